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
  texts: string[];
  /** The column that does best, or -1 where no direction is better or all are equal. */
  best: number;
}

/** `text` shows a value; what looks the same there is no better. */
export function metric(
  name: string,
  unit: string,
  values: Array<number | null>,
  better: "low" | "none",
  text: (value: number) => string,
): Metric {
  const texts = values.map((value) => (value === null ? "–" : text(value)));
  return { name, unit, texts, best: better === "none" ? -1 : lowestOf(values, texts) };
}

function lowestOf(values: ReadonlyArray<number | null>, texts: readonly string[]): number {
  const known = values.filter((value): value is number => value !== null);
  const best = values.indexOf(Math.min(...known));
  const alone = texts.filter((text) => text === texts[best]).length === 1;
  return known.length > 1 && alone ? best : -1;
}

export function sameScan(jobs: readonly Job[]): boolean {
  return new Set(jobs.map((job) => job.scan.sha256 ?? job.scan.upload_id)).size <= 1;
}
