/** One job with its events, as its page shows it. */
import { effect, signal, type Signal } from "@preact/signals";
import { fetchJob } from "../api/calls";
import { followJob } from "../api/events";
import { Refused, sentence } from "../api/http";
import type { Job } from "../api/types";
import { type History, NO_HISTORY, withEvent } from "../logic/history";
import { epoch, whenOnline } from "./connection";
import { remember } from "./jobs";
import { apiKey } from "./session";

export interface OneJob {
  job: Signal<Job | null>;
  history: Signal<History>;
  trouble: Signal<string>;
  refresh(): Promise<void>;
  stop(): void;
}

// These events change what GET /jobs/{id} gives beyond its progress.
const CHANGES = new Set(["started", "level", "scan", "requeued", "cancel_requested", "succeeded", "failed", "cancelled"]);
const QUEUE_MILLISECONDS = 2000;

export function openJob(id: string): OneJob {
  const job = signal<Job | null>(null);
  const history = signal<History>(NO_HISTORY);
  const trouble = signal("");
  const stopper = new AbortController();

  const refresh = async () => {
    try {
      job.value = await fetchJob(id, stopper.signal);
      remember(job.value);
      trouble.value = "";
    } catch (error) {
      if (error instanceof Refused && error.status !== 401) trouble.value = sentence(error);
    }
  };
  const follow = async () => {
    await followJob(
      id,
      (events) => {
        history.value = events.reduce(withEvent, history.peek());
        if (events.some((event) => CHANGES.has(event.type))) void refresh();
      },
      stopper.signal,
    );
    await refresh();
  };
  const watchQueue = async () => {
    for (;;) {
      await whenOnline(QUEUE_MILLISECONDS, stopper.signal);
      if (job.peek()?.status === "queued" || (!job.peek() && !trouble.peek())) await refresh();
    }
  };
  const stopEffect = effect(() => {
    void epoch.value;
    void apiKey.value;
    void refresh();
  });
  follow().catch(() => undefined);
  watchQueue().catch(() => undefined);
  return {
    job,
    history,
    trouble,
    refresh,
    stop: () => {
      stopEffect();
      stopper.abort();
    },
  };
}
