/** How surfaces and points look. */
import {
  Color,
  DoubleSide,
  type Material,
  MeshBasicMaterial,
  MeshNormalMaterial,
  MeshStandardMaterial,
  type Plane,
  PointsMaterial,
} from "three";

export type Mode = "shaded" | "facets" | "normals" | "colors" | "error" | "confidence";

const SURFACE = "#c3c8ce";
const INSIDE = new Color("#b8643f");

/** The surface in a mode; its inside, seen through a section, has a color of its own. */
export function surfaceMaterial(mode: Mode, planes: Plane[]): Material {
  const shared = { side: DoubleSide, clippingPlanes: planes };
  if (mode === "normals") return new MeshNormalMaterial(shared);
  const painted = mode === "colors" || mode === "error" || mode === "confidence";
  const material = new MeshStandardMaterial({
    ...shared,
    color: painted ? "#ffffff" : SURFACE,
    vertexColors: painted,
    flatShading: mode === "facets",
    roughness: 0.62,
    metalness: 0,
  });
  material.onBeforeCompile = (shader) => {
    shader.uniforms["insideColor"] = { value: INSIDE };
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", "uniform vec3 insideColor;\n#include <common>")
      .replace(
        "#include <color_fragment>",
        "#include <color_fragment>\nif (!gl_FrontFacing) diffuseColor.rgb = insideColor;",
      );
  };
  return material;
}

export function wireMaterial(planes: Plane[]): Material {
  return new MeshBasicMaterial({
    color: "#1b2229",
    wireframe: true,
    transparent: true,
    opacity: 0.35,
    clippingPlanes: planes,
  });
}

/** `colored`: with the scan's own colors. */
export function pointMaterial(colored: boolean, planes: Plane[]): PointsMaterial {
  return new PointsMaterial({
    color: colored ? "#ffffff" : "#0e6872",
    vertexColors: colored,
    size: 2,
    sizeAttenuation: false,
    clippingPlanes: planes,
  });
}
