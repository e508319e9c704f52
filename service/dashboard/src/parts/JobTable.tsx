/** The jobs as a table that draws only the rows in view. */
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { isActive, type Job } from "../api/types";
import { ago, count, duration, jobName } from "../logic/format";
import { rowsInView, type SortKey } from "../logic/listing";
import { shown, view } from "../state/jobs";
import { Name } from "./Name";
import { ProgressBar, progressText, StatusBadge } from "./Status";
import { Thumbnail } from "./Thumbnail";

const ROW = 64;
const PHONE_ROW = 108;
const phone = matchMedia("(max-width: 900px)");

interface Props {
  selected: ReadonlySet<string>;
  onSelect(ids: string[], on: boolean): void;
}

export function JobTable({ selected, onSelect }: Props) {
  const rows = shown.value;
  const body = useRef<HTMLDivElement>(null);
  const rowHeight = phone.matches ? PHONE_ROW : ROW;
  const { first, last } = useWindow(body, rows.length, rowHeight);
  const anchor = useRef(-1);
  const select = (index: number, on: boolean, range: boolean) => {
    const from = range && anchor.current >= 0 ? anchor.current : index;
    const [low, high] = [Math.min(from, index), Math.max(from, index)];
    onSelect(rows.slice(low, high + 1).map((job) => job.id), on);
    anchor.current = index;
  };
  const all = rows.length > 0 && rows.every((job) => selected.has(job.id));
  return (
    <div role="table" aria-label="Jobs" aria-rowcount={rows.length + 1}>
      <div role="rowgroup">
        <div role="row" class="job-row job-head" aria-rowindex={1}>
          <span role="columnheader">
            <input
              type="checkbox"
              aria-label="Select all shown jobs"
              checked={all}
              onChange={(event) => onSelect(rows.map((job) => job.id), event.currentTarget.checked)}
            />
          </span>
          <span role="columnheader">
            <span class="unseen">Picture</span>
          </span>
          <SortHeader sort="name">Name</SortHeader>
          <SortHeader sort="status">Status</SortHeader>
          <SortHeader sort="time" number>
            Time
          </SortHeader>
          <SortHeader sort="faces" number>
            Triangles
          </SortHeader>
          <SortHeader sort="created" number>
            Submitted
          </SortHeader>
        </div>
      </div>
      <div role="rowgroup" class="job-body" ref={body} style={{ height: `${rows.length * rowHeight}px` }}>
        {rows.slice(first, last).map((job, offset) => (
          <JobRow
            key={job.id}
            job={job}
            index={first + offset}
            top={(first + offset) * rowHeight}
            selected={selected.has(job.id)}
            onSelect={select}
          />
        ))}
      </div>
    </div>
  );
}

function SortHeader({ sort, number, children }: { sort: SortKey; number?: boolean; children: string }) {
  const { sort: now, descending } = view.value;
  const active = now === sort;
  const change = () => {
    const next = active ? !descending : sort !== "name" && sort !== "status";
    view.value = { ...view.value, sort, descending: next };
  };
  return (
    <span
      role="columnheader"
      class={number ? "number" : ""}
      aria-sort={active ? (descending ? "descending" : "ascending") : "none"}
    >
      <button onClick={change}>
        {children}
        <span aria-hidden="true">{active ? (descending ? " ↓" : " ↑") : ""}</span>
      </button>
    </span>
  );
}

interface RowProps {
  job: Job;
  index: number;
  top: number;
  selected: boolean;
  onSelect(index: number, on: boolean, range: boolean): void;
}

function JobRow({ job, index, top, selected, onSelect }: RowProps) {
  const name = jobName(job);
  return (
    <div
      role="row"
      aria-rowindex={index + 2}
      class={`job-row ${selected ? "selected" : ""}`}
      style={{ top: `${top}px` }}
    >
      <span role="cell">
        <input
          type="checkbox"
          aria-label={`Select ${name}`}
          checked={selected}
          onClick={(event) => onSelect(index, event.currentTarget.checked, event.shiftKey)}
        />
      </span>
      <span role="cell">
        <Thumbnail job={job} />
      </span>
      <span role="cell" class="two-lines name-cell">
        <a class="name clip" href={`/jobs/${job.id}`} title={name}>
          <Name>{name}</Name>
        </a>
        <span class="muted small clip">
          {job.label && (
            <>
              <Name>{job.scan.name}</Name> ·{" "}
            </>
          )}
          {job.scan.points === null ? "" : `${count(job.scan.points)} points`}
        </span>
      </span>
      <span role="cell" class="two-lines state">
        <StatusBadge job={job} />
        <State job={job} />
      </span>
      <span role="cell" class="number time">
        {duration(job.timings.running_seconds)}
      </span>
      <span role="cell" class="number faces">
        {count(job.result?.faces)}
      </span>
      <span role="cell" class="number small muted age">
        <time dateTime={job.created_at} title={new Date(job.created_at).toLocaleString()}>
          {ago(job.created_at)}
        </time>
      </span>
    </div>
  );
}

function State({ job }: { job: Job }) {
  if (job.status === "failed") {
    return (
      <span class="small muted clip" title={job.error?.detail}>
        {job.error?.detail}
      </span>
    );
  }
  if (!isActive(job)) return null;
  return (
    <>
      {job.status === "running" && <ProgressBar progress={job.progress} label={`Progress of ${jobName(job)}`} />}
      <span class="small muted clip">{progressText(job)}</span>
    </>
  );
}

/** The rows in the browser's window; follows scrolling and resizing. */
function useWindow(body: { current: HTMLElement | null }, total: number, rowHeight: number) {
  const scrolled = useSignal({ top: 0, height: 1000 });
  useEffect(() => {
    const look = () => {
      const top = -(body.current?.getBoundingClientRect().top ?? 0);
      scrolled.value = { top, height: innerHeight };
    };
    look();
    addEventListener("scroll", look, { passive: true });
    addEventListener("resize", look);
    return () => {
      removeEventListener("scroll", look);
      removeEventListener("resize", look);
    };
  }, []);
  return rowsInView(total, rowHeight, scrolled.value.top, scrolled.value.height);
}
