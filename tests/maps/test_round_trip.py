"""Writing and reading are inverse: no world and no statement is lost."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import pyoxigraph as ox
import pytest
from hypothesis import given
from msgspec.structs import replace

from mindstage.maps import MapFormat, UnitConventions, UnstatedMobility, bundled_kitchen, save_map, write_map
from mindstage.scene import (
    Attachment,
    BlankNode,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    IriRef,
    Joint,
    Light,
    LightType,
    Literal,
    Material,
    NamedResource,
    Pose,
    PrimitiveShape,
    PropertyAssertion,
    Tag,
    World,
)
from tests.cases import each_case
from tests.kitchenette import kitchenette
from tests.maps.small_maps import (
    XSD,
    ReadMap,
    assert_worlds_equal,
    body_turtle,
    individual,
    knowledge_base_from,
    knowrob_iri,
    room_map,
    slide_joint,
)
from tests.worlds import worlds

SUFFIXES = {MapFormat.RDF_XML: ".owl", MapFormat.TURTLE: ".ttl"}
each_format = pytest.mark.parametrize("format", MapFormat)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for all examples of Hypothesis, which overwrite their files."""
    return tmp_path_factory.mktemp("maps")


AS_STATED = UnitConventions(mobility=UnstatedMobility.STATIC)


def read_back(world: World, folder: Path, format: MapFormat, *, bundled_ontology: bool = False) -> World:
    """The world of a file; a mobility that it does not give is assumed for no body."""
    path = folder / f"written{SUFFIXES[format]}"
    path.write_text(write_map(world, format=format), encoding="utf-8", newline="")
    return knowledge_base_from(path, bundled_ontology=bundled_ontology, conventions=AS_STATED).world(world.iri)


# -- worlds ------------------------------------------------------------------------------------------------------------


@each_format
@given(world=worlds(wild_tags=True))
def test_any_world_comes_back_from_its_file(world: World, format: MapFormat, folder: Path) -> None:
    assert_worlds_equal(world, read_back(world, folder, format))


@each_format
@given(world=worlds(labels=True))
def test_a_world_that_was_read_is_written_identically(world: World, format: MapFormat, folder: Path) -> None:
    # With labels, the first reading may change the form: a blank node with one reference is nested.
    once = read_back(world, folder, format)
    assert read_back(once, folder, format) == once


@given(world=worlds())
def test_both_formats_have_the_same_statements(world: World, folder: Path) -> None:
    assert read_back(world, folder, MapFormat.RDF_XML) == read_back(world, folder, MapFormat.TURTLE)


@given(world=worlds())
def test_the_bundled_ontology_does_not_change_the_result(world: World, folder: Path) -> None:
    assert_worlds_equal(world, read_back(world, folder, MapFormat.RDF_XML, bundled_ontology=True))


def test_writing_is_deterministic() -> None:
    assert write_map(kitchenette()) == write_map(kitchenette())


CUP = Body(id=BodyId("cup"), iri=individual("cup"), cls=knowrob_iri("Cup"), pose=Pose((1.0, 2.0, 3.0)))
TABLE = replace(CUP, id=BodyId("table"), iri=individual("table"))


def world_of(*bodies: Body, **more: object) -> World:
    return replace(World(iri=individual("room"), name="room"), bodies=bodies, **more)


def fact(property: str, text: str, datatype: str | None = None) -> PropertyAssertion:
    return PropertyAssertion(Iri(property), Literal(text, Iri(XSD + datatype) if datatype else None))


SIZED = NamedResource(
    knowrob_iri("Cup"),
    tuple(
        PropertyAssertion(
            Iri("http://www.w3.org/2000/01/rdf-schema#subClassOf"),
            BlankNode(
                (
                    PropertyAssertion(
                        Iri("http://www.w3.org/2002/07/owl#hasValue"), Literal("0.50", Iri(XSD + "float"))
                    ),
                    PropertyAssertion(
                        Iri("http://www.w3.org/2002/07/owl#onProperty"), IriRef(knowrob_iri(f"{axis}OfObject"))
                    ),
                )
            ),
        )
        for axis in ("depth", "width", "height")
    ),
)

