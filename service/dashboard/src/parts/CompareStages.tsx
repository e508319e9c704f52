/** Viewers under one camera and one set of buttons: side by side, or one over the other. */
import { effect, useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import type { Job } from "../api/types";
import { jobName } from "../logic/format";
import type { Mode } from "../viewer/materials";
import type { Model } from "../viewer/model";
import { rememberedUp, rememberUp, ViewSettings } from "../viewer/settings";
import type { Pose, Stage } from "../viewer/stage";
import { roundUp, type Summary } from "../viewer/statistics";
import { SectionPanel, Toggle, Toolbar, toggleWhole } from "../viewer/Toolbar";
import type { Up } from "../viewer/up";
import { Name } from "./Name";
import { ViewerFrame } from "./ViewerFrame";

interface Props {
  jobs: readonly Job[];
  onMeasured(id: string, summary: Summary): void;
}

export function CompareStages({ jobs, onMeasured }: Props) {
  const scan = jobs[0]!.scan.sha256;
  const settings = useMemo(() => commonSettings(scan), []);
  const linked = useLinkedCameras();
  const card = useRef<HTMLElement>(null);
  const slider = useSignal(false);
  const split = useSignal(0.5);
  const hasColors = useSignal(false);
  const fileUp = useSignal<Up>("z");
  const sliding = slider.value && jobs.length === 2;
  const watch = useWatch((id, model) => {
    const mesh = model.mesh.value;
    if (mesh?.colors) hasColors.value = true;
    // All stand alike, also where one job was told another way up.
    if (mesh && id === jobs[0]!.id) fileUp.value = mesh.upAxis;
    if (mesh && settings.up.peek() === null) settings.up.value = mesh.upAxis;
    if (mesh && model.scanIsWhole.value) void model.measure();
    if (!model.error.value) return;
    const { summary } = model.error.value;
    settings.commonEnd.value = Math.max(settings.commonEnd.peek() ?? 0, roundUp(summary.p95));
    onMeasured(id, summary);
  });
  const modes: Mode[] = ["shaded", "facets", "normals", "error", "confidence"];
  if (hasColors.value) modes.splice(3, 0, "colors");
  return (
    <section class="card compare-card" aria-label="Surfaces" ref={card}>
      <Toolbar
        settings={settings}
        modes={modes}
        mode={settings.mode.value ?? "shaded"}
        hasScan
        up={settings.up.value ?? fileUp.value}
        onUp={(up) => {
          settings.up.value = up;
          rememberUp(scan, up);
        }}
        onFit={() => linked.first()?.fit()}
        onWhole={() => toggleWhole(card.current)}
      >
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
      </Toolbar>
      <div class={sliding ? "stages sliding" : "stages"}>
        {jobs.map((job, index) => (
          <div
            key={job.id}
            class="stage-cell"
            style={{ clipPath: sliding && index === 1 ? `inset(0 0 0 ${split.value * 100}%)` : "none" }}
          >
            <ViewerFrame
              job={job}
              settings={settings}
              onStage={(stage) => linked.join(job.id, stage)}
              onPose={(pose) => linked.turn(job.id, pose)}
              onModel={(model) => watch(job.id, model)}
            />
            <a class={`stage-name ${sliding && index === 1 ? "right" : ""}`} href={`/jobs/${job.id}`}>
              <Name>{jobName(job)}</Name>
            </a>
          </div>
        ))}
        {sliding && <span class="divider" style={{ left: `${split.value * 100}%` }} aria-hidden="true" />}
        <SectionPanel settings={settings} />
      </div>
    </section>
  );
}

function commonSettings(scan: string | null): ViewSettings {
  const settings = new ViewSettings();
  settings.mode.value = "shaded";
  settings.up.value = rememberedUp(scan);
  return settings;
}

/** Runs `look` whenever something that it read of a model has changed. */
function useWatch(look: (id: string, model: Model) => void) {
  const stops = useRef(new Map<string, () => void>());
  useEffect(() => () => stops.current.forEach((stop) => stop()), []);
  return (id: string, model: Model) => {
    stops.current.get(id)?.();
    stops.current.set(id, effect(() => look(id, model)));
  };
}

/** What one viewer's camera does, the others' do too. */
function useLinkedCameras() {
  return useMemo(() => {
    const stages = new Map<string, Stage>();
    const settled = new Set<Stage>();
    let latest: Pose | null = null;
    return {
      join(id: string, stage: Stage | null) {
        if (stage) stages.set(id, stage);
        else stages.delete(id);
      },
      turn(id: string, pose: Pose) {
        const from = stages.get(id)!;
        const isFirst = !settled.has(from);
        settled.add(from);
        // One that comes later looks where the others already look.
        if (isFirst && latest) return from.takePose(latest);
        latest = pose;
        for (const [other, stage] of stages) if (other !== id) stage.takePose(pose);
      },
      first: () => stages.values().next().value,
    };
  }, []);
}
