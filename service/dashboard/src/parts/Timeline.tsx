/** Where the time of the latest attempt went: one bar, a segment for each phase and level. */
import { duration, phaseName, shortPhaseName } from "../logic/format";
import { latestAttempt, phaseSeconds, type Segment, withWriting } from "../logic/history";

interface Props {
  segments: readonly Segment[];
  /** What each phase cost, once the job has ended. */
  final: ReadonlyArray<{ name: string; seconds: number }>;
}

const SHORTEST_SHARE = 0.004;
const SHORTEST_SECONDS = 0.005;

export function Timeline({ segments, final }: Props) {
  const writing = final.find(({ name }) => name === "write")?.seconds ?? 0;
  const shown = withWriting(latestAttempt(segments), writing);
  const first = shown[0];
  const last = shown.at(-1);
  if (!first || !last) return <p class="muted">The work has not begun.</p>;
  const span = Math.max(1, last.end - first.start);
  const sums = final.length > 0 ? final : phaseSeconds(shown);
  return (
    <div class="timeline">
      <div class="track" aria-hidden="true">
        {shown.map((segment) => {
          const share = (segment.end - segment.start) / span;
          if (share < SHORTEST_SHARE) return null;
          return (
            <span
              key={`${segment.start}${segment.phase}`}
              class={`segment ${segment.phase}`}
              style={{ flexGrow: share }}
              title={`${phaseName(segment.phase)}${at(segment)}: ${duration((segment.end - segment.start) / 1000)}`}
            >
              {share > 0.09 && segment.resolution > 0 ? segment.resolution : ""}
            </span>
          );
        })}
      </div>
      <dl>
        {sums
          .filter(({ seconds }) => seconds >= SHORTEST_SECONDS)
          .map(({ name, seconds }) => (
            <div key={name}>
              <dt title={phaseName(name)}>
                <span class={`swatch ${name}`} /> {shortPhaseName(name)}
              </dt>
              <dd class="number">{duration(seconds)}</dd>
            </div>
          ))}
      </dl>
    </div>
  );
}

function at({ resolution }: Segment): string {
  return resolution > 0 ? ` at ${resolution}` : "";
}