UNUSUAL = {
    "nothing": world_of(),
    "a name of its own": replace(world_of(), name="The kitchen"),
    "no name": replace(world_of(), name=""),
    "an id of its own": world_of(replace(CUP, id=BodyId("a b/c#d"))),
    "ids that are swapped": world_of(replace(CUP, id=BodyId("table")), replace(TABLE, id=BodyId("cup"))),
    "equal local names": world_of(CUP, replace(CUP, id=BodyId("other"), iri=Iri("http://elsewhere.org/#cup"))),
    "an empty local name": world_of(replace(CUP, iri=Iri("http://e/x#"), id=BodyId("http://e/x#"))),
    "a body called like a pose": world_of(CUP, replace(TABLE, iri=individual("cup-pose"), id=BodyId("cup-pose"))),
    "a fact that mentions a pose": world_of(
        replace(CUP, facts=(PropertyAssertion(individual("a"), IriRef(individual("cup-pose"))),))
    ),
    "minus nought": world_of(replace(CUP, pose=Pose((-0.0, 0.0, 0.0), (-0.0, 1.0, 0.0, 0.0)))),
    "tiny and huge": world_of(
        replace(CUP, pose=Pose((5e-324, 1.7e300, 0.1 + 0.2)), physics=BodyPhysics(mass_kg=1e-300))
    ),
    "an owl:Thing": world_of(replace(CUP, cls=Iri("http://www.w3.org/2002/07/owl#Thing"))),
    "an empty label": world_of(replace(CUP, label="")),
    "a label in a language only": world_of(
        replace(
            CUP,
            facts=(
                PropertyAssertion(Iri("http://www.w3.org/2000/01/rdf-schema#label"), Literal("Tasse", language="de")),
            ),
        )
    ),
    "a mass that is only a fact": world_of(replace(CUP, facts=(fact(knowrob_iri("mass"), "5.0", "float"),))),
    "a stale fact": world_of(
        replace(CUP, physics=BodyPhysics(mass_kg=1.0), facts=(fact(knowrob_iri("mass"), "5.0", "double"),))
    ),
    "no size though the class has one": world_of(CUP, resources=(SIZED,)),
    "the size of the class": world_of(replace(CUP, size=(0.5, 0.5, 0.5)), resources=(SIZED,)),
    "partly the size of the class": world_of(replace(CUP, size=(0.5, 0.7, 0.5)), resources=(SIZED,)),
    "a size of nothing": world_of(replace(CUP, size=(0.0, 0.0, 0.0))),
    "tags with all the wrong letters": world_of(
        replace(CUP, tags=(Tag(type="a;b", key="c,d", value="e;\x00\ud800"), Tag(type="", key="", value="")))
    ),
    "no tags though a fact has some": world_of(replace(CUP, facts=(fact(knowrob_iri("tagsData"), "A;k,v"),))),
    "one material twice": world_of(replace(CUP, materials=(Material(name="a", path="b"),) * 2)),
    "letters that XML escapes": world_of(replace(CUP, label="<&>\"' ]]> \t\r\n\r\n  ")),
    "letters from far away": world_of(replace(CUP, label="Küche 名 😀", iri=individual("Küche"), id=BodyId("Küche"))),
    "a property with strange letters": world_of(replace(CUP, facts=(fact("http://e/größe", "1"),))),
    "a name of which no prefix can be made": world_of(facts=(fact("http://e/_x#a", "1"), fact("http://e/xml#a", "1"))),
    "a shape": world_of(replace(CUP, shape=PrimitiveShape())),
    "attached and joined": world_of(
        CUP,
        TABLE,
        attachments=(Attachment(parent=TABLE.id, child=CUP.id),),
        joints=(
            Joint(
                id=BodyId("j"), iri=individual("j"), parent=CUP.id, child=TABLE.id, pose=Pose(), disable_collision=False
            ),
        ),
    ),
    "a light": world_of(lights=(Light(id=BodyId("l"), iri=individual("l"), type=LightType.SPOT, pose=Pose()),)),
    "a body without name": world_of(
        replace(CUP, iri=Iri("_:cup"), facts=(PropertyAssertion(individual("a"), IriRef(Iri("_:cup"))),)), TABLE
    ),
    "labels that no file can have": world_of(
        facts=(PropertyAssertion(individual("a"), IriRef(Iri("_:1 2"))),),
        resources=(
            NamedResource(
                Iri("_:1 2"),
                (
                    PropertyAssertion(individual("b"), IriRef(Iri("_:b1"))),
                    PropertyAssertion(individual("c"), IriRef(Iri("_:b1"))),
                ),
            ),
            NamedResource(Iri("_:b1"), (PropertyAssertion(individual("b"), IriRef(Iri("_:1 2"))),)),
        ),
    ),
    "names that Turtle would misread": world_of(
        facts=tuple(
            PropertyAssertion(individual(name), IriRef(individual(name)))
            for name in ("a.", "a-", "-a", "a%20b", "é.é", "_", "a..b")
        )
    ),
    "a language with a region": world_of(facts=(PropertyAssertion(individual("a"), Literal("x", language="pt-br")),)),
}


