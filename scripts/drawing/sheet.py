"""Sheets: many small pictures with their names, as one small file."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

__all__ = ["save_sheet"]

_COLUMNS = 9
_CAPTION = 26
"""Pixels for two lines of text."""
_LETTERS = 19
"""That a line has room for."""
_INK = (70, 70, 70)
_COLORS = 250


def save_sheet(path: Path, pictures: Sequence[tuple[str, Image.Image]], *, paper: tuple[int, int, int]) -> None:
    """Writes the pictures row by row, with as few colors as they need to look well."""
    side = pictures[0][1].width
    columns = min(_COLUMNS, len(pictures))
    rows = -(-len(pictures) // columns)
    sheet = Image.new("RGB", (columns * side, rows * (side + _CAPTION)), paper)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=9)
    for number, (name, picture) in enumerate(pictures):
        row, column = divmod(number, columns)
        x, y = column * side, row * (side + _CAPTION)
        sheet.paste(picture, (x, y))
        for line, text in enumerate(textwrap.wrap(name, _LETTERS)[:2]):
            draw.text((x + side / 2, y + side + 12 * line), text, font=font, fill=_INK, anchor="mt")
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet.quantize(_COLORS, dither=Image.Dither.NONE).save(path, optimize=True)
