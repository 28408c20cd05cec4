"""Conversion between worlds and the messages of UROSWorldControl (`world_control_msgs`).

Bodies: Unreal finds a mesh by its name, so the name of a model is that of the mesh of the body, or else of its class,
as in the KnowRob maps. Properties for which a model has no field are added as tags of the type `Mindstage`: always
these, in this order, behind the tags of the body, so that they cannot be confused with them:

    Iri, Class, Mesh, Shape ("box"), Size ("depth width height"), Untold (names of the fields that the map leaves out)

Facts, and the colors of materials, are lost.

Joints: the motion codes are 0 free, 1 limited, 2 locked; the first model is the parent, the second the child. In
messages a range is symmetric about the pose at which the joint is spawned. Another range is widened until it is
symmetric: a drawer that can also move backwards still opens, one with a shortened range does not.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator, Mapping
from itertools import count
from pathlib import PurePosixPath
from typing import Any

from mindstage.bridge.conversions import ConversionNote, merge_notes, pose_from_message, pose_message
from mindstage.errors import MessageValidationError
from mindstage.msgs import geometry_msgs, world_control_msgs
from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    BlankNode,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    IriRef,
    Joint,
    LinearLimits,
    Literal,
    Material,
    Mobility,
    PrimitiveShape,
    PrimitiveType,
    SoftLimit,
    Tag,
    Vector,
    World,
)

__all__ = [
    "CLASS_NAMESPACE",
    "attachment_from_message",
    "body_from_box",
    "body_from_message",
    "iri_from_id",
    "iri_namespace",
    "joint_from_message",
    "joint_message",
    "materials_from_lists",
    "mesh_pivots",
    "model_message",
    "model_tags",
    "physics_from_message",
    "physics_message",
    "relation_message",
    "spawn_model_request",
    "spawn_request",
    "tag_message",
    "untranslatable_body_fields",
    "untranslatable_fields",
    "untranslatable_joint_fields",
    "world_from_request",
]


CLASS_NAMESPACE = "http://knowrob.org/kb/knowrob.owl#"
"""Namespace of the class of a model without the `Class` tag, as in the KnowRob maps."""

_POSE = CLASS_NAMESPACE + "pose"
_PIVOT = "http://mindstage.org/ontology#pivot"

TAG_TYPE = "Mindstage"
TAG_KEYS = ("Iri", "Class", "Mesh", "Shape", "Size", "Untold")
MOBILITY_CODES = {
    Mobility.STATIC: world_control_msgs.MobilityCode.STATIC,
    Mobility.STATIONARY: world_control_msgs.MobilityCode.STATIONARY,
    Mobility.DYNAMIC: world_control_msgs.MobilityCode.DYNAMIC,
    Mobility.KINEMATIC: world_control_msgs.MobilityCode.KINEMATIC,
}
MOBILITY_BY_CODE = {code: mobility for mobility, code in MOBILITY_CODES.items()}
LINEAR_AXES = ("x", "y", "z")
ANGULAR_AXES = ("swing1", "swing2", "twist")

# -- to the wire -------------------------------------------------------------------------------------------------------


def model_message(body: Body) -> world_control_msgs.ModelDescription:
    """Converts a body to a model of `spawn_semantic_map`."""
    return world_control_msgs.ModelDescription(
        name=_mesh_name(body),
        pose=pose_message(body.pose),
        id=body.id,
        tags=model_tags(body),
        path=_content_folder(body),
        actor_label=body.label or "",
        physics_properties=physics_message(body.physics),
        material_names=tuple(material.name for material in body.materials),
        material_paths=tuple(material.path for material in body.materials),
    )


def spawn_model_request(
    body: Body, *, parent: str = "", spawn_collision_check: bool = False
) -> world_control_msgs.SpawnModel.Request:
    """Converts a body to a request of `spawn_model`.

    Args:
        body: the body to spawn.
        parent: id of the body to which it is attached.
        spawn_collision_check: do not spawn it if it overlaps another body.
    """
    model = model_message(body)
    return world_control_msgs.SpawnModel.Request(
        **{name: getattr(model, name) for name in world_control_msgs.ModelDescription.__struct_fields__},
        parent_id=parent,
        spawn_collision_check=spawn_collision_check,
    )


def mesh_pivots(world: World) -> Mapping[BodyId, Vector]:
    """Returns the origins of meshes that are not centered, relative to the centers of bodies [m].

    Unreal places a model by the origin of its mesh, which was the pose in the map (`ms:pivot`), a world by the center.
    """
    facts_by_subject = {resource.iri: resource.facts for resource in world.resources}
    pivots: dict[BodyId, Vector] = {}
    for body in world.bodies:
        for value in (fact.value for fact in body.facts if fact.property == _POSE):
            facts = facts_by_subject.get(value.iri, ()) if isinstance(value, IriRef) else ()
            facts = value.facts if isinstance(value, BlankNode) else facts
            for pivot in (fact.value for fact in facts if fact.property == _PIVOT):
                if isinstance(pivot, Literal):
                    x, y, z = map(float, pivot.text.split())
                    pivots[body.id] = (x, y, z)
    return pivots


def physics_message(physics: BodyPhysics) -> world_control_msgs.PhysicsProperties:
    """Converts physics properties to a message; missing values are replaced by their defaults."""
    return world_control_msgs.PhysicsProperties(
        mobility=MOBILITY_CODES[physics.mobility or Mobility.STATIC],
        gravity=physics.gravity is not False,
        generate_overlap_events=physics.overlap_events is True,
        mass=physics.mass_kg or 0.0,
    )


def tag_message(tag: Tag) -> world_control_msgs.Tag:
    """Converts a tag to a message."""
    return world_control_msgs.Tag(type=tag.type, key=tag.key, value=tag.value)


def model_tags(body: Body) -> tuple[world_control_msgs.Tag, ...]:
    """Returns the tags of a body, followed by those for properties for which a model has no field."""
    fields = {name: getattr(body, name) for name in ("label", "mesh", "shape", "size")}
    fields |= {name: getattr(body.physics, name) for name in BodyPhysics.__struct_fields__}
    values = (
        body.iri,
        body.cls,
        body.mesh or "",
        body.shape.type.value if body.shape else "",
        " ".join(repr(float(extent)) for extent in body.size or ()),
        " ".join(name for name, value in fields.items() if value is None),
    )
    own = (
        world_control_msgs.Tag(type=TAG_TYPE, key=key, value=value) for key, value in zip(TAG_KEYS, values, strict=True)
    )
    return (*map(tag_message, body.tags), *own)


def untranslatable_body_fields(body: Body) -> Iterator[ConversionNote]:
    """Yields what a model cannot represent of a body."""
    if body.facts:
        yield ConversionNote("facts", (body.id,), "a model has no field for facts")
    if any(material.color is not None for material in body.materials):
        yield ConversionNote("materials", (body.id,), "the materials of a model have names and paths, but no colors")
    if any(set(tag.type + tag.key + tag.value) & set(";,") for tag in body.tags):
        yield ConversionNote("tags", (body.id,), "Unreal stores tags as text in which ';' and ',' are separators")


def _mesh_name(body: Body) -> str:
    if body.mesh:
        return PurePosixPath(body.mesh).stem.removeprefix("SM_") or body.mesh
    return _local_name(body.cls)


def _content_folder(body: Body) -> str:
    """Returns the folder in which Unreal looks first, if the mesh is named by its path in Unreal's content."""
    return str(PurePosixPath(body.mesh).parent) if body.mesh and body.mesh.startswith("/Game/") else ""


