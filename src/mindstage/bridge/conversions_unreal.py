"""Models: a body as the wire describes a model, and back.

Unreal finds a mesh by its name, so a model is called like its body's mesh, or else like its class, as the community's
maps mean it. What a model has no field for and can be said in a few words goes along as tags of the type `Mindstage`,
always these, in this order and behind all others; so they are found again, and a body's own tags are never taken for
them:

    Iri, Class, Mesh, Shape ("box"), Size ("depth width height"), Untold (the names of fields that the map leaves out)

Facts, and the colors of materials, stay behind.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePosixPath

from mindstage.bridge.description.geometry import pose_from_message, pose_message
from mindstage.bridge.description.remarks import ConversionNote
from mindstage.errors import MessageValidationError
from mindstage.msgs import world_control_msgs
from mindstage.world import (
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Material,
    Mobility,
    PrimitiveShape,
    PrimitiveType,
    Tag,
    Vector,
)

__all__ = [
    "CLASS_NAMESPACE",
    "body_from_box",
    "body_from_message",
    "iri_from_id",
    "materials_from_lists",
    "model_message",
    "model_tags",
    "physics_from_message",
    "physics_message",
    "spawn_model_request",
    "tag_message",
    "untranslatable_body_fields",
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
