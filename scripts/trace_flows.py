"""Counts the source files that each main flow passes, for docs/explanation/architecture.md; with -v names them."""

from __future__ import annotations

import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import TypeVar

import mindstage
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen, save_map
from mindstage.scene import World
from mindstage.scene.edits import Spawn
from mindstage.simulation import Simulation

__all__ = ["FlowTracer", "main"]

R = TypeVar("R")
PACKAGE = str(Path(mindstage.__file__).parent) + "/"


class FlowTracer:
    """Records in which files of the package functions are called, in this thread and in those started later."""

    def __init__(self) -> None:
        self.files: set[str] = set()

    def run(self, flow: Callable[[], R]) -> R:
        """Runs a flow and records its files, in addition to those recorded before."""
        threading.setprofile(self._record)
        sys.setprofile(self._record)
        try:
            return flow()
        finally:
            sys.setprofile(None)
            threading.setprofile(None)

    def take(self) -> set[str]:
        """The files recorded since the last call."""
        files, self.files = self.files, set()
        return files

    def _record(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(PACKAGE) and code.co_name != "<module>":
            self.files.add(code.co_filename.removeprefix(PACKAGE))


def main() -> int:
    """Prints the number of files of each flow; returns 0."""
    tracer = FlowTracer()
    knowledge = KnowledgeBase()

    def load() -> World:
        knowledge.load(bundled_kitchen())
        return knowledge.world()

    def spawn_into_engine() -> None:
        engine = MujocoEngine()
        engine.apply(Spawn(world))
        engine.step(0.01)
        engine.close()

    def spawn_with_geometry() -> Simulation:
        sim = Simulation(knowledge, MujocoEngine())
        sim.spawn(world)
        sim.step(0.01)
        return sim

    world = tracer.run(load)
    report("map to World", tracer)
    tracer.run(spawn_into_engine)
    report("World to MuJoCo", tracer)
    sim = tracer.run(spawn_with_geometry)
    report("World to MuJoCo, with geometry and the simulation thread", tracer)
    with sim, tempfile.TemporaryDirectory() as folder:
        tracer.run(lambda: sim.highlight(sim.ask("storage_place_in_environment", item="CowsMilk"), "green"))
        report("ask to highlight", tracer)
        tracer.run(lambda: save_map(sim.snapshot(), Path(folder, "now.owl")))
        report("snapshot to OWL", tracer)
    return 0


def report(flow: str, tracer: FlowTracer) -> None:
    """Prints what was recorded for a flow."""
    files = sorted(tracer.take())
    print(f"{flow}: {len(files)} files")
    if "-v" in sys.argv[1:]:
        print(*(f"    {name}" for name in files), sep="\n")


if __name__ == "__main__":
    sys.exit(main())
