"""Sizes of bodies are given by the body, its class or a superclass."""

from __future__ import annotations

from pathlib import Path

from msgspec.structs import replace

from mindstage.knowledge import KnowledgeBase
from mindstage.maps import write_map
from mindstage.scene import Iri, Literal, PropertyAssertion
from tests.maps.small_maps import XSD, ReadMap, body_turtle, individual, knowrob_iri, room_map


def float_fact(property: str, text: str) -> PropertyAssertion:
    return PropertyAssertion(knowrob_iri(property), Literal(text, Iri(XSD + "float")))


def sized(cls: str, **extents: object) -> str:
    return " ".join(
        f"k:{cls} rdfs:subClassOf [ a owl:Restriction ; owl:onProperty k:{axis}OfObject ; "
        f'owl:hasValue "{extent}"^^xsd:float ] .'
        for axis, extent in extents.items()
    )


def test_sizes_come_from_classes(read: ReadMap) -> None:
    world, findings = read(room_map(body_turtle("cup"), sized("Cup", depth=0.1, width=177.512833, height=0.3)))
    assert world.bodies[0].size == (0.1, 177.512833, 0.3)
    assert findings == ()


def test_each_extent_comes_from_the_nearest_class_that_gives_it(read: ReadMap) -> None:
    above = "k:Cup rdfs:subClassOf k:Vessel . k:Vessel rdfs:subClassOf k:Thing ."
    world, _ = read(
        room_map(
            body_turtle("cup"),
            above,
            sized("Cup", depth=1),
            sized("Vessel", depth=2, width=3),
            sized("Thing", width=4, height=5),
        )
    )
    assert world.bodies[0].size == (1.0, 3.0, 5.0)


def test_the_size_of_a_body_takes_precedence_over_that_of_its_class(read: ReadMap) -> None:
    world, findings = read(
        room_map(body_turtle("cup", 'k:depthOfObject "9.0"^^xsd:float'), sized("Cup", depth=1, width=2, height=3))
    )
    assert world.bodies[0].size == (9.0, 2.0, 3.0)
    assert world.bodies[0].facts == ()
    assert findings == ()


def test_an_incomplete_size_is_none_and_reported(read: ReadMap) -> None:
    world, (finding,) = read(room_map(body_turtle("cup", 'k:depthOfObject "9.0"^^xsd:float'), sized("Cup", width=2)))
    assert world.bodies[0].size is None
    assert world.bodies[0].facts == (float_fact("depthOfObject", "9.0"),)
    assert (finding.individual, finding.property) == (individual("cup"), knowrob_iri("heightOfObject"))


def test_the_first_of_two_sizes_of_a_class_counts_and_the_second_is_reported(read: ReadMap) -> None:
    world, findings = read(
        room_map(body_turtle("cup"), sized("Cup", depth=1, width=2, height=3), sized("Cup", depth=4, width=2, height=3))
    )
    assert world.bodies[0].size == (1.0, 2.0, 3.0)
    (finding,) = findings
    assert (finding.individual, finding.property) == (knowrob_iri("Cup"), knowrob_iri("depthOfObject"))
    assert "1.0" in finding.problem
    assert "4.0" in finding.problem


def test_a_restriction_shared_by_two_classes_applies_to_both(read: ReadMap) -> None:
    shared = '_:r a owl:Restriction ; owl:onProperty k:depthOfObject ; owl:hasValue "1.0"^^xsd:float .'
    both = "k:Cup rdfs:subClassOf _:r . k:Mug rdfs:subClassOf _:r ."
    rest = sized("Cup", width=2, height=3) + sized("Mug", width=4, height=5)
    world, _ = read(room_map(body_turtle("cup"), body_turtle("mug", cls="k:Mug"), shared, both, rest))
    assert [body.size for body in world.bodies] == [(1.0, 2.0, 3.0), (1.0, 4.0, 5.0)]


def test_contradicting_superclasses_are_reported(read: ReadMap) -> None:
    world, findings = read(
        room_map(
            body_turtle("cup"),
            "k:Cup rdfs:subClassOf k:B, k:A .",
            sized("A", depth=1, width=2, height=3),
            sized("B", depth=4, width=2, height=3),
        )
    )
    assert world.bodies[0].size == (1.0, 2.0, 3.0)
    assert any(knowrob_iri("A") in finding.problem and knowrob_iri("B") in finding.problem for finding in findings)


def test_an_extent_that_is_not_a_number_is_reported(read: ReadMap) -> None:
    world, findings = read(room_map(body_turtle("cup"), sized("Cup", depth="wide", width=2, height=3)))
    assert world.bodies[0].size is None
    assert knowrob_iri("Cup") in {finding.individual for finding in findings}


def test_equal_classes_have_equal_sizes(read: ReadMap) -> None:
    text = room_map(body_turtle("cup"), "k:Mug owl:equivalentClass k:Cup .", sized("Mug", depth=1, width=2, height=3))
    world, _ = read(text)
    assert world.bodies[0].size == (1.0, 2.0, 3.0)
    # The body itself needs no statement, since the class is written to the same file.
    assert "depthOfObject" in write_map(world)
    assert write_map(world).count("depthOfObject") == 1


