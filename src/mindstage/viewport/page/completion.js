// Completion: a text field that offers the names that may be meant.

import { channel } from "./channel.js";
import { el, fill, lately } from "./dom.js";

let made = 0;

// A field with a list below it. `kind` is the kind of name (CLASS, INDIVIDUAL, …); any if it is empty.
export function nameField({ kind, label, value = "", enter = () => {}, ...attributes }) {
  const list = el("ul", { id: `names-${++made}`, role: "listbox", class: "names", "aria-label": label, hidden: true });
  const input = el("input", {
    type: "text", role: "combobox", autocomplete: "off", autocapitalize: "off", spellcheck: "false", value,
    "aria-label": label, "aria-expanded": "false", "aria-controls": list.id, "aria-autocomplete": "list", ...attributes,
  });
  let chosen = -1;
  let asked = 0;

  const close = () => {
    asked++;
    chosen = -1;
    list.hidden = true;
    input.setAttribute("aria-expanded", "false");
    input.removeAttribute("aria-activedescendant");
  };
  const take = (option) => {
    input.value = option.dataset.name;
    close();
  };
  const mark = (at) => {
    const options = [...list.children];
    chosen = (at + options.length) % options.length;
    options.forEach((option, each) => option.setAttribute("aria-selected", String(each === chosen)));
    options[chosen].scrollIntoView({ block: "nearest" });
    input.setAttribute("aria-activedescendant", options[chosen].id);
  };
  const offer = lately(async () => {
    const turn = ++asked;
    if (!input.value.trim()) return close();
    const found = await channel.ask("ask.names", { start: input.value.trim(), kind }).catch(() => []);
    if (turn !== asked || document.activeElement !== input) return;
    const only = found.length === 1 && found[0].name === input.value.trim();
    if (!found.length || only) return close();
    fill(list, found.map(({ name, iri, about }, at) =>
      el("li", { id: `${list.id}-${at}`, role: "option", "aria-selected": "false", "data-name": name, title: iri },
        el("span", { class: "grow" }, name), el("span", { class: "faint" }, about))));
    list.hidden = false;
    chosen = -1;
    input.setAttribute("aria-expanded", "true");
  }, 90);

  input.addEventListener("input", offer);
  input.addEventListener("blur", () => setTimeout(close, 150));
  list.addEventListener("mousedown", (event) => {
    const option = event.target.closest("li");
    event.preventDefault();
    if (option) take(option);
  });
  input.addEventListener("keydown", (event) => {
    const open = !list.hidden;
    if (event.key === "ArrowDown" && open) mark(chosen + 1);
    else if (event.key === "ArrowUp" && open) mark(chosen - (chosen < 0 ? 0 : 1));
    else if (event.key === "Escape" && open) close();
    else if (event.key === "Enter" && open && chosen >= 0) take(list.children[chosen]);
    else if (event.key === "Enter") {
      close();
      enter();
    } else return;
    event.preventDefault();
    event.stopPropagation();
  });
  return { root: el("div", { class: "completed" }, input, list), input };
}
