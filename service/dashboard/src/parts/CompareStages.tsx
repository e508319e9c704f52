/** Viewers under one camera and one set of buttons: side by side, or one over the other. */
import { effect, useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import type { Job } from "../api/types";
import { jobName } from "../logic/format";
import type { Mode } from "../viewer/materials";
import type { Model } from "../viewer/model";
import { ViewSettings } from "../viewer/settings";
import type { Pose, Stage } from "../viewer/stage";
import type { Summary } from "../viewer/statistics";
import { ViewerFrame } from "./ViewerFrame";

interface Props {
  jobs: readonly Job[];
  onMeasured(id: string, summary: Summary): void;
}

const MODES: Array<[Mode, string]> = [
  ["shaded", "Shaded"],
  ["facets", "Facets"],
  ["normals", "Normals"],
  ["colors", "Colors"],
  ["error", "Distance to the scan"],
];

export function CompareStages({ jobs, onMeasured }: Props) {
  const settings = useMemo(() => new ViewSettings(), []);
  const linked = useLinkedCameras();
  const slider = useSignal(false);
  const split = useSignal(0.5);
  const sliding = slider.value && jobs.length === 2;
  useEffect(() => void (settings.mode.value = "shaded"), []);
  const stopMeasuring = useRef(new Map<string, () => void>());
  useEffect(() => () => stopMeasuring.current.forEach((stop) => stop()), []);
  const watch = (id: string, model: Model) => {
    const stop = effect(() => {
      if (model.mesh.value && model.scan.value) void model.measure();
      if (model.error.value) onMeasured(id, model.error.value.summary);
    });
    stopMeasuring.current.set(id, stop);
  };
  return (
    <section class="card" aria-label="Surfaces">
      <div class="viewer-tools">
        <select
          class="input"
          aria-label="Surfaces shown as"
          value={settings.mode.value ?? "shaded"}
          onChange={(event) => (settings.mode.value = event.currentTarget.value as Mode)}
        >
          {MODES.map(([mode, name]) => (
            <option key={mode} value={mode}>
              {name}
            </option>
          ))}
        </select>
        <Toggle on={settings.scan}>Scan</Toggle>
        <Toggle on={settings.wires}>Wireframe</Toggle>
        {jobs.length === 2 && <Toggle on={slider}>Slider</Toggle>}
        {sliding && (
          <input
            class="split"
            type="range"
            min={0}
            max={1}
            step={0.005}
            aria-label={`Where ${jobName(jobs[0]!)} ends and ${jobName(jobs[1]!)} begins`}
            value={split.value}
            onInput={(event) => (split.value = Number(event.currentTarget.value))}
          />
        )}
        <span class="grow" />
        <button type="button" class="button" onClick={() => linked.first()?.fit()}>
          Fit
        </button>
      </div>
      <div class={sliding ? "stages sliding" : "stages"}>
        {jobs.map((job, index) => (
          <div
            key={job.id}
            class="stage-cell"
            style={{ clipPath: sliding && index === 1 ? `inset(0 0 0 ${split.value * 100}%)` : "none" }}
          >
            <ViewerFrame
              job={job}
              bare
              settings={settings}
              onStage={(stage) => linked.join(job.id, stage)}
              onPose={(pose) => linked.turn(job.id, pose)}
              onModel={(model) => watch(job.id, model)}
            />
            <a class={`stage-name ${sliding && index === 1 ? "right" : ""}`} href={`/jobs/${job.id}`}>
              {jobName(job)}
            </a>
          </div>
        ))}
        {sliding && <span class="divider" style={{ left: `${split.value * 100}%` }} aria-hidden="true" />}
      </div>
    </section>
  );
}

function Toggle({ on, children }: { on: { value: boolean }; children: string }) {
  return (
    <button type="button" class="button" aria-pressed={on.value} onClick={() => (on.value = !on.value)}>
      {children}
    </button>
  );
}

/** What one viewer's camera does, the others' do too. */
function useLinkedCameras() {
  return useMemo(() => {
    const stages = new Map<string, Stage>();
    return {
      join(id: string, stage: Stage | null) {
        if (stage) stages.set(id, stage);
        else stages.delete(id);
      },
      turn(id: string, pose: Pose) {
        for (const [other, stage] of stages) if (other !== id) stage.takePose(pose);
      },
      first: () => stages.values().next().value,
    };
  }, []);
}
