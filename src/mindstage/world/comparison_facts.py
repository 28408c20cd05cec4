"""Statements compared by what they say: forms, multisets, and a line of text for each.

Two facts have the same form when they state the same: numbers of one datatype count by their value ("0.0" is "0.00"
and "0E0"), language tags without case, things without a name by what is said about them, in any order.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping
from typing import TypeVar

import msgspec

from mindstage.world.facts import BlankNode, FactValue, IriRef, Literal, PropertyAssertion
from mindstage.world.values import Tag

__all__ = ["Statement", "StatementCanonicalizer", "multiset_difference"]

XSD = "http://www.w3.org/2001/XMLSchema#"
NUMERIC_DATATYPES = frozenset(
    XSD + name
    for name in (
        *("float", "double", "decimal", "integer", "nonPositiveInteger", "negativeInteger", "nonNegativeInteger"),
        *("positiveInteger", "long", "int", "short", "byte"),
        *("unsignedLong", "unsignedInt", "unsignedShort", "unsignedByte"),
    )
)
NUMBER_PATTERN = re.compile(r"[ \t\n\r]*([+-]?)(?=\.?[0-9])([0-9]*)\.?([0-9]*)(?:[eE]([+-]?[0-9]{1,9}))?[ \t\n\r]*")


class Statement(msgspec.Struct, frozen=True):
    """A fact or a tag, and what it is about; `str` gives one readable line of it."""

    id: str
    """Of a body, a constraint, a light; the IRI of a resource or of the world itself."""
    assertion: PropertyAssertion | Tag

    def __str__(self) -> str:
        if isinstance(self.assertion, Tag):
            return f"{self.assertion.type};{self.assertion.key},{self.assertion.value}"
        return format_assertion(self.assertion)


class StatementCanonicalizer:
    """Numbers statements: two have the same number when they say the same. One table serves both sides.

    What is nested is numbered from the inside out and without recursion, since a list of a thousand items in RDF is
    a thousand levels deep.
    """

    def __init__(self) -> None:
        self._ids: dict[Hashable, int] = {}

    def canonical_id(self, fact: PropertyAssertion, names: Mapping[str, str]) -> int:
        """The number of a fact once the names in it are replaced by those that they stand for."""
        value = fact.value
        form = self._blank_node_id(value, names) if isinstance(value, BlankNode) else _leaf_key(value, names)
        return self._intern((fact.property, form))

    def _intern(self, key: Hashable) -> int:
        return self._ids.setdefault(key, len(self._ids))

    def _blank_node_id(self, root: BlankNode, names: Mapping[str, str]) -> int:
        done: dict[int, int] = {}
        waiting = [root]
        while waiting:
            inner = [fact.value for fact in waiting[-1].facts if isinstance(fact.value, BlankNode)]
            if undone := [value for value in inner if id(value) not in done]:
                waiting.extend(undone)
                continue
            node = waiting.pop()
            forms = (
                (
                    fact.property,
                    done[id(fact.value)] if isinstance(fact.value, BlankNode) else _leaf_key(fact.value, names),
                )
                for fact in node.facts
            )
            done[id(node)] = self._intern((None, *sorted(map(self._intern, forms))))
        return done[id(root)]


def _leaf_key(value: IriRef | Literal, names: Mapping[str, str]) -> Hashable:
    if isinstance(value, IriRef):
        return ("iri", names.get(value.iri, value.iri))
    number = _parse_decimal(value.text) if value.datatype in NUMERIC_DATATYPES else None
    datatype = None if value.datatype == XSD + "string" else value.datatype
    return ("literal", number or value.text, datatype, value.language and value.language.lower())


def _parse_decimal(text: str) -> tuple[str, str, int] | None:
    """Sign, digits and exponent of a number, exactly and whatever its length; None for what is no finite number."""
    match = NUMBER_PATTERN.fullmatch(text)
    if match is None:
        return None
    sign, whole, fraction, exponent = match.groups()
    digits = (whole + fraction).lstrip("0")
    shortest = digits.rstrip("0")
    if not shortest:
        return ("", "0", 0)
    return ("-" if sign == "-" else "", shortest, int(exponent or 0) - len(fraction) + len(digits) - len(shortest))


Item = TypeVar("Item")


def multiset_difference(
    items: Iterable[Item], keys: Iterable[Hashable], other_keys: Iterable[Hashable]
) -> tuple[Item, ...]:
    """The items whose form is not among the others, each counted as often as it stands there."""
    left = Counter(other_keys)
    result = []
    for item, form in zip(items, keys, strict=True):
        if left[form] > 0:
            left[form] -= 1
        else:
            result.append(item)
    return tuple(result)


def format_assertion(fact: PropertyAssertion, *, max_depth: int = 3) -> str:
    """A fact in the manner of Turtle; what is nested deeper than so many levels is cut short."""
    return f"<{fact.property}> {_format_value(fact.value, max_depth)}"


def _format_value(value: FactValue, max_depth: int) -> str:
    if isinstance(value, IriRef):
        return value.iri if value.iri.startswith("_:") else f"<{value.iri}>"
    if isinstance(value, Literal):
        suffix = f"@{value.language}" if value.language else f"^^<{value.datatype}>" if value.datatype else ""
        return msgspec.json.encode(value.text).decode() + suffix
    if not value.facts:
        return "[]"
    inner = " ; ".join(format_assertion(fact, max_depth=max_depth - 1) for fact in value.facts) if max_depth else "…"
    return f"[ {inner} ]"
