"""Notions: everything that a store says of forms, materials and light, gathered by what it is said of.

The words are annotation properties of `ms:`, so that no reasoner draws conclusions from the look of things:

| property | of | value |
|---|---|---|
| `ms:shapedAs` | class | a form, or another class that it is shaped like |
| `ms:builtAs` | form | the name of the builder that makes it |
| below `ms:formParameter` | class, form | a parameter: `ms:shelfCount` is the builder's `shelf_count` |
| `ms:madeOf`; below it `ms:frontMadeOf` ... | class, form | a material, of the whole or of the part with that role |
| `ms:inColour`; `ms:frontInColour` ... | class, form, material | `#rrggbb` or a name; classes choose one of several |
| `ms:givesLight`, `ms:lightColour`, `ms:lightIntensity` | class | `point`, `spot`, `directional` or `none`; cd or lx |
| `ms:metalness`, `ms:roughness`, `ms:opacity`, `ms:glow` | material | factors from 0 to 1 |
| `ms:density`, `ms:friction`, `ms:restitution` | material, class | kg/m3, and numbers from 0 |
| `ms:typicalSize` | class | depth, width and height [m] of things whose size nobody tells |
| `ms:nameWord` | class, material | a word in names of unknown classes that stands for it, besides its label |
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TypeVar

import pyoxigraph as ox

from mindstage.errors import InvalidColorError
from mindstage.knowledge.names import local_name
from mindstage.knowledge.shaping.rule import DEFAULT_ROLE, ShapeParameter
from mindstage.knowledge.stores.triplestore import QuadSource
from mindstage.knowledge.vocabulary import LABEL, RDFS, XSD, ms
from mindstage.world import Color, Iri, LightType, Vector
from mindstage.world.colors import parse_color

__all__ = ["MATERIAL_FACTORS", "NO_LIGHT", "ShapeAnnotations"]

T = TypeVar("T")

MATERIAL_FACTORS = ("metalness", "roughness", "opacity", "glow", "density", "friction", "restitution")
NO_LIGHT = "none"

_SHAPED_AS, _BUILT_AS, _PARAMETER = ms("shapedAs"), ms("builtAs"), ms("formParameter")
_MADE_OF, _IN_COLOR, _WORD = ms("madeOf"), ms("inColour"), ms("nameWord")
_GIVES_LIGHT, _LIGHT_COLOR, _LIGHT_INTENSITY = ms("givesLight"), ms("lightColour"), ms("lightIntensity")
_SUBPROPERTY = Iri(RDFS + "subPropertyOf")
_BUNDLED_GRAPH = re.compile(r"/knowledge/bundled/[^/]*$")
_NUMBERS = frozenset(XSD + name for name in ("integer", "int", "decimal", "double", "float", "nonNegativeInteger"))


class ShapeAnnotations:
    """What is said, by subject; of several values the one that does not come with Mindstage."""

    def __init__(self, store: QuadSource) -> None:
        """Reads everything."""
        self._store = store
        self._issues: dict[Iri, list[str]] = {}
        self.shaped_as = self._single_values(_SHAPED_AS, _iri)
        self.shape_types = self._single_values(_BUILT_AS, _text)
        self.parameters: dict[Iri, dict[str, ShapeParameter]] = {}
        for property in self._sub_properties(_PARAMETER):
            for subject, value in self._single_values(property, _parameter).items():
                self.parameters.setdefault(subject, {})[_snake(local_name(property))] = value
        self.made_of = {
            _role(each, "MadeOf"): self._single_values(each, _iri)
            for each in (*self._sub_properties(_MADE_OF), _MADE_OF)
        }
        in_color = (*self._sub_properties(_IN_COLOR), _IN_COLOR)
        self.colors = {_role(each, "InColour"): self._all_values(each, _color) for each in in_color}
        self.lights = self._single_values(_GIVES_LIGHT, _light)
        """None for what is said to give none."""
        self.light_colors = self._single_values(_LIGHT_COLOR, _color)
        self.light_intensities = self._single_values(_LIGHT_INTENSITY, _positive)
        self.sizes = self._single_values(ms("typicalSize"), _size)
        self.material_factors = {name: self._single_values(ms(name), _positive) for name in MATERIAL_FACTORS}
        self.materials = {material for told in self.made_of.values() for material in told.values()}

    @property
    def roles(self) -> Iterable[str]:
        """The parts of forms for which some material or color is told, `DEFAULT_ROLE` among them."""
        return dict.fromkeys((*self.made_of, *self.colors))

    def material_words(self, subject: Iri) -> Iterator[str]:
        """The words for a material."""
        for property in (LABEL, _WORD):
            for quad in self._quads(property, ox.NamedNode(subject)):
                yield str(getattr(quad.object, "value", "")).lower()

    def all_words(self) -> Iterator[tuple[str, Iri]]:
        """All words for classes and materials: first those meant for it, then their labels."""
        yield from self.primary_words()
        yield from self._labels(LABEL)

    def primary_words(self) -> Iterator[tuple[str, Iri]]:
        """The words meant for it alone."""
        return self._labels(_WORD)

    def add_issue(self, subject: Iri, text: str) -> None:
        """Keeps in mind that something was told that cannot be so."""
        told = self._issues.setdefault(subject, [])
        if text not in told:
            told.append(text)

    def issues_of(self, subjects: Iterable[Iri]) -> Iterator[str]:
        """What could not be taken as told of these."""
        for subject in subjects:
            yield from (f"{local_name(subject)}: {text}" for text in self._issues.get(subject, ()))

    # -- reading -------------------------------------------------------------------------------------------------------

    def _sub_properties(self, property: Iri) -> list[Iri]:
        told = self._store.quads_for_pattern(None, ox.NamedNode(_SUBPROPERTY), ox.NamedNode(property))
        return sorted({Iri(quad.subject.value) for quad in told if isinstance(quad.subject, ox.NamedNode)} - {property})

    def _single_values(self, property: Iri, read: Callable[[object], T]) -> dict[Iri, T]:
        return {subject: values[0] for subject, values in self._all_values(property, read).items()}

    def _all_values(self, property: Iri, read: Callable[[object], T]) -> dict[Iri, list[T]]:
        """What is said by a property; what comes with Mindstage gives way to what anybody else says."""
        found: dict[Iri, list[tuple[bool, T]]] = {}
        for quad in sorted(self._quads(property), key=lambda quad: (_is_bundled(quad), str(quad.object))):
            if isinstance(quad.subject, ox.NamedNode):
                subject = Iri(quad.subject.value)
                try:
                    found.setdefault(subject, []).append((_is_bundled(quad), read(quad.object)))
                except ValueError as error:
                    self.add_issue(subject, f"{local_name(property)} cannot be {error}")
        return {subject: _preferred(values) for subject, values in found.items() if values}

    def _labels(self, property: Iri) -> Iterator[tuple[str, Iri]]:
        for quad in sorted(self._quads(property), key=lambda quad: str(quad.subject)):
            if isinstance(quad.subject, ox.NamedNode) and isinstance(quad.object, ox.Literal):
                yield quad.object.value.lower(), Iri(quad.subject.value)

    def _quads(self, property: Iri, subject: ox.NamedNode | None = None) -> Iterator[ox.Quad]:
        return self._store.quads_for_pattern(subject, ox.NamedNode(property), None)


def _preferred(values: list[tuple[bool, T]]) -> list[T]:
    return [value for bundled, value in values if bundled == values[0][0]]


def _is_bundled(quad: ox.Quad) -> bool:
    return bool(_BUNDLED_GRAPH.search(str(getattr(quad.graph_name, "value", ""))))


def _role(property: Iri, suffix: str) -> str:
    return _snake(local_name(property).removesuffix(suffix)) if property not in (_MADE_OF, _IN_COLOR) else DEFAULT_ROLE


def _snake(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def _iri(node: object) -> Iri:
    if not isinstance(node, ox.NamedNode):
        raise ValueError(f"{_node_text(node)}; it leads to things that have a name")
    return Iri(node.value)


def _text(node: object) -> str:
    if not isinstance(node, ox.Literal):
        raise ValueError(f"{_node_text(node)}; it is a word in quotes")
    return node.value


def _parameter(node: object) -> ShapeParameter:
    text = _text(node)
    datatype = node.datatype.value if isinstance(node, ox.Literal) else ""
    if datatype == XSD + "boolean":
        return text in ("true", "1")
    if datatype in _NUMBERS:
        return int(text) if datatype.lower().endswith(("integer", "int")) else float(text)
    return text


def _positive(node: object) -> float:
    text = _text(node)
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < float("inf"):
        raise ValueError(f'"{text}"; it is a number from 0')
    return value


def _color(node: object) -> Color:
    try:
        color = parse_color(_text(node))
    except InvalidColorError as error:
        raise ValueError(f'"{_text(node)}": {error}') from None
    if color is None:
        raise ValueError(f'"{_text(node)}"; it is a colour')
    return color


def _size(node: object) -> Vector:
    text = _text(node)
    try:
        depth, width, height = map(float, text.split())
    except ValueError:
        depth = width = height = 0.0
    if not all(0.0 < extent < float("inf") for extent in (depth, width, height)):
        raise ValueError(f'"{text}"; it is depth, width and height in metres')
    return depth, width, height


def _light(node: object) -> LightType | None:
    text = _text(node)
    known: Mapping[str, LightType | None] = {NO_LIGHT: None, **{kind.value: kind for kind in LightType}}
    if text not in known:
        raise ValueError(f'"{text}"; it is one of {", ".join(known)}')
    return known[text]


def _node_text(node: object) -> str:
    return str(node)
