/** The scan's axes as they lie in the view; a click looks along one of them. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Stage } from "./stage";
import { isPositive, opposite, upName, UPS } from "./up";

const REACH = 30;
const MIDDLE = 42;
// Cosine from which on an axis points at the eye.
const STRAIGHT = 0.999;

export function Compass({ stage }: { stage: Stage }) {
  // Grows with every drawing, because the camera then may have moved.
  const drawn = useSignal(0);
  useEffect(() => stage.watch(() => (drawn.value += 1)), [stage]);
  void drawn.value;
  const ends = UPS.flatMap((axis) => {
    const way = stage.seen(axis);
    if (!way || way.z < -STRAIGHT) return [];
    // Who looks along an axis already goes to its other side, which is hidden behind it.
    const from = way.z > STRAIGHT ? opposite(axis) : axis;
    return [{ axis, from, x: MIDDLE + REACH * way.x, y: MIDDLE - REACH * way.y, depth: way.z }];
  });
  return (
    <div class="compass" role="group" aria-label="Look along an axis">
      <svg aria-hidden="true">
        {ends.map(({ axis, x, y }) =>
          isPositive(axis) ? <line key={axis} class={axis} x1={MIDDLE} y1={MIDDLE} x2={x} y2={y} /> : null,
        )}
      </svg>
      {ends.map(({ axis, from, x, y, depth }) => (
        <button
          key={axis}
          type="button"
          class={`${axis.at(-1)} ${isPositive(axis) ? "" : "negative"}`}
          style={{ left: `${x}px`, top: `${y}px`, zIndex: depth > 0 ? 2 : 1 }}
          aria-label={`Look from ${upName(from)}`}
          title={`Look from ${upName(from)}`}
          onClick={() => stage.fit(from)}
        >
          {isPositive(axis) ? axis.toUpperCase() : ""}
        </button>
      ))}
    </div>
  );
}
