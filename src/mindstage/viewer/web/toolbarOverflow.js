// Moves controls that do not fit into the toolbar to a menu at its end, and back when there is room.

import { el } from "./dom.js";
import { icon } from "./icons.js";
import "./helpMenu.js";

// Controls that are moved last; the others are moved from right to left.
const LAST = ["play", "undo", "redo", "reset-camera", "save", "step", "clip", "range", "focus", "load", "reset"];

const toolbar = document.getElementById("toolbar");
const menu = el("div", { id: "toolbar-menu", class: "popup-menu", popover: "auto", role: "group", "aria-label": "More controls" });
const button = el("button", { id: "toolbar-more", type: "button", class: "flat", "aria-label": "More controls", title: "More controls", "aria-expanded": "false", "aria-controls": menu.id, popovertarget: menu.id, hidden: true }, icon("more"));
const homes = new Map(); // moved control -> the comment at its place in the toolbar

const groups = () => [...toolbar.querySelectorAll(":scope > [role=toolbar]")];
const overflows = () => toolbar.scrollWidth > toolbar.clientWidth;

function nextToMove() {
  const controls = groups().flatMap((group) => [...group.children]).filter((control) => !control.hidden && control.type !== "file");
  const rank = (control) => LAST.indexOf(control.dataset.action ?? control.type);
  const free = controls.filter((control) => rank(control) < 0);
  return free.at(-1) ?? controls.reduce((last, control) => (last === null || rank(control) > rank(last) ? control : last), null);
}

function layOut() {
  observer.disconnect();
  const focused = document.activeElement;
  for (const [control, home] of homes) home.replaceWith(control);
  homes.clear();
  button.hidden = true;
  const moved = [];
  while (overflows()) {
    button.hidden = false;
    const control = nextToMove();
    if (!control) break;
    const home = document.createComment("moved to the menu");
    control.replaceWith(home);
    homes.set(control, home);
    moved.push(control);
  }
  const follows = (a, b) => homes.get(a).compareDocumentPosition(homes.get(b)) & Node.DOCUMENT_POSITION_FOLLOWING;
  moved.sort((a, b) => (follows(a, b) ? -1 : 1));
  menu.replaceChildren(...moved);
  if (!moved.length && menu.matches(":popover-open")) menu.hidePopover();
  // A control that was moved has lost the focus.
  if (focused !== document.activeElement && (menu.contains(focused) ? menu.matches(":popover-open") : toolbar.contains(focused))) focused.focus();
  observe();
}

// Controls are shown, hidden, added and renamed at any time.
const observer = new MutationObserver(() => layOut());
const observe = () => {
  for (const group of [...groups(), menu]) observer.observe(group, { childList: true, subtree: true, attributes: true, attributeFilter: ["hidden"], characterData: true });
};

toolbar.querySelector("#help").before(button);
document.body.append(menu);
menu.addEventListener("toggle", ({ newState }) => {
  const open = newState === "open";
  button.setAttribute("aria-expanded", String(open));
  if (open) menu.querySelector("button, select, input")?.focus();
});
// Choosing something closes the menu; sliders and check boxes leave it open.
menu.addEventListener("click", (event) => event.target.closest("button") && menu.hidePopover());
menu.addEventListener("change", (event) => event.target.matches("select") && menu.hidePopover());
// A click into the 3D view, a frame of its own, does not reach this document.
window.addEventListener("blur", () => document.activeElement?.tagName === "IFRAME" && menu.hidePopover());
new ResizeObserver(() => layOut()).observe(toolbar);
document.fonts.ready.then(layOut);
layOut();
