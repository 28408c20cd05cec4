// Joints: a slider for each axis that moves; where time passes it pulls, and what is in the way stops it.

import { channel } from "./channel.js";
import { el, number } from "./dom.js";
import { bodyLink } from "./links.js";
import { toast } from "./toasts.js";

const DEGREES = 180 / Math.PI;
const FREE = { slides: 1, turns: Math.PI };
const BETWEEN_MS = 60;

class AxisSlider {
  #joint;
  #axis;
  #held = false;
  #sent = 0;
  #value = el("output", { "data-role": "joint-value" });
  #slider;

  constructor(joint, axis) {
    this.#joint = joint;
    this.#axis = axis;
    const free = axis.slides ? FREE.slides : FREE.turns;
    this.#slider = el("input", {
      type: "range", min: String(axis.low ?? -free), max: String(axis.high ?? free), step: "any", value: "0",
      "aria-label": `${joint.id}: ${axis.name}`, "data-joint": joint.id, "data-axis": axis.name,
      oninput: () => this.#pull(false), onchange: () => this.#pull(true),
    });
    this.element = el("div", { class: "axis" }, el("span", { class: "faint" }, axis.slides ? `slides ${axis.name}` : `turns ${axis.name}`), this.#value, this.#slider,
      el("div", { class: "range faint" }, el("span", {}, axis.low === null ? "no limit" : this.#words(axis.low)), el("span", {}, axis.high === null ? "no limit" : this.#words(axis.high))));
  }

  show(value) {
    this.#value.textContent = this.#words(value);
    this.#value.value = this.#words(value);
    if (!this.#held) this.#slider.value = String(value);
  }

  #words(value) {
    return this.#axis.slides ? `${number(value, 3)} m` : `${number(value * DEGREES, 1)}°`;
  }

  async #pull(done) {
    this.#held = !done;
    const now = performance.now();
    if (!done && now - this.#sent < BETWEEN_MS) return;
    this.#sent = now;
    try {
      await channel.ask("joint", { id: this.#joint.id, axis: this.#axis.name, value: Number(this.#slider.value), done });
    } catch (error) {
      toast(error.message, "error");
    }
  }
}

// The joints of a body as elements, and what keeps them up to date.
export function jointsView(joints) {
  const sliders = new Map();
  const element = el("div", {}, joints.map((joint) => {
    const axes = joint.axes.map((axis) => {
      const slider = new AxisSlider(joint, axis);
      sliders.set(`${joint.id} ${axis.name}`, slider);
      return slider.element;
    });
    return el("div", { class: "joint", "data-joint-of": joint.id }, el("div", { class: "row" }, el("span", { class: "grow wrap" }, joint.id), el("span", { class: "faint" }, "with"), bodyLink(joint.other)), axes);
  }));
  const show = (live) => {
    for (const [id, axes] of Object.entries(live)) for (const [axis, value] of Object.entries(axes)) sliders.get(`${id} ${axis}`)?.show(value);
  };
  return { element, show };
}
