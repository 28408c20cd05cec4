// Measuring: the distance between two clicked points, and the gap between two selected bodies.

import { channel } from "./rpcChannel.js";
import { el, formatNumber, replaceChildren } from "./dom.js";
import { icon } from "./icons.js";
import { selection } from "./selection.js";
import { callOrToast, toast } from "./toasts.js";
import { viewTools } from "./viewTools.js";

const meters = (value) => `${formatNumber(value, 3)} m`;

class MeasureTool {
  name = "measure";
  #points = [];
  #readout = el("section", { id: "measurement", class: "floating", "aria-label": "Measurement", role: "status", hidden: true });

  constructor() {
    document.getElementById("center").append(this.#readout);
  }

  start() {
    this.#points = [];
    viewTools.use(this);
    this.#show(el("p", {}, "Click two points; corners of bodies attract."));
  }

  ended() {
    this.#readout.hidden = true;
    channel.call("measure", {}).catch(() => {}); // without a view there is no line
  }

  async onClick(pointer) {
    const picked = await callOrToast("pick", { pointer, corners: true });
    if (!picked) return toast("There is nothing at that point.");
    this.#points = [...(this.#points.length === 2 ? [] : this.#points), picked];
    const found = await callOrToast("measure", { points: this.#points.map(({ point }) => point) });
    const [first, second] = this.#points;
    const name = ({ id, is_corner: isCorner }) => (isCorner ? `a corner of ${id}` : id);
    if (found) this.#show(...this.#rows(found), el("p", { class: "muted" }, `${name(first)} to ${name(second)}`));
    else this.#show(el("p", {}, `From ${name(first)}. Click the second point.`));
  }

  // The gap between the two selected bodies.
  async gap() {
    const [first, second] = selection.ids.slice(-2);
    const found = await callOrToast("measure_gap", { first, second });
    if (!found) return;
    if (viewTools.active !== this.name) viewTools.use(this);
    this.#show(...this.#rows(found, "gap"), el("p", { class: "muted" }, `between the boxes of ${first} and ${second}; the differences are those of their centers`));
  }

  #rows({ distance, offset: [x, y, z] }, title = "distance") {
    const row = (name, value) => el("div", { class: "measured" }, el("dt", {}, name), el("dd", { "data-measured": name }, meters(value)));
    return [el("dl", {}, row(title, distance), row("dx", x), row("dy", y), row("dz", z))];
  }

  #show(...content) {
    this.#readout.hidden = false;
    replaceChildren(this.#readout, el("header", {}, el("strong", {}, "Measure"),
      el("button", { type: "button", class: "flat", "aria-label": "Stop measuring", title: "Stop measuring (Esc)", onclick: () => viewTools.use(null) }, icon("close"))), ...content);
  }
}

export const measureTool = new MeasureTool();
