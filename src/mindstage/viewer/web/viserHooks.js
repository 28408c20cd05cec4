// Hooks into viser's page: access to its view, data of Mindstage in its messages, its console output, a defect of it, and
// the notice of a view that has stopped. This script is part of the page itself and not a module, because it must run
// before viser does, however slow the connection is; the modules use it by viewData.js.

{
  // -- console ------------------------------------------------------------------------------------------------------
  // Known output of viser that would cover messages that matter; its causes are inside of viser's bundle, and anything
  // else is written. react-three-fiber 9 creates a THREE.Clock, which three.js has deprecated; shaders are compiled one by
  // one without a GPU; and the view reports its camera before its websocket is open, and again afterwards. Of other
  // messages that were not sent, such as a click, the warning is kept.
  const known = [/^THREE\.Clock: This module has been deprecated/, /^THREE\.WebGLRenderer: KHR_parallel_shader_compile/, /^Tried to send ViewerCameraMessage but websocket is not connected!$/];
  for (const level of ["log", "warn"]) {
    const write = console[level];
    console[level] = (...values) => known.some((each) => each.test(String(values[0]))) || write.apply(console, values);
  }

  // viser calls `preventDefault` for a press on a body that can be dragged, in a passive listener, where it has no effect
  // but an error in the console.
  window.addEventListener("pointerdown", (event) => {
    if (event.target instanceof HTMLCanvasElement) event.preventDefault = () => {};
  }, true);

  // -- frames -------------------------------------------------------------------------------------------------------
  // Besides the frames that changes request, viser draws one each second. Without a GPU a frame of a whole room takes
  // most of a second, and an idle page would take a processor core; one frame in 30 is left then.
  const HEARTBEAT_MS = 1000;
  const HEARTBEAT = /^\(\)\s*=>\s*[\w$]+\(\)$/;
  const SPARED_FRAMES = 29;
  const setPageInterval = window.setInterval;
  window.setInterval = (callback, delay, ...values) => {
    if (delay !== HEARTBEAT_MS || !HEARTBEAT.test(String(callback))) return setPageInterval(callback, delay, ...values);
    let spared = 0;
    return setPageInterval(() => {
      spared = window.mindstageView?.quality?.isSoftware && spared < SPARED_FRAMES ? spared + 1 : 0;
      if (spared === 0) callback();
    }, delay);
  };

  // -- data of Mindstage --------------------------------------------------------------------------------------------
  // Updates of scene nodes below "/mindstage/", see mindstage/viewer/view_data.py. They are taken out of the messages, so
  // that neither viser's store nor React handles them, and wait until the other messages of their batch are handled:
  // poses must not be set before a node is replaced.
  const PREFIX = "/mindstage/";
  const AFTER_MESSAGES = -50_000; // priority in a frame: viser handles messages at -100,000 and sets poses at -1,000
  const handlers = new Map();
  const resetCallbacks = [];
  const changeCallbacks = [];
  const replayCallbacks = [];
  const waiting = new Map();

  function receive(message) {
    if (message.type !== "SceneNodeUpdateMessage" || !message.name.startsWith(PREFIX)) return true;
    const name = message.name.slice(PREFIX.length);
    waiting.set(name, { ...waiting.get(name), ...message.updates });
    return false;
  }

  function deliver() {
    for (const [name, values] of waiting) {
      const [topic, ...rest] = name.split("/");
      if (!handlers.has(topic)) continue; // its module is not loaded yet
      waiting.delete(name);
      handlers.get(topic)(rest.join("/"), values);
    }
  }

  // Calls a function before each frame is rendered.
  function beforeFrames(view, priority, callback) {
    const store = view.scene.__r3f.root;
    store.getState().internal.subscribe({ current: callback }, priority, store);
  }

  // -- bounds of copied geometries ----------------------------------------------------------------------------------
  // An effect of viser 1.1 (src/mesh/BatchedMeshBase.tsx) reads `mesh.geometry.boundingSphere.radius` of the copy that it
  // has made of a batch's geometry. A geometry of several materials has no bounding sphere before its first frame; if the
  // effect runs before that, which it does on a slow or busy machine, it throws, and React removes the whole view. A copy
  // therefore always has one. To be removed with the first version of viser whose effect computes it.
  function boundCopies(view) {
    let geometry = null;
    view.scene.traverse((node) => {
      geometry ??= node.geometry ?? null;
    });
    if (!geometry) throw new Error("the view has no geometry yet: viser has changed its background, which this script relies on");
    let prototype = geometry; // in the end that of THREE.BufferGeometry
    while (Object.getPrototypeOf(prototype).computeBoundingSphere) prototype = Object.getPrototypeOf(prototype);
    const copy = prototype.copy;
    prototype.copy = function (source) {
      copy.call(this, source);
      if (this.boundingSphere === null && this.attributes.position) this.computeBoundingSphere();
      return this;
    };
  }

  // -- a view that has stopped --------------------------------------------------------------------------------------
  // After an error in a script or the loss of the GPU's context, a view that still draws needs no notice: it is asked for
  // a frame, and has stopped if it draws none. Time counts only while the tab is visible, since hidden ones draw nothing.
  const CHECK_MS = 500;
  const MAX_SILENT_CHECKS = 8;
  const STUCK_CHECKS = 60;
  let suspicion = null; // the cause, the frames that were drawn before it, and the checks since
  let view = null;
  let stuck = { missing: 0, count: 0, checks: 0 };
  const notice = document.createElement("div");
  notice.className = "mindstage-stopped";
  notice.setAttribute("role", "alert");
  notice.hidden = true;

  const drawnFrames = () => view?.scene?.__r3f?.root?.getState().gl.info.render.frame ?? 0;

  function suspect(cause) {
    suspicion ??= { cause, frames: drawnFrames(), checks: 0 };
  }

  function showNotice(text) {
    if (!notice.hidden) return;
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = "Reload the view";
    button.addEventListener("click", () => location.reload());
    const message = document.createElement("p");
    message.textContent = text;
    notice.replaceChildren(message, button);
    notice.hidden = false;
    document.body.append(notice);
  }

  window.addEventListener("error", ({ message }) => message && suspect(message));
  window.addEventListener("unhandledrejection", ({ reason }) => suspect(String(reason?.message ?? reason)));
  window.addEventListener("webglcontextlost", () => suspect("the graphics context was lost"), true);
  setPageInterval(() => {
    if (document.visibilityState !== "visible") return;
    if (stuck.missing && ++stuck.checks > STUCK_CHECKS) showNotice(`Loading has stopped: ${stuck.count - stuck.missing} of ${stuck.count} bodies have their shapes.`);
    if (!suspicion) return;
    if (drawnFrames() > suspicion.frames) {
      suspicion = null;
      notice.hidden = true;
      return;
    }
    view?.requestRender();
    if (++suspicion.checks >= MAX_SILENT_CHECKS) showNotice(`The 3D view has stopped: ${suspicion.cause}`);
  }, CHECK_MS);

  // Reports how many bodies lack a mesh; without progress, and without messages that may bring them, the view is stuck.
  function reportMissing(missing, count) {
    if (missing === stuck.missing) return;
    if (stuck.checks > STUCK_CHECKS) notice.hidden = true;
    stuck = { missing, count, checks: 0 };
  }

  let resolveView;
  const viewReady = new Promise((resolve) => {
    resolveView = resolve;
  });

  function attach(attached) {
    view = attached;
    let isBounded = false;
    let isReplayed = false;
    // viser takes each batch out of its queue with `splice` before it handles it.
    view.messageQueue.splice = (...range) => {
      if (!isBounded) boundCopies(view);
      isBounded = true;
      if (view.firstMessageBatch) {
        isReplayed = false;
        waiting.clear();
        for (const callback of resetCallbacks) callback();
      }
      const messages = Array.prototype.splice.apply(view.messageQueue, range);
      if (messages.length && !isReplayed) stuck.checks = 0;
      if (messages.some(({ type }) => !type.includes("Camera"))) for (const callback of changeCallbacks) callback();
      isReplayed ||= messages.some(({ type }) => type === "ReplayDoneMessage");
      if (messages.some(({ type }) => type === "ReplayDoneMessage")) for (const callback of replayCallbacks) callback();
      return messages.filter(receive);
    };
    beforeFrames(view, AFTER_MESSAGES, deliver);
    resolveView(view);
  }

  // viser assigns its state when its canvas is mounted, before it handles the first message. The property is replaced by
  // a plain one, which viser deletes when the canvas is removed.
  Object.defineProperty(window, "__viserMutable", {
    configurable: true,
    get: () => undefined,
    set: (mutable) => {
      Object.defineProperty(window, "__viserMutable", { configurable: true, writable: true, value: mutable });
      attach(mutable);
    },
  });

  window.mindstageHooks = { beforeFrames, changeCallbacks, handlers, replayCallbacks, reportMissing, resetCallbacks, viewReady };
}
