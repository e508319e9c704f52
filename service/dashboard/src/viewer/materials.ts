/** How surfaces and points look. */
import {
  Color,
  DoubleSide,
  type Material,
  MeshBasicMaterial,
  type Plane,
  ShaderMaterial,
} from "three";

export type Mode = "shaded" | "facets" | "normals" | "colors" | "error" | "confidence";

export const PAINTED: ReadonlySet<Mode> = new Set<Mode>(["colors", "error", "confidence"]);
const SURFACE = new Color("#c8ccd0");
const INSIDE = new Color("#b8643f");
const POINTS = new Color("#c2ccd2");
// Among the grey of a surface, points need a color of their own.
const POINTS_ON_SURFACE = new Color("#12909c");

const VERTEX = `
  #include <clipping_planes_pars_vertex>
  varying vec3 vPlace;
  varying vec3 vNormal;
  varying vec3 vColor;
  void main() {
    #ifdef PAINTED
      vColor = color.rgb;
    #endif
    vNormal = normalMatrix * normal;
    vec4 mvPosition = modelViewMatrix * vec4(position, 1.0);
    vPlace = mvPosition.xyz;
    #include <clipping_planes_vertex>
    gl_Position = projectionMatrix * mvPosition;
  }`;

/**
 * A studio that moves with the eye, so that no side is ever dark: a key light from the upper left,
 * a weaker one from the right, a rim from behind, a sky.
 */
export const STUDIO = `
  const vec3 KEY = vec3(-0.407, 0.610, 0.680);
  const vec3 FILL = vec3(0.873, -0.097, 0.478);
  const vec3 RIM = vec3(0.302, 0.402, -0.864);

  vec3 studio(vec3 normal) {
    vec3 light = mix(vec3(0.13, 0.125, 0.12), vec3(0.30, 0.31, 0.33), normal.y * 0.5 + 0.5);
    light += vec3(0.70, 0.68, 0.65) * max(dot(normal, KEY), 0.0);
    light += vec3(0.17, 0.19, 0.21) * max(dot(normal, FILL), 0.0);
    return light + vec3(0.35) * max(dot(normal, RIM), 0.0);
  }`;

/**
 * Edges are lighter and grooves darker than light alone would make them (after "cavity" in
 * sculpting programs), which shows a scan's detail.
 *
 * Back faces belong to the inside, which has a color of its own. At the outline of a closed surface
 * some of them are seen by a hair; those are shaded like their neighbors in front.
 */
const FRAGMENT = `
  #include <clipping_planes_pars_fragment>
  varying vec3 vPlace;
  varying vec3 vNormal;
  varying vec3 vColor;
  uniform vec3 surface;
  uniform vec3 inside;
  const float HAIR = 0.3;
  ${STUDIO}

  void main() {
    #include <clipping_planes_fragment>
    vec3 eye = normalize(-vPlace);
    #ifdef FACETS
      vec3 normal = normalize(cross(dFdx(vPlace), dFdy(vPlace)));
      bool isInside = !gl_FrontFacing && dot(normal, eye) > HAIR;
    #else
      vec3 normal = normalize(vNormal);
      bool isInside = !gl_FrontFacing && dot(normal, eye) < -HAIR;
      if (isInside) normal = -normal;
    #endif
    #ifdef NORMALS
      gl_FragColor = vec4(normal * 0.5 + 0.5, 1.0);
      return;
    #endif
    #ifdef PAINTED
      vec3 albedo = vColor;
    #else
      vec3 albedo = surface;
    #endif
    if (isInside) albedo = inside;
    float bend = dFdx(normal).x + dFdy(normal).y;
    albedo *= 1.0 + clamp(CAVITY * bend, -0.3, 0.25);
    float shine = pow(max(dot(normal, normalize(KEY + eye)), 0.0), 32.0);
    gl_FragColor = vec4(albedo * studio(normal) + SHINE * shine, 1.0);
    #include <colorspace_fragment>
  }`;

/** The surface in a mode; its inside, seen through a section, has a color of its own. */
export function surfaceMaterial(mode: Mode, planes: Plane[]): ShaderMaterial {
  const painted = PAINTED.has(mode);
  const defines: Record<string, string> = { CAVITY: painted ? "0.0" : "1.2", SHINE: painted ? "0.03" : "0.07" };
  if (painted) defines["PAINTED"] = "";
  if (mode === "facets") defines["FACETS"] = "";
  if (mode === "normals") defines["NORMALS"] = "";
  return new ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    defines,
    uniforms: { surface: { value: SURFACE }, inside: { value: INSIDE } },
    vertexColors: painted,
    side: DoubleSide,
    clipping: true,
    clippingPlanes: planes,
  });
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

const POINT_VERTEX = `
  #include <clipping_planes_pars_vertex>
  uniform float reach;
  uniform float least;
  varying vec3 vColor;
  void main() {
    #ifdef PAINTED
      vColor = color.rgb;
    #endif
    vec4 mvPosition = modelViewMatrix * vec4(position, 1.0);
    #include <clipping_planes_vertex>
    gl_Position = projectionMatrix * mvPosition;
    gl_PointSize = clamp(reach / -mvPosition.z, least, 12.0 * least);
  }`;
const POINT_FRAGMENT = `
  #include <clipping_planes_pars_fragment>
  uniform vec3 surface;
  varying vec3 vColor;
  void main() {
    #include <clipping_planes_fragment>
    vec2 off = gl_PointCoord - 0.5;
    if (dot(off, off) > 0.25) discard;
    #ifdef PAINTED
      gl_FragColor = vec4(vColor, 1.0);
    #else
      gl_FragColor = vec4(surface, 1.0);
    #endif
  }`;

/** Round points in linear color; `colored`: with the scan's own colors. */
export function pointMaterial(colored: boolean, onSurface: boolean, planes: Plane[]): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: POINT_VERTEX,
    fragmentShader: POINT_FRAGMENT,
    defines: colored ? { PAINTED: "" } : {},
    uniforms: {
      surface: { value: onSurface ? POINTS_ON_SURFACE : POINTS },
      // Device pixels: the size at distance one, and the smallest size.
      reach: { value: 0 },
      least: { value: 2 },
    },
    vertexColors: colored,
    clipping: true,
    clippingPlanes: planes,
  });
}
