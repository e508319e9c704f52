/** Scans on their way in: each file is uploaded and then submitted with its settings. */
import { computed, signal } from "@preact/signals";
import { submitJob } from "../api/calls";
import { sentence } from "../api/http";
import { patiently } from "../api/patience";
import type { Params } from "../api/types";
import { uploadFile } from "../api/upload";
import { remember } from "./jobs";

export interface Item {
  key: string;
  file: File;
  /** Nothing else was submitted with it. */
  alone: boolean;
  params: Params;
  state: "waiting" | "uploading" | "submitting" | "done" | "failed";
  sent: number;
  error: string;
  jobId: string;
}

const AT_ONCE = 2;
export const items = signal<readonly Item[]>([]);
/** Files that were chosen but not yet submitted. */
export const chosen = signal<readonly File[]>([]);
export const underway = computed(() => items.value.some((item) => !isSettled(item)));
const stoppers = new Map<string, AbortController>();

export function isSettled(item: Item): boolean {
  return item.state === "done" || item.state === "failed";
}

export function choose(files: readonly File[]): void {
  const same = (a: File, b: File) => a.name === b.name && a.size === b.size && a.lastModified === b.lastModified;
  const fresh = files.filter((file) => !chosen.peek().some((one) => same(one, file)));
  chosen.value = [...chosen.peek(), ...fresh];
}

export function send(files: readonly File[], params: Params): void {
  const fresh = files.map((file) => ({
    key: newKey(),
    file,
    alone: files.length === 1,
    params,
    state: "waiting" as const,
    sent: 0,
    error: "",
    jobId: "",
  }));
  items.value = [...items.peek(), ...fresh];
  next();
}

export function giveUp(key: string): void {
  stoppers.get(key)?.abort();
  items.value = items.peek().filter((item) => item.key !== key);
  next();
}

/** Those that are submitted need no place here. */
export function clearDone(): void {
  items.value = items.peek().filter((item) => item.state !== "done");
}

export function again(key: string): void {
  change(key, { state: "waiting", error: "" });
  next();
}

function next(): void {
  const busy = items.peek().filter((item) => stoppers.has(item.key)).length;
  const waiting = items.peek().filter((item) => item.state === "waiting" && !stoppers.has(item.key));
  for (const item of waiting.slice(0, AT_ONCE - busy)) void work(item);
}

async function work(item: Item): Promise<void> {
  const stopper = new AbortController();
  stoppers.set(item.key, stopper);
  try {
    change(item.key, { state: "uploading" });
    const onProgress = (sent: number) => change(item.key, { sent });
    const upload = await uploadFile(item.file, { onProgress, signal: stopper.signal });
    change(item.key, { state: "submitting", sent: item.file.size });
    const jobId = await submit(upload.id, item, stopper.signal);
    change(item.key, { state: "done", jobId });
  } catch (error) {
    change(item.key, { state: "failed", error: sentence(error) });
  }
  stoppers.delete(item.key);
  next();
}

async function submit(uploadId: string, item: Item, signal: AbortSignal): Promise<string> {
  const job = await patiently(() => submitJob(uploadId, item.params, item.key), signal);
  remember(job);
  return job.id;
}

function change(key: string, fields: Partial<Item>): void {
  items.value = items.peek().map((item) => (item.key === key ? { ...item, ...fields } : item));
}

/** Unguessable, and also where the page is not a secure context. */
export function newKey(): string {
  const words = crypto.getRandomValues(new Uint32Array(4));
  return [...words].map((word) => word.toString(16).padStart(8, "0")).join("");
}
