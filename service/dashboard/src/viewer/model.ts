/** What a job has to show: its best mesh so far and its scan, loaded as they appear. */
import { batch, computed, signal } from "@preact/signals";
import { artifactTrouble, call, Refused } from "../api/http";
import { type Artifact, isActive, type Job } from "../api/types";
import { whenOnline } from "../state/connection";
import { DistanceMeter } from "./distances";
import { type Geometry, pointsSoFar, readGlb, triangleCount } from "./glb";
import { type Summary, summarize } from "./statistics";

export interface Measured {
  values: Float32Array;
  summary: Summary;
}

/** Told of a file of which so many bytes have come. */
type OnPart = (file: ArrayBuffer, loaded: number) => void;

const FIRST_PART_BYTES = 1_000_000;

export class Model {
  readonly mesh = signal<Geometry | null>(null);
  /** Grows while it is loaded. */
  readonly scan = signal<Geometry | null>(null);
  readonly scanIsWhole = signal(false);
  /** Name of the artifact that is shown as the mesh. */
  readonly shown = signal("");
  /** Share of the file that is loading, or null. */
  readonly loading = signal<number | null>(null);
  readonly trouble = signal("");
  readonly error = signal<Measured | null>(null);
  readonly measuring = signal(false);
  readonly triangles = computed(() => (this.mesh.value ? triangleCount(this.mesh.value) : 0));
  readonly upAxis = computed(() => (this.mesh.value ?? this.scan.value)?.upAxis ?? "z");
  private readonly stopper = new AbortController();
  private meter: DistanceMeter | null = null;
  private meshSum = "";
  private scanSum = "";
  private busy: Promise<void> = Promise.resolve();

  /** Take what the job has by now; what is newer replaces what is shown. */
  follow(job: Job): void {
    this.busy = this.busy.then(() => this.load(job)).catch(() => undefined);
  }

  /** Compute the distances to the scan, if both are there and it was not done. */
  async measure(): Promise<void> {
    const mesh = this.mesh.peek();
    if (!mesh || !this.scanIsWhole.peek() || this.error.peek() || this.measuring.peek()) return;
    const measured = await this.measured(mesh);
    if (mesh === this.mesh.peek()) this.error.value = measured;
    else await this.measure();
  }

  dispose(): void {
    this.stopper.abort();
    this.meter?.close();
  }

  /** The mesh first: the scan is seen alone only until there is one. */
  private async load(job: Job): Promise<void> {
    await this.loadMesh(job);
    const scan = job.artifacts.find((one) => one.name === "scan.glb");
    if (!scan || scan.sha256 === this.scanSum) return;
    this.scanSum = scan.sha256;
    const whole = await this.fetch(scan, (file, loaded) => {
      this.scan.value = pointsSoFar(file, loaded) ?? this.scan.peek();
    });
    if (!whole) return;
    batch(() => {
      this.scan.value = whole;
      this.scanIsWhole.value = true;
    });
  }

  private async loadMesh(job: Job): Promise<void> {
    for (const artifact of meshesToShow(job, this.mesh.peek() !== null)) {
      if (artifact.sha256 === this.meshSum || this.stopper.signal.aborted) continue;
      const geometry = await this.fetch(artifact);
      if (!geometry) continue;
      this.meshSum = artifact.sha256;
      // Distances that are on show stay there until those of the new mesh can take their place.
      const error = this.error.peek() ? await this.measured(geometry) : null;
      batch(() => {
        this.error.value = error;
        this.mesh.value = geometry;
        this.shown.value = artifact.name;
        this.trouble.value = "";
      });
    }
  }

  private async measured(mesh: Geometry): Promise<Measured> {
    const scan = this.scan.peek()!;
    this.measuring.value = true;
    this.meter ??= new DistanceMeter(scan, scan.offset);
    const values = await this.meter.measure(mesh);
    this.measuring.value = false;
    return { values, summary: summarize(values) };
  }

  private async fetch(artifact: Artifact, onPart?: OnPart): Promise<Geometry | null> {
    for (;;) {
      try {
        this.loading.value = 0;
        return readGlb(await this.download(artifact, onPart));
      } catch (error) {
        if (this.stopper.signal.aborted) throw error;
        if (error instanceof Refused || !isNetworkTrouble(error)) {
          this.trouble.value = artifactTrouble(error);
          return null;
        }
        await whenOnline(500, this.stopper.signal);
      } finally {
        this.loading.value = null;
      }
    }
  }

  private async download(artifact: Artifact, onPart?: OnPart): Promise<ArrayBuffer> {
    const answer = await call(artifact.url, { signal: this.stopper.signal });
    const whole = new Uint8Array(artifact.size);
    const reader = answer.body!.getReader();
    let at = 0;
    let nextPart = FIRST_PART_BYTES;
    for (;;) {
      const { done, value } = await reader.read();
      if (done) break;
      if (at + value.length > whole.length) throw new Error("The file changed while it was loaded.");
      whole.set(value, at);
      at += value.length;
      this.loading.value = at / artifact.size;
      if (at < nextPart || at === whole.length) continue;
      nextPart = 2 * at;
      onPart?.(whole.buffer, at);
    }
    if (at < whole.length) throw new TypeError("The connection was cut.");
    return whole.buffer;
  }
}

function isNetworkTrouble(error: unknown): boolean {
  return error instanceof TypeError || (error as Error).message.includes("cannot be reached");
}

/**
 * The meshes worth loading, coarse to fine: something to see soon, then the best there is. An
 * unfinished job has its levels only.
 */
export function meshesToShow(job: Job, hasMesh: boolean): Artifact[] {
  const levels = job.artifacts
    .filter((one) => /^level-\d+\.glb$/.test(one.name))
    .sort((a, b) => levelOf(a) - levelOf(b));
  const final = job.artifacts.find((one) => one.name === "mesh.glb");
  if (isActive(job) || !final) return levels.slice(-1);
  const first = levels[0];
  const helps = first && !hasMesh && first.size * 4 < final.size;
  return helps ? [first, final] : [final];
}

function levelOf({ name }: Artifact): number {
  return Number(name.replace(/\D/g, ""));
}
