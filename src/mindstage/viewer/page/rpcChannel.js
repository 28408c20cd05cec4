// RPC over a websocket: requests with responses, and topics that the server publishes; see mindstage/viewer/server.py.

const RESPONSE_TIMEOUT_MS = 90_000;
const RECONNECT_DELAYS_MS = [250, 500, 1000, 2000];

// Identifies this page to the server; the URL of its 3D view has the same key.
export const clientKey = Array.from(crypto.getRandomValues(new Uint8Array(8)), (byte) => byte.toString(16).padStart(2, "0")).join("");

// An error response: `type` is the name of the error's class on the server, or "Disconnected" or "Timeout".
class RpcError extends Error {
  constructor({ type, message }) {
    super(message);
    this.type = type;
  }
}

class RpcChannel {
  #socket = null;
  #nextId = 1;
  #pending = new Map();
  #listeners = new Map();
  #latest = new Map();
  #attempts = 0;

  constructor() {
    this.#connect();
  }

  get connected() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  // Calls a method of the server. The promise is rejected with an RpcError that has the server's message.
  call(method, params = {}) {
    if (!this.connected) return Promise.reject(new RpcError({ type: "Disconnected", message: "there is no connection to the server" }));
    const id = this.#nextId++;
    return new Promise((resolve, reject) => {
      const error = { type: "Timeout", message: `the server did not respond within ${RESPONSE_TIMEOUT_MS / 1000} s` };
      const timeout = setTimeout(() => this.#settle(id, { error }), RESPONSE_TIMEOUT_MS);
      this.#pending.set(id, { resolve, reject, timeout });
      this.#socket.send(JSON.stringify({ id, method, params }));
    });
  }

  // Calls a listener with the latest value of a topic, if there is one, and with each later value. Returns a function
  // that removes the listener.
  on(topic, listener) {
    if (!this.#listeners.has(topic)) this.#listeners.set(topic, new Set());
    this.#listeners.get(topic).add(listener);
    if (this.#latest.has(topic)) listener(this.#latest.get(topic));
    return () => this.#listeners.get(topic).delete(listener);
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
      this.#emit("connection", true);
    };
    socket.onmessage = ({ data }) => this.#receive(JSON.parse(data));
    socket.onclose = () => {
      this.#emit("connection", false);
      const error = { type: "Disconnected", message: "the connection was lost before the server responded" };
      for (const id of [...this.#pending.keys()]) this.#settle(id, { error });
      const delay = RECONNECT_DELAYS_MS[Math.min(this.#attempts++, RECONNECT_DELAYS_MS.length - 1)];
      setTimeout(() => this.#connect(), delay);
    };
  }

  #receive(message) {
    if (message.topic !== undefined) this.#emit(message.topic, message.value);
    else if (message.id !== null) this.#settle(message.id, message);
    else this.#emit("error", message.error);
  }

  #settle(id, { result, error }) {
    const { resolve, reject, timeout } = this.#pending.get(id) ?? {};
    if (!resolve) return;
    this.#pending.delete(id);
    clearTimeout(timeout);
    if (error) reject(new RpcError(error));
    else resolve(result);
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
