"""Substances: what the parts of things are made of, as light and touch meet it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from colorsys import hls_to_rgb
from typing import NamedTuple

from mindstage.knowledge.names import local_name
from mindstage.knowledge.shaping.notions import ShapeAnnotations
from mindstage.knowledge.shaping.rule import DEFAULT_ROLE, PartMaterial
from mindstage.knowledge.shaping.words import name_tokens, stable_hash
from mindstage.world import Color, Iri, PbrMaterial

__all__ = ["MaterialResolver", "default_material"]

_APPEARANCE_FACTORS = ("metalness", "roughness", "opacity", "glow")
_MATERIAL_SUFFIX = "Material"
_FRONT = "front"


class _PartAnnotation(NamedTuple):
    """What is said of a part of a thing."""

    material: Iri | None
    colors: Sequence[Color]
    specificity: int
    """Where in the line the most special of it is said."""


_NO_ANNOTATION = _PartAnnotation(None, (), sys.maxsize)


class MaterialResolver:
    """Materials by name, and which one a class is made of."""

    def __init__(self, annotations: ShapeAnnotations) -> None:
        """Nothing is looked up yet."""
        self._annotations = annotations
        self._adjectives: dict[str, Iri] | None = None

    def for_class(self, cls: Iri, lineage: Sequence[Iri]) -> dict[str, PartMaterial]:
        """By role, what the statements that hold for a class say; of the whole there is always something."""
        told = {role: self._part_annotation(role, cls, lineage) for role in self._annotations.roles}
        body = told.get(DEFAULT_ROLE, _NO_ANNOTATION)
        if _FRONT in told and told[_FRONT].specificity > body.specificity:  # whoever paints a drawer paints its front
            del told[_FRONT]
        found = {}
        for role, (material, colors, _) in told.items():
            made = self._resolve(cls, material, colors, lineage if role == DEFAULT_ROLE else ())
            if made is not None:
                found[role] = made
        return {DEFAULT_ROLE: default_material(cls), **found}

    def _part_annotation(self, role: str, cls: Iri, lineage: Sequence[Iri]) -> _PartAnnotation:
        made_of, colors = self._annotations.made_of.get(role, {}), self._annotations.colors.get(role, {})
        made = next((at for at, each in enumerate(lineage) if each in made_of), len(lineage))
        painted = next((at for at, each in enumerate(lineage) if each in colors), len(lineage))
        material = made_of[lineage[made]] if made < len(lineage) else None
        if (
            role == DEFAULT_ROLE and made > 0 and (named := self._material_from_name(cls))
        ):  # "steel" in its name says more than its kind
            material, made = named, 0
        if painted > made or painted == len(lineage):  # the color of something more general than the material is
            return _PartAnnotation(material, (), made)
        return _PartAnnotation(material, colors[lineage[painted]], painted)

    def _resolve(
        self, cls: Iri, material: Iri | None, colors: Sequence[Color], lineage: Sequence[Iri]
    ) -> PartMaterial | None:
        if material is None and not colors:
            return None
        told = [*lineage, material] if material is not None else lineage
        factors = {}
        for (
            name,
            said,
        ) in self._annotations.material_factors.items():  # a carton of milk weighs what milk does, not what paper does
            teller = next((each for each in told if each in said), None)
            if teller is not None:
                factors[name] = said[teller]
        own = self._annotations.colors.get(DEFAULT_ROLE, {}).get(material, []) if material is not None else []
        surface = PbrMaterial(
            name=self._material_name(material) if material is not None else "",
            color=_pick_color(cls, colors or own),
            **{name: min(factors[name], 1.0) for name in _APPEARANCE_FACTORS if name in factors},
        )
        return PartMaterial(
            surface, **{name: value for name, value in factors.items() if name not in _APPEARANCE_FACTORS}
        )

    def _material_name(self, material: Iri) -> str:
        return next(
            self._annotations.material_words(material), local_name(material).removesuffix(_MATERIAL_SUFFIX).lower()
        )

    def _material_from_name(self, cls: Iri) -> Iri | None:
        """The material that a word before the noun speaks of: an OakBoard is of wood, a CutleryDrawer of nothing."""
        if self._adjectives is None:
            self._adjectives = {
                word: named for word, named in self._annotations.primary_words() if named in self._annotations.materials
            }
        return next((self._adjectives[word] for word in name_tokens(cls)[:-1] if word in self._adjectives), None)


def default_material(cls: Iri) -> PartMaterial:
    """Of something of which nobody says what it is made of."""
    return PartMaterial(PbrMaterial(color=_pick_color(cls, ())))


def _pick_color(cls: Iri, colors: Sequence[Color]) -> Color:
    """One of several colors, or a quiet one of its own, grayish and neither dark nor bright; always the same."""
    number = stable_hash(local_name(cls))
    return colors[number % len(colors)] if colors else hls_to_rgb(number % 360 / 360, 0.66, 0.18)
