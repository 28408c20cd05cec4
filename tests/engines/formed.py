"""Forms made by hand, the simplest ones that show what a form is for."""

from __future__ import annotations

import hashlib
from typing import Any

from mindstage.world import Form, Pose, Solid, SolidKind, Vector
from mindstage.world.geometry import Array

__all__ = ["as_vector", "bin_form", "case_form", "form", "plank", "solid_form", "table_form", "wedge_form"]

WALL_M = 0.02


def form(*solids: Solid, **more: Any) -> Form:
    """A form that is only there to be touched."""
    told = repr((solids, sorted(more.items())))
    return Form(key=hashlib.sha256(told.encode()).hexdigest()[:16], skins=(), solids=solids, **more)


def plank(low: Vector, high: Vector) -> Solid:
    """A box from corner to corner."""
    (a, b, c), (d, e, f) = low, high
    return Solid(size=(d - a, e - b, f - c), pose=Pose(((a + d) / 2, (b + e) / 2, (c + f) / 2)))


def bin_form(size: Vector, *, wall: float = WALL_M, **more: Any) -> Form:
    """A box that is open at the top: a floor and four walls."""
    x, y, z = (extent / 2 for extent in size)
    walls = [
        plank((-x, -y, -z + wall), (-x + wall, y, z)),
        plank((x - wall, -y, -z + wall), (x, y, z)),
        plank((-x + wall, -y, -z + wall), (x - wall, -y + wall, z)),
        plank((-x + wall, y - wall, -z + wall), (x - wall, y, z)),
    ]
    return form(plank((-x, -y, -z), (x, y, -z + wall)), *walls, **more)


def case_form(size: Vector, *, shelves: tuple[float, ...] = (), wall: float = WALL_M, **more: Any) -> Form:
    """A box that is open towards x, with the tops of its shelves at some heights over its middle."""
    x, y, z = (extent / 2 for extent in size)
    boards = [
        plank((-x, -y, -z), (x, y, -z + wall)),
        plank((-x, -y, z - wall), (x, y, z)),
        plank((-x, -y, -z + wall), (-x + wall, y, z - wall)),
        plank((-x + wall, -y, -z + wall), (x, -y + wall, z - wall)),
        plank((-x + wall, y - wall, -z + wall), (x, y, z - wall)),
    ]
    boards += [plank((-x + wall, -y + wall, top - wall), (x, y - wall, top)) for top in shelves]
    return form(*boards, **more)


def table_form(size: Vector, *, wall: float = 0.04, **more: Any) -> Form:
    """A top on four legs."""
    x, y, z = (extent / 2 for extent in size)
    legs = [
        plank((min(a, a - i * wall), min(b, b - j * wall), -z), (max(a, a - i * wall), max(b, b - j * wall), z - wall))
        for i, a in ((-1, -x), (1, x))
        for j, b in ((-1, -y), (1, y))
    ]
    return form(plank((-x, -y, z - wall), (x, y, z)), *legs, **more)


def wedge_form(size: Vector, **more: Any) -> Form:
    """A ramp that goes up along x, one hull."""
    x, y, z = (extent / 2 for extent in size)
    points = ((-x, -y, -z), (-x, y, -z), (x, -y, -z), (x, y, -z), (x, -y, z), (x, y, z))
    return form(Solid(kind=SolidKind.HULL, size=size, points=points), **more)


def solid_form(kind: SolidKind, size: Vector, **more: Any) -> Form:
    """One solid of some kind, upright in the middle."""
    return form(Solid(kind=kind, size=size), **more)


def as_vector(row: Array) -> Vector:
    """Three numbers of an array."""
    x, y, z = row.tolist()
    return x, y, z
