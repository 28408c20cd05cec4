"""Fields of bodies that several statements make up: materials, attachments, tags and sizes.

Materials have terms of our own, since dialect 1 has none. Attachments are stated by the parent, the child or both. Tags
are the text "SemLog;Class,Cup;Id,c1;Other;k,v;": types, each followed by its pairs of key and value. That format has no
escapes; tags that it cannot express are written as JSON under a term of our own.

A size is stated by the classes of a body, or by the body if it differs. What a body need not state itself depends only
on the classes that the world holds as resources, since those are written to the same file; a size from an ontology is
therefore written with the body.
"""

from __future__ import annotations

import json
from collections.abc import Container, Iterable, Mapping, Sequence

import msgspec

from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.maps.rdf_mapping.nested import sorted_facts
from mindstage.maps.rdf_mapping.properties import SIZE, PropertyCodec, SubjectReader, SubjectWriter, literal_text
from mindstage.rdf.graphs import FindingSink, Graph, Severity, find_forbidden_character
from mindstage.rdf.taxonomy import ClassHierarchy
from mindstage.rdf.vocabulary import (
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

Tags = tuple[Tag, ...]
PartialSize = tuple[float | None, float | None, float | None]
"""The known extents along x, y and z [m]."""


def read_materials(reader: SubjectReader) -> tuple[Material, ...]:
    """The materials of a body; none if they are not numbered from 0 or have further statements."""
    found: dict[int, Material] = {}
    indexes = reader.indexes_of(MATERIAL)
    for index in indexes:
        material = _read_material(reader, reader.facts[index].value)
        if material is None or material[0] in found or material[0] >= len(indexes):
            reader.warn(MATERIAL, "a material is incomplete, or its index is invalid", "its materials stay facts")
            return ()
        found[material[0]] = material[1]
    reader.consume(*indexes)
    return tuple(found[number] for number in sorted(found))


def write_materials(writer: SubjectWriter, materials: Sequence[Material]) -> None:
    """Writes the materials of a body."""
    for number, material in enumerate(materials):
        node = SubjectWriter(writer.subject)
        node.write(codecs.INDEX, number)
        node.write(codecs.MATERIAL_NAME, material.name)
        node.write(codecs.MATERIAL_PATH, material.path or None)
        node.write(codecs.COLOR, material.color)
        writer.add_fact(PropertyAssertion(MATERIAL, BlankNode(sorted_facts(node.all_facts()))))


def _read_material(reader: SubjectReader, value: FactValue) -> tuple[int, Material] | None:
    if not isinstance(value, BlankNode):
        return None
    node = SubjectReader(reader.subject, value.facts, reader.report, is_nested=True)
    number, name = node.read(codecs.INDEX), node.read(codecs.MATERIAL_NAME)
    path, color = node.read(codecs.MATERIAL_PATH), node.read(codecs.COLOR)
    if number is None or name is None or node.remaining():
        return None
    if color is None:
        return number, Material(name=name, path=path or "")
    red, green, blue = color
    return number, Material(name=name, path=path or "", color=(red, green, blue))


class AttachmentReader:
    """Reads the relations between bodies as a forest of attachments; other relations remain facts."""

    def __init__(self, bodies: Mapping[Iri, SubjectReader], constraints: Container[Iri]) -> None:
        """Reads the relations of all bodies.

        Args:
            bodies: the reader of each body.
            constraints: the joints; a body may name a joint that connects it.
        """
        self.ends: dict[tuple[Iri, Iri], Iri] = {}
        """By joint and role (`PARENT` or `CHILD`), the body that states to have that role."""
        self.parents: dict[Iri, Iri] = {}
        """The parent of each attached body."""
        self._ancestor: dict[Iri, Iri] = {}
        for body, reader in bodies.items():
            self._read_relations(body, reader, bodies, constraints)

    def _read_relations(
        self, body: Iri, reader: SubjectReader, bodies: Container[Iri], constraints: Container[Iri]
    ) -> None:
        references = [(index, role, other) for role in (CHILD, PARENT) for index, other in reader.references(role)]
        for index, role, other in sorted(references):
            if other in bodies:
                parent, child = (body, other) if role == CHILD else (other, body)
                if problem := self._attach(parent, child):
                    reader.warn(role, problem, "the relation stays a fact")
                else:
                    reader.consume(index)
            elif other in constraints:
                self.ends.setdefault((other, PARENT if role == CHILD else CHILD), body)
            else:
                reader.warn(role, f"{other} is not a body of this map", "the relation stays a fact")

    def _attach(self, parent: Iri, child: Iri) -> str:
        """Attaches a body; returns the problem if that is not possible, else an empty string."""
        if child in self.parents:
            other = self.parents[child]
            return "" if other == parent else f"{child} is already a child of {other}, so {parent} cannot be its parent"
        if self._root(parent) == child:
            return f"{child} would be its own ancestor, by way of {parent}"
        self.parents[child] = parent
        self._ancestor[child] = parent
        return ""

    def _root(self, body: Iri) -> Iri:
        # Union-find with path halving: long chains are as fast as short ones.
        ancestor = self._ancestor
        while (up := ancestor.get(body)) is not None:
            if up in ancestor:
                ancestor[body] = ancestor[up]
            body = up
        return body


def read_tags(reader: SubjectReader) -> Tags:
    """The tags of an individual; if both formats are present, those in JSON."""
    tags = reader.read(_JSON_TAGS_CODEC)
    return (reader.read(_TAGS_CODEC) or ()) if tags is None else tags


def parse_tags(value: FactValue) -> Tags:
    """Parses tags in the community's format; returns none if the value is not in it."""
    return _parse(value) or ()


def write_tags(writer: SubjectWriter, tags: Tags) -> None:
    """Writes tags in the community's format if it can express them, else as JSON."""
    if writer.first_value(_JSON_TAGS_CODEC) is not None or not _has_short_form(tags):
        writer.write(_JSON_TAGS_CODEC, tags)
    elif tags or writer.first_value(_TAGS_CODEC) != ():
        writer.write(_TAGS_CODEC, tags or None)


def _parse(value: FactValue) -> Tags | None:
    text = literal_text(value)
    if text is None:
        return None
    tags, tag_type = [], None
    for part in text.removesuffix(";").split(";") if text else ():
        key, comma, tag_value = part.partition(",")
        if not comma:
            tag_type = part
        elif tag_type is None:
            return None
        else:
            tags.append(Tag(type=tag_type, key=key, value=tag_value))
    return tuple(tags)


def _format(tags: Tags) -> Literal:
    parts: list[str] = []
    tag_type = None
    for tag in tags:
        if tag.type != tag_type:
            tag_type = tag.type
            parts.append(tag_type)
        parts.append(f"{tag.key},{tag.value}")
    return Literal("".join(part + ";" for part in parts))


def _has_short_form(tags: Tags) -> bool:
    literal = _format(tags)
    return _parse(literal) == tags and not find_forbidden_character(literal.text)


def _parse_json(value: FactValue) -> Tags | None:
    try:
        rows = msgspec.convert(json.loads(literal_text(value) or ""), list[tuple[str, str, str]])
    except (ValueError, RecursionError):
        return None
    return tuple(Tag(type=tag_type, key=key, value=value) for tag_type, key, value in rows)


def _format_json(tags: Tags) -> Literal:
    # ASCII only: JSON can escape every character, including those that XML cannot contain.
    return Literal(json.dumps([(tag.type, tag.key, tag.value) for tag in tags]))


_TAGS_CODEC = PropertyCodec(TAGS_DATA, 'tags ("type;key,value;…")', _parse, _format)
_JSON_TAGS_CODEC = PropertyCodec(TAGS_JSON, "a JSON array of [type, key, value]", _parse_json, _format_json)


def _superclasses(classes: Iterable[tuple[Iri, Sequence[PropertyAssertion]]]) -> Iterable[tuple[Iri, Iri]]:
    """Pairs of named class and superclass in the statements about classes."""
    for cls, facts in classes:
        for fact in facts:
            if isinstance(fact.value, IriRef):
                if fact.property in (SUBCLASS_OF, EQUIVALENT_CLASS):
                    yield cls, fact.value.iri
                if fact.property == EQUIVALENT_CLASS:
                    yield fact.value.iri, cls


def map_class_sizes(resources: Iterable[NamedResource]) -> ClassSizes:
    """The sizes that the class resources of one world state; a reader of its file finds the same."""
    classes = {resource.iri: resource.facts for resource in resources}

    def ignore(severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
        """The findings are reported when the source is read."""

    return ClassSizes([classes], ClassHierarchy(_superclasses(classes.items())), ignore)


class ClassSizes:
    """The extents of the members of classes, from `hasValue` restrictions; the nearest superclass is used."""

    def __init__(self, sources: Sequence[Graph], hierarchy: ClassHierarchy, report: FindingSink) -> None:
        """Reads the restrictions.

        Args:
            sources: statements by class, in descending precedence; restrictions that several classes of a source share
                are subjects there, under their labels.
            report: receives findings about contradictions.
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

    def __len__(self) -> int:
        """The number of classes that give an extent."""
        return len(self._sizes_by_class)

    def get(self, classes: tuple[Iri, ...]) -> PartialSize:
        """The extents of an individual of these classes; each axis is looked up separately."""
        size = self._cache.get(classes)
        if size is None:
            levels = self._hierarchy.levels(classes) if self._sizes_by_class else ()
            known = [found for level in levels if (found := [cls for cls in level if cls in self._sizes_by_class])]
            x, y, z = (self._find_extent(axis, classes, known) for axis in range(3))
            size = self._cache[classes] = (x, y, z)
        return size

    def of(self, facts: Iterable[PropertyAssertion], classes: tuple[Iri, ...]) -> PartialSize:
        """The extents that statements about an individual of these classes give, and else the classes."""
        own = (codec.first_value(facts) for codec in SIZE)
        x, y, z = (given if extent is None else extent for extent, given in zip(own, self.get(classes), strict=True))
        return x, y, z

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
        for axis, codec in enumerate(SIZE):
            if PropertyAssertion(ON_PROPERTY, IriRef(codec.property)) not in restriction:
                continue
            for value in (part.value for part in restriction if part.property == HAS_VALUE):
                number = codec.decode(value)
                if number is None:
                    self._warn(cls, axis, f"its value is not {codec.expected}", "it gives no size")
                    continue
                size = self._sizes_by_class.setdefault(cls, [None, None, None])
                if size[axis] is None:
                    size[axis] = number
                elif size[axis] != number:
                    self._warn(cls, axis, f"it has two values: {size[axis]!r} and {number!r}", "the first is used")

    def _find_extent(self, axis: int, classes: tuple[Iri, ...], levels: Iterable[Sequence[Iri]]) -> float | None:
        for level in levels:
            sizes = {cls: size for cls in level if (size := self._sizes_by_class[cls][axis]) is not None}
            if sizes:
                cls, size = next(iter(sizes.items()))
                if any(other != size for other in sizes.values()):
                    self._warn(classes[0], axis, f"{' and '.join(sizes)} disagree", f"that of {cls} is used")
                return size
        return None

    def _warn(self, cls: Iri, axis: int, problem: str, action: str) -> None:
        self._report(Severity.WARNING, cls, SIZE[axis].property, problem, action)


def read_size(
    reader: SubjectReader, classes: tuple[Iri, ...], *, all_classes: ClassSizes, map_classes: ClassSizes
) -> Vector | None:
    """The size of a body; None if not all three extents are known, and the statements remain facts then.

    Args:
        reader: the statements about the body.
        classes: its classes, the most specific first.
        all_classes: the sizes that all sources state for classes.
        map_classes: the sizes that the class resources of the world state.
    """
    if any(reader.is_marked_untold(codec.property) for codec in SIZE):
        if None not in _effective_size(reader, map_classes.get(classes)):
            reader.consume_untold_mark(SIZE[0].property)
        return None
    own = [reader.read(codec, keep_if=lambda _: True) for codec in SIZE]
    x, y, z = (
        inherited if extent is None else extent for extent, inherited in zip(own, all_classes.get(classes), strict=True)
    )
    if x is None or y is None or z is None:
        missing = [codec.property for codec, extent in zip(SIZE, (x, y, z), strict=True) if extent is None]
        if len(missing) < len(SIZE):
            reader.warn(missing[0], "its size is incomplete", "it has no size")
        return None
    for codec, inherited in zip(SIZE, map_classes.get(classes), strict=True):
        reader.read(codec, keep_if=lambda extent, inherited=inherited: extent == inherited)  # type: ignore[misc]
    return x, y, z


def write_size(writer: SubjectWriter, classes: tuple[Iri, ...], size: Vector | None, map_classes: ClassSizes) -> None:
    """Writes the extents that differ from those of the classes."""
    inherited = map_classes.get(classes)
    if size is None:
        if None not in _effective_size(writer, inherited):
            writer.add_reference(UNTOLD, SIZE[0].property)
        return
    for codec, extent, given in zip(SIZE, size, _effective_size(writer, inherited), strict=True):
        if extent != given:
            writer.write(codec, extent)


def _effective_size(reader_or_writer: SubjectWriter | SubjectReader, inherited: PartialSize) -> PartialSize:
    """The extents that a reader would find in the statements so far, ignoring `ms:untold`."""
    x, y, z = (
        given if extent is None else extent
        for extent, given in zip((reader_or_writer.first_value(codec) for codec in SIZE), inherited, strict=True)
    )
    return x, y, z
