// Clipping plane: hides everything above a height. Runs inside the viewer iframe.
//
// The server sets the height as the position of a scene node of this client. Clipping is done by three.js
// (`renderer.clippingPlanes`), and hits of the raycaster above the plane are dropped, so that the mouse reaches what
// is visible below. Shadows are clipped by planes of materials only, so that all materials have the plane, too.

const NODE = "/clipping_plane";
const INTERVAL_MS = 100;
let height = null; // [m]; null while nothing is clipped
let planes = []; // those of the renderer
let patchedRaycaster = null;

function requestedHeight(view) {
  const pose = view.nodePoseData[NODE];
  return pose && view.nodeRefFromName[NODE] ? pose.position[2] : null;
}

function fiberState(view) {
  return view.scene?.__r3f?.root?.getState();
}

function isCulled(object) {
  for (let node = object; node; node = node.parent) if (node.userData.isCulled) return true;
  return false;
}

// Drops intersections with clipped and culled geometry. The y axis of the three.js scene is the z axis of the world.
function patchRaycaster(raycaster) {
  if (raycaster === patchedRaycaster) return;
  for (const name of ["intersectObject", "intersectObjects"]) {
    const intersect = raycaster[name].bind(raycaster);
    raycaster[name] = (...args) => {
      const hits = intersect(...args);
      const visible = hits.filter((hit) => (height === null || hit.point.y <= height) && !isCulled(hit.object));
      if (visible.length < hits.length) hits.splice(0, hits.length, ...visible);
      return hits;
    };
  }
  patchedRaycaster = raycaster;
}

function plane(constant) {
  return { normal: { x: 0, y: -1, z: 0 }, constant, clone: () => plane(constant) }; // materials are cloned with theirs
}

// Gives the planes to materials, also of meshes that have arrived since; returns whether any had others.
function clipShadows(scene) {
  const wanted = planes.length ? planes : null;
  let changed = false;
  scene.traverse(({ isMesh, material }) => {
    if (!isMesh || !material) return;
    for (const each of Array.isArray(material) ? material : [material]) {
      if (each.isShaderMaterial || each.clippingPlanes === wanted) continue;
      Object.assign(each, { clippingPlanes: wanted, clipShadows: wanted !== null });
      changed = true;
    }
  });
  return changed;
}

function update() {
  const view = window.__viserMutable;
  const state = view && fiberState(view);
  if (state) {
    patchRaycaster(state.raycaster);
    const requested = requestedHeight(view);
    if (requested !== height) {
      height = requested;
      planes = height === null ? [] : [plane(height)];
      state.gl.clippingPlanes = planes;
      state.gl.localClippingEnabled = height !== null;
      view.requestRender();
    }
    if (clipShadows(view.scene)) for (const callback of window.mindstageHooks.changeCallbacks) callback();
  }
  setTimeout(update, INTERVAL_MS);
}

update();
