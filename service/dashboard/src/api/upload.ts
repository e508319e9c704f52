/**
 * Resumable uploads by tus 1.0: pieces with a checksum, taken up again where the server stopped,
 * also after the page was closed.
 */
import { whenOnline } from "../state/connection";
import { call, json, Refused, Unreachable } from "./http";
import type { Upload } from "./types";

const TUS = { "Tus-Resumable": "1.0.0" };
const SMALLEST_PIECE = 1 << 18;
const LARGEST_PIECE = 1 << 24;
// A piece should take about this long, so that progress moves and a cut costs little.
const PIECE_MILLISECONDS = 400;

export interface UploadHooks {
  onProgress(sent: number): void;
  signal: AbortSignal;
}

/** The complete upload of the file. Throws Refused (also for what is no scan) or AbortError. */
export async function uploadFile(file: File, hooks: UploadHooks): Promise<Upload> {
  let id: string | null = null;
  for (;;) {
    try {
      id ??= await beginOrResume(file);
      await sendPieces(id, file, hooks);
      const upload = await json<Upload>(`/v1/uploads/${id}`, { signal: hooks.signal });
      forget(file);
      if (upload.error) throw new Refused(415, upload.error.code, upload.error.detail);
      return upload;
    } catch (error) {
      if (hooks.signal.aborted || !mayPass(error)) throw error;
      const seconds = error instanceof Refused ? error.retryAfterSeconds : 0;
      await whenOnline(Math.max(500, seconds * 1000), hooks.signal);
    }
  }
}

/** A lost connection, an offset that is behind, a rate limit: asking again helps. */
function mayPass(error: unknown): boolean {
  if (error instanceof Unreachable) return true;
  return (
    error instanceof Refused && ["offset_mismatch", "checksum_mismatch", "rate_limited"].includes(error.code)
  );
}

async function beginOrResume(file: File): Promise<string> {
  const earlier = localStorage.getItem(memoryOf(file));
  if (earlier) {
    try {
      const upload = await json<Upload>(`/v1/uploads/${earlier}`);
      if (upload.size === file.size && !upload.error) return upload.id;
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
    }
  }
  const name = btoa(String.fromCharCode(...new TextEncoder().encode(file.name)));
  const upload = await json<Upload>("/v1/uploads", {
    method: "POST",
    headers: { ...TUS, "Upload-Length": String(file.size), "Upload-Metadata": `filename ${name}` },
  });
  localStorage.setItem(memoryOf(file), upload.id);
  return upload.id;
}

async function sendPieces(id: string, file: File, { onProgress, signal }: UploadHooks) {
  const head = await call(`/v1/uploads/${id}`, { method: "HEAD", headers: TUS, signal });
  let offset = Number(head.headers.get("Upload-Offset"));
  let size = SMALLEST_PIECE;
  onProgress(offset);
  while (offset < file.size) {
    const begun = performance.now();
    const piece = await file.slice(offset, offset + size).arrayBuffer();
    const answer = await call(`/v1/uploads/${id}`, {
      method: "PATCH",
      headers: { ...TUS, ...(await pieceHeaders(offset, piece)) },
      body: piece,
      signal,
    });
    offset = Number(answer.headers.get("Upload-Offset"));
    onProgress(offset);
    const factor = PIECE_MILLISECONDS / Math.max(1, performance.now() - begun);
    size = Math.round(Math.min(LARGEST_PIECE, Math.max(SMALLEST_PIECE, size * Math.min(4, factor))));
  }
}

async function pieceHeaders(offset: number, piece: ArrayBuffer): Promise<Record<string, string>> {
  const headers = {
    "Upload-Offset": String(offset),
    "Content-Type": "application/offset+octet-stream",
  };
  // Browsers offer digests on https and on loopback only.
  if (!globalThis.crypto?.subtle) return headers;
  const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", piece));
  return { ...headers, "Upload-Checksum": `sha256 ${btoa(String.fromCharCode(...digest))}` };
}

function memoryOf(file: File): string {
  return `visco.upload:${file.size}:${file.lastModified}:${file.name}`;
}

function forget(file: File): void {
  localStorage.removeItem(memoryOf(file));
}

