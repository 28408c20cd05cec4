"""Repair of RDF/XML that is not well-formed, as SWI-Prolog would read it; every change is reported with its line.

Only files that the RDF parser rejects are repaired. A truncated file is not: nothing is guessed about its end. Tags are
parsed leniently, and the content model of RDF/XML decides where text and elements are allowed.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from html import escape
from html.entities import name2codepoint
from typing import NamedTuple

from mindstage.rdf.vocabulary import KNOWROB, OWL, RDF, RDFS, XSD

__all__ = [
    "Attribute",
    "ContentModel",
    "OpenElement",
    "StartTag",
    "XmlRepair",
    "XmlRepairError",
    "find_tag_end",
    "parse_start_tag",
    "repair_xml",
]


Attribute = tuple[str, str]
"""Name and value; the value is not unescaped."""

_NAME = re.compile(r"[^\W\d][\w:.-]*")
_ATTRIBUTE = re.compile(
    r"""(?P<gap>\s*)(?P<name>[^\W\d][\w:.-]*)\s*=\s*(?:"(?P<double>[^"]*)"|'(?P<single>[^']*)'|(?P<bare>[^\s"'<>/]+(?:/(?!>)[^\s"'<>/]*)*))"""
)
_END = re.compile(r"\s*(/?)>")
_JUNK = re.compile(r"\s*[^\s<>]+")


WELL_KNOWN_PREFIXES = {"rdf": RDF, "rdfs": RDFS, "owl": OWL, "xsd": XSD, "knowrob": KNOWROB}
"""Namespaces of prefixes and entities that are used without a declaration."""
_XML_ENTITIES = {"amp", "lt", "gt", "quot", "apos"}
_XML_NAMESPACE = "xml"
_RDF_ATTRIBUTES = {"about", "ID", "resource", "datatype", "nodeID", "parseType"}
_AMPERSAND = re.compile(r"&(#\d+;|#x[0-9a-fA-F]+;|([^\W\d][\w.-]*)([;:]))?")
_ENTITY = re.compile(
    r"""<!ENTITY\s*(?P<name>[^\W\d][\w.-]*)\s*(?:"(?P<double>[^"]*)"|'(?P<single>[^']*)'|(?P<bare>[^\s"'<>]+))\s*(?P<end>>?)""",
    re.IGNORECASE,
)
_STRICT_ENTITY = re.compile(r"""<!ENTITY\s+\S+\s+(?:"[^"]*"|'[^']*')\s*>""")
_DOCTYPE_END = re.compile(r"\]\s*>")
_NOT_IN_IRIS = re.compile(r"[\x00-\x20<>\"{}|\\^`]|%(?![0-9a-fA-F]{2})")
_LANGUAGE = re.compile(r"[A-Za-z]{1,8}(-[A-Za-z0-9]{1,8})*\Z")
_XML_NAME = re.compile(r"[^\W\d][\w.-]*\Z")


@dataclass(slots=True)
class StartTag:
    """A start tag, parsed leniently."""

    name: str
    attributes: list[Attribute] = field(default_factory=list)
    issues: list[str] = field(default_factory=list)
    """Errors in the tag that were ignored."""
    is_self_closing: bool = False
    """Whether it ends with `/>`."""
    is_truncated: bool = False
    """Whether the text ends within the tag."""
    end: int = 0
    """Position after the tag."""


def parse_start_tag(text: str, position: int) -> StartTag:
    """Parses the start tag at a position."""
    named = _NAME.match(text, position + 1)
    tag = StartTag(named[0] if named else "", end=named.end() if named else position + 1)
    while True:
        if end := _END.match(text, tag.end):
            tag.is_self_closing, tag.end = bool(end[1]), end.end()
            return tag
        if attribute := _ATTRIBUTE.match(text, tag.end):
            _add_attribute(tag, attribute)
        elif junk := _JUNK.match(text, tag.end):
            tag.issues.append(f"{junk[0].strip()[:40]!r} is not an attribute")
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
    """Returns the position after the end tag at a position, or None if the text ends within it."""
    close, opening = text.find(">", position), text.find("<", position + 1)
    if close < 0 or 0 <= opening < close:
        return opening if opening >= 0 else None
    return close + 1


