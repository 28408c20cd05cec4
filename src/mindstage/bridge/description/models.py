"""Models: a body as the wire describes a model, and back.

Unreal finds a mesh by its name, so a model is called like its body's mesh, or else like its class, as the community's
maps mean it. What a model has no field for and can be said in a few words goes along as tags of the type `Mindstage`,
always these, in this order and behind all others; so they are found again, and a body's own tags are never taken for
them:

    Iri, Class, Mesh, Shape ("box"), Size ("depth width height"), Untold (the names of fields that the map leaves out)

Facts, and the colours of materials, stay behind.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePosixPath

from mindstage.bridge.description.geometry import pose_from, pose_message
from mindstage.bridge.description.remarks import Remark
from mindstage.errors import MessageRefused
from mindstage.msgs import world_control_msgs
from mindstage.world import Body, BodyId, Iri, Material, Mobility, Physics, Shape, ShapeKind, Tag, Vector

__all__ = [
    "CLASS_NAMESPACE",
    "body_from",
    "body_from_box",
    "individual",
    "materials_from",
    "model_description",
    "model_request",
    "model_tags",
    "physics_from",
    "physics_message",
    "tag_message",
    "unsaid_of_body",
]

CLASS_NAMESPACE = "http://knowrob.org/kb/knowrob.owl#"
"""Where a model's class is looked for when only its name is told: the community's maps have theirs there."""

TYPE = "Mindstage"
KEYS = ("Iri", "Class", "Mesh", "Shape", "Size", "Untold")
CODES = {
    Mobility.STATIC: world_control_msgs.MobilityCode.STATIC,
    Mobility.STATIONARY: world_control_msgs.MobilityCode.STATIONARY,
    Mobility.DYNAMIC: world_control_msgs.MobilityCode.DYNAMIC,
    Mobility.KINEMATIC: world_control_msgs.MobilityCode.KINEMATIC,
}
MOBILITIES = {code: mobility for mobility, code in CODES.items()}

# -- to the wire -------------------------------------------------------------------------------------------------------


def model_description(body: Body) -> world_control_msgs.ModelDescription:
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


def model_request(
    body: Body, *, parent: str = "", spawn_collision_check: bool = False
) -> world_control_msgs.SpawnModel.Request:
    """A body for `spawn_model`.

    Args:
        body: what to spawn.
        parent: the id of what it hangs on.
        spawn_collision_check: do not spawn it into something else.
    """
    model = model_description(body)
    return world_control_msgs.SpawnModel.Request(
        **{name: getattr(model, name) for name in world_control_msgs.ModelDescription.__struct_fields__},
        parent_id=parent,
        spawn_collision_check=spawn_collision_check,
    )


def physics_message(physics: Physics) -> world_control_msgs.PhysicsProperties:
    """Physics for the wire; what is not told is written as what it is taken for."""
    return world_control_msgs.PhysicsProperties(
        mobility=CODES[physics.mobility or Mobility.STATIC],
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
    told |= {name: getattr(body.physics, name) for name in Physics.__struct_fields__}
    values = (
        body.iri,
        body.cls,
        body.mesh or "",
        body.shape.kind.value if body.shape else "",
        " ".join(repr(float(extent)) for extent in body.size or ()),
        " ".join(name for name, value in told.items() if value is None),
    )
    own = (world_control_msgs.Tag(type=TYPE, key=key, value=value) for key, value in zip(KEYS, values, strict=True))
    return (*map(tag_message, body.tags), *own)


def unsaid_of_body(body: Body) -> Iterator[Remark]:
    """What a model cannot say of a body."""
    if body.facts:
        yield Remark("facts", (body.id,), "a model has no place for facts")
    if any(material.colour is not None for material in body.materials):
        yield Remark("materials", (body.id,), "a model's materials have names and paths, and no colours")
    if any(set(tag.type + tag.key + tag.value) & set(";,") for tag in body.tags):
        yield Remark("tags", (body.id,), "they travel, but Unreal keeps tags as text in which ';' and ',' part them")


def _mesh_name(body: Body) -> str:
    if body.mesh:
        return PurePosixPath(body.mesh).stem.removeprefix("SM_") or body.mesh
    return _local(body.cls)


def _content_folder(body: Body) -> str:
    """Where Unreal is to look first, if the mesh is named by a place among its content."""
    return str(PurePosixPath(body.mesh).parent) if body.mesh and body.mesh.startswith("/Game/") else ""


def _local(iri: str) -> str:
    return iri.rpartition("#")[2] or iri.rstrip("#").rpartition("/")[2]


# -- from the wire -----------------------------------------------------------------------------------------------------

Model = world_control_msgs.ModelDescription | world_control_msgs.SpawnModel.Request


def body_from(model: Model, *, id: str = "", namespace: str, path: str = "") -> tuple[Body, tuple[Remark, ...]]:
    """The body that a model describes, and what was assumed.

    Args:
        model: from `spawn_semantic_map` or `spawn_model`.
        id: its id, where the model itself has none.
        namespace: what comes before the id in the IRI of a body that does not tell its own.
        path: where the model stands in the message, for errors.

    Raises:
        MessageRefused: its `Mindstage` tags are broken.
    """
    name = BodyId(model.id or id)
    tags = tuple(Tag(type=tag.type, key=tag.key, value=tag.value) for tag in model.tags)
    plain = Body(
        id=name,
        iri=individual(name, namespace),
        cls=Iri(CLASS_NAMESPACE + _class_name(tags, model.name)),
        pose=pose_from(model.pose),
        label=model.actor_label or None,
        mesh=f"{model.path.rstrip('/')}/{model.name}" if model.path else model.name or None,
        physics=physics_from(model.physics_properties),
        materials=materials_from(model.material_names, model.material_paths),
        tags=tags,
    )
    own = tags[-len(KEYS) :]
    if tuple((tag.type, tag.key) for tag in own) == tuple((TYPE, key) for key in KEYS):
        return _told_whole(
            plain, tags[: -len(KEYS)], dict(zip(KEYS, (tag.value for tag in own), strict=True)), path
        ), ()
    return plain, tuple(_assumed(name, model))


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
        iri=individual(name, namespace),
        cls=Iri(CLASS_NAMESPACE + _class_name(tags, "Box")),
        pose=pose_from(request.pose),
        label=request.actor_label or None,
        size=(request.depth, request.width, request.height),
        shape=Shape(kind=ShapeKind.BOX),
        physics=physics_from(request.physics_properties),
        tags=tags,
    )


def individual(id: str, namespace: str) -> Iri:
    """The IRI of something that the wire knows by its id only; some programs have IRIs for ids."""
    return Iri(id if "://" in id else namespace + id)


def physics_from(message: world_control_msgs.PhysicsProperties) -> Physics:
    """Physics from the wire, where everything is told."""
    return Physics(
        mobility=MOBILITIES[message.mobility],
        gravity=message.gravity,
        overlap_events=message.generate_overlap_events,
        mass_kg=message.mass,
    )


def materials_from(names: tuple[str, ...], paths: tuple[str, ...]) -> tuple[Material, ...]:
    """Materials from two lists that run in parallel; what one of them lacks is empty."""
    count = max(len(names), len(paths))
    names, paths = names + ("",) * (count - len(names)), paths + ("",) * (count - len(paths))
    return tuple(Material(name=name, path=path) for name, path in zip(names, paths, strict=True))


def _told_whole(body: Body, tags: tuple[Tag, ...], said: dict[str, str], path: str) -> Body:
    """The body as the tags of ours complete it."""
    untold = set(said["Untold"].split())
    physics = {name: None if name in untold else getattr(body.physics, name) for name in Physics.__struct_fields__}
    try:
        shape = None if "shape" in untold else Shape(kind=ShapeKind(said["Shape"]))
        size = None if "size" in untold else _size(said["Size"])
    except ValueError as error:
        raise MessageRefused(
            "world_control_msgs/ModelDescription",
            path=f"{path}.tags" if path else "tags",
            cause=f"a tag of the type {TYPE} is broken: {error}",
            remedy="send a shape that is known and three sizes, or leave all tags of that type out",
        ) from error
    return Body(
        id=body.id,
        iri=Iri(said["Iri"]),
        cls=Iri(said["Class"]),
        pose=body.pose,
        label=None if "label" in untold else body.label or "",
        size=size,
        mesh=None if "mesh" in untold else said["Mesh"],
        shape=shape,
        physics=Physics(**physics),
        materials=body.materials,
        tags=tags,
    )


def _assumed(id: str, model: Model) -> Iterator[Remark]:
    """What is guessed of a model that somebody else described."""
    yield Remark("size", (id,), "a model does not say how large it is")
    yield Remark("class", (id,), "only the name of a class is told, and it is taken as one of knowrob's")
    if len(model.material_names) != len(model.material_paths):
        yield Remark("materials", (id,), "names and paths differ in number; what is missing is taken as empty")


def _size(text: str) -> Vector:
    depth, width, height = map(float, text.split())
    return depth, width, height


def _class_name(tags: tuple[Tag, ...], name: str) -> str:
    """What the logger called the class, else the mesh's name, which Unreal's maps have from the class."""
    return next((tag.value for tag in tags if (tag.type, tag.key) == ("SemLog", "Class")), name) or "Thing"
