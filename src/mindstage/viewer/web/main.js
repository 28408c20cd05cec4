// Entry point of the page: importing a module creates its part of the interface.

import { channel, clientKey } from "./rpcChannel.js";
import { selection } from "./selection.js";
import { panels } from "./panels.js";
import "./connectionBanner.js";
import "./viewFrame.js";
import "./toasts.js";
import "./toolbar.js";
import "./viewMenu.js";
import "./mapFiles.js";
import "./autosave.js";
import "./toolbarOverflow.js";
import { outliner } from "./outliner.js";
import { detailsPanel } from "./detailsPanel.js";
import "./addObjectPanel.js";
import "./historyPanel.js";
import { viewBookmarks } from "./viewsPanel.js";
import { viewTools } from "./viewTools.js";
import "./askPanel.js";
import "./planPanel.js";
import "./robotPanel.js";
import "./statusPanel.js";
import { timelinePanel } from "./timelinePanel.js";
import { tour } from "./tour.js";

// Exposed for tests and for the browser's console.
window.mindstage = { channel, clientKey, panels, selection, outliner, detailsPanel, timelinePanel, tour, viewBookmarks, viewTools };
