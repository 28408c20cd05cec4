// Poses of bodies: sets those of many scene nodes from one array. Runs inside the viewer iframe.
//
// A block has the names of its nodes, "" where there is none, and an array with seven numbers for each: position and
// quaternion (w, x, y, z). viser applies the poses before it renders the next frame.

import { onNewConnection, onViewData, viewReady } from "./viewData.js";

const POSE_LENGTH = 7;
const BODIES = "/bodies/";
const BATCHES = "/batches/";
const blocks = new Map();
const view = { nodePoseData: {} };
viewReady.then(({ nodePoseData, nodeRefFromName }) => Object.assign(view, { nodePoseData, nodeRefFromName }));

// Sets the poses of nodes, which need not exist yet; those without a name are skipped.
export function applyPoses({ names, poses }) {
  if (!names || poses?.length !== names.length * POSE_LENGTH) return; // the other half follows
  for (let row = 0; row < names.length; row++) {
    if (!names[row]) continue;
    const [x, y, z, ...wxyz] = poses.subarray(row * POSE_LENGTH, (row + 1) * POSE_LENGTH);
    const pose = view.nodePoseData[names[row]];
    if (!pose) {
      view.nodePoseData[names[row]] = { position: [x, y, z], wxyz, poseUpdateState: "needsUpdate" };
      continue;
    }
    const isSame = pose.position[0] === x && pose.position[1] === y && pose.position[2] === z && wxyz.every((part, axis) => part === pose.wxyz[axis]);
    if (isSame) continue;
    pose.position = [x, y, z];
    pose.wxyz = wxyz;
    if (pose.poseUpdateState !== "waitForMakeObject") pose.poseUpdateState = "needsUpdate";
  }
}

onNewConnection(() => blocks.clear());
onViewData("poses", (key, values) => {
  const block = { ...blocks.get(key), ...values };
  blocks.set(key, block);
  applyPoses(block);
});

// A batch may have further meshes: outlines under the pointer.
function largestInstanceCount(batch) {
  let largest = 0;
  batch.traverse((mesh) => {
    if (mesh.isMesh) largest = Math.max(largest, mesh.instancesCount ?? mesh.count ?? 0);
  });
  return largest;
}

// The number of bodies whose meshes are drawn, or whose batch is.
function loadedBodies() {
  let count = 0;
  for (const [name, node] of Object.entries(view.nodeRefFromName ?? {})) {
    if (!node) continue;
    if (name.startsWith(BODIES) && name.indexOf("/", BODIES.length) < 0) count += node.children.some((child) => child.children.length) ? 1 : 0;
    else if (name.startsWith(BATCHES) && name.endsWith("/textured")) count += largestInstanceCount(node);
  }
  return count;
}

window.mindstageView = { ...window.mindstageView, loadedBodies };
