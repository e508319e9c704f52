/** The jobs list: keeping it in step with the server, filtering and sorting it. */
import { isActive, type Job, type Status } from "../api/types";
import { jobName } from "./format";

export type JobMap = ReadonlyMap<string, Job>;
export type SortKey = "created" | "name" | "status" | "time" | "faces";

export interface View {
  text: string;
  statuses: ReadonlySet<Status>;
  sort: SortKey;
  descending: boolean;
}

export const FIRST_VIEW: View = { text: "", statuses: new Set(), sort: "created", descending: true };

export function withJobs(known: JobMap, fresh: readonly Job[]): JobMap {
  const next = new Map(known);
  for (const job of fresh) next.set(job.id, job);
  return next;
}

export function withoutJobs(known: JobMap, ids: Iterable<string>): JobMap {
  const next = new Map(known);
  for (const id of ids) next.delete(id);
  return next;
}

/**
 * Merges the newest page. Ids grow with time, so a known job whose id lies within the page's range
 * but which is not on it was deleted elsewhere.
 */
export function withNewestPage(known: JobMap, page: readonly Job[], isLast: boolean): JobMap {
  const oldest = isLast ? "" : (page.at(-1)?.id ?? "");
  const present = new Set(page.map((job) => job.id));
  const gone = [...known.keys()].filter((id) => id >= oldest && !present.has(id));
  return withJobs(withoutJobs(known, gone), page);
}

/** Known unfinished jobs that the server no longer lists as such: they ended or were deleted. */
export function ended(known: JobMap, active: readonly Job[]): string[] {
  const present = new Set(active.map((job) => job.id));
  return [...known.values()].filter((job) => isActive(job) && !present.has(job.id)).map((j) => j.id);
}

const ORDER: Record<Status, number> = { running: 0, queued: 1, failed: 2, succeeded: 3, cancelled: 4 };

const KEYS: Record<SortKey, (job: Job) => string | number> = {
  created: (job) => job.id,
  name: (job) => jobName(job).toLowerCase(),
  status: (job) => ORDER[job.status],
  time: (job) => job.timings.running_seconds ?? -1,
  faces: (job) => job.result?.faces ?? -1,
};

export function visible(jobs: JobMap, hidden: ReadonlySet<string>, view: View): Job[] {
  const words = view.text.toLowerCase().split(/\s+/).filter(Boolean);
  const found = [...jobs.values()].filter(
    (job) =>
      !hidden.has(job.id) &&
      (view.statuses.size === 0 || view.statuses.has(job.status)) &&
      matches(job, words),
  );
  const key = KEYS[view.sort];
  const sign = view.descending ? -1 : 1;
  return found.sort((a, b) => sign * compare(key(a), key(b)) || compare(b.id, a.id));
}

/** From this length on a word is looked for in ids too: shorter ones occur in random ids by chance. */
const ID_WORD = 8;

function matches(job: Job, words: readonly string[]): boolean {
  const text = `${job.label ?? ""} ${job.scan.name}`.toLowerCase();
  const id = job.id.toLowerCase();
  return words.every((word) => text.includes(word) || (word.length >= ID_WORD && id.includes(word)));
}

function compare(a: string | number, b: string | number): number {
  return a < b ? -1 : a > b ? 1 : 0;
}

export function countByStatus(jobs: JobMap, hidden: ReadonlySet<string>): Record<Status, number> {
  const counts = { queued: 0, running: 0, succeeded: 0, failed: 0, cancelled: 0 };
  for (const job of jobs.values()) if (!hidden.has(job.id)) counts[job.status] += 1;
  return counts;
}

/** Which rows [first, last) of fixed height lie in the window, with some to spare. */
export function rowsInView(
  total: number,
  rowHeight: number,
  scrolled: number,
  height: number,
  spare = 6,
): { first: number; last: number } {
  const first = Math.max(0, Math.floor(scrolled / rowHeight) - spare);
  const last = Math.min(total, Math.ceil((scrolled + height) / rowHeight) + spare);
  return { first: Math.min(first, total), last: Math.max(last, 0) };
}
