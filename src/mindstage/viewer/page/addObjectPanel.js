// The Add panel: adds an object of a known class on or in the selected body, or where the camera looks.

import { channel } from "./rpcChannel.js";
import { debounce, el, formatNumber, replaceChildren } from "./dom.js";
import { panels } from "./panels.js";
import { selection } from "./selection.js";
import { callOrToast } from "./toasts.js";

class AddObjectPanel {
  #class = null;
  #search = el("input", { type: "search", placeholder: "Find a class", "aria-label": "Find a class", "data-role": "find-class", oninput: debounce(() => this.#find(), 150) });
  #list = el("ul", { class: "classes", role: "listbox", "aria-label": "Classes", "data-role": "classes" });
  #placementChosen = false;
  #placement = el("select", { "aria-label": "Placement", "data-role": "placement", onchange: () => {
    this.#placementChosen = true;
  } });
  #size = ["depth", "width", "height"].map((name) => el("input", { type: "number", step: "any", min: "0.001", max: "1000", "aria-label": `${name} [m]`, placeholder: name, "data-size": name }));
  #addButton = el("button", { type: "button", class: "primary", "data-action": "add", disabled: true, onclick: () => this.#add() }, "Add");

  build(root) {
    root.classList.add("add-object");
    root.append(this.#search, this.#list, el("label", { class: "field" }, el("span", { class: "muted" }, "placement"), this.#placement),
      el("div", { class: "vector-fields" }, this.#size, el("span", { class: "muted unit" }, "m")), this.#addButton);
    selection.onChange((id) => this.#updatePlacements(id));
  }

  shown() {
    if (!this.#list.children.length) this.#find();
  }

  #updatePlacements(id) {
    const before = this.#placementChosen && this.#placement.value;
    replaceChildren(this.#placement, id && el("option", { value: "on" }, `on ${id}`), id && el("option", { value: "into" }, `in ${id}`), el("option", { value: "camera" }, "at the camera target"));
    if ([...this.#placement.options].some(({ value }) => value === before)) this.#placement.value = before;
  }

  async #find() {
    const text = this.#search.value;
    const classes = await channel.call("find_classes", { text }).catch(() => []);
    if (text !== this.#search.value) return;
    replaceChildren(this.#list, classes.map((each) => el("li", { role: "option", tabindex: "0", "aria-selected": "false", "data-class": each.name, title: each.class,
      onclick: (event) => this.#choose(each, event.currentTarget), onkeydown: (event) => ["Enter", " "].includes(event.key) && this.#choose(each, event.currentTarget) },
      el("span", { class: "grow wrap" }, each.name), el("span", { class: "muted" }, each.size ? each.size.map((extent) => formatNumber(extent, 2)).join(" × ") : ""))));
    if (!classes.length) replaceChildren(this.#list, el("li", { class: "muted" }, "No matching class."));
  }

  #choose(each, row) {
    this.#class = each;
    for (const other of this.#list.children) other.setAttribute("aria-selected", String(other === row));
    this.#size.forEach((field, index) => {
      field.value = each.size ? formatNumber(each.size[index], 3) : "";
    });
    this.#addButton.disabled = false;
    this.#addButton.textContent = `Add ${each.name}`;
  }

  async #add() {
    const params = { class: this.#class.class };
    if (this.#size.every(({ value }) => Number(value) > 0)) params.size = this.#size.map(({ value }) => Number(value));
    if (this.#placement.value !== "camera") params[this.#placement.value] = selection.id;
    this.#addButton.disabled = true;
    const id = await callOrToast("add", params);
    this.#addButton.disabled = false;
    if (id !== undefined) selection.select(id, { focus: true });
  }
}

const panel = new AddObjectPanel();

panels.add({ id: "add", title: "Add", side: "right", order: 20, build: (root) => panel.build(root), shown: () => panel.shown() });
