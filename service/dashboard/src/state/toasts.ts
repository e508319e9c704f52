/** Short notes at the page's foot; some can be undone while they are there. */
import { signal } from "@preact/signals";

export interface Toast {
  id: number;
  text: string;
  tone: "plain" | "bad";
  undo?: () => void;
}

export const toasts = signal<readonly Toast[]>([]);
const SHOWN_MILLISECONDS = 6000;
let last = 0;

export function say(text: string, tone: Toast["tone"] = "plain"): void {
  show({ id: ++last, text, tone });
}

export function dismiss(id: number): void {
  toasts.value = toasts.value.filter((toast) => toast.id !== id);
}

function show(toast: Toast): void {
  toasts.value = [...toasts.value, toast].slice(-4);
  setTimeout(() => dismiss(toast.id), SHOWN_MILLISECONDS);
}

/** Does `act` only after a while, unless `undo` is chosen; leaving the page does it at once. */
export function sayWithUndo(text: string, act: (leaving: boolean) => void, undo: () => void): void {
  const id = ++last;
  let open = true;
  const close = () => {
    open = false;
    clearTimeout(timer);
    removeEventListener("pagehide", leave);
    dismiss(id);
  };
  const leave = () => {
    if (open) act(true);
    open = false;
  };
  const timer = setTimeout(() => {
    if (!open) return;
    close();
    act(false);
  }, SHOWN_MILLISECONDS);
  addEventListener("pagehide", leave);
  const takeBack = () => {
    if (!open) return;
    close();
    undo();
  };
  toasts.value = [...toasts.value, { id, text, tone: "plain" as const, undo: takeBack }].slice(-4);
}
