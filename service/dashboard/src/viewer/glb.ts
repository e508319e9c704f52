/**
 * The meshes and points that the service writes. They are centred float32 under an offset and a
 * scale in `asset.extras.visco`, in float64: going through a glTF scene graph instead would round
 * a scan in map coordinates to centimetres.
 */
export type Vector = readonly [number, number, number];
export type UpAxis = "x" | "y" | "z";

export interface Geometry {
  positions: Float32Array;
  normals: Float32Array | Int8Array | null;
  /** Linear RGBA, normalized. */
  colors: Uint16Array | Uint8Array | null;
  indices: Uint32Array | null;
  /** Further values, one a vertex, such as CONFIDENCE. */
  attributes: Readonly<Record<string, Float32Array>>;
  /** Scan coordinates = offset + scale * position. */
  offset: Vector;
  scale: number;
  low: Vector;
  high: Vector;
  upAxis: UpAxis;
}

interface Accessor {
  bufferView: number;
  byteOffset?: number;
  componentType: number;
  count: number;
  type: "SCALAR" | "VEC2" | "VEC3" | "VEC4";
  min?: number[];
  max?: number[];
}

interface Document {
  asset: { extras?: { visco?: { offset?: Vector; scale?: number; up_axis?: UpAxis } } };
  accessors: Accessor[];
  bufferViews: Array<{ byteOffset?: number; byteLength: number; byteStride?: number }>;
  meshes: Array<{ primitives: Array<{ attributes: Record<string, number>; indices?: number }> }>;
}

const MAGIC = 0x46546c67;
const JSON_CHUNK = 0x4e4f534a;
const WIDTHS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 } as const;
const ARRAYS = {
  5120: Int8Array,
  5121: Uint8Array,
  5123: Uint16Array,
  5125: Uint32Array,
  5126: Float32Array,
} as const;

/** The first primitive of a binary glTF file; its arrays share the file's memory. Throws Error. */
export function readGlb(file: ArrayBuffer): Geometry {
  const head = new DataView(file);
  if (file.byteLength < 20 || head.getUint32(0, true) !== MAGIC || head.getUint32(16, true) !== JSON_CHUNK) {
    throw new Error("The file is not binary glTF.");
  }
  const length = head.getUint32(12, true);
  const document = JSON.parse(new TextDecoder().decode(new Uint8Array(file, 20, length))) as Document;
  const primitive = document.meshes[0]?.primitives[0];
  const position = document.accessors[primitive?.attributes["POSITION"] ?? -1];
  if (!primitive || !position) throw new Error("The file holds no points.");
  const read = (index: number | undefined) =>
    index === undefined ? null : arrayOf(document, document.accessors[index]!, file, 28 + length);
  const names = Object.keys(primitive.attributes).filter((name) => name.startsWith("_"));
  const extras = document.asset.extras?.visco ?? {};
  return {
    positions: read(primitive.attributes["POSITION"]) as Float32Array,
    normals: read(primitive.attributes["NORMAL"]) as Float32Array | null,
    colors: read(primitive.attributes["COLOR_0"]) as Uint16Array | null,
    indices: read(primitive.indices) as Uint32Array | null,
    attributes: Object.fromEntries(
      names.map((name) => [name.slice(1), read(primitive.attributes[name]) as Float32Array]),
    ),
    offset: extras.offset ?? [0, 0, 0],
    scale: extras.scale ?? 1,
    low: position.min as unknown as Vector,
    high: position.max as unknown as Vector,
    upAxis: extras.up_axis ?? "y",
  };
}

/** The points in the first `loaded` bytes of a file, or null before there are any. */
export function pointsSoFar(file: ArrayBuffer, loaded: number): Geometry | null {
  const jsonEnd = loaded < 20 ? Infinity : 20 + new DataView(file).getUint32(12, true);
  if (loaded < jsonEnd) return null;
  const whole = readGlb(file);
  const { positions, colors } = whole;
  const count = Math.min(positions.length / 3, Math.floor((loaded - positions.byteOffset) / 12));
  if (count <= 0) return null;
  const colored = colors && colors.byteOffset + colors.byteLength <= loaded;
  return { ...whole, positions: positions.subarray(0, 3 * count), colors: colored ? colors : null };
}

function arrayOf(document: Document, accessor: Accessor, file: ArrayBuffer, start: number) {
  const view = document.bufferViews[accessor.bufferView]!;
  const kind = ARRAYS[accessor.componentType as keyof typeof ARRAYS];
  if (!kind) throw new Error("The file has numbers of an unknown kind.");
  const offset = start + (view.byteOffset ?? 0) + (accessor.byteOffset ?? 0);
  return new kind(file, offset, accessor.count * WIDTHS[accessor.type]);
}

/** Largest extent in scan units. */
export function sizeOf({ low, high, scale }: Geometry): number {
  return Math.max(high[0] - low[0], high[1] - low[1], high[2] - low[2]) * scale || 1;
}

export function triangleCount(geometry: Geometry): number {
  return (geometry.indices?.length ?? 0) / 3;
}
