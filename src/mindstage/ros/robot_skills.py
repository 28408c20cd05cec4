"""The skills of robots as actions: `mindstage/perform`, and `mindstage/skills/NAME` for each; and adding robots.

A skill runs in simulated time; while the simulation is paused, it waits. A robot performs one skill at a time: a newer
goal cancels the one before.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from mindstage.access.limits import SKILL_REPLACEMENT
from mindstage.access.policies import GOAL, READ, SPAWN
from mindstage.access.resources import from_outside
from mindstage.bridge.conversions import pose_from_message
from mindstage.errors import InvalidArgumentError, MessageValidationError, MindstageError, RobotError
from mindstage.msgs import mindstage_msgs as wire
from mindstage.registry import Group, extensions
from mindstage.robots import find_robot
from mindstage.ros.queries import parse_arguments
from mindstage.ros.service import ActionSpec, GoalAbortedError, GoalCanceledError, GoalContext, ServiceSpec
from mindstage.simulation import Simulation

if TYPE_CHECKING:  # they are loaded with the first robot, and with the first skill
    from mindstage.robots.robot import Robot
    from mindstage.robots.skill_declaration import SkillResult, SkillSpec, SkillStep

__all__ = ["ROBOT_SUFFIXES", "RobotSkills"]

ROBOT_SUFFIXES = (".urdf", ".xml")
"""Files that clients may add as robots."""

_POLL_S = 0.005
"""Interval at which a skill notices that simulated time has passed [s]."""


class _Performance:
    """A skill that a robot performs."""

    def __init__(self) -> None:
        self.replaced = threading.Event()
        self.ended = threading.Event()


class RobotSkills:
    """The skills of all robots of a simulation."""

    def __init__(
        self, simulation: Simulation, find_file: Callable[[str], Path | None], on_added: Callable[[], object]
    ) -> None:
        """Offers nothing yet.

        Args:
            find_file: returns a file that clients may read, by the name that they give; None if there is none.
            on_added: called after a robot was added.
        """
        self._simulation = simulation
        self._find_file = find_file
        self._on_added = on_added
        self._performances: dict[str, _Performance] = {}
        self._lock = threading.Lock()

    def services(self) -> Iterator[ServiceSpec]:
        """Yields the services."""
        yield ServiceSpec(wire.ListSkills, self.list_skills, READ, name="mindstage/list_skills")
        yield ServiceSpec(wire.AddRobot, self.add_robot, SPAWN, name="mindstage/add_robot")

    def actions(self) -> Iterator[ActionSpec]:
        """Yields the action of all skills."""
        yield ActionSpec(wire.Perform, partial(self.perform, ""), GOAL, name="mindstage/perform")

    def skill_actions(self) -> Iterator[ActionSpec]:
        """Yields the action of each skill."""
        with from_outside():
            names = tuple(extensions(Group.SKILLS))
        for name in names:
            yield ActionSpec(wire.Perform, partial(self.perform, name), GOAL, name=f"mindstage/skills/{name}")

    def list_skills(self, _: wire.ListSkills.Request) -> wire.ListSkills.Response:
        """Returns the skills with their arguments, and the robots."""
        from mindstage.robots.skill_declaration import skill_specs

        known = skill_specs()
        specs = [_spec(spec) for spec in known.values()]
        return wire.ListSkills.Response(
            success=True,
            skills=tuple(known),
            robots=tuple(self._simulation.robots),
            specs=msgspec.json.encode(specs).decode(),
        )

    def add_robot(self, request: wire.AddRobot.Request) -> wire.AddRobot.Response:
        """Adds a robot; a description that cannot be used is refused with the reason."""
        from mindstage.robots.edits import add_robot
        from mindstage.robots.models.catalog import list_models

        path = self._find_file(request.source)
        source: str | Path = path or request.source
        if path is None and request.source not in {model.name for model in list_models()}:
            cause = f"{request.source!r} is neither the name of a model nor a file in the folder of the server"
            raise MessageValidationError(
                "mindstage_msgs/AddRobotRequest", path="source", cause=cause, remedy="try mobile_manipulator"
            )
        try:
            robot = add_robot(self._simulation, source, pose_from_message(request.pose), name=request.name, xacro=False)
        except RobotError as error:
            text = str(error) if path is None else str(error).replace(str(path), request.source)
            return wire.AddRobot.Response(refusal=wire.Refusal(code=error.code, text=text))
        self._on_added()
        notes = tuple(f"{note.subject}: {note.text}" if note.subject else note.text for note in robot.model.notes)
        rebuild_s = self._simulation.state.expected_rebuild_s
        return wire.AddRobot.Response(success=True, name=robot.name, notes=notes, expected_rebuild_s=rebuild_s)

    def perform(self, skill: str, goal: wire.Perform.Goal, context: GoalContext) -> wire.Perform.Result:
        """Performs a skill.

        Args:
            skill: its name; empty for that in the goal.
            context: its cancellation and feedback.

        Raises:
            GoalAbortedError: it was refused before it began, or did not succeed; with the result.
            GoalCanceledError: it was canceled, or another one replaced it.
        """
        from mindstage.robots.skill_performance import start_skill

        name = (goal.skill or skill).replace("-", "_")
        steps: list[SkillStep] = []
        try:
            if skill and name != skill:
                cause = f"this action is for {skill}, not {name}"
                raise MessageValidationError("mindstage_msgs/PerformGoal", path="skill", cause=cause)
            robot = find_robot(self._simulation, goal.robot)
            deadline_s = goal.deadline_s if goal.deadline_s > 0.0 else None
            args = parse_arguments(goal.args)
            motion = start_skill(robot, name, args, deadline_s=deadline_s, on_step=steps.append)
        except (RobotError, InvalidArgumentError, MessageValidationError) as error:
            refusal = wire.Refusal(code=error.code, text=str(error))
            result = wire.Perform.Result(
                refusal=refusal, skill=name, args=goal.args, outcome="failed", reason=str(error)
            )
            raise GoalAbortedError(result, reason=str(error), rejected=True) from error
        performance = self._begin(robot)
        start_s = self._simulation.state.time_s

        def feedback() -> wire.Perform.Feedback:
            elapsed_s = self._simulation.state.time_s - start_s
            return wire.Perform.Feedback(skill=name, step=_current(steps), elapsed_s=elapsed_s)

        try:
            result = _result(self._run(motion, context, feedback, performance))
        except GoalCanceledError as canceled:
            known = wire.Perform.Result(
                outcome="unknown",
                skill=name,
                args=goal.args,
                reason=str(canceled),
                duration_s=self._simulation.state.time_s - start_s,
            )
            raise GoalCanceledError(known, reason=canceled.reason) from canceled
        finally:
            performance.ended.set()
        if not result.success:
            raise GoalAbortedError(result, reason=result.reason)
        return result

    def _begin(self, robot: Robot) -> _Performance:
        """Ends the skill that a robot performs, and registers a new one."""
        with self._lock:
            before = self._performances.get(robot.name)
            self._performances[robot.name] = performance = _Performance()
        if before is not None:
            before.replaced.set()
            before.ended.wait(SKILL_REPLACEMENT.maximum)
        return performance

    def _run(
        self,
        motion: Generator[float, None, SkillResult],
        context: GoalContext,
        feedback: Callable[[], wire.Perform.Feedback],
        performance: _Performance,
    ) -> SkillResult:
        """Lets simulated time pass until a skill has ended; the robot stops if it is canceled."""
        try:
            while True:
                try:
                    duration_s = next(motion)
                except StopIteration as end:
                    result: SkillResult = end.value
                    return result
                start_s = self._simulation.state.time_s
                while True:
                    context.check(feedback)
                    if performance.replaced.is_set():
                        raise GoalCanceledError(reason="a newer goal has replaced it")
                    passed_s = self._simulation.state.time_s - start_s
                    if passed_s < 0.0 or passed_s >= duration_s - 1e-9:  # negative after a reset
                        break
                    if self._simulation.closed:
                        raise MindstageError("the simulation was closed")
                    context.wait(_POLL_S)
        finally:
            motion.close()


def _current(steps: list[SkillStep]) -> str:
    """Returns what is being done: the last step that has begun and not ended, in words."""
    open_steps: dict[tuple[str, int, float], SkillStep] = {}
    for step in list(steps):
        key = (step.name, step.depth, step.start_s)
        if step.end_s is None:
            open_steps[key] = step
        else:
            open_steps.pop(key, None)
    return list(open_steps.values())[-1].text if open_steps else ""


def _result(result: SkillResult) -> wire.Perform.Result:
    return wire.Perform.Result(
        success=bool(result),
        outcome=result.outcome.value,
        skill=result.skill,
        args=msgspec.json.encode(result.args).decode(),
        reason=result.reason,
        suggestion=result.suggestion,
        state=result.state.text,
        assumptions=result.assumptions,
        duration_s=result.duration_s,
        result=msgspec.json.encode(result).decode(),
    )


def _spec(spec: SkillSpec) -> dict[str, object]:
    return {
        "name": spec.name,
        "summary": spec.summary,
        "parameters": msgspec.to_builtins(spec.parameters),
        "needs": sorted(need.value for need in spec.needs),
    }
