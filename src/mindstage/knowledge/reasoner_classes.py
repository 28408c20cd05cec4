"""Class axioms: subclasses, restrictions, definitions and disjointness, updated statement by statement.

The axioms that follow from each statement are counted, so that statements can be added and removed in any order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.owl import (
    EXPRESSION_PROPERTIES,
    ClassExpressionParser,
    ComplementOf,
    Expression,
    IntersectionOf,
    NamedClass,
    OneOf,
    Restriction,
    RestrictionType,
    UnionOf,
    named_classes,
)
from mindstage.rdf.taxonomy import TransitiveClosure
from mindstage.rdf.vocabulary import EQUIVALENT_CLASS, OWL, SUBCLASS_OF
from mindstage.scene import Iri

__all__ = [
    "CLASS_AXIOM_PROPERTIES",
    "Axiom",
    "ClassAxioms",
    "ClassRestriction",
    "QuadsByPredicate",
    "SufficientCondition",
    "discard_from_group",
]

_DISJOINT = Iri(OWL + "disjointWith")
CLASS_AXIOM_PROPERTIES = frozenset({SUBCLASS_OF, EQUIVALENT_CLASS, _DISJOINT, *EXPRESSION_PROPERTIES})
"""The properties of statements about classes."""

QuadsByPredicate = Callable[[str], Iterable[ox.Quad]]
"""Returns all statements with a predicate, of the store or of one graph."""


class ClassRestriction(msgspec.Struct, frozen=True, tag=True):
    """A restriction on all members of a class."""

    cls: Iri
    restriction: Restriction


class SubClassEdge(msgspec.Struct, frozen=True, tag=True):
    """A class and a direct superclass of it."""

    subclass: Iri
    superclass: Iri


class SufficientCondition(msgspec.Struct, frozen=True, tag=True):
    """An expression whose instances are members of the class."""

    cls: Iri
    expression: Expression


class DisjointClasses(msgspec.Struct, frozen=True, tag=True):
    """Two classes without common members."""

    first: Iri
    second: Iri


Axiom = ClassRestriction | SubClassEdge | SufficientCondition | DisjointClasses


class ClassAxioms:
    """The classes, restrictions and definitions of a triple store."""

    def __init__(self, asserted: QuadsByPredicate) -> None:
        """Reads all axioms."""
        self.class_closure: TransitiveClosure[Iri] = TransitiveClosure()
        self.sufficient_conditions: dict[SufficientCondition, None] = {}
        """The definitions that make individuals members, besides plain subclasses."""
        self.parser = ClassExpressionParser()
        self._axioms_by_triple: dict[ox.Triple, tuple[Axiom, ...]] = {}
        self._counts: dict[Axiom, int] = {}
        self._by_class: dict[Iri, dict[ClassRestriction, None]] = {}
        self._sorted_cache: dict[tuple[int, object], Sequence[ClassRestriction]] = {}
        self._by_property_and_filler: dict[tuple[Iri, Iri], dict[ClassRestriction, None]] = {}
        self._by_filler: dict[Iri, dict[ClassRestriction, None]] = {}
        self._by_property: dict[Iri, dict[ClassRestriction, None]] = {}
        self._disjoint: dict[Iri, dict[Iri, None]] = {}
        self._merged_names: dict[Iri, None] = {}
        """The names in the statements of merged axioms."""
        self.is_merged = False
        """Whether axioms were merged, whose statements are not known."""
        self.add(asserted)

    def add(self, asserted: QuadsByPredicate) -> bool:
        """Adds statements; returns False if they change existing expressions, so that everything must be read again."""
        if self.is_merged:
            added = ClassAxioms(asserted)
            self.merge(added.axioms, added.parser, added.names())
            return True
        is_new = self.parser.add(quad for property in EXPRESSION_PROPERTIES for quad in asserted(property))
        if is_new:
            for property in (SUBCLASS_OF, EQUIVALENT_CLASS, _DISJOINT):
                for quad in asserted(property):
                    self._add_axioms(quad.triple, self._axioms_of(quad.triple))
            self.add_definitions()
        return is_new

    def merge(self, axioms: Iterable[Axiom], parser: ClassExpressionParser, names: Iterable[Iri]) -> None:
        """Adds axioms without the statements that they follow from; later, statements can be added but not removed.

        Args:
            parser: has the fillers and restricted properties of their statements.
            names: the names in their statements.
        """
        self.is_merged = True
        for axiom in axioms:
            if axiom not in self._counts:
                self._assert_axiom(axiom)
        self._merged_names.update(dict.fromkeys(names))
        self.parser.restricted_properties |= parser.restricted_properties
        self.parser.fillers |= parser.fillers

    @property
    def axioms(self) -> Iterable[Axiom]:
        """All axioms."""
        return self._counts.keys()

    def add_definitions(self) -> None:
        """Adds the named classes that are class expressions themselves."""
        for cls, expression in self.parser.definitions():
            # Several statements make up a definition; its key is a triple that does not occur in any source.
            key = ox.Triple(ox.NamedNode(cls), ox.NamedNode(OWL + "definition"), ox.Literal(repr(expression)))
            self._add_axioms(
                key, (*_subclass_axioms(NamedClass(cls), expression), *_subclass_axioms(expression, NamedClass(cls)))
            )

    def update(self, triple: ox.Triple, *, is_asserted: bool) -> None:
        """Adds or removes the axioms that follow from a statement about classes."""
        if is_asserted:
            self._add_axioms(triple, self._axioms_of(triple))
        else:
            for axiom in self._axioms_by_triple.pop(triple, ()):
                self._retract_axiom(axiom)

    # -- look-up -------------------------------------------------------------------------------------------------------

    def own_restrictions(self, cls: Iri) -> Sequence[Restriction]:
        """The restrictions of a class, without inherited ones."""
        return [owned.restriction for owned in self._sorted_group(self._by_class, cls)]

    def restricted_classes(self) -> list[Iri]:
        """The classes with restrictions of their own."""
        return sorted(self._by_class)

    def class_restrictions(self, cls: Iri) -> Sequence[ClassRestriction]:
        """The restrictions of a class, without inherited ones, as `ClassRestriction`."""
        return self._sorted_group(self._by_class, cls)

    def restrictions_with_filler(self, property: Iri, cls: Iri) -> Sequence[ClassRestriction]:
        """Restrictions of exactly this property to a class."""
        return self._sorted_group(self._by_property_and_filler, (property, cls))

    def restrictions_on(self, property: Iri) -> Sequence[ClassRestriction]:
        """Restrictions of exactly this property, not of its inverse."""
        return self._sorted_group(self._by_property, property)

    def disjoint_with(self, cls: Iri) -> Iterable[Iri]:
        """The classes that are asserted to have no common member with a class."""
        return self._disjoint.get(cls, ())

    def names(self) -> Iterator[Iri]:
        """All names that may be those of classes."""
        nodes = (node for triple in self._axioms_by_triple for node in (triple.subject, triple.object))
        yield from (Iri(node.value) for node in nodes if isinstance(node, ox.NamedNode))
        yield from self._merged_names
        yield from self.parser.names()

    def __contains__(self, cls: object) -> bool:
        """Whether the class has an axiom."""
        return (
            cls in self.class_closure
            or cls in self._by_class
            or cls in self._disjoint
            or cls in self._by_filler
            or cls in self.parser.fillers
            or any(condition.cls == cls for condition in self.sufficient_conditions)
        )

    def _sorted_group(
        self, groups: Mapping[Any, dict[ClassRestriction, None]], key: object
    ) -> Sequence[ClassRestriction]:
        if key not in groups:
            return ()
        place = id(groups), key
        if place not in self._sorted_cache:
            self._sorted_cache[place] = sorted(groups[key], key=_sort_key)
        return self._sorted_cache[place]

    # -- axioms --------------------------------------------------------------------------------------------------------

    def _axioms_of(self, triple: ox.Triple) -> Iterator[Axiom]:
        one, other = self.parser.parse(triple.subject), self.parser.parse(triple.object)
        if triple.predicate.value == _DISJOINT:
            yield from _disjoint_axioms(one, other)
            return
        yield from _subclass_axioms(one, other)
        if triple.predicate.value == EQUIVALENT_CLASS:
            yield from _subclass_axioms(other, one)

    def _add_axioms(self, key: ox.Triple, axioms: Iterable[Axiom]) -> None:
        if key not in self._axioms_by_triple:
            self._axioms_by_triple[key] = tuple(dict.fromkeys(axioms))
            for axiom in self._axioms_by_triple[key]:
                self._assert_axiom(axiom)

    def _assert_axiom(self, axiom: Axiom) -> None:
        self._counts[axiom] = count = self._counts.get(axiom, 0) + 1
        if count > 1:
            return
        match axiom:
            case SubClassEdge(lower, upper):
                self.class_closure.add(lower, upper)
            case ClassRestriction(cls, restriction):
                self._sorted_cache.clear()
                self._by_class.setdefault(cls, {})[axiom] = None
                for groups, key in self._indexes_for(restriction):
                    groups.setdefault(key, {})[axiom] = None
            case SufficientCondition():
                self.sufficient_conditions[axiom] = None
            case DisjointClasses(one, other):
                self._disjoint.setdefault(one, {})[other] = None

    def _retract_axiom(self, axiom: Axiom) -> None:
        self._counts[axiom] -= 1
        if self._counts[axiom]:
            return
        del self._counts[axiom]
        match axiom:
            case SubClassEdge(lower, upper):
                self.class_closure.discard(lower, upper)
            case ClassRestriction(cls, restriction):
                self._sorted_cache.clear()
                discard_from_group(self._by_class, cls, axiom)
                for groups, key in self._indexes_for(restriction):
                    discard_from_group(groups, key, axiom)
            case SufficientCondition():
                del self.sufficient_conditions[axiom]
            case DisjointClasses(one, other):
                discard_from_group(self._disjoint, one, other)

    def _indexes_for(
        self, restriction: Restriction
    ) -> Iterator[tuple[dict[Any, dict[ClassRestriction, None]], object]]:
        """The indexes, with keys, that a restriction belongs to: by its property and by its fillers."""
        if restriction.inverse:
            return
        yield self._by_property, restriction.property
        for cls in (
            dict.fromkeys(named_classes(restriction.filler))
            if restriction.restriction_type is not RestrictionType.HAS_VALUE
            else ()
        ):
            yield self._by_property_and_filler, (restriction.property, cls)
            yield self._by_filler, cls


def _subclass_axioms(one: Expression, other: Expression) -> Iterator[Axiom]:
    """The axioms that follow if every instance of one expression is an instance of the other."""
    if isinstance(one, NamedClass):
        yield from _superclass_axioms(one.iri, other)
    if isinstance(other, NamedClass):
        yield from _sufficient_axioms(other.iri, one)


def _superclass_axioms(cls: Iri, expression: Expression) -> Iterator[Axiom]:
    match expression:
        case NamedClass(iri):
            yield SubClassEdge(cls, iri)
        case IntersectionOf(members):
            for member in members:
                yield from _superclass_axioms(cls, member)
        case Restriction():
            yield ClassRestriction(cls, expression)
        case ComplementOf(NamedClass() as other):
            yield from _disjoint_axioms(NamedClass(cls), other)


def _sufficient_axioms(cls: Iri, expression: Expression) -> Iterator[Axiom]:
    match expression:
        case NamedClass(iri):
            yield SubClassEdge(iri, cls)
        case UnionOf(members):
            for member in members:
                yield from _sufficient_axioms(cls, member)
        case IntersectionOf() | OneOf() | Restriction():
            yield SufficientCondition(cls, expression)


def _disjoint_axioms(one: Expression, other: Expression) -> Iterator[Axiom]:
    if isinstance(one, NamedClass) and isinstance(other, NamedClass):
        yield DisjointClasses(one.iri, other.iri)
        yield DisjointClasses(other.iri, one.iri)


def discard_from_group(groups: dict[Any, dict[Any, None]], key: object, item: object) -> None:
    """Removes an item from a group, and the group if it is empty."""
    group = groups.get(key, {})
    group.pop(item, None)
    if not group:
        groups.pop(key, None)


def _sort_key(restriction_of_class: ClassRestriction) -> tuple[str, str, str, str]:
    restriction = restriction_of_class.restriction
    return restriction_of_class.cls, restriction.property, restriction.restriction_type.value, repr(restriction)
