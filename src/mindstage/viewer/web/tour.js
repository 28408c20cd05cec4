// The tour: five steps that a new user does in the page itself. Each step notices that it was done; the tour can be
// skipped at any time and started again from the Help menu.

import { channel } from "./rpcChannel.js";
import { el, replaceChildren } from "./dom.js";
import { helpMenu } from "./helpMenu.js";
import { panels } from "./panels.js";
import { selection } from "./selection.js";
import { viewFrame } from "./viewFrame.js";

const STORED = "mindstage.tour";
const POLL_MS = 600;
const DONE_MS = 1400; // how long the check mark of a finished step is shown
const OPENED = 0.15; // of the range of the door
const CAMERA_MOVED_M = 0.05;
const VIEW_METHODS = new Set(["view_from_top", "focus", "reset_camera", "set_camera"]);
const FOOD = /milk/i;
const VESSEL = /mug|cup/i;
const touch = matchMedia("(pointer: coarse)").matches;

// Each step: {title, text(state), show?(): shows where to do it, asked?(method, params, result) and polled?(state): done}
const STEPS = [
  {
    title: "Look around",
    text: () => (touch ? "Drag one finger over the view to turn it, pinch to zoom, and drag two fingers to move it." : "Drag in the view to turn it, zoom with the wheel, and move with the right button. Keys work too: W, A, S, D and the arrows."),
    asked: (method) => VIEW_METHODS.has(method),
    polled: ({ camera }, tour) => tour.cameraMoved(camera),
  },
  {
    title: "Open the fridge",
    text: () => "Pull the fridge's door by its handle in the view, or select the door and move its slider under Details.",
    show: async ({ part }) => {
      if (part) await selection.select(part, { focus: true });
      panels.show("details");
      return appears("#panel-details [data-section=joints]");
    },
    polled: ({ openness }) => openness >= OPENED,
  },
  {
    title: "Ask where milk is kept",
    text: () => "Open Ask, type “where is milk kept?” and press Ask. The answer is a sentence, and its body is highlighted.",
    show: () => {
      panels.show("ask");
      return fill("[data-role=sentence]", "where is milk kept?");
    },
    asked: (method, params, result) => method.startsWith("ask") && result?.total > 0 && FOOD.test(JSON.stringify(params)),
  },
  {
    title: "Add a mug",
    text: () => "Select the table, open Add, find “mug”, choose one and press Add. It is placed where there is room.",
    show: () => {
      panels.show("add");
      return fill("[data-role=find-class]", "mug");
    },
    asked: (method, params, result) => ["add", "drop"].includes(method) && Boolean(result) && VESSEL.test(String(params.cls)),
  },
  {
    title: "Save the map",
    text: () => "Choose a format under “Save map…”. The file has everything that you changed, and can be loaded again.",
    show: () => {
      const menu = document.querySelector("[data-action=save]");
      const popup = menu?.closest("[popover]");
      if (popup && !popup.matches(":popover-open")) popup.showPopover();
      return menu;
    },
    asked: (method, params, result) => method === "save" && Boolean(result),
  },
];

// Types a text into a field as a user would, and returns the field.
function fill(selector, text) {
  const field = document.querySelector(selector);
  if (!field) return null;
  field.value = text;
  field.dispatchEvent(new Event("input", { bubbles: true }));
  return field;
}

// The element of a selector, which may be created in the next seconds; null if it is not.
async function appears(selector) {
  for (let tries = 0; tries < 20 && !document.querySelector(selector); tries++) await new Promise((resolve) => setTimeout(resolve, 150));
  return document.querySelector(selector);
}

// Private windows may refuse to store anything; the tour is then offered again.
function stored() {
  try {
    return localStorage.getItem(STORED);
  } catch {
    return null;
  }
}

function store(value) {
  try {
    localStorage.setItem(STORED, value);
  } catch {
    // see stored()
  }
}

