"""Cells of homes x dialects x robots x skills, drawn by a seed, and what the referee says about each.

A home is read from a file of a dialect, so that a robot acts in what the reader has made of it.
"""

from __future__ import annotations

import json
import random
import re
import tempfile
import time
from collections.abc import Generator, Mapping, Sequence
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import mujoco
import numpy as np

import mindstage as ms
from mindstage.errors import MindstageError
from mindstage.homes import HomeDialect, HomeStyle, WrittenHome, generate_home, write_home
from mindstage.robots.models.catalog import list_models
from mindstage.robots.robot import Robot
from mindstage.robots.skills import SkillOutcome, SkillResult, start_skill
from mindstage.robots.standing import add_standing_robot
from mindstage.simulation import Simulation
from tests.referee import SkillReferee

__all__ = ["ROBOTS", "Cell", "CellResult", "Verdict", "draw_cell", "judge", "referee_of", "try_cell", "try_drawn"]

ROBOTS = ("mobile_manipulator", "stretch", "tiago", "pr2")
"""Robots that drive and grasp; those that are not installed are not drawn."""
SKILLS = ("open", "close", "pick", "place")
DEADLINES_S = {"open": 150.0, "close": 150.0, "pick": 150.0, "place": 240.0}
"""Limits of simulated time; searches are limited by their steps."""
SETTLING_S = 0.5
FRACTION_OPEN, FRACTION_CLOSED = 0.95, 0.04
"""What counts as open and as closed; the skills allow for an error of 5 and 4 %."""
FALLING_M_S, MAX_FALLING = 0.3, 0.1
"""A home in which more than this share of the loose things is faster than this after it has settled was misread."""
LEAST_OPEN = 0.5
"""A front that is to be closed is opened at least so far before."""
MISREAD_SHARE = 0.8
"""A front that is open by the map as it was read, and by a smaller part of the true range, was misread."""
SUPPORTS = re.compile(r"(counter_top|kitchen_table|table|desk|dresser|sideboard)_\d+")
NEAREST_SUPPORTS = 3
CLUTTER = 0.1
MAX_ROOMS = 2
"""Homes have one or two rooms, since the time of a step grows with the number of bodies."""
WORDS = {
    "cutlery": ("fork", "knife", "spoon", "cutlery", "spatula", "ladle", "whisk", "tongs", "stick"),
    "plates": ("plate", "saucer", "bowl"),
    "cups": ("mug", "cup", "glass"),
    "bottles": ("bottle", "juice", "wine", "beer", "softdrink", "ketchup", "water", "oil", "vinegar", "soap", "sauce"),
    "boxes": (
        *("flour", "sugar", "pasta", "rice", "cereal", "box", "carton", "milk", "salt", "coffee", "tea", "cocoa"),
        *("soda", "pancake", "detergent", "tablets", "butter", "frozen", "book", "medicine", "toast", "candy"),
    ),
}
"""Kinds of things by parts of the names of their classes, the first one that fits."""


class Verdict(StrEnum):
    """What the referee says about a skill."""

    TRUE = "true success"
    ASSISTED = "assisted success"
    FALSE = "false success"
    FAILED = "failure"
    FALSE_REASON = "false reason"
    ERROR = "exception"
    NOT_BEGUN = "not begun"
    """Things fall in the home as it was read, the robot does not stand in it, or the front that was to be closed did
    not open before."""


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """One skill of a robot in a home."""

    seed: int
    number: int
    style: str
    home_seed: int
    rooms: int
    dialect: str
    robot: str
    skill: str
    kind: str
    """Of the front or the thing, such as "drawer" or "cups"."""
    thing: str
    """Its id in the generated home."""
    support: str = ""
    """Where it is placed."""

    def __str__(self) -> str:
        where = f" on {self.support}" if self.support else ""
        home = f"{self.style} {self.home_seed} with {self.rooms} rooms as {self.dialect}"
        return f"{self.seed}:{self.number} {self.robot} {self.skill} {self.thing}{where} ({self.kind}) in {home}"


class CellResult(msgspec.Struct, frozen=True, kw_only=True):
    """What happened in a cell."""

    cell: Cell
    verdict: Verdict
    reason: str = ""
    """What the skill says about its failure, or why it was not begun."""
    referee: tuple[str, ...] = ()
    """What was done without contact, what was promised and is not so, or what the reason says against the geometry."""
    assumptions: tuple[str, ...] = ()
    """What the skill itself reports."""
    misread: str = ""
    """How the front's motion differs from that of the generated home."""
    simulated_s: float = 0.0
    cpu_s: float = 0.0


@cache
def installed_robots() -> tuple[str, ...]:
    installed = {model.name for model in list_models() if model.is_installed}
    return tuple(name for name in ROBOTS if name in installed)


