"""Dialect 5, SOMA (KnowRob 2): objects that have a localization, a shape and a color, each a thing of its own.

Poses are x y z and a quaternion x y z w; a joint hangs on its parent link, and its class says how far it goes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from mindstage.knowledge.names import local_name
from mindstage.knowledge.readers.numbers import NumberReader
from mindstage.knowledge.readers.rewording import DialectNormalizer
from mindstage.knowledge.readers.soma_joints import add_joints
from mindstage.knowledge.readers.soma_nodes import RdfNode, RdfNodes
from mindstage.knowledge.reading.conventions import QuaternionOrder
from mindstage.knowledge.reading.excerpt import SourceMap
from mindstage.knowledge.reading.other_words import (
    HAS_COLOR,
    HAS_LOCALIZATION,
    HAS_SHAPE,
    TO_PARTS,
    TO_WHOLES,
    dul,
    soma,
)
from mindstage.knowledge.vocabulary import CHILD, HAS_POSE, MATERIAL, PARENT, knowrob
from mindstage.knowledge.wording import words
from mindstage.world import Iri, IriRef, Material, Pose, PrimitiveType, World
from mindstage.world.geometry import Array, normalized_pose_array, pose_from_array, pose_multiply

__all__ = ["is_soma", "read_soma"]

_POSITION = (knowrob("translation"), soma("hasPositionVector"), soma("translation"))
_ROTATION = (knowrob("quaternion"), soma("hasOrientationVector"), soma("quaternion"))
_REFERENCE_FRAME = (
    *(soma("isDescribedRelativeTo"), soma("isRelativeTo"), soma("hasReferenceFrame"), soma("relativeTo")),
    *(knowrob("isDescribedRelativeTo"), knowrob("relativeTo"), knowrob("hasReferenceFrame")),
)
_COLOR = (soma("hasRGBValue"), soma("hasRGBAValue"), knowrob("hasRGBValue"))
_RADIUS, _LENGTH, _PATH = soma("hasRadius"), soma("hasLength"), (soma("hasFilePath"), knowrob("pathToCadModel"))
_EXTENTS = tuple((soma(name),) for name in ("hasDepth", "hasWidth", "hasHeight"))
_SIZE_PROPERTIES = (_RADIUS, *(property for properties in _EXTENTS for property in properties))
_PART_RELATIONS = frozenset((*TO_PARTS, *TO_WHOLES))
_REGION = (soma("hasSpaceRegion"), dul("hasRegion"))


def is_soma(source_map: SourceMap) -> bool:
    """Whether something in the map has a place that only this dialect understands."""
    return any(_lacks_pose(source_map, member) for member in source_map.members)


def read_soma(source_map: SourceMap) -> World:
    """Reads a map of dialect 5."""
    with np.errstate(over="ignore", invalid="ignore"):  # what becomes of too large numbers is looked at afterwards
        return _read_normalized(DialectNormalizer(source_map))


def _read_normalized(normalizer: DialectNormalizer) -> World:
    reading, excerpt = _SomaReader(normalizer), normalizer.source_map
    unplaced = [member for member in excerpt.members if _lacks_pose(excerpt, member)]
    reading.set_poses(unplaced)
    for individual in normalizer.poses:
        reading.set_size(individual)
        reading.set_color(individual)
    reading.number_reader.report_assumptions(normalizer, quaternions=True)
    reading.add_existing_poses()
    add_joints(normalizer, reading.nodes, reading.number_reader)
    reading.attach_parts()
    normalizer.make_jointed_dynamic()
    return normalizer.world()


def _lacks_pose(source_map: SourceMap, individual: Iri) -> bool:
    told = {fact.property for fact in source_map.graph.get(individual, ())}
    return HAS_LOCALIZATION in told and HAS_POSE not in told


class _SomaReader:
    """One map on its way into the words of dialect 1."""

    def __init__(self, normalizer: DialectNormalizer) -> None:
        self.normalizer = normalizer
        self.nodes = RdfNodes(normalizer.source_map.graph, normalizer.members)
        self.number_reader = NumberReader(normalizer.source_map.conventions, order=QuaternionOrder.XYZW)

    # -- where ---------------------------------------------------------------------------------------------------------

    def set_poses(self, individuals: list[Iri]) -> None:
        """Says where things are, those told relative to others among them."""
        told: dict[Iri, Pose] = {}
        frames: dict[Iri, Iri] = {}
        for individual in individuals:
            found = self._pose(individual)
            if found is not None:
                told[individual] = found[0]
                if frame := self._reference_frame(individual, found[1]):
                    frames[individual] = frame
        for individual, pose in self._to_map_frame(told, frames).items():
            self.normalizer.set_pose(individual, pose)

    def _pose(self, individual: Iri) -> tuple[Pose, list[RdfNode]] | None:
        here = self.nodes.node_named(individual)
        way = list(self.nodes.descendants(here, HAS_LOCALIZATION))
        for node in way:
            if not (node.has(*_POSITION) and node.has(*_ROTATION)):
                continue
            position, rotation = node.numbers(*_POSITION), node.numbers(*_ROTATION)
            if len(position) == 3 and len(rotation) == 4 and any(rotation):
                x, y, z = position
                return self.number_reader.pose(Pose((x, y, z), self.number_reader.quaternion(rotation))), way
            what = "its pose is not three finite numbers, and four that are not all 0"
            self.normalizer.warn(individual, HAS_LOCALIZATION, what, "it tells no place")
            return None
        self.normalizer.warn(individual, HAS_LOCALIZATION, "no pose hangs on it", "it tells no place")
        return None

    def _reference_frame(self, individual: Iri, path: list[RdfNode]) -> Iri | None:
        """The thing that the pose is told relative to, if there is one."""
        for value in (value for node in path for value in node.values(*_REFERENCE_FRAME)):
            if isinstance(value, IriRef) and value.iri in self.normalizer.members and value.iri != individual:
                return value.iri
            name = local_name(value.iri) if isinstance(value, IriRef) else words.literal_text(value) or ""
            if name.strip("/").lower() not in {
                "map",
                "world",
                "odom",
                local_name(self.normalizer.source_map.map).lower(),
            }:
                what = f"its pose is told relative to {name!r}, which has no place in this map"
                self.normalizer.warn(individual, HAS_LOCALIZATION, what, "it is taken as told in the frame of the map")
        return None

    def _to_map_frame(self, poses: dict[Iri, Pose], parents: Mapping[Iri, Iri]) -> Mapping[Iri, Pose]:
        """Poses told relative to other things, in the frame of the map; each way is gone once."""
        rows: dict[Iri, Array] = {
            individual: normalized_pose_array(poses[individual]) for individual in poses.keys() - parents.keys()
        }
        lost: dict[Iri, Iri] = {}
        """By individual, where the way from it ends without having led anywhere."""
        for start in parents:
            way: dict[Iri, None] = {}
            here = start
            while here in parents and here not in rows and here not in lost and here not in way:
                way[here] = None
                here = parents[here]
            for individual in reversed(way):
                if (base := rows.get(parents[individual])) is None:
                    lost[individual] = lost.get(here, here)
                else:
                    rows[individual] = pose_multiply(base, normalized_pose_array(poses[individual]))
        for individual, end in lost.items():
            what = f"its pose is told relative to {local_name(end)}, which leads nowhere"
            self.normalizer.warn(individual, HAS_LOCALIZATION, what, "it is taken as told in the frame of the map")
        return poses | {each: pose_from_array(rows[each]) for each in parents if each in rows}

    def add_existing_poses(self) -> None:
        """Things that are placed in the words of dialect 1 can be joined and attached too."""
        for member in self.normalizer.members:
            if member not in self.normalizer.poses:
                for node in self.nodes.descendants(self.nodes.node_named(member), HAS_POSE, depth=1):
                    position, rotation = node.numbers(*_POSITION), node.numbers(*_ROTATION)
                    if len(position) == 3 and len(rotation) == 4 and any(rotation):
                        x, y, z = position
                        w, i, j, k = rotation
                        self.normalizer.poses[member] = Pose((x, y, z), (w, i, j, k))

    # -- what it looks like --------------------------------------------------------------------------------------------

    def set_size(self, individual: Iri) -> None:
        """Says how large something is, and of what form."""
        shapes = list(self._nodes_of(individual, HAS_SHAPE))
        if not shapes:
            return
        told = ((node, self._extents(node)) for node in shapes)
        shape, extents = next((each for each in told if each[1]), (None, ()))
        if shape is not None:
            self.normalizer.set_size(individual, self.number_reader.lengths(extents))
            kind = PrimitiveType.BOX
            if shape.has(_RADIUS):
                kind = (
                    PrimitiveType.SPHERE
                    if extents[0] == extents[2] and not shape.has(_LENGTH)
                    else PrimitiveType.CYLINDER
                )
            if kind is not PrimitiveType.BOX and self.normalizer.first_value(individual, words.SHAPE) is None:
                self.normalizer.set_shape(individual, kind)
        path = next(
            (text for node in shapes for value in node.values(*_PATH) if (text := words.literal_text(value))), None
        )
        if path is not None and self.normalizer.first_value(individual, words.MESH) is None:
            self.normalizer.set_mesh(individual, path)
        if shape is None and path is None:
            what = "its shape has no extents of 0 or more, no radius and no mesh"
            self.normalizer.warn(individual, HAS_SHAPE, what, "it has no size")

    def _extents(self, node: RdfNode) -> tuple[float, ...]:
        """Along x, y and z; nothing, where one of them is missing or makes no sense."""
        if not node.has(*_SIZE_PROPERTIES):
            return ()
        radius = node.number(_RADIUS)
        if radius is not None:
            length = node.number(_LENGTH, *_EXTENTS[2])
            extents = [2 * radius, 2 * radius, 2 * radius if length is None else length]
        else:
            told = [node.number(*properties) for properties in _EXTENTS]
            extents = [extent for extent in told if extent is not None]
        return tuple(extents) if len(extents) == 3 and min(extents) >= 0.0 else ()

    def set_color(self, individual: Iri) -> None:
        """Says what color something has."""
        if self.normalizer.values(individual, MATERIAL):
            return
        for node in self._nodes_of(individual, HAS_COLOR):
            if not node.has(*_COLOR):
                continue
            told = node.numbers(*_COLOR)
            if len(told) not in (3, 4) or min(told) < 0.0 or max(told[:3]) > 255.0:
                what = "its colour is not three or four numbers from 0 to 1, or to 255"
                self.normalizer.warn(individual, HAS_COLOR, what, "it has none")
                return
            red, green, blue = (part / 255.0 if max(told[:3]) > 1.0 else part for part in told[:3])
            self.normalizer.set_materials(individual, [Material(name="colour", color=(red, green, blue))])
            return

    def _nodes_of(self, individual: Iri, property: Iri) -> Iterator[RdfNode]:
        return self.nodes.descendants(self.nodes.node_named(individual), property)

    # -- what hangs together -------------------------------------------------------------------------------------------

    def attach_parts(self) -> None:
        """Says that parts go with their wholes, unless a joint lets them move."""
        rewording = self.normalizer
        hanging = {child for member in rewording.members for child in rewording.references(member, CHILD)}
        hanging |= {member for member in rewording.members if rewording.references(member, PARENT)}
        pairs: dict[tuple[Iri, Iri], Iri] = {}
        for member in rewording.members:
            for fact in rewording.graph.get(member, ()):
                property, other = fact.property, fact.value
                if property not in _PART_RELATIONS or not isinstance(other, IriRef):
                    continue
                pair = (member, other.iri) if property in TO_PARTS else (other.iri, member)
                if other.iri in rewording.poses and member in rewording.poses:
                    pairs.setdefault(pair, property)
                else:
                    what = f"{other.iri} is no body of this map"
                    rewording.warn(member, property, what, "the relation stays a fact")
        for whole, part in pairs:
            if rewording.can_attach(whole, part) and part not in hanging:
                rewording.attach(whole, part)
