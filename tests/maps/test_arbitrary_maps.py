"""Arbitrary statements in arbitrary order: reading does not fail, loses nothing, and survives a round trip."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import msgspec
import pyoxigraph as ox
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy
from msgspec.structs import replace

from mindstage.errors import SourceParseError
from mindstage.maps import bundled_kitchen, save_map
from mindstage.scene import Body, Joint, Light, NamedResource, World
from tests.maps.small_maps import (
    KNOWROB,
    OWL,
    RDFS,
    ROOM_NAMESPACE,
    XSD,
    body_turtle,
    knowledge_base_from,
    room_map,
    slide_joint,
)
from tests.maps.test_round_trip import statements

T = TypeVar("T")
Owner = TypeVar("Owner", Body, Joint, Light, NamedResource)

DESCRIBED = ox.NamedNode(KNOWROB + "describedInMap")
MS = "http://mindstage.org/ontology#"
GOOD = room_map(
    body_turtle("table", 'k:mobility "static" ; k:mass "20.0"^^xsd:float ; k:tagsData "SemLog;Id,t;" ; k:child :cup'),
    body_turtle("cup", 'ms:material [ ms:index 0 ; ms:name "glaze" ] ; rdfs:label "cup"'),
    body_turtle("box", 'k:depthOfObject "1.0"^^xsd:float'),
    body_turtle("lamp", cls="ms:SpotLight"),
    slide_joint("slide", "table", "box"),
    *(
        f"k:Cup rdfs:subClassOf [ a owl:Restriction ; owl:onProperty k:{axis}OfObject ; owl:hasValue {extent} ] ."
        for axis, extent in (("depth", 1), ("width", 2), ("height", 3))
    ),
    "k:Cup rdfs:subClassOf k:Vessel . k:Vessel owl:equivalentClass k:Cup .",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of files that Hypothesis writes, which may overwrite one another."""
    return tmp_path_factory.mktemp("anything")


def valid_quads() -> list[ox.Quad]:
    return list(ox.parse(GOOD, ox.RdfFormat.TURTLE))


def arbitrary_statements() -> SearchStrategy[ox.Quad]:
    """Any combination of subject, property and value that a map dialect uses."""
    individuals = [ROOM_NAMESPACE + name for name in ("room", "other", "table", "cup", "box", "lamp", "slide", "ghost")]
    parts = [
        ROOM_NAMESPACE + name for name in ("cup-pose", "table-pose", "slide-linear", "slide-pose-2", "slide-angular")
    ]
    classes = [KNOWROB + name for name in ("Cup", "Vessel", "Constraint", "Pose", "SemanticEnvironmentMap")]
    classes += [MS + "PointLight", OWL + "NamedIndividual", OWL + "Thing", OWL + "Restriction", OWL + "Class"]
    properties = [quad.predicate for quad in valid_quads()]
    properties += [ox.NamedNode(MS + name) for name in ("id", "tags", "untold", "shape", "colour", "path", "intensity")]
    properties += [ox.NamedNode(RDFS + "label"), ox.NamedNode(OWL + "equivalentClass")]
    named = st.sampled_from([ox.NamedNode(name) for name in (*individuals, *parts, *classes)])
    nameless = st.sampled_from([ox.BlankNode(name) for name in ("a", "b", "c")])
    texts = st.sampled_from(["", "1 2 3", "1 0 0 0", "0 0 0 0", "nan", "1,5", "2", "-1", "SemLog;k,v;", "A;", "true"])
    types = st.sampled_from([ox.NamedNode(XSD + name) for name in ("string", "float", "integer", "boolean")])
    literals = st.builds(lambda text, kind: ox.Literal(text, datatype=kind), texts, types)
    spoken = texts.map(lambda text: ox.Literal(text, language="de"))
    property_values = st.sampled_from(sorted(set(properties), key=str))
    return st.builds(
        ox.Quad, named | nameless, st.sampled_from(properties), named | nameless | literals | spoken | property_values
    ).filter(
        lambda quad: getattr(quad.subject, "value", "") not in parts or "describedInMap" not in str(quad.predicate)
    )


@st.composite
def mutated_maps(draw: st.DrawFn) -> list[ox.Quad]:
    """A valid map with some statements removed, added and reordered."""
    quads = valid_quads()
    for index in sorted(draw(st.sets(st.integers(0, len(quads) - 1), max_size=6)), reverse=True):
        quads.pop(index)
    for quad in draw(st.lists(arbitrary_statements(), max_size=8)):
        quads.insert(draw(st.integers(0, len(quads))), quad)
    return quads


def normalized(world: World) -> World:
    """The world in a canonical order; only the orders of tags and materials are significant."""

    def in_order(items: tuple[T, ...]) -> tuple[T, ...]:
        return tuple(sorted(items, key=msgspec.json.encode))

    def with_facts(items: tuple[Owner, ...]) -> tuple[Owner, ...]:
        return in_order(tuple(replace(item, facts=in_order(item.facts)) for item in items))

    return replace(
        world,
        bodies=with_facts(world.bodies),
        joints=with_facts(world.joints),
        attachments=in_order(world.attachments),
        lights=with_facts(world.lights),
        facts=in_order(world.facts),
        resources=with_facts(world.resources),
    )


@given(quads=mutated_maps())
def test_no_statement_is_lost(quads: list[ox.Quad], folder: Path) -> None:
    path, out = folder / "map.ttl", folder / "out.ttl"
    ox.serialize(quads, path, ox.RdfFormat.TURTLE)
    knowledge = knowledge_base_from(path)
    for map in knowledge.maps():
        world = knowledge.world(map)
        assert knowledge.map_statistics(map).individuals >= len(world.bodies) + len(world.joints) + len(world.lights)
        save_map(world, out)
        assert normalized(knowledge_base_from(out).world(map)) == normalized(world)
    if knowledge.maps() == (ROOM_NAMESPACE + "room",):
        assert set(statements(path)) - set(statements(out)) == set()


@given(data=st.data())
def test_a_damaged_file_is_read_or_refused(data: st.DataObject, folder: Path) -> None:
    path = folder / "map.owl"
    text = bundled_kitchen().read_bytes()[:40_000] + b"\n</rdf:RDF>"
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 200)))
    path.write_bytes(text[:start] + data.draw(st.binary(max_size=8)) + text[end:])
    with suppress(SourceParseError):
        knowledge = knowledge_base_from(path)
        assert all(knowledge.world(map).iri == map for map in knowledge.maps())
