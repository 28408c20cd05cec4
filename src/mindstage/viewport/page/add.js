// Adding: a new thing of any class that is known, on or in what is selected, or where one looks.

import { channel } from "./channel.js";
import { el, fill, lately, number } from "./dom.js";
import { panels } from "./panels.js";
import { selection } from "./selection.js";
import { attempt } from "./toasts.js";

class AddPanel {
  #chosen = null;
  #search = el("input", { type: "search", placeholder: "Find a class", "aria-label": "Find a class", "data-role": "find-class", oninput: lately(() => this.#find(), 150) });
  #list = el("ul", { class: "classes", role: "listbox", "aria-label": "Classes", "data-role": "classes" });
  #picked = false;
  #where = el("select", { "aria-label": "Where", "data-role": "where", onchange: () => {
    this.#picked = true;
  } });
  #size = ["depth", "width", "height"].map((name) => el("input", { type: "number", step: "any", min: "0.001", max: "1000", "aria-label": `${name} [m]`, placeholder: name, "data-size": name }));
  #add = el("button", { type: "button", class: "main", "data-do": "add", disabled: true, onclick: () => this.#put() }, "Add");

  build(root) {
    root.classList.add("adding");
    root.append(this.#search, this.#list, el("label", { class: "field" }, el("span", { class: "faint" }, "where"), this.#where),
      el("div", { class: "triple" }, this.#size.map((field) => field), el("span", { class: "faint unit" }, "m")), this.#add);
    selection.on((id) => this.#offerPlaces(id));
  }

  shown() {
    if (!this.#list.children.length) this.#find();
  }

  #offerPlaces(id) {
    const before = this.#picked && this.#where.value;
    fill(this.#where, id && el("option", { value: "on" }, `on ${id}`), id && el("option", { value: "into" }, `into ${id}`), el("option", { value: "here" }, "where I look"));
    if ([...this.#where.options].some(({ value }) => value === before)) this.#where.value = before;
  }

  async #find() {
    const text = this.#search.value;
    const classes = await channel.ask("classes", { text }).catch(() => []);
    if (text !== this.#search.value) return;
    fill(this.#list, classes.map((each) => el("li", { role: "option", tabindex: "0", "aria-selected": "false", "data-class": each.name, title: each.class,
      onclick: (event) => this.#choose(each, event.currentTarget), onkeydown: (event) => ["Enter", " "].includes(event.key) && this.#choose(each, event.currentTarget) },
      el("span", { class: "grow wrap" }, each.name), el("span", { class: "faint" }, each.size ? each.size.map((extent) => number(extent, 2)).join(" × ") : ""))));
    if (!classes.length) fill(this.#list, el("li", { class: "faint" }, "No class is called so."));
  }

  #choose(each, row) {
    this.#chosen = each;
    for (const other of this.#list.children) other.setAttribute("aria-selected", String(other === row));
    this.#size.forEach((field, index) => {
      field.value = each.size ? number(each.size[index], 3) : "";
    });
    this.#add.disabled = false;
    this.#add.textContent = `Add ${each.name}`;
  }

  async #put() {
    const args = { class: this.#chosen.class };
    if (this.#size.every(({ value }) => Number(value) > 0)) args.size = this.#size.map(({ value }) => Number(value));
    if (this.#where.value !== "here") args[this.#where.value] = selection.id;
    this.#add.disabled = true;
    const id = await attempt("add", args);
    this.#add.disabled = false;
    if (id !== undefined) selection.choose(id, { focus: true });
  }
}

const add = new AddPanel();

panels.add({ id: "add", title: "Add", side: "right", order: 20, build: (element) => add.build(element), shown: () => add.shown() });
