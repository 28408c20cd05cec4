// The Details panel: the properties of the selected body, with fields to edit them.

import { channel } from "./rpcChannel.js";
import { el, formatNumber, replaceChildren } from "./dom.js";
import { icon } from "./icons.js";
import { deleteBodies, duplicate } from "./editActions.js";
import { jointSliders } from "./jointSliders.js";
import { panels } from "./panels.js";
import { bodyLink, selection } from "./selection.js";
import { callOrToast, toast } from "./toasts.js";

const DEGREES = 180 / Math.PI;
const MOBILITIES = [["static", "static: fixed in the world"], ["dynamic", "dynamic: moved by the physics"], ["kinematic", "kinematic: moved by commands"], ["stationary", "stationary: a light that does not move"]];
const COLLAPSED_SECTIONS = new Set(["Tags", "Facts"]);

class DetailsPanel {
  #root = null;
  #details = null;
  #live = null;
  #sliders = null;
  #poseFields = [];
  #shownId = undefined;
  #attaching = null; // the body that is attached to the next selected one
  #refreshPending = false;
  #others = el("p", { class: "muted", "data-role": "others", hidden: true });

  build(root) {
    this.#root = root;
    root.setAttribute("aria-live", "off");
    this.#showPlaceholder();
    selection.onChange((id, ids) => {
      this.#others.hidden = ids.length < 2;
      this.#others.textContent = `The last of ${ids.length} selected bodies; the gizmo, copies and deleting apply to all.`;
      if (id !== this.#shownId) this.#onSelect(id);
      this.#shownId = id;
    });
    channel.on("details_changed", () => this.#load());
    channel.on("live_details", (live) => this.#showLive(live));
    root.addEventListener("focusout", () => this.#refreshPending && this.#load());
    document.addEventListener("keydown", (event) => event.key === "Escape" && this.#stopAttaching());
  }

  get details() {
    return this.#details;
  }

  get live() {
    return this.#live;
  }

  // Lets the user type another name for the selected body.
  rename() {
    panels.show("details");
    const field = this.#root.querySelector("[data-field=name]");
    field?.focus();
    field?.select();
  }

  // -- the selected body -------------------------------------------------------------------------------------------

  #onSelect(id) {
    if (this.#attaching && id && id !== this.#attaching) return this.#attach(id);
    this.#live = null;
    if (id === null) {
      this.#details = null;
      this.#showPlaceholder();
    } else this.#load();
  }

  async #load() {
    const id = selection.id;
    if (id === null) return;
    try {
      const details = await channel.call("details", { id });
      if (selection.id !== id) return;
      this.#details = details;
      this.#show(details);
    } catch (error) {
      if (selection.id !== id) return; // such as a copy that was undone at once
      if (error.code === "BodyNotFoundError") selection.select(null);
      else if (error.code !== "Disconnected") toast(error.message, "error");
    }
  }

  #showLive(live) {
    if (live.id !== selection.id) return;
    this.#live = live;
    if (this.#details?.id !== live.id) return;
    const numbers = [...live.pose.position, ...eulerFromQuaternion(live.pose.quaternion)];
    this.#poseFields.forEach((field, index) => {
      if (document.activeElement !== field) field.value = formatNumber(numbers[index], index < 3 ? 3 : 1);
    });
    this.#sliders?.show(live.joints);
  }

  #showPlaceholder() {
    replaceChildren(this.#root, el("p", { class: "muted", "data-role": "no-selection" }, "No body is selected."),
      el("p", { class: "muted" }, "Click a body to select it. Drag a door, a drawer or a movable object to pull it; drag elsewhere to orbit the camera."));
  }

  #show(details) {
    // A field that is being edited is kept: the panel is rebuilt when the field loses the focus.
    this.#refreshPending = this.#root.contains(document.activeElement) && document.activeElement.matches("input") && this.#root.firstChild?.dataset.body === details.id;
    if (this.#refreshPending) return;
    this.#sliders = details.joints.length ? jointSliders(details.joints) : null;
    replaceChildren(this.#root, el("div", { "data-body": details.id },
      this.#title(details), this.#actions(details),
      this.#section("Pose", this.#poseSection(details)),
      this.#sliders && this.#section("Joints", this.#sliders.element),
      this.#section("Physics", this.#physics(details)),
      this.#section("Appearance", this.#appearance(details)),
      this.#section("Attachments", this.#attachments(details)),
      details.storage_places.length > 0 && this.#section("Storage places", details.storage_places.map(({ class_name: className, ids }) => el("div", { class: "wrap" }, el("span", { class: "muted" }, `${className}: `), ids.map((id) => bodyLink(id))))),
      details.tags.length > 0 && this.#section("Tags", this.#table(details.tags.map(([type, key, value]) => [`${type} ${key}`, value]))),
      details.facts.length > 0 && this.#section("Facts", this.#table(details.facts.map(({ property, value, id }) => [property, id ? bodyLink(id) : value])))));
    if (this.#live) this.#showLive(this.#live);
  }

  // -- parts of the panel ------------------------------------------------------------------------------------------

  #title({ id, label, cls, ancestors, iri }) {
    const name = el("input", { type: "text", "data-field": "name", "aria-label": "Name", maxlength: "200", value: label, placeholder: cls, title: "The name that people see (F2); the id stays",
      onkeydown: (event) => event.key === "Enter" && event.target.blur(), onchange: () => callOrToast("rename", { id, label: name.value }) });
    const superclasses = ancestors.slice(0, 6).join(" › ");
    return el("div", {}, el("h2", { "data-role": "title" }, label || cls), el("div", { class: "wrap", "data-role": "id" }, id), this.#others,
      this.#field("name", name),
      el("div", { class: "muted wrap", "data-role": "class", title: iri }, [cls, superclasses].filter(Boolean).join(" › ") + (ancestors.length > 6 ? " …" : "")));
  }

  #actions({ id, attached_to: parent }) {
    const action = (iconName, text, onclick, attributes = {}) => el("button", { type: "button", onclick, ...attributes }, icon(iconName), text);
    return el("div", { class: "actions" },
      action("focus", "Focus", () => callOrToast("focus", { ids: [id] }), { "data-action": "focus-selected" }),
      parent ? action("unlink", "Detach", () => callOrToast("attach", { child: id, parent: null }), { "data-action": "detach" })
        : action("link", "Attach to…", () => this.#startAttaching(id), { "data-action": "attach" }),
      action("box", "Duplicate", duplicate, { "data-action": "duplicate" }),
      action("trash", "Delete", () => deleteBodies(selection.ids.includes(id) ? selection.ids : [id]), { "data-action": "delete", class: "danger" }));
  }

  #section(title, ...content) {
    return el("details", { class: "section", open: !COLLAPSED_SECTIONS.has(title), "data-section": title.toLowerCase() }, el("summary", {}, title), ...content);
  }

  #field(label, input, unit = "") {
    return el("label", { class: "field" }, el("span", { class: "muted" }, label), input, unit && el("span", { class: "muted unit" }, unit));
  }

