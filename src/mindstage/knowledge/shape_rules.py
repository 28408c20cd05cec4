"""Shape rules: the shape, material and light of the objects of a class, resolved from annotations in ontologies.

The annotation properties are in `ms:`; they have no effect on reasoning:

| property | of | value |
|---|---|---|
| `ms:shapedAs` | class | a shape, or another class with the same shape |
| `ms:builtAs` | shape | the name of the shape template that builds it |
| below `ms:formParameter` | class, shape | a parameter: `ms:shelfCount` is the template's `shelf_count` |
| `ms:madeOf`; below it `ms:frontMadeOf` ... | class, shape | a material, of the whole or of the part with that role |
| `ms:inColour`; `ms:frontInColour` ... | class, shape, material | `#rrggbb` or a name; classes choose one of several |
| `ms:givesLight`, `ms:lightColour`, `ms:lightIntensity` | class | `point`, `spot`, `directional` or `none`; cd or lx |
| `ms:metalness`, `ms:roughness`, `ms:opacity`, `ms:glow` | material | factors from 0 to 1 |
| `ms:texture` | material, class | a procedural texture (`mindstage.textures`), or `none` |
| `ms:density`, `ms:friction`, `ms:restitution` | material, class | kg/m3, and numbers from 0 |
| `ms:typicalSize` | class | depth, width and height [m] of objects without a size |
| `ms:mounting` | class | `fixed`, `installed` or `portable`: whether an object can be loose |
| `ms:nameWord` | class, material | a word in the names of unknown classes that refers to it, besides its label |

An annotation of a class holds for all its subclasses, unless a more specific class overrides that property: a subclass
with only a color keeps the inherited shape and material. A class that is shaped as another one has all annotations of
that class, and a shape has defaults of its own. For a class without a shape, words in its name that refer to known
classes are used, which is marked as a guess.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from colorsys import hls_to_rgb
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from hashlib import blake2s
from typing import NamedTuple, TypeVar

import pyoxigraph as ox

from mindstage.errors import InvalidColorError, TextureNotFoundError
from mindstage.rdf.graphs import BUNDLED_GRAPHS, QuadSource, local_name, node_to_look_up
from mindstage.rdf.taxonomy import ClassHierarchy
from mindstage.rdf.vocabulary import KNOWROB, LABEL, MS, RDFS, XSD, ms
from mindstage.scene import Color, GeometrySource, Iri, LightType, PbrMaterial, Vector
from mindstage.scene.colors import parse_color
from mindstage.textures.catalog import texture_info

__all__ = [
    "DEFAULT_ROLE",
    "DEFAULT_SHAPE",
    "MATERIAL_FACTORS",
    "NO_LIGHT",
    "LightRule",
    "MaterialResolver",
    "Mounting",
    "PartMaterial",
    "ShapeAnnotations",
    "ShapeParameter",
    "ShapeRule",
    "ShapeRuleResolver",
    "default_material",
    "joined_words",
    "name_suffixes",
    "name_tokens",
    "singular_forms",
    "stable_hash",
]


ShapeParameter = bool | int | float | str

DEFAULT_ROLE = "body"
"""The role of parts without another role: the material of the whole object."""

DEFAULT_SHAPE = "box"
"""The shape type of classes without any annotation."""


@dataclass(frozen=True, slots=True)
class PartMaterial:
    """The material of a part of an object."""

    pbr_material: PbrMaterial
    density: float | None = None
    """[kg/m3]."""
    friction: float | None = None
    """The coefficient of sliding friction against the same material."""
    restitution: float | None = None


@dataclass(frozen=True, slots=True)
class LightRule:
    """The light that an object emits."""

    light_type: LightType
    color: Color = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    """[cd], or [lx] for a directional light."""


class Mounting(StrEnum):
    """Whether the objects of a class can be loose, whatever a map says about their mobility."""

    FIXED = "fixed"
    """Never: a part of the building, or mounted on it."""
    INSTALLED = "installed"
    """Furniture, appliances and parts: as the map says, unless its mobility is the same for nearly everything."""
    PORTABLE = "portable"
    """Always."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeRule:
    """The shape, materials and light of the objects of a class."""

    cls: Iri
    shape_type: str = DEFAULT_SHAPE
    """The name of a shape template, such as "drawer"."""
    source: GeometrySource = GeometrySource.MAP
    reason: str = ""
    """Where the rule comes from, in one line."""
    parameters: Mapping[str, ShapeParameter]
    """By the template's parameter names, such as `shelf_count`. A template need not have all of them."""
    materials: Mapping[str, PartMaterial]
    """By role; there is always one for `DEFAULT_ROLE`."""
    word: str = ""
    """The label of the class, or of the nearest superclass with a label: what is printed on a package."""
    light: LightRule | None = None
    size: Vector | None = None
    """The typical depth, width and height [m]."""
    mounting: Mounting | None = None
    """None if neither an annotation nor a word in the name gives it."""
    mounting_reason: str = ""
    """Where `mounting` comes from, in one line."""
    mounting_is_weak: bool = False
    """Whether only a word before the last one of the name gives it, so that it does not hold for small objects."""
    issues: tuple[str, ...] = ()
    """Annotations that could not be used."""

    @property
    def default_material(self) -> PartMaterial:
        """The material of the whole object."""
        return self.materials[DEFAULT_ROLE]


