"""Finishes: the surfaces that parts of shapes have unless somebody knows better."""

from __future__ import annotations

from mindstage.world.colours import rgb
from mindstage.world.forms import Surface

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


PLAIN = Surface(colour=rgb("b9bcc0"))
LACQUER = Surface(material="lacquered wood", colour=rgb("ece4d6"), roughness=0.45)
OAK = Surface(material="wood", colour=rgb("b8946c"), roughness=0.6)
BAMBOO = Surface(material="wood", colour=rgb("cfb083"), roughness=0.6)
WICKER = Surface(material="wicker", colour=rgb("b58a55"), roughness=0.9)
STONE = Surface(material="stone", colour=rgb("6d6a68"), roughness=0.4)
STEEL = Surface(material="steel", colour=rgb("c0c6ca"), metalness=0.9, roughness=0.35)
CHROME = Surface(material="chrome", colour=rgb("d9dee2"), metalness=1.0, roughness=0.15)
IRON = Surface(material="iron", colour=rgb("3a3f45"), metalness=0.6, roughness=0.5)
BRASS = Surface(material="brass", colour=rgb("c8a253"), metalness=0.9, roughness=0.3)
CERAMIC = Surface(material="ceramic", colour=rgb("f5f1e8"), roughness=0.25)
TERRACOTTA = Surface(material="terracotta", colour=rgb("b8684a"), roughness=0.9)
CLEAR_GLASS = Surface(material="glass", colour=rgb("cfe4ea"), roughness=0.05, opacity=0.3)
SKY_GLASS = Surface(material="glass", colour=rgb("a9cbd8"), roughness=0.05, opacity=0.35)
BLACK_GLASS = Surface(material="glass", colour=rgb("22262b"), roughness=0.08)
SCREEN = Surface(material="glass", colour=rgb("1d2733"), roughness=0.1)
DARK_PLASTIC = Surface(material="plastic", colour=rgb("33373c"), roughness=0.5)
CREAM = Surface(material="plastic", colour=rgb("efe9dd"), roughness=0.5)
RED = Surface(material="plastic", colour=rgb("b7463a"), roughness=0.45)
LABEL = Surface(material="paper", colour=rgb("f0e7d2"), roughness=0.8)
PAPER = Surface(material="paper", colour=rgb("f6f3ea"), roughness=0.9)
PICTURE = Surface(material="paper", colour=rgb("8fa9b5"), roughness=0.8)
LINEN = Surface(material="textile", colour=rgb("e6dfd1"), roughness=0.95)
LEAF = Surface(material="plant", colour=rgb("5f8a4a"), roughness=0.8)
SOIL = Surface(material="soil", colour=rgb("4a3728"), roughness=1.0)
FOOD = Surface(material="food", colour=rgb("c9854a"), roughness=0.8)
PLASTER = Surface(material="plaster", colour=rgb("ece8e0"), roughness=0.95)
GLOWING = Surface(material="glass", colour=rgb("fff1cc"), roughness=0.4, glow=0.9)
