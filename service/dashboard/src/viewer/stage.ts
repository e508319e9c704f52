/** The scene behind one canvas. It draws when something has changed, and only then. */
import {
  AmbientLight,
  BufferAttribute,
  BufferGeometry,
  DirectionalLight,
  HemisphereLight,
  type Material,
  Mesh,
  PerspectiveCamera,
  Plane,
  Points,
  Scene,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { Frame } from "./frame";
import type { Geometry, Vector } from "./glb";
import { type Mode, pointMaterial, surfaceMaterial, wireMaterial } from "./materials";
import { pick } from "./picking";

export interface Section {
  axis: 0 | 1 | 2;
  /** Share of the extent, 0 to 1. */
  at: number;
  flipped: boolean;
}

export interface Pose {
  position: Vector;
  target: Vector;
}

const FRONT = new Vector3(0.62, 0.42, 1).normalize();
// Above this many points, moving draws a share of them; they come in random order.
const POINTS_WHILE_MOVING = 500_000;
const SLOW_FRAME_MILLISECONDS = 40;

export class Stage {
  readonly camera = new PerspectiveCamera(32, 1, 0.01, 100);
  readonly controls: OrbitControls;
  frame: Frame | null = null;
  onPose: (pose: Pose) => void = () => undefined;
  onDraw: () => void = () => undefined;
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly surface = new Mesh(new BufferGeometry());
  private readonly wires = new Mesh(new BufferGeometry());
  private readonly cloud = new Points(new BufferGeometry());
  private planes: Plane[] = [];
  private mode: Mode = "shaded";
  private requested = 0;
  private moving = false;
  private silent = false;
  private lastDraw = 0;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.localClippingEnabled = true;
    this.renderer.setClearColor(0, 0);
    this.scene.add(this.surface, this.wires, this.cloud, this.camera, ...lights(this.camera));
    for (const object of [this.surface, this.wires, this.cloud]) {
      object.matrixAutoUpdate = false;
      object.frustumCulled = false;
      object.visible = false;
    }
    this.wires.userData["helper"] = true;
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.controls.dampingFactor = 0.12;
    this.controls.addEventListener("change", () => this.moved());
    this.controls.addEventListener("start", () => (this.moving = true));
    this.controls.addEventListener("end", () => {
      this.moving = false;
      this.resize();
    });
    this.restyle();
    this.fit();
  }

  /** Shows another mesh; the camera stays unless this is the first thing to be seen. */
  setMesh(geometry: Geometry | null): void {
    replace(this.surface, geometry && bufferOf(geometry));
    this.wires.geometry = this.surface.geometry;
    this.place(geometry, this.surface, this.wires);
  }

  setScan(geometry: Geometry | null): void {
    replace(this.cloud, geometry && bufferOf(geometry));
    this.place(geometry, this.cloud);
    this.restyle();
  }

  /** Colors of the vertices, normalized; null takes the scan's own. */
  paint(colors: Uint16Array | null): void {
    const { attributes } = this.surface.geometry;
    const own = attributes["ownColor"];
    if (colors) this.surface.geometry.setAttribute("color", new BufferAttribute(colors, 3, true));
    else if (own) this.surface.geometry.setAttribute("color", own);
    else this.surface.geometry.deleteAttribute("color");
    this.draw();
  }

  show(what: { mesh: boolean; scan: boolean; wires: boolean; mode: Mode }): void {
    this.surface.visible = what.mesh && hasPoints(this.surface.geometry);
    this.wires.visible = this.surface.visible && what.wires;
    this.cloud.visible = what.scan && hasPoints(this.cloud.geometry);
    if (what.mode !== this.mode) {
      this.mode = what.mode;
      this.restyle();
    }
    this.draw();
  }

  cut(section: Section | null): void {
    const had = this.planes.length;
    this.planes = section ? [planeOf(section)] : [];
    if (had !== this.planes.length) this.restyle();
    else for (const one of this.materials()) one.clippingPlanes = this.planes;
    this.draw();
  }

  fit(): void {
    const aspect = this.camera.aspect;
    const distance = 1.75 / Math.min(1, aspect) / (2 * Math.tan((this.camera.fov * Math.PI) / 360));
    this.controls.target.set(0, 0, 0);
    this.camera.position.copy(FRONT).multiplyScalar(distance * 0.7);
    this.controls.update();
    this.moved();
  }

  /** Turn by angles in radians, or come closer by a factor; for the keyboard. */
  nudge(around: number, up: number, closer = 1): void {
    const arm = this.camera.position.clone().sub(this.controls.target);
    const polar = Math.min(3.1, Math.max(0.04, Math.acos(arm.y / arm.length()) - up));
    const azimuth = Math.atan2(arm.x, arm.z) + around;
    this.camera.position.setFromSphericalCoords(arm.length() / closer, polar, azimuth);
    this.camera.position.add(this.controls.target);
    this.controls.update();
    this.moved();
  }

  get pose(): Pose | null {
    if (!this.frame) return null;
    return {
      position: this.frame.toScan(this.camera.position),
      target: this.frame.toScan(this.controls.target),
    };
  }

  /** Look from where another viewer looks, without telling it back. */
  takePose(pose: Pose): void {
    if (!this.frame) return;
    this.silent = true;
    this.camera.position.copy(this.frame.fromScan(pose.position));
    this.controls.target.copy(this.frame.fromScan(pose.target));
    this.controls.update();
    this.silent = false;
    this.draw();
  }

  /** The place under a point of the canvas, in viewer coordinates. */
  pick(x: number, y: number): Vector3 | null {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return pick(this.renderer, this.scene, this.camera, this.planes, { x, y, width, height });
  }

  /** Where a place in viewer coordinates is on the canvas, in CSS pixels. */
  project(place: Vector3): { x: number; y: number } {
    const { x, y } = place.clone().project(this.camera);
    return { x: ((x + 1) / 2) * this.canvas.clientWidth, y: ((1 - y) / 2) * this.canvas.clientHeight };
  }

  resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.drawNow();
  }

  draw(): void {
    this.requested ||= requestAnimationFrame(() => this.drawNow());
  }

  /** A picture of what is seen, over the given background. */
  snapshot(background: string): Promise<Blob | null> {
    const copy = document.createElement("canvas");
    this.drawNow();
    copy.width = this.canvas.width;
    copy.height = this.canvas.height;
    const context = copy.getContext("2d")!;
    context.fillStyle = background;
    context.fillRect(0, 0, copy.width, copy.height);
    context.drawImage(this.canvas, 0, 0);
    return new Promise((resolve) => copy.toBlob(resolve, "image/png"));
  }

  dispose(): void {
    cancelAnimationFrame(this.requested);
    this.controls.dispose();
    this.surface.geometry.dispose();
    this.cloud.geometry.dispose();
    for (const material of this.materials()) material.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  private place(geometry: Geometry | null, ...objects: Array<Mesh | Points>): void {
    if (!geometry) return this.draw();
    const first = this.frame === null;
    this.frame ??= new Frame(geometry);
    const placement = this.frame.placement(geometry);
    for (const object of objects) {
      object.matrix.copy(placement);
      object.matrixWorldNeedsUpdate = true;
    }
    if (first) this.fit();
    this.draw();
  }

  private restyle(): void {
    for (const material of this.materials()) material.dispose();
    this.surface.material = surfaceMaterial(this.mode, this.planes);
    this.wires.material = wireMaterial(this.planes);
    this.cloud.material = pointMaterial("color" in this.cloud.geometry.attributes, this.planes);
    this.draw();
  }

  private materials(): Material[] {
    return [this.surface, this.wires, this.cloud].map((object) => object.material as Material);
  }

  private moved(): void {
    this.draw();
    if (!this.silent && this.pose) this.onPose(this.pose);
  }

  private drawNow(): void {
    cancelAnimationFrame(this.requested);
    this.requested = 0;
    this.adapt();
    this.controls.update();
    this.renderer.render(this.scene, this.camera);
    this.onDraw();
  }

  /** While the camera moves on a slow machine, draw fewer points and pixels. */
  private adapt(): void {
    const now = performance.now();
    const slow = now - this.lastDraw > SLOW_FRAME_MILLISECONDS && now - this.lastDraw < 1000;
    this.lastDraw = now;
    const count = this.moving && slow ? POINTS_WHILE_MOVING : Infinity;
    if (!this.moving || slow) this.cloud.geometry.setDrawRange(0, count);
    if (this.moving && slow && this.renderer.getPixelRatio() > 1) this.renderer.setPixelRatio(1);
  }
}

