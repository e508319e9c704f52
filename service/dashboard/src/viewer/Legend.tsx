/** The scale of the colors, with how many vertices have each. */
import { useSignal } from "@preact/signals";
import { Fragment } from "preact";
import { percent, significant } from "../logic/format";
import { cssColorAt } from "./colormap";
import { histogram, type Summary } from "./statistics";

const BINS = 40;

export interface Scale {
  title: string;
  unit: string;
  values: Float32Array;
  summary: Summary;
  low: number;
  high: number;
  /** What is told of the values in words: a name and a number each. */
  facts: ReadonlyArray<readonly [string, string]>;
  /** Sets the upper end; absent where the scale is fixed. */
  onEnd?: (end: number | null) => void;
}

export function Legend({ title, unit, values, summary, low, high, facts, onEnd }: Scale) {
  const counts = histogram(values, low, high, BINS);
  const most = Math.max(...counts, 1);
  const beyond = values.reduce((sum, value) => sum + (value > high ? 1 : 0), 0) / (values.length || 1);
  return (
    <figure class="viewer-panel legend">
      <figcaption>{title}</figcaption>
      <p class="muted">{unit}</p>
      <svg viewBox={`0 0 ${BINS * 6} 48`} role="img" aria-label={`Histogram: mean ${significant(summary.mean)}`}>
        {counts.map((count, bin) => (
          <rect
            key={bin}
            x={bin * 6}
            width={5.4}
            y={48 - (47 * count) / most}
            height={(47 * count) / most}
            fill={cssColorAt((bin + 0.5) / BINS)}
          />
        ))}
      </svg>
      <div class="scale" aria-hidden="true">
        {Array.from({ length: 24 }, (_, step) => (
          <span key={step} style={{ background: cssColorAt(step / 23) }} />
        ))}
      </div>
      <div class="row ends">
        <span>{significant(low)}</span>
        <span class="grow" />
        {onEnd ? <End high={high} onEnd={onEnd} /> : <span>{significant(high)}</span>}
      </div>
      {onEnd && (
        <input
          type="range"
          aria-label="Upper end of the colors"
          min={0.02}
          max={1}
          step={0.01}
          value={Math.sqrt(high / (summary.max || 1))}
          onInput={(event) => onEnd(Number(event.currentTarget.value) ** 2 * summary.max)}
          onDblClick={() => onEnd(null)}
        />
      )}
      <dl>
        {facts.map(([name, value]) => (
          <Fragment key={name}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </Fragment>
        ))}
      </dl>
      {beyond > 0 && <p class="muted">{beyond < 0.01 ? "Under 1 %" : percent(beyond)} above the scale</p>}
    </figure>
  );
}

/**
 * A tolerance is typed; empty goes back to what the data suggest. What is being typed stays where
 * the scale is drawn anew meanwhile, as when the other surface's distances arrive.
 */
function End({ high, onEnd }: { high: number; onEnd: (end: number | null) => void }) {
  const typed = useSignal<string | null>(null);
  const take = (text: string) => {
    typed.value = null;
    const value = Number(text);
    if (text.trim() === "") onEnd(null);
    else if (value > 0 && Number.isFinite(value)) onEnd(value);
  };
  return (
    <input
      class="input end"
      aria-label="Colors end at"
      inputMode="decimal"
      autocomplete="off"
      value={typed.value ?? significant(high)}
      onInput={(event) => (typed.value = event.currentTarget.value)}
      onBlur={() => (typed.value = null)}
      onChange={(event) => take(event.currentTarget.value)}
    />
  );
}
