// Ambient occlusion: darkens corners and where things stand on others. Used inside the viewer iframe.
//
// After each frame the depth of the scene is drawn once more at half the resolution; from it the share of directions is
// estimated from which light is blocked nearby, and the frame is multiplied with it. viser renders to the canvas itself,
// so that the frame cannot be composed in a buffer.

const SCALE = 0.5;
const RADIUS_M = 0.2;
const STRENGTH = 0.8;

const VERTEX_SHADER = `
varying vec2 vUv;
void main() {
  vUv = uv;
  gl_Position = vec4(position.xy, 0.0, 1.0);
}`;

// Samples on a spiral around each pixel; its normal is that of the depth buffer.
const OCCLUSION_SHADER = `
precision highp float;
varying vec2 vUv;
uniform sampler2D depthMap;
uniform mat4 unproject;
uniform vec2 scale; // of the projection
uniform float isReversed;
uniform vec2 texel;

const int SAMPLES = 14;

vec3 viewPosition(vec2 at) {
  float depth = texture2D(depthMap, at).r;
  vec4 position = unproject * vec4(2.0 * at - 1.0, isReversed > 0.5 ? depth : 2.0 * depth - 1.0, 1.0);
  return position.xyz / position.w;
}

void main() {
  float depth = texture2D(depthMap, vUv).r;
  if (isReversed > 0.5 ? depth <= 0.0 : depth >= 1.0) {
    gl_FragColor = vec4(1.0);
    return;
  }
  vec3 center = viewPosition(vUv);
  vec3 left = center - viewPosition(vUv - vec2(texel.x, 0.0));
  vec3 right = viewPosition(vUv + vec2(texel.x, 0.0)) - center;
  vec3 below = center - viewPosition(vUv - vec2(0.0, texel.y));
  vec3 above = viewPosition(vUv + vec2(0.0, texel.y)) - center;
  vec3 normal = normalize(cross(abs(left.z) < abs(right.z) ? left : right, abs(below.z) < abs(above.z) ? below : above));
  float turn = 6.2832 * fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
  float blocked = 0.0;
  for (int i = 0; i < SAMPLES; i++) {
    float part = (float(i) + 0.5) / float(SAMPLES);
    float angle = turn + 2.39996 * float(i);
    vec2 offset = ${RADIUS_M.toFixed(2)} * sqrt(part) * vec2(cos(angle), sin(angle)) * scale * 0.5 / -center.z;
    vec3 toward = viewPosition(vUv + offset) - center;
    float distance2 = dot(toward, toward);
    float cosine = dot(toward, normal) * inversesqrt(distance2 + 1e-6);
    float near = max(0.0, 1.0 - distance2 / ${(RADIUS_M * RADIUS_M).toFixed(4)});
    blocked += max(0.0, cosine - 0.12) * near;
  }
  gl_FragColor = vec4(vec3(clamp(1.0 - ${STRENGTH.toFixed(2)} * 2.4 * blocked / float(SAMPLES), 0.0, 1.0)), 1.0);
}`;

// The mean of 4 x 4 samples, which removes the pattern of the turned spirals.
const BLUR_SHADER = `
precision highp float;
varying vec2 vUv;
uniform sampler2D occlusionMap;
uniform vec2 texel;
void main() {
  float sum = 0.0;
  for (int x = 0; x < 4; x++) for (int y = 0; y < 4; y++) sum += texture2D(occlusionMap, vUv + (vec2(x, y) - 1.5) * texel).r;
  gl_FragColor = vec4(vec3(sum / 16.0), 1.0);
}`;

// Returns an object with the flag `enabled`, or null until the renderer has drawn a shadow, from which the class of
// render targets is taken.
export function buildOcclusion(view, gl) {
  const light = view.scene.children.find((each) => each.isDirectionalLight && each.shadow?.map?.depthTexture);
  const background = view.backgroundMaterial;
  const quad = view.scene.children.find((each) => each.material === background) ?? findMesh(view.scene, background);
  if (!light || !quad) return null;
  const RenderTarget = light.shadow.map.constructor;
  const DepthTexture = light.shadow.map.depthTexture.constructor;
  const Material = background.constructor;
  const [Mesh, Geometry, Vector2] = [quad.constructor, quad.geometry.constructor, light.shadow.mapSize.constructor];
  const Scene = view.scene.constructor;
  const Camera = light.shadow.camera.constructor;

  const depthTarget = new RenderTarget(1, 1, { depthTexture: new DepthTexture(1, 1, 1015 /* FloatType */) });
  const occlusionTarget = new RenderTarget(1, 1, { depthBuffer: false });
  const uniforms = { depthMap: { value: depthTarget.depthTexture }, occlusionMap: { value: occlusionTarget.texture }, unproject: { value: view.camera.projectionMatrixInverse.clone() },
    scale: { value: new Vector2() }, isReversed: { value: Number(gl.capabilities.reversedDepthBuffer) }, texel: { value: new Vector2() } };
  const pass = (fragmentShader, options) => {
    const scene = new Scene();
    const mesh = new Mesh(new Geometry(2, 2), new Material({ vertexShader: VERTEX_SHADER, fragmentShader, uniforms, depthTest: false, depthWrite: false, toneMapped: false, ...options }));
    mesh.frustumCulled = false;
    scene.add(mesh);
    return scene;
  };
  const occlusionPass = pass(OCCLUSION_SHADER);
  const blurPass = pass(BLUR_SHADER, { transparent: true, blending: 4 /* MultiplyBlending */, premultipliedAlpha: true });
  const still = new Camera();
  const state = { enabled: true };
  const render = gl.render;
  const size = new Vector2();

  function resize() {
    gl.getDrawingBufferSize(size).multiplyScalar(SCALE).floor();
    if (depthTarget.width !== size.x || depthTarget.height !== size.y) {
      depthTarget.setSize(size.x, size.y);
      occlusionTarget.setSize(size.x, size.y);
      uniforms.texel.value.set(1 / size.x, 1 / size.y);
    }
  }

  gl.render = (scene, camera) => {
    render.call(gl, scene, camera);
    if (!state.enabled || scene !== view.scene || gl.getRenderTarget() !== null || !camera.isPerspectiveCamera) return;
    resize();
    const kept = { autoClear: gl.autoClear, shadows: gl.shadowMap.autoUpdate, clipping: gl.clippingPlanes };
    uniforms.unproject.value.copy(camera.projectionMatrixInverse);
    uniforms.scale.value.set(camera.projectionMatrix.elements[0], camera.projectionMatrix.elements[5]);
    gl.shadowMap.autoUpdate = false;
    gl.setRenderTarget(depthTarget);
    render.call(gl, scene, camera);
    gl.clippingPlanes = [];
    gl.setRenderTarget(occlusionTarget);
    render.call(gl, occlusionPass, still);
    gl.setRenderTarget(null);
    gl.autoClear = false;
    render.call(gl, blurPass, still);
    Object.assign(gl, { autoClear: kept.autoClear, clippingPlanes: kept.clipping });
    gl.shadowMap.autoUpdate = kept.shadows;
  };
  return state;
}

function findMesh(scene, material) {
  let found = null;
  scene.traverse((node) => {
    if (node.material === material) found = node;
  });
  return found;
}