class Tour {
  #index = -1;
  #state = { camera: null, part: null, openness: 0 };
  #cameraBefore = null;
  #touched = false;
  #timer = 0;
  #pausing = false;
  #target = null;
  #title = el("h2", { id: "tour-title", tabindex: "-1" });
  #text = el("p", { id: "tour-text" });
  #progress = el("span", { class: "muted", "data-role": "tour-progress" });
  #bar = el("span", { class: "tour-bar", "aria-hidden": "true" });
  #buttons = el("div", { class: "row" });
  #announcement = el("div", { class: "visually-hidden", role: "status" });
  #root = el("section", { id: "tour", "aria-labelledby": "tour-title", "aria-describedby": "tour-text", hidden: true, onkeydown: (event) => {
    if (event.key !== "Escape") return;
    event.stopPropagation(); // Escape clears the selection, too
    this.stop("skipped");
  } },
    el("div", { class: "row" }, this.#progress, el("span", { class: "grow" }), el("button", { type: "button", class: "flat", "aria-label": "Close the tour", "data-action": "tour-close", onclick: () => this.stop("skipped") }, "×")),
    this.#bar, this.#title, this.#text, this.#buttons);

  constructor() {
    document.getElementById("center").append(this.#root, this.#announcement);
    helpMenu.add({ title: "Start the tour", action: "start-tour", run: () => this.start({ focus: true }) });
    channel.on("tour", ({ offered }) => offered && this.#index < 0 && !stored() && this.start());
    channel.onResponse(({ method, params, result }) => this.#step?.asked?.(method, params, result) && this.#finish());
    const listen = () => {
      for (const type of ["pointerdown", "wheel", "keydown", "touchstart"]) viewFrame.contentWindow.addEventListener(type, () => this.#onTouch(), { capture: true, passive: true });
    };
    viewFrame.addEventListener("load", listen);
    listen(); // the frame may have been loaded before this module
  }

  get #step() {
    return STEPS[this.#index];
  }

  // For tests and the browser's console.
  get state() {
    return { step: this.#index, title: this.#step?.title ?? null, stored: stored() };
  }

  start({ focus = false } = {}) {
    this.#go(0);
    if (focus) this.#title.focus();
  }

  // Ends the tour: "done" after the last step, "skipped" before.
  stop(result) {
    clearInterval(this.#timer);
    this.#mark(null);
    this.#index = -1;
    const focused = this.#root.contains(document.activeElement);
    this.#root.hidden = true;
    store(result);
    if (focused) helpMenu.focus();
  }

  // The camera has moved since the user touched the view, and not by an animation of the page.
  cameraMoved(camera) {
    if (!camera || !this.#touched) {
      this.#cameraBefore = camera;
      return false;
    }
    const before = this.#cameraBefore;
    if (!before) this.#cameraBefore = camera;
    return Boolean(before) && Math.hypot(...camera.map((value, index) => value - before[index])) > CAMERA_MOVED_M;
  }

  #onTouch() {
    this.#touched = true;
  }

  #go(index) {
    this.#index = index;
    this.#pausing = false;
    this.#touched = false;
    this.#cameraBefore = null;
    this.#mark(null);
    clearInterval(this.#timer);
    this.#root.hidden = false;
    this.#root.dataset.done = "false";
    this.#bar.style.setProperty("--part", String(index / STEPS.length));
    if (index === STEPS.length) return this.#showEnd();
    const step = this.#step;
    this.#progress.textContent = `Tour, step ${index + 1} of ${STEPS.length}`;
    this.#title.textContent = step.title;
    this.#text.textContent = step.text(this.#state);
    replaceChildren(this.#buttons,
      step.show && el("button", { type: "button", "data-action": "tour-show", onclick: () => this.#show() }, "Show me"),
      el("span", { class: "grow" }),
      el("button", { type: "button", "data-action": "tour-skip", onclick: () => this.#skip() }, index + 1 < STEPS.length ? "Skip this step" : "Skip"));
    this.#announce(`Tour, step ${index + 1} of ${STEPS.length}: ${step.title}. ${this.#text.textContent}`);
    if (step.polled) {
      this.#timer = setInterval(() => this.#poll(), POLL_MS);
      this.#poll();
    }
  }

  #showEnd() {
    store("done");
    this.#progress.textContent = "Tour finished";
    this.#title.textContent = "That was the tour";
    this.#text.textContent = "The Help menu starts it again. “mindstage --help” lists what the shell can do with the same kitchen.";
    replaceChildren(this.#buttons, el("button", { type: "button", "data-action": "tour-replay", onclick: () => this.start({ focus: true }) }, "Start again"),
      el("span", { class: "grow" }), el("button", { type: "button", class: "primary", "data-action": "tour-end", onclick: () => this.stop("done") }, "Close"));
    this.#announce(`${this.#title.textContent}. ${this.#text.textContent}`);
  }

  #skip() {
    this.#go(this.#index + 1);
    this.#title.focus(); // the button may be gone
  }

  async #show() {
    const index = this.#index;
    const target = await this.#step.show(this.#state);
    if (index !== this.#index || !target) return;
    this.#mark(target);
    target.scrollIntoView({ block: "nearest" });
    if (target.matches("input, select, button")) target.focus();
  }

  #mark(target) {
    this.#target?.classList.remove("tour-target");
    this.#target = target;
    target?.classList.add("tour-target");
  }

  async #poll() {
    const index = this.#index;
    const state = await channel.call("tour.state").catch(() => null);
    if (!state || index !== this.#index) return;
    this.#state = { ...state, camera: state.camera?.flat() ?? null };
    if (this.#step.polled(this.#state, this)) this.#finish();
  }

  #finish() {
    if (this.#pausing) return;
    this.#pausing = true;
    clearInterval(this.#timer);
    const index = this.#index;
    this.#root.dataset.done = "true";
    this.#bar.style.setProperty("--part", String((index + 1) / STEPS.length));
    this.#announce(`Done: ${this.#step.title}`);
    setTimeout(() => index === this.#index && this.#go(index + 1), DONE_MS);
  }

  #announce(text) {
    this.#announcement.textContent = text;
  }
}

export const tour = new Tour();
