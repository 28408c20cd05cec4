"""Colors: names, parsing and formatting, and conversion between sRGB and linear light."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from mindstage.errors import InvalidColorError
from mindstage.scene.world_model import Color

if TYPE_CHECKING:
    from mindstage.scene.transforms import Array

__all__ = [
    "COLORS",
    "NO_COLOR",
    "color_from",
    "color_name",
    "hex_color",
    "linear_to_srgb",
    "parse_color",
    "rgb_from_hex",
    "srgb_to_linear",
]

NO_COLOR = "none"
"""The text that removes a highlight."""


def rgb_from_hex(text: str) -> Color:
    """Returns the color of six hexadecimal digits."""
    red, green, blue = (int(text[start : start + 2], 16) / 255 for start in (0, 2, 4))
    return red, green, blue


COLORS: Mapping[str, Color] = MappingProxyType(
    {
        "black": rgb_from_hex("000000"),
        "red": rgb_from_hex("e5191c"),
        "blue": rgb_from_hex("1f5fe0"),
        "green": rgb_from_hex("1fa83c"),
        "yellow": rgb_from_hex("f5c400"),
    }
)
"""In the order of their numbers in messages: 1 is black, 5 is yellow; 0 is no color."""


def parse_color(text: str) -> Color | None:
    """Parses a color: a name, `#rrggbb`, or three numbers `r,g,b` from 0 to 1; returns None for "none".

    Raises:
        InvalidColorError: the text has none of these forms.
    """
    name = text.strip().lower()
    if name == NO_COLOR:
        return None
    if name in COLORS:
        return COLORS[name]
    if re.fullmatch(r"#[0-9a-f]{6}", name):
        return rgb_from_hex(name[1:])
    try:
        red, green, blue = map(float, name.split(","))
    except ValueError:
        raise InvalidColorError(text, known=(*COLORS, NO_COLOR)) from None
    if not all(0.0 <= part <= 1.0 for part in (red, green, blue)):
        raise InvalidColorError(text, known=(*COLORS, NO_COLOR))
    return red, green, blue


def color_from(color: Color | str | None) -> Color | None:
    """Returns a color given as text or as numbers: "green", "#1fa83c", (0.1, 0.7, 0.2); None for None and "none".

    Raises:
        InvalidColorError: it is not a color; numbers must be from 0 to 1.
    """
    if color is None:
        return None
    return parse_color(color if isinstance(color, str) else ",".join(map(str, color)))


def color_name(color: Color) -> str:
    """Returns the name of a color, or `#rrggbb` if it has none."""
    return next((name for name, known in COLORS.items() if known == color), None) or hex_color(color)


def hex_color(color: Color) -> str:
    """Returns a color as `#rrggbb`; components are clipped to 0 to 1."""
    return "#" + "".join(f"{round(255 * min(max(part, 0.0), 1.0)):02x}" for part in color)


def srgb_to_linear(colors: Array) -> Array:
    """Returns the linear values of sRGB values from 0 to 1 (IEC 61966-2-1)."""
    import numpy as np  # here, since names of colors need no arrays

    clipped = np.clip(colors, 0.0, 1.0)
    return np.where(clipped <= 0.04045, clipped / 12.92, ((clipped + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(linear_values: Array) -> Array:
    """Returns the sRGB values of linear values from 0 to 1: the inverse of `srgb_to_linear`."""
    import numpy as np  # see above

    linear_values = np.clip(linear_values, 0.0, 1.0)
    return np.where(linear_values <= 0.0031308, 12.92 * linear_values, 1.055 * linear_values ** (1 / 2.4) - 0.055)
