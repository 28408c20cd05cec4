// The Views panel: standard views, and camera bookmarks, which the browser keeps for each map.

import { channel } from "./rpcChannel.js";
import { el, replaceChildren } from "./dom.js";
import { icon } from "./icons.js";
import { panels } from "./panels.js";
import { selection } from "./selection.js";
import { callOrToast, toast } from "./toasts.js";

export const STANDARD_VIEWS = ["front", "back", "left", "right", "top"];
const MAX_BOOKMARKS = 9;

class ViewBookmarks {
  #map = "";
  #bookmarks = new Map(); // number -> {name, camera}
  #list = el("ul", { class: "bookmarks", "data-role": "bookmarks", "aria-label": "Camera bookmarks" });

  build(root) {
    const standard = (view) => el("button", { type: "button", "data-view": view, onclick: () => this.goToStandard(view) }, view[0].toUpperCase() + view.slice(1));
    root.append(el("h3", {}, "Standard views"), el("div", { class: "actions" }, STANDARD_VIEWS.map(standard)),
      el("h3", {}, "Bookmarks"), this.#list,
      el("button", { type: "button", class: "primary", "data-action": "save-view", onclick: () => this.save() }, "Save this view"));
    channel.on("scene_tree", ({ name }) => this.#load(name));
  }

  // Shows everything from a side; with selected bodies, those.
  goToStandard(view) {
    return callOrToast("standard_view", { view, ids: selection.ids });
  }

  // Saves the camera under a number, by default the first free one.
  async save(number = this.#freeNumber()) {
    if (!number) return toast(`There are ${MAX_BOOKMARKS} bookmarks; delete one first.`, "error");
    const camera = await callOrToast("camera");
    if (!camera) return;
    this.#bookmarks.set(number, { name: this.#bookmarks.get(number)?.name ?? `View ${number}`, camera });
    this.#store();
    toast(`Saved as ${this.#bookmarks.get(number).name}; press ${number} to return.`);
  }

  goTo(number) {
    const bookmark = this.#bookmarks.get(number);
    if (bookmark) return callOrToast("set_camera", bookmark.camera);
    toast(`There is no view ${number}; Shift+${number} saves this one.`);
  }

  get all() {
    return [...this.#bookmarks].sort(([a], [b]) => a - b).map(([number, { name }]) => ({ number, name }));
  }

  #freeNumber() {
    return Array.from({ length: MAX_BOOKMARKS }, (_, index) => index + 1).find((number) => !this.#bookmarks.has(number));
  }

  get #key() {
    return `mindstage views of ${this.#map}`;
  }

  #load(map) {
    if (map === this.#map && this.#list.children.length) return;
    this.#map = map;
    let stored = [];
    try {
      stored = JSON.parse(localStorage.getItem(this.#key) ?? "[]");
    } catch {
      toast("The saved views of this map cannot be read; they are ignored.", "error");
    }
    this.#bookmarks = new Map(stored);
    this.#show();
  }

  #store() {
    try {
      localStorage.setItem(this.#key, JSON.stringify([...this.#bookmarks]));
    } catch {
      toast("The browser does not store views; they are lost when the page is closed.", "error");
    }
    this.#show();
  }

  #show() {
    const row = ({ number, name }) => el("li", { "data-bookmark": number },
      el("kbd", {}, String(number)),
      el("input", { type: "text", value: name, "aria-label": `Name of view ${number}`, maxlength: "60", onchange: (event) => {
        this.#bookmarks.get(number).name = event.target.value.trim() || `View ${number}`;
        this.#store();
      } }),
      el("button", { type: "button", "aria-label": `Go to ${name}`, onclick: () => this.goTo(number) }, "Go"),
      el("button", { type: "button", class: "flat", "aria-label": `Delete ${name}`, title: `Delete ${name}`, onclick: () => {
        this.#bookmarks.delete(number);
        this.#store();
      } }, icon("close")));
    replaceChildren(this.#list, this.all.length ? this.all.map(row) : el("li", { class: "muted" }, "None for this map. Shift+1 saves the first."));
  }
}

export const viewBookmarks = new ViewBookmarks();

panels.add({ id: "views", title: "Views", side: "left", order: 30, build: (root) => viewBookmarks.build(root) });
