"""Whatever a map tells, in whatever order: nothing crashes, nothing is lost, and reading it again gives the same."""

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
from mindstage.knowledge import bundled_kitchen, save_map
from mindstage.scene import Body, Joint, Light, NamedResource, World
from tests.knowledge.maps import (
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
from tests.knowledge.test_round_trip import statements

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
    """Hypothesis writes many files; they may replace one another."""
    return tmp_path_factory.mktemp("anything")


def good() -> list[ox.Quad]:
    return list(ox.parse(GOOD, ox.RdfFormat.TURTLE))


def strange_statements() -> SearchStrategy[ox.Quad]:
    """Any subject, any property, any value, of those that mean something to somebody."""
    individuals = [ROOM_NAMESPACE + name for name in ("room", "other", "table", "cup", "box", "lamp", "slide", "ghost")]
    parts = [
        ROOM_NAMESPACE + name for name in ("cup-pose", "table-pose", "slide-linear", "slide-pose-2", "slide-angular")
    ]
    classes = [KNOWROB + name for name in ("Cup", "Vessel", "Constraint", "Pose", "SemanticEnvironmentMap")]
    classes += [MS + "PointLight", OWL + "NamedIndividual", OWL + "Thing", OWL + "Restriction", OWL + "Class"]
    properties = [quad.predicate for quad in good()]
    properties += [ox.NamedNode(MS + name) for name in ("id", "tags", "untold", "shape", "colour", "path", "intensity")]
    properties += [ox.NamedNode(RDFS + "label"), ox.NamedNode(OWL + "equivalentClass")]
    named = st.sampled_from([ox.NamedNode(name) for name in (*individuals, *parts, *classes)])
    nameless = st.sampled_from([ox.BlankNode(name) for name in ("a", "b", "c")])
    texts = st.sampled_from(["", "1 2 3", "1 0 0 0", "0 0 0 0", "nan", "1,5", "2", "-1", "SemLog;k,v;", "A;", "true"])
    types = st.sampled_from([ox.NamedNode(XSD + name) for name in ("string", "float", "integer", "boolean")])
    literals = st.builds(lambda text, kind: ox.Literal(text, datatype=kind), texts, types)
    spoken = texts.map(lambda text: ox.Literal(text, language="de"))
    untold = st.sampled_from(sorted(set(properties), key=str))
    return st.builds(
        ox.Quad, named | nameless, st.sampled_from(properties), named | nameless | literals | spoken | untold
    ).filter(
        lambda quad: getattr(quad.subject, "value", "") not in parts or "describedInMap" not in str(quad.predicate)
    )


@st.composite
def mutated_maps(draw: st.DrawFn) -> list[ox.Quad]:
    """A good map with some statements taken away, some strange ones put in, and others in another order."""
    said = good()
    for index in sorted(draw(st.sets(st.integers(0, len(said) - 1), max_size=6)), reverse=True):
        said.pop(index)
    for quad in draw(st.lists(strange_statements(), max_size=8)):
        said.insert(draw(st.integers(0, len(said))), quad)
    return said


def normalized(world: World) -> World:
    """The world in one order; none of a world's orders means anything, but for those of tags and materials."""

    def in_order(things: tuple[T, ...]) -> tuple[T, ...]:
        return tuple(sorted(things, key=msgspec.json.encode))

    def with_facts(things: tuple[Owner, ...]) -> tuple[Owner, ...]:
        return in_order(tuple(replace(thing, facts=in_order(thing.facts)) for thing in things))

    return replace(
        world,
        bodies=with_facts(world.bodies),
        joints=with_facts(world.joints),
        attachments=in_order(world.attachments),
        lights=with_facts(world.lights),
        facts=in_order(world.facts),
        resources=with_facts(world.resources),
    )


@given(said=mutated_maps())
def test_nothing_that_is_told_is_lost(said: list[ox.Quad], folder: Path) -> None:
    path, out = folder / "map.ttl", folder / "out.ttl"
    ox.serialize(said, path, ox.RdfFormat.TURTLE)
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
