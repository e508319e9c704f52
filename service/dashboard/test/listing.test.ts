import { describe, expect, it } from "vitest";
import { countByStatus, ended, FIRST_VIEW, rowsInView, visible, withNewestPage } from "../src/logic/listing";
import { job, jobMap } from "./samples";

const NONE = new Set<string>();

describe("the newest page", () => {
  it("adds and replaces jobs", () => {
    const known = jobMap(job("a"), job("b", { status: "running" }));
    const next = withNewestPage(known, [job("c"), job("b")], false);
    expect([...next.keys()].sort()).toEqual(["a", "b", "c"]);
    expect(next.get("b")?.status).toBe("succeeded");
  });

  it("drops a job within its range that is not on it", () => {
    const known = jobMap(job("a"), job("b"), job("c"));
    expect(withNewestPage(known, [job("c"), job("a")], false).has("b")).toBe(false);
  });

  it("says nothing of older jobs unless it is the last page", () => {
    const known = jobMap(job("a"), job("c"));
    expect(withNewestPage(known, [job("c")], false).has("a")).toBe(true);
    expect(withNewestPage(known, [job("c")], true).has("a")).toBe(false);
  });

  it("can be empty", () => {
    expect(withNewestPage(jobMap(job("a")), [], true).size).toBe(0);
  });
});

it("finds jobs that ended since they were last seen", () => {
  const known = jobMap(job("a", { status: "queued" }), job("b", { status: "running" }), job("c"));
  expect(ended(known, [job("b", { status: "running" })])).toEqual(["a"]);
});

describe("the view", () => {
  const jobs = jobMap(
    job("a", { label: "Bracket left", status: "failed" }),
    job("b", { label: "bracket right" }),
    job("c", { label: "anchor" }),
  );

  it("shows the newest first", () => {
    expect(visible(jobs, NONE, FIRST_VIEW).map((one) => one.id)).toEqual(["c", "b", "a"]);
  });

  it("matches every word, in any case, in label and file name", () => {
    expect(visible(jobs, NONE, { ...FIRST_VIEW, text: "BRACKET .ply r" }).map((one) => one.id)).toEqual(["b", "a"]);
    expect(visible(jobs, NONE, { ...FIRST_VIEW, text: "bracket left" }).map((one) => one.id)).toEqual(["a"]);
  });

  it("finds a job by its id or a longer part of it, not by a number that is in it by chance", () => {
    const id = "01KB5Z1234QXJ7M0T9V8W6Y3R2";
    const both = jobMap(job(id, { scan: { ...job("").scan, name: "arm.ply" } }), job("x", { label: "part 1234" }));
    const found = (text: string) => visible(both, NONE, { ...FIRST_VIEW, text }).map((one) => one.id);
    expect(found("1234")).toEqual(["x"]);
    expect(found(id)).toEqual([id]);
    expect(found("qxj7m0t9 arm")).toEqual([id]);
  });

  it("keeps to the chosen states and leaves out what is being deleted", () => {
    const view = { ...FIRST_VIEW, statuses: new Set(["succeeded"] as const) };
    expect(visible(jobs, new Set(["c"]), view).map((one) => one.id)).toEqual(["b"]);
    expect(countByStatus(jobs, new Set(["c"])).succeeded).toBe(1);
  });

  it("sorts by name, and newest first among equals", () => {
    const twins = jobMap(job("a", { label: "x" }), job("b", { label: "x" }), job("c", { label: "w" }));
    const view = { ...FIRST_VIEW, sort: "name" as const, descending: false };
    expect(visible(twins, NONE, view).map((one) => one.id)).toEqual(["c", "b", "a"]);
  });
});

describe("the rows in the window", () => {
  it("are few, however long the list is", () => {
    expect(rowsInView(5000, 64, 64_000, 640, 2)).toEqual({ first: 998, last: 1012 });
  });

  it("stay within the list", () => {
    expect(rowsInView(3, 64, -500, 900)).toEqual({ first: 0, last: 3 });
    expect(rowsInView(3, 64, 9000, 900)).toEqual({ first: 3, last: 3 });
    expect(rowsInView(0, 64, 0, 900)).toEqual({ first: 0, last: 0 });
  });
});