@each_format
@each_case("name", UNUSUAL)
def test_unusual_worlds_come_back(name: str, format: MapFormat, folder: Path) -> None:
    assert_worlds_equal(UNUSUAL[name], read_back(UNUSUAL[name], folder, format))


@each_format
def test_a_list_of_a_thousand_items_comes_back_in_pieces(format: MapFormat, folder: Path) -> None:
    end = BlankNode()
    for number in range(1000):
        end = BlankNode(
            (PropertyAssertion(individual("first"), Literal(str(number))), PropertyAssertion(individual("rest"), end))
        )
    world = read_back(world_of(facts=(PropertyAssertion(individual("list"), end),)), folder, format)
    text = write_map(world, format=format)
    assert [number for number in range(1000) if f">{number}<" not in text and f'"{number}"' not in text] == []
    assert read_back(world, folder, format) == world


# -- maps --------------------------------------------------------------------------------------------------------------

RDF_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"
OF_NUMBERS = {knowrob_iri("translation"), knowrob_iri("quaternion"), "http://mindstage.org/ontology#colour"}
NUMERIC = {XSD + name for name in ("float", "double", "decimal", "integer")}


def quads(path: Path) -> Iterable[ox.Quad]:
    format = ox.RdfFormat.TURTLE if path.suffix == ".ttl" else ox.RdfFormat.RDF_XML
    return ox.parse(path=path, format=format, base_iri="file:///same")


def statements(path: Path) -> ox.Dataset:
    """The canonical statements of a file, with numbers as values; equal for any labels of blank nodes."""
    statements = ox.Dataset()
    for quad in quads(path):
        term = quad.object
        if isinstance(term, ox.Literal) and (term.datatype.value in NUMERIC or quad.predicate.value in OF_NUMBERS):
            with suppress(ValueError):
                numbers = " ".join(repr(float(number)) for number in term.value.split())
                term = ox.Literal(numbers, datatype=term.datatype)
        statements.add(ox.Quad(quad.subject, quad.predicate, term))
    statements.canonicalize(ox.CanonicalizationAlgorithm.RDFC_1_0)
    return statements


def implied(statements: set[ox.Quad]) -> set[ox.Quad]:
    """Statements that the writer adds: both directions of a relation, and the type NamedIndividual."""
    turned = {ox.NamedNode(knowrob_iri("child")): ox.NamedNode(knowrob_iri("parent"))}
    turned |= {parent: child for child, parent in turned.items()}
    others = {ox.Quad(q.object, turned[q.predicate], q.subject) for q in statements if q.predicate in turned}  # type: ignore[arg-type]
    named = ox.NamedNode("http://www.w3.org/2002/07/owl#NamedIndividual")
    return others | {ox.Quad(q.subject, ox.NamedNode(RDF_TYPE), named) for q in statements}


