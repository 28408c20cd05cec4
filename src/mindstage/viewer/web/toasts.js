// Toasts: short notifications that disappear after some seconds.

import { channel } from "./rpcChannel.js";
import { el } from "./dom.js";

const DURATION_MS = { info: 5000, error: 12000 };
const MAX_TOASTS = 5;

// Shows a text; a text that is already shown is replaced, not repeated.
export function toast(text, kind = "info") {
  const log = document.getElementById("toasts");
  const duplicate = [...log.children].find((other) => other.dataset.text === text);
  duplicate?.remove();
  const close = el("button", { type: "button", class: "flat", "aria-label": "Close", onclick: () => box.remove() }, "×");
  const box = el("div", { class: `toast ${kind}`, "data-toast": kind, "data-text": text }, el("span", {}, text), close);
  log.append(box);
  while (log.children.length > MAX_TOASTS) log.firstChild.remove();
  setTimeout(() => box.remove(), DURATION_MS[kind] ?? DURATION_MS.info);
}

// Calls a method of the server. An error is shown as a toast, and the result is undefined.
export async function callOrToast(method, params = {}) {
  try {
    return await channel.call(method, params);
  } catch (error) {
    toast(error.message, "error");
    return undefined;
  }
}

channel.on("toast", ({ text, kind }) => toast(text, kind));
channel.on("error", ({ message }) => toast(message, "error"));
