// The toolbar (time, undo, camera, display), the status bar and the keyboard shortcuts.

import { channel } from "./rpcChannel.js";
import { el } from "./dom.js";
import { icon } from "./icons.js";
import { selection } from "./selection.js";
import { callOrToast, toast } from "./toasts.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5];
const LABEL_MODES = [["none", "No labels"], ["selected", "Label selected body"], ["class", "Label bodies of its class"], ["all", "Label all bodies"]];

function iconButton(iconName, title, onclick, attributes = {}) {
  return el("button", { type: "button", class: "flat", title, "aria-label": title, onclick, ...attributes }, icon(iconName));
}

// -- time ----------------------------------------------------------------------------------------------------------

const speed = el("select", { "aria-label": "Speed", "data-action": "speed", title: "Speed",
  onchange: () => channel.latest("clock")?.playing && callOrToast("play", { speed: Number(speed.value) }) },
  SPEEDS.map((factor) => el("option", { value: String(factor) }, `${factor} ×`)));
speed.value = "1";
const play = iconButton("play", "Play", () => callOrToast(channel.latest("clock")?.playing ? "pause" : "play", channel.latest("clock")?.playing ? {} : { speed: Number(speed.value) }), { "data-action": "play" });
const step = iconButton("step", "Step 0.1 s", () => callOrToast("step", {}), { "data-action": "step" });
const reset = iconButton("reset", "Reset to the spawned state", () => callOrToast("reset"), { "data-action": "reset" });
const undo = iconButton("undo", "Undo", () => callOrToast("undo"), { "data-action": "undo", disabled: true });
const redo = iconButton("redo", "Redo", () => callOrToast("redo"), { "data-action": "redo", disabled: true });
const record = el("button", { type: "button", class: "flat record", "data-action": "record", "aria-pressed": "false", onclick: () => toggleRecording() }, icon("record"), el("span", { "data-role": "recorded-time" }));
document.getElementById("time-controls").append(play, step, speed, reset, undo, redo, record);

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

channel.on("history", ({ undo: undoable, redo: redoable }) => {
  updateHistoryButton(undo, "Undo", undoable);
  updateHistoryButton(redo, "Redo", redoable);
});

function updateHistoryButton(button, verb, edit) {
  button.disabled = edit === null;
  button.title = edit === null ? `Nothing to ${verb.toLowerCase()}` : `${verb}: ${edit}`;
  button.setAttribute("aria-label", edit === null ? verb : `${verb}: ${edit}`);
}

// -- recording -----------------------------------------------------------------------------------------------------

async function toggleRecording() {
  if (channel.latest("recording")?.path) {
    const done = await callOrToast("recording.stop");
    if (done) toast(`Recorded ${done.time_s.toFixed(1)} s (${(done.size_bytes / 1e6).toFixed(2)} MB) to ${done.path}. Replay it with: mindstage replay ${done.path}`);
  } else {
    const path = await callOrToast("recording.start");
    if (path) toast(`Recording to ${path}`);
  }
}

channel.on("recording", ({ path, time_s: time, failed }) => {
  const title = path ? `${failed ? "The recording has failed; stop it to see why" : "Stop recording"}: ${path}` : "Record an episode";
  record.title = title;
  record.setAttribute("aria-label", title);
  record.setAttribute("aria-pressed", String(Boolean(path)));
  record.lastChild.textContent = path ? (failed ? "failed" : `${time} s`) : "";
});

// -- camera and display ------------------------------------------------------------------------------------------------------

const clippingHeight = el("input", { type: "range", min: "0", max: "4", step: "0.05", value: "1.8", hidden: true, "aria-label": "Clipping height [m]", title: "Clipping height",
  oninput: () => callOrToast("set_clipping_height", { height: Number(clippingHeight.value) }) });
