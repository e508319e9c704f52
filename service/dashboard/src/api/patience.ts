/** Calls that only need another moment. */
import { whenOnline } from "../state/connection";
import { Refused, Unreachable } from "./http";

/** Sends again when the server could not be reached or wants to be left alone for a while. */
export async function patiently<T>(send: () => Promise<T>, signal?: AbortSignal): Promise<T> {
  for (;;) {
    try {
      return await send();
    } catch (error) {
      const crowded = error instanceof Refused && error.code === "rate_limited";
      if (!crowded && !(error instanceof Unreachable)) throw error;
      await whenOnline(crowded ? Math.max(500, 1000 * error.retryAfterSeconds) : 500, signal);
    }
  }
}
