/**
 * A job's events without a gap. `EventSource` cannot send an API key in a header, and a key does
 * not belong into an address, so the stream is read with fetch.
 */
import { EventParser, type ServerEvent } from "../logic/sse";
import { whenOnline } from "../state/connection";
import { call, Refused } from "./http";

const TERMINAL = new Set(["succeeded", "failed", "cancelled"]);
// The server sends something at least every ten seconds.
const SILENCE_MILLISECONDS = 25_000;

/** Calls `onEvents` with what comes until the job's last event. Throws Refused or AbortError. */
export async function followJob(
  id: string,
  onEvents: (events: ServerEvent[]) => void,
  signal: AbortSignal,
): Promise<void> {
  let after = 0;
  for (;;) {
    try {
      const ended = await readStream(id, after, signal, (events) => {
        after = events.at(-1)?.id ?? after;
        onEvents(events);
      });
      if (ended) return;
    } catch (error) {
      if (signal.aborted || (error instanceof Refused && error.status !== 429)) throw error;
    }
    await whenOnline(1000, signal);
  }
}

async function readStream(
  id: string,
  after: number,
  signal: AbortSignal,
  onEvents: (events: ServerEvent[]) => void,
): Promise<boolean> {
  const silence = new AbortController();
  const either = AbortSignal.any([signal, silence.signal]);
  let timer = setTimeout(() => silence.abort(), SILENCE_MILLISECONDS);
  try {
    const answer = await call(`/v1/jobs/${encodeURIComponent(id)}/events`, {
      headers: { "Last-Event-ID": String(after) },
      signal: either,
      cache: "no-store",
    });
    if (answer.status === 204 || !answer.body) return true;
    const parser = new EventParser();
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return false;
      clearTimeout(timer);
      timer = setTimeout(() => silence.abort(), SILENCE_MILLISECONDS);
      const events = parser.feed(value);
      if (events.length > 0) onEvents(events);
      if (events.some((event) => TERMINAL.has(event.type))) return true;
    }
  } finally {
    clearTimeout(timer);
  }
}
