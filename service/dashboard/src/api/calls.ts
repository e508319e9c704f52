/** The calls of the REST API that the dashboard makes. */
import { call, json } from "./http";
import type { Info, Job, JobPage, Option, Params, Status } from "./types";

export function fetchInfo(): Promise<Info> {
  return json<Info>("/v1/info");
}

/** Throws Refused unless the server knows the key. */
export async function tryKey(key: string): Promise<void> {
  await call("/v1/info", { headers: { Authorization: `Bearer ${key}` } });
}

export async function fetchOptions(): Promise<Option[]> {
  return (await json<{ options: Option[] }>("/v1/options")).options;
}

export function fetchJob(id: string, signal?: AbortSignal): Promise<Job> {
  return json<Job>(`/v1/jobs/${encodeURIComponent(id)}`, { signal });
}

export interface JobQuery {
  status?: Status[];
  cursor?: string | null;
  limit?: number;
}

export function fetchJobs({ status = [], cursor, limit = 100 }: JobQuery): Promise<JobPage> {
  const query = new URLSearchParams({ limit: String(limit) });
  for (const one of status) query.append("status", one);
  if (cursor) query.set("cursor", cursor);
  return json<JobPage>(`/v1/jobs?${query}`);
}

/** The same `idempotencyKey` never makes a second job, so a lost answer may be asked for again. */
export function submitJob(uploadId: string, params: Params, idempotencyKey: string): Promise<Job> {
  const body = new FormData();
  body.set("upload_id", uploadId);
  body.set("params", JSON.stringify(params));
  return json<Job>("/v1/jobs", {
    method: "POST",
    body,
    headers: { "Idempotency-Key": idempotencyKey },
  });
}

export function cancelJob(id: string): Promise<Job> {
  return json<Job>(`/v1/jobs/${encodeURIComponent(id)}/cancel`, { method: "POST" });
}

export function retryJob(id: string, changes: Params, idempotencyKey: string): Promise<Job> {
  return json<Job>(`/v1/jobs/${encodeURIComponent(id)}/retry`, {
    method: "POST",
    body: JSON.stringify(changes),
    headers: { "Content-Type": "application/json", "Idempotency-Key": idempotencyKey },
  });
}

/** `keepalive` lets the call finish after the page is left. */
export async function deleteJob(id: string, keepalive = false): Promise<void> {
  await call(`/v1/jobs/${encodeURIComponent(id)}`, { method: "DELETE", keepalive });
}

export async function fetchText(path: string): Promise<string> {
  return (await call(path)).text();
}
