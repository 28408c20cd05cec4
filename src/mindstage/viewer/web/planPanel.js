// The Plan panel: a plan as text, its steps added by form, the verdict, and the ghosts that show it in the view.

import { el, formatNumber, replaceChildren } from "./dom.js";
import { nameField } from "./nameCompletion.js";
import { panels } from "./panels.js";
import { channel } from "./rpcChannel.js";
import { selection } from "./selection.js";
import { callOrToast } from "./toasts.js";

// How each action is written as a step; "other" is a second body, "number" a force, a distance or a time.
const ACTIONS = {
  "place on": { other: "on", step: (thing, other) => `{do: place, thing: ${thing}, on: ${other}}` },
  "place into": { other: "into", step: (thing, other) => `{do: place, thing: ${thing}, into: ${other}}` },
  "push along x": { number: "N", step: (thing, _, value) => `{do: push, thing: ${thing}, force: [${value}, 0, 0]}` },
  "push along y": { number: "N", step: (thing, _, value) => `{do: push, thing: ${thing}, force: [0, ${value}, 0]}` },
  open: { step: (thing) => `{do: open, thing: ${thing}}` },
  close: { step: (thing) => `{do: close, thing: ${thing}}` },
  wait: { number: "s", noThing: true, step: (_, __, value) => `{do: wait, duration_s: ${value}}` },
};
const EXAMPLE = "steps:\n  - {do: wait, duration_s: 2}\n";

// A name as YAML; quoted unless it is a plain word.
const quoted = (name) => (/^[A-Za-z_][\w-]*$/.test(name) ? name : JSON.stringify(name));

// Appends an item to a list of a plan, which is created at the end if it does not exist.
export function withItem(text, list, item) {
  const lines = text.trimEnd().split("\n").filter((line, number, all) => line || all.length > 1);
  const start = lines.findIndex((line) => line.startsWith(`${list}:`));
  if (start < 0) return [...lines, `${list}:`, `  - ${item}`, ""].join("\n");
  let end = start + 1;
  while (end < lines.length && /^[\s-]/.test(lines[end])) end += 1;
  lines.splice(end, 0, `  - ${item}`);
  return `${lines.join("\n")}\n`;
}

class PlanPanel {
  #text = el("textarea", { rows: "8", spellcheck: "false", "aria-label": "Plan", "data-role": "plan", placeholder: EXAMPLE });
  #samples = el("input", { type: "number", min: "1", max: "100000", value: "100", "aria-label": "Samples" });
  #workers = el("input", { type: "number", min: "1", max: "64", value: "1", "aria-label": "Processes" });
  #run = el("button", { type: "button", class: "primary", "data-action": "plan-evaluate", onclick: () => this.#start() }, "Try");
  #act = el("button", { type: "button", "data-action": "plan-act", title: "Does the plan in the world itself; it can be undone", onclick: () => this.#do() }, "Do it");
  #cancel = el("button", { type: "button", "data-action": "plan-cancel", hidden: true, onclick: () => callOrToast("plan.cancel") }, "Cancel");
  #result = el("div", { class: "verdict", "aria-live": "polite", "data-role": "verdict" });
  #copies = el("div", { class: "copies", "data-role": "copies", hidden: true });
  #builder = el("div", { class: "plan-builder" });

