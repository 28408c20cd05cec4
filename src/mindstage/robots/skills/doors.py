"""Skills that open and close doors and drawers."""

from __future__ import annotations

from mindstage.robots.skills.declaration import FractionOpen, SkillMotion, SkillNeed, ThingName, skill
from mindstage.robots.skills.task import SkillTask

__all__ = ["close_thing", "open_thing"]

_NOT_YET = "it is not built yet"


@skill(name="open", needs=(SkillNeed.ARM, SkillNeed.GRIPPER))
def open_thing(task: SkillTask, thing: ThingName, fraction: FractionOpen = 1.0) -> SkillMotion:
    """Opens a door or drawer by its handle.

    Args:
        task: this performance of the skill.
        thing: the door or drawer, or a container with one.
        fraction: how far, from 0 (closed) to 1.
    """
    raise task.failure(_NOT_YET, "wait")
    yield 0.0


@skill(name="close", needs=(SkillNeed.ARM, SkillNeed.GRIPPER))
def close_thing(task: SkillTask, thing: ThingName) -> SkillMotion:
    """Closes a door or drawer.

    Args:
        task: this performance of the skill.
        thing: the door or drawer, or a container with one.
    """
    raise task.failure(_NOT_YET, "wait")
    yield 0.0
