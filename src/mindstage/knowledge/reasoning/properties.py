"""Properties: what follows from subproperties, inverse, symmetric and transitive ones."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.reasoning.closure import Closure
from mindstage.knowledge.reasoning.expressions import node_name
from mindstage.knowledge.vocabulary import OWL, RDFS, TYPE
from mindstage.world import Iri

__all__ = ["PropertyIndex", "Statement"]


class Statement(msgspec.Struct, frozen=True):
    """One triple between two things, as told."""

    subject: Iri
    property: Iri
    object: Iri


class PropertyIndex:
    """How properties follow from one another, and the values that follow from that."""

    def __init__(self, store: ox.Store) -> None:
        """Reads what is told of properties; statements about individuals stay in the store."""
        self._store = store
        self._lattice = Closure(self._pairs())
        transitive = self._of_type("TransitiveProperty")
        self._transitive = {
            iri
            for property in transitive
            for iri, forward in self._lattice.below((property, True))
            if (iri, forward) in self._lattice.above((property, True))  # itself, equal ones, and inverses
        }
        self.lines = cache(self._lines)

    def sub_properties(self, property: Iri) -> tuple[Iri, ...]:
        """The property itself and those that imply it in the same direction, the nearest first."""
        return tuple(iri for iri, forward in self._lattice.below((property, True)) if forward)

    def implied(self, property: Iri) -> tuple[Iri, ...]:
        """The property itself and those that it implies in the same direction, the nearest first."""
        return tuple(iri for iri, forward in self._lattice.above((property, True)) if forward)

    def path(self, property: Iri, upper: Iri) -> tuple[Iri, ...]:
        """How one property implies the other, step by step."""
        return tuple(iri for iri, _ in self._lattice.path((property, True), (upper, True)))

    def known(self) -> Iterator[Iri]:
        """Every property that something is told of."""
        return iter(dict.fromkeys(iri for iri, _ in self._lattice))

    def steps(self, property: Iri, thing: Iri, *, backwards: bool = False) -> Iterator[tuple[Iri, Statement]]:
        """One told statement away, by any property that implies this one in either direction."""
        node = _node(thing)
        for iri, forward in self.lines(property):
            if forward != backwards:
                for quad in self._store.quads_for_pattern(node, iri, None):
                    if name := node_name(quad.object):
                        yield name, Statement(thing, Iri(iri.value), name)
            else:
                for quad in self._store.quads_for_pattern(None, iri, node):
                    if name := node_name(quad.subject):
                        yield name, Statement(name, Iri(iri.value), thing)

    def values(self, property: Iri, thing: Iri, *, backwards: bool = False) -> tuple[Iri, ...]:
        """All values that follow; a transitive property is followed to the end, and so are transitive ones below it."""
        if property in self._transitive:
            return self._reached(property, thing, backwards=backwards)
        found = dict.fromkeys(name for name, _ in self.steps(property, thing, backwards=backwards))
        for iri, forward in self._lattice.below((property, True)):
            if iri in self._transitive:
                found |= dict.fromkeys(self._reached(iri, thing, backwards=backwards == forward))
        return tuple(found)

    def _reached(self, property: Iri, thing: Iri, *, backwards: bool) -> tuple[Iri, ...]:
        found: dict[Iri, None] = {}
        waiting = [thing]
        while waiting:
            for name, _ in self.steps(property, waiting.pop(), backwards=backwards):
                if name not in found:
                    found[name] = None
                    waiting.append(name)
        return tuple(found)

    def _lines(self, property: Iri) -> tuple[tuple[ox.NamedNode, bool], ...]:
        """The properties that imply this one, forwards or backwards, as far as anybody uses them."""
        below = [(ox.NamedNode(iri), forward) for iri, forward in self._lattice.below((property, True))]
        return tuple(line for line in below if next(self._store.quads_for_pattern(None, line[0], None), None))

    def _pairs(self) -> Iterator[tuple[tuple[Iri, bool], tuple[Iri, bool]]]:
        """A property read forwards or backwards implies another one, read forwards or backwards."""
        for word, mirrored, inverse in (
            (RDFS + "subPropertyOf", False, False),
            (OWL + "equivalentProperty", True, False),
            (OWL + "inverseOf", True, True),
        ):
            for quad in self._store.quads_for_pattern(None, ox.NamedNode(word), None):
                if isinstance(quad.subject, ox.NamedNode) and isinstance(quad.object, ox.NamedNode):
                    one, other = Iri(quad.subject.value), Iri(quad.object.value)
                    for forward in (True, False):
                        yield (one, forward), (other, forward != inverse)
                        if mirrored:
                            yield (other, forward), (one, forward != inverse)
        for iri in self._of_type("SymmetricProperty"):
            yield (iri, True), (iri, False)
            yield (iri, False), (iri, True)

    def _of_type(self, name: str) -> frozenset[Iri]:
        quads = self._store.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(OWL + name))
        return frozenset(Iri(quad.subject.value) for quad in quads if isinstance(quad.subject, ox.NamedNode))


def _node(name: Iri) -> ox.NamedNode | ox.BlankNode:
    return ox.BlankNode(name[2:]) if name.startswith("_:") else ox.NamedNode(name)
