"""Skills that move the robot, but nothing else."""

from __future__ import annotations

from mindstage.robots.skills.declaration import AngleRad, LengthM, SkillMotion, SkillNeed, ThingName, skill
from mindstage.robots.skills.task import SkillTask

__all__ = ["go_to", "look_at", "park", "reach"]

_NOT_YET = "it is not built yet"


@skill(needs=(SkillNeed.MOBILE_BASE,), alternatives=(("thing",), ("x", "y", "yaw")))
def go_to(
    task: SkillTask,
    thing: ThingName | None = None,
    x: LengthM | None = None,
    y: LengthM | None = None,
    yaw: AngleRad = 0.0,
) -> SkillMotion:
    """Drives to a thing, so that an arm can reach it, or to a place on the floor.

    Args:
        task: this performance of the skill.
        thing: where to drive to; the robot faces it.
        x: of the place [m].
        y: of the place [m].
        yaw: the direction in which the robot faces there [rad].
    """
    raise task.failure(_NOT_YET, "wait")
    yield 0.0


@skill(needs=(SkillNeed.HEAD,))
def look_at(task: SkillTask, thing: ThingName) -> SkillMotion:
    """Turns the head towards a thing.

    Args:
        task: this performance of the skill.
        thing: what to look at.
    """
    raise task.failure(_NOT_YET, "wait")
    yield 0.0


@skill(needs=(SkillNeed.ARM,), alternatives=(("thing",), ("x", "y", "z")))
def reach(
    task: SkillTask,
    thing: ThingName | None = None,
    x: LengthM | None = None,
    y: LengthM | None = None,
    z: LengthM | None = None,
) -> SkillMotion:
    """Moves the gripper to a thing without touching it, or to a point; the base stays where it is.

    Args:
        task: this performance of the skill.
        thing: the gripper stops in front of it.
        x: of the point [m].
        y: of the point [m].
        z: of the point [m].
    """
    raise task.failure(_NOT_YET, "wait")
    yield 0.0


@skill(needs=(SkillNeed.ARM,))
def park(task: SkillTask) -> SkillMotion:
    """Folds the arms, so that they are out of the way."""
    raise task.failure(_NOT_YET, "wait")
    yield 0.0
