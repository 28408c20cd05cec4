"""Skills of a robot in the bundled kitchen: the doors and drawers it opens and closes, and how often it puts milk away.

    python -m benchmarks.robots_skills [--robot mobile_manipulator] [--seeds 10] [--fronts fridge_door …]

Prints one line for each front and seed, then the counts, and the deepest penetration of two bodies on the way.
"""

from __future__ import annotations

import argparse
import random
import time
from collections.abc import Generator
from typing import NamedTuple

import numpy as np

import mindstage as ms
from mindstage.engines.base import Engine
from mindstage.errors import MindstageError
from mindstage.robots.navigation import FloorMap
from mindstage.robots.robot import Robot
from mindstage.robots.skills import SkillResult, can_open, start_skill
from mindstage.scene import BodyId, Pose
from mindstage.simulation import Simulation

_START = (0.9, 0.6, 0.0)
_DEADLINE_S = 240.0
_REACH_M = 0.7
_OPEN, _CLOSED = 0.95, 0.05
"""The openness from which on a front counts as open, and below which it counts as closed."""
_SUPPORTS = ("counter_left", "table", "counter_west", "counter_right", "dresser")


class _Depths:
    """The deepest penetration of two bodies of which one belongs to the robot or was moved by it."""

    def __init__(self, robot: Robot) -> None:
        self.own = {*robot.link_ids.values()}
        self.depth_m, self.pair = 0.0, ("", "")

    def read(self, engine: Engine) -> None:
        """Reads the contacts of the last step."""
        for contact in engine.contacts():
            if contact.b is not None and contact.depth_m > self.depth_m and {contact.a, contact.b} & self.own:
                self.depth_m, self.pair = contact.depth_m, (contact.a, contact.b)


def _perform(robot: Robot, name: str, args: dict[str, object]) -> tuple[SkillResult, _Depths, float]:
    depths, start = _Depths(robot), time.perf_counter()

    def watched(motion: Generator[float, None, SkillResult]) -> Generator[float, None, SkillResult]:
        while True:
            try:
                duration_s = next(motion)
            except StopIteration as end:
                result: SkillResult = end.value
                return result
            yield duration_s
            robot.session.run_on_engine(depths.read)

    result = robot.run(watched(start_skill(robot, name, args, deadline_s=_DEADLINE_S)), timeout_s=2 * _DEADLINE_S)
    return result, depths, time.perf_counter() - start


def _line(what: str, result: SkillResult, depths: _Depths, wall_s: float) -> None:
    deep = f"{depths.depth_m * 1000:.1f} mm {'-'.join(depths.pair) if depths.depth_m > 0.005 else ''}"
    print(
        f"{what:44} {result.outcome:9} {result.duration_s:6.1f} s ({wall_s:5.1f} s) {deep} {result.reason}", flush=True
    )
    for each in result.assumptions:
        print(f"{'':46}assumed: {each}")


class _Row(NamedTuple):
    """The result of opening and closing one front."""

    front: str
    opened: bool
    closed: bool | None
    """None if that was not tried."""
    openness: float
    """After it was opened."""
    why: str


def open_and_close(sim: Simulation, robot: Robot, fronts: list[str], *, closes: bool) -> None:
    """Opens and closes each front, from the same state; says of those that stay closed whether they are reachable."""
    names = fronts or [row.front.rpartition("#")[2] for row in sim.ask("openings")]
    rows: list[_Row] = []
    deepest = 0.0
    for front in names:
        sim.reset()
        result, depths, wall_s = _perform(robot, "open", {"thing": front})
        _line(f"open {front}", result, depths, wall_s)
        openness = sim.joint(front).openness
        opened = openness >= _OPEN
        deepest, closed, why = max(deepest, depths.depth_m), None, result.reason
        if not opened:
            robot.run(start_skill(robot, "park", {}))
            sim.reset()
            reach = can_open(robot, front)
            possible = "reachable from " + " and ".join(str(each.base) for each in reach.steps)
            why = f"{possible if reach else f'not reachable: {reach.reason}'}; {why}"
        elif closes:
            result, depths, wall_s = _perform(robot, "close", {"thing": front})
            _line(f"close {front}", result, depths, wall_s)
            closed, deepest = sim.joint(front).openness < _CLOSED, max(deepest, depths.depth_m)
            why = result.reason
        rows.append(_Row(front, opened, closed, openness, why))
    sim.reset()
    print(f"{'front':30} opened      closed  why not")
    for row in rows:
        closed_text = {None: "-", True: "yes", False: "no"}[row.closed]
        print(f"{row.front:30} {'yes' if row.opened else 'no':3} {row.openness:5.0%}   {closed_text:6}  {row.why}")
    opened_count, closed_count = sum(row.opened for row in rows), sum(bool(row.closed) for row in rows)
    print(f"opened {opened_count} of {len(rows)}, closed {closed_count} of {opened_count if closes else 0}; ", end="")
    print(f"deepest penetration {deepest * 1000:.1f} mm", flush=True)


def put_milk_away(sim: Simulation, robot: Robot, seeds: int) -> None:
    """Puts a carton from a random place into the fridge, and closes it."""
    succeeded, deepest = 0, 0.0
    for seed in range(seeds):
        sim.reset()
        support = _place_milk(sim, robot, random.Random(seed))
        result, depths, wall_s = _perform(robot, "put_away", {"thing": "milk_carton_1"})
        is_in = any(
            row.other.endswith("fridge") for row in sim.ask("where_is", thing="milk_carton_1", relation="inside")
        )
        is_closed = sim.joint("fridge_door").openness < 0.05
        _line(f"put_away milk from {support}, seed {seed}", result, depths, wall_s)
        succeeded += bool(result) and is_in and is_closed
        deepest = max(deepest, depths.depth_m)
    sim.reset()
    print(f"milk put away {succeeded} of {seeds}; deepest penetration {deepest * 1000:.1f} mm")


def _place_milk(sim: Simulation, robot: Robot, chance: random.Random) -> str:
    """Puts the carton at a random free place that is at most 0.7 m from where the base can stand."""
    floor = FloorMap(robot)
    standing = floor.plan.centers(np.flatnonzero(np.isfinite(floor.lengths)))
    while True:
        support = chance.choice(_SUPPORTS)
        rows = list(sim.ask("free_place", thing="milk_carton_1", relation="onto", support=support, count=40))
        poses = [row.pose for row in rows if np.hypot(*(standing - row.pose.position[:2]).T).min() <= _REACH_M]
        if poses:
            pose: Pose = chance.choice(poses)
            _set_pose(sim, pose)
            sim.step(0.5)
            return support


def _set_pose(sim: Simulation, pose: Pose) -> None:
    sim.run_on_engine(lambda engine: engine.set_pose(BodyId("milk_carton_1"), pose), edits=True)


def main() -> None:
    """Runs the parts that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="mobile_manipulator")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--open-only", action="store_true", help="do not close what was opened")
    parser.add_argument("--fronts", nargs="*", help="these fronts only; none without names")
    options = parser.parse_args()
    with ms.open("bundled:kitchen") as sim:
        robot = sim.add_robot(options.robot, Pose((_START[0], _START[1], 0.0)))
        sim.step(0.5)
        try:
            if options.seeds:
                put_milk_away(sim, robot, options.seeds)
            if options.fronts is None or options.fronts:
                open_and_close(sim, robot, options.fronts or [], closes=not options.open_only)
        except MindstageError as error:
            print(f"error: {error}")


if __name__ == "__main__":
    main()
