"""The index: classes, restrictions and individuals of a store, arranged so that questions are look-ups.

It is made when the first question comes. From then on it is told of each change, and looks again at just what that
concerns; the statements about individuals stay in the store, where they are looked up.

Two names are two things here: that they are the same (owl:sameAs, and what follows from properties that have one value
only) is found by `KnowledgeBase.derive`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.reading.other_words import dul, soma
from mindstage.knowledge.reasoning.axioms import CLASS_AXIOM_PROPERTIES, ClassAxioms, ClassRestriction
from mindstage.knowledge.reasoning.chains import PropertyExpression
from mindstage.knowledge.reasoning.derivation import InferredTriples
from mindstage.knowledge.reasoning.expressions import (
    EXPRESSION_PROPERTIES,
    ComplementOf,
    Expression,
    IntersectionOf,
    NamedClass,
    UnionOf,
    node_label,
)
from mindstage.knowledge.reasoning.individuals import PROPERTY_TYPE_IRIS, IndividualIndex
from mindstage.knowledge.reasoning.membership import InferenceRule, InstanceChecker, Justification
from mindstage.knowledge.reasoning.properties import (
    PROPERTY_AXIOM_PROPERTIES,
    PROPERTY_TYPES,
    InferenceStep,
    ObjectTriple,
    PropertyHierarchy,
)
from mindstage.knowledge.stores.triplestore import QuadSource
from mindstage.knowledge.taxonomy import TransitiveClosure
from mindstage.knowledge.vocabulary import (
    CHILD,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    OWL_CLASS,
    PARENT,
    TYPE,
    XSD,
    knowrob,
)
from mindstage.world import Iri

__all__ = ["PartOfStep", "Reasoner"]

_PART_PROPERTIES = (
    CHILD,
    *map(knowrob, ("parts", "physicalParts", "properPhysicalParts")),
    *map(dul, ("hasPart", "hasComponent")),
)
_PART_OF_PROPERTIES = (PARENT, *map(dul, ("isPartOf", "isComponentOf")))
_PART_EXPRESSIONS: tuple[PropertyExpression, ...] = (
    *((word, True) for word in (*_PART_PROPERTIES, soma("hasPhysicalComponent"))),
    *((word, False) for word in (*_PART_OF_PROPERTIES, soma("isPhysicalComponentOf"))),
)


class PartOfStep(msgspec.Struct, frozen=True):
    """A thing that another one is made of, or is a part of."""

    individual: Iri
    depth: int
    path: tuple[ObjectTriple, ...]
    """The statements on the way there."""


class Reasoner:
    """What follows from a store, as it stands now."""

    def __init__(self, store: QuadSource) -> None:
        """Reads classes, restrictions, types and maps; everything else is looked up when it is asked for."""
        self._inferred = InferredTriples(store)
        self._store = self._inferred.asserted()
        self.axioms = ClassAxioms(self._quads_with_predicate)
        self.individuals = IndividualIndex(self._quads_with_predicate)
        self._sorted_members: dict[Iri, Sequence[Iri]] = {}
        self._class_cache: dict[Iri, Iri | None] = {}

    @property
    def classes(self) -> TransitiveClosure[Iri]:
        """Who is below whom."""
        return self.axioms.class_closure

    @property
    def types(self) -> dict[Iri, tuple[Iri, ...]]:
        """The classes of individuals, as told."""
        return self.individuals.types

    @property
    def members_by_map(self) -> dict[Iri, dict[Iri, None]]:
        """By map, who is described in it."""
        return self.individuals.members_by_map

    @property
    def maps_of(self) -> dict[Iri, tuple[Iri, ...]]:
        """By individual, the maps that it is described in."""
        return self.individuals.maps_of

    @cached_property
    def properties(self) -> PropertyHierarchy:
        """How properties follow from one another."""
        return PropertyHierarchy(self._store, self.axioms.parser, self._inferred)

    @cached_property
    def instance_checker(self) -> InstanceChecker:
        """The classes that follow for individuals."""
        return InstanceChecker(self, self._store, self._inferred)

    # -- change --------------------------------------------------------------------------------------------------------

    def add_graph(self, graph: ox.NamedNode) -> set[Iri]:
        """Takes in a graph that has been added to the store, and gives the names that came up."""
        told = {
            word: list(self._store.quads_for_pattern(None, ox.NamedNode(word), None, graph))
            for word in (TYPE, DESCRIBED_IN_MAP, *CLASS_AXIOM_PROPERTIES, *PROPERTY_AXIOM_PROPERTIES)
        }
        if not self.axioms.add(told.__getitem__):
            self.axioms = ClassAxioms(self._quads_with_predicate)
        self.individuals.add(told.__getitem__)
        self._drop_cached("properties", "membership")
        nodes = (node for quads in told.values() for quad in quads for node in (quad.subject, quad.object))
        return {Iri(node.value) for node in nodes if isinstance(node, ox.NamedNode)}

    def update(self, quads: Iterable[ox.Quad]) -> bool:
        """Looks again at what statements are about that have been added to the store, or removed from it.

        Returns:
            Whether what is known of classes has changed.
        """
        quads = list(quads)
        words = {quad.predicate.value for quad in quads}
        of_classes = not CLASS_AXIOM_PROPERTIES.isdisjoint(words)
        anew = of_classes and not self._update_classes(
            [q for q in quads if q.predicate.value in CLASS_AXIOM_PROPERTIES]
        )
        subjects = (quad.subject for quad in quads if quad.predicate.value in {TYPE, DESCRIBED_IN_MAP})
        for node in dict.fromkeys(subjects):
            if name := node_label(node):
                self.individuals.update(name, self._objects(node, TYPE), self._objects(node, DESCRIBED_IN_MAP))
        becomes = {quad.object.value for quad in quads if isinstance(quad.object, ox.NamedNode)}
        if anew or not (PROPERTY_AXIOM_PROPERTIES.isdisjoint(words) and PROPERTY_TYPES.isdisjoint(becomes)):
            self._drop_cached("properties", "membership")
        elif of_classes or TYPE in words or DESCRIBED_IN_MAP in words or self._affects_membership(quads):
            self._drop_cached("membership")
        if "properties" in self.__dict__:
            self.properties.clear_usage_cache()
        return of_classes

    def _affects_membership(self, quads: Sequence[ox.Quad]) -> bool:
        """Whether the classes that were found to follow for individuals may be others now."""
        return "membership" in self.__dict__ and self.instance_checker.is_affected_by(quads)

    def _update_classes(self, quads: Sequence[ox.Quad]) -> bool:
        """Takes in statements about classes; False where expressions have changed, and all was read anew."""
        there = [self._is_asserted(quad) for quad in quads]
        built = [
            (quad, told)
            for quad, told in zip(quads, there, strict=True)
            if quad.predicate.value in EXPRESSION_PROPERTIES
        ]
        if not all(told for _, told in built) or not self.axioms.parser.add(quad for quad, _ in built):
            self.axioms = ClassAxioms(self._quads_with_predicate)
            return False
        self.axioms.add_definitions()
        for quad, is_told in zip(quads, there, strict=True):
            if quad.predicate.value not in EXPRESSION_PROPERTIES:
                self.axioms.update(quad.triple, is_asserted=is_told)
        return True

    def _is_asserted(self, quad: ox.Quad) -> bool:
        """Whether some graph has the statement."""
        told = self._store.quads_for_pattern(quad.subject, quad.predicate, quad.object)
        return next(iter(told), None) is not None

    def _drop_cached(self, *names: str) -> None:
        for name in names:
            self.__dict__.pop(name, None)
        self._sorted_members, self._class_cache = {}, {}

    def _quads_with_predicate(self, property: str) -> Iterator[ox.Quad]:
        return self._store.quads_for_pattern(None, ox.NamedNode(property), None)

    def _objects(self, node: ox.NamedNode | ox.BlankNode | ox.Triple, property: Iri) -> list[object]:
        return [quad.object for quad in self._store.quads_for_pattern(node, ox.NamedNode(property), None)]

    # -- classes -------------------------------------------------------------------------------------------------------

    def is_a(self, cls: Iri, ancestor: Iri) -> bool:
        """Whether one class is the other or below it."""
        return ancestor in self.classes.above(cls)

    def are_disjoint(self, first: Iri, second: Iri) -> bool:
        """Whether nothing can be of both classes: they, or two classes above them, are told to be disjoint."""
        others = self.classes.above(second)
        return any(each in others for above in self.classes.above(first) for each in self.axioms.disjoint_with(above))

    def restrictions(self, cls: Iri) -> Iterator[ClassRestriction]:
        """What a class says itself, then what it inherits, the nearest first."""
        for owner in self.classes.above(cls):
            yield from self.axioms.class_restrictions(owner)

    def restricted_classes(self) -> Iterable[Iri]:
        """Classes that say something themselves."""
        return self.axioms.restricted_classes()

    def restrictions_with_filler(self, property: Iri, cls: Iri) -> Iterator[ClassRestriction]:
        """What classes say of a class by a property, or one that implies it; what they inherit is not repeated."""
        for sub in self.properties.sub_properties(property):
            yield from self.axioms.restrictions_with_filler(sub, cls)

    def restrictions_on(self, property: Iri) -> Iterator[ClassRestriction]:
        """What all classes say by a property, or one that implies it."""
        for sub in self.properties.sub_properties(property):
            yield from self.axioms.restrictions_on(sub)

    def subsuming_class(self, expression: Expression | None, cls: Iri) -> Iri | None:
        """The class for which another one falls under an expression: the nearest of a union's, the farthest of all.

        None where it does not fall under it.
        """
        match expression:
            case NamedClass(iri):
                return iri if self.is_a(cls, iri) else None
            case UnionOf(members):
                reasons = [reason for member in members if (reason := self.subsuming_class(member, cls))]
                return min(reasons, key=lambda reason: self.classes.count_between(cls, reason), default=None)
            case IntersectionOf(members):
                all_reasons = [self.subsuming_class(member, cls) for member in members]
                met = [reason for reason in all_reasons if reason]
                if len(met) < len(all_reasons):
                    return None
                return max(met, key=lambda reason: self.classes.count_between(cls, reason), default=None)
            case ComplementOf(NamedClass(iri)):
                return cls if self.are_disjoint(cls, iri) else None
            case _:
                return None

    # -- individuals ---------------------------------------------------------------------------------------------------

    def members(self, cls: Iri, map: Iri | None = None) -> list[Iri]:
        """Individuals of a class and of those below it, each once; of one map, or of all and none."""
        found: dict[Iri, None] = {}
        for below in self.classes.below(cls):
            told = (
                self.individuals.members.get(below)
                if map is None
                else self.individuals.members_by_map_and_class.get((map, below))
            )
            if told:
                found |= told
            for individual in self.instance_checker.members(below):
                if map is None or map in self.maps_of.get(individual, ()):
                    found[individual] = None
        return sorted(found)

    def is_member(self, individual: Iri, cls: Iri) -> bool:
        """Whether an individual is of a class."""
        classes = self.classes
        return any(cls in classes.above(told) for told in self.types_of(individual))

    def types_of(self, individual: Iri) -> tuple[Iri, ...]:
        """The classes that an individual is said to be of, and those that follow without their superclasses."""
        told = self.types.get(individual, ())
        grounds = self.instance_checker.justifications(individual)
        return told if not grounds else tuple(dict.fromkeys((*told, *sorted(grounds))))

    def justification(self, individual: Iri, cls: Iri) -> Justification | None:
        """Why an individual is of this very class, where nobody says so."""
        return (
            None if cls in self.types.get(individual, ()) else self.instance_checker.justifications(individual).get(cls)
        )

    def individuals_in(self, map: Iri, individual: Iri | None = None) -> Sequence[Iri]:
        """Who is described in a map, in one order; only this one, if it is."""
        if individual is not None:
            return [individual] if map in self.maps_of.get(individual, ()) else []
        if map not in self._sorted_members:
            self._sorted_members[map] = sorted(self.members_by_map.get(map, ()))
        return self._sorted_members[map]

    def class_of(self, individual: Iri) -> Iri | None:
        """The most special class that an individual is of; one that was derived only where nobody says any."""
        if individual not in self._class_cache:
            self._class_cache[individual] = self._most_specific_class(individual)
        return self._class_cache[individual]

    def _most_specific_class(self, individual: Iri) -> Iri | None:
        grounds = self.instance_checker.justifications(individual)
        types = self.types.get(individual, ())
        types = (
            *types,
            *(cls for cls, ground in grounds.items() if not types or ground.rule is not InferenceRule.OWL_RL),
        )
        if len(types) < 2:
            return types[0] if types else None
        return max(types, key=lambda cls: (len(self.classes.above(cls)), cls))

    def is_individual(self, iri: Iri) -> bool:
        """Whether something is told of an individual: a class or a map."""
        individuals = self.individuals
        return iri in individuals.types or iri in individuals.maps_of or iri in individuals.anonymous_types

    def is_class(self, iri: Iri) -> bool:
        """Whether it is the name of a class."""
        if iri in self.individuals.declared[OWL_CLASS] or iri in self.individuals.members:
            return not iri.startswith("_:")
        if iri.startswith(("_:", XSD)):
            return False
        return iri in self.axioms or self.properties.is_domain_or_range(iri) or bool(self.instance_checker.members(iri))

    def is_property(self, iri: Iri) -> bool:
        """Whether it is the name of a property."""
        declared = any(iri in self.individuals.declared[kind] for kind in PROPERTY_TYPE_IRIS)
        return declared or iri in self.axioms.parser.restricted_properties or iri in self.properties

    def declared_classes(self) -> Iterator[Iri]:
        """Every class that has a name."""
        return (name for name in dict.fromkeys(self.all_names()) if self.is_class(name))

    def all_names(self) -> Iterator[Iri]:
        """Every name of an individual, a class or a property, some of them more than once."""
        individuals = self.individuals
        yield from (*individuals.types, *individuals.maps_of, *individuals.anonymous_types, *individuals.members_by_map)
        yield from individuals.members
        for declared in individuals.declared.values():
            yield from declared
        yield from self.axioms.names()
        yield from self.properties.all_names()

    # -- parts ---------------------------------------------------------------------------------------------------------

    def parts(self, whole: Iri, *, through_joints: bool = False) -> Iterator[PartOfStep]:
        """All that a thing is made of, to any depth, the nearest first; it is no part of itself, even in a circle.

        Args:
            whole: the thing.
            through_joints: whether the second of two things that a constraint joins counts as a part of the first, and
                the constraint as one between them.
        """
        return self._walk_parts(whole, backwards=False, through_joints=through_joints)

    def wholes(self, part: Iri, *, through_joints: bool = False) -> Iterator[PartOfStep]:
        """All that a thing is a part of, the nearest first."""
        return self._walk_parts(part, backwards=True, through_joints=through_joints)

    def _walk_parts(self, start: Iri, *, backwards: bool, through_joints: bool) -> Iterator[PartOfStep]:
        seen = {start}
        waiting = [PartOfStep(start, 0, ())]
        for derived in (False, True) if self._inferred else (False,):  # what is told says more of the way
            for here in waiting:
                steps = self._part_steps(here.individual, backwards=backwards, inferred=derived)
                for thing, way in sorted(steps, key=lambda step: step[0]):
                    if thing not in seen and (through_joints or not self._is_joint_path(way)):
                        seen.add(thing)
                        waiting.append(PartOfStep(thing, here.depth + 1, (*here.path, *way)))
                        yield waiting[-1]

    def _is_joint_path(self, path: Sequence[ObjectTriple]) -> bool:
        """Whether a constraint says it: with the words for wholes and parts it names the two things that it joins."""
        return any(self.is_member(statement.subject, CONSTRAINT) for statement in path)

    def _part_steps(self, individual: Iri, *, backwards: bool, inferred: bool) -> Iterator[InferenceStep]:
        steps = self.properties.inferred_steps if inferred else self.properties.steps
        return steps(_PART_EXPRESSIONS, individual, backwards=backwards)
