"""Writing of any world as a self-contained SOMA map (KnowRob 2).

Poses are written only where SOMA has them. Shapes, colors, parts and joints are restated in SOMA's vocabulary, by nodes
marked with `ms:restates`. What SOMA cannot express (physics, tags, lights, joints with several axes) stays in the
vocabularies of dialect 1 and of Mindstage. A SOMA reader finds its usual statements, and Mindstage reads the same world
again (see `without_restatements`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mindstage.maps.dialects.serialize import DocumentSection, SubjectBlock
from mindstage.maps.dialects.soma_nodes import (
    ARRAY,
    HAS_COMPONENT,
    SPACE_REGION,
    RdfNode,
    RdfNodes,
    extents_of,
    to_soma_pose,
)
from mindstage.maps.dialects.unit_conversion import original_property
from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.maps.rdf_mapping.nested import sorted_facts
from mindstage.maps.rdf_mapping.properties import QUATERNION, TRANSLATION
from mindstage.rdf.graphs import part_name
from mindstage.rdf.vocabulary import (
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    DIALECT,
    HAS_COLOR,
    HAS_JOINT,
    HAS_LOCALIZATION,
    HAS_POSE,
    HAS_SHAPE,
    HAS_VALUE,
    MATERIAL,
    ON_PROPERTY,
    OWL,
    OWL_CLASS,
    RESTATES,
    SUBCLASS_OF,
    TYPE,
    dul,
    soma,
    urdf,
    xsd,
)
from mindstage.scene import (
    AxisMotion,
    BlankNode,
    Body,
    BodyId,
    BodyPhysics,
    Color,
    FactValue,
    Iri,
    IriRef,
    Joint,
    Literal,
    Pose,
    PrimitiveType,
    PropertyAssertion,
    World,
)
from mindstage.scene.joint_kinematics import axis_ranges
from mindstage.scene.transforms import Array, normalized_pose_array, pose_inverse, pose_multiply, quat_rotate

__all__ = [
    "SOMA_DIALECT",
    "DofAxis",
    "SomaPoseWriter",
    "blank_node",
    "color_node",
    "free_axes",
    "joint_node",
    "limits_node",
    "localization_node",
    "shape_node",
    "write_as_soma",
]


_REGION = dul("hasRegion")
_DOUBLE = xsd("double")


SOMA_DIALECT = "SOMA"
_AXISLESS_CLASSES = {0: "FixedJoint", 6: "FloatingJoint"}
_RESTRICTION = Iri(OWL + "Restriction")


class DofAxis(NamedTuple):
    """A free or limited axis of a joint."""

    is_rotational: bool
    direction: Array
    """Unit vector in the joint frame."""
    range: tuple[float, float] | None
    """Lower and upper limit relative to the initial pose [m or rad]; None for no limits."""


def blank_node(cls: Iri, facts: Iterable[PropertyAssertion] = (), *, restates: Iri | None = None) -> BlankNode:
    """Creates a blank node of a class, marked as restating a property if one is given."""
    mark = () if restates is None else (PropertyAssertion(RESTATES, IriRef(restates)),)
    return BlankNode(sorted_facts((PropertyAssertion(TYPE, IriRef(cls)), *mark, *facts)))


def localization_node(pose_node: FactValue) -> BlankNode:
    """Creates the localization of an object from a pose in SOMA's form."""
    return blank_node(soma("Localization"), [PropertyAssertion(SPACE_REGION, pose_node)], restates=HAS_POSE)


def shape_node(body: Body) -> BlankNode | None:
    """Creates the shape of a body from its size and mesh; None if it has neither."""
    regions = [*_shape_nodes(body), *_mesh_nodes(body)]
    if not regions:
        return None
    return blank_node(
        soma("Shape"), (PropertyAssertion(_REGION, region) for region in regions), restates=codecs.SIZE[0].property
    )


def _shape_nodes(body: Body) -> Iterator[BlankNode]:
    if body.size is None:
        return
    x, y, z = body.size
    kind = body.shape.type if body.shape else PrimitiveType.BOX
    if kind is PrimitiveType.SPHERE and x == y == z:
        yield blank_node(soma("SphereShape"), [_number_fact(soma("hasRadius"), x / 2)])
    elif kind is PrimitiveType.CYLINDER and x == y:
        yield blank_node(
            soma("CylinderShape"), [_number_fact(soma("hasRadius"), x / 2), _number_fact(soma("hasLength"), z)]
        )
    else:
        extents = zip(("hasDepth", "hasWidth", "hasHeight"), (x, y, z), strict=True)
        yield blank_node(soma("BoxShape"), [_number_fact(soma(name), extent) for name, extent in extents])