class ContentModel(Enum):
    """The content that RDF/XML allows inside an element."""

    NODES = auto()
    """Nodes: in rdf:RDF, and in a collection."""
    PROPERTIES = auto()
    """Properties of a node."""
    VALUE = auto()
    """A node or a text: in a property."""
    LITERAL = auto()
    """Anything: in an XML literal."""


@dataclass(slots=True)
class OpenElement:
    """An element whose end tag has not been read."""

    name: str
    content_model: ContentModel
    declared_prefixes: Sequence[str] = ()
    """Prefixes that are declared in its start tag."""
    text_positions: list[int] = field(default_factory=list)
    """Indices of its texts in the output."""
    has_children: bool = False
    has_resource: bool = False

    @classmethod
    def child_of(cls, parent: OpenElement | None, name: str, *, is_root: bool) -> OpenElement:
        """Creates an element inside another one, or the root element."""
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
        """Updates the content model by the attributes of the start tag."""
        for name, value in attributes:
            if self.content_model is ContentModel.VALUE and name == "rdf:parseType":
                self.content_model = {"Resource": ContentModel.PROPERTIES, "Collection": ContentModel.NODES}.get(
                    value, ContentModel.LITERAL
                )
            elif name in {"rdf:resource", "rdf:nodeID"}:
                self.has_resource = True

    def allows_text(self) -> bool:
        """Whether text is allowed at this point."""
        return self.content_model is ContentModel.LITERAL or (
            self.content_model is ContentModel.VALUE and not self.has_children and not self.has_resource
        )


class XmlRepair(NamedTuple):
    """A change that was made to a file."""

    line: int
    problem: str
    action: str


class XmlRepairError(Exception):
    """The file cannot be repaired."""

    def __init__(self, line: int, cause: str, *, is_truncated: bool = False) -> None:
        self.line = line
        self.cause = f"it is truncated: {cause}" if is_truncated else cause
        self.is_truncated = is_truncated
        super().__init__(cause)


def repair_xml(text: str) -> tuple[str, list[XmlRepair]]:
    """Makes a text well-formed XML, keeping its line breaks, and returns it with the changes.

    Raises:
        XmlRepairError: it is truncated, or not a single document.
    """
    repairer = _XmlRepairer(text)
    repairer.run()
    return "".join(repairer.output), sorted(repairer.repairs)


