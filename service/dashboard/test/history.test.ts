import { describe, expect, it } from "vitest";
import { type History, latestAttempt, NO_HISTORY, phaseSeconds, withEvent, withWriting } from "../src/logic/history";
import type { ServerEvent } from "../src/logic/sse";

let id = 0;
function event(type: string, seconds: number, data: Record<string, unknown> = {}): ServerEvent {
  return { id: ++id, type, data: { at: new Date(seconds * 1000).toISOString(), ...data } };
}

function progress(seconds: number, phase: string, resolution = 0, step = 0, losses = {}): ServerEvent {
  return event("progress", seconds, { phase, resolution, step, losses, fraction: 0.5 });
}

function run(...events: ServerEvent[]): History {
  return events.reduce(withEvent, NO_HISTORY);
}

describe("the time line", () => {
  it("has the writing at its end, of which no event tells", () => {
    const extract = { phase: "extract", resolution: 256, start: 1000, end: 3000 };
    expect(withWriting([extract], 0.5)).toEqual([
      { ...extract, end: 2500 },
      { phase: "write", resolution: 0, start: 2500, end: 3000 },
    ]);
    expect(withWriting([extract], 0)).toEqual([extract]);
    expect(withWriting([], 1)).toEqual([]);
  });

  it("charges the time from one phase's report to the next", () => {
    const history = run(
      event("queued", 0),
      event("started", 2, { attempt: 1, device: "cpu" }),
      progress(3, "prepare"),
      progress(4, "solve"),
      progress(5, "solve", 64, 1),
      progress(7, "solve", 128, 1),
      event("succeeded", 9, {}),
    );
    const parts = history.segments.map(({ phase, resolution, start, end }) => [phase, resolution, (end - start) / 1000]);
    expect(parts).toEqual([
      ["queued", 0, 2],
      ["fetch", 0, 1],
      ["prepare", 0, 1],
      ["solve", 64, 3],
      ["solve", 128, 2],
    ]);
    expect(phaseSeconds(history.segments).find((one) => one.name === "solve")?.seconds).toBe(5);
    expect(latestAttempt(history.segments)[0]?.phase).toBe("fetch");
    expect(history.end).toBe("succeeded");
  });
});

describe("events", () => {
  it("count once, however often they come", () => {
    const once = progress(1, "solve", 64, 1, { point: 1 });
    expect(run(once, once).losses).toHaveLength(1);
  });

  it("begin anew with a second attempt, but keep the log", () => {
    const history = run(
      event("started", 0, { attempt: 1, device: "cpu" }),
      progress(1, "solve", 64, 1, { point: 1 }),
      event("level", 2, { resolution: 64, artifact: "level-64.glb", vertices: 1, faces: 2 }),
      event("requeued", 3, { detail: "The worker was lost." }),
      event("started", 5, { attempt: 2, device: "gpu" }),
    );
    expect(history.losses).toEqual([]);
    expect(history.levels).toEqual([]);
    expect(history.lines.map((line) => line.text)).toContain("The worker was lost.");
    expect(history.lines.at(-1)?.text).toBe("Started on gpu, attempt 2");
  });

  it("end with the failure's advice in the log", () => {
    const history = run(event("failed", 1, { error: { code: "x", detail: "Use fewer points." } }));
    expect(history.end).toBe("failed");
    expect(history.lines.at(-1)?.text).toBe("Use fewer points.");
  });

  it("of an unknown kind only move the place", () => {
    const strange = event("curious", 1);
    expect(run(strange)).toEqual({ ...NO_HISTORY, lastId: strange.id });
  });
});
