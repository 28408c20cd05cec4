// A banner that says whether the server is connected and responds, and which request takes long.

import { channel } from "./rpcChannel.js";

const banner = document.getElementById("disconnected");
const waiting = document.getElementById("waiting");
// Questions, plans and robots show their own progress.
const HAVE_PROGRESS = /^(ask|plan|robot)/;

let connected = null;
let stalled = false;

function update() {
  banner.textContent = connected ? "The server does not respond. What you do is sent as soon as it does." : "Connection lost. Reconnecting…";
  banner.hidden = connected !== false && !stalled;
  document.body.dataset.connected = String(connected === true);
}

channel.on("connection", (value) => {
  connected = value;
  update();
});
channel.on("stalled", (value) => {
  stalled = value;
  update();
});
channel.on("waiting", (requests) => {
  const request = requests.find(({ method }) => !HAVE_PROGRESS.test(method));
  waiting.hidden = !request;
  waiting.textContent = request ? `Waiting for the server: ${request.method.replaceAll("_", " ")}, ${request.seconds} s` : "";
});
