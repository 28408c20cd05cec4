"""A reasoner that was updated with any sequence of changes equals a new one."""

from __future__ import annotations

from itertools import count
from pathlib import Path

import pyoxigraph as ox
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mindstage.knowledge.names import EntityType, NameIndex
from mindstage.knowledge.reasoner import Reasoner
from mindstage.knowledge.store_index import IndexFile
from mindstage.rdf.graphs import local_name, node_from_label
from mindstage.scene import Iri
from tests.maps.small_maps import OWL, RDFS, knowrob_iri

RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
RUNTIME = ox.NamedNode("http://example.org/runtime")
CLASSES = [Iri(f"http://example.org/class#{letter}") for letter in "ABCD"]
INDIVIDUALS = [Iri(f"http://example.org/thing#{letter}") for letter in "abcd"]
PROPERTIES = [Iri(f"http://example.org/property#{letter}") for letter in "pqr"]
MAP = Iri("http://example.org/map#room")
BLANKS = [Iri(f"_:{number}") for number in range(3)]

Triple = tuple[str, str, str]

classes = st.sampled_from(CLASSES)
expressions = st.sampled_from([*CLASSES, *BLANKS])
individuals_or_blanks = st.sampled_from([*INDIVIDUALS, BLANKS[0]])
properties = st.sampled_from(PROPERTIES)
lists = st.sampled_from([*BLANKS, RDF + "nil"])

triples = st.one_of(
    st.tuples(expressions, st.sampled_from([RDFS + "subClassOf", OWL + "equivalentClass"]), expressions),
    st.tuples(classes, st.just(OWL + "disjointWith"), expressions),
    st.tuples(
        individuals_or_blanks,
        st.just(RDF + "type"),
        st.sampled_from([*CLASSES, *BLANKS, knowrob_iri("Pose"), OWL + "Class"]),
    ),
    st.tuples(
        st.sampled_from([*INDIVIDUALS, MAP]), st.just(RDF + "type"), st.just(knowrob_iri("SemanticEnvironmentMap"))
    ),
    st.tuples(individuals_or_blanks, st.just(knowrob_iri("describedInMap")), st.sampled_from([MAP, INDIVIDUALS[0]])),
    st.tuples(individuals_or_blanks, properties, individuals_or_blanks),
    st.tuples(properties, st.sampled_from([RDFS + "subPropertyOf", OWL + "inverseOf"]), properties),
    st.tuples(properties, st.just(OWL + "propertyChainAxiom"), lists),
    st.tuples(properties, st.just(RDF + "type"), st.just(OWL + "TransitiveProperty")),
    st.tuples(properties, st.sampled_from([RDFS + "domain", RDFS + "range"]), expressions),
    st.tuples(st.sampled_from(BLANKS), st.just(OWL + "onProperty"), properties),
    st.tuples(st.sampled_from(BLANKS), st.just(OWL + "someValuesFrom"), expressions),
    st.tuples(st.sampled_from(BLANKS), st.just(OWL + "hasValue"), individuals_or_blanks),
    st.tuples(expressions, st.sampled_from([OWL + "unionOf", OWL + "intersectionOf", OWL + "oneOf"]), lists),
    st.tuples(expressions, st.just(OWL + "complementOf"), expressions),
    st.tuples(lists, st.just(RDF + "first"), st.one_of(expressions, individuals_or_blanks, properties)),
    st.tuples(lists, st.just(RDF + "rest"), lists),
)
some_triples = st.lists(triples, min_size=1, max_size=8)
changes = st.lists(
    st.one_of(
        st.tuples(st.just("tell"), some_triples),
        st.tuples(st.just("retract"), st.lists(st.integers(0, 1000), min_size=1, max_size=4)),
        st.tuples(st.just("load"), some_triples),
    ),
    min_size=1,
    max_size=5,
)


def quads(triples: list[Triple], graph: ox.NamedNode) -> list[ox.Quad]:
    return [ox.Quad(node_from_label(Iri(s)), ox.NamedNode(p), node_from_label(Iri(o)), graph) for s, p, o in triples]


