// The view: viser's own page in a frame, as large as the middle; its address says whose view it is.

import { key } from "./channel.js";
import { el } from "./dom.js";

const wanted = new URLSearchParams(location.search);
const passed = new URLSearchParams([...wanted].filter(([name]) => ["fixedDpr", "showStats"].includes(name)));
if (matchMedia("(prefers-color-scheme: dark)").matches) passed.set("darkMode", "1");

export const frame = el("iframe", { id: "view", title: "3D view", src: `/view/${key}/${passed.size ? `?${passed}` : ""}`, allow: "fullscreen" });

document.getElementById("middle").append(frame);

// What is dropped on the view, and what is pressed there, is meant for the whole page.
frame.addEventListener("load", () => {
  const inner = frame.contentWindow;
  for (const type of ["dragenter", "dragover", "dragleave", "drop"]) {
    inner.addEventListener(type, (event) => {
      const twin = new DragEvent(type, { bubbles: true, cancelable: true, dataTransfer: event.dataTransfer });
      if (!frame.dispatchEvent(twin)) event.preventDefault();
    });
  }
  inner.addEventListener("keydown", (event) => {
    if (!frame.dispatchEvent(new KeyboardEvent("keydown", { ...keyOf(event), bubbles: true, cancelable: true }))) event.preventDefault();
  });
});

const keyOf = ({ key, code, ctrlKey, metaKey, shiftKey, altKey }) => ({ key, code, ctrlKey, metaKey, shiftKey, altKey });
