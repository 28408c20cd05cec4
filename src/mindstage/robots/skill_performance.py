"""How a skill is started, and performed until its end or its deadline.

motion = start_skill(robot, "put_away", {"thing": "milk_1"})
result = robot.session.run_motion(motion)  # or step by each yielded time
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from types import MappingProxyType
from typing import NamedTuple

from mindstage.access.limits import Timeout
from mindstage.errors import (
    CommandRefusedError,
    InvalidArgumentError,
    KnowledgeError,
    NoFreePlacementError,
    SkillFailedError,
    UnreachableError,
    WorldError,
    suggestion,
)
from mindstage.ranges import Seed, checked
from mindstage.registry import Group, extensions
from mindstage.robots.robot import Robot
from mindstage.robots.skill_declaration import (
    Skill,
    SkillOutcome,
    SkillResult,
    SkillStep,
    SkillValue,
    split_command,
)
from mindstage.robots.skill_task import SkillTask

__all__ = ["start_skill"]


class _End(NamedTuple):
    outcome: SkillOutcome
    reason: str = ""
    suggestion: str = ""


@checked
def start_skill(
    robot: Robot,
    name: str,
    args: Mapping[str, object] = MappingProxyType({}),
    *,
    deadline_s: Timeout | None = None,
    seed: Seed = 0,
    on_step: Callable[[SkillStep], object] | None = None,
) -> Generator[float, None, SkillResult]:
    """Starts a skill: a generator of the simulated times [s] by which the caller has to step.

    Closing the generator stops the robot, where it then is.

    Args:
        name: the name of the skill, or a command with arguments: "open fridge_door", "go_to x=1 y=0".
        args: its arguments by name; numbers may be given as text.
        deadline_s: the skill fails if it has not ended after this simulated time [s].
        seed: of everything that is sampled.
        on_step: called when a step begins and when it ends.

    Returns:
        The generator, which returns the result. A skill that fails is a result, not an error.

    Raises:
        InvalidArgumentError: there is no such skill, or it does not take these arguments.
        ExtensionError: the package that adds it cannot be imported.
    """
    name, words = split_command(name)
    known = extensions(Group.SKILLS)
    if name not in known:
        remedy = suggestion(name, known)
        raise InvalidArgumentError("a skill", cause=f"there is no skill {name!r}", remedy=remedy)
    skill = known[name].load(Skill)
    return _performing(robot, skill, skill.spec.parse(words, args), deadline_s, seed, on_step)


def _performing(
    robot: Robot,
    skill: Skill,
    args: dict[str, SkillValue],
    deadline_s: float | None,
    seed: int,
    on_step: Callable[[SkillStep], object] | None,
) -> Generator[float, None, SkillResult]:
    task = SkillTask(robot, seed=seed, on_step=on_step)
    with robot.performing(skill.spec.name, args) as report:
        try:
            end = yield from _until_deadline(task, skill, args, deadline_s)
        except BaseException:
            robot.stop()
            raise
        if end.outcome is not SkillOutcome.SUCCEEDED:
            robot.stop()
        report(end.outcome, end.reason)
    return SkillResult(
        outcome=end.outcome,
        skill=skill.spec.name,
        args=args,
        reason=end.reason,
        assumptions=tuple(task.assumptions),
        suggestion=end.suggestion,
        state=task.state(),
        duration_s=task.duration_s,
        steps=tuple(task.steps),
    )


def _until_deadline(
    task: SkillTask, skill: Skill, args: dict[str, SkillValue], deadline_s: float | None
) -> Generator[float, None, _End]:
    try:
        task.check_needs(skill.spec)
        motion = skill.function(task, **args)
        try:
            while (duration_s := next(motion, None)) is not None:
                if deadline_s is not None and task.duration_s + duration_s > deadline_s:
                    done = task.steps[-1].text if task.steps else "nothing"
                    reason = f"it did not end within {deadline_s:g} s; the last step was: {done}"
                    return _End(SkillOutcome.FAILED, reason, "give it more time")
                yield duration_s
        finally:
            motion.close()
    except SkillFailedError as error:
        outcome = SkillOutcome.FAILED if error.is_known else SkillOutcome.UNKNOWN
        return _End(outcome, error.reason, error.suggestion)
    except UnreachableError as error:
        blocked = f"move {error.obstacle} out of the way" if error.obstacle else "move the thing, or another robot"
        return _End(SkillOutcome.FAILED, str(error), blocked)
    except NoFreePlacementError as error:
        return _End(SkillOutcome.FAILED, str(error), "clear a place there, or name another one")
    except (CommandRefusedError, KnowledgeError, WorldError) as error:
        return _End(SkillOutcome.FAILED, str(error), getattr(error, "remedy", "") or "check the names and the robot")
    return _End(SkillOutcome.SUCCEEDED)
