// The body that is selected in this page, kept in step with the 3D view and the server.

import { channel } from "./rpcChannel.js";
import { el } from "./dom.js";
import { toast } from "./toasts.js";

class Selection {
  #id = null;
  #listeners = new Set();

  constructor() {
    // Sent by the server when a body was clicked in the view, or when the selected body was deleted.
    channel.on("selected", (id) => this.#set(id));
    channel.on("connection", (connected) => {
      if (connected && this.#id) channel.call("select", { id: this.#id }).catch(() => this.#set(null));
    });
  }

  get id() {
    return this.#id;
  }

  // Selects a body, or nothing with null; with `focus` the camera flies to it.
  async select(id, { focus = false } = {}) {
    this.#set(id);
    try {
      await channel.call("select", { id, focus });
    } catch (error) {
      toast(error.message, "error");
    }
  }

  // Calls a listener now and whenever the selection changes.
  onChange(listener) {
    this.#listeners.add(listener);
    listener(this.#id);
  }

  #set(id) {
    if (id === this.#id) return;
    this.#id = id;
    for (const listener of this.#listeners) listener(id);
  }
}

export const selection = new Selection();

// A button that shows a body's id and selects the body.
export function bodyLink(id) {
  return el("button", { type: "button", class: "body-link", "data-body-link": id, title: `Select ${id}`, onclick: () => selection.select(id, { focus: true }) }, id);
}
