"""Printed pictures of our own: labels of packages, spines and covers of books, wall pictures and clock faces.

A label has the word of what is inside, a simple drawing chosen by that word, and what is usually small print as lines.
Drawings are made at twice the resolution and reduced.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from hashlib import blake2b
from math import cos, pi, sin
from re import sub
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from mindstage.scene.world_model import Color

if TYPE_CHECKING:
    from numpy import uint8
    from numpy.typing import NDArray
    from PIL.ImageDraw import ImageDraw

__all__ = [
    "book_cover",
    "book_spine",
    "clock_face",
    "name_label",
    "package_top",
    "package_wrap",
    "round_label",
    "wall_picture",
]

_PIXELS_PER_M = 2000
_MAX_PIXELS = 768
_LABEL_PIXELS = 256
_DARK, _LIGHT = (40, 38, 42), (252, 250, 244)
"""These are colors."""

_Rgb = tuple[int, int, int]
_Box = tuple[float, float, float, float]
"""Left, top, right, bottom [pixels]."""


def _rgb(color: Color) -> _Rgb:
    red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in color)
    return red, green, blue


def _mixed(one: _Rgb, other: _Rgb, share: float) -> _Rgb:
    red, green, blue = (round(a + (b - a) * share) for a, b in zip(one, other, strict=True))
    return red, green, blue


def _drawing_color(word: str, accent: _Rgb) -> _Rgb:
    """The color of a drawing on light ground."""
    return next((color for key, color in _ACCENTS.items() if key in word), _mixed(accent, _DARK, 0.2))


def _is_dark(color: _Rgb) -> bool:
    return 0.30 * color[0] + 0.59 * color[1] + 0.11 * color[2] < 140


def _ink(paper: _Rgb) -> _Rgb:
    return _LIGHT if _is_dark(paper) else _DARK


def _accent(word: str, base: _Rgb) -> _Rgb:
    """A color that suits the word and differs from the base."""
    found = next((color for key, color in _ACCENTS.items() if key in word), None)
    if found is None:
        choices = [(178, 58, 46), (36, 92, 140), (58, 118, 72), (196, 132, 36), (104, 62, 120)]
        found = choices[_number(word) % len(choices)]
    near = sum(abs(a - b) for a, b in zip(found, base, strict=True)) < 120
    return _mixed(found, _DARK if not _is_dark(base) else _LIGHT, 0.55) if near else found


def _number(text: str) -> int:
    return int.from_bytes(blake2b(text.encode(), digest_size=4).digest(), "big")


_ACCENTS: Mapping[str, _Rgb] = MappingProxyType(
    {
        "milk": (38, 96, 168),
        "orange": (226, 112, 20),
        "apple": (96, 148, 48),
        "juice": (226, 112, 20),
        "cereal": (196, 60, 40),
        "tea": (46, 104, 70),
        "coffee": (86, 54, 34),
        "cocoa": (96, 58, 40),
        "flour": (190, 140, 56),
        "sugar": (206, 72, 110),
        "rice": (70, 120, 60),
        "pasta": (26, 70, 140),
        "noodle": (26, 70, 140),
        "water": (40, 130, 190),
        "oil": (110, 120, 34),
        "honey": (206, 140, 24),
        "jam": (170, 30, 50),
        "tomato": (190, 44, 32),
        "bean": (120, 70, 40),
        "salt": (40, 80, 130),
        "pizza": (176, 40, 34),
        "pea": (70, 130, 54),
        "wine": (96, 24, 44),
        "beer": (180, 120, 30),
        "egg": (190, 150, 90),
    }
)


# -- drawings ----------------------------------------------------------------------------------------------------------


def _drop(draw: ImageDraw, x: float, y: float, r: float, color: _Rgb) -> None:
    draw.ellipse((x - 0.62 * r, y - 0.25 * r, x + 0.62 * r, y + r), fill=color)
    draw.polygon([(x - 0.58 * r, y + 0.18 * r), (x, y - r), (x + 0.58 * r, y + 0.18 * r)], fill=color)
    draw.ellipse((x - 0.34 * r, y + 0.3 * r, x - 0.1 * r, y + 0.62 * r), fill=_mixed(color, _LIGHT, 0.6))


def _slice(draw: ImageDraw, x: float, y: float, r: float, color: _Rgb) -> None:
    draw.ellipse((x - r, y - r, x + r, y + r), fill=color)
    draw.ellipse((x - 0.88 * r, y - 0.88 * r, x + 0.88 * r, y + 0.88 * r), fill=_LIGHT)
    for number in range(8):
        box = (x - 0.82 * r, y - 0.82 * r, x + 0.82 * r, y + 0.82 * r)
        draw.pieslice(box, 45 * number + 4, 45 * number + 41, fill=_mixed(color, (255, 210, 90), 0.35))


def _leaf(draw: ImageDraw, x: float, y: float, r: float, color: _Rgb) -> None:
    for side, tone in ((-1, 0.0), (1, 0.2)):
        points = [(x + side * 0.55 * r * (1 - (2 * t - 1) ** 2), y - r + 2 * r * t) for t in _steps(12)]
        draw.polygon([(x, y - r), *points, (x, y + r)], fill=_mixed(color, _LIGHT, tone))
    for number in range(1, 5):
        height = y - 0.7 * r + 0.34 * r * number
        for side in (-1, 1):
            draw.line((x, height, x + side * 0.36 * r, height - 0.22 * r), fill=_LIGHT, width=max(round(0.035 * r), 1))
    draw.line((x, y - r, x, y + 1.15 * r), fill=_mixed(color, _DARK, 0.4), width=max(round(0.05 * r), 1))


def _beans(draw: ImageDraw, x: float, y: float, r: float, color: _Rgb) -> None:
    for dx, dy in ((-0.45, 0.2), (0.45, 0.25), (0.0, -0.4)):
        left, top = x + dx * r, y + dy * r
        draw.ellipse((left - 0.42 * r, top - 0.55 * r, left + 0.42 * r, top + 0.55 * r), fill=color)
        line = [(left + 0.10 * r * sin(2 * pi * t), top - 0.5 * r + r * t) for t in _steps(12)]
        draw.line(line, fill=_mixed(color, _LIGHT, 0.65), width=max(round(0.07 * r), 1))


def _ear(draw: ImageDraw, x: float, y: float, r: float, color: _Rgb) -> None:
    draw.line((x, y + 1.1 * r, x, y - 0.8 * r), fill=color, width=max(round(0.07 * r), 1))
    for number in range(6):
        height = y - 0.75 * r + 0.24 * r * number
        for side in (-1, 1):
            tip = (x + side * 0.5 * r, height - 0.22 * r)
            middle = [(x, height + 0.12 * r), (x + side * 0.16 * r, height - 0.2 * r), tip]
            draw.polygon([*middle, (x + side * 0.34 * r, height + 0.1 * r)], fill=color)


def _bowl(draw: ImageDraw, x: float, y: float, r: float, color: _Rgb) -> None:
    for number in range(9):
        at = (x - 0.72 * r + 0.18 * r * number, y - 0.18 * r - 0.16 * r * (number % 3))
        draw.ellipse((at[0] - 0.2 * r, at[1] - 0.2 * r, at[0] + 0.2 * r, at[1] + 0.2 * r), fill=(222, 160, 70))
        draw.ellipse((at[0] - 0.07 * r, at[1] - 0.07 * r, at[0] + 0.07 * r, at[1] + 0.07 * r), fill=_LIGHT)
    draw.pieslice((x - r, y - 0.95 * r, x + r, y + 0.95 * r), 0, 180, fill=color)
    draw.rectangle((x - 0.35 * r, y + 0.8 * r, x + 0.35 * r, y + 0.98 * r), fill=color)


def _grains(draw: ImageDraw, x: float, y: float, r: float, color: _Rgb) -> None:
    for number in range(26):
        turn = 2.399963 * number
        reach = 0.19 * r * number**0.5
        cx, cy = x + reach * cos(turn), y + reach * sin(turn)
        draw.ellipse(
            (cx - 0.13 * r, cy - 0.06 * r, cx + 0.13 * r, cy + 0.06 * r),
            fill=_mixed(color, _LIGHT, 0.15 * (number % 4)),
        )


def _tubes(draw: ImageDraw, x: float, y: float, r: float, color: _Rgb) -> None:
    for number in range(5):
        left = x - 0.95 * r + 0.42 * r * number
        top = y - 0.8 * r + 0.12 * r * (number % 2)
        draw.polygon(
            [(left, top + 0.2 * r), (left + 0.24 * r, top), (left + 0.24 * r, top + 1.3 * r), (left, top + 1.5 * r)],
            fill=(236, 190, 96),
        )
        draw.ellipse((left, top - 0.02 * r, left + 0.24 * r, top + 0.22 * r), fill=_mixed(color, _DARK, 0.1))


def _fruit(draw: ImageDraw, x: float, y: float, r: float, color: _Rgb) -> None:
    draw.ellipse((x - 0.85 * r, y - 0.7 * r, x + 0.85 * r, y + 0.9 * r), fill=color)
    draw.ellipse((x - 0.5 * r, y - 0.45 * r, x - 0.15 * r, y + 0.0 * r), fill=_mixed(color, _LIGHT, 0.45))
    for side in (-1, 1):
        draw.polygon(
            [(x, y - 0.65 * r), (x + side * 0.6 * r, y - 0.95 * r), (x + side * 0.2 * r, y - 0.45 * r)],
            fill=(74, 128, 60),
        )


def _comb(draw: ImageDraw, x: float, y: float, r: float, color: _Rgb) -> None:
    for dx, dy in ((0, 0), (0.9, 0.52), (-0.9, 0.52), (0, 1.04), (0.9, -0.52), (-0.9, -0.52), (0, -1.04)):
        middle = x + 0.6 * dx * r, y + 0.6 * dy * r
        points = [(middle[0] + 0.34 * r * cos(n * pi / 3), middle[1] + 0.34 * r * sin(n * pi / 3)) for n in range(6)]
        draw.polygon(points, fill=_mixed(color, (255, 214, 110), 0.25 * ((dx > 0) + (dy > 0))))


def _pizza(draw: ImageDraw, x: float, y: float, r: float, color: _Rgb) -> None:
    draw.ellipse((x - r, y - r, x + r, y + r), fill=(206, 150, 84))
    draw.ellipse((x - 0.86 * r, y - 0.86 * r, x + 0.86 * r, y + 0.86 * r), fill=(240, 200, 104))
    for dx, dy in ((-0.4, -0.3), (0.35, -0.45), (0.5, 0.25), (-0.1, 0.5), (-0.55, 0.25), (0.05, 0.0)):
        at = x + dx * r, y + dy * r
        draw.ellipse((at[0] - 0.17 * r, at[1] - 0.17 * r, at[0] + 0.17 * r, at[1] + 0.17 * r), fill=color)


def _rings(draw: ImageDraw, x: float, y: float, r: float, color: _Rgb) -> None:
    for number in range(4):
        reach = r * (1 - 0.25 * number)
        draw.ellipse((x - reach, y - reach, x + reach, y + reach), fill=color if number % 2 == 0 else _LIGHT)


_Drawing = Callable[["ImageDraw", float, float, float, _Rgb], None]
_DRAWINGS: Mapping[str, _Drawing] = MappingProxyType(
    {
        "milk": _drop,
        "cream": _drop,
        "water": _drop,
        "oil": _drop,
        "orange": _slice,
        "lemon": _slice,
        "juice": _slice,
        "cereal": _bowl,
        "tea": _leaf,
        "coffee": _beans,
        "cocoa": _beans,
        "bean": _beans,
        "flour": _ear,
        "beer": _ear,
        "sugar": _grains,
        "salt": _grains,
        "rice": _grains,
        "pasta": _tubes,
        "noodle": _tubes,
        "tomato": _fruit,
        "jam": _fruit,
        "apple": _fruit,
        "wine": _grains,
        "honey": _comb,
        "pizza": _pizza,
        "pea": _grains,
        "herb": _leaf,
        "spice": _leaf,
    }
)


def _drawing(word: str) -> _Drawing:
    return next((draw for key, draw in _DRAWINGS.items() if key in word), _rings)


def _steps(count: int) -> list[float]:
    return [number / (count - 1) for number in range(count)]


# -- text --------------------------------------------------------------------------------------------------------------


def _write(draw: ImageDraw, text: str, box: _Box, color: _Rgb) -> None:
    """Writes words below each other, as large as they fit into a box."""
    from PIL import ImageFont

    lines = text.split() or [text]
    width, height = box[2] - box[0], box[3] - box[1]
    size = max(height / len(lines) / 1.15, 6.0)
    for _ in range(24):
        font = ImageFont.load_default(size)
        if max(draw.textlength(line, font=font) * 1.06 for line in lines) <= width:
            break
        size *= 0.9
    top = box[1] + (height - 1.15 * size * len(lines)) / 2
    for number, line in enumerate(lines):
        at = (box[0] + width / 2, top + 1.15 * size * (number + 0.5))
        draw.text(
            at, line, fill=color, font=font, anchor="mm", stroke_width=max(round(0.03 * size), 1), stroke_fill=color
        )


def _small_print(draw: ImageDraw, box: _Box, color: _Rgb, seed: int) -> None:
    """Lines in place of text, and a bar code."""
    left, top, right, bottom = box
    width, height = right - left, bottom - top
    for number in range(9):
        y = top + height * (0.06 + 0.06 * number)
        length = 0.55 + 0.4 * (((seed >> number) & 7) / 7)
        draw.rectangle((left, y, left + width * length, y + 0.018 * height), fill=color)
    code, x = (left + 0.1 * width, top + 0.72 * height, right - 0.1 * width, bottom), left + 0.14 * width
    draw.rectangle(code, fill=_LIGHT)
    number = 0
    while x < code[2] - 0.05 * width:
        bar = width * (0.012 + 0.01 * ((seed >> number % 24) & 1))
        draw.rectangle((x, code[1] + 0.03 * height, x + bar, code[3] - 0.03 * height), fill=_DARK)
        x, number = x + 2.1 * bar, number + 1


# -- pictures ----------------------------------------------------------------------------------------------------------


def _canvas(width: float, height: float, color: _Rgb) -> tuple[Any, ImageDraw, float]:
    """An image for a surface of a size [m], a pen for it, and the number of pixels per meter."""
    from PIL import Image, ImageDraw

    scale = min(_PIXELS_PER_M, _MAX_PIXELS / max(width, height)) * 2
    image = Image.new("RGB", (max(round(width * scale), 16), max(round(height * scale), 16)), color)
    return image, ImageDraw.Draw(image), scale


def _finished(image: Any) -> NDArray[uint8]:
    import numpy as np

    return np.asarray(image.reduce(2).convert("RGBA"), dtype=np.uint8)


def _front(draw: ImageDraw, box: _Box, word: str, accent: _Rgb) -> None:
    """The main side of a package: a colored field with the word, and a drawing below it."""
    left, top, right, bottom = box
    width, height = right - left, bottom - top
    field = top + 0.40 * height
    draw.rectangle((left, top + 0.06 * height, right, field), fill=accent)
    draw.ellipse((left - 0.2 * width, field - 0.16 * height, right + 0.2 * width, field + 0.08 * height), fill=accent)
    inner = (left + 0.07 * width, top + 0.10 * height, right - 0.07 * width, field - 0.02 * height)
    _write(draw, word.capitalize(), inner, _ink(accent))
    r = min(0.30 * width, 0.19 * height)
    middle = ((left + right) / 2, top + 0.72 * height)
    draw.ellipse((middle[0] - 1.3 * r, middle[1] - 1.3 * r, middle[0] + 1.3 * r, middle[1] + 1.3 * r), fill=_LIGHT)
    _drawing(word)(draw, *middle, 0.85 * r, _drawing_color(word, accent))


def _small_side(draw: ImageDraw, box: _Box, word: str, base: _Rgb, accent: _Rgb) -> None:
    """The narrow side of a package: the word in small letters, and small print."""
    _, _, right, bottom = box
    margin = 0.12 * right
    draw.rectangle((0, 0.06 * bottom, right, 0.2 * bottom), fill=accent)
    _write(draw, word.capitalize(), (margin, 0.07 * bottom, right - margin, 0.19 * bottom), _ink(accent))
    lines = (margin, 0.28 * bottom, right - margin, 0.9 * bottom)
    _small_print(draw, lines, _mixed(base, _ink(base), 0.45), _number(word))


@lru_cache(maxsize=256)
def package_wrap(word: str, depth: float, width: float, height: float, color: Color) -> NDArray[uint8]:
    """The printing on the four sides of a package, h x w x 4: front, the side at its left, back, and the other side.

    Args:
        word: what is inside, in lower case.
        depth: extent of the sides [m].
        width: extent of front and back [m].
        height: [m].
        color: the color of the paper.
    """
    from PIL import Image, ImageDraw

    base = _rgb(color)
    accent = _accent(word, base)
    image, _, scale = _canvas(2 * (depth + width), height, base)
    left = 0.0
    for number, extent in enumerate((width, depth, width, depth)):
        panel = Image.new("RGB", (max(round(extent * scale), 8), image.height), base)
        box = (0.0, 0.0, float(panel.width), float(panel.height))
        if number % 2:
            _small_side(ImageDraw.Draw(panel), box, word, base, accent)
        else:
            _front(ImageDraw.Draw(panel), box, word, accent)
        image.paste(panel, (round(left), 0))
        left += extent * scale
    return _finished(image)


@lru_cache(maxsize=256)
def package_top(word: str, depth: float, width: float, color: Color) -> NDArray[uint8]:
    """The printing on the upper side of a flat package, h x w x 4.

    Args:
        word: what is inside, in lower case.
        depth: the extent from its lower to its upper edge [m].
        width: [m].
        color: the color of the paper.
    """
    base = _rgb(color)
    image, draw, _ = _canvas(width, depth, base)
    _front(draw, (0.0, 0.0, float(image.width), float(image.height)), word, _accent(word, base))
    return _finished(image)


@lru_cache(maxsize=256)
def round_label(word: str, around: float, height: float, color: Color) -> NDArray[uint8]:
    """The label around a can, a jar or a bottle, h x w x 4; its middle is the front.

    Args:
        word: what is inside, in lower case.
        around: its length [m].
        height: [m].
        color: the color of the paper.
    """
    base = _rgb(color)
    accent = _accent(word, base)
    image, draw, _ = _canvas(around, height, base)
    wide, tall = image.width, image.height
    for start in (0.0, 0.93):
        draw.rectangle((0, start * tall, wide, (start + 0.07) * tall), fill=accent)
    third = wide / 3
    field = (third, 0.16 * tall, 2 * third, 0.52 * tall)
    _write(draw, word.capitalize(), field, _mixed(accent, _ink(base), 0.25))
    r = 0.19 * tall
    _drawing(word)(draw, wide / 2, 0.72 * tall, min(r, 0.14 * wide), accent)
    for left in (0.05 * wide, 0.74 * wide):
        _small_print(
            draw, (left, 0.14 * tall, left + 0.2 * wide, 0.86 * tall), _mixed(base, _ink(base), 0.45), _number(word)
        )
    return _finished(image)


@lru_cache(maxsize=1024)
def name_label(name: str, aspect: float) -> NDArray[uint8]:
    """A label with the name of a class, h x w x 4; its words are on as many lines as make them largest.

    Args:
        name: a name such as `OrangeJuiceCarton`, which is divided before capital letters.
        aspect: width by height.
    """
    words = sub(r"(?<=[a-z0-9])(?=[A-Z])|[_\s]+", " ", name).split() or [name]
    layouts = [_lines(words, max(len(" ".join(words)) / count, *map(len, words))) for count in range(1, len(words) + 1)]
    lines = max(layouts, key=lambda each: min(1.7 * aspect / max(map(len, each)), 1 / len(each)))
    width = min(_LABEL_PIXELS, _LABEL_PIXELS * aspect)
    image, draw, _ = _canvas(width / _PIXELS_PER_M, width / aspect / _PIXELS_PER_M, _LIGHT)
    box = (0.04 * image.width, 0.06 * image.height, 0.96 * image.width, 0.94 * image.height)
    _write(draw, " ".join(line.replace(" ", "\u00a0") for line in lines), box, _DARK)
    return _finished(image)


def _lines(words: list[str], most_characters: float) -> list[str]:
    """Joins words to lines with at most that number of characters."""
    lines = [words[0]]
    for word in words[1:]:
        joined = f"{lines[-1]} {word}"
        lines[-1:] = [joined] if len(joined) <= most_characters else [lines[-1], word]
    return lines


@lru_cache(maxsize=256)
def book_spine(word: str, width: float, height: float, color: Color) -> NDArray[uint8]:
    """The spine of a book, h x w x 4, with its title from top to bottom.

    Args:
        word: the title.
        width: thickness of the book [m].
        height: [m].
        color: the color of the cover.
    """
    from PIL import Image

    base = _rgb(color)
    ink = _mixed(_ink(base), (214, 178, 96), 0.4)
    image, draw, _ = _canvas(height, width, base)
    wide, tall = image.width, image.height
    for at in (0.05, 0.93):
        draw.rectangle((at * wide, 0, (at + 0.012) * wide, tall), fill=ink)
    box = (0.12 * wide, 0.1 * tall, 0.88 * wide, 0.9 * tall)
    _write(draw, word.title().replace(" ", "\u00a0"), box, ink)
    return _finished(image.transpose(Image.Transpose.ROTATE_270))


@lru_cache(maxsize=256)
def book_cover(word: str, width: float, height: float, color: Color) -> NDArray[uint8]:
    """The front of a book, h x w x 4.

    Args:
        word: the title.
        width: [m].
        height: [m].
        color: the color of the cover.
    """
    base = _rgb(color)
    ink = _mixed(_ink(base), (214, 178, 96), 0.4)
    image, draw, _ = _canvas(width, height, base)
    wide, tall = image.width, image.height
    line = max(round(0.008 * wide), 1)
    draw.rectangle((0.07 * wide, 0.05 * tall, 0.93 * wide, 0.95 * tall), outline=ink, width=line)
    _write(draw, word.title(), (0.14 * wide, 0.12 * tall, 0.86 * wide, 0.42 * tall), ink)
    _drawing(word)(draw, 0.5 * wide, 0.68 * tall, 0.2 * min(wide, tall), ink)
    return _finished(image)


@lru_cache(maxsize=64)
def wall_picture(width: float, height: float, color: Color) -> NDArray[uint8]:
    """A landscape in layers of one hue, h x w x 4.

    Args:
        width: [m].
        height: [m].
        color: its main color.
    """
    base = _rgb(color)
    image, draw, _ = _canvas(width, height, _mixed(base, _LIGHT, 0.75))
    wide, tall = image.width, image.height
    seed = _number(f"{width:.4f} {height:.4f} {color}")
    sun, r = (0.25 + 0.5 * (seed % 97) / 97) * wide, 0.09 * min(wide, tall)
    draw.ellipse((sun - r, 0.22 * tall - r, sun + r, 0.22 * tall + r), fill=(244, 196, 120))
    for layer in range(5):
        level, wave = 0.42 + 0.12 * layer, 0.07 - 0.006 * layer
        phase = (seed >> (3 * layer)) % 50
        line = [
            (t * wide, tall * (level + wave * sin(6 * t + phase) + 0.4 * wave * sin(17 * t + 2 * phase)))
            for t in _steps(60)
        ]
        draw.polygon([(0, tall), *line, (wide, tall)], fill=_mixed(_mixed(base, _LIGHT, 0.5), _DARK, 0.17 * layer))
    return _finished(image)


@lru_cache(maxsize=16)
def clock_face(diameter: float, color: Color) -> NDArray[uint8]:
    """The face of a clock with twelve numbers, h x w x 4.

    Args:
        diameter: [m].
        color: the color of the paper.
    """
    base = _rgb(color)
    image, draw, _ = _canvas(diameter, diameter, base)
    half = image.width / 2
    for minute in range(60):
        turn, start = minute * pi / 30, 0.93 if minute % 5 else 0.89
        ends = [(half * (1 + reach * sin(turn)), half * (1 - reach * cos(turn))) for reach in (start, 0.96)]
        draw.line(ends, fill=_ink(base), width=max(round(0.012 * half), 1))
    for hour in range(1, 13):
        x, y = half * (1 + 0.58 * sin(hour * pi / 6)), half * (1 - 0.58 * cos(hour * pi / 6))
        reach = 0.13 * half
        _write(draw, str(hour), (x - reach, y - reach, x + reach, y + reach), _ink(base))
    return _finished(image)


_SEGMENTS = {  # corners from (0, 0) at the upper left to (1, 2) at the lower right
    "a": ((0, 0), (1, 0)),
    "b": ((1, 0), (1, 1)),
    "c": ((1, 1), (1, 2)),
    "d": ((0, 2), (1, 2)),
    "e": ((0, 1), (0, 2)),
    "f": ((0, 0), (0, 1)),
    "g": ((0, 1), (1, 1)),
}
_SEGMENTS_OF_DIGITS = {"0": "abcdef", "1": "bc", "2": "abdeg", "3": "abcdg"}


@lru_cache(maxsize=16)
def clock_display(width: float, height: float, color: Color) -> NDArray[uint8]:
    """The display of an appliance: a time in seven-segment digits on dark glass, h x w x 4.

    Args:
        width: [m].
        height: [m].
        color: the color of the glass.
    """
    base = _rgb(color)
    bright, dim = (150, 232, 226), _mixed(base, (150, 232, 226), 0.07)
    image, draw, _ = _canvas(width, height, base)
    digit = min(0.29 * image.height, 0.09 * image.width)  # half of the height
    pitch, left, top = 1.75 * digit, image.width / 2 - 3.8 * digit, image.height / 2 - digit
    for number, character in enumerate("12 30"):
        x = left + pitch * number + (0.1 if number < 2 else -0.1) * digit
        if character == " ":
            for y in (top + 0.6 * digit, top + 1.4 * digit):
                r = 0.13 * digit
                draw.ellipse((x + 0.4 * digit - r, y - r, x + 0.4 * digit + r, y + r), fill=bright)
            continue
        for name, ends in sorted(_SEGMENTS.items(), key=lambda segment: segment[0] in _SEGMENTS_OF_DIGITS[character]):
            points = [(x + digit * (0.1 + 0.8 * across), top + digit * down) for across, down in ends]
            fill = bright if name in _SEGMENTS_OF_DIGITS[character] else dim
            draw.line(points, fill=fill, width=max(round(0.17 * digit), 1))
    return _finished(image)
