// Quality of the 3D view: plain lights, or an environment light, tone mapping and soft shadows. Runs inside the viewer
// iframe.
//
// An environment light makes a frame 30 times slower without a GPU. The renderer that the browser reports therefore
// decides, unless the user has chosen: `mindstage.quality` in localStorage is "automatic", "plain" or "high".
//
// The bundle of viser exports no class of three.js; classes are taken from objects that exist in the scene.

import { buildOcclusion } from "./ambientOcclusion.js";
import { applyTexture } from "./textures.js";
import { beforeFrames, fiberState, viewReady } from "./viewData.js";

const STORAGE_KEY = "mindstage.quality";
const BEFORE_RENDERING = -3;
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render|virgl/i;
const [SUN, SKY] = ["/sun", "/sky"]; // nodes of mindstage/viewer/scene.py
const PLAIN_METALNESS = 0.3; // factor in mindstage/rendering/appearance.py: without an environment, metal would be black
const PLAIN = { toneMapping: 4 /* ACES */, exposure: 1, environment: 0, sky: 1, sun: 1, shadowPixels: 1024, shadowRadius: 1 };
const HIGH = { toneMapping: 7 /* Khronos PBR neutral */, exposure: 0.8, environment: 0.52, sky: 0, sun: 1.45, shadowPixels: 2048, shadowRadius: 3.5 };
const [ENVIRONMENT_WIDTH, ENVIRONMENT_HEIGHT] = [128, 64];
// Lights of the environment: azimuth from the sun, elevation and half extents [rad], and color.
const SOFT_BOXES = [
  { azimuth: 0, elevation: 0.75, width: 0.55, height: 0.35, color: [7, 6.7, 6.2] },
  { azimuth: 2.2, elevation: 0.5, width: 0.3, height: 0.45, color: [2.6, 2.8, 3.1] },
  { azimuth: -2.0, elevation: 0.35, width: 0.25, height: 0.5, color: [2.2, 2.3, 2.5] },
];

// -- which quality --------------------------------------------------------------------------------------------------

export function rendererName(gl) {
  const context = gl.getContext();
  const info = context.getExtension("WEBGL_debug_renderer_info");
  return String(context.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : context.RENDERER));
}

function storedChoice() {
  try {
    return localStorage.getItem(STORAGE_KEY) ?? "automatic";
  } catch {
    return "automatic"; // the browser blocks storage
  }
}

export function qualityFor(choice, renderer) {
  if (choice === "plain" || choice === "high") return choice;
  return SOFTWARE.test(renderer) ? "plain" : "high";
}

// -- environment light ----------------------------------------------------------------------------------------------

// The bits of a number as a 16-bit float; negative numbers and those below 6e-5 become 0.
function toHalf(value) {
  if (value < 6.2e-5) return 0;
  const exponent = Math.floor(Math.log2(value));
  return ((exponent + 15) << 10) | Math.round((value / 2 ** exponent - 1) * 1023);
}

const smooth = (low, high, x) => {
  const part = Math.min(Math.max((x - low) / (high - low), 0), 1);
  return part * part * (3 - 2 * part);
};

// Radiance of a bright room: a white ceiling, lighter walls than floor, and windows as soft boxes.
function radiance(azimuth, elevation) {
  const up = Math.sin(elevation);
  const floor = [0.42, 0.4, 0.37];
  const wall = [0.8, 0.8, 0.81];
  const ceiling = [1.12, 1.13, 1.15];
  const aboveFloor = smooth(-0.35, 0.05, up);
  const aboveWall = smooth(0.1, 0.75, up);
  const color = floor.map((part, channel) => (part + (wall[channel] - part) * aboveFloor) * (1 - aboveWall) + ceiling[channel] * aboveWall);
  for (const box of SOFT_BOXES) {
    const aside = Math.abs(Math.atan2(Math.sin(azimuth - box.azimuth), Math.cos(azimuth - box.azimuth)));
    const weight = smooth(1.25, 0.8, aside / box.width) * smooth(1.25, 0.8, Math.abs(elevation - box.elevation) / box.height);
    for (let channel = 0; channel < 3; channel++) color[channel] += weight * box.color[channel];
  }
  return color;
}

function environmentTexture(Texture) {
  const data = new Uint16Array(4 * ENVIRONMENT_WIDTH * ENVIRONMENT_HEIGHT);
  for (let row = 0; row < ENVIRONMENT_HEIGHT; row++) {
    for (let column = 0; column < ENVIRONMENT_WIDTH; column++) {
      const azimuth = ((column + 0.5) / ENVIRONMENT_WIDTH - 0.5) * 2 * Math.PI;
      const color = radiance(azimuth, ((row + 0.5) / ENVIRONMENT_HEIGHT - 0.5) * Math.PI);
      data.set([...color.map(toHalf), toHalf(1)], 4 * (row * ENVIRONMENT_WIDTH + column));
    }
  }
  const texture = new Texture();
  Object.assign(texture, {
    isDataTexture: true,
    image: { data, width: ENVIRONMENT_WIDTH, height: ENVIRONMENT_HEIGHT },
    mapping: 303, // EquirectangularReflectionMapping
    type: 1016, // HalfFloatType
    format: 1023, // RGBAFormat
    minFilter: 1006, // LinearFilter
    magFilter: 1006,
    generateMipmaps: false,
    flipY: false,
    unpackAlignment: 1,
  });
  texture.needsUpdate = true;
  return texture;
}

