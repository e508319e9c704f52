/** The loss terms, step by step, as they come. */
import { chart } from "../logic/chart";
import { significant } from "../logic/format";
import type { LossPoint } from "../logic/history";

const WIDTH = 310;
const HEIGHT = 130;
// A level with less room than this goes unnamed; the time line above has its name too.
const LABEL_WIDTH = 28;

export function LossChart({ points, ended }: { points: readonly LossPoint[]; ended: boolean }) {
  const { curves, ticks, levels } = chart(points, WIDTH, HEIGHT);
  if (curves.length === 0) {
    return <p class="muted">{ended ? "The job ended before its first step." : "The curves begin with the first step."}</p>;
  }
  return (
    <figure class="losses">
      <svg viewBox={`-44 -16 ${WIDTH + 48} ${HEIGHT + 24}`} role="img" aria-label={spoken(curves, points.length)}>
        {ticks.map(([value, y]) => (
          <g key={value} class="tick">
            <line x1={0} x2={WIDTH} y1={y} y2={y} />
            <text x={-6} y={y + 4} text-anchor="end">
              {value.toExponential(0)}
            </text>
          </g>
        ))}
        {levels.map(([resolution, x], place) => (
          <g key={x} class="level">
            <line x1={x} x2={x} y1={0} y2={HEIGHT} />
            {(levels[place + 1]?.[1] ?? Infinity) - x > LABEL_WIDTH && (
              <text x={Math.min(x + 4, WIDTH - LABEL_WIDTH)} y={-5}>
                {resolution}
              </text>
            )}
          </g>
        ))}
        {curves.map(({ name, path }) => (
          <path key={name} class={`curve ${name}`} d={path} />
        ))}
      </svg>
      <figcaption>
        {curves.map(({ name, last }) => (
          <span key={name} class="row">
            <span class={`swatch ${name}`} /> {name} <span class="muted">{significant(last)}</span>
          </span>
        ))}
      </figcaption>
    </figure>
  );
}

function spoken(curves: ReadonlyArray<{ name: string; last: number }>, steps: number): string {
  const ends = curves.map(({ name, last }) => `${name} ${significant(last)}`).join(", ");
  return `Loss terms over ${steps} steps, now ${ends}`;
}
