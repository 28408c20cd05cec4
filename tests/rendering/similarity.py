"""Similarity of pictures: what a person would notice, and not what differs between graphics drivers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from skimage.metrics import structural_similarity

__all__ = ["REFERENCES", "picture_similarity", "read_picture"]

REFERENCES = Path(__file__).parent / "photographs"
_SIZE = (240, 150)
_COLOR_TOLERANCE = 0.06
"""Difference of colors, averaged over small regions, from which on they count as different."""

_COLOR_WEIGHT = 8
"""A color that is wrong in one of eighty regions is as bad as a structural similarity of 0.9."""


def read_picture(path: Path) -> NDArray[np.uint8]:
    """A picture file as an array, h x w x 3."""
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def picture_similarity(picture: NDArray[np.uint8], reference: NDArray[np.uint8]) -> float:
    """How similar two pictures are, from 0 to 1: the lowest of three measures.

    They are the structural similarity (SSIM) of the whole, that of the worst of 6 x 4 regions, raised since noise has
    more weight in a region, and the part of small regions whose mean color is the same.

    Args:
        picture: h x w x 3, sRGB.
        reference: the same, of any size.
    """
    one, other = (_reduced(each) for each in (picture, reference))
    similarity, field = structural_similarity(one, other, channel_axis=2, data_range=1.0, full=True)
    regions = [part.mean() for row in np.array_split(field.mean(axis=2), 4) for part in np.array_split(row, 6, axis=1)]
    colors = np.abs(_blocks(one) - _blocks(other)).max(axis=2)
    return float(min(similarity, min(regions) ** 0.5, 1 - np.mean(colors > _COLOR_TOLERANCE) * _COLOR_WEIGHT))


def _reduced(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    image = Image.fromarray(picture).resize(_SIZE, Image.Resampling.BOX)
    return np.asarray(image, dtype=np.float64) / 255


def _blocks(picture: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means of blocks of 10 x 10 pixels."""
    height, width, _ = picture.shape
    return picture.reshape(height // 10, 10, width // 10, 10, 3).mean(axis=(1, 3))
