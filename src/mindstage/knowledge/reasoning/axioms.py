"""Axioms: what is told of classes, and what each single statement of that adds to or takes from the whole.

Every statement has its own consequences. They are counted, so that a statement can come and go, in whatever order, and
leave what others say as it was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.reasoning.expressions import (
    STRUCTURE,
    AllOf,
    AnyOf,
    Expression,
    ExpressionReader,
    Kind,
    Named,
    Not,
    OneOf,
    Restriction,
    classes_in,
)
from mindstage.knowledge.taxonomy import Closure
from mindstage.knowledge.vocabulary import EQUIVALENT_CLASS, OWL, SUBCLASS_OF
from mindstage.world import Iri

__all__ = ["CLASS_WORDS", "ClassAxioms", "ClassRestriction", "Condition"]

_DISJOINT = Iri(OWL + "disjointWith")
CLASS_WORDS = frozenset({SUBCLASS_OF, EQUIVALENT_CLASS, _DISJOINT, *STRUCTURE})
"""The properties that tell something of classes."""

Told = Callable[[str], Iterable[ox.Quad]]
"""All statements by a property, or those of one graph."""


class ClassRestriction(msgspec.Struct, frozen=True):
    """What a class says of all its members."""

    cls: Iri
    restriction: Restriction


class Edge(msgspec.Struct, frozen=True):
    """One class is directly below another."""

    lower: Iri
    upper: Iri


class Condition(msgspec.Struct, frozen=True):
    """Whatever falls under the expression is a member of the class."""

    cls: Iri
    expression: Expression


class Apart(msgspec.Struct, frozen=True):
    """Nothing is of both classes."""

    one: Iri
    other: Iri


Consequence = ClassRestriction | Edge | Condition | Apart


class ClassAxioms:
    """Classes, their restrictions and definitions."""

    def __init__(self, told: Told) -> None:
        """Reads all that is told."""
        self.lattice: Closure[Iri] = Closure()
        self.conditions: dict[Condition, None] = {}
        """The definitions that make individuals members, where a name alone does not."""
        self.reader = ExpressionReader()
        self._axioms: dict[ox.Triple, tuple[Consequence, ...]] = {}
        self._counts: dict[Consequence, int] = {}
        self._own: dict[Iri, dict[ClassRestriction, None]] = {}
        self._ordered: dict[tuple[int, object], Sequence[ClassRestriction]] = {}
        self._naming: dict[tuple[Iri, Iri], dict[ClassRestriction, None]] = {}
        self._named: dict[Iri, dict[ClassRestriction, None]] = {}
        self._stating: dict[Iri, dict[ClassRestriction, None]] = {}
        self._apart: dict[Iri, dict[Iri, None]] = {}
        self.read(told)

    def read(self, told: Told) -> bool:
        """Adds more; False where it changes what expressions meant, so that everything must be read anew."""
        fresh = self.reader.learn(quad for property in STRUCTURE for quad in told(property))
        if fresh:
            for property in (SUBCLASS_OF, EQUIVALENT_CLASS, _DISJOINT):
                for quad in told(property):
                    self._add(quad.triple, self._consequences(quad.triple))
            self.define()
        return fresh

    def define(self) -> None:
        """Takes in named classes that are themselves said to be expressions."""
        for cls, expression in self.reader.definitions():
            # A definition is told by several statements; its key is one that no source can tell.
            key = ox.Triple(ox.NamedNode(cls), ox.NamedNode(OWL + "definition"), ox.Literal(repr(expression)))
            self._add(key, (*_implies(Named(cls), expression), *_implies(expression, Named(cls))))

    def reread(self, triple: ox.Triple, *, is_told: bool) -> None:
        """Makes what a statement by one of the three properties says true, or no longer so."""
        if is_told:
            self._add(triple, self._consequences(triple))
        else:
            for consequence in self._axioms.pop(triple, ()):
                self._unsay(consequence)

    # -- looking things up ---------------------------------------------------------------------------------------------

    def own(self, cls: Iri) -> Sequence[Restriction]:
        """What a class says itself."""
        return [told.restriction for told in self._in_order(self._own, cls)]

    def restricting(self) -> list[Iri]:
        """Classes that say something themselves."""
        return sorted(self._own)

    def told_by(self, cls: Iri) -> Sequence[ClassRestriction]:
        """The same, with the class."""
        return self._in_order(self._own, cls)

    def naming(self, property: Iri, cls: Iri) -> Sequence[ClassRestriction]:
        """What classes say of another one by this very property."""
        return self._in_order(self._naming, (property, cls))

    def stating(self, property: Iri) -> Sequence[ClassRestriction]:
        """What classes say by this very property, forwards."""
        return self._in_order(self._stating, property)

    def apart(self, cls: Iri) -> Iterable[Iri]:
        """The classes that are told to have no member in common with this one."""
        return self._apart.get(cls, ())

    def names(self) -> Iterator[Iri]:
        """Every name that may be, or become, the name of a class."""
        nodes = (node for triple in self._axioms for node in (triple.subject, triple.object))
        yield from (Iri(node.value) for node in nodes if isinstance(node, ox.NamedNode))
        yield from self.reader.names()

    def __contains__(self, cls: object) -> bool:
        """Whether something is told of the class."""
        return (
            cls in self.lattice
            or cls in self._own
            or cls in self._apart
            or cls in self._named
            or cls in self.reader.fillers
            or any(condition.cls == cls for condition in self.conditions)
        )

    def _in_order(self, groups: Mapping[Any, dict[ClassRestriction, None]], key: object) -> Sequence[ClassRestriction]:
        if key not in groups:
            return ()
        place = id(groups), key
        if place not in self._ordered:
            self._ordered[place] = sorted(groups[key], key=_order)
        return self._ordered[place]

    # -- consequences --------------------------------------------------------------------------------------------------

    def _consequences(self, triple: ox.Triple) -> Iterator[Consequence]:
        one, other = self.reader.read(triple.subject), self.reader.read(triple.object)
        if triple.predicate.value == _DISJOINT:
            yield from _apart(one, other)
            return
        yield from _implies(one, other)
        if triple.predicate.value == EQUIVALENT_CLASS:
            yield from _implies(other, one)

    def _add(self, key: ox.Triple, consequences: Iterable[Consequence]) -> None:
        if key not in self._axioms:
            self._axioms[key] = tuple(dict.fromkeys(consequences))
            for consequence in self._axioms[key]:
                self._say(consequence)

    def _say(self, consequence: Consequence) -> None:
        self._counts[consequence] = count = self._counts.get(consequence, 0) + 1
        if count > 1:
            return
        match consequence:
            case Edge(lower, upper):
                self.lattice.add(lower, upper)
            case ClassRestriction(cls, restriction):
                self._ordered.clear()
                self._own.setdefault(cls, {})[consequence] = None
                for groups, key in self._groups(restriction):
                    groups.setdefault(key, {})[consequence] = None
            case Condition():
                self.conditions[consequence] = None
            case Apart(one, other):
                self._apart.setdefault(one, {})[other] = None

    def _unsay(self, consequence: Consequence) -> None:
        self._counts[consequence] -= 1
        if self._counts[consequence]:
            return
        del self._counts[consequence]
        match consequence:
            case Edge(lower, upper):
                self.lattice.discard(lower, upper)
            case ClassRestriction(cls, restriction):
                self._ordered.clear()
                _drop(self._own, cls, consequence)
                for groups, key in self._groups(restriction):
                    _drop(groups, key, consequence)
            case Condition():
                del self.conditions[consequence]
            case Apart(one, other):
                _drop(self._apart, one, other)

    def _groups(self, restriction: Restriction) -> Iterator[tuple[dict[Any, dict[ClassRestriction, None]], object]]:
        """Where a restriction is to be found: by its property, and by what it speaks of."""
        if restriction.inverse:
            return
        yield self._stating, restriction.property
        for cls in dict.fromkeys(classes_in(restriction.filler)) if restriction.kind is not Kind.VALUE else ():
            yield self._naming, (restriction.property, cls)
            yield self._named, cls


def _implies(one: Expression, other: Expression) -> Iterator[Consequence]:
    """Whatever falls under the one falls under the other."""
    if isinstance(one, Named):
        yield from _under(one.iri, other)
    if isinstance(other, Named):
        yield from _over(other.iri, one)


def _under(cls: Iri, expression: Expression) -> Iterator[Consequence]:
    match expression:
        case Named(iri):
            yield Edge(cls, iri)
        case AllOf(members):
            for member in members:
                yield from _under(cls, member)
        case Restriction():
            yield ClassRestriction(cls, expression)
        case Not(Named() as other):
            yield from _apart(Named(cls), other)


def _over(cls: Iri, expression: Expression) -> Iterator[Consequence]:
    match expression:
        case Named(iri):
            yield Edge(iri, cls)
        case AnyOf(members):
            for member in members:
                yield from _over(cls, member)
        case AllOf() | OneOf() | Restriction():
            yield Condition(cls, expression)


def _apart(one: Expression, other: Expression) -> Iterator[Consequence]:
    if isinstance(one, Named) and isinstance(other, Named):
        yield Apart(one.iri, other.iri)
        yield Apart(other.iri, one.iri)


def _drop(told: dict[Any, dict[Any, None]], key: object, item: object) -> None:
    told[key].pop(item, None)
    if not told[key]:
        del told[key]


def _order(told: ClassRestriction) -> tuple[str, str, str, str]:
    restriction = told.restriction
    return told.cls, restriction.property, restriction.kind.value, repr(restriction)
