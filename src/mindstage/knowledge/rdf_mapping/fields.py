"""Sizes: what classes say about the extents of their members, inherited by their subclasses.

Materials: surfaces in their order, which dialect 1 has no words for.

Relations: who hangs on whom, told by the parent, by the child, or by both.

Tags: "SemLog;Class,Cup;Id,c1;Other;k,v;", which is types, each followed by its pairs of key and value.

That writing knows no escapes; tags that it cannot hold are written as JSON under a name of our own.

Bodies' sizes: told by their classes, or by themselves where they differ from what their classes say.

Only the classes that a world holds as resources count for what a body need not say itself, since only those go into
the same file. A size that comes from an ontology is said by the body.
"""

from __future__ import annotations

import json
from collections.abc import Container, Iterable, Mapping, Sequence

import msgspec

from mindstage.knowledge.rdf import FindingSink, Graph, Severity, find_forbidden_character
from mindstage.knowledge.rdf_mapping import properties as words
from mindstage.knowledge.rdf_mapping.nested import sorted_facts
from mindstage.knowledge.rdf_mapping.properties import SIZE, PropertyCodec, SubjectReader, SubjectWriter, literal_text
from mindstage.knowledge.taxonomy import ClassHierarchy
from mindstage.knowledge.vocabulary import (
    CHILD,
    EQUIVALENT_CLASS,
    HAS_VALUE,
    MATERIAL,
    ON_PROPERTY,
    PARENT,
    SUBCLASS_OF,
    TAGS_DATA,
    TAGS_JSON,
    UNTOLD,
)
from mindstage.scene import (
    BlankNode,
    FactValue,
    Iri,
    IriRef,
    Literal,
    Material,
    NamedResource,
    PropertyAssertion,
    Tag,
    Vector,
)

__all__ = [
    "AttachmentReader",
    "ClassSizes",
    "PartialSize",
    "map_class_sizes",
    "parse_tags",
    "read_materials",
    "read_size",
    "read_tags",
    "write_materials",
    "write_size",
    "write_tags",
]


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


class AttachmentReader:
    """What bodies say about one another, as a forest; a statement that would spoil it stays a fact."""

    def __init__(self, bodies: Mapping[Iri, SubjectReader], constraints: Container[Iri]) -> None:
        """Listens to all bodies.

        Args:
            bodies: what is told about each.
            constraints: individuals that join others; a body may name one it is an end of.
        """
        self.ends: dict[tuple[Iri, Iri], Iri] = {}
        """By constraint and role (`parents` or `child`), the body that says to be that end of it."""
        self.parents: dict[Iri, Iri] = {}
        """By child."""
        self._ancestor: dict[Iri, Iri] = {}
        for body, heard in bodies.items():
            self._read_relations(body, heard, bodies, constraints)

    def _read_relations(
        self, body: Iri, reader: SubjectReader, bodies: Container[Iri], constraints: Container[Iri]
    ) -> None:
        told = [(index, role, other) for role in (CHILD, PARENT) for index, other in reader.references(role)]
        for index, role, other in sorted(told):
            if other in bodies:
                parent, child = (body, other) if role == CHILD else (other, body)
                if problem := self._attach(parent, child):
                    reader.warn(role, problem, "the relation stays a fact")
                else:
                    reader.consume(index)
            elif other in constraints:
                self.ends.setdefault((other, PARENT if role == CHILD else CHILD), body)
            else:
                reader.warn(role, f"{other} is no body of this map", "the relation stays a fact")

    def _attach(self, parent: Iri, child: Iri) -> str:
        """What speaks against it; nothing if it is done."""
        if child in self.parents:
            other = self.parents[child]
            return "" if other == parent else f"{child} already hangs on {other} and cannot hang on {parent} too"
        if self._root(parent) == child:
            return f"{child} would hang on itself, by way of {parent}"
        self.parents[child] = parent
        self._ancestor[child] = parent
        return ""

    def _root(self, body: Iri) -> Iri:
        # Each walk halves the way for the next one, so that long chains cost no more than short ones.
        towards = self._ancestor
        while (up := towards.get(body)) is not None:
            if up in towards:
                towards[body] = towards[up]
            body = up
        return body


Tags = tuple[Tag, ...]


