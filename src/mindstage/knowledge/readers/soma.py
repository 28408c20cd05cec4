"""Dialect 5, SOMA (KnowRob 2): objects that have a localization, a shape and a colour, each a thing of its own.

Poses are x y z and a quaternion x y z w; a joint hangs on its parent link, and its class says how far it goes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from mindstage.knowledge.names import local_name
from mindstage.knowledge.readers.numbers import Numbers
from mindstage.knowledge.readers.rewording import Rewording
from mindstage.knowledge.readers.soma_joints import join_all
from mindstage.knowledge.readers.soma_nodes import Node, Nodes
from mindstage.knowledge.reading.conventions import QuaternionOrder
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.reading.other_words import (
    HAS_COLOUR,
    HAS_LOCALIZATION,
    HAS_SHAPE,
    TO_PARTS,
    TO_WHOLES,
    dul,
    soma,
)
from mindstage.knowledge.vocabulary import CHILD, HAS_POSE, MATERIAL, PARENT, knowrob
from mindstage.knowledge.wording import words
from mindstage.world import Iri, Material, Pose, Reference, ShapeKind, World
from mindstage.world.geometry import Array, compose, pose_from, unit_pose

__all__ = ["is_soma", "read_soma"]

_POSITION = (knowrob("translation"), soma("hasPositionVector"), soma("translation"))
_ROTATION = (knowrob("quaternion"), soma("hasOrientationVector"), soma("quaternion"))
_RELATIVE_TO = (
    *(soma("isDescribedRelativeTo"), soma("isRelativeTo"), soma("hasReferenceFrame"), soma("relativeTo")),
    *(knowrob("isDescribedRelativeTo"), knowrob("relativeTo"), knowrob("hasReferenceFrame")),
)
_COLOUR = (soma("hasRGBValue"), soma("hasRGBAValue"), knowrob("hasRGBValue"))
_RADIUS, _LENGTH, _PATH = soma("hasRadius"), soma("hasLength"), (soma("hasFilePath"), knowrob("pathToCadModel"))
_EXTENTS = tuple((soma(name),) for name in ("hasDepth", "hasWidth", "hasHeight"))
_MEASURES = (_RADIUS, *(property for properties in _EXTENTS for property in properties))
_PARTS_AND_WHOLES = frozenset((*TO_PARTS, *TO_WHOLES))
_REGION = (soma("hasSpaceRegion"), dul("hasRegion"))


def is_soma(excerpt: Excerpt) -> bool:
    """Whether something in the map has a place that only this dialect understands."""
    return any(_is_unplaced(excerpt, member) for member in excerpt.members)


def read_soma(excerpt: Excerpt) -> World:
    """Reads a map of dialect 5."""
    with np.errstate(over="ignore", invalid="ignore"):  # what becomes of too large numbers is looked at afterwards
        return _read(Rewording(excerpt))


def _read(rewording: Rewording) -> World:
    reading, excerpt = _Reading(rewording), rewording.excerpt
    unplaced = [member for member in excerpt.members if _is_unplaced(excerpt, member)]
    reading.place(unplaced)
    for individual in rewording.poses:
        reading.measure(individual)
        reading.paint(individual)
    reading.numbers.tell(rewording, quaternions=True)
    reading.remember_the_others()
    join_all(rewording, reading.nodes, reading.numbers)
    reading.attach()
    rewording.let_move()
    return rewording.world()


def _is_unplaced(excerpt: Excerpt, individual: Iri) -> bool:
    told = {fact.property for fact in excerpt.graph.get(individual, ())}
    return HAS_LOCALIZATION in told and HAS_POSE not in told


class _Reading:
    """One map on its way into the words of dialect 1."""

    def __init__(self, rewording: Rewording) -> None:
        self.rewording = rewording
        self.nodes = Nodes(rewording.excerpt.graph, rewording.members)
        self.numbers = Numbers(rewording.excerpt.conventions, order=QuaternionOrder.XYZW)

    # -- where ---------------------------------------------------------------------------------------------------------

    def place(self, individuals: list[Iri]) -> None:
        """Says where things are, those told relative to others among them."""
        told: dict[Iri, Pose] = {}
        frames: dict[Iri, Iri] = {}
        for individual in individuals:
            found = self._pose(individual)
            if found is not None:
                told[individual] = found[0]
                if frame := self._frame(individual, found[1]):
                    frames[individual] = frame
        for individual, pose in self._in_the_map(told, frames).items():
            self.rewording.place(individual, pose)

    def _pose(self, individual: Iri) -> tuple[Pose, list[Node]] | None:
        here = self.nodes.of(individual)
        way = list(self.nodes.below(here, HAS_LOCALIZATION))
        for node in way:
            if not (node.told(*_POSITION) and node.told(*_ROTATION)):
                continue
            position, rotation = node.numbers(*_POSITION), node.numbers(*_ROTATION)
            if len(position) == 3 and len(rotation) == 4 and any(rotation):
                x, y, z = position
                return self.numbers.pose(Pose((x, y, z), self.numbers.quaternion(rotation))), way
            what = "its pose is not three finite numbers, and four that are not all 0"
            self.rewording.warn(individual, HAS_LOCALIZATION, what, "it tells no place")
            return None
        self.rewording.warn(individual, HAS_LOCALIZATION, "no pose hangs on it", "it tells no place")
        return None

    def _frame(self, individual: Iri, way: list[Node]) -> Iri | None:
        """The thing that the pose is told relative to, if there is one."""
        for value in (value for node in way for value in node.values(*_RELATIVE_TO)):
            if isinstance(value, Reference) and value.iri in self.rewording.members and value.iri != individual:
                return value.iri
            name = local_name(value.iri) if isinstance(value, Reference) else words.text_in(value) or ""
            if name.strip("/").lower() not in {"map", "world", "odom", local_name(self.rewording.excerpt.map).lower()}:
                what = f"its pose is told relative to {name!r}, which has no place in this map"
                self.rewording.warn(individual, HAS_LOCALIZATION, what, "it is taken as told in the frame of the map")
        return None

    def _in_the_map(self, told: dict[Iri, Pose], frames: Mapping[Iri, Iri]) -> Mapping[Iri, Pose]:
        """Poses told relative to other things, in the frame of the map; each way is gone once."""
        rows: dict[Iri, Array] = {individual: unit_pose(told[individual]) for individual in told.keys() - frames.keys()}
        lost: dict[Iri, Iri] = {}
        """By individual, where the way from it ends without having led anywhere."""
        for start in frames:
            way: dict[Iri, None] = {}
            here = start
            while here in frames and here not in rows and here not in lost and here not in way:
                way[here] = None
                here = frames[here]
            for individual in reversed(way):
                if (base := rows.get(frames[individual])) is None:
                    lost[individual] = lost.get(here, here)
                else:
                    rows[individual] = compose(base, unit_pose(told[individual]))
        for individual, end in lost.items():
            what = f"its pose is told relative to {local_name(end)}, which leads nowhere"
            self.rewording.warn(individual, HAS_LOCALIZATION, what, "it is taken as told in the frame of the map")
        return told | {each: pose_from(rows[each]) for each in frames if each in rows}

    def remember_the_others(self) -> None:
        """Things that are placed in the words of dialect 1 can be joined and attached too."""
        for member in self.rewording.members:
            if member not in self.rewording.poses:
                for node in self.nodes.below(self.nodes.of(member), HAS_POSE, depth=1):
                    position, rotation = node.numbers(*_POSITION), node.numbers(*_ROTATION)
                    if len(position) == 3 and len(rotation) == 4 and any(rotation):
                        x, y, z = position
                        w, i, j, k = rotation
                        self.rewording.poses[member] = Pose((x, y, z), (w, i, j, k))

    # -- what it looks like --------------------------------------------------------------------------------------------

    def measure(self, individual: Iri) -> None:
        """Says how large something is, and of what form."""
        shapes = list(self._regions(individual, HAS_SHAPE))
        if not shapes:
            return
        told = ((node, self._extents(node)) for node in shapes)
        shape, extents = next((each for each in told if each[1]), (None, ()))
        if shape is not None:
            self.rewording.measure(individual, self.numbers.lengths(extents))
            kind = ShapeKind.BOX
            if shape.told(_RADIUS):
                kind = ShapeKind.SPHERE if extents[0] == extents[2] and not shape.told(_LENGTH) else ShapeKind.CYLINDER
            if kind is not ShapeKind.BOX and self.rewording.told(individual, words.SHAPE) is None:
                self.rewording.shape(individual, kind)
        path = next((text for node in shapes for value in node.values(*_PATH) if (text := words.text_in(value))), None)
        if path is not None and self.rewording.told(individual, words.MESH) is None:
            self.rewording.mesh(individual, path)
        if shape is None and path is None:
            what = "its shape has no extents of 0 or more, no radius and no mesh"
            self.rewording.warn(individual, HAS_SHAPE, what, "it has no size")

    def _extents(self, node: Node) -> tuple[float, ...]:
        """Along x, y and z; nothing, where one of them is missing or makes no sense."""
        if not node.told(*_MEASURES):
            return ()
        radius = node.number(_RADIUS)
        if radius is not None:
            length = node.number(_LENGTH, *_EXTENTS[2])
            extents = [2 * radius, 2 * radius, 2 * radius if length is None else length]
        else:
            told = [node.number(*properties) for properties in _EXTENTS]
            extents = [extent for extent in told if extent is not None]
        return tuple(extents) if len(extents) == 3 and min(extents) >= 0.0 else ()

    def paint(self, individual: Iri) -> None:
        """Says what colour something has."""
        if self.rewording.values(individual, MATERIAL):
            return
        for node in self._regions(individual, HAS_COLOUR):
            if not node.told(*_COLOUR):
                continue
            told = node.numbers(*_COLOUR)
            if len(told) not in (3, 4) or min(told) < 0.0 or max(told[:3]) > 255.0:
                what = "its colour is not three or four numbers from 0 to 1, or to 255"
                self.rewording.warn(individual, HAS_COLOUR, what, "it has none")
                return
            red, green, blue = (part / 255.0 if max(told[:3]) > 1.0 else part for part in told[:3])
            self.rewording.paint(individual, [Material(name="colour", colour=(red, green, blue))])
            return

    def _regions(self, individual: Iri, property: Iri) -> Iterator[Node]:
        return self.nodes.below(self.nodes.of(individual), property)

    # -- what hangs together -------------------------------------------------------------------------------------------

    def attach(self) -> None:
        """Says that parts go with their wholes, unless a joint lets them move."""
        rewording = self.rewording
        hanging = {child for member in rewording.members for child in rewording.references(member, CHILD)}
        hanging |= {member for member in rewording.members if rewording.references(member, PARENT)}
        pairs: dict[tuple[Iri, Iri], Iri] = {}
        for member in rewording.members:
            for fact in rewording.graph.get(member, ()):
                property, other = fact.property, fact.value
                if property not in _PARTS_AND_WHOLES or not isinstance(other, Reference):
                    continue
                pair = (member, other.iri) if property in TO_PARTS else (other.iri, member)
                if other.iri in rewording.poses and member in rewording.poses:
                    pairs.setdefault(pair, property)
                else:
                    what = f"{other.iri} is no body of this map"
                    rewording.warn(member, property, what, "the relation stays a fact")
        for whole, part in pairs:
            if rewording.may_go_together(whole, part) and part not in hanging:
                rewording.attach(whole, part)
