"""The reasoner: the classes, restrictions and individuals of a triple store, indexed for the questions.

It is built for the first question, and then updated with each change. Statements about individuals stay in the store
and are looked up there. The asserted classes of individuals are completed by inference: from definitions, from
anonymous types, and for individuals without a type from the domains and ranges of their properties.

Different names are different individuals here; that two are the same (owl:sameAs, functional properties) is only found
by `KnowledgeBase.materialize`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from enum import StrEnum
from functools import cached_property, partial

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.owl import (
    EXPRESSION_PROPERTIES,
    LIST_PROPERTIES,
    ComplementOf,
    Expression,
    IntersectionOf,
    LiteralValue,
    NamedClass,
    OneOf,
    Restriction,
    RestrictionType,
    UnionOf,
    node_label,
)
from mindstage.knowledge.owl_rl import InferredTriples
from mindstage.knowledge.reasoner_classes import (
    CLASS_AXIOM_PROPERTIES,
    ClassAxioms,
    ClassRestriction,
    QuadsByPredicate,
    SufficientCondition,
    discard_from_group,
)
from mindstage.knowledge.reasoner_properties import (
    PROPERTY_AXIOM_PROPERTIES,
    PROPERTY_TYPES,
    InferenceStep,
    ObjectTriple,
    PropertyExpression,
    PropertyHierarchy,
)
from mindstage.maps.rdf_mapping.nested import NESTED_RESOURCES
from mindstage.rdf.graphs import QuadSource, node_to_look_up, quads_with_property
from mindstage.rdf.taxonomy import TransitiveClosure
from mindstage.rdf.vocabulary import (
    CHILD,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    OWL,
    OWL_CLASS,
    PARENT,
    RDF,
    RDFS,
    SEMANTIC_MAP,
    TYPE,
    XSD,
    dul,
    knowrob,
    soma,
    xsd,
)
from mindstage.scene import Iri

__all__ = [
    "PROPERTY_TYPE_IRIS",
    "IndividualIndex",
    "InferenceRule",
    "InstanceChecker",
    "Justification",
    "PartOfStep",
    "Reasoner",
]


_PROPERTY_TYPE_NAMES = "Object Datatype Annotation Functional InverseFunctional Transitive Symmetric"
PROPERTY_TYPE_IRIS = (Iri(RDF + "Property"), *(Iri(f"{OWL}{kind}Property") for kind in _PROPERTY_TYPE_NAMES.split()))
_DECLARATION_TYPES = frozenset({OWL_CLASS, *PROPERTY_TYPE_IRIS})
_PART_CLASSES = frozenset(part.cls for part in NESTED_RESOURCES)


ProofStatements = tuple[ObjectTriple, ...]
_NO_JUSTIFICATIONS: Mapping[Iri, Justification] = {}
_PART_PROPERTIES = (
    CHILD,
    *map(knowrob, ("parts", "physicalParts", "properPhysicalParts")),
    *map(dul, ("hasPart", "hasComponent")),
)
_PART_OF_PROPERTIES = (PARENT, *map(dul, ("isPartOf", "isComponentOf")))
_PART_EXPRESSIONS: tuple[PropertyExpression, ...] = (
    *((property, True) for property in (*_PART_PROPERTIES, soma("hasPhysicalComponent"))),
    *((property, False) for property in (*_PART_OF_PROPERTIES, soma("isPhysicalComponentOf"))),
)


class IndividualIndex:
    """The asserted types and maps of individuals."""

    def __init__(self, asserted: QuadsByPredicate) -> None:
        """Reads all type and map statements."""
        self.types: dict[Iri, tuple[Iri, ...]] = {}
        """By individual, sorted; without the classes of OWL, RDFS and RDF."""
        self.anonymous_types: dict[Iri, dict[ox.BlankNode, None]] = {}
        """Class expressions without a name, by individual."""
        self.members: dict[Iri, dict[Iri, None]] = {}
        """By class, as asserted."""
        self.declared: dict[Iri, dict[Iri, None]] = {kind: {} for kind in _DECLARATION_TYPES}
        """Classes and properties, by the type of their declaration."""
        self.members_by_map: dict[Iri, dict[Iri, None]] = {}
        """By map; the poses and limits of individuals are not counted as individuals."""
        self.maps_of: dict[Iri, tuple[Iri, ...]] = {}
        self.untyped: dict[Iri, None] = {}
        """Individuals of a map that have no type."""
        self._members_by_map_and_class: dict[tuple[Iri, Iri], dict[Iri, None]] | None = None
        self.nested_resources: dict[Iri, tuple[Iri, ...]] = {}
        """The maps of resources that only belong to another individual, such as poses."""
        self.add(asserted)

    @property
    def members_by_map_and_class(self) -> dict[tuple[Iri, Iri], dict[Iri, None]]:
        """By map and class, as asserted; made at the first use and then updated."""
        if self._members_by_map_and_class is None:
            groups: dict[tuple[Iri, Iri], dict[Iri, None]] = {}
            for individual, maps in self.maps_of.items():
                for cls in self.types.get(individual, ()):
                    for map in maps:
                        groups.setdefault((map, cls), {})[individual] = None
            self._members_by_map_and_class = groups
        return self._members_by_map_and_class

    def add(self, asserted: QuadsByPredicate) -> None:
        """Adds more statements."""
        touched: dict[Iri, None] = {}
        for quad in asserted(TYPE):
            self._add_type(quad.subject, quad.object, touched)
        described: dict[Iri, list[object]] = {}
        for quad in asserted(DESCRIBED_IN_MAP):
            if individual := node_label(quad.subject):
                described.setdefault(individual, []).append(quad.object)
        for individual in touched:  # members of a map may have got another class
            if individual in self.maps_of or individual in self.nested_resources:
                described.setdefault(individual, [])
        for individual, maps in described.items():
            before = (*self.maps_of.get(individual, ()), *self.nested_resources.get(individual, ()))
            self._set_maps(individual, {*before, *_map_names(individual, maps)})

    def nested_maps(self, resource: Iri | None = None) -> Collection[Iri]:
        """The maps of a resource that only belongs to another individual, such as a pose; of all of them, if None."""
        if resource is not None:
            return self.nested_resources.get(resource, ())
        return {map for maps in self.nested_resources.values() for map in maps}

    def update(self, individual: Iri, types: Iterable[object], maps: Iterable[object]) -> None:
        """Replaces everything about an individual by its current types and maps."""
        self._set_maps(individual, ())
        for cls in self.types.pop(individual, ()):
            self._remove_from_class(cls, individual)
        self.anonymous_types.pop(individual, None)
        for declared in self.declared.values():
            declared.pop(individual, None)
        node = ox.BlankNode(individual[2:]) if individual.startswith("_:") else ox.NamedNode(individual)
        for each in types:
            self._add_type(node, each, {})
        self._set_maps(individual, set(_map_names(individual, maps)))

    def _add_type(self, subject: object, cls: object, touched: dict[Iri, None]) -> None:
        individual = node_label(subject)
        if individual is None:
            return
        if isinstance(cls, ox.BlankNode):
            self.anonymous_types.setdefault(individual, {})[cls] = None
        elif isinstance(cls, ox.NamedNode):
            name = Iri(cls.value)
            if name in _DECLARATION_TYPES:
                self.declared[name][individual] = None
            elif not name.startswith((OWL, RDFS, RDF)):
                self._add_to_class(name, individual)
                touched[individual] = None

    def _add_to_class(self, cls: Iri, individual: Iri) -> None:
        known = self.types.get(individual, ())
        if cls not in known:
            self.types[individual] = tuple(sorted((*known, cls))) if known else (cls,)
            self.members.setdefault(cls, {})[individual] = None
            if cls == SEMANTIC_MAP:
                self.members_by_map.setdefault(individual, {})

    def _remove_from_class(self, cls: Iri, individual: Iri) -> None:
        discard_from_group(self.members, cls, individual)
        if cls == SEMANTIC_MAP and not self.members_by_map[individual]:
            del self.members_by_map[individual]

    def _set_maps(self, individual: Iri, maps: Iterable[Iri]) -> None:
        """Replaces the maps of an individual, using its current classes."""
        types = self.types.get(individual, ())
        for map in self.maps_of.pop(individual, ()):
            self.members_by_map[map].pop(individual)
            if not self.members_by_map[map] and map not in self.members.get(SEMANTIC_MAP, ()):
                del self.members_by_map[map]
            for cls in types:
                discard_from_group(self.members_by_map_and_class, (map, cls), individual)
        self.untyped.pop(individual, None)
        self.nested_resources.pop(individual, None)
        if maps and types and _PART_CLASSES.issuperset(types):
            self.nested_resources[individual] = tuple(sorted(maps))
        elif maps:
            self._add_to_maps(individual, types, tuple(sorted(maps)))

    def _add_to_maps(self, individual: Iri, types: tuple[Iri, ...], maps: tuple[Iri, ...]) -> None:
        self.maps_of[individual] = maps
        if not types:
            self.untyped[individual] = None
        for map in maps:
            self.members_by_map.setdefault(map, {})[individual] = None
            for cls in types:
                self.members_by_map_and_class.setdefault((map, cls), {})[individual] = None


def _map_names(individual: Iri, maps: Iterable[object]) -> Iterator[Iri]:
    return (name for map in maps if (name := node_label(map)) and name != individual)


class InferenceRule(StrEnum):
    """How the class of an individual was inferred."""

    DOMAIN = "domain"
    RANGE = "range"
    DEFINITION = "definition"
    TYPE = "type"
    OWL_RL = "OWL 2 RL"


class Justification(msgspec.Struct, frozen=True):
    """Why an individual is a member of an inferred class."""

    cls: Iri
    rule: InferenceRule
    statements: ProofStatements
    property: Iri | None = None
    """The property whose domain or range the class is."""
    expression: Expression | None = None
    """The expression that the individual is an instance of, or its anonymous type."""


class InstanceChecker:
    """Infers the classes of individuals, for one state of a reasoner."""

    def __init__(self, reasoner: Reasoner, store: QuadSource, inferred: InferredTriples) -> None:
        """Applies all definitions to the individuals that may satisfy them, until nothing more follows."""
        self._reasoner = reasoner
        self._store = store
        self._inferred = inferred
        self._by_definition: dict[Iri, dict[Iri, Justification]] = {}
        self._by_domain_range: dict[Iri, dict[Iri, Justification]] = {}
        self._inferred_members: dict[Iri, dict[Iri, None]] = {}
        for individual in reasoner.individuals.anonymous_types:
            for expression in self._anonymous_types(individual):
                for cls in _conjunct_classes(expression):
                    self._add_member(individual, Justification(cls, InferenceRule.TYPE, (), expression=expression))
        while any(
            self._apply_condition(condition) for condition in sorted(reasoner.axioms.sufficient_conditions, key=repr)
        ):
            pass
        for individual in reasoner.individuals.untyped:
            for cls in self.justifications(individual):
                self._inferred_members.setdefault(cls, {})[individual] = None

    def members(self, cls: Iri) -> Iterable[Iri]:
        """Individuals that were inferred to be members of exactly this class."""
        members = self._inferred_members.get(cls, ())
        if not self._inferred:
            return members
        quads = self._inferred.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(cls))
        return dict.fromkeys((*members, *(name for quad in quads if (name := node_label(quad.subject)))))

    def justifications(self, individual: Iri) -> Mapping[Iri, Justification]:
        """The inferred classes of an individual, with their justifications."""
        justified = self._by_definition.get(individual, _NO_JUSTIFICATIONS)
        if individual not in self._reasoner.types and individual not in self._reasoner.individuals.anonymous_types:
            if individual not in self._by_domain_range:
                self._by_domain_range[individual] = {
                    each.cls: each for each in self._domain_range_justifications(individual)
                }
            justified = {**self._by_domain_range[individual], **justified}
        return {**self._owl_rl_justifications(individual, justified), **justified} if self._inferred else justified

    def _owl_rl_justifications(self, individual: Iri, known: Iterable[Iri]) -> dict[Iri, Justification]:
        """Classes that were materialized, except those that follow from the others."""
        above = self._reasoner.classes.above
        implied = {cls for each in (*self._reasoner.types.get(individual, ()), *known) for cls in above(each)}
        quads = self._inferred.quads_for_pattern(node_to_look_up(individual), ox.NamedNode(TYPE), None)
        names = {Iri(quad.object.value) for quad in quads if isinstance(quad.object, ox.NamedNode)}
        new = {name for name in names - implied if not name.startswith((OWL, RDFS, RDF))}
        most_specific = {cls for cls in new if not any(cls != other and cls in above(other) for other in new)}
        return {cls: Justification(cls, InferenceRule.OWL_RL, ()) for cls in sorted(most_specific or new)}

    def is_affected_by(self, quads: Sequence[ox.Quad]) -> bool:
        """Whether the inferred classes may change when these statements are added or removed.

        Statements about classes, properties and types always have an effect and are not checked here.
        """
        if self._definition_properties is None:
            return True
        names = (name for quad in quads for name in (node_label(quad.subject), node_label(quad.object)))
        return any(Iri(quad.predicate.value) in self._definition_properties for quad in quads) or any(
            name in self._by_domain_range for name in names
        )

    @cached_property
    def _definition_properties(self) -> frozenset[Iri] | None:
        """The properties that definitions use; None if chains may relate them to any other property."""
        properties = self._reasoner.properties
        used = {
            each
            for condition in self._reasoner.axioms.sufficient_conditions
            for each in _decisive_properties(condition.expression)
        }
        if used and properties.has_chains:
            return None
        return frozenset(implying for property in used for implying in properties.implying_properties(property))

    # -- domains and ranges --------------------------------------------------------------------------------------------

    def _domain_range_justifications(self, individual: Iri) -> Iterator[Justification]:
        node = node_to_look_up(individual)
        properties = self._reasoner.properties
        quads = [(quad, True) for quad in self._store.quads_for_pattern(node, None, None)]
        quads += [(quad, False) for quad in self._store.quads_for_pattern(None, None, node)]
        found: dict[Iri, Justification] = {}
        for quad, is_subject in sorted(quads, key=lambda each: (str(each[0].predicate), str(each[0]))):
            one, other = node_label(quad.subject), node_label(quad.object)
            property = Iri(quad.predicate.value)
            text = getattr(quad.object, "value", str(quad.object))
            for bound in properties.domains_ranges(property, as_subject=is_subject):
                rule = InferenceRule.DOMAIN if bound.is_domain else InferenceRule.RANGE
                proof = (ObjectTriple(one or individual, property, other or Iri(text)),)
                found.setdefault(bound.cls, Justification(bound.cls, rule, proof, property=bound.property))
        yield from found.values()

    # -- definitions ---------------------------------------------------------------------------------------------------

    def _anonymous_types(self, individual: Iri) -> Iterator[Expression]:
        """The anonymous types of an individual."""
        parser = self._reasoner.axioms.parser
        return (parser.parse(node) for node in self._reasoner.individuals.anonymous_types.get(individual, ()))

    def _add_member(self, individual: Iri, justification: Justification) -> None:
        self._by_definition.setdefault(individual, {})[justification.cls] = justification
        self._inferred_members.setdefault(justification.cls, {})[individual] = None

    def _apply_condition(self, condition: SufficientCondition) -> bool:
        """Adds the new members of one class; returns whether there were any."""
        expression, found = condition.expression, False
        for individual in sorted(set(self._candidates(expression))):
            if not self._is_instance(individual, condition.cls):
                proof = self._proof(individual, expression)
                if proof is not None:
                    self._add_member(
                        individual, Justification(condition.cls, InferenceRule.DEFINITION, proof, expression=expression)
                    )
                    found = True
        return found

    def _candidates(self, expression: Expression | None) -> Iterator[Iri]:
        """A superset of the instances of an expression."""
        match expression:
            case NamedClass(iri):
                for below in self._reasoner.classes.below(iri):
                    yield from self._reasoner.individuals.members.get(below, ())
                    yield from self._inferred_members.get(below, ())
            case IntersectionOf(members):
                yield from self._candidates(min(members, key=_search_cost, default=None))
            case UnionOf(members):
                for member in members:
                    yield from self._candidates(member)
            case OneOf(members):
                yield from (member.iri for member in members if isinstance(member, NamedClass))
            case Restriction(property=property, inverse=inverse):
                if _is_provable(expression):
                    yield from self._reasoner.properties.candidate_subjects(property, backwards=inverse)
                for individual in self._reasoner.individuals.anonymous_types:
                    if expression in self._anonymous_types(individual):
                        yield individual

    def _is_instance(self, individual: Iri, cls: Iri) -> bool:
        classes = self._reasoner.classes
        types = (*self._reasoner.types.get(individual, ()), *self.justifications(individual))
        return any(cls in classes.above(each) for each in types)

    def _proof(self, individual: Iri, expression: Expression | None) -> ProofStatements | None:
        """The statements that make an individual an instance of an expression; None if it is none."""
        match expression:
            case NamedClass(iri):
                return () if self._is_instance(individual, iri) else None
            case IntersectionOf(members):
                proofs = [self._proof(individual, member) for member in members]
                return None if None in proofs else tuple(step for proof in proofs for step in proof or ())
            case UnionOf(members):
                proofs = [self._proof(individual, member) for member in members]
                return next((proof for proof in proofs if proof is not None), None)
            case OneOf(members):
                return () if NamedClass(individual) in members else None
            case Restriction():
                return (
                    ()
                    if expression in self._anonymous_types(individual)
                    else self._restriction_proof(individual, expression)
                )
        return None

    def _restriction_proof(self, individual: Iri, restriction: Restriction) -> ProofStatements | None:
        """The statements that give an individual a value as the restriction requires."""
        if not _is_provable(restriction):
            return None
        reached = self._reasoner.properties.values_with_paths(
            restriction.property, individual, backwards=restriction.inverse
        )
        return next((path for value, path in reached if self._satisfies(individual, restriction, value)), None)

    def _satisfies(self, individual: Iri, restriction: Restriction, value: NamedClass | LiteralValue) -> bool:
        filler = restriction.filler
        if restriction.restriction_type is RestrictionType.HAS_SELF:
            return value == NamedClass(individual)
        if restriction.restriction_type is RestrictionType.HAS_VALUE or filler is None:
            return filler in {None, value}
        if isinstance(value, LiteralValue):
            return filler == NamedClass(value.literal.datatype or xsd("string"))
        return self._proof(value.iri, filler) is not None


def _is_provable(restriction: Restriction) -> bool:
    """Whether statements can prove it in an open world without unique names: upper bounds and counts above 1 cannot."""
    if restriction.restriction_type is RestrictionType.MIN_CARDINALITY:
        return restriction.cardinality == 1
    return restriction.restriction_type in {RestrictionType.SOME, RestrictionType.HAS_VALUE, RestrictionType.HAS_SELF}


def _decisive_properties(expression: Expression | None) -> Iterator[Iri]:
    """The properties that decide whether an individual is an instance of an expression."""
    match expression:
        case IntersectionOf(members) | UnionOf(members):
            for member in members:
                yield from _decisive_properties(member)
        case Restriction(property=property, filler=filler) if _is_provable(expression):
            yield property
            yield from _decisive_properties(filler)


def _conjunct_classes(expression: Expression) -> Iterator[Iri]:
    """The named classes of all instances of an expression."""
    match expression:
        case NamedClass(iri):
            yield iri
        case IntersectionOf(members):
            for member in members:
                yield from _conjunct_classes(member)


def _search_cost(expression: Expression) -> int:
    """Sort key for where to search first: named classes and enumerations list their instances."""
    return 0 if isinstance(expression, NamedClass | OneOf) else 1


class PartOfStep(msgspec.Struct, frozen=True):
    """An individual that is a part of another one, or the whole of it."""

    individual: Iri
    depth: int
    path: tuple[ObjectTriple, ...]
    """The statements that lead to it."""


class Reasoner:
    """Answers what follows from a triple store in its current state."""

    def __init__(
        self, store: QuadSource, *, axioms: ClassAxioms | None = None, individuals: IndividualIndex | None = None
    ) -> None:
        """Reads classes, restrictions, types and maps; everything else is looked up when it is needed.

        Args:
            store: the statements.
            axioms: what follows from the statements about classes, if that is known.
            individuals: the types and maps of individuals, if they are known.
        """
        self._inferred = InferredTriples(store)
        self._store = self._inferred.asserted()
        self._asserted = partial(quads_with_property, self._store)
        self.axioms = axioms or ClassAxioms(self._asserted)
        self.individuals = individuals or IndividualIndex(self._asserted)
        self._sorted_members: dict[Iri, Sequence[Iri]] = {}
        self._class_cache: dict[Iri, Iri | None] = {}

    @property
    def classes(self) -> TransitiveClosure[Iri]:
        """The transitive closure of the subclass relation."""
        return self.axioms.class_closure

    @property
    def types(self) -> dict[Iri, tuple[Iri, ...]]:
        """The asserted classes, by individual."""
        return self.individuals.types

    @property
    def members_by_map(self) -> dict[Iri, dict[Iri, None]]:
        """The individuals that are described in a map, by map."""
        return self.individuals.members_by_map

    @property
    def maps_of(self) -> dict[Iri, tuple[Iri, ...]]:
        """The maps that an individual is described in, by individual."""
        return self.individuals.maps_of

    @cached_property
    def properties(self) -> PropertyHierarchy:
        """The hierarchy of properties."""
        return PropertyHierarchy(self._store, self.axioms.parser, self._inferred)

    @cached_property
    def instance_checker(self) -> InstanceChecker:
        """The inferred classes of individuals."""
        return InstanceChecker(self, self._store, self._inferred)

    # -- change --------------------------------------------------------------------------------------------------------

    def add_graph(self, graph: ox.NamedNode) -> set[Iri]:
        """Updates the reasoner with a graph that was added to the store, and returns the names in it."""
        quads_by_property = {
            property: list(self._store.quads_for_pattern(None, ox.NamedNode(property), None, graph))
            for property in (TYPE, DESCRIBED_IN_MAP, *CLASS_AXIOM_PROPERTIES, *PROPERTY_AXIOM_PROPERTIES)
        }
        if self.axioms.is_merged:
            self._add_to_merged([quad for name in CLASS_AXIOM_PROPERTIES for quad in quads_by_property[name]])
        elif not self.axioms.add(quads_by_property.__getitem__):
            self.axioms = ClassAxioms(self._asserted)
        self.individuals.add(quads_by_property.__getitem__)
        self._drop_cached("properties", "instance_checker")
        nodes = (node for quads in quads_by_property.values() for quad in quads for node in (quad.subject, quad.object))
        return {Iri(node.value) for node in nodes if isinstance(node, ox.NamedNode)}

    def update(self, quads: Iterable[ox.Quad]) -> bool:
        """Updates everything that depends on statements that were added to the store or removed from it.

        Returns:
            Whether statements about classes are among them.
        """
        quads = list(quads)
        predicates = {quad.predicate.value for quad in quads}
        of_classes = not CLASS_AXIOM_PROPERTIES.isdisjoint(predicates)
        reset = of_classes and not self._update_classes(
            [q for q in quads if q.predicate.value in CLASS_AXIOM_PROPERTIES]
        )
        subjects = (quad.subject for quad in quads if quad.predicate.value in {TYPE, DESCRIBED_IN_MAP})
        for node in dict.fromkeys(subjects):
            if name := node_label(node):
                self.individuals.update(name, self._objects(node, TYPE), self._objects(node, DESCRIBED_IN_MAP))
        objects = {quad.object.value for quad in quads if isinstance(quad.object, ox.NamedNode)}
        if reset or not (PROPERTY_AXIOM_PROPERTIES.isdisjoint(predicates) and PROPERTY_TYPES.isdisjoint(objects)):
            self._drop_cached("properties", "instance_checker")
        elif (
            of_classes
            or TYPE in predicates
            or DESCRIBED_IN_MAP in predicates
            or ("instance_checker" in self.__dict__ and self.instance_checker.is_affected_by(quads))
        ):
            self._drop_cached("instance_checker")
        if "properties" in self.__dict__:
            self.properties.clear_usage_cache()
        return of_classes

    def _update_classes(self, quads: Sequence[ox.Quad]) -> bool:
        """Updates the class axioms; returns False if expressions have changed and all of them were read again."""
        asserted = [self._is_asserted(quad) for quad in quads]
        if self.axioms.is_merged:
            return self._add_to_merged(quads) if all(asserted) else self._read_classes_again()
        expressions = [
            (quad, is_asserted)
            for quad, is_asserted in zip(quads, asserted, strict=True)
            if quad.predicate.value in EXPRESSION_PROPERTIES
        ]
        if not all(is_asserted for _, is_asserted in expressions) or not self.axioms.parser.add(
            quad for quad, _ in expressions
        ):
            return self._read_classes_again()
        self.axioms.add_definitions()
        for quad, is_asserted in zip(quads, asserted, strict=True):
            if quad.predicate.value not in EXPRESSION_PROPERTIES:
                self.axioms.update(quad.triple, is_asserted=is_asserted)
        return True

    def _read_classes_again(self) -> bool:
        self.axioms = ClassAxioms(self._asserted)
        return False

    def _add_to_merged(self, quads: Sequence[ox.Quad]) -> bool:
        """Adds statements to axioms of which only the result is known; all are read again if that is not enough."""
        triples = {quad.triple for quad in quads}
        nodes = {node for triple in triples for node in triple if isinstance(node, ox.BlankNode)}
        if any(self._continues_expression(triple) for triple in triples) or any(
            quad.triple not in triples and quad.predicate.value in CLASS_AXIOM_PROPERTIES
            for node in nodes
            for pattern in ((node, None, None), (None, None, node))
            for quad in self._store.quads_for_pattern(*pattern)
        ):
            return self._read_classes_again()
        groups: dict[str, list[ox.Quad]] = {}
        for quad in quads:
            groups.setdefault(quad.predicate.value, []).append(quad)
        self.axioms.add(lambda name: groups.get(name, ()))
        return True

    def _continues_expression(self, triple: ox.Triple) -> bool:
        """Whether a statement is about a named list, which statements that exist may refer to."""
        return isinstance(triple.subject, ox.NamedNode) and triple.predicate.value in LIST_PROPERTIES

    def _is_asserted(self, quad: ox.Quad) -> bool:
        """Whether any graph contains the statement."""
        quads = self._store.quads_for_pattern(quad.subject, quad.predicate, quad.object)
        return next(iter(quads), None) is not None

    def _drop_cached(self, *names: str) -> None:
        for name in names:
            self.__dict__.pop(name, None)
        self._sorted_members, self._class_cache = {}, {}

    def _objects(self, node: ox.NamedNode | ox.BlankNode | ox.Triple, property: Iri) -> list[object]:
        return [quad.object for quad in self._store.quads_for_pattern(node, ox.NamedNode(property), None)]

    # -- classes -------------------------------------------------------------------------------------------------------

    def is_a(self, cls: Iri, ancestor: Iri) -> bool:
        """Whether a class is another class or one of its subclasses."""
        return ancestor in self.classes.above(cls)

    def equivalents(self, cls: Iri) -> Iterator[Iri]:
        """The class itself, and the classes that have the same members by definition."""
        return (each for each in self.classes.above(cls) if cls in self.classes.above(each))

    def are_disjoint(self, first: Iri, second: Iri) -> bool:
        """Whether two classes have no common member: they, or two of their superclasses, are asserted disjoint."""
        others = self.classes.above(second)
        return any(each in others for above in self.classes.above(first) for each in self.axioms.disjoint_with(above))

    def restrictions(self, cls: Iri) -> Iterator[ClassRestriction]:
        """The restrictions of a class, then those that it inherits, the nearest first."""
        for owner in self.classes.above(cls):
            yield from self.axioms.class_restrictions(owner)

    def expression(self, cls: Iri) -> Expression | None:
        """The class expression of a node, which may be a blank node `_:label`; None if it is none."""
        return self.axioms.parser.parse(node_to_look_up(cls))

    def restricted_classes(self) -> Iterable[Iri]:
        """The classes that have restrictions of their own."""
        return self.axioms.restricted_classes()

    def restrictions_with_filler(self, property: Iri, cls: Iri) -> Iterator[ClassRestriction]:
        """Restrictions of a property or of its subproperties to a class; inherited restrictions are not repeated."""
        for sub in self.properties.sub_properties(property):
            yield from self.axioms.restrictions_with_filler(sub, cls)

    def restrictions_on(self, property: Iri) -> Iterator[ClassRestriction]:
        """Restrictions of a property or of its subproperties, of all classes."""
        for sub in self.properties.sub_properties(property):
            yield from self.axioms.restrictions_on(sub)

    def subsuming_class(self, expression: Expression | None, cls: Iri) -> Iri | None:
        """The class in an expression that subsumes a class: the nearest in a union, the farthest in an intersection.

        Returns:
            None if the expression does not subsume the class.
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
        """The individuals of a class and of its subclasses, each once: those of one map, or all."""
        found: dict[Iri, None] = {}
        for below in self.classes.below(cls):
            asserted = (
                self.individuals.members.get(below)
                if map is None
                else self.individuals.members_by_map_and_class.get((map, below))
            )
            if asserted:
                found |= asserted
            for individual in self.instance_checker.members(below):
                if map is None or map in self.maps_of.get(individual, ()):
                    found[individual] = None
        return sorted(found)

    def is_member(self, individual: Iri, cls: Iri) -> bool:
        """Whether an individual is a member of a class."""
        classes = self.classes
        return any(cls in classes.above(own) for own in self.types_of(individual))

    def types_of(self, individual: Iri) -> tuple[Iri, ...]:
        """The asserted classes of an individual, then the inferred ones; superclasses are not listed."""
        asserted = self.types.get(individual, ())
        inferred = self.instance_checker.justifications(individual)
        return asserted if not inferred else tuple(dict.fromkeys((*asserted, *sorted(inferred))))

    def justification(self, individual: Iri, cls: Iri) -> Justification | None:
        """Why an individual is a member of exactly this class; None if that is asserted."""
        return (
            None if cls in self.types.get(individual, ()) else self.instance_checker.justifications(individual).get(cls)
        )

    def individuals_in(self, map: Iri, individual: Iri | None = None) -> Sequence[Iri]:
        """The sorted individuals that are described in a map; only the given one, if it is."""
        if individual is not None:
            return [individual] if map in self.maps_of.get(individual, ()) else []
        if map not in self._sorted_members:
            self._sorted_members[map] = sorted(self.members_by_map.get(map, ()))
        return self._sorted_members[map]

    def class_of(self, individual: Iri) -> Iri | None:
        """The most specific class of an individual; a materialized one only if no other is known."""
        if individual not in self._class_cache:
            self._class_cache[individual] = self._most_specific_class(individual)
        return self._class_cache[individual]

    def _most_specific_class(self, individual: Iri) -> Iri | None:
        justifications = self.instance_checker.justifications(individual)
        types = self.types.get(individual, ())
        types = (
            *types,
            *(cls for cls, each in justifications.items() if not types or each.rule is not InferenceRule.OWL_RL),
        )
        if len(types) < 2:
            return types[0] if types else None
        return max(types, key=lambda cls: (len(self.classes.above(cls)), cls))

    def is_individual(self, iri: Iri) -> bool:
        """Whether an individual of this name has a type or a map."""
        individuals = self.individuals
        return iri in individuals.types or iri in individuals.maps_of or iri in individuals.anonymous_types

    def is_class(self, iri: Iri) -> bool:
        """Whether this is the name of a class."""
        if iri in self.individuals.declared[OWL_CLASS] or iri in self.individuals.members:
            return not iri.startswith("_:")
        if iri.startswith(("_:", XSD)):
            return False
        return iri in self.axioms or self.properties.is_domain_or_range(iri) or bool(self.instance_checker.members(iri))

    def is_property(self, iri: Iri) -> bool:
        """Whether this is the name of a property."""
        declared = any(iri in self.individuals.declared[kind] for kind in PROPERTY_TYPE_IRIS)
        return declared or iri in self.axioms.parser.restricted_properties or iri in self.properties

    def declared_classes(self) -> Iterator[Iri]:
        """All named classes."""
        return (name for name in dict.fromkeys(self.all_names()) if self.is_class(name))

    def all_names(self) -> Iterator[Iri]:
        """All names of individuals, classes and properties, possibly repeated."""
        individuals = self.individuals
        yield from (*individuals.types, *individuals.maps_of, *individuals.anonymous_types, *individuals.members_by_map)
        yield from individuals.members
        for declared in individuals.declared.values():
            yield from declared
        yield from self.axioms.names()
        yield from self.properties.all_names()

    # -- parts ---------------------------------------------------------------------------------------------------------

    def parts(self, whole: Iri, *, through_joints: bool = False) -> Iterator[PartOfStep]:
        """All parts of an individual to any depth, the nearest first; never the individual itself, even in a cycle.

        Args:
            whole: the individual.
            through_joints: whether the child of a joint counts as a part of its parent, with the joint between them.
        """
        return self._walk_parts(whole, backwards=False, through_joints=through_joints)

    def wholes(self, part: Iri, *, through_joints: bool = False) -> Iterator[PartOfStep]:
        """All individuals that an individual is a part of, the nearest first."""
        return self._walk_parts(part, backwards=True, through_joints=through_joints)

    def _walk_parts(self, start: Iri, *, backwards: bool, through_joints: bool) -> Iterator[PartOfStep]:
        seen = {start}
        waiting = [PartOfStep(start, 0, ())]
        for inferred in (False, True) if self._inferred else (False,):  # asserted paths are more informative
            for here in waiting:
                steps = self._part_steps(here.individual, backwards=backwards, inferred=inferred)
                for neighbor, path in sorted(steps, key=lambda step: step[0]):
                    if neighbor not in seen and (
                        through_joints or not any(self.is_member(each.subject, CONSTRAINT) for each in path)
                    ):
                        seen.add(neighbor)
                        waiting.append(PartOfStep(neighbor, here.depth + 1, (*here.path, *path)))
                        yield waiting[-1]

    def _is_joint_path(self, path: Sequence[ObjectTriple]) -> bool:
        """Whether the statements are about a joint, which has part-of properties for the two bodies it connects."""
        return any(self.is_member(statement.subject, CONSTRAINT) for statement in path)

    def _part_steps(self, individual: Iri, *, backwards: bool, inferred: bool) -> Iterator[InferenceStep]:
        steps = self.properties.inferred_steps if inferred else self.properties.steps
        return steps(_PART_EXPRESSIONS, individual, backwards=backwards)
