"""Textures as compressed images in the layout of glTF, for files and for the page."""

from __future__ import annotations

import io
from collections.abc import Callable
from enum import StrEnum
from functools import lru_cache
from typing import TYPE_CHECKING

from mindstage.ranges import Pixels, checked
from mindstage.textures.baking import texture_set

if TYPE_CHECKING:
    from numpy import uint8
    from numpy.typing import NDArray

__all__ = ["TextureMap", "TextureUri", "image_png", "texture_jpeg"]

_QUALITY = {"color": 88, "roughness": 92, "normal": 92}


class TextureMap(StrEnum):
    """The images of a texture."""

    COLOR = "color"
    ROUGHNESS = "roughness"
    """As glTF's metallicRoughnessTexture: roughness in green; blue, which multiplies the metalness, is 1."""
    NORMAL = "normal"


TextureUri = Callable[[str, TextureMap], str | None]
"""Returns the URI of an image of a texture, given its name; None if that image is left out."""


def image_png(pixels: NDArray[uint8], *, longest_px: int | None = None) -> bytes:
    """An image as PNG.

    Args:
        pixels: h x w x 3 or 4, sRGB.
        longest_px: larger images are reduced to this width or height; by default none.
    """
    from PIL import Image

    image = Image.fromarray(pixels)
    if longest_px is not None:
        image.thumbnail((longest_px, longest_px))
    content = io.BytesIO()
    image.save(content, "png")
    return content.getvalue()


@lru_cache(maxsize=512)
@checked
def texture_jpeg(name: str, map: TextureMap, pixels: Pixels) -> bytes:
    """One image of a texture as JPEG.

    Args:
        name: the name of the texture.
        map: which image.
        pixels: its width and height; at most that of the texture.

    Raises:
        TextureNotFoundError: there is no texture of that name.
    """
    import numpy as np
    from PIL import Image

    textures = texture_set(name)
    match map:
        case TextureMap.COLOR:
            array = textures.color
        case TextureMap.NORMAL:
            array = textures.normal
        case TextureMap.ROUGHNESS:
            array = np.full((*textures.roughness.shape, 3), 255, dtype=np.uint8)
            array[..., 1] = textures.roughness
    image = Image.fromarray(array)
    if pixels < image.width:
        image = image.resize((pixels, pixels), Image.Resampling.BOX)
    content = io.BytesIO()
    # Only chroma of colors is subsampled: components of normals are no colors.
    image.save(content, "jpeg", quality=_QUALITY[map], subsampling=2 if map is TextureMap.COLOR else 0)
    return content.getvalue()
