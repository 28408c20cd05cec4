"""The index: classes, restrictions and individuals of a store, arranged so that questions are look-ups.

It is made when the first question comes and holds for one state of the store: who changes that makes a new one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.parts import PARTS
from mindstage.knowledge.reasoning.closure import Closure
from mindstage.knowledge.reasoning.expressions import (
    AllOf,
    AnyOf,
    Expression,
    ExpressionReader,
    Kind,
    Named,
    Restriction,
    node_name,
)
from mindstage.knowledge.reasoning.properties import PropertyIndex, Statement
from mindstage.knowledge.vocabulary import (
    CHILD,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    EQUIVALENT_CLASS,
    OWL,
    OWL_CLASS,
    PARENT,
    RDF,
    RDFS,
    SEMANTIC_MAP,
    SUBCLASS_OF,
    TYPE,
    XSD,
    knowrob,
)
from mindstage.world import Iri

__all__ = ["ClassRestriction", "Index", "Part"]

_DUL = "http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#"
_TO_PARTS = (
    *(CHILD, knowrob("parts"), knowrob("physicalParts"), knowrob("properPhysicalParts")),
    *(Iri(_DUL + "hasPart"), Iri(_DUL + "hasComponent")),
)
_TO_WHOLES = (PARENT, Iri(_DUL + "isPartOf"), Iri(_DUL + "isComponentOf"))
_PART_CLASSES = frozenset(part.cls for part in PARTS)


class ClassRestriction(msgspec.Struct, frozen=True):
    """What a class says of all its members."""

    cls: Iri
    restriction: Restriction


class Part(msgspec.Struct, frozen=True):
    """A thing that another one is made of, or is a part of."""

    thing: Iri
    depth: int
    chain: tuple[Statement, ...]
    """The statements on the way there."""


class Index:
    """What follows from a store as it stands."""

    def __init__(self, store: ox.Store) -> None:
        """Reads classes, restrictions and types; everything else is looked up when it is asked for."""
        self._store = store
        self._pairs: list[tuple[Iri, Iri]] = []
        self._own: dict[Iri, dict[Restriction, None]] = {}
        self._read_classes()
        self._own = {cls: dict.fromkeys(sorted(told, key=_restriction_key)) for cls, told in self._own.items()}
        self.classes = Closure(self._pairs)
        self.types: dict[Iri, list[Iri]] = {}
        """By individual, as told; what only ontologies are made of is left out."""
        self._members: dict[Iri, list[Iri]] = {}
        self._read_types()
        self.residents: dict[Iri, list[Iri]] = {map: [] for map in self._members.get(SEMANTIC_MAP, ())}
        """By map; the poses and limits of individuals are not counted as individuals."""
        self.maps_of: dict[Iri, list[Iri]] = {}
        self._here: dict[tuple[Iri, Iri], list[Iri]] = {}
        self._read_maps()
        self._naming: dict[tuple[Iri, Iri], list[ClassRestriction]] = {}
        self._read_naming()

    @cached_property
    def properties(self) -> PropertyIndex:
        """How properties follow from one another."""
        return PropertyIndex(self._store)

    # -- classes -------------------------------------------------------------------------------------------------------

    def is_a(self, cls: Iri, ancestor: Iri) -> bool:
        """Whether one class is the other or below it."""
        return ancestor in self.classes.above(cls)

    def restrictions(self, cls: Iri) -> Iterator[ClassRestriction]:
        """What a class says itself, then what it inherits, the nearest first."""
        for owner in self.classes.above(cls):
            for restriction in self._own.get(owner, ()):
                yield ClassRestriction(owner, restriction)

    def restricting(self) -> Iterator[Iri]:
        """Classes that say something themselves."""
        return iter(self._own)

    def naming(self, property: Iri, cls: Iri) -> Iterator[ClassRestriction]:
        """What classes say of a class by a property, or one that implies it; what they inherit is not repeated."""
        for sub in self.properties.sub_properties(property):
            yield from self._naming.get((sub, cls), ())

    def stating(self, property: Iri) -> Iterator[ClassRestriction]:
        """What all classes say by a property, or one that implies it."""
        subs = set(self.properties.sub_properties(property))
        for cls, restrictions in self._own.items():
            for restriction in restrictions:
                if restriction.property in subs and not restriction.inverse:
                    yield ClassRestriction(cls, restriction)

    def reason(self, expression: Expression | None, cls: Iri) -> Iri | None:
        """The class for which another one falls under an expression: the nearest of a union's, the farthest of all.

        None where it does not fall under it.
        """
        match expression:
            case Named(iri):
                return iri if self.is_a(cls, iri) else None
            case AnyOf(members):
                reasons = [reason for member in members if (reason := self.reason(member, cls))]
                return min(reasons, key=lambda reason: self.classes.between(cls, reason), default=None)
            case AllOf(members):
                all_reasons = [self.reason(member, cls) for member in members]
                met = [reason for reason in all_reasons if reason]
                if len(met) < len(all_reasons):
                    return None
                return max(met, key=lambda reason: self.classes.between(cls, reason), default=None)
            case _:
                return None

    # -- individuals ---------------------------------------------------------------------------------------------------

    def members(self, cls: Iri, map: Iri | None = None) -> list[Iri]:
        """Individuals of a class and of those below it, each once; of one map, or of all and none."""
        found: dict[Iri, None] = {}
        for below in self.classes.below(cls):
            found |= dict.fromkeys(self._members.get(below, ()) if map is None else self._here.get((map, below), ()))
        return sorted(found)

    def direct_members(self, cls: Iri) -> Sequence[Iri]:
        """Individuals that are said to be of this very class."""
        return self._members.get(cls, ())

    def is_member(self, individual: Iri, cls: Iri) -> bool:
        """Whether an individual is of a class."""
        return any(self.is_a(told, cls) for told in self.types.get(individual, ()))

    def class_of(self, individual: Iri) -> Iri | None:
        """The most special class that an individual is said to be of."""
        told = self.types.get(individual, ())
        return max(told, key=lambda cls: (len(self.classes.above(cls)), cls), default=None)

    # -- parts ---------------------------------------------------------------------------------------------------------

    def parts(self, whole: Iri, *, through_joints: bool = False) -> Iterator[Part]:
        """All that a thing is made of, to any depth, the nearest first; it is no part of itself, even in a circle.

        Args:
            whole: the thing.
            through_joints: whether the second of two things that a constraint joins counts as a part of the first, and
                the constraint as one between them.
        """
        return self._walk(whole, backwards=False, through_joints=through_joints)

    def wholes(self, part: Iri, *, through_joints: bool = False) -> Iterator[Part]:
        """All that a thing is a part of, the nearest first."""
        return self._walk(part, backwards=True, through_joints=through_joints)

    def _walk(self, start: Iri, *, backwards: bool, through_joints: bool) -> Iterator[Part]:
        seen = {start}
        waiting = [Part(start, 0, ())]
        for here in waiting:
            steps = self._part_steps(here.thing, backwards=backwards)
            for thing, statement in sorted(steps, key=lambda step: step[0]):
                # A constraint names the two things that it joins with the words for wholes and parts.
                if thing not in seen and (through_joints or not self.is_member(statement.subject, CONSTRAINT)):
                    seen.add(thing)
                    waiting.append(Part(thing, here.depth + 1, (*here.chain, statement)))
                    yield waiting[-1]

    def _part_steps(self, thing: Iri, *, backwards: bool) -> Iterator[tuple[Iri, Statement]]:
        for property in _TO_PARTS:
            yield from self.properties.steps(property, thing, backwards=backwards)
        for property in _TO_WHOLES:
            yield from self.properties.steps(property, thing, backwards=not backwards)

    # -- reading -------------------------------------------------------------------------------------------------------

    def _read_classes(self) -> None:
        reader = ExpressionReader(self._store)
        for cls, expression in reader.definitions():
            self._under(cls, expression)
            self._over(cls, expression)
        for property, equal in ((SUBCLASS_OF, False), (EQUIVALENT_CLASS, True)):
            for quad in self._told(property):
                one, other = reader.read(quad.subject), reader.read(quad.object)
                for lower, upper in ((one, other), (other, one)) if equal else ((one, other),):
                    if isinstance(lower, Named):
                        self._under(lower.iri, upper)
                    if isinstance(upper, Named):
                        self._over(upper.iri, lower)

    def _under(self, cls: Iri, expression: Expression) -> None:
        """Every member of the class falls under the expression."""
        match expression:
            case Named(iri):
                self._pairs.append((cls, iri))
            case AllOf(members):
                for member in members:
                    self._under(cls, member)
            case Restriction():
                self._own.setdefault(cls, {})[expression] = None

    def _over(self, cls: Iri, expression: Expression) -> None:
        """Everything that falls under the expression is a member of the class."""
        match expression:
            case Named(iri):
                self._pairs.append((iri, cls))
            case AnyOf(members):
                for member in members:
                    self._over(cls, member)

    def _read_types(self) -> None:
        for quad in self._told(TYPE):
            individual, cls = node_name(quad.subject), node_name(quad.object)
            if individual and cls and not cls.startswith((OWL, RDFS, RDF, "_:")):
                known = self.types.setdefault(individual, [])
                if cls not in known:
                    known.append(cls)
                    known.sort()
                    self._members.setdefault(cls, []).append(individual)

    def _read_maps(self) -> None:
        for quad in self._told(DESCRIBED_IN_MAP):
            individual, map = node_name(quad.subject), node_name(quad.object)
            if not individual or not map or individual == map:
                continue
            types = self.types.get(individual, ())
            maps = self.maps_of.setdefault(individual, [])
            if map not in maps and not (types and _PART_CLASSES.issuperset(types)):
                maps.append(map)
                self.residents.setdefault(map, []).append(individual)
                for cls in types:
                    self._here.setdefault((map, cls), []).append(individual)

    def _read_naming(self) -> None:
        for cls, restrictions in self._own.items():
            for restriction in restrictions:
                if restriction.kind is not Kind.VALUE and not restriction.inverse:
                    owned = ClassRestriction(cls, restriction)
                    for named in dict.fromkeys(_names(restriction.filler)):
                        self._naming.setdefault((restriction.property, named), []).append(owned)

    def declared_classes(self) -> Iterator[Iri]:
        """Every class that has a name."""
        for quad in self._store.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(OWL_CLASS)):
            if isinstance(quad.subject, ox.NamedNode):
                yield Iri(quad.subject.value)
        yield from self.classes
        yield from self._members
        yield from self._own
        yield from (cls for _, cls in self._naming if not cls.startswith(XSD))

    def _told(self, property: Iri) -> Iterator[ox.Quad]:
        return self._store.quads_for_pattern(None, ox.NamedNode(property), None)


def _restriction_key(restriction: Restriction) -> tuple[str, str, str]:
    return restriction.property, restriction.kind.value, repr(restriction)


def _names(expression: Expression | None) -> Iterator[Iri]:
    match expression:
        case Named(iri):
            yield iri
        case AnyOf(members) | AllOf(members):
            for member in members:
                yield from _names(member)
