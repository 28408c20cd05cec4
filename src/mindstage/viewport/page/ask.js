// Ask: the declared questions as forms, SPARQL, and lines in Prolog.

import { answersView, legend } from "./answers.js";
import { channel } from "./channel.js";
import { nameField } from "./completion.js";
import { el, fill } from "./dom.js";
import { panels } from "./panels.js";
import { attempt } from "./toasts.js";

const PROLOG = "storage_place_in_environment(Map, knowrob:'CowsMilk', Place),\nopenings(Map, Place, State, Front)";
const SPARQL = "SELECT ?thing ?class WHERE {\n  ?thing a ?class .\n  ?class rdfs:subClassOf* knowrob:Container\n} LIMIT 50";
const FIRST = "storage_place_in_environment";

class AskPanel {
  #questions = [];
  #fields = new Map();
  #form = el("div", { class: "ask-form" });
  #answers = el("div", { "aria-live": "polite", "aria-busy": "false", "data-role": "answers" });
  #modes = el("div", { class: "modes", role: "group", "aria-label": "How to ask" });

  build(root) {
    root.append(this.#modes, this.#form, this.#answers);
    fill(this.#modes, this.#mode("question", "Question"), this.#mode("sparql", "SPARQL"));
    channel.on("connection", (connected) => connected && !this.#questions.length && this.#begin());
  }

  async #begin() {
    const questions = await attempt("ask.questions");
    if (!questions) return;
    this.#questions = questions;
    const { prolog } = (await attempt("ask.ways")) ?? {};
    if (prolog) this.#modes.append(this.#mode("prolog", "Prolog"));
    this.#choose("question");
  }

  #mode(name, title) {
    return el("button", { type: "button", "data-mode": name, "aria-pressed": "false", onclick: () => this.#choose(name) }, title);
  }

  #choose(mode) {
    for (const button of this.#modes.children) button.setAttribute("aria-pressed", String(button.dataset.mode === mode));
    fill(this.#answers);
    if (mode === "question") this.#offerQuestions();
    else if (mode === "sparql") this.#offerText("SPARQL query", SPARQL, "7", (query) => this.#ask("ask.query", { query }));
    else this.#offerText("Prolog line", PROLOG, "4", (line) => this.#ask("ask.line", { line }));
  }

  // -- questions ---------------------------------------------------------------------------------------------------

  #offerQuestions() {
    const start = this.#questions.find(({ name }) => name === FIRST) ?? this.#questions[0];
    const menu = el("select", { "aria-label": "Question", "data-role": "question", onchange: () => this.#offer(menu.value, about) },
      this.#questions.map(({ name }) => el("option", { value: name, selected: name === start.name }, name.replaceAll("_", " "))));
    const about = el("form", { onsubmit: (event) => event.preventDefault() });
    fill(this.#form, menu, about);
    this.#offer(start.name, about);
  }

  #offer(name, root) {
    const question = this.#questions.find((each) => each.name === name);
    const ask = () => this.#ask("ask", { question: name, args: this.#given() });
    this.#fields.clear();
    fill(this.#answers);
    fill(root,
      el("p", { class: "faint about" }, question.text.split("\n\n")[0]),
      question.arguments.map((argument) => this.#field(argument, ask)),
      el("div", { class: "row" },
        el("button", { type: "button", class: "main", "data-do": "ask", onclick: ask }, "Ask"),
        question.live ? el("span", { class: "faint" }, "about the place as it is now") : null));
  }

  #field(argument, ask) {
    const { name, kind, choices, completed } = argument;
    const label = name.replaceAll("_", " ");
    const attributes = { "data-argument": name };
    let shown;
    let input;
    if (choices.length) {
      shown = input = el("select", { "aria-label": label, ...attributes }, el("option", { value: "" }, "any"), choices.map((choice) => el("option", { value: choice }, choice)));
    } else if (completed) {
      ({ root: shown, input } = nameField({ kind: completed, label, enter: ask, placeholder: kind, ...attributes }));
    } else {
      const enter = (event) => event.key === "Enter" && ask();
      shown = input = el("input", { type: kind === "number" ? "number" : "text", step: "any", "aria-label": label, placeholder: kind, onkeydown: enter, ...attributes });
    }
    this.#fields.set(name, input);
    return el("label", { class: "argument" }, el("span", {}, label), shown);
  }

  #given() {
    const given = [...this.#fields].map(([name, input]) => [name, input.value.trim()]);
    return Object.fromEntries(given.filter(([, text]) => text));
  }

  // -- SPARQL and Prolog -------------------------------------------------------------------------------------------

  #offerText(label, example, rows, asking) {
    const text = el("textarea", { rows, spellcheck: "false", "aria-label": label, "data-role": "text" }, example);
    const ask = () => asking(text.value);
    text.addEventListener("keydown", (event) => event.key === "Enter" && (event.ctrlKey || event.metaKey) && ask());
    fill(this.#form, text, el("div", { class: "row" }, el("button", { type: "button", class: "main", "data-do": "ask", onclick: ask }, "Ask"), el("span", { class: "faint" }, "or Ctrl+Enter")));
  }

  // -- both --------------------------------------------------------------------------------------------------------

  #turn = 0;

  async #ask(what, wish) {
    const turn = ++this.#turn;
    this.#answers.setAttribute("aria-busy", "true");
    fill(this.#answers, el("p", { class: "faint thinking" }, "Thinking…"));
    try {
      const table = await channel.ask(what, wish);
      if (turn === this.#turn) fill(this.#answers, answersView(table, () => this.#ask(what, wish)));
    } catch (error) {
      if (turn === this.#turn) fill(this.#answers, el("p", { class: "bad-text", role: "alert", "data-role": "refusal" }, error.message));
    } finally {
      if (turn === this.#turn) this.#answers.setAttribute("aria-busy", "false");
    }
  }
}

const panel = new AskPanel();
panels.add({ id: "ask", title: "Ask", side: "right", order: 30, build: (root) => panel.build(root) });

const key = el("div", { id: "legend", "aria-label": "What is lit", hidden: true });
document.getElementById("middle").append(key);
legend(key);
