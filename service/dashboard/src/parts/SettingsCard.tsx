/** A job's settings: what differs from the defaults, and all of it as text to copy. */
import { useSignal } from "@preact/signals";
import type { Job } from "../api/types";
import { defaultText, fieldName } from "../logic/form";
import { snippet, type SnippetKind } from "../logic/snippets";
import { options } from "../state/options";
import { say } from "../state/toasts";
import { Icon } from "./Icon";

const KINDS: Record<SnippetKind, string> = { json: "JSON", curl: "curl", python: "Python" };

export function SettingsCard({ job }: { job: Job }) {
  const shown = useSignal<SnippetKind | null>(null);
  const given = options.value.filter((option) => option.name !== "label" && option.name in job.params);
  const text = shown.value && snippet(shown.value, job.scan.name, job.params, location.origin);
  return (
    <section class="card panel">
      <div class="row">
        <h2 class="grow">Settings</h2>
        {(Object.keys(KINDS) as SnippetKind[]).map((kind) => (
          <button
            key={kind}
            class="button small-button"
            aria-pressed={shown.value === kind}
            onClick={() => {
              shown.value = kind;
              void copy(snippet(kind, job.scan.name, job.params, location.origin), KINDS[kind]);
            }}
          >
            <Icon name="copy" /> {KINDS[kind]}
          </button>
        ))}
      </div>
      {given.length === 0 ? (
        <p class="muted">All settings have their defaults.</p>
      ) : (
        <dl class="pairs">
          {given.map((option) => (
            <div key={option.name}>
              <dt>{fieldName(option.name)}</dt>
              <dd>
                {valueText(job.params[option.name])}{" "}
                <span class="muted">
                  {option.unit} (default {defaultText(option)})
                </span>
              </dd>
            </div>
          ))}
        </dl>
      )}
      {text && (
        <pre class="snippet" tabIndex={0} aria-label={`The settings as ${KINDS[shown.value!]}`}>
          {text}
        </pre>
      )}
    </section>
  );
}

export function valueText(value: unknown): string {
  if (value === null || value === undefined) return "default";
  return Array.isArray(value) ? value.join(" ") : String(value);
}

/** Where the browser denies the clipboard, the text below the buttons can be marked by hand. */
async function copy(text: string, name: string): Promise<void> {
  try {
    await navigator.clipboard.writeText(text);
    say(`Copied as ${name}.`);
  } catch {
    say("The browser did not allow copying; mark the text instead.");
  }
}
