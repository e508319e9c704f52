/**
 * The viewer's own coordinates: y up, about one unit large, centred on the first thing shown. Scans
 * in micrometers and in map coordinates look alike there and lose nothing to float32.
 */
import { Matrix4, Quaternion, Vector3 } from "three";
import { type Geometry, sizeOf, type UpAxis, type Vector } from "./glb";

const HALF = Math.SQRT1_2;
const TO_Y_UP: Record<UpAxis, Quaternion> = {
  x: new Quaternion(0, 0, HALF, HALF),
  y: new Quaternion(),
  z: new Quaternion(-HALF, 0, 0, HALF),
};

export class Frame {
  readonly origin: Vector;
  readonly size: number;
  readonly up: Quaternion;

  constructor(first: Geometry) {
    const middle = (axis: 0 | 1 | 2) =>
      first.offset[axis] + (first.scale * (first.low[axis] + first.high[axis])) / 2;
    this.origin = [middle(0), middle(1), middle(2)];
    this.size = sizeOf(first);
    this.up = TO_Y_UP[first.upAxis];
  }

  /** From a geometry's positions to the viewer's coordinates. */
  placement({ offset, scale }: Geometry): Matrix4 {
    const shift = offset.map((value, axis) => (value - this.origin[axis]!) / this.size);
    const place = new Matrix4().makeTranslation(shift[0]!, shift[1]!, shift[2]!);
    place.scale(new Vector3().setScalar(scale / this.size));
    return new Matrix4().makeRotationFromQuaternion(this.up).multiply(place);
  }

  /** Upright scan coordinates, which another viewer of the same scan understands. */
  toScan(point: Vector3): Vector {
    const center = this.uprightOrigin();
    return [0, 1, 2].map((axis) => point.getComponent(axis) * this.size + center[axis]!) as unknown as Vector;
  }

  fromScan(place: Vector): Vector3 {
    const center = this.uprightOrigin();
    return new Vector3(...(place.map((value, axis) => (value - center[axis]!) / this.size) as [number, number, number]));
  }

  private uprightOrigin(): number[] {
    const [x, y, z] = this.origin;
    if (this.up === TO_Y_UP.x) return [-y, x, z];
    return this.up === TO_Y_UP.z ? [x, z, -y] : [x, y, z];
  }
}
