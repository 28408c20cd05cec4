"""Forms: what bodies are made of, on the wire.

What is touched travels in full, what is seen as the name of a mesh file in a folder that both sides can read: its name
is the form's key, so it never has to be sent twice, and it is no path. Whoever has no such file shows the solids.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any

import msgspec

from mindstage.bridge.description.worlds import from_json, to_json
from mindstage.errors import MessageValidationError
from mindstage.world import (
    AttachedLight,
    BodyGeometry,
    BodyId,
    CollisionShape,
    CollisionShapeType,
    GeometryMap,
    GeometrySource,
    PbrMaterial,
    Pose,
    SupportSurface,
    VisualMesh,
)
from mindstage.world.values import FrozenStruct

__all__ = ["geometry_from_json", "geometry_to_json", "mesh_name"]

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
