/** A job's surface and scan, to be turned, cut and measured. */
import { type Signal, useComputed, useSignal, useSignalEffect } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { isActive, type Job } from "../api/types";
import { count, percent, plainName, significant } from "../logic/format";
import { isDark } from "../state/theme";
import { colorsOf } from "./colormap";
import { Compass } from "./Compass";
import { Legend, type Scale } from "./Legend";
import { type Mode, PAINTED } from "./materials";
import { Model } from "./model";
import { Ruler } from "./Ruler";
import { rememberedUp, rememberUp, ViewSettings } from "./settings";
import { type Ink, snapshot } from "./snapshot";
import { type Pose, Stage } from "./stage";
import { roundUp, summarize } from "./statistics";
import { SectionPanel, Toggle, Toolbar, toggleWhole } from "./Toolbar";

export interface ViewerProps {
  job: Job;
  /** Where several viewers share what their buttons set; those are then elsewhere. */
  settings?: ViewSettings;
  onStage?: (stage: Stage | null) => void;
  onPose?: (pose: Pose) => void;
  onModel?: (model: Model) => void;
  /** The graphics are gone for good. */
  onBroken?: () => void;
}

export default function Viewer({ job, settings: shared, onStage, onPose, onModel, onBroken }: ViewerProps) {
  const frame = useRef<HTMLDivElement>(null);
  const model = useMemo(() => new Model(), []);
  const settings = useMemo(() => shared ?? ownSettings(job), [shared]);
  const { canvas, stage, life, lost } = useStage(settings, { onStage, onPose, onBroken });
  const scale = useScale(model, settings);

  useEffect(() => {
    onModel?.(model);
    return () => model.dispose();
  }, []);
  useEffect(() => model.follow(job), [job.artifacts.length, job.status]);
  useSignalEffect(() => stage.value?.setUp(settings.up.value));
  useSignalEffect(() => stage.value?.setScan(model.scan.value));
  useSignalEffect(() => stage.value?.setMesh(model.mesh.value));
  useSignalEffect(() => stage.value?.cut(settings.section.value));
  useSignalEffect(() => refresh());
  useSignalEffect(() => {
    if (settings.mode.value === "error" && model.mesh.value && model.scanIsWhole.value) void model.measure();
  });

  function refresh() {
    const mesh = model.mesh.value;
    void model.scan.value;
    const painted = scale.value;
    stage.value?.paint(painted && colorsOf(painted.values, painted.low, painted.high));
    const wanted = settings.mode.value ?? "colors";
    const unpainted = PAINTED.has(wanted) && (wanted === "colors" ? !mesh?.colors : !painted);
    stage.value?.show({
      mesh: settings.mesh.value,
      scan: settings.scan.value || !mesh,
      wires: settings.wires.value,
      mode: unpainted ? "shaded" : wanted,
    });
  }

  const modes = modesOf(model);
  const firstMode = model.mesh.value?.colors ? "colors" : "shaded";
  const unsure = settings.mode.value === "confidence" && model.mesh.value !== null && !scale.value;
  return (
    <div class="viewer" ref={frame}>
      {!shared && (
        <Toolbar
          settings={settings}
          modes={modes}
          mode={settings.mode.value ?? firstMode}
          hasScan={model.scan.value !== null}
          up={settings.up.value ?? model.upAxis.value}
          onUp={(up) => {
            settings.up.value = up;
            rememberUp(job.scan.sha256, up);
          }}
          onFit={() => stage.value?.fit()}
          onWhole={() => toggleWhole(frame.current)}
          onSnapshot={() => void saveSnapshot(stage.value, scale.value, settings, job)}
        >
          <Toggle on={settings.ruler}>Measure</Toggle>
        </Toolbar>
      )}
      <div class="stage">
        <canvas
          key={life.value}
          ref={canvas}
          tabIndex={0}
          role="img"
          aria-label="Surface in three dimensions. Arrow keys turn it and with Shift move it, plus and minus zoom, F fits."
          data-mesh={model.shown.value}
          data-triangles={model.triangles.value}
          onKeyDown={(event) => steer(event, stage.value)}
          onDblClick={({ offsetX, offsetY }) => settings.ruler.value || stage.value?.centreOn(offsetX, offsetY)}
        />
        {!shared && <SectionPanel settings={settings} />}
        {settings.ruler.value && stage.value && canvas.current && (
          <Ruler stage={stage.value} canvas={canvas.current} settings={settings} />
        )}
        {scale.value && <Legend {...scale.value} />}
        {unsure && <p class="viewer-panel legend">{noConfidence(job)}</p>}
        {!shared && stage.value && <Compass stage={stage.value} />}
        <Caption model={model} job={job} lost={lost.value} />
      </div>
    </div>
  );
}

function ownSettings(job: Job): ViewSettings {
  const settings = new ViewSettings();
  settings.up.value = rememberedUp(job.scan.sha256);
  return settings;
}

// A browser gives the graphics back by itself, if it does, within this time.
const PATIENCE_MILLISECONDS = 1500;
const MOST_LIVES = 4;

/**
 * The stage on a canvas. When the browser takes the graphics away (a driver that restarts, too many
 * pages) and does not give them back, another canvas gets another stage that looks the same way.
 */
