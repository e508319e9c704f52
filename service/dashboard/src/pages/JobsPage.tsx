/** All jobs. */
import { useSignal } from "@preact/signals";
import { isActive, type Status } from "../api/types";
import { STATUS_NAMES } from "../logic/format";
import { countByStatus, FIRST_VIEW } from "../logic/listing";
import { Heading } from "../parts/Heading";
import { Icon } from "../parts/Icon";
import { DropZone } from "../parts/Intake";
import { JobTable } from "../parts/JobTable";
import { useTitle } from "../parts/useTitle";
import { online } from "../state/connection";
import { cancelJobs, deleteJobs, hidden, info, jobs, loaded, shown, trouble, view, whole } from "../state/jobs";

export function JobsPage() {
  useTitle("Jobs");
  const counts = countByStatus(jobs.value, hidden.value);
  const total = jobs.value.size - [...hidden.value].filter((id) => jobs.value.has(id)).length;
  return (
    <>
      <div class="page-head">
        <Heading grow>
          Jobs
        </Heading>
        {total > 0 && (
          <a class="button primary" href="/new">
            <Icon name="plus" /> New job
          </a>
        )}
      </div>
      {trouble.value && (
        <p class="notice bad" role="alert">
          {trouble.value}
        </p>
      )}
      {info.value?.workers.length === 0 && (counts.queued > 0 || total === 0) && (
        <p class="notice warn">
          No worker is running, so jobs wait. Start one with <code>visco worker</code>.
        </p>
      )}
      {!loaded.value ? (
        <p class="blank muted">{online.value ? (trouble.value ? "" : "Loading the jobs…") : "Waiting for the server"}</p>
      ) : total === 0 ? (
        <FirstVisit />
      ) : (
        <List counts={counts} />
      )}
    </>
  );
}

function FirstVisit() {
  return (
    <section class="stack first-visit">
      <DropZone withSample />
      <p class="muted">
        VisCo turns scanned points into a clean, closed surface. Drop a scan to begin; the settings have good defaults.
      </p>
    </section>
  );
}

function List({ counts }: { counts: Record<Status, number> }) {
  const selected = useSignal<ReadonlySet<string>>(new Set());
  const select = (ids: string[], on: boolean) => {
    const next = new Set(selected.value);
    for (const id of ids) if (on) next.add(id); else next.delete(id);
    selected.value = next;
  };
  const clear = () => (selected.value = new Set());
  return (
    <div class="card">
      <div class="list-tools">
        <Filters counts={counts} />
        <div class="grow" />
        <Bulk selected={selected.value} onDone={clear} />
      </div>
      {shown.value.length === 0 ? (
        <div class="blank">
          <h2>No job matches</h2>
          <button class="button" onClick={() => (view.value = FIRST_VIEW)}>
            Show all jobs
          </button>
        </div>
      ) : (
        <JobTable selected={selected.value} onSelect={select} />
      )}
      {!whole.value && <p class="blank muted">Loading older jobs…</p>}
    </div>
  );
}

function Filters({ counts }: { counts: Record<Status, number> }) {
  const { text, statuses } = view.value;
  const toggle = (status: Status) => {
    const next = new Set(statuses);
    if (!next.delete(status)) next.add(status);
    view.value = { ...view.value, statuses: next };
  };
  return (
    <>
      <label class="search">
        <span class="unseen">Search by label, file name or id</span>
        <Icon name="search" />
        <input
          class="input"
          type="search"
          placeholder="Search"
          value={text}
          onInput={(event) => (view.value = { ...view.value, text: event.currentTarget.value })}
        />
      </label>
      <div class="chips" role="group" aria-label="Show only">
        {(Object.keys(STATUS_NAMES) as Status[])
          .filter((status) => counts[status] > 0 || statuses.has(status))
          .map((status) => (
            <button
              key={status}
              class="button"
              aria-pressed={statuses.has(status)}
              onClick={() => toggle(status)}
            >
              {STATUS_NAMES[status]} <span class="muted">{counts[status]}</span>
            </button>
          ))}
      </div>
    </>
  );
}

function Bulk({ selected, onDone }: { selected: ReadonlySet<string>; onDone(): void }) {
  const chosen = shown.value.filter((job) => selected.has(job.id));
  if (chosen.length === 0) return null;
  const active = chosen.filter((job) => isActive(job) && !job.cancel_requested);
  const then = (act: () => void) => () => {
    act();
    onDone();
  };
  return (
    <div class="row" role="group" aria-label="Selected jobs">
      <span class="muted small">{chosen.length} selected</span>
      {chosen.length >= 2 && chosen.length <= 4 && (
        <a class="button" href={`/compare?jobs=${chosen.map((job) => job.id).join()}`}>
          <Icon name="columns" /> Compare
        </a>
      )}
      {active.length > 0 && (
        <button class="button" onClick={then(() => cancelJobs(active.map((job) => job.id)))}>
          Cancel
        </button>
      )}
      <button class="button danger" onClick={then(() => deleteJobs(chosen.map((job) => job.id)))}>
        <Icon name="trash" /> Delete
      </button>
    </div>
  );
}
