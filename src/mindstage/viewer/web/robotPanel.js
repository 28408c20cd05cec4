// The Robot panel: adds robots, runs their skills, and moves their joints, grippers and base.

import { channel } from "./rpcChannel.js";
import { el, formatNumber, replaceChildren } from "./dom.js";
import { nameField } from "./nameCompletion.js";
import { panels } from "./panels.js";
import { bodyLink, selection } from "./selection.js";
import { callOrToast } from "./toasts.js";

const DEGREES = 180 / Math.PI;
const UNLIMITED = Math.PI; // shown range of a joint without limits [rad or m]
const MIN_INTERVAL_MS = 80;
const DRIVE_INTERVAL_MS = 150; // the robot stops by itself if no velocity arrives for some tenths of a second
const DEFAULT_SKILL = "open";

// Directions of the driving buttons: forward, left and turn, as shares of the largest velocities.
const DIRECTIONS = [
  ["↺", "Turn left", [0, 0, 1]], ["↑", "Forward", [1, 0, 0]], ["↻", "Turn right", [0, 0, -1]],
  ["←", "Left", [0, 1, 0]], ["↓", "Backward", [-1, 0, 0]], ["→", "Right", [0, -1, 0]],
];

// The slider of a joint or of a gripper's opening; it shows the current position while it is not being moved.
class PositionSlider {
  #format;
  #send;
  #moving = false;
  #sentAt = 0;
  #slider;
  #value = el("output", { "data-role": "joint-value" });

