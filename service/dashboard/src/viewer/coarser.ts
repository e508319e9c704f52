/**
 * Fewer triangles over the same vertices, to draw while the view moves: vertices of a cell become
 * one of them (Rossignac and Borrel, Multi-resolution 3D approximations, 1993). Colors, distances
 * and sections need no thought, because the vertices stay what they are.
 */
const FEWEST = 15_000;
const EDGES_LOOKED_AT = 2000;
const EMPTY = -1;

/** Index lists of a mesh, each with about a quarter of the triangles of the one before. */
export function coarserIndices(positions: Float32Array, indices: Uint32Array): Uint32Array[] {
  const found: Uint32Array[] = [];
  let now = indices;
  let cell = 2 * meanEdge(positions, indices);
  while (now.length / 3 > FEWEST && cell > 0) {
    const next = clustered(positions, now, cell);
    if (next.length < now.length / 2) found.push(next);
    now = next;
    cell *= 2;
  }
  return found;
}

/** The triangles that remain when all vertices of a cubic cell become one of them. */
export function clustered(positions: Float32Array, indices: Uint32Array, cell: number): Uint32Array {
  const leader = leaders(positions, cell);
  const kept = new Uint32Array(indices.length);
  let count = 0;
  for (let i = 0; i < indices.length; i += 3) {
    const [a, b, c] = [leader[indices[i]!]!, leader[indices[i + 1]!]!, leader[indices[i + 2]!]!];
    if (a === b || b === c || c === a) continue;
    kept[count] = a;
    kept[count + 1] = b;
    kept[count + 2] = c;
    count += 3;
  }
  return kept.slice(0, count);
}

/** For each vertex the one that stands for its cell: the one nearest to the cell's middle. */
function leaders(positions: Float32Array, cell: number): Int32Array {
  const count = positions.length / 3;
  const cells = new Int32Array(positions.length);
  for (let i = 0; i < cells.length; i++) cells[i] = Math.floor(positions[i]! / cell);
  const mask = 2 ** Math.ceil(Math.log2(2 * count + 1)) - 1;
  const table = new Int32Array(mask + 1).fill(EMPTY);
  const slots = new Int32Array(count);
  for (let vertex = 0; vertex < count; vertex++) {
    const at = 3 * vertex;
    let slot = hash(cells[at]!, cells[at + 1]!, cells[at + 2]!) & mask;
    while (table[slot] !== EMPTY && !sameCell(cells, 3 * table[slot]!, at)) slot = (slot + 1) & mask;
    const held = table[slot]!;
    const nearer = held === EMPTY || offCentre(positions, at, cell) < offCentre(positions, 3 * held, cell);
    if (nearer) table[slot] = vertex;
    slots[vertex] = slot;
  }
  return slots.map((slot) => table[slot]!);
}

function sameCell(cells: Int32Array, a: number, b: number): boolean {
  return cells[a] === cells[b] && cells[a + 1] === cells[b + 1] && cells[a + 2] === cells[b + 2];
}

function offCentre(positions: Float32Array, at: number, cell: number): number {
  let sum = 0;
  for (let axis = 0; axis < 3; axis++) {
    const share = positions[at + axis]! / cell;
    sum += (share - Math.floor(share) - 0.5) ** 2;
  }
  return sum;
}

function hash(x: number, y: number, z: number): number {
  return Math.imul(x, 73856093) ^ Math.imul(y, 19349663) ^ Math.imul(z, 83492791);
}

function meanEdge(positions: Float32Array, indices: Uint32Array): number {
  const stride = 3 * Math.max(1, Math.floor(indices.length / 3 / EDGES_LOOKED_AT));
  let [sum, count] = [0, 0];
  for (let i = 0; i + 2 < indices.length; i += stride) {
    const [a, b] = [3 * indices[i]!, 3 * indices[i + 1]!];
    sum += Math.hypot(
      positions[a]! - positions[b]!,
      positions[a + 1]! - positions[b + 1]!,
      positions[a + 2]! - positions[b + 2]!,
    );
    count += 1;
  }
  return count > 0 ? sum / count : 0;
}
