"""Tags of XML, read as leniently as can be without guessing, and what RDF/XML lets stand inside each element."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

__all__ = ["Attribute", "ContentModel", "OpenElement", "StartTag", "find_tag_end", "parse_start_tag"]

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
    issues: list[str] = field(default_factory=list)
    """What is wrong with it that had no effect."""
    is_self_closing: bool = False
    """Whether it is an end tag as well."""
    is_truncated: bool = False
    """Whether the text ends before the tag does."""
    end: int = 0
    """Where the text goes on."""


def parse_start_tag(text: str, position: int) -> StartTag:
    """The start tag that begins there."""
    named = _NAME.match(text, position + 1)
    tag = StartTag(named[0] if named else "", end=named.end() if named else position + 1)
    while True:
        if end := _END.match(text, tag.end):
            tag.is_self_closing, tag.end = bool(end[1]), end.end()
            return tag
        if attribute := _ATTRIBUTE.match(text, tag.end):
            _add_attribute(tag, attribute)
        elif junk := _JUNK.match(text, tag.end):
            tag.issues.append(f"{junk[0].strip()[:40]!r} is no attribute")
            tag.end = junk.end()
        else:
            rest = text[tag.end : tag.end + 1_000].lstrip()
            tag.is_truncated = not rest
            tag.issues.append("its > is missing")
            return tag


def _add_attribute(tag: StartTag, attribute: re.Match[str]) -> None:
    if not attribute["gap"]:
        tag.issues.append(f"there is no blank before {attribute['name']}")
    if attribute["bare"] is not None:
        tag.issues.append(f"the value of {attribute['name']} has no quotes")
    value = next(attribute[kind] for kind in ("double", "single", "bare") if attribute[kind] is not None)
    tag.attributes.append((attribute["name"], value))
    tag.end = attribute.end()


def find_tag_end(text: str, position: int) -> int | None:
    """Where the end tag that begins there ends; None where the text ends before."""
    close, opening = text.find(">", position), text.find("<", position + 1)
    if close < 0 or 0 <= opening < close:
        return opening if opening >= 0 else None
    return close + 1


class ContentModel(Enum):
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
class OpenElement:
    """An element that has begun."""

    name: str
    content_model: ContentModel
    declared_prefixes: Sequence[str] = ()
    """Prefixes."""
    text_positions: list[int] = field(default_factory=list)
    """Where its texts stand in what is written."""
    has_children: bool = False
    has_resource: bool = False

    @classmethod
    def child_of(cls, parent: OpenElement | None, name: str, *, is_root: bool) -> OpenElement:
        """An element that begins inside another one, or first of all."""
        if parent is None:
            return cls(name, ContentModel.NODES if is_root and name.endswith(":RDF") else ContentModel.PROPERTIES)
        inside = {
            ContentModel.NODES: ContentModel.PROPERTIES,
            ContentModel.PROPERTIES: ContentModel.VALUE,
            ContentModel.VALUE: ContentModel.PROPERTIES,
            ContentModel.LITERAL: ContentModel.LITERAL,
        }
        return cls(name, inside[parent.content_model])

    def apply_attributes(self, attributes: Sequence[Attribute]) -> None:
        """Heeds the attributes that change what it holds."""
        for name, value in attributes:
            if self.content_model is ContentModel.VALUE and name == "rdf:parseType":
                self.content_model = {"Resource": ContentModel.PROPERTIES, "Collection": ContentModel.NODES}.get(
                    value, ContentModel.LITERAL
                )
            elif name in {"rdf:resource", "rdf:nodeID"}:
                self.has_resource = True

    def allows_text(self) -> bool:
        """Whether a text has a place in it."""
        return self.content_model is ContentModel.LITERAL or (
            self.content_model is ContentModel.VALUE and not self.has_children and not self.has_resource
        )
