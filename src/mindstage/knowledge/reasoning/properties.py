"""Properties: what follows from subproperties, inverse, symmetric and transitive ones, and from chains of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.reasoning.chains import Chain, Line, Search
from mindstage.knowledge.reasoning.derivation import Derived
from mindstage.knowledge.reasoning.expressions import AllOf, Expression, ExpressionReader, Named, Value, node_name
from mindstage.knowledge.stores.triplestore import Readable
from mindstage.knowledge.taxonomy import Closure
from mindstage.knowledge.vocabulary import OWL, RDFS, TYPE
from mindstage.world import Iri

__all__ = ["PROPERTY_TYPES", "PROPERTY_WORDS", "PropertyIndex", "Statement", "node_of"]

_CHAIN = Iri(OWL + "propertyChainAxiom")
_DOMAIN, _RANGE = Iri(RDFS + "domain"), Iri(RDFS + "range")
_IMPLYING = (
    (Iri(RDFS + "subPropertyOf"), False, False),
    (Iri(OWL + "equivalentProperty"), True, False),
    (Iri(OWL + "inverseOf"), True, True),
)
"""Words; whether each works both ways; whether it turns the direction."""
PROPERTY_WORDS = frozenset({_CHAIN, _DOMAIN, _RANGE, *(word for word, _, _ in _IMPLYING)})
"""The properties that tell something of properties."""
PROPERTY_TYPES = frozenset(Iri(OWL + name) for name in ("TransitiveProperty", "SymmetricProperty"))
"""What properties can be said to be that has consequences."""


class Statement(msgspec.Struct, frozen=True):
    """One triple between two things, as told."""

    subject: Iri
    property: Iri
    object: Iri


Step = tuple[Iri, tuple[Statement, ...]]
"""A thing, and the statements that lead there."""


class Bound(msgspec.Struct, frozen=True):
    """What everything at one end of a property is."""

    property: Iri
    at_start: bool
    """Whether the start of the property is meant (rdfs:domain), and not its end (rdfs:range)."""
    cls: Iri


class PropertyIndex:
    """How properties follow from one another, and the values that follow from that."""

    def __init__(self, store: Readable, reader: ExpressionReader | None = None, derived: Derived | None = None) -> None:
        """Reads what is told of properties; statements about individuals stay in the store.

        Args:
            store: where everything is that was told.
            reader: knows the lists and expressions that chains, domains and ranges are written with.
            derived: what was derived from it.
        """
        self._store = store
        self._derived = derived
        self._lattice = Closure(self._pairs())
        self._reader = reader = reader or ExpressionReader()
        self._chains = self._read_chains(reader)
        self._bounds = {
            word: {iri: tuple(_classes(map(reader.read, nodes))) for iri, nodes in self._objects(word).items()}
            for word in (_DOMAIN, _RANGE)
        }
        self._bounding = {cls for bounds in self._bounds.values() for classes in bounds.values() for cls in classes}
        self._transitive = {
            iri
            for property in self._of_type("TransitiveProperty")
            for iri, forward in self._lattice.below((property, True))
            if (iri, forward) in self._lattice.above((property, True))  # itself, equal ones, and inverses
        }
        self._used = cache(self._lines_used)
        self._chained = cache(self._lines_chained)
        self.sub_properties = cache(self._sub_properties)

    def _sub_properties(self, property: Iri) -> tuple[Iri, ...]:
        """The property itself and those that imply it in the same direction, the nearest first."""
        return tuple(iri for iri, forward in self._lattice.below((property, True)) if forward)

    def implied(self, property: Iri) -> tuple[Iri, ...]:
        """The property itself and those that it implies in the same direction, the nearest first."""
        return tuple(iri for iri, forward in self._lattice.above((property, True)) if forward)

    def used_for(self, property: Iri) -> Iterator[Iri]:
        """The property itself and all that imply it or its inverse."""
        return (iri for iri, _ in self._lattice.below((property, True)))

    @property
    def has_chains(self) -> bool:
        """Whether some property follows from others put one behind another."""
        return any(self._chains.values())

    def path(self, property: Iri, upper: Iri) -> tuple[Iri, ...]:
        """How one property implies the other, step by step."""
        return tuple(iri for iri, _ in self._lattice.path((property, True), (upper, True)))

    def names(self) -> Iterator[Iri]:
        """Every property that something is told of, and the classes that they lead to; some more than once."""
        yield from (iri for iri, _ in self._lattice)
        yield from (*self._bounds[_DOMAIN], *self._bounds[_RANGE], *self._chains, *self._bounding)

    def __contains__(self, iri: object) -> bool:
        """Whether something is told of the property."""
        told = (iri, True) in self._lattice or (iri, False) in self._lattice
        return told or iri in self._bounds[_DOMAIN] or iri in self._bounds[_RANGE] or iri in self._chains

    def bounds(self, property: Iri, *, at_start: bool) -> Iterator[Bound]:
        """What everything is that has the property, or that is its value; implied properties count."""
        for iri, forward in self._lattice.above((property, True)):
            is_start = forward == at_start
            for cls in self._bounds[_DOMAIN if is_start else _RANGE].get(iri, ()):
                yield Bound(iri, is_start, cls)

    def lines(self, property: Iri) -> tuple[tuple[ox.NamedNode, bool], ...]:
        """The properties that imply this one, forwards or backwards, as far as anybody uses them."""
        return self._used(((property, True),))

    def leads_to(self, cls: Iri) -> bool:
        """Whether the class is the domain or range of some property."""
        return cls in self._bounding

    def forget_use(self) -> None:
        """Some property may be used now that nobody used before, or the other way round."""
        self._used.cache_clear()

    # -- values --------------------------------------------------------------------------------------------------------

    def steps(self, lines: tuple[Line, ...], thing: Iri, *, backwards: bool = False) -> Iterator[Step]:
        """One step away: by a told statement of a property that implies one of these, or by a chain that does."""
        for node, forward in self._used(lines):
            yield from _along(self._store, node, thing, forwards=forward != backwards)
        for iri, forward in self._chained(lines):
            line = (iri, forward != backwards)
            yield from self._search().values(line, thing, transitive=False).items()

    def derived_steps(self, lines: tuple[Line, ...], thing: Iri, *, backwards: bool = False) -> Iterator[Step]:
        """One step away by a statement that was derived."""
        if self._derived:
            for iri, forward in self._below(lines):
                yield from _along(self._derived, ox.NamedNode(iri), thing, forwards=forward != backwards)

    def values(self, property: Iri, thing: Iri, *, backwards: bool = False) -> tuple[Iri, ...]:
        """All values that follow; a transitive property is followed to the end, and so are transitive ones below it."""
        return tuple(self._search().values((property, not backwards), thing))

    def reached(
        self, property: Iri, thing: Iri, *, backwards: bool = False
    ) -> Iterator[tuple[Named | Value, tuple[Statement, ...]]]:
        """All values that follow, texts and numbers too, with the statements that lead there."""
        for name, way in self._search().values((property, not backwards), thing).items():
            yield Named(name), way
        for iri, forward in self.lines(property):
            for quad in self._store.quads_for_pattern(node_of(thing), iri, None) if forward != backwards else ():
                if isinstance(value := self._reader.read(quad.object), Value):
                    yield value, (Statement(thing, Iri(iri.value), Iri(value.literal.text)),)

    def starts(self, property: Iri, *, backwards: bool = False) -> Iterator[Iri]:
        """All things that may have a value of the property, and some that do not."""
        waiting: dict[Line, None] = {(property, not backwards): None}
        done: set[Line] = set()
        while waiting:
            line, _ = waiting.popitem()
            for iri, forward in self._lattice.below(line).keys() - done:
                done.add((iri, forward))
                for quad in self._told(iri):
                    if name := node_name(quad.subject if forward else quad.object):
                        yield name
                for chain in self._chains.get(iri, ()):
                    first, ahead = chain[0] if forward else chain[-1]
                    waiting[first, ahead == forward] = None

    def _search(self) -> Search[Statement]:
        def told(line: Line, thing: Iri) -> Iterator[Step]:
            return _along(self._store, ox.NamedNode(line[0]), thing, forwards=line[1])

        return Search(self._lattice, self._chains, self._transitive, told)

    def _below(self, lines: tuple[Line, ...]) -> dict[Line, None]:
        return {below: None for line in lines for below in self._lattice.below(line)}

    def _lines_used(self, lines: tuple[Line, ...]) -> tuple[tuple[ox.NamedNode, bool], ...]:
        """What implies one of these, as far as anybody uses it."""
        below = [(ox.NamedNode(iri), forward) for iri, forward in self._below(lines)]
        return tuple(line for line in below if next(iter(self._told(line[0].value)), None))

    def _lines_chained(self, lines: tuple[Line, ...]) -> tuple[Line, ...]:
        """Those of the lines that some chain implies."""
        return tuple(line for line in lines if any(self._chains.get(iri) for iri, _ in self._lattice.below(line)))

    # -- reading -------------------------------------------------------------------------------------------------------

    def _pairs(self) -> Iterator[tuple[Line, Line]]:
        """A property read forwards or backwards implies another one, read forwards or backwards."""
        for word, mirrored, inverse in _IMPLYING:
            for quad in self._told(word):
                if isinstance(quad.subject, ox.NamedNode) and isinstance(quad.object, ox.NamedNode):
                    one, other = Iri(quad.subject.value), Iri(quad.object.value)
                    for forward in (True, False):
                        yield (one, forward), (other, forward != inverse)
                        if mirrored:
                            yield (other, forward), (one, forward != inverse)
        for iri in self._of_type("SymmetricProperty"):
            yield (iri, True), (iri, False)
            yield (iri, False), (iri, True)

    def _read_chains(self, reader: ExpressionReader) -> dict[Iri, tuple[Chain, ...]]:
        chains: dict[Iri, list[Chain]] = {}
        for iri, heads in self._objects(_CHAIN).items():
            chains[iri] = []
            for head in heads:
                lines = [reader.line(item) for item in reader.items(head)]
                if lines and None not in lines:
                    chains[iri].append(tuple(line for line in lines if line))
        return {iri: tuple(sorted(told)) for iri, told in chains.items()}

    def _objects(self, word: Iri) -> dict[Iri, list[object]]:
        found: dict[Iri, list[object]] = {}
        for quad in self._told(word):
            if isinstance(quad.subject, ox.NamedNode):
                found.setdefault(Iri(quad.subject.value), []).append(quad.object)
        return found

    def _of_type(self, name: str) -> frozenset[Iri]:
        quads = self._store.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(OWL + name))
        return frozenset(Iri(quad.subject.value) for quad in quads if isinstance(quad.subject, ox.NamedNode))

    def _told(self, word: str) -> Iterator[ox.Quad]:
        return self._store.quads_for_pattern(None, ox.NamedNode(word), None)


def _along(store: Readable | Derived, property: ox.NamedNode, thing: Iri, *, forwards: bool) -> Iterator[Step]:
    """The told values of one property, or what has the thing as its value."""
    node = node_of(thing)
    if forwards:
        for quad in store.quads_for_pattern(node, property, None):
            if name := node_name(quad.object):
                yield name, (Statement(thing, Iri(property.value), name),)
    else:
        for quad in store.quads_for_pattern(None, property, node):
            if name := node_name(quad.subject):
                yield name, (Statement(name, Iri(property.value), thing),)


def _classes(expressions: Iterable[Expression]) -> list[Iri]:
    """The named classes that all of these promise together."""
    found: set[Iri] = set()
    for expression in expressions:
        match expression:
            case Named(iri) if not iri.startswith((OWL, RDFS)):
                found.add(iri)
            case AllOf(members):
                found.update(_classes(members))
    return sorted(found)


def node_of(name: Iri) -> ox.NamedNode | ox.BlankNode:
    """The node that has the name or label."""
    return ox.BlankNode(name[2:]) if name.startswith("_:") else ox.NamedNode(name)
