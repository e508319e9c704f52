/** One number a vertex, summed up for the legend. */
export interface Summary {
  mean: number;
  rms: number;
  p95: number;
  max: number;
  min: number;
}

export function summarize(values: Float32Array): Summary {
  if (values.length === 0) return { mean: 0, rms: 0, p95: 0, max: 0, min: 0 };
  let sum = 0;
  let squares = 0;
  for (const value of values) {
    sum += value;
    squares += value * value;
  }
  const sorted = Float32Array.from(values).sort();
  return {
    mean: sum / values.length,
    rms: Math.sqrt(squares / values.length),
    p95: sorted[Math.floor(0.95 * (sorted.length - 1))]!,
    max: sorted.at(-1)!,
    min: sorted[0]!,
  };
}

/** Counts in `bins` equal steps from `low` to `high`; what lies outside counts at the ends. */
export function histogram(values: Float32Array, low: number, high: number, bins: number): number[] {
  const counts = Array.from({ length: bins }, () => 0);
  const step = (high - low) / bins || 1;
  for (const value of values) {
    const bin = Math.min(bins - 1, Math.max(0, Math.floor((value - low) / step)));
    counts[bin]! += 1;
  }
  return counts;
}

/** A round number not far above the value: an end for a scale. */
export function roundUp(value: number): number {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  // A hair of slack, so that 0.3 / 0.1 is no more than 3.
  const factor = [1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10].find((one) => one * (1 + 1e-9) >= value / power)!;
  return Number((factor * power).toPrecision(2));
}
