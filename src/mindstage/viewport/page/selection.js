// The selection: which body this visitor looks at; the view and the server know it too.

import { channel } from "./channel.js";
import { toast } from "./toasts.js";

class Selection {
  #id = null;
  #listeners = new Set();

  constructor() {
    // The server says what was clicked in the view, and what was deleted meanwhile.
    channel.on("selected", (id) => this.#take(id));
    channel.on("connection", (connected) => {
      if (connected && this.#id) channel.ask("select", { id: this.#id }).catch(() => this.#take(null));
    });
  }

  get id() {
    return this.#id;
  }

  // Selects a body, or nothing; `focus` flies the camera there.
  async choose(id, { focus = false } = {}) {
    this.#take(id);
    try {
      await channel.ask("select", { id, focus });
    } catch (error) {
      toast(error.message, "error");
    }
  }

  on(react) {
    this.#listeners.add(react);
    react(this.#id);
  }

  #take(id) {
    if (id === this.#id) return;
    this.#id = id;
    for (const react of this.#listeners) react(id);
  }
}

export const selection = new Selection();
