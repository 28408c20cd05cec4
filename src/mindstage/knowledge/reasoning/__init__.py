"""Reasoning: what follows from what was told, as an index that questions look things up in."""

from mindstage.knowledge.reasoning.closure import Closure
from mindstage.knowledge.reasoning.expressions import AllOf, AnyOf, Expression, Kind, Named, Restriction, Unread, Value
from mindstage.knowledge.reasoning.index import ClassRestriction, Index, Part
from mindstage.knowledge.reasoning.namebook import Namebook, NameKind
from mindstage.knowledge.reasoning.properties import PropertyIndex, Statement

__all__ = [
    "AllOf",
    "AnyOf",
    "ClassRestriction",
    "Closure",
    "Expression",
    "Index",
    "Kind",
    "NameKind",
    "Namebook",
    "Named",
    "Part",
    "PropertyIndex",
    "Restriction",
    "Statement",
    "Unread",
    "Value",
]