def _local_name(iri: str) -> str:
    return re.split("[#/]", iri.rstrip("#/"))[-1]


# -- from the wire -----------------------------------------------------------------------------------------------------

Model = world_control_msgs.ModelDescription | world_control_msgs.SpawnModel.Request


def body_from_message(
    message: Model, *, id: str = "", namespace: str, path: str = ""
) -> tuple[Body, tuple[ConversionNote, ...]]:
    """Converts a model to a body, and returns what was assumed.

    Args:
        message: a model of `spawn_semantic_map`, or a request of `spawn_model`.
        id: id of the body if the model has none.
        namespace: namespace of the IRI of a body without the `Iri` tag.
        path: path of the model in the message, for errors.

    Raises:
        MessageValidationError: its `Mindstage` tags are invalid.
    """
    name = BodyId(message.id or id)
    tags = tuple(Tag(type=tag.type, key=tag.key, value=tag.value) for tag in message.tags)
    plain = Body(
        id=name,
        iri=iri_from_id(name, namespace),
        cls=Iri(CLASS_NAMESPACE + _class_name(tags, message.name)),
        pose=pose_from_message(message.pose),
        label=message.actor_label or None,
        mesh=f"{message.path.rstrip('/')}/{message.name}" if message.path else message.name or None,
        physics=physics_from_message(message.physics_properties),
        materials=materials_from_lists(message.material_names, message.material_paths),
        tags=tags,
    )
    own = tags[-len(TAG_KEYS) :]
    if tuple((tag.type, tag.key) for tag in own) == tuple((TAG_TYPE, key) for key in TAG_KEYS):
        return _with_tag_fields(
            plain, tags[: -len(TAG_KEYS)], dict(zip(TAG_KEYS, (tag.value for tag in own), strict=True)), path
        ), ()
    return plain, tuple(_assumption_notes(name, message))


