// Maps: the world goes to the visitor's disk as a map, and a map from there becomes the world.

import { channel } from "./channel.js";
import { el } from "./dom.js";
import { icon } from "./icons.js";
import { attempt, toast } from "./toasts.js";
import { frame } from "./view.js";

const MOST_BYTES = 20_000_000;
const WAYS = [
  ["", "Save as it came"],
  ["rdf/xml semlog", "SemLog, OWL"],
  ["turtle semlog", "SemLog, Turtle"],
  ["rdf/xml soma", "SOMA, OWL"],
  ["turtle soma", "SOMA, Turtle"],
];

async function save(way) {
  const [format, dialect] = way.split(" ");
  const map = await attempt("save", { ...(format && { format }), ...(dialect && { dialect }) });
  if (!map) return;
  const url = URL.createObjectURL(new Blob([map.text], { type: map.type }));
  el("a", { href: url, download: map.name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}

async function load(file) {
  if (file.size > MOST_BYTES) return toast(`${file.name} is larger than ${MOST_BYTES / 1e6} MB; spawn it from the command line`, "error");
  const told = await attempt("load", { name: file.name, text: await file.text() });
  if (!told) return;
  const failed = told.failed.length ? `; ${told.failed.length} could not be spawned, the first: ${told.failed[0].id}: ${told.failed[0].reason}` : "";
  const findings = told.findings ? `; ${told.findings} findings, see Status` : "";
  toast(`${told.name}: ${told.bodies} bodies, ${told.constraints} constraints${failed}${findings}`, failed ? "error" : "info");
}

const ways = el("select", { "aria-label": "Save as a map", title: "Save as a map", "data-do": "save", onchange: () => {
  save(ways.value);
  ways.selectedIndex = 0;
} }, el("option", { value: "none", disabled: true, selected: true }, "Save map…"), WAYS.map(([value, text]) => el("option", { value }, text)));

const chooser = el("input", { type: "file", accept: ".owl,.rdf,.xml,.ttl,.urdf", "aria-label": "A map from your disk", "data-role": "upload", hidden: true, onchange: async () => {
  if (chooser.files.length) await load(chooser.files[0]);
  chooser.value = "";
} });
const open = el("button", { type: "button", "data-do": "load", title: "Show a map from your disk instead of this world", onclick: () => chooser.click() }, icon("open"), "Load map");
document.getElementById("file").append(ways, open, chooser);

// -- dropping a file ---------------------------------------------------------------------------------------------------

const drop = el("div", { id: "drop", hidden: true }, el("p", {}, "Drop a map: it takes the place of this world"));
document.body.append(drop);

const hasFiles = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");

for (const target of [window, frame]) {
  target.addEventListener("dragenter", (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    drop.hidden = false;
  });
}
drop.addEventListener("dragover", (event) => event.preventDefault());
drop.addEventListener("dragleave", () => {
  drop.hidden = true;
});
for (const target of [drop, frame]) {
  target.addEventListener("drop", (event) => {
    event.preventDefault();
    drop.hidden = true;
    if (event.dataTransfer.files.length) load(event.dataTransfer.files[0]);
  });
}
frame.addEventListener("dragover", (event) => event.preventDefault());

// For whoever looks into the page from outside.
export const maps = { load, save, channel };
