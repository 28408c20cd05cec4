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

from mindstage.world.geometry import rotation_angle
from mindstage.world.values import Body, Constraint, Light, World

__all__ = [
    "BODY_FIELDS",
    "CONSTRAINT_FIELDS",
    "LIGHT_FIELDS",
    "MEASURED",
    "MECHANICS",
    "WORLD_FIELDS",
    "Change",
    "Kind",
    "column",
    "columns",
    "material_columns",
]

Array = NDArray[np.float64]


class Kind(StrEnum):
    """What a change is about. Those in `MEASURED` have an error, in the unit that is said here."""

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
    COLOUR = "colour"
    """Of a material or a light: the largest of the three channels' differences, each 0 to 1."""
    LIGHT = "light"
    """A light's intensity [cd or lx]."""
    NAME = "name"
    """IRI, label, name of the world."""
    CLASS = "class"
    """What a thing is: the class of a body, the kind of a light."""
    LOOK = "look"
    """Mesh, shape, materials."""
    PHYSICS = "physics"
    """Mobility, gravity, overlap events."""
    MOTION = "motion"
    """What a constraint lets happen: its axes, soft or not, whether its two bodies collide."""
    STRUCTURE = "structure"
    """What a constraint joins, and what hangs on what."""
    TAGS = "tags"
    FACTS = "facts"


MEASURED = (
    Kind.TRANSLATION,
    Kind.ROTATION,
    Kind.SIZE,
    Kind.MASS,
    Kind.LIMIT,
    Kind.STIFFNESS,
    Kind.DAMPING,
    Kind.COLOUR,
    Kind.LIGHT,
)
"""The kinds whose changes have a number."""

MECHANICS = frozenset({Kind.TRANSLATION, Kind.ROTATION, Kind.MASS, Kind.LIMIT})
"""Where things are, what they weigh and how far they move, whatever else is said of them."""

_POSE = {"pose.position": Kind.TRANSLATION, "pose.quaternion": Kind.ROTATION}

WORLD_FIELDS: Mapping[str, Kind] = {"iri": Kind.NAME, "name": Kind.NAME, "format_version": Kind.NAME}

BODY_FIELDS: Mapping[str, Kind] = {
    "iri": Kind.NAME,
    "cls": Kind.CLASS,
    "label": Kind.NAME,
    **_POSE,
    "size": Kind.SIZE,
    "mesh": Kind.LOOK,
    "shape": Kind.LOOK,
    "physics.mobility": Kind.PHYSICS,
    "physics.gravity": Kind.PHYSICS,
    "physics.overlap_events": Kind.PHYSICS,
    "physics.mass_kg": Kind.MASS,
}

CONSTRAINT_FIELDS: Mapping[str, Kind] = {
    "iri": Kind.NAME,
    "parent": Kind.STRUCTURE,
    "child": Kind.STRUCTURE,
    **_POSE,
    **{f"linear.{axis}": Kind.MOTION for axis in ("x", "y", "z")},
    **{f"angular.{axis}": Kind.MOTION for axis in ("swing1", "swing2", "twist")},
    "linear.limit": Kind.LIMIT,
    **{f"linear.{axis}_middle": Kind.LIMIT for axis in ("x", "y", "z")},
    **{f"angular.{axis}_{what}": Kind.LIMIT for axis in ("swing1", "swing2", "twist") for what in ("limit", "middle")},
    **{
        f"{soft}.{part}": kind
        for soft in ("linear.soft", "angular.swing_soft", "angular.twist_soft")
        for part, kind in (("enabled", Kind.MOTION), ("stiffness", Kind.STIFFNESS), ("damping", Kind.DAMPING))
    },
    "disable_collision": Kind.MOTION,
}

LIGHT_FIELDS: Mapping[str, Kind] = {
    "iri": Kind.NAME,
    "kind": Kind.CLASS,
    **_POSE,
    "colour": Kind.COLOUR,
    "intensity": Kind.LIGHT,
}


