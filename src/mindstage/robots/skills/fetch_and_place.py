"""Skills whose destinations follow from what the map and its ontologies state."""

from __future__ import annotations

from mindstage.errors import KnowledgeError, NoFreePlacementError, SkillFailedError, UnreachableError
from mindstage.rdf.graphs import local_name
from mindstage.robots.skill_declaration import ClassName, SkillMotion, SkillNeed, ThingName, skill
from mindstage.robots.skill_task import SkillTask
from mindstage.robots.skills.doors import moving_part
from mindstage.robots.skills.handling import pick_up, put_down
from mindstage.robots.skills.manipulator import hand_with
from mindstage.robots.skills.movement import drive_to
from mindstage.robots.surroundings import Surroundings
from mindstage.scene import BodyId

__all__ = ["fetch", "put_away"]

_NEEDS = (SkillNeed.MOBILE_BASE, SkillNeed.ARM, SkillNeed.GRIPPER)
_MAX_CANDIDATES = 4
"""Number of storage places, or of things of a kind, that are tried."""


@skill(needs=_NEEDS, wordings=("put away {thing}", "put {thing} away", "tidy up {thing}", "tidy {thing} away"))
def put_away(task: SkillTask, thing: ThingName) -> SkillMotion:
    """Puts a thing where its kind is stored; opens what is closed, and closes it again.

    Args:
        thing: what to put away.
    """
    surroundings = task.surroundings()
    id = surroundings.find(thing)
    places = surroundings.storage_places(id)
    if not places:
        kind = local_name(surroundings.body(id).cls)
        raise task.failure(
            f"it is not known where a {kind} is stored", f"tell it, or place {id} on or into something by name"
        )
    inside = surroundings.containers_of(id)
    if any(place in inside for place in places) and hand_with(task, id) is None:
        task.assume(f"{id} is already where its kind is stored: in {inside[0]}")
        return
    task.assume(f"{id} belongs to {places[0]}, as storage_place_in_environment answers")
    last: Exception | None = None
    for place in places[:_MAX_CANDIDATES]:
        is_container = _is_container(surroundings, id, place)
        was_closed = [each.id for each in surroundings.articulated_parts() if each.is_closed]
        try:
            yield from put_down(task, id, place, inside=is_container)
        except (SkillFailedError, UnreachableError, NoFreePlacementError) as error:
            last = error
            if hand_with(task, id) is None and not isinstance(error, NoFreePlacementError):
                raise
            continue
        yield from _closing_again(task, was_closed)
        return
    assert last is not None
    raise last


def _is_container(surroundings: Surroundings, id: BodyId, place: BodyId) -> bool:
    """Whether a thing is put into a place rather than on it."""
    parts = surroundings.articulated_parts_of(place)
    return bool(parts) or bool(surroundings.free_places(id, place, inside=True, count=1))


def _closing_again(task: SkillTask, ids: list[BodyId]) -> SkillMotion:
    """Closes the doors and drawers that the skill has opened."""
    for part in task.surroundings().articulated_parts():
        if part.id in ids and part.id in task.opened and not part.is_closed:
            yield from moving_part(task, part, 0.0)


@skill(needs=_NEEDS, wordings=("fetch {kind}", "fetch me {kind}", "bring {kind}", "bring me {kind}", "get me {kind}"))
def fetch(task: SkillTask, kind: ClassName) -> SkillMotion:
    """Finds a thing of a kind, picks it up and brings it to where the robot started.

    Args:
        kind: the class of the thing.
    """
    surroundings = task.surroundings()
    start = task.robot.base_pose()
    candidates = _by_effort(surroundings, surroundings.instances(kind), start)
    last: Exception | None = None
    for id in candidates[:_MAX_CANDIDATES]:
        try:
            yield from pick_up(task, id)
        except (SkillFailedError, UnreachableError, KnowledgeError) as error:
            last = error
            continue
        with task.step("bring", f"bring {id} to where the robot started"):
            yield from drive_to(task, start)
        return
    assert last is not None
    raise last


def _by_effort(surroundings: Surroundings, things: list[BodyId], start: tuple[float, float, float]) -> list[BodyId]:
    """Things that nothing closed is in front of first, then by their distance."""

    def effort(id: BodyId) -> tuple[int, float]:
        x, y = surroundings.pose(id)[:2].tolist()
        return len(surroundings.closed_in_front_of(id)), (x - start[0]) ** 2 + (y - start[1]) ** 2

    return sorted(things, key=effort)
