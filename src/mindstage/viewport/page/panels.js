// Panels: tabs at the left and at the right; on a narrow screen, sheets over the view that a bar below opens.

import { el } from "./dom.js";

const narrow = matchMedia("(max-width: 760px)");

class Side {
  constructor(id) {
    this.root = document.getElementById(id);
    this.tabs = el("div", { class: "tabs", role: "tablist" });
    this.body = el("div", { class: "panels" });
    this.root.append(this.tabs, this.body);
    this.tabs.addEventListener("keydown", (event) => this.#walk(event));
  }

  #walk(event) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const tabs = [...this.tabs.children];
    const next = tabs[(tabs.indexOf(document.activeElement) + step + tabs.length) % tabs.length];
    next.focus();
    next.click();
  }
}

class Panels {
  #sides = { left: new Side("left"), right: new Side("right") };
  #all = new Map();
  #open = { left: null, right: null };

  constructor() {
    narrow.addEventListener("change", () => this.#closeSheets());
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && narrow.matches) this.#closeSheets();
    });
  }

  // Adds a panel: {id, title, side: "left" | "right", order, build(element), shown?(), hidden?()}.
  add({ id, title, side, order, build, shown = () => {}, hidden = () => {} }) {
    const body = el("section", { id: `panel-${id}`, class: "panel", role: "tabpanel", "aria-labelledby": `tab-${id}`, "data-panel": id, hidden: true });
    const attributes = { id: `tab-${id}`, role: "tab", type: "button", "aria-controls": `panel-${id}`, "aria-selected": "false", "data-tab": id, tabindex: "-1" };
    const tab = el("button", { ...attributes, onclick: () => this.show(id) }, title);
    const sheet = el("button", { type: "button", "data-sheet": id, "aria-expanded": "false", onclick: () => this.#toggleSheet(id) }, title);
    const panel = { id, side, order, body, tab, sheet, shown, hidden };
    this.#all.set(id, panel);
    this.#insert(this.#sides[side].tabs, tab, order);
    this.#insert(document.getElementById("sheets"), sheet, (side === "left" ? 0 : 1000) + order);
    this.#sides[side].body.append(body);
    build(body);
    if (!this.#open[side] || order < this.#all.get(this.#open[side]).order) this.#choose(panel);
  }

  // Brings a panel to the front of its side; on a narrow screen, opens its sheet.
  show(id) {
    const panel = this.#all.get(id);
    this.#choose(panel);
    if (narrow.matches) this.#openSheet(panel);
  }

  isOpen(id) {
    const panel = this.#all.get(id);
    return this.#open[panel.side] === id && (!narrow.matches || this.#sides[panel.side].root.classList.contains("open"));
  }

  // Takes sheets away, so that the view is seen; of no effect on a wide screen.
  closeSheets() {
    this.#closeSheets();
  }

  #choose(panel) {
    const before = this.#all.get(this.#open[panel.side]);
    if (before === panel) return;
    this.#open[panel.side] = panel.id;
    for (const each of [before, panel].filter(Boolean)) {
      const chosen = each === panel;
      each.body.hidden = !chosen;
      each.tab.setAttribute("aria-selected", String(chosen));
      each.tab.tabIndex = chosen ? 0 : -1;
    }
    before?.hidden();
    panel.shown();
  }

  #toggleSheet(id) {
    if (this.isOpen(id)) this.#closeSheets();
    else this.show(id);
  }

  #openSheet(panel) {
    this.#closeSheets();
    this.#sides[panel.side].root.classList.add("open");
    panel.sheet.setAttribute("aria-expanded", "true");
  }

  #closeSheets() {
    for (const side of Object.values(this.#sides)) side.root.classList.remove("open");
    for (const panel of this.#all.values()) panel.sheet.setAttribute("aria-expanded", "false");
  }

  #insert(list, button, order) {
    button.dataset.order = String(order);
    const after = [...list.children].find((other) => Number(other.dataset.order) > order);
    list.insertBefore(button, after ?? null);
  }
}

export const panels = new Panels();
