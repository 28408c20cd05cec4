"""Skills whose destinations follow from what the map and its ontologies state."""

from __future__ import annotations

from mindstage.robots.skills.declaration import KindName, SkillMotion, SkillNeed, ThingName, skill
from mindstage.robots.skills.task import SkillTask

__all__ = ["fetch", "put_away"]

_NOT_YET = "it is not built yet"
_NEEDS = (SkillNeed.MOBILE_BASE, SkillNeed.ARM, SkillNeed.GRIPPER)


@skill(needs=_NEEDS)
def put_away(task: SkillTask, thing: ThingName) -> SkillMotion:
    """Puts a thing where its kind is stored; opens what is closed, and closes it again.

    Args:
        task: this performance of the skill.
        thing: what to put away.
    """
    raise task.failure(_NOT_YET, "wait")
    yield 0.0


@skill(needs=_NEEDS)
def fetch(task: SkillTask, kind: KindName) -> SkillMotion:
    """Finds a thing of a kind, picks it up and brings it to where the robot started.

    Args:
        task: this performance of the skill.
        kind: the class of the thing.
    """
    raise task.failure(_NOT_YET, "wait")
    yield 0.0
