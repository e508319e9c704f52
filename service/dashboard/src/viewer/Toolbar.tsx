/** The viewer's buttons. */
import type { Signal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { Icon } from "../parts/Icon";
import type { Mode } from "./materials";
import type { ViewSettings } from "./settings";
import { type Up, upName, UPS } from "./up";

const MODE_NAMES: Record<Mode, string> = {
  shaded: "Shaded",
  facets: "Facets",
  normals: "Normals",
  colors: "Colors",
  error: "Distance to the scan",
  confidence: "Confidence",
};

interface Props {
  settings: ViewSettings;
  /** What the surface can be shown as; empty without a surface. */
  modes: readonly Mode[];
  mode: Mode;
  hasScan: boolean;
  up: Up;
  onUp(up: Up): void;
  /** Further buttons before those at the end. */
  children?: ComponentChildren;
  onFit(): void;
  onWhole(): void;
  onSnapshot?(): void;
}

export function Toolbar({ settings, modes, mode, hasScan, up, onUp, children, onFit, onWhole, onSnapshot }: Props) {
  const hasMesh = modes.length > 0;
  return (
    <div class="viewer-tools" role="toolbar" aria-label="Viewer">
      {hasMesh && (
        <label>
          <span class="unseen">Surface shown as</span>
          <select
            class="input"
            value={mode}
            onChange={(event) => (settings.mode.value = event.currentTarget.value as Mode)}
          >
            {modes.map((one) => (
              <option key={one} value={one}>
                {MODE_NAMES[one]}
              </option>
            ))}
          </select>
        </label>
      )}
      {hasMesh && <Toggle on={settings.mesh}>Surface</Toggle>}
      {hasMesh && hasScan && <Toggle on={settings.scan}>Scan</Toggle>}
      {hasMesh && <Toggle on={settings.wires}>Wireframe</Toggle>}
      <button
        type="button"
        class="button"
        aria-pressed={settings.section.value !== null}
        onClick={() => (settings.section.value = settings.section.value ? null : { axis: 0, at: 0.5, flipped: false })}
      >
        Section
      </button>
      {children}
      <span class="grow" />
      <label title="For the view alone; the files follow the job's setting">
        <span class="unseen">Up in the view</span>
        <select class="input" value={up} onChange={(event) => onUp(event.currentTarget.value as Up)}>
          {UPS.map((one) => (
            <option key={one} value={one}>
              {upName(one)} up
            </option>
          ))}
        </select>
      </label>
      <Action label="Fit the view" hint="Fit the view (F)" icon="fit" onClick={onFit} />
      {document.fullscreenEnabled && (
        <Action label="Whole screen" hint="Whole screen" icon="whole" onClick={onWhole} />
      )}
      {onSnapshot && <Action label="Save a picture" hint="Save a picture" icon="camera" onClick={onSnapshot} />}
    </div>
  );
}

interface ActionProps {
  label: string;
  hint: string;
  icon: "fit" | "whole" | "camera";
  onClick(): void;
}

function Action({ label, hint, icon, onClick }: ActionProps) {
  return (
    <button type="button" class="button icon-only" aria-label={label} title={hint} onClick={onClick}>
      <Icon name={icon} />
    </button>
  );
}

export function Toggle({ on, children }: { on: Signal<boolean>; children: string }) {
  return (
    <button type="button" class="button" aria-pressed={on.value} onClick={() => (on.value = !on.value)}>
      {children}
    </button>
  );
}

const AXES = ["Left – right", "Bottom – top", "Back – front"];

export function SectionPanel({ settings }: { settings: ViewSettings }) {
  const section = settings.section.value;
  if (!section) return null;
  return (
    <div class="viewer-panel section-panel" role="group" aria-label="Section plane">
      <div class="row">
        <select
          class="input"
          aria-label="Direction of the section"
          value={String(section.axis)}
          onChange={(event) =>
            (settings.section.value = { ...section, axis: Number(event.currentTarget.value) as 0 | 1 | 2 })
          }
        >
          {AXES.map((name, axis) => (
            <option key={name} value={String(axis)}>
              {name}
            </option>
          ))}
        </select>
        <button
          type="button"
          class="button"
          aria-pressed={section.flipped}
          onClick={() => (settings.section.value = { ...section, flipped: !section.flipped })}
        >
          Flip
        </button>
      </div>
      <input
        type="range"
        aria-label="Place of the section"
        min={0}
        max={1}
        step={0.005}
        value={section.at}
        onInput={(event) => (settings.section.value = { ...section, at: Number(event.currentTarget.value) })}
      />
    </div>
  );
}

/** Let an element fill the screen, or no longer. */
export function toggleWhole(element: HTMLElement | null): void {
  if (document.fullscreenElement) void document.exitFullscreen();
  else void element?.requestFullscreen();
}
