// Shadow bias: prevents shadow acne on thin panels. Runs inside the viewer iframe.
//
// A texel of the directional light's shadow map covers some centimeters, more than the thickness of many panels, so
// that they would shade themselves in stripes. `normalBias` moves the sampled point off the surface.

const NORMAL_BIAS_M = 0.03;
const INTERVAL_MS = 500; // lights may be created or replaced at any time

function applyBias() {
  const view = window.__viserMutable;
  let changed = false;
  view?.scene?.traverse((node) => {
    if (node.isDirectionalLight && node.castShadow && node.shadow.normalBias !== NORMAL_BIAS_M) {
      node.shadow.normalBias = NORMAL_BIAS_M;
      changed = true;
    }
  });
  if (changed) view.requestRender();
  setTimeout(applyBias, INTERVAL_MS);
}

applyBias();