// -- applying -------------------------------------------------------------------------------------------------------

class Quality {
  #view;
  #gl;
  #environment = null;
  #occlusion = null;
  #applied = null;
  #lastCount = -1;

  constructor(view) {
    this.#view = view;
    this.#gl = fiberState(view).gl;
    this.renderer = rendererName(this.#gl);
    this.isSoftware = SOFTWARE.test(this.renderer);
    this.choice = storedChoice();
    addEventListener("storage", ({ key }) => key === STORAGE_KEY && this.update()); // another page or tab
    beforeFrames(view, BEFORE_RENDERING, () => this.#refresh());
  }

  get name() {
    return qualityFor(this.choice, this.renderer);
  }

  // For people, such as "plain quality (chosen automatically), SwiftShader".
  get description() {
    return `${this.name} quality (${this.choice === "automatic" ? "chosen automatically" : "chosen in the View menu"}), ${this.renderer}`;
  }

  // Reads the user's choice again; the page calls this after it has stored it.
  update() {
    this.choice = storedChoice();
    this.#applied = null;
    this.#view.requestRender();
  }

  #refresh() {
    const { scene, nodeRefFromName } = this.#view;
    const isHigh = this.name === "high";
    const settings = isHigh ? HIGH : PLAIN;
    if (!nodeRefFromName[SKY] || !this.#view.backgroundMaterial?.uniforms.colorMap.value) return; // not yet received
    // Lights and meshes arrive at any time. viser sets the intensity of lights anew only if the server changes it.
    this.#applyLights(settings);
    if (this.#applied !== this.name) {
      this.#applied = this.name;
      this.#gl.toneMapping = settings.toneMapping;
      this.#gl.toneMappingExposure = settings.exposure;
      this.#environment ??= isHigh ? environmentTexture(this.#textureClass()) : null;
      scene.environment = isHigh ? this.#environment : null;
      scene.environmentIntensity = settings.environment;
      this.#lastCount = -1;
    }
    this.#turnEnvironment();
    this.#applyMaterials(isHigh);
    this.#occlusion ??= isHigh ? buildOcclusion(this.#view, this.#gl) : null;
    if (this.#occlusion) this.#occlusion.enabled = isHigh;
  }

  #textureClass() {
    return this.#view.backgroundMaterial.uniforms.colorMap.value.constructor;
  }

  #applyLights(settings) {
    const sky = this.#view.nodeRefFromName[SKY];
    sky.userData.given ??= sky.intensity;
    sky.intensity = settings.sky * sky.userData.given;
    for (const light of this.#view.scene.children) {
      if (!light.isDirectionalLight || !light.castShadow) continue;
      light.userData.given ??= light.intensity;
      light.intensity = settings.sun * light.userData.given * (light.userData.share ?? 1); // see sunShadow.js
      light.shadow.radius = settings.shadowRadius;
      if (light.shadow.mapSize.x !== settings.shadowPixels) {
        light.shadow.mapSize.set(settings.shadowPixels, settings.shadowPixels);
        light.shadow.map?.dispose();
        light.shadow.map = null;
        light.shadow.needsUpdate = true;
      }
    }
  }

  // The brightest soft box is in the direction of the sun.
  #turnEnvironment() {
    const pose = this.#view.nodePoseData[SUN];
    const root = this.#view.nodeRefFromName[""];
    if (!pose || !root) return;
    const direction = this.#view.camera.position.clone().fromArray(pose.position).applyQuaternion(root.quaternion);
    this.#view.scene.environmentRotation.y = -Math.atan2(direction.z, direction.x);
  }

  #applyMaterials(isHigh) {
    const count = Object.keys(this.#view.nodeRefFromName).length + this.#gl.info.memory.geometries;
    if (count === this.#lastCount) return; // nothing has been added or removed
    this.#lastCount = count;
    this.#view.scene.traverse((node) => {
      for (const material of node.isMesh ? [node.material].flat() : []) {
        if (!material.isMeshStandardMaterial) continue;
        material.userData.plainMetalness ??= material.metalness;
        applyTexture(material, { isHigh, Texture: this.#textureClass(), anisotropy: isHigh ? 8 : 1, onLoad: () => this.#view.requestRender() });
        material.metalness = isHigh ? Math.min(1, material.userData.plainMetalness / PLAIN_METALNESS) : material.userData.plainMetalness;
      }
    });
  }
}

viewReady.then((view) => {
  const quality = new Quality(view);
  window.mindstageView = { ...window.mindstageView, quality };
});