  build(root) {
    root.append(
      el("p", { class: "muted description" }, "Tries a plan in copies of the world, which stays as it is, or does it."),
      this.#builder, this.#text,
      el("div", { class: "row" }, el("label", { class: "row" }, el("span", {}, "samples"), this.#samples), el("label", { class: "row" }, el("span", {}, "processes"), this.#workers)),
      el("div", { class: "row" }, this.#run, this.#act, this.#cancel, this.#file()), this.#result, this.#copies);
    this.#text.addEventListener("keydown", (event) => event.key === "Enter" && (event.ctrlKey || event.metaKey) && this.#start());
    this.#buildForm();
    channel.on("plan", (state) => this.#show(state));
    channel.on("copies", (state) => this.#showCopies(state));
  }

  // -- the plan ------------------------------------------------------------------------------------------------------

  #buildForm() {
    const menu = el("select", { "aria-label": "Step", "data-role": "step", onchange: () => update() }, Object.keys(ACTIONS).map((name) => el("option", { value: name }, name)));
    const { root: other, input: otherInput } = nameField({ kind: "individual", label: "Where", placeholder: "where", "data-argument": "other" });
    const number = el("input", { type: "number", step: "any", value: "2", "aria-label": "Value", "data-argument": "number" });
    const unit = el("span", { class: "muted" });
    const spread = el("input", { type: "number", min: "0", step: "any", value: "1", "aria-label": "Deviation in cm" });
    const update = () => {
      const action = ACTIONS[menu.value];
      other.hidden = !action.other;
      number.hidden = unit.hidden = !action.number;
      unit.textContent = action.number ?? "";
    };
    const add = () => {
      const action = ACTIONS[menu.value];
      if (!action.noThing && !selection.id) return this.#fail("Select the body first, in the view or the outline.");
      if (action.other && !otherInput.value.trim()) return this.#fail("Give the body to place it on or into.");
      const step = action.step(quoted(selection.id ?? ""), quoted(otherInput.value.trim()), Number(number.value));
      this.#text.value = withItem(this.#text.value, "steps", step);
    };
    const vary = () => {
      if (!selection.id) return this.#fail("Select the body whose place is uncertain.");
      this.#text.value = withItem(this.#text.value, "uncertainty", `{thing: ${quoted(selection.id)}, position_m: ${Number(spread.value) / 100}}`);
    };
    replaceChildren(this.#builder,
      el("div", { class: "row" }, menu, other, number, unit, el("button", { type: "button", "data-action": "add-step", onclick: add }, "Add step")),
      el("div", { class: "row" }, el("span", {}, "its place varies by"), spread, el("span", { class: "muted" }, "cm"), el("button", { type: "button", "data-action": "add-uncertainty", title: "The standard deviation of where the selected body is", onclick: vary }, "Add")));
    update();
  }

  #file() {
    const input = el("input", { type: "file", accept: ".json,.yaml,.yml", hidden: true });
    input.addEventListener("change", async () => {
      const [file] = input.files;
      if (file) this.#text.value = await file.text();
      input.value = "";
    });
    return el("span", {}, input, el("button", { type: "button", "data-action": "open-plan", onclick: () => input.click() }, "Open file…"));
  }

  async #start() {
    const params = { plan: this.#text.value, samples: Number(this.#samples.value), workers: Number(this.#workers.value) };
    try {
      await channel.call("plan.evaluate", params);
    } catch (error) {
      this.#fail(error.message);
    }
  }

  async #do() {
    try {
      await channel.call("plan.act", { plan: this.#text.value });
    } catch (error) {
      this.#fail(error.message);
    }
  }

  #fail(message) {
    replaceChildren(this.#result, el("p", { class: "error-text", role: "alert", "data-role": "error" }, message));
  }

  // -- the result ----------------------------------------------------------------------------------------------------

  #show(state) {
    const running = state.state === "running" || state.state === "acting";
    this.#run.disabled = this.#act.disabled = running;
    this.#cancel.hidden = !running;
    if (state.state === "error") this.#fail(state.error);
    else if (state.state === "acting") replaceChildren(this.#result, el("progress", { "aria-label": "The plan is being done" }), el("p", { class: "muted" }, `Doing ${state.name || "the plan"}…`));
    else if (state.state === "acted") replaceChildren(this.#result, el("h2", { "data-outcome": state.outcome }, state.outcome), el("p", { class: "wrap" }, state.why), el("div", { class: "row" }, el("button", { type: "button", "data-action": "plan-undo", onclick: () => callOrToast("undo") }, "Undo")));
    else if (running) this.#showProgress(state);
    else if (state.state === "done") this.#showVerdict(state);
    else if (state.state === "outdated") replaceChildren(this.#result, el("p", { class: "muted wrap" }, "The world has changed since the plan was tried."));
    else replaceChildren(this.#result);
  }

  #showProgress({ done, samples, succeeded, failed }) {
    const parts = done ? `${done} of ${samples}: ${succeeded} succeeded, ${failed} failed` : "Running…";
    replaceChildren(this.#result, el("progress", { max: String(samples), value: done, "aria-label": "Samples that have ended" }), el("p", { class: "muted" }, parts));
  }

  #showVerdict(state) {
    const { outcome, why, causes, assumptions, drawn, shown, failing_sample: failing, stopped } = state;
    const percent = (value) => `${formatNumber(100 * value, 0)} %`;
    const range = state.probability === null ? "" : `${percent(state.probability)} (${percent(state.interval[0])} to ${percent(state.interval[1])})`;
    const play = failing === null ? null : el("button", { type: "button", "data-action": "plan-replay", onclick: () => callOrToast("plan.replay") }, `Play sample ${failing}`);
    const clear = el("button", { type: "button", "data-action": "plan-clear", onclick: () => callOrToast("plan.clear") }, "Clear");
    replaceChildren(this.#result,
      el("h2", { "data-outcome": outcome }, `${outcome} ${range}`),
      el("p", { class: "wrap" }, why),
      causes.length ? el("ul", {}, causes.map(({ kind, thing, other, count }) => el("li", {}, [count, "×", thing, kind, other ? `(${other})` : ""].filter(Boolean).join(" ")))) : null,
      drawn.length ? el("p", { class: "muted wrap" }, `In the view: ${shown} end poses of ${drawn.slice(0, 3).join(", ")}${drawn.length > 3 ? ` and ${drawn.length - 3} more` : ""}; green succeeded, red failed, yellow unknown.`) : null,
      el("div", { class: "row" }, play, clear),
      el("details", {}, el("summary", {}, "Basis"), el("ul", {}, [`ended: ${stopped}`, ...assumptions].map((text) => el("li", { class: "wrap" }, text)))));
  }

  // -- open copies ---------------------------------------------------------------------------------------------------

  #showCopies({ shown, copies }) {
    this.#copies.hidden = !copies.length;
    const toggle = el("input", { type: "checkbox", checked: shown, "data-action": "show-copies", onchange: (event) => callOrToast("plan.show_copies", { shown: event.target.checked }) });
    replaceChildren(this.#copies, el("label", { class: "row" }, toggle, "Show open copies of the simulation"),
      el("ul", {}, copies.map(({ number, color, time_s: time, differing }) => {
        const dot = el("span", { class: "dot", "aria-hidden": "true" });
        dot.style.background = color;
        return el("li", {}, dot, ` copy ${number} at ${formatNumber(time, 1)} s, ${differing} ${differing === 1 ? "body" : "bodies"} elsewhere`);
      })));
  }
}

const panel = new PlanPanel();
panels.add({ id: "plan", title: "Plan", side: "right", order: 40, build: (root) => panel.build(root) });