def _mesh_nodes(body: Body) -> Iterator[BlankNode]:
    if body.mesh is not None:
        yield blank_node(soma("MeshShape"), [PropertyAssertion(soma("hasFilePath"), Literal(body.mesh))])


def color_node(color: Color) -> BlankNode:
    """Creates the color of an object."""
    region = blank_node(soma("ColorRegion"), [_number_row_fact(soma("hasRGBValue"), (*color, 1.0))])
    return blank_node(soma("Color"), [PropertyAssertion(_REGION, region)], restates=MATERIAL)


# -- joints ------------------------------------------------------------------------------------------------------------


def free_axes(joint: Joint) -> Sequence[DofAxis]:
    """Returns the axes that a joint does not lock."""
    return [
        DofAxis(at >= 3, np.eye(3)[at % 3], None if motion is AxisMotion.FREE else (middle - limit, middle + limit))
        for at, (motion, limit, middle) in enumerate(axis_ranges(joint))
        if motion is AxisMotion.FREE or (motion is AxisMotion.LIMITED and limit)
    ]


def joint_node(joint: Joint, cls: Iri, ends: tuple[Iri, Iri], parent: Pose) -> BlankNode:
    """Creates the node of a joint, with its frame relative to the parent link as in URDF.

    Args:
        cls: class of the node, which gives its type and limits.
        ends: IRIs of the parent and the child.
        parent: pose of the parent in the map frame.
    """
    facts = [
        PropertyAssertion(urdf("hasParentLink"), IriRef(ends[0])),
        PropertyAssertion(urdf("hasChildLink"), IriRef(ends[1])),
    ]
    axes = free_axes(joint)
    with np.errstate(over="ignore", invalid="ignore"):  # the result may overflow
        parent_from_frame: Array = pose_multiply(
            pose_inverse(normalized_pose_array(parent)), normalized_pose_array(joint.pose)
        )
        axis = quat_rotate(parent_from_frame[3:], axes[0].direction) if len(axes) == 1 else parent_from_frame[:0]
    if np.isfinite(parent_from_frame).all():
        facts.append(
            PropertyAssertion(
                urdf("hasOrigin"),
                blank_node(urdf("Pose"), [_number_row_fact(urdf("hasXYZ"), parent_from_frame[:3].tolist())]),
            )
        )
        facts += [_number_row_fact(urdf("hasAxisVector"), axis.tolist())] if len(axis) else []
    return blank_node(cls, facts, restates=CONSTRAINT)


def limits_node(range: tuple[float, float]) -> BlankNode:
    """Creates the limits of a joint, lower one first."""
    ends = zip((urdf("hasLowerLimit"), urdf("hasUpperLimit")), range, strict=True)
    return blank_node(urdf("JointLimits"), [_number_fact(property, end) for property, end in ends])


def _number_fact(property: Iri, number: float) -> PropertyAssertion:
    return PropertyAssertion(property, Literal(repr(float(number)), _DOUBLE))


def _number_row_fact(property: Iri, numbers: Iterable[float]) -> PropertyAssertion:
    return PropertyAssertion(property, Literal(" ".join(repr(float(number) + 0.0) for number in numbers), ARRAY))


def write_as_soma(
    world: World, all_sections: Sequence[DocumentSection]
) -> tuple[Sequence[DocumentSection], tuple[str, ...]]:
    """Rewrites the sections of a map in SOMA's vocabulary.

    Args:
        all_sections: its complete description in the vocabulary of dialect 1; it is not modified.

    Returns:
        The sections, and sentences about what SOMA cannot express.
    """
    sections = [replace(section, blocks=[replace(block, facts=list(block.facts)) for block in section.blocks])
                for section in all_sections]  # fmt: skip
    blocks = {block.subject: block for section in sections for block in section.blocks}
    writer = _SomaWriter(world, blocks)
    writer.write()
    return [*sections[:2], DocumentSection("Joint Classes", writer.classes), *sections[2:]], tuple(
        _unsupported_notes(world)
    )


