"""Conventions of a map's numbers: their sources, and the assumptions and findings about them."""

from __future__ import annotations

from pathlib import Path

import pyoxigraph as ox
import pytest
from msgspec.structs import replace

from mindstage.knowledge import KnowledgeBase
from mindstage.maps import Handedness, LengthUnit, QuaternionOrder, UnitConventions, save_map
from mindstage.scene import Pose
from tests.maps.small_maps import (
    KNOWROB,
    XSD,
    ReadMap,
    assert_worlds_equal,
    body_turtle,
    individual,
    knowledge_base_from,
    room_map,
    slide_joint,
)

MUGS = [
    body_turtle(f"mug{n}", f'k:heightOfObject "{n + 8}.0"', 'k:widthOfObject "8.0"', 'k:depthOfObject "8.0"')
    for n in range(6)
]
"""Eight meters high, or centimeters."""
TURNED = [body_turtle(f"mug{n}", position=f"{n} 0 0", quaternion="0.0 0.0 0.0 1.0") for n in range(3)]
LYING = [body_turtle(f"pan{n}", position=f"{n} 1 0", quaternion="0.0 0.0 1.0 0.0") for n in range(4)]


def read_as(tmp_path: Path, text: str, **conventions: object) -> KnowledgeBase:
    path = tmp_path / "map.ttl"
    path.write_text(text, encoding="utf-8")
    knowledge = KnowledgeBase(bundled_ontology=False)
    knowledge.load(path, conventions=UnitConventions(**conventions))  # type: ignore[arg-type]
    return knowledge


def values(knowledge: KnowledgeBase) -> dict[str, str]:
    return {assumption.topic: assumption.value for assumption in knowledge.assumptions()}


def test_semlog_maps_are_in_meters_by_default(tmp_path: Path) -> None:
    knowledge = read_as(tmp_path, room_map(*MUGS))
    world = knowledge.world()
    assert world.body("mug0").size == (8.0, 8.0, 8.0)
    assert values(knowledge) == {"units": "m", "frame": "ros", "quaternion": "wxyz"}


def test_implausible_lengths_are_reported(tmp_path: Path) -> None:
    knowledge = read_as(tmp_path, room_map(*MUGS))
    knowledge.world()
    (finding,) = [finding for finding in knowledge.findings() if "indicate" in finding.problem]
    assert finding.individual == individual("room")
    assert "indicate cm" in finding.problem
    assert finding.action == "they are read as m; --units cm would change that"


def test_implausible_rotations_are_reported(tmp_path: Path) -> None:
    knowledge = read_as(tmp_path, room_map(*TURNED, *LYING))
    knowledge.world()
    (finding,) = [finding for finding in knowledge.findings() if "indicate" in finding.problem]
    assert "indicate xyzw" in finding.problem


def test_decisions_of_the_user_are_not_reported(tmp_path: Path) -> None:
    knowledge = read_as(tmp_path, room_map(*MUGS), units=LengthUnit.METERS)
    knowledge.world()
    assert knowledge.findings() == ()
    decided = next(assumption for assumption in knowledge.assumptions() if assumption.topic == "units")
    assert decided.overridden


def test_the_user_can_choose_other_units(tmp_path: Path) -> None:
    text = room_map(
        body_turtle("base"), body_turtle("door", position="0 0 0"), slide_joint("slide", "base", "door"), *MUGS
    )
    knowledge = read_as(tmp_path, text, units=LengthUnit.CENTIMETERS, frame=Handedness.UNREAL)
    world = knowledge.world()
    assert world.body("base").pose == Pose((0.01, -0.02, 0.03), (1.0, 0.0, 0.0, 0.0))
    assert world.body("mug0").size == (0.08, 0.08, 0.08)
    assert world.joints[0].linear.limit == 0.0045
    assert world.joints[0].angular.twist_limit == 0.3
    save_map(world, tmp_path / "out.ttl")
    assert_worlds_equal(world, knowledge_base_from(tmp_path / "out.ttl").world())


def test_a_map_may_declare_its_conventions(tmp_path: Path) -> None:
    declared = ':room ms:units "cm" ; ms:frame "unreal" ; ms:quaternionOrder "xyzw" .'
    knowledge = read_as(tmp_path, room_map(declared, body_turtle("cup", position="100 200 300", quaternion="0 0 0 1")))
    world = knowledge.world()
    assert world.body("cup").pose == Pose((1.0, -2.0, 3.0), (1.0, 0.0, 0.0, 0.0))
    assert all("declared in the map" in assumption.evidence for assumption in knowledge.assumptions())
    save_map(world, tmp_path / "out.ttl")
    assert_worlds_equal(world, knowledge_base_from(tmp_path / "out.ttl").world())


def test_an_invalid_declaration_is_reported(tmp_path: Path) -> None:
    knowledge = read_as(tmp_path, room_map(':room ms:units "furlong" .', body_turtle("cup")))
    assert knowledge.world().body("cup").pose.position == (1.0, 2.0, 3.0)
    (finding,) = knowledge.findings()
    assert finding.problem == "'furlong' is not one of m, cm, mm"


