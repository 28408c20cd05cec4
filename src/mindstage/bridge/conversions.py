"""Forms: what bodies are made of, on the wire.

What is touched travels in full, what is seen as the name of a mesh file in a folder that both sides can read: its name
is the form's key, so it never has to be sent twice, and it is no path. Whoever has no such file shows the solids.

Geometry: poses, points and colors on the wire. Nothing is converted but where the numbers stand.

The wire is in ROS's frame and in meters, as a world is; a quaternion is w x y z in memory and has four names there.
Digits stay as they are, so a quaternion that a map has normalized to six digits only arrives as it was.

Refusals: how an error crosses the wire, so that it is the same error on the other side.

What the world refuses travels in a reply (`success: false`) as a `Refusal`. What breaks outside of it ends the call
itself (`result: false`), and all that rosbridge has for that is a text: its first line is for people, and a second one
holds the facts for us.

Remarks: what does not cross the border between a world and the wire, or is assumed there.

Worlds: a world, or a part of one, as JSON, exact: every fact, every tag, every digit.

This is how mindstage_msgs carries them, since ROS has no word for a value that is not told and no place for a fact.

Plans: what Mindstage decided for an engine that leaves decisions to it, on the wire.

Who moves rigidly with whom, who collides with whom, what is touched, how much it weighs, and which constraints hold. A
`PhysicsModelDelta` tells what is new; whatever it does not name runs on as it was.
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

from mindstage.errors import (
    AttachmentError,
    BodyExistsError,
    BodyNotFoundError,
    EngineClosedError,
    EngineError,
    EngineTimeoutError,
    EngineUnavailableError,
    MessageValidationError,
    PoseUnreachableError,
    SimulationDivergedError,
    UnsupportedByEngineError,
    WorldError,
)
from mindstage.msgs import geometry_msgs, mindstage_msgs, std_msgs, world_control_msgs
from mindstage.msgs.base import to_python_number, validation_error_details
from mindstage.scene import (
    IDENTITY,
    AttachedLight,
    BodyGeometry,
    BodyId,
    CollisionShape,
    CollisionShapeType,
    Color,
    GeometryMap,
    GeometrySource,
    Iri,
    Mobility,
    PbrMaterial,
    Pose,
    SupportSurface,
    Vector,
    VisualMesh,
    World,
)
from mindstage.scene.colors import COLORS
from mindstage.scene.model import FrozenStruct

__all__ = [
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


def pose_message(pose: Pose) -> geometry_msgs.Pose:
    """A pose for the wire."""
    w, x, y, z = pose.quaternion
    return geometry_msgs.Pose(
        position=point_message(pose.position), orientation=geometry_msgs.Quaternion(x=x, y=y, z=z, w=w)
    )


def pose_from_message(message: geometry_msgs.Pose) -> Pose:
    """A pose from the wire."""
    turn = message.orientation
    return Pose(point_from_message(message.position), (turn.w, turn.x, turn.y, turn.z))


def pose_array_messages(rows: NDArray[np.float64]) -> tuple[geometry_msgs.Pose, ...]:
    """Many poses for the wire, from an array n x 7: x y z, then w x y z."""
    return tuple(
        geometry_msgs.Pose(
            position=geometry_msgs.Point(x=x, y=y, z=z), orientation=geometry_msgs.Quaternion(x=i, y=j, z=k, w=w)
        )
        for x, y, z, w, i, j, k in rows.tolist()
    )


def pose_array_from_messages(messages: Sequence[geometry_msgs.Pose]) -> NDArray[np.float64]:
    """Many poses from the wire, as an array n x 7: x y z, then w x y z."""
    return np.array([_pose_row(message) for message in messages], dtype=np.float64).reshape(-1, 7)


def _pose_row(message: geometry_msgs.Pose) -> Iterable[float]:
    at, turn = message.position, message.orientation
    return at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z


def point_message(vector: Vector) -> geometry_msgs.Point:
    """A place for the wire."""
    x, y, z = vector
    return geometry_msgs.Point(x=x, y=y, z=z)


def point_from_message(message: geometry_msgs.Point) -> Vector:
    """A place from the wire."""
    return message.x, message.y, message.z


def vector_message(vector: Vector) -> geometry_msgs.Vector3:
    """A direction or a force for the wire."""
    x, y, z = vector
    return geometry_msgs.Vector3(x=x, y=y, z=z)


def vector_from_message(message: geometry_msgs.Vector3) -> Vector:
    """A direction or a force from the wire."""
    return message.x, message.y, message.z


def color_message(color: Color, *, opacity: float = 1.0) -> std_msgs.ColorRGBA:
    """A color for the wire."""
    red, green, blue = color
    return std_msgs.ColorRGBA(r=red, g=green, b=blue, a=opacity)


def color_from_message(message: std_msgs.ColorRGBA) -> Color:
    """A color from the wire, without its opacity."""
    return message.r, message.g, message.b


def color_from_code(code: world_control_msgs.ColorCode) -> Color | None:
    """The color of a code; None puts out."""
    return _COLORS.get(code)


def color_code(color: Color | None) -> world_control_msgs.ColorCode:
    """The code whose color is nearest; only five colors have one, so what comes back may be another color."""
    if color is None:
        return world_control_msgs.ColorCode.NONE
    return min(_COLORS, key=lambda code: sum((a - b) ** 2 for a, b in zip(_COLORS[code], color, strict=True)))


WORLD_ERROR_FACTORIES: dict[str, Callable[[mindstage_msgs.Refusal], WorldError]] = {
    "BodyUnknown": lambda said: BodyNotFoundError(said.body, known=said.near, world=said.world),
    "BodyExists": lambda said: BodyExistsError(said.body),
    "PoseUnreachable": lambda said: PoseUnreachableError(said.body, reason=said.reason),
    "AttachmentRefused": lambda said: AttachmentError(said.parent, said.child, reason=said.reason),
}
ENGINE_ERROR_TYPES: dict[str, type[EngineError]] = {
    cls.code: cls
    for cls in (
        EngineUnavailableError,
        EngineTimeoutError,
        UnsupportedByEngineError,
        EngineClosedError,
        SimulationDivergedError,
    )
}


def error_to_message(error: WorldError) -> mindstage_msgs.Refusal:
    """Why the world said no, for the wire."""
    facts = dict(vars(error))
    facts["near"] = facts.pop("suggestions", ())
    fields = {name: facts[name] for name in mindstage_msgs.Refusal.__struct_fields__ if name in facts}
    return mindstage_msgs.Refusal(kind=error.code, text=str(error), **fields)


def message_to_error(message: mindstage_msgs.Refusal) -> WorldError:
    """The error that was refused with; of a kind that is not known here, its sentence."""
    made = WORLD_ERROR_FACTORIES.get(message.kind)
    return made(message) if made else WorldError(message.text)


def error_text(error: EngineError) -> str:
    """What broke, as the text that ends a call."""
    facts = {"kind": error.code, **vars(error)}
    return f"{error}\n{msgspec.json.encode(facts).decode()}"


def error_from_text(text: str) -> EngineError:
    """The error that ended a call over there; where the text is anybody's, an error that says the text."""
    sentence, _, facts = text.partition("\n")
    try:
        known = msgspec.json.decode(facts, type=dict[str, str | float])
        return ENGINE_ERROR_TYPES[str(known.pop("kind"))](**known)
    except (msgspec.MsgspecError, KeyError, TypeError):
        return EngineError(sentence)


