// Panels: tabs in the left and right sidebars; on a narrow screen, sheets over the view that a bar at the bottom opens.

import { el } from "./dom.js";

const narrow = matchMedia("(max-width: 760px)");

class Sidebar {
  constructor(id) {
    this.root = document.getElementById(id);
    this.tabs = el("div", { class: "tabs", role: "tablist" });
    this.body = el("div", { class: "panels" });
    this.root.append(this.tabs, this.body);
    this.tabs.addEventListener("keydown", (event) => this.#onKey(event));
  }

  #onKey(event) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const tabs = [...this.tabs.children];
    const next = tabs[(tabs.indexOf(document.activeElement) + step + tabs.length) % tabs.length];
    next.focus();
    next.click();
  }
}

class Panels {
  #sidebars = { left: new Sidebar("left-sidebar"), right: new Sidebar("right-sidebar") };
  #panels = new Map();
  #active = { left: null, right: null };

  constructor() {
    narrow.addEventListener("change", () => this.closeSheets());
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && narrow.matches) this.closeSheets();
    });
  }

  // Adds a panel: {id, title, side: "left" | "right", order, build(root), shown?(), hidden?()}.
  add({ id, title, side, order, build, shown = () => {}, hidden = () => {} }) {
    const body = el("section", { id: `panel-${id}`, class: "panel", role: "tabpanel", "aria-labelledby": `tab-${id}`, "data-panel": id, hidden: true });
    const attributes = { id: `tab-${id}`, role: "tab", type: "button", "aria-controls": `panel-${id}`, "aria-selected": "false", "data-tab": id, tabindex: "-1" };
    const tab = el("button", { ...attributes, onclick: () => this.show(id) }, title);
    const sheet = el("button", { type: "button", "data-sheet": id, "aria-expanded": "false", onclick: () => this.#toggleSheet(id) }, title);
    const panel = { id, side, order, body, tab, sheet, shown, hidden };
    this.#panels.set(id, panel);
    this.#insert(this.#sidebars[side].tabs, tab, order);
    this.#insert(document.getElementById("sheet-bar"), sheet, (side === "left" ? 0 : 1000) + order);
    this.#sidebars[side].body.append(body);
    build(body);
    if (!this.#active[side] || order < this.#panels.get(this.#active[side]).order) this.#activate(panel);
  }

  // Activates a panel's tab; on a narrow screen, opens its sheet.
  show(id) {
    const panel = this.#panels.get(id);
    this.#activate(panel);
    if (narrow.matches) this.#openSheet(panel);
  }

  isOpen(id) {
    const panel = this.#panels.get(id);
    return this.#active[panel.side] === id && (!narrow.matches || this.#sidebars[panel.side].root.classList.contains("open"));
  }

  // Closes the sheets so that the view is visible; no effect on a wide screen.
  closeSheets() {
    for (const sidebar of Object.values(this.#sidebars)) sidebar.root.classList.remove("open");
    for (const panel of this.#panels.values()) panel.sheet.setAttribute("aria-expanded", "false");
  }

  #activate(panel) {
    const before = this.#panels.get(this.#active[panel.side]);
    if (before === panel) return;
    this.#active[panel.side] = panel.id;
    for (const each of [before, panel].filter(Boolean)) {
      const active = each === panel;
      each.body.hidden = !active;
      each.tab.setAttribute("aria-selected", String(active));
      each.tab.tabIndex = active ? 0 : -1;
    }
    before?.hidden();
    panel.shown();
  }

  #toggleSheet(id) {
    if (this.isOpen(id)) this.closeSheets();
    else this.show(id);
  }

  #openSheet(panel) {
    this.closeSheets();
    this.#sidebars[panel.side].root.classList.add("open");
    panel.sheet.setAttribute("aria-expanded", "true");
    panel.sheet.scrollIntoView({ block: "nearest", inline: "nearest" }); // the bar is wider than a phone
  }

  #insert(list, button, order) {
    button.dataset.order = String(order);
    const after = [...list.children].find((other) => Number(other.dataset.order) > order);
    list.insertBefore(button, after ?? null);
  }
}

export const panels = new Panels();
