"""Default materials of the roles of shapes."""

from __future__ import annotations

from mindstage.scene.colors import rgb_from_hex
from mindstage.scene.geometry import PbrMaterial

__all__ = [
    "BAMBOO",
    "BLACK_GLASS",
    "BRASS",
    "CERAMIC",
    "CHROME",
    "CLEAR_GLASS",
    "CREAM",
    "DARK_PLASTIC",
    "FOOD",
    "GLOWING",
    "IRON",
    "LABEL",
    "LACQUER",
    "LEAF",
    "LINEN",
    "OAK",
    "PAPER",
    "PICTURE",
    "PLAIN",
    "PLASTER",
    "RED",
    "SCREEN",
    "SKY_GLASS",
    "SOIL",
    "STEEL",
    "STONE",
    "TERRACOTTA",
    "WICKER",
]


PLAIN = PbrMaterial(color=rgb_from_hex("b9bcc0"))
LACQUER = PbrMaterial(name="lacquered wood", color=rgb_from_hex("ece4d6"), roughness=0.45, texture="lacquered_board")
OAK = PbrMaterial(name="wood", color=rgb_from_hex("b8946c"), roughness=0.6, texture="oak_board")
BAMBOO = PbrMaterial(name="wood", color=rgb_from_hex("cfb083"), roughness=0.6, texture="bamboo_staves")
WICKER = PbrMaterial(name="wicker", color=rgb_from_hex("b58a55"), roughness=0.9, texture="wicker")
STONE = PbrMaterial(name="stone", color=rgb_from_hex("6d6a68"), roughness=0.4, texture="granite")
STEEL = PbrMaterial(name="steel", color=rgb_from_hex("c0c6ca"), metalness=0.9, roughness=0.35, texture="brushed_steel")
CHROME = PbrMaterial(
    name="chrome", color=rgb_from_hex("d9dee2"), metalness=1.0, roughness=0.15, texture="polished_metal"
)
IRON = PbrMaterial(name="iron", color=rgb_from_hex("3a3f45"), metalness=0.6, roughness=0.5, texture="cast_iron")
BRASS = PbrMaterial(name="brass", color=rgb_from_hex("c8a253"), metalness=0.9, roughness=0.3, texture="polished_metal")
CERAMIC = PbrMaterial(name="ceramic", color=rgb_from_hex("f5f1e8"), roughness=0.25, texture="glazed_ceramic")
TERRACOTTA = PbrMaterial(name="terracotta", color=rgb_from_hex("b8684a"), roughness=0.9, texture="terracotta")
CLEAR_GLASS = PbrMaterial(name="glass", color=rgb_from_hex("cfe4ea"), roughness=0.05, opacity=0.3, texture="glass")
SKY_GLASS = PbrMaterial(name="glass", color=rgb_from_hex("a9cbd8"), roughness=0.05, opacity=0.35, texture="glass")
BLACK_GLASS = PbrMaterial(name="glass", color=rgb_from_hex("22262b"), roughness=0.08, texture="glass")
SCREEN = PbrMaterial(name="glass", color=rgb_from_hex("1d2733"), roughness=0.1, texture="glass")
DARK_PLASTIC = PbrMaterial(name="plastic", color=rgb_from_hex("33373c"), roughness=0.5, texture="plastic")
CREAM = PbrMaterial(name="plastic", color=rgb_from_hex("efe9dd"), roughness=0.5, texture="plastic")
RED = PbrMaterial(name="plastic", color=rgb_from_hex("b7463a"), roughness=0.45, texture="plastic")
LABEL = PbrMaterial(name="paper", color=rgb_from_hex("f0e7d2"), roughness=0.8, texture="paper")
PAPER = PbrMaterial(name="paper", color=rgb_from_hex("f6f3ea"), roughness=0.9, texture="paper")
PICTURE = PbrMaterial(name="paper", color=rgb_from_hex("8fa9b5"), roughness=0.8, texture="paper")
LINEN = PbrMaterial(name="textile", color=rgb_from_hex("e6dfd1"), roughness=0.95, texture="linen")
LEAF = PbrMaterial(name="plant", color=rgb_from_hex("5f8a4a"), roughness=0.8, texture="leaf")
SOIL = PbrMaterial(name="soil", color=rgb_from_hex("4a3728"), roughness=1.0, texture="soil")
FOOD = PbrMaterial(name="food", color=rgb_from_hex("c9854a"), roughness=0.8, texture="bread_crust")
PLASTER = PbrMaterial(name="plaster", color=rgb_from_hex("ece8e0"), roughness=0.95, texture="plaster")
GLOWING = PbrMaterial(name="glass", color=rgb_from_hex("fff1cc"), roughness=0.4, emission=0.9)