def _unsupported_notes(world: World) -> Sequence[str]:
    """Returns sentences about what a reader that supports SOMA only will not find in the map."""
    several = [each.id for each in world.joints if len(free_axes(each)) not in (1, *_AXISLESS_CLASSES)]
    dynamic = [body.id for body in world.bodies if body.physics != BodyPhysics()]
    unsupported = (
        (several, "joints have several axes"),
        (dynamic, "bodies have physical properties"),
        ([light.id for light in world.lights], "lights"),
        ([body.id for body in world.bodies if body.tags], "bodies have tags"),
    )
    return [
        f"{len(ids)} {what}, which SOMA cannot express: SemLog's vocabulary is used" for ids, what in unsupported if ids
    ]


class _SomaWriter:
    def __init__(self, world: World, blocks: dict[Iri, SubjectBlock]) -> None:
        self.world, self.blocks = world, blocks
        self.bodies = {body.id: body for body in world.bodies}
        self.parents = {attachment.child: attachment.parent for attachment in world.attachments}
        self.non_bodies = {each.iri for each in world.joints} | {each.iri for each in world.lights}
        self.attached: dict[BodyId, list[Iri]] = {}
        for each in world.attachments:
            self.attached.setdefault(each.parent, []).append(self.bodies[each.child].iri)
        self.classes: list[SubjectBlock] = []

    def write(self) -> None:
        """Writes all bodies and joints, then the dialect of the map."""
        poses = SomaPoseWriter(self.blocks, self.non_bodies)
        for body in self.world.bodies:
            facts = self.blocks[body.iri].facts
            poses.write(body, facts)
            self._write_shape(body, facts)
            self._write_color(body, facts)
            self._write_parent(body, facts)
        for joint in self.world.joints:
            self._write_joint(joint)
        facts = self.blocks[self.world.iri].facts
        facts.insert(0, PropertyAssertion(DIALECT, Literal(SOMA_DIALECT)))

    def _write_shape(self, body: Body, facts: list[PropertyAssertion]) -> None:
        if any(fact.property == HAS_SHAPE for fact in facts):
            nodes = RdfNodes({})
            shapes = nodes.descendants(RdfNode(body.iri, facts), HAS_SHAPE)
            if body.size is None or any(tuple(extents_of(shape)) == body.size for shape in shapes):
                return
            _preserve_as_original(facts, HAS_SHAPE)
        if (shape := shape_node(body)) is not None:
            facts.append(PropertyAssertion(HAS_SHAPE, shape))

    def _write_color(self, body: Body, facts: list[PropertyAssertion]) -> None:
        if body.color is not None and all(fact.property != HAS_COLOR for fact in facts):
            facts.append(PropertyAssertion(HAS_COLOR, color_node(body.color)))

    def _write_parent(self, body: Body, facts: list[PropertyAssertion]) -> None:
        if body.id not in self.parents:
            return
        whole = self.blocks[self.bodies[self.parents[body.id]].iri]
        part = PropertyAssertion(HAS_COMPONENT, IriRef(body.iri))
        if part not in whole.facts:
            whole.facts.append(part)
            facts.append(PropertyAssertion(RESTATES, IriRef(HAS_COMPONENT)))

    def _write_joint(self, joint: Joint) -> None:
        if "parent" in joint.assumed:
            return  # it stays in the vocabulary of dialect 1, with the mark that it is assumed
        parent, child = self.bodies[joint.parent], self.bodies[joint.child]
        facts = self.blocks[parent.iri].facts
        # A map may name the two ends the other way round, or the handle in place of the drawer (see `joint_ends.py`).
        carried = self.attached.get(joint.child, ())
        if _has_joint_to(facts, child.iri) or _has_joint_to(self.blocks[child.iri].facts, parent.iri, *carried):
            return
        if (cls := self._joint_class(joint)) is not None:
            facts.append(PropertyAssertion(HAS_JOINT, joint_node(joint, cls, (parent.iri, child.iri), parent.pose)))

    def _joint_class(self, joint: Joint) -> Iri | None:
        """Returns the class of a joint; a limited one gets a class of its own, which gives its limits."""
        axes = free_axes(joint)
        if len(axes) != 1:
            return urdf(_AXISLESS_CLASSES[len(axes)]) if len(axes) in _AXISLESS_CLASSES else None
        axis = axes[0]
        if axis.range is None:
            return urdf("ContinuousJoint" if axis.is_rotational else "PrismaticJoint")
        restriction = blank_node(
            _RESTRICTION,
            [
                PropertyAssertion(ON_PROPERTY, IriRef(urdf("hasJointLimits"))),
                PropertyAssertion(HAS_VALUE, limits_node(axis.range)),
            ],
        )
        cls = part_name(joint.iri, "class", self.blocks)
        block = SubjectBlock(
            cls,
            [
                PropertyAssertion(TYPE, IriRef(OWL_CLASS)),
                PropertyAssertion(RESTATES, IriRef(CONSTRAINT)),
                PropertyAssertion(
                    SUBCLASS_OF, IriRef(urdf("RevoluteJoint" if axis.is_rotational else "PrismaticJoint"))
                ),
                PropertyAssertion(SUBCLASS_OF, restriction),
            ],
        )
        self.classes.append(block)
        self.blocks[cls] = block
        return cls


