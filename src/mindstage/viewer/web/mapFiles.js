// Map files: saves the world as a map to the user's disk, and loads a map that is chosen or dropped on the page.

import { ask } from "./choiceDialog.js";
import { el } from "./dom.js";
import { icon } from "./icons.js";
import { channel } from "./rpcChannel.js";
import { callOrToast, toast } from "./toasts.js";
import { viewFrame } from "./viewFrame.js";

const MAX_BYTES = 20_000_000;
const FORMATS = [
  ["", "Original format"],
  ["owl semlog", "SemLog, OWL"],
  ["ttl semlog", "SemLog, Turtle"],
  ["owl soma", "SOMA, OWL"],
  ["ttl soma", "SOMA, Turtle"],
];

// Downloads the world; returns whether it worked.
async function save(choice) {
  const [format, dialect] = choice.split(" ");
  const map = await callOrToast("save", { ...(format && { format }), ...(dialect && { dialect }) });
  if (!map) return false;
  const content = map.text ?? Uint8Array.from(atob(map.base64), (character) => character.charCodeAt(0));
  const url = URL.createObjectURL(new Blob([content], { type: map.type }));
  el("a", { href: url, download: map.name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
  return true;
}

// Conventions of loaded maps are inferred, unless the address of the page gives them: ?units=cm&quaternion=xyzw
const CONVENTIONS = ["units", "frame", "quaternion", "sizes"];
const given = [...new URLSearchParams(location.search)].filter(([name]) => CONVENTIONS.includes(name));

// Replaces the world for everybody; asks first if edits are not saved.
async function replaceWorld(params) {
  try {
    return await channel.call("load", params);
  } catch (error) {
    if (error.code !== "UnsavedEditsError") return toast(error.message, "error");
    const choice = await ask(`Replace the world by ${params.name}?`, `${error.message.split("; ")[0]}. All windows get the new world; Undo brings back this one.`, [
      ["save", "Save the map first"],
      ["discard", "Replace without saving"],
    ]);
    if (!choice || (choice === "save" && !(await save("")))) return undefined;
    return callOrToast("load", { ...params, discard: true });
  }
}

async function load(file) {
  if (file.size > MAX_BYTES) return toast(`${file.name} is larger than ${MAX_BYTES / 1e6} MB; load it with: mindstage spawn`, "error");
  const report = await replaceWorld({ name: file.name, text: await file.text(), conventions: Object.fromEntries(given) });
  if (!report) return;
  const failed = report.failed.length ? `; ${report.failed.length} could not be spawned, the first: ${report.failed[0].id}: ${report.failed[0].reason}` : "";
  const findings = report.findings ? `; ${report.findings} findings, see Status` : "";
  toast(`Loaded ${report.name}: ${report.bodies} bodies, ${report.joints} joints${failed}${findings}. Undo brings back the world before.`, failed ? "error" : "info");
}

const formatMenu = el("select", { "aria-label": "Save as a map", title: "Save as a map", "data-action": "save", onchange: () => {
  save(formatMenu.value);
  formatMenu.selectedIndex = 0;
} }, el("option", { value: "none", disabled: true, selected: true }, "Save map…"), FORMATS.map(([value, text]) => el("option", { value }, text)));

// A replay has no formats.
channel.call("formats").then((others) => formatMenu.append(...others.map(({ name, title }) => el("option", { value: name }, title))), () => {});

const fileInput = el("input", { type: "file", accept: ".owl,.rdf,.xml,.ttl,.urdf", "aria-label": "Map file", "data-role": "upload", hidden: true, onchange: async () => {
  if (fileInput.files.length) await load(fileInput.files[0]);
  fileInput.value = "";
} });
const loadButton = el("button", { type: "button", "data-action": "load", title: "Replace this world with a map from your disk", onclick: () => fileInput.click() }, icon("open"), "Load map");
document.getElementById("file-controls").append(formatMenu, loadButton, fileInput);

// -- drag and drop -----------------------------------------------------------------------------------------------------

const dropTarget = el("div", { id: "drop-target", hidden: true }, el("p", {}, "Drop a map file to replace this world"));
document.body.append(dropTarget);

const hasFiles = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");

for (const target of [window, viewFrame]) {
  target.addEventListener("dragenter", (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    dropTarget.hidden = false;
  });
}
dropTarget.addEventListener("dragover", (event) => event.preventDefault());
dropTarget.addEventListener("dragleave", () => {
  dropTarget.hidden = true;
});
for (const target of [dropTarget, viewFrame]) {
  target.addEventListener("drop", (event) => {
    event.preventDefault();
    dropTarget.hidden = true;
    if (event.dataTransfer.files.length) load(event.dataTransfer.files[0]);
  });
}
viewFrame.addEventListener("dragover", (event) => event.preventDefault());
