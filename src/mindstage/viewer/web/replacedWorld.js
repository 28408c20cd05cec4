// Tells the parts of the page that the whole world was replaced: what they show of the former one has to go.

import { channel } from "./rpcChannel.js";

const listeners = new Set();
let known = null;

export function onReplacedWorld(listener) {
  listeners.add(listener);
}

channel.on("world", ({ number }) => {
  const isReplaced = known !== null && known !== number;
  known = number;
  if (isReplaced) for (const listener of listeners) listener();
});
