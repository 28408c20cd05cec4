"""Models: a body as the wire describes a model, and back.

Unreal finds a mesh by its name, so a model is called like its body's mesh, or else like its class, as the community's
maps mean it. What a model has no field for and can be said in a few words goes along as tags of the type `Mindstage`,
always these, in this order and behind all others; so they are found again, and a body's own tags are never taken for
them:

    Iri, Class, Mesh, Shape ("box"), Size ("depth width height"), Untold (the names of fields that the map leaves out)

Facts, and the colors of materials, stay behind.

Constraints: a constraint of a world as the wire describes one, and back.

The motions are the same numbers, 0 free, 1 limited, 2 locked; the first model is the parent, the second the child. On
the wire a range is the same either way from where it was spawned. A range that is not is widened until it is, since a
drawer that could also go backwards still opens, and one that is cut short does not.

Maps: a whole world as one `spawn_semantic_map`, and back.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from itertools import count
from pathlib import PurePosixPath

from mindstage.bridge.conversions import ConversionNote, merge_notes, pose_from_message, pose_message
from mindstage.errors import MessageValidationError
from mindstage.msgs import geometry_msgs, world_control_msgs
from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Joint,
    LinearLimits,
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
    "joint_from_message",
    "joint_message",
    "materials_from_lists",
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
"""Where a model's class is looked for when only its name is told: the community's maps have theirs there."""

TAG_TYPE = "Mindstage"
TAG_KEYS = ("Iri", "Class", "Mesh", "Shape", "Size", "Untold")
MOBILITY_CODES = {
    Mobility.STATIC: world_control_msgs.MobilityCode.STATIC,
    Mobility.STATIONARY: world_control_msgs.MobilityCode.STATIONARY,
    Mobility.DYNAMIC: world_control_msgs.MobilityCode.DYNAMIC,
    Mobility.KINEMATIC: world_control_msgs.MobilityCode.KINEMATIC,
}
MOBILITY_BY_CODE = {code: mobility for mobility, code in MOBILITY_CODES.items()}

# -- to the wire -------------------------------------------------------------------------------------------------------


def model_message(body: Body) -> world_control_msgs.ModelDescription:
    """A body for `spawn_semantic_map`."""
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
    """A body for `spawn_model`.

    Args:
        body: what to spawn.
        parent: the id of what it hangs on.
        spawn_collision_check: do not spawn it into something else.
    """
    model = model_message(body)
    return world_control_msgs.SpawnModel.Request(
        **{name: getattr(model, name) for name in world_control_msgs.ModelDescription.__struct_fields__},
        parent_id=parent,
        spawn_collision_check=spawn_collision_check,
    )


def physics_message(physics: BodyPhysics) -> world_control_msgs.PhysicsProperties:
    """Physics for the wire; what is not told is written as what it is taken for."""
    return world_control_msgs.PhysicsProperties(
        mobility=MOBILITY_CODES[physics.mobility or Mobility.STATIC],
        gravity=physics.gravity is not False,
        generate_overlap_events=physics.overlap_events is True,
        mass=physics.mass_kg or 0.0,
    )


def tag_message(tag: Tag) -> world_control_msgs.Tag:
    """A tag for the wire."""
    return world_control_msgs.Tag(type=tag.type, key=tag.key, value=tag.value)


def model_tags(body: Body) -> tuple[world_control_msgs.Tag, ...]:
    """A body's own tags, and behind them what a model has no field for."""
    told = {name: getattr(body, name) for name in ("label", "mesh", "shape", "size")}
    told |= {name: getattr(body.physics, name) for name in BodyPhysics.__struct_fields__}
    values = (
        body.iri,
        body.cls,
        body.mesh or "",
        body.shape.type.value if body.shape else "",
        " ".join(repr(float(extent)) for extent in body.size or ()),
        " ".join(name for name, value in told.items() if value is None),
    )
    own = (
        world_control_msgs.Tag(type=TAG_TYPE, key=key, value=value) for key, value in zip(TAG_KEYS, values, strict=True)
    )
    return (*map(tag_message, body.tags), *own)


