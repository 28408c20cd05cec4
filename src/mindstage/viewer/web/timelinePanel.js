// The timeline of a replay, below the view: playing, seeking, events as bars by kind, paths, and continuing from a moment.

import { channel } from "./rpcChannel.js";
import { el, formatNumber, replaceChildren } from "./dom.js";
import { icon } from "./icons.js";
import { bodyLink, selection } from "./selection.js";
import { callOrToast, toast } from "./toasts.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16];
const STEP_S = 0.01;
const MAX_BARS = 3000;
// Colors of kinds, in the order of the legend; kinds that are close in meaning are close in hue.
const COLORS = {
  Contact: "#8a94a0", Colliding: "#d6336c", SupportedBy: "#7a8f2a", ContainedIn: "#4c8f5c", Grasping: "#e8590c",
  PickingUp: "#f08c00", PuttingDown: "#b8860b", Transporting: "#c2410c", Sliding: "#0c8599", Opening: "#1971c2",
  Closing: "#4263eb", Falling: "#9c36b5", Performing: "#5c940d", TippingOver: "#c026a3",
};

// Kinds that are states: those that last from the begin of a recording to its end say nothing about it.
const STATES = new Set(["Contact", "SupportedBy", "ContainedIn"]);

const timeText = (time) => `${formatNumber(Math.floor(time / 60), 0)}:${(time % 60).toFixed(2).padStart(5, "0")}`;

function iconButton(iconName, title, onclick, action) {
  return el("button", { type: "button", class: "flat", title, "aria-label": title, "data-action": action, onclick }, icon(iconName));
}

class TimelinePanel {
  #root = document.getElementById("timeline");
  #recording = null;
  #state = null;
  #shownKinds = new Set();
  #event = null;
  // The time that is being asked for; newer ones replace it while the server has not answered.
  #wanted = null;
  #seeking = false;