const clipButton = iconButton("clip", "Clip: hide everything above a height", () => {
  clippingHeight.hidden = !clippingHeight.hidden;
  clipButton.setAttribute("aria-pressed", String(!clippingHeight.hidden));
  callOrToast("set_clipping_height", { height: clippingHeight.hidden ? null : Number(clippingHeight.value) });
}, { "data-action": "clip", "aria-pressed": "false" });
const labels = el("select", { "aria-label": "Labels", title: "Labels", "data-action": "labels", onchange: () => callOrToast("set_labels", { mode: labels.value }) },
  LABEL_MODES.map(([value, text]) => el("option", { value }, text)));
const gizmoButtons = ["move", "turn"].map((mode) => iconButton(mode === "move" ? "translate" : "rotate", mode === "move" ? "Translate gizmo on the selected body" : "Rotate gizmo on the selected body", () => {
  const requested = gizmoButtons.find((each) => each.dataset.gizmo === mode).getAttribute("aria-pressed") !== "true" ? mode : null;
  for (const each of gizmoButtons) each.setAttribute("aria-pressed", String(each.dataset.gizmo === requested));
  callOrToast("set_gizmo", { mode: requested });
}, { "data-gizmo": mode, "aria-pressed": "false" }));
const enclosures = el("input", { type: "checkbox", checked: true, onchange: () => callOrToast("show_enclosures", { shown: enclosures.checked }) });
const outlines = el("label", { class: "row", title: "Show the outlines of enclosing bodies such as walls and sky spheres", hidden: true }, enclosures, "Outlines");

document.getElementById("view-controls").append(
  iconButton("home", "Reset the camera", () => callOrToast("reset_camera"), { "data-action": "reset-camera" }),
  iconButton("top", "View from the top", () => callOrToast("view_from_top"), { "data-action": "view-from-top" }),
  iconButton("focus", "Focus the selected body", () => callOrToast("focus", { ids: selection.id ? [selection.id] : [] }), { "data-action": "focus" }),
  ...gizmoButtons, clipButton, clippingHeight, labels, outlines,
);

channel.on("visibility", ({ enclosures: shown }) => {
  enclosures.checked = shown;
});
channel.on("scene_tree", ({ rows }) => {
  outlines.hidden = !rows.some(([, , , , , , , encloses]) => encloses);
});

// -- status bar ----------------------------------------------------------------------------------------------------

const statusBar = { state: el("span", { "data-role": "state" }), bodies: el("span"), engine: el("span"), fault: el("span", { class: "error-text", role: "alert" }) };
document.getElementById("status-bar").append(statusBar.state, statusBar.bodies, statusBar.engine, statusBar.fault);

const faults = { simulation: "", viewer: "" };
const showFaults = () => {
  statusBar.fault.textContent = [faults.simulation, faults.viewer].filter(Boolean).join(" · ");
};

channel.on("clock", ({ time_s: time, playing: isPlaying, real_time_factor: factor, bodies, fault }) => {
  statusBar.state.textContent = `${time.toFixed(1)} s · ${isPlaying ? `playing at ${factor.toFixed(2)} × real time` : "paused"}`;
  statusBar.bodies.textContent = `${bodies} bodies`;
  faults.simulation = fault;
  showFaults();
});
channel.on("viewer_error", (text) => {
  faults.viewer = text;
  showFaults();
});
channel.on("scene_tree", ({ name: title, engine, joints }) => {
  statusBar.engine.textContent = `${joints} joints · ${engine}`;
  document.getElementById("world-name").textContent = title || "Mindstage";
  document.title = title ? `${title} – Mindstage` : "Mindstage";
});

// -- keyboard shortcuts ----------------------------------------------------------------------------------------------------------

document.addEventListener("keydown", (event) => {
  if (event.target.closest?.("input, select, textarea")) return;
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z") {
    event.preventDefault();
    callOrToast(event.shiftKey ? "redo" : "undo");
  } else if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "y") {
    event.preventDefault();
    callOrToast("redo");
  } else if (event.key === "Delete" && selection.id) {
    callOrToast("delete", { ids: [selection.id] });
  } else if (event.key === "f" && !event.ctrlKey && !event.metaKey) {
    callOrToast("focus", { ids: selection.id ? [selection.id] : [] });
  }
});
