"""Outline: a world as the tree that the page shows: rooms, furniture, what belongs to it, what hangs on that.

It is written in rows and numbers of rows, so that five thousand bodies are a few hundred kilobytes, once for all.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from enum import IntEnum

import msgspec

from mindstage.knowledge.names import local_name
from mindstage.world import BodyId, World
from mindstage.world.travel import reaches

__all__ = ["Link", "Outline", "OutlineRow", "outline_of"]


class Link(IntEnum):
    """What a body has to do with the one above it."""

    NONE = 0
    """Nothing is above it."""
    ATTACHED = 1
    JOINT = 2


class OutlineRow(msgspec.Struct, frozen=True, array_like=True):
    """One body."""

    id: BodyId
    label: str
    cls: int
    """A number of the classes."""
    parent: int
    """A number of a row, or -1."""
    link: Link
    joint: BodyId | None
    """The constraint by which it is linked."""
    movable: bool
    """Whether the physics moves it."""
    encloses: bool
    """Whether it encloses the place, so that only its outline is drawn."""


class Outline(msgspec.Struct, frozen=True, kw_only=True):
    """All of a world."""

    name: str
    engine: str
    classes: tuple[str, ...]
    rows: tuple[OutlineRow, ...]
    joints: int
    """Constraints that let something move."""


def outline_of(world: World, *, engine: str, shells: Container[BodyId] = ()) -> Outline:
    """The tree of a world: what is attached is below its holder, what a joint holds below the joint's parent.

    Args:
        world: all that is there.
        engine: who runs it.
        shells: bodies that enclose the place.
    """
    numbers = {body.id: row for row, body in enumerate(world.bodies)}
    above: dict[BodyId, tuple[BodyId, Link, BodyId | None]] = {}
    for joint in world.constraints:
        # The map may have the roles upside down: what moves is shown below what it moves in.
        upside_down = _simulates(world, numbers, joint.parent) and not _simulates(world, numbers, joint.child)
        parent, child = (joint.child, joint.parent) if upside_down else (joint.parent, joint.child)
        if parent in numbers and child in numbers and child not in above:
            above[child] = (parent, Link.JOINT, joint.id)
    above |= {
        hold.child: (hold.parent, Link.ATTACHED, None)
        for hold in world.attachments
        if hold.parent in numbers and hold.child in numbers
    }
    above = _without_circles(above)
    classes = {cls: number for number, cls in enumerate(dict.fromkeys(body.cls for body in world.bodies))}
    rows = []
    for body in world.bodies:
        parent, link, joint_id = above.get(body.id, (BodyId(""), Link.NONE, None))
        rows.append(
            OutlineRow(
                id=body.id,
                label=body.label or "",
                cls=classes[body.cls],
                parent=numbers.get(parent, -1),
                link=link,
                joint=joint_id,
                movable=body.physics.simulates,
                encloses=body.id in shells,
            )
        )
    return Outline(
        name=world.name or local_name(world.iri),
        engine=engine,
        classes=tuple(map(local_name, classes)),
        rows=tuple(rows),
        joints=sum(any(reach != 0.0 for reach in reaches(joint)) for joint in world.constraints),
    )


def _simulates(world: World, numbers: Mapping[BodyId, int], id: BodyId) -> bool:
    return id in numbers and world.bodies[numbers[id]].physics.simulates


def _without_circles(
    above: Mapping[BodyId, tuple[BodyId, Link, BodyId | None]],
) -> dict[BodyId, tuple[BodyId, Link, BodyId | None]]:
    """Joints may go round in a circle, which has no top; the last link of it is left out."""
    kept: dict[BodyId, tuple[BodyId, Link, BodyId | None]] = {}
    for child, link in above.items():
        if child not in _chain(link[0], kept):
            kept[child] = link
    return kept


def _chain(id: BodyId, above: Mapping[BodyId, tuple[BodyId, Link, BodyId | None]]) -> Iterable[BodyId]:
    seen = dict.fromkeys([id])
    while id in above and above[id][0] not in seen:
        id = above[id][0]
        seen[id] = None
    return seen
