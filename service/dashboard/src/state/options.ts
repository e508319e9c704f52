/** What a job may be asked for; read once. */
import { effect, signal } from "@preact/signals";
import { fetchOptions } from "../api/calls";
import type { Option } from "../api/types";
import { epoch } from "./connection";

export const options = signal<readonly Option[]>([]);

export function loadOptions(): void {
  effect(() => {
    void epoch.value;
    if (options.peek().length === 0) {
      fetchOptions().then(
        (found) => (options.value = found),
        () => undefined,
      );
    }
  });
}
