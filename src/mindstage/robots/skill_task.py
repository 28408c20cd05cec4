"""A skill that is being performed: its robot, the steps so far, what was assumed, and how it fails."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import inf

from msgspec.structs import replace

from mindstage.errors import SkillFailedError
from mindstage.robots.models.robot_model import BaseType
from mindstage.robots.robot import Robot
from mindstage.robots.robot_kinematics import RobotKinematics
from mindstage.robots.search_limits import SearchLimit
from mindstage.robots.skill_declaration import Skill, SkillMotion, SkillNeed, SkillSpec, SkillState, SkillStep
from mindstage.robots.surroundings import Surroundings
from mindstage.scene import BodyId

__all__ = ["SkillTask"]

_STEPS = 1_000_000
"""Number of steps of all searches of a skill together; several times those of the longest ones that succeed."""


class SkillTask:
    """One performance of a skill; skills get it as their first argument."""

    def __init__(self, robot: Robot, *, seed: int = 0, on_step: Callable[[SkillStep], object] | None = None) -> None:
        """Does nothing yet.

        Args:
            seed: of everything that is sampled.
            on_step: called when a step begins, and when it ends.
        """
        self.robot = robot
        self.session = robot.session
        self.kinematics = RobotKinematics(robot.model)
        self.seed = seed
        self.assumptions: list[str] = []
        self.steps: list[SkillStep] = []
        self.moved: dict[BodyId, None] = {}
        """The things that were moved."""
        self.opened: dict[BodyId, None] = {}
        """The doors and drawers that were used."""
        self.limit = SearchLimit(_STEPS, cpu_s=inf)
        """Of all its searches together."""
        self._on_step = on_step
        self._start_s = self.time_s
        self._depth = 0

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self.session.state.time_s

    @property
    def duration_s(self) -> float:
        """Simulated time since it began [s]."""
        return self.time_s - self._start_s

    def assume(self, text: str) -> None:
        """Reports an assumption, once."""
        if text not in self.assumptions:
            self.assumptions.append(text)

    def failure(self, reason: str, suggestion: str, *, is_known: bool = True) -> SkillFailedError:
        """The error with which the skill fails.

        Args:
            reason: why, with names and numbers.
            suggestion: what to try.
            is_known: whether it certainly failed; otherwise the outcome is unknown.
        """
        return SkillFailedError(self.robot.name, reason=reason, suggestion=suggestion, is_known=is_known)

    @contextmanager
    def step(self, name: str, text: str) -> Iterator[None]:
        """Reports what is done within the context as a step."""
        index = len(self.steps)
        started = SkillStep(
            name=name, text=text, depth=self._depth, start_s=self.duration_s, end_s=None, succeeded=None
        )
        self.steps.append(started)
        self._report(index)
        self._depth += 1
        succeeded = False
        try:
            yield
            succeeded = True
        finally:
            self._depth -= 1
            self.steps[index] = replace(self.steps[index], end_s=self.duration_s, succeeded=succeeded)
            self._report(index)

    def perform(self, skill: Skill, **args: object) -> SkillMotion:
        """Performs a skill as a part of this one.

        Raises:
            InvalidArgumentError: the skill does not take these arguments.
            SkillFailedError: it failed.
        """
        checked = skill.spec.check(args)
        with self.step(skill.spec.name, " ".join([skill.spec.name, *map(str, checked.values())])):
            yield from skill.function(self, **checked)

    def surroundings(self) -> Surroundings:
        """The things of the world as they are now, without robots."""
        return Surroundings(self.session, ignored=self.robot_bodies())

    def robot_bodies(self) -> frozenset[BodyId]:
        """The bodies of this robot."""
        return frozenset((*self.robot.link_ids.values(), *(body.id for body in self.robot.placed.world.bodies)))

    def check_needs(self, spec: SkillSpec) -> None:
        """Checks that the robot has what a skill needs.

        Raises:
            SkillFailedError: something is missing.
        """
        missing = [each for each in SkillNeed if each in spec.needs and not self._has(each)]
        if missing:
            reason = f"{self.robot.name} has no {' and no '.join(missing)}"
            raise self.failure(reason, f"use a robot with {', '.join(missing)} for {spec.name}")

    def _has(self, need: SkillNeed) -> bool:
        model = self.robot.model
        match need:
            case SkillNeed.MOBILE_BASE:
                return model.base.type is not BaseType.FIXED
            case SkillNeed.ARM:
                return bool(model.arms)
            case SkillNeed.GRIPPER:
                return any(arm.gripper is not None for arm in model.arms)
            case SkillNeed.HEAD:
                return model.head is not None

    def state(self) -> SkillState:
        """The present state of the robot, and of what the skill moved and opened."""
        is_mobile = self.robot.model.base.type is not BaseType.FIXED
        return SkillState(
            base=self.robot.base_pose() if is_mobile else None,
            held=dict(self.robot.held),
            supports=self._supports(),
            openness=self._openness(),
        )

    def _supports(self) -> dict[BodyId, str]:
        if not self.moved:
            return {}
        surroundings = self.surroundings()
        held = set(self.robot.held.values())
        return {id: surroundings.support_of(id) for id in self.moved if surroundings.exists(id) and id not in held}

    def _openness(self) -> dict[BodyId, float]:
        if not self.opened:
            return {}
        parts = self.surroundings().articulated_parts()
        return {each.id: round(each.openness, 3) for each in parts if each.id in self.opened}

    def _report(self, index: int) -> None:
        if self._on_step is not None:
            self._on_step(self.steps[index])
