"""Tags of XML, read as leniently as can be without guessing, and what RDF/XML lets stand inside each element."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

__all__ = ["Attribute", "Element", "Holds", "StartTag", "ending_of", "start_tag"]

Attribute = tuple[str, str]
"""Name and value, the value as it stands in the file."""

_NAME = re.compile(r"[^\W\d][\w:.-]*")
_ATTRIBUTE = re.compile(
    r"""(?P<gap>\s*)(?P<name>[^\W\d][\w:.-]*)\s*=\s*(?:"(?P<double>[^"]*)"|'(?P<single>[^']*)'|(?P<bare>[^\s"'<>/]+(?:/(?!>)[^\s"'<>/]*)*))"""
)
_END = re.compile(r"\s*(/?)>")
_JUNK = re.compile(r"\s*[^\s<>]+")


@dataclass(slots=True)
class StartTag:
    """A start tag, or what can be made of it."""

    name: str
    attributes: list[Attribute] = field(default_factory=list)
    oddities: list[str] = field(default_factory=list)
    """What is wrong with it that had no effect."""
    empty: bool = False
    """Whether it is an end tag as well."""
    cut: bool = False
    """Whether the text ends before the tag does."""
    stop: int = 0
    """Where the text goes on."""


def start_tag(text: str, at: int) -> StartTag:
    """The start tag that begins there."""
    named = _NAME.match(text, at + 1)
    tag = StartTag(named[0] if named else "", stop=named.end() if named else at + 1)
    while True:
        if end := _END.match(text, tag.stop):
            tag.empty, tag.stop = bool(end[1]), end.end()
            return tag
        if attribute := _ATTRIBUTE.match(text, tag.stop):
            _take(tag, attribute)
        elif junk := _JUNK.match(text, tag.stop):
            tag.oddities.append(f"{junk[0].strip()[:40]!r} is no attribute")
            tag.stop = junk.end()
        else:
            rest = text[tag.stop : tag.stop + 1_000].lstrip()
            tag.cut = not rest
            tag.oddities.append("its > is missing")
            return tag


def _take(tag: StartTag, attribute: re.Match[str]) -> None:
    if not attribute["gap"]:
        tag.oddities.append(f"there is no blank before {attribute['name']}")
    if attribute["bare"] is not None:
        tag.oddities.append(f"the value of {attribute['name']} has no quotes")
    value = next(attribute[kind] for kind in ("double", "single", "bare") if attribute[kind] is not None)
    tag.attributes.append((attribute["name"], value))
    tag.stop = attribute.end()


def ending_of(text: str, at: int) -> int | None:
    """Where the end tag that begins there ends; None where the text ends before."""
    close, opening = text.find(">", at), text.find("<", at + 1)
    if close < 0 or 0 <= opening < close:
        return opening if opening >= 0 else None
    return close + 1


class Holds(Enum):
    """What RDF/XML lets stand inside an element."""

    NODES = auto()
    """Things: in rdf:RDF, and in a collection."""
    PROPERTIES = auto()
    """Statements about a thing."""
    VALUE = auto()
    """A thing or a text: in a statement."""
    LITERAL = auto()
    """Anything: it is a text of XML."""


@dataclass(slots=True)
class Element:
    """An element that has begun."""

    name: str
    kind: Holds
    declares: Sequence[str] = ()
    """Prefixes."""
    texts: list[int] = field(default_factory=list)
    """Where its texts stand in what is written."""
    has_children: bool = False
    has_resource: bool = False

    @classmethod
    def below(cls, above: Element | None, name: str, *, is_root: bool) -> Element:
        """An element that begins inside another one, or first of all."""
        if above is None:
            return cls(name, Holds.NODES if is_root and name.endswith(":RDF") else Holds.PROPERTIES)
        inside = {
            Holds.NODES: Holds.PROPERTIES,
            Holds.PROPERTIES: Holds.VALUE,
            Holds.VALUE: Holds.PROPERTIES,
            Holds.LITERAL: Holds.LITERAL,
        }
        return cls(name, inside[above.kind])

    def learn(self, attributes: Sequence[Attribute]) -> None:
        """Heeds the attributes that change what it holds."""
        for name, value in attributes:
            if self.kind is Holds.VALUE and name == "rdf:parseType":
                self.kind = {"Resource": Holds.PROPERTIES, "Collection": Holds.NODES}.get(value, Holds.LITERAL)
            elif name in {"rdf:resource", "rdf:nodeID"}:
                self.has_resource = True

    def takes_text(self) -> bool:
        """Whether a text has a place in it."""
        return self.kind is Holds.LITERAL or (
            self.kind is Holds.VALUE and not self.has_children and not self.has_resource
        )
