"""Reasoning: what follows from what was told, as an index that questions look things up in."""

from mindstage.knowledge.reasoning.axioms import ClassRestriction
from mindstage.knowledge.reasoning.expressions import (
    ComplementOf,
    Expression,
    IntersectionOf,
    LiteralValue,
    NamedClass,
    OneOf,
    Restriction,
    RestrictionType,
    UnionOf,
    UnparsedExpression,
    named_classes,
)
from mindstage.knowledge.reasoning.index import PartOfStep, Reasoner
from mindstage.knowledge.reasoning.membership import InferenceRule, Justification
from mindstage.knowledge.reasoning.namebook import EntityType, NameIndex
from mindstage.knowledge.reasoning.properties import ObjectTriple, PropertyHierarchy
from mindstage.knowledge.taxonomy import TransitiveClosure

__all__ = [
    "ClassRestriction",
    "ComplementOf",
    "EntityType",
    "Expression",
    "InferenceRule",
    "IntersectionOf",
    "Justification",
    "LiteralValue",
    "NameIndex",
    "NamedClass",
    "ObjectTriple",
    "OneOf",
    "PartOfStep",
    "PropertyHierarchy",
    "Reasoner",
    "Restriction",
    "RestrictionType",
    "TransitiveClosure",
    "UnionOf",
    "UnparsedExpression",
    "named_classes",
]
