"""Palette: how a colour changes when something is lit, and when it steps back behind what is."""

from __future__ import annotations

import msgspec
import numpy as np

from mindstage.knowledge.names import local_name
from mindstage.world import Colour
from mindstage.world.geometry import Array

__all__ = ["HIGHLIGHT_OPACITY", "VEIL_OPACITY", "Paint", "dimmed", "linear", "lit", "local_name"]

HIGHLIGHT_OPACITY = 0.85
"""Of a lit body that is see-through otherwise: a highlight must be seen."""
VEIL_OPACITY = 0.25
"""Of what stands before something lit: what is lit in a cupboard must be seen too."""
_MIST, _MISTINESS = 0.82, 0.72
"""The grey that dimmed colours go towards, and how far."""


class Paint(msgspec.Struct, frozen=True):
    """A colour, and how much of what is behind stays hidden."""

    colour: Colour
    opacity: float = 1.0


def lit(paint: Paint, colour: Colour) -> Paint:
    """The same surface with a highlight."""
    return Paint(colour, max(paint.opacity, HIGHLIGHT_OPACITY))


def dimmed(paint: Paint, *, veil: bool = False) -> Paint:
    """The same surface stepping back behind what is lit; as a veil it also lets that be seen through it."""
    red, green, blue = (part + (_MIST - part) * _MISTINESS for part in paint.colour)
    return Paint((red, green, blue), min(paint.opacity, VEIL_OPACITY) if veil else paint.opacity)


def linear(colours: Array) -> Array:
    """As light adds up (the curve of sRGB, IEC 61966-2-1): lines and crowds want their colours so, all else as seen."""
    clipped = np.clip(colours, 0.0, 1.0)
    return np.where(clipped <= 0.04045, clipped / 12.92, ((clipped + 0.055) / 1.055) ** 2.4)
