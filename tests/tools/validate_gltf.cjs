// Prints what the Khronos validator says about each file named on the command line, as JSON.
const fs = require("fs");
const validator = require("gltf-validator");

const check = (path) =>
  validator.validateBytes(new Uint8Array(fs.readFileSync(path))).then((report) => report.issues);

Promise.all(process.argv.slice(2).map(check)).then((issues) => {
  process.stdout.write(JSON.stringify(issues));
});
