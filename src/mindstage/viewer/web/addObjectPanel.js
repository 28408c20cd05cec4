// The Add panel: classes by category with thumbnails. A class is dragged to a surface in the view, or added by a button
// on or in the body that was selected last.

import { channel } from "./rpcChannel.js";
import { debounce, el, formatNumber, replaceChildren } from "./dom.js";
import { icon } from "./icons.js";
import { panels } from "./panels.js";
import { selection } from "./selection.js";
import { callOrToast } from "./toasts.js";
import { viewTools } from "./viewTools.js";

const ALL = "All";
const START_DRAG_PX = 6;
const HOLD_MS = 350; // after which a finger drags an object; one that moves at once scrolls the list
const MAX_THUMBNAILS = 600;

// Thumbnails are requested one after another, those in sight first.
class Thumbnails {
  #kept = new Map();
  #waiting = [];
  #busy = false;
  #observer = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      this.#waiting = this.#waiting.filter((other) => other !== target);
      if (isIntersecting) this.#waiting.push(target);
    }
    this.#load();
  });

  // An element that shows the thumbnail of a class as soon as it is in sight; until then, an icon.
  element(cls) {
    if (this.#kept.get(cls)) return el("img", { class: "thumbnail", alt: "", src: this.#kept.get(cls) });
    const placeholder = el("span", { class: "thumbnail", "data-thumbnail-of": cls }, icon("box"));
    if (!this.#kept.has(cls)) this.#observer.observe(placeholder);
    return placeholder;
  }

  get(cls) {
    return this.#kept.get(cls);
  }

  async #load() {
    if (this.#busy) return;
    this.#busy = true;
    while (this.#waiting.length) {
      const placeholder = this.#waiting.shift();
      if (!placeholder.isConnected) continue;
      this.#observer.unobserve(placeholder);
      const cls = placeholder.dataset.thumbnailOf;
      const data = await channel.call("thumbnail", { cls }).catch(() => null); // the icon stays
      if (data === null) continue;
      if (this.#kept.size >= MAX_THUMBNAILS) this.#kept.delete(this.#kept.keys().next().value);
      this.#kept.set(cls, data ? `data:image/png;base64,${data}` : null);
      if (data) placeholder.replaceWith(this.element(cls));
    }
    this.#busy = false;
  }
}

class AddObjectPanel {
  #class = null;
  #category = ALL;
  #target = null; // the body that was selected last and was not added here
  #added = new Set();
  #thumbnails = new Thumbnails();
  #drag = null;
  #search = el("input", { type: "search", placeholder: "Find an object", "aria-label": "Find a class by name, label or synonym", "data-role": "find-class", oninput: debounce(() => this.#find(), 120) });
  #categories = el("div", { class: "categories", role: "group", "aria-label": "Categories", "data-role": "categories" });
  #list = el("ul", { class: "classes", role: "listbox", "aria-label": "Classes", "data-role": "classes", onkeydown: (event) => this.#onKey(event) });
  #placementChosen = false;
  #placement = el("select", { "aria-label": "Placement", "data-role": "placement", onchange: () => {
    this.#placementChosen = true;
  } });
  #size = ["depth", "width", "height"].map((name) => el("input", { type: "number", step: "any", min: "0.001", max: "1000", "aria-label": `${name} [m]`, placeholder: name, "data-size": name }));
  #addButton = el("button", { type: "button", class: "primary", "data-action": "add", disabled: true, onclick: () => this.#add() }, "Add");
  #image = el("img", { class: "drag-image", alt: "", hidden: true });
  #hint = el("div", { class: "drag-hint", role: "status", hidden: true });

  build(root) {
    root.classList.add("add-object");
    root.append(this.#search, this.#categories, this.#list, el("div", { class: "placed-by" },
      el("label", { class: "field" }, el("span", { class: "muted" }, "where"), this.#placement),
      el("div", { class: "vector-fields" }, this.#size, el("span", { class: "muted unit" }, "m")), this.#addButton,
      el("p", { class: "muted" }, `Or ${matchMedia("(pointer: coarse)").matches ? "hold an object and drag it" : "drag an object"} into the view, onto a surface.`)));
    document.body.append(this.#image, this.#hint);
    this.#list.addEventListener("touchmove", (event) => this.#drag && event.preventDefault(), { passive: false }); // else it scrolls
    selection.onChange((id) => {
      if (!this.#added.has(id)) this.#target = id ?? this.#target;
      this.#updatePlacements();
    });
    channel.on("scene_tree", ({ rows }) => {
      if (this.#target && !rows.some(([id]) => id === this.#target) && channel.latest("clock")?.bodies) this.#target = null;
      this.#updatePlacements();
    });
  }

  async shown() {
    if (this.#list.children.length) return;
    this.#find();
    const categories = await channel.call("class_categories").catch(() => []);
    replaceChildren(this.#categories, [ALL, ...categories].map((category) => el("button", { type: "button", "data-category": category, "aria-pressed": String(category === this.#category), onclick: () => this.#chooseCategory(category) }, category)));
  }

  #chooseCategory(category) {
    this.#category = category;
    for (const button of this.#categories.children) button.setAttribute("aria-pressed", String(button.dataset.category === category));
    this.#find();
  }

  #updatePlacements() {
    const before = this.#placementChosen && this.#placement.value;
    const id = this.#target;
    replaceChildren(this.#placement, id && el("option", { value: "on" }, `on ${id}`), id && el("option", { value: "into" }, `in ${id}`), el("option", { value: "camera" }, "in the middle of the view"));
    if ([...this.#placement.options].some(({ value }) => value === before)) this.#placement.value = before;
  }

  async #find() {
    const text = this.#search.value;
    const category = this.#category;
    const classes = await channel.call("find_classes", { text, category: category === ALL ? "" : category }).catch(() => []);
    if (text !== this.#search.value || category !== this.#category) return;
    this.#list.scrollTop = 0;
    replaceChildren(this.#list, classes.map((each, index) => this.#tile(each, index)));
    if (!classes.length) replaceChildren(this.#list, el("li", { class: "muted" }, "No matching class."));
  }

  #tile(each, index) {
    const extents = each.size ? each.size.map((extent) => formatNumber(extent, 2)).join(" × ") : "size unknown";
    return el("li", { role: "option", tabindex: index === 0 ? "0" : "-1", "aria-selected": String(this.#class?.cls === each.cls), "data-class": each.name, title: `${each.name}, ${extents} m`,
      onclick: (event) => this.#choose(each, event.currentTarget), ondblclick: () => this.#add(), onpointerdown: (event) => this.#press(event, each), oncontextmenu: (event) => this.#drag && event.preventDefault() },
    this.#thumbnails.element(each.cls), el("span", {}, each.title), (this.#search.value || each.used) && el("small", { class: "muted" }, [this.#search.value && each.category, each.used && "in use"].filter(Boolean).join(" · ")));
  }

  #choose(each, tile) {
    this.#class = each;
    for (const other of this.#list.children) other.setAttribute("aria-selected", String(other === tile));
    this.#size.forEach((field, index) => {
      field.value = each.size ? formatNumber(each.size[index], 3) : "";
    });
    this.#addButton.disabled = false;
    this.#addButton.textContent = `Add ${each.name}`;
  }

  #onKey(event) {
    const tiles = [...this.#list.querySelectorAll("[role=option]")];
    const at = tiles.indexOf(document.activeElement);
    if (at < 0) return;
    const columns = tiles.filter(({ offsetTop }) => offsetTop === tiles[0].offsetTop).length;
    const step = { ArrowRight: 1, ArrowLeft: -1, ArrowDown: columns, ArrowUp: -columns }[event.key];
    if (step) {
      const next = tiles[Math.min(tiles.length - 1, Math.max(0, at + step))];
      tiles[at].tabIndex = -1;
      next.tabIndex = 0;
      next.focus();
    } else if (event.key === " ") tiles[at].click();
    else if (event.key === "Enter") {
      tiles[at].click();
      this.#add();
    } else return;
    event.preventDefault();
    event.stopPropagation();
  }

  #chosenSize() {
    return this.#size.every(({ value }) => Number(value) > 0) ? { size: this.#size.map(({ value }) => Number(value)) } : {};
  }

  async #add() {
    if (!this.#class) return;
    const params = { cls: this.#class.cls, ...this.#chosenSize() };
    if (this.#placement.value !== "camera") params[this.#placement.value] = this.#target;
    this.#addButton.disabled = true;
    const id = await callOrToast("add", params);
    this.#addButton.disabled = false;
    if (id !== undefined) this.#select(id);
  }

  #select(id) {
    this.#added.add(id);
    selection.select(id);
  }

  // -- dragging into the view ----------------------------------------------------------------------------------------

  #press(event, each) {
    if (event.button !== 0) return;
    const tile = event.currentTarget;
    const { clientX: x, clientY: y } = event;
    tile.setPointerCapture(event.pointerId); // the view is a frame of its own, which would receive the events
    const isFinger = event.pointerType === "touch";
    const begin = (atX, atY) => {
      this.#choose(each, tile);
      this.#drag = { params: { cls: each.cls, ...this.#chosenSize() }, pointer: null, busy: false };
      if (this.#thumbnails.get(each.cls)) this.#image.src = this.#thumbnails.get(each.cls);
      document.addEventListener("keydown", cancel, true);
      document.body.classList.add("dragging-object"); // on a phone the panel covers the view
      this.#dragTo(atX, atY);
    };
    const hold = isFinger ? setTimeout(() => begin(x, y), HOLD_MS) : 0;
    const end = (last) => {
      clearTimeout(hold);
      tile.onpointermove = tile.onpointerup = tile.onpointercancel = null;
      document.removeEventListener("keydown", cancel, true);
      document.body.classList.remove("dragging-object");
      if (this.#drag) this.#drop(last.type === "pointerup" ? last : null);
    };
    const cancel = (key) => {
      if (key.key !== "Escape") return;
      key.stopPropagation();
      end(key);
    };
    tile.onpointermove = ({ clientX, clientY }) => {
      const [dx, dy] = [Math.abs(clientX - x), Math.abs(clientY - y)];
      if (this.#drag) this.#dragTo(clientX, clientY);
      else if (Math.hypot(dx, dy) > START_DRAG_PX) {
        clearTimeout(hold);
        if (!isFinger || dx > dy) begin(clientX, clientY); // a vertical motion scrolls, and the browser cancels the pointer
      }
    };
    tile.onpointerup = tile.onpointercancel = end;
  }

  #dragTo(x, y) {
    const drag = this.#drag;
    drag.pointer = viewTools.pointerAt(x, y);
    this.#image.hidden = drag.pointer !== null || !this.#image.src;
    for (const element of [this.#image, this.#hint]) {
      element.style.left = `${x + (element === this.#hint ? 18 : 0)}px`;
      element.style.top = `${y + (element === this.#hint ? 12 : 0)}px`;
    }
    this.#hint.hidden = drag.pointer === null;
    this.#hover(drag);
  }

  // Asks for the place at the pointer, one request at a time, and again if the pointer has moved in the meantime.
  async #hover(drag) {
    if (drag.busy) return;
    drag.busy = true;
    let asked;
    while (this.#drag === drag && drag.pointer !== asked) {
      asked = drag.pointer;
      if (asked === null) await channel.call("end_hover").catch(() => {});
      else this.#showOffer(await channel.call("hover", { ...drag.params, pointer: asked }).catch((error) => ({ reason: error.message })));
    }
    drag.busy = false;
  }

  #showOffer({ on, reason }) {
    this.#hint.textContent = on ? `on ${on}` : reason;
    this.#hint.classList.toggle("blocked", !on);
  }

  async #drop(event) {
    const drag = this.#drag;
    this.#drag = null;
    this.#image.hidden = this.#hint.hidden = true;
    const pointer = event && viewTools.pointerAt(event.clientX, event.clientY);
    if (!pointer) {
      await channel.call("end_hover").catch(() => {});
      return;
    }
    const id = await callOrToast("drop", { ...drag.params, pointer });
    if (id !== undefined) this.#select(id);
  }
}

const panel = new AddObjectPanel();

panels.add({ id: "add", title: "Add", side: "right", order: 20, build: (root) => panel.build(root), shown: () => panel.shown() });
