"""Skills as behaviors of py_trees (extra `py_trees`): trees of skills with conditions, fallbacks and monitors."""

from __future__ import annotations

from collections.abc import Generator

from mindstage.errors import InvalidArgumentError, RobotLibraryError
from mindstage.robots.robot import Robot
from mindstage.robots.skills.declaration import SkillOutcome, SkillResult, SkillStep
from mindstage.robots.skills.performance import start_skill

try:
    from py_trees.behaviour import Behaviour
    from py_trees.common import Status
except ImportError as error:
    raise RobotLibraryError(error.name or "py_trees", extra="py_trees") from error

__all__ = ["SkillBehavior", "run_tree"]

_TICK_S = 0.05


class SkillBehavior(Behaviour):
    """Performs a skill of a robot while it is ticked.

    It is `RUNNING` until the skill has ended, then `SUCCESS` or `FAILURE`; of a skill whose effect is unknown it is
    `FAILURE`, and `result` has the difference. Each time it is entered, the skill starts anew. Interrupting it, for
    example by a parent that chooses another child, stops the robot.

    Simulated time passes between the ticks: the simulation plays, or the caller steps it, as `run_tree` does.
    """

    def __init__(
        self,
        robot: Robot,
        skill: str,
        *,
        behavior_name: str = "",
        deadline_s: float | None = None,
        seed: int = 0,
        **args: object,
    ) -> None:
        """Nothing moves before the first tick.

        Args:
            robot: the robot.
            skill: the name of the skill.
            behavior_name: the name in the tree; by default the skill with its arguments.
            deadline_s: the skill fails if it has not ended after this simulated time [s].
            seed: of everything that is sampled.
            args: the arguments of the skill.

        Raises:
            InvalidArgumentError: there is no such skill, or it does not take these arguments.
        """
        super().__init__(behavior_name or " ".join([skill, *(str(each) for each in args.values())]))
        self.result: SkillResult | None = None
        """The result of the skill that ended last; None before, and after an interruption."""
        self._robot, self._skill, self._args = robot, skill, args
        self._deadline_s, self._seed = deadline_s, seed
        self._motion: Generator[float, None, SkillResult] | None = None
        self._due_s = 0.0
        self._start().close()  # checks the arguments

    def initialise(self) -> None:
        """Starts the skill; called by py_trees at the first tick after it was not running."""
        self.result, self._motion, self._due_s = None, self._start(), self._robot.session.state.time_s

    def update(self) -> Status:
        """Continues the skill if the simulated time has come for which it waits; called by py_trees at each tick."""
        assert self._motion is not None
        if self._robot.session.state.time_s < self._due_s - 1e-9:
            return Status.RUNNING
        try:
            self._due_s = self._robot.session.state.time_s + next(self._motion)
        except StopIteration as end:
            self.result, self._motion = end.value, None
            self.feedback_message = end.value.reason or "done"
            return Status.SUCCESS if end.value.outcome is SkillOutcome.SUCCEEDED else Status.FAILURE
        return Status.RUNNING

    def terminate(self, new_status: Status) -> None:
        """Stops the robot if the skill has not ended; called by py_trees."""
        if self._motion is not None:
            self._motion.close()
            self._motion = None
            self.feedback_message = "interrupted"

    def _start(self) -> Generator[float, None, SkillResult]:
        return start_skill(
            self._robot, self._skill, self._args, deadline_s=self._deadline_s, seed=self._seed, on_step=self._on_step
        )

    def _on_step(self, step: SkillStep) -> None:
        self.feedback_message = step.text


def run_tree(tree: Behaviour, robot: Robot, *, tick_s: float = _TICK_S, timeout_s: float = 600.0) -> Status:
    """Ticks a tree until it is not running anymore, and lets simulated time pass in between.

    Args:
        tree: the root of the tree.
        robot: a robot in the simulation.
        tick_s: simulated time between two ticks [s].
        timeout_s: after this simulated time [s] the tree is interrupted.

    Returns:
        The status of the tree; `INVALID` if it was interrupted.
    """
    if not tick_s > 0.0:
        raise InvalidArgumentError("tick_s", cause=f"{tick_s:g} s is no interval", remedy="give a positive number")

    def ticks() -> Generator[float, None, None]:
        left_s = timeout_s
        while tree.status is Status.RUNNING and left_s > 0.0:
            yield tick_s
            left_s -= tick_s
            tree.tick_once()

    try:
        tree.tick_once()
        robot.run(ticks(), timeout_s=timeout_s + 2 * tick_s)
    finally:
        if tree.status is Status.RUNNING:
            tree.stop(Status.INVALID)
    status: Status = tree.status
    return status
