"""Shaping: how things of a class look, feel and shine, as far as ontologies say so; nothing of it answers questions."""

from mindstage.knowledge.shaping.resolver import ShapeRuleResolver
from mindstage.knowledge.shaping.rule import DEFAULT_ROLE, LightRule, PartMaterial, ShapeRule

__all__ = ["DEFAULT_ROLE", "LightRule", "PartMaterial", "ShapeRule", "ShapeRuleResolver"]