class _XmlRepairer:
    """A single pass over the text; `output` grows as `position` advances."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.position = 0
        self.line = 1
        self._counted_position = 0
        self.output: list[str] = []
        self.repairs: list[XmlRepair] = []
        self.open_elements: list[OpenElement] = []
        self.entities: dict[str, str] = {}
        self.namespaces: dict[str, str] = {}
        self.declared_prefixes: Counter[str] = Counter([_XML_NAMESPACE])
        self.ids: set[str] = set()
        self.root_end: int | None = None
        """Index in `output` of the end of the root's start tag, where missing prefixes are declared."""
        self.undeclared_prefixes: dict[str, int] = {}
        """Prefixes without a declaration, and the lines where they are first used."""

    def run(self) -> None:
        while self.position < len(self.text):
            self._step()
        if self.root_end is None:
            raise XmlRepairError(self._line(), "it is not XML")
        if self.open_elements:
            raise XmlRepairError(self._line(), "the file ends before its root element does", is_truncated=True)
        for prefix, line in self.undeclared_prefixes.items():
            namespace = self._namespace(prefix)
            self.output[self.root_end] = (
                f' xmlns:{prefix}="{escape(namespace, quote=False)}"{self.output[self.root_end]}'
            )
            self.repairs.append(XmlRepair(line, f"the prefix {prefix!r} is not declared", f"it is read as {namespace}"))

    def _step(self) -> None:
        text, at = self.text, self.position
        opening = text.find("<", at)
        if opening != at:
            self._text(opening if opening >= 0 else len(text))
        elif text.startswith("<!--", at):
            self._copy_until("-->")
        elif text.startswith("<![CDATA[", at):
            self._cdata()
        elif text.startswith("<?", at):
            self._instruction()
        elif text[at : at + 9].upper() == "<!DOCTYPE" and self.root_end is None:
            self._doctype()
        elif text.startswith("</", at):
            self._end_tag()
        elif text[at + 1 : at + 2].isalpha() or text.startswith("<_", at):
            self._start_tag()
        else:
            self._warn("there is a < in a text", "it is read as &lt;")
            self._text(at + 1, "&lt;")

    # -- between tags --------------------------------------------------------------------------------------------------

    def _copy_until(self, end: str) -> None:
        found = self.text.find(end, self.position)
        if found < 0:
            raise XmlRepairError(
                self._line(), f"a {self.text[self.position : self.position + 4]} has no {end}", is_truncated=True
            )
        self._emit(self.text[self.position : found + len(end)], to=found + len(end))

    def _cdata(self) -> None:
        if self.open_elements:
            self._copy_until("]]>")
        else:
            raise XmlRepairError(self._line(), "it is not well-formed XML: there is text outside of its root element")

    def _instruction(self) -> None:
        declares = re.match(r"<\?xml\s", self.text[self.position : self.position + 6])
        if declares and self.output and "".join(self.output).strip():
            self._warn("there is an XML declaration inside the document", "it is ignored")
            self._skip_until("?>")
        elif declares and self.output:
            self._skip_until("?>")
        else:
            self._copy_until("?>")

    def _skip_until(self, end: str) -> None:
        found = self.text.find(end, self.position)
        stop = len(self.text) if found < 0 else found + len(end)
        self._emit("\n" * self.text.count("\n", self.position, stop), to=stop)

    def _text(self, stop: int, text: str | None = None) -> None:
        """Reads the text between two tags, which is dropped where RDF/XML does not allow it."""
        text = self.text[self.position : stop] if text is None else text
        blank = not text.strip()
        if not self.open_elements:
            if not blank:
                where = "after its root element" if self.root_end is not None else "before its root element"
                raise XmlRepairError(self._line(), f"it is not well-formed XML: there is text {where}")
        elif not blank and not self.open_elements[-1].allows_text():
            self._warn(
                f"the text {_shortened(text)} is not allowed in <{self.open_elements[-1].name}>", "it is ignored"
            )
            text = "\n" * text.count("\n")
        elif not blank:
            self.open_elements[-1].text_positions.append(len(self.output))
            text = self._resolved(text)
        self._emit(text, to=stop)

    # -- DOCTYPE -------------------------------------------------------------------------------------------------------

    def _doctype(self) -> None:
        bracket, close = self.text.find("[", self.position), self.text.find(">", self.position)
        if close < 0 or (0 <= bracket < close and not _DOCTYPE_END.search(self.text, bracket)):
            raise XmlRepairError(self._line(), "it is not well-formed XML: its DOCTYPE has no end")
        if not 0 <= bracket < close:
            self._emit(self.text[self.position : close + 1], to=close + 1)
            return
        end = _DOCTYPE_END.search(self.text, bracket)
        assert end is not None
        subset = self.text[bracket : end.start()]
        start = self._line() + self.text.count("\n", self.position, bracket)
        fixed = _ENTITY.sub(lambda entity: self._entity(entity, start), subset)
        self._emit(self.text[self.position : bracket] + fixed + "]>", to=end.end())

    def _entity(self, entity: re.Match[str], start: int) -> str:
        if entity["bare"] and entity["bare"].upper() in {"SYSTEM", "PUBLIC"}:
            return entity[0]  # external entities are rejected by `expand_safe_entities`
        value = next(entity[kind] for kind in ("double", "single", "bare") if entity[kind] is not None)
        name, breaks = entity["name"], "\n" * entity[0].count("\n")
        line = start + entity.string.count("\n", 0, entity.start())
        if name in self.entities:
            if self.entities[name] != value:
                other = f"the first counts; the other, {value!r}, is ignored"
                self.repairs.append(XmlRepair(line, f"the entity {name!r} is declared twice", other))
            return breaks
        self.entities[name] = value
        if _STRICT_ENTITY.fullmatch(entity[0].rstrip()):
            return entity[0]
        problem = f"the declaration of the entity {name!r} is not well-formed"
        self.repairs.append(XmlRepair(line, problem, "it is read nevertheless"))
        return f'<!ENTITY {name} "{value.replace(chr(34), "&#34;")}">{breaks}'

    # -- tags ----------------------------------------------------------------------------------------------------------

    def _end_tag(self) -> None:
        stop = find_tag_end(self.text, self.position)
        if stop is None:
            raise XmlRepairError(self._line(), "the file ends within a tag", is_truncated=True)
        if self.text[stop - 1] != ">":
            self._warn("an end tag has no >", "it is read nevertheless")
        name = self.text[self.position + 2 : stop].rstrip(">").strip()
        if not any(element.name == name for element in self.open_elements):
            self._warn(f"</{name}> has no start tag", "it is ignored")
            self._emit("", to=stop)
            return
        ends = []
        while self.open_elements[-1].name != name:
            ends.append(f"</{self.open_elements[-1].name}>")
            self._warn(f"<{self.open_elements[-1].name}> has no end tag", f"it ends before </{name}>")
            self._close()
        self._close()
        self._emit("".join(ends) + f"</{name}>", to=stop)

    def _start_tag(self) -> None:
        if self.root_end is not None and not self.open_elements:
            raise XmlRepairError(self._line(), "it is not well-formed XML: junk after document element")
        tag = parse_start_tag(self.text, self.position)
        if tag.is_truncated:
            raise XmlRepairError(self._line(), "the file ends within a tag", is_truncated=True)
        for problem in tag.issues:
            self._warn(f"<{tag.name}>: {problem}", "it is read nevertheless")
        self._close_full_property(tag.name)
        parent = self.open_elements[-1] if self.open_elements else None
        element = OpenElement.child_of(parent, tag.name, is_root=self.root_end is None)
        if parent is not None and element.content_model is not ContentModel.LITERAL:
            self._drop_texts(parent)
        attributes = list(self._attributes(tag.name, element, tag.attributes))
        self._declare(element, tag.name, attributes)
        element.apply_attributes(attributes)
        written = "".join(f' {name}="{value}"' for name, value in attributes)
        self.output.append(f"<{tag.name}{written}")
        if self.root_end is None:
            self.root_end = len(self.output)
        breaks = "\n" * (self.text.count("\n", self.position, tag.end) - written.count("\n"))
        self._emit(f"{breaks}/>" if tag.is_self_closing else f"{breaks}>", to=tag.end)
        self.open_elements.append(element)
        if tag.is_self_closing:
            self._close()

    def _close_full_property(self, name: str) -> None:
        """Ends a property that has its value: the next element is a further value, or the next property."""
        parent = self.open_elements[-1] if self.open_elements else None
        if (
            parent is None
            or parent.content_model is not ContentModel.VALUE
            or not (parent.has_children or parent.has_resource)
        ):
            return
        self.output.append(f"</{parent.name}>")
        if parent.has_children and name.rpartition(":")[2][:1].isupper():
            self._warn(
                f"<{parent.name}> contains several nodes", f"<{name}> is read as if in a <{parent.name}> of its own"
            )
            self.output.append(f"<{parent.name}>")
        else:
            self._warn(f"<{parent.name}> has no end tag", f"it ends before <{name}>")
            self._close()

    def _drop_texts(self, parent: OpenElement) -> None:
        """Drops the texts of an element that contains other elements."""
        parent.has_children = True
        for index in parent.text_positions:
            self._warn(
                f"the text {_shortened(self.output[index])} is next to an element in <{parent.name}>", "it is ignored"
            )
            self.output[index] = "\n" * self.output[index].count("\n")
        parent.text_positions.clear()

    def _close(self) -> None:
        for prefix in self.open_elements.pop().declared_prefixes:
            self.declared_prefixes[prefix] -= 1

    def _declare(self, element: OpenElement, name: str, attributes: list[Attribute]) -> None:
        element.declared_prefixes = [key[6:] for key, _ in attributes if key.startswith("xmlns:")]
        self.declared_prefixes.update(element.declared_prefixes)
        for key, value in attributes:
            if key.startswith("xmlns:"):
                self.namespaces.setdefault(key[6:], self._unescape(value))
        for used in (name, *(key for key, _ in attributes)):
            prefix, colon, _ = used.partition(":")
            if colon and prefix != "xmlns" and self.declared_prefixes[prefix] <= 0:
                self.undeclared_prefixes.setdefault(prefix, self._line())

    def _attributes(self, tag: str, element: OpenElement, attributes: list[Attribute]) -> Iterator[Attribute]:
        names = {name for name, _ in attributes}
        seen: dict[str, str] = {}
        for name, value in attributes:
            key = name
            if name in _RDF_ATTRIBUTES and element.content_model is not ContentModel.LITERAL:
                key = f"rdf:{name}"
                self._warn(f"<{tag}> has the attribute {name!r} without a prefix", f"it is read as {key}")
            if key in seen:
                other = "" if seen[key] == value else f"; the other, {value!r}, is ignored"
                self._warn(f"<{tag}> has the attribute {key} twice", f"the first counts{other}")
                continue
            seen[key] = value
            if key == "rdf:ID" and element.content_model is ContentModel.PROPERTIES:
                if {"rdf:about", "about"} & names:
                    self._warn(f"<{tag}> has both rdf:about and rdf:ID", "rdf:about counts")
                    continue
                key, value = self._identifier(tag, value)
            if key == "xml:lang" and not _LANGUAGE.match(value):
                value = value.replace("_", "-")
                if not _LANGUAGE.match(value):
                    self._warn(f"<{tag}> has the invalid language {value!r}", "it is ignored")
                    continue
                self._warn(f"<{tag}> has a language with an underscore", f"it is read as {value}")
            if key in {"rdf:about", "rdf:resource", "rdf:datatype"}:
                value = self._iri(tag, key, value)
            yield key, self._resolved(value).replace("<", "&lt;").replace('"', "&quot;")

    def _identifier(self, tag: str, value: str) -> Attribute:
        if _XML_NAME.match(value) and value not in self.ids:
            self.ids.add(value)
            return "rdf:ID", value
        reason = "is already used" if value in self.ids else "is not an XML name"
        self._warn(f"<{tag}> has the rdf:ID {value!r}, which {reason}", f'it is read as rdf:about="#{value}"')
        return "rdf:about", self._iri(tag, "rdf:ID", f"#{value}")

    def _iri(self, tag: str, key: str, value: str) -> str:
        fixed = _NOT_IN_IRIS.sub(lambda found: "".join(f"%{byte:02X}" for byte in found[0].encode()), value)
        if fixed != value:
            self._warn(
                f"<{tag}> has the {key} {value!r}, with characters that IRIs exclude", f"it is read as {fixed!r}"
            )
        return fixed

    # -- entities ------------------------------------------------------------------------------------------------------

    def _resolved(self, text: str) -> str:
        return _AMPERSAND.sub(self._reference, text) if "&" in text else text

    def _reference(self, reference: re.Match[str]) -> str:
        name = reference[2]
        if not reference[1] or reference[3] == ":":
            return self._escape_ampersand(reference)
        if name is None or name in _XML_ENTITIES or name in self.entities:
            return reference[0]
        meaning = self.namespaces.get(name) or WELL_KNOWN_PREFIXES.get(name)
        if meaning is None and name in name2codepoint:
            meaning = chr(name2codepoint[name])
        if meaning is None:
            self._warn(f"the entity {name!r} is not declared", "it is read as text")
            return f"&amp;{name};"
        self._warn(f"the entity {name!r} is not declared", f"it is read as {meaning}")
        return escape(meaning, quote=False)

    def _escape_ampersand(self, ampersand: re.Match[str]) -> str:
        name = ampersand[2]
        if name in self.entities:
            self._warn(f"the entity {name!r} is used with a colon", "it is read as if with a semicolon")
            return f"&{name};"
        self._warn("there is an unescaped &", "it is read as &amp;")
        return f"&amp;{ampersand[0][1:]}"

    def _namespace(self, prefix: str) -> str:
        return self.entities.get(prefix) or WELL_KNOWN_PREFIXES.get(prefix) or f"{prefix}:"

    def _unescape(self, value: str) -> str:
        return _AMPERSAND.sub(lambda found: self.entities.get(found[2] or "", found[0]), value)

    # -- output --------------------------------------------------------------------------------------------------------

    def _emit(self, text: str, *, to: int) -> None:
        self.output.append(text)
        self.position = to

    def _line(self) -> int:
        self.line += self.text.count("\n", self._counted_position, self.position)
        self._counted_position = self.position
        return self.line

    def _warn(self, problem: str, action: str) -> None:
        self.repairs.append(XmlRepair(self._line(), problem, action))


def _shortened(text: str) -> str:
    text = " ".join(text.split())
    return repr(text if len(text) <= 40 else f"{text[:40]}…")