_WORD_PATTERN = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+\d*|\d+")


def name_tokens(iri: str) -> tuple[str, ...]:
    """The words of a name in lower case, without codes, numbers and suffixes that distinguish homonyms.

    The words of `IAIDrawerW60H29` are ("drawer",), those of `Table-PieceOfFurniture` ("table",).
    """
    parts = _WORD_PATTERN.findall(local_name(iri).split("-")[0])
    return tuple(part.lower() for part in parts if len(part) > 1 and not (part.isupper() or part.isdigit()))


def name_suffixes(words: tuple[str, ...]) -> Iterator[str]:
    """What a name may refer to, the most likely first: its endings, the longest first, then each word before that."""
    for start in range(len(words)):
        yield from singular_forms(" ".join(words[start:]))
    for word in reversed(words[:-1]):
        yield from singular_forms(word)


def joined_words(words: tuple[str, ...], known: Container[str]) -> tuple[str, ...]:
    """Joins neighboring words that are one word, so that none is looked up alone: a dish washer is no dish."""
    for length in range(len(words), 1, -1):
        for start in range(len(words) - length + 1):
            run = words[start : start + length]
            for text in (" ".join(run), "".join(run)):
                if any(form in known for form in singular_forms(text)):
                    return (*joined_words(words[:start], known), text, *joined_words(words[start + length :], known))
    return words


def singular_forms(word: str) -> tuple[str, ...]:
    """A word, and the words that it may be the plural of."""
    return tuple(dict.fromkeys((word, word.removesuffix("s"), word.removesuffix("es"))))


def stable_hash(text: str) -> int:
    """A hash of a text that is the same in every process."""
    return int.from_bytes(blake2s(text.encode(errors="surrogatepass"), digest_size=4).digest(), "big")


T = TypeVar("T")

MATERIAL_FACTORS = ("metalness", "roughness", "opacity", "glow", "density", "friction", "restitution")
NO_LIGHT = "none"
_NO_TEXTURE = "none"

_SHAPED_AS, _BUILT_AS, _PARAMETER = ms("shapedAs"), ms("builtAs"), ms("formParameter")
_MADE_OF, _IN_COLOR, _WORD = ms("madeOf"), ms("inColour"), ms("nameWord")
_GIVES_LIGHT, _LIGHT_COLOR, _LIGHT_INTENSITY = ms("givesLight"), ms("lightColour"), ms("lightIntensity")
_PLACE = Iri(KNOWROB + "Place")
_SUBPROPERTY = Iri(RDFS + "subPropertyOf")
_NUMBERS = frozenset(XSD + name for name in ("integer", "int", "decimal", "double", "float", "nonNegativeInteger"))


