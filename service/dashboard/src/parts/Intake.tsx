/** Choosing scans, and watching them go. */
import { useRef } from "preact/hooks";
import sample from "../../../../visco_core/samples/octopus.ply?url";
import { SCAN_ENDINGS } from "../logic/files";
import { bytes, percent, plainName } from "../logic/format";
import { online } from "../state/connection";
import { again, chosen, clearDone, giveUp, items, type Item } from "../state/intake";
import { say } from "../state/toasts";
import { Icon } from "./Icon";
import { Name } from "./Name";
import { takeFiles } from "./Shell";

const ACCEPT = SCAN_ENDINGS.map((ending) => `.${ending}`).join();

export function DropZone({ withSample }: { withSample: boolean }) {
  const files = useRef<HTMLInputElement>(null);
  const folder = useRef<HTMLInputElement>(null);
  const take = (event: Event) => {
    const input = event.currentTarget as HTMLInputElement;
    takeFiles(input.files ?? []);
    input.value = "";
  };
  return (
    <div class="drop-zone">
      <Icon name="upload" />
      <strong>Drop scans or folders here</strong>
      <p class="muted small">PLY, XYZ, PTS, OBJ, STL, PCD, LAS, LAZ, E57 or NPZ</p>
      <div class="row">
        <button type="button" class="button" onClick={() => files.current?.click()}>
          Choose files
        </button>
        <button type="button" class="button" onClick={() => folder.current?.click()}>
          <Icon name="folder" /> Choose a folder
        </button>
      </div>
      {withSample && (
        <button type="button" class="button quiet" onClick={takeSample}>
          No scan at hand? Take the sample
        </button>
      )}
      <input ref={files} type="file" multiple accept={ACCEPT} hidden onChange={take} aria-label="Scan files" />
      <input
        ref={(input) => {
          folder.current = input;
          // Not an attribute that Preact's types know.
          input?.setAttribute("webkitdirectory", "");
        }}
        type="file"
        hidden
        onChange={take}
        aria-label="Folder of scans"
      />
    </div>
  );
}

/** The scan that ships with the service, as if it had been dropped. */
export async function takeSample(): Promise<void> {
  try {
    const answer = await fetch(sample);
    if (!answer.ok) throw new Error(`The server answered ${answer.status}.`);
    takeFiles([new File([await answer.blob()], "octopus.ply", { lastModified: 0 })]);
  } catch (error) {
    say(`The sample could not be loaded. ${(error as Error).message}`, "bad");
  }
}

export function ChosenFiles() {
  if (chosen.value.length === 0) return null;
  return (
    <ul class="files" aria-label="Chosen scans">
      {chosen.value.map((file) => (
        <li key={`${file.name}:${file.size}:${file.lastModified}`}>
          <span class="grow clip" title={plainName(file.name)}>
            <Name>{file.name}</Name>
          </span>
          <span class="muted small">{bytes(file.size)}</span>
          <button
            type="button"
            class="button quiet icon-only"
            aria-label={`Remove ${plainName(file.name)}`}
            onClick={() => (chosen.value = chosen.value.filter((one) => one !== file))}
          >
            <Icon name="close" />
          </button>
        </li>
      ))}
    </ul>
  );
}

export function SentFiles() {
  const all = items.value;
  if (all.length === 0) return null;
  const done = all.filter((item) => item.state === "done").length;
  return (
    <section class="card panel stack">
      <div class="row">
        <h2>Uploads</h2>
        <span class="muted small grow" role="status">
          {done} of {all.length} submitted
        </span>
        {done > 0 && (
          <>
            <button type="button" class="button small-button" onClick={clearDone}>
              Clear
            </button>
            <a class="button small-button" href="/">
              All jobs
            </a>
          </>
        )}
      </div>
      <ul class="files">
        {all.toSorted((a, b) => URGENCY[a.state] - URGENCY[b.state]).map((item) => (
          <SentFile key={item.key} item={item} />
        ))}
      </ul>
    </section>
  );
}

/** What needs a hand comes first, what is over last. */
const URGENCY: Record<Item["state"], number> = { failed: 0, submitting: 1, uploading: 1, waiting: 2, done: 3 };

function SentFile({ item }: { item: Item }) {
  const fraction = item.file.size > 0 ? item.sent / item.file.size : 1;
  return (
    <li>
      <span class="grow">
        <span class="clip" style={{ display: "block" }} title={plainName(item.file.name)}>
          <Name>{item.file.name}</Name>
        </span>
        {item.error && <span class="error">{item.error}</span>}
      </span>
      {(item.state === "uploading" || item.state === "submitting") && (
        <>
          <span class="muted small">{online.value ? percent(fraction) : "waiting for the server"}</span>
          <span
            class="bar"
            role="progressbar"
            aria-label={`Upload of ${plainName(item.file.name)}`}
            aria-valuemin={0}
            aria-valuemax={100}
            aria-valuenow={Math.floor(fraction * 100)}
          >
            <span style={{ width: `${fraction * 100}%` }} />
          </span>
        </>
      )}
      {item.state === "waiting" && <span class="muted small">waiting</span>}
      {item.state === "failed" && (
        <button type="button" class="button" onClick={() => again(item.key)}>
          Try again
        </button>
      )}
      {item.state === "done" ? (
        <a class="button" href={`/jobs/${item.jobId}`}>
          Open
        </a>
      ) : (
        <button
          type="button"
          class="button quiet icon-only"
          aria-label={`Give up ${plainName(item.file.name)}`}
          onClick={() => giveUp(item.key)}
        >
          <Icon name="close" />
        </button>
      )}
    </li>
  );
}
