// The page: each import below brings one part of it.

import { channel, key } from "./channel.js";
import { selection } from "./selection.js";
import { panels } from "./panels.js";
import "./view.js";
import "./toasts.js";
import "./tools.js";
import "./maps.js";
import { outliner } from "./outliner.js";
import { details } from "./details.js";
import "./add.js";
import "./ask.js";
import "./status.js";

channel.on("connection", (connected) => {
  document.getElementById("lost").hidden = connected;
  document.body.dataset.connected = String(connected);
});

// For whoever looks into the page from outside: tests, and people with a console.
window.mindstage = { channel, key, panels, selection, outliner, details };
