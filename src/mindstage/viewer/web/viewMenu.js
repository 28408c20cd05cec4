// The View menu: quality of the 3D view and whether the camera follows answers; and messages above the view: how much of
// it is loaded, and that answers are not in the picture.

import { channel } from "./rpcChannel.js";
import { el } from "./dom.js";
import { callOrToast } from "./toasts.js";
import { viewFrame } from "./viewFrame.js";

const QUALITY = "mindstage.quality"; // also read by renderQuality.js
const FOLLOW = "mindstage.followAnswers";
const QUALITIES = [["automatic", "Automatic"], ["plain", "Plain: fast without a GPU"], ["high", "High: environment light, soft shadows"]];
const LOADING_INTERVAL_MS = 300;
const LOADING_DELAY_MS = 1200; // less than this is no slow link
const LOADING_STOPPED_MS = 5000; // bodies without a visible mesh are never counted
const MESSAGE_MS = 12_000;

// -- settings of this browser ------------------------------------------------------------------------------------------

function stored(key, otherwise) {
  try {
    return localStorage.getItem(key) ?? otherwise;
  } catch {
    return otherwise; // the browser blocks storage
  }
}

function store(key, value) {
  try {
    localStorage.setItem(key, value);
  } catch {
    // The setting holds until the page is closed.
  }
}

const view = () => viewFrame.contentWindow?.mindstageView;

// -- menu --------------------------------------------------------------------------------------------------------------

const renderer = el("p", { class: "muted", "data-role": "renderer" });
const quality = el("select", { "data-action": "quality", onchange: () => {
  store(QUALITY, quality.value);
  view()?.quality?.update();
  describe();
} }, QUALITIES.map(([value, text]) => el("option", { value }, text)));
const follow = el("input", { type: "checkbox", "data-action": "follow-answers", onchange: () => store(FOLLOW, follow.checked ? "yes" : "no") });
const menu = el("div", { id: "view-menu", popover: "auto", role: "group", "aria-label": "View settings" },
  el("label", {}, "Quality", quality), renderer,
  el("label", { class: "row", title: "If no answer is in the picture, the camera moves to the answers" }, follow, "Move the camera to answers"));
const button = el("button", { type: "button", class: "flat", "data-action": "view-menu", title: "Quality of the view, camera", popovertarget: "view-menu", "aria-haspopup": "true" }, "View");

function describe() {
  renderer.textContent = view()?.quality ? `Now ${view().quality.description}` : "The view is not loaded yet.";
}

menu.addEventListener("beforetoggle", ({ newState }) => {
  if (newState !== "open") return;
  quality.value = stored(QUALITY, "automatic");
  follow.checked = stored(FOLLOW, "yes") === "yes";
  describe();
  // In a narrow window the button is in the menu of the toolbar, which closes.
  const anchor = button.closest("#toolbar") ? button : document.getElementById("toolbar-more");
  const { left, bottom } = anchor.getBoundingClientRect();
  menu.style.left = `${Math.max(8, Math.min(left, innerWidth - 282))}px`;
  menu.style.top = `${bottom + 4}px`;
});
document.getElementById("view-controls").append(button);
document.body.append(menu);

// -- answers out of the picture ----------------------------------------------------------------------------------------

let message = null;

function showMessage(...content) {
  message?.remove();
  message = el("div", { class: "view-message", role: "status" }, content);
  document.getElementById("center").append(message);
  const shown = message;
  setTimeout(() => shown.remove(), MESSAGE_MS);
}

channel.on("unseen_answers", (ids) => {
  const what = ids.length === 1 ? "The answer is" : `The ${ids.length} answers are`;
  const focus = () => callOrToast("focus", { ids });
  if (stored(FOLLOW, "yes") === "yes") {
    focus();
    showMessage(el("span", {}, `${what} out of the picture: the camera moves there.`), el("button", { type: "button", "data-action": "camera-back", onclick: () => callOrToast("reset_camera") }, "Back to the start"));
  } else {
    showMessage(el("span", {}, `${what} out of the picture.`), el("button", { type: "button", "data-action": "show-answers", onclick: () => {
      message?.remove();
      focus();
    } }, "Show"));
  }
});

// -- loading -----------------------------------------------------------------------------------------------------------

const progress = el("progress", { max: "1", value: 0, "aria-label": "Loaded part of the 3D view" });
const loaded = el("span");
const loading = el("div", { class: "view-message", role: "status", "data-role": "loading", hidden: true }, progress, loaded);
document.getElementById("center").append(loading);
const started = performance.now();
let expected = 0;
let wasComplete = false;
let progressed = { count: 0, at: started };

channel.on("clock", ({ bodies }) => {
  expected = bodies;
});

function showLoading() {
  const count = view()?.loadedBodies?.() ?? 0;
  if (count !== progressed.count) progressed = { count, at: performance.now() };
  const hasStopped = count > 0 && performance.now() - progressed.at > LOADING_STOPPED_MS;
  const isComplete = expected > 0 && (count >= expected || hasStopped);
  wasComplete ||= isComplete;
  const isStopped = Boolean(viewFrame.contentDocument?.querySelector(".mindstage-stopped:not([hidden])")); // it says so itself
  loading.hidden = wasComplete || isStopped || performance.now() - started < LOADING_DELAY_MS;
  progress.value = expected ? Math.min(1, count / expected) : 0;
  loaded.textContent = view() ? `Loading ${count} of ${expected} bodies` : "Loading the 3D view";
  if (!wasComplete) setTimeout(showLoading, LOADING_INTERVAL_MS);
}

showLoading();
