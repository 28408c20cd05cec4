// The 3D view: viser's client in an iframe. The client key in its URL connects the view with this page on the server.

import { clientKey } from "./rpcChannel.js";
import { el } from "./dom.js";

const pageParams = new URLSearchParams(location.search);
const viewParams = new URLSearchParams([...pageParams].filter(([name]) => ["fixedDpr", "showStats"].includes(name)));
if (matchMedia("(prefers-color-scheme: dark)").matches) viewParams.set("darkMode", "1");

export const viewFrame = el("iframe", { id: "view", title: "3D view", src: `/view/${clientKey}/${viewParams.size ? `?${viewParams}` : ""}`, allow: "fullscreen" });

document.getElementById("center").append(viewFrame);

// Drag-and-drop and key events inside the iframe are dispatched again on this page, which handles them.
viewFrame.addEventListener("load", () => {
  const inner = viewFrame.contentWindow;
  for (const type of ["dragenter", "dragover", "dragleave", "drop"]) {
    inner.addEventListener(type, (event) => {
      const copy = new DragEvent(type, { bubbles: true, cancelable: true, dataTransfer: event.dataTransfer });
      if (!viewFrame.dispatchEvent(copy)) event.preventDefault();
    });
  }
  inner.addEventListener("keydown", (event) => {
    if (!viewFrame.dispatchEvent(new KeyboardEvent("keydown", { ...keyInit(event), bubbles: true, cancelable: true }))) event.preventDefault();
  });
});

const keyInit = ({ key, code, ctrlKey, metaKey, shiftKey, altKey }) => ({ key, code, ctrlKey, metaKey, shiftKey, altKey });
