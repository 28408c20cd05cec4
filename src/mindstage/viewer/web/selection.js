// The bodies that are selected in this page, kept in step with the 3D view and the server. The details panel and the
// gizmo belong to the one that was selected last.

import { channel } from "./rpcChannel.js";
import { el } from "./dom.js";
import { onReplacedWorld } from "./replacedWorld.js";
import { toast } from "./toasts.js";

class Selection {
  #ids = [];
  #listeners = new Set();

  constructor() {
    // Sent by the server when the selection was changed by a program, or when a selected body was deleted.
    channel.on("selected", (ids) => this.#set(ids));
    onReplacedWorld(() => this.#set([]));
    channel.on("connection", (connected) => {
      if (connected && this.id) this.#send().catch(() => this.#set([]));
    });
  }

  // The body that was selected last, or null.
  get id() {
    return this.#ids.at(-1) ?? null;
  }

  // All selected bodies, the one that was selected last at the end.
  get ids() {
    return [...this.#ids];
  }

  has(id) {
    return this.#ids.includes(id);
  }

  // Selects a body, or nothing with null; with `focus` the camera moves to it.
  select(id, { focus = false } = {}) {
    return this.selectAll(id === null ? [] : [id], { focus });
  }

  // Adds a body to the selection, or removes it.
  toggle(id) {
    return this.selectAll(this.has(id) ? this.#ids.filter((other) => other !== id) : [...this.#ids, id]);
  }

  async selectAll(ids, { focus = false } = {}) {
    this.#set(ids);
    try {
      await this.#send(focus);
    } catch (error) {
      if (error.code !== "BodyNotFoundError") toast(error.message, "error");
      else if (this.id === (ids.at(-1) ?? null)) this.#set([]); // deleted meanwhile, such as a copy that was undone at once
    }
  }

  // Calls a listener now and whenever the selection changes, with the last selected body and all selected ones.
  onChange(listener) {
    this.#listeners.add(listener);
    listener(this.id, this.ids);
  }

  #send(focus = false) {
    return channel.call("select", { id: this.id, further: this.#ids.slice(0, -1), focus });
  }

  #set(ids) {
    const unique = [...new Set(ids)];
    if (unique.length === this.#ids.length && unique.every((id, index) => id === this.#ids[index])) return;
    this.#ids = unique;
    for (const listener of this.#listeners) listener(this.id, this.ids);
  }
}

export const selection = new Selection();

// A button that shows a body's id and selects the body.
export function bodyLink(id) {
  return el("button", { type: "button", class: "body-link", "data-body-link": id, title: `Select ${id}`, onclick: () => selection.select(id, { focus: true }) }, id);
}
