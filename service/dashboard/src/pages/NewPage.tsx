/** Submit scans, or run a job again with other settings. */
import { useComputed, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { fetchJob, retryJob } from "../api/calls";
import { Refused, sentence } from "../api/http";
import type { Job } from "../api/types";
import { jobName, moment } from "../logic/format";
import { checkDraft, type Draft, draftOf, retryChanges, serverErrors } from "../logic/form";
import { Heading } from "../parts/Heading";
import { Name } from "../parts/Name";
import { ChosenFiles, DropZone, SentFiles } from "../parts/Intake";
import { SettingsForm } from "../parts/SettingsForm";
import { useTitle } from "../parts/useTitle";
import { chosen, items, newKey, send } from "../state/intake";
import { jobs, remember } from "../state/jobs";
import { options } from "../state/options";
import { navigate, query } from "../state/route";

export function NewPage() {
  const retryOf = query.value.get("retry");
  const model = query.value.get("like") ?? retryOf ?? "";
  const draft = useSignal<Draft>({});
  const refused = useSignal<Record<string, string>>({});
  const trouble = useSignal("");
  const like = useSignal<Job | null>(null);
  const checked = useComputed(() => checkDraft(options.value, draft.value));
  useTitle(retryOf ? "Retry" : "New job");
  useEffect(() => void copySettings(model), [model, options.value.length]);

  async function copySettings(id: string) {
    if (!id || options.value.length === 0) return;
    try {
      like.value = jobs.peek().get(id) ?? (await fetchJob(id));
      const { label, ...settings } = like.value.params;
      draft.value = draftOf(options.value, retryOf ? { ...settings, label } : settings);
    } catch (error) {
      trouble.value = `The settings could not be copied. ${sentence(error)}`;
    }
  }

  async function submit(event: Event) {
    event.preventDefault();
    if (retryOf && like.value) return retry(like.value);
    send(chosen.value, checked.value.params);
    chosen.value = [];
  }

  async function retry(old: Job) {
    const changes = retryChanges(options.value, old.params, checked.value.params);
    try {
      const job = await retryJob(old.id, changes, newKey());
      remember(job);
      navigate(`/jobs/${job.id}`);
    } catch (error) {
      trouble.value = sentence(error);
      if (error instanceof Refused) refused.value = serverErrors(error.fields);
    }
  }

  useOpenOnlyItem();
  const invalid = Object.keys(checked.value.errors).length;
  const ready = options.value.length > 0 && invalid === 0 && (retryOf ? like.value !== null : chosen.value.length > 0);
  return (
    <>
      <div class="page-head">
        <Heading>{retryOf ? <>Retry {like.value ? <Name>{jobName(like.value)}</Name> : "a job"}</> : "New job"}</Heading>
      </div>
      <form class={retryOf ? "" : "new-page"} onSubmit={submit} noValidate>
        {!retryOf && (
          <div class="stack">
            <DropZone withSample={chosen.value.length === 0} />
            {chosen.value.length > 0 && (
              <section class="card panel">
                <h2>{chosen.value.length === 1 ? "1 scan" : `${chosen.value.length} scans`}</h2>
                <ChosenFiles />
              </section>
            )}
            <SentFiles />
          </div>
        )}
        <section class="card panel stack">
          <div class="row">
            <h2 class="grow">Settings</h2>
            {!retryOf && <SameAs now={model} />}
          </div>
          <SettingsForm
            draft={draft.value}
            errors={{ ...refused.value, ...checked.value.errors }}
            onChange={(next) => {
              draft.value = next;
              refused.value = {};
            }}
          />
          <div class="submit-bar">
            <button class="button primary" disabled={!ready}>
              {retryOf ? "Run again" : chosen.value.length > 1 ? `Reconstruct ${chosen.value.length} scans` : "Reconstruct"}
            </button>
            <span class="muted small" role="status">
              {invalid > 0
                ? `${invalid} ${invalid === 1 ? "setting needs" : "settings need"} a change`
                : !retryOf && chosen.value.length === 0
                  ? "Choose a scan first"
                  : ""}
            </span>
            <span class="error grow" role="alert">
              {trouble.value}
            </span>
          </div>
        </section>
      </form>
    </>
  );
}

const OFFERED = 30;

/** “Same as job X”: the settings of an earlier job for new scans. */
function SameAs({ now }: { now: string }) {
  const recent = [...jobs.value.values()].sort((a, b) => (a.id < b.id ? 1 : -1)).slice(0, OFFERED);
  const known = jobs.value.get(now);
  if (known && !recent.includes(known)) recent.push(known);
  if (recent.length === 0) return null;
  return (
    <label class="row small">
      <span class="muted">Same as</span>
      <select
        class="input same-as"
        value={now}
        onChange={(event) => navigate(event.currentTarget.value ? `/new?like=${event.currentTarget.value}` : "/new")}
      >
        <option value="">the defaults</option>
        {recent.map((job) => (
          <option key={job.id} value={job.id}>
            {jobName(job)} · {String(job.params["resolution"] ?? "")} {moment(job.created_at)}
          </option>
        ))}
      </select>
    </label>
  );
}

/** A single scan's job is opened as soon as it exists; of many, the list tells. */
function useOpenOnlyItem(): void {
  const last = items.value.at(-1);
  const opened = useSignal(new Set(items.peek().map((item) => item.key)));
  useEffect(() => {
    if (last?.state !== "done" || !last.alone || opened.value.has(last.key)) return;
    opened.value = new Set([...opened.value, last.key]);
    navigate(`/jobs/${last.jobId}`);
  }, [last]);
}
