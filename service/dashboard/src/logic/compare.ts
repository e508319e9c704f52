/** What differs between jobs. */
import type { Job, Option, Params } from "../api/types";
import { sameValue } from "./form";

export interface DiffRow {
  name: string;
  values: unknown[];
  differs: boolean;
}

/** Each option with its value in every job; what was left out has its default. */
export function settingsRows(options: readonly Option[], all: readonly Params[]): DiffRow[] {
  return options
    .filter((option) => option.name !== "label")
    .map((option) => {
      const values = all.map((params) => params[option.name] ?? option.default ?? null);
      return { name: option.name, values, differs: values.some((v) => !sameValue(v, values[0])) };
    });
}

export interface Metric {
  name: string;
  unit: string;
  values: Array<number | null>;
  /** The column that does best, or -1 where no direction is better or all are equal. */
  best: number;
}

export function metric(
  name: string,
  unit: string,
  values: Array<number | null>,
  better: "low" | "high" | "none",
): Metric {
  return { name, unit, values, best: better === "none" ? -1 : bestOf(values, better) };
}

function bestOf(values: Array<number | null>, better: "low" | "high"): number {
  const known = values.filter((value): value is number => value !== null);
  if (known.length < 2 || new Set(known).size === 1) return -1;
  return values.indexOf(better === "low" ? Math.min(...known) : Math.max(...known));
}

export function sameScan(jobs: readonly Job[]): boolean {
  return new Set(jobs.map((job) => job.scan.sha256 ?? job.scan.upload_id)).size <= 1;
}
