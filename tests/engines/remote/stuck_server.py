"""A Mindstage server in its own process, which tests can kill.

`python -m tests.engines.remote.stuck_server [PORT] [--stuck]` starts it.
It prints its address. With `--stuck`, its engine prints "spawning" at the first spawn and never returns.
"""

from __future__ import annotations

import sys
import threading

from mindstage.engines import NullEngine
from mindstage.engines.base import Applied
from mindstage.scene.edits import Edit
from tests.engines.remote.served_simulation import ServedSimulation


class StuckEngine(NullEngine):
    """An engine whose `spawn` never returns."""

    def apply(self, edit: Edit) -> Applied:
        print("spawning", flush=True)
        threading.Event().wait()
        return super().apply(edit)


def main() -> None:
    stuck = "--stuck" in sys.argv
    ports = [int(each) for each in sys.argv[1:] if each.isdigit()]
    with ServedSimulation(StuckEngine if stuck else NullEngine, port=ports[0] if ports else 0) as served:
        print(served.address, flush=True)
        sys.stdin.read()  # until the parent process has closed it


if __name__ == "__main__":
    main()