def read_tags(reader: SubjectReader) -> Tags:
    """The tags of an individual. Where they are told both ways, JSON counts."""
    told = reader.read(_JSON_TAGS_CODEC)
    return (reader.read(_TAGS_CODEC) or ()) if told is None else told


def parse_tags(value: FactValue) -> Tags:
    """The tags that one text in the community's writing holds; none, if it is none."""
    return _parse(value) or ()


def write_tags(writer: SubjectWriter, tags: Tags) -> None:
    """Says the tags in the community's writing, if it can hold them."""
    if writer.first_value(_JSON_TAGS_CODEC) is not None or not _has_short_form(tags):
        writer.write(_JSON_TAGS_CODEC, tags)
    elif tags or writer.first_value(_TAGS_CODEC) != ():
        writer.write(_TAGS_CODEC, tags or None)


def _parse(value: FactValue) -> Tags | None:
    text = literal_text(value)
    if text is None:
        return None
    tags, kind = [], None
    for part in text.removesuffix(";").split(";") if text else ():
        key, comma, told = part.partition(",")
        if not comma:
            kind = part
        elif kind is None:
            return None
        else:
            tags.append(Tag(type=kind, key=key, value=told))
    return tuple(tags)


def _format(tags: Tags) -> Literal:
    parts: list[str] = []
    kind = None
    for tag in tags:
        if tag.type != kind:
            kind = tag.type
            parts.append(kind)
        parts.append(f"{tag.key},{tag.value}")
    return Literal("".join(part + ";" for part in parts))


def _has_short_form(tags: Tags) -> bool:
    literal = _format(tags)
    return _parse(literal) == tags and not find_forbidden_character(literal.text)


def _parse_json(value: FactValue) -> Tags | None:
    try:
        told = msgspec.convert(json.loads(literal_text(value) or ""), list[tuple[str, str, str]])
    except (ValueError, RecursionError):
        return None
    return tuple(Tag(type=kind, key=key, value=value) for kind, key, value in told)


def _format_json(tags: Tags) -> Literal:
    # ASCII alone: JSON has an escape for every letter, also for those that XML has no way to write.
    return Literal(json.dumps([(tag.type, tag.key, tag.value) for tag in tags]))


_TAGS_CODEC = PropertyCodec(TAGS_DATA, 'tags ("type;key,value;…")', _parse, _format)
_JSON_TAGS_CODEC = PropertyCodec(TAGS_JSON, "a JSON array of [type, key, value]", _parse_json, _format_json)


PartialSize = tuple[float | None, float | None, float | None]
"""What is known along x, y and z [m]."""


def _superclasses(classes: Iterable[tuple[Iri, Sequence[PropertyAssertion]]]) -> Iterable[tuple[Iri, Iri]]:
    """Class and superclass, for each pair of named ones that facts tell of."""
    for cls, facts in classes:
        for fact in facts:
            if isinstance(fact.value, IriRef):
                if fact.property in (SUBCLASS_OF, EQUIVALENT_CLASS):
                    yield cls, fact.value.iri
                if fact.property == EQUIVALENT_CLASS:
                    yield fact.value.iri, cls


