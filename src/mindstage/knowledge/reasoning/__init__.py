"""Reasoning: what follows from what was told, as an index that questions look things up in."""

from mindstage.knowledge.reasoning.axioms import ClassRestriction
from mindstage.knowledge.reasoning.expressions import (
    AllOf,
    AnyOf,
    Expression,
    Kind,
    Named,
    Not,
    OneOf,
    Restriction,
    Unread,
    Value,
    classes_in,
)
from mindstage.knowledge.reasoning.index import Index, Part
from mindstage.knowledge.reasoning.membership import Ground, Rule
from mindstage.knowledge.reasoning.namebook import Namebook, NameKind
from mindstage.knowledge.reasoning.properties import PropertyIndex, Statement
from mindstage.knowledge.taxonomy import Closure

__all__ = [
    "AllOf",
    "AnyOf",
    "ClassRestriction",
    "Closure",
    "Expression",
    "Ground",
    "Index",
    "Kind",
    "NameKind",
    "Namebook",
    "Named",
    "Not",
    "OneOf",
    "Part",
    "PropertyIndex",
    "Restriction",
    "Rule",
    "Statement",
    "Unread",
    "Value",
    "classes_in",
]
