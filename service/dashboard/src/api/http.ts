/** One way to call the API: adds the key, tells refusals from a lost connection. */
import { connectionLost } from "../state/connection";
import { apiKey, keyRefused } from "../state/session";
import type { ProblemBody } from "./types";

/** The API refused; `message` is its sentence that says what to do. */
export class Refused extends Error {
  constructor(
    readonly status: number,
    readonly code: string,
    detail: string,
    readonly fields: ReadonlyArray<{ path: string; detail: string }> = [],
    readonly retryAfterSeconds = 0,
  ) {
    super(detail);
  }
}

/** The server could not be reached; the call may be tried again. */
export class Unreachable extends Error {
  constructor() {
    super("The server cannot be reached.");
  }
}

const GATEWAY_TROUBLE = new Set([502, 503, 504]);

/** The answer to a call, if it is a good one. Throws Refused, Unreachable or AbortError. */
export async function call(path: string, init: RequestInit = {}): Promise<Response> {
  const headers = new Headers(init.headers);
  const key = apiKey.peek();
  if (key && !headers.has("Authorization")) headers.set("Authorization", `Bearer ${key}`);
  let answer: Response;
  try {
    answer = await fetch(path, { ...init, headers, credentials: "omit" });
  } catch (error) {
    if (init.signal?.aborted) throw error;
    connectionLost();
    throw new Unreachable();
  }
  if (answer.ok || answer.status === 304) return answer;
  if (GATEWAY_TROUBLE.has(answer.status) && path !== "/v1/readyz") {
    connectionLost();
    throw new Unreachable();
  }
  throw await refusal(answer);
}

export async function json<T>(path: string, init?: RequestInit): Promise<T> {
  return (await (await call(path, init)).json()) as T;
}

async function refusal(answer: Response): Promise<Refused> {
  const body = (await answer.json().catch(() => ({}))) as Partial<ProblemBody>;
  if (answer.status === 401) keyRefused();
  return new Refused(
    answer.status,
    body.code ?? "unknown",
    body.detail ?? `The server answered ${answer.status}.`,
    body.errors ?? [],
    Number(answer.headers.get("Retry-After")) || 0,
  );
}

/** What to show when a job's file could not be had. */
export function artifactTrouble(error: unknown): string {
  const gone = error instanceof Refused && (error.status === 404 || error.status === 410);
  return gone ? "The files of this job have expired. Retry it to make them again." : sentence(error);
}

/** What to show for anything that was thrown. */
export function sentence(error: unknown): string {
  if (error instanceof Refused || error instanceof Unreachable) return error.message;
  return error instanceof Error ? error.message : String(error);
}
