"""Skills of a robot in the bundled kitchen: the doors and drawers it opens and closes, and how often it puts milk away.

    python -m benchmarks.robots_skills [--robot mobile_manipulator] [--seeds 10] [--parts fridge_door …]

Prints one line for each part and seed, with the deepest penetration of two bodies on the way; then the table of the
parts as Markdown, and the counts. `--first-seed 4 --seeds 3` and `--parts` measure a part.
"""

from __future__ import annotations

import argparse
import random
import time
from collections.abc import Collection, Generator, Sequence
from typing import NamedTuple

import numpy as np

import mindstage as ms
from mindstage.engines.base import Engine
from mindstage.robots import add_robot
from mindstage.robots.navigation import FloorMap
from mindstage.robots.robot import Robot
from mindstage.robots.skills import SkillResult, SkillStep, can_open, start_skill
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import SetPoses
from mindstage.simulation import Simulation

_START = (0.9, 0.6, 0.0)
_DEADLINE_S = 240.0
_REACH_M = 0.7
_OPEN, _CLOSED = 0.95, 0.05
"""The openness from which on a part counts as open, and below which it counts as closed."""
_DEEP_M, _FAST = 0.005, 1.05
_SUPPORTS = ("counter_left", "table", "counter_west", "counter_right", "dresser")