def untranslatable_body_fields(body: Body) -> Iterator[ConversionNote]:
    """What a model cannot say of a body."""
    if body.facts:
        yield ConversionNote("facts", (body.id,), "a model has no place for facts")
    if any(material.color is not None for material in body.materials):
        yield ConversionNote("materials", (body.id,), "a model's materials have names and paths, and no colours")
    if any(set(tag.type + tag.key + tag.value) & set(";,") for tag in body.tags):
        yield ConversionNote(
            "tags", (body.id,), "they travel, but Unreal keeps tags as text in which ';' and ',' part them"
        )


def _mesh_name(body: Body) -> str:
    if body.mesh:
        return PurePosixPath(body.mesh).stem.removeprefix("SM_") or body.mesh
    return _local_name(body.cls)


def _content_folder(body: Body) -> str:
    """Where Unreal is to look first, if the mesh is named by a place among its content."""
    return str(PurePosixPath(body.mesh).parent) if body.mesh and body.mesh.startswith("/Game/") else ""


def _local_name(iri: str) -> str:
    return iri.rpartition("#")[2] or iri.rstrip("#").rpartition("/")[2]


# -- from the wire -----------------------------------------------------------------------------------------------------

Model = world_control_msgs.ModelDescription | world_control_msgs.SpawnModel.Request


def body_from_message(
    message: Model, *, id: str = "", namespace: str, path: str = ""
) -> tuple[Body, tuple[ConversionNote, ...]]:
    """The body that a model describes, and what was assumed.

    Args:
        model: from `spawn_semantic_map` or `spawn_model`.
        id: its id, where the model itself has none.
        namespace: what comes before the id in the IRI of a body that does not tell its own.
        path: where the model stands in the message, for errors.

    Raises:
        MessageValidationError: its `Mindstage` tags are broken.
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
    """The body that `spawn_pro_mesh` asks for: a box of that size.

    Args:
        request: what came.
        id: its id, where the request has none.
        namespace: what comes before the id in its IRI.
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
    """The IRI of something that the wire knows by its id only; some programs have IRIs for ids."""
    return Iri(id if "://" in id else namespace + id)


def physics_from_message(message: world_control_msgs.PhysicsProperties) -> BodyPhysics:
    """Physics from the wire, where everything is told."""
    return BodyPhysics(
        mobility=MOBILITY_BY_CODE[message.mobility],
        gravity=message.gravity,
        overlap_events=message.generate_overlap_events,
        mass_kg=message.mass,
    )


def materials_from_lists(names: tuple[str, ...], paths: tuple[str, ...]) -> tuple[Material, ...]:
    """Materials from two lists that run in parallel; what one of them lacks is empty."""
    count = max(len(names), len(paths))
    names, paths = names + ("",) * (count - len(names)), paths + ("",) * (count - len(paths))
    return tuple(Material(name=name, path=path) for name, path in zip(names, paths, strict=True))


def _with_tag_fields(body: Body, tags: tuple[Tag, ...], notes: dict[str, str], path: str) -> Body:
    """The body as the tags of ours complete it."""
    untold = set(notes["Untold"].split())
    physics = {name: None if name in untold else getattr(body.physics, name) for name in BodyPhysics.__struct_fields__}
    try:
        shape = None if "shape" in untold else PrimitiveShape(type=PrimitiveType(notes["Shape"]))
        size = None if "size" in untold else _parse_size(notes["Size"])
    except ValueError as error:
        raise MessageValidationError(
            "world_control_msgs/ModelDescription",
            path=f"{path}.tags" if path else "tags",
            cause=f"a tag of the type {TAG_TYPE} is broken: {error}",
            remedy="send a shape that is known and three sizes, or leave all tags of that type out",
        ) from error
    return Body(
        id=body.id,
        iri=Iri(notes["Iri"]),
        cls=Iri(notes["Class"]),
        pose=body.pose,
        label=None if "label" in untold else body.label or "",
        size=size,
        mesh=None if "mesh" in untold else notes["Mesh"],
        shape=shape,
        physics=BodyPhysics(**physics),
        materials=body.materials,
        tags=tags,
    )


def _assumption_notes(id: str, model: Model) -> Iterator[ConversionNote]:
    """What is guessed of a model that somebody else described."""
    yield ConversionNote("size", (id,), "a model does not say how large it is")
    yield ConversionNote("class", (id,), "only the name of a class is told, and it is taken as one of knowrob's")
    if len(model.material_names) != len(model.material_paths):
        yield ConversionNote("materials", (id,), "names and paths differ in number; what is missing is taken as empty")