class ConversionNote(msgspec.Struct, frozen=True):
    """One thing that the other side will not know, or that was assumed because it was not told."""

    field: str
    """What it is about, such as `facts` or `class`."""
    ids: tuple[str, ...]
    """Of the bodies, constraints or lights."""
    text: str


def merge_notes(notes: Iterable[ConversionNote]) -> tuple[ConversionNote, ...]:
    """The same with one remark for each field and text, which has all the ids."""
    ids: defaultdict[tuple[str, str], dict[str, None]] = defaultdict(dict)
    for remark in notes:
        ids[remark.field, remark.text].update(dict.fromkeys(remark.ids))
    return tuple(ConversionNote(field, tuple(about), text) for (field, text), about in ids.items())


T = TypeVar("T")

FORMAT_VERSION = World(iri=Iri("")).format_version
"""What this version writes and reads."""


class FormatVersion(msgspec.Struct):
    """As much of a world as tells whether the rest can be read."""

    format_version: int


def world_to_json(world: World) -> str:
    """A world as JSON; `format_version` is always in it.

    Raises:
        MessageValidationError: it holds what JSON cannot, such as NaN.
    """
    try:
        told = {**msgspec.to_builtins(world, enc_hook=to_python_number), "format_version": world.format_version}
    except (TypeError, RecursionError) as error:
        raise MessageValidationError("a world", cause=str(error)) from error
    return to_json(told, World)


