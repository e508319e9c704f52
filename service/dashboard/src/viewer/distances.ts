/** Asks the distance worker; positions are in a common frame, so that both float32 sets agree. */
import type { DistanceReply, DistanceRequest } from "./distances.worker";
import type { Geometry, Vector } from "./glb";

export class DistanceMeter {
  private readonly worker = new Worker(new URL("./distances.worker.ts", import.meta.url), {
    type: "module",
  });
  private readonly waiting = new Map<number, (distances: Float32Array) => void>();
  private last = 0;

  constructor(
    scan: Geometry,
    private readonly origin: Vector,
  ) {
    this.worker.onmessage = ({ data }: MessageEvent<DistanceReply>) => {
      this.waiting.get(data.id)?.(data.distances);
      this.waiting.delete(data.id);
    };
    const points = inFrame(scan, origin);
    this.send({ kind: "scan", points }, points);
  }

  /** For each vertex the distance to the scan's surface, in scan units. */
  measure(mesh: Geometry): Promise<Float32Array> {
    const id = ++this.last;
    const vertices = inFrame(mesh, this.origin);
    return new Promise((resolve) => {
      this.waiting.set(id, resolve);
      this.send({ kind: "mesh", id, vertices }, vertices);
    });
  }

  close(): void {
    this.worker.terminate();
  }

  private send(request: DistanceRequest, moved: Float32Array): void {
    this.worker.postMessage(request, [moved.buffer]);
  }
}

/** Positions relative to `origin`, in scan units. */
export function inFrame({ positions, offset, scale }: Geometry, origin: Vector): Float32Array {
  const moved = new Float32Array(positions.length);
  for (let axis = 0; axis < 3; axis++) {
    const shift = offset[axis]! - origin[axis]!;
    for (let i = axis; i < positions.length; i += 3) moved[i] = positions[i]! * scale + shift;
  }
  return moved;
}
