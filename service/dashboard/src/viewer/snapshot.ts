/** The view as a picture, with the scale of its colors and what was measured in it. */
import { significant } from "../logic/format";
import { cssColorAt } from "./colormap";
import type { Scale } from "./Legend";
import { lengthOf } from "./Ruler";
import type { ViewSettings } from "./settings";
import type { Stage } from "./stage";

const STEPS = 64;

export interface Ink {
  background: string;
  text: string;
}

export function snapshot(
  stage: Stage,
  scale: Scale | null,
  settings: ViewSettings,
  ink: Ink,
): Promise<Blob | null> {
  const picture = stage.snapshot(ink.background);
  const context = picture.getContext("2d")!;
  const ratio = Math.min(2, devicePixelRatio);
  context.scale(ratio, ratio);
  context.font = '13px "Inter", system-ui, sans-serif';
  context.fillStyle = ink.text;
  if (scale) drawScale(context, scale, picture.height / ratio);
  if (settings.ruler.value) drawRuler(context, stage, settings, ink);
  return new Promise((resolve) => picture.toBlob(resolve, "image/png"));
}

function drawScale(context: CanvasRenderingContext2D, scale: Scale, height: number): void {
  const [left, width, foot] = [16, 220, height - 16];
  const text = context.fillStyle;
  context.fillText(`${scale.title} (${scale.unit})`, left, foot - 34);
  for (let step = 0; step < STEPS; step++) {
    context.fillStyle = cssColorAt(step / (STEPS - 1));
    context.fillRect(left + (step * width) / STEPS, foot - 26, width / STEPS + 1, 10);
  }
  context.fillStyle = text;
  context.fillText(significant(scale.low), left, foot);
  context.textAlign = "right";
  context.fillText(significant(scale.high), left + width, foot);
  context.textAlign = "left";
}

function drawRuler(context: CanvasRenderingContext2D, stage: Stage, settings: ViewSettings, ink: Ink): void {
  const length = lengthOf(settings.places.value);
  if (length === null) return;
  const [from, to] = settings.places.value.map((place) => stage.project(place)) as [Point, Point];
  for (const [color, width] of [[ink.background, 4], [ink.text, 2]] as const) {
    context.strokeStyle = color;
    context.lineWidth = width;
    context.beginPath();
    context.moveTo(from.x, from.y);
    context.lineTo(to.x, to.y);
    context.stroke();
  }
  context.strokeStyle = ink.background;
  context.lineWidth = 4;
  const text = `${significant(length, 4)} scan units`;
  const [x, y] = [(from.x + to.x) / 2 + 8, (from.y + to.y) / 2 - 8];
  context.strokeText(text, x, y);
  context.fillText(text, x, y);
}

type Point = { x: number; y: number };
