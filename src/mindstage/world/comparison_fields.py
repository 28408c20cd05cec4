"""Fields compared in columns: one field of many things at once, and how far its two values are apart.

Numbers go through numpy, so that ten thousand bodies cost as many array operations as ten. NaN is equal to NaN and to
nothing else: a world is equal to itself whatever it holds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from math import isfinite
from operator import attrgetter
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.world.geometry import quat_angle
from mindstage.world.values import Body, Joint, Light, World

__all__ = [
    "BODY_FIELDS",
    "JOINT_FIELDS",
    "LIGHT_FIELDS",
    "MEASURED_KINDS",
    "MECHANICAL_KINDS",
    "WORLD_FIELDS",
    "ChangeKind",
    "FieldChange",
    "compare_column",
    "compare_columns",
    "compare_materials",
]

Array = NDArray[np.float64]


class ChangeKind(StrEnum):
    """What a change is about. Those in `MEASURED_KINDS` have an error, in the unit that is said here."""

    TRANSLATION = "translation_m"
    """The distance between two positions [m]."""
    ROTATION = "rotation_rad"
    """The smallest angle between two rotations [rad]: q and -q are one, and lengths do not count."""
    SIZE = "size_m"
    """The largest of the three extents' differences [m]."""
    MASS = "mass_kg"
    LIMIT = "limit"
    """Of a constraint, or the middle between its limits: linear [m] or angular [rad]."""
    STIFFNESS = "stiffness"
    """[N/m] or [Nm/rad]."""
    DAMPING = "damping"
    """[Ns/m] or [Nms/rad]."""
    COLOR = "colour"
    """Of a material or a light: the largest of the three channels' differences, each 0 to 1."""
    INTENSITY = "light"
    """A light's intensity [cd or lx]."""
    NAME = "name"
    """IRI, label, name of the world."""
    CLASS = "class"
    """What a thing is: the class of a body, the kind of a light."""
    APPEARANCE = "look"
    """Mesh, shape, materials."""
    PHYSICS = "physics"
    """Mobility, gravity, overlap events."""
    MOTION = "motion"
    """What a constraint lets happen: its axes, soft or not, whether its two bodies collide."""
    STRUCTURE = "structure"
    """What a constraint joins, and what hangs on what."""
    TAGS = "tags"
    FACTS = "facts"


MEASURED_KINDS = (
    ChangeKind.TRANSLATION,
    ChangeKind.ROTATION,
    ChangeKind.SIZE,
    ChangeKind.MASS,
    ChangeKind.LIMIT,
    ChangeKind.STIFFNESS,
    ChangeKind.DAMPING,
    ChangeKind.COLOR,
    ChangeKind.INTENSITY,
)
"""The kinds whose changes have a number."""

MECHANICAL_KINDS = frozenset({ChangeKind.TRANSLATION, ChangeKind.ROTATION, ChangeKind.MASS, ChangeKind.LIMIT})
"""Where things are, what they weigh and how far they move, whatever else is said of them."""

_POSE = {"pose.position": ChangeKind.TRANSLATION, "pose.quaternion": ChangeKind.ROTATION}

WORLD_FIELDS: Mapping[str, ChangeKind] = {
    "iri": ChangeKind.NAME,
    "name": ChangeKind.NAME,
    "format_version": ChangeKind.NAME,
}

BODY_FIELDS: Mapping[str, ChangeKind] = {
    "iri": ChangeKind.NAME,
    "cls": ChangeKind.CLASS,
    "label": ChangeKind.NAME,
    **_POSE,
    "size": ChangeKind.SIZE,
    "mesh": ChangeKind.APPEARANCE,
    "shape": ChangeKind.APPEARANCE,
    "physics.mobility": ChangeKind.PHYSICS,
    "physics.gravity": ChangeKind.PHYSICS,
    "physics.overlap_events": ChangeKind.PHYSICS,
    "physics.mass_kg": ChangeKind.MASS,
}

JOINT_FIELDS: Mapping[str, ChangeKind] = {
    "iri": ChangeKind.NAME,
    "parent": ChangeKind.STRUCTURE,
    "child": ChangeKind.STRUCTURE,
    **_POSE,
    **{f"linear.{axis}": ChangeKind.MOTION for axis in ("x", "y", "z")},
    **{f"angular.{axis}": ChangeKind.MOTION for axis in ("swing1", "swing2", "twist")},
    "linear.limit": ChangeKind.LIMIT,
    **{f"linear.{axis}_middle": ChangeKind.LIMIT for axis in ("x", "y", "z")},
    **{
        f"angular.{axis}_{what}": ChangeKind.LIMIT
        for axis in ("swing1", "swing2", "twist")
        for what in ("limit", "middle")
    },
    **{
        f"{soft}.{part}": kind
        for soft in ("linear.soft", "angular.swing_soft", "angular.twist_soft")
        for part, kind in (
            ("enabled", ChangeKind.MOTION),
            ("stiffness", ChangeKind.STIFFNESS),
            ("damping", ChangeKind.DAMPING),
        )
    },
    "disable_collision": ChangeKind.MOTION,
}

