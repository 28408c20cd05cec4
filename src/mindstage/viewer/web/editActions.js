// Edits of the selected bodies: delete, duplicate, copy, paste, hide and isolate, and the snapping of the gizmo.

import { ask } from "./choiceDialog.js";
import { channel } from "./rpcChannel.js";
import { selection } from "./selection.js";
import { callOrToast, toast } from "./toasts.js";

const STORED = "mindstage copied bodies"; // in localStorage, where the browser's clipboard cannot be used
const plural = (count, one, several) => `${count} ${count === 1 ? one : several}`;

// -- deleting ------------------------------------------------------------------------------------------------------

// Deletes bodies; asks first if parts of them or things on or in them would be left behind.
export async function deleteBodies(ids = selection.ids) {
  if (!ids.length) return;
  const found = await callOrToast("dependents", { ids });
  if (!found) return;
  const parts = found.parts.filter((id) => !ids.includes(id)).length;
  const contents = found.contents.filter((id) => !ids.includes(id)).length;
  const name = ids.length === 1 ? ids[0] : `${ids.length} bodies`;
  let choice = "only";
  if (parts || contents) {
    const its = ids.length === 1 ? "its" : "their";
    const what = [parts && `${its} ${plural(parts, "part", "parts")}`, contents && `${plural(contents, "thing", "things")} on or in ${ids.length === 1 ? "it" : "them"}`].filter(Boolean).join(" and ");
    choice = await ask(`Delete ${name}?`, `Delete also ${what}? Without ${ids.length === 1 ? "it" : "them"}, they stay where they are, in the air.`, [
      ["all", `Delete all ${ids.length + parts + contents}`],
      ...(parts && contents ? [["parts", `With ${its} ${plural(parts, "part", "parts")}`]] : []),
      ["only", `Only ${name}`],
    ]);
  }
  if (choice) await callOrToast("delete", { ids, parts: choice !== "only", contents: choice === "all" });
}

// -- copies --------------------------------------------------------------------------------------------------------

export async function duplicate() {
  const ids = await callOrToast("duplicate", { ids: selection.ids });
  if (ids) selection.selectAll(ids);
}

export async function copy() {
  const { ids } = selection;
  const text = await callOrToast("copy", { ids });
  if (!text) return false;
  try {
    localStorage.setItem(STORED, text);
  } catch { /* too long or forbidden: the clipboard alone is used */ }
  try {
    await navigator.clipboard.writeText(text);
    toast(`Copied ${ids.length === 1 ? ids[0] : `${ids.length} bodies`} to the clipboard.`);
  } catch {
    toast(`Copied ${ids.length === 1 ? ids[0] : `${ids.length} bodies`} for tabs of this server; the browser does not allow the clipboard.`);
  }
  return true;
}

export async function cut() {
  if (await copy()) await deleteBodies();
}

export async function pasteText(text) {
  const ids = await callOrToast("paste", { text });
  if (ids) selection.selectAll(ids);
}

export async function paste() {
  let text = null;
  try {
    text = await navigator.clipboard.readText();
  } catch {
    text = localStorage.getItem(STORED);
  }
  if (text) await pasteText(text);
  else toast("The clipboard is empty; copy bodies first.", "error");
}

// -- visibility ------------------------------------------------------------------------------------------------------

const allIds = () => (channel.latest("scene_tree")?.rows ?? []).map(([id]) => id);
const hiddenIds = () => channel.latest("visibility")?.hidden ?? [];

export const hideSelected = () => callOrToast("set_visible", { ids: selection.ids, shown: false });
export const showAll = () => callOrToast("set_visible", { ids: hiddenIds(), shown: true });
export const isAnythingHidden = () => hiddenIds().length > 0;

// Hides everything but the selected bodies and their parts.
export async function isolate() {
  const found = await callOrToast("dependents", { ids: selection.ids });
  if (!found) return;
  const kept = new Set([...selection.ids, ...found.parts]);
  await callOrToast("set_visible", { ids: [...kept], shown: true });
  await callOrToast("set_visible", { ids: allIds().filter((id) => !kept.has(id)), shown: false });
}

// -- selecting -------------------------------------------------------------------------------------------------------

export const selectEverything = () => selection.selectAll(allIds());

// Selects all bodies of the class of the selected one.
export function selectClass() {
  const { rows } = channel.latest("scene_tree");
  const cls = rows.find(([id]) => id === selection.id)?.[2];
  selection.selectAll([...rows.filter((row) => row[2] === cls).map(([id]) => id).filter((id) => id !== selection.id), selection.id]);
}

// -- gizmo and snapping ------------------------------------------------------------------------------------------------

class Gizmo {
  mode = null;
  #snapping = { step_m: 0, step_deg: 0, to_surface: false };
  #precise = false;
  #listeners = new Set();

  constructor() {
    for (const type of ["keydown", "keyup"]) document.addEventListener(type, (event) => event.key === "Shift" && this.#setPrecise(type === "keydown"));
    channel.on("connection", (connected) => connected && this.#send());
  }

  toggle(mode) {
    this.mode = this.mode === mode ? null : mode;
    for (const listener of this.#listeners) listener(this.mode);
    return callOrToast("set_gizmo", { mode: this.mode });
  }

  onChange(listener) {
    this.#listeners.add(listener);
    listener(this.mode);
  }

  snap(snapping) {
    this.#snapping = snapping;
    this.#send();
  }

  #setPrecise(precise) {
    if (precise === this.#precise) return;
    this.#precise = precise;
    if (this.mode) this.#send();
  }

  #send() {
    channel.call("set_snapping", { ...this.#snapping, precise: this.#precise }).catch(() => {}); // sent again when connected
  }
}

export const gizmo = new Gizmo();
