"""How a map's numbers are meant: who decides it, and what is said about it."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.knowledge import Handedness, KnowledgeBase, LengthUnit, QuaternionOrder, UnitConventions, save_map
from mindstage.scene import Pose
from tests.knowledge.maps import (
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
"""Eight meters high, or centimetres."""
TURNED = [body_turtle(f"mug{n}", position=f"{n} 0 0", quaternion="0.0 0.0 0.0 1.0") for n in range(3)]
LYING = [body_turtle(f"pan{n}", position=f"{n} 1 0", quaternion="0.0 0.0 1.0 0.0") for n in range(4)]


def read_as(tmp_path: Path, text: str, **told: object) -> KnowledgeBase:
    path = tmp_path / "map.ttl"
    path.write_text(text, encoding="utf-8")
    knowledge = KnowledgeBase(bundled_ontology=False)
    knowledge.load(path, conventions=UnitConventions(**told))  # type: ignore[arg-type]
    return knowledge


def values(knowledge: KnowledgeBase) -> dict[str, str]:
    return {assumption.topic: assumption.value for assumption in knowledge.assumptions()}


def test_semlog_maps_are_in_meters_whatever_their_size_and_say_so(tmp_path: Path) -> None:
    knowledge = read_as(tmp_path, room_map(*MUGS))
    world = knowledge.world()
    assert world.body("mug0").size == (8.0, 8.0, 8.0)
    assert values(knowledge) == {"units": "m", "frame": "ros", "quaternion": "wxyz"}


def test_lengths_that_no_household_has_are_doubted(tmp_path: Path) -> None:
    knowledge = read_as(tmp_path, room_map(*MUGS))
    knowledge.world()
    (finding,) = [finding for finding in knowledge.findings() if "indicate" in finding.problem]
    assert finding.individual == individual("room")
    assert "indicate cm" in finding.problem
    assert finding.action == "they are read as m; --units cm would change that"


def test_rotations_that_would_lay_everything_down_are_doubted(tmp_path: Path) -> None:
    knowledge = read_as(tmp_path, room_map(*TURNED, *LYING))
    knowledge.world()
    (finding,) = [finding for finding in knowledge.findings() if "indicate" in finding.problem]
    assert "indicate xyzw" in finding.problem


def test_nothing_is_doubted_that_the_user_decided(tmp_path: Path) -> None:
    knowledge = read_as(tmp_path, room_map(*MUGS), units=LengthUnit.METERS)
    knowledge.world()
    assert knowledge.findings() == ()
    told = next(assumption for assumption in knowledge.assumptions() if assumption.topic == "units")
    assert told.overridden


def test_any_map_can_be_told_to_be_in_other_units(tmp_path: Path) -> None:
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


def test_a_declaration_that_means_nothing_is_named(tmp_path: Path) -> None:
    knowledge = read_as(tmp_path, room_map(':room ms:units "furlong" .', body_turtle("cup")))
    assert knowledge.world().body("cup").pose.position == (1.0, 2.0, 3.0)
    (finding,) = knowledge.findings()
    assert finding.problem == "'furlong' is not one of m, cm, mm"


def test_classes_that_an_ontology_knows_tell_the_units(tmp_path: Path) -> None:
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
def test_without_sizes_the_spread_of_things_tells_the_units(at: tuple[str, ...], units: str, tmp_path: Path) -> None:
    things = [body_turtle(f"a{n}", 'k:maskColor "FF"', position=place) for n, place in enumerate(at)]
    knowledge = read_as(tmp_path, room_map(*things))
    knowledge.world()
    assert values(knowledge)["units"] == units


def test_each_map_has_conventions_of_its_own(tmp_path: Path) -> None:
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


# -- what else is odd about numbers ------------------------------------------------------------------------------------


@pytest.mark.parametrize("turned", ["2.0 0.0 0.0 0.0", "0.5 0.5 0.5 0.4"])
def test_a_quaternion_that_is_no_rotation_is_named_and_used(turned: str, read: ReadMap) -> None:
    world, (finding,) = read(room_map(body_turtle("cup", quaternion=turned)))
    assert world.body("cup").pose.quaternion == tuple(map(float, turned.split()))
    assert "has the norm" in finding.problem


@pytest.mark.parametrize("at", ["1,5 2,0 3,0", "1,2,3"])
def test_a_comma_for_a_point_is_named_as_such(at: str, read: ReadMap) -> None:
    world, findings = read(room_map(body_turtle("cup", position=at)))
    assert world.bodies == ()
    assert any("a point, not a comma" in finding.problem for finding in findings)


def test_a_crowd_in_one_place_is_named(read: ReadMap) -> None:
    world, (finding,) = read(
        room_map(*(body_turtle(f"cup{n}") for n in range(10)), body_turtle("pan", position="0 0 0"))
    )
    assert len(world.bodies) == 11
    assert finding.problem == "10 bodies are at one position (1 2 3)"


def test_nine_in_one_place_are_no_crowd(read: ReadMap) -> None:
    assert read(room_map(*(body_turtle(f"cup{n}") for n in range(9))))[1] == ()