def front_kind(joint: Mapping[str, Any], bodies: Mapping[str, Mapping[str, Any]]) -> str:
    """The kind of a front of a generated home, from its true joint."""
    cls, axis = bodies[joint["moving"]]["class"].rpartition("#")[2], joint["axis"]
    if joint["kind"] == "slide":
        return "drawer" if "Drawer" in cls else "sliding door"
    if abs(axis[2]) > 0.9:
        return "door, left hinge" if axis[2] < 0 else "door, right hinge"
    if "Lid" in cls:
        return "lid"
    return "flap" if "CupboardDoor" in cls else "door that tilts down"


def thing_kind(cls: str) -> str:
    """The kind of a thing, from the name of its class."""
    name = cls.rpartition("#")[2].lower()
    return next((kind for kind, words in WORDS.items() if any(word in name for word in words)), "other things")


def draw_cell(seed: int, number: int) -> Cell:
    """The cell of that number, drawn by a seed; the same on every machine with the same robots."""
    chance = random.Random(f"{seed}:{number}")
    style, home_seed = chance.choice(list(HomeStyle)), chance.randrange(1_000_000)
    rooms = chance.randint(1, MAX_ROOMS)
    dialect, robot = chance.choice(list(HomeDialect)), chance.choice(installed_robots())
    truth = json.loads(write_home(generate_home(seed=home_seed, style=style, rooms=rooms, clutter=CLUTTER)).truth)
    bodies, joints = truth["bodies"], truth["joints"].values()
    fronts = {joint["moving"] for joint in joints}
    kinds: dict[str, list[str]] = {}
    skill = chance.choice(SKILLS)
    if skill in ("open", "close"):
        for joint in joints:
            kinds.setdefault(front_kind(joint, bodies), []).append(bodies[joint["moving"]]["id"])
    else:
        for name, body in bodies.items():
            if body["mobility"] == "dynamic" and name not in fronts and not body["attached_to"]:
                kinds.setdefault(thing_kind(body["class"]), []).append(body["id"])
    kind = chance.choice(sorted(kinds))
    thing = chance.choice(sorted(kinds[kind]))
    support = ""
    if skill == "place":
        by_id = {body["id"]: np.array(body["center"]) for body in bodies.values()}
        at = by_id[thing]
        supports = sorted(filter(SUPPORTS.fullmatch, by_id), key=lambda each: (np.linalg.norm(by_id[each] - at), each))
        skill, support = ("place", chance.choice(supports[:NEAREST_SUPPORTS])) if supports else ("pick", "")
    return Cell(
        seed=seed,
        number=number,
        style=style,
        home_seed=home_seed,
        rooms=rooms,
        dialect=dialect,
        robot=robot,
        skill=skill,
        kind=kind,
        thing=thing,
        support=support,
    )


def try_drawn(seed: int, number: int) -> CellResult:
    """`try_cell` of `draw_cell`."""
    return try_cell(draw_cell(seed, number))


def try_cell(cell: Cell) -> CellResult:
    """Performs a skill and judges it; an exception that leaves a skill is a verdict."""
    began_s = time.process_time()
    home = generate_home(seed=cell.home_seed, style=cell.style, rooms=cell.rooms, clutter=CLUTTER)
    written = write_home(home, dialect=cell.dialect)
    with tempfile.TemporaryDirectory() as folder:
        path, description = Path(folder, "home.owl"), Path(folder, "home.urdf")
        path.write_text(written.text, encoding="utf-8")
        description.write_text(written.urdf, encoding="utf-8")
        with ms.open(path, urdf=description if written.urdf else ()) as simulation:
            result = _try_in(simulation, cell, written)
    return msgspec.structs.replace(result, cpu_s=round(time.process_time() - began_s, 2))