def everything(index: Reasoner) -> dict[str, object]:
    """All results of a reasoner."""
    axioms, individuals, nodes = index.axioms, index.individuals, [*INDIVIDUALS, *BLANKS]
    return {
        "above": {cls: dict(index.classes.above(cls)) for cls in CLASSES},
        "below": {cls: dict(index.classes.below(cls)) for cls in CLASSES},
        "own": {cls: axioms.own_restrictions(cls) for cls in CLASSES},
        "naming": {(p, cls): list(index.restrictions_with_filler(p, cls)) for p in PROPERTIES for cls in CLASSES},
        "stating": {p: list(index.restrictions_on(p)) for p in PROPERTIES},
        "apart": {(one, other): index.are_disjoint(one, other) for one in CLASSES for other in CLASSES},
        "conditions": set(axioms.sufficient_conditions),
        "classes": {cls for cls in [*CLASSES, *INDIVIDUALS] if index.is_class(cls)},
        "types": {node: (index.types.get(node), index.types_of(node)) for node in nodes},
        "justifications": {node: dict(index.instance_checker.justifications(node)) for node in nodes},
        "members": {(cls, map): index.members(cls, map) for cls in CLASSES for map in (None, MAP)},
        "residents": {map: set(residents) for map, residents in index.members_by_map.items()},
        "maps": index.maps_of,
        "untyped": set(individuals.untyped),
        "declared": {kind: set(declared) for kind, declared in individuals.declared.items()},
        "expressions": {individual: set(types) for individual, types in individuals.anonymous_types.items()},
        "here": {key: set(here) for key, here in individuals.members_by_map_and_class.items()},
        "properties": {p: index.properties.super_properties(p) for p in PROPERTIES},
        "steps": {
            (p, t): sorted(map(repr, index.properties.steps(((p, True),), t))) for p in PROPERTIES for t in nodes
        },
        "values": {(p, t): set(index.properties.values(p, t)) for p in PROPERTIES for t in nodes},
        "property names": {p for p in PROPERTIES if index.is_property(p)},
    }


def meanings(names: NameIndex) -> dict[str, object]:
    return {name: names.find_any(name) for name in map(local_name, [*CLASSES, *INDIVIDUALS, *PROPERTIES, MAP])}


@given(st.lists(triples, max_size=12), changes)
def test_an_updated_reasoner_equals_a_new_one(start: list[Triple], steps: list[tuple[str, list]]) -> None:
    store, numbers = ox.Store(), count()
    store.extend(quads(start, RUNTIME))
    index = Reasoner(store)
    names = NameIndex(store, index)
    meanings(names)
    everything(index)
    for action, arguments in steps:
        if action == "load":
            graph = ox.NamedNode(f"http://example.org/file/{next(numbers)}")
            store.extend(quads(arguments, graph))
            names.add(index.add_graph(graph))
        else:
            existing = sorted(store, key=str)
            touched = (
                quads(arguments, RUNTIME)
                if action == "tell"
                else [existing[at % len(existing)] for at in arguments if existing]
            )
            for quad in touched:
                store.add(quad) if action == "tell" else store.remove(quad)
            index.update(touched)
            names.add(Iri(node.value) for quad in touched for node in quad.triple if isinstance(node, ox.NamedNode))
        afresh = Reasoner(store)
        assert everything(index) == everything(afresh)
        assert meanings(names) == meanings(NameIndex(store, afresh))


@given(st.lists(triples, max_size=12), changes)
@settings(max_examples=40)
def test_a_reasoner_restored_from_an_index_and_updated_equals_a_new_one(
    tmp_path_factory: pytest.TempPathFactory, start: list[Triple], steps: list[tuple[str, list]]
) -> None:
    store, numbers = ox.Store(), count()
    store.extend(quads(start, RUNTIME))
    file = IndexFile(tmp_path_factory.mktemp("index"), Path("none"), read_only=False)
    index = Reasoner(store)
    names = NameIndex(store, index)
    for action, arguments in steps:
        file.save(index, names, maps_by_source={})
        saved = file.load()
        assert saved is not None
        index = saved.reasoner(store)
        names = saved.name_index(store, index)
        if action == "load":
            graph = ox.NamedNode(f"http://example.org/file/{next(numbers)}")
            store.extend(quads(arguments, graph))
            names.add(index.add_graph(graph))
        else:
            existing = sorted(store, key=str)
            touched = (
                quads(arguments, RUNTIME)
                if action == "tell"
                else [existing[at % len(existing)] for at in arguments if existing]
            )
            for quad in touched:
                store.add(quad) if action == "tell" else store.remove(quad)
            index.update(touched)
            names.add(Iri(node.value) for quad in touched for node in quad.triple if isinstance(node, ox.NamedNode))
        afresh = Reasoner(store)
        assert everything(index) == everything(afresh)
        assert meanings(names) == meanings(NameIndex(store, afresh))


def test_names_resolve_to_current_entities() -> None:
    store = ox.Store()
    index = Reasoner(store)
    names = NameIndex(store, index)
    (quad,) = quads([(INDIVIDUALS[0], RDF + "type", CLASSES[0])], RUNTIME)
    for change, meaning in ((store.add, (CLASSES[0], EntityType.CLASS)), (store.remove, None), (store.add, None)):
        change(quad)
        index.update([quad])
        names.add([CLASSES[0], INDIVIDUALS[0]])
        assert names.find_any("A") == (meaning if change == store.remove else (CLASSES[0], EntityType.CLASS))
