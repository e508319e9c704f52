/** What the viewer's buttons set; a signal each, so that a change touches nothing else. */
import { signal } from "@preact/signals";
import type { Vector } from "./glb";
import type { Mode } from "./materials";
import type { Section } from "./stage";
import { type Up, UPS } from "./up";

export class ViewSettings {
  /** null: the scan's colors where it has some. */
  readonly mode = signal<Mode | null>(null);
  readonly mesh = signal(true);
  readonly scan = signal(false);
  readonly wires = signal(false);
  readonly section = signal<Section | null>(null);
  readonly ruler = signal(false);
  /** The measured places, at most two, in scan coordinates. */
  readonly places = signal<readonly Vector[]>([]);
  /** Upper end of the error colors in scan units; null follows the data. */
  readonly errorEnd = signal<number | null>(null);
  /** The end that the data of several viewers suggest together. */
  readonly commonEnd = signal<number | null>(null);
  /** Which way of the scan points up; null: the way that its file says. */
  readonly up = signal<Up | null>(null);
}

/** The way up that was once chosen for a scan, named by its checksum. */
export function rememberedUp(scan: string | null): Up | null {
  const found = scan && localStorage.getItem(memoryOf(scan));
  return UPS.find((one) => one === found) ?? null;
}

export function rememberUp(scan: string | null, up: Up): void {
  if (scan) localStorage.setItem(memoryOf(scan), up);
}

function memoryOf(scan: string): string {
  return `visco.up:${scan}`;
}
