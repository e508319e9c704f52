/** Which of the dropped files are scans. */
export const SCAN_ENDINGS = [
  "ply", "xyz", "pts", "txt", "csv", "asc", "obj", "stl", "pcd", "las", "laz", "e57", "npz", "npy",
] as const;

const ENDINGS = new Set<string>(SCAN_ENDINGS);

export function isScanName(name: string): boolean {
  const dot = name.lastIndexOf(".");
  return dot > 0 && ENDINGS.has(name.slice(dot + 1).toLowerCase());
}

export interface Sorted {
  scans: File[];
  others: number;
}

export function sortFiles(files: Iterable<File>): Sorted {
  const scans: File[] = [];
  let others = 0;
  for (const file of files) {
    if (isScanName(file.name)) scans.push(file);
    else if (!file.name.startsWith(".")) others += 1;
  }
  return { scans, others };
}

/** Everything dropped, folders opened. Must be called before the drop event's handler returns. */
export async function droppedFiles(transfer: DataTransfer): Promise<File[]> {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry());
  const plain = [...transfer.files];
  if (entries.every((entry) => entry === null)) return plain;
  const found = await Promise.all(entries.map((entry) => (entry ? filesUnder(entry) : [])));
  return found.flat().sort((a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }));
}

async function filesUnder(entry: FileSystemEntry): Promise<File[]> {
  if (entry.isFile) {
    const file = entry as FileSystemFileEntry;
    return [await new Promise<File>((resolve, reject) => file.file(resolve, reject))];
  }
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  const found: File[] = [];
  for (;;) {
    // A reader gives at most a hundred entries at a time.
    const batch = await new Promise<FileSystemEntry[]>((resolve, reject) =>
      reader.readEntries(resolve, reject),
    );
    if (batch.length === 0) return found;
    for (const inner of batch) found.push(...(await filesUnder(inner)));
  }
}
