"""Materials: surfaces in their order, which dialect 1 has no words for."""

from __future__ import annotations

from collections.abc import Sequence

from mindstage.knowledge.vocabulary import MATERIAL
from mindstage.knowledge.wording import words
from mindstage.knowledge.wording.nesting import sorted_facts
from mindstage.knowledge.wording.statements import SubjectReader, SubjectWriter
from mindstage.world import BlankNode, FactValue, Material, PropertyAssertion

__all__ = ["read_materials", "write_materials"]


def read_materials(reader: SubjectReader) -> tuple[Material, ...]:
    """The surfaces of a body; none, if they are not numbered from 0 or hold what no surface has."""
    found: dict[int, Material] = {}
    indexes = reader.indexes_of(MATERIAL)
    for index in indexes:
        told = _read_material(reader, reader.facts[index].value)
        if told is None or told[0] in found or told[0] >= len(indexes):
            reader.warn(MATERIAL, "a surface is not told as a whole, or its number is", "its materials stay facts")
            return ()
        found[told[0]] = told[1]
    reader.consume(*indexes)
    return tuple(found[number] for number in sorted(found))


def write_materials(writer: SubjectWriter, materials: Sequence[Material]) -> None:
    """Says the surfaces of a body."""
    for number, material in enumerate(materials):
        node = SubjectWriter(writer.subject)
        node.write(words.INDEX, number)
        node.write(words.MATERIAL_NAME, material.name)
        node.write(words.MATERIAL_PATH, material.path or None)
        node.write(words.COLOR, material.color)
        writer.add_fact(PropertyAssertion(MATERIAL, BlankNode(sorted_facts(node.all_facts()))))


def _read_material(reader: SubjectReader, value: FactValue) -> tuple[int, Material] | None:
    if not isinstance(value, BlankNode):
        return None
    node = SubjectReader(reader.subject, value.facts, reader.report, is_nested=True)
    number, name = node.read(words.INDEX), node.read(words.MATERIAL_NAME)
    path, color = node.read(words.MATERIAL_PATH), node.read(words.COLOR)
    if number is None or name is None or node.remaining():
        return None
    if color is None:
        return number, Material(name=name, path=path or "")
    red, green, blue = color
    return number, Material(name=name, path=path or "", color=(red, green, blue))
