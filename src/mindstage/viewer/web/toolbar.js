// The toolbar (time, undo, camera, display) and the status bar. Buttons run commands of `commands.js`.

import { channel } from "./rpcChannel.js";
import { el, replaceChildren } from "./dom.js";
import { icon } from "./icons.js";
import { command, keyText, run } from "./commands.js";
import { gizmo } from "./editActions.js";
import { helpMenu } from "./helpMenu.js";
import { callOrToast, toast } from "./toasts.js";
import { viewTools } from "./viewTools.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5];
const LABEL_MODES = [["none", "No labels"], ["selected", "Label selected body"], ["class", "Label bodies of its class"], ["all", "Label all bodies"]];

function iconButton(iconName, title, onclick, attributes = {}) {
  return el("button", { type: "button", class: "flat", title, "aria-label": title, onclick, ...attributes }, icon(iconName));
}

// The button of a command.
function commandButton(id, attributes = {}) {
  const { title, keys, icon: iconName } = command(id);
  return iconButton(iconName, [title, keys.length && `(${keyText(keys[0])})`].filter(Boolean).join(" "), () => run(id), { "data-action": id, "aria-label": title, ...attributes });
}

// -- time ----------------------------------------------------------------------------------------------------------

const speed = el("select", { "aria-label": "Speed", "data-action": "speed", title: "Speed",
  onchange: () => channel.latest("clock")?.playing && callOrToast("play", { speed: Number(speed.value) }) },
  SPEEDS.map((factor) => el("option", { value: String(factor) }, `${factor} ×`)));
speed.value = "1";
const play = commandButton("play");
const step = commandButton("step");
const reset = commandButton("reset");
const undo = commandButton("undo", { disabled: true });
const redo = commandButton("redo", { disabled: true });
const record = el("button", { type: "button", class: "flat record", "data-action": "record", "aria-pressed": "false", onclick: () => toggleRecording() }, icon("record"), el("span", { "data-role": "recorded-time" }));
document.getElementById("time-controls").append(play, step, speed, reset, undo, redo, record);

let playing = null;

channel.on("clock", (clock) => {
  if (clock.playing !== playing) {
    playing = clock.playing;
    play.replaceChildren(icon(playing ? "pause" : "play"));
    play.title = `${playing ? "Pause" : "Play"} (${keyText("Space")})`;
    play.setAttribute("aria-label", playing ? "Pause" : "Play");
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
  button.title = `${edit === null ? `Nothing to ${verb.toLowerCase()}` : `${verb}: ${edit}`} (${keyText(command(verb.toLowerCase()).keys[0])})`;
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

let shownFault = null;
const liveEvents = el("ol", { id: "live-events", "data-role": "live-events", "aria-label": "Last events of the recording", hidden: true });
document.body.append(liveEvents);

channel.on("recording", ({ path, time_s: time, failed, fault, events, late_s: late }) => {
  liveEvents.hidden = !events.length && !late;
  replaceChildren(liveEvents, [
    ...events.map(({ id, kind, thing, other, begin_s: begin }) => el("li", { "data-event": id }, `${begin.toFixed(1)} s ${kind}: ${thing}${other ? `, ${other}` : ""}`)),
    ...(late ? [el("li", {}, `Events are ${late} s late`)] : []),
  ]);
  const title = path ? `${failed ? "The recording has failed; stop it" : "Stop recording"}: ${path}${fault ? `. ${fault}` : ""}` : "Record an episode";
  if (fault && fault !== shownFault) toast(`${failed ? "The recording has failed" : "A fault while recording"}: ${fault}`, "error");
  shownFault = fault;
  record.title = title;
  record.setAttribute("aria-label", title);
  record.setAttribute("aria-pressed", String(Boolean(path)));
  record.lastChild.textContent = path ? (failed ? "failed" : `${time} s${fault ? " ⚠" : ""}`) : "";
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
const gizmoButtons = ["move", "turn"].map((mode) => commandButton(mode, { "data-gizmo": mode, "aria-pressed": "false" }));
gizmo.onChange((active) => gizmoButtons.forEach((button) => button.setAttribute("aria-pressed", String(button.dataset.gizmo === active))));
const SNAPPINGS = {
  none: ["No snapping", { step_m: 0, step_deg: 0, to_surface: false }],
  surface: ["Snap to surfaces", { step_m: 0, step_deg: 15, to_surface: true }],
  fine: ["Snap 1 cm, 5°", { step_m: 0.01, step_deg: 5, to_surface: false }],
  medium: ["Snap 5 cm, 15°", { step_m: 0.05, step_deg: 15, to_surface: false }],
  coarse: ["Snap 25 cm, 45°", { step_m: 0.25, step_deg: 45, to_surface: false }],
};
const snapping = el("select", { "aria-label": "Snapping of the gizmo", title: "Snapping of the gizmo", "data-action": "snapping", onchange: () => gizmo.snap(SNAPPINGS[snapping.value][1]) },
  Object.entries(SNAPPINGS).map(([value, [text]]) => el("option", { value }, text)));
const measure = commandButton("measure", { "aria-pressed": "false" });
viewTools.onChange((tool) => measure.setAttribute("aria-pressed", String(tool === "measure")));
const enclosures = el("input", { type: "checkbox", checked: true, onchange: () => callOrToast("show_enclosures", { shown: enclosures.checked }) });
const outlines = el("label", { class: "row", title: "Show the outlines of enclosing bodies such as walls and sky spheres", hidden: true }, enclosures, "Outlines");

document.getElementById("view-controls").append(
  commandButton("reset-camera"), commandButton("view-from-top"), commandButton("focus"),
  ...gizmoButtons, snapping, measure, clipButton, clippingHeight, labels, outlines
);
for (const id of ["help", "palette"]) helpMenu.add({ title: `${command(id).title} (${keyText(command(id).keys[0])})`, action: id, run: () => run(id) });

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

channel.on("clock", ({ time_s: time, playing: isPlaying, real_time_factor: factor, bodies, fault, expected_rebuild_s: rebuild }) => {
  statusBar.state.textContent = `${time.toFixed(1)} s · ${isPlaying ? `playing at ${factor.toFixed(2)} × real time` : "paused"}${rebuild > 0.5 ? ` · the next step compiles for about ${rebuild.toFixed(1)} s` : ""}`;
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
