// Joint sliders: one for each free axis. While the simulation plays a slider pulls the moving body, so that obstacles
// stop it; while it is paused the body is placed at the joint position.

import { channel } from "./rpcChannel.js";
import { el, formatNumber } from "./dom.js";
import { bodyLink } from "./selection.js";
import { toast } from "./toasts.js";

const DEGREES = 180 / Math.PI;
const UNLIMITED_RANGE = { prismatic: 1, revolute: Math.PI }; // [m], [rad]
const MIN_INTERVAL_MS = 60;

class AxisSlider {
  #joint;
  #axis;
  #dragging = false;
  #sentAt = 0;
  #value = el("output", { "data-role": "joint-value" });
  #slider;
  #blocked = el("div", { class: "error-text", role: "status", "data-role": "blocked" });

  constructor(joint, axis) {
    this.#joint = joint;
    this.#axis = axis;
    const range = axis.is_prismatic ? UNLIMITED_RANGE.prismatic : UNLIMITED_RANGE.revolute;
    this.#slider = el("input", {
      type: "range", min: String(axis.lower ?? -range), max: String(axis.upper ?? range), step: "any", value: "0",
      "aria-label": `${joint.id}: ${axis.name}`, "data-joint": joint.id, "data-axis": axis.name,
      oninput: () => this.#moveJoint(false), onchange: () => this.#moveJoint(true),
    });
    this.element = el("div", { class: "axis" }, el("span", { class: "muted" }, axis.is_prismatic ? `translation ${axis.name}` : `rotation ${axis.name}`), this.#value, this.#slider,
      el("div", { class: "limits muted" }, el("span", {}, axis.lower === null ? "no limit" : this.#format(axis.lower)), el("span", {}, axis.upper === null ? "no limit" : this.#format(axis.upper))), this.#blocked);
  }

  // Shows the current joint position [m or rad].
  show(value) {
    this.#value.textContent = this.#format(value);
    this.#value.value = this.#format(value);
    if (!this.#dragging) this.#slider.value = String(value);
  }

  #format(value) {
    return this.#axis.is_prismatic ? `${formatNumber(value, 3)} m` : `${formatNumber(value * DEGREES, 1)}°`;
  }

  async #moveJoint(done) {
    this.#dragging = !done;
    const now = performance.now();
    if (!done && now - this.#sentAt < MIN_INTERVAL_MS) return;
    this.#sentAt = now;
    try {
      const { blocked_by: blocker } = await channel.call("move_joint", { id: this.#joint.id, axis: this.#axis.name, value: Number(this.#slider.value), done });
      this.#blocked.textContent = blocker ? `stopped by ${blocker}` : "";
    } catch (error) {
      toast(error.message, "error");
    }
  }
}

// The sliders of a body's joints: the element, and `show(positions)` with the joint positions by joint id and axis.
export function jointSliders(joints) {
  const sliders = new Map();
  const element = el("div", {}, joints.map((joint) => {
    const axes = joint.axes.map((axis) => {
      const slider = new AxisSlider(joint, axis);
      sliders.set(`${joint.id} ${axis.name}`, slider);
      return slider.element;
    });
    return el("div", { class: "joint", "data-joint-of": joint.id }, el("div", { class: "row" }, el("span", { class: "grow wrap" }, joint.id), el("span", { class: "muted" }, "to"), bodyLink(joint.other_body)), axes);
  }));
  const show = (positions) => {
    for (const [id, axes] of Object.entries(positions)) for (const [axis, value] of Object.entries(axes)) sliders.get(`${id} ${axis}`)?.show(value);
  };
  return { element, show };
}
