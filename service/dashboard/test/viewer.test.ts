import { Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { clustered, coarserIndices } from "../src/viewer/coarser";
import { colorAt, colorsOf } from "../src/viewer/colormap";
import { inFrame } from "../src/viewer/distances";
import { Frame } from "../src/viewer/frame";
import { type Geometry, pointsSoFar, readGlb, sizeOf } from "../src/viewer/glb";
import { buildTree, Neighbors } from "../src/viewer/kdtree";
import { meshesToShow } from "../src/viewer/model";
import { Pace } from "../src/viewer/pace";
import { leastDirection, ScanSurface } from "../src/viewer/scansurface";
import { histogram, roundUp, summarize } from "../src/viewer/statistics";
import { UPS } from "../src/viewer/up";
import { job } from "./samples";

/** Numbers that look random and are the same in every run (Lehmer). */
function noise(count: number, seed = 1): Float32Array {
  let state = seed;
  return Float32Array.from({ length: count }, () => (state = (state * 48271) % 2147483647) / 2147483647);
}

describe("the nearest points", () => {
  const points = noise(3 * 700);
  points.set(points.subarray(0, 30), 30);
  points.set([1e6, -1e6, 1e6], 60);
  const queries = noise(3 * 60, 7);
  const plain = points.slice();
  const tree = buildTree(points);

  it.each([1, 5])("are as far as looking at every point says: %i", (most) => {
    const neighbors = new Neighbors(tree, most);
    for (let q = 0; q < queries.length; q += 3) {
      const [x, y, z] = queries.subarray(q, q + 3) as unknown as [number, number, number];
      const all = Array.from({ length: plain.length / 3 }, (_, i) =>
        Math.hypot(plain[3 * i]! - x, plain[3 * i + 1]! - y, plain[3 * i + 2]! - z),
      ).sort((a, b) => a - b);
      const found = [...neighbors.search(x, y, z).squares].map(Math.sqrt);
      found.forEach((distance, place) => expect(distance).toBeCloseTo(all[place]!, 9));
      expect(Math.sqrt(neighbors.search(x, y, z, all[0]! * 1.01).squares[0]!)).toBeCloseTo(all[0]!, 9);
    }
  });

  it("are found among equal points too", () => {
    const { squares, found } = new Neighbors(buildTree(new Float32Array(3 * 200)), 4).search(3, 4, 0);
    expect([found, ...squares]).toEqual([4, 25, 25, 25, 25]);
  });

  it("may be fewer than were asked for", () => {
    expect(new Neighbors(buildTree(Float32Array.of(0, 0, 0)), 4).search(1, 0, 0).found).toBe(1);
  });
});

describe("the distance to a scan", () => {
  // A plane z = x, one unit between its points, without those near the origin.
  const points: number[] = [];
  for (let x = -12; x <= 12; x++) {
    for (let y = -12; y <= 12; y++) if (Math.hypot(x, y) > 6) points.push(x, y, x);
  }
  const surface = new ScanSurface(Float32Array.from(points));

  it("does not depend on where between the points one is", () => {
    for (const [x, y] of [[9, 0.5], [9.5, 0.5], [9, 0], [9.3, -0.2]] as const) {
      expect(surface.distance(x, y, x)).toBeLessThan(1e-5);
      expect(surface.distance(x - 0.1, y, x + 0.1)).toBeCloseTo(0.1 * Math.SQRT2, 5);
    }
  });

  it("counts the way to the rim in a hole and beyond the edge", () => {
    expect(surface.distance(0, 0, 0)).toBeGreaterThan(3);
    expect(surface.distance(0, 40, 0)).toBeGreaterThan(24);
  });

  it("is never more than to the nearest point", () => {
    const line = new ScanSurface(Float32Array.of(0, 0, 0, 1, 0, 0, 2, 0, 0));
    expect(line.distance(1, 0.25, 0)).toBeCloseTo(0.25);
    expect(new ScanSurface(Float32Array.of(1, 1, 1)).distance(1, 1, 3)).toBeCloseTo(2);
  });
});

it("the least direction is the one with the smallest eigenvalue", () => {
  // 3, 2 and 1 along (1, 1, 0), (1, -1, 0) and z.
  const [x, y, z] = leastDirection(2.5, 0.5, 0, 2.5, 0, 1);
  expect([x, y, Math.abs(z)]).toEqual([expect.closeTo(0), expect.closeTo(0), expect.closeTo(1)]);
  expect(leastDirection(1, 0, 0, 1, 0, 1)).toEqual([0, 0, 0]);
});

describe("statistics", () => {
  it("sum up", () => {
    const { mean, rms, p95, max } = summarize(Float32Array.from({ length: 101 }, (_, i) => i));
    expect([mean, p95, max]).toEqual([50, 95, 100]);
    expect(rms).toBeCloseTo(Math.sqrt(3350));
  });

  it("count every value once", () => {
    const counts = histogram(Float32Array.of(-1, 0, 0.5, 1, 9), 0, 1, 4);
    expect(counts).toEqual([2, 0, 1, 2]);
  });

  it.each([
    [0.3, 0.3],
    [0.543, 0.6],
    [0.91, 1],
    [11, 15],
    [0, 1],
    [Number.NaN, 1],
  ])("a scale for %s ends at %s", (value, end) => expect(roundUp(value)).toBe(end));
});

describe("colors", () => {
  it("go from viridis' first to its last and stay there", () => {
    expect(colorAt(-1)).toEqual(colorAt(0));
    expect(colorAt(2).map((channel) => Math.round(channel * 255))).toEqual([253, 231, 37]);
  });

  it("are one for each value", () => {
    const colors = colorsOf(Float32Array.of(0, 5, Infinity), 0, 1);
    expect(colors.subarray(3, 6)).toEqual(colors.subarray(6, 9));
    expect(colors.subarray(0, 3)).not.toEqual(colors.subarray(3, 6));
  });
});

function geometry(fields: Partial<Geometry>): Geometry {
  return {
    positions: Float32Array.of(-1, -2, -3, 1, 2, 3),
    normals: null,
    colors: null,
    indices: null,
    attributes: {},
    offset: [0, 0, 0],
    scale: 1,
    low: [-1, -2, -3],
    high: [1, 2, 3],
    upAxis: "z",
    ...fields,
  };
}

describe("the viewer's frame", () => {
  it.each(["x", "y", "z"] as const)("puts %s up and comes back", (upAxis) => {
    const frame = new Frame(geometry({ upAxis, offset: [1e7, 2e7, 3e6] }));
    const axis = { x: 0, y: 1, z: 2 }[upAxis];
    const top = new Vector3().setComponent(axis, 3);
    const placed = top.clone().applyMatrix4(frame.placement(geometry({ upAxis, offset: [1e7, 2e7, 3e6] })));
    expect(placed.y).toBeCloseTo(0.5);
    expect(placed.x).toBeCloseTo(0);
    expect(frame.fromScan(frame.toScan(placed)).distanceTo(placed)).toBeLessThan(1e-6);
  });

  it.each(UPS)("turns without mirroring when %s is up", (up) => {
    const frame = new Frame(geometry({}), up);
    expect(frame.placement(geometry({})).determinant()).toBeGreaterThan(0);
    expect(frame.direction(up).y).toBeCloseTo(1);
  });

  it("keeps two files of one scan together in map coordinates", () => {
    const frame = new Frame(geometry({ offset: [5e6, 0, 0] }));
    const other = geometry({ offset: [5e6 + 0.25, 0, 0] });
    const placed = new Vector3(-0.25, 0, 0).applyMatrix4(frame.placement(other));
    expect(placed.length()).toBeLessThan(1e-7);
    expect(inFrame(other, [5e6, 0, 0])[0]).toBeCloseTo(-0.75, 6);
  });

  it("speaks of the same places as another job's frame", () => {
    const other = geometry({ offset: [10, 20, 30], scale: 2, upAxis: "x" });
    const [one, two] = [new Frame(geometry({})), new Frame(other)];
    const place = new Vector3(0.1, 0.2, 0.3);
    const back = one.fromScan(two.toScan(two.fromScan(one.toScan(place))));
    expect(back.distanceTo(place)).toBeLessThan(1e-6);
  });
});

describe("a GLB", () => {
  function glb(extras: unknown): ArrayBuffer {
    const text = JSON.stringify({
      asset: { version: "2.0", extras },
      accessors: [
        { bufferView: 0, componentType: 5126, count: 3, type: "VEC3", min: [0, 0, 0], max: [2, 1, 0] },
        { bufferView: 1, componentType: 5125, count: 3, type: "SCALAR" },
        { bufferView: 2, componentType: 5126, count: 3, type: "SCALAR" },
      ],
      bufferViews: [
        { byteOffset: 0, byteLength: 36 },
        { byteOffset: 36, byteLength: 12 },
        { byteOffset: 48, byteLength: 12 },
      ],
      meshes: [{ primitives: [{ attributes: { POSITION: 0, _CONFIDENCE: 2 }, indices: 1 }] }],
    });
    const json = new TextEncoder().encode(text.padEnd(Math.ceil(text.length / 4) * 4));
    const file = new ArrayBuffer(28 + json.length + 60);
    new Uint32Array(file, 0, 5).set([0x46546c67, 2, file.byteLength, json.length, 0x4e4f534a]);
    new Uint8Array(file, 20, json.length).set(json);
    new Uint32Array(file, 20 + json.length, 2).set([60, 0x004e4942]);
    new Float32Array(file, 28 + json.length, 9).set([0, 0, 0, 2, 0, 0, 0, 1, 0]);
    new Uint32Array(file, 64 + json.length, 3).set([0, 1, 2]);
    new Float32Array(file, 76 + json.length, 3).set([0.25, 0.5, 1]);
    return file;
  }

  it("gives its arrays, its place and its attributes", () => {
    const read = readGlb(glb({ visco: { offset: [1, 2, 3], scale: 2, up_axis: "x" } }));
    expect([...read.positions]).toEqual([0, 0, 0, 2, 0, 0, 0, 1, 0]);
    expect([...read.indices!]).toEqual([0, 1, 2]);
    expect([...read.attributes["CONFIDENCE"]!]).toEqual([0.25, 0.5, 1]);
    expect([read.offset, read.scale, read.upAxis]).toEqual([[1, 2, 3], 2, "x"]);
    expect(sizeOf(read)).toBe(4);
  });

  it("gives the points that have come so far", () => {
    const file = glb({});
    const begun = readGlb(file).positions.byteOffset;
    expect(pointsSoFar(file, 10)).toBeNull();
    expect(pointsSoFar(file, begun + 11)).toBeNull();
    expect([...pointsSoFar(file, begun + 25)!.positions]).toEqual([0, 0, 0, 2, 0, 0]);
    expect(pointsSoFar(file, file.byteLength)!.positions).toHaveLength(9);
  });

  it("that is none is refused", () => {
    expect(() => readGlb(new ArrayBuffer(64))).toThrow("not binary glTF");
    expect(() => readGlb(new ArrayBuffer(3))).toThrow("not binary glTF");
  });
});

describe("the meshes to load", () => {
  const file = (name: string, size: number) => ({
    name, size, sha256: name, content_type: "", created_at: "", url: "",
  });
  const levels = [file("level-128.glb", 50), file("level-64.glb", 10)];

  it("of a running job are its finest level", () => {
    const running = job("a", { status: "running", artifacts: levels });
    expect(meshesToShow(running, false).map((one) => one.name)).toEqual(["level-128.glb"]);
  });

  it("of a finished job begin coarse where that helps", () => {
    const done = job("a", { artifacts: [...levels, file("mesh.glb", 200)] });
    expect(meshesToShow(done, false).map((one) => one.name)).toEqual(["level-64.glb", "mesh.glb"]);
    expect(meshesToShow(done, true).map((one) => one.name)).toEqual(["mesh.glb"]);
  });

  it("of a failed job are what it got to", () => {
    const failed = job("a", { status: "failed", artifacts: levels });
    expect(meshesToShow(failed, false).map((one) => one.name)).toEqual(["level-128.glb"]);
  });
});

describe("fewer triangles while the view moves", () => {
  // A square of 200 by 200 by 2 triangles, one unit between its vertices.
  const side = 201;
  const positions = Float32Array.from({ length: 3 * side * side }, (_, i) =>
    i % 3 === 0 ? Math.floor(i / 3) % side : i % 3 === 1 ? Math.floor(i / 3 / side) : 0,
  );
  const corners: number[] = [];
  for (let y = 0; y < side - 1; y++) {
    for (let x = 0; x < side - 1; x++) {
      const at = y * side + x;
      corners.push(at, at + 1, at + side, at + side, at + 1, at + side + 1);
    }
  }
  const indices = Uint32Array.from(corners);

  it("are about a quarter at each step, until they are few", () => {
    const counts = coarserIndices(positions, indices).map((one) => one.length / 3);
    expect(counts).toHaveLength(2);
    expect(counts[0]! / 80_000).toBeCloseTo(0.25, 1);
    expect(counts[1]! / counts[0]!).toBeCloseTo(0.25, 1);
  });

  it("still cover the surface, facing the same way", () => {
    const found = clustered(positions, indices, 4);
    let area = 0;
    for (let i = 0; i < found.length; i += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => new Vector3().fromArray(positions, 3 * found[i + k]!)) as [
        Vector3, Vector3, Vector3,
      ];
      area += b.sub(a).cross(c.sub(a)).z / 2;
    }
    expect(area / 200 ** 2).toBeGreaterThan(0.9);
    expect(area / 200 ** 2).toBeLessThanOrEqual(1);
  });

  it("of nothing are none", () => {
    expect(coarserIndices(new Float32Array(0), new Uint32Array(0))).toEqual([]);
  });
});

describe("the pace", () => {
  it("draws everything until a frame was slow, then what fits into a thirtieth of a second", () => {
    const pace = new Pace();
    pace.learn(2_000_000, 17, 1);
    expect(pace.budget).toBe(Infinity);
    pace.learn(2_000_000, 200, 1);
    expect(pace.budget).toBe(300_000);
  });

  it("gives up sharpness first", () => {
    const pace = new Pace();
    pace.learn(2_000_000, 200, 2);
    expect([pace.sharp, pace.budget]).toEqual([false, Infinity]);
    pace.learn(2_000_000, 100, 1);
    expect(pace.budget).toBe(600_000);
  });

  it("dares more while frames are fast, and never draws next to nothing", () => {
    const pace = new Pace();
    pace.learn(1_000_000, 100, 1);
    pace.learn(290_000, 17, 1);
    expect(pace.budget).toBe(375_000);
    pace.learn(50_000, 17, 1);
    expect(pace.budget).toBe(375_000);
    pace.learn(375_000, 60_000, 1);
    expect(pace.budget).toBe(20_000);
  });
});
