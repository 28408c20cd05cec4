"""A hub of its own in a process of its own: python -m tests.ros.hub_process [PORT]; it ends with its stdin."""

from __future__ import annotations

import sys

from mindstage.bridge import LocalNode, RosbridgeServer

if __name__ == "__main__":
    with (
        LocalNode(name="/elsewhere") as hub,
        RosbridgeServer(hub, port=int(sys.argv[1]) if sys.argv[1:] else 0) as server,
    ):
        print(server.port, flush=True)
        sys.stdin.read()
