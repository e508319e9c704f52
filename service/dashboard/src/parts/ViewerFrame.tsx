/** The viewer's place: loads it when it is needed, and shows a picture where it cannot run. */
import type { ComponentType } from "preact";
import { useEffect, useState } from "preact/hooks";
import { isActive, type Job } from "../api/types";
import { plainName } from "../logic/format";
import type { ViewerProps } from "../viewer/Viewer";
import { hasWebgl } from "../viewer/webgl";
import { progressText } from "./Status";
import { pictureOf, useArtifactUrl } from "./Thumbnail";

type Loaded = ComponentType<ViewerProps>;
let kept: Loaded | undefined;

const NOT_LOADED = "The viewer could not be loaded; reload the page to try again.";
const NO_GRAPHICS = "The browser gives this page no graphics, so here is a picture.";

export function ViewerFrame(props: ViewerProps) {
  const { job } = props;
  const [View, setView] = useState<Loaded | undefined>(() => kept);
  const [trouble, setTrouble] = useState("");
  const drawable = job.artifacts.some((artifact) => artifact.name.endsWith(".glb"));
  const wanted = hasWebgl() && drawable;
  useEffect(() => {
    if (!wanted || View || trouble) return;
    import("../viewer/Viewer").then(
      (module) => setView(() => (kept = module.default)),
      () => setTrouble(NOT_LOADED),
    );
  }, [wanted, View, trouble]);
  if (!drawable) return <Waiting job={job} />;
  if (!hasWebgl()) return <Picture job={job} why="This browser has no WebGL, so here is a picture." />;
  if (trouble) return <Picture job={job} why={trouble} onAgain={() => setTrouble("")} />;
  if (!View) return <p class="picture muted">Loading the viewer…</p>;
  return <View {...props} onBroken={() => setTrouble(NO_GRAPHICS)} />;
}

function Waiting({ job }: { job: Job }) {
  if (isActive(job)) {
    return (
      <p class="picture muted">
        {job.status === "queued" ? progressText(job) : "The surface appears here with the first level."}
      </p>
    );
  }
  return <Picture job={job} why={job.status === "succeeded" ? "This job was asked for no GLB." : ""} />;
}

function Picture({ job, why, onAgain }: { job: Job; why: string; onAgain?: () => void }) {
  const source = useArtifactUrl(pictureOf(job));
  const [broken, setBroken] = useState(false);
  useEffect(() => setBroken(false), [source]);
  const visible = source && !broken;
  return (
    <div class="picture">
      {visible && (
        <img src={source} alt={`The surface of ${plainName(job.scan.name)}`} onError={() => setBroken(true)} />
      )}
      <p class="muted">{why || (visible ? "" : "There is no surface to show.")}</p>
      {onAgain && (
        <button type="button" class="button" onClick={onAgain}>
          Try again
        </button>
      )}
    </div>
  );
}
