/** Numbers and times as people read them. */
import type { Job, Status } from "../api/types";

export function duration(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return "–";
  if (seconds < 0.995) return `${Math.max(0, seconds).toFixed(2)} s`;
  if (seconds < 9.95) return `${seconds.toFixed(1)} s`;
  if (seconds < 59.5) return `${Math.round(seconds)} s`;
  const whole = Math.round(seconds);
  const [hours, minutes, rest] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  if (hours > 0) return `${hours} h ${minutes} min`;
  return rest > 0 ? `${minutes} min ${rest} s` : `${minutes} min`;
}

export function bytes(size: number): string {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let value = size;
  let unit = 0;
  while (value >= 999.5 && unit < units.length - 1) {
    value /= 1000;
    unit += 1;
  }
  return `${unit === 0 || value >= 99.5 ? Math.round(value) : value.toPrecision(2)} ${units[unit]}`;
}

export function count(value: number | null | undefined): string {
  return value === null || value === undefined ? "–" : value.toLocaleString("en-US");
}

/** About `digits` significant digits, without an exponent where a person would not use one. */
export function significant(value: number, digits = 3): string {
  if (!Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(digits - 1).replace("e+", "e");
  if (size >= 10 ** (digits - 1)) return String(Math.round(value));
  return String(Number(value.toPrecision(digits)));
}

export function percent(fraction: number): string {
  return `${Math.floor(Math.min(1, Math.max(0, fraction)) * 100)} %`;
}

export function ago(iso: string, now = Date.now()): string {
  const seconds = (now - Date.parse(iso)) / 1000;
  if (seconds < 45) return "just now";
  if (seconds < 3600) return `${Math.max(1, Math.round(seconds / 60))} min ago`;
  if (seconds < 86_400) return `${Math.round(seconds / 3600)} h ago`;
  if (seconds < 7 * 86_400) return `${Math.round(seconds / 86_400)} d ago`;
  return iso.slice(0, 10);
}

/** Day and time, here and now. */
export function moment(iso: string): string {
  return new Date(iso).toLocaleString("en-GB", { day: "numeric", month: "short", hour: "2-digit", minute: "2-digit" });
}

export const STATUS_NAMES: Record<Status, string> = {
  queued: "Queued",
  running: "Running",
  succeeded: "Done",
  failed: "Failed",
  cancelled: "Cancelled",
};

export function statusName(job: Pick<Job, "status" | "cancel_requested">): string {
  if (job.status === "running" && job.cancel_requested) return "Cancelling";
  return STATUS_NAMES[job.status];
}

/** What a person calls the job. */
export function jobName(job: Pick<Job, "label" | "scan">): string {
  return plainName(job.label || job.scan.name);
}

/**
 * A name without control characters, also those that turn the direction of reading: `gpj.ply` must
 * not be shown where `ylp.jpg` is stored. Marks that only Arabic or Hebrew needs are let through.
 */
export function plainName(name: string): string {
  return name.replace(/[\p{Cc}\u2028\u2029\u202a-\u202e\u2066-\u2069]/gu, "\ufffd");
}

/** For the place in a list; `phaseName` is for a sentence. */
export function shortPhaseName(phase: string): string {
  return phase === "queued" ? "Wait" : phase.charAt(0).toUpperCase() + phase.slice(1);
}

const PHASE_NAMES: Record<string, string> = {
  queued: "Waiting",
  fetch: "Fetching the scan",
  read: "Reading the scan",
  prepare: "Preparing points",
  normals: "Estimating normals",
  noise: "Measuring the noise",
  start: "Starting field",
  refine: "Refining the grid",
  solve: "Solving",
  extract: "Extracting the surface",
  write: "Writing files",
};

export function phaseName(phase: string): string {
  return PHASE_NAMES[phase] ?? phase;
}
