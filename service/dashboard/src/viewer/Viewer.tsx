/** A job's surface and scan, to be turned, cut and measured. */
import { useComputed, useSignal, useSignalEffect } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import type { Job } from "../api/types";
import { count, percent } from "../logic/format";
import { isDark } from "../state/theme";
import { colorsOf } from "./colormap";
import { Legend } from "./Legend";
import { Model } from "./model";
import { Ruler } from "./Ruler";
import { ViewSettings } from "./settings";
import { type Pose, Stage } from "./stage";
import { roundUp, summarize } from "./statistics";
import { SectionPanel, Toolbar } from "./Toolbar";

export interface ViewerProps {
  job: Job;
  /** Where several viewers share what their buttons set. */
  settings?: ViewSettings;
  bare?: boolean;
  onStage?: (stage: Stage | null) => void;
  onPose?: (pose: Pose) => void;
  onModel?: (model: Model) => void;
}

export default function Viewer({ job, settings: given, bare, onStage, onPose, onModel }: ViewerProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const stage = useSignal<Stage | null>(null);
  const model = useMemo(() => new Model(), []);
  const settings = useMemo(() => given ?? new ViewSettings(), [given]);
  const scale = useScale(model, settings);

  useEffect(() => {
    const made = new Stage(canvas.current!);
    const watcher = new ResizeObserver(() => made.resize());
    watcher.observe(canvas.current!);
    made.onPose = (pose) => onPose?.(pose);
    stage.value = made;
    onStage?.(made);
    onModel?.(model);
    return () => {
      watcher.disconnect();
      onStage?.(null);
      model.dispose();
      made.dispose();
    };
  }, []);
  useEffect(() => model.follow(job), [job.artifacts.length, job.status]);
  useSignalEffect(() => stage.value?.setScan(model.scan.value));
  useSignalEffect(() => stage.value?.setMesh(model.mesh.value));
  useSignalEffect(() => stage.value?.cut(settings.section.value));
  useSignalEffect(() => refresh());
  useSignalEffect(() => {
    if (settings.mode.value === "error" && model.mesh.value && model.scan.value) void model.measure();
  });

  function refresh() {
    const mesh = model.mesh.value;
    void model.scan.value;
    const painted = scale.value;
    stage.value?.paint(painted && colorsOf(painted.values, painted.low, painted.high));
    const wanted = settings.mode.value ?? "colors";
    const missing = (wanted === "error" || wanted === "confidence") && !painted;
    const colorless = wanted === "colors" && !mesh?.colors;
    stage.value?.show({
      mesh: settings.mesh.value,
      scan: settings.scan.value || !mesh,
      wires: settings.wires.value,
      mode: missing || colorless ? "shaded" : wanted,
    });
  }

  return (
    <div class="viewer">
      {!bare && (
        <Toolbar
          settings={settings}
          model={model}
          onFit={() => stage.value?.fit()}
          onSnapshot={() => void saveSnapshot(stage.value, job)}
        />
      )}
      <div class="stage">
        <canvas
          ref={canvas}
          tabIndex={0}
          role="img"
          aria-label="Surface in three dimensions. Arrow keys turn it, plus and minus zoom, F fits."
          data-mesh={model.shown.value}
          data-triangles={model.triangles.value}
          onKeyDown={(event) => steer(event, stage.value)}
        />
        <SectionPanel settings={settings} />
        {settings.ruler.value && stage.value && canvas.current && <Ruler stage={stage.value} canvas={canvas.current} />}
        {scale.value && <Legend {...scale.value} />}
        <Caption model={model} job={job} />
      </div>
    </div>
  );
}

/** The values that color the surface, and their scale. */
function useScale(model: Model, settings: ViewSettings) {
  return useComputed(() => {
    const measured = model.error.value;
    if (settings.mode.value === "error" && measured) {
      const { values, summary } = measured;
      const high = settings.errorEnd.value ?? roundUp(summary.p95);
      const onEnd = (end: number | null) => (settings.errorEnd.value = end);
      return { title: "Distance to the scan", unit: "scan units", values, summary, low: 0, high, onEnd };
    }
    const confidence = model.mesh.value?.attributes["CONFIDENCE"];
    if (settings.mode.value !== "confidence" || !confidence) return null;
    return { title: "Confidence", unit: "", values: confidence, summary: summarize(confidence), low: 0, high: 1 };
  });
}

function Caption({ model, job }: { model: Model; job: Job }) {
  const loading = model.loading.value;
  const level = /^level-(\d+)/.exec(model.shown.value)?.[1];
  const text = model.trouble.value
    ? model.trouble.value
    : model.measuring.value
      ? "Measuring distances…"
      : loading !== null
        ? `Loading ${percent(loading)}`
        : model.mesh.value
          ? `${level && job.status === "running" ? `Level ${level}: ` : ""}${count(model.triangles.value)} triangles`
          : model.scan.value
            ? `${count(model.scan.value.positions.length / 3)} points`
            : "";
  return (
    <p class={`viewer-caption ${model.trouble.value ? "bad" : ""}`} role="status">
      {text}
    </p>
  );
}

const TURN = Math.PI / 24;

function steer(event: KeyboardEvent, stage: Stage | null): void {
  const moves: Record<string, () => void> = {
    ArrowLeft: () => stage?.nudge(-TURN, 0),
    ArrowRight: () => stage?.nudge(TURN, 0),
    ArrowUp: () => stage?.nudge(0, TURN),
    ArrowDown: () => stage?.nudge(0, -TURN),
    "+": () => stage?.nudge(0, 0, 1.15),
    "=": () => stage?.nudge(0, 0, 1.15),
    "-": () => stage?.nudge(0, 0, 1 / 1.15),
    f: () => stage?.fit(),
  };
  const move = moves[event.key];
  if (!move || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  move();
}

async function saveSnapshot(stage: Stage | null, job: Job): Promise<void> {
  const picture = await stage?.snapshot(isDark.peek() ? "#181d22" : "#f1f3f5");
  if (!picture) return;
  const link = document.createElement("a");
  link.href = URL.createObjectURL(picture);
  link.download = `${job.scan.name.replace(/\.[^.]*$/, "")}.png`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
