/** The scene behind one canvas. It draws when something has changed, and only then. */
import { type Box3, PerspectiveCamera, Plane, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { Eye, OBLIQUE } from "./camera";
import { EyeDome } from "./eyedome";
import { Frame } from "./frame";
import type { Geometry, Vector } from "./glb";
import { FrameTimer, Pace } from "./pace";
import { pick } from "./picking";
import { Scenery, type Shown } from "./scenery";
import type { Up } from "./up";

export interface Section {
  axis: 0 | 1 | 2;
  /** Share of the extent, 0 to 1. */
  at: number;
  flipped: boolean;
}

/** In scan coordinates. */
export interface Pose {
  position: Vector;
  target: Vector;
}

// After so long without a movement everything is drawn again.
const REST_MILLISECONDS = 200;

export class Stage {
  frame: Frame | null = null;
  onPose: (pose: Pose) => void = () => undefined;
  /** The browser took the graphics away, or gave them back. */
  onLost: () => void = () => undefined;
  onRestored: () => void = () => undefined;
  private readonly renderer: WebGLRenderer;
  private readonly eye: Eye;
  private readonly scenery = new Scenery();
  private readonly eyeDome = new EyeDome();
  private readonly timer: FrameTimer;
  private readonly pace = new Pace();
  private readonly watchers = new Set<() => void>();
  private readonly stopper = new AbortController();
  private mesh: Geometry | null = null;
  private first: Geometry | null = null;
  private up: Up | null;
  private section: Section | null = null;
  private planes: Plane[] = [];
  /** Set until the view is turned: then another size of the canvas asks for another distance. */
  private fitted: { from: Up | null } | null = null;
  private coarser: Worker | null = null;
  private requested = 0;
  private held = false;
  private movedAt = -Infinity;
  private drawnAt = -Infinity;
  private resting: ReturnType<typeof setTimeout> | undefined;
  private silent = false;
  /** What was just uploaded is slow to draw once, which says nothing. */
  private fresh = true;
  private readonly awaited: Pose | null;

  /** `pose`: where to look from at first, rather than at the whole. Throws without WebGL. */
  constructor(
    private readonly canvas: HTMLCanvasElement,
    { up, pose }: { up: Up | null; pose: Pose | null },
  ) {
    this.up = up;
    this.awaited = pose;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.localClippingEnabled = true;
    this.renderer.setClearColor(0, 0);
    this.timer = new FrameTimer(this.renderer.getContext() as WebGL2RenderingContext);
    const camera = new PerspectiveCamera(32, 1, 0.01, 100);
    const controls = new OrbitControls(camera, canvas);
    this.eye = new Eye(camera, controls);
    controls.enableDamping = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    controls.zoomToCursor = true;
    controls.addEventListener("change", () => this.moved());
    controls.addEventListener("start", () => {
      this.held = true;
      this.fitted = null;
    });
    controls.addEventListener("end", () => {
      this.held = false;
      this.moved();
    });
    const { signal } = this.stopper;
    canvas.addEventListener("webglcontextlost", () => this.onLost(), { signal });
    canvas.addEventListener("webglcontextrestored", () => this.restored(), { signal });
    this.fit();
  }

  /** Shows another mesh; the camera stays once someone has moved it, and else sees all of it. */
  setMesh(geometry: Geometry | null): void {
    this.coarser?.terminate();
    this.coarser = null;
    this.mesh = geometry;
    this.scenery.setMesh(geometry);
    this.place(geometry);
  }

  setScan(geometry: Geometry | null): void {
    this.scenery.setScan(geometry);
    this.place(geometry);
  }

  /** Colors of the vertices, normalized; null takes the scan's own. */
  paint(colors: Uint16Array | null): void {
    this.scenery.paint(colors);
    this.draw();
  }

  show(what: Shown): void {
    this.scenery.show(what);
    this.cut(this.section);
  }

  cut(section: Section | null): void {
    if (section !== this.section) this.movedAt = performance.now();
    this.section = section;
    this.planes = section ? [planeOf(section, this.scenery.bounds())] : [];
    this.scenery.cut(this.planes);
    this.draw();
  }

  /** Which way of the scan points up; null: the way that its file says. */
  setUp(up: Up | null): void {
    if (up === this.up) return;
    this.up = up;
    if (!this.first) return;
    this.frame = new Frame(this.first, up ?? undefined);
    this.scenery.place(this.frame);
    this.cut(this.section);
    this.fit();
  }

  /** Look at everything, from the corner or from one of the scan's sides. */
  fit(from: Up | null = null): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width > 0 && height > 0) this.eye.camera.aspect = width / height;
    const direction = from && this.frame ? this.frame.direction(from) : OBLIQUE.clone();
    // Seen from straight above, the front is below.
    if (Math.abs(direction.y) > 0.9) direction.z += 1e-4;
    this.eye.fit(this.scenery.somePlaces(), direction);
    this.fitted = { from };
    this.moved();
  }

  turn(around: number, up: number, closer = 1): void {
    this.fitted = null;
    this.eye.turn(around, up, closer);
    this.moved();
  }

  shift(right: number, up: number): void {
    this.fitted = null;
    this.eye.shift(right, up);
    this.moved();
  }

  /** Turn around what is seen at a point of the canvas, if anything is. */
  centreOn(x: number, y: number): void {
    const place = this.pick(x, y);
    if (!place || !this.frame) return;
    this.fitted = null;
    this.eye.lookAt(this.frame.fromScan(place));
    this.moved();
  }

  get pose(): Pose | null {
    if (!this.frame) return null;
    const { camera, controls } = this.eye;
    return { position: this.frame.toScan(camera.position), target: this.frame.toScan(controls.target) };
  }

  /** Look from where another viewer looks, without telling it back. */
  takePose(pose: Pose): void {
    if (!this.frame) return;
    const { camera, controls } = this.eye;
    this.silent = true;
    this.fitted = null;
    camera.position.copy(this.frame.fromScan(pose.position));
    controls.target.copy(this.frame.fromScan(pose.target));
    controls.update();
    this.silent = false;
    this.movedAt = performance.now();
    this.draw();
  }

  /** The place under a point of the canvas, in scan coordinates. */
  pick(x: number, y: number): Vector | null {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const scenes = [this.scenery.surfaces, this.scenery.points];
    const place = pick(this.renderer, scenes, this.eye.camera, this.planes, { x, y, width, height });
    return place && this.frame ? this.frame.toScan(place) : null;
  }

  /** Where a place in scan coordinates is on the canvas, in CSS pixels. */
  project(place: Vector): { x: number; y: number } {
    const { x, y } = (this.frame?.fromScan(place) ?? new Vector3()).project(this.eye.camera);
    return { x: ((x + 1) / 2) * this.canvas.clientWidth, y: ((1 - y) / 2) * this.canvas.clientHeight };
  }

  /** One of the scan's directions as the eye sees it: right, up, towards the eye. */
  seen(direction: Up): Vector3 | null {
    return this.frame?.direction(direction).transformDirection(this.eye.camera.matrixWorldInverse) ?? null;
  }

  resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.eye.camera.aspect = width / height;
    if (this.fitted) this.fit(this.fitted.from);
    this.drawNow();
  }

  draw(): void {
    this.requested ||= requestAnimationFrame(() => this.drawNow());
  }

  /** Calls back after every drawing; gives what ends that. */
  watch(look: () => void): () => void {
    this.watchers.add(look);
    return () => void this.watchers.delete(look);
  }

  /** A copy of what is seen, over the given background. */
  snapshot(background: string): HTMLCanvasElement {
    const copy = document.createElement("canvas");
    this.movedAt = -Infinity;
    this.drawNow();
    copy.width = this.canvas.width;
    copy.height = this.canvas.height;
    const context = copy.getContext("2d")!;
    context.fillStyle = background;
    context.fillRect(0, 0, copy.width, copy.height);
    context.drawImage(this.canvas, 0, 0);
    return copy;
  }

  dispose(): void {
    this.stopper.abort();
    cancelAnimationFrame(this.requested);
    clearTimeout(this.resting);
    this.coarser?.terminate();
    this.eye.controls.dispose();
    this.scenery.dispose();
    this.eyeDome.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  private place(geometry: Geometry | null): void {
    this.fresh = true;
    if (!geometry) return this.draw();
    this.first ??= geometry;
    const isFirst = this.frame === null;
    this.frame ??= new Frame(this.first, this.up ?? undefined);
    this.scenery.place(this.frame);
    this.cut(this.section);
    if (isFirst && this.awaited) this.takePose(this.awaited);
    else if (this.fitted) this.fit(this.fitted.from);
    this.draw();
  }

  private restored(): void {
    this.fresh = true;
    this.onRestored();
    this.resize();
  }

  private moved(): void {
    this.movedAt = performance.now();
    this.draw();
    if (!this.silent && this.pose) this.onPose(this.pose);
  }

  private drawNow(): void {
    cancelAnimationFrame(this.requested);
    this.requested = 0;
    const now = performance.now();
    this.eye.settle(now - this.drawnAt);
    this.drawnAt = now;
    this.eye.adaptDepth();
    const moving = this.held || now - this.movedAt < REST_MILLISECONDS;
    const drawn = this.scenery.limit(moving ? this.pace.budget : Infinity);
    const ratio = moving && !this.pace.sharp ? 1 : Math.min(2, devicePixelRatio);
    this.fitBuffer(ratio);
    this.renderer.render(this.scenery.surfaces, this.eye.camera);
    if (this.scenery.hasPoints) this.drawPoints(ratio);
    this.canvas.dataset["drawn"] = String(drawn);
    if (drawn < this.scenery.primitives || ratio < Math.min(2, devicePixelRatio)) this.drawWholeLater();
    this.time(drawn, ratio);
    for (const look of this.watchers) look();
  }

  private drawPoints(ratio: number): void {
    const { camera } = this.eye;
    if (this.frame) {
      const zoom = camera.projectionMatrix.elements[5]!;
      this.scenery.sizePoints(this.canvas.clientHeight * ratio, ratio, zoom, this.frame);
    }
    this.eyeDome.draw(this.renderer, this.scenery.points, camera, !this.scenery.hasSurface);
  }

  private fitBuffer(ratio: number): void {
    const { clientWidth: width, clientHeight: height, width: now, height: nowHigh } = this.canvas;
    if (now === Math.floor(width * ratio) && nowHigh === Math.floor(height * ratio)) return;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
  }

  private drawWholeLater(): void {
    clearTimeout(this.resting);
    this.resting = setTimeout(() => (this.held ? this.drawWholeLater() : this.draw()), REST_MILLISECONDS + 20);
  }

  private time(drawn: number, ratio: number): void {
    if (this.fresh) {
      this.fresh = false;
      return this.draw();
    }
    this.timer.start((milliseconds) => {
      this.pace.learn(drawn, milliseconds, ratio);
      if (this.pace.budget < this.scenery.triangles) this.prepareCoarser();
    });
  }

  private prepareCoarser(): void {
    const { mesh } = this;
    if (this.coarser || !mesh?.indices) return;
    this.coarser = new Worker(new URL("./coarser.worker.ts", import.meta.url), { type: "module" });
    this.coarser.onmessage = ({ data }: MessageEvent<Uint32Array[]>) => this.scenery.setCoarser(data);
    this.coarser.postMessage({ positions: mesh.positions, indices: mesh.indices });
  }
}

function planeOf({ axis, at, flipped }: Section, { min, max }: Box3): Plane {
  const sign = flipped ? 1 : -1;
  const [low, high] = [min.getComponent(axis), max.getComponent(axis)];
  // At either end nothing is cut, also not what rounding puts on the plane.
  const place = low + (at * 1.002 - 0.001) * (high - low);
  return new Plane(new Vector3().setComponent(axis, sign), -sign * place);
}
