// A dialog with a question and a button for each answer.

import { el } from "./dom.js";

// Asks with buttons: [[value, text], ...]; Escape and the last button, `otherwise`, are null, as is an abort by `signal`.
export function ask(title, text, choices, { otherwise = "Cancel", signal } = {}) {
  return new Promise((resolve) => {
    const button = ([value, label], index) => el("button", { type: "button", class: index === 0 ? "primary" : "", "data-choice": value, autofocus: index === 0, onclick: () => dialog.close(value) }, label);
    const dialog = el("dialog", { class: "choice", "aria-labelledby": "choice-title", onclose: () => {
      dialog.remove();
      resolve(dialog.returnValue || null);
    } }, el("h2", { id: "choice-title" }, title), el("p", {}, text),
    el("div", { class: "choices" }, choices.map(button), el("button", { type: "button", "data-choice": "cancel", onclick: () => dialog.close("") }, otherwise)));
    document.body.append(dialog);
    dialog.showModal();
    signal?.addEventListener("abort", () => dialog.close(""));
  });
}
