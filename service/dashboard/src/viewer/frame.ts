/**
 * The viewer's own coordinates: y up, about one unit large, centred on the first thing shown. Scans
 * in micrometers and in map coordinates look alike there and lose nothing to float32.
 */
import { Matrix4, Vector3 } from "three";
import { type Geometry, sizeOf, type Vector } from "./glb";
import type { Up } from "./up";

// Rows of the rotation that turns the way up to +y; the glTF files have the first three.
const TO_Y_UP: Record<Up, readonly [Vector, Vector, Vector]> = {
  x: [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
  y: [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
  z: [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
  "-x": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
  "-y": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
  "-z": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
};

export class Frame {
  readonly origin: Vector;
  readonly size: number;

  constructor(
    first: Geometry,
    readonly up: Up = first.upAxis,
  ) {
    const middle = (axis: 0 | 1 | 2) =>
      first.offset[axis] + (first.scale * (first.low[axis] + first.high[axis])) / 2;
    this.origin = [middle(0), middle(1), middle(2)];
    this.size = sizeOf(first);
  }

  /** From a geometry's positions to the viewer's coordinates. */
  placement({ offset, scale }: Geometry): Matrix4 {
    const shift = offset.map((value, axis) => (value - this.origin[axis]!) / this.size);
    const place = new Matrix4().makeTranslation(shift[0]!, shift[1]!, shift[2]!);
    place.scale(new Vector3().setScalar(scale / this.size));
    return this.rotation().multiply(place);
  }

  /** Scan coordinates, which another viewer of the same scan understands. */
  toScan(point: Vector3): Vector {
    const rows = TO_Y_UP[this.up];
    const along = (axis: 0 | 1 | 2) =>
      rows[0][axis] * point.x + rows[1][axis] * point.y + rows[2][axis] * point.z;
    const at = (axis: 0 | 1 | 2) => this.origin[axis] + this.size * along(axis);
    return [at(0), at(1), at(2)];
  }

  fromScan(place: Vector): Vector3 {
    const away = place.map((value, axis) => (value - this.origin[axis]!) / this.size);
    return new Vector3(away[0], away[1], away[2]).applyMatrix4(this.rotation());
  }

  /** Where one of the scan's directions points in the viewer. */
  direction(axis: Up): Vector3 {
    const sign = axis.startsWith("-") ? -1 : 1;
    return new Vector3().setComponent("xyz".indexOf(axis.at(-1)!), sign).applyMatrix4(this.rotation());
  }

  private rotation(): Matrix4 {
    const [x, y, z] = TO_Y_UP[this.up];
    return new Matrix4().set(...x, 0, ...y, 0, ...z, 0, 0, 0, 0, 1);
  }
}
