"""Bodies that a map describes as dynamic, but that cannot be loose: walls, floors, sky spheres, mounted lamps.

Loggers of game engines mark nearly every actor as dynamic, since that is what allows it to be recorded. Which bodies
are immovable is therefore decided here, in this order:

- by class: `ms:mounting` of the class or a superclass, in the bundled or in a user's ontology; of a class without one,
  a word in its name;
- by size: a body that is longer than `MAX_LOOSE_EXTENT_M`, or that encloses several others, is not loose;
- by the map: where it describes bodies that are fixed by class, and nearly all others, as dynamic, its mobility is no
  evidence. Furniture and parts are immovable then, and so are bodies of unknown classes that nobody carries;
- by place: a door, a drawer or a rack for which the map has no joint, and that meets a fixed piece of furniture, is
  held by it.

A body that a joint moves is never immovable, and bodies that are attached move with their parent. The world itself is
not changed: it keeps the mobility of the map.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mindstage.knowledge.shape_rules import Mounting, ShapeRule
from mindstage.scene import Body, BodyId, Iri, World
from mindstage.scene.bounding_boxes import OrientedBoxes, contains, overlapping_pairs
from mindstage.scene.display import short_name
from mindstage.scene.joint_kinematics import moving_body
from mindstage.scene.spatial import ENCLOSURE_MIN_CONTENTS, ENCLOSURE_MIN_SIZE_M
from mindstage.scene.transforms import normalize, pose_array

__all__ = ["MAX_LOOSE_EXTENT_M", "MAX_PORTABLE_EXTENT_M", "ImmovableBodies", "find_immovable_bodies"]

MAX_LOOSE_EXTENT_M = 5.0
"""Nothing that is longer is loose [m]."""
MAX_PORTABLE_EXTENT_M = 0.6
"""Length above which a body is immovable, unless its class is portable [m]."""
_MIN_UNIFORM_FRACTION = 0.75
"""Fraction of dynamic bodies from which on the mobility of a map is no evidence, if fixed ones are among them."""
_PART_SHAPES = ("door", "drawer", "rack")
_HOLDER_SHAPES = ("case", "shelf", "drawer", "frame")
_MEETING_M = 0.01
"""A part meets a piece of furniture if the distance of their boxes is at most this [m]."""
_MAX_LISTED_CLASSES = 12
"""Classes that a note names."""


class MountingSource(Protocol):
    """A source of the mounting of classes, such as a `KnowledgeBase`."""

    def shape_rule(self, cls: Iri, /) -> ShapeRule:
        """Returns the rule of a class, of which the mounting is used."""


@dataclass(frozen=True, slots=True)
class ImmovableBodies:
    """Dynamic bodies that cannot be loose, and why."""

    ids: frozenset[BodyId] = frozenset()
    notes: tuple[tuple[tuple[BodyId, ...], str], ...] = ()
    """One note for each kind of evidence: the bodies that it is about, and a sentence."""


def find_immovable_bodies(world: World, knowledge: MountingSource) -> ImmovableBodies:
    """Finds the dynamic bodies of a world that cannot be loose.

    Args:
        world: the world, with the mobility that the map gives.
        knowledge: the source of the mounting of classes.
    """
    candidates = _candidates(world)
    if not candidates:
        return ImmovableBodies()
    rules = {cls: knowledge.shape_rule(cls) for cls in dict.fromkeys(body.cls for body in candidates)}
    fixed = [body for body in candidates if _mounting(body, rules[body.cls]) is Mounting.FIXED]
    notes = []
    if fixed:
        text = f"{_count(fixed)} dynamic in the map, but fixed by class: {_classes(fixed, rules)}; static is simulated"
        notes.append((tuple(body.id for body in fixed), text))
    rest = [body for body in candidates if _mounting(body, rules[body.cls]) is not Mounting.FIXED]
    if huge := _too_large(rest, world):
        text = f"{_count(huge)} dynamic in the map, but too large to be loose: {_classes(huge, rules)}; "
        notes.append((tuple(body.id for body in huge), text + "static is simulated"))
    ids = {body.id for body in (*fixed, *huge)}
    dynamic_count = sum(body.physics.is_dynamic for body in world.bodies)
    if ids and dynamic_count >= _MIN_UNIFORM_FRACTION * len(world.bodies):
        placed = [body for body in rest if body.id not in ids and _is_installed(body, rules[body.cls])]
        if placed:
            text = (
                f"{_count(placed)} simulated as static, since the map describes {dynamic_count:,} of "
                f"{len(world.bodies):,} bodies as dynamic, {short_name((fixed or huge)[0].cls)} among them, which says "
                f"nothing about furniture and parts: {_classes(placed, rules)}"
            )
            notes.append((tuple(body.id for body in placed), text))
            ids.update(body.id for body in placed)
    parts = [body for body in rest if body.id not in ids and _is_part(body, rules[body.cls])]
    if held := _held_by_furniture(parts, world, ids, knowledge):
        text = (
            f"{_count(held)} dynamic in the map, which has no joint for what furniture holds: {_classes(held, rules)}; "
            "static is simulated"
        )
        notes.append((tuple(body.id for body in held), text))
        ids.update(body.id for body in held)
    return ImmovableBodies(frozenset(ids), tuple(notes))


def _candidates(world: World) -> list[Body]:
    """The dynamic bodies that are attached to no other one, and that no joint moves."""
    if not any(body.physics.is_dynamic for body in world.bodies):
        return []
    bodies = {body.id: body for body in world.bodies}
    parents = {each.child: each.parent for each in world.attachments if each.parent in bodies}
    moved = set()
    for joint in world.joints:
        if joint.parent in bodies and joint.child in bodies:
            moving, _ = moving_body(joint, bodies[joint.parent], bodies[joint.child])
            moved.add(_root(moving.id, parents))
    return [
        body for body in world.bodies if body.physics.is_dynamic and body.id not in parents and body.id not in moved
    ]


def _root(id: BodyId, parents: Mapping[BodyId, BodyId]) -> BodyId:
    visited = {id}
    while (parent := parents.get(id)) is not None and parent not in visited:
        visited.add(parent)
        id = parent
    return id


def _too_large(bodies: Sequence[Body], world: World) -> list[Body]:
    """Bodies that are longer than any loose one, or that enclose several bodies."""
    long = {body.id for body in bodies if body.size is not None and max(body.size) > MAX_LOOSE_EXTENT_M}
    roomy = {
        body.id
        for body in bodies
        if body.id not in long
        and body.size is not None
        and all(extent >= least for extent, least in zip(sorted(body.size), ENCLOSURE_MIN_SIZE_M, strict=True))
    }
    if roomy:
        long |= _enclosing(world, roomy)
    return [body for body in bodies if body.id in long]


def _is_part(body: Body, rule: ShapeRule) -> bool:
    """Whether a body is what furniture holds: its doors, drawers and racks."""
    return rule.shape_type in _PART_SHAPES and _mounting(body, rule) is Mounting.INSTALLED


def _held_by_furniture(
    parts: Sequence[Body], world: World, immovable: set[BodyId], knowledge: MountingSource
) -> list[Body]:
    """Those of the parts that meet a fixed piece of furniture."""
    if not parts:
        return []
    sized, boxes = _sized_boxes(world)
    wanted = {body.id for body in parts}
    attached = {each.child for each in world.attachments}
    is_part = np.array([body.id in wanted for body in sized], dtype=bool)
    is_holder = np.array(
        [
            ((not body.physics.is_dynamic and body.id not in attached) or body.id in immovable)
            and knowledge.shape_rule(body.cls).shape_type in _HOLDER_SHAPES
            for body in sized
        ],
        dtype=bool,
    )
    held = set[BodyId]()
    for pair in overlapping_pairs(boxes, is_part, is_holder, margin=(_MEETING_M,) * 3):
        held.update(sized[row].id for row in np.concatenate(pair).tolist() if is_part[row])
    return [body for body in parts if body.id in held]


def _sized_boxes(world: World) -> tuple[list[Body], OrientedBoxes]:
    """The bodies with a size and an orientation, and a box around each."""
    sized = [body for body in world.bodies if body.size is not None and any(body.pose.quaternion)]
    poses = pose_array(body.pose for body in sized)
    poses[:, 3:] = normalize(poses[:, 3:])
    return sized, OrientedBoxes.from_poses(poses, np.array([body.size for body in sized], dtype=float))


def _enclosing(world: World, ids: set[BodyId]) -> set[BodyId]:
    """Those of the bodies that contain several others."""
    sized, boxes = _sized_boxes(world)
    mask: NDArray[np.bool_] = np.array([body.id in ids for body in sized], dtype=bool)
    count = np.zeros(len(sized), dtype=np.intp)
    for a, b in overlapping_pairs(boxes, mask, np.ones(len(sized), dtype=bool)):
        for outer, inner in ((a, b), (b, a)):
            outer, inner = outer[mask[outer]], inner[mask[outer]]
            np.add.at(count, outer[contains(boxes, outer, inner)], 1)
    return {sized[row].id for row in np.flatnonzero(mask & (count >= ENCLOSURE_MIN_CONTENTS)).tolist()}


def _is_installed(body: Body, rule: ShapeRule) -> bool:
    """Whether a body stays in place where the mobility of the map is no evidence."""
    mounting = _mounting(body, rule)
    return mounting is Mounting.INSTALLED if mounting is not None else not _is_small(body)


def _mounting(body: Body, rule: ShapeRule) -> Mounting | None:
    return None if rule.mounting_is_weak and _is_small(body) else rule.mounting


def _is_small(body: Body) -> bool:
    return body.size is None or max(body.size) <= MAX_PORTABLE_EXTENT_M


def _count(bodies: Sequence[Body]) -> str:
    return f"{len(bodies):,} {'body is' if len(bodies) == 1 else 'bodies are'}"


def _classes(bodies: Iterable[Body], rules: Mapping[Iri, ShapeRule]) -> str:
    """The classes of bodies with their numbers and the reason of a guess: "IAILabFloor, LabWall (4)"."""
    counts = Counter(body.cls for body in bodies).most_common()
    listed = []
    for cls, count in counts[:_MAX_LISTED_CLASSES]:
        details = [f"{count:,}"] if count > 1 else []
        details += [rules[cls].mounting_reason] if rules[cls].mounting_reason else []
        listed.append(short_name(cls) + (f" ({': '.join(details)})" if details else ""))
    if len(counts) > _MAX_LISTED_CLASSES:
        listed.append(f"{len(counts) - _MAX_LISTED_CLASSES:,} more classes")
    return ", ".join(listed)
