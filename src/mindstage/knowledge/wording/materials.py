"""Materials: surfaces in their order, which dialect 1 has no words for."""

from __future__ import annotations

from collections.abc import Sequence

from mindstage.knowledge.vocabulary import MATERIAL
from mindstage.knowledge.wording import words
from mindstage.knowledge.wording.nesting import sorted_facts
from mindstage.knowledge.wording.statements import Heard, Said
from mindstage.world import Anonymous, Fact, FactValue, Material

__all__ = ["materials_of", "say_materials"]


def materials_of(heard: Heard) -> tuple[Material, ...]:
    """The surfaces of a body; none, if they are not numbered from 0 or hold what no surface has."""
    found: dict[int, Material] = {}
    indexes = heard.at(MATERIAL)
    for index in indexes:
        told = _material(heard, heard.facts[index].value)
        if told is None or told[0] in found or told[0] >= len(indexes):
            heard.warn(MATERIAL, "a surface is not told as a whole, or its number is", "its materials stay facts")
            return ()
        found[told[0]] = told[1]
    heard.take(*indexes)
    return tuple(found[number] for number in sorted(found))


def say_materials(said: Said, materials: Sequence[Material]) -> None:
    """Says the surfaces of a body."""
    for number, material in enumerate(materials):
        node = Said(said.subject)
        node.value(words.INDEX, number)
        node.value(words.MATERIAL_NAME, material.name)
        node.value(words.MATERIAL_PATH, material.path or None)
        node.value(words.COLOUR, material.colour)
        said.fact(Fact(MATERIAL, Anonymous(sorted_facts(node.everything()))))


def _material(heard: Heard, value: FactValue) -> tuple[int, Material] | None:
    if not isinstance(value, Anonymous):
        return None
    node = Heard(heard.subject, value.facts, heard.report, is_part=True)
    number, name = node.value(words.INDEX), node.value(words.MATERIAL_NAME)
    path, colour = node.value(words.MATERIAL_PATH), node.value(words.COLOUR)
    if number is None or name is None or node.left():
        return None
    if colour is None:
        return number, Material(name=name, path=path or "")
    red, green, blue = colour
    return number, Material(name=name, path=path or "", colour=(red, green, blue))
