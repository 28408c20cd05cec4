"""Sizes of bodies are given by the body, its class or a superclass."""

from __future__ import annotations

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
