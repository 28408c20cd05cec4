"""The styles and dialects of generated homes, and the parts that they can lack; importing them loads no library."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["HomeDialect", "HomePart", "HomeStyle"]


class HomeStyle(StrEnum):
    """The kinds of places that are generated."""

    KITCHEN = "kitchen"
    FLAT = "flat"
    OFFICE = "office"
    LAB = "lab"
    SHOP = "shop"


class HomePart(StrEnum):
    """What a home can be generated without."""

    THINGS = "things"
    DOORS = "doors"
    """Doors, lids and drawers of rooms and furniture."""
    HANDLES = "handles"
    WALLS = "walls"
    WINDOWS = "windows"
    LAMPS = "lamps"


class HomeDialect(StrEnum):
    """The dialects of semantic maps in which a home can be written, with the habits of the programs that wrote them."""

    SEMLOG = "semlog"
    """SemLog of 2019: world-aligned boxes of classes, poses of mesh pivots, symmetric limits."""
    SEMLOG_2018 = "semlog-2018"
    """Early SemLog: mobility in tags only, and a document type that is not well-formed."""
    AMEVA = "ameva"
    """Centimeters, Unreal's left-handed frame, quaternions x y z w, joints without axes and limits."""
    KNOWROB1 = "knowrob1"
    """Perceptions with 4 x 4 matrices, sizes of individuals, joints from a lower to an upper value."""
    SOMA = "soma"
    """Nested nodes, quaternions x y z w, limits of classes of joints, joints without axes and positions."""
    SOMA_URDF = "soma-urdf"
    """Classes, parts and names of links; poses and joints are in a URDF file beside it."""