def given(property: str, value: str) -> str:
    return f'[ a owl:Restriction ; owl:onProperty k:{property} ; owl:hasValue "{value}" ]'


MESH_AND_SIZE = (
    f"k:Cup a owl:Class ; rdfs:subClassOf {given('boundingBoxSize', '0.5 0.8 0.14')}, "
    f"{given('pathToCadModel', 'package://shapes/cup.stl')} ."
)


def test_a_class_gives_a_mesh_and_a_size_as_one_text(read: ReadMap) -> None:
    world, findings = read(room_map(body_turtle("cup"), MESH_AND_SIZE))
    (cup,) = world.bodies
    assert (cup.size, cup.mesh) == ((0.5, 0.8, 0.14), "package://shapes/cup.stl")
    assert cup.pose.position == read(room_map(body_turtle("cup")))[0].bodies[0].pose.position
    assert findings == ()
    again = write_map(world)
    assert again.count("cup.stl") == again.count("0.5 0.8 0.14") == 1
    assert read(again, suffix=".owl")[0] == world


def test_a_body_may_differ_from_its_class_in_mesh_and_size(read: ReadMap) -> None:
    own = 'k:pathToCadModel "own.stl" ; k:boundingBoxSize "1 2 3"'
    world, _ = read(room_map(body_turtle("cup", own), MESH_AND_SIZE))
    (cup,) = world.bodies
    assert (cup.size, cup.mesh) == ((1.0, 2.0, 3.0), "own.stl")
    for changed in (replace(cup, mesh=None), replace(cup, size=None), replace(cup, size=(4.0, 2.0, 3.0))):
        (again,) = read(write_map(replace(world, bodies=(changed,))), suffix=".owl")[0].bodies
        assert (again.size, again.mesh) == (changed.size, changed.mesh)


def test_values_come_through_intersections_and_equivalent_classes(read: ReadMap) -> None:
    both = f"owl:intersectionOf ( k:Vessel {given('boundingBoxSize', '0.5 0.8 0.14')} )"
    vessel = f"k:Vessel a owl:Class ; rdfs:subClassOf {given('pathToCadModel', 'vessel.stl')} ."
    for axiom in ("rdfs:subClassOf", "owl:equivalentClass"):
        world, _ = read(room_map(body_turtle("cup"), vessel, f"k:Cup a owl:Class ; {axiom} [ a owl:Class ; {both} ] ."))
        assert (world.bodies[0].size, world.bodies[0].mesh) == ((0.5, 0.8, 0.14), "vessel.stl")
    world, _ = read(room_map(body_turtle("cup"), vessel, f"k:Cup a owl:Class ; {both} ."))
    assert (world.bodies[0].size, world.bodies[0].mesh) == ((0.5, 0.8, 0.14), "vessel.stl")


def test_the_nearest_class_gives_the_mesh_and_contradictions_are_reported(read: ReadMap) -> None:
    above = "k:Cup rdfs:subClassOf k:B, k:A . k:B rdfs:subClassOf k:Thing . k:A rdfs:subClassOf k:Thing ."
    meshes = [f"k:{name} rdfs:subClassOf {given('pathToCadModel', f'{name}.stl')} ." for name in ("A", "B", "Thing")]
    world, findings = read(room_map(body_turtle("cup"), above, *meshes))
    assert world.bodies[0].mesh == "A.stl"
    assert [finding.property for finding in findings] == [knowrob_iri("pathToCadModel")]
    assert "disagree" in findings[0].problem


def test_a_class_of_an_ontology_gives_values_without_statements_about_the_body(tmp_path: Path) -> None:
    text = room_map(body_turtle("cup"))
    (tmp_path / "map.ttl").write_text(text, encoding="utf-8")
    ontology = room_map(MESH_AND_SIZE).replace(", k:SemanticEnvironmentMap", "")
    (tmp_path / "classes.ttl").write_text(ontology, encoding="utf-8")
    with KnowledgeBase() as kb:
        kb.load(tmp_path / "map.ttl", ontologies=tmp_path / "classes.ttl")
        world, view = kb.world(), kb.source_view()
        (row,) = kb.ask("what_is", individual=individual("cup"))
        because = kb.explain("what_is", row)
    assert (world.bodies[0].size, world.bodies[0].mesh) == ((0.5, 0.8, 0.14), "package://shapes/cup.stl")
    assert "every Cup: boundingBoxSize 0.5 0.8 0.14" in str(because)
    assert "every Cup: pathToCadModel package://shapes/cup.stl" in str(because)
    moved = replace(world.bodies[0], pose=replace(world.bodies[0].pose, position=(4.0, 5.0, 6.0)))
    for each in (world, replace(world, bodies=(moved,))):
        written = write_map(each, source_view=view)
        assert "cup.stl" not in written
        assert "OfObject rdf:datatype" not in written
