"""Colours: the ones that people name, how any other is written, and how much light they are."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from mindstage.errors import ColourUnknown
from mindstage.world.geometry import Array
from mindstage.world.values import Colour

__all__ = ["COLOURS", "NO_COLOUR", "color_from", "colour_from", "colour_text", "hex_text", "linear", "rgb", "shown"]

NO_COLOUR = "none"
"""Puts a light out."""


def rgb(text: str) -> Colour:
    """A colour from its six hexadecimal digits."""
    red, green, blue = (int(text[start : start + 2], 16) / 255 for start in (0, 2, 4))
    return red, green, blue


COLOURS: Mapping[str, Colour] = MappingProxyType(
    {
        "black": rgb("000000"),
        "red": rgb("e5191c"),
        "blue": rgb("1f5fe0"),
        "green": rgb("1fa83c"),
        "yellow": rgb("f5c400"),
    }
)
"""In the order of the numbers that stand for them on the wire: 1 is black, 5 yellow, and 0 is none."""


def colour_from(text: str) -> Colour | None:
    """A colour as people write it: a name, `#rrggbb`, or three numbers `r,g,b` from 0 to 1; None for "none".

    Raises:
        ColourUnknown: it is none of these.
    """
    name = text.strip().lower()
    if name == NO_COLOUR:
        return None
    if name in COLOURS:
        return COLOURS[name]
    if re.fullmatch(r"#[0-9a-f]{6}", name):
        return rgb(name[1:])
    try:
        red, green, blue = map(float, name.split(","))
    except ValueError:
        raise ColourUnknown(text, known=(*COLOURS, NO_COLOUR)) from None
    if not all(0.0 <= part <= 1.0 for part in (red, green, blue)):
        raise ColourUnknown(text, known=(*COLOURS, NO_COLOUR))
    return red, green, blue


def color_from(color: Colour | str | None) -> Colour | None:
    """A color given by name, as text or as numbers: "green", "#1fa83c", (0.1, 0.7, 0.2); None for None and "none".

    Raises:
        ColourUnknown: it is no color; numbers go from 0 to 1.
    """
    if color is None:
        return None
    return colour_from(color if isinstance(color, str) else ",".join(map(str, color)))


def colour_text(colour: Colour) -> str:
    """A colour's name, or else `#rrggbb`."""
    return next((name for name, known in COLOURS.items() if known == colour), None) or hex_text(colour)


def hex_text(colour: Colour) -> str:
    """A colour as `#rrggbb`, which a web page reads too."""
    return "#" + "".join(f"{round(255 * min(max(part, 0.0), 1.0)):02x}" for part in colour)


def linear(colours: Array) -> Array:
    """How much light a screen's values stand for, each from 0 to 1 (the curve of sRGB, IEC 61966-2-1)."""
    clipped = np.clip(colours, 0.0, 1.0)
    return np.where(clipped <= 0.04045, clipped / 12.92, ((clipped + 0.055) / 1.055) ** 2.4)


def shown(light: Array) -> Array:
    """A screen's values for so much light; what undoes `linear`."""
    light = np.clip(light, 0.0, 1.0)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