  constructor({ name, lower, upper, is_prismatic: isPrismatic }, attributes, send) {
    this.#format = (value) => (isPrismatic ? `${formatNumber(value, 3)} m` : `${formatNumber(value * DEGREES, 1)}°`);
    this.#send = send;
    this.#slider = el("input", { type: "range", min: String(lower ?? -UNLIMITED), max: String(upper ?? UNLIMITED), step: "any", value: "0",
      "aria-label": name, ...attributes, oninput: () => this.#move(false), onchange: () => this.#move(true) });
    const limit = (value) => el("span", {}, value === null ? "no limit" : this.#format(value));
    this.element = el("div", { class: "axis" }, el("span", { class: "wrap" }, name), this.#value, this.#slider, el("div", { class: "limits muted" }, limit(lower), limit(upper)));
  }

  show(value) {
    this.#value.textContent = this.#format(value);
    if (!this.#moving) this.#slider.value = String(value);
  }

  #move(done) {
    this.#moving = !done;
    const now = performance.now();
    if (!done && now - this.#sentAt < MIN_INTERVAL_MS) return;
    this.#sentAt = now;
    this.#send(Number(this.#slider.value));
  }
}

class RobotPanel {
  #robots = [];
  #skills = [];
  #measurable = [];
  #name = null;
  #sliders = new Map();
  #inputs = new Map();
  #driving = 0;
  #adding = el("div", { class: "robot-adding" });
  #menu = el("select", { "aria-label": "Robot", "data-role": "robot", onchange: () => this.#choose(this.#menu.value) });
  #remove = el("button", { type: "button", "data-action": "remove-robot", onclick: () => callOrToast("robots.remove", { robot: this.#name }) }, "Remove");
  #head = el("div", { class: "row" }, this.#menu, this.#remove);
  #skillForm = el("form", { class: "ask-form", "data-role": "skill-form", onsubmit: (event) => event.preventDefault() });
  #result = el("div", { class: "verdict", "aria-live": "polite", "data-role": "skill-result" });
  #arms = el("div", { "data-role": "arms" });
  #joints = el("div", { class: "joint", "data-role": "robot-joints" });
  #base = el("div", { class: "drive" });
  #facts = el("div");
  #body = el("div", {}, this.#skillForm, this.#result, this.#section("Gripper", this.#arms, true), this.#section("Joints", this.#joints, true), this.#section("Drive", this.#base), this.#section("Model", this.#facts));

  build(root) {
    root.append(this.#head, this.#body, this.#adding);
    this.#head.hidden = this.#body.hidden = true;
    channel.on("robots", (robots) => this.#showRobots(robots));
    channel.on("robot_states", (states) => this.#showStates(states));
    channel.on("connection", (connected) => connected && !this.#skills.length && this.#load());
  }

  #section(title, content, open = false) {
    return el("details", { class: "section", open, "data-section": title.toLowerCase() }, el("summary", {}, title), content);
  }

  async #load() {
    const offer = await callOrToast("robots.offer");
    if (!offer) return;
    this.#skills = offer.skills;
    this.#measurable = offer.measurable;
    this.#showAdding(offer.models);
    this.#showRobots(channel.latest("robots") ?? []);
  }

  // -- robots --------------------------------------------------------------------------------------------------------

  #showAdding(models) {
    const menu = el("select", { "aria-label": "Model", "data-role": "robot-model" }, models.map(({ name, title }) => el("option", { value: name }, title)));
    const add = el("button", { type: "button", class: "primary", "data-action": "add-robot", onclick: async () => {
      add.disabled = true;
      const name = await callOrToast("robots.add", { model: menu.value });
      add.disabled = false;
      if (name !== undefined) this.#choose(name);
    } }, "Add");
    replaceChildren(this.#adding, el("h2", {}, "Add a robot"), el("p", { class: "muted description" }, "It is put on the free floor nearest to the center of the view."), el("div", { class: "row" }, menu, add));
  }

  get #robot() {
    return this.#robots.find(({ name }) => name === this.#name);
  }

  #showRobots(robots) {
    this.#robots = robots;
    replaceChildren(this.#menu, robots.map(({ name, model }) => el("option", { value: name }, name === model ? name : `${name} (${model})`)));
    this.#choose(this.#robot ? this.#name : robots[0]?.name ?? null);
  }

  #choose(name) {
    this.#name = name;
    const robot = this.#robot;
    this.#head.hidden = this.#body.hidden = !robot;
    if (!robot) return;
    this.#menu.value = name;
    this.#showSkills();
    this.#showArms(robot);
    this.#showJoints(robot);
    this.#showBase(robot);
    this.#showFacts(robot);
    this.#showStates(channel.latest("robot_states") ?? {});
  }

  #call(method, params) {
    return callOrToast(`robots.${method}`, { robot: this.#name, ...params });
  }

  // Calls a method for a checkbox, which keeps its state until there is a response.
  async #toggle(box, method, params) {
    box.dataset.pending = String(Number(box.dataset.pending ?? 0) + 1);
    await this.#call(method, params);
    box.dataset.pending = String(Number(box.dataset.pending) - 1);
  }

  // -- skills --------------------------------------------------------------------------------------------------------

  #showSkills() {
    if (!this.#skills.length || this.#skillForm.children.length) return;
    const fields = el("div", { class: "ask-form" });
    const menu = el("select", { "aria-label": "Skill", "data-role": "skill", onchange: () => this.#showArguments(fields, menu.value) },
      this.#skills.map(({ name }) => el("option", { value: name }, name.replaceAll("_", " "))));
    if (this.#skills.some(({ name }) => name === DEFAULT_SKILL)) menu.value = DEFAULT_SKILL;
    const run = () => this.#call("skill", { skill: menu.value, args: this.#arguments() });
    replaceChildren(this.#skillForm, menu, fields, el("div", { class: "row" },
      el("button", { type: "button", class: "primary", "data-action": "run-skill", onclick: run }, "Run"),
      el("button", { type: "button", "data-action": "stop-robot", onclick: () => this.#call("stop") }, "Stop")));
    this.#showArguments(fields, menu.value);
  }

  #showArguments(fields, name) {
    const skill = this.#skills.find((each) => each.name === name);
    this.#inputs.clear();
    replaceChildren(fields, el("p", { class: "muted description" }, skill.text.split("\n\n")[0]), skill.arguments.map((argument) => this.#argumentField(argument)));
  }

  #argumentField({ name, kind, choices, completion, required }) {
    const label = name.replaceAll("_", " ");
    const attributes = { "aria-label": label, "data-argument": name, placeholder: required ? kind : `${kind} (optional)` };
    let field;
    let input;
    if (choices.length) field = input = el("select", attributes, required ? null : el("option", { value: "" }, "any"), choices.map((choice) => el("option", { value: choice }, choice)));
    else if (completion) ({ root: field, input } = nameField({ kind: completion, label, value: required && completion === "INDIVIDUAL" ? selection.id ?? "" : "", ...attributes }));
    else field = input = el("input", { type: kind === "number" ? "number" : "text", step: "any", ...attributes });
    this.#inputs.set(name, input);
    return el("label", { class: "argument" }, el("span", {}, label), field);
  }

  #arguments() {
    const values = [...this.#inputs].map(([name, input]) => [name, input.value.trim()]);
    return Object.fromEntries(values.filter(([, text]) => text));
  }

  #showResult(run) {
    if (!run) return replaceChildren(this.#result);
    const { state, skill, args, time_s: time, step, outcome, reason, suggestion, assumptions } = run;
    const title = [skill.replaceAll("_", " "), ...Object.values(args)].join(" ");
    const running = state === "running";
    replaceChildren(this.#result,
      el("h2", { "data-outcome": running ? "running" : outcome }, running ? `${title} …` : `${title}: ${outcome}`),
      el("p", { class: "muted" }, `${formatNumber(time, 1)} s simulated`, step ? `: ${step}` : ""),
      running ? el("progress", { "aria-label": "The skill is running" }) : null,
      reason ? el("p", { class: "wrap", "data-role": "skill-reason" }, reason) : null,
      suggestion ? el("p", { class: "wrap" }, `To try: ${suggestion}`) : null,
      assumptions?.length ? el("details", {}, el("summary", {}, "Assumptions"), el("ul", {}, assumptions.map((text) => el("li", { class: "wrap" }, text)))) : null);
  }

  // -- grippers ------------------------------------------------------------------------------------------------------

  #showArms({ arms, grippers }) {
    const rows = arms.map(({ name }) => {
      const drag = el("input", { type: "checkbox", "data-action": "drag-gripper", "data-arm": name, onchange: () => this.#toggle(drag, "target", { arm: name, shown: drag.checked }) });
      const height = el("input", { type: "number", min: "0", max: "3", step: "0.1", value: "0.9", "aria-label": "Height of the region [m]", onchange: () => region.checked && show() });
      const region = el("input", { type: "checkbox", "data-action": "show-region", "data-arm": name, onchange: () => show() });
      const show = () => this.#toggle(region, "region", { arm: name, height_m: Number(height.value), shown: region.checked });
      return el("div", { class: "arm", "data-arm-name": name },
        arms.length > 1 ? el("strong", {}, name) : null,
        el("label", { class: "row" }, drag, "drag the gripper in the view"),
        el("div", { class: "row" }, el("label", { class: "row" }, region, "show what it reaches at"), height, el("span", { class: "muted" }, "m")),
        el("p", { class: "muted wrap", "aria-live": "polite", "data-role": "target-reason" }));
    });
    this.#sliders.clear();
    const openings = grippers.map(({ name, max_opening_m: most }) => {
      const slider = new PositionSlider({ name: grippers.length > 1 ? `opening of ${name}` : "opening", lower: 0, upper: most, slides: true }, { "data-gripper": name }, (value) => this.#call("grip", { gripper: name, opening_m: value }));
      this.#sliders.set(`gripper ${name}`, slider);
      return slider.element;
    });
    replaceChildren(this.#arms, rows, el("div", { class: "joint" }, openings), el("p", { class: "wrap", "data-role": "held" }));
  }

  // -- joints and base -----------------------------------------------------------------------------------------------

  #showJoints({ joints }) {
    const groups = Map.groupBy ? Map.groupBy(joints, ({ group }) => group) : joints.reduce((found, joint) => found.set(joint.group, [...(found.get(joint.group) ?? []), joint]), new Map());
    replaceChildren(this.#joints, [...groups].map(([group, members]) => el("div", { "data-group": group }, el("strong", {}, group || "other"), members.map((joint) => {
      const slider = new PositionSlider(joint, { "data-robot-joint": joint.name }, (value) => this.#call("move_joint", { joint: joint.name, position: value }));
      this.#sliders.set(`joint ${joint.name}`, slider);
      return slider.element;
    }))));
  }

  #showBase({ base }) {
    const section = this.#base.closest("details");
    section.hidden = base.type === "fixed";
    const buttons = DIRECTIONS.filter(([, , [, left]]) => base.type === "planar" || !left).map(([text, label, direction]) => {
      const begin = (event) => {
        event.preventDefault();
        this.#drive(direction);
      };
      return el("button", { type: "button", "aria-label": label, title: label, "data-drive": label, onpointerdown: begin, onpointerup: () => this.#drive(null), onpointerleave: () => this.#drive(null), onpointercancel: () => this.#drive(null),
        onkeydown: (event) => ["Enter", " "].includes(event.key) && !event.repeat && begin(event), onkeyup: () => this.#drive(null), onblur: () => this.#drive(null) }, text);
    });
    replaceChildren(this.#base, buttons, el("output", { "data-role": "base-pose" }));
  }

  // Drives in a direction until it is null; velocities are repeated, since the robot stops without them.
  #drive(direction) {
    const was = this.#driving;
    clearInterval(this.#driving);
    this.#driving = 0;
    const send = () => this.#call("drive", { velocity: direction ?? [0, 0, 0] });
    if (direction) {
      send();
      this.#driving = setInterval(send, DRIVE_INTERVAL_MS);
    } else if (was) send();
  }

  #showFacts({ source, notes, sensors }) {
    const reading = el("p", { class: "wrap", "data-role": "reading" });
    replaceChildren(this.#facts, el("p", { class: "muted wrap" }, source),
      sensors.length ? el("p", { class: "wrap" }, `Sensors: ${sensors.join(", ")}`) : null,
      el("ul", { "data-role": "robot-notes" }, notes.map((text) => el("li", { class: "wrap" }, text))),
      el("div", { class: "row" }, this.#measurable.map((sensor) => el("button", { type: "button", "data-sensor": sensor, onclick: async () => {
        const measured = await this.#call("measure", { sensor });
        if (measured !== undefined) reading.textContent = JSON.stringify(measured);
      } }, `Measure ${sensor.replaceAll("_", " ")}`))), reading);
  }

  // -- the state -----------------------------------------------------------------------------------------------------

  #showStates(states) {
    const state = states[this.#name];
    if (!state) return;
    for (const [joint, position] of Object.entries(state.positions)) this.#sliders.get(`joint ${joint}`)?.show(position);
    for (const [gripper, opening] of Object.entries(state.openings)) this.#sliders.get(`gripper ${gripper}`)?.show(opening);
    for (const [arm, { shown, reason, region }] of Object.entries(state.targets)) {
      const row = this.#arms.querySelector(`[data-arm-name="${CSS.escape(arm)}"]`);
      if (!row) continue;
      for (const [action, checked] of [["drag-gripper", shown], ["show-region", region]]) {
        const box = row.querySelector(`[data-action=${action}]`);
        if (!Number(box.dataset.pending ?? 0)) box.checked = checked;
      }
      row.querySelector("[data-role=target-reason]").textContent = reason;
    }
    const held = this.#arms.querySelector("[data-role=held]");
    if (held) replaceChildren(held, Object.values(state.held).length ? ["holds ", ...Object.values(state.held).map((id) => bodyLink(id))] : null);
    const pose = this.#base.querySelector("output");
    if (pose) pose.textContent = `x ${formatNumber(state.base[0], 2)} m, y ${formatNumber(state.base[1], 2)} m, ${formatNumber(state.base[2] * DEGREES, 0)}°`;
    const key = JSON.stringify(state.skill);
    if (key !== this.#result.dataset.key) {
      this.#result.dataset.key = key;
      this.#showResult(state.skill);
    }
  }
}

const panel = new RobotPanel();
panels.add({ id: "robot", title: "Robot", side: "right", order: 50, build: (root) => panel.build(root) });
