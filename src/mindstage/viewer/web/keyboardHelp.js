// The keyboard help: a dialog with the keys of all commands.

import { el, replaceChildren } from "./dom.js";
import { icon } from "./icons.js";

const MOUSE = [
  ["Click", "Select a body; click it again to select nothing"],
  ["Shift+Click, Ctrl+Click", "Add a body to the selection, or remove it"],
  ["Drag a body", "Pull it, while the simulation plays"],
  ["Drag elsewhere", "Orbit the camera; with the right button, pan; with the wheel, zoom"],
  ["Shift while dragging the gizmo", "Move or turn by a tenth"],
  ["Drag from the Add panel", "Add an object where it is dropped"],
];

class KeyboardHelp {
  #body = el("div", { class: "help-groups" });
  #dialog = el("dialog", { id: "keyboard-help", "aria-labelledby": "help-title", onclick: (event) => event.target === this.#dialog && this.#dialog.close() },
    el("header", {}, el("h2", { id: "help-title" }, "Keyboard and mouse"), el("button", { type: "button", class: "flat", "aria-label": "Close", onclick: () => this.#dialog.close() }, icon("close"))), this.#body);

  constructor() {
    document.body.append(this.#dialog);
  }

  // Opens it for a table of commands; `keyText` writes a key.
  open(commands, keyText) {
    const groups = groupBy(commands);
    const row = (keys, text) => el("div", { class: "help-row" }, el("dt", {}, keys.map((key) => el("kbd", {}, key))), el("dd", {}, text));
    const group = (title, rows) => el("section", {}, el("h3", {}, title), el("dl", {}, rows));
    const bookmarks = [row(["1 … 9"], "Go to a saved view"), row([keyText("Shift+1"), "…"], "Save this view")];
    replaceChildren(this.#body,
      [...groups].filter(([title, list]) => title !== "Bookmarks" && list.some(({ keys }) => keys.length)).map(([title, list]) => group(title, list.filter(({ keys }) => keys.length).map(({ keys, title: text }) => row(keys.map(keyText), text)))),
      group("Bookmarks", bookmarks), group("Mouse", MOUSE.map(([keys, text]) => row([keys], text))));
    this.#dialog.showModal();
  }
}

function groupBy(commands) {
  const groups = new Map();
  for (const each of commands) groups.set(each.group, [...(groups.get(each.group) ?? []), each]);
  return groups;
}

export const keyboardHelp = new KeyboardHelp();
