// Surroundings of the scene in the theme of the page: background and ground. Runs inside the viewer iframe.
//
// The server sends those of the light theme. The page sets `data-theme` of this document; a view without the page has the
// theme of the system.

import { beforeFrames, viewReady } from "./viewData.js";

const BEFORE_RENDERING = -4;
const ROWS = 256;
const SKY = [[52, 57, 63], [27, 30, 34]]; // at the upper and the lower edge
const GROUND = { light: 0xe5e7e9, dark: 0x23272b };
const SHADOW_OPACITY = { light: 0.3, dark: 0.5 };
const system = matchMedia("(prefers-color-scheme: dark)");

const theme = () => document.documentElement.dataset.theme ?? "light";

function darkSky(Texture) {
  const data = new Uint8Array(4 * ROWS);
  for (let row = 0; row < ROWS; row++) {
    const up = row / (ROWS - 1);
    data.set([...SKY[1].map((low, channel) => Math.round(low + (SKY[0][channel] - low) * up)), 255], 4 * row);
  }
  const texture = new Texture();
  Object.assign(texture, { isDataTexture: true, image: { data, width: 1, height: ROWS }, minFilter: 1006 /* LinearFilter */, magFilter: 1006, generateMipmaps: false, flipY: false, unpackAlignment: 1 });
  texture.needsUpdate = true;
  return texture;
}

viewReady.then((view) => {
  let dark = null; // the texture of the dark sky
  let light = null; // that of the server
  const applySky = (name) => {
    const uniform = view.backgroundMaterial?.uniforms.colorMap;
    if (!uniform?.value) return;
    if (uniform.value !== dark) light = uniform.value;
    if (name === "dark") uniform.value = dark ??= darkSky(light.constructor);
    else if (uniform.value === dark) uniform.value = light;
  };
  const applyGround = (name) => {
    view.nodeRefFromName["/ground"]?.traverse((node) => {
      if (!node.isMesh || !node.material.uniforms?.planeColor) return;
      node.material.uniforms.planeColor.value.set(GROUND[name]);
      node.material.uniforms.shadowOpacity.value = SHADOW_OPACITY[name];
    });
  };
  beforeFrames(view, BEFORE_RENDERING, () => {
    applySky(theme());
    applyGround(theme());
  });
  const follow = () => {
    document.documentElement.dataset.theme = system.matches ? "dark" : "light";
  };
  if (parent === window) {
    follow();
    system.addEventListener("change", follow);
  }
  new MutationObserver(() => view.requestRender()).observe(document.documentElement, { attributeFilter: ["data-theme"] });
});
