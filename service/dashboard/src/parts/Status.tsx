/** A job's state as a word, and its progress as a bar. */
import type { Job, Progress } from "../api/types";
import { duration, percent, phaseName, statusName } from "../logic/format";

export function StatusBadge({ job }: { job: Job }) {
  return <span class={`badge ${job.status}`}>{statusName(job)}</span>;
}

export function ProgressBar({ progress, label }: { progress: Progress | null; label: string }) {
  const fraction = progress?.fraction ?? 0;
  return (
    <span
      class="bar"
      role="progressbar"
      aria-label={label}
      aria-valuemin={0}
      aria-valuemax={100}
      aria-valuenow={Math.floor(fraction * 100)}
    >
      <span style={{ width: `${Math.max(1, fraction * 100)}%` }} />
    </span>
  );
}

export function progressText(job: Job): string {
  if (job.status === "queued") {
    return job.queue_position === null ? "In the queue" : `${ordinal(job.queue_position)} in the queue`;
  }
  if (job.status !== "running") return "";
  const progress = job.progress;
  if (!progress) return "Starting";
  const left = progress.remaining_seconds;
  const rest = left === null ? "" : ` · about ${duration(Math.max(1, left))} left`;
  return `${percent(progress.fraction)} · ${phaseName(progress.phase)}${levelText(progress)}${rest}`;
}

function levelText(progress: Progress): string {
  return progress.resolution > 0 ? ` at ${progress.resolution}` : "";
}

function ordinal(place: number): string {
  const ending = { one: "st", two: "nd", few: "rd" }[
    new Intl.PluralRules("en", { type: "ordinal" }).select(place) as "one" | "two" | "few"
  ];
  return `${place}${ending ?? "th"}`;
}
