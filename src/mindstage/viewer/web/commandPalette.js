// The command palette: finds commands, questions and bodies by their words.

import { el, replaceChildren } from "./dom.js";

const MAX_SHOWN = 40;

class CommandPalette {
  #entries = [];
  #shown = [];
  #active = 0;
  #before = null;
  #input = el("input", { type: "text", role: "combobox", "aria-expanded": "true", "aria-controls": "palette-list", "aria-autocomplete": "list", "aria-label": "Find a command, a question or a body", placeholder: "Find a command, a question or a body", "data-role": "find-command", autocomplete: "off", spellcheck: "false",
    oninput: () => this.#find(), onkeydown: (event) => this.#onKey(event) });
  #list = el("ul", { id: "palette-list", role: "listbox", "aria-label": "Commands" });
  #dialog = el("dialog", { id: "palette", "aria-label": "Command palette", onclick: (event) => event.target === this.#dialog && this.#dialog.close(), onclose: () => this.#leave() }, this.#input, this.#list);

  constructor() {
    document.body.append(this.#dialog);
  }

  // Opens it with entries: {title, group, keys?, detail?, disabled?, run()}.
  open(entries) {
    if (this.#dialog.open) return this.#dialog.close();
    this.#before = document.activeElement;
    this.#entries = entries.map((entry) => ({ ...entry, words: `${entry.title} ${entry.group} ${entry.detail ?? ""}`.toLowerCase() }));
    this.#input.value = "";
    this.#dialog.showModal();
    this.#find();
    this.#input.focus();
  }

  // A field of a closed dialog may keep the focus, and would take the next keys.
  #leave() {
    if (document.activeElement === this.#input) this.#input.blur();
    this.#before?.focus?.();
  }

  #find() {
    const text = this.#input.value.trim().toLowerCase();
    const parts = text.split(/\s+/).filter(Boolean);
    const rank = ({ title, words }) => {
      const name = title.toLowerCase();
      if (name === text || name === `select ${text}`) return 0;
      if (name.startsWith(text)) return 1;
      return parts.every((part) => name.split(/[\s:_]+/).some((word) => word.startsWith(part))) ? 2 : words.includes(text) ? 3 : 4;
    };
    const found = this.#entries.filter(({ words, group }) => (parts.length ? parts.every((part) => words.includes(part)) : group !== "Bodies"));
    this.#shown = found.map((entry, index) => [rank(entry), entry.disabled ? 1 : 0, index, entry]).sort((a, b) => a[0] - b[0] || a[1] - b[1] || a[2] - b[2]).slice(0, MAX_SHOWN).map((each) => each[3]);
    this.#active = 0;
    this.#show();
  }

  #show() {
    const row = ({ title, group, keys = [], disabled }, index) => el("li", { id: `palette-${index}`, role: "option", "aria-selected": String(index === this.#active), "aria-disabled": disabled ? "true" : undefined, "data-entry": title, onclick: () => this.#run(index) },
      el("span", { class: "grow" }, title), el("span", { class: "muted" }, group), keys.map((key) => el("kbd", {}, key)));
    replaceChildren(this.#list, this.#shown.length ? this.#shown.map(row) : el("li", { class: "muted" }, "Nothing found."));
    if (this.#shown.length) this.#input.setAttribute("aria-activedescendant", `palette-${this.#active}`);
    else this.#input.removeAttribute("aria-activedescendant");
    this.#list.children[this.#active]?.scrollIntoView({ block: "nearest" });
  }

  #onKey(event) {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step && this.#shown.length) {
      this.#active = (this.#active + step + this.#shown.length) % this.#shown.length;
      this.#show();
    } else if (event.key === "Enter") this.#run(this.#active);
    else if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "k") this.#dialog.close();
    else return;
    event.preventDefault();
  }

  #run(index) {
    const entry = this.#shown[index];
    if (!entry || entry.disabled) return;
    this.#before = null; // the command decides where the focus goes
    this.#dialog.close();
    this.#leave(); // the event "close" comes later
    entry.run();
  }
}

export const commandPalette = new CommandPalette();
