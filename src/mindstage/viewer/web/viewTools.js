// Tools of the 3D view: what a click or drag in it does. Without a tool, a click selects a body; with Shift or Ctrl it
// adds it to the selection or removes it.

import { channel } from "./rpcChannel.js";
import { el } from "./dom.js";
import { selection } from "./selection.js";
import { callOrToast } from "./toasts.js";
import { viewFrame } from "./viewFrame.js";

const MAX_CLICK_PX = 5; // a press that moves farther is a drag, which moves the camera

class ViewTools {
  #tool = null;
  #modifiers = { shiftKey: false, ctrlKey: false, metaKey: false };
  #listeners = new Set();
  #overlay = el("div", { id: "view-overlay", hidden: true, onpointerdown: (event) => this.#startBox(event) });

  constructor() {
    document.getElementById("center").append(this.#overlay);
    channel.on("clicked", (id) => this.#clicked(id));
    viewFrame.addEventListener("load", () => this.#listen(viewFrame.contentWindow));
  }

  // The name of the active tool: "measure", "box", or null.
  get active() {
    return this.#tool?.name ?? null;
  }

  // Activates a tool: {name, hint, onClick?(pointer), onBox?(first, second), ended?()}; null selects bodies again.
  use(tool) {
    const before = this.#tool;
    this.#tool = tool;
    before?.ended?.();
    this.#overlay.hidden = !tool?.onBox;
    if (tool) document.body.dataset.tool = tool.name;
    else delete document.body.dataset.tool;
    for (const listener of this.#listeners) listener(this.active);
  }

  onChange(listener) {
    this.#listeners.add(listener);
    listener(this.active);
  }

  // The position of a point of the window in the view: -1 to 1, x to the right and y up; null outside of it.
  pointerAt(clientX, clientY) {
    const { left, top, width, height } = viewFrame.getBoundingClientRect();
    const x = (2 * (clientX - left)) / width - 1;
    const y = 1 - (2 * (clientY - top)) / height;
    return Math.abs(x) <= 1 && Math.abs(y) <= 1 ? [x, y] : null;
  }

  #clicked(id) {
    if (this.#tool?.onClick || id === null) return;
    const { shiftKey, ctrlKey, metaKey } = this.#modifiers;
    if (shiftKey || ctrlKey || metaKey) selection.toggle(id);
    else if (selection.id === id && selection.ids.length === 1) selection.select(null);
    else selection.select(id);
  }

  #listen(view) {
    let start = null;
    const isOnCanvas = (event) => event.button === 0 && event.target.closest?.("canvas");
    view.addEventListener("pointerdown", (event) => {
      this.#modifiers = { shiftKey: event.shiftKey, ctrlKey: event.ctrlKey, metaKey: event.metaKey };
      start = isOnCanvas(event) ? [event.clientX, event.clientY] : null;
    }, true);
    view.addEventListener("pointerup", (event) => {
      if (!start || !this.#tool?.onClick) return;
      const moved = Math.hypot(event.clientX - start[0], event.clientY - start[1]);
      start = null;
      if (moved > MAX_CLICK_PX) return;
      const { left, top } = viewFrame.getBoundingClientRect();
      const pointer = this.pointerAt(event.clientX + left, event.clientY + top);
      if (pointer) this.#tool.onClick(pointer);
    }, true);
  }

  #startBox(event) {
    const { left, top } = viewFrame.getBoundingClientRect();
    const start = [event.clientX, event.clientY];
    const rectangle = el("div", { class: "selection-rectangle" });
    this.#overlay.replaceChildren(rectangle);
    this.#overlay.setPointerCapture(event.pointerId);
    const draw = ({ clientX, clientY }) => {
      rectangle.style.left = `${Math.min(start[0], clientX) - left}px`;
      rectangle.style.top = `${Math.min(start[1], clientY) - top}px`;
      rectangle.style.width = `${Math.abs(clientX - start[0])}px`;
      rectangle.style.height = `${Math.abs(clientY - start[1])}px`;
    };
    const end = (up) => {
      this.#overlay.onpointermove = this.#overlay.onpointerup = this.#overlay.onpointercancel = null;
      this.#overlay.replaceChildren();
      const [first, second] = [this.pointerAt(...start), this.pointerAt(up.clientX, up.clientY)];
      if (up.type === "pointerup" && first && second) this.#tool?.onBox?.(first, second, up);
    };
    this.#overlay.onpointermove = draw;
    this.#overlay.onpointerup = this.#overlay.onpointercancel = end;
  }
}

export const viewTools = new ViewTools();

// Box selection: the bodies whose centers are in a rectangle; with Shift or Ctrl they are added to the selection.
export const boxSelection = {
  name: "box",
  async onBox(first, second, { shiftKey, ctrlKey, metaKey }) {
    viewTools.use(null);
    const ids = await callOrToast("bodies_in_box", { first, second });
    if (ids) selection.selectAll(shiftKey || ctrlKey || metaKey ? [...selection.ids, ...ids] : ids);
  },
};
