// Shadow of the sun: one shadow map over the whole scene, drawn when something has changed. Runs inside the viewer iframe.
//
// viser lights the scene with three directional lights, whose shadow maps follow the camera and are drawn in each frame:
// each mesh is drawn four times, and each pixel shaded by three lights. Here the first light has the intensity of all
// three and a shadow map that does not depend on the camera; the others are off. Of a scene that is larger than the map
// can show, the part in front of the camera has shadows.

import { beforeFrames, onNewConnection, onSceneChange, onViewData, viewReady } from "./viewData.js";

const BEFORE_RENDERING = -3.5; // before renderQuality.js, which sets the intensities
const MAX_RADIUS_M = 14;
const MARGIN_M = 0.3;
const ABOVE_M = 30; // what is so far above the scene casts shadows, too
const AHEAD = 0.7; // of a large scene: distance of the shown part from the camera, relative to its radius
const FOLLOWING = 0.25; // how far that part moves before it is drawn again, relative to its radius
const BIAS_TEXELS = 1.6; // of slopes in the direction of the normal: without it surfaces shade themselves in stripes
const MIN_BIAS_M = 0.006; // thin panels cover fewer texels than their thickness
// Meshes change some time after their message: React updates them in a later frame, and GLB files are decoded first.
const CHANGING_FRAMES = 3;
const CHANGING_MS = 500;

let bounds = null; // {center, radius} in the world frame [m]
let framesLeft = 0;
let changedAt = -Infinity;

function markChanged() {
  framesLeft = CHANGING_FRAMES;
  changedAt = performance.now();
}

onNewConnection(() => {
  bounds = null;
});
onViewData("bounds", (_, { center, radius }) => {
  if (!center) return; // there is no body
  bounds = { center, radius };
  markChanged();
});
onSceneChange(markChanged);

class SunShadow {
  #view;
  #center; // of what the shadow map shows, in the frame of three.js
  #radius = 0;
  #geometries = -1;

  constructor(view) {
    this.#view = view;
    this.#center = view.camera.position.clone();
  }

  update() {
    const lights = this.#view.scene.children.filter((each) => each.isDirectionalLight && each.castShadow);
    const world = this.#view.nodeRefFromName[""]?.matrixWorld;
    if (!lights.length || !bounds || !world) return;
    if (this.#place(world)) markChanged();
    lights.forEach((light, index) => {
      light.visible = index === 0;
      light.userData.share = index === 0 ? lights.length : 0;
    });
    if (!lights[0].userData.hasFixedShadow) {
      lights[0].userData.hasFixedShadow = true;
      this.#takeOver(lights[0]);
      markChanged();
    }
    const { geometries } = this.#view.scene.__r3f.root.getState().gl.info.memory;
    if (geometries !== this.#geometries) markChanged(); // a mesh was loaded or removed
    this.#geometries = geometries;
    if (framesLeft <= 0 && performance.now() - changedAt > CHANGING_MS) return;
    framesLeft -= 1;
    lights[0].shadow.needsUpdate = true;
  }

  // Chooses what the shadow map shows; returns whether that has changed.
  #place(world) {
    const { camera } = this.#view;
    const radius = Math.min(bounds.radius + MARGIN_M, MAX_RADIUS_M);
    const center = camera.position.clone().fromArray(bounds.center).applyMatrix4(world);
    if (bounds.radius + MARGIN_M > MAX_RADIUS_M) {
      const ahead = camera.getWorldDirection(center.clone()).multiplyScalar(AHEAD * radius).add(camera.position);
      ahead.y = center.y;
      center.copy(ahead.sub(center).clampLength(0, bounds.radius).add(center));
      if (radius === this.#radius && center.distanceTo(this.#center) < FOLLOWING * radius) return false;
    }
    if (radius === this.#radius && center.equals(this.#center)) return false;
    this.#radius = radius;
    this.#center.copy(center);
    return true;
  }

  #takeOver(light) {
    const { shadow } = light;
    const updateMatrices = shadow.updateMatrices;
    const stand = { matrixWorld: light.matrixWorld.clone().identity(), target: { matrixWorld: light.matrixWorld.clone().identity() } };
    const toSun = light.position.clone();
    shadow.autoUpdate = false;
    shadow.updateMatrices = (given) => {
      toSun.subVectors(given.position, given.target.position).normalize();
      const distance = this.#radius + ABOVE_M;
      stand.target.matrixWorld.setPosition(this.#center);
      stand.matrixWorld.setPosition(toSun.multiplyScalar(distance).add(this.#center));
      const { camera } = shadow;
      Object.assign(camera, { left: -this.#radius, right: this.#radius, top: this.#radius, bottom: -this.#radius, near: 0.1, far: distance + this.#radius + MARGIN_M });
      camera.updateProjectionMatrix();
      shadow.normalBias = Math.max(MIN_BIAS_M, (BIAS_TEXELS * 2 * this.#radius) / shadow.mapSize.x);
      updateMatrices.call(shadow, stand);
    };
  }
}

viewReady.then((view) => {
  const sunShadow = new SunShadow(view);
  beforeFrames(view, BEFORE_RENDERING, () => sunShadow.update());
});
