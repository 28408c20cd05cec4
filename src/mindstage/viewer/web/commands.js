// All actions of the page: names, keys and functions. The toolbar, the command palette, the keyboard help and the
// keyboard read this table.
//
// A command is {id, title, group, keys, run(), enabled?(), icon?}. Keys are written "Ctrl+Shift+Z"; Ctrl is Cmd on a Mac.

import { channel } from "./rpcChannel.js";
import { askPanel } from "./askPanel.js";
import { commandPalette } from "./commandPalette.js";
import { boxSelection, viewTools } from "./viewTools.js";
import { detailsPanel } from "./detailsPanel.js";
import * as edit from "./editActions.js";
import { keyboardHelp } from "./keyboardHelp.js";
import { measureTool } from "./measureTool.js";
import { panels } from "./panels.js";
import { selection } from "./selection.js";
import { callOrToast } from "./toasts.js";
import { tour } from "./tour.js";
import { STANDARD_VIEWS, viewBookmarks } from "./viewsPanel.js";

const isMac = navigator.platform.startsWith("Mac");
const playing = () => Boolean(channel.latest("clock")?.playing);
const selected = () => selection.ids.length > 0;
const speed = () => Number(document.querySelector("[data-action=speed]")?.value ?? 1);

function toggleTool(tool, start) {
  if (viewTools.active === tool) viewTools.use(null);
  else start();
}

function openPanel(id) {
  panels.show(id);
  document.querySelector(`#panel-${id} :is(input, select, button, [tabindex="0"])`)?.focus();
}

function cancel() {
  if (viewTools.active) viewTools.use(null);
  else if (edit.gizmo.mode) edit.gizmo.toggle(edit.gizmo.mode);
  else if (document.body.dataset.picking !== "parent") selection.select(null);
}

export const commands = [
  { id: "palette", title: "Find a command…", group: "Help", keys: ["Ctrl+K"], run: () => commandPalette.open(paletteEntries()), icon: "search" },
  { id: "help", title: "Keyboard help", group: "Help", keys: ["?"], run: () => keyboardHelp.open(commands, keyText), icon: "help" },
  { id: "tour", title: "Start the tour", group: "Help", keys: [], run: () => tour.start({ focus: true }) },

  { id: "play", title: "Play or pause", group: "Simulation", keys: ["Space"], run: () => callOrToast(playing() ? "pause" : "play", playing() ? {} : { speed: speed() }), icon: "play" },
  { id: "step", title: "Step 0.1 s", group: "Simulation", keys: ["."], run: () => callOrToast("step", {}), icon: "step" },
  { id: "reset", title: "Reset to the spawned state", group: "Simulation", keys: [], run: () => callOrToast("reset"), icon: "reset" },

  { id: "undo", title: "Undo", group: "Edit", keys: ["Ctrl+Z"], run: () => callOrToast("undo"), icon: "undo" },
  { id: "redo", title: "Redo", group: "Edit", keys: ["Ctrl+Shift+Z", "Ctrl+Y"], run: () => callOrToast("redo"), icon: "redo" },
  { id: "history", title: "Show the history", group: "Edit", keys: ["Alt+H"], run: () => openPanel("history") },
  { id: "add", title: "Add an object…", group: "Edit", keys: ["Shift+A"], run: () => openPanel("add") },
  { id: "rename", title: "Rename the selected body", group: "Edit", keys: ["F2"], enabled: selected, run: () => detailsPanel.rename() },
  { id: "duplicate", title: "Duplicate the selected bodies", group: "Edit", keys: ["Ctrl+D"], enabled: selected, run: edit.duplicate },
  { id: "copy", title: "Copy the selected bodies", group: "Edit", keys: ["Ctrl+C"], enabled: selected, run: edit.copy },
  { id: "cut", title: "Cut the selected bodies", group: "Edit", keys: ["Ctrl+X"], enabled: selected, run: edit.cut },
  { id: "paste", title: "Paste bodies", group: "Edit", keys: ["Ctrl+V"], run: edit.paste },
  { id: "delete", title: "Delete the selected bodies", group: "Edit", keys: ["Delete"], enabled: selected, run: () => edit.deleteBodies() },

  { id: "select-all", title: "Select all bodies", group: "Selection", keys: ["Ctrl+A"], run: edit.selectEverything },
  { id: "select-class", title: "Select all bodies of this class", group: "Selection", keys: ["Shift+G"], enabled: selected, run: edit.selectClass },
  { id: "select-box", title: "Select bodies in a rectangle", group: "Selection", keys: ["B"], run: () => toggleTool("box", () => viewTools.use(boxSelection)) },
  { id: "cancel", title: "Cancel, or select nothing", group: "Selection", keys: ["Escape"], run: cancel },
  { id: "hide", title: "Hide the selected bodies", group: "Selection", keys: ["H"], enabled: selected, run: edit.hideSelected },
  { id: "isolate", title: "Show only the selected bodies", group: "Selection", keys: ["Shift+H"], enabled: selected, run: edit.isolate },
  { id: "show-all", title: "Show all hidden bodies", group: "Selection", keys: ["Ctrl+H"], enabled: edit.isAnythingHidden, run: edit.showAll },

  { id: "move", title: "Move with the gizmo", group: "Tools", keys: ["G"], run: () => edit.gizmo.toggle("move"), icon: "translate" },
  { id: "turn", title: "Turn with the gizmo", group: "Tools", keys: ["R"], run: () => edit.gizmo.toggle("turn"), icon: "rotate" },
  { id: "measure", title: "Measure a distance", group: "Tools", keys: ["M"], run: () => toggleTool("measure", () => measureTool.start()), icon: "measure" },
  { id: "gap", title: "Measure the gap between two selected bodies", group: "Tools", keys: ["Shift+M"], enabled: () => selection.ids.length >= 2, run: () => measureTool.gap() },

  { id: "focus", title: "Move the camera to the selected bodies", group: "View", keys: ["F"], run: () => callOrToast("focus", { ids: selection.ids }), icon: "focus" },
  { id: "reset-camera", title: "Reset the camera", group: "View", keys: ["Home"], run: () => callOrToast("reset_camera"), icon: "home" },
  { id: "view-from-top", title: "View from the top", group: "View", keys: ["T"], run: () => callOrToast("view_from_top"), icon: "top" },
  ...STANDARD_VIEWS.map((view, index) => ({ id: `view-${view}`, title: `View along an axis: ${view}`, group: "View", keys: [`Alt+${index + 1}`], run: () => viewBookmarks.goToStandard(view) })),
  { id: "save-view", title: "Save this view as a bookmark", group: "View", keys: [], run: () => viewBookmarks.save() },
  ...Array.from({ length: 9 }, (_, index) => index + 1).flatMap((number) => [
    { id: `go-to-view-${number}`, title: `Go to view ${number}`, group: "Bookmarks", keys: [`${number}`], run: () => viewBookmarks.goTo(number) },
    { id: `save-view-${number}`, title: `Save this view as ${number}`, group: "Bookmarks", keys: [`Shift+${number}`], run: () => viewBookmarks.save(number) },
  ]),
  ...[["outline", "Outline"], ["details", "Details"], ["ask", "Ask"], ["plan", "Plan"], ["robot", "Robot"], ["status", "Status"], ["views", "Views"]]
    .map(([id, title]) => ({ id: `panel-${id}`, title: `Open panel: ${title}`, group: "Panels", keys: [], enabled: () => Boolean(document.getElementById(`tab-${id}`)), run: () => openPanel(id) })),
];