def body_from_box(request: world_control_msgs.SpawnProMesh.Request, *, id: str = "", namespace: str) -> Body:
    """Converts a request of `spawn_pro_mesh` to a body: a box.

    Args:
        id: id of the body if the request has none.
        namespace: namespace of its IRI.
    """
    name = BodyId(request.id or id)
    tags = tuple(Tag(type=tag.type, key=tag.key, value=tag.value) for tag in request.tags)
    return Body(
        id=name,
        iri=iri_from_id(name, namespace),
        cls=Iri(CLASS_NAMESPACE + _class_name(tags, "Box")),
        pose=pose_from_message(request.pose),
        label=request.actor_label or None,
        size=(request.depth, request.width, request.height),
        shape=PrimitiveShape(type=PrimitiveType.BOX),
        physics=physics_from_message(request.physics_properties),
        tags=tags,
    )


def iri_from_id(id: str, namespace: str) -> Iri:
    """Returns the IRI of an id; an id that is an IRI is returned as it is."""
    return Iri(id if "://" in id else namespace + id)


def physics_from_message(message: world_control_msgs.PhysicsProperties) -> BodyPhysics:
    """Converts a message to physics properties."""
    return BodyPhysics(
        mobility=MOBILITY_BY_CODE[message.mobility],
        gravity=message.gravity,
        overlap_events=message.generate_overlap_events,
        mass_kg=message.mass,
    )


def materials_from_lists(names: tuple[str, ...], paths: tuple[str, ...]) -> tuple[Material, ...]:
    """Converts two parallel lists to materials; missing elements of the shorter one are empty."""
    count = max(len(names), len(paths))
    names, paths = names + ("",) * (count - len(names)), paths + ("",) * (count - len(paths))
    return tuple(Material(name=name, path=path) for name, path in zip(names, paths, strict=True))


def _with_tag_fields(body: Body, tags: tuple[Tag, ...], notes: dict[str, str], path: str) -> Body:
    """Returns the body with the properties in its `Mindstage` tags."""
    missing = set(notes["Untold"].split())
    fields = BodyPhysics.__struct_fields__
    physics: dict[str, Any] = {name: None if name in missing else getattr(body.physics, name) for name in fields}
    try:
        shape = None if "shape" in missing else PrimitiveShape(type=PrimitiveType(notes["Shape"]))
        size = None if "size" in missing else _parse_size(notes["Size"])
    except ValueError as error:
        raise MessageValidationError(
            "world_control_msgs/ModelDescription",
            path=f"{path}.tags" if path else "tags",
            cause=f"a tag of the type {TAG_TYPE} is invalid: {error}",
            remedy="send a known shape and three extents, or leave out all tags of that type",
        ) from error
    return Body(
        id=body.id,
        iri=Iri(notes["Iri"]),
        cls=Iri(notes["Class"]),
        pose=body.pose,
        label=None if "label" in missing else body.label or "",
        size=size,
        mesh=None if "mesh" in missing else notes["Mesh"],
        shape=shape,
        physics=BodyPhysics(**physics),
        materials=body.materials,
        tags=tags,
    )


