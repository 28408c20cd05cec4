"""Outlines and labels in rendered pictures.

Outlines are drawn through whatever is in front, so that the milk in a closed fridge is seen; labels are placed where
they cover neither each other nor lie behind other bodies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mindstage.rendering.camera import ViewFrame
from mindstage.rendering.render_scene import RenderLabel, RenderScene
from mindstage.scene import Color

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont, ImageFont

__all__ = ["Outline", "annotate"]


_SELECTION_COLOR: Color = (0.91, 0.36, 0.02)
_TINT, _HIDDEN_TINT = 0.62, 0.28
"""Weight of the color of a highlighted body where it is visible, and where it is behind others."""
_DIM, _DIM_GRAY = 0.55, 0.86
"""Weight of the gray that everything else is blended with while bodies are highlighted."""
_LINE_PX = 2
_FONT_PX = 13
_PADDING_PX = (5, 2)
_LABEL_SHIFTS = (0, 1, -1, 2, -2, 3, -3)
"""Where a label is tried, in heights of a label above its point."""
_OCCLUSION_MARGIN_FRACTION = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outline:
    """A body that is outlined."""

    color: Color | None
    """The color of a highlighted body; None if it is only selected."""
    visible: NDArray[np.bool_]
    """h x w, where the body is seen."""
    whole: NDArray[np.bool_]
    """h x w, where it would be seen if nothing were in front of it."""
    selected: bool = False


def annotate(
    picture: NDArray[np.uint8],
    scene: RenderScene,
    view: ViewFrame,
    depth: NDArray[np.floating[Any]],
    outlines: Sequence[Outline],
) -> NDArray[np.uint8]:
    """Draws outlines and labels into a picture.

    Args:
        picture: h x w x 3, sRGB.
        scene: what it shows.
        view: its camera.
        depth: h x w, distance along the axis of the camera [m].
        outlines: the bodies that are outlined.

    Returns:
        The picture, h x w x 3.
    """
    if outlines:
        picture = _outlined(picture, outlines)
    if scene.labels:
        picture = _labeled(picture, scene.labels, view, depth)
    return picture


def _outlined(picture: NDArray[np.uint8], outlines: Sequence[Outline]) -> NDArray[np.uint8]:
    result: NDArray[np.floating[Any]] = picture.astype(np.float32) / 255
    highlighted = [each for each in outlines if each.color is not None]
    if highlighted:
        shown = np.any([each.visible for each in highlighted], axis=0)
        gray = result.mean(axis=2, keepdims=True) * (1 - _DIM) + _DIM_GRAY * _DIM
        dimmed = result * (1 - _DIM) + gray * _DIM
        result = np.where(shown[..., None], result, dimmed)
    for each in highlighted:
        color = np.array(each.color, dtype=np.float32)
        brightness = result.mean(axis=2, keepdims=True)
        tint = np.clip(color * (0.45 + 0.75 * brightness), 0, 1)
        weight = np.where(each.visible, _TINT, np.where(each.whole, _HIDDEN_TINT, 0.0))[..., None]
        result = result * (1 - weight) + np.where(each.visible[..., None], tint, color) * weight
    for each in outlines:
        edge = _SELECTION_COLOR if each.selected or each.color is None else each.color
        line = _border(each.whole)[..., None]
        result = result * (1 - line) + np.array(edge, dtype=np.float32) * line
    return np.asarray(np.clip(result * 255 + 0.5, 0, 255), dtype=np.uint8)


def _border(mask: NDArray[np.bool_]) -> NDArray[np.floating[Any]]:
    """The weight of a line around a mask."""
    solid = mask.astype(np.float32)
    padded = np.pad(solid, _LINE_PX)
    height, width = mask.shape
    total = np.zeros_like(solid)
    offsets = [
        (row, column)
        for row in range(-_LINE_PX, _LINE_PX + 1)
        for column in range(-_LINE_PX, _LINE_PX + 1)
        if row * row + column * column <= _LINE_PX * _LINE_PX + 1
    ]
    for row, column in offsets:
        total += padded[_LINE_PX + row : _LINE_PX + row + height, _LINE_PX + column : _LINE_PX + column + width]
    part = total / len(offsets)
    line: NDArray[np.floating[Any]] = np.clip(1.6 - np.abs(part - 0.5) * 4, 0, 1) * (part > 0) * (part < 1)
    return line


def _labeled(
    picture: NDArray[np.uint8], labels: Sequence[RenderLabel], view: ViewFrame, depth: NDArray[np.floating[Any]]
) -> NDArray[np.uint8]:
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(picture).convert("RGBA")
    layer = Image.new("RGBA", image.size, (0, 0, 0, 0))
    draw = ImageDraw.Draw(layer)
    font = ImageFont.load_default(_FONT_PX)
    taken: list[tuple[float, float, float, float]] = []
    for label, x, y in _visible_labels(labels, view, depth):
        box = _free_box(_extent(font, label.text), x, y, taken, view)
        if box is None:
            continue
        taken.append(box)
        left, upper, right, lower = box
        draw.rounded_rectangle((left, upper, right, lower), radius=3, fill=(255, 255, 255, 225))
        draw.text((left + _PADDING_PX[0], (upper + lower) / 2), label.text, font=font, fill=(28, 32, 38), anchor="lm")
        if not upper <= y <= lower:
            draw.line((x, y, min(max(x, left), right), lower if y > lower else upper), fill=(60, 66, 74, 160))
            draw.ellipse((x - 2, y - 2, x + 2, y + 2), fill=(60, 66, 74, 200))
    return np.asarray(Image.alpha_composite(image, layer).convert("RGB"))


def _extent(font: FreeTypeFont | ImageFont, text: str) -> tuple[float, float]:
    width = font.getlength(text)
    return width + 2 * _PADDING_PX[0], _FONT_PX + 2 * _PADDING_PX[1] + 2


def _visible_labels(
    labels: Sequence[RenderLabel], view: ViewFrame, depth: NDArray[np.floating[Any]]
) -> list[tuple[RenderLabel, float, float]]:
    """The labels of bodies that are in the picture and not behind others, nearest first, with their pixels."""
    places = view.project(np.array([label.point for label in labels], dtype=float))
    found = []
    for label, (x, y, distance) in zip(labels, places.tolist(), strict=True):
        if distance <= 0 or not (0 <= x < view.width and 0 <= y < view.height):
            continue
        reach = label.radius * (1 + _OCCLUSION_MARGIN_FRACTION) + 0.02
        if float(depth[int(y), int(x)]) < distance - reach:
            continue
        found.append((distance, label, x, y))
    found.sort(key=lambda each: each[0])
    return [(label, x, y) for _, label, x, y in found]


def _free_box(
    extent: tuple[float, float], x: float, y: float, taken: list[tuple[float, float, float, float]], view: ViewFrame
) -> tuple[float, float, float, float] | None:
    """A place near a point where a label covers no other; None if there is none."""
    width, height = extent
    for shift in _LABEL_SHIFTS:
        left = min(max(x - width / 2, 2), view.width - width - 2)
        upper = y - height / 2 - shift * (height + 1)
        box = (left, upper, left + width, upper + height)
        if upper < 2 or box[3] > view.height - 2:
            continue
        if all(box[0] > b[2] or box[2] < b[0] or box[1] > b[3] or box[3] < b[1] for b in taken):
            return box
    return None
