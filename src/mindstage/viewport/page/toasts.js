// Toasts: what went wrong, or well, in a sentence that goes away by itself.

import { channel } from "./channel.js";
import { el } from "./dom.js";

const SHOWN_MS = { info: 5000, error: 12000 };
const MOST = 5;

// Shows a sentence; the same one only once at a time.
export function toast(text, kind = "info") {
  const log = document.getElementById("toasts");
  const same = [...log.children].find((other) => other.dataset.text === text);
  same?.remove();
  const close = el("button", { type: "button", class: "quiet", "aria-label": "Close", onclick: () => box.remove() }, "×");
  const box = el("div", { class: `toast ${kind}`, "data-toast": kind, "data-text": text }, el("span", {}, text), close);
  log.append(box);
  while (log.children.length > MOST) log.firstChild.remove();
  setTimeout(() => box.remove(), SHOWN_MS[kind] ?? SHOWN_MS.info);
}

// Asks the server, and shows its sentence where it says no; gives undefined then.
export async function attempt(what, args = {}) {
  try {
    return await channel.ask(what, args);
  } catch (error) {
    toast(error.message, "error");
    return undefined;
  }
}

channel.on("toast", ({ text, kind }) => toast(text, kind));
channel.on("refused", ({ text }) => toast(text, "error"));
