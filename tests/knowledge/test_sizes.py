"""Sizes come from classes, from those above them, or from bodies themselves."""

from __future__ import annotations

from mindstage.knowledge import write_map
from mindstage.world import Fact, Iri, Literal
from tests.knowledge.maps import XSD, Read, body, knowrob, m, room


def float_fact(property: str, text: str) -> Fact:
    return Fact(knowrob(property), Literal(text, Iri(XSD + "float")))


def sized(cls: str, **extents: object) -> str:
    return " ".join(
        f"k:{cls} rdfs:subClassOf [ a owl:Restriction ; owl:onProperty k:{axis}OfObject ; "
        f'owl:hasValue "{extent}"^^xsd:float ] .'
        for axis, extent in extents.items()
    )


def test_sizes_come_from_classes(read: Read) -> None:
    world, findings = read(room(body("cup"), sized("Cup", depth=0.1, width=177.512833, height=0.3)))
    assert world.bodies[0].size == (0.1, 177.512833, 0.3)
    assert findings == ()


def test_each_extent_comes_from_the_nearest_class_that_tells_it(read: Read) -> None:
    above = "k:Cup rdfs:subClassOf k:Vessel . k:Vessel rdfs:subClassOf k:Thing ."
    world, _ = read(
        room(
            body("cup"),
            above,
            sized("Cup", depth=1),
            sized("Vessel", depth=2, width=3),
            sized("Thing", width=4, height=5),
        )
    )
    assert world.bodies[0].size == (1.0, 3.0, 5.0)


def test_a_body_knows_its_size_better_than_its_class(read: Read) -> None:
    world, findings = read(
        room(body("cup", 'k:depthOfObject "9.0"^^xsd:float'), sized("Cup", depth=1, width=2, height=3))
    )
    assert world.bodies[0].size == (9.0, 2.0, 3.0)
    assert world.bodies[0].facts == ()
    assert findings == ()


def test_a_size_that_is_told_in_part_is_none_and_that_is_said(read: Read) -> None:
    world, (finding,) = read(room(body("cup", 'k:depthOfObject "9.0"^^xsd:float'), sized("Cup", width=2)))
    assert world.bodies[0].size is None
    assert world.bodies[0].facts == (float_fact("depthOfObject", "9.0"),)
    assert (finding.individual, finding.property) == (m("cup"), knowrob("heightOfObject"))


def test_a_class_that_is_told_twice_keeps_its_first_size_and_that_is_said(read: Read) -> None:
    world, findings = read(
        room(body("cup"), sized("Cup", depth=1, width=2, height=3), sized("Cup", depth=4, width=2, height=3))
    )
    assert world.bodies[0].size == (1.0, 2.0, 3.0)
    (finding,) = findings
    assert (finding.individual, finding.property) == (knowrob("Cup"), knowrob("depthOfObject"))
    assert "1.0" in finding.what
    assert "4.0" in finding.what


def test_restrictions_that_two_classes_share_count_for_both(read: Read) -> None:
    shared = '_:r a owl:Restriction ; owl:onProperty k:depthOfObject ; owl:hasValue "1.0"^^xsd:float .'
    both = "k:Cup rdfs:subClassOf _:r . k:Mug rdfs:subClassOf _:r ."
    rest = sized("Cup", width=2, height=3) + sized("Mug", width=4, height=5)
    world, _ = read(room(body("cup"), body("mug", cls="k:Mug"), shared, both, rest))
    assert [thing.size for thing in world.bodies] == [(1.0, 2.0, 3.0), (1.0, 4.0, 5.0)]


def test_superclasses_that_disagree_are_named(read: Read) -> None:
    world, findings = read(
        room(
            body("cup"),
            "k:Cup rdfs:subClassOf k:B, k:A .",
            sized("A", depth=1, width=2, height=3),
            sized("B", depth=4, width=2, height=3),
        )
    )
    assert world.bodies[0].size == (1.0, 2.0, 3.0)
    assert any(knowrob("A") in finding.what and knowrob("B") in finding.what for finding in findings)


def test_a_class_whose_extent_is_no_number_is_named(read: Read) -> None:
    world, findings = read(room(body("cup"), sized("Cup", depth="wide", width=2, height=3)))
    assert world.bodies[0].size is None
    assert knowrob("Cup") in {finding.individual for finding in findings}


def test_equal_classes_have_equal_sizes(read: Read) -> None:
    text = room(body("cup"), "k:Mug owl:equivalentClass k:Cup .", sized("Mug", depth=1, width=2, height=3))
    world, _ = read(text)
    assert world.bodies[0].size == (1.0, 2.0, 3.0)
    # Nothing needs to be said of the body itself, since the class goes into the same file.
    assert "depthOfObject" in write_map(world)
    assert write_map(world).count("depthOfObject") == 1
