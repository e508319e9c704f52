import { describe, expect, it } from "vitest";
import { chart } from "../src/logic/chart";
import { metric, settingsRows } from "../src/logic/compare";
import { isScanName, sortFiles } from "../src/logic/files";
import { bytes, duration, plainName, significant } from "../src/logic/format";
import { pythonic, shellQuoted, snippet } from "../src/logic/snippets";
import { routeOf } from "../src/state/route";
import { option } from "./samples";

describe("numbers", () => {
  it.each([
    [0.004, "0.00 s"],
    [0.5, "0.50 s"],
    [9.96, "10 s"],
    [59.6, "1 min"],
    [61, "1 min 1 s"],
    [3725, "1 h 2 min"],
    [null, "–"],
  ])("%s seconds are %s", (seconds, text) => expect(duration(seconds)).toBe(text));

  it.each([
    [0, "0 B"],
    [999, "999 B"],
    [1500, "1.5 kB"],
    [1_350_233, "1.4 MB"],
    [2.4e9, "2.4 GB"],
  ])("%s bytes are %s", (size, text) => expect(bytes(size)).toBe(text));

  it.each([
    [0, "0"],
    [0.29612, "0.296"],
    [1234.5, "1235"],
    [2.17e-8, "2.17e-8"],
    [3e7, "3.00e7"],
  ])("%s is %s", (value, text) => expect(significant(value)).toBe(text));
});

describe("names", () => {
  it("cannot turn the text around them", () => {
    expect(plainName("a\u202egpj.ply")).toBe("a\ufffdgpj.ply");
    expect(plainName("line\nbreak\u2028")).toBe("line\ufffdbreak\ufffd");
  });

  it("may be of any script", () => {
    for (const name of ["مسح\u200f (1).ply", "扫描.ply", "<b>.ply", "🐙.ply"]) expect(plainName(name)).toBe(name);
  });
});

describe("snippets", () => {
  const hostile = `it's "a" $(rm); scan.ply`;

  it("leave nothing for a shell to read", () => {
    expect(shellQuoted(hostile)).toBe(`'it'\\''s "a" $(rm); scan.ply'`);
    expect(snippet("curl", hostile, {}, "http://h")).toContain(`-F 'file=@"it'\\''s \\"a\\" $(rm); scan.ply"'`);
  });

  it("are valid Python", () => {
    expect(pythonic({ a: 1 }.a)).toBe("1");
    expect(pythonic([null, true, "ü\n"])).toBe('[None, True, "ü\\n"]');
    expect(snippet("python", "a.ply", { trim: null, resolution: 64 }, "http://h")).toContain("resolution=64,");
  });

  it("show every character that turns the direction of reading", () => {
    const params = { label: "a\u202eb" };
    for (const kind of ["json", "curl", "python"] as const) {
      expect(snippet(kind, "a.ply", params, "http://h")).toContain(String.raw`"a\u202eb"`);
    }
    expect(JSON.parse(snippet("json", "a", params, ""))).toEqual(params);
  });

  it("are the params as JSON", () => {
    expect(JSON.parse(snippet("json", "a", { x: [1] }, ""))).toEqual({ x: [1] });
  });
});

describe("files", () => {
  it("are scans by their ending", () => {
    expect(["a.PLY", "b.e57", "c.tar.xyz"].every(isScanName)).toBe(true);
    expect([".ply", "ply", "notes.pdf"].some(isScanName)).toBe(false);
  });

  it("that are hidden are left out in silence", () => {
    const files = [".DS_Store", "a.ply", "b.jpg"].map((name) => new File([], name));
    const { scans, others } = sortFiles(files);
    expect([scans.map((file) => file.name), others]).toEqual([["a.ply"], 1]);
  });
});

describe("comparisons", () => {
  it("put the defaults where nothing was set", () => {
    const rows = settingsRows([option({ name: "resolution", default: 256 })], [{}, { resolution: 256 }, { resolution: 64 }]);
    expect(rows).toEqual([{ name: "resolution", values: [256, 256, 64], differs: true }]);
  });

  it("mark the best only where there is one", () => {
    expect(metric("d", "", [3, 1, null], "low", String).best).toBe(1);
    expect(metric("d", "", [1, 1], "low", String).best).toBe(-1);
    expect(metric("d", "", [1.01, 1.02, 3], "low", (value) => value.toFixed(1)).best).toBe(-1);
    expect(metric("d", "", [1, null], "low", String).best).toBe(-1);
    expect(metric("d", "", [1, 2], "none", String).best).toBe(-1);
  });
});

describe("loss curves", () => {
  it("span the whole powers of ten, the largest on top", () => {
    const points = [
      { resolution: 64, step: 1, terms: { point: 10, viscosity: 0 } },
      { resolution: 128, step: 1, terms: { point: 0.1, viscosity: 0 } },
    ];
    const { curves, ticks, levels } = chart(points, 100, 50);
    expect(curves).toEqual([{ name: "point", path: "M0.0 0.0L100.0 50.0", last: 0.1 }]);
    expect(ticks.map(([value]) => value)).toEqual([0.1, 1, 10]);
    expect(levels).toEqual([[64, 0], [128, 100]]);
  });

  it("are empty without steps", () => {
    expect(chart([], 100, 50).curves).toEqual([]);
  });
});

it("addresses name pages", () => {
  const at = (url: string) => {
    const { pathname, searchParams } = new URL(url, "http://h");
    return routeOf(pathname, searchParams);
  };
  expect(at("/")).toEqual({ page: "jobs" });
  expect(at("/jobs/01a")).toEqual({ page: "job", id: "01a" });
  expect(at("/compare?jobs=a,b,a,c,d,e")).toEqual({ page: "compare", ids: ["a", "b", "c", "d"] });
  expect(at("/jobs/01a/more")).toEqual({ page: "missing" });
});
