/** Two picked places, the line between them and its length in scan units. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { significant } from "../logic/format";
import type { Vector } from "./glb";
import type { ViewSettings } from "./settings";
import type { Stage } from "./stage";

const CLICK_PIXELS = 5;

interface Props {
  stage: Stage;
  canvas: HTMLCanvasElement;
  settings: ViewSettings;
}

export function Ruler({ stage, canvas, settings: { places } }: Props) {
  // Grows with every drawing, because the camera then may have moved.
  const drawn = useSignal(0);
  useEffect(() => {
    let down = { x: 0, y: 0 };
    const add = (x: number, y: number) => {
      const place = stage.pick(x, y);
      if (place) places.value = [...(places.value.length === 2 ? [] : places.value), place];
    };
    const press = (event: PointerEvent) => (down = { x: event.offsetX, y: event.offsetY });
    const release = (event: PointerEvent) => {
      const way = Math.hypot(event.offsetX - down.x, event.offsetY - down.y);
      if (way < CLICK_PIXELS && event.button === 0) add(event.offsetX, event.offsetY);
    };
    const key = (event: KeyboardEvent) => {
      if (event.key === "Enter") add(canvas.clientWidth / 2, canvas.clientHeight / 2);
      if (event.key === "Escape") places.value = [];
    };
    const stopWatching = stage.watch(() => (drawn.value += 1));
    canvas.addEventListener("pointerdown", press);
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("keydown", key);
    return () => {
      stopWatching();
      canvas.removeEventListener("pointerdown", press);
      canvas.removeEventListener("pointerup", release);
      canvas.removeEventListener("keydown", key);
    };
  }, [stage, canvas]);
  void drawn.value;
  const [from, to] = places.value.map((place) => stage.project(place));
  const length = lengthOf(places.value);
  return (
    <>
      <svg class="ruler" aria-hidden="true">
        {from && to && <line x1={from.x} y1={from.y} x2={to.x} y2={to.y} />}
        {[from, to].map((end, index) => end && <circle key={index} cx={end.x} cy={end.y} r={4.5} />)}
        {!from && <path class="cross" d={crossAt(canvas.clientWidth / 2, canvas.clientHeight / 2)} />}
      </svg>
      <p class="viewer-panel ruler-text" role="status">
        {length === null ? (
          from ? "Click the second point" : "Click two points (or aim at the cross and press Enter)"
        ) : (
          <>
            <strong>{significant(length, 4)}</strong> scan units
          </>
        )}
      </p>
    </>
  );
}

/** In scan units, once there are two places. */
export function lengthOf([from, to]: readonly Vector[]): number | null {
  return from && to ? Math.hypot(to[0] - from[0], to[1] - from[1], to[2] - from[2]) : null;
}

function crossAt(x: number, y: number): string {
  return `M${x - 8} ${y}h16M${x} ${y - 8}v16`;
}
