/** The viewer's buttons. */
import { Icon } from "../parts/Icon";
import type { Mode } from "./materials";
import type { Model } from "./model";
import type { ViewSettings } from "./settings";

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
  model: Model;
  onFit(): void;
  onSnapshot(): void;
}

export function Toolbar({ settings, model, onFit, onSnapshot }: Props) {
  const hasScan = model.scan.value !== null;
  return (
    <div class="viewer-tools" role="toolbar" aria-label="Viewer">
      <label>
        <span class="unseen">Surface shown as</span>
        <select
          class="input"
          value={settings.mode.value ?? (model.mesh.value?.colors ? "colors" : "shaded")}
          onChange={(event) => (settings.mode.value = event.currentTarget.value as Mode)}
        >
          {modesOf(model).map((mode) => (
            <option key={mode} value={mode}>
              {MODE_NAMES[mode]}
            </option>
          ))}
        </select>
      </label>
      <Toggle on={settings.mesh}>Surface</Toggle>
      {hasScan && <Toggle on={settings.scan}>Scan</Toggle>}
      <Toggle on={settings.wires}>Wireframe</Toggle>
      <button
        type="button"
        class="button"
        aria-pressed={settings.section.value !== null}
        onClick={() => (settings.section.value = settings.section.value ? null : { axis: 0, at: 0.5, flipped: false })}
      >
        Section
      </button>
      <Toggle on={settings.ruler}>Measure</Toggle>
      <span class="grow" />
      <button type="button" class="button icon-only" aria-label="Fit the view" title="Fit the view (F)" onClick={onFit}>
        <Icon name="home" />
      </button>
      <button type="button" class="button icon-only" aria-label="Save a picture" title="Save a picture" onClick={onSnapshot}>
        <Icon name="camera" />
      </button>
    </div>
  );
}

/** The modes that the loaded mesh can be shown in. */
function modesOf(model: Model): Mode[] {
  const mesh = model.mesh.value;
  return [
    "shaded",
    "facets",
    "normals",
    ...(mesh?.colors ? ["colors" as const] : []),
    ...(mesh && model.scan.value ? ["error" as const] : []),
    ...(mesh?.attributes["CONFIDENCE"] ? ["confidence" as const] : []),
  ];
}

function Toggle({ on, children }: { on: { value: boolean }; children: string }) {
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
