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

Shape rules: what is known of the form of a class's things, as plain values.

Words: what the name of a class says about its things, where nobody else does.

Substances: what the parts of things are made of, as light and touch meet it.

The resolver: from what ontologies say of forms, materials and light to one rule for each class.

What is said of a class holds for all below it, the most special first, each statement on its own: a subclass of which
only a color is told keeps the form and the material that it inherits. What is shaped as another class has all that is
told of that one, and a form has defaults of its own. Where nobody says how a class is shaped, its name is searched for
the words for known classes: a guess, and called one.

Shaping: how things of a class look, feel and shine, as far as ontologies say so; nothing of it answers questions.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from colorsys import hls_to_rgb
from dataclasses import dataclass
from functools import cached_property
from hashlib import blake2s
from typing import NamedTuple, TypeVar

import pyoxigraph as ox

from mindstage.errors import InvalidColorError
from mindstage.knowledge.rdf import QuadSource, local_name
from mindstage.knowledge.taxonomy import ClassHierarchy
from mindstage.knowledge.vocabulary import KNOWROB, LABEL, MS, RDFS, XSD, ms
from mindstage.scene import Color, GeometrySource, Iri, LightType, PbrMaterial, Vector
from mindstage.scene.colors import parse_color

__all__ = [
    "DEFAULT_ROLE",
    "DEFAULT_SHAPE",
    "MATERIAL_FACTORS",
    "NO_LIGHT",
    "LightRule",
    "MaterialResolver",
    "PartMaterial",
    "ShapeAnnotations",
    "ShapeParameter",
    "ShapeRule",
    "ShapeRuleResolver",
    "default_material",
    "name_suffixes",
    "name_tokens",
    "singular_forms",
    "stable_hash",
]


ShapeParameter = bool | int | float | str

DEFAULT_ROLE = "body"
"""The role of whatever has no other: the material of the thing as a whole."""

DEFAULT_SHAPE = "box"
"""The kind of what nobody knows better."""


@dataclass(frozen=True, slots=True)
class PartMaterial:
    """What a part of a thing is made of."""

    pbr_material: PbrMaterial
    density: float | None = None
    """[kg/m3]."""
    friction: float | None = None
    """Sliding, against something alike."""
    restitution: float | None = None


@dataclass(frozen=True, slots=True)
class LightRule:
    """The light that a thing gives."""

    light_type: LightType
    color: Color = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    """[cd], or [lx] of a directional one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeRule:
    """What is known of the form of a class's things."""

    cls: Iri
    shape_type: str = DEFAULT_SHAPE
    """The name of a form: "drawer", say."""
    source: GeometrySource = GeometrySource.MAP
    reason: str = ""
    """Who says so, in one line."""
    parameters: Mapping[str, ShapeParameter]
    """As the form names them: `shelf_count`. A form need not have all of them."""
    materials: Mapping[str, PartMaterial]
    """By role; that of `DEFAULT_ROLE` is always there."""
    light: LightRule | None = None
    size: Vector | None = None
    """Of a typical one: depth, width, height [m]."""
    issues: tuple[str, ...] = ()
    """What was told and could not be taken as told."""

    @property
    def default_material(self) -> PartMaterial:
        """Of the thing as a whole."""
        return self.materials[DEFAULT_ROLE]


_PARTS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+\d*|\d+")


def name_tokens(iri: str) -> tuple[str, ...]:
    """The words of a name in lower case: codes, numbers and what tells homonyms apart are left out.

    `IAIDrawerW60H29` is a drawer, `Table-PieceOfFurniture` a table.
    """
    parts = _PARTS.findall(local_name(iri).split("-")[0])
    return tuple(part.lower() for part in parts if len(part) > 1 and not (part.isupper() or part.isdigit()))


def name_suffixes(words: tuple[str, ...]) -> Iterator[str]:
    """What a name may be about, the most telling first: how it ends, the longest first, then each word before that."""
    for start in range(len(words)):
        yield from singular_forms(" ".join(words[start:]))
    for word in reversed(words[:-1]):
        yield from singular_forms(word)


def singular_forms(word: str) -> tuple[str, ...]:
    """A word, and what it may be the plural of."""
    return tuple(dict.fromkeys((word, word.removesuffix("s"), word.removesuffix("es"))))


def stable_hash(text: str) -> int:
    """A number that a text falls on, the same every time."""
    return int.from_bytes(blake2s(text.encode(), digest_size=4).digest(), "big")


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


_APPEARANCE_FACTORS = {"metalness": "metalness", "roughness": "roughness", "opacity": "opacity", "glow": "emission"}
"""The attribute of `PbrMaterial` that each of these factors sets."""
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
            **{field: min(factors[name], 1.0) for name, field in _APPEARANCE_FACTORS.items() if name in factors},
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


ClassLineage = tuple[Iri, ...]
"""Classes, and at last a form, whose statements hold for a class: the most special first."""


