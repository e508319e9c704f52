/**
 * The surface that a scan's points lie on, to measure distances to. The distance to the nearest
 * point alone would show how far apart the points are, not how far off the surface is.
 */
import { buildTree, type KdTree, Neighbors } from "./kdtree";

const NEIGHBORS = 12;
// Of each point's plane: center, unit normal, reach.
const STRIDE = 7;

export class ScanSurface {
  private readonly tree: KdTree;
  private readonly nearest: Neighbors;
  private readonly around: Neighbors;
  private readonly planes: Float32Array;

  /** Points (N, 3), which are reordered in place. */
  constructor(points: Float32Array) {
    this.tree = buildTree(points);
    this.nearest = new Neighbors(this.tree, 1);
    this.around = new Neighbors(this.tree, NEIGHBORS);
    this.planes = new Float32Array((points.length / 3) * STRIDE).fill(Number.NaN);
  }

  /**
   * Distance from (x, y, z) to the plane through the points around the nearest one; beyond their
   * reach, as in a hole, the way along the plane counts too. Never more than to the nearest point.
   */
  distance(x: number, y: number, z: number): number {
    const { found, indices, squares } = this.nearest.search(x, y, z);
    if (found === 0) return Infinity;
    const toPoint = Math.sqrt(squares[0]!);
    const at = this.planeOf(indices[0]!);
    const { planes } = this;
    const [dx, dy, dz] = [x - planes[at]!, y - planes[at + 1]!, z - planes[at + 2]!];
    const off = dx * planes[at + 3]! + dy * planes[at + 4]! + dz * planes[at + 5]!;
    const along = Math.sqrt(Math.max(0, dx * dx + dy * dy + dz * dz - off * off));
    return Math.min(toPoint, Math.hypot(off, Math.max(0, along - planes[at + 6]!)));
  }

  /** Where the plane of a point begins in `planes`; fitted when it is first asked for. */
  private planeOf(index: number): number {
    const at = index * STRIDE;
    if (Number.isNaN(this.planes[at]!)) this.fit(index, at);
    return at;
  }

  private fit(index: number, at: number): void {
    const { points } = this.tree;
    const [x, y, z] = [points[3 * index]!, points[3 * index + 1]!, points[3 * index + 2]!];
    const { found, indices, squares } = this.around.search(x, y, z);
    const center = [0, 0, 0];
    for (let i = 0; i < found; i++) {
      for (let axis = 0; axis < 3; axis++) center[axis]! += points[3 * indices[i]! + axis]! / found;
    }
    const [xx, xy, xz, yy, yz, zz] = this.covariance(center);
    const normal = leastDirection(xx, xy, xz, yy, yz, zz);
    const flat = normal.some((share) => share !== 0);
    // Without a plane of its own a point stands for itself.
    const plane = flat ? [...center, ...normal, Math.sqrt(squares[found - 1]!)] : [x, y, z, 0, 0, 0, 0];
    this.planes.set(plane, at);
  }

  private covariance(center: readonly number[]): [number, number, number, number, number, number] {
    const sums: [number, number, number, number, number, number] = [0, 0, 0, 0, 0, 0];
    const { found, indices } = this.around;
    for (let i = 0; i < found; i++) {
      const from = 3 * indices[i]!;
      const dx = this.tree.points[from]! - center[0]!;
      const dy = this.tree.points[from + 1]! - center[1]!;
      const dz = this.tree.points[from + 2]! - center[2]!;
      sums[0] += dx * dx;
      sums[1] += dx * dy;
      sums[2] += dx * dz;
      sums[3] += dy * dy;
      sums[4] += dy * dz;
      sums[5] += dz * dz;
    }
    return sums;
  }
}

/**
 * Unit eigenvector of the smallest eigenvalue of a symmetric matrix, or zeros where it has none of
 * its own (a line, a single point). Eigenvalues by Smith, Communications of the ACM 4 (1961).
 */
export function leastDirection(
  xx: number, xy: number, xz: number, yy: number, yz: number, zz: number,
): [number, number, number] {
  const mean = (xx + yy + zz) / 3;
  const [a, b, c] = [xx - mean, yy - mean, zz - mean];
  const spread = Math.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6);
  if (!(spread > 0)) return [0, 0, 0];
  const determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz);
  const angle = Math.acos(Math.min(1, Math.max(-1, determinant / (2 * spread ** 3)))) / 3;
  const least = mean + 2 * spread * Math.cos(angle + (2 * Math.PI) / 3);
  const rows = [
    [xx - least, xy, xz],
    [xy, yy - least, yz],
    [xz, yz, zz - least],
  ] as const;
  const crosses = [cross(rows[0], rows[1]), cross(rows[0], rows[2]), cross(rows[1], rows[2])];
  const lengths = crosses.map((one) => Math.hypot(...one));
  const longest = Math.max(...lengths);
  // Rounding alone makes 1e-8 of a line.
  if (!(longest > 1e-6 * spread * spread)) return [0, 0, 0];
  const [x, y, z] = crosses[lengths.indexOf(longest)]!;
  return [x / longest, y / longest, z / longest];
}

type Three = readonly [number, number, number];

function cross([ax, ay, az]: Three, [bx, by, bz]: Three): Three {
  return [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
}
