/** All jobs, kept in step with the server while the page is looked at. */
import { computed, effect, signal } from "@preact/signals";
import { cancelJob, deleteJob, fetchInfo, fetchJob, fetchJobs } from "../api/calls";
import { Refused, sentence, Unreachable } from "../api/http";
import { patiently } from "../api/patience";
import { type Info, isActive, type Job } from "../api/types";
import {
  ended,
  FIRST_VIEW,
  type JobMap,
  type View,
  visible,
  withJobs,
  withNewestPage,
  withoutJobs,
} from "../logic/listing";
import { epoch, online, pause } from "./connection";
import { apiKey, keyWanted } from "./session";
import { say, sayWithUndo } from "./toasts";

export const jobs = signal<JobMap>(new Map());
/** Jobs whose deletion can still be undone. */
export const hidden = signal<ReadonlySet<string>>(new Set());
export const view = signal<View>(FIRST_VIEW);
export const shown = computed(() => visible(jobs.value, hidden.value, view.value));
export const info = signal<Info | null>(null);
/** False until the newest page has come; true for `whole` once all pages have. */
export const loaded = signal(false);
export const whole = signal(false);
export const trouble = signal("");

const BUSY_MILLISECONDS = 1000;
const QUIET_MILLISECONDS = 4000;
const PAGE = 200;
let watching = false;

/** Keep the list fresh from now on. */
export function watchJobs(): void {
  if (watching) return;
  watching = true;
  void loop();
  effect(() => {
    void epoch.value;
    void apiKey.value;
    wake();
  });
  document.addEventListener("visibilitychange", () => !document.hidden && wake());
}

let waker = new AbortController();
function wake(): void {
  waker.abort();
}

async function loop(): Promise<never> {
  for (;;) {
    let told = 0;
    if (online.peek() && !keyWanted.peek() && !document.hidden) told = await refresh();
    const busy = [...jobs.peek().values()].some(isActive);
    waker = new AbortController();
    const wait = busy ? BUSY_MILLISECONDS : QUIET_MILLISECONDS;
    await pause(Math.max(wait, told), waker.signal).catch(() => undefined);
  }
}

/** Gives the milliseconds that the server wants to be left alone. */
async function refresh(): Promise<number> {
  try {
    info.value = await fetchInfo();
    const newest = await fetchJobs({ limit: whole.peek() ? 50 : PAGE });
    jobs.value = withNewestPage(jobs.peek(), newest.jobs, newest.next_cursor === null);
    loaded.value = true;
    if (!whole.peek()) await loadOlder(newest.next_cursor);
    else await refreshActive();
    trouble.value = "";
  } catch (error) {
    if (!(error instanceof Unreachable)) trouble.value = sentence(error);
    if (error instanceof Refused) return error.retryAfterSeconds * 1000;
  }
  return 0;
}

async function loadOlder(first: string | null): Promise<void> {
  let cursor = first;
  while (cursor) {
    const page = await fetchJobs({ cursor, limit: PAGE });
    jobs.value = withJobs(jobs.peek(), page.jobs);
    cursor = page.next_cursor;
  }
  whole.value = true;
}

async function refreshActive(): Promise<void> {
  if (![...jobs.peek().values()].some(isActive)) return;
  const before = jobs.peek();
  const { jobs: active, next_cursor } = await fetchJobs({ status: ["queued", "running"], limit: PAGE });
  jobs.value = withJobs(jobs.peek(), active);
  if (next_cursor === null) for (const id of ended(before, active).slice(0, 20)) await refreshJob(id);
}

/** Look at one job again; a job that is gone leaves the list. */
export async function refreshJob(id: string): Promise<void> {
  try {
    jobs.value = withJobs(jobs.peek(), [await fetchJob(id)]);
  } catch (error) {
    if (!(error instanceof Refused && error.status === 404)) throw error;
    jobs.value = withoutJobs(jobs.peek(), [id]);
  }
}

export function remember(job: Job): void {
  jobs.value = withJobs(jobs.peek(), [job]);
}

/** Delete after a moment in which it can be undone. */
export function deleteJobs(ids: readonly string[]): void {
  hidden.value = new Set([...hidden.peek(), ...ids]);
  const reveal = () => {
    hidden.value = new Set([...hidden.peek()].filter((id) => !ids.includes(id)));
  };
  const act = (leaving: boolean) => void sendAll(ids, (id) => deleteJob(id, leaving)).then((done) => {
    jobs.value = withoutJobs(jobs.peek(), done);
    reveal();
  });
  sayWithUndo(`Deleted ${named(ids)}`, act, reveal);
}

/** Cancel after a moment in which it can be undone. */
export function cancelJobs(ids: readonly string[]): void {
  const act = () => void sendAll(ids, async (id) => remember(await cancelJob(id)));
  sayWithUndo(`Cancelling ${named(ids)}`, act, () => undefined);
}

function named(ids: readonly string[]): string {
  return ids.length === 1 ? "1 job" : `${ids.length} jobs`;
}

async function sendAll(ids: readonly string[], send: (id: string) => Promise<unknown>) {
  const done: string[] = [];
  const refusals: string[] = [];
  for (const id of ids) {
    try {
      await patiently(() => send(id));
      done.push(id);
    } catch (error) {
      const settled = error instanceof Refused && ["job_finished", "job_not_found"].includes(error.code);
      if (settled) done.push(id);
      else refusals.push(sentence(error));
    }
  }
  if (refusals.length > 0) say(`${named(refusals)} not changed: ${refusals[0]}`, "bad");
  wake();
  return done;
}
