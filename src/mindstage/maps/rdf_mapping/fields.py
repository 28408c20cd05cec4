"""Fields of bodies that several statements make up: materials, attachments, tags and sizes.

Materials have terms of our own, since dialect 1 has none. Attachments are stated by the parent, the child or both. Tags
are the text "SemLog;Class,Cup;Id,c1;Other;k,v;": types, each followed by its pairs of key and value. That format has no
escapes; tags that it cannot express are written as JSON under a term of our own.

A size and a mesh are stated by the classes of a body, or by the body if they differ. What a body need not state itself
depends only on the classes that the world holds as resources, since those are written to the same file; a value from an
ontology is therefore written with the body, unless the map is written as its source states it.
"""

from __future__ import annotations

import json
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec

from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.maps.rdf_mapping.nested import sorted_facts
from mindstage.maps.rdf_mapping.properties import SIZE, PropertyCodec, SubjectReader, SubjectWriter, literal_text
from mindstage.rdf.graphs import FindingSink, Graph, Severity, find_forbidden_character
from mindstage.rdf.taxonomy import ClassHierarchy
from mindstage.rdf.vocabulary import (
    CHILD,
    EQUIVALENT_CLASS,
    FIRST,
    HAS_VALUE,
    INTERSECTION_OF,
    MATERIAL,
    ON_PROPERTY,
    OWL_CLASS,
    PARENT,
    REST,
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
    "ClassGeometry",
    "PartialSize",
    "map_class_geometry",
    "parse_tags",
    "read_materials",
    "read_mesh",
    "read_size",
    "read_tags",
    "write_materials",
    "write_mesh",
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


_CLASS_CODECS: Mapping[Iri, PropertyCodec[Any]] = {
    codec.property: codec for codec in (*SIZE, codecs.BOUNDING_BOX, codecs.MESH)
}
"""The properties whose values a class may give for its members."""
_CLASS_AXIOMS = (SUBCLASS_OF, EQUIVALENT_CLASS, INTERSECTION_OF)
_LIST_PROPERTIES = frozenset({INTERSECTION_OF, FIRST, REST})
_MAX_EXPRESSION_DEPTH = 200
"""The number of nodes of nested lists that are followed."""
_IS_CLASS = IriRef(OWL_CLASS)


def _superclasses(classes: Graph) -> Iterable[tuple[Iri, Iri]]:
    """Pairs of named class and superclass in the statements about classes."""
    for cls, facts in classes.items():
        for fact in facts:
            if fact.property not in _CLASS_AXIOMS:
                continue
            if isinstance(fact.value, IriRef) and not fact.value.iri.startswith("_:"):
                yield cls, fact.value.iri
                if fact.property == EQUIVALENT_CLASS:
                    yield fact.value.iri, cls
                continue
            for part in _expression_parts(fact.value, classes):
                for each in part:
                    if each.property == FIRST and isinstance(each.value, IriRef):
                        yield cls, each.value.iri


def map_class_geometry(resources: Iterable[NamedResource]) -> ClassGeometry:
    """The sizes and meshes that the class resources of one world state; a reader of its file finds the same."""
    classes = {resource.iri: resource.facts for resource in resources}

    def ignore(severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
        """The findings are reported when the source is read."""

    return ClassGeometry([classes], ClassHierarchy(_superclasses(classes)), ignore)


class ClassGeometry:
    """The extents and meshes of the members of classes; the nearest class that gives a value is used.

    A class gives a value by an `owl:hasValue` restriction above it or equivalent to it, also as a part of an
    intersection, or by a statement about itself.
    """

    def __init__(self, sources: Sequence[Graph], hierarchy: ClassHierarchy, report: FindingSink) -> None:
        """Reads the values.

        Args:
            sources: statements by class, in descending precedence; restrictions that several classes of a source share
                are subjects there, under their labels.
            report: receives findings about contradictions.
        """
        self._hierarchy = hierarchy
        self._report = report
        self._values: dict[Iri, dict[Iri, float | str]] = {}
        """By class, the values of the properties in `_CLASS_CODECS`."""
        self._cache: dict[tuple[Iri, ...], tuple[PartialSize, str | None]] = {}
        for source in sources:
            for cls, facts in source.items():
                self._read_class(cls, facts, source)

    def __len__(self) -> int:
        """The number of classes that give an extent."""
        return sum(any(codec.property in values for codec in SIZE) for values in self._values.values())

    def get(self, classes: tuple[Iri, ...]) -> PartialSize:
        """The extents of an individual of these classes; each axis is looked up separately."""
        return self._find(classes)[0]

    def mesh(self, classes: tuple[Iri, ...]) -> str | None:
        """The path of the mesh of an individual of these classes; None if no class gives one."""
        return self._find(classes)[1]

    def of(self, facts: Sequence[PropertyAssertion], classes: tuple[Iri, ...]) -> PartialSize:
        """The extents that statements about an individual of these classes give, and else the classes."""
        own = (codec.first_value(facts) for codec in SIZE)
        return _first_known(_first_known(own, codecs.BOUNDING_BOX.first_value(facts)), self.get(classes))

    def _read_class(self, cls: Iri, facts: Sequence[PropertyAssertion], source: Graph) -> None:
        own: list[PropertyAssertion] = []
        is_class = False
        for fact in facts:
            if fact.property in _CLASS_AXIOMS:
                is_class = True
                for part in _expression_parts(fact.value, source):
                    self._add_restriction(cls, part)
            elif fact.property in _CLASS_CODECS:
                own.append(fact)
            elif fact.value == _IS_CLASS:
                is_class = True
        for fact in own if is_class else ():
            self._add_value(cls, fact)

    def _add_restriction(self, cls: Iri, restriction: Sequence[PropertyAssertion]) -> None:
        for on in restriction:
            if on.property == ON_PROPERTY and isinstance(on.value, IriRef) and on.value.iri in _CLASS_CODECS:
                for part in restriction:
                    if part.property == HAS_VALUE:
                        self._add_value(cls, PropertyAssertion(on.value.iri, part.value))

    def _add_value(self, cls: Iri, given: PropertyAssertion) -> None:
        codec = _CLASS_CODECS[given.property]
        value = codec.decode(given.value)
        if value is None:
            what = "mesh" if codec is codecs.MESH else "size"
            self._warn(cls, codec.property, f"its value is not {codec.expected}", f"it gives no {what}")
            return
        row = zip((each.property for each in SIZE), value, strict=True) if isinstance(value, tuple) else ()
        for property, each in row or ((codec.property, value),):
            known = self._values.setdefault(cls, {}).setdefault(property, each)
            if known != each:
                self._warn(cls, property, f"it has two values: {known!r} and {each!r}", "the first is used")

    def _find(self, classes: tuple[Iri, ...]) -> tuple[PartialSize, str | None]:
        found = self._cache.get(classes)
        if found is None:
            levels = self._hierarchy.levels(classes) if self._values else ()
            known = [giving for level in levels if (giving := [cls for cls in level if cls in self._values])]
            x, y, z, mesh = (self._nearest(codec.property, classes, known) for codec in (*SIZE, codecs.MESH))
            found = self._cache[classes] = (x, y, z), mesh
        return found

    def _nearest(self, property: Iri, classes: tuple[Iri, ...], levels: Iterable[Sequence[Iri]]) -> Any:
        for level in levels:
            values = {cls: self._values[cls][property] for cls in level if property in self._values[cls]}
            if values:
                cls, value = next(iter(values.items()))
                if any(other != value for other in values.values()):
                    self._warn(classes[0], property, f"{' and '.join(values)} disagree", f"that of {cls} is used")
                return value
        return None

    def _warn(self, cls: Iri, property: Iri, problem: str, action: str) -> None:
        self._report(Severity.WARNING, cls, property, problem, action)


def _expression_parts(value: FactValue, source: Graph, depth: int = 0) -> Iterator[Sequence[PropertyAssertion]]:
    """The statements about an anonymous class, and about those that it is the intersection of."""
    if isinstance(value, BlankNode):
        facts: Sequence[PropertyAssertion] = value.facts
    elif isinstance(value, IriRef) and value.iri.startswith("_:"):
        facts = source.get(value.iri, ())
    else:
        return
    yield facts
    for fact in facts:
        if fact.property in _LIST_PROPERTIES and depth < _MAX_EXPRESSION_DEPTH:
            yield from _expression_parts(fact.value, source, depth + 1)


def read_size(
    reader: SubjectReader, classes: tuple[Iri, ...], *, all_classes: ClassGeometry, map_classes: ClassGeometry
) -> Vector | None:
    """The size of a body; None if not all three extents are known, and the statements remain facts then.

    Args:
        reader: the statements about the body.
        classes: its classes, the most specific first.
        all_classes: what all sources state for classes.
        map_classes: what the class resources of the world state.
    """
    if any(reader.is_marked_untold(codec.property) for codec in SIZE):
        if None not in _effective_size(reader, map_classes.get(classes)):
            reader.consume_untold_mark(SIZE[0].property)
        return None
    box = reader.read(codecs.BOUNDING_BOX, keep_if=lambda _: True)
    own = [reader.read(codec, keep_if=lambda _: True) for codec in SIZE]
    x, y, z = _first_known(_first_known(own, box), all_classes.get(classes))
    if x is None or y is None or z is None:
        missing = [codec.property for codec, extent in zip(SIZE, (x, y, z), strict=True) if extent is None]
        if len(missing) < len(SIZE):
            reader.warn(missing[0], "its size is incomplete", "it has no size")
        return None
    for codec, inherited in zip(SIZE, box or map_classes.get(classes), strict=True):
        reader.read(codec, keep_if=lambda extent, inherited=inherited: extent == inherited)  # type: ignore[misc]
    return x, y, z


def read_mesh(
    reader: SubjectReader, classes: tuple[Iri, ...], *, all_classes: ClassGeometry, map_classes: ClassGeometry
) -> str | None:
    """The path of the mesh of a body; see `read_size`."""
    inherited = map_classes.mesh(classes)
    if reader.is_marked_untold(codecs.MESH.property):
        if inherited is not None or reader.first_value(codecs.MESH) is not None:
            reader.consume_untold_mark(codecs.MESH.property)
        return None
    mesh = reader.read(codecs.MESH, keep_if=lambda path: path == inherited)
    return all_classes.mesh(classes) if mesh is None else mesh


def write_mesh(writer: SubjectWriter, classes: tuple[Iri, ...], mesh: str | None, map_classes: ClassGeometry) -> None:
    """Writes a mesh that differs from that of the classes."""
    inherited = map_classes.mesh(classes)
    if writer.first_value(codecs.MESH) is not None or mesh != inherited:
        if mesh is None and inherited is not None:
            writer.add_reference(UNTOLD, codecs.MESH.property)
        else:
            writer.write(codecs.MESH, mesh)


def write_size(
    writer: SubjectWriter, classes: tuple[Iri, ...], size: Vector | None, map_classes: ClassGeometry
) -> None:
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
    own = (reader_or_writer.first_value(codec) for codec in SIZE)
    return _first_known(_first_known(own, reader_or_writer.first_value(codecs.BOUNDING_BOX)), inherited)


def _first_known(extents: Iterable[float | None], others: Iterable[float | None] | None) -> PartialSize:
    """The extents, and where one is unknown, the other one."""
    x, y, z = (
        other if extent is None else extent for extent, other in zip(extents, others or (None, None, None), strict=True)
    )
    return x, y, z