def _parse_size(text: str) -> Vector:
    depth, width, height = map(float, text.split())
    return depth, width, height


def _class_name(tags: tuple[Tag, ...], name: str) -> str:
    """What the logger called the class, else the mesh's name, which Unreal's maps have from the class."""
    return next((tag.value for tag in tags if (tag.type, tag.key) == ("SemLog", "Class")), name) or "Thing"


LINEAR_AXES = ("x", "y", "z")
ANGULAR_AXES = ("swing1", "swing2", "twist")


def joint_message(joint: Joint) -> world_control_msgs.ConstraintDescription:
    """A constraint for the wire."""
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
    """What the wire cannot say of a constraint."""
    if joint.facts:
        yield ConversionNote("facts", (joint.id,), "a constraint has no place for facts there")
    if joint.tags:
        yield ConversionNote("tags", (joint.id,), "a constraint has no place for tags there")
    if joint.disable_collision is None:
        yield ConversionNote("disable_collision", (joint.id,), "what is not told is written as true there")
    if _shifted_axes(joint.linear, LINEAR_AXES) or _shifted_axes(joint.angular, ANGULAR_AXES):
        yield ConversionNote(
            "middle", (joint.id,), "a range is the same either way there, so it is widened until it is"
        )


def joint_from_message(
    message: world_control_msgs.ConstraintDescription, *, id: str = "", namespace: str
) -> tuple[Joint, tuple[ConversionNote, ...]]:
    """The constraint that is described, and what was left aside.

    Args:
        description: from the wire.
        id: its id, where the description has none.
        namespace: what comes before the id in its IRI, which the wire does not tell.
    """
    name = BodyId(message.id or id)
    details = message.constraint_details
    linear, angular = details.linear_limits, details.angular_limits
    constraint = Joint(
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
    return constraint, tuple(_ignored_note(name, details))


def _linear_message(motion: LinearLimits) -> world_control_msgs.LinearLimits:
    reach = [
        abs(getattr(motion, f"{axis}_middle")) for axis in LINEAR_AXES if getattr(motion, axis) is AxisMotion.LIMITED
    ]
    return world_control_msgs.LinearLimits(
        x_motion=world_control_msgs.MotionCode(motion.x),
        y_motion=world_control_msgs.MotionCode(motion.y),
        z_motion=world_control_msgs.MotionCode(motion.z),
        limit=motion.limit + max(reach, default=0.0),
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
        swing_1_limit_angle=_joint_reach(motion, "swing1"),
        swing_2_limit_angle=_joint_reach(motion, "swing2"),
        twist_limit_angle=_joint_reach(motion, "twist"),
        use_advanced=True,
        swing_soft_constraint=motion.swing_soft_limit.enabled,
        swing_stiffness=motion.swing_soft_limit.stiffness,
        swing_damping=motion.swing_soft_limit.damping,
        twist_soft_constraint=motion.twist_soft_limit.enabled,
        twist_stiffness=motion.twist_soft_limit.stiffness,
        twist_damping=motion.twist_soft_limit.damping,
    )


def _joint_reach(motion: AngularLimits, axis: str) -> float:
    limit: float = getattr(motion, f"{axis}_limit")
    middle: float = getattr(motion, f"{axis}_middle")
    return limit + abs(middle) if getattr(motion, axis) is AxisMotion.LIMITED else limit


def _shifted_axes(motion: LinearLimits | AngularLimits, axes: tuple[str, ...]) -> bool:
    return any(getattr(motion, axis) is AxisMotion.LIMITED and getattr(motion, f"{axis}_middle") for axis in axes)


def _soft_limit(use_advanced: bool, enabled: bool, stiffness: float, damping: float) -> SoftLimit:
    return SoftLimit(enabled=use_advanced and enabled, stiffness=stiffness, damping=damping)


def _ignored_note(id: str, details: world_control_msgs.PhysicsConstraintDetails) -> Iterator[ConversionNote]:
    linear, angular = details.linear_limits, details.angular_limits
    if linear.soft_constraint and not linear.use_advanced:
        yield ConversionNote("soft", (id,), "softness along the axes does not count without use_advanced")
    if (angular.swing_soft_constraint or angular.twist_soft_constraint) and not angular.use_advanced:
        yield ConversionNote("soft", (id,), "softness about the axes does not count without use_advanced")
    if angular.angular_roation_offset != geometry_msgs.Vector3():
        yield ConversionNote("angular_roation_offset", (id,), "it is left aside; turn the pose in its place")
    if details.enable_projection:
        yield ConversionNote("enable_projection", (id,), "how an engine corrects errors is left to the engine")
    if details.parent_dominates:
        yield ConversionNote("parent_dominates", (id,), "it is left aside; make the parent static in its place")


def spawn_request(world: World) -> world_control_msgs.SpawnSemanticMap.Request:
    """A world for `spawn_semantic_map`; `untranslatable_fields` tells what is not in it."""
    return world_control_msgs.SpawnSemanticMap.Request(
        models=tuple(model_message(body) for body in world.bodies),
        constraints=tuple(joint_message(constraint) for constraint in world.joints),
        relations=tuple(relation_message(attachment) for attachment in world.attachments),
    )


def untranslatable_fields(world: World) -> tuple[ConversionNote, ...]:
    """What of a world `spawn_semantic_map` has no way to say. What is not named here comes back as it was."""
    return merge_notes(_untranslatable(world))


def world_from_request(
    request: world_control_msgs.SpawnSemanticMap.Request, *, iri: Iri, name: str = "", taken: Container[str] = ()
) -> tuple[World, tuple[ConversionNote, ...]]:
    """The world that a request describes, and what was assumed on the way.

    Args:
        request: what came.
        iri: the IRI of the map, which no request tells; those of its things start like it.
        name: what to call the map.
        taken: ids that are not to be given to a model or a constraint without one.

    Raises:
        MessageValidationError: the tags of a model that Mindstage wrote are broken.
    """
    namespace = _namespace(iri)
    named = {model.id for model in request.models} | {constraint.id for constraint in request.constraints}
    told: list[ConversionNote] = []
    bodies, constraints = [], []
    for at, model in enumerate(request.models):
        id = model.id or _generated_id(model.name or "Model", named, taken, told)
        body, assumed = body_from_message(model, id=id, namespace=namespace, path=f"models[{at}]")
        bodies.append(body)
        told += assumed
    for description in request.constraints:
        id = description.id or _generated_id("Constraint", named, taken, told)
        constraint, aside = joint_from_message(description, id=id, namespace=namespace)
        constraints.append(constraint)
        told += aside
    world = World(
        iri=iri,
        name=name,
        bodies=tuple(bodies),
        joints=tuple(constraints),
        attachments=tuple(map(attachment_from_message, request.relations)),
    )
    return world, merge_notes(told)


def relation_message(attachment: Attachment) -> world_control_msgs.RelationDescription:
    """An attachment for the wire."""
    return world_control_msgs.RelationDescription(parent_id=attachment.parent, child_id=attachment.child)


def attachment_from_message(relation: world_control_msgs.RelationDescription) -> Attachment:
    """An attachment from the wire."""
    return Attachment(parent=BodyId(relation.parent_id), child=BodyId(relation.child_id))


def _untranslatable(world: World) -> Iterator[ConversionNote]:
    for body in world.bodies:
        yield from untranslatable_body_fields(body)
    for constraint in world.joints:
        yield from untranslatable_joint_fields(constraint)
        if constraint.iri != iri_from_id(constraint.id, _namespace(world.iri)):
            yield ConversionNote("iri", (constraint.id,), "a constraint's IRI is not told; it is taken from its id")
    for light in world.lights:
        yield ConversionNote("lights", (light.id,), "there are no lights there")
    if world.facts or world.resources:
        yield ConversionNote("facts", (world.iri,), "what is said of the map and of anything but bodies stays behind")


def _namespace(iri: Iri) -> str:
    return iri.rpartition("#")[0] + "#" if "#" in iri else f"{iri}#"


def _generated_id(stem: str, name: set[str], taken: Container[str], notes: list[ConversionNote]) -> str:
    """An id of its own for something that came without one."""
    tries = (f"{stem}_{number}" for number in count(1))
    id = next(each for each in tries if each not in name and each not in taken)
    name.add(id)
    notes.append(ConversionNote("id", (id,), "it came without an id and got this one"))
    return id
