/** What happened, as it happens; the worker's whole log once it is stored. */
import { useEffect, useState } from "preact/hooks";
import { fetchText } from "../api/calls";
import { isActive, type Job } from "../api/types";
import type { LogLine } from "../logic/history";

export function LogCard({ job, lines }: { job: Job; lines: readonly LogLine[] }) {
  const stored = job.artifacts.find((artifact) => artifact.name === "log.txt");
  const [text, setText] = useState("");
  const wanted = isActive(job) ? undefined : stored?.url;
  useEffect(() => {
    if (wanted) fetchText(wanted).then(setText, () => undefined);
  }, [wanted, stored?.sha256]);
  return (
    <section class="card panel">
      <h2>Log</h2>
      <pre class="log" tabIndex={0} aria-label="Log">
        {text ? withLocalTimes(text) : lines.map(lineText).join("\n") || "Nothing yet."}
      </pre>
    </section>
  );
}

function lineText({ at, text }: LogLine): string {
  return `${clock(at)}  ${text}`;
}

function clock(at: number | string): string {
  return new Date(at).toLocaleTimeString("en-GB");
}

/** The stored log has dates in UTC, which leave a narrow card no room for what happened. */
function withLocalTimes(log: string): string {
  return log.replace(/^(\d{4}-\d\d-\d\dT\S+) /gm, (_, at: string) => `${clock(at)}  `);
}
