"""Counts the source files that each main flow passes, for docs/explanation/architecture.md; with --check only compares.

With `-v FLOW` it prints the names of the files instead.
"""

from __future__ import annotations

import re
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

from generated import is_check

import mindstage as ms
from mindstage.engines.mujoco import MujocoEngine
from mindstage.episodes import Episode, Recorder
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen, save_map
from mindstage.robots import add_robot
from mindstage.scene import World
from mindstage.scene.edits import Spawn
from mindstage.simulation import Simulation

__all__ = ["FlowTracer", "main"]

PACKAGE = str(Path(ms.__file__).parent) + "/"
PAGE = Path(__file__).resolve().parent.parent / "docs" / "explanation" / "architecture.md"
HEAD = "| flow | files |\n|---|---|\n"
TOLERANCE = 3
"""Difference of counts that is no change, since threads pass other files by chance."""


class FlowTracer:
    """Records in which files of the package functions are called, in this thread and in those started later."""

    def __init__(self) -> None:
        self.files: set[str] = set()

    def run(self, flow: Callable[[], object]) -> list[str]:
        """Runs a flow; returns its files."""
        self.files.clear()
        threading.setprofile(self._record)
        sys.setprofile(self._record)
        try:
            flow()
        finally:
            sys.setprofile(None)
            threading.setprofile(None)
        return sorted(self.files)

    def _record(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(PACKAGE) and code.co_name != "<module>":
            self.files.add(code.co_filename.removeprefix(PACKAGE))


def main() -> int:
    """Writes or checks the table; returns 0 if it is up to date, otherwise 1."""
    if "-v" in sys.argv[1:]:
        wanted = sys.argv[-1]
        print(*(name for flow, files in flows() if wanted in flow for name in files), sep="\n")
        return 0
    check = is_check()
    text = PAGE.read_text(encoding="utf-8")
    table = re.compile(re.escape(HEAD) + r"((?:\|.*\n)*)")
    written = dict(re.findall(r"^\| (.*) \| (\d+) \|$", table.search(text)[1], re.MULTILINE))  # type: ignore[index]
    counted = {flow: len(files) for flow, files in flows()}
    is_same = written.keys() == counted.keys() and all(
        abs(int(written[flow]) - count) <= TOLERANCE for flow, count in counted.items()
    )
    if check and not is_same:
        print(f"{PAGE.name} is out of date: run {Path(sys.argv[0]).name}; counted: {counted}", file=sys.stderr)
    elif not is_same:
        rows = "".join(f"| {flow} | {count} |\n" for flow, count in counted.items())
        PAGE.write_text(table.sub(HEAD + rows, text), encoding="utf-8")
    return int(check and not is_same)


def flows() -> Iterator[tuple[str, list[str]]]:
    """Yields each flow with its files; each begins where the one before it has ended."""
    tracer = FlowTracer()
    knowledge = KnowledgeBase()
    worlds: list[World] = []

    def load() -> None:
        knowledge.load(bundled_kitchen())
        worlds.append(knowledge.world())

    def spawn_into_engine() -> None:
        engine = MujocoEngine()
        engine.apply(Spawn(worlds[0]))
        engine.step(0.01)
        engine.close()

    yield "map to `World`", tracer.run(load)
    yield "`World` to MuJoCo: `Engine.apply(Spawn(world))`, `step`", tracer.run(spawn_into_engine)
    with Simulation(knowledge, MujocoEngine()) as sim, tempfile.TemporaryDirectory() as folder:

        def spawn_with_geometry() -> None:
            sim.spawn(worlds[0])
            sim.step(0.01)

        yield "`World` to MuJoCo with `Simulation`: geometry, thread, `step`", tracer.run(spawn_with_geometry)
        door = sim.joint("fridge_door")
        yield "open a door, `step`", tracer.run(lambda: (door.open(), sim.step(0.1)))
        answers = "storage_place_in_environment"
        yield "`ask`, then `highlight`", tracer.run(lambda: sim.highlight(sim.ask(answers, item="CowsMilk"), "green"))
        yield "`snapshot`, then `save_map`", tracer.run(lambda: save_map(sim.snapshot(), Path(folder, "now.owl")))
        plan = {"steps": [{"do": "wait", "duration_s": 0.1}]}
        yield "`evaluate_plan` with one worker", tracer.run(lambda: ms.evaluate_plan(sim, plan, samples=2, workers=1))
        with Recorder(sim, Path(folder, "run.mcap")):
            sim.step(0.1)
        with Episode(Path(folder, "run.mcap")) as episode:
            past = episode.knowledge()
            past.add_episode(episode)
            yield "a question about an episode", tracer.run(lambda: list(past.ask("where_is", "Milk", at=0.05)))
        robot = add_robot(sim, "mobile_manipulator", (0.6, 0.6, 0.0))
        yield "the skill `open` of a robot", tracer.run(lambda: robot.do("open fridge_door"))


if __name__ == "__main__":
    sys.exit(main())
