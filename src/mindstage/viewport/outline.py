"""Outline: a world as the tree that the page shows: rooms, furniture, what belongs to it, what hangs on that.

It is written in rows and numbers of rows, so that five thousand bodies are a few hundred kilobytes, once for all.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from enum import IntEnum

import msgspec

from mindstage.knowledge.names import local_name
from mindstage.world import BodyId, World
from mindstage.world.travel import joint_reach

__all__ = ["ParentLink", "SceneTree", "SceneTreeRow", "scene_tree"]


class ParentLink(IntEnum):
    """What a body has to do with the one above it."""

    NONE = 0
    """Nothing is above it."""
    ATTACHED = 1
    JOINT = 2


class SceneTreeRow(msgspec.Struct, frozen=True, array_like=True):
    """One body."""

    id: BodyId
    label: str
    cls: int
    """A number of the classes."""
    parent: int
    """A number of a row, or -1."""
    link: ParentLink
    joint: BodyId | None
    """The constraint by which it is linked."""
    movable: bool
    """Whether the physics moves it."""
    encloses: bool
    """Whether it encloses the place, so that only its outline is drawn."""


class SceneTree(msgspec.Struct, frozen=True, kw_only=True):
    """All of a world."""

    name: str
    engine: str
    classes: tuple[str, ...]
    rows: tuple[SceneTreeRow, ...]
    joints: int
    """Constraints that let something move."""


def scene_tree(world: World, *, engine: str, enclosing: Container[BodyId] = ()) -> SceneTree:
    """The tree of a world: what is attached is below its holder, what a joint holds below the joint's parent.

    Args:
        world: all that is there.
        engine: who runs it.
        shells: bodies that enclose the place.
    """
    numbers = {body.id: row for row, body in enumerate(world.bodies)}
    above: dict[BodyId, tuple[BodyId, ParentLink, BodyId | None]] = {}
    for joint in world.joints:
        # The map may have the roles upside down: what moves is shown below what it moves in.
        upside_down = _is_dynamic(world, numbers, joint.parent) and not _is_dynamic(world, numbers, joint.child)
        parent, child = (joint.child, joint.parent) if upside_down else (joint.parent, joint.child)
        if parent in numbers and child in numbers and child not in above:
            above[child] = (parent, ParentLink.JOINT, joint.id)
    above |= {
        hold.child: (hold.parent, ParentLink.ATTACHED, None)
        for hold in world.attachments
        if hold.parent in numbers and hold.child in numbers
    }
    above = _without_cycles(above)
    classes = {cls: number for number, cls in enumerate(dict.fromkeys(body.cls for body in world.bodies))}
    rows = []
    for body in world.bodies:
        parent, link, joint_id = above.get(body.id, (BodyId(""), ParentLink.NONE, None))
        rows.append(
            SceneTreeRow(
                id=body.id,
                label=body.label or "",
                cls=classes[body.cls],
                parent=numbers.get(parent, -1),
                link=link,
                joint=joint_id,
                movable=body.physics.is_dynamic,
                encloses=body.id in enclosing,
            )
        )
    return SceneTree(
        name=world.name or local_name(world.iri),
        engine=engine,
        classes=tuple(map(local_name, classes)),
        rows=tuple(rows),
        joints=sum(any(reach != 0.0 for reach in joint_reach(joint)) for joint in world.joints),
    )


def _is_dynamic(world: World, numbers: Mapping[BodyId, int], id: BodyId) -> bool:
    return id in numbers and world.bodies[numbers[id]].physics.is_dynamic


def _without_cycles(
    parents: Mapping[BodyId, tuple[BodyId, ParentLink, BodyId | None]],
) -> dict[BodyId, tuple[BodyId, ParentLink, BodyId | None]]:
    """Joints may go round in a circle, which has no top; the last link of it is left out."""
    kept: dict[BodyId, tuple[BodyId, ParentLink, BodyId | None]] = {}
    for child, link in parents.items():
        if child not in _ancestors(link[0], kept):
            kept[child] = link
    return kept


def _ancestors(id: BodyId, parents: Mapping[BodyId, tuple[BodyId, ParentLink, BodyId | None]]) -> Iterable[BodyId]:
    seen = dict.fromkeys([id])
    while id in parents and parents[id][0] not in seen:
        id = parents[id][0]
        seen[id] = None
    return seen
