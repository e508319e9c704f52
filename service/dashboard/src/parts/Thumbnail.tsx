/** A job's picture. With an API key it cannot be a plain image address, so it is fetched. */
import { useEffect, useState } from "preact/hooks";
import { call } from "../api/http";
import type { Job } from "../api/types";
import { apiKey } from "../state/session";
import { Icon } from "./Icon";

export function useArtifactUrl(url: string | undefined): string | undefined {
  const key = apiKey.value;
  const [fetched, setFetched] = useState<string>();
  useEffect(() => {
    if (!url || !key) return;
    let address = "";
    const stopper = new AbortController();
    call(url, { signal: stopper.signal })
      .then((answer) => answer.blob())
      .then((blob) => setFetched((address = URL.createObjectURL(blob))))
      .catch(() => undefined);
    return () => {
      stopper.abort();
      URL.revokeObjectURL(address);
      setFetched(undefined);
    };
  }, [url, key]);
  return key ? fetched : url;
}

export function pictureOf(job: Job): string | undefined {
  return job.artifacts.find((artifact) => artifact.name === "preview.png")?.url;
}

export function Thumbnail({ job }: { job: Job }) {
  const source = useArtifactUrl(pictureOf(job));
  const [broken, setBroken] = useState(false);
  useEffect(() => setBroken(false), [source]);
  return (
    <span class="thumbnail">
      {source && !broken ? (
        <img src={source} alt="" loading="lazy" decoding="async" onError={() => setBroken(true)} />
      ) : (
        <Icon name="cube" />
      )}
    </span>
  );
}