@pytest.fixture(params=["iai-kitchen-original", "iai-kitchen-spawned", "knowrob1-ccrl", "bundled"])
def map_file(request: pytest.FixtureRequest) -> Path:
    """Maps of other projects, and our own."""
    if request.param == "bundled":
        return bundled_kitchen()
    folder: Path = request.getfixturevalue("shared_data")
    return folder / "maps" / f"{request.param}.owl"


BOX_PROPERTIES = {
    *map(knowrob_iri, ("depthOfObject", "widthOfObject", "heightOfObject")),
    *(f"http://mindstage.org/ontology#{name}" for name in ("givenSizes", "pivot")),
}
"""What a file states about boxes that were inferred, so that no reader infers them again."""


@each_format
def test_every_statement_of_a_map_comes_back(map_file: Path, format: MapFormat, tmp_path: Path) -> None:
    out = tmp_path / f"out{SUFFIXES[format]}"
    save_map(knowledge_base_from(map_file).world(), out)
    before, after = set(statements(map_file)), set(statements(out))
    assert before - after == set()
    if any(quad.predicate.value == knowrob_iri("describedInMap") for quad in before):  # else it is of another dialect,
        added = after - before - implied(before)  # which is written in the terms of dialect 1 too
        assert {quad.predicate.value for quad in added} <= BOX_PROPERTIES


def test_the_round_trip_needs_no_ontology(shared_data: Path, tmp_path: Path) -> None:
    map = shared_data / "maps" / "iai-kitchen-original.owl"
    world = knowledge_base_from(map, ontologies=(shared_data / "ontology",)).world()
    assert world == knowledge_base_from(map).world()


WRONG = {
    "no pose": ":x a k:Cup ; k:describedInMap :room .",
    "a bad pose": body_turtle("x", position="1,5 2 3"),
    "two poses": body_turtle("x") + ':x k:pose :y . :y k:translation "4 5 6" ; k:quaternion "1 0 0 0" ; e:a 1 .',
    "a bad pose and a good one": ':x a k:Cup ; k:describedInMap :room ; k:pose :b, :x-pose . :b k:translation "a" . '
    ':x-pose k:translation "4 5 6" ; k:quaternion "1 0 0 0" ; a k:Pose, owl:NamedIndividual .',
    "a shared pose": body_turtle("x") + ":y a k:Cup ; k:describedInMap :room ; k:pose :x-pose .",
    "a pose with further statements": body_turtle("x") + ":cup-pose e:a :x-pose . e:b e:c :x-pose .",
    "values that are none": body_turtle(
        "x", 'k:mass "heavy" ; k:mobility "flying" ; k:gravity 7 ; k:tagsData 5, "a;b"'
    ),
    "duplicate values": body_turtle("x", 'k:mass 1, 2 ; k:mobility "static", "dynamic" ; k:gravity true, false'),
    "a size in part": body_turtle("x", 'k:depthOfObject "1.0"^^xsd:float'),
    "two parents": body_turtle("a") + body_turtle("b") + body_turtle("x", "k:parent :a, :b"),
    "a circle": body_turtle("a", "k:parent :b", "k:child :b") + body_turtle("b", "k:parent :a", "k:child :a"),
    "an unknown child": body_turtle("x", "k:child :ghost"),
    "a missing end": body_turtle("a") + slide_joint("j", "a", "ghost"),
    "a bad motion": body_turtle("a")
    + body_turtle("b")
    + slide_joint("j", "a", "b").replace("k:xMotion 1", 'k:xMotion 2, "x"'),
    "a second end": body_turtle("a") + body_turtle("b") + body_turtle("c") + slide_joint("j", "a", "b", "k:child :c"),
    "bad materials": body_turtle("x", "ms:material [ ms:index 0 ]"),
    "a joint stated by the body": body_turtle("a", "k:child :j") + body_turtle("b") + slide_joint("j", "a", "b"),
}


