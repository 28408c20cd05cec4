// The table of answers: rows select bodies and can be highlighted and explained; missing facts can be asserted.

import { nameField } from "./nameCompletion.js";
import { el } from "./dom.js";
import { panels } from "./panels.js";
import { selection } from "./selection.js";
import { callOrToast, toast } from "./toasts.js";

const COLORS = ["blue", "green", "yellow", "red", "black"];
let color = COLORS[0];

// Shows a result of the server (see AnswerTable in Python); `askAgain` repeats the question after a fact was asserted.
export function answerTable(answers, askAgain) {
  return el("div", { class: "answers", "data-answers": String(answers.total) }, answers.sentence ? el("p", { class: "answer-sentence", role: "status", "data-role": "sentence-answer" }, answers.sentence) : null, header(answers), answers.notes?.map((note) => el("p", { class: "muted", "data-role": "note" }, note)), answers.boolean === undefined || answers.boolean === null ? table(answers) : null, answers.missing?.map((fact) => missingFact(fact, askAgain)));
}

function header(answers) {
  const count = answers.boolean === true ? "yes" : answers.boolean === false ? "no" : answers.complete === false ? `the first ${answers.total} answers, there may be more` : answers.total === 1 ? "1 answer" : `${answers.total} answers`;
  const shown = answers.rows.length < answers.total ? `, the first ${answers.rows.length} shown` : "";
  return el("div", { class: "row answers-header" },
    el(answers.sentence ? "span" : "strong", { class: "grow muted" }, `${count}${shown}`),
    answers.ids.some(Boolean) || answers.explainable ? [colorMenu(), el("button", { type: "button", class: "primary", "data-action": "highlight-all", title: "Highlight all answers and dim the other bodies", onclick: () => highlight(answers) }, "Highlight")] : null);
}

function colorMenu() {
  const choose = (event) => { color = event.target.value; };
  return el("select", { "aria-label": "Color", class: "color-select", onchange: choose, "data-action": "color" },
    COLORS.map((name) => el("option", { value: name, selected: name === color }, name)));
}

// Highlights the bodies of all answers; at once after a question, which says nothing about answers without bodies.
export async function highlight(answers, { atOnce = false } = {}) {
  const result = await callOrToast("ask.highlight", { key: answers.key, color, replace: true });
  if (!result || atOnce) return;
  const failed = result.not_highlighted.map(({ id, reason }) => `${id}: ${reason}`);
  if (!result.highlighted.length && !failed.length) toast("None of these answers has a body in the world.");
  if (failed.length) toast(failed.length > 3 ? `${failed.length} have no body: ${failed.slice(0, 3).join("; ")} …` : failed.join("; "));
  if (result.highlighted.length) panels.closeSheets();
}

function table(answers) {
  if (!answers.rows.length) return null;
  const rows = answers.rows.map((cells, index) => tableRow(answers, cells, index));
  shown = { rows, ids: answers.ids };
  markSelected(selection.id);
  return el("div", { class: "answers-scroll" },
    el("table", { role: "grid", "aria-label": answers.title },
      el("thead", {}, el("tr", {}, visibleColumns(answers).map((name) => el("th", { scope: "col" }, name.replaceAll("_", " "))), answers.explainable ? el("th", {}, "") : null)),
      el("tbody", {}, rows)));
}

// The row of the selected body is marked, wherever the body was selected.
let shown = { rows: [], ids: [] };
const markSelected = (id) => shown.rows.forEach((row, index) => row.setAttribute("aria-selected", String(Boolean(id) && shown.ids[index] === id)));
selection.onChange(markSelected);

function tableRow(answers, cells, index) {
  const id = answers.ids[index];
  const select = () => id && selection.select(id, { focus: true });
  const explainCell = answers.explainable ? el("td", {}, el("button", { type: "button", class: "flat", "aria-expanded": "false", "data-action": "explain", onclick: (event) => toggleExplanation(event, answers, index, row) }, "why")) : null;
  const row = el("tr", {
    class: id ? "has-body" : "", "data-id": id || null, tabindex: id ? "0" : null, "aria-selected": "false",
    onclick: select, onkeydown: (event) => event.key === "Enter" && event.target === row && select(),
  }, firstCell(answers, cells), cells.slice(hasClassColumn(answers) ? 2 : 1).map(tableCell), explainCell);
  return row;
}

// The class of the queried individual is shown below its name instead of in a column of its own.
const hasClassColumn = (answers) => answers.columns[1]?.startsWith("class of ") ?? false;
const visibleColumns = (answers) => (hasClassColumn(answers) ? [answers.columns[0], ...answers.columns.slice(2)] : answers.columns);
const tableCell = (cell) => el("td", { title: cell.iri ?? null }, formatValue(cell.text));

function firstCell(answers, cells) {
  const cell = tableCell(cells[0]);
  if (hasClassColumn(answers)) cell.append(el("span", { class: "muted subtext", title: cells[1].iri ?? null }, formatValue(cells[1].text)));
  return cell;
}

const formatValue = (value) => (value === null ? "–" : typeof value === "number" ? String(Number(value.toPrecision(6))) : value);

async function toggleExplanation(event, answers, index, row) {
  event.stopPropagation();
  const button = event.currentTarget;
  if (button.getAttribute("aria-expanded") === "true") {
    button.setAttribute("aria-expanded", "false");
    row.nextElementSibling.remove();
    return;
  }
  const lines = await callOrToast("ask.explain", { key: answers.key, row: index });
  if (!lines) return;
  button.setAttribute("aria-expanded", "true");
  const explanation = lines.length ? el("ol", { class: "explanation" }, lines.map((each) => el("li", {}, each))) : el("p", { class: "muted" }, "This is asserted directly.");
  const colspan = String(visibleColumns(answers).length + 1);
  row.after(el("tr", { class: "explanation-row", "data-explanation": String(index) }, el("td", { colspan }, el("div", {}, explanation))));
}

// A fact that is missing from the knowledge base, with fields to assert it.
function missingFact(fact, askAgain) {
  const inputs = {};
  const field = (name, kind) => {
    const { root, input } = nameField({ kind, label: name, value: fact[name], onEnter: assertFact, placeholder: name, "data-statement": name });
    inputs[name] = input;
    return root;
  };
  async function assertFact() {
    const statement = Object.fromEntries(Object.entries(inputs).map(([name, input]) => [name, input.value.trim()]));
    if (Object.values(statement).some((text) => !text)) return toast("A statement needs a subject, a property and a value.", "error");
    const added = await callOrToast("ask.tell", statement);
    if (added === undefined) return;
    if (!added) toast("This statement already exists.");
    askAgain();
  }
  return el("div", { class: "missing-fact", "data-missing": fact.property },
    el("p", {}, el("strong", {}, "Missing: "), fact.reason),
    el("div", { class: "statement" }, field("subject", "VALUE"), field("property", "PROPERTY"), field("value", "VALUE"),
      el("button", { type: "button", "data-action": "tell", onclick: assertFact }, "Assert")));
}
