/**
 * A k-d tree over points, for distances from a mesh to its scan. Unlike a grid it does not mind
 * far outliers or a density that varies. Median layout: the middle of each range splits it.
 */
export interface KdTree {
  /** (N, 3), in the order of the tree. */
  points: Float32Array;
  /** The axis that splits at each middle. */
  axes: Uint8Array;
}

const LEAF = 12;

/** Points (N, 3), which are reordered in place. */
export function buildTree(points: Float32Array): KdTree {
  const count = points.length / 3;
  const axes = new Uint8Array(count);
  const ranges: Array<[number, number]> = [[0, count]];
  for (let range = ranges.pop(); range; range = ranges.pop()) {
    const [low, high] = range;
    if (high - low <= LEAF) continue;
    const middle = (low + high) >> 1;
    const axis = widestAxis(points, low, high);
    select(points, axis, low, high - 1, middle);
    axes[middle] = axis;
    ranges.push([low, middle], [middle + 1, high]);
  }
  return { points, axes };
}

function widestAxis(points: Float32Array, low: number, high: number): number {
  let widest = 0;
  let most = -1;
  for (let axis = 0; axis < 3; axis++) {
    let least = Infinity;
    let greatest = -Infinity;
    for (let i = low; i < high; i++) {
      const value = points[3 * i + axis]!;
      if (value < least) least = value;
      if (value > greatest) greatest = value;
    }
    if (greatest - least > most) [widest, most] = [axis, greatest - least];
  }
  return widest;
}

/** Hoare's quickselect: what belongs at `target` comes there, less before it and more after. */
function select(points: Float32Array, axis: number, first: number, last: number, target: number) {
  let low = first;
  let high = last;
  while (low < high) {
    const pivot = points[3 * ((low + high) >> 1) + axis]!;
    let i = low;
    let j = high;
    while (i <= j) {
      while (points[3 * i + axis]! < pivot) i++;
      while (points[3 * j + axis]! > pivot) j--;
      if (i <= j) swap(points, i++, j--);
    }
    if (target <= j) high = j;
    else if (target >= i) low = i;
    else return;
  }
}

function swap(points: Float32Array, a: number, b: number): void {
  for (let axis = 0; axis < 3; axis++) {
    const kept = points[3 * a + axis]!;
    points[3 * a + axis] = points[3 * b + axis]!;
    points[3 * b + axis] = kept;
  }
}

/** Finds the nearest few points; made once and asked often, so that a search allocates nothing. */
export class Neighbors {
  /** Places in `tree.points`, and squared distances, nearest first; valid up to `found`. */
  readonly indices: Int32Array;
  readonly squares: Float64Array;
  found = 0;
  private readonly at = new Float64Array(3);
  private limit = Infinity;

  constructor(
    private readonly tree: KdTree,
    private readonly most: number,
  ) {
    this.indices = new Int32Array(most);
    this.squares = new Float64Array(most);
  }

  /** `within` is any upper bound of the distances that matter, to search less. */
  search(x: number, y: number, z: number, within = Infinity): this {
    this.at[0] = x;
    this.at[1] = y;
    this.at[2] = z;
    this.found = 0;
    this.limit = within * within;
    this.visit(0, this.tree.axes.length);
    return this;
  }

  private visit(low: number, high: number): void {
    if (high - low <= LEAF) {
      for (let i = low; i < high; i++) this.consider(i);
      return;
    }
    const middle = (low + high) >> 1;
    const axis = this.tree.axes[middle]!;
    const beyond = this.at[axis]! - this.tree.points[3 * middle + axis]!;
    this.consider(middle);
    if (beyond < 0) this.visit(low, middle);
    else this.visit(middle + 1, high);
    if (beyond * beyond >= this.limit) return;
    if (beyond < 0) this.visit(middle + 1, high);
    else this.visit(low, middle);
  }

  private consider(index: number): void {
    const { points } = this.tree;
    const dx = points[3 * index]! - this.at[0]!;
    const dy = points[3 * index + 1]! - this.at[1]!;
    const dz = points[3 * index + 2]! - this.at[2]!;
    const square = dx * dx + dy * dy + dz * dz;
    if (square >= this.limit) return;
    let place = Math.min(this.found, this.most - 1);
    for (; place > 0 && this.squares[place - 1]! > square; place--) {
      this.squares[place] = this.squares[place - 1]!;
      this.indices[place] = this.indices[place - 1]!;
    }
    this.squares[place] = square;
    this.indices[place] = index;
    if (this.found < this.most) this.found += 1;
    if (this.found === this.most) this.limit = this.squares[this.most - 1]!;
  }
}