  #numberInput(label, attributes) {
    return el("input", { type: "number", step: "any", "aria-label": label, ...attributes,
      onkeydown: (event) => event.key === "Enter" && event.target.blur() });
  }

  #poseSection({ size }) {
    const names = ["x", "y", "z", "roll", "pitch", "yaw"];
    this.#poseFields = names.map((name) => this.#numberInput(name, { "data-pose": name, onchange: () => this.#move() }));
    const row = (fields, unit) => el("div", { class: "vector-fields" }, fields.map((field) => this.#field(field.dataset.pose, field)), el("span", { class: "muted unit" }, unit));
    return [row(this.#poseFields.slice(0, 3), "m"), row(this.#poseFields.slice(3), "°"),
      el("div", { class: "muted", "data-role": "size" }, size ? `size ${size.map((extent) => formatNumber(extent)).join(" × ")} m` : "size unknown")];
  }

  #physics({ id, mass, mobility, gravity }) {
    const set = (changes) => callOrToast("set_physics", { id, ...changes });
    const menu = el("select", { "aria-label": "Mobility", "data-field": "mobility", onchange: () => set({ mobility: menu.value }) },
      mobility === null && el("option", { value: "", selected: true, disabled: true }, "not specified"),
      MOBILITIES.map(([value, text]) => el("option", { value, selected: value === mobility }, text)));
    const massInput = this.#numberInput("Mass [kg]", { min: "0.000001", "data-field": "mass", placeholder: "not specified", value: mass ? formatNumber(mass, 4) : "",
      onchange: () => massInput.value && (Number(massInput.value) > 0 ? set({ mass_kg: Number(massInput.value) }) : toast("The mass must be greater than 0 kg.", "error")) });
    const gravityInput = el("input", { type: "checkbox", "data-field": "gravity", checked: gravity ?? true, onchange: () => set({ gravity: gravityInput.checked }) });
    return [this.#field("mobility", menu), this.#field("mass", massInput, "kg"), this.#field("gravity", gravityInput)];
  }

  #appearance({ id, materials, geometry }) {
    const first = materials[0];
    const color = el("input", { type: "color", "data-field": "color", "aria-label": "Color", value: first?.color ?? "#cccccc",
      onchange: () => callOrToast("set_material", { id, name: first?.name ?? "", color: color.value }) });
    const names = materials.map(({ name }) => name).join(", ") || "class default";
    return [this.#field("material", el("span", { class: "row grow" }, color, el("span", { class: "wrap grow" }, names),
      materials.length > 0 && el("button", { type: "button", class: "flat", "data-action": "clear-material", title: "Use the default material of the class", onclick: () => callOrToast("set_material", { id }) }, icon("close")))),
    geometry && el("div", { class: "muted wrap" }, geometry)];
  }

  #attachments({ attached_to: parent, attached_bodies: children }) {
    return [this.#field("attached to", parent ? bodyLink(parent) : el("span", {}, "none")),
      this.#field("children", children.length ? el("span", { class: "wrap" }, children.map((id) => bodyLink(id))) : el("span", {}, "none"))];
  }

  #table(rows) {
    return el("table", { class: "facts" }, el("tbody", {}, rows.map(([name, value]) => el("tr", {}, el("td", { class: "muted" }, name), el("td", {}, value)))));
  }

  // -- user actions ------------------------------------------------------------------------------------------------

  async #move() {
    const numbers = this.#poseFields.map((field) => Number(field.value));
    if (this.#poseFields.some((field) => field.value === "") || !numbers.every(Number.isFinite)) return toast("A pose needs six numbers.", "error");
    await callOrToast("move", { id: selection.id, position: numbers.slice(0, 3), quaternion: quaternionFromEuler(numbers.slice(3)) });
    this.#poseFields.forEach((field) => field.blur());
  }

  #startAttaching(id) {
    this.#attaching = id;
    document.body.dataset.picking = "parent";
    toast(`Click the body to attach ${id} to; press Escape to cancel.`);
  }

  #stopAttaching() {
    this.#attaching = null;
    delete document.body.dataset.picking;
  }

  async #attach(parent) {
    const child = this.#attaching;
    this.#stopAttaching();
    await callOrToast("attach", { child, parent });
    selection.select(child);
  }
}

// Roll, pitch and yaw about the fixed axes x, y and z [degrees] of a unit quaternion (w, x, y, z).
function eulerFromQuaternion([w, x, y, z]) {
  const roll = Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y));
  const pitch = Math.asin(Math.min(1, Math.max(-1, 2 * (w * y - z * x))));
  const yaw = Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
  return [roll, pitch, yaw].map((angle) => angle * DEGREES);
}

function quaternionFromEuler([roll, pitch, yaw]) {
  const [a, b, c] = [roll, pitch, yaw].map((angle) => angle / DEGREES / 2);
  const [ca, cb, cc] = [a, b, c].map(Math.cos);
  const [sa, sb, sc] = [a, b, c].map(Math.sin);
  return [ca * cb * cc + sa * sb * sc, sa * cb * cc - ca * sb * sc, ca * sb * cc + sa * cb * sc, ca * cb * sc - sa * sb * cc];
}

export const detailsPanel = new DetailsPanel();

panels.add({ id: "details", title: "Details", side: "right", order: 10, build: (root) => detailsPanel.build(root) });
