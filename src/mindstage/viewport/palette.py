"""Palette: how a colour changes when something is lit, and when it steps back behind what is."""

from __future__ import annotations

import msgspec

from mindstage.knowledge.names import local_name
from mindstage.world import Colour

__all__ = ["HIGHLIGHT_OPACITY", "VEIL_OPACITY", "Paint", "dimmed", "lit", "local_name"]

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
