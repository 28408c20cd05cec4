// Status: how the engine does, who is connected, and what was found and assumed about the map.

import { channel } from "./channel.js";
import { el, fill, lately } from "./dom.js";
import { panels } from "./panels.js";
import { selection } from "./selection.js";
import { attempt, toast } from "./toasts.js";

const MOST = 200;

class StatusPanel {
  #figures = el("dl", { class: "figures", "data-role": "figures" });
  #guests = el("ul", { class: "guests", "data-role": "guests" });
  #groups = el("div", { class: "groups", role: "group", "aria-label": "Kinds of remarks" });
  #search = el("input", { type: "search", placeholder: "Search the remarks", "aria-label": "Search the remarks", oninput: lately(() => this.#list()) });
  #entries = el("ul", { class: "entries", "data-role": "entries" });
  #report = { groups: [], entries: [], total: 0 };
  #group = "";
  #told = -1;
  #open = false;
  #fault = "";

  build(root) {
    root.append(
      el("h2", {}, "Engine"), this.#figures,
      el("h2", {}, "Connected"), this.#guests,
      el("h2", {}, "The map"), this.#groups, this.#search, this.#entries);
    channel.on("status", (status) => this.#show(status));
  }

  shown() {
    this.#open = true;
    this.#refresh(channel.latest("status"));
  }

  hidden() {
    this.#open = false;
  }

  #show(status) {
    if (status.fault && status.fault !== this.#fault) toast(`The world stands still: ${status.fault}`, "error");
    this.#fault = status.fault;
    const busy = status.statistics;
    const figures = {
      engine: status.engine,
      time: `${status.time_s.toFixed(1)} s, ${status.playing ? `playing at ${status.real_time_factor.toFixed(2)} × real time` : "paused"}`,
      bodies: busy ? `${status.bodies}, ${busy.movable} can move, ${busy.awake} awake` : String(status.bodies),
      contacts: busy ? String(busy.contacts) : "the engine does not say",
      "time step": busy?.timestep_s ? `${Number((busy.timestep_s * 1000).toPrecision(3))} ms` : null,
      visitors: String(status.visitors),
      fault: status.fault || null,
    };
    fill(this.#figures, Object.entries(figures).filter(([, text]) => text !== null).flatMap(([name, text]) => [
      el("dt", {}, name), el("dd", { "data-figure": name, class: name === "fault" ? "bad-text" : null }, text)]));
    fill(this.#guests, status.guests.length ? status.guests.map(({ name, way, does }) => el("li", { "data-guest": name }, el("strong", {}, name), ` ${way} `, el("span", { class: "faint" }, does))) : el("li", { class: "faint" }, "no program over ROS"));
    this.#refresh(status);
  }

  async #refresh(status) {
    if (!this.#open || !status || status.report === this.#told) return;
    this.#told = status.report;
    const report = await attempt("status.report");
    if (!report) return;
    this.#report = report;
    if (!report.groups.some(({ name }) => name === this.#group)) this.#group = "";
    this.#offer();
    this.#list();
  }

  #offer() {
    const button = (name, title, count) => el("button", { type: "button", "data-group": name, "aria-pressed": String(name === this.#group), onclick: () => {
      this.#group = name;
      this.#offer();
      this.#list();
    } }, `${title} ${count}`);
    fill(this.#groups, button("", "all", this.#report.total), this.#report.groups.map(({ name, count }) => button(name, name, count)));
  }

  #list() {
    const words = this.#search.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
    const found = this.#report.entries.filter((entry) => (!this.#group || entry.group === this.#group)
      && words.every((word) => `${entry.group} ${entry.text} ${entry.ids.join(" ")}`.toLowerCase().includes(word)));
    const more = found.length - MOST;
    const rest = this.#report.total - this.#report.entries.length;
    fill(this.#entries, found.slice(0, MOST).map((entry) => this.#entry(entry)),
      found.length ? null : el("li", { class: "faint" }, this.#report.total ? "Nothing like that." : "Nothing odd was found, and nothing assumed."),
      more > 0 ? el("li", { class: "faint" }, `… and ${more} more; search for less`) : null,
      rest > 0 ? el("li", { class: "faint" }, `${rest} are not listed here`) : null);
  }

  #entry({ group, text, ids, grave }) {
    const bodies = ids.slice(0, 6).map((id) => el("button", { type: "button", class: "quiet id", onclick: () => selection.choose(id, { focus: true }) }, id));
    return el("li", { class: grave ? "grave" : null, "data-entry": group }, el("span", { class: "faint kind" }, group), el("span", {}, text), bodies.length ? el("span", { class: "ids" }, bodies, ids.length > 6 ? ` and ${ids.length - 6} more` : null) : null);
  }
}

const panel = new StatusPanel();
panels.add({ id: "status", title: "Status", side: "right", order: 40, build: (root) => panel.build(root), shown: () => panel.shown(), hidden: () => panel.hidden() });