@pytest.mark.parametrize("name", WRONG)
def test_errors_in_a_map_are_written_unchanged(name: str, read: ReadMap, tmp_path: Path) -> None:
    world, findings = read(room_map(WRONG[name]))
    save_map(world, tmp_path / "out.ttl")
    before, after = statements(tmp_path / "map.ttl"), statements(tmp_path / "out.ttl")
    assert set(before) - set(after) == set()
    again = knowledge_base_from(tmp_path / "out.ttl")
    assert_worlds_equal(world, again.world("room"))
    assert again.world("room") == world
    assert set(again.findings()) == set(findings)


def test_a_body_that_moved_away_from_a_shared_pose_gets_a_pose_of_its_own(read: ReadMap, tmp_path: Path) -> None:
    world, _ = read(room_map(body_turtle("x"), ":y a k:Cup ; k:describedInMap :room ; k:pose :x-pose ."))
    x, y = world.bodies
    moved = replace(world, bodies=(x, replace(y, pose=Pose((7.0, 8.0, 9.0)))))
    save_map(moved, tmp_path / "out.ttl")
    assert [body.pose for body in knowledge_base_from(tmp_path / "out.ttl").world().bodies] == [
        body.pose for body in moved.bodies
    ]


@pytest.mark.parametrize("position", [(1.0, 2.0, 3.0), (7.0, 8.0, 9.0)])
def test_a_blank_pose_with_further_statements(
    position: tuple[float, float, float], read: ReadMap, tmp_path: Path
) -> None:
    pose = '[ k:translation "1 2 3" ; k:quaternion "1 0 0 0" ; e:measured true ]'
    world, _ = read(room_map(f":x a k:Cup ; k:describedInMap :room ; k:pose {pose} ."))
    moved = replace(world, bodies=(replace(world.bodies[0], pose=Pose(position)),))
    save_map(moved, tmp_path / "out.ttl")
    again = knowledge_base_from(tmp_path / "out.ttl").world()
    assert again.bodies[0].pose == Pose(position)
    assert "measured" in str(again.bodies[0].facts)


def test_generated_ids_are_written(read: ReadMap, tmp_path: Path) -> None:
    world, findings = read(room_map(body_turtle("x", 'ms:id "y"'), body_turtle("y"), body_turtle("z", 'ms:id "y"')))
    assert len(findings) == 2
    save_map(world, tmp_path / "out.ttl")
    assert knowledge_base_from(tmp_path / "out.ttl").world() == world


# -- other readers -----------------------------------------------------------------------------------------------------


def prolog_count(swipl: Path, path: Path) -> int:
    goal = f"use_module(library(semweb/rdf11)), rdf_load('{path}', [format(xml), silent(true)])"
    count = "aggregate_all(count, rdf(_, _, _), Count), writeln(Count)"
    command = [swipl, "-g", f"{goal}, {count}", "-t", "halt"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert done.stderr == ""
    return int(done.stdout)


def test_swi_prolog_reads_all_written_statements(swipl: Path, map_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.owl"
    save_map(knowledge_base_from(map_file).world(), out)
    assert prolog_count(swipl, out) == len(set(quads(out)))


def test_swi_prolog_reads_unusual_worlds(swipl: Path, tmp_path: Path) -> None:
    for name, world in UNUSUAL.items():
        save_map(world, tmp_path / "out.owl")
        assert prolog_count(swipl, tmp_path / "out.owl") == len(set(quads(tmp_path / "out.owl"))), name


def test_knowrob_finds_individuals(tmp_path: Path) -> None:
    text = write_map(kitchenette())
    assert text.startswith('<?xml version="1.0" encoding="utf-8"?>\n\n<!DOCTYPE rdf:RDF[\n\t<!ENTITY owl')
    assert '<owl:NamedIndividual rdf:about="&m;Mug">' in text
    assert '<knowrob:describedInMap rdf:resource="&m;map"/>' in text
    assert '<knowrob:translation rdf:datatype="&xsd;string">2.0 0.0 0.85</knowrob:translation>' in text
    assert '<knowrob:tagsData rdf:datatype="&xsd;string">SemLog;' in text
    assert re.search(r"<!-- Individual Cup -->\n\t<owl:NamedIndividual", text)