class _Watch:
    """The deepest penetration of a part of the robot, or of what it holds; and how near its joints came to limits."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.own = robot, frozenset(robot.link_ids.values())
        self.depth_m, self.pair, self.when = 0.0, ("", ""), ""
        self.beyond, self.speed = 0.0, 0.0
        """Largest position beyond a limit [m or rad], and largest fraction of a velocity limit."""
        self.fastest = ""
        self._step = ""

    def on_step(self, step: SkillStep) -> None:
        """Notes what the robot does."""
        self._step = step.text if step.end_s is None else f"after: {step.text}"

    def look(self) -> None:
        """Reads the contacts and the joints after the last step."""
        held = self.robot.held.values()
        self.robot.session.engine.run(lambda engine: self._read(engine, held))

    def _read(self, engine: Engine, held: Collection[BodyId]) -> None:
        own = self.own.union(held)
        for contact in engine.contacts():
            if contact.depth_m > self.depth_m and not own.isdisjoint((contact.a, contact.b)):
                self.depth_m, self.pair, self.when = contact.depth_m, (contact.a, contact.b or "ground"), self._step
        states = self.robot.read_joint_states(engine)
        for joint in self.robot.model.actuated_joints:
            if (state := states.get(joint.name)) is None:
                continue
            low, high = joint.lower, joint.upper
            beyond = max(0.0 if low is None else low - state.position, 0.0 if high is None else state.position - high)
            self.beyond = max(self.beyond, beyond)
            speed = abs(state.velocity) / (joint.velocity or np.inf)
            if speed > self.speed:
                self.speed, self.fastest = speed, f" by {joint.name}: {self._step}" if speed > _FAST else ""

    def __str__(self) -> str:
        text = f"{self.depth_m * 1000:.1f} mm"
        text += f" ({'-'.join(self.pair)}: {self.when})" if self.depth_m > _DEEP_M else ""
        return f"{text}, {self.beyond * 1000:.1f}e-3 beyond limits, {self.speed:.0%} of the speed{self.fastest};"


def _perform(robot: Robot, name: str, args: dict[str, object]) -> tuple[SkillResult, _Watch, float]:
    watch, start = _Watch(robot), time.perf_counter()
    motion = start_skill(robot, name, args, deadline_s=_DEADLINE_S, on_step=watch.on_step)

    def watched() -> Generator[float, None, SkillResult]:
        while True:
            try:
                duration_s = next(motion)
            except StopIteration as end:
                result: SkillResult = end.value
                return result
            yield duration_s
            watch.look()

    result = robot.run(watched(), timeout_s=2 * _DEADLINE_S)
    return result, watch, time.perf_counter() - start


def _line(what: str, result: SkillResult, watch: _Watch, wall_s: float) -> None:
    times = f"{result.duration_s:6.1f} s ({wall_s:5.1f} s)"
    print(f"{what:44} {result.outcome:9} {times} {watch} {result.reason}", flush=True)
    for each in result.assumptions:
        print(f"{'':46}assumed: {each}")


class _Row(NamedTuple):
    """The result of opening and closing one part."""

    part: str
    opened: float
    """Openness after it was opened."""
    closed: float | None
    """Openness after it was closed; None if that was not tried."""
    depth_m: float
    """The deepest penetration."""
    why: str
    """Why it was not opened or closed."""

    def markdown(self) -> str:
        """A row of the table."""
        closed = "" if self.closed is None else f"{self.closed:.0%}"
        return f"| `{self.part}` | {self.opened:.0%} | {closed} | {self.depth_m * 1000:.1f} | {self.why} |"


def open_and_close(sim: Simulation, robot: Robot, parts: list[str], *, closes: bool) -> None:
    """Opens and closes each part, from the same state; says of those that stay closed whether they are reachable."""
    names = parts or [row.part.rpartition("#")[2] for row in sim.ask("articulated_parts")]
    rows = [_open_and_close_one(sim, robot, part, closes=closes) for part in names]
    sim.reset()
    print("| part | opened | closed | penetration [mm] | why not |\n|---|---|---|---|---|")
    for row in rows:
        print(row.markdown())
    opened = sum(row.opened >= _OPEN for row in rows)
    closed = sum(row.closed is not None and row.closed < _CLOSED for row in rows)
    deepest = max(row.depth_m for row in rows)
    print(f"opened {opened} of {len(rows)}, closed {closed} of {opened if closes else 0}; ", end="")
    print(f"deepest penetration {deepest * 1000:.1f} mm", flush=True)


def _open_and_close_one(sim: Simulation, robot: Robot, part: str, *, closes: bool) -> _Row:
    sim.reset()
    result, watch, wall_s = _perform(robot, "open", {"thing": part})
    _line(f"open {part}", result, watch, wall_s)
    opened, depth_m = sim.joint(part).openness, watch.depth_m
    if opened < _OPEN:
        sim.reset()
        reach = can_open(robot, part)
        if not reach:
            return _Row(part, opened, None, depth_m, f"{max(0.0, reach.openness):.0%} in reach: {reach.reason}")
        stances = " and ".join(f"({x:.2f}, {y:.2f}, {yaw:.2f})" for x, y, yaw in (each.base for each in reach.steps))
        return _Row(part, opened, None, depth_m, f"in reach from {stances}, but {result.reason}")
    if not closes:
        return _Row(part, opened, None, depth_m, "")
    result, watch, wall_s = _perform(robot, "close", {"thing": part})
    _line(f"close {part}", result, watch, wall_s)
    return _Row(part, opened, sim.joint(part).openness, max(depth_m, watch.depth_m), result.reason)


def put_milk_away(sim: Simulation, robot: Robot, seeds: Sequence[int]) -> None:
    """Puts a carton from a random place into the fridge, and closes it."""
    succeeded, deepest = 0, 0.0
    for seed in seeds:
        sim.reset()
        support = _place_milk(sim, robot, random.Random(seed))
        result, watch, wall_s = _perform(robot, "put_away", {"thing": "milk_carton_1"})
        is_in = any(
            row.other.endswith("fridge") for row in sim.ask("where_is", thing="milk_carton_1", relation="inside")
        )
        is_closed = sim.joint("fridge_door").openness < _CLOSED
        _line(f"put_away milk from {support}, seed {seed}", result, watch, wall_s)
        succeeded += bool(result) and is_in and is_closed
        deepest = max(deepest, watch.depth_m)
    sim.reset()
    print(f"milk put away {succeeded} of {len(seeds)}; deepest penetration {deepest * 1000:.1f} mm")


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
    sim.engine.run(lambda engine: engine.apply(SetPoses({BodyId("milk_carton_1"): pose})), edits=True)


def main() -> None:
    """Runs the parts that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="mobile_manipulator")
    parser.add_argument("--seeds", type=int, default=10, help="number of places of the milk")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--open-only", action="store_true", help="do not close what was opened")
    parser.add_argument("--parts", nargs="*", help="these parts only; none without names")
    options = parser.parse_args()
    with ms.open("bundled:kitchen") as sim:
        robot = add_robot(sim, options.robot, Pose((_START[0], _START[1], 0.0)))
        sim.step(0.5)
        if options.seeds:
            put_milk_away(sim, robot, range(options.first_seed, options.first_seed + options.seeds))
        if options.parts is None or options.parts:
            open_and_close(sim, robot, options.parts or [], closes=not options.open_only)


if __name__ == "__main__":
    main()
