"""The styles of generated homes, and the parts that they can lack; importing them loads no library."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["HomePart", "HomeStyle"]


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
