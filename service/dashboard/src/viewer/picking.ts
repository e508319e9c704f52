/**
 * What lies under the pointer: the one pixel there is drawn with positions instead of colors. That
 * takes as long as a frame whatever the number of triangles, and sees points and sections alike.
 */
import {
  DoubleSide,
  FloatType,
  type PerspectiveCamera,
  type Plane,
  type Scene,
  ShaderMaterial,
  Vector3,
  type WebGLRenderer,
  WebGLRenderTarget,
} from "three";

const VERTEX = `
  #include <clipping_planes_pars_vertex>
  uniform float pointSize;
  varying vec3 place;
  void main() {
    vec4 world = modelMatrix * vec4(position, 1.0);
    place = world.xyz;
    vec4 mvPosition = viewMatrix * world;
    #include <clipping_planes_vertex>
    gl_Position = projectionMatrix * mvPosition;
    gl_PointSize = pointSize;
  }`;
const FRAGMENT = `
  #include <clipping_planes_pars_fragment>
  varying vec3 place;
  void main() {
    #include <clipping_planes_fragment>
    gl_FragColor = vec4(place, 1.0);
  }`;

/** The world position seen at pixel (x, y) of a canvas of the given size, or null. */
export function pick(
  renderer: WebGLRenderer,
  scenes: readonly Scene[],
  camera: PerspectiveCamera,
  planes: Plane[],
  { x, y, width, height }: { x: number; y: number; width: number; height: number },
): Vector3 | null {
  const target = new WebGLRenderTarget(1, 1, { type: FloatType });
  const material = new ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    uniforms: { pointSize: { value: 6 } },
    clipping: true,
    clippingPlanes: planes,
    side: DoubleSide,
  });
  camera.setViewOffset(width, height, Math.floor(x), Math.floor(y), 1, 1);
  renderer.setRenderTarget(target);
  renderer.clear();
  renderer.autoClear = false;
  for (const scene of scenes) {
    scene.overrideMaterial = material;
    renderer.render(scene, camera);
    scene.overrideMaterial = null;
  }
  renderer.autoClear = true;
  const pixel = new Float32Array(4);
  renderer.readRenderTargetPixels(target, 0, 0, 1, 1, pixel);
  renderer.setRenderTarget(null);
  camera.clearViewOffset();
  target.dispose();
  material.dispose();
  return pixel[3] === 1 ? new Vector3(pixel[0], pixel[1], pixel[2]) : null;
}
