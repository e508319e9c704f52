/** What can be seen: the surface, its edges, and the scan's points, as three.js objects. */
import {
  Box3,
  BufferAttribute,
  BufferGeometry,
  type Material,
  Matrix4,
  Mesh,
  type Plane,
  Points,
  Scene,
  type ShaderMaterial,
  Vector3,
} from "three";
import type { Frame } from "./frame";
import { type Geometry, sizeOf } from "./glb";
import { type Mode, pointMaterial, surfaceMaterial, wireMaterial } from "./materials";

export interface Shown {
  mesh: boolean;
  scan: boolean;
  wires: boolean;
  mode: Mode;
}

const PLACES_LOOKED_AT = 4000;
// Points this much larger than their mean spacing leave no gaps between them.
const CLOSING = 2;
// A scan's surface in units of its largest extent squared; that of a ball is 3.1, of a plate 1.
const TYPICAL_AREA = 2;

export class Scenery {
  /** Drawn with depth and shading of their own, so apart from each other. */
  readonly surfaces = new Scene();
  readonly points = new Scene();
  private readonly surface = new Mesh<BufferGeometry, Material>(new BufferGeometry());
  private readonly wires = new Mesh<BufferGeometry, Material>(new BufferGeometry());
  private readonly cloud = new Points<BufferGeometry, ShaderMaterial>(new BufferGeometry());
  /** The surface's triangles, whole and then ever fewer, over the same vertices. */
  private details: BufferGeometry[] = [];
  private mesh: Geometry | null = null;
  private scan: Geometry | null = null;
  private shown: Shown = { mesh: true, scan: false, wires: false, mode: "shaded" };
  private planes: Plane[] = [];

  constructor() {
    this.surfaces.add(this.surface, this.wires);
    this.points.add(this.cloud);
    for (const object of this.objects()) {
      object.matrixAutoUpdate = false;
      object.frustumCulled = false;
    }
    this.show(this.shown);
    this.restyle();
  }

  setMesh(geometry: Geometry | null): void {
    for (const one of this.details) one.dispose();
    this.mesh = geometry;
    this.details = geometry ? [bufferOf(geometry)] : [];
    this.surface.geometry = this.details[0] ?? new BufferGeometry();
    this.wires.geometry = this.surface.geometry;
    this.show(this.shown);
  }

  setScan(geometry: Geometry | null): void {
    this.cloud.geometry.dispose();
    this.scan = geometry;
    this.cloud.geometry = geometry ? bufferOf(geometry) : new BufferGeometry();
    this.show(this.shown);
    this.restyle();
  }

  /** Fewer triangles over the vertices of the mesh that is shown, fine to coarse. */
  setCoarser(indices: readonly Uint32Array[]): void {
    const whole = this.details[0];
    if (!whole) return;
    const coarser = indices.map((one) => {
      const buffer = new BufferGeometry();
      for (const [name, values] of Object.entries(whole.attributes)) buffer.setAttribute(name, values);
      return buffer.setIndex(new BufferAttribute(one, 1));
    });
    this.details = [whole, ...coarser];
  }

  /** Colors of the vertices, normalized; null takes the scan's own. */
  paint(colors: Uint16Array | null): void {
    const painted = colors && new BufferAttribute(colors, 3, true);
    for (const buffer of this.details) {
      const values = painted ?? buffer.getAttribute("ownColor");
      if (values) buffer.setAttribute("color", values);
      else buffer.deleteAttribute("color");
    }
  }

  show(what: Shown): void {
    const before = { mode: this.shown.mode, surface: this.surface.visible };
    this.shown = what;
    this.surface.visible = what.mesh && this.mesh !== null;
    this.wires.visible = this.surface.visible && what.wires;
    this.cloud.visible = what.scan && this.scan !== null;
    if (before.mode !== what.mode || before.surface !== this.surface.visible) this.restyle();
  }

  cut(planes: Plane[]): void {
    const before = this.planes.length;
    this.planes = planes;
    if (before !== planes.length) this.restyle();
    else for (const object of this.objects()) object.material.clippingPlanes = planes;
  }

  place(frame: Frame): void {
    for (const [geometry, objects] of [
      [this.mesh, [this.surface, this.wires]],
      [this.scan, [this.cloud]],
    ] as const) {
      for (const object of objects) {
        object.matrix.copy(geometry ? frame.placement(geometry) : new Matrix4());
        object.matrixWorldNeedsUpdate = true;
      }
    }
  }

