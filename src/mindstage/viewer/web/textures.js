// Procedural textures of materials: each image is fetched once and shared by all bodies. Used inside the viewer iframe.
//
// The name of a material with a texture is "texture:" and the address of the color image, see
// mindstage/rendering/appearance.py. That image is used in any quality, roughness and normals only in the high one.

const PREFIX = "texture:";
const REPEAT = 1000; // RepeatWrapping
const SLOTS = { map: "color", roughnessMap: "roughness", normalMap: "normal" };
const loaded = new Map();
let pending = 0;
window.mindstageView = { ...window.mindstageView, pendingTextures: () => pending };

const RETRY_DELAYS_MS = [500, 2000, 8000]; // a busy server may refuse a connection

// The texture at an address, or null if it cannot be loaded, which is reported once.
async function loadOrReport(address, kind, options) {
  pending += 1;
  try {
    return await retried(address, kind, options);
  } finally {
    pending -= 1;
  }
}

async function retried(address, kind, options) {
  for (const delay of [...RETRY_DELAYS_MS, null]) {
    try {
      return await load(address, kind, options);
    } catch (error) {
      if (delay === null) console.error(`the texture ${address} could not be loaded: ${error.message}`);
      else await new Promise((done) => setTimeout(done, delay));
    }
  }
  return null;
}

async function load(address, kind, { Texture, anisotropy }) {
  const response = await fetch(address);
  if (!response.ok) throw new Error(`status ${response.status}`);
  const texture = new Texture(await createImageBitmap(await response.blob(), { colorSpaceConversion: "none", premultiplyAlpha: "none" }));
  Object.assign(texture, { wrapS: REPEAT, wrapT: REPEAT, flipY: false, anisotropy, colorSpace: kind === "color" ? "srgb" : "" });
  texture.needsUpdate = true;
  return texture;
}

// Sets the images of a material by its name; those that are not loaded yet follow.
export function applyTexture(material, { isHigh, onLoad, ...options }) {
  if (!material.name.startsWith(PREFIX)) return;
  const color = material.name.slice(PREFIX.length);
  material.userData.hasOwnMap ??= Boolean(material.map); // label art is in the file of the body
  material.userData.isHigh = isHigh;
  for (const [slot, kind] of Object.entries(SLOTS)) {
    if (slot === "map" ? material.userData.hasOwnMap : !isHigh) {
      if (slot !== "map" && material[slot]) {
        material[slot] = null;
        material.needsUpdate = true;
      }
      continue;
    }
    const address = color.replace("-color-", `-${kind}-`);
    if (!loaded.has(address)) loaded.set(address, loadOrReport(address, kind, options));
    loaded.get(address).then((texture) => {
      if (!texture || material[slot] === texture || (slot !== "map" && !material.userData.isHigh)) return;
      material[slot] = texture;
      material.needsUpdate = true;
      onLoad();
    });
  }
}
