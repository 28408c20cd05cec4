// Hooks into viser's page: access to its view, data of Mindstage in its messages, and its console output. This script is
// part of the page itself and not a module, because it must run before viser does, however slow the connection is; the
// modules use it by viewData.js.

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

  let resolveView;
  const viewReady = new Promise((resolve) => {
    resolveView = resolve;
  });

  function attach(view) {
    // viser takes each batch out of its queue with `splice` before it handles it.
    view.messageQueue.splice = (...range) => {
      if (view.firstMessageBatch) {
        waiting.clear();
        for (const callback of resetCallbacks) callback();
      }
      const messages = Array.prototype.splice.apply(view.messageQueue, range);
      if (messages.some(({ type }) => !type.includes("Camera"))) for (const callback of changeCallbacks) callback();
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
    set: (view) => {
      Object.defineProperty(window, "__viserMutable", { configurable: true, writable: true, value: view });
      attach(view);
    },
  });

  window.mindstageHooks = { beforeFrames, changeCallbacks, handlers, replayCallbacks, resetCallbacks, viewReady };
}