function useStage(settings: ViewSettings, props: Pick<ViewerProps, "onStage" | "onPose" | "onBroken">) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const stage = useSignal<Stage | null>(null);
  const life = useSignal(0);
  const lost = useSignal(false);
  const pose = useRef<Pose | null>(null);
  useEffect(() => {
    const made = stageOn(canvas.current!, settings, pose.current);
    if (!made) return props.onBroken?.();
    let timer: ReturnType<typeof setTimeout> | undefined;
    const watcher = new ResizeObserver(() => made.resize());
    watcher.observe(canvas.current!);
    made.onPose = (now) => props.onPose?.(now);
    made.onLost = () => {
      lost.value = true;
      timer = setTimeout(() => {
        if (life.value + 1 < MOST_LIVES) life.value += 1;
        else props.onBroken?.();
      }, PATIENCE_MILLISECONDS);
    };
    made.onRestored = () => {
      lost.value = false;
      clearTimeout(timer);
    };
    lost.value = false;
    stage.value = made;
    props.onStage?.(made);
    return () => {
      clearTimeout(timer);
      watcher.disconnect();
      props.onStage?.(null);
      pose.current = made.pose ?? pose.current;
      stage.value = null;
      made.dispose();
    };
  }, [life.value]);
  return { canvas, stage, life, lost };
}

function stageOn(canvas: HTMLCanvasElement, settings: ViewSettings, pose: Pose | null): Stage | null {
  try {
    return new Stage(canvas, { up: settings.up.peek(), pose });
  } catch {
    // The browser has WebGL but does not give it to this page; the caller shows a picture.
    return null;
  }
}

/** The values that color the surface, and their scale. */
function useScale(model: Model, settings: ViewSettings): Signal<Scale | null> {
  return useComputed(() => {
    const measured = model.error.value;
    if (settings.mode.value === "error" && measured) {
      const { values, summary } = measured;
      const high = settings.errorEnd.value ?? settings.commonEnd.value ?? roundUp(summary.p95);
      const onEnd = (end: number | null) => (settings.errorEnd.value = end);
      const facts = [
        ["Mean", significant(summary.mean)],
        ["RMS", significant(summary.rms)],
        ["95 %", significant(summary.p95)],
        ["Max", significant(summary.max)],
      ] as const;
      return { title: "Distance to the scan", unit: "scan units", values, summary, low: 0, high, facts, onEnd };
    }
    const values = model.mesh.value?.attributes["CONFIDENCE"];
    if (settings.mode.value !== "confidence" || !values) return null;
    const unit = "1: the scan supports it well, 0: it was made up";
    const summary = summarize(values);
    const doubtful = values.reduce((sum, value) => sum + (value < 0.5 ? 1 : 0), 0) / (values.length || 1);
    const facts = [
      ["Mean", significant(summary.mean)],
      ["Under 0.5", percent(doubtful)],
    ] as const;
    return { title: "Confidence", unit, values, summary, low: 0, high: 1, facts };
  });
}

/** What the loaded mesh can be shown as. */
function modesOf(model: Model): Mode[] {
  const mesh = model.mesh.value;
  if (!mesh) return [];
  return [
    "shaded",
    "facets",
    "normals",
    ...(mesh.colors ? ["colors" as const] : []),
    ...(model.scanIsWhole.value ? ["error" as const] : []),
    "confidence",
  ];
}

function noConfidence(job: Job): string {
  return isActive(job)
    ? "The confidence comes with the finished surface."
    : "This surface carries no confidence. Run the job again to have it.";
}

function Caption({ model, job, lost }: { model: Model; job: Job; lost: boolean }) {
  const loading = model.loading.value;
  const level = /^level-(\d+)/.exec(model.shown.value)?.[1];
  const text = lost
    ? "The browser took the graphics away; they come back by themselves."
    : model.trouble.value
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
    <p class={`viewer-caption ${lost || model.trouble.value ? "bad" : ""}`} role="status">
      {text}
    </p>
  );
}

const TURN = Math.PI / 24;
const STEP = 0.06;

function steer(event: KeyboardEvent, stage: Stage | null): void {
  const by = (right: number, up: number) =>
    event.shiftKey ? stage?.shift(-right * STEP, -up * STEP) : stage?.turn(right * TURN, up * TURN);
  const moves: Record<string, () => void> = {
    ArrowLeft: () => by(-1, 0),
    ArrowRight: () => by(1, 0),
    ArrowUp: () => by(0, 1),
    ArrowDown: () => by(0, -1),
    "+": () => stage?.turn(0, 0, 1.15),
    "=": () => stage?.turn(0, 0, 1.15),
    "-": () => stage?.turn(0, 0, 1 / 1.15),
    f: () => stage?.fit(),
  };
  const move = moves[event.key];
  if (!move || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  move();
}

async function saveSnapshot(stage: Stage | null, scale: Scale | null, settings: ViewSettings, job: Job) {
  const light: Ink = { background: "#f1f3f5", text: "#171b20" };
  const dark: Ink = { background: "#181d22", text: "#e8ebee" };
  const picture = stage && (await snapshot(stage, scale, settings, isDark.peek() ? dark : light));
  if (!picture) return;
  const link = document.createElement("a");
  link.href = URL.createObjectURL(picture);
  link.download = `${plainName(job.scan.name).replace(/\.[^.]*$/, "")}.png`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
