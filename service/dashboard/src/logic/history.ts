/** What a job's events say: phases on a time line, loss curves, levels and a log. */
import type { Progress, Status } from "../api/types";
import { phaseName } from "./format";
import type { ServerEvent } from "./sse";

export interface Segment {
  phase: string;
  /** Nodes per axis, or 0 outside the levels. */
  resolution: number;
  /** Milliseconds since 1970. `end` grows while the segment is the last one. */
  start: number;
  end: number;
}

export interface LossPoint {
  resolution: number;
  step: number;
  terms: Readonly<Record<string, number>>;
}

export interface Level {
  resolution: number;
  artifact: string;
  vertices: number;
  faces: number;
}

export interface LogLine {
  at: number;
  text: string;
}

export interface History {
  lastId: number;
  attempt: number;
  segments: readonly Segment[];
  losses: readonly LossPoint[];
  levels: readonly Level[];
  lines: readonly LogLine[];
  progress: Progress | null;
  end: Status | null;
}

export const NO_HISTORY: History = {
  lastId: 0,
  attempt: 0,
  segments: [],
  losses: [],
  levels: [],
  lines: [],
  progress: null,
  end: null,
};

/** The history after one more event; one that was seen before changes nothing. */
export function withEvent(history: History, event: ServerEvent): History {
  if (event.id <= history.lastId) return history;
  const at = Date.parse(String(event.data["at"]));
  const next = { ...history, lastId: event.id };
  switch (event.type) {
    case "queued":
      return logged(withSegment(next, "queued", 0, at), at, "Queued");
    case "started":
      return started(next, event.data, at);
    case "progress":
      return progressed(next, event.data as unknown as Progress, at);
    case "level":
      return leveled(next, event.data as unknown as Level, at);
    case "requeued":
      return logged(withSegment(next, "queued", 0, at), at, String(event.data["detail"]));
    case "degraded":
      return logged(next, at, String(event.data["detail"]));
    case "cancel_requested":
      return logged(next, at, "Cancel asked for");
    case "succeeded":
    case "failed":
    case "cancelled":
      return finished(next, event.type, event.data, at);
    default:
      return next;
  }
}

function started(history: History, data: Record<string, unknown>, at: number): History {
  const attempt = Number(data["attempt"]);
  const again = attempt > 1 ? `, attempt ${attempt}` : "";
  const fresh = { ...history, attempt, losses: [], levels: [], progress: null };
  return logged(withSegment(fresh, "fetch", 0, at), at, `Started on ${data["device"]}${again}`);
}

function progressed(history: History, progress: Progress, at: number): History {
  const changed = history.progress?.phase !== progress.phase;
  let next = { ...withSegment(history, progress.phase, progress.resolution, at), progress };
  if (Object.keys(progress.losses).length > 0) {
    const point = { resolution: progress.resolution, step: progress.step, terms: progress.losses };
    next = { ...next, losses: [...next.losses, point] };
  }
  return changed ? logged(next, at, phaseName(progress.phase)) : next;
}

function leveled(history: History, level: Level, at: number): History {
  const others = history.levels.filter((one) => one.resolution !== level.resolution);
  const levels = [...others, level].sort((a, b) => a.resolution - b.resolution);
  const faces = level.faces.toLocaleString("en-US");
  return logged({ ...history, levels }, at, `Level ${level.resolution}: ${faces} triangles`);
}

function finished(
  history: History,
  end: Status,
  data: Record<string, unknown>,
  at: number,
): History {
  const outcome = (data["result"] as { outcome?: { message?: string } } | undefined)?.outcome;
  const error = data["error"] as { detail?: string } | undefined;
  const text = outcome?.message ?? error?.detail ?? "Cancelled";
  return logged({ ...history, segments: stretched(history.segments, at), end }, at, text);
}

function withSegment(history: History, phase: string, resolution: number, at: number): History {
  const segments = stretched(history.segments, at);
  const last = segments.at(-1);
  const same = last?.phase === phase && (resolution === 0 || last.resolution === resolution);
  if (same) return { ...history, segments };
  if (last?.phase === phase && last.resolution === 0) {
    // The first report of a level comes with its first step; the time before belongs to it.
    return { ...history, segments: [...segments.slice(0, -1), { ...last, resolution }] };
  }
  return { ...history, segments: [...segments, { phase, resolution, start: at, end: at }] };
}

function stretched(segments: readonly Segment[], at: number): readonly Segment[] {
  const last = segments.at(-1);
  return last ? [...segments.slice(0, -1), { ...last, end: Math.max(last.end, at) }] : segments;
}

function logged(history: History, at: number, text: string): History {
  return { ...history, lines: [...history.lines, { at, text }] };
}

/** What came after the last wait in the queue. */
export function latestAttempt(segments: readonly Segment[]): readonly Segment[] {
  return segments.slice(segments.findLastIndex((segment) => segment.phase === "queued") + 1);
}

/** Splits the writing off the end: no event tells of it, but the ended job knows how long it took. */
export function withWriting(segments: readonly Segment[], seconds: number): readonly Segment[] {
  const last = segments.at(-1);
  if (!last || last.phase === "write" || !(seconds > 0)) return segments;
  const begun = Math.max(last.start, last.end - 1000 * seconds);
  const writing = { phase: "write", resolution: 0, start: begun, end: last.end };
  return [...segments.slice(0, -1), { ...last, end: begun }, writing];
}

/** Seconds of each phase, in the order of their first appearance. */
export function phaseSeconds(segments: readonly Segment[]): Array<{ name: string; seconds: number }> {
  const sums = new Map<string, number>();
  for (const { phase, start, end } of segments) {
    sums.set(phase, (sums.get(phase) ?? 0) + (end - start) / 1000);
  }
  return [...sums].map(([name, seconds]) => ({ name, seconds }));
}