class ShapeAnnotations:
    """The annotations of a triple store by subject; other values take precedence over those bundled with Mindstage."""

    def __init__(self, store: QuadSource) -> None:
        """Reads all annotations."""
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
        """None for a class that is annotated to emit no light."""
        self.light_colors = self._single_values(_LIGHT_COLOR, _color)
        self.light_intensities = self._single_values(_LIGHT_INTENSITY, _positive)
        self.sizes = self._single_values(ms("typicalSize"), _size)
        self.mountings = self._single_values(ms("mounting"), _mounting)
        self.material_factors = {name: self._single_values(ms(name), _positive) for name in MATERIAL_FACTORS}
        self.textures = self._single_values(ms("texture"), _texture)
        """By material or class; an empty string for one that is annotated to have none."""
        self.materials = {material for values in self.made_of.values() for material in values.values()}

    @property
    def roles(self) -> Iterable[str]:
        """The roles for which there is a material or a color, including `DEFAULT_ROLE`."""
        return dict.fromkeys((*self.made_of, *self.colors))

    def label_of(self, subjects: Iterable[Iri]) -> str:
        """The label of the first of these classes that has one, in lower case; English before other languages."""
        for subject in subjects:
            labels = [quad.object for quad in self._quads(LABEL, node_to_look_up(subject))]
            literals = [label for label in labels if isinstance(label, ox.Literal)]
            if literals:
                return min(literals, key=lambda each: (each.language != "en", each.value)).value.lower()
        return ""

    def material_words(self, subject: Iri) -> Iterator[str]:
        """The words that refer to a material."""
        for property in (LABEL, _WORD):
            for quad in self._quads(property, node_to_look_up(subject)):
                yield str(getattr(quad.object, "value", "")).lower()

    def all_words(self) -> Iterator[tuple[str, Iri]]:
        """All words that refer to classes and materials: those of `ms:nameWord`, then the labels."""
        yield from self.primary_words()
        yield from self._labels(LABEL)

    def primary_words(self) -> Iterator[tuple[str, Iri]]:
        """The words of `ms:nameWord`."""
        return self._labels(_WORD)

    def add_issue(self, subject: Iri, text: str) -> None:
        """Records an annotation that could not be used."""
        issues = self._issues.setdefault(subject, [])
        if text not in issues:
            issues.append(text)

    def materials_of(self, subjects: Iterable[Iri]) -> dict[Iri, None]:
        """The materials that these classes and shapes are annotated with, of any part, in a fixed order."""
        return {values[each]: None for each in subjects for values in self.made_of.values() if each in values}

    def issues_of(self, subjects: Iterable[Iri]) -> Iterator[str]:
        """The annotations of these subjects that could not be used."""
        for subject in subjects:
            yield from (f"{local_name(subject)}: {text}" for text in self._issues.get(subject, ()))

    # -- reading -------------------------------------------------------------------------------------------------------

    def _sub_properties(self, property: Iri) -> list[Iri]:
        quads = self._store.quads_for_pattern(None, ox.NamedNode(_SUBPROPERTY), ox.NamedNode(property))
        return sorted(
            {Iri(quad.subject.value) for quad in quads if isinstance(quad.subject, ox.NamedNode)} - {property}
        )

    def _single_values(self, property: Iri, read: Callable[[object], T]) -> dict[Iri, T]:
        return {subject: values[0] for subject, values in self._all_values(property, read).items()}

    def _all_values(self, property: Iri, read: Callable[[object], T]) -> dict[Iri, list[T]]:
        """The values of a property by subject; bundled values only where there are no others."""
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

    def _quads(self, property: Iri, subject: ox.NamedNode | ox.BlankNode | None = None) -> Iterator[ox.Quad]:
        return self._store.quads_for_pattern(subject, ox.NamedNode(property), None)


def _preferred(values: list[tuple[bool, T]]) -> list[T]:
    return [value for bundled, value in values if bundled == values[0][0]]


def _is_bundled(quad: ox.Quad) -> bool:
    return isinstance(quad.graph_name, ox.NamedNode) and quad.graph_name.value.startswith(BUNDLED_GRAPHS)


def _role(property: Iri, suffix: str) -> str:
    return _snake(local_name(property).removesuffix(suffix)) if property not in (_MADE_OF, _IN_COLOR) else DEFAULT_ROLE


