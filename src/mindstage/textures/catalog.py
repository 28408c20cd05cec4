"""The textures that exist: their names, metric sizes, and how they are laid on a part.

No image is computed here, so geometry can be built without baking a texture.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType

import msgspec

from mindstage.errors import TextureNotFoundError

__all__ = ["TextureInfo", "TextureLayout", "texture_info", "texture_names"]


class TextureLayout(StrEnum):
    """How a texture is laid on the parts of a body."""

    GRAIN = "grain"
    """Its u axis is along the longest side of each part, and each part begins at another place of the texture."""
    GRID = "grid"
    """Upright, and aligned over all parts of a body: tiles, parquet."""
    LOOSE = "loose"
    """Upright, and each part begins at another place."""


class TextureInfo(msgspec.Struct, frozen=True, kw_only=True):
    """What is known about a texture without baking it."""

    name: str
    size: tuple[float, float]
    """Width and height of one repeat [m]."""
    layout: TextureLayout
    description: str
    is_plain: bool = False
    """Whether it has no visible pattern, only a slightly uneven surface, as enamel: without reflections and fine
    normals it can be left out."""


_PLAIN = frozenset(
    (
        *("lacquered_board", "polished_metal", "cast_iron", "enamel", "glazed_ceramic", "glass", "mirror", "plaster"),
        *("paper", "plastic", "rubber", "wax"),
    )
)


def _info(
    name: str, size: tuple[float, float], description: str, layout: TextureLayout = TextureLayout.LOOSE
) -> TextureInfo:
    return TextureInfo(name=name, size=size, layout=layout, description=description, is_plain=name in _PLAIN)


_GRAIN, _GRID = TextureLayout.GRAIN, TextureLayout.GRID

_TEXTURES: Mapping[str, TextureInfo] = MappingProxyType(
    {
        info.name: info
        for info in (
            _info("oak_board", (0.8, 0.4), "oak with arched growth rings and open pores", _GRAIN),
            _info("oak_staves", (0.8, 0.4), "oak boards of 5 cm glued side by side, as in table tops", _GRAIN),
            _info("walnut_board", (0.8, 0.4), "walnut with broad dark figure", _GRAIN),
            _info("beech_board", (0.6, 0.3), "beech with small flecks", _GRAIN),
            _info("pine_board", (0.8, 0.4), "pine with wide rings", _GRAIN),
            _info("bamboo_staves", (0.6, 0.3), "bamboo strips with nodes", _GRAIN),
            _info("lacquered_board", (0.5, 0.5), "sprayed paint on board", _GRAIN),
            _info("painted_wood", (0.5, 0.5), "brushed paint with the grain showing through", _GRAIN),
            _info("parquet", (1.2, 0.8), "oak boards of 10 x 60 cm, staggered", _GRID),
            _info("brushed_steel", (0.3, 0.3), "steel with fine scratches along one direction", _GRAIN),
            _info("polished_metal", (0.4, 0.4), "chrome or brass with faint smudges"),
            _info("cast_iron", (0.15, 0.15), "rough cast metal"),
            _info("enamel", (0.3, 0.3), "glossy paint on sheet metal"),
            _info("glazed_ceramic", (0.2, 0.2), "glaze that is slightly uneven"),
            _info("terracotta", (0.2, 0.2), "unglazed, sandy clay"),
            _info("glass", (0.5, 0.5), "smooth, with faint smudges"),
            _info("mirror", (0.8, 0.8), "perfectly flat"),
            _info("granite", (0.4, 0.4), "polished stone with mineral grains"),
            _info("marble", (0.8, 0.8), "polished stone with veins"),
            _info("concrete", (1.0, 1.0), "smoothed concrete with pores"),
            _info("plaster", (0.8, 0.8), "painted with a roller"),
            _info("floor_tiles", (0.9, 0.9), "square tiles of 30 cm with grout", _GRID),
            _info("wall_tiles", (0.6, 0.6), "glossy tiles of 15 cm with grout", _GRID),
            _info("linen", (0.1, 0.1), "plain weave of uneven threads"),
            _info("upholstery", (0.16, 0.16), "coarse two-tone weave"),
            _info("terry", (0.12, 0.12), "loops of toweling"),
            _info("carpet", (0.25, 0.25), "cut pile"),
            _info("leather", (0.15, 0.15), "grained leather"),
            _info("wicker", (0.16, 0.16), "woven willow"),
            _info("cardboard", (0.3, 0.3), "corrugated brown cardboard", _GRAIN),
            _info("paper", (0.2, 0.2), "uncoated paper"),
            _info("plastic", (0.1, 0.1), "molded plastic with a fine grain"),
            _info("rubber", (0.1, 0.1), "matt rubber"),
            _info("wax", (0.1, 0.1), "wax or soap"),
            _info("bread_crust", (0.15, 0.15), "baked crust, darker on ridges"),
            _info("fruit_skin", (0.06, 0.06), "skin with fine dots and dimples"),
            _info("sponge", (0.08, 0.08), "open pores"),
            _info("leaf", (0.12, 0.06), "veins on both sides of a midrib", _GRAIN),
            _info("soil", (0.2, 0.2), "loose crumbs"),
        )
    }
)


def texture_names() -> tuple[str, ...]:
    """The names of all textures."""
    return tuple(_TEXTURES)


def texture_info(name: str) -> TextureInfo:
    """The size and layout of a texture.

    Raises:
        TextureNotFoundError: there is no texture of that name.
    """
    try:
        return _TEXTURES[name]
    except KeyError:
        raise TextureNotFoundError(name, known=_TEXTURES) from None
