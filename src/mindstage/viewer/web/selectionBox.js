// Selection box: draws the boxes of selected bodies faintly through what is in front. Runs inside the viewer iframe.
//
// The server sends the same lines as two scene nodes. The second one is drawn without a depth test here, which viser
// offers for gizmos and labels only.

import { beforeFrames, viewReady } from "./viewData.js";

const BEHIND = "/selected_behind";
const OPACITY = 0.4;
const BEFORE_RENDERING = -2;

viewReady.then((view) => {
  beforeFrames(view, BEFORE_RENDERING, () => {
    view.nodeRefFromName[BEHIND]?.traverse((node) => {
      if (!node.isMesh || !node.material.depthTest) return;
      Object.assign(node.material, { depthTest: false, depthWrite: false, transparent: true, opacity: OPACITY });
      node.renderOrder = 1000;
    });
  });
});
