// Access to viser's view and to data from the server, for the modules inside the viewer iframe; see viserHooks.js.

const { beforeFrames, changeCallbacks, handlers, replayCallbacks, reportMissing, resetCallbacks, viewReady } = window.mindstageHooks;

// `viewReady` is a promise of the mutable state of viser's page (`ViewerMutable` in viser's client).
// `beforeFrames(view, priority, callback)` calls a function before each frame; viser sets poses at priority -1,000.
// `reportMissing(missing, count)` says how many bodies have no mesh yet.
export { beforeFrames, reportMissing, viewReady };

// Calls `handler(key, values)` for each message of a topic: of "poses/3" the topic is "poses" and the key "3".
export function onViewData(topic, handler) {
  handlers.set(topic, handler);
}

// Calls a function when a new connection begins, which sends all data again.
export function onNewConnection(callback) {
  resetCallbacks.push(callback);
}

// Calls a function when messages arrive that may change the scene, all but those of the camera.
export function onSceneChange(callback) {
  changeCallbacks.push(callback);
}

// Calls a function when all messages have arrived that the server had when the connection began.
export function onReplayDone(callback) {
  replayCallbacks.push(callback);
}

// The state of react-three-fiber: renderer, camera, raycaster.
export function fiberState(view) {
  return view.scene?.__r3f?.root?.getState();
}

// The three.js class of geometries of any shape, which the class of a plane is derived from.
export function geometryClass(geometry) {
  let found = geometry.constructor;
  while (Object.getPrototypeOf(found).prototype?.isBufferGeometry) found = Object.getPrototypeOf(found);
  return found;
}
