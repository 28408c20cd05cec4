"""Turtle: the same statements for people to read, and for everything that XML has no way to write."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mindstage.knowledge.names import namespace_of
from mindstage.knowledge.vocabulary import TYPE
from mindstage.knowledge.wording.blocks import DocumentSection, SubjectBlock
from mindstage.knowledge.wording.prefixes import PrefixTable, is_plain_name
from mindstage.world import FactValue, Iri, IriRef, Literal, PropertyAssertion

__all__ = ["to_turtle"]

_ESCAPES = {code: f"\\u{code:04X}" for code in (*range(0x20), 0x7F)}
_ESCAPES |= {ord('"'): '\\"', ord("\\"): "\\\\", ord("\n"): "\\n", ord("\r"): "\\r", ord("\t"): "\\t"}


def to_turtle(sections: Sequence[DocumentSection], prefix_table: PrefixTable) -> str:
    """Statements as Turtle."""
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
