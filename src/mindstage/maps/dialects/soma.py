"""Dialect 5, SOMA (KnowRob 2): objects whose localization, shape and color are separate RDF nodes.

A pose is a position x y z and a quaternion x y z w. A joint is a node of its parent link; its kind and its limits come
from its class. What is read is added in the vocabulary of dialect 1 by `DialectNormalizer`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mindstage.maps.dialects.conventions import QuaternionOrder
from mindstage.maps.dialects.joint_ends import JointEnds
from mindstage.maps.dialects.joints import (
    HingeEvidence,
    InferredAxis,
    JointLimits,
    JointRange,
    JointType,
    infer_hinge_axis,
    infer_prismatic_axis,
    joint_from_axis,
    opening_range,
)
from mindstage.maps.dialects.membership import types_of
from mindstage.maps.dialects.normalize import DialectNormalizer
from mindstage.maps.dialects.poses import NumberReader
from mindstage.maps.dialects.soma_nodes import LENGTH, RADIUS, RdfNode, RdfNodes, extents_of
from mindstage.maps.dialects.source_map import Dialect, SourceMap
from mindstage.maps.dialects.units import decide_quaternion_order, guess_units
from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import (
    HAS_COLOR,
    HAS_JOINT,
    HAS_LINEAR,
    HAS_LOCALIZATION,
    HAS_POSE,
    HAS_SHAPE,
    HAS_VALUE,
    MATERIAL,
    ON_PROPERTY,
    SUBCLASS_OF,
    TO_PARTS,
    TO_WHOLES,
    knowrob,
    soma,
    urdf,
)
from mindstage.scene import Iri, IriRef, Material, Pose, PrimitiveType, World
from mindstage.scene.joint_kinematics import ObservedBox
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array, pose_multiply, quat_rotate

__all__ = ["SOMA", "add_joints", "is_soma", "read_soma"]


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


_POSITION = (knowrob("translation"), soma("hasPositionVector"), soma("translation"))
_ROTATION = (knowrob("quaternion"), soma("hasOrientationVector"), soma("quaternion"))
_REFERENCE_FRAME = (
    *(soma("isDescribedRelativeTo"), soma("isRelativeTo"), soma("hasReferenceFrame"), soma("relativeTo")),
    *(knowrob("isDescribedRelativeTo"), knowrob("relativeTo"), knowrob("hasReferenceFrame")),
)
_COLOR = (soma("hasRGBValue"), soma("hasRGBAValue"), knowrob("hasRGBValue"))
_PATH = (soma("hasFilePath"), knowrob("pathToCadModel"))
_PART_RELATIONS = frozenset((*TO_PARTS, *TO_WHOLES))


def add_joints(normalizer: DialectNormalizer, nodes: RdfNodes, number_reader: NumberReader) -> None:
    """Adds every joint of a map to the normalizer, with the bodies that it connects and its motion."""
    reader = _SomaJointReader(normalizer, nodes, number_reader)
    for owner in list(normalizer.members):
        for value in normalizer.values(owner, HAS_JOINT):
            node = nodes.node_from_value(value)
            if node is None:
                normalizer.warn(owner, HAS_JOINT, "its joint is not described anywhere", "it is kept as a fact")
            elif not node.has(HAS_LINEAR):
                reader.add_joint(owner, node)
    normalizer.record_inferred(reader.inferred, reader.evidence, of="those of ")
    reader.ends.record_carried()


class _SomaJointReader:
    """Reads the joints of a map."""

    def __init__(self, normalizer: DialectNormalizer, nodes: RdfNodes, number_reader: NumberReader) -> None:
        self.normalizer, self.nodes, self.number_reader = normalizer, nodes, number_reader
        self.existing_pairs = frozenset(normalizer.joined_pairs)
        self.inferred: dict[str, list[Iri]] = {}
        self.evidence: list[str] = []
        self.ends = JointEnds(normalizer)
        self._ancestor_cache: dict[tuple[Iri, ...], Sequence[Iri]] = {}

    def add_joint(self, owner: Iri, node: RdfNode) -> None:
        """Adds one joint; one whose bodies are missing or already joined is reported and omitted."""
        parent, child = self._referenced_iri(node, _PARENT_LINK) or owner, self._referenced_iri(node, _CHILD_LINK)
        for end, role in ((parent, _PARENT_LINK), (child, _CHILD_LINK)):
            if end not in self.normalizer.poses:
                name = "it" if end is None else end
                problem = f"one end of its joint is missing: {name} is not a body of this map"
                self.normalizer.warn(owner, role[0], problem, "the joint is kept as a fact")
                return
        assert child is not None
        if parent == child:
            self.normalizer.warn(owner, HAS_JOINT, "its joint connects it to itself", "the joint is kept as a fact")
            return
        names = self._class_names(node)
        joint_type = next((_JOINT_TYPES[name] for name in names if name in _JOINT_TYPES), None)
        link, is_swapped = parent, False
        if joint_type in (JointType.REVOLUTE, JointType.PRISMATIC):
            parent, child = self.ends.ordered(node.name, parent, child, property=HAS_JOINT, child=child)
            is_swapped = child == link
            parent, child = self.ends.carrier(joint_type, parent, child)
        if frozenset((parent, child)) in self.existing_pairs:
            return  # the joint is already given in the vocabulary of dialect 1
        if frozenset((parent, child)) in self.normalizer.joined_pairs:
            self.normalizer.warn(
                owner, HAS_JOINT, f"a second joint connects it to {local_name(child)}", "it is kept as a fact"
            )
            return
        if joint_type is None:
            problem = f"{', '.join(node.types()) or 'a joint without a class'} is an unknown type of joint"
            self.normalizer.warn(owner, HAS_JOINT, problem, "the two bodies are joined rigidly")
        range = (
            self._range(owner, node)
            if joint_type in (JointType.REVOLUTE, JointType.PRISMATIC) and _CONTINUOUS not in names
            else None
        )
        origin, axis = self._origin(node, self.normalizer.box(link)), self._axis(node, self.normalizer.box(link))
        if axis is not None and is_swapped:
            axis = -axis  # the map gives the motion of its child relative to its parent
        joint = self._joint_limits(node, joint_type or JointType.FIXED, range, (parent, child), origin, axis)
        self.normalizer.add_joint(owner, parent, child, joint, name=node.name)

    def _referenced_iri(self, node: RdfNode, properties: Sequence[Iri]) -> Iri | None:
        return next((value.iri for value in node.values(*properties) if isinstance(value, IriRef)), None)

    def _classes(self, node: RdfNode) -> Sequence[Iri]:
        """Returns the classes of a joint and their ancestors, nearest first."""
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
        """Returns the limits given by the joint, or by the nearest class that restricts them for its members."""
        for limits in self._limits(node):
            lower, upper = limits.number(*_LOWER), limits.number(*_UPPER)
            if lower is None or upper is None:
                self.normalizer.warn(owner, _LIMITS[0], "its limits are not two finite numbers", "they are ignored")
                continue
            lower, upper = self.normalizer.ordered_limits(owner, _LOWER[0], lower, upper)
            if JointType.PRISMATIC in (_JOINT_TYPES.get(name) for name in self._class_names(node)):
                lower, upper = self.number_reader.lengths((lower, upper))
            return lower, upper
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
        self,
        node: RdfNode,
        joint_type: JointType,
        range: JointRange,
        ends: tuple[Iri, Iri],
        origin: Array | None,
        axis: Array | None,
    ) -> JointLimits:
        parent, child = ends
        base, moving, handle = self.normalizer.box(parent), self.normalizer.box(child), self._find_handle(child)
        if joint_type in (JointType.REVOLUTE, JointType.PRISMATIC):
            for attribute, given in (("position", origin), ("axis", axis)):
                if given is None and (axis is None or joint_type is JointType.REVOLUTE):
                    self.inferred.setdefault(attribute, []).append(child)
                    self.normalizer.assumed.setdefault(child, []).append(attribute)
            if joint_type is JointType.REVOLUTE:
                evidence = HingeEvidence(
                    parent=base,
                    child=moving,
                    handle=handle,
                    range=range,
                    origin=origin,
                    axis=axis,
                    class_names=self.normalizer.class_names(parent, child),
                )
                inferred, conflicts = infer_hinge_axis(evidence)
                for conflict in conflicts:
                    self.normalizer.warn(
                        parent, HAS_JOINT, f"{local_name(child)}: {conflict}", "it is inferred instead"
                    )
                origin, axis = inferred.origin, inferred.axis
                self.evidence.append(f"{local_name(child)}: {inferred.evidence}")
            else:
                inferred = infer_prismatic_axis(base, moving, handle)
                inferred = inferred if axis is None else inferred._replace(opens=int(np.sign(inferred.axis @ axis)))
                origin = inferred.origin if origin is None else origin
                axis = inferred.axis if axis is None else axis
            if range is None and _CONTINUOUS not in self._class_names(node):
                range = self._missing_range(parent, joint_type, moving, inferred)
                if range is not None:
                    self.normalizer.assumed.setdefault(child, []).append("limits")
        origin = moving.center if origin is None else origin
        return joint_from_axis(joint_type, origin, np.array([1.0, 0.0, 0.0]) if axis is None else axis, range)

    def _missing_range(
        self, owner: Iri, joint_type: JointType, child: ObservedBox, inferred: InferredAxis
    ) -> JointRange:
        """Returns an assumed range of a joint without limits; None if it may move without limits."""
        assumed = opening_range(child, inferred, joint_type)
        action = "it may move without limits"
        if assumed is not None:
            unit = "m" if joint_type is JointType.PRISMATIC else "rad"
            action = f"it opens outwards, by {max(map(abs, assumed)):.3g} {unit}"
        self.normalizer.warn(owner, _LIMITS[0], "its joint has no limits", action)
        return assumed

    def _axis(self, node: RdfNode, base: ObservedBox) -> Array | None:
        """Returns the joint axis in the world frame; as in URDF, the map gives it in the frame of the parent link."""
        holders = (node, *self.nodes.descendants(node, *_AXIS, depth=1))
        axis = next((row for holder in holders if len(row := holder.numbers(*_AXIS)) == 3), ())
        if not any(axis):
            return None
        return quat_rotate(normalized_pose_array(base.pose)[3:], self.number_reader.direction(axis))

    def _origin(self, node: RdfNode, base: ObservedBox) -> Array | None:
        row = next((row for each in self.nodes.descendants(node, _ORIGIN) if len(row := each.numbers(*_XYZ)) == 3), ())
        if not row:
            return None
        offset = self.number_reader.direction(self.number_reader.lengths(row))
        return base.center + quat_rotate(normalized_pose_array(base.pose)[3:], offset)

    def _find_handle(self, child: Iri) -> ObservedBox | None:
        """Returns the part of a child that it is most likely pulled by."""
        parts = [part for part in self.normalizer.references(child, *TO_PARTS) if part in self.normalizer.poses]
        parts.sort(key=lambda part: not self.normalizer.class_name_contains(part, "Handle"))
        return self.normalizer.box(parts[0]) if parts else None


def is_soma(source_map: SourceMap) -> bool:
    """Whether some individual of the map has a pose in this dialect only."""
    return any(_lacks_pose(source_map, member) for member in source_map.members)


def read_soma(source_map: SourceMap) -> World:
    """Reads a SOMA map."""
    with np.errstate(over="ignore", invalid="ignore"):  # overflowing poses are reported afterwards
        return _read_normalized(DialectNormalizer(source_map))


def _read_normalized(normalizer: DialectNormalizer) -> World:
    reader, source_map = _SomaReader(normalizer), normalizer.source_map
    unplaced = [member for member in source_map.members if _lacks_pose(source_map, member)]
    reader.decide_conventions(unplaced)
    reader.set_poses(unplaced)
    for individual in normalizer.poses:
        reader.set_size(individual)
        reader.set_color(individual)
    reader.number_reader.report_assumptions(normalizer)
    reader.add_existing_poses()
    add_joints(normalizer, reader.nodes, reader.number_reader)
    reader.attach_parts()
    normalizer.make_jointed_dynamic()
    return normalizer.world()


def _lacks_pose(source_map: SourceMap, individual: Iri) -> bool:
    given = {fact.property for fact in source_map.graph.get(individual, ())}
    return HAS_LOCALIZATION in given and HAS_POSE not in given


def _pose_of(node: RdfNode) -> Pose | None:
    """Returns the pose in the statements about a node, with its four numbers as given; None without a valid one."""
    position, rotation = node.numbers(*_POSITION), node.numbers(*_ROTATION)
    if len(position) != 3 or len(rotation) != 4 or not any(rotation):
        return None
    (x, y, z), (a, b, c, d) = position, rotation
    return Pose((x, y, z), (a, b, c, d))


class _SomaReader:
    """Adds the poses, sizes, colors and attachments of a map to its normalizer."""

    def __init__(self, normalizer: DialectNormalizer) -> None:
        self.normalizer = normalizer
        self.nodes = RdfNodes(normalizer.source_map.graph, normalizer.members)
        self.number_reader = NumberReader(normalizer.source_map.conventions, order=QuaternionOrder.XYZW)

    # -- poses ---------------------------------------------------------------------------------------------------------

    def decide_conventions(self, individuals: Sequence[Iri]) -> None:
        """Decides units and quaternion order by the numbers of some individuals: m and x y z w unless ruled out."""
        extents = {
            individual: found
            for individual in individuals
            if (found := next(filter(any, map(extents_of, self._nodes_of(individual, HAS_SHAPE))), ()))
        }
        self.number_reader.consider_units(guess_units(self.normalizer.source_map, extents))
        given: list[tuple[float, ...]] = []
        for individual in individuals:
            for node in self.nodes.descendants(self.nodes.node_named(individual), HAS_LOCALIZATION):
                rotation = node.numbers(*_ROTATION)
                if len(rotation) == 4 and any(rotation):
                    given.append(tuple(rotation))
                    break
        if given:
            self.number_reader.order = decide_quaternion_order(
                self.normalizer.source_map, given, QuaternionOrder.XYZW, dialect="SOMA"
            )

    def set_poses(self, individuals: list[Iri]) -> None:
        """Adds the poses of individuals, converted to the map frame."""
        given: dict[Iri, Pose] = {}
        frames: dict[Iri, Iri] = {}
        for individual in individuals:
            found = self._pose(individual)
            if found is not None:
                given[individual] = found[0]
                if frame := self._reference_frame(individual, found[1]):
                    frames[individual] = frame
        for individual, pose in self._to_map_frame(given, frames).items():
            self.normalizer.set_pose(individual, pose)

    def _pose(self, individual: Iri) -> tuple[Pose, list[RdfNode]] | None:
        here = self.nodes.node_named(individual)
        path = list(self.nodes.descendants(here, HAS_LOCALIZATION))
        for node in path:
            if not (node.has(*_POSITION) and node.has(*_ROTATION)):
                continue
            if (given := _pose_of(node)) is not None:
                turned = Pose(given.position, self.number_reader.quaternion(given.quaternion))
                return self.number_reader.pose(turned), path
            problem = "its pose is not three finite numbers, and four that are not all 0"
            self.normalizer.warn(individual, HAS_LOCALIZATION, problem, "it has no pose")
            return None
        self.normalizer.warn(individual, HAS_LOCALIZATION, "its localization has no pose", "it has no pose")
        return None

    def _reference_frame(self, individual: Iri, path: list[RdfNode]) -> Iri | None:
        """Returns the individual that a pose is relative to, or None for the map."""
        for value in (value for node in path for value in node.values(*_REFERENCE_FRAME)):
            if isinstance(value, IriRef) and value.iri in self.normalizer.members and value.iri != individual:
                return value.iri
            name = local_name(value.iri) if isinstance(value, IriRef) else codecs.literal_text(value) or ""
            if name.strip("/").lower() not in {
                "map",
                "world",
                "odom",
                local_name(self.normalizer.source_map.map).lower(),
            }:
                problem = f"its pose is relative to {name!r}, which has no pose in this map"
                self.normalizer.warn(individual, HAS_LOCALIZATION, problem, "it is read as relative to the map")
        return None

    def _to_map_frame(self, poses: dict[Iri, Pose], parents: Mapping[Iri, Iri]) -> Mapping[Iri, Pose]:
        """Converts poses relative to other individuals to the map frame; each chain of parents is followed once."""
        rows: dict[Iri, Array] = {
            individual: normalized_pose_array(poses[individual]) for individual in poses.keys() - parents.keys()
        }
        unresolved: dict[Iri, Iri] = {}
        """By individual, the end of its chain of parents, where that has no pose."""
        for start in parents:
            chain: dict[Iri, None] = {}
            here = start
            while here in parents and here not in rows and here not in unresolved and here not in chain:
                chain[here] = None
                here = parents[here]
            for individual in reversed(chain):
                if (base := rows.get(parents[individual])) is None:
                    unresolved[individual] = unresolved.get(here, here)
                else:
                    rows[individual] = pose_multiply(base, normalized_pose_array(poses[individual]))
        for individual, end in unresolved.items():
            problem = f"its pose is relative to {local_name(end)}, which has no pose in the map frame"
            self.normalizer.warn(individual, HAS_LOCALIZATION, problem, "it is read as relative to the map")
        return poses | {each: pose_from_array(rows[each]) for each in parents if each in rows}

    def add_existing_poses(self) -> None:
        """Adds poses given in the vocabulary of dialect 1, so that these bodies can be joined and attached."""
        for member in self.normalizer.members:
            if member not in self.normalizer.poses:
                for node in self.nodes.descendants(self.nodes.node_named(member), HAS_POSE, depth=1):
                    if (given := _pose_of(node)) is not None:
                        self.normalizer.poses[member] = given

    # -- appearance ----------------------------------------------------------------------------------------------------

    def set_size(self, individual: Iri) -> None:
        """Adds the size, primitive shape and mesh of an individual."""
        shapes = list(self._nodes_of(individual, HAS_SHAPE))
        if not shapes:
            return
        candidates = ((node, extents_of(node)) for node in shapes)
        shape, extents = next((each for each in candidates if each[1]), (None, ()))
        if shape is not None:
            self.normalizer.set_size(individual, self.number_reader.lengths(extents))
            shape_type = PrimitiveType.BOX
            if shape.has(RADIUS):
                shape_type = (
                    PrimitiveType.SPHERE
                    if extents[0] == extents[2] and not shape.has(LENGTH)
                    else PrimitiveType.CYLINDER
                )
            if shape_type is not PrimitiveType.BOX and self.normalizer.first_value(individual, codecs.SHAPE) is None:
                self.normalizer.set_shape(individual, shape_type)
        path = next(
            (text for node in shapes for value in node.values(*_PATH) if (text := codecs.literal_text(value))), None
        )
        if path is not None and self.normalizer.first_value(individual, codecs.MESH) is None:
            self.normalizer.set_mesh(individual, path)
        if shape is None and path is None:
            problem = "its shape has no extents of 0 or more, no radius and no mesh"
            self.normalizer.warn(individual, HAS_SHAPE, problem, "it has no size")

    def set_color(self, individual: Iri) -> None:
        """Adds the color of an individual as a material."""
        if self.normalizer.values(individual, MATERIAL):
            return
        for node in self._nodes_of(individual, HAS_COLOR):
            if not node.has(*_COLOR):
                continue
            rgb = node.numbers(*_COLOR)
            if len(rgb) not in (3, 4) or min(rgb) < 0.0 or max(rgb[:3]) > 255.0:
                problem = "its color is not three or four numbers from 0 to 1, or to 255"
                self.normalizer.warn(individual, HAS_COLOR, problem, "it has none")
                return
            red, green, blue = (part / 255.0 if max(rgb[:3]) > 1.0 else part for part in rgb[:3])
            self.normalizer.set_materials(individual, [Material(name="colour", color=(red, green, blue))])
            return

    def _nodes_of(self, individual: Iri, property: Iri) -> Iterator[RdfNode]:
        return self.nodes.descendants(self.nodes.node_named(individual), property)

    # -- attachments ---------------------------------------------------------------------------------------------------

    def attach_parts(self) -> None:
        """Attaches parts to their wholes, unless a joint lets them move."""
        normalizer = self.normalizer
        pairs: dict[tuple[Iri, Iri], Iri] = {}
        for member in normalizer.members:
            for fact in normalizer.graph.get(member, ()):
                property, other = fact.property, fact.value
                if property not in _PART_RELATIONS or not isinstance(other, IriRef):
                    continue
                pair = (member, other.iri) if property in TO_PARTS else (other.iri, member)
                if other.iri in normalizer.poses and member in normalizer.poses:
                    pairs.setdefault(pair, property)
                else:
                    problem = f"{other.iri} is not a body of this map"
                    normalizer.warn(member, property, problem, "the relation is kept as a fact")
        normalizer.attach_loose(pairs)


SOMA = Dialect("SOMA", is_soma, read_soma, order=20)