def world_from_json(text: str | bytes) -> World:
    """The world that `world_to_json` wrote.

    Raises:
        MessageValidationError: it is no such JSON, or that of another version.
    """
    version = from_json(text, FormatVersion).format_version
    if version != FORMAT_VERSION:
        raise MessageValidationError(
            "a world",
            path="format_version",
            cause=f"it is {version}, and this Mindstage reads {FORMAT_VERSION}",
            remedy="use the same version of Mindstage on both sides",
        )
    return from_json(text, World)


def to_json(value: object, type: Any = None) -> str:
    """A part of a world (`BodyPhysics`, a tuple of `Material`s) as JSON.

    Args:
        value: the part.
        type: how it will be read, where that is not its own type; a tuple's is `tuple[Material, ...]`.

    Raises:
        MessageValidationError: it holds what JSON cannot, such as NaN.
    """
    try:
        text = msgspec.json.encode(value, enc_hook=to_python_number).decode()
    except (TypeError, UnicodeError, RecursionError) as error:
        raise MessageValidationError(_type_name(type or value.__class__), cause=str(error)) from error
    # msgspec writes NaN and the infinities as null, and a null in the place of a number cannot be read: so read it.
    from_json(text, type or value.__class__)
    return text


def from_json(text: str | bytes, type: type[T]) -> T:
    """A part of a world from JSON.

    Raises:
        MessageValidationError: it is no JSON, or not of that type.
    """
    try:
        return msgspec.json.decode(text, type=type)
    except msgspec.ValidationError as error:
        cause, path = validation_error_details(error)
        raise MessageValidationError(_type_name(type), path=path, cause=cause) from error
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise MessageValidationError(_type_name(type), cause=f"it is no JSON: {error}") from error


def _type_name(type: Any) -> str:
    return "a world" if type in {World, FormatVersion} else getattr(type, "__name__", str(type))


class BodyModelDelta(FrozenStruct, frozen=True, kw_only=True):
    """How a body takes part in the physics from now on."""

    size: Vector
    """In force: assumed where the map has none [m]."""
    top: BodyId
    """The body that all others of its rigid assembly hang on; itself where it is that, or alone."""
    hold: Pose = IDENTITY
    """Where it is in the top's frame."""
    mobility: Mobility = Mobility.STATIC
    """Of the whole assembly."""
    gravity: bool = True
    """Whether it falls; of an assembly, as much of it as does counts."""
    mass_kg: float = 0.0
    """In force: estimated where the map has none; 0 for what the physics does not move."""
    ghost: bool = False
    """Whether it collides with nothing."""
    solids: tuple[CollisionShape, ...] = ()
    """All that can be touched of it, in its own frame."""
    friction: float | None = None
    """None leaves it to the engine."""
    restitution: float | None = None


class JointModelDelta(FrozenStruct, frozen=True, kw_only=True):
    """Where a constraint's frame is, as seen from either end; its ranges are about where these two coincide."""

    parent: BodyId
    child: BodyId
    of_parent: Pose = IDENTITY
    of_child: Pose = IDENTITY


class PhysicsModelDelta(FrozenStruct, frozen=True, kw_only=True):
    """What is different from before, or all of it for a world that is new."""

    bodies: dict[BodyId, BodyModelDelta] = msgspec.field(default_factory=dict)
    """By id."""
    apart: tuple[tuple[BodyId, BodyId], ...] = ()
    """Pairs that do not collide from now on."""
    together: tuple[tuple[BodyId, BodyId], ...] = ()
    """Pairs that may collide again."""
    joints: dict[BodyId, JointModelDelta | None] = msgspec.field(default_factory=dict)
    """Constraints that hold, by id; None for one that does not."""
    poses: dict[BodyId, Pose] = msgspec.field(default_factory=dict)
    """Bodies that are put somewhere else, at rest: all that go there, not only the first."""


def model_delta_to_json(change: PhysicsModelDelta) -> str:
    """A change as JSON; what is left out has its default.

    Raises:
        MessageValidationError: it holds what JSON cannot, such as NaN.
    """
    return to_json(change)


_MESH_NAME = re.compile(r"[0-9a-f]{8,64}\.glb")
_MAX_SIZE_M = 1e6
_MESSAGE_ONLY_FIELDS = ("mesh", "material")


