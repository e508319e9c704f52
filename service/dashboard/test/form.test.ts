import { describe, expect, it } from "vitest";
import { arrange, checkDraft, draftOf, parseField, retryChanges, serverErrors } from "../src/logic/form";
import { option } from "./samples";

const resolution = option({ name: "resolution", type: "integer", default: 256, nullable: false, minimum: 64, maximum: 1024 });
const profile = option({ name: "profile", type: "string", default: "fast", choices: ["fast", "paper"] });
const steps = option({ name: "outer_steps", type: "integers", minimum: 1, expert: true, group: "schedule" });
const outputs = option({ name: "outputs", type: "strings", default: ["a", "b"], choices: ["a", "b", "c"] });
const label = option({ name: "label", type: "string", maximum: 5, group: "job" });
const crop = option({ name: "crop", type: "numbers" });

describe("a field", () => {
  it("means the default when it is empty", () => {
    expect(parseField(resolution, "  ")).toBe("default");
    expect(parseField(resolution, undefined)).toBe("default");
  });

  it.each(["abc", "0x80", "1e999", "128 px", "--1"])("refuses %j as a number", (text) => {
    expect(parseField(resolution, text)).toHaveProperty("error");
  });

  it("takes decimals and exponents where they are whole", () => {
    expect(parseField(resolution, "1e2")).toEqual({ value: 100 });
    expect(parseField(resolution, "100.5")).toEqual({ error: "Type a whole number." });
  });

  it("names the range that was left", () => {
    expect(parseField(resolution, "63")).toEqual({ error: "Between 64 and 1024." });
    expect(parseField(resolution, "64")).toEqual({ value: 64 });
  });

  it("reads lists with spaces or commas", () => {
    expect(parseField(steps, "5, 4 3")).toEqual({ value: [5, 4, 3] });
    expect(parseField(steps, "5 x")).toEqual({ error: "Type a number. “x” is none." });
  });

  it("wants a box with ordered corners", () => {
    expect(parseField(crop, "0 0 0 1 1 1")).toEqual({ value: [0, 0, 0, 1, 1, 1] });
    expect(parseField(crop, "0 0 0 1 1 0")).toHaveProperty("error");
    expect(parseField(crop, "0 0 0")).toHaveProperty("error");
  });

  it("limits texts and choices", () => {
    expect(parseField(label, "123456")).toHaveProperty("error");
    expect(parseField(profile, "slow")).toHaveProperty("error");
  });
});

describe("a draft", () => {
  it("sends only what differs from the defaults", () => {
    const draft = { resolution: "256", profile: "paper", outputs: ["b", "a"] };
    const { params, errors } = checkDraft([resolution, profile, outputs], draft);
    expect(params).toEqual({ profile: "paper" });
    expect(errors).toEqual({});
  });

  it("comes back from the params that it made", () => {
    const all = [resolution, steps, outputs, label];
    const params = { resolution: 128, outer_steps: [5, 4], outputs: ["c"], label: "x" };
    expect(checkDraft(all, draftOf(all, params)).params).toEqual(params);
  });

  it("names a setting that goes back to its default, since retry merges", () => {
    const changes = retryChanges([resolution, label], { resolution: 128, label: "x" }, { label: "y" });
    expect(changes).toEqual({ label: "y", resolution: 256 });
  });
});

it("puts the server's complaints beside their fields", () => {
  expect(serverErrors([{ path: "params.resolution", detail: "Too large." }, { path: "params", detail: "?" }])).toEqual({
    resolution: "Too large.",
  });
});

it("folds expert options into groups and puts the label first", () => {
  const { basic, expert } = arrange([resolution, steps, label]);
  expect(basic.map((one) => one.name)).toEqual(["label", "resolution"]);
  expect(expert).toEqual([{ title: "Schedule", options: [steps] }]);
});
