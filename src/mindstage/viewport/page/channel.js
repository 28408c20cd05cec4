// The channel: what this page asks the server, and what it is told; see mindstage/viewport/channel.py.

const REPLY_MS = 90_000;
const RETRIES_MS = [250, 500, 1000, 2000];

export const key = Array.from(crypto.getRandomValues(new Uint8Array(8)), (byte) => byte.toString(16).padStart(2, "0")).join("");

class Refusal extends Error {
  constructor({ kind, text }) {
    super(text);
    this.kind = kind;
  }
}

class Channel {
  #socket = null;
  #next = 1;
  #waiting = new Map();
  #listeners = new Map();
  #latest = new Map();
  #tries = 0;

  constructor() {
    this.#open();
  }

  get connected() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  // Asks the server to do something; the promise is rejected with the server's own sentence.
  ask(what, args = {}) {
    if (!this.connected) return Promise.reject(new Refusal({ kind: "Lost", text: "there is no connection to the server" }));
    const id = this.#next++;
    return new Promise((resolve, reject) => {
      const late = setTimeout(() => this.#settle(id, { error: { kind: "Late", text: `the server did not answer within ${REPLY_MS / 1000} s` } }), REPLY_MS);
      this.#waiting.set(id, { resolve, reject, late });
      this.#socket.send(JSON.stringify({ id, do: what, with: args }));
    });
  }

  // Calls back with each value of a topic; at once with the last one, if there is one. Gives a function that ends it.
  on(topic, react) {
    if (!this.#listeners.has(topic)) this.#listeners.set(topic, new Set());
    this.#listeners.get(topic).add(react);
    if (this.#latest.has(topic)) react(this.#latest.get(topic));
    return () => this.#listeners.get(topic).delete(react);
  }

  latest(topic) {
    return this.#latest.get(topic);
  }

  #open() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(`${scheme}//${location.host}/mindstage/channel?visitor=${key}`);
    this.#socket = socket;
    socket.onopen = () => {
      this.#tries = 0;
      this.#tell("connection", true);
    };
    socket.onmessage = ({ data }) => this.#receive(JSON.parse(data));
    socket.onclose = () => {
      this.#tell("connection", false);
      for (const id of [...this.#waiting.keys()]) this.#settle(id, { error: { kind: "Lost", text: "the connection was lost before the answer came" } });
      const pause = RETRIES_MS[Math.min(this.#tries++, RETRIES_MS.length - 1)];
      setTimeout(() => this.#open(), pause);
    };
  }

  #receive(message) {
    if (message.topic !== undefined) this.#tell(message.topic, message.value);
    else if (message.id !== null) this.#settle(message.id, message);
    else this.#tell("refused", message.error);
  }

  #settle(id, { result, error }) {
    const { resolve, reject, late } = this.#waiting.get(id) ?? {};
    if (!resolve) return;
    this.#waiting.delete(id);
    clearTimeout(late);
    if (error) reject(new Refusal(error));
    else resolve(result);
  }

  #tell(topic, value) {
    this.#latest.set(topic, value);
    for (const react of this.#listeners.get(topic) ?? []) {
      try {
        react(value);
      } catch (error) {
        // One panel's mistake must not silence the others; it is still reported as the page's error.
        queueMicrotask(() => {
          throw error;
        });
      }
    }
  }
}

export const channel = new Channel();
