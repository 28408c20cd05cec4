// The outliner: the world as a tree; only the rows that are seen are elements, so that thousands cost nothing.

import { channel } from "./channel.js";
import { el, lately } from "./dom.js";
import { icon } from "./icons.js";
import { panels } from "./panels.js";
import { selection } from "./selection.js";
import { attempt } from "./toasts.js";

const ROW_PX = matchMedia("(pointer: coarse)").matches ? 34 : 24;
const SPARE = 8;
const JOINT = 2;

class Outliner {
  #nodes = [];
  #byId = new Map();
  #roots = [];
  #open = new Set();
  #hidden = new Set();
  #rows = [];
  #filter = "";
  #cursor = null;

  #search = el("input", { type: "search", placeholder: "Find by name, class or id", "aria-label": "Find in the outline", "data-role": "find",
    oninput: lately(() => this.#find(), 80), onkeydown: (event) => this.#fromSearch(event) });
  #count = el("div", { class: "faint count", role: "status" });
  #rowsBox = el("div", { class: "tree-rows", role: "presentation" });
  #tree = el("div", { class: "tree", role: "tree", tabindex: "0", "aria-label": "Everything in the world", "data-role": "tree",
    onscroll: () => this.#draw(), onkeydown: (event) => this.#walk(event),
    // The row itself was drawn anew by the first click.
    ondblclick: () => this.#cursor && selection.choose(this.#cursor, { focus: true }) }, this.#rowsBox);

  build(root) {
    root.classList.add("outliner");
    root.append(this.#search, this.#count, this.#tree);
    new ResizeObserver(() => this.#draw()).observe(this.#tree);
    channel.on("world", (world) => this.#take(world));
    channel.on("shown", ({ hidden }) => {
      this.#hidden = new Set(hidden);
      this.#draw();
    });
    selection.on((id) => this.#reveal(id));
  }

  // -- the tree ----------------------------------------------------------------------------------------------------

  #take({ classes, rows }) {
    const names = new Intl.Collator(undefined, { numeric: true });
    this.#nodes = rows.map(([id, label, cls, parent, link, joint, movable, shell]) => {
      const kind = classes[cls];
      return { id, label, kind, parent, link, joint, movable, shell, children: [], words: `${id} ${label} ${kind}`.toLowerCase() };
    });
    this.#byId = new Map(this.#nodes.map((node) => [node.id, node]));
    this.#roots = [];
    for (const node of this.#nodes) {
      node.above = this.#nodes[node.parent] ?? null;
      (node.above?.children ?? this.#roots).push(node);
    }
    const order = (a, b) => names.compare(a.label || a.id, b.label || b.id);
    for (const list of [this.#roots, ...this.#nodes.map(({ children }) => children)]) list.sort(order);
    this.#list();
  }

  #find() {
    this.#filter = this.#search.value.trim().toLowerCase();
    this.#tree.scrollTop = 0;
    this.#list();
  }

  // Which rows there are, from top to bottom: what is found with all that is above it, or what is opened.
  #list() {
    const words = this.#filter.split(/\s+/).filter(Boolean);
    const found = new Set(words.length ? this.#nodes.filter((node) => words.every((word) => node.words.includes(word))) : []);
    const shown = new Set();
    for (let node of found) for (; node && !shown.has(node); node = node.above) shown.add(node);
    this.#rows = [];
    const add = (node, level) => {
      if (words.length && !shown.has(node)) return;
      this.#rows.push({ node, level, found: found.has(node) });
      if (words.length ? node.children.some((child) => shown.has(child)) : this.#open.has(node.id)) for (const child of node.children) add(child, level + 1);
    };
    for (const root of this.#roots) add(root, 1);
    this.#count.textContent = words.length ? `${found.size} of ${this.#nodes.length} found` : `${this.#nodes.length} bodies`;
    this.#rowsBox.style.height = `${this.#rows.length * ROW_PX}px`;
    this.#draw();
  }

  #draw() {
    const first = Math.max(0, Math.floor(this.#tree.scrollTop / ROW_PX) - SPARE);
    const last = Math.min(this.#rows.length, Math.ceil((this.#tree.scrollTop + this.#tree.clientHeight) / ROW_PX) + SPARE);
    this.#rowsBox.replaceChildren(...this.#rows.slice(first, last).map((row, index) => this.#row(row, first + index)));
    const active = this.#cursor && document.getElementById(`row-${this.#cursor}`);
    if (active) this.#tree.setAttribute("aria-activedescendant", active.id);
    else this.#tree.removeAttribute("aria-activedescendant");
  }

  #row({ node, level, found }, index) {
    const { id, label, kind, children, link, shell } = node;
    const open = this.#filter ? true : this.#open.has(id);
    const away = this.#hidden.has(id);
    const toggle = children.length
      ? el("button", { type: "button", class: "quiet caret", tabindex: "-1", "aria-label": open ? "Close" : "Open", onclick: (event) => this.#toggle(event, node) }, icon(open ? "down" : "right"))
      : el("span", { class: "caret" });
    const eye = el("button", { type: "button", class: "quiet eye", tabindex: "-1", "aria-pressed": String(away), "aria-label": away ? "Show" : "Hide", title: away ? "Show it, and what belongs to it" : "Hide it, and what belongs to it", "data-do": "eye",
      onclick: (event) => this.#show(event, node, away) }, icon(away ? "hidden" : "eye"));
    const row = el("div", { id: `row-${id}`, class: "tree-row", role: "treeitem", "data-id": id, "aria-level": level, "aria-selected": String(selection.id === id), "aria-expanded": children.length ? String(open) : undefined,
      onclick: () => this.#choose(id) },
      toggle,
      link === JOINT && el("span", { class: "joint-sign", title: `Moves by ${node.joint}`, role: "img", "aria-label": "by a joint" }, icon("joint")),
      el("span", { class: "tree-name" }, label || id),
      el("span", { class: "tree-kind faint" }, shell ? `${kind} · outline` : kind), eye);
    row.classList.toggle("passing", Boolean(this.#filter) && !found);
    row.classList.toggle("away", away);
    row.classList.toggle("cursor", this.#cursor === id);
    row.style.top = `${index * ROW_PX}px`;
    row.style.height = `${ROW_PX}px`;
    row.style.paddingLeft = `${(level - 1) * 13 + 2}px`;
    return row;
  }

  // -- what a person does ------------------------------------------------------------------------------------------

  #choose(id) {
    this.#cursor = id;
    selection.choose(id);
  }

  #toggle(event, { id }) {
    event.stopPropagation();
    if (this.#open.has(id)) this.#open.delete(id);
    else this.#open.add(id);
    this.#list();
  }

  #show(event, node, shown) {
    event.stopPropagation();
    const ids = [];
    const take = ({ id, children }) => {
      ids.push(id);
      children.forEach(take);
    };
    take(node);
    attempt("show_bodies", { ids, shown });
  }

  // Opens what is above a body that was selected, and scrolls to it.
  #reveal(id) {
    const node = this.#byId.get(id);
    if (node && !this.#filter) {
      let opened = false;
      for (let above = node.above; above; above = above.above) {
        opened ||= !this.#open.has(above.id);
        this.#open.add(above.id);
      }
      if (opened) this.#list();
    }
    this.#cursor = id;
    const index = this.#rows.findIndex((row) => row.node.id === id);
    if (index >= 0) {
      const top = index * ROW_PX;
      if (top < this.#tree.scrollTop || top + ROW_PX > this.#tree.scrollTop + this.#tree.clientHeight) this.#tree.scrollTop = top - this.#tree.clientHeight / 2;
    }
    this.#draw();
  }

  #fromSearch(event) {
    if (event.key === "ArrowDown") {
      event.preventDefault();
      this.#tree.focus();
      this.#goTo(this.#rows.findIndex((row) => row.found || !this.#filter));
    } else if (event.key === "Enter") {
      const match = this.#rows.find((row) => row.found);
      if (match) selection.choose(match.node.id, { focus: true });
    }
  }

  #walk(event) {
    const at = this.#rows.findIndex((row) => row.node.id === this.#cursor);
    const row = this.#rows[at];
    const page = Math.max(1, Math.floor(this.#tree.clientHeight / ROW_PX) - 1);
    const steps = { ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -Infinity, End: Infinity };
    if (event.key in steps) this.#goTo(Math.min(this.#rows.length - 1, Math.max(0, at + steps[event.key])));
    else if (event.key === "Enter" && row) selection.choose(row.node.id, { focus: true });
    else if (event.key === "ArrowRight" && row?.node.children.length && !this.#open.has(row.node.id)) this.#toggle(event, row.node);
    else if (event.key === "ArrowLeft" && row && this.#open.has(row.node.id)) this.#toggle(event, row.node);
    else if (event.key === "ArrowLeft" && row?.node.above) this.#choose(row.node.above.id);
    else return;
    event.preventDefault();
  }

  #goTo(index) {
    if (this.#rows[index]) this.#choose(this.#rows[index].node.id);
  }

  // For whoever looks into the page from outside.
  get state() {
    return { bodies: this.#nodes.length, rows: this.#rows.map(({ node }) => node.id), drawn: this.#rowsBox.children.length };
  }
}

export const outliner = new Outliner();

panels.add({ id: "outline", title: "Outline", side: "left", order: 10, build: (element) => outliner.build(element) });
