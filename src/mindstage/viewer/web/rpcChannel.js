// RPC over a websocket: requests with responses, and topics that the server publishes; see mindstage/viewer/server.py.

const RESPONSE_TIMEOUT_MS = 90_000;
const RECONNECT_DELAYS_MS = [250, 500, 1000, 2000];
// Requests that are made while there is no connection are sent if it is back within this time, otherwise rejected.
const QUEUE_MS = 4000;
// After so long without a message the page asks for one; a server or network without an answer has stalled.
const PING_AFTER_MS = 5000;
const STALLED_AFTER_MS = 10_000;
const ABANDONED_AFTER_MS = 40_000;
const WATCH_INTERVAL_MS = 1000;
// Requests that take longer are listed in the topic "waiting", oldest first.
const SLOW_MS = 4000;

// Identifies this page to the server; the URL of its 3D view has the same key.
export const clientKey = Array.from(crypto.getRandomValues(new Uint8Array(8)), (byte) => byte.toString(16).padStart(2, "0")).join("");

// An error response: `code` is the name of the error's class on the server, or "Disconnected" or "Timeout".
class RpcError extends Error {
  constructor({ code, message }) {
    super(message);
    this.code = code;
  }
}

class RpcChannel {
  #socket = null;
  #nextId = 1;
  #pending = new Map();
  #listeners = new Map();
  #responseListeners = new Set();
  #latest = new Map();
  #attempts = 0;
  #queue = [];
  #receivedAt = 0;
  #pinging = false;

  constructor() {
    this.#connect();
    setInterval(() => this.#watch(), WATCH_INTERVAL_MS);
  }

  get connected() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  // The methods of the requests that have no response yet, in the order in which they were sent.
  get pendingMethods() {
    return [...this.#pending.values()].map(({ method }) => method);
  }

  // Calls a method of the server. The promise is rejected with an RpcError that has the server's message.
  call(method, params = {}) {
    return new Promise((resolve, reject) => {
      const request = { method, params, resolve, reject, startedAt: Date.now() };
      if (this.connected) this.#send(request);
      else this.#enqueue(request);
    });
  }

  #send(request) {
    const id = this.#nextId++;
    const error = { type: "Timeout", message: `the server did not respond to ${request.method} within ${RESPONSE_TIMEOUT_MS / 1000} s` };
    request.timeout = setTimeout(() => this.#settle(id, { error }), RESPONSE_TIMEOUT_MS);
    this.#pending.set(id, request);
    this.#socket.send(JSON.stringify({ id, method: request.method, params: request.params }));
  }

  #enqueue(request) {
    this.#queue.push(request);
    setTimeout(() => {
      const index = this.#queue.indexOf(request);
      if (index < 0) return;
      this.#queue.splice(index, 1);
      request.reject(new RpcError({ code: "Disconnected", message: `there is no connection to the server: ${request.method} was not sent` }));
    }, QUEUE_MS);
  }

  // Calls a listener with the latest value of a topic, if there is one, and with each later value. Returns a function
  // that removes the listener.
  on(topic, listener) {
    if (!this.#listeners.has(topic)) this.#listeners.set(topic, new Set());
    this.#listeners.get(topic).add(listener);
    if (this.#latest.has(topic)) listener(this.#latest.get(topic));
    return () => this.#listeners.get(topic).delete(listener);
  }

  // Calls a listener with {method, params, result} after each successful request of this page.
  onResponse(listener) {
    this.#responseListeners.add(listener);
  }

  latest(topic) {
    return this.#latest.get(topic);
  }

  #connect() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(`${scheme}//${location.host}/mindstage/channel?client=${clientKey}`);
    this.#socket = socket;
    socket.onopen = () => {
      this.#attempts = 0;
      this.#receivedAt = Date.now();
      this.#emit("connection", true);
      for (const request of this.#queue.splice(0)) this.#send(request);
    };
    socket.onmessage = ({ data }) => {
      this.#receivedAt = Date.now();
      if (this.latest("stalled")) this.#emit("stalled", false);
      this.#receive(JSON.parse(data));
    };
    socket.onclose = () => this.#lost(socket);
  }

  #lost(socket) {
    if (socket !== this.#socket) return; // abandoned before
    this.#socket = null;
    this.#emit("connection", false);
    this.#emit("stalled", false);
    const error = { code: "Disconnected", message: "the connection was lost before the server responded" };
    for (const id of [...this.#pending.keys()]) this.#settle(id, { error });
    const delay = RECONNECT_DELAYS_MS[Math.min(this.#attempts++, RECONNECT_DELAYS_MS.length - 1)];
    setTimeout(() => this.#connect(), delay);
  }

  // Detects a connection that is open but dead, for example of a phone that has left its network, and lists slow requests.
  #watch() {
    const slow = [...this.#pending.values()].filter(({ method, startedAt }) => method !== "ping" && Date.now() - startedAt >= SLOW_MS);
    if (slow.length || this.latest("waiting")?.length) {
      this.#emit("waiting", slow.map(({ method, startedAt }) => ({ method, seconds: Math.floor((Date.now() - startedAt) / 1000) })));
    }
    if (!this.connected || document.hidden) {
      this.#receivedAt = Date.now(); // timers of hidden pages are slowed down
      return;
    }
    const silent_ms = Date.now() - this.#receivedAt;
    if (silent_ms > ABANDONED_AFTER_MS) {
      const socket = this.#socket;
      socket.close();
      this.#lost(socket); // the close event of a dead connection may come minutes later
    } else if (silent_ms > STALLED_AFTER_MS) {
      if (!this.latest("stalled")) this.#emit("stalled", true);
    } else if (silent_ms > PING_AFTER_MS && !this.#pinging) {
      this.#pinging = true;
      this.call("ping").catch(() => {}).finally(() => {
        this.#pinging = false;
      });
    }
  }

  #receive(message) {
    if (message.topic !== undefined) this.#emit(message.topic, message.value);
    else if (message.id !== null) this.#settle(message.id, message);
    else this.#emit("error", message.error);
  }

  #settle(id, { result, error }) {
    const request = this.#pending.get(id);
    if (!request) return;
    this.#pending.delete(id);
    clearTimeout(request.timeout);
    if (error) {
      request.reject(new RpcError(error));
      return;
    }
    request.resolve(result);
    for (const listener of this.#responseListeners) listener({ method: request.method, params: request.params, result });
  }

  #emit(topic, value) {
    this.#latest.set(topic, value);
    for (const listener of this.#listeners.get(topic) ?? []) {
      try {
        listener(value);
      } catch (error) {
        // The other listeners are still called; the error is reported as an uncaught error of the page.
        queueMicrotask(() => {
          throw error;
        });
      }
    }
  }
}

export const channel = new RpcChannel();
