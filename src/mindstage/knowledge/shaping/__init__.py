"""Shaping: how things of a class look, feel and shine, as far as ontologies say so; nothing of it answers questions."""

from mindstage.knowledge.shaping.resolver import Shaping
from mindstage.knowledge.shaping.rule import BODY, Lighting, ShapeRule, Substance

__all__ = ["BODY", "Lighting", "ShapeRule", "Shaping", "Substance"]
