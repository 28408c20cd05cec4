// Culling: hides what is mounted on walls that are not drawn from where the camera is. Runs inside the viewer iframe.
//
// The server sends the names of nodes and, of nodes with many instances, which of these; see `MountCulling` in
// mindstage/viewer/client_views.py. viser sets the visibility of each node in each frame, so that it is changed after it.

import { beforeFrames, onNewConnection, onViewData, viewReady } from "./viewData.js";

const AFTER_VISER = -900; // viser sets the visibility of nodes at priority -1,000
const culled = new Map(); // node names and the instances
const touched = new Set(); // node names that were culled before
let requestRender = () => {};

function hideInstances(node, instances) {
  node.traverse((mesh) => {
    if (!mesh.setVisibilityAt) return;
    for (const instance of mesh.userData.culledInstances ?? []) if (!instances.includes(instance) && instance < mesh.instancesCount) mesh.setVisibilityAt(instance, true);
    for (const instance of instances) if (instance < mesh.instancesCount && mesh.getVisibilityAt(instance)) mesh.setVisibilityAt(instance, false);
    mesh.userData.culledInstances = instances;
  });
}

function apply(nodes) {
  for (const name of touched) {
    const node = nodes[name];
    const instances = culled.get(name);
    if (!instances) touched.delete(name);
    if (!node) continue;
    const isWhole = instances?.length === 0;
    node.userData.isCulled = isWhole;
    if (isWhole) node.visible = false;
    else hideInstances(node, instances ?? []);
  }
}

onNewConnection(() => culled.clear());
onViewData("culled", (_, { names, instances }) => {
  culled.clear();
  names.forEach((name, row) => culled.set(name, instances[row]));
  names.forEach((name) => touched.add(name));
  requestRender();
});
viewReady.then((view) => {
  requestRender = () => view.requestRender();
  beforeFrames(view, AFTER_VISER, () => apply(view.nodeRefFromName));
});