  #play = iconButton("play", "Play the recording", () => this.#togglePlaying(), "timeline-play");
  #previous = iconButton("previousEvent", "Previous event ([)", () => this.#stepToEvent(true), "previous-event");
  #next = iconButton("nextEvent", "Next event (])", () => this.#stepToEvent(false), "next-event");
  #speed = el("select", { "aria-label": "Speed of the replay", title: "Speed", "data-action": "timeline-speed", onchange: () => this.#state?.playing && this.#start() },
    SPEEDS.map((factor) => el("option", { value: String(factor) }, `${factor} ×`)));
  #label = el("output", { class: "time", "data-role": "timeline-time", "aria-label": "Shown time" });
  #slider = el("input", { type: "range", step: String(STEP_S), "aria-label": "Time in the recording [s]", "data-role": "timeline-slider", oninput: () => this.#seek(Number(this.#slider.value)) });
  #trail = el("button", { type: "button", "data-action": "timeline-trail", "aria-pressed": "false", title: "Show the path of the selected body in the whole recording", onclick: () => this.#toggleTrail() }, "Path");
  #resume = el("button", { type: "button", class: "primary", "data-action": "timeline-resume", title: "Continue from here as a live simulation; the recording stays as it is", onclick: () => this.#continue() }, "Resume");
  #back = el("button", { type: "button", class: "primary", "data-action": "timeline-return", hidden: true, onclick: () => callOrToast("timeline.return") }, "Back to the recording");
  #live = el("span", { class: "muted", "data-role": "timeline-live", "aria-live": "polite" });
  #legend = el("div", { class: "legend", role: "group", "aria-label": "Kinds of events that are shown" });
  #lanes = el("div", { class: "lanes", "data-role": "timeline-lanes" });
  #cursor = el("div", { class: "cursor", "aria-hidden": "true" });
  #evidence = el("div", { class: "evidence", "data-role": "timeline-event", "aria-live": "polite", hidden: true });
  #note = el("span", { class: "muted", "data-role": "timeline-note" });

  constructor() {
    this.#speed.value = "1";
    const track = el("div", { class: "track" }, this.#slider, el("div", { class: "marks" }, this.#lanes, this.#cursor));
    this.#root.append(
      el("div", { class: "row controls", role: "toolbar", "aria-label": "Replay" }, this.#previous, this.#play, this.#next, this.#speed, this.#label, this.#trail, this.#resume, this.#back, this.#live, el("span", { class: "grow" }), this.#legend, this.#note),
      track, this.#evidence);
    document.addEventListener("keydown", (event) => this.#onKey(event));
    channel.on("timeline", (recording) => this.#showRecording(recording));
    channel.on("timeline_state", (state) => this.#showState(state));
    selection.onChange((id) => {
      this.#trail.title = id ? `Show the path of ${id} in the whole recording` : "Select a body to show its path";
    });
  }

  get #isLive() {
    return this.#state?.resumed_at_s !== null && this.#state?.resumed_at_s !== undefined;
  }

  // -- time --------------------------------------------------------------------------------------------------------

  #togglePlaying() {
    if (this.#state?.playing) callOrToast("pause");
    else this.#start();
  }

  #start() {
    callOrToast("play", { speed: Number(this.#speed.value) });
  }

  async #seek(time) {
    this.#wanted = time;
    this.#showTime(time);
    if (this.#seeking) return;
    this.#seeking = true;
    while (this.#wanted !== null) {
      const asked = this.#wanted;
      await callOrToast("timeline.seek", { time_s: asked });
      if (this.#wanted === asked) this.#wanted = null;
    }
    this.#seeking = false;
  }

  async #stepToEvent(back) {
    if (this.#isLive) return;
    const id = await callOrToast("timeline.step_event", { back, kinds: [...this.#shownKinds] });
    if (id) this.#showEvent(this.#recording.recordings[0].events.find((event) => event.id === id), 0);
    else if (id === null) toast(back ? "There is no earlier event." : "There is no later event.");
  }

  #onKey(event) {
    if (this.#root.hidden || event.ctrlKey || event.metaKey || event.altKey || event.target.closest?.("input, select, textarea")) return;
    if (event.key === "[" || event.key === "]") this.#stepToEvent(event.key === "[");
    else if (event.key === " " && !event.target.closest?.("button, summary")) {
      event.preventDefault();
      this.#togglePlaying();
    }
  }

  #showState(state) {
    const wasLive = this.#isLive;
    this.#state = state;
    this.#play.replaceChildren(icon(state.playing ? "pause" : "play"));
    this.#play.title = state.playing ? "Pause" : this.#isLive ? "Play" : "Play the recording";
    this.#play.setAttribute("aria-label", this.#play.title);
    this.#play.setAttribute("aria-pressed", String(state.playing));
    if (state.playing && SPEEDS.includes(state.speed)) this.#speed.value = String(state.speed);
    for (const control of [this.#slider, this.#previous, this.#next]) control.disabled = this.#isLive;
    this.#resume.hidden = this.#isLive;
    this.#back.hidden = !this.#isLive;
    document.body.dataset.replay = this.#isLive ? "live" : "recording";
    if (wasLive !== this.#isLive) this.#live.title = state.notes.join("\n");
    this.#live.textContent = this.#isLive ? `live, continued at ${timeText(state.resumed_at_s)}` : "";
    this.#trail.setAttribute("aria-pressed", String(state.trail !== null));
    this.#trail.textContent = state.trail === null ? "Path" : `Path of ${state.trail}`;
    if (this.#wanted === null) this.#showTime(state.time_s);
  }

  #showTime(time) {
    if (!this.#recording) return;
    const { begin_s: begin, end_s: end } = this.#recording;
    this.#label.textContent = `${timeText(time)} / ${timeText(end)}`;
    this.#slider.setAttribute("aria-valuetext", `${time.toFixed(2)} seconds of ${end.toFixed(2)}`);
    if (document.activeElement !== this.#slider || this.#wanted === null) this.#slider.value = String(time);
    this.#cursor.style.left = `${100 * Math.min(1, Math.max(0, (time - begin) / Math.max(end - begin, 1e-9)))}%`;
  }

  // -- events ------------------------------------------------------------------------------------------------------

  #showRecording(recording) {
    this.#recording = recording;
    this.#root.hidden = false;
    document.body.dataset.replay ??= "recording";
    this.#slider.min = String(recording.begin_s);
    this.#slider.max = String(recording.end_s);
    this.#shownKinds = new Set(this.#events.map(({ kind }) => kind));
    this.#root.setAttribute("aria-label", `Timeline of ${recording.recordings.map(({ name }) => name).join(" and ")}`);
    this.#label.title = recording.recordings.map(({ name, start_unix_s: start }) => (start ? `${name}, recorded ${new Date(1000 * start).toLocaleString()}` : name)).join("\n");
    this.#showLegend();
    this.#showBars();
    this.#showTime(this.#state?.time_s ?? recording.begin_s);
  }

  get #events() {
    return this.#recording.recordings.flatMap((recording) => this.#eventsOf(recording));
  }

  // The events of a recording without states that last from its begin to its end.
  #eventsOf({ begin_s: begin, events }) {
    return (events ?? []).filter(({ kind, begin_s, end_s }) => !STATES.has(kind) || begin_s > begin || end_s !== null);
  }

  #showLegend() {
    const counts = new Map();
    for (const { kind } of this.#events) counts.set(kind, (counts.get(kind) ?? 0) + 1);
    const kinds = Object.keys(COLORS).filter((kind) => counts.has(kind));
    replaceChildren(this.#legend, kinds.map((kind) => {
      const chip = el("button", { type: "button", class: "kind", "data-kind": kind, "aria-pressed": String(this.#shownKinds.has(kind)), title: `${counts.get(kind)} × ${kind}; click to show or hide`, onclick: () => this.#toggleKind(kind) },
        el("span", { class: "dot", "aria-hidden": "true" }), `${kind} ${counts.get(kind)}`);
      chip.style.setProperty("--kind", COLORS[kind]);
      return chip;
    }));
    const errors = this.#recording.recordings.map(({ error }) => error).filter(Boolean);
    const isLoading = this.#recording.recordings.some(({ events }) => events === null);
    const none = this.#recording.recordings.some(({ events }) => events?.length) ? "No event begins or ends." : "No events.";
    this.#note.textContent = errors.join(" ") || (isLoading ? "Finding events…" : kinds.length ? "" : none);
  }

  #toggleKind(kind) {
    if (!this.#shownKinds.delete(kind)) this.#shownKinds.add(kind);
    this.#showLegend();
    this.#showBars();
    this.#legend.querySelector(`[data-kind="${kind}"]`)?.focus();
  }

  // One lane per kind and recording; each event is a bar from its begin to its end.
  #showBars() {
    const { recordings } = this.#recording;
    let drawn = 0;
    const groups = recordings.map((recording, number) => {
      const events = this.#eventsOf(recording);
      const { name } = recording;
      const lanes = Object.keys(COLORS).filter((kind) => this.#shownKinds.has(kind)).map((kind) => {
        // The longest first, so that shorter ones are above them.
        const length = (event) => (event.end_s ?? recording.end_s) - event.begin_s;
        const shown = events.filter((event) => event.kind === kind).sort((a, b) => length(b) - length(a));
        const bars = shown.slice(0, Math.max(0, MAX_BARS - drawn)).map((event) => this.#bar(event, number, event.begin_s + length(event)));
        drawn += shown.length;
        const lane = el("div", { class: "lane", role: "group", "aria-label": kind }, bars);
        lane.style.setProperty("--kind", COLORS[kind]);
        return shown.length ? lane : null;
      });
      return el("div", { role: "group", "aria-label": `Events of ${name}` }, recordings.length > 1 ? el("div", { class: "muted lane-name" }, name) : null, lanes);
    });
    replaceChildren(this.#lanes, groups);
    if (drawn > MAX_BARS) this.#note.textContent = `The first ${MAX_BARS} of ${drawn} events are drawn; hide kinds to see the others.`;
    this.#markEvent();
  }

  #bar(event, number, until) {
    const { begin_s: begin, end_s: end } = this.#recording;
    const percent = (time) => 100 * (time - begin) / Math.max(end - begin, 1e-9);
    const text = this.#describe(event);
    const bar = el("button", { type: "button", class: "bar", tabindex: "-1", "data-event": event.id, "data-recording": String(number), title: text, "aria-label": text, onclick: () => this.#goTo(event, number) });
    bar.style.left = `${percent(event.begin_s)}%`;
    bar.style.width = `${Math.max(0, percent(until) - percent(event.begin_s))}%`;
    return bar;
  }

  #describe({ kind, thing, other, begin_s: begin, end_s: end }) {
    return `${kind}: ${thing}${other ? `, ${other}` : ""}, ${begin.toFixed(2)} s to ${end === null ? "the end" : `${end.toFixed(2)} s`}`;
  }

  async #goTo(event, number) {
    if (!this.#isLive) await this.#seek(event.begin_s);
    this.#showEvent(event, number);
  }

  // Shows what an event was concluded from, and flies to its body.
  #showEvent(event, number) {
    this.#event = { id: event.id, recording: String(number) };
    this.#markEvent();
    const { id, kind, thing, other, agent, begin_s: begin, end_s: end, evidence } = event;
    const bodies = [...new Set([thing, other].filter(Boolean))];
    replaceChildren(this.#evidence,
      el("strong", {}, `${kind} `), bodies.flatMap((each) => [bodyLink(each), " "]),
      el("span", { class: "muted" }, `${id}, ${begin.toFixed(2)} s to ${end === null ? "the end" : `${end.toFixed(2)} s`}${agent ? `, by ${agent}` : ""} `),
      el("span", { class: "grow" }, evidence.length ? evidence.join(" ") : "No evidence was recorded."),
      el("button", { type: "button", class: "flat", "aria-label": "Close the event", onclick: () => this.#closeEvent() }, icon("close")));
    this.#evidence.hidden = false;
    if (number === 0) selection.select(thing, { focus: true });
  }

  #closeEvent() {
    this.#event = null;
    this.#evidence.hidden = true;
    this.#markEvent();
  }

  #markEvent() {
    for (const bar of this.#lanes.querySelectorAll(".bar")) bar.toggleAttribute("data-current", bar.dataset.event === this.#event?.id && bar.dataset.recording === this.#event.recording);
  }

  async #continue() {
    const notes = await callOrToast("timeline.resume");
    if (notes?.length) toast(notes.slice(0, 4).join(" · ") + (notes.length > 4 ? ` · and ${notes.length - 4} more` : ""));
  }

  #toggleTrail() {
    const shown = this.#state?.trail ?? null;
    const wanted = selection.id !== shown ? selection.id : null;
    if (!wanted && !shown) toast("Select the body whose path is to be shown.");
    else callOrToast("timeline.trail", { id: wanted });
  }
}

export const timelinePanel = new TimelinePanel();
