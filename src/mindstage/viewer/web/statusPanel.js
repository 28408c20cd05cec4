// The Status panel: engine statistics, connected clients, and the report on the map (findings, assumptions, failures).

import { channel } from "./rpcChannel.js";
import { debounce, el, replaceChildren } from "./dom.js";
import { panels } from "./panels.js";
import { selection } from "./selection.js";
import { viewFrame } from "./viewFrame.js";
import { callOrToast, toast } from "./toasts.js";

const MAX_ENTRIES = 200;
const MAX_IDS = 6;

class StatusPanel {
  #statistics = el("dl", { class: "statistics", "data-role": "statistics" });
  #window = el("p", { class: "muted" });
  #clients = el("ul", { class: "clients", "data-role": "clients" });
  #filters = el("div", { class: "filters", role: "group", "aria-label": "Groups of entries" });
  #search = el("input", { type: "search", placeholder: "Search the report", "aria-label": "Search the report", oninput: debounce(() => this.#showEntries()) });
  #entries = el("ul", { class: "report-entries", "data-role": "report-entries" });
  #report = { groups: [], entries: [], total: 0 };
  #group = "";
  #reportVersion = -1;
  #open = false;
  #fault = "";

  build(root) {
    root.append(
      el("h2", {}, "Engine"), this.#statistics,
      el("h2", {}, "Connected clients"), this.#window, this.#clients,
      el("h2", {}, "Map report"), this.#filters, this.#search, this.#entries);
    channel.on("window", (name) => {
      this.#window.textContent = `Others see this page as “${name}”.`;
    });
    channel.on("status", (status) => this.#show(status));
  }

  shown() {
    this.#open = true;
    this.#loadReport(channel.latest("status"));
  }

  hidden() {
    this.#open = false;
  }

  #show(status) {
    if (status.fault && status.fault !== this.#fault) toast(`The simulation has stopped: ${status.fault}`, "error");
    this.#fault = status.fault;
    const engine = status.statistics;
    const rows = {
      engine: status.engine,
      time: `${status.time_s.toFixed(1)} s, ${status.playing ? `playing at ${status.real_time_factor.toFixed(2)} × real time` : "paused"}`,
      bodies: engine ? `${status.bodies}, ${engine.movable} movable, ${engine.awake} awake` : String(status.bodies),
      contacts: engine ? String(engine.contacts) : "not reported by the engine",
      "time step": engine?.timestep_s ? `${Number((engine.timestep_s * 1000).toPrecision(3))} ms` : null,
      browsers: String(status.browsers),
      "3D view": viewFrame.contentWindow?.mindstageView?.quality?.description ?? null,
      fault: status.fault || null,
    };
    replaceChildren(this.#statistics, Object.entries(rows).filter(([, text]) => text !== null).flatMap(([name, text]) => [
      el("dt", {}, name), el("dd", { "data-statistic": name, class: name === "fault" ? "error-text" : null }, text)]));
    replaceChildren(this.#clients, status.clients.length ? status.clients.map(({ name, transport, activity }) => el("li", { "data-client": name }, el("strong", {}, name), ` ${transport} `, el("span", { class: "muted" }, activity))) : el("li", { class: "muted" }, "no ROS clients"));
    this.#loadReport(status);
  }

  // Loads the report again if it has changed and the panel is open.
  async #loadReport(status) {
    if (!this.#open || !status || status.report === this.#reportVersion) return;
    this.#reportVersion = status.report;
    const report = await callOrToast("status.report");
    if (!report) return;
    this.#report = report;
    if (!report.groups.some(({ name }) => name === this.#group)) this.#group = "";
    this.#showFilters();
    this.#showEntries();
  }

  #showFilters() {
    const button = (name, title, count) => el("button", { type: "button", "data-group": name, "aria-pressed": String(name === this.#group), onclick: () => {
      this.#group = name;
      this.#showFilters();
      this.#showEntries();
    } }, `${title} ${count}`);
    replaceChildren(this.#filters, button("", "all", this.#report.total), this.#report.groups.map(({ name, count }) => button(name, name, count)));
  }

  #showEntries() {
    const words = this.#search.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
    const found = this.#report.entries.filter((entry) => (!this.#group || entry.group === this.#group)
      && words.every((word) => `${entry.group} ${entry.text} ${entry.ids.join(" ")}`.toLowerCase().includes(word)));
    const hidden = found.length - MAX_ENTRIES;
    const omitted = this.#report.total - this.#report.entries.length;
    replaceChildren(this.#entries, found.slice(0, MAX_ENTRIES).map((entry) => this.#entry(entry)),
      found.length ? null : el("li", { class: "muted" }, this.#report.total ? "No matching entries." : "No findings and no assumptions."),
      hidden > 0 ? el("li", { class: "muted" }, `… and ${hidden} more; narrow the search to see them`) : null,
      omitted > 0 ? el("li", { class: "muted" }, `${omitted} more entries were not sent by the server`) : null);
  }

  #entry({ group, text, ids, is_error: isError }) {
    const bodies = ids.slice(0, MAX_IDS).map((id) => el("button", { type: "button", class: "flat body-id", onclick: () => selection.select(id, { focus: true }) }, id));
    return el("li", { class: isError ? "error" : null, "data-entry": group }, el("span", { class: "muted entry-group" }, group), el("span", {}, text), bodies.length ? el("span", { class: "body-ids" }, bodies, ids.length > MAX_IDS ? ` and ${ids.length - MAX_IDS} more` : null) : null);
  }
}

const panel = new StatusPanel();
panels.add({ id: "status", title: "Status", side: "right", order: 40, build: (root) => panel.build(root), shown: () => panel.shown(), hidden: () => panel.hidden() });
