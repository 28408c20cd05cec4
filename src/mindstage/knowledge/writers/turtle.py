"""Turtle: the same statements for people to read, and for everything that XML has no way to write."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mindstage.knowledge.names import namespace_of
from mindstage.knowledge.vocabulary import TYPE
from mindstage.knowledge.wording.blocks import Block, Section
from mindstage.knowledge.wording.prefixes import Names, plain_name
from mindstage.world import Fact, FactValue, Iri, Literal, Reference

__all__ = ["turtle"]

_ESCAPES = {code: f"\\u{code:04X}" for code in (*range(0x20), 0x7F)}
_ESCAPES |= {ord('"'): '\\"', ord("\\"): "\\\\", ord("\n"): "\\n", ord("\r"): "\\r", ord("\t"): "\\t"}


def turtle(sections: Sequence[Section], names: Names) -> str:
    """Statements as Turtle."""
    return "".join(_Document(names).lines(sections))


class _Document:
    def __init__(self, names: Names) -> None:
        self.names = names
        self._iris: dict[Iri, str] = {}

    def lines(self, sections: Sequence[Section]) -> Iterator[str]:
        for namespace, prefix in self.names.prefixes.items():
            yield f"@prefix {prefix}: <{namespace}> .\n"
        for section in sections:
            if section.blocks:
                yield f"\n# {section.heading}\n"
            for block in section.blocks:
                yield from self._block(block)

    def _block(self, block: Block) -> Iterator[str]:
        comment = " ".join(block.comment.split())
        yield f"\n# {comment}\n" if comment else "\n"
        yield self._name(block.subject)
        yield from self._facts(block.facts, "    ")
        yield " .\n"

    def _facts(self, facts: Sequence[Fact], indent: str) -> Iterator[str]:
        separator = " "
        for fact in facts:
            property = "a" if fact.property == TYPE else self._name(fact.property)
            yield f"{separator}{property} "
            yield from self._value(fact.value, indent)
            separator = f" ;\n{indent}"

    def _value(self, value: FactValue, indent: str) -> Iterator[str]:
        if isinstance(value, Reference):
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
                name = "_:" + self.names.labels[iri]
            else:
                namespace = namespace_of(iri)
                prefix, rest = self.names.prefixes.get(namespace), iri[len(namespace) :]
                name = f"{prefix}:{rest}" if prefix and plain_name(rest) else f"<{iri}>"
            self._iris[iri] = name
        return name
