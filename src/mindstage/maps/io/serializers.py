"""Serialization of statements to RDF/XML, in KnowRob's layout, and to Turtle.

The RDF/XML has an entity for each namespace, a comment for each individual and one statement per line. Turtle can
represent everything, RDF/XML neither all characters nor all property names.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from mindstage.errors import MapWriteError
from mindstage.maps.dialects.serialize import DocumentSection, PrefixTable, SubjectBlock, is_plain_name
from mindstage.rdf.graphs import find_forbidden_character, namespace_of, remove_forbidden_characters
from mindstage.rdf.vocabulary import KNOWROB, OWL, RDF, RDFS, TYPE
from mindstage.scene import FactValue, Iri, IriRef, Literal, PropertyAssertion

__all__ = ["to_rdf_xml", "to_turtle"]


_ESCAPES = {code: f"\\u{code:04X}" for code in (*range(0x20), 0x7F)}
_ESCAPES |= {ord('"'): '\\"', ord("\\"): "\\\\", ord("\n"): "\\n", ord("\r"): "\\r", ord("\t"): "\\t"}


_REMEDY = "write Turtle (.ttl), which can represent it"
_RESERVED = frozenset(
    RDF + name
    for name in ("RDF", "Description", "ID", "about", "parseType", "resource", "nodeID", "datatype", "li", "aboutEach")
) | {RDF + "bagID", RDF + "aboutEachPrefix"}
_TEXT = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", "\r": "&#13;"})
_ATTRIBUTE = str.maketrans({"&": "&amp;", "<": "&lt;", '"': "&quot;"})


def to_turtle(sections: Sequence[DocumentSection], prefix_table: PrefixTable) -> str:
    """Serializes statements as Turtle."""
    return "".join(_TurtleSerializer(prefix_table).lines(sections))


class _TurtleSerializer:
    def __init__(self, prefix_table: PrefixTable) -> None:
        self.prefix_table = prefix_table
        self._iris: dict[Iri, str] = {}

    def lines(self, sections: Sequence[DocumentSection]) -> Iterator[str]:
        for namespace, prefix in self.prefix_table.prefixes.items():
            yield f"@prefix {prefix}: <{namespace}> .\n"
        for section in sections:
            if section.blocks:
                yield f"\n# {section.heading}\n"
            for block in section.blocks:
                yield from self._block(block)

    def _block(self, block: SubjectBlock) -> Iterator[str]:
        comment = " ".join(block.comment.split())
        yield f"\n# {comment}\n" if comment else "\n"
        yield self._name(block.subject)
        yield from self._facts(block.facts, "    ")
        yield " .\n"

    def _facts(self, facts: Sequence[PropertyAssertion], indent: str) -> Iterator[str]:
        separator = " "
        for fact in facts:
            property = "a" if fact.property == TYPE else self._name(fact.property)
            yield f"{separator}{property} "
            yield from self._value(fact.value, indent)
            separator = f" ;\n{indent}"

    def _value(self, value: FactValue, indent: str) -> Iterator[str]:
        if isinstance(value, IriRef):
            yield self._name(value.iri)
        elif isinstance(value, Literal):
            yield f'"{value.text.translate(_ESCAPES)}"'
            if value.language:
                yield f"@{value.language}"
            elif value.datatype:
                yield f"^^{self._name(value.datatype)}"
        else:
            yield "["
            yield from self._facts(value.facts, indent + "    ")
            yield " ]"

    def _name(self, iri: Iri) -> str:
        name = self._iris.get(iri)
        if name is None:
            if iri.startswith("_:"):
                name = "_:" + self.prefix_table.blank_node_labels[iri]
            else:
                namespace = namespace_of(iri)
                prefix, rest = self.prefix_table.prefixes.get(namespace), iri[len(namespace) :]
                name = f"{prefix}:{rest}" if prefix and is_plain_name(rest) else f"<{iri}>"
            self._iris[iri] = name
        return name


def to_rdf_xml(sections: Sequence[DocumentSection], prefix_table: PrefixTable) -> str:
    """Serializes statements as RDF/XML.

    Raises:
        MapWriteError: a property has no XML name, or a text contains a character that XML forbids.
    """
    return "".join(_RdfXmlSerializer(prefix_table).lines(sections))


class _RdfXmlSerializer:
    def __init__(self, prefix_table: PrefixTable) -> None:
        self.prefix_table = prefix_table
        self.entities = {
            namespace: prefix
            for namespace, prefix in prefix_table.prefixes.items()
            if not re.search("[%&']", namespace)
        }
        self._iris: dict[Iri, str] = {}
        self._elements: dict[Iri, str] = {}

    def lines(self, sections: Sequence[DocumentSection]) -> Iterator[str]:
        yield '<?xml version="1.0" encoding="utf-8"?>\n\n<!DOCTYPE rdf:RDF[\n'
        for namespace, prefix in self.entities.items():
            yield f'\t<!ENTITY {prefix} "{namespace}">\n'
        prefixes = self.prefix_table.prefixes.items()
        declared = (f'xmlns:{prefix}="{namespace.translate(_ATTRIBUTE)}"' for namespace, prefix in prefixes)
        yield "]>\n\n<rdf:RDF " + "\n\t ".join(declared) + ">\n"
        for section in sections:
            if section.blocks:
                yield f"\n\t<!-- {section.heading} -->\n"
            for block in section.blocks:
                yield from self._block(block)
        yield "</rdf:RDF>\n"

    def _block(self, block: SubjectBlock) -> Iterator[str]:
        if block.comment:
            yield f"\n\t<!-- {_xml_comment(block.comment)} -->\n"
        if block.subject.startswith("_:"):
            about = f' rdf:nodeID="{self.prefix_table.blank_node_labels[block.subject]}"'
        else:
            about = f' rdf:about="{self._iri(block.subject)}"'
        yield from self._node(block.subject, block.facts, about, "\t")

    def _node(self, subject: Iri, facts: Sequence[PropertyAssertion], about: str, indent: str) -> Iterator[str]:
        type_index = next((at for at, fact in enumerate(facts) if _is_typed_element(fact)), None)
        element = "rdf:Description" if type_index is None else self._element_of(facts[type_index])
        rest = [fact for at, fact in enumerate(facts) if at != type_index]
        if not rest:
            yield f"{indent}<{element}{about}/>\n"
            return
        yield f"{indent}<{element}{about}>\n"
        for fact in rest:
            yield from self._property(subject, fact, indent + "\t")
        yield f"{indent}</{element}>\n"

    def _property(self, subject: Iri, fact: PropertyAssertion, indent: str) -> Iterator[str]:
        element = self._elements.get(fact.property) or self._element(subject, fact.property)
        value = fact.value
        if isinstance(value, IriRef):
            if value.iri.startswith("_:"):
                yield f'{indent}<{element} rdf:nodeID="{self.prefix_table.blank_node_labels[value.iri]}"/>\n'
            else:
                yield f'{indent}<{element} rdf:resource="{self._iri(value.iri)}"/>\n'
        elif isinstance(value, Literal):
            if illegal := find_forbidden_character(value.text):
                cause = f"the text of {fact.property} contains the character U+{ord(illegal[0]):04X}, which XML forbids"
                raise MapWriteError(subject, cause=cause, remedy=_REMEDY)
            attribute = self._literal_attribute(fact.property, value)
            yield f"{indent}<{element}{attribute}>{value.text.translate(_TEXT)}</{element}>\n"
        else:
            yield f"{indent}<{element}>\n"
            yield from self._node(subject, value.facts, "", indent + "\t")
            yield f"{indent}</{element}>\n"

    def _literal_attribute(self, property: Iri, literal: Literal) -> str:
        if literal.language:
            return f' xml:lang="{literal.language}"'
        if literal.datatype:
            return f' rdf:datatype="{self._iri(literal.datatype)}"'
        # KnowRob's files give the datatype of their strings explicitly; it is redundant elsewhere.
        return ' rdf:datatype="&xsd;string"' if property.startswith(KNOWROB) else ""

    def _element_of(self, fact: PropertyAssertion) -> str:
        assert isinstance(fact.value, IriRef)
        iri = fact.value.iri
        namespace = namespace_of(iri)
        return f"{self.prefix_table.prefixes[namespace]}:{iri[len(namespace) :]}"

    def _element(self, subject: Iri, property: Iri) -> str:
        parts = self.prefix_table.split(property)
        if parts is None or property in _RESERVED:
            raise MapWriteError(subject, cause=f"the property <{property}> has no name in XML", remedy=_REMEDY)
        element = self._elements[property] = f"{parts[0]}:{parts[1]}"
        return element

    def _iri(self, iri: Iri) -> str:
        short = self._iris.get(iri)
        if short is None:
            namespace = namespace_of(iri)
            prefix = self.entities.get(namespace)
            rest = iri.translate(_ATTRIBUTE) if prefix is None else iri[len(namespace) :].translate(_ATTRIBUTE)
            short = self._iris[iri] = rest if prefix is None else f"&{prefix};{rest}"
        return short


def _is_typed_element(fact: PropertyAssertion) -> bool:
    """Whether the statement gives a class of OWL or RDFS, which is written as the element's name."""
    return (
        fact.property == TYPE
        and isinstance(fact.value, IriRef)
        and re.fullmatch(rf"({re.escape(OWL)}|{re.escape(RDFS)})[A-Za-z]+", fact.value.iri) is not None
    )


def _xml_comment(text: str) -> str:
    return re.sub("-(?=-)", "- ", remove_forbidden_characters(text)).rstrip("-")