  /** Some of the places that are seen, in the viewer's coordinates. */
  somePlaces(): Vector3[] {
    const object = this.surface.visible || !this.scan ? this.surface : this.cloud;
    const positions = object.geometry.getAttribute("position") as BufferAttribute | undefined;
    if (!positions) return [];
    const stride = Math.ceil(positions.count / PLACES_LOOKED_AT);
    const places: Vector3[] = [];
    for (let i = 0; i < positions.count; i += stride) {
      places.push(new Vector3().fromBufferAttribute(positions, i).applyMatrix4(object.matrix));
    }
    return places;
  }

  /** What is seen reaches so far, in the viewer's coordinates. */
  bounds(): Box3 {
    const object = this.surface.visible || !this.scan ? this.surface : this.cloud;
    const geometry = object === this.surface ? this.mesh : this.scan;
    if (!geometry) return new Box3(new Vector3(-0.5, -0.5, -0.5), new Vector3(0.5, 0.5, 0.5));
    return new Box3(new Vector3(...geometry.low), new Vector3(...geometry.high)).applyMatrix4(object.matrix);
  }

  get hasPoints(): boolean {
    return this.cloud.visible;
  }

  get hasSurface(): boolean {
    return this.surface.visible;
  }

  /** Were everything drawn. */
  get triangles(): number {
    return this.trianglesOf(0);
  }

  /** Triangles and points, were everything drawn. */
  get primitives(): number {
    return this.triangles + (this.cloud.visible ? this.pointCount : 0);
  }

  /** Choose what to draw of it all, at most `budget` where that can be had; gives its count. */
  limit(budget: number): number {
    const level = this.surface.visible ? this.levelWithin(budget) : 0;
    this.surface.geometry = this.details[level] ?? this.surface.geometry;
    this.wires.visible = this.surface.visible && this.shown.wires && level === 0;
    const triangles = this.trianglesOf(level);
    const points = this.cloud.visible ? Math.min(this.pointCount, Math.max(0, budget - triangles)) : 0;
    // They come in random order, so the first few are a thinner scan.
    this.cloud.geometry.setDrawRange(0, Math.ceil(points));
    return triangles + Math.ceil(points);
  }

  /** Points as large as their distance from each other, for a canvas `height` device pixels high. */
  sizePoints(height: number, pixelRatio: number, zoom: number, frame: Frame): void {
    const { uniforms } = this.cloud.material;
    uniforms["least"]!.value = 2 * pixelRatio;
    const drawn = Math.min(this.cloud.geometry.drawRange.count, this.pointCount);
    if (!this.scan || drawn === 0) return;
    const extent = sizeOf(this.scan) / frame.size;
    const spacing = extent * Math.sqrt(TYPICAL_AREA / drawn);
    // Over a surface they stay small, or they would hide it.
    uniforms["reach"]!.value = this.surface.visible ? 0 : (CLOSING * spacing * zoom * height) / 2;
  }

  dispose(): void {
    for (const one of this.details) one.dispose();
    this.cloud.geometry.dispose();
    for (const object of this.objects()) object.material.dispose();
  }

  private get pointCount(): number {
    return this.scan ? this.scan.positions.length / 3 : 0;
  }

  private trianglesOf(level: number): number {
    return this.surface.visible ? (this.details[level]?.index?.count ?? 0) / 3 : 0;
  }

  private levelWithin(budget: number): number {
    const found = this.details.findIndex((one) => (one.index?.count ?? 0) / 3 <= budget);
    return found < 0 ? this.details.length - 1 : found;
  }

  private restyle(): void {
    for (const object of this.objects()) object.material.dispose();
    const colored = "color" in this.cloud.geometry.attributes;
    this.surface.material = surfaceMaterial(this.shown.mode, this.planes);
    this.wires.material = wireMaterial(this.planes);
    this.cloud.material = pointMaterial(colored, this.surface.visible, this.planes);
  }

  private objects() {
    return [this.surface, this.wires, this.cloud] as const;
  }
}

function bufferOf(geometry: Geometry): BufferGeometry {
  const buffer = new BufferGeometry();
  buffer.setAttribute("position", new BufferAttribute(geometry.positions, 3));
  if (geometry.normals) buffer.setAttribute("normal", new BufferAttribute(geometry.normals, 3));
  if (geometry.indices) buffer.setIndex(new BufferAttribute(geometry.indices, 1));
  if (geometry.colors) {
    const width = geometry.colors.length / (geometry.positions.length / 3);
    buffer.setAttribute("color", new BufferAttribute(geometry.colors, width, true));
    buffer.setAttribute("ownColor", buffer.getAttribute("color"));
  }
  return buffer;
}