def _assumption_notes(id: str, model: Model) -> Iterator[ConversionNote]:
    """Yields what is assumed of a model without `Mindstage` tags."""
    yield ConversionNote("size", (id,), "a model has no size")
    yield ConversionNote(
        "class", (id,), "only the local name of the class is given; the namespace of KnowRob is assumed"
    )
    if len(model.material_names) != len(model.material_paths):
        yield ConversionNote("materials", (id,), "names and paths differ in number; missing ones are assumed empty")


def _parse_size(text: str) -> Vector:
    depth, width, height = map(float, text.split())
    return depth, width, height


def _class_name(tags: tuple[Tag, ...], name: str) -> str:
    """Returns the class in the tag of the semantic logger, or else the mesh name, or `Thing`."""
    return next((tag.value for tag in tags if (tag.type, tag.key) == ("SemLog", "Class")), name) or "Thing"


def joint_message(joint: Joint) -> world_control_msgs.ConstraintDescription:
    """Converts a joint to a message."""
    return world_control_msgs.ConstraintDescription(
        id=joint.id,
        constraint_details=world_control_msgs.PhysicsConstraintDetails(
            id_first_model=joint.parent,
            id_second_model=joint.child,
            disable_collision=joint.disable_collision is not False,
            linear_limits=_linear_message(joint.linear),
            angular_limits=_angular_message(joint.angular),
        ),
        pose=pose_message(joint.pose),
    )


def untranslatable_joint_fields(joint: Joint) -> Iterator[ConversionNote]:
    """Yields what the message cannot represent of a joint."""
    if joint.facts:
        yield ConversionNote("facts", (joint.id,), "the message has no field for facts")
    if joint.tags:
        yield ConversionNote("tags", (joint.id,), "the message has no field for tags")
    if joint.mimic is not None:
        yield ConversionNote("mimic", (joint.id,), "it moves independently")
    if joint.disable_collision is None:
        yield ConversionNote("disable_collision", (joint.id,), "a missing value is sent as true")
    if _shifted_axes(joint.linear, LINEAR_AXES) or _shifted_axes(joint.angular, ANGULAR_AXES):
        yield ConversionNote(
            "middle", (joint.id,), "ranges are symmetric in the message, so it is widened until it is symmetric"
        )


def joint_from_message(
    message: world_control_msgs.ConstraintDescription, *, id: str = "", namespace: str
) -> tuple[Joint, tuple[ConversionNote, ...]]:
    """Converts a message to a joint, and returns what was ignored.

    Args:
        id: id of the joint if the message has none.
        namespace: namespace of its IRI.
    """
    name = BodyId(message.id or id)
    details = message.constraint_details
    linear, angular = details.linear_limits, details.angular_limits
    joint = Joint(
        id=name,
        iri=iri_from_id(name, namespace),
        parent=BodyId(details.id_first_model),
        child=BodyId(details.id_second_model),
        pose=pose_from_message(message.pose),
        linear=LinearLimits(
            x=AxisMotion(linear.x_motion),
            y=AxisMotion(linear.y_motion),
            z=AxisMotion(linear.z_motion),
            limit=linear.limit,
            soft_limit=_soft_limit(linear.use_advanced, linear.soft_constraint, linear.stiffness, linear.damping),
        ),
        angular=AngularLimits(
            swing1=AxisMotion(angular.swing_1_motion),
            swing2=AxisMotion(angular.swing_2_motion),
            twist=AxisMotion(angular.twist_motion),
            swing1_limit=angular.swing_1_limit_angle,
            swing2_limit=angular.swing_2_limit_angle,
            twist_limit=angular.twist_limit_angle,
            swing_soft_limit=_soft_limit(
                angular.use_advanced, angular.swing_soft_constraint, angular.swing_stiffness, angular.swing_damping
            ),
            twist_soft_limit=_soft_limit(
                angular.use_advanced, angular.twist_soft_constraint, angular.twist_stiffness, angular.twist_damping
            ),
        ),
        disable_collision=details.disable_collision,
    )
    return joint, tuple(_ignored_notes(name, details))


