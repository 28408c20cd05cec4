"""Procedural textures with a metric size: color, roughness and normal maps, baked once and cached."""

from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names
from mindstage.textures.catalog import TextureInfo, TextureLayout, texture_info, texture_names

if TYPE_CHECKING:
    from mindstage.textures.baking import TextureSet, texture_set
    from mindstage.textures.images import TextureMap, texture_jpeg

__all__ = [
    "TextureInfo",
    "TextureLayout",
    "TextureMap",
    "TextureSet",
    "texture_info",
    "texture_jpeg",
    "texture_names",
    "texture_set",
]

__getattr__, __dir__ = lazy_names(__name__, ["mindstage.textures.baking", "mindstage.textures.images"])
