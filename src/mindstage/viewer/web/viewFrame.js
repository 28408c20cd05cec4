// The 3D view: viser's client in an iframe. The client key in its URL connects the view with this page on the server.

import { clientKey } from "./rpcChannel.js";
import { el } from "./dom.js";

const pageParams = new URLSearchParams(location.search);
const viewParams = new URLSearchParams([...pageParams].filter(([name]) => ["fixedDpr", "showStats"].includes(name)));

export const viewFrame = el("iframe", { id: "view", title: "3D view", src: `/view/${clientKey}/${viewParams.size ? `?${viewParams}` : ""}`, allow: "fullscreen" });

document.getElementById("center").append(viewFrame);

// The view has the theme of this page, whether it is that of the system or chosen by the user.
const isDark = () => {
  const [red, green, blue] = getComputedStyle(document.body).backgroundColor.match(/[\d.]+/g).map(Number);
  return red + green + blue < 3 * 128;
};
function applyTheme() {
  const inner = viewFrame.contentDocument?.documentElement;
  if (inner) inner.dataset.theme = isDark() ? "dark" : "light";
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", applyTheme);
for (const element of [document.documentElement, document.body]) new MutationObserver(applyTheme).observe(element, { attributes: true });
viewFrame.addEventListener("load", applyTheme);

// Drag-and-drop and key events inside the iframe are dispatched again on this page, which handles them.
viewFrame.addEventListener("load", () => {
  const inner = viewFrame.contentWindow;
  for (const type of ["dragenter", "dragover", "dragleave", "drop"]) {
    inner.addEventListener(type, (event) => {
      const copy = new DragEvent(type, { bubbles: true, cancelable: true, dataTransfer: event.dataTransfer });
      if (!viewFrame.dispatchEvent(copy)) event.preventDefault();
    });
  }
  for (const type of ["keydown", "keyup"]) {
    inner.addEventListener(type, (event) => {
      if (viewFrame.dispatchEvent(new KeyboardEvent(type, { ...keyInit(event), bubbles: true, cancelable: true }))) return;
      event.preventDefault();
      event.stopImmediatePropagation(); // a key that was used here does not move the camera of viser as well
    }, true);
  }
  inner.addEventListener("paste", (event) => {
    const copy = new ClipboardEvent("paste", { bubbles: true, cancelable: true, clipboardData: event.clipboardData });
    if (!viewFrame.dispatchEvent(copy)) event.preventDefault();
  });
});

const keyInit = ({ key, code, ctrlKey, metaKey, shiftKey, altKey, repeat }) => ({ key, code, ctrlKey, metaKey, shiftKey, altKey, repeat });