def _linear_message(motion: LinearLimits) -> world_control_msgs.LinearLimits:
    offsets = [
        abs(getattr(motion, f"{axis}_middle")) for axis in LINEAR_AXES if getattr(motion, axis) is AxisMotion.LIMITED
    ]
    return world_control_msgs.LinearLimits(
        x_motion=world_control_msgs.MotionCode(motion.x),
        y_motion=world_control_msgs.MotionCode(motion.y),
        z_motion=world_control_msgs.MotionCode(motion.z),
        limit=motion.limit + max(offsets, default=0.0),
        use_advanced=True,
        soft_constraint=motion.soft_limit.enabled,
        stiffness=motion.soft_limit.stiffness,
        damping=motion.soft_limit.damping,
    )


def _angular_message(motion: AngularLimits) -> world_control_msgs.AngularLimits:
    return world_control_msgs.AngularLimits(
        swing_1_motion=world_control_msgs.MotionCode(motion.swing1),
        swing_2_motion=world_control_msgs.MotionCode(motion.swing2),
        twist_motion=world_control_msgs.MotionCode(motion.twist),
        swing_1_limit_angle=_symmetric_limit(motion, "swing1"),
        swing_2_limit_angle=_symmetric_limit(motion, "swing2"),
        twist_limit_angle=_symmetric_limit(motion, "twist"),
        use_advanced=True,
        swing_soft_constraint=motion.swing_soft_limit.enabled,
        swing_stiffness=motion.swing_soft_limit.stiffness,
        swing_damping=motion.swing_soft_limit.damping,
        twist_soft_constraint=motion.twist_soft_limit.enabled,
        twist_stiffness=motion.twist_soft_limit.stiffness,
        twist_damping=motion.twist_soft_limit.damping,
    )


def _symmetric_limit(motion: AngularLimits, axis: str) -> float:
    limit: float = getattr(motion, f"{axis}_limit")
    middle: float = getattr(motion, f"{axis}_middle")
    return limit + abs(middle) if getattr(motion, axis) is AxisMotion.LIMITED else limit


def _shifted_axes(motion: LinearLimits | AngularLimits, axes: tuple[str, ...]) -> bool:
    return any(getattr(motion, axis) is AxisMotion.LIMITED and getattr(motion, f"{axis}_middle") for axis in axes)


def _soft_limit(use_advanced: bool, enabled: bool, stiffness: float, damping: float) -> SoftLimit:
    return SoftLimit(enabled=use_advanced and enabled, stiffness=stiffness, damping=damping)


def _ignored_notes(id: str, details: world_control_msgs.PhysicsConstraintDetails) -> Iterator[ConversionNote]:
    linear, angular = details.linear_limits, details.angular_limits
    if linear.soft_constraint and not linear.use_advanced:
        yield ConversionNote("soft", (id,), "the linear soft limit is ignored without use_advanced")
    if (angular.swing_soft_constraint or angular.twist_soft_constraint) and not angular.use_advanced:
        yield ConversionNote("soft", (id,), "the angular soft limits are ignored without use_advanced")
    if angular.angular_roation_offset != geometry_msgs.Vector3():
        yield ConversionNote("angular_roation_offset", (id,), "it is ignored; rotate the pose instead")
    if details.enable_projection:
        yield ConversionNote("enable_projection", (id,), "it is ignored; engines use their own error correction")
    if details.parent_dominates:
        yield ConversionNote("parent_dominates", (id,), "it is ignored; make the parent static instead")


