/** Two to four jobs beside each other: surfaces under one camera, metrics, settings. */
import { useComputed, useSignal } from "@preact/signals";
import { useEffect, useMemo } from "preact/hooks";
import { fetchJob } from "../api/calls";
import { sentence } from "../api/http";
import type { Job } from "../api/types";
import { sameScan } from "../logic/compare";
import { jobName } from "../logic/format";
import { Heading } from "../parts/Heading";
import { CompareStages } from "../parts/CompareStages";
import { MetricsTable, SettingsTable } from "../parts/CompareTables";
import { Icon } from "../parts/Icon";
import { useTitle } from "../parts/useTitle";
import { epoch } from "../state/connection";
import { jobs, remember } from "../state/jobs";
import { navigate } from "../state/route";
import type { Summary } from "../viewer/statistics";

const MOST = 4;

export function ComparePage({ ids }: { ids: string[] }) {
  useTitle("Compare");
  const trouble = useSignal("");
  const distances = useSignal<Record<string, Summary>>({});
  const found = useComputed(() => ids.map((id) => jobs.value.get(id)));
  useEffect(() => {
    trouble.value = "";
    for (const id of ids) {
      if (!jobs.peek().get(id)) fetchJob(id).then(remember, (error) => (trouble.value = sentence(error)));
    }
  }, [epoch.value]);
  const known = found.value.filter((job): job is Job => job !== undefined);
  const onMeasured = useMemo(
    () => (id: string, summary: Summary) => (distances.value = { ...distances.peek(), [id]: summary }),
    [],
  );
  return (
    <>
      <div class="page-head">
        <Heading grow>
          Compare
        </Heading>
        <AddJob known={known} />
      </div>
      {trouble.value && (
        <p class="notice bad" role="alert">
          A job cannot be shown. {trouble.value}
        </p>
      )}
      {known.length < 2 ? (
        <div class="blank card">
          <h2>{known.length === 0 ? "Choose jobs to compare" : "Choose a second job"}</h2>
          <p>Mark two to four jobs in the list and choose Compare, or add one above.</p>
          <a class="button" href="/">
            All jobs
          </a>
        </div>
      ) : (
        <div class="stack">
          {!sameScan(known) && <p class="notice warn">These jobs are of different scans.</p>}
          <CompareStages jobs={known} onMeasured={onMeasured} />
          <MetricsTable jobs={known} distances={distances.value} />
          <SettingsTable jobs={known} />
        </div>
      )}
    </>
  );
}

function AddJob({ known }: { known: readonly Job[] }) {
  const ids = known.map((job) => job.id);
  const scan = known[0]?.scan.sha256;
  const others = [...jobs.value.values()]
    .filter((job) => job.status === "succeeded" && !ids.includes(job.id))
    .filter((job) => scan === undefined || job.scan.sha256 === scan)
    .sort((a, b) => (a.id < b.id ? 1 : -1));
  if (others.length === 0 || known.length >= MOST) return null;
  return (
    <label class="row small">
      <Icon name="plus" />
      <span class="muted">Add a job{scan ? " of this scan" : ""}</span>
      <select
        class="input same-as"
        value=""
        onChange={(event) => navigate(`/compare?jobs=${[...ids, event.currentTarget.value].join()}`)}
      >
        <option value="">…</option>
        {others.slice(0, 50).map((job) => (
          <option key={job.id} value={job.id}>
            {jobName(job)} · {job.result?.outcome.resolution}
          </option>
        ))}
      </select>
    </label>
  );
}
