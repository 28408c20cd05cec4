// Links: a body's id that selects it.

import { el } from "./dom.js";
import { selection } from "./selection.js";

export function bodyLink(id, text = id) {
  return el("button", { type: "button", class: "link", "data-link": id, title: `Select ${id}`, onclick: () => selection.choose(id, { focus: true }) }, text);
}
