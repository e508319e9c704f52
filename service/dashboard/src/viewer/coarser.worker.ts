/** Makes coarser meshes beside the page, which stays smooth. */
import { coarserIndices } from "./coarser";

export interface CoarserRequest {
  positions: Float32Array;
  indices: Uint32Array;
}

self.onmessage = ({ data }: MessageEvent<CoarserRequest>) => {
  const found = coarserIndices(data.positions, data.indices);
  postMessage(found, { transfer: found.map((one) => one.buffer) });
};