class Change(msgspec.Struct, frozen=True, kw_only=True):
    """One field that the two worlds do not agree on."""

    id: str
    """Of a body, a constraint, a light; the IRI of a resource or of the world itself."""
    field: str
    """Dotted, as the values have it: `pose.position`, `linear.limit`."""
    kind: Kind
    a: Any
    """What the first world has; None for nothing. For tags and facts: those that the second lacks."""
    b: Any
    """What the second world has; None for nothing. For tags and facts: those that the first lacks."""
    error: float | None = None
    """How far apart the two are, in the unit of the kind.

    None where no number says it: for what is not measured, a value against none, NaN or infinity against a number.
    """


def columns(
    fields: Mapping[str, Kind], ids: Sequence[str], a: Sequence[World | Body | Constraint | Light], b: Sequence[Any]
) -> Iterator[Change]:
    """The changes of all fields of things of one sort, a[i] against b[i]."""
    for field, kind in fields.items():
        get = attrgetter(field)
        yield from column(field, kind, ids, [get(item) for item in a], [get(item) for item in b])


def material_columns(ids: Sequence[str], a: Sequence[Body], b: Sequence[Body]) -> Iterator[Change]:
    """The changes of materials: their names, paths and order at once, then the colour of each."""
    names = [[tuple((m.name, m.path) for m in body.materials) for body in side] for side in (a, b)]
    yield from column("materials", Kind.LOOK, ids, *names)
    rows = list(range(len(ids)))
    slot = 0
    while rows := [row for row in rows if min(len(a[row].materials), len(b[row].materials)) > slot]:
        colours = [[side[row].materials[slot].colour for row in rows] for side in (a, b)]
        yield from column(f"materials[{slot}].colour", Kind.COLOUR, [ids[row] for row in rows], *colours)
        slot += 1


def column(field: str, kind: Kind, ids: Sequence[str], a: Sequence[Any], b: Sequence[Any]) -> Iterator[Change]:
    """The changes of one field."""
    if kind not in MEASURED:
        for owner, x, y in zip(ids, a, b, strict=True):
            if x != y:
                yield Change(id=owner, field=field, kind=kind, a=x, b=y)
        return
    errors = _errors(kind, a, b)
    for row in np.flatnonzero(errors != 0.0).tolist():
        error = float(errors[row])
        told = error if isfinite(error) else None
        yield Change(id=ids[row], field=field, kind=kind, a=a[row], b=b[row], error=told)


def _errors(kind: Kind, a: Sequence[Any], b: Sequence[Any]) -> Array:
    """How far each pair is apart; NaN or infinite where no number says it."""
    width = 4 if kind is Kind.ROTATION else 3 if kind in (Kind.TRANSLATION, Kind.SIZE, Kind.COLOUR) else 1
    x, y = _array(a, width), _array(b, width)
    given_a, given_b = (np.array([value is not None for value in values], dtype=bool) for values in (a, b))
    same = np.all((x == y) | (np.isnan(x) & np.isnan(y)), axis=1) & (given_a == given_b)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        if kind is Kind.ROTATION:
            error = _angles(x, y)
        elif kind is Kind.TRANSLATION:
            error = _lengths(x - y)
        else:
            error = np.max(np.abs(x - y), axis=1, initial=0.0)
    return np.where(same, 0.0, error)


def _array(values: Sequence[Any], width: int) -> Array:
    empty = (np.nan,) * width if width > 1 else np.nan
    return np.array([empty if value is None else value for value in values], dtype=np.float64).reshape(-1, width)


def _lengths(ways: Array) -> Array:
    """Euclid's, without squaring numbers so small or large that their squares are none."""
    longest = np.max(np.abs(ways), axis=1, initial=0.0)
    scale = np.where(longest > 0.0, longest, 1.0)
    return np.asarray(longest * np.linalg.norm(ways / scale[:, None], axis=1))


def _angles(a: Array, b: Array) -> Array:
    """NaN where one of the two is no rotation."""
    near_one = []
    for q in (a, b):
        longest = np.max(np.abs(q), axis=1, initial=0.0)
        _, exponent = np.frexp(longest)  # a power of two: to scale by it rounds nothing
        near_one.append(np.where((longest > 0.0)[:, None], np.ldexp(q, -exponent[:, None]), np.nan))
    return rotation_angle(*near_one)
