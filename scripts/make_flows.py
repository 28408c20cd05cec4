"""Counts the source files that each main flow passes, for docs/explanation/architecture.md; with --check only compares.

It also follows a thing that a robot picks up from function to function. With `-v FLOW` it prints the names of the
files, or of the functions, instead.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from types import CodeType, FrameType

import msgspec
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

__all__ = ["FlowTracer", "ThingTracer", "main"]

PACKAGE = str(Path(ms.__file__).parent) + "/"
PAGE = Path(__file__).resolve().parent.parent / "docs" / "explanation" / "architecture.md"
HEAD = "| flow | files |\n|---|---|\n"
THING_HEAD = "| thing | functions | modules | returns | climbs |\n|---|---|---|---|---|\n"
THING_FLOW = "a carton that a robot picks up"
MAX_TRIES = 200
"""How many calls of a function are looked at for the thing."""
MAX_PARTS = 20
"""Longer collections are not looked through."""
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


class ThingTracer:
    """Follows a thing: the functions of the package that are called with its id, or with a value that has its id.

    Each function counts when it is first called so. A return is a function of another module than the one before, to
    which the thing had been given before that; a climb is a call from a package to a higher one.
    """

    def __init__(self, id: str) -> None:
        self.id = id
        self.steps: list[tuple[str, str]] = []
        """Modules and functions, in the order of the calls."""
        self.climbs: list[tuple[str, str]] = []
        """The functions that are called from a lower package."""
        self._tries: dict[CodeType, int] = {}
        names = re.findall(r"^\| `([a-z_/]+)` \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
        self._floors = {name: number for number, name in enumerate(names)}

    def run(self, flow: Callable[[], object]) -> tuple[int, int, int, int]:
        """Runs a flow; returns the numbers of functions, modules, returns and climbs."""
        sys.setprofile(self._record)
        try:
            flow()
        finally:
            sys.setprofile(None)
        modules = [module for module, _ in self.steps]
        returns = sum(b != a and b in modules[:row] for row, (a, b) in enumerate(pairwise(modules), 1))
        return len(modules), len(set(modules)), returns, len(self.climbs)

    def _record(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != "call" or self._tries.get(code, 0) >= MAX_TRIES or not self._module(code):
            return
        self._tries[code] = self._tries.get(code, 0) + 1
        values = frame.f_locals
        arguments = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        if any(self._has(values[name]) for name in arguments if name in values):
            self._tries[code] = MAX_TRIES
            step = self._module(code), code.co_qualname
            self.steps.append(step)
            caller = frame.f_back
            while caller is not None and not self._module(caller.f_code):
                caller = caller.f_back
            if caller is not None and self._floor(self._module(caller.f_code)) < self._floor(step[0]):
                self.climbs.append(step)

    def _has(self, value: object) -> bool:
        if isinstance(value, (tuple, list, set, frozenset, dict)):
            return len(value) < MAX_PARTS and any(isinstance(each, str) and each == self.id for each in value)
        if isinstance(value, msgspec.Struct):
            return any(isinstance(each, str) and each == self.id for each in msgspec.structs.astuple(value))
        return isinstance(value, str) and value == self.id

    @staticmethod
    def _module(code: CodeType) -> str:
        """The file of a function in the package; empty for others, for comprehensions and for checks of ranges."""
        name = code.co_filename.removeprefix(PACKAGE)
        is_own = name != code.co_filename and not code.co_name.startswith("<") and name != "ranges.py"
        return name if is_own else ""

    def _floor(self, module: str) -> int:
        """The number of the package of a module."""
        path = module.removesuffix(".py")
        while path and path not in self._floors:
            path = path.rpartition("/")[0]
        return self._floors[path]


def main() -> int:
    """Writes or checks the tables; returns 0 if they are up to date, otherwise 1."""
    if "-v" in sys.argv[1:]:
        wanted = sys.argv[-1]
        print(*(name for flow, names, _ in flows() if wanted in flow for name in names), sep="\n")
        return 0
    check = is_check()
    with tempfile.TemporaryDirectory() as folder:  # what was kept from runs before would be read instead of made
        os.environ["MINDSTAGE_CACHE"] = folder
        counted = {flow: counts for flow, _, counts in flows()}
    text = PAGE.read_text(encoding="utf-8")
    written = dict(re.findall(r"^\| (.*?) \| ([\d |]*\d) \|$", text, re.MULTILINE))
    is_same = all(_is_same(written.get(flow, ""), counts) for flow, counts in counted.items())
    if check and not is_same:
        print(f"{PAGE.name} is out of date: run {Path(sys.argv[0]).name}; counted: {counted}", file=sys.stderr)
    elif not is_same:
        rows = {flow: f"| {flow} | {' | '.join(map(str, counts))} |\n" for flow, counts in counted.items()}
        for head, own in ((HEAD, [each for each in rows if each != THING_FLOW]), (THING_HEAD, [THING_FLOW])):
            table = head + "".join(rows[each] for each in own)
            text = re.sub(re.escape(head) + r"(?:\|.*\n)*", lambda _, table=table: table, text)
        PAGE.write_text(text, encoding="utf-8")
    return int(check and not is_same)


def _is_same(written: str, counts: Sequence[int]) -> bool:
    """Whether a row of the page has numbers, up to the tolerance."""
    before = [int(each) for each in written.split(" | ") if each]
    return len(before) == len(counts) and all(abs(a - b) <= TOLERANCE for a, b in zip(before, counts, strict=True))


def flows() -> Iterator[tuple[str, list[str], tuple[int, ...]]]:
    """Yields each flow with its files, or the functions that get a thing, and its numbers."""
    for flow, files in _file_flows():
        yield flow, files, (len(files),)
    yield _thing_flow()


def _thing_flow() -> tuple[str, list[str], tuple[int, ...]]:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, MujocoEngine(), threaded=False) as sim:
        sim.spawn()
        sim.joint("fridge_door").open()
        sim.step(0.1)
        robot = add_robot(sim, "mobile_manipulator", (0.6, 0.6, 0.0))
        things = ThingTracer("milk_carton_1")
        counts = things.run(lambda: robot.do("pick milk_carton_1"))
    return THING_FLOW, [f"{module} {function}" for module, function in things.steps], counts


def _file_flows() -> Iterator[tuple[str, list[str]]]:
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
