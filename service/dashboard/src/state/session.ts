/** The API key, where the server wants one. It stays in this browser and never in an address. */
import { signal } from "@preact/signals";

const NAME = "visco.key";

export const apiKey = signal(read());
/** Set when a call was refused for want of a key; the page then asks for one. */
export const keyWanted = signal(false);

export function keyRefused(): void {
  keyWanted.value = true;
}

/** `remember` keeps the key on this device; otherwise it is gone with the tab. */
export function setKey(key: string, remember: boolean): void {
  forgetKey();
  (remember ? localStorage : sessionStorage).setItem(NAME, key);
  apiKey.value = key;
  keyWanted.value = false;
}

export function forgetKey(): void {
  localStorage.removeItem(NAME);
  sessionStorage.removeItem(NAME);
  apiKey.value = "";
}

function read(): string {
  if (typeof localStorage === "undefined") return "";
  return sessionStorage.getItem(NAME) ?? localStorage.getItem(NAME) ?? "";
}