export const command = (id) => commands.find((each) => each.id === id);

export function run(id) {
  const { enabled = () => true, run: action } = command(id);
  if (enabled()) return action();
}

// Commands, questions and bodies, for the palette.
function paletteEntries() {
  const bodies = (channel.latest("scene_tree")?.rows ?? []).map(([id, label]) => ({ title: `Select ${id}`, detail: label, group: "Bodies", run: () => selection.select(id, { focus: true }) }));
  const questions = askPanel.questions.map(({ name, text }) => ({ title: `Ask: ${name.replaceAll("_", " ")}`, detail: text, group: "Questions", run: () => {
    openPanel("ask");
    askPanel.show(name);
  } }));
  const actions = commands.filter(({ id }) => id !== "palette").map(({ title, group, keys, run: action, enabled = () => true }) => ({ title, group, keys: keys.map(keyText), run: action, disabled: !enabled() }));
  return [...actions, ...questions, ...bodies];
}

// -- keys --------------------------------------------------------------------------------------------------------------

const NAMES = { Escape: "Esc", Delete: "Del", " ": "Space" };

// A key as it is written on this computer's keyboard.
export function keyText(key) {
  const parts = key.split("+").map((part) => NAMES[part] ?? part);
  return isMac ? parts.join("").replace("Ctrl", "⌘").replace("Shift", "⇧").replace("Alt", "⌥") : parts.join("+");
}

function pressed(event) {
  // With Shift or Alt a digit has another character, which depends on the keyboard.
  const digit = /^Digit(\d)$/.exec(event.code ?? "")?.[1];
  const named = { " ": "Space", Backspace: "Delete" }[event.key] ?? event.key;
  const key = digit && named !== "?" ? digit : named.length === 1 ? named.toUpperCase() : named;
  const isSymbol = key.length === 1 && key.toLowerCase() === key.toUpperCase() && !digit;
  return [(event.ctrlKey || event.metaKey) && "Ctrl", event.altKey && "Alt", event.shiftKey && !isSymbol && "Shift", key].filter(Boolean).join("+");
}

const byKey = new Map(commands.flatMap((each) => each.keys.map((key) => [key, each])));

function isTyping(target) {
  return Boolean(target.closest?.("textarea, select, [contenteditable], input:not([type=checkbox], [type=range], [type=button], [type=color])"));
}

function hasOwnUse(event, key) {
  if (["Space", "Home", "Delete"].includes(key) && event.target.closest?.("button, summary, a, input, [role=tree], [role=option], [role=listbox], [role=slider]")) return key !== "Delete";
  return key === "Ctrl+C" && String(getSelection()) !== "";
}

// An element of a dialog keeps the focus after the dialog was closed, until the browser draws the page again.
const isInClosedDialog = (target) => Boolean(target.closest?.("dialog:not([open])"));

document.addEventListener("keydown", (event) => {
  const key = pressed(event);
  const found = byKey.get(key);
  if (!found || event.defaultPrevented || event.repeat && key === "Space" || document.querySelector("dialog[open]")) return;
  if (key === "Escape" && document.querySelector(":popover-open")) return; // the browser closes the menu
  if (found.id !== "palette" && !isInClosedDialog(event.target) && (isTyping(event.target) || hasOwnUse(event, key))) return;
  // Text is pasted by the event "paste", which needs no permission.
  if (key === "Ctrl+V" || (found.enabled && !found.enabled())) return;
  event.preventDefault();
  found.run();
});

export function pasteEvent(event) {
  if (isTyping(event.target)) return;
  event.preventDefault();
  const text = event.clipboardData?.getData("text/plain");
  if (text) edit.pasteText(text);
  else edit.paste();
}
document.addEventListener("paste", pasteEvent);
