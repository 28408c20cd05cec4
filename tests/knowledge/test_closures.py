"""Transitive closures and property chains, compared with a naive closure."""

from __future__ import annotations

from itertools import pairwise, product

import pyoxigraph as ox
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.knowledge.reasoner_properties import PropertyHierarchy
from mindstage.rdf.taxonomy import TransitiveClosure
from mindstage.scene import Iri
from tests.maps.small_maps import OWL, RDFS

NODES = [Iri(f"http://example.org/{letter}") for letter in "abcdef"]
PROPERTIES = [Iri(f"http://example.org/{letter}") for letter in "pqrs"]
RDF_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"

node_pairs = st.lists(st.tuples(st.sampled_from(NODES), st.sampled_from(NODES)), max_size=14)
property_pairs = st.lists(st.tuples(st.sampled_from(PROPERTIES), st.sampled_from(PROPERTIES)), max_size=5)


def closed(pairs: set[tuple[Iri, Iri]]) -> set[tuple[Iri, Iri]]:
    """Adds all consequences until nothing changes."""
    while more := {(a, d) for (a, b), (c, d) in product(pairs, pairs) if b == c} - pairs:
        pairs = pairs | more
    return pairs


@given(node_pairs)
def test_above_and_below_are_the_transitive_closure(pairs: list[tuple[Iri, Iri]]) -> None:
    closure, expected = TransitiveClosure(pairs), closed(set(pairs)) | {(node, node) for node in NODES}
    for node in NODES:
        assert set(closure.above(node)) == {upper for lower, upper in expected if lower == node}
        assert set(closure.below(node)) == {lower for lower, upper in expected if upper == node}


@given(node_pairs)
def test_a_path_consists_of_asserted_steps_and_is_shortest(pairs: list[tuple[Iri, Iri]]) -> None:
    closure = TransitiveClosure(pairs)
    for lower, upper in product(NODES, NODES):
        path = closure.path(lower, upper)
        if upper not in closure.above(lower):
            assert path == ()
        else:
            assert (path[0], path[-1]) == (lower, upper)
            assert all(step in pairs for step in pairwise(path))
            assert len(path) - 1 == closure.above(lower)[upper] == closure.below(upper)[lower]


@given(node_pairs)
def test_the_more_specific_class_has_fewer_classes_between(pairs: list[tuple[Iri, Iri]]) -> None:
    closure = TransitiveClosure(pairs)
    for item, special, general in product(NODES, NODES, NODES):
        if special in closure.above(item) and general in closure.above(special):
            if special in closure.above(general):
                assert closure.count_between(item, special) == closure.count_between(item, general)
            else:
                assert closure.count_between(item, special) < closure.count_between(item, general)


def naive_values(
    asserted: list[tuple[Iri, Iri, Iri]],
    below: list[tuple[Iri, Iri]],
    inverses: list[tuple[Iri, Iri]],
    equal: list[tuple[Iri, Iri]],
    symmetric: set[Iri],
    transitive: set[Iri],
) -> set[tuple[Iri, Iri, Iri]]:
    """Applies every rule repeatedly until nothing new follows."""
    known = set(asserted)
    while True:
        new = {(s, q, o) for s, p, o in known for lower, q in below if p == lower}
        new |= {
            (o, q, s)
            for s, p, o in known
            for one, other in inverses
            for p1, q in ((one, other), (other, one))
            if p == p1
        }
        new |= {
            (s, q, o) for s, p, o in known for one, other in equal for p1, q in ((one, other), (other, one)) if p == p1
        }
        new |= {(o, p, s) for s, p, o in known if p in symmetric}
        new |= {(a, p, d) for (a, p, b), (c, q, d) in product(known, known) if p == q and b == c and p in transitive}
        if new <= known:
            return known
        known |= new


@given(
    st.lists(
        st.tuples(st.sampled_from(NODES[:4]), st.sampled_from(PROPERTIES), st.sampled_from(NODES[:4])), max_size=6
    ),
    property_pairs,
    st.lists(st.tuples(st.sampled_from(PROPERTIES), st.sampled_from(PROPERTIES)), max_size=1),
    st.lists(st.tuples(st.sampled_from(PROPERTIES), st.sampled_from(PROPERTIES)), max_size=1),
    st.sets(st.sampled_from(PROPERTIES), max_size=1),
    st.sets(st.sampled_from(PROPERTIES), max_size=2),
)
def test_values_equal_the_naive_closure(
    asserted: list[tuple[Iri, Iri, Iri]],
    below: list[tuple[Iri, Iri]],
    inverses: list[tuple[Iri, Iri]],
    equal: list[tuple[Iri, Iri]],
    symmetric: set[Iri],
    transitive: set[Iri],
) -> None:
    triples = [
        *asserted,
        *((lower, RDFS + "subPropertyOf", upper) for lower, upper in below),
        *((one, OWL + "inverseOf", other) for one, other in inverses),
        *((one, OWL + "equivalentProperty", other) for one, other in equal),
        *((property, RDF_TYPE, OWL + "SymmetricProperty") for property in symmetric),
        *((property, RDF_TYPE, OWL + "TransitiveProperty") for property in transitive),
    ]
    store = ox.Store()
    store.extend([ox.Quad(*map(ox.NamedNode, triple)) for triple in triples])
    index = PropertyHierarchy(store)
    expected = naive_values(asserted, below, inverses, equal, symmetric, transitive)
    for property, node in product(PROPERTIES, NODES[:4]):
        assert set(index.values(property, node)) == {o for s, p, o in expected if (s, p) == (node, property)}
        found = set(index.values(property, node, backwards=True))
        assert found == {s for s, p, o in expected if (p, o) == (property, node)}


def test_unknown_resources_have_no_values() -> None:
    closure: TransitiveClosure[Iri] = TransitiveClosure([])
    assert closure.path(NODES[0], NODES[1]) == ()
    assert dict(closure.above(NODES[0])) == {NODES[0]: 0}
    assert PropertyHierarchy(ox.Store()).values(PROPERTIES[0], NODES[0]) == ()


@pytest.mark.parametrize("length", [2, 3000])
def test_long_chains_and_cycles_are_handled(length: int) -> None:
    ring = [Iri(f"http://example.org/{number}") for number in range(length)]
    closure = TransitiveClosure(zip(ring, [*ring[1:], ring[0]], strict=True))
    assert set(closure.above(ring[0])) == set(closure.below(ring[0])) == set(ring)
    assert len(closure.path(ring[0], ring[-1])) == length