def _has_joint_to(facts: Sequence[PropertyAssertion], *children: Iri) -> bool:
    """Whether one of the joints in the statements about a link has one of these links as its child."""
    wanted = {PropertyAssertion(urdf("hasChildLink"), IriRef(child)) for child in children}
    nodes = (fact.value.facts for fact in facts if fact.property == HAS_JOINT and isinstance(fact.value, BlankNode))
    return any(not wanted.isdisjoint(node) for node in nodes)


class SomaPoseWriter:
    """Replaces poses of dialect 1 by poses in SOMA's form."""

    def __init__(self, blocks: Mapping[Iri, SubjectBlock], non_bodies: Iterable[Iri]) -> None:
        """Creates a writer.

        Args:
            blocks: the statements of the map by subject; those about poses are modified.
            non_bodies: individuals whose poses are not converted.
        """
        self.blocks = blocks
        self._kept_poses = {
            fact.value.iri
            for other in non_bodies
            for fact in blocks[other].facts
            if fact.property == HAS_POSE and isinstance(fact.value, IriRef)
        }
        self._converted: set[Iri] = set()

    def write(self, body: Body, facts: list[PropertyAssertion]) -> bool:
        """Replaces the pose of a body, unless its facts already give it in SOMA's form; outdated ones are set aside.

        Args:
            facts: its statements, which are modified.

        Returns:
            Whether the pose was replaced.
        """
        at = next((index for index, fact in enumerate(facts) if fact.property == HAS_POSE), None)
        if at is None or _has_pose(facts, body.pose):
            return False
        localized = self._localized_value(facts[at].value)
        if localized is None:
            return False
        facts[at] = PropertyAssertion(HAS_LOCALIZATION, localization_node(localized))
        _preserve_as_original(facts, HAS_LOCALIZATION, except_index=at)
        return True

    def _localized_value(self, value: FactValue) -> FactValue | None:
        if isinstance(value, BlankNode) and not any(isinstance(inner.value, BlankNode) for inner in value.facts):
            converted = to_soma_pose(value.facts)
            return None if converted is None else BlankNode(sorted_facts(converted))
        if not isinstance(value, IriRef) or value.iri not in self.blocks or value.iri in self._kept_poses:
            return None
        if value.iri not in self._converted:
            if any(fact.property == DESCRIBED_IN_MAP for fact in self.blocks[value.iri].facts):
                return None  # the resource is an individual of the map as well, and would not remain one
            converted = to_soma_pose(self.blocks[value.iri].facts)
            if converted is None:
                return None
            self.blocks[value.iri].facts = converted
            self._converted.add(value.iri)
        return value


def _has_pose(facts: Sequence[PropertyAssertion], pose: Pose) -> bool:
    """Whether the facts give this pose in SOMA's form."""
    here = RdfNode(None, facts)
    for below in RdfNodes({}).descendants(here, HAS_LOCALIZATION):
        position, rotation = below.numbers(TRANSLATION.property), below.numbers(QUATERNION.property)
        if position == pose.position and len(rotation) == 4:
            return (rotation[3], *rotation[:3]) == pose.quaternion
    return False


def _preserve_as_original(facts: list[PropertyAssertion], property: Iri, *, except_index: int | None = None) -> None:
    """Renames outdated statements to their `original_property`, which reading the map reverses."""
    for index, fact in enumerate(facts):
        if fact.property == property and index != except_index:
            facts[index] = PropertyAssertion(original_property(property), fact.value)
