// The outliner: the bodies of the world as a tree. Only visible rows are DOM elements (virtual scrolling), so that it
// stays fast with thousands of bodies.

import { channel } from "./rpcChannel.js";
import { debounce, el } from "./dom.js";
import { icon } from "./icons.js";
import { panels } from "./panels.js";
import { onReplacedWorld } from "./replacedWorld.js";
import { selection } from "./selection.js";
import { callOrToast } from "./toasts.js";

const ROW_PX = matchMedia("(pointer: coarse)").matches ? 40 : 24;
const OVERSCAN_ROWS = 8;
const JOINT_LINK = 2; // ParentLink.JOINT in mindstage/viewer/inspector.py

// Whether a node is another one, or below it.
function isBelow(node, other) {
  for (let at = node; at; at = at.parentNode) if (at === other) return true;
  return false;
}

class Outliner {
  #world = { classes: [], class_words: [], rows: [] };
  #places = { holders: {}, rooms: {} };
  #nodes = [];
  #byId = new Map();
  #roots = [];
  #expanded = new Set();
  #hidden = new Set();
  #rooms = new Set();
  #bodies = 0;
  #rows = [];
  #filter = "";
  #cursor = null;

  #search = el("input", { type: "search", placeholder: "Find by name, class or id", "aria-label": "Find in the outline", "data-role": "find-body",
    oninput: debounce(() => this.#applyFilter(), 80), onkeydown: (event) => this.#onSearchKey(event) });
  #count = el("div", { class: "muted count", role: "status" });
  #rowsBox = el("div", { class: "tree-rows", role: "presentation" });
  #tree = el("div", { class: "tree", role: "tree", "aria-multiselectable": "true", tabindex: "0", "aria-label": "Bodies of the world", "data-role": "tree",
    onscroll: () => this.#render(), onkeydown: (event) => this.#onTreeKey(event),
    // A listener on the row would not work: the first click replaces the row's element.
    ondblclick: () => this.#cursor && selection.select(this.#cursor, { focus: true }) }, this.#rowsBox);

  build(root) {
    root.classList.add("outliner");
    root.append(this.#search, this.#count, this.#tree);
    new ResizeObserver(() => this.#render()).observe(this.#tree);
    channel.on("scene_tree", (tree) => {
      this.#world = tree;
      this.#build();
    });
    channel.on("places", (places) => {
      this.#places = places;
      this.#build();
    });
    channel.on("visibility", ({ hidden }) => {
      this.#hidden = new Set(hidden);
      this.#render();
    });
    onReplacedWorld(() => {
      this.#search.value = "";
      this.#expanded.clear();
      this.#applyFilter();
    });
    selection.onChange((id) => (id === this.#cursor && id ? this.#render() : this.#reveal(id)));
  }

  // -- the tree ----------------------------------------------------------------------------------------------------

  // A body is below what it is attached or joined to, else below what it is in or on; what is left, below its room.
  #build() {
    const { classes, class_words: words, rows } = this.#world;
    const { holders, rooms } = this.#places;
    const collator = new Intl.Collator(undefined, { numeric: true });
    this.#nodes = rows.map(([id, label, cls, parent, link, joint, movable, encloses]) => {
      const className = classes[cls];
      return { id, title: label || words[cls] || id, label, className, words: words[cls], parent, link, joint, movable, encloses, children: [], searchText: `${id} ${label} ${className} ${words[cls]}`.toLowerCase() };
    });
    this.#byId = new Map(this.#nodes.map((node) => [node.id, node]));
    this.#roots = [];
    for (const node of this.#nodes) node.parentNode = this.#nodes[node.parent] ?? null;
    for (const node of this.#nodes) {
      const [holder, place] = (node.parentNode ? null : holders[node.id]) ?? [];
      const parentNode = this.#byId.get(holder);
      if (parentNode && !isBelow(parentNode, node)) Object.assign(node, { parentNode, place });
    }
    const roomNodes = new Map();
    for (const node of this.#nodes) {
      node.parentNode ??= this.#room(roomNodes, rooms[node.id]);
      (node.parentNode?.children ?? this.#roots).push(node);
    }
    this.#roots.push(...roomNodes.values());
    this.#bodies = this.#nodes.length;
    this.#nodes.push(...roomNodes.values());
    for (const node of roomNodes.values()) this.#byId.set(node.id, node);
    const order = (a, b) => collator.compare(a.title, b.title) || collator.compare(a.id, b.id);
    for (const list of [this.#roots, ...this.#nodes.map(({ children }) => children)]) list.sort(order);
    this.#updateRows();
  }

  // The node of a room, which is no body; null without one.
  #room(nodes, name) {
    if (!name) return null;
    if (!nodes.has(name)) {
      const id = `room ${name}`;
      if (!this.#rooms.has(id)) this.#expanded.add(id); // open until somebody closes it
      this.#rooms.add(id);
      nodes.set(name, { id, title: name, isRoom: true, words: "room", children: [], parentNode: null, searchText: "" });
    }
    return nodes.get(name);
  }

  #applyFilter() {
    this.#filter = this.#search.value.trim().toLowerCase();
    this.#tree.scrollTop = 0;
    this.#updateRows();
  }

  // Lists the rows from top to bottom: with a filter, the matches and their ancestors; otherwise what is expanded.
  #updateRows() {
    const words = this.#filter.split(/\s+/).filter(Boolean);
    const matches = new Set(words.length ? this.#nodes.filter((node) => words.every((word) => node.searchText.includes(word))) : []);
    const shown = new Set();
    for (let node of matches) for (; node && !shown.has(node); node = node.parentNode) shown.add(node);
    this.#rows = [];
    const add = (node, level) => {
      if (words.length && !shown.has(node)) return;
      this.#rows.push({ node, level, matches: matches.has(node) });
      if (words.length ? node.children.some((child) => shown.has(child)) : this.#expanded.has(node.id)) for (const child of node.children) add(child, level + 1);
    };
    for (const root of this.#roots) add(root, 1);
    this.#count.textContent = words.length ? `${matches.size} of ${this.#bodies} found` : `${this.#bodies} bodies`;
    this.#rowsBox.style.height = `${this.#rows.length * ROW_PX}px`;
    this.#render();
  }

  #render() {
    const first = Math.max(0, Math.floor(this.#tree.scrollTop / ROW_PX) - OVERSCAN_ROWS);
    const last = Math.min(this.#rows.length, Math.ceil((this.#tree.scrollTop + this.#tree.clientHeight) / ROW_PX) + OVERSCAN_ROWS);
    this.#showRows(this.#rows.slice(first, last).map((row, index) => this.#row(row, first + index)));
    const active = this.#cursor && document.getElementById(`row-${this.#cursor}`);
    if (active) this.#tree.setAttribute("aria-activedescendant", active.id);
    else this.#tree.removeAttribute("aria-activedescendant");
  }

  // Keeps the elements of rows that look the same: a click on an element that is replaced before the button is released
  // would be lost.
  #showRows(rows) {
    const shown = new Map([...this.#rowsBox.children].map((row) => [row.id, row]));
    const wanted = rows.map((row) => (shown.get(row.id)?.isEqualNode(row) ? shown.get(row.id) : row));
    const kept = new Set(wanted);
    for (const row of shown.values()) if (!kept.has(row)) row.remove();
    wanted.forEach((row, index) => {
      const present = this.#rowsBox.children[index] ?? null;
      if (present !== row) this.#rowsBox.insertBefore(row, present);
    });
  }

  #row({ node, level, matches }, index) {
    const { id, title, label, className, words, children, link, encloses, place, isRoom } = node;
    const expanded = this.#filter ? true : this.#expanded.has(id);
    const hidden = this.#hidden.has(id);
    const toggle = children.length
      ? el("button", { type: "button", class: "flat caret", tabindex: "-1", "aria-label": expanded ? "Collapse" : "Expand", onclick: (event) => this.#toggle(event, { id }) }, icon(expanded ? "chevronDown" : "chevronRight"))
      : el("span", { class: "caret" });
    const eye = isRoom ? null : el("button", { type: "button", class: "flat eye", tabindex: "-1", "aria-pressed": String(hidden), "aria-label": hidden ? "Show" : "Hide", title: hidden ? "Show this body and its children" : "Hide this body and its children", "data-action": "toggle-visibility",
      onclick: (event) => this.#setVisible(event, this.#byId.get(id), hidden) }, icon(hidden ? "hidden" : "eye"));
    const row = el("div", { id: `row-${id}`, class: "tree-row", role: "treeitem", "data-id": id, "aria-level": level, "aria-selected": String(selection.has(id)), "aria-expanded": children.length ? String(expanded) : undefined,
      onclick: (event) => (isRoom ? this.#toggle(event, node) : this.#click(event, id)) },
      toggle,
      link === JOINT_LINK && el("span", { class: "joint-icon", title: `Joint: ${node.joint}`, role: "img", "aria-label": "connected by a joint" }, icon("joint")),
      place && el("span", { class: "joint-icon", title: `${place} ${node.parentNode.title}`, role: "img", "aria-label": place }, icon(place === "in" ? "inside" : "onTop")),
      isRoom && el("span", { class: "joint-icon", role: "img", "aria-label": "room" }, icon("room")),
      // The label or class is what a person recognizes, while ids are opaque in many maps: a narrow row cuts the id.
      el("span", { class: "tree-name", title: isRoom ? title : `${className} ${id}` }, title),
      label && words !== title && el("span", { class: "tree-class muted" }, words),
      el("span", { class: "tree-id muted" }, [encloses && "outline", !isRoom && id !== title && id].filter(Boolean).join(" · ")), eye);
    row.classList.toggle("ancestor-only", Boolean(this.#filter) && !matches);
    row.classList.toggle("hidden-body", hidden);
    row.classList.toggle("active", this.#cursor === id);
    row.style.top = `${index * ROW_PX}px`;
    row.style.height = `${ROW_PX}px`;
    row.style.paddingLeft = `${(level - 1) * 13 + 2}px`;
    return row;
  }

  // -- user actions ------------------------------------------------------------------------------------------------

  #select(id) {
    this.#cursor = id;
    selection.select(id);
  }

  // With Ctrl, a click adds a row to the selection or removes it; with Shift, it adds all rows from the last one on.
  #click({ ctrlKey, metaKey, shiftKey }, id) {
    const from = this.#rows.findIndex(({ node }) => node.id === this.#cursor);
    const to = this.#rows.findIndex(({ node }) => node.id === id);
    if (shiftKey && from >= 0) selection.selectAll([...selection.ids, ...this.#rows.slice(Math.min(from, to), Math.max(from, to) + 1).map(({ node }) => node.id).filter((other) => other !== id), id]);
    else if (ctrlKey || metaKey) {
      this.#cursor = id;
      selection.toggle(id);
    } else this.#select(id);
  }

  #toggle(event, { id }) {
    event.stopPropagation();
    if (this.#expanded.has(id)) this.#expanded.delete(id);
    else this.#expanded.add(id);
    this.#updateRows();
  }

  #setVisible(event, node, shown) {
    event.stopPropagation();
    const ids = [];
    const collect = ({ id, children }) => {
      ids.push(id);
      children.filter(({ place }) => !place).forEach(collect); // its parts, not what lies in or on it
    };
    collect(node);
    callOrToast("set_visible", { ids, shown });
  }

  // Expands the ancestors of the selected body and scrolls to its row.
  #reveal(id) {
    const node = this.#byId.get(id);
    if (node && !this.#filter) {
      let changed = false;
      for (let ancestor = node.parentNode; ancestor; ancestor = ancestor.parentNode) {
        changed ||= !this.#expanded.has(ancestor.id);
        this.#expanded.add(ancestor.id);
      }
      if (changed) this.#updateRows();
    }
    this.#cursor = id;
    const index = this.#rows.findIndex((row) => row.node.id === id);
    if (index >= 0) {
      const top = index * ROW_PX;
      if (top < this.#tree.scrollTop || top + ROW_PX > this.#tree.scrollTop + this.#tree.clientHeight) this.#tree.scrollTop = top - this.#tree.clientHeight / 2;
    }
    this.#render();
  }

  #onSearchKey(event) {
    if (event.key === "ArrowDown") {
      event.preventDefault();
      this.#tree.focus();
      this.#goTo(this.#rows.findIndex((row) => row.matches || !this.#filter));
    } else if (event.key === "Enter") {
      const match = this.#rows.find((row) => row.matches);
      if (match) selection.select(match.node.id, { focus: true });
    }
  }

  #onTreeKey(event) {
    const at = this.#rows.findIndex((row) => row.node.id === this.#cursor);
    const row = this.#rows[at];
    const page = Math.max(1, Math.floor(this.#tree.clientHeight / ROW_PX) - 1);
    const steps = { ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -Infinity, End: Infinity };
    if (event.key in steps) this.#goTo(Math.min(this.#rows.length - 1, Math.max(0, at + steps[event.key])));
    else if (event.key === "Enter" && row && !row.node.isRoom) selection.select(row.node.id, { focus: true });
    else if (event.key === "ArrowRight" && row?.node.children.length && !this.#expanded.has(row.node.id)) this.#toggle(event, row.node);
    else if (event.key === "ArrowLeft" && row && this.#expanded.has(row.node.id)) this.#toggle(event, row.node);
    else if (event.key === "ArrowLeft" && row?.node.parentNode) this.#select(row.node.parentNode.id);
    else return;
    event.preventDefault();
  }

  #goTo(index) {
    const node = this.#rows[index]?.node;
    if (node?.isRoom) {
      this.#cursor = node.id;
      this.#render();
    } else if (node) this.#select(node.id);
  }

  // For tests and the browser's console.
  get state() {
    return { filter: this.#filter, bodies: this.#bodies, rows: this.#rows.map(({ node }) => node.id), rendered: this.#rowsBox.children.length };
  }
}

export const outliner = new Outliner();

panels.add({ id: "outline", title: "Outline", side: "left", order: 10, build: (root) => outliner.build(root) });