LIGHT_FIELDS: Mapping[str, ChangeKind] = {
    "iri": ChangeKind.NAME,
    "kind": ChangeKind.CLASS,
    **_POSE,
    "colour": ChangeKind.COLOR,
    "intensity": ChangeKind.INTENSITY,
}


class FieldChange(msgspec.Struct, frozen=True, kw_only=True):
    """One field that the two worlds do not agree on."""

    id: str
    """Of a body, a constraint, a light; the IRI of a resource or of the world itself."""
    field: str
    """Dotted, as the values have it: `pose.qpos_address`, `srgb_to_linear.limit`."""
    kind: ChangeKind
    a: Any
    """What the first world has; None for nothing. For tags and facts: those that the second lacks."""
    b: Any
    """What the second world has; None for nothing. For tags and facts: those that the first lacks."""
    error: float | None = None
    """How far apart the two are, in the unit of the kind.

    None where no number says it: for what is not measured, a value against none, NaN or infinity against a number.
    """


def compare_columns(
    fields: Mapping[str, ChangeKind], ids: Sequence[str], a: Sequence[World | Body | Joint | Light], b: Sequence[Any]
) -> Iterator[FieldChange]:
    """The changes of all fields of things of one sort, a[i] against b[i]."""
    for field, kind in fields.items():
        get = attrgetter(field)
        yield from compare_column(field, kind, ids, [get(item) for item in a], [get(item) for item in b])


def compare_materials(ids: Sequence[str], a: Sequence[Body], b: Sequence[Body]) -> Iterator[FieldChange]:
    """The changes of materials: their names, paths and order at once, then the color of each."""
    names = [[tuple((m.name, m.path) for m in body.materials) for body in side] for side in (a, b)]
    yield from compare_column("materials", ChangeKind.APPEARANCE, ids, *names)
    rows = list(range(len(ids)))
    slot = 0
    while rows := [row for row in rows if min(len(a[row].materials), len(b[row].materials)) > slot]:
        colors = [[side[row].materials[slot].color for row in rows] for side in (a, b)]
        yield from compare_column(f"materials[{slot}].colour", ChangeKind.COLOR, [ids[row] for row in rows], *colors)
        slot += 1


def compare_column(
    field: str, kind: ChangeKind, ids: Sequence[str], a: Sequence[Any], b: Sequence[Any]
) -> Iterator[FieldChange]:
    """The changes of one field."""
    if kind not in MEASURED_KINDS:
        for owner, x, y in zip(ids, a, b, strict=True):
            if x != y:
                yield FieldChange(id=owner, field=field, kind=kind, a=x, b=y)
        return
    errors = _measured_errors(kind, a, b)
    for row in np.flatnonzero(errors != 0.0).tolist():
        error = float(errors[row])
        told = error if isfinite(error) else None
        yield FieldChange(id=ids[row], field=field, kind=kind, a=a[row], b=b[row], error=told)


def _measured_errors(kind: ChangeKind, a: Sequence[Any], b: Sequence[Any]) -> Array:
    """How far each pair is apart; NaN or infinite where no number says it."""
    width = (
        4
        if kind is ChangeKind.ROTATION
        else 3
        if kind in (ChangeKind.TRANSLATION, ChangeKind.SIZE, ChangeKind.COLOR)
        else 1
    )
    x, y = _array(a, width), _array(b, width)
    given_a, given_b = (np.array([value is not None for value in values], dtype=bool) for values in (a, b))
    same = np.all((x == y) | (np.isnan(x) & np.isnan(y)), axis=1) & (given_a == given_b)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        if kind is ChangeKind.ROTATION:
            error = _rotation_angles(x, y)
        elif kind is ChangeKind.TRANSLATION:
            error = _row_norms(x - y)
        else:
            error = np.max(np.abs(x - y), axis=1, initial=0.0)
    return np.where(same, 0.0, error)


def _array(values: Sequence[Any], width: int) -> Array:
    empty = (np.nan,) * width if width > 1 else np.nan
    return np.array([empty if value is None else value for value in values], dtype=np.float64).reshape(-1, width)


def _row_norms(vectors: Array) -> Array:
    """Euclid's, without squaring numbers so small or large that their squares are none."""
    longest = np.max(np.abs(vectors), axis=1, initial=0.0)
    scale = np.where(longest > 0.0, longest, 1.0)
    return np.asarray(longest * np.linalg.norm(vectors / scale[:, None], axis=1))


def _rotation_angles(a: Array, b: Array) -> Array:
    """NaN where one of the two is no rotation."""
    near_one = []
    for q in (a, b):
        longest = np.max(np.abs(q), axis=1, initial=0.0)
        _, exponent = np.frexp(longest)  # a power of two: to scale by it rounds nothing
        near_one.append(np.where((longest > 0.0)[:, None], np.ldexp(q, -exponent[:, None]), np.nan))
    return quat_angle(*near_one)
