/**
 * Points without normals, lit all the same: they are drawn aside, and then put over the picture at
 * their depth, each with the direction that the depths around it say and darker where its neighbors
 * are nearer to the eye (eye-dome lighting; Boucheny, PhD thesis, Grenoble 2009).
 */
import {
  type Camera,
  DepthTexture,
  HalfFloatType,
  Mesh,
  NearestFilter,
  OrthographicCamera,
  type PerspectiveCamera,
  PlaneGeometry,
  Scene,
  ShaderMaterial,
  Vector2,
  type WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import { STUDIO } from "./materials";

const VERTEX = `
  varying vec2 at;
  void main() {
    at = uv;
    gl_Position = vec4(position.xy, 0.0, 1.0);
  }`;
const FRAGMENT = `
  varying vec2 at;
  uniform sampler2D colors;
  uniform sampler2D depths;
  /** One CSS pixel, in shares of the picture. */
  uniform vec2 pixel;
  /** One CSS pixel at distance one, in the camera's units. */
  uniform float spread;
  uniform float near;
  uniform float far;
  uniform bool closed;
  const int TAPS = 8;
  const float STRENGTH = 25.0;
  // Neighbors that differ by more than this share of the distance are another surface.
  const float STEP = 0.01;
  ${STUDIO}

  float distanceAt(vec2 place) {
    return near * far / (far - texture2D(depths, place).x * (far - near));
  }

  vec2 ring(int i, float radius) {
    float angle = 6.2831853 * (float(i) + 0.25) / float(TAPS);
    return radius * vec2(cos(angle), sin(angle));
  }

  // Sums for the plane through the neighbors by least squares.
  float xx = 1e-6, xy = 0.0, yy = 1e-6, xd = 0.0, yd = 0.0;

  void weigh(vec2 offset, float rise, float here) {
    if (abs(rise) > STEP * here) return;
    xx += offset.x * offset.x;
    xy += offset.x * offset.y;
    yy += offset.y * offset.y;
    xd += offset.x * rise;
    yd += offset.y * rise;
  }

  vec3 planeNormal(float here) {
    vec2 slope = vec2(yy * xd - xy * yd, xx * yd - xy * xd) / (xx * yy - xy * xy + 1e-6);
    return normalize(vec3(slope / (spread * here), 1.0));
  }

  void main() {
    vec2 place = at;
    float light = 1.0;
    vec3 normal = vec3(0.0, 0.0, 1.0);
    if (closed) {
      float here = distanceAt(at);
      float least = here;
      float dome = 0.0;
      int before = 0;
      for (int i = 0; i < TAPS; i++) {
        vec2 offset = ring(i, 2.0);
        float there = distanceAt(at + offset * pixel);
        weigh(offset, there - here, here);
        dome += max(0.0, log2(here / there));
        if (there < here * (1.0 - STEP)) before++;
        if (there < least) {
          least = there;
          place = at + offset * pixel;
        }
      }
      // With nearly all neighbors far before it this is a gap, which the nearest of them closes.
      bool gap = before > TAPS - 3;
      if (!gap) place = at;
      if (!gap) light = exp(-STRENGTH * dome / float(TAPS));
      if (gap) here = least;
      for (int i = 0; i < TAPS; i++) {
        vec2 offset = ring(i, 5.0);
        weigh(offset, distanceAt(place + offset * pixel) - here, here);
      }
      normal = planeNormal(here);
    }
    float depth = texture2D(depths, place).x;
    if (depth >= 1.0) discard;
    vec3 color = texture2D(colors, place).rgb;
    if (closed) color *= studio(normal) * light;
    gl_FragColor = vec4(color, 1.0);
    gl_FragDepth = depth;
    #include <colorspace_fragment>
  }`;

export class EyeDome {
  private readonly target = new WebGLRenderTarget(1, 1, {
    type: HalfFloatType,
    minFilter: NearestFilter,
    magFilter: NearestFilter,
    depthTexture: new DepthTexture(1, 1),
  });
  private readonly material = new ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    uniforms: {
      colors: { value: this.target.texture },
      depths: { value: this.target.depthTexture },
      pixel: { value: new Vector2() },
      spread: { value: 0 },
      near: { value: 0 },
      far: { value: 0 },
      closed: { value: false },
    },
  });
  private readonly quad = new Mesh(new PlaneGeometry(2, 2), this.material);
  private readonly flat: Camera = new OrthographicCamera();
  private readonly page = new Scene().add(this.quad);
  private readonly size = new Vector2();

  constructor() {
    this.quad.frustumCulled = false;
  }

  /** Draws the points over what the canvas has. `closed`: they are large enough to be a surface. */
  draw(renderer: WebGLRenderer, points: Scene, camera: PerspectiveCamera, closed: boolean): void {
    renderer.getDrawingBufferSize(this.size);
    this.target.setSize(this.size.x, this.size.y);
    renderer.setRenderTarget(this.target);
    renderer.clear();
    renderer.render(points, camera);
    renderer.setRenderTarget(null);
    const { uniforms } = this.material;
    const ratio = renderer.getPixelRatio();
    (uniforms["pixel"]!.value as Vector2).set(ratio / this.size.x, ratio / this.size.y);
    uniforms["spread"]!.value = (2 * ratio) / (this.size.y * camera.projectionMatrix.elements[5]!);
    uniforms["near"]!.value = camera.near;
    uniforms["far"]!.value = camera.far;
    uniforms["closed"]!.value = closed;
    renderer.autoClear = false;
    renderer.render(this.page, this.flat);
    renderer.autoClear = true;
  }

  dispose(): void {
    this.target.dispose();
    this.target.depthTexture?.dispose();
    this.material.dispose();
    this.quad.geometry.dispose();
  }
}
