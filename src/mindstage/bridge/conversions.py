"""Conversion between the types of `scene` and ROS messages or JSON.

Poses, points and colors become fields of messages; both sides use the ROS frame and meters, quaternions are w x y z in
memory and named fields in messages, and the digits are kept. Worlds, body geometries and physics model deltas become
JSON without loss, since ROS messages can represent neither a missing value nor a fact.

An error of the world is returned as a `Refusal` (`success: false`). Any other error fails the call itself (`result:
false`) with a text: its first line is the message, its second line the fields of the error as JSON.

Body geometries contain the collision shapes, and the name of a mesh file for the visual mesh in a folder that both
sides can read; the name is derived from the key of the geometry and is not a path. Without that file, the collision
shapes are displayed.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from math import isfinite
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.access.limits import SIZE
from mindstage.errors import (
    AttachmentError,
    BodyExistsError,
    BodyNotFoundError,
    EngineClosedError,
    EngineError,
    EngineMemoryError,
    EngineTimeoutError,
    EngineUnavailableError,
    MessageValidationError,
    PoseUnreachableError,
    SimulationDivergedError,
    UnsupportedByEngineError,
    WorldError,
)
from mindstage.msgs import geometry_msgs, mindstage_msgs, std_msgs, world_control_msgs
from mindstage.msgs.schema.base import to_python_number, validation_error_details
from mindstage.scene import (
    IDENTITY,
    AngularLimits,
    AttachedLight,
    BodyGeometry,
    BodyId,
    CollisionShape,
    CollisionShapeType,
    Color,
    GeometryMap,
    GeometrySource,
    Iri,
    LinearLimits,
    Mobility,
    PbrMaterial,
    Pose,
    SupportSurface,
    Vector,
    VisualMesh,
    World,
)
from mindstage.scene.colors import COLORS
from mindstage.scene.geometry import Inertia
from mindstage.scene.world_model import FrozenStruct

__all__ = [
    "FORMAT_VERSION",
    "BodyModelDelta",
    "ConversionNote",
    "JointModelDelta",
    "PhysicsModelDelta",
    "color_code",
    "color_from_code",
    "color_from_message",
    "color_message",
    "error_from_text",
    "error_text",
    "error_to_message",
    "from_json",
    "geometry_from_json",
    "geometry_to_json",
    "merge_notes",
    "mesh_name",
    "message_to_error",
    "model_delta_to_json",
    "point_from_message",
    "point_message",
    "pose_array_from_messages",
    "pose_array_messages",
    "pose_from_message",
    "pose_message",
    "to_json",
    "vector_from_message",
    "vector_message",
    "world_from_json",
    "world_to_json",
]


_COLORS: dict[world_control_msgs.ColorCode, Color] = {
    world_control_msgs.ColorCode(code): color for code, color in enumerate(COLORS.values(), start=1)
}
WORLD_ERROR_FACTORIES: dict[str, Callable[[mindstage_msgs.Refusal], WorldError]] = {
    "BodyNotFoundError": lambda message: BodyNotFoundError(
        message.body, known=message.suggestions, world=message.world
    ),
    "BodyExistsError": lambda message: BodyExistsError(message.body),
    "PoseUnreachableError": lambda message: PoseUnreachableError(message.body, reason=message.reason),
    "AttachmentError": lambda message: AttachmentError(message.parent, message.child, reason=message.reason),
}
ENGINE_ERROR_TYPES: dict[str, type[EngineError]] = {
    cls.__name__: cls
    for cls in (
        EngineUnavailableError,
        EngineTimeoutError,
        UnsupportedByEngineError,
        EngineClosedError,
        EngineMemoryError,
        SimulationDivergedError,
    )
}
T = TypeVar("T")
FORMAT_VERSION = World(iri=Iri("")).format_version
"""Version of the JSON of worlds."""
_MESH_NAME = re.compile(r"[0-9a-f]{8,64}\.glb")
_MESSAGE_ONLY_FIELDS = ("mesh", "material")


def pose_message(pose: Pose) -> geometry_msgs.Pose:
    """Converts a pose to a message."""
    w, x, y, z = pose.quaternion
    return geometry_msgs.Pose(
        position=point_message(pose.position), orientation=geometry_msgs.Quaternion(x=x, y=y, z=z, w=w)
    )


def pose_from_message(message: geometry_msgs.Pose) -> Pose:
    """Converts a message to a pose."""
    rotation = message.orientation
    return Pose(point_from_message(message.position), (rotation.w, rotation.x, rotation.y, rotation.z))


def pose_array_messages(rows: NDArray[np.float64]) -> tuple[geometry_msgs.Pose, ...]:
    """Converts poses to messages; the array is n x 7: x y z [m], then quaternion w x y z."""
    return tuple(
        geometry_msgs.Pose(
            position=geometry_msgs.Point(x=x, y=y, z=z), orientation=geometry_msgs.Quaternion(x=i, y=j, z=k, w=w)
        )
        for x, y, z, w, i, j, k in rows.tolist()
    )


def pose_array_from_messages(messages: Sequence[geometry_msgs.Pose]) -> NDArray[np.float64]:
    """Converts messages to poses, an array n x 7: x y z [m], then quaternion w x y z."""
    return np.array([_pose_row(message) for message in messages], dtype=np.float64).reshape(-1, 7)


def _pose_row(message: geometry_msgs.Pose) -> Iterable[float]:
    position, rotation = message.position, message.orientation
    return position.x, position.y, position.z, rotation.w, rotation.x, rotation.y, rotation.z


def point_message(vector: Vector) -> geometry_msgs.Point:
    """Converts a point to a message."""
    x, y, z = vector
    return geometry_msgs.Point(x=x, y=y, z=z)


def point_from_message(message: geometry_msgs.Point) -> Vector:
    """Converts a message to a point."""
    return message.x, message.y, message.z


def vector_message(vector: Vector) -> geometry_msgs.Vector3:
    """Converts a direction or a force to a message."""
    x, y, z = vector
    return geometry_msgs.Vector3(x=x, y=y, z=z)


def vector_from_message(message: geometry_msgs.Vector3) -> Vector:
    """Converts a message to a direction or a force."""
    return message.x, message.y, message.z


def color_message(color: Color, *, opacity: float = 1.0) -> std_msgs.ColorRGBA:
    """Converts a color to a message."""
    red, green, blue = color
    return std_msgs.ColorRGBA(r=red, g=green, b=blue, a=opacity)


def color_from_message(message: std_msgs.ColorRGBA) -> Color:
    """Converts a message to a color, without its opacity."""
    return message.r, message.g, message.b


def color_from_code(code: world_control_msgs.ColorCode) -> Color | None:
    """Returns the color of a code; None removes the highlight."""
    return _COLORS.get(code)


def color_code(color: Color | None) -> world_control_msgs.ColorCode:
    """Returns the code of the nearest of the five colors that have one."""
    if color is None:
        return world_control_msgs.ColorCode.NONE
    return min(_COLORS, key=lambda code: sum((a - b) ** 2 for a, b in zip(_COLORS[code], color, strict=True)))


def error_to_message(error: WorldError) -> mindstage_msgs.Refusal:
    """Converts an error of the world to a message."""
    facts = vars(error)
    fields = {name: facts[name] for name in mindstage_msgs.Refusal.__struct_fields__ if name in facts}
    return mindstage_msgs.Refusal(code=error.code, text=str(error), **fields)


def message_to_error(message: mindstage_msgs.Refusal) -> WorldError:
    """Converts a message to an error of its class; a `WorldError` with the text if the class is unknown."""
    factory = WORLD_ERROR_FACTORIES.get(message.code)
    return factory(message) if factory else WorldError(message.text)


def error_text(error: EngineError) -> str:
    """Encodes an engine error as the text of a failed call."""
    facts = {"code": error.code, **vars(error)}
    return f"{error}\n{msgspec.json.encode(facts).decode()}"


def error_from_text(text: str) -> EngineError:
    """Decodes the text of a failed call; an `EngineError` with the first line if the text has another format."""
    message, _, fields = text.partition("\n")
    try:
        values = msgspec.json.decode(fields, type=dict[str, str | float])
        return ENGINE_ERROR_TYPES[str(values.pop("code"))](**values)
    except (msgspec.MsgspecError, KeyError, TypeError):
        return EngineError(message)


class ConversionNote(msgspec.Struct, frozen=True):
    """Information that is lost in a conversion, or a value that was assumed because it was missing."""

    field: str
    """The field, such as `facts` or `class`."""
    ids: tuple[str, ...]
    """Ids of the bodies, joints or lights."""
    text: str


def merge_notes(notes: Iterable[ConversionNote]) -> tuple[ConversionNote, ...]:
    """Merges the notes with the same field and text."""
    ids: defaultdict[tuple[str, str], dict[str, None]] = defaultdict(dict)
    for note in notes:
        ids[note.field, note.text].update(dict.fromkeys(note.ids))
    return tuple(ConversionNote(field, tuple(merged), text) for (field, text), merged in ids.items())


class FormatVersion(msgspec.Struct):
    """The field of a world that determines whether the others can be decoded."""

    format_version: int


def world_to_json(world: World) -> str:
    """Encodes a world as JSON; `format_version` is always included.

    Raises:
        MessageValidationError: it has a value that JSON cannot represent, such as NaN.
    """
    try:
        fields = {**msgspec.to_builtins(world, enc_hook=to_python_number), "format_version": world.format_version}
    except (TypeError, RecursionError) as error:
        raise MessageValidationError("a world", cause=str(error)) from error
    return to_json(fields, World)


def world_from_json(text: str | bytes) -> World:
    """Decodes the JSON of `world_to_json`.

    Raises:
        MessageValidationError: it is not the JSON of a world, or of another version.
    """
    version = from_json(text, FormatVersion).format_version
    if version != FORMAT_VERSION:
        raise MessageValidationError(
            "a world",
            path="format_version",
            cause=f"it is {version}, and this version of Mindstage reads {FORMAT_VERSION}",
            remedy="use the same version of Mindstage on both sides",
        )
    return from_json(text, World)


def to_json(value: object, type: Any = None) -> str:
    """Encodes a part of a world (`BodyPhysics`, a tuple of `Material`s) as JSON.

    Args:
        value: the part.
        type: type for decoding, if it is not that of the value; for a tuple, such as `tuple[Material, ...]`.

    Raises:
        MessageValidationError: it has a value that JSON cannot represent, such as NaN.
    """
    try:
        text = msgspec.json.encode(value, enc_hook=to_python_number).decode()
    except (TypeError, UnicodeError, RecursionError) as error:
        raise MessageValidationError(_type_name(type or value.__class__), cause=str(error)) from error
    # msgspec encodes NaN and infinities as null, which decoding detects, since null is not a number.
    from_json(text, type or value.__class__)
    return text


def from_json(text: str | bytes, type: type[T]) -> T:
    """Decodes a part of a world from JSON.

    Raises:
        MessageValidationError: it is not JSON, or not of that type.
    """
    try:
        return msgspec.json.decode(text, type=type)
    except msgspec.ValidationError as error:
        cause, path = validation_error_details(error)
        raise MessageValidationError(_type_name(type), path=path, cause=cause) from error
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise MessageValidationError(_type_name(type), cause=f"it is not JSON: {error}") from error


def _type_name(type: Any) -> str:
    return "a world" if type in {World, FormatVersion} else getattr(type, "__name__", str(type))


class BodyModelDelta(FrozenStruct, frozen=True, kw_only=True):
    """Physics of a body from now on."""

    size: Vector
    """Effective size: assumed if the map has none [m]."""
    top: BodyId
    """Root of the rigid assembly that the body belongs to; the body itself if it is the root."""
    hold: Pose = IDENTITY
    """Pose in the frame of the root."""
    mobility: Mobility = Mobility.STATIC
    """Mobility of the whole assembly."""
    gravity: bool = True
    """Whether gravity acts on the body."""
    mass_kg: float = 0.0
    """Effective mass: estimated if the map has none; 0 for a body that is not dynamic [kg]."""
    ghost: bool = False
    """Whether the body collides with nothing."""
    collision_shapes: tuple[CollisionShape, ...] = ()
    """Collision shapes, in the frame of the body."""
    friction: float | None = None
    """Coefficient of friction; None is the default of the engine."""
    restitution: float | None = None
    on_ground: bool = False
    """Whether the body collides with the ground."""
    inertia: Inertia | None = None
    """Mass distribution; None for that of the collision shapes."""


class GroundDelta(FrozenStruct, frozen=True, kw_only=True):
    """A changed ground."""

    height_m: float | None
    """Its height [m]; None if it is removed."""
    area: tuple[float, float, float, float] | None = None
    """Its rectangle, least x and y and largest x and y [m]; None for a plane."""


class DriveModelDelta(FrozenStruct, frozen=True, kw_only=True):
    """An actuator of a joint; see `mindstage.engines.Actuator`."""

    name: str
    axis: int
    """0 to 5: x, y, z, twist, swing2, swing1."""
    mode: str
    effort_limit: float
    stiffness: float = 0.0
    damping: float = 0.0
    armature: float = 0.0
    friction: float = 0.0


class JointModelDelta(FrozenStruct, frozen=True, kw_only=True):
    """Frames of a joint in its parent and its child; where they coincide, the displacement is zero."""

    parent: BodyId
    child: BodyId
    of_parent: Pose = IDENTITY
    of_child: Pose = IDENTITY
    linear: LinearLimits | None = None
    """Limits to simulate instead of those of the world; None for the latter."""
    angular: AngularLimits | None = None
    drives: tuple[DriveModelDelta, ...] = ()
    """Its actuators."""
    is_driven: bool = False
    """Whether it has actuators, or follows a joint that has some: then it has no other friction."""


class PhysicsModelDelta(FrozenStruct, frozen=True, kw_only=True):
    """Difference to the previous physics model; for a new world, the whole model. What is not listed is unchanged."""

    bodies: dict[BodyId, BodyModelDelta] = msgspec.field(default_factory=dict)
    """New or changed bodies, by id."""
    excluded_pairs: tuple[tuple[BodyId, BodyId], ...] = ()
    """Pairs of bodies that no longer collide."""
    included_pairs: tuple[tuple[BodyId, BodyId], ...] = ()
    """Pairs of bodies that collide again."""
    joints: dict[BodyId, JointModelDelta | None] = msgspec.field(default_factory=dict)
    """Active joints, by id; None for one that is removed."""
    poses: dict[BodyId, Pose] = msgspec.field(default_factory=dict)
    """Bodies that are set to another pose at rest, including those attached to them."""
    ground: GroundDelta | None = None
    """None if the ground is unchanged."""


def model_delta_to_json(change: PhysicsModelDelta) -> str:
    """Encodes a difference as JSON; fields with their default are left out.

    Raises:
        MessageValidationError: it has a value that JSON cannot represent, such as NaN.
    """
    return to_json(change)


class GeometryMessage(
    FrozenStruct,
    frozen=True,
    kw_only=True,
):
    """The JSON of a body geometry; fields that are missing have their defaults."""

    collision_shapes: tuple[CollisionShape, ...] = ()
    source: GeometrySource = GeometrySource.MAP
    reason: str = ""
    shape_name: str = "box"
    friction: float | None = None
    restitution: float | None = None
    density: float | None = None
    inertia: Inertia | None = None
    support_surfaces: tuple[SupportSurface, ...] = ()
    lights: tuple[AttachedLight, ...] = ()
    mesh: str = ""
    """Name of the mesh file; empty if there is none."""
    material: PbrMaterial | None = None
    """Material of the collision shapes, if those are displayed."""


class GeometryMapMessage(FrozenStruct, frozen=True, kw_only=True):
    """The JSON of the geometries of some bodies; equal geometries are listed once."""

    bodies: dict[BodyId, str] = msgspec.field(default_factory=dict)
    """Key of the geometry of each body."""
    geometries: dict[str, GeometryMessage] = msgspec.field(default_factory=dict)


def mesh_name(key: str) -> str:
    """Returns the name of the mesh file of a geometry; empty if its key is not a digest and so not a safe file name."""
    name = f"{key}.glb"
    return name if _MESH_NAME.fullmatch(name) else ""


def geometry_to_json(geometry: GeometryMap, *, mesh: Callable[[BodyGeometry], str] = lambda geometry: "") -> str:
    """Encodes body geometries as JSON; an empty string if there are none.

    Args:
        geometry: geometries by body.
        mesh: returns the name of the mesh file of a geometry, or an empty string.

    Raises:
        MessageValidationError: a geometry has a value that JSON cannot represent, such as NaN.
    """
    if not geometry:
        return ""
    by_key = {each.key: each for each in geometry.values()}
    message = GeometryMapMessage(
        bodies={id: each.key for id, each in geometry.items()},
        geometries={key: _to_message(each, mesh(each)) for key, each in by_key.items()},
    )
    return to_json(message)


def geometry_from_json(
    text: str, *, load_visuals: Callable[[str], tuple[VisualMesh, ...]] = lambda mesh: ()
) -> Mapping[BodyId, BodyGeometry]:
    """Decodes the JSON of `geometry_to_json`.

    Args:
        text: the JSON.
        load_visuals: returns the visual meshes of a mesh file; empty if there is no such file.

    Raises:
        MessageValidationError: it is not such JSON, or a geometry is invalid.
    """
    if not text:
        return {}
    message = from_json(text, GeometryMapMessage)
    geometries = {key: _from_message(key, each, load_visuals) for key, each in message.geometries.items()}
    for id, key in message.bodies.items():
        if key not in geometries:
            raise MessageValidationError("geometries", path=f"bodies.{id}", cause=f"no geometry has the key {key!r}")
    return {id: geometries[key] for id, key in message.bodies.items()}


def _shared_fields(geometry: BodyGeometry | GeometryMessage) -> dict[str, Any]:
    """Returns the fields that a body geometry and its message have in common."""
    return {
        name: getattr(geometry, name) for name in GeometryMessage.__struct_fields__ if name not in _MESSAGE_ONLY_FIELDS
    }


def _to_message(geometry: BodyGeometry, mesh: str) -> GeometryMessage:
    return GeometryMessage(
        **_shared_fields(geometry),
        mesh=mesh,
        material=max(geometry.visuals, key=lambda visual: len(visual.faces)).material if geometry.visuals else None,
    )


def _from_message(
    key: str, message: GeometryMessage, load_visuals: Callable[[str], tuple[VisualMesh, ...]]
) -> BodyGeometry:
    if message.mesh and message.mesh != mesh_name(key):
        raise MessageValidationError(
            "geometries", path=f"geometries.{key}.mesh", cause=f"{message.mesh!r} is not the mesh of this geometry"
        )
    for number, shape in enumerate(message.collision_shapes):
        if cause := _shape_error(shape):
            raise MessageValidationError("geometries", path=f"geometries.{key}.collision_shapes[{number}]", cause=cause)
    return BodyGeometry(
        key=key,
        visuals=load_visuals(message.mesh) if message.mesh else (),
        **_shared_fields(message),
    )


def _shape_error(shape: CollisionShape) -> str:
    """Returns why a collision shape is invalid, or an empty string."""
    if not all(0.0 < extent <= SIZE.maximum for extent in shape.size):
        return f"its size {shape.size} is not positive and at most {SIZE.maximum:g} m"
    if not _is_rigid(shape.pose):
        return "its pose is not finite, or its quaternion is not of norm 1"
    if shape.type is CollisionShapeType.HULL and len(shape.points) < 4:
        return f"a hull has at least 4 points, not {len(shape.points)}"
    return ""


def _is_rigid(pose: Pose) -> bool:
    norm = sum(part * part for part in pose.quaternion)
    return all(map(isfinite, pose.position)) and abs(norm - 1.0) < 1e-6
