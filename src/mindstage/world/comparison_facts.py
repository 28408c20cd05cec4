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

from mindstage.world.facts import Anonymous, Fact, FactValue, Literal, Reference
from mindstage.world.values import Tag

__all__ = ["Forms", "Statement", "missing"]

XSD = "http://www.w3.org/2001/XMLSchema#"
NUMERIC = frozenset(
    XSD + name
    for name in (
        *("float", "double", "decimal", "integer", "nonPositiveInteger", "negativeInteger", "nonNegativeInteger"),
        *("positiveInteger", "long", "int", "short", "byte"),
        *("unsignedLong", "unsignedInt", "unsignedShort", "unsignedByte"),
    )
)
NUMBER = re.compile(r"[ \t\n\r]*([+-]?)(?=\.?[0-9])([0-9]*)\.?([0-9]*)(?:[eE]([+-]?[0-9]{1,9}))?[ \t\n\r]*")


class Statement(msgspec.Struct, frozen=True):
    """A fact or a tag, and what it is about; `str` gives one readable line of it."""

    id: str
    """Of a body, a constraint, a light; the IRI of a resource or of the world itself."""
    said: Fact | Tag

    def __str__(self) -> str:
        if isinstance(self.said, Tag):
            return f"{self.said.type};{self.said.key},{self.said.value}"
        return fact_text(self.said)


class Forms:
    """Numbers statements: two have the same number when they say the same. One table serves both sides.

    What is nested is numbered from the inside out and without recursion, since a list of a thousand items in RDF is
    a thousand levels deep.
    """

    def __init__(self) -> None:
        self._numbers: dict[Hashable, int] = {}

    def number(self, fact: Fact, names: Mapping[str, str]) -> int:
        """The number of a fact once the names in it are replaced by those that they stand for."""
        value = fact.value
        form = self._anonymous(value, names) if isinstance(value, Anonymous) else _leaf(value, names)
        return self._number((fact.property, form))

    def _number(self, form: Hashable) -> int:
        return self._numbers.setdefault(form, len(self._numbers))

    def _anonymous(self, root: Anonymous, names: Mapping[str, str]) -> int:
        done: dict[int, int] = {}
        waiting = [root]
        while waiting:
            inner = [fact.value for fact in waiting[-1].facts if isinstance(fact.value, Anonymous)]
            if undone := [value for value in inner if id(value) not in done]:
                waiting.extend(undone)
                continue
            node = waiting.pop()
            forms = (
                (fact.property, done[id(fact.value)] if isinstance(fact.value, Anonymous) else _leaf(fact.value, names))
                for fact in node.facts
            )
            done[id(node)] = self._number((None, *sorted(map(self._number, forms))))
        return done[id(root)]


def _leaf(value: Reference | Literal, names: Mapping[str, str]) -> Hashable:
    if isinstance(value, Reference):
        return ("iri", names.get(value.iri, value.iri))
    number = _decimal(value.text) if value.datatype in NUMERIC else None
    datatype = None if value.datatype == XSD + "string" else value.datatype
    return ("literal", number or value.text, datatype, value.language and value.language.lower())


def _decimal(text: str) -> tuple[str, str, int] | None:
    """Sign, digits and exponent of a number, exactly and whatever its length; None for what is no finite number."""
    match = NUMBER.fullmatch(text)
    if match is None:
        return None
    sign, whole, fraction, exponent = match.groups()
    digits = (whole + fraction).lstrip("0")
    shortest = digits.rstrip("0")
    if not shortest:
        return ("", "0", 0)
    return ("-" if sign == "-" else "", shortest, int(exponent or 0) - len(fraction) + len(digits) - len(shortest))


Item = TypeVar("Item")


def missing(items: Iterable[Item], forms: Iterable[Hashable], others: Iterable[Hashable]) -> tuple[Item, ...]:
    """The items whose form is not among the others, each counted as often as it stands there."""
    left = Counter(others)
    result = []
    for item, form in zip(items, forms, strict=True):
        if left[form] > 0:
            left[form] -= 1
        else:
            result.append(item)
    return tuple(result)


def fact_text(fact: Fact, *, levels: int = 3) -> str:
    """A fact in the manner of Turtle; what is nested deeper than so many levels is cut short."""
    return f"<{fact.property}> {_value_text(fact.value, levels)}"


def _value_text(value: FactValue, levels: int) -> str:
    if isinstance(value, Reference):
        return value.iri if value.iri.startswith("_:") else f"<{value.iri}>"
    if isinstance(value, Literal):
        suffix = f"@{value.language}" if value.language else f"^^<{value.datatype}>" if value.datatype else ""
        return msgspec.json.encode(value.text).decode() + suffix
    if not value.facts:
        return "[]"
    inner = " ; ".join(fact_text(fact, levels=levels - 1) for fact in value.facts) if levels else "…"
    return f"[ {inner} ]"
