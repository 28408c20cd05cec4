// The Help menu of the toolbar; modules of the page add their entries.

import { el } from "./dom.js";

const menu = el("div", { id: "help-menu", class: "popup-menu", popover: "auto", role: "group", "aria-label": "Help" });
const button = el("button", { id: "help", type: "button", class: "flat", "aria-label": "Help", title: "Help", "aria-expanded": "false", "aria-controls": menu.id, popovertarget: menu.id }, "?");
document.getElementById("toolbar").append(button);
document.body.append(menu);
menu.addEventListener("toggle", ({ newState }) => {
  button.setAttribute("aria-expanded", String(newState === "open"));
  if (newState === "open") menu.querySelector("button")?.focus();
});
// A click into the 3D view, a frame of its own, does not reach this document.
window.addEventListener("blur", () => document.activeElement?.tagName === "IFRAME" && menu.hidePopover());

export const helpMenu = {
  // Adds an entry: {title, run, action: its name for tests and style sheets}.
  add({ title, run, action }) {
    menu.append(el("button", { type: "button", class: "flat", "data-action": action, onclick: () => {
      menu.hidePopover();
      run();
    } }, title));
  },

  focus() {
    button.focus();
  },
};