function lights(camera: PerspectiveCamera) {
  const key = new DirectionalLight("#fff8ef", 2.4);
  const fill = new DirectionalLight("#cfe0ee", 0.7);
  // They move with the eye, so that no side is ever dark.
  key.position.set(-0.6, 0.9, 1);
  fill.position.set(1.2, -0.2, 0.6);
  camera.add(key, key.target, fill, fill.target);
  key.target.position.set(0, 0, -1);
  fill.target.position.set(0, 0, -1);
  return [new HemisphereLight("#ffffff", "#8d8478", 0.7), new AmbientLight("#ffffff", 0.25)];
}

function bufferOf(geometry: Geometry): BufferGeometry {
  const buffer = new BufferGeometry();
  const whole = geometry.normals instanceof Int8Array;
  buffer.setAttribute("position", new BufferAttribute(geometry.positions, 3));
  if (geometry.normals && !whole) buffer.setAttribute("normal", new BufferAttribute(geometry.normals, 3));
  if (geometry.indices) buffer.setIndex(new BufferAttribute(geometry.indices, 1));
  if (geometry.colors) {
    const width = geometry.colors.length / (geometry.positions.length / 3);
    buffer.setAttribute("color", new BufferAttribute(geometry.colors, width, true));
    buffer.setAttribute("ownColor", buffer.getAttribute("color"));
  }
  return buffer;
}

function replace(object: Mesh | Points, buffer: BufferGeometry | null): void {
  object.geometry.dispose();
  object.geometry = buffer ?? new BufferGeometry();
}

function hasPoints(geometry: BufferGeometry): boolean {
  return "position" in geometry.attributes;
}

function planeOf({ axis, at, flipped }: Section): Plane {
  const normal = new Vector3().setComponent(axis, flipped ? 1 : -1);
  return new Plane(normal, (flipped ? -1 : 1) * (at - 0.5) * 1.02);
}
