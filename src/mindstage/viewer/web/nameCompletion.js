// A text field with completion of names (WAI-ARIA combobox).

import { channel } from "./rpcChannel.js";
import { debounce, el, replaceChildren } from "./dom.js";

let fieldCount = 0;

// A text field with a list of completions below. `kind` is the kind of name (CLASS, INDIVIDUAL, …), any if empty;
// `onEnter` is called when Enter is pressed and no completion is chosen. Returns the root element and the input.
export function nameField({ kind, label, value = "", onEnter = () => {}, ...attributes }) {
  const list = el("ul", { id: `completions-${++fieldCount}`, role: "listbox", class: "completions", "aria-label": label, hidden: true });
  const input = el("input", {
    type: "text", role: "combobox", autocomplete: "off", autocapitalize: "off", spellcheck: "false", value,
    "aria-label": label, "aria-expanded": "false", "aria-controls": list.id, "aria-autocomplete": "list", ...attributes,
  });
  let active = -1;
  let requests = 0;

  const close = () => {
    requests++;
    active = -1;
    list.hidden = true;
    input.setAttribute("aria-expanded", "false");
    input.removeAttribute("aria-activedescendant");
  };
  const accept = (option) => {
    input.value = option.dataset.name;
    close();
  };
  const activate = (index) => {
    const options = [...list.children];
    active = (index + options.length) % options.length;
    options.forEach((option, each) => option.setAttribute("aria-selected", String(each === active)));
    options[active].scrollIntoView({ block: "nearest" });
    input.setAttribute("aria-activedescendant", options[active].id);
  };
  const complete = debounce(async () => {
    const request = ++requests;
    if (!input.value.trim()) return close();
    const found = await channel.call("ask.complete", { prefix: input.value.trim(), kind }).catch(() => []);
    if (request !== requests || document.activeElement !== input) return;
    const isComplete = found.length === 1 && found[0].name === input.value.trim();
    if (!found.length || isComplete) return close();
    replaceChildren(list, found.map(({ name, iri, description }, index) =>
      el("li", { id: `${list.id}-${index}`, role: "option", "aria-selected": "false", "data-name": name, title: iri },
        el("span", { class: "grow" }, name), el("span", { class: "muted" }, description))));
    list.hidden = false;
    active = -1;
    input.setAttribute("aria-expanded", "true");
  }, 90);

  input.addEventListener("input", complete);
  input.addEventListener("blur", () => setTimeout(close, 150));
  list.addEventListener("mousedown", (event) => {
    const option = event.target.closest("li");
    event.preventDefault();
    if (option) accept(option);
  });
  input.addEventListener("keydown", (event) => {
    const open = !list.hidden;
    if (event.key === "ArrowDown" && open) activate(active + 1);
    else if (event.key === "ArrowUp" && open) activate(active - (active < 0 ? 0 : 1));
    else if (event.key === "Escape" && open) close();
    else if (event.key === "Enter" && open && active >= 0) accept(list.children[active]);
    else if (event.key === "Enter") {
      close();
      onEnter();
    } else return;
    event.preventDefault();
    event.stopPropagation();
  });
  return { root: el("div", { class: "completion" }, input, list), input };
}
