"""Dialect 5, SOMA (KnowRob 2): objects that have a localization, a shape and a color, each a thing of its own.

Poses are x y z and a quaternion x y z w; a joint hangs on its parent link, and its class says how far it goes.

SOMA's joints: things without a name on their parent link, whose classes say what they do and how far.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mindstage.knowledge.dialects.conventions import QuaternionOrder
from mindstage.knowledge.dialects.joints import (
    JointLimits,
    JointRange,
    JointType,
    ObservedBox,
    infer_hinge_axis,
    infer_prismatic_axis,
    joint_from_axis,
)
from mindstage.knowledge.dialects.membership import types_of
from mindstage.knowledge.dialects.normalize import DialectNormalizer, abbreviated_names
from mindstage.knowledge.dialects.poses import NumberReader
from mindstage.knowledge.dialects.soma_nodes import RdfNode, RdfNodes
from mindstage.knowledge.dialects.source_map import SourceMap
from mindstage.knowledge.rdf import local_name
from mindstage.knowledge.rdf_mapping import properties as words
from mindstage.knowledge.vocabulary import (
    CHILD,
    HAS_COLOR,
    HAS_JOINT,
    HAS_LINEAR,
    HAS_LOCALIZATION,
    HAS_POSE,
    HAS_SHAPE,
    HAS_VALUE,
    MATERIAL,
    ON_PROPERTY,
    PARENT,
    SUBCLASS_OF,
    TO_PARTS,
    TO_WHOLES,
    dul,
    knowrob,
    soma,
    urdf,
)
from mindstage.scene import Iri, IriRef, Material, Pose, PrimitiveType, World
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array, pose_multiply, quat_rotate

__all__ = ["add_joints", "is_soma", "read_soma"]


_JOINT_TYPES = {
    "PrismaticJoint": JointType.PRISMATIC,
    "RevoluteJoint": JointType.REVOLUTE,
    "HingedJoint": JointType.REVOLUTE,
    "HingeJoint": JointType.REVOLUTE,
    "ContinuousJoint": JointType.REVOLUTE,
    "FixedJoint": JointType.FIXED,
    "FloatingJoint": JointType.FLOATING,
    "PlanarJoint": JointType.PLANAR,
}
_CONTINUOUS = "ContinuousJoint"
_PARENT_LINK, _CHILD_LINK = (urdf("hasParentLink"), soma("hasParentLink")), (urdf("hasChildLink"), soma("hasChildLink"))
_LIMITS = (urdf("hasJointLimits"), soma("hasJointLimit"), soma("hasJointLimits"))
_LOWER = (urdf("hasLowerLimit"), urdf("hasJointPositionMin"), soma("hasJointPositionMin"))
_UPPER = (urdf("hasUpperLimit"), urdf("hasJointPositionMax"), soma("hasJointPositionMax"))
_AXIS = (urdf("hasAxisVector"), urdf("hasJointAxis"), urdf("hasAxis"))
_ORIGIN, _XYZ = urdf("hasOrigin"), (urdf("hasXYZ"), urdf("hasTranslation"))


def add_joints(normalizer: DialectNormalizer, nodes: RdfNodes, number_reader: NumberReader) -> None:
    """Says of every joint what it joins and how."""
    joining = _SomaJointReader(normalizer, nodes, number_reader)
    for owner in list(normalizer.members):
        for value in normalizer.values(owner, HAS_JOINT):
            node = nodes.node_from_value(value)
            if node is None:
                normalizer.warn(owner, HAS_JOINT, "its joint is not described anywhere", "it stays a fact")
            elif not node.has(HAS_LINEAR):
                joining.add_joint(owner, node)
    joining.report_inferred()


class _SomaJointReader:
    """All joints of a map."""

    def __init__(self, normalizer: DialectNormalizer, nodes: RdfNodes, number_reader: NumberReader) -> None:
        self.normalizer, self.nodes, self.number_reader = normalizer, nodes, number_reader
        self.existing_pairs = frozenset(normalizer.joined_pairs)
        self.inferred: dict[str, list[Iri]] = {}
        self._ancestor_cache: dict[tuple[Iri, ...], Sequence[Iri]] = {}

    def add_joint(self, owner: Iri, node: RdfNode) -> None:
        """Says what one joint joins, and how."""
        parent, child = self._referenced_iri(node, _PARENT_LINK) or owner, self._referenced_iri(node, _CHILD_LINK)
        for end, role in ((parent, _PARENT_LINK), (child, _CHILD_LINK)):
            if end not in self.normalizer.poses:
                name = "it" if end is None else end
                what = f"one end of its joint is missing: {name} is no body of this map"
                self.normalizer.warn(owner, role[0], what, "the joint stays a fact")
                return
        assert child is not None
        if parent == child:
            self.normalizer.warn(owner, HAS_JOINT, "its joint joins it to itself", "the joint stays a fact")
            return
        if frozenset((parent, child)) in self.existing_pairs:
            return  # it is told in the words of dialect 1 already
        if frozenset((parent, child)) in self.normalizer.joined_pairs:
            self.normalizer.warn(
                owner, HAS_JOINT, f"a second joint joins it with {local_name(child)}", "it stays a fact"
            )
            return
        kinds = self._class_names(node)
        kind = next((_JOINT_TYPES[name] for name in kinds if name in _JOINT_TYPES), None)
        if kind is None:
            what = f"{', '.join(node.types()) or 'a joint without class'} is no known kind of joint"
            self.normalizer.warn(owner, HAS_JOINT, what, "it holds its two ends together")
        range = (
            self._range(owner, node)
            if kind in (JointType.REVOLUTE, JointType.PRISMATIC) and _CONTINUOUS not in kinds
            else None
        )
        joint = self._joint_limits(node, kind or JointType.FIXED, range, parent, child)
        self.normalizer.add_joint(owner, parent, child, joint, name=node.name)

    def report_inferred(self) -> None:
        """Says aloud what joints do not tell."""
        for what, children in self.inferred.items():
            evidence = f"{len(children)} joints do not tell it, such as those of {abbreviated_names(children)}"
            self.normalizer.source_map.record_assumption(f"joints: {what}", "from where things stand", evidence)

    def _referenced_iri(self, node: RdfNode, properties: Sequence[Iri]) -> Iri | None:
        return next((value.iri for value in node.values(*properties) if isinstance(value, IriRef)), None)

    def _classes(self, node: RdfNode) -> Sequence[Iri]:
        """The classes of a joint, and those above them, the nearest first."""
        types = types_of(node.facts)
        if types not in self._ancestor_cache:
            classes = dict.fromkeys(types)
            for cls in types:
                classes |= dict.fromkeys(self.normalizer.source_map.hierarchy.ancestors(cls))
            self._ancestor_cache[types] = tuple(classes)
        return self._ancestor_cache[types]

    def _class_names(self, node: RdfNode) -> list[str]:
        return [local_name(cls) for cls in self._classes(node)]

    def _range(self, owner: Iri, node: RdfNode) -> JointRange:
        """From the joint itself, or from the nearest of its classes that says it of all its members."""
        for limits in self._limits(node):
            lower, upper = limits.number(*_LOWER), limits.number(*_UPPER)
            if lower is None or upper is None:
                self.normalizer.warn(owner, _LIMITS[0], "its limits are not two finite numbers", "they limit nothing")
                continue
            if lower > upper:
                what = f"its lower limit {lower:g} is above its upper limit {upper:g}"
                self.normalizer.warn(owner, _LOWER[0], what, "the two are taken the other way round")
                lower, upper = upper, lower
            if JointType.PRISMATIC in (_JOINT_TYPES.get(name) for name in self._class_names(node)):
                lower, upper = self.number_reader.lengths((lower, upper))
            return lower, upper
        self.normalizer.warn(owner, _LIMITS[0], "its joint has no limits", "it may move without end")
        return None

    def _limits(self, node: RdfNode) -> list[RdfNode]:
        found = list(self.nodes.descendants(node, *_LIMITS, depth=1))
        for cls in self._classes(node):
            for restriction in self.nodes.descendants(self.nodes.node_named(cls), SUBCLASS_OF, depth=1):
                on = self._referenced_iri(restriction, (ON_PROPERTY,))
                if on in _LIMITS:
                    found += self.nodes.descendants(restriction, HAS_VALUE, depth=1)
        return found

    def _joint_limits(
        self, node: RdfNode, joint_type: JointType, range: JointRange, parent: Iri, child: Iri
    ) -> JointLimits:
        base = self._box(parent)
        origin, axis = self._origin(node, base), self._axis(node, base)
        turns = joint_type in (JointType.REVOLUTE, JointType.PRISMATIC)
        if turns and (axis is None or (origin is None and joint_type is JointType.REVOLUTE)):
            handle = self._find_handle(child)
            if joint_type is JointType.REVOLUTE:
                likely = infer_hinge_axis(base, self._box(child), handle, range, origin=origin)
            else:
                likely = infer_prismatic_axis(base, self._box(child), handle)
            for what, told in (("where they are", origin), ("which way they go", axis)):
                if told is None:
                    self.inferred.setdefault(what, []).append(child)
            origin = likely.origin if origin is None else origin
            axis = likely.axis if axis is None else axis
        origin = self._box(child).center if origin is None else origin
        return joint_from_axis(joint_type, origin, np.array([1.0, 0.0, 0.0]) if axis is None else axis, range)

    def _axis(self, node: RdfNode, base: ObservedBox) -> Array | None:
        """As in a robot's description, told in the frame of the parent link."""
        axis = next((row for each in self._with_axis_nodes(node) if len(row := each.numbers(*_AXIS)) == 3), ())
        if not any(axis):
            return None
        return quat_rotate(normalized_pose_array(base.pose)[3:], self.number_reader.direction(axis))

    def _origin(self, node: RdfNode, base: ObservedBox) -> Array | None:
        row = next((row for each in self.nodes.descendants(node, _ORIGIN) if len(row := each.numbers(*_XYZ)) == 3), ())
        if not row:
            return None
        way = self.number_reader.direction(self.number_reader.lengths(row))
        return base.center + quat_rotate(normalized_pose_array(base.pose)[3:], way)

    def _with_axis_nodes(self, node: RdfNode) -> list[RdfNode]:
        return [node, *self.nodes.descendants(node, *_AXIS, depth=1)]

    def _box(self, body: Iri) -> ObservedBox:
        return ObservedBox(self.normalizer.poses[body], self.normalizer.sizes.get(body))

    def _find_handle(self, child: Iri) -> ObservedBox | None:
        """The part of a child that it is likely pulled by."""
        parts = [part for part in self.normalizer.references(child, *TO_PARTS) if part in self.normalizer.poses]
        parts.sort(key=lambda part: not self.normalizer.class_name_contains(part, "Handle"))
        return self._box(parts[0]) if parts else None


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
