/** One job: how it goes, what came out, and what to do next. */
import { useEffect, useMemo } from "preact/hooks";
import { cancelJob } from "../api/calls";
import { sentence } from "../api/http";
import { isActive, type Job } from "../api/types";
import { count, duration, jobName } from "../logic/format";
import { type History, NO_HISTORY } from "../logic/history";
import { Heading } from "../parts/Heading";
import { Downloads } from "../parts/Downloads";
import { Icon } from "../parts/Icon";
import { LogCard } from "../parts/LogCard";
import { LossChart } from "../parts/LossChart";
import { SettingsCard } from "../parts/SettingsCard";
import { Name } from "../parts/Name";
import { ProgressBar, progressText, StatusBadge } from "../parts/Status";
import { Timeline } from "../parts/Timeline";
import { useTitle } from "../parts/useTitle";
import { ViewerFrame } from "../parts/ViewerFrame";
import { deleteJobs, jobs } from "../state/jobs";
import { openJob, type OneJob } from "../state/onejob";
import { navigate } from "../state/route";
import { say } from "../state/toasts";

export function JobPage({ id }: { id: string }) {
  const one = useMemo(() => openJob(id), [id]);
  useEffect(() => one.stop, [one]);
  const job = one.job.value;
  useTitle(job ? jobName(job) : "Job");
  if (!job) return <NoJob trouble={one.trouble.value} />;
  const history = one.history.value;
  const live = current(job, history);
  return (
    <>
      <Head job={live} one={one} />
      <Verdict job={live} />
      <div class="job-page">
        <div class="card viewer-card">
          <ViewerFrame job={job} />
        </div>
        <div class="stack">
          <Facts job={live} />
          <section class="card panel">
            <h2>Time</h2>
            <Timeline segments={history.segments} final={job.phases} />
          </section>
          <section class="card panel">
            <h2>Losses</h2>
            <LossChart points={history.losses} ended={!isActive(live)} />
          </section>
          <Downloads job={job} />
          <SettingsCard job={job} />
          <LogCard job={job} lines={history.lines} />
        </div>
      </div>
    </>
  );
}

/** Events are ahead of what was last fetched. */
function current(job: Job, history: History): Job {
  if (history === NO_HISTORY || !isActive(job)) return job;
  if (history.end) return { ...job, status: history.end };
  return job.status === "running" && history.progress ? { ...job, progress: history.progress } : job;
}

function NoJob({ trouble }: { trouble: string }) {
  if (!trouble) return <p class="blank muted">Loading the job…</p>;
  return (
    <div class="blank card">
      <Heading>This job cannot be shown</Heading>
      <p>{trouble}</p>
      <a class="button primary" href="/">
        All jobs
      </a>
    </div>
  );
}

function Head({ job, one }: { job: Job; one: OneJob }) {
  const active = isActive(job);
  const cancel = async () => {
    try {
      one.job.value = await cancelJob(job.id);
    } catch (error) {
      say(sentence(error), "bad");
      await one.refresh();
    }
  };
  const remove = () => {
    deleteJobs([job.id]);
    navigate("/");
  };
  const other = job.status === "succeeded" ? sibling(job) : undefined;
  return (
    <div class="page-head">
      <div class="grow">
        <Heading>
          <Name>{jobName(job)}</Name>
        </Heading>
        <p class="row small muted">
          <StatusBadge job={job} />
          {job.label && <Name>{job.scan.name}</Name>}
          <span class="mono">{job.id}</span>
        </p>
      </div>
      {active ? (
        <button class="button" onClick={cancel} disabled={job.cancel_requested}>
          <Icon name="close" /> {job.cancel_requested ? "Cancelling…" : "Cancel"}
        </button>
      ) : (
        <a class="button" href={`/new?retry=${job.id}`}>
          <Icon name="retry" /> Retry with changes
        </a>
      )}
      <a class="button" href={`/new?like=${job.id}`}>
        <Icon name="plus" /> Same settings
      </a>
      {other && (
        <a class="button" href={`/compare?jobs=${other.id},${job.id}`}>
          <Icon name="columns" /> Compare
        </a>
      )}
      <button class="button danger icon-only" aria-label="Delete this job" title="Delete" onClick={remove}>
        <Icon name="trash" />
      </button>
    </div>
  );
}

/** Another finished job of the same scan, the nearest one in time. */
function sibling(job: Job): Job | undefined {
  const others = [...jobs.value.values()].filter(
    (one) => one.id !== job.id && one.status === "succeeded" && one.scan.sha256 === job.scan.sha256,
  );
  const before = others.filter((one) => one.id < job.id).sort((a, b) => (a.id < b.id ? 1 : -1));
  return before[0] ?? others[0];
}

function Verdict({ job }: { job: Job }) {
  if (isActive(job)) {
    return (
      <section class="card panel progress-card" aria-label="Progress">
        <ProgressBar progress={job.status === "running" ? job.progress : null} label="Progress" />
        <p>{progressText(job)}</p>
      </section>
    );
  }
  if (job.status === "failed") {
    return (
      <div class="notice bad" role="alert">
        <strong>The job failed.</strong> {job.error?.detail} <span class="muted small mono">{job.error?.code}</span>
      </div>
    );
  }
  if (job.status === "cancelled") return <p class="notice">The job was cancelled.</p>;
  const { outcome, notes } = job.result ?? {};
  const remarks = [outcome && outcome.code !== "complete" ? outcome.message : "", ...(notes ?? [])].filter(Boolean);
  return remarks.length > 0 ? <p class="notice warn">{remarks.join(" ")}</p> : null;
}

function Facts({ job }: { job: Job }) {
  const device = job.attempts.at(-1)?.device;
  const facts: Array<[string, string]> = [
    ["Points", count(job.scan.points)],
    ["Triangles", count(job.result?.faces)],
    ["Resolution", count(job.result?.outcome.resolution)],
    ["Time", duration(job.timings.running_seconds)],
    ["Waited", duration(job.timings.queued_seconds)],
    ["Device", device ?? "–"],
  ];
  return (
    <section class="card panel">
      <h2 class="unseen">Result</h2>
      <dl class="facts">
        {facts.map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
    </section>
  );
}
