/** A job's settings as text that can be used elsewhere. */
import type { Params } from "../api/types";

export type SnippetKind = "json" | "curl" | "python";

export function snippet(kind: SnippetKind, scan: string, params: Params, origin: string): string {
  if (kind === "json") return visibly(JSON.stringify(params, null, 2));
  return kind === "curl" ? curl(scan, params, origin) : python(scan, params, origin);
}

function curl(scan: string, params: Params, origin: string): string {
  // Inside -F, curl itself reads quotes, backslashes and semicolons; quoting the name stops that.
  const file = `file=@"${scan.replaceAll("\\", "\\\\").replaceAll('"', '\\"')}"`;
  return [
    `curl ${shellQuoted(`${origin}/v1/jobs`)}`,
    `  -F ${shellQuoted(file)}`,
    `  --form-string ${shellQuoted(`params=${visibly(JSON.stringify(params))}`)}`,
  ].join(" \\\n");
}

function python(scan: string, params: Params, origin: string): string {
  const settings = Object.entries(params).map(([name, value]) => `        ${name}=${pythonic(value)},`);
  return [
    "from service.client import Client",
    "",
    `with Client(${pythonic(origin)}) as client:`,
    "    job = client.submit(",
    `        ${pythonic(scan)},`,
    ...settings,
    "    )",
    "    job = client.wait(job.id)",
    '    client.download(job.id, "mesh.glb", "mesh.glb")',
  ].join("\n");
}

export function shellQuoted(text: string): string {
  return `'${text.replaceAll("'", `'\\''`)}'`;
}

/** JSON's strings and numbers are Python's too; its three words are not. */
export function pythonic(value: unknown): string {
  if (value === null || value === undefined) return "None";
  if (typeof value === "boolean") return value ? "True" : "False";
  if (Array.isArray(value)) return `[${value.map(pythonic).join(", ")}]`;
  return visibly(JSON.stringify(value));
}

/** JSON and Python know the same way to write what would turn the direction of reading. */
function visibly(text: string): string {
  return text.replace(/[\u202a-\u202e\u2066-\u2069]/g, (one) => `\\u${one.charCodeAt(0).toString(16)}`);
}
