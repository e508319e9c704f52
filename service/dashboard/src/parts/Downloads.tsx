/** The files that a job has left. */
import { artifactTrouble, call } from "../api/http";
import type { Artifact, Job } from "../api/types";
import { bytes } from "../logic/format";
import { apiKey } from "../state/session";
import { say } from "../state/toasts";
import { Icon } from "./Icon";

const ORDER = ["mesh.glb", "mesh.ply", "preview.png", "report.json", "log.txt"];

export function Downloads({ job }: { job: Job }) {
  const files = [...job.artifacts].sort((a, b) => rank(a) - rank(b));
  if (files.length === 0) return null;
  return (
    <section class="card panel">
      <h2>Files</h2>
      <ul class="downloads">
        {files.map((file) => (
          <li key={file.name}>
            <a href={file.url} download={file.name} onClick={(event) => void download(event, file)}>
              <Icon name="down" /> {file.name}
            </a>
            <span class="muted small">{bytes(file.size)}</span>
          </li>
        ))}
      </ul>
    </section>
  );
}

function rank({ name }: Artifact): number {
  const place = ORDER.indexOf(name);
  return place < 0 ? ORDER.length : place;
}

/**
 * A link cannot carry the key, and an address must not; so with a key the file is fetched. Without
 * one the browser loads it, once the server was asked whether it is still there.
 */
async function download(event: Event, file: Artifact): Promise<void> {
  event.preventDefault();
  try {
    if (apiKey.peek()) {
      const address = URL.createObjectURL(await (await call(file.url)).blob());
      save(address, file.name);
      setTimeout(() => URL.revokeObjectURL(address), 60_000);
    } else {
      await call(file.url, { headers: { Range: "bytes=0-0" }, cache: "no-store" });
      save(file.url, file.name);
    }
  } catch (error) {
    say(artifactTrouble(error), "bad");
  }
}

function save(address: string, name: string): void {
  const link = document.createElement("a");
  link.href = address;
  link.download = name;
  link.click();
}