def test_units_are_inferred_from_known_sizes_of_classes(tmp_path: Path) -> None:
    sizes = " ".join(
        f'[a owl:Restriction ; owl:onProperty k:{name}OfObject ; owl:hasValue "0.1"^^xsd:float]{end}'
        for name, end in (("depth", ","), ("width", ","), ("height", "."))
    )
    ontology = tmp_path / "sizes.ttl"
    the_map = ":room a owl:NamedIndividual, k:SemanticEnvironmentMap ."
    ontology.write_text(room_map(f"k:Cup rdfs:subClassOf {sizes}").replace(the_map, ""), encoding="utf-8")
    own = ('k:heightOfObject "110.0"', 'k:widthOfObject "80.0"', 'k:depthOfObject "80.0"', 'k:maskColor "FF"')
    path = tmp_path / "map.ttl"
    path.write_text(room_map(body_turtle("cup", *own)), encoding="utf-8")
    knowledge = knowledge_base_from(path, ontologies=(ontology,))
    assert knowledge.world().body("cup").size == (0.08, 0.08, 0.11)
    assert values(knowledge)["units"] == "mm"
    assert "1 of 1 classes agree with those in ontologies" in knowledge.assumptions()[0].evidence


@pytest.mark.parametrize(
    ("at", "units"), [(("0 0 0", "400 0 0", "0 300 0"), "cm"), (("0 0 0", "4 0 0", "0 3 0"), "m"), (("1 2 3",), "cm")]
)
def test_units_are_inferred_from_distances_where_there_are_no_sizes(
    at: tuple[str, ...], units: str, tmp_path: Path
) -> None:
    bodies = [body_turtle(f"a{n}", 'k:maskColor "FF"', position=place) for n, place in enumerate(at)]
    knowledge = read_as(tmp_path, room_map(*bodies))
    knowledge.world()
    assert values(knowledge)["units"] == units


def test_each_map_has_its_own_conventions(tmp_path: Path) -> None:
    knowledge = read_as(tmp_path, room_map(body_turtle("cup", position="100 0 0")), units=LengthUnit.CENTIMETERS)
    other = tmp_path / "other.ttl"
    other.write_text(room_map(body_turtle("cup2"), map="other").replace(":room", ":other"), encoding="utf-8")
    knowledge.load(other, conventions=UnitConventions(quaternion=QuaternionOrder.XYZW))
    assert knowledge.world("room").body("cup").pose.position == (1.0, 0.0, 0.0)
    assert knowledge.world("other").body("cup2").pose == Pose((1.0, 2.0, 3.0), (0.0, 1.0, 0.0, 0.0))
    assert {
        assumption.map: assumption.value for assumption in knowledge.assumptions() if assumption.topic == "units"
    } == {
        individual("room"): "cm",
        individual("other"): "m",
    }


def test_changed_values_are_written_in_the_units_of_the_map_with_their_datatypes(tmp_path: Path) -> None:
    knowledge = read_as(tmp_path, room_map(*MUGS), units=LengthUnit.CENTIMETERS, frame=Handedness.ROS)
    world = knowledge.world()
    first, *others = world.bodies
    position = (1.5, 3e-20, 2.5e17)
    changed = replace(first, size=(0.07, 0.0, 0.125), pose=replace(first.pose, position=position))
    path = tmp_path / "back.ttl"
    save_map(replace(world, bodies=(changed, *others)), path, source_view=knowledge.source_view())
    values = {
        quad.predicate.value.rpartition("#")[2]: quad.object
        for quad in ox.parse(path=path)
        if quad.subject.value.startswith(first.iri) and quad.predicate.value.startswith(KNOWROB)
    }
    assert [values[f"{name}OfObject"].value for name in ("depth", "width", "height")] == ["7.0", "0.0", "12.5"]
    assert values["translation"].value == "150.0 3E-18 2.5E+19", "numbers far from 1 have an exponent"
    assert values["heightOfObject"].datatype.value == XSD + "float"
    assert knowledge_base_from(path).world().body(first.id).pose.position == pytest.approx(position, rel=1e-12)


# -- invalid and suspicious numbers ------------------------------------------------------------------------------------


@pytest.mark.parametrize("turned", ["2.0 0.0 0.0 0.0", "0.5 0.5 0.5 0.4"])
def test_a_quaternion_that_is_not_normalized_is_reported_and_used(turned: str, read: ReadMap) -> None:
    world, (finding,) = read(room_map(body_turtle("cup", quaternion=turned)))
    assert world.body("cup").pose.quaternion == tuple(map(float, turned.split()))
    assert "has the norm" in finding.problem


@pytest.mark.parametrize("at", ["1,5 2,0 3,0", "1,2,3"])
def test_a_decimal_comma_is_reported(at: str, read: ReadMap) -> None:
    world, findings = read(room_map(body_turtle("cup", position=at)))
    assert world.bodies == ()
    assert any("a point, not a comma" in finding.problem for finding in findings)


def test_many_bodies_at_one_position_are_reported(read: ReadMap) -> None:
    world, (finding,) = read(
        room_map(*(body_turtle(f"cup{n}") for n in range(10)), body_turtle("pan", position="0 0 0"))
    )
    assert len(world.bodies) == 11
    assert finding.problem == "10 bodies are at one position (1 2 3)"


def test_nine_bodies_at_one_position_are_not_reported(read: ReadMap) -> None:
    assert read(room_map(*(body_turtle(f"cup{n}") for n in range(9))))[1] == ()