def _try_in(simulation: Simulation, cell: Cell, written: WrittenHome) -> CellResult:
    truth = json.loads(written.truth)
    names = {body["id"]: name for name, body in truth["bodies"].items()}
    bodies = simulation.snapshot().bodies
    ids = {str(body.iri).rpartition("#")[2]: str(body.id) for body in bodies}
    thing, support = (ids.get(names.get(each, ""), "") for each in (cell.thing, cell.support))
    if not thing or (cell.support and not support):
        return CellResult(cell=cell, verdict=Verdict.NOT_BEGUN, reason="the map as it was read does not have it")
    x, y, _ = next(body.pose.position for body in bodies if body.id == thing)
    try:
        robot = add_standing_robot(simulation, cell.robot, near=(x, y))
    except MindstageError as error:
        return CellResult(cell=cell, verdict=Verdict.NOT_BEGUN, reason=str(error))
    simulation.engine.run(_join_regions)
    simulation.step(SETTLING_S)
    speeds = referee_of(simulation, robot).speeds()
    falling = [name for name, speed in speeds.items() if speed > FALLING_M_S]
    if len(falling) > MAX_FALLING * len(speeds):
        reason = f"{len(falling)} of {len(speeds)} things fall, such as {falling[0]}"
        return CellResult(cell=cell, verdict=Verdict.NOT_BEGUN, reason=reason)
    closed, is_front = 0.0, cell.skill in ("open", "close")
    try:
        if is_front:
            closed = referee_of(simulation, robot).position(thing)[0]
        if cell.skill == "close":
            simulation.joint(thing).open()
            referee = referee_of(simulation, robot)
            if referee.openness(thing, closed) < LEAST_OPEN:
                return CellResult(cell=cell, verdict=Verdict.NOT_BEGUN, reason="it did not open")
    except (MindstageError, ValueError, AssertionError) as error:
        return CellResult(cell=cell, verdict=Verdict.NOT_BEGUN, reason=f"it does not open as it was read: {error}")
    referee, args = referee_of(simulation, robot), {"thing": thing} | ({"on": support} if support else {})
    try:
        with referee.watching():
            result = _perform(robot, cell, args)
            robot.run(iter_steps(SETTLING_S))
    except Exception as error:
        return CellResult(cell=cell, verdict=Verdict.ERROR, reason=f"{type(error).__name__}: {error}")
    misread = _misread(referee, cell, truth, thing) if is_front and result else ""
    verdict, said = judge(referee, result, cell.skill, thing, support, closed if is_front else None)
    return CellResult(
        cell=cell,
        verdict=verdict,
        reason=result.reason,
        referee=tuple(said),
        assumptions=result.assumptions,
        misread=misread,
        simulated_s=round(result.duration_s, 2),
    )


def _join_regions(engine: Any) -> None:
    engine.join_regions()


def _perform(robot: Robot, cell: Cell, args: Mapping[str, object]) -> SkillResult:
    deadline_s = DEADLINES_S[cell.skill]
    motion = start_skill(robot, cell.skill, args, deadline_s=deadline_s)
    return robot.run(motion, timeout_s=2 * deadline_s)


def iter_steps(duration_s: float) -> Generator[float, None, None]:
    """A motion in which the robot stays where it is."""
    yield duration_s


def referee_of(simulation: Simulation, robot: Robot) -> SkillReferee:
    """A referee of a simulation, which has looked at its present state."""
    engine: Any = simulation.engine.run(lambda engine: engine)

    def owners(_: mujoco.MjModel) -> Sequence[str]:
        compiled = engine.compiled()
        names = {row: str(id) for id, row in compiled.rows.items()}
        return [names.get(int(row), "ground") for row in compiled.geom_rows]

    referee = SkillReferee(
        [str(id) for id in robot.body_ids], name_of=lambda name: name.removeprefix("body:"), owners=owners
    )

    def look(_: object) -> None:
        compiled = engine.compiled()
        referee.look(compiled.model, compiled.data)

    simulation.engine.run(look)
    return referee


def judge(
    referee: SkillReferee, result: SkillResult, skill: str, thing: str, support: str = "", closed: float | None = None
) -> tuple[Verdict, list[str]]:
    """The verdict about a skill that the referee has watched, with what it found.

    Args:
        closed: the position of the joint of a front when it is closed.
    """
    if result.outcome is not SkillOutcome.SUCCEEDED:
        found = referee.false_reasons(result.reason, thing, closed)
        return (Verdict.FALSE_REASON if found else Verdict.FAILED), found
    if why := _unkept(referee, skill, thing, support, closed):
        return Verdict.FALSE, [why]
    if referee.interventions:
        return Verdict.ASSISTED, [str(each) for each in referee.interventions]
    return Verdict.TRUE, []


def _unkept(referee: SkillReferee, skill: str, thing: str, support: str, closed: float | None) -> str:
    """What a skill that succeeded promises and is not so."""
    if closed is not None:
        openness = referee.openness(thing, closed)
        is_kept = openness >= FRACTION_OPEN if skill == "open" else openness <= FRACTION_CLOSED
        return "" if is_kept else f"{thing} is {openness:.1%} open"
    return referee.why_not_on(thing, support) if support else referee.why_not_lifted(thing)


def _misread(referee: SkillReferee, cell: Cell, truth: Mapping[str, Any], thing: str) -> str:
    """How a front that was opened has moved otherwise than its true joint lets it."""
    if cell.skill != "open":
        return ""
    bodies = truth["bodies"]
    joint = next(each for each in truth["joints"].values() if bodies[each["moving"]]["id"] == cell.thing)
    before, after = referee.first[thing], referee.poses()[thing]
    axis = np.array(joint["axis"])
    if joint["kind"] == "slide":
        along = float((after[:3] - before[:3]) @ axis)
    else:
        conjugate, turned, turn = before[3:] * [1, -1, -1, -1], np.zeros(4), np.zeros(3)
        mujoco.mju_mulQuat(turned, after[3:], conjugate)
        mujoco.mju_quat2Vel(turn, turned, 1.0)
        along = float(turn @ axis)
    share = along / joint["travel"]
    return "" if share >= MISREAD_SHARE else f"{thing} is {share:.0%} open along its true axis"