def _snake(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def _iri(node: object) -> Iri:
    if not isinstance(node, ox.NamedNode):
        raise ValueError(f"{_node_text(node)}; expected an IRI")
    return Iri(node.value)


def _text(node: object) -> str:
    if not isinstance(node, ox.Literal):
        raise ValueError(f"{_node_text(node)}; expected a string in quotes")
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
        raise ValueError(f'"{text}"; expected a number from 0')
    return value


def _color(node: object) -> Color:
    try:
        color = parse_color(_text(node))
    except InvalidColorError as error:
        raise ValueError(f'"{_text(node)}": {error}') from None
    if color is None:
        raise ValueError(f'"{_text(node)}"; expected a color')
    return color


def _texture(node: object) -> str:
    text = _text(node)
    if text == _NO_TEXTURE:
        return ""
    try:
        return texture_info(text).name
    except TextureNotFoundError as error:
        raise ValueError(f'"{text}": {error}') from None


def _size(node: object) -> Vector:
    text = _text(node)
    try:
        depth, width, height = map(float, text.split())
    except ValueError:
        depth = width = height = 0.0
    if not all(0.0 < extent < float("inf") for extent in (depth, width, height)):
        raise ValueError(f'"{text}"; expected depth, width and height in meters')
    return depth, width, height


def _mounting(node: object) -> Mounting:
    text = _text(node)
    try:
        return Mounting(text)
    except ValueError:
        raise ValueError(f'"{text}"; expected one of {", ".join(Mounting)}') from None


def _light(node: object) -> LightType | None:
    text = _text(node)
    known: Mapping[str, LightType | None] = {NO_LIGHT: None, **{kind.value: kind for kind in LightType}}
    if text not in known:
        raise ValueError(f'"{text}"; expected one of {", ".join(known)}')
    return known[text]


def _node_text(node: object) -> str:
    return str(node)


_APPEARANCE_FACTORS = {"metalness": "metalness", "roughness": "roughness", "opacity": "opacity", "glow": "emission"}
"""The attribute of `PbrMaterial` that each of these factors sets."""
_MATERIAL_SUFFIX = "Material"
_FRONT = "front"


class _PartAnnotation(NamedTuple):
    """The annotations of one part of a class's objects."""

    material: Iri | None
    material_index: int
    """The index in the lineage of the annotation of its material."""
    colors: Sequence[Color]
    specificity: int
    """The index in the lineage of the most specific annotation."""


_NO_ANNOTATION = _PartAnnotation(None, sys.maxsize, (), sys.maxsize)


class MaterialResolver:
    """Resolves the materials of classes."""

    def __init__(self, annotations: ShapeAnnotations) -> None:
        """Stores the annotations; nothing is resolved yet."""
        self._annotations = annotations
        self._adjectives: dict[str, Iri] | None = None

    def for_class(self, cls: Iri, lineage: Sequence[Iri]) -> dict[str, PartMaterial]:
        """The materials by role, from the annotations in the lineage; there is always one for the default role."""
        annotations = {role: self._part_annotation(role, cls, lineage) for role in self._annotations.roles}
        body = annotations.get(DEFAULT_ROLE, _NO_ANNOTATION)
        if _FRONT in annotations and annotations[_FRONT].specificity > body.specificity:
            del annotations[_FRONT]  # the color of a drawer is also that of its front
        found = {}
        for role, annotation in annotations.items():
            resolved = self._resolve(cls, annotation, lineage if role == DEFAULT_ROLE else ())
            if resolved is not None:
                found[role] = resolved
        return {DEFAULT_ROLE: default_material(cls), **found}

    def _part_annotation(self, role: str, cls: Iri, lineage: Sequence[Iri]) -> _PartAnnotation:
        made_of, colors = self._annotations.made_of.get(role, {}), self._annotations.colors.get(role, {})
        material_index = next((at for at, each in enumerate(lineage) if each in made_of), len(lineage))
        color_index = next((at for at, each in enumerate(lineage) if each in colors), len(lineage))
        material = made_of[lineage[material_index]] if material_index < len(lineage) else None
        # A word such as "steel" in the name is more specific than an inherited material.
        if role == DEFAULT_ROLE and material_index > 0 and (named := self._material_from_name(cls)):
            material, material_index = named, 0
        if color_index > material_index or color_index == len(lineage):  # the color belongs to a more general class
            return _PartAnnotation(material, material_index, (), material_index)
        return _PartAnnotation(material, material_index, colors[lineage[color_index]], color_index)

    def _resolve(self, cls: Iri, annotation: _PartAnnotation, lineage: Sequence[Iri]) -> PartMaterial | None:
        material, colors = annotation.material, annotation.colors
        if material is None and not colors:
            return None
        subjects = [*lineage, material] if material is not None else lineage
        factors = {}
        # Classes come before the material: a carton of milk has the density of milk, not that of paper.
        for name, values in self._annotations.material_factors.items():
            subject = next((each for each in subjects if each in values), None)
            if subject is not None:
                factors[name] = values[subject]
        own = self._annotations.colors.get(DEFAULT_ROLE, {}).get(material, []) if material is not None else []
        surface = PbrMaterial(
            name=self._material_name(material) if material is not None else "",
            color=_pick_color(cls, colors or own),
            texture=self._texture(material, lineage[: annotation.material_index + 1]),
            **{field: min(factors[name], 1.0) for name, field in _APPEARANCE_FACTORS.items() if name in factors},
        )
        return PartMaterial(
            surface, **{name: value for name, value in factors.items() if name not in _APPEARANCE_FACTORS}
        )

    def _texture(self, material: Iri | None, classes: Sequence[Iri]) -> str:
        """The texture of a material, unless a class that is at least as specific as its annotation has another one."""
        textures = self._annotations.textures
        subjects = classes if material is None else (*classes, material)
        return next((textures[each] for each in subjects if each in textures), "")

    def _material_name(self, material: Iri) -> str:
        return next(
            self._annotations.material_words(material), local_name(material).removesuffix(_MATERIAL_SUFFIX).lower()
        )

    def _material_from_name(self, cls: Iri) -> Iri | None:
        """The material that a word before the noun refers to: wood for OakBoard, None for CutleryDrawer."""
        if self._adjectives is None:
            self._adjectives = {
                word: named for word, named in self._annotations.primary_words() if named in self._annotations.materials
            }
        return next((self._adjectives[word] for word in name_tokens(cls)[:-1] if word in self._adjectives), None)


def default_material(cls: Iri) -> PartMaterial:
    """The material of objects without annotations."""
    return PartMaterial(PbrMaterial(color=_pick_color(cls, ())))


def _pick_color(cls: Iri, colors: Sequence[Color]) -> Color:
    """One of several colors, or a muted color, chosen by the name of the class; always the same."""
    number = stable_hash(local_name(cls))
    return colors[number % len(colors)] if colors else hls_to_rgb(number % 360 / 360, 0.66, 0.18)


ClassLineage = tuple[Iri, ...]
"""The classes, and finally a shape, whose annotations hold for a class: the most specific first."""


class ShapeRuleResolver:
    """Resolves shape rules for one state of a store; after a change of the store a new one is needed."""

    def __init__(self, store: QuadSource, hierarchy: ClassHierarchy) -> None:
        """Reads all annotations.

        Args:
            store: the store with the annotations.
            hierarchy: the hierarchy of all its classes.
        """
        self._annotations = ShapeAnnotations(store)
        self._materials = MaterialResolver(self._annotations)
        self._hierarchy = hierarchy
        self._lineages: dict[Iri, ClassLineage] = {}
        self._rules: dict[Iri, ShapeRule] = {}

    def rule(self, cls: Iri) -> ShapeRule:
        """The shape rule of a class."""
        if cls not in self._rules:
            self._rules[cls] = self._resolve(cls)
        return self._rules[cls]

    def _resolve(self, cls: Iri) -> ShapeRule:
        annotated = self._annotated_ancestor(cls)
        shape_type, lineage, reason = (
            self._follow_shaped_as(cls, annotated)
            if annotated
            else (DEFAULT_SHAPE, self._lineage(cls), "no annotation for its shape")
        )
        source = GeometrySource.ONTOLOGY if annotated else GeometrySource.MAP
        if not annotated and (guess := self._guess_from_name(cls)):
            word, named = guess
            shape_type, of_named, _ = self._follow_shaped_as(named, self._annotated_ancestor(named) or named)
            lineage = tuple(dict.fromkeys((cls, *of_named, *lineage)))
            source, reason = GeometrySource.CLASS_NAME, f'"{word}" in its name is the word for {_short_name(named)}'
        mounting, mounting_reason, mounting_is_weak = self._mounting(cls)
        return ShapeRule(
            cls=cls,
            shape_type=shape_type,
            source=source,
            reason=reason,
            parameters=self._parameters(lineage),
            materials=self._materials.for_class(cls, lineage),
            word=self._annotations.label_of(self._lineage(cls)),
            light=self._light(lineage),
            size=next((self._annotations.sizes[each] for each in lineage if each in self._annotations.sizes), None),
            mounting=mounting,
            mounting_reason=mounting_reason,
            mounting_is_weak=mounting_is_weak,
            issues=tuple(self._annotations.issues_of((*lineage, *self._annotations.materials_of(lineage)))),
        )

    def _mounting(self, cls: Iri) -> tuple[Mounting | None, str, bool]:
        """The mounting of a class, where it comes from, and whether only a word before the last gives it.

        The last word of an unknown class is what its objects are. Another word may only say what they belong to, as in
        FloorCleaner or KitchenRoll: it is used for large objects only, and not if it is a room.
        """
        mountings = self._annotations.mountings
        annotated = next((each for each in self._lineage(cls) if each in mountings), None)
        if annotated is not None:
            reason = "" if annotated == cls else f"it is a {_short_name(annotated)}"
            return mountings[annotated], reason, False
        words = joined_words(name_tokens(cls), self._words_for_mountings)
        endings = {word for start in range(len(words)) for word in singular_forms(" ".join(words[start:]))}
        for word in name_suffixes(words):
            named, annotated = self._words_for_mountings.get(word, (None, None))
            if named is None or annotated is None:
                continue
            if word in endings or _PLACE not in self._lineage(named):
                reason = f'"{word}" in its name is the word for {_short_name(named)}'
                return mountings[annotated], reason, word not in endings
        return None, "", False

    @cached_property
    def _words_for_mountings(self) -> dict[str, tuple[Iri, Iri]]:
        """The words for classes with a mounting: the class, and the class that has the annotation."""
        mountings, found = self._annotations.mountings, dict[str, tuple[Iri, Iri]]()
        for word, cls in self._annotations.all_words():
            annotated = next((each for each in self._lineage(cls) if each in mountings), None)
            if word not in found and annotated is not None:
                found[word] = cls, annotated
        return found

    # -- lineage -------------------------------------------------------------------------------------------------------

    def _lineage(self, cls: Iri) -> ClassLineage:
        """A class and all its superclasses: subclasses come first, and among unrelated classes the nearer one."""
        if cls not in self._lineages:
            above = self._hierarchy.ancestors(cls)
            self._lineages[cls] = (cls, *sorted(above, key=lambda each: -len(self._hierarchy.ancestors(each))))
        return self._lineages[cls]

    def _annotated_ancestor(self, cls: Iri) -> Iri | None:
        """The nearest class with a shape annotation, including the class itself."""
        return next((each for each in self._lineage(cls) if each in self._annotations.shaped_as), None)

    def _follow_shaped_as(self, cls: Iri, annotated: Iri) -> tuple[str, ClassLineage, str]:
        """The shape type, the lineage and the reason, from following `ms:shapedAs` from class to class."""
        lineage, trail = self._lineage(cls), [annotated]
        reason = (
            f"{_short_name(annotated)} is shaped as "
            if annotated == cls
            else f"it is a {_short_name(annotated)}, shaped as "
        )
        while (target := self._annotations.shaped_as[trail[-1]]) not in self._annotations.shape_types:
            own = lineage[: lineage.index(trail[-1]) + 1]
            lineage = tuple(dict.fromkeys((*own, *self._lineage(target), *lineage)))
            above = self._annotated_ancestor(target)
            if above is None or above in trail:
                issue = f"it is shaped as {_short_name(target)}, which has no annotation for its shape"
                self._annotations.add_issue(trail[-1], issue)
                return DEFAULT_SHAPE, lineage, reason + f"{_short_name(target)}, which has no annotation for its shape"
            reason += f"{_short_name(target)}, which is shaped as "
            trail.append(above)
        return self._annotations.shape_types[target], (*lineage, target), reason + _short_name(target)

    def _guess_from_name(self, cls: Iri) -> tuple[str, Iri] | None:
        """A word in the name of a class, and the class that it refers to."""
        return next(
            (
                (word, self._words_for_classes[word])
                for word in name_suffixes(joined_words(name_tokens(cls), self._words_for_classes))
                if word in self._words_for_classes
            ),
            None,
        )

    @cached_property
    def _words_for_classes(self) -> dict[str, Iri]:
        """The words for classes with a known shape."""
        found: dict[str, Iri] = {}
        for word, cls in self._annotations.all_words():
            if word not in found and self._annotated_ancestor(cls):
                found[word] = cls
        return found

    # -- values --------------------------------------------------------------------------------------------------------

    def _parameters(self, lineage: Sequence[Iri]) -> dict[str, ShapeParameter]:
        found: dict[str, ShapeParameter] = {}
        for each in reversed(lineage):
            found |= self._annotations.parameters.get(each, {})
        return found

    def _light(self, lineage: Sequence[Iri]) -> LightRule | None:
        annotations = self._annotations
        light_type = next((annotations.lights[each] for each in lineage if each in annotations.lights), None)
        if light_type is None:
            return None
        colors = (annotations.light_colors[each] for each in lineage if each in annotations.light_colors)
        intensities = (annotations.light_intensities[each] for each in lineage if each in annotations.light_intensities)
        return LightRule(light_type, next(colors, (1.0, 1.0, 1.0)), next(intensities, 1.0))


def _short_name(iri: Iri) -> str:
    """An IRI as a prefixed name."""
    prefix = next((name for name, start in (("ms:", MS), ("knowrob:", KNOWROB)) if iri.startswith(start)), "")
    return prefix + local_name(iri)
