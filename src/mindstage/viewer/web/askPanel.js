// The Ask panel: a question in words, its answer as a sentence and as rows, which are highlighted at once; under "More"
// the forms of the declared questions, SPARQL queries and Prolog goals; earlier questions; the legend of what is highlighted.

import { answerTable, highlight } from "./answerTable.js";
import { channel } from "./rpcChannel.js";
import { nameField } from "./nameCompletion.js";
import { el, replaceChildren } from "./dom.js";
import { panels } from "./panels.js";
import { onReplacedWorld } from "./replacedWorld.js";
import { callOrToast } from "./toasts.js";

const EXAMPLE_PROLOG = "storage_place_in_environment(Map, knowrob:'CowsMilk', Place),\narticulated_parts(Map, Place, State, Part)";
const EXAMPLE_SPARQL = "SELECT ?thing ?class WHERE {\n  ?thing a ?class .\n  ?class rdfs:subClassOf* knowrob:Container\n} LIMIT 50";
const DEFAULT_QUESTION = "storage_place_in_environment";
const MAX_EARLIER = 20;

class AskPanel {
  #questions = [];
  #inputs = new Map();
  #requests = 0;
  #prologMissing = "";
  #form = el("div", { class: "ask-form" });
  #answers = el("div", { "aria-live": "polite", "aria-busy": "false", "data-role": "answers" });
  #modes = el("div", { class: "modes", role: "group", "aria-label": "Query language" });
  #more = el("details", { class: "more" }, el("summary", { "data-role": "more-questions" }, "More: forms, SPARQL, Prolog"), this.#modes, this.#form);
  #earlierList = el("ul", { class: "earlier", "data-role": "earlier-questions" });
  #earlier = el("details", { hidden: true }, el("summary", {}, "Earlier questions"), this.#earlierList);
  #sentence = this.#sentenceField();