class ShapeRuleResolver:
    """One look at a store; after any change to the store another one is needed."""

    def __init__(self, store: QuadSource, hierarchy: ClassHierarchy) -> None:
        """Reads what is said about forms.

        Args:
            store: where it is said.
            hierarchy: of all its classes.
        """
        self._annotations = ShapeAnnotations(store)
        self._materials = MaterialResolver(self._annotations)
        self._hierarchy = hierarchy
        self._lineages: dict[Iri, ClassLineage] = {}
        self._rules: dict[Iri, ShapeRule] = {}

    def rule(self, cls: Iri) -> ShapeRule:
        """How things of a class are shaped."""
        if cls not in self._rules:
            self._rules[cls] = self._resolve(cls)
        return self._rules[cls]

    def _resolve(self, cls: Iri) -> ShapeRule:
        told = self._annotated_ancestor(cls)
        kind, line, why = (
            self._follow_shaped_as(cls, told)
            if told
            else (DEFAULT_SHAPE, self._lineage(cls), "nobody says how it is shaped")
        )
        source = GeometrySource.ONTOLOGY if told else GeometrySource.MAP
        if not told and (guess := self._guess_from_name(cls)):
            word, named = guess
            kind, of_named, _ = self._follow_shaped_as(named, self._annotated_ancestor(named) or named)
            line = tuple(dict.fromkeys((cls, *of_named, *line)))
            source, why = GeometrySource.CLASS_NAME, f'"{word}" in its name is the word for {_short_name(named)}'
        return ShapeRule(
            cls=cls,
            shape_type=kind,
            source=source,
            reason=why,
            parameters=self._parameters(line),
            materials=self._materials.for_class(cls, line),
            light=self._light(line),
            size=next((self._annotations.sizes[each] for each in line if each in self._annotations.sizes), None),
            issues=tuple(self._annotations.issues_of(line)),
        )

    # -- whose statements hold -----------------------------------------------------------------------------------------

    def _lineage(self, cls: Iri) -> ClassLineage:
        """A class and all above it: none before one that is below it; of two alike the nearer one first."""
        if cls not in self._lineages:
            above = self._hierarchy.ancestors(cls)
            self._lineages[cls] = (cls, *sorted(above, key=lambda each: -len(self._hierarchy.ancestors(each))))
        return self._lineages[cls]

    def _annotated_ancestor(self, cls: Iri) -> Iri | None:
        """The class of which it is told how it and all below it are shaped."""
        return next((each for each in self._lineage(cls) if each in self._annotations.shaped_as), None)

    def _follow_shaped_as(self, cls: Iri, annotated: Iri) -> tuple[str, ClassLineage, str]:
        """The kind of form, everything whose statements hold, and why."""
        line, trail = self._lineage(cls), [annotated]
        why = (
            f"{_short_name(annotated)} is shaped as "
            if annotated == cls
            else f"it is a {_short_name(annotated)}, shaped as "
        )
        while (target := self._annotations.shaped_as[trail[-1]]) not in self._annotations.shape_types:
            own = line[: line.index(trail[-1]) + 1]
            line = tuple(dict.fromkeys((*own, *self._lineage(target), *line)))
            above = self._annotated_ancestor(target)
            if above is None or above in trail:
                self._annotations.add_issue(
                    trail[-1], f"it is shaped as {_short_name(target)}, and nobody says how that is shaped"
                )
                return DEFAULT_SHAPE, line, why + f"{_short_name(target)}, of which nobody says how it is shaped"
            why += f"{_short_name(target)}, which is shaped as "
            trail.append(above)
        return self._annotations.shape_types[target], (*line, target), why + _short_name(target)

    def _guess_from_name(self, cls: Iri) -> tuple[str, Iri] | None:
        """A word in the name of a class, and the class that it stands for."""
        return next(
            (
                (word, self._words_for_classes[word])
                for word in name_suffixes(name_tokens(cls))
                if word in self._words_for_classes
            ),
            None,
        )

    @cached_property
    def _words_for_classes(self) -> dict[str, Iri]:
        """What classes of a known form are called."""
        found: dict[str, Iri] = {}
        for word, cls in self._annotations.all_words():
            if word not in found and self._annotated_ancestor(cls):
                found[word] = cls
        return found

    # -- what they say -------------------------------------------------------------------------------------------------

    def _parameters(self, lineage: Sequence[Iri]) -> dict[str, ShapeParameter]:
        found: dict[str, ShapeParameter] = {}
        for each in reversed(lineage):
            found |= self._annotations.parameters.get(each, {})
        return found

    def _light(self, lineage: Sequence[Iri]) -> LightRule | None:
        notions = self._annotations
        kind = next((notions.lights[each] for each in lineage if each in notions.lights), None)
        if kind is None:
            return None
        color = next((notions.light_colors[each] for each in lineage if each in notions.light_colors), (1.0, 1.0, 1.0))
        strength = (notions.light_intensities[each] for each in lineage if each in notions.light_intensities)
        return LightRule(kind, color, next(strength, 1.0))


def _short_name(iri: Iri) -> str:
    """An IRI as people write it."""
    prefix = next((name for name, start in (("ms:", MS), ("knowrob:", KNOWROB)) if iri.startswith(start)), "")
    return prefix + local_name(iri)
