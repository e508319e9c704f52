/** Metrics and settings of several jobs, a column each. */
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import type { Job } from "../api/types";
import { type Metric, metric, settingsRows } from "../logic/compare";
import { count, duration, jobName, significant } from "../logic/format";
import { fieldName } from "../logic/form";
import { options } from "../state/options";
import type { Summary } from "../viewer/statistics";
import { Name } from "./Name";
import { valueText } from "./SettingsCard";

export function MetricsTable({ jobs, distances }: { jobs: readonly Job[]; distances: Record<string, Summary> }) {
  const rows = metricsOf(jobs, distances);
  return (
    <section class="card panel">
      <h2>Metrics</h2>
      <Columns jobs={jobs}>
        {rows.map((row) => (
          <tr key={row.name}>
            <th scope="row">
              {row.name} <span class="muted small">{row.unit}</span>
            </th>
            {row.texts.map((text, column) => (
              <td key={jobs[column]!.id} class={column === row.best ? "best" : ""}>
                {text}
                {column === row.best && <span class="unseen"> (best)</span>}
              </td>
            ))}
          </tr>
        ))}
      </Columns>
    </section>
  );
}

function metricsOf(jobs: readonly Job[], distances: Record<string, Summary>): Metric[] {
  const each = (read: (job: Job) => number | null | undefined) => jobs.map((job) => read(job) ?? null);
  const distance = (name: keyof Summary) => each((job) => distances[job.id]?.[name]);
  return [
    metric("Mean distance to the scan", "scan units", distance("mean"), "low", significant),
    metric("95 % are nearer than", "scan units", distance("p95"), "low", significant),
    metric("Largest distance", "scan units", distance("max"), "low", significant),
    metric("Resolution reached", "voxels", each((job) => job.result?.outcome.resolution), "none", count),
    metric("Triangles", "", each((job) => job.result?.faces), "none", count),
    metric("Time", "", each((job) => job.timings.running_seconds), "low", duration),
  ];
}

export function SettingsTable({ jobs }: { jobs: readonly Job[] }) {
  const all = useSignal(false);
  const rows = settingsRows(options.value, jobs.map((job) => job.params));
  const shown = all.value ? rows : rows.filter((row) => row.differs);
  return (
    <section class="card panel">
      <div class="row">
        <h2 class="grow">Settings</h2>
        <label class="check small">
          <input type="checkbox" checked={all.value} onChange={(event) => (all.value = event.currentTarget.checked)} />
          Also those that are the same
        </label>
      </div>
      {shown.length === 0 ? (
        <p class="muted">All settings are the same.</p>
      ) : (
        <Columns jobs={jobs}>
          {shown.map((row) => (
            <tr key={row.name}>
              <th scope="row">{fieldName(row.name)}</th>
              {row.values.map((value, column) => (
                <td key={jobs[column]!.id} class={row.differs ? "differs" : "muted"}>
                  {valueText(value)}
                </td>
              ))}
            </tr>
          ))}
        </Columns>
      )}
    </section>
  );
}

// Pixels that the columns need at least; a smaller screen scrolls them.
const FIRST_COLUMN = 120;
const COLUMN = 96;

function Columns({ jobs, children }: { jobs: readonly Job[]; children: ComponentChildren }) {
  return (
    <div class="table-scroll" tabIndex={0} role="group" aria-label="Table">
      <table class="columns" style={{ minWidth: `${FIRST_COLUMN + COLUMN * jobs.length}px` }}>
        <thead>
          <tr>
            <td />
            {jobs.map((job) => (
              <th key={job.id} scope="col">
                <a href={`/jobs/${job.id}`} title={jobName(job)}>
                  <Name>{jobName(job)}</Name>
                </a>
              </th>
            ))}
          </tr>
        </thead>
        <tbody>{children}</tbody>
      </table>
    </div>
  );
}