def map_class_sizes(resources: Iterable[NamedResource]) -> ClassSizes:
    """What the resources of one world say, and nothing else; whoever reads that world's file can find it there."""
    classes = {resource.iri: resource.facts for resource in resources}

    def silent(severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
        """Reading reports the same of all that is known."""

    return ClassSizes([classes], ClassHierarchy(_superclasses(classes.items())), silent)


class ClassSizes:
    """Extents by class, from `hasValue` restrictions; what is nearest in the hierarchy counts."""

    def __init__(self, sources: Sequence[Graph], hierarchy: ClassHierarchy, report: FindingSink) -> None:
        """Collects what classes say.

        Args:
            sources: facts by class, first those that come before others; restrictions that several classes of one
                source share stand among them under their label.
            hierarchy: who inherits from whom.
            report: where disagreements go.
        """
        self._hierarchy = hierarchy
        self._report = report
        self._sizes_by_class: dict[Iri, list[float | None]] = {}
        self._cache: dict[tuple[Iri, ...], PartialSize] = {}
        for source in sources:
            for cls, facts in source.items():
                for fact in facts:
                    if fact.property in (SUBCLASS_OF, EQUIVALENT_CLASS):
                        self._add_restriction(cls, fact, source)

    def get(self, classes: tuple[Iri, ...]) -> PartialSize:
        """The extents of a thing of these classes; each axis is found, or not, by itself."""
        known = self._cache.get(classes)
        if known is None:
            levels = self._hierarchy.levels(classes) if self._sizes_by_class else ()
            telling = [told for level in levels if (told := [cls for cls in level if cls in self._sizes_by_class])]
            x, y, z = (self._find_extent(axis, classes, telling) for axis in range(3))
            known = self._cache[classes] = (x, y, z)
        return known

    def _add_restriction(self, cls: Iri, fact: PropertyAssertion, source: Graph) -> None:
        restriction = (
            fact.value.facts
            if isinstance(fact.value, BlankNode)
            else source.get(fact.value.iri, ())
            if isinstance(fact.value, IriRef) and fact.value.iri.startswith("_:")
            else ()
        )
        if not restriction:
            return
        for axis, word in enumerate(SIZE):
            if PropertyAssertion(ON_PROPERTY, IriRef(word.property)) not in restriction:
                continue
            for value in (part.value for part in restriction if part.property == HAS_VALUE):
                number = word.decode(value)
                if number is None:
                    self._warn(cls, axis, f"its value is not {word.expected}", "it gives no size")
                    continue
                told = self._sizes_by_class.setdefault(cls, [None, None, None])
                if told[axis] is None:
                    told[axis] = number
                elif told[axis] != number:
                    self._warn(cls, axis, f"it is told twice: {told[axis]!r} and {number!r}", "the first counts")

    def _find_extent(self, axis: int, classes: tuple[Iri, ...], levels: Iterable[Sequence[Iri]]) -> float | None:
        for level in levels:
            sizes = {cls: size for cls in level if (size := self._sizes_by_class[cls][axis]) is not None}
            if sizes:
                cls, size = next(iter(sizes.items()))
                if any(other != size for other in sizes.values()):
                    self._warn(classes[0], axis, f"{' and '.join(sizes)} disagree", f"{cls} counts")
                return size
        return None

    def _warn(self, cls: Iri, axis: int, problem: str, action: str) -> None:
        self._report(Severity.WARNING, cls, SIZE[axis].property, problem, action)


def read_size(
    reader: SubjectReader, classes: tuple[Iri, ...], *, all_classes: ClassSizes, map_classes: ClassSizes
) -> Vector | None:
    """The size of a body; None where not all three extents are known, and then what is told stays facts.

    Args:
        heard: what is told about the body.
        classes: its classes, the most telling one first.
        known: what all sources say about classes.
        resources: what the classes among the world's resources say.
    """
    if any(reader.is_marked_untold(word.property) for word in SIZE):
        if None not in _effective_size(reader, map_classes.get(classes)):
            reader.consume_untold_mark(SIZE[0].property)
        return None
    own = [reader.read(word, keep_if=lambda _: True) for word in SIZE]
    x, y, z = (
        inherited if told is None else told for told, inherited in zip(own, all_classes.get(classes), strict=True)
    )
    if x is None or y is None or z is None:
        missing = [word.property for word, extent in zip(SIZE, (x, y, z), strict=True) if extent is None]
        if len(missing) < len(SIZE):
            reader.warn(missing[0], "its size is told in part only", "it has none")
        return None
    for word, inherited in zip(SIZE, map_classes.get(classes), strict=True):
        reader.read(word, keep_if=lambda extent, inherited=inherited: extent == inherited)  # type: ignore[misc]
    return x, y, z


def write_size(writer: SubjectWriter, classes: tuple[Iri, ...], size: Vector | None, map_classes: ClassSizes) -> None:
    """Says of a size what the classes do not."""
    inherited = map_classes.get(classes)
    if size is None:
        if None not in _effective_size(writer, inherited):
            writer.add_reference(UNTOLD, SIZE[0].property)
        return
    for word, extent, given in zip(SIZE, size, _effective_size(writer, inherited), strict=True):
        if extent != given:
            writer.write(word, extent)


def _effective_size(reader_or_writer: SubjectWriter | SubjectReader, inherited: PartialSize) -> PartialSize:
    """What a reader would find if nothing more were said, and no mark were set."""
    x, y, z = (
        given if told is None else told
        for told, given in zip((reader_or_writer.first_value(word) for word in SIZE), inherited, strict=True)
    )
    return x, y, z
