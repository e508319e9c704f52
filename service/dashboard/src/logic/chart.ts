/** Loss curves as paths: one step a unit to the right, logarithmic upwards. */
import type { LossPoint } from "./history";

export interface Curve {
  name: string;
  path: string;
  last: number;
}

export interface Chart {
  curves: Curve[];
  /** Powers of ten within the range, as [value, y]. */
  ticks: Array<[number, number]>;
  /** Where a level begins, as [resolution, x]. */
  levels: Array<[number, number]>;
}

const ORDER = ["point", "normal", "viscosity", "coarea"];

export function chart(points: readonly LossPoint[], width: number, height: number): Chart {
  const names = ORDER.filter((name) => points.some((point) => (point.terms[name] ?? 0) > 0));
  const values = points.flatMap((point) => names.map((name) => point.terms[name] ?? 0));
  const positive = values.filter((value) => value > 0);
  if (positive.length === 0) return { curves: [], ticks: [], levels: [] };
  const low = Math.floor(Math.log10(Math.min(...positive)));
  const high = Math.max(low + 1, Math.ceil(Math.log10(Math.max(...positive))));
  const x = (index: number) => (points.length < 2 ? 0 : (index / (points.length - 1)) * width);
  const y = (log: number) => height - ((log - low) / (high - low)) * height;
  const place = (value: number, index: number) =>
    `${x(index).toFixed(1)} ${y(Math.log10(value)).toFixed(1)}`;
  const curves = names.map((name) => {
    const known = points.map((point) => point.terms[name] ?? 0);
    const steps = known.flatMap((value, index) => (value > 0 ? [place(value, index)] : []));
    return { name, path: `M${steps.join("L")}`, last: known.at(-1) ?? 0 };
  });
  const ticks = Array.from({ length: high - low + 1 }, (_, step): [number, number] => [
    10 ** (low + step),
    y(low + step),
  ]);
  const levels = points.flatMap((point, index): Array<[number, number]> =>
    point.resolution === points[index - 1]?.resolution ? [] : [[point.resolution, x(index)]],
  );
  return { curves, ticks, levels };
}
