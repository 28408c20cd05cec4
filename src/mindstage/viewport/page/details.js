// The details of what is selected: what is known of it, and what of it can be changed.

import { channel } from "./channel.js";
import { el, fill, number } from "./dom.js";
import { icon } from "./icons.js";
import { jointsView } from "./joints.js";
import { bodyLink } from "./links.js";
import { panels } from "./panels.js";
import { selection } from "./selection.js";
import { attempt, toast } from "./toasts.js";
import { anglesOf, quaternionOf } from "./turns.js";

const MOBILITIES = [["static", "static: nobody moves it"], ["dynamic", "dynamic: the physics moves it"], ["kinematic", "kinematic: a program moves it"], ["stationary", "stationary: a light that stays"]];
const FOLDED = new Set(["Tags", "Facts"]);

class DetailsPanel {
  #root = null;
  #details = null;
  #live = null;
  #joints = null;
  #pose = [];
  #hanging = null;
  #waiting = false;

  build(root) {
    this.#root = root;
    root.setAttribute("aria-live", "off");
    this.#showNothing();
    selection.on((id) => this.#select(id));
    channel.on("described", () => this.#ask());
    channel.on("live", (live) => this.#follow(live));
    root.addEventListener("focusout", () => this.#waiting && this.#ask());
    document.addEventListener("keydown", (event) => event.key === "Escape" && this.#stopHanging());
  }

  get details() {
    return this.#details;
  }

  get live() {
    return this.#live;
  }

  // -- what is selected --------------------------------------------------------------------------------------------

  #select(id) {
    if (this.#hanging && id && id !== this.#hanging) return this.#hang(id);
    this.#live = null;
    if (id === null) {
      this.#details = null;
      this.#showNothing();
    } else this.#ask();
  }

  async #ask() {
    const id = selection.id;
    if (id === null) return;
    try {
      const details = await channel.ask("details", { id });
      if (selection.id !== id) return;
      this.#details = details;
      this.#show(details);
    } catch (error) {
      if (error.kind === "BodyUnknown" && selection.id === id) selection.choose(null);
      else if (error.kind !== "Lost") toast(error.message, "error");
    }
  }

  #follow(live) {
    if (live.id !== selection.id) return;
    this.#live = live;
    if (this.#details?.id !== live.id) return;
    const numbers = [...live.pose.position, ...anglesOf(live.pose.quaternion)];
    this.#pose.forEach((field, index) => {
      if (document.activeElement !== field) field.value = number(numbers[index], index < 3 ? 3 : 1);
    });
    this.#joints?.show(live.joints);
  }

  #showNothing() {
    fill(this.#root, el("p", { class: "faint", "data-role": "nothing" }, "Nothing is selected."),
      el("p", { class: "faint" }, "Click a thing to select it. Drag a door, a drawer or anything loose to pull it; drag elsewhere to look around."));
  }

  #show(details) {
    // What a person is typing is not taken away by what somebody else changes meanwhile.
    this.#waiting = this.#root.contains(document.activeElement) && document.activeElement.matches("input") && this.#root.firstChild?.dataset.body === details.id;
    if (this.#waiting) return;
    this.#joints = details.joints.length ? jointsView(details.joints) : null;
    fill(this.#root, el("div", { "data-body": details.id },
      this.#title(details), this.#actions(details),
      this.#section("Place", this.#placeFields(details)),
      this.#joints && this.#section("Joints", this.#joints.element),
      this.#section("Physics", this.#physics(details)),
      this.#section("Surface", this.#surface(details)),
      this.#section("Belongs together", this.#together(details)),
      details.kept.length > 0 && this.#section("Kept in", details.kept.map(({ place, ids }) => el("div", { class: "wrap" }, el("span", { class: "faint" }, `${place}: `), ids.map((id) => bodyLink(id))))),
      details.tags.length > 0 && this.#section("Tags", this.#table(details.tags.map(([type, key, value]) => [`${type} ${key}`, value]))),
      details.facts.length > 0 && this.#section("Facts", this.#table(details.facts.map(({ property, value, id }) => [property, id ? bodyLink(id) : value])))));
    if (this.#live) this.#follow(this.#live);
  }

  // -- parts of the panel ------------------------------------------------------------------------------------------

  #title({ id, label, cls, ancestors, iri }) {
    const more = ancestors.slice(0, 6).join(" › ");
    return el("div", {}, el("h2", { "data-role": "title" }, label || cls), el("div", { class: "wrap", "data-role": "id" }, id),
      el("div", { class: "faint wrap", "data-role": "class", title: iri }, [cls, more].filter(Boolean).join(" › ") + (ancestors.length > 6 ? " …" : "")));
  }

  #actions({ id, hangs_on: holder }) {
    const action = (sign, text, run, attributes = {}) => el("button", { type: "button", onclick: run, ...attributes }, icon(sign), text);
    return el("div", { class: "actions" },
      action("focus", "Focus", () => attempt("focus", { ids: [id] }), { "data-do": "focus-selected" }),
      holder ? action("unlink", "Detach", () => attempt("hang", { child: id, parent: null }), { "data-do": "detach" })
        : action("link", "Attach to…", () => this.#startHanging(id), { "data-do": "attach" }),
      action("trash", "Delete", () => this.#delete(id), { "data-do": "delete", class: "bad" }));
  }

  #section(title, ...content) {
    return el("details", { class: "part", open: !FOLDED.has(title), "data-part": title.toLowerCase() }, el("summary", {}, title), ...content);
  }

  #field(label, input, unit = "") {
    return el("label", { class: "field" }, el("span", { class: "faint" }, label), input, unit && el("span", { class: "faint unit" }, unit));
  }

  #number(label, attributes) {
    return el("input", { type: "number", step: "any", "aria-label": label, ...attributes,
      onkeydown: (event) => event.key === "Enter" && event.target.blur() });
  }

  #placeFields({ size }) {
    const names = ["x", "y", "z", "roll", "pitch", "yaw"];
    this.#pose = names.map((name) => this.#number(name, { "data-pose": name, onchange: () => this.#move() }));
    const row = (fields, unit) => el("div", { class: "triple" }, fields.map((field) => this.#field(field.dataset.pose, field)), el("span", { class: "faint unit" }, unit));
    return [row(this.#pose.slice(0, 3), "m"), row(this.#pose.slice(3), "°"),
      el("div", { class: "faint", "data-role": "size" }, size ? `size ${size.map((each) => number(each)).join(" × ")} m` : "no size is told")];
  }

  #physics({ id, mass, mobility, gravity }) {
    const set = (changes) => attempt("physics", { id, ...changes });
    const menu = el("select", { "aria-label": "Mobility", "data-field": "mobility", onchange: () => set({ mobility: menu.value }) },
      mobility === null && el("option", { value: "", selected: true, disabled: true }, "not told"),
      MOBILITIES.map(([value, text]) => el("option", { value, selected: value === mobility }, text)));
    const weight = this.#number("Mass [kg]", { min: "0.000001", "data-field": "mass", placeholder: "not told", value: mass ? number(mass, 4) : "",
      onchange: () => weight.value && (Number(weight.value) > 0 ? set({ mass_kg: Number(weight.value) }) : toast("a mass is above 0 kg", "error")) });
    const falls = el("input", { type: "checkbox", "data-field": "gravity", checked: gravity ?? true, onchange: () => set({ gravity: falls.checked }) });
    return [this.#field("mobility", menu), this.#field("mass", weight, "kg"), this.#field("gravity", falls)];
  }

  #surface({ id, materials, form }) {
    const first = materials[0];
    const colour = el("input", { type: "color", "data-field": "colour", "aria-label": "Colour", value: first?.colour ?? "#cccccc",
      onchange: () => attempt("material", { id, name: first?.name ?? "", colour: colour.value }) });
    const names = materials.map(({ name }) => name).join(", ") || "by its class";
    return [this.#field("material", el("span", { class: "row grow" }, colour, el("span", { class: "wrap grow" }, names),
      materials.length > 0 && el("button", { type: "button", class: "quiet", "data-do": "undress", title: "As its class looks", onclick: () => attempt("material", { id }) }, icon("close")))),
    form && el("div", { class: "faint wrap" }, form)];
  }

  #together({ hangs_on: holder, parts }) {
    return [this.#field("hangs on", holder ? bodyLink(holder) : el("span", {}, "nothing")),
      this.#field("holds", parts.length ? el("span", { class: "wrap" }, parts.map((id) => bodyLink(id))) : el("span", {}, "nothing"))];
  }

  #table(rows) {
    return el("table", { class: "facts" }, el("tbody", {}, rows.map(([name, value]) => el("tr", {}, el("td", { class: "faint" }, name), el("td", {}, value)))));
  }

  // -- what a person does ------------------------------------------------------------------------------------------

  async #move() {
    const numbers = this.#pose.map((field) => Number(field.value));
    if (this.#pose.some((field) => field.value === "") || !numbers.every(Number.isFinite)) return toast("a place takes six numbers", "error");
    await attempt("move", { id: selection.id, position: numbers.slice(0, 3), quaternion: quaternionOf(numbers.slice(3)) });
    this.#pose.forEach((field) => field.blur());
  }

  async #delete(id) {
    await attempt("delete", { ids: [id] });
  }

  #startHanging(id) {
    this.#hanging = id;
    document.body.dataset.choosing = "holder";
    toast(`Click what ${id} shall hang on; Escape ends it.`);
  }

  #stopHanging() {
    this.#hanging = null;
    delete document.body.dataset.choosing;
  }

  async #hang(parent) {
    const child = this.#hanging;
    this.#stopHanging();
    await attempt("hang", { child, parent });
    selection.choose(child);
  }
}

export const details = new DetailsPanel();

panels.add({ id: "details", title: "Details", side: "right", order: 10, build: (element) => details.build(element) });
