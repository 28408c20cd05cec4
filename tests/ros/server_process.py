"""A server in a process of its own: python -m tests.ros.server_process [PORT]; it ends when its stdin is closed."""

from __future__ import annotations

import sys

from mindstage.bridge import LocalNode, RosbridgeServer

if __name__ == "__main__":
    with (
        LocalNode(name="/elsewhere") as local_node,
        RosbridgeServer(local_node, port=int(sys.argv[1]) if sys.argv[1:] else 0) as server,
    ):
        print(server.port, flush=True)
        sys.stdin.read()
