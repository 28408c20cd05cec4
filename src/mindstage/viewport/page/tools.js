// The bar: time, what was edited, and the view.

import { channel } from "./channel.js";
import { el } from "./dom.js";
import { icon } from "./icons.js";
import { selection } from "./selection.js";
import { attempt } from "./toasts.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5];
const LABELS = [["none", "No labels"], ["selected", "Label of the selected"], ["class", "Labels of its class"], ["all", "All labels"]];

function button(sign, title, action, attributes = {}) {
  return el("button", { type: "button", class: "quiet", title, "aria-label": title, onclick: action, ...attributes }, icon(sign));
}

// -- time ----------------------------------------------------------------------------------------------------------

const speed = el("select", { "aria-label": "Speed", "data-do": "speed", title: "Speed",
  onchange: () => channel.latest("clock")?.playing && attempt("play", { speed: Number(speed.value) }) },
  SPEEDS.map((each) => el("option", { value: String(each) }, `${each} ×`)));
speed.value = "1";
const play = button("play", "Play", () => attempt(channel.latest("clock")?.playing ? "pause" : "play", channel.latest("clock")?.playing ? {} : { speed: Number(speed.value) }), { "data-do": "play" });
const step = button("step", "Step: a tenth of a second", () => attempt("step", {}), { "data-do": "step" });
const reset = button("reset", "Reset: as it was spawned", () => attempt("reset"), { "data-do": "reset" });
const undo = button("undo", "Undo", () => attempt("undo"), { "data-do": "undo", disabled: true });
const redo = button("redo", "Redo", () => attempt("redo"), { "data-do": "redo", disabled: true });
document.getElementById("time").append(play, step, speed, reset, undo, redo);

let playing = null;

channel.on("clock", (clock) => {
  if (clock.playing !== playing) {
    playing = clock.playing;
    play.replaceChildren(icon(playing ? "pause" : "play"));
    play.title = playing ? "Pause" : "Play";
    play.setAttribute("aria-label", play.title);
    play.setAttribute("aria-pressed", String(playing));
  }
  if (playing && SPEEDS.includes(clock.speed)) speed.value = String(clock.speed);
});

channel.on("history", ({ undo: last, redo: next }) => {
  name(undo, "Undo", last);
  name(redo, "Redo", next);
});

function name(which, verb, what) {
  which.disabled = what === null;
  which.title = what === null ? `Nothing to ${verb.toLowerCase()}` : `${verb}: ${what}`;
  which.setAttribute("aria-label", what === null ? verb : `${verb}: ${what}`);
}

// -- the view ------------------------------------------------------------------------------------------------------

const height = el("input", { type: "range", min: "0", max: "4", step: "0.05", value: "1.8", hidden: true, "aria-label": "Height of the section [m]", title: "Height of the section",
  oninput: () => attempt("section", { height: Number(height.value) }) });
const section = button("section", "Section: hide what is above a height", () => {
  height.hidden = !height.hidden;
  section.setAttribute("aria-pressed", String(!height.hidden));
  attempt("section", { height: height.hidden ? null : Number(height.value) });
}, { "data-do": "section", "aria-pressed": "false" });
const labels = el("select", { "aria-label": "Labels", title: "Labels", "data-do": "labels", onchange: () => attempt("label", { mode: labels.value }) },
  LABELS.map(([value, text]) => el("option", { value }, text)));
const gizmos = ["move", "turn"].map((mode) => button(mode, mode === "move" ? "Move the selected by handles" : "Turn the selected by handles", () => {
  const wanted = gizmos.find((each) => each.dataset.gizmo === mode).getAttribute("aria-pressed") !== "true" ? mode : null;
  for (const each of gizmos) each.setAttribute("aria-pressed", String(each.dataset.gizmo === wanted));
  attempt("gizmo", { mode: wanted });
}, { "data-gizmo": mode, "aria-pressed": "false" }));
const shells = el("input", { type: "checkbox", checked: true, onchange: () => attempt("show_shells", { shown: shells.checked }) });
const outlines = el("label", { class: "row", title: "Outlines of what encloses the whole place", hidden: true }, shells, "Outlines");

document.getElementById("tools").append(
  button("home", "Home: as it opened", () => attempt("home"), { "data-do": "home" }),
  button("top", "From above", () => attempt("top"), { "data-do": "top" }),
  button("focus", "Fly to the selected", () => attempt("focus", { ids: selection.id ? [selection.id] : [] }), { "data-do": "focus" }),
  ...gizmos, section, height, labels, outlines,
);

channel.on("shown", ({ shells: shown }) => {
  shells.checked = shown;
});
channel.on("world", ({ rows }) => {
  outlines.hidden = !rows.some(([, , , , , , , shell]) => shell);
});

// -- the line below ------------------------------------------------------------------------------------------------

const foot = { state: el("span", { "data-role": "state" }), bodies: el("span"), engine: el("span"), fault: el("span", { class: "bad-text", role: "alert" }) };
document.getElementById("foot").append(foot.state, foot.bodies, foot.engine, foot.fault);

const faults = { world: "", page: "" };
const sayFaults = () => {
  foot.fault.textContent = [faults.world, faults.page].filter(Boolean).join(" · ");
};

channel.on("clock", ({ time_s: time, playing: plays, factor, bodies, fault }) => {
  foot.state.textContent = `${time.toFixed(1)} s · ${plays ? `playing at ${factor.toFixed(2)} × real time` : "paused"}`;
  foot.bodies.textContent = `${bodies} bodies`;
  faults.world = fault;
  sayFaults();
});
channel.on("fault", (text) => {
  faults.page = text;
  sayFaults();
});
channel.on("world", ({ name: title, engine, joints }) => {
  foot.engine.textContent = `${joints} joints · ${engine}`;
  document.getElementById("world-name").textContent = title || "Mindstage";
  document.title = title ? `${title} – Mindstage` : "Mindstage";
});

// -- keys ----------------------------------------------------------------------------------------------------------

document.addEventListener("keydown", (event) => {
  if (event.target.closest?.("input, select, textarea")) return;
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z") {
    event.preventDefault();
    attempt(event.shiftKey ? "redo" : "undo");
  } else if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "y") {
    event.preventDefault();
    attempt("redo");
  } else if (event.key === "Delete" && selection.id) {
    attempt("delete", { ids: [selection.id] });
  } else if (event.key === "f" && !event.ctrlKey && !event.metaKey) {
    attempt("focus", { ids: selection.id ? [selection.id] : [] });
  }
});
