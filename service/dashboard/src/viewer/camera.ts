/** Where the eye is: fitting, turning, moving and coming closer. */
import { type PerspectiveCamera, Vector3 } from "three";
import type { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

/** From the middle to the eye, for the first look. */
export const OBLIQUE = new Vector3(0.62, 0.42, 1).normalize();
const MARGIN = 1.06;
const DISTANCE_OF_NOTHING = 2;
// Share of a turn's speed that is lost in a sixtieth of a second.
const DAMPING = 0.12;
const STEP_MILLISECONDS = 1000 / 60;
const MOST_STEPS = 30;

export class Eye {
  constructor(
    readonly camera: PerspectiveCamera,
    readonly controls: OrbitControls,
  ) {}

  /** Look along `direction` (from the middle to the eye) so that all of `places` is seen. */
  fit(places: readonly Vector3[], direction: Vector3): void {
    const { camera, controls } = this;
    this.stop();
    camera.position.copy(direction);
    camera.lookAt(0, 0, 0);
    const [right, up, back] = [new Vector3(), new Vector3(), new Vector3()];
    camera.matrixWorld.makeRotationFromQuaternion(camera.quaternion).extractBasis(right, up, back);
    const middle = new Vector3();
    for (const axis of [right, up, back]) {
      const [low, high] = extent(places, axis);
      middle.addScaledVector(axis, (low + high) / 2);
    }
    const vertical = Math.tan((camera.fov * Math.PI) / 360);
    const horizontal = vertical * camera.aspect;
    let distance = places.length > 0 ? 0 : DISTANCE_OF_NOTHING;
    const arm = new Vector3();
    for (const place of places) {
      arm.subVectors(place, middle);
      const side = Math.max(Math.abs(arm.dot(right)) / horizontal, Math.abs(arm.dot(up)) / vertical);
      distance = Math.max(distance, arm.dot(back) + side * MARGIN);
    }
    controls.target.copy(middle);
    camera.position.copy(middle).addScaledVector(back, distance);
    controls.update();
  }

  /** Turn by angles in radians, or come closer by a factor. */
  turn(around: number, up: number, closer = 1): void {
    const { camera, controls } = this;
    const arm = camera.position.clone().sub(controls.target);
    const polar = Math.min(3.1, Math.max(0.04, Math.acos(arm.y / arm.length()) - up));
    const azimuth = Math.atan2(arm.x, arm.z) + around;
    camera.position.setFromSphericalCoords(arm.length() / closer, polar, azimuth);
    camera.position.add(controls.target);
    controls.update();
  }

  /** Move sideways by shares of the distance to what is looked at. */
  shift(right: number, up: number): void {
    const { camera, controls } = this;
    const distance = camera.position.distanceTo(controls.target);
    const [x, y] = [new Vector3(), new Vector3()];
    camera.matrixWorld.extractBasis(x, y, new Vector3());
    const way = x.multiplyScalar(right * distance).addScaledVector(y, up * distance);
    this.lookAt(controls.target.clone().add(way));
  }

  /** Turn around this place from now on; the direction of the view stays. */
  lookAt(place: Vector3): void {
    this.stop();
    this.camera.position.add(place).sub(this.controls.target);
    this.controls.target.copy(place);
    this.controls.update();
  }

  /** Let a turn fade out: as fast in few frames a second as in many. */
  settle(milliseconds: number): void {
    const steps = Math.min(MOST_STEPS, Math.max(1, milliseconds / STEP_MILLISECONDS));
    this.controls.dampingFactor = 1 - (1 - DAMPING) ** steps;
    this.controls.update();
  }

  /** End a turn that still fades out. */
  private stop(): void {
    const { controls } = this;
    const damped = controls.enableDamping;
    controls.enableDamping = false;
    controls.update();
    controls.enableDamping = damped;
  }

  /** Depth is resolved best when its range follows the distance. */
  adaptDepth(): void {
    const distance = this.camera.position.distanceTo(this.controls.target);
    this.camera.near = Math.max(1e-5, distance / 100);
    this.camera.far = distance + 20;
    this.camera.updateProjectionMatrix();
  }
}

function extent(places: readonly Vector3[], axis: Vector3): [number, number] {
  let [low, high] = places.length > 0 ? [Infinity, -Infinity] : [0, 0];
  for (const place of places) {
    const along = place.dot(axis);
    low = Math.min(low, along);
    high = Math.max(high, along);
  }
  return [low, high];
}