  build(root) {
    root.append(this.#sentence, this.#answers, this.#earlier, this.#more);
    replaceChildren(this.#modes, this.#modeButton("question", "Question"), this.#modeButton("sparql", "SPARQL"));
    onReplacedWorld(() => {
      this.#requests += 1; // an answer that is on its way is about the former world
      replaceChildren(this.#answers);
      this.#answers.setAttribute("aria-busy", "false");
    });
    channel.on("connection", (connected) => connected && !this.#questions.length && this.#loadQuestions());
  }

  async #loadQuestions() {
    const questions = await callOrToast("ask.questions");
    if (!questions) return;
    this.#questions = questions;
    const { prolog, prolog_missing: missing } = (await callOrToast("ask.languages")) ?? {};
    this.#prologMissing = prolog ? "" : missing;
    this.#modes.append(this.#modeButton("prolog", "Prolog"));
    this.#setMode("question");
  }

  // The declared questions: {name, summary, ...}.
  get questions() {
    return this.#questions;
  }

  // Shows the form of a question.
  show(name) {
    this.#more.open = true;
    this.#setMode("question");
    const menu = this.#form.querySelector("[data-role=question]");
    menu.value = name;
    menu.dispatchEvent(new Event("change"));
    this.#form.querySelector("form input")?.focus();
  }

  #modeButton(name, title) {
    return el("button", { type: "button", "data-mode": name, "aria-pressed": "false", onclick: () => this.#setMode(name) }, title);
  }

  #setMode(mode) {
    for (const button of this.#modes.children) button.setAttribute("aria-pressed", String(button.dataset.mode === mode));
    replaceChildren(this.#answers);
    if (mode === "question") this.#showQuestions();
    else if (mode === "sparql") this.#showEditor("SPARQL query", EXAMPLE_SPARQL, "7", (query) => this.#ask("ask.sparql", { query }));
    else if (this.#prologMissing) replaceChildren(this.#form, el("p", { "data-role": "prolog-missing" }, this.#prologMissing));
    else this.#showEditor("Prolog goal", EXAMPLE_PROLOG, "4", (line) => this.#ask("ask.prolog", { line }));
  }

  // -- question forms ----------------------------------------------------------------------------------------------

  #showQuestions() {
    const first = this.#questions.find(({ name }) => name === DEFAULT_QUESTION) ?? this.#questions[0];
    const menu = el("select", { "aria-label": "Question", "data-role": "question", onchange: () => this.#showQuestion(menu.value, form) },
      this.#questions.map(({ name }) => el("option", { value: name, selected: name === first.name }, name.replaceAll("_", " "))));
    const form = el("form", { onsubmit: (event) => event.preventDefault() });
    replaceChildren(this.#form, menu, form);
    this.#showQuestion(first.name, form);
  }

  // A plain sentence; the answers begin with the question that it was understood as.
  #sentenceField() {
    const input = el("input", { type: "text", class: "grow", maxlength: "1000", "aria-label": "Question in words", placeholder: "where is the milk?", "data-role": "sentence" });
    const ask = () => {
      const text = input.value.trim();
      if (text) this.#ask("ask", { question: text.endsWith("?") ? text : `${text}?` });
    };
    input.addEventListener("keydown", (event) => event.key === "Enter" && ask());
    return el("div", { class: "row" }, input, el("button", { type: "button", class: "primary", "data-action": "ask-sentence", onclick: ask }, "Ask"));
  }

  #showQuestion(name, form) {
    const question = this.#questions.find((each) => each.name === name);
    const ask = () => this.#ask("ask", { question: name, args: this.#arguments() });
    this.#inputs.clear();
    replaceChildren(this.#answers);
    replaceChildren(form,
      el("p", { class: "muted description" }, question.text.split("\n\n")[0]),
      question.arguments.map((argument) => this.#argumentField(argument, ask)),
      el("div", { class: "row" },
        el("button", { type: "button", class: "primary", "data-action": "ask", onclick: ask }, "Ask"),
        question.live ? el("span", { class: "muted" }, "uses the current simulation state") : null));
  }

  #argumentField({ name, kind, choices, completion }, ask) {
    const label = name.replaceAll("_", " ");
    const attributes = { "data-argument": name };
    let field;
    let input;
    if (choices.length) {
      field = input = el("select", { "aria-label": label, ...attributes }, el("option", { value: "" }, "any"), choices.map((choice) => el("option", { value: choice }, choice)));
    } else if (completion) {
      ({ root: field, input } = nameField({ kind: completion, label, onEnter: ask, placeholder: kind, ...attributes }));
    } else {
      const onkeydown = (event) => event.key === "Enter" && ask();
      field = input = el("input", { type: kind === "number" ? "number" : "text", step: "any", "aria-label": label, placeholder: kind, onkeydown, ...attributes });
    }
    this.#inputs.set(name, input);
    return el("label", { class: "argument" }, el("span", {}, label), field);
  }

  // The arguments that are filled in; the server answers with values for the others.
  #arguments() {
    const values = [...this.#inputs].map(([name, input]) => [name, input.value.trim()]);
    return Object.fromEntries(values.filter(([, text]) => text));
  }

  // -- SPARQL and Prolog -------------------------------------------------------------------------------------------

  #showEditor(label, example, rows, run) {
    const text = el("textarea", { rows, spellcheck: "false", "aria-label": label, "data-role": "text" }, example);
    const ask = () => run(text.value);
    text.addEventListener("keydown", (event) => event.key === "Enter" && (event.ctrlKey || event.metaKey) && ask());
    replaceChildren(this.#form, text, el("div", { class: "row" }, el("button", { type: "button", class: "primary", "data-action": "ask", onclick: ask }, "Ask"), el("span", { class: "muted" }, "or Ctrl+Enter")));
  }

  // Shows the place of the question in the queue of all clients, if it has to wait.
  #showPlace(status) {
    const before = channel.latest("ask.place");
    return channel.on("ask.place", (value) => {
      if (value === before) return; // of an earlier question
      status.textContent = `Waiting: place ${value.place} of ${value.waiting} in the queue…`;
    });
  }

  // Lists a question under the earlier ones, the last one first.
  #remember(method, params) {
    const text = params.query ?? params.line ?? [params.question.replaceAll("_", " "), ...Object.entries(params.args ?? {}).map(([name, value]) => `${name}=${value}`)].join(" ");
    for (const item of [...this.#earlierList.children]) if (item.dataset.text === text) item.remove();
    this.#earlierList.prepend(el("li", { "data-text": text }, el("button", { type: "button", class: "flat", onclick: () => this.#ask(method, params) }, text)));
    while (this.#earlierList.children.length > MAX_EARLIER) this.#earlierList.lastChild.remove();
    this.#earlier.hidden = false;
  }

  // -- requests ----------------------------------------------------------------------------------------------------

  // Sends a question and shows its answers, unless another one was sent meanwhile.
  async #ask(method, params) {
    this.#remember(method, params);
    const request = ++this.#requests;
    this.#answers.setAttribute("aria-busy", "true");
    const status = el("p", { class: "muted pending", role: "status" }, "Running the query…");
    replaceChildren(this.#answers, status);
    const unsubscribe = method === "ask" ? this.#showPlace(status) : () => {};
    try {
      const answers = await channel.call(method, params);
      if (request !== this.#requests) return;
      replaceChildren(this.#answers, answerTable(answers, () => this.#ask(method, params)));
      if (method === "ask" && answers.ids.some(Boolean)) highlight(answers, { atOnce: true });
    } catch (error) {
      if (request === this.#requests) replaceChildren(this.#answers, el("p", { class: "error-text", role: "alert", "data-role": "error" }, error.message));
    } finally {
      unsubscribe();
      if (request === this.#requests) this.#answers.setAttribute("aria-busy", "false");
    }
  }
}

export const askPanel = new AskPanel();
panels.add({ id: "ask", title: "Ask", side: "right", order: 30, build: (root) => askPanel.build(root) });

// -- the legend over the 3D view ---------------------------------------------------------------------------------------

const legend = el("div", { id: "legend", "aria-label": "Highlighted bodies", hidden: true });
document.getElementById("center").append(legend);

channel.on("highlights", (groups) => {
  legend.hidden = !groups.length;
  const items = [...groups].reverse().map((group) => {
    const dot = el("span", { class: "dot", "aria-hidden": "true" });
    dot.style.background = group.color;
    const count = el("span", { class: "muted" }, String(group.ids.length));
    const clear = el("button", { type: "button", class: "flat", "aria-label": `Clear ${group.label || "highlight"}`, onclick: () => callOrToast("ask.clear_highlights", group.label ? { label: group.label } : {}) }, "×");
    return el("li", { "data-highlighted": String(group.ids.length), "data-color": group.color }, dot, el("span", { class: "grow" }, group.label || "highlighted"), count, clear);
  });
  replaceChildren(legend, el("ul", {}, items), groups.length > 1 ? el("button", { type: "button", class: "flat", onclick: () => callOrToast("ask.clear_highlights") }, "Clear all") : null);
});
