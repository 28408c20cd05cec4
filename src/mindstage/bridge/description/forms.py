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
from mindstage.errors import MessageRefused
from mindstage.world import BodyId, Form, Forms, FormSource, Glow, Place, Pose, Skin, Solid, SolidKind, Surface
from mindstage.world.values import Value

__all__ = ["forms_from_json", "forms_to_json", "mesh_name"]

_MESH_NAME = re.compile(r"[0-9a-f]{8,64}\.glb")
_LARGEST_M = 1e6
_WRITTEN_ONLY = ("mesh", "surface")


class WrittenForm(Value, frozen=True, kw_only=True):
    """A form as it travels; what is left out has its default."""

    solids: tuple[Solid, ...] = ()
    source: FormSource = FormSource.MAP
    why: str = ""
    kind: str = "box"
    friction: float | None = None
    restitution: float | None = None
    density: float | None = None
    places: tuple[Place, ...] = ()
    glows: tuple[Glow, ...] = ()
    mesh: str = ""
    """Of the file that shows it; empty where there is none."""
    surface: Surface | None = None
    """Of its solids, where those are shown."""


class WrittenForms(Value, frozen=True, kw_only=True):
    """The forms of some bodies; equal ones stand there once."""

    bodies: dict[BodyId, str] = msgspec.field(default_factory=dict)
    """The key of each body's form."""
    forms: dict[str, WrittenForm] = msgspec.field(default_factory=dict)


def mesh_name(key: str) -> str:
    """What the mesh file of a form is called; empty where its key is no digest, and so no name for a file."""
    name = f"{key}.glb"
    return name if _MESH_NAME.fullmatch(name) else ""


def forms_to_json(forms: Forms, *, mesh: Callable[[Form], str] = lambda form: "") -> str:
    """Forms as JSON; an empty string where there are none.

    Args:
        forms: by body.
        mesh: the name of the file that shows a form, or an empty string.

    Raises:
        MessageRefused: a form holds what JSON cannot, such as NaN.
    """
    if not forms:
        return ""
    each = {form.key: form for form in forms.values()}
    written = WrittenForms(
        bodies={id: form.key for id, form in forms.items()},
        forms={key: _written(form, mesh(form)) for key, form in each.items()},
    )
    return to_json(written)


def forms_from_json(text: str, *, skins: Callable[[str], tuple[Skin, ...]] = lambda mesh: ()) -> Mapping[BodyId, Form]:
    """The forms that `forms_to_json` wrote.

    Args:
        text: as it came.
        skins: what is in a mesh file of that name; nothing where it is not at hand.

    Raises:
        MessageRefused: it is no such JSON, or says what cannot be built.
    """
    if not text:
        return {}
    written = from_json(text, WrittenForms)
    forms = {key: _read(key, form, skins) for key, form in written.forms.items()}
    for id, key in written.bodies.items():
        if key not in forms:
            raise MessageRefused("forms", path=f"bodies.{id}", cause=f"there is no form {key!r} among them")
    return {id: forms[key] for id, key in written.bodies.items()}


def _shared(form: Form | WrittenForm) -> dict[str, Any]:
    """What both writings of a form have."""
    return {name: getattr(form, name) for name in WrittenForm.__struct_fields__ if name not in _WRITTEN_ONLY}


def _written(form: Form, mesh: str) -> WrittenForm:
    return WrittenForm(
        **_shared(form),
        mesh=mesh,
        surface=max(form.skins, key=lambda skin: len(skin.faces)).surface if form.skins else None,
    )


def _read(key: str, form: WrittenForm, skins: Callable[[str], tuple[Skin, ...]]) -> Form:
    if form.mesh and form.mesh != mesh_name(key):
        raise MessageRefused("forms", path=f"forms.{key}.mesh", cause=f"{form.mesh!r} is no mesh of that form")
    for number, solid in enumerate(form.solids):
        if cause := _why_no_solid(solid):
            raise MessageRefused("forms", path=f"forms.{key}.solids[{number}]", cause=cause)
    return Form(
        key=key,
        skins=skins(form.mesh) if form.mesh else (),
        **_shared(form),
    )


def _why_no_solid(solid: Solid) -> str:
    """Why nothing can be built of it, or an empty string."""
    if not all(0.0 < extent <= _LARGEST_M for extent in solid.size):
        return f"its size {solid.size} is none"
    if not _is_rigid(solid.pose):
        return "its pose is none: a place, and a quaternion of norm 1"
    if solid.kind is SolidKind.HULL and len(solid.points) < 4:
        return f"a hull has at least 4 points, not {len(solid.points)}"
    return ""


def _is_rigid(pose: Pose) -> bool:
    norm = sum(part * part for part in pose.quaternion)
    return all(map(isfinite, pose.position)) and abs(norm - 1.0) < 1e-6
