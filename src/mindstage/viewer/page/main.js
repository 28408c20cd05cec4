// Entry point of the page: importing a module creates its part of the interface.

import { channel, clientKey } from "./rpcChannel.js";
import { selection } from "./selection.js";
import { panels } from "./panels.js";
import "./viewFrame.js";
import "./toasts.js";
import "./toolbar.js";
import "./mapFiles.js";
import { outliner } from "./outliner.js";
import { detailsPanel } from "./detailsPanel.js";
import "./addObjectPanel.js";
import "./askPanel.js";
import "./imaginePanel.js";
import "./robotPanel.js";
import "./statusPanel.js";
import { timelinePanel } from "./timelinePanel.js";

channel.on("connection", (connected) => {
  document.getElementById("disconnected").hidden = connected;
  document.body.dataset.connected = String(connected);
});

// Exposed for tests and for the browser's console.
window.mindstage = { channel, clientKey, panels, selection, outliner, detailsPanel, timelinePanel };