class GeometryMessage(
    FrozenStruct,
    frozen=True,
    kw_only=True,
    rename={
        "collision_shapes": "solids",
        "reason": "why",
        "shape_name": "kind",
        "support_surfaces": "places",
        "lights": "glows",
        "material": "surface",
    },
):
    """The JSON of a body geometry; fields that are missing have their defaults."""

    collision_shapes: tuple[CollisionShape, ...] = ()
    source: GeometrySource = GeometrySource.MAP
    reason: str = ""
    shape_name: str = "box"
    friction: float | None = None
    restitution: float | None = None
    density: float | None = None
    support_surfaces: tuple[SupportSurface, ...] = ()
    lights: tuple[AttachedLight, ...] = ()
    mesh: str = ""
    """Of the file that shows it; empty where there is none."""
    material: PbrMaterial | None = None
    """Of its solids, where those are shown."""


class GeometryMapMessage(FrozenStruct, frozen=True, kw_only=True, rename={"geometries": "forms"}):
    """The forms of some bodies; equal ones stand there once."""

    bodies: dict[BodyId, str] = msgspec.field(default_factory=dict)
    """The key of each body's form."""
    geometries: dict[str, GeometryMessage] = msgspec.field(default_factory=dict)


def mesh_name(key: str) -> str:
    """What the mesh file of a form is called; empty where its key is no digest, and so no name for a file."""
    name = f"{key}.glb"
    return name if _MESH_NAME.fullmatch(name) else ""


def geometry_to_json(geometry: GeometryMap, *, mesh: Callable[[BodyGeometry], str] = lambda form: "") -> str:
    """Forms as JSON; an empty string where there are none.

    Args:
        forms: by body.
        mesh: the name of the file that shows a form, or an empty string.

    Raises:
        MessageValidationError: a form holds what JSON cannot, such as NaN.
    """
    if not geometry:
        return ""
    each = {form.key: form for form in geometry.values()}
    written = GeometryMapMessage(
        bodies={id: form.key for id, form in geometry.items()},
        geometries={key: _to_message(form, mesh(form)) for key, form in each.items()},
    )
    return to_json(written)


def geometry_from_json(
    text: str, *, load_visuals: Callable[[str], tuple[VisualMesh, ...]] = lambda mesh: ()
) -> Mapping[BodyId, BodyGeometry]:
    """The forms that `geometry_to_json` wrote.

    Args:
        text: as it came.
        skins: what is in a mesh file of that name; nothing where it is not at hand.

    Raises:
        MessageValidationError: it is no such JSON, or says what cannot be built.
    """
    if not text:
        return {}
    written = from_json(text, GeometryMapMessage)
    forms = {key: _from_message(key, form, load_visuals) for key, form in written.geometries.items()}
    for id, key in written.bodies.items():
        if key not in forms:
            raise MessageValidationError("forms", path=f"bodies.{id}", cause=f"there is no form {key!r} among them")
    return {id: forms[key] for id, key in written.bodies.items()}


def _shared_fields(geometry: BodyGeometry | GeometryMessage) -> dict[str, Any]:
    """What both writings of a form have."""
    return {
        name: getattr(geometry, name) for name in GeometryMessage.__struct_fields__ if name not in _MESSAGE_ONLY_FIELDS
    }


def _to_message(geometry: BodyGeometry, mesh: str) -> GeometryMessage:
    return GeometryMessage(
        **_shared_fields(geometry),
        mesh=mesh,
        material=max(geometry.visuals, key=lambda skin: len(skin.faces)).material if geometry.visuals else None,
    )


def _from_message(
    key: str, message: GeometryMessage, load_visuals: Callable[[str], tuple[VisualMesh, ...]]
) -> BodyGeometry:
    if message.mesh and message.mesh != mesh_name(key):
        raise MessageValidationError(
            "forms", path=f"forms.{key}.mesh", cause=f"{message.mesh!r} is no mesh of that form"
        )
    for number, solid in enumerate(message.collision_shapes):
        if cause := _shape_error(solid):
            raise MessageValidationError("forms", path=f"forms.{key}.solids[{number}]", cause=cause)
    return BodyGeometry(
        key=key,
        visuals=load_visuals(message.mesh) if message.mesh else (),
        **_shared_fields(message),
    )


def _shape_error(shape: CollisionShape) -> str:
    """Why nothing can be built of it, or an empty string."""
    if not all(0.0 < extent <= _MAX_SIZE_M for extent in shape.size):
        return f"its size {shape.size} is none"
    if not _is_rigid(shape.pose):
        return "its pose is none: a place, and a quaternion of norm 1"
    if shape.type is CollisionShapeType.HULL and len(shape.points) < 4:
        return f"a hull has at least 4 points, not {len(shape.points)}"
    return ""


def _is_rigid(pose: Pose) -> bool:
    norm = sum(part * part for part in pose.quaternion)
    return all(map(isfinite, pose.position)) and abs(norm - 1.0) < 1e-6