def spawn_request(world: World) -> world_control_msgs.SpawnSemanticMap.Request:
    """Converts a world to a request of `spawn_semantic_map`; `untranslatable_fields` returns what it leaves out."""
    return world_control_msgs.SpawnSemanticMap.Request(
        models=tuple(model_message(body) for body in world.bodies),
        constraints=tuple(joint_message(joint) for joint in world.joints),
        relations=tuple(relation_message(attachment) for attachment in world.attachments),
    )


def untranslatable_fields(world: World) -> tuple[ConversionNote, ...]:
    """Returns what `spawn_semantic_map` cannot represent of a world; everything else can be converted back."""
    return merge_notes(_untranslatable(world))


def world_from_request(
    request: world_control_msgs.SpawnSemanticMap.Request, *, iri: Iri, name: str = "", taken: Container[str] = ()
) -> tuple[World, tuple[ConversionNote, ...]]:
    """Converts a request of `spawn_semantic_map` to a world, and returns what was assumed.

    Args:
        iri: IRI of the map, whose namespace is that of its individuals.
        name: name of the map.
        taken: ids that are not given to models and constraints without one.

    Raises:
        MessageValidationError: the `Mindstage` tags of a model are invalid.
    """
    namespace = iri_namespace(iri)
    ids = {model.id for model in request.models} | {constraint.id for constraint in request.constraints}
    notes: list[ConversionNote] = []
    bodies, joints = [], []
    for number, model in enumerate(request.models):
        id = model.id or _generated_id(model.name or "Model", ids, taken, notes)
        body, new_notes = body_from_message(model, id=id, namespace=namespace, path=f"models[{number}]")
        bodies.append(body)
        notes += new_notes
    for description in request.constraints:
        id = description.id or _generated_id("Constraint", ids, taken, notes)
        joint, new_notes = joint_from_message(description, id=id, namespace=namespace)
        joints.append(joint)
        notes += new_notes
    world = World(
        iri=iri,
        name=name,
        bodies=tuple(bodies),
        joints=tuple(joints),
        attachments=tuple(map(attachment_from_message, request.relations)),
    )
    return world, merge_notes(notes)


def relation_message(attachment: Attachment) -> world_control_msgs.RelationDescription:
    """Converts an attachment to a message."""
    return world_control_msgs.RelationDescription(parent_id=attachment.parent, child_id=attachment.child)


def attachment_from_message(relation: world_control_msgs.RelationDescription) -> Attachment:
    """Converts a message to an attachment."""
    return Attachment(parent=BodyId(relation.parent_id), child=BodyId(relation.child_id))


def _untranslatable(world: World) -> Iterator[ConversionNote]:
    for body in world.bodies:
        yield from untranslatable_body_fields(body)
    for joint in world.joints:
        yield from untranslatable_joint_fields(joint)
        if joint.iri != iri_from_id(joint.id, iri_namespace(world.iri)):
            yield ConversionNote("iri", (joint.id,), "the IRI of a joint is not sent; it is derived from its id")
    for light in world.lights:
        yield ConversionNote("lights", (light.id,), "the message has no field for lights")
    if world.facts or world.resources:
        yield ConversionNote("facts", (world.iri,), "facts about the map and about anything but bodies are not sent")


def iri_namespace(iri: str) -> str:
    """Returns the namespace of an IRI; of one without a fragment, the IRI and `#`."""
    return iri.rpartition("#")[0] + "#" if "#" in iri else f"{iri}#"


def _generated_id(stem: str, ids: set[str], taken: Container[str], notes: list[ConversionNote]) -> str:
    """Returns a new id for an object without one."""
    candidates = (f"{stem}_{number}" for number in count(1))
    id = next(each for each in candidates if each not in ids and each not in taken)
    ids.add(id)
    notes.append(ConversionNote("id", (id,), "it has no id; this one was generated"))
    return id
