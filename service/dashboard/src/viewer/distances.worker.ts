/** Distances from a mesh's vertices to its scan, beside the page that stays smooth. */
import { ScanSurface } from "./scansurface";

export type DistanceRequest =
  | { kind: "scan"; points: Float32Array }
  | { kind: "mesh"; id: number; vertices: Float32Array };
export interface DistanceReply {
  id: number;
  distances: Float32Array;
}

let scan: ScanSurface | null = null;

self.onmessage = ({ data }: MessageEvent<DistanceRequest>) => {
  if (data.kind === "scan") {
    scan = new ScanSurface(data.points);
    return;
  }
  const { id, vertices } = data;
  const distances = new Float32Array(vertices.length / 3);
  for (let i = 0; scan && i < distances.length; i++) {
    distances[i] = scan.distance(vertices[3 * i]!, vertices[3 * i + 1]!, vertices[3 * i + 2]!);
  }
  postMessage({ id, distances } satisfies DistanceReply, { transfer: [distances.buffer] });
};
