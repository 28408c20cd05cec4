"""A far side in a process of its own, that can be killed: `python slow_far_side.py [PORT] [--stuck]`.

It prints its address; with `--stuck` its engine begins to spawn, says so, and never ends.
"""

from __future__ import annotations

import sys
import threading

from mindstage.engines import NullEngine, SpawnReport
from mindstage.scene import NO_GEOMETRY, GeometryMap, World
from tests.engines.served_simulation import ServedSimulation


class StuckEngine(NullEngine):
    """Does not get further than the beginning."""

    def spawn(self, world: World, *, geometry: GeometryMap = NO_GEOMETRY) -> SpawnReport:
        print("spawning", flush=True)
        threading.Event().wait()
        return super().spawn(world, geometry=geometry)


def main() -> None:
    stuck = "--stuck" in sys.argv
    ports = [int(each) for each in sys.argv[1:] if each.isdigit()]
    with ServedSimulation(StuckEngine if stuck else NullEngine, port=ports[0] if ports else 0) as served:
        print(served.address, flush=True)
        sys.stdin.read()  # until whoever started it is gone


if __name__ == "__main__":
    main()
