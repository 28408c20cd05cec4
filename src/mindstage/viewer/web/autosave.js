// Asks whether to restore edits that an earlier process has saved automatically, and says if they cannot be saved now.

import { ask } from "./choiceDialog.js";
import { channel } from "./rpcChannel.js";
import { callOrToast, toast } from "./toasts.js";

let open = null;
let postponed = false;

async function offer({ name, saved_unix_s: saved, edits, last }) {
  open = new AbortController();
  const time = new Date(saved * 1000).toLocaleString();
  const what = edits === 1 ? `1 edit (${last})` : `${edits} edits, the last one: ${last}`;
  const choice = await ask(`Restore the edits of ${name}?`, `The program ended at ${time} before they were saved: ${what}.`, [
    ["restore", "Restore"],
    ["discard", "Discard them"],
  ], { otherwise: "Ask later", signal: open.signal });
  const answered = open.signal.aborted;
  open = null;
  if (answered) return;
  if (choice === null) postponed = true;
  else if (choice === "discard") await callOrToast("autosave.discard");
  else {
    const restored = await callOrToast("autosave.restore");
    if (restored) toast([`Restored ${what}. Undo brings back the world before.`, ...restored.notes.slice(0, 3)].join(" "), restored.notes.length ? "error" : "info");
  }
}

channel.on("autosave", (state) => {
  if (state.error) toast(`Edits are not saved automatically: ${state.error}`, "error");
  if (!state.offer) open?.abort(); // another window has answered
  else if (!open && !postponed) offer(state.offer);
});
