"""Palette: how a color changes when something is lit, and when it steps back behind what is."""

from __future__ import annotations

import msgspec

from mindstage.knowledge.names import local_name
from mindstage.world import Color

__all__ = ["HIGHLIGHT_OPACITY", "OCCLUDER_OPACITY", "Paint", "dimmed", "highlighted", "local_name"]

HIGHLIGHT_OPACITY = 0.85
"""Of a lit body that is see-through otherwise: a highlight must be seen."""
OCCLUDER_OPACITY = 0.25
"""Of what stands before something lit: what is lit in a cupboard must be seen too."""
_DIM_GRAY, _DIM_AMOUNT = 0.82, 0.72
"""The gray that dimmed colors go towards, and how far."""


class Paint(msgspec.Struct, frozen=True):
    """A color, and how much of what is behind stays hidden."""

    color: Color
    opacity: float = 1.0


def highlighted(paint: Paint, color: Color) -> Paint:
    """The same surface with a highlight."""
    return Paint(color, max(paint.opacity, HIGHLIGHT_OPACITY))


def dimmed(paint: Paint, *, as_occluder: bool = False) -> Paint:
    """The same surface stepping back behind what is lit; as a veil it also lets that be seen through it."""
    red, green, blue = (part + (_DIM_GRAY - part) * _DIM_AMOUNT for part in paint.color)
    return Paint((red, green, blue), min(paint.opacity, OCCLUDER_OPACITY) if as_occluder else paint.opacity)
