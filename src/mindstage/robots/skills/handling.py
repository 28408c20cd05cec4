"""Skills that grasp, carry and put down things."""

from __future__ import annotations

from mindstage.robots.skills.declaration import SkillMotion, SkillNeed, SupportName, ThingName, skill
from mindstage.robots.skills.task import SkillTask

__all__ = ["grasp", "pick", "place", "pour", "release"]

_NOT_YET = "it is not built yet"


@skill(needs=(SkillNeed.ARM, SkillNeed.GRIPPER))
def grasp(task: SkillTask, thing: ThingName) -> SkillMotion:
    """Grasps a thing where it is; the base stays where it is if the thing is in reach.

    Args:
        task: this performance of the skill.
        thing: what to grasp.
    """
    raise task.failure(_NOT_YET, "wait")
    yield 0.0


@skill(needs=(SkillNeed.ARM, SkillNeed.GRIPPER))
def release(task: SkillTask) -> SkillMotion:
    """Opens the gripper and moves it away from what it held."""
    raise task.failure(_NOT_YET, "wait")
    yield 0.0


@skill(needs=(SkillNeed.ARM, SkillNeed.GRIPPER))
def pick(task: SkillTask, thing: ThingName) -> SkillMotion:
    """Drives to a thing, grasps it and lifts it; opens what it is in.

    Args:
        task: this performance of the skill.
        thing: what to pick up.
    """
    raise task.failure(_NOT_YET, "wait")
    yield 0.0


@skill(needs=(SkillNeed.ARM, SkillNeed.GRIPPER), alternatives=(("on",), ("into",)))
def place(
    task: SkillTask, thing: ThingName, on: SupportName | None = None, into: SupportName | None = None
) -> SkillMotion:
    """Puts a thing at a free place on or in another one; picks it up first if it is not held.

    Args:
        task: this performance of the skill.
        thing: what to put down.
        on: what to put it on.
        into: what to put it into; opened first if it is closed.
    """
    raise task.failure(_NOT_YET, "wait")
    yield 0.0


@skill(needs=(SkillNeed.ARM, SkillNeed.GRIPPER))
def pour(task: SkillTask, thing: ThingName, into: SupportName) -> SkillMotion:
    """Tilts a thing over a container so that what is in it falls out; picks it up first if it is not held.

    Args:
        task: this performance of the skill.
        thing: the container to pour from.
        into: the container to pour into.
    """
    raise task.failure(_NOT_YET, "wait")
    yield 0.0
