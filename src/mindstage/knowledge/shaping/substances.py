"""Substances: what the parts of things are made of, as light and touch meet it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from colorsys import hls_to_rgb
from typing import NamedTuple

from mindstage.knowledge.names import local_name
from mindstage.knowledge.shaping.notions import Notions
from mindstage.knowledge.shaping.rule import BODY, Substance
from mindstage.knowledge.shaping.words import number_of, words
from mindstage.world import Colour, Iri, Surface

__all__ = ["Substances", "plain_substance"]

_SURFACE = ("metalness", "roughness", "opacity", "glow")
_MATERIAL = "Material"
_FRONT = "front"


class _Told(NamedTuple):
    """What is said of a part of a thing."""

    material: Iri | None
    colours: Sequence[Colour]
    at: int
    """Where in the line the most special of it is said."""


_UNTOLD = _Told(None, (), sys.maxsize)


class Substances:
    """Materials by name, and which one a class is made of."""

    def __init__(self, notions: Notions) -> None:
        """Nothing is looked up yet."""
        self._notions = notions
        self._adjectives: dict[str, Iri] | None = None

    def of(self, cls: Iri, line: Sequence[Iri]) -> dict[str, Substance]:
        """By role, what the statements that hold for a class say; of the whole there is always something."""
        told = {role: self._told(role, cls, line) for role in self._notions.roles}
        body = told.get(BODY, _UNTOLD)
        if _FRONT in told and told[_FRONT].at > body.at:  # whoever paints a drawer paints its front
            del told[_FRONT]
        found = {}
        for role, (material, colours, _) in told.items():
            made = self._substance(cls, material, colours, line if role == BODY else ())
            if made is not None:
                found[role] = made
        return {BODY: plain_substance(cls), **found}

    def _told(self, role: str, cls: Iri, line: Sequence[Iri]) -> _Told:
        made_of, colours = self._notions.made_of.get(role, {}), self._notions.colours.get(role, {})
        made = next((at for at, each in enumerate(line) if each in made_of), len(line))
        painted = next((at for at, each in enumerate(line) if each in colours), len(line))
        material = made_of[line[made]] if made < len(line) else None
        if role == BODY and made > 0 and (named := self._named(cls)):  # "steel" in its name says more than its kind
            material, made = named, 0
        if painted > made or painted == len(line):  # the colour of something more general than the material is
            return _Told(material, (), made)
        return _Told(material, colours[line[painted]], painted)

    def _substance(
        self, cls: Iri, material: Iri | None, choices: Sequence[Colour], line: Sequence[Iri]
    ) -> Substance | None:
        if material is None and not choices:
            return None
        told = [*line, material] if material is not None else line
        factors = {}
        for name, said in self._notions.factors.items():  # a carton of milk weighs what milk does, not what paper does
            teller = next((each for each in told if each in said), None)
            if teller is not None:
                factors[name] = said[teller]
        own = self._notions.colours.get(BODY, {}).get(material, []) if material is not None else []
        surface = Surface(
            material=self._word(material) if material is not None else "",
            colour=_chosen(cls, choices or own),
            **{name: min(factors[name], 1.0) for name in _SURFACE if name in factors},
        )
        return Substance(surface, **{name: value for name, value in factors.items() if name not in _SURFACE})

    def _word(self, material: Iri) -> str:
        return next(self._notions.names_of(material), local_name(material).removesuffix(_MATERIAL).lower())

    def _named(self, cls: Iri) -> Iri | None:
        """The material that a word before the noun speaks of: an OakBoard is of wood, a CutleryDrawer of nothing."""
        if self._adjectives is None:
            self._adjectives = {
                word: named for word, named in self._notions.name_words() if named in self._notions.materials
            }
        return next((self._adjectives[word] for word in words(cls)[:-1] if word in self._adjectives), None)


def plain_substance(cls: Iri) -> Substance:
    """Of something of which nobody says what it is made of."""
    return Substance(Surface(colour=_chosen(cls, ())))


def _chosen(cls: Iri, choices: Sequence[Colour]) -> Colour:
    """One of several colours, or a quiet one of its own, greyish and neither dark nor bright; always the same."""
    number = number_of(local_name(cls))
    return choices[number % len(choices)] if choices else hls_to_rgb(number % 360 / 360, 0.66, 0.18)
