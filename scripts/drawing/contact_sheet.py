"""Contact sheets: many small images with captions in one file."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

__all__ = ["save_sheet"]

_COLUMNS = 9
_CAPTION_HEIGHT = 26
"""[px], two lines of text."""
_CAPTION_WIDTH = 19
"""Characters per line."""
_TEXT_COLOR = (70, 70, 70)
_COLORS = 250


def save_sheet(path: Path, pictures: Sequence[tuple[str, Image.Image]], *, background: tuple[int, int, int]) -> None:
    """Writes the images row by row, with a reduced palette."""
    side = pictures[0][1].width
    columns = min(_COLUMNS, len(pictures))
    rows = -(-len(pictures) // columns)
    sheet = Image.new("RGB", (columns * side, rows * (side + _CAPTION_HEIGHT)), background)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=9)
    for number, (name, picture) in enumerate(pictures):
        row, column = divmod(number, columns)
        x, y = column * side, row * (side + _CAPTION_HEIGHT)
        sheet.paste(picture, (x, y))
        for line, text in enumerate(textwrap.wrap(name, _CAPTION_WIDTH)[:2]):
            draw.text((x + side / 2, y + side + 12 * line), text, font=font, fill=_TEXT_COLOR, anchor="mt")
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet.quantize(_COLORS, dither=Image.Dither.NONE).save(path, optimize=True)
