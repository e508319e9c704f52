/** The viewer's place: loads it when it is needed, and shows a picture where it cannot run. */
import type { ComponentType } from "preact";
import { useEffect, useState } from "preact/hooks";
import { isActive, type Job } from "../api/types";
import type { ViewerProps } from "../viewer/Viewer";
import { hasWebgl } from "../viewer/webgl";
import { progressText } from "./Status";
import { pictureOf, useArtifactUrl } from "./Thumbnail";

type Loaded = ComponentType<ViewerProps>;
let kept: Loaded | undefined;

export function ViewerFrame(props: ViewerProps) {
  const { job } = props;
  const [View, setView] = useState<Loaded | undefined>(() => kept);
  const [failed, setFailed] = useState(false);
  const drawable = job.artifacts.some((artifact) => artifact.name.endsWith(".glb"));
  const wanted = hasWebgl() && drawable;
  useEffect(() => {
    if (!wanted || View) return;
    import("../viewer/Viewer").then(
      (module) => setView(() => (kept = module.default)),
      () => setFailed(true),
    );
  }, [wanted, View]);
  if (!drawable) return <Waiting job={job} />;
  if (!hasWebgl()) return <Picture job={job} why="This browser has no WebGL, so here is a picture." />;
  if (failed) return <Picture job={job} why="The viewer could not be loaded; reload the page to try again." />;
  return View ? <View {...props} /> : <p class="picture muted">Loading the viewer…</p>;
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

function Picture({ job, why }: { job: Job; why: string }) {
  const source = useArtifactUrl(pictureOf(job));
  return (
    <div class="picture">
      {source ? <img src={source} alt={`The surface of ${job.scan.name}`} /> : null}
      <p class="muted">{why || (source ? "" : "There is no surface to show.")}</p>
    </div>
  );
}
