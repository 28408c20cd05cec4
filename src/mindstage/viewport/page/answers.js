// Answers: a table whose rows select, light up and explain themselves, and what is missing for more.

import { channel } from "./channel.js";
import { nameField } from "./completion.js";
import { el, fill } from "./dom.js";
import { panels } from "./panels.js";
import { selection } from "./selection.js";
import { attempt, toast } from "./toasts.js";

const COLOURS = ["blue", "green", "yellow", "red", "black"];
let colour = COLOURS[0];

// The table of what the server answered; `again` asks the same once more.
export function answersView(table, again) {
  return el("div", { class: "answers", "data-answers": String(table.total) }, heading(table), table.truth === undefined || table.truth === null ? body(table) : null, table.missing?.map((lack) => lacking(lack, again)));
}

function heading(table) {
  const count = table.truth === true ? "yes" : table.truth === false ? "no" : table.total === 1 ? "1 answer" : `${table.total} answers`;
  const some = table.rows.length < table.total ? `, the first ${table.rows.length} of them here` : "";
  return el("div", { class: "row answers-head" },
    el("strong", { class: "grow", role: "status" }, `${count}${some}`),
    table.ids.some(Boolean) || table.explains ? [colours(), el("button", { type: "button", class: "main", "data-do": "show-all", title: "Light up all answers, and dim the rest", onclick: () => show(table) }, "Show")] : null);
}

function colours() {
  const pick = (event) => { colour = event.target.value; };
  return el("select", { "aria-label": "Colour", class: "colour", onchange: pick, "data-do": "colour" },
    COLOURS.map((name) => el("option", { value: name, selected: name === colour }, name)));
}

async function show(table) {
  const shown = await attempt("ask.show", { key: table.key, colour, replace: true });
  if (!shown) return;
  const dark = shown.not_lit.map(({ id, reason }) => `${id}: ${reason}`);
  if (!shown.lit.length && !dark.length) toast("None of these answers stands in the world.");
  if (dark.length) toast(dark.length > 3 ? `${dark.length} have no body: ${dark.slice(0, 3).join("; ")} …` : dark.join("; "));
  if (shown.lit.length) panels.closeSheets();
}

function body(table) {
  if (!table.rows.length) return null;
  const rows = table.rows.map((cells, at) => line(table, cells, at));
  shown = { rows, ids: table.ids };
  mark(selection.id);
  return el("div", { class: "answers-scroll" },
    el("table", { role: "grid", "aria-label": table.title },
      el("thead", {}, el("tr", {}, columnsOf(table).map((name) => el("th", { scope: "col" }, name.replaceAll("_", " "))), table.explains ? el("th", {}, "") : null)),
      el("tbody", {}, rows)));
}

// The row of what is selected, wherever it was selected, is marked.
let shown = { rows: [], ids: [] };
const mark = (id) => shown.rows.forEach((row, at) => row.setAttribute("aria-selected", String(Boolean(id) && shown.ids[at] === id)));
selection.on(mark);

function line(table, cells, at) {
  const id = table.ids[at];
  const choose = () => id && selection.choose(id, { focus: true });
  const why = table.explains ? el("td", {}, el("button", { type: "button", class: "quiet", "aria-expanded": "false", "data-do": "why", onclick: (event) => explain(event, table, at, element) }, "why")) : null;
  const element = el("tr", {
    class: id ? "has-body" : "", "data-id": id || null, tabindex: id ? "0" : null, "aria-selected": "false",
    onclick: choose, onkeydown: (event) => event.key === "Enter" && event.target === element && choose(),
  }, first(table, cells), cells.slice(withClass(table) ? 2 : 1).map(field), why);
  return element;
}

// The class of what was asked for stands below its name: it says the same in fewer columns.
const withClass = (table) => table.columns[1]?.startsWith("class of ") ?? false;
const columnsOf = (table) => (withClass(table) ? [table.columns[0], ...table.columns.slice(2)] : table.columns);
const field = (cell) => el("td", { title: cell.iri ?? null }, shownAs(cell.text));

function first(table, cells) {
  const cell = field(cells[0]);
  if (withClass(table)) cell.append(el("span", { class: "faint below", title: cells[1].iri ?? null }, shownAs(cells[1].text)));
  return cell;
}

const shownAs = (text) => (text === null ? "–" : typeof text === "number" ? String(Number(text.toPrecision(6))) : text);

async function explain(event, table, at, element) {
  event.stopPropagation();
  const button = event.currentTarget;
  if (button.getAttribute("aria-expanded") === "true") {
    button.setAttribute("aria-expanded", "false");
    element.nextElementSibling.remove();
    return;
  }
  const lines = await attempt("ask.why", { key: table.key, row: at });
  if (!lines) return;
  button.setAttribute("aria-expanded", "true");
  const chain = lines.length ? el("ol", { class: "why" }, lines.map((each) => el("li", {}, each))) : el("p", { class: "faint" }, "It is told just so.");
  const wide = String(columnsOf(table).length + 1);
  element.after(el("tr", { class: "reason", "data-reason": String(at) }, el("td", { colspan: wide }, el("div", {}, chain))));
}

// What nobody has told yet, with fields to tell it.
function lacking(lack, again) {
  const fields = {};
  const field = (name, kind) => {
    const made = nameField({ kind, label: name, value: lack[name], enter: tell, placeholder: name, "data-tell": name });
    fields[name] = made.input;
    return made.root;
  };
  async function tell() {
    const statement = Object.fromEntries(Object.entries(fields).map(([name, input]) => [name, input.value.trim()]));
    if (Object.values(statement).some((text) => !text)) return toast("A statement has a subject, a property and a value.", "error");
    const told = await attempt("ask.tell", statement);
    if (told === undefined) return;
    if (!told) toast("That was known already.");
    again();
  }
  return el("div", { class: "lack", "data-missing": lack.property },
    el("p", {}, el("strong", {}, "Missing: "), lack.why),
    el("div", { class: "statement" }, field("subject", "VALUE"), field("property", "PROPERTY"), field("value", "VALUE"),
      el("button", { type: "button", "data-do": "tell", onclick: tell }, "Tell")));
}

// The legend over the view: what is lit, and why.
export function legend(root) {
  channel.on("lit", (groups) => {
    root.hidden = !groups.length;
    const each = [...groups].reverse().map((group) => {
      const dot = el("span", { class: "dot", "aria-hidden": "true" });
      dot.style.background = group.colour;
      const count = el("span", { class: "faint" }, String(group.ids.length));
      const out = el("button", { type: "button", class: "quiet", "aria-label": `Put out ${group.label || "what is lit"}`, onclick: () => attempt("ask.put_out", group.label ? { label: group.label } : {}) }, "×");
      return el("li", { "data-lit": String(group.ids.length), "data-colour": group.colour }, dot, el("span", { class: "grow" }, group.label || "lit"), count, out);
    });
    fill(root, el("ul", {}, each), groups.length > 1 ? el("button", { type: "button", class: "quiet", onclick: () => attempt("ask.put_out") }, "Put out all") : null);
  });
}
