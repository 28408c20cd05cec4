// The History panel: the edits of all clients, oldest first. A click on a step undoes or redoes everything up to it.

import { channel } from "./rpcChannel.js";
import { el, replaceChildren } from "./dom.js";
import { panels } from "./panels.js";
import { callOrToast } from "./toasts.js";

class HistoryPanel {
  #list = el("ol", { class: "history", role: "listbox", "aria-label": "Steps of the history", tabindex: "0", "data-role": "history", onkeydown: (event) => this.#onKey(event) });
  #position = 0;
  #count = 0;
  #version = 0;

  build(root) {
    root.classList.add("history-panel");
    root.append(el("p", { class: "muted" }, "Click a step to go back or forward to it."), this.#list);
    channel.on("history", (history) => this.#show(history));
  }

  #show({ done, undone, version }) {
    this.#version = version;
    this.#position = done.length;
    this.#count = done.length + undone.length;
    const step = (label, position) => {
      const current = position === this.#position;
      return el("li", { id: `step-${position}`, role: "option", class: position > this.#position ? "undone" : "", "aria-selected": String(current), "aria-current": current ? "step" : undefined, "data-step": position, onclick: () => this.#goTo(position) }, label);
    };
    replaceChildren(this.#list, step("Start", 0), [...done, ...undone].map((label, index) => step(label, index + 1)));
    this.#list.setAttribute("aria-activedescendant", `step-${this.#position}`);
    if (!this.#list.closest("[hidden]")) this.#list.querySelector("[aria-current]")?.scrollIntoView({ block: "nearest" });
  }

  #goTo(position) {
    if (position !== this.#position) callOrToast("go_to_step", { position, version: this.#version });
  }

  #onKey(event) {
    const target = { ArrowUp: this.#position - 1, ArrowDown: this.#position + 1, Home: 0, End: this.#count }[event.key];
    if (target === undefined) return;
    event.preventDefault();
    this.#goTo(Math.min(this.#count, Math.max(0, target)));
  }
}

const panel = new HistoryPanel();

panels.add({ id: "history", title: "History", side: "left", order: 20, build: (root) => panel.build(root) });
