/** Whether the server can be reached; the page notices its return by itself. */
import { signal } from "@preact/signals";

export const online = signal(true);
/** Grows each time the server comes back, so that stores know to look again. */
export const epoch = signal(0);

const FIRST_PROBE_MILLISECONDS = 500;
const SLOWEST_PROBE_MILLISECONDS = 4000;
let probing = false;

export function connectionLost(): void {
  online.value = false;
  if (!probing) void probe();
}

async function probe(): Promise<void> {
  probing = true;
  let wait = FIRST_PROBE_MILLISECONDS;
  while (!(await answers())) {
    await pause(wait);
    wait = Math.min(wait * 1.5, SLOWEST_PROBE_MILLISECONDS);
  }
  probing = false;
  online.value = true;
  epoch.value += 1;
}

async function answers(): Promise<boolean> {
  try {
    return (await fetch("/healthz", { cache: "no-store", credentials: "omit" })).ok;
  } catch {
    return false;
  }
}

/** Waits `milliseconds`, and then until the server answers. Throws AbortError. */
export async function whenOnline(milliseconds: number, stop?: AbortSignal): Promise<void> {
  await pause(milliseconds, stop);
  while (!online.peek()) await pause(200, stop);
}

export function pause(milliseconds: number, stop?: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    if (stop?.aborted) return reject(stop.reason);
    const abort = () => {
      clearTimeout(timer);
      reject(stop?.reason);
    };
    const timer = setTimeout(() => {
      stop?.removeEventListener("abort", abort);
      resolve();
    }, milliseconds);
    stop?.addEventListener("abort", abort, { once: true });
  });
}
