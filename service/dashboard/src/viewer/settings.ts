/** What the viewer's buttons set; a signal each, so that a change touches nothing else. */
import { signal } from "@preact/signals";
import type { Mode } from "./materials";
import type { Section } from "./stage";

export class ViewSettings {
  /** null: the scan's colors where it has some. */
  readonly mode = signal<Mode | null>(null);
  readonly mesh = signal(true);
  readonly scan = signal(false);
  readonly wires = signal(false);
  readonly section = signal<Section | null>(null);
  readonly ruler = signal(false);
  /** Upper end of the error colors in scan units; null follows the data. */
  readonly errorEnd = signal<number | null>(null);
}
