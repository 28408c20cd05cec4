"""Invalid statements are reported and none of them is lost."""

from __future__ import annotations

import pytest

from mindstage.rdf import Severity
from mindstage.scene import BodyPhysics, Iri, IriRef, Literal, PropertyAssertion
from tests.maps.small_maps import XSD, ReadMap, body_turtle, individual, knowrob_iri, room_map


def float_fact(property: str, text: str) -> PropertyAssertion:
    return PropertyAssertion(knowrob_iri(property), Literal(text, Iri(XSD + "float")))


@pytest.mark.parametrize(
    ("at", "turned"),
    [
        ("1,5 2 3", "1 0 0 0"),
        ("nan 2 3", "1 0 0 0"),
        ("inf 2 3", "1 0 0 0"),
        ("1e999 2 3", "1 0 0 0"),
        ("1_0 2 3", "1 0 0 0"),
        ("1 2", "1 0 0 0"),
        ("1 2 3 4", "1 0 0 0"),
        ("", "1 0 0 0"),
        ("1 2 3", "0 0 0 0"),
        ("1 2 3", "nan 0 0 1"),
        ("1 2 3", "one 0 0 0"),
    ],
)
def test_an_invalid_pose_omits_the_body_with_a_finding(at: str, turned: str, read: ReadMap) -> None:
    world, findings = read(
        room_map(body_turtle("cup", position=at, quaternion=turned), body_turtle("mug", "k:parent :cup"))
    )
    assert [body.id for body in world.bodies] == ["mug"]
    assert {resource.iri for resource in world.resources} == {individual("cup"), individual("cup-pose")}
    (error,) = (finding for finding in findings if finding.severity is Severity.ERROR)
    assert error.individual == individual("cup")
    assert any(finding.individual == individual("cup-pose") for finding in findings)
    assert any(finding.individual == individual("mug") and individual("cup") in finding.problem for finding in findings)


@pytest.mark.parametrize("pose", ["", "k:pose :nowhere ;", 'k:pose "1 2 3" ;', "k:pose :cup ;", "k:pose :room ;"])
def test_a_missing_pose_omits_the_body_with_a_finding(pose: str, read: ReadMap) -> None:
    world, findings = read(room_map(f':cup a k:Cup ; {pose} k:describedInMap :room ; k:translation "1 2 3" .'))
    assert world.bodies == ()
    assert world.resources[0].iri == individual("cup")
    assert [finding.individual for finding in findings if finding.severity is Severity.ERROR] == [individual("cup")]


def test_the_first_of_two_poses_is_used(read: ReadMap) -> None:
    world, (finding,) = read(
        room_map(body_turtle("cup"), ':cup k:pose :other . :other k:translation "4 5 6" ; k:quaternion "1 0 0 0" .')
    )
    (cup,) = world.bodies
    assert cup.pose.position == (1.0, 2.0, 3.0)
    assert cup.facts == tuple(
        PropertyAssertion(knowrob_iri("pose"), IriRef(individual(name))) for name in ("cup-pose", "other")
    )
    assert [resource.iri for resource in world.resources] == [individual("other")]
    assert finding.individual == individual("cup")


def test_a_valid_pose_is_used_before_an_invalid_one(read: ReadMap) -> None:
    world, _ = read(
        room_map(
            ":cup a k:Cup ; k:describedInMap :room ; k:pose :bad, :good .",
            ':bad k:translation "a b c" . :good k:translation "4 5 6" ; k:quaternion "1 0 0 0" .',
        )
    )
    (cup,) = world.bodies
    assert cup.pose.position == (4.0, 5.0, 6.0)
    # The pose that is used comes first, so that the writer uses its name.
    assert cup.facts == tuple(
        PropertyAssertion(knowrob_iri("pose"), IriRef(individual(name))) for name in ("good", "bad")
    )


@pytest.mark.parametrize(
    ("property", "text"),
    [
        ("mobility", "flying"),
        ("mass", "1,5"),
        ("mass", "nan"),
        ("mass", "-1.0"),
        ("gravity", "perhaps"),
        ("depthOfObject", "-0.5"),
        ("heightOfObject", "inf"),
    ],
)
def test_an_invalid_value_remains_a_fact_with_a_finding(property: str, text: str, read: ReadMap) -> None:
    world, (finding,) = read(room_map(body_turtle("cup", f'k:{property} "{text}"')))
    (cup,) = world.bodies
    assert (cup.physics, cup.size) == (BodyPhysics(), None)
    assert cup.facts == (PropertyAssertion(knowrob_iri(property), Literal(text)),)
    assert (finding.individual, finding.property) == (individual("cup"), knowrob_iri(property))
    assert text in finding.problem


def test_the_first_of_two_masses_is_used(read: ReadMap) -> None:
    world, (finding,) = read(room_map(body_turtle("cup", 'k:mass "2.0"^^xsd:float, "3.0"^^xsd:float')))
    assert world.bodies[0].physics.mass_kg == 2.0
    assert world.bodies[0].facts == (float_fact("mass", "3.0"),)
    assert finding.property == knowrob_iri("mass")


def test_incomplete_materials_remain_facts(read: ReadMap) -> None:
    world, (finding,) = read(room_map(body_turtle("cup", "ms:material [ ms:index 0 ]")))
    assert world.bodies[0].materials == ()
    assert len(world.bodies[0].facts) == 1
    assert finding.individual == individual("cup")


def test_an_undeclared_map_is_read_with_a_finding(read: ReadMap) -> None:
    text = room_map(body_turtle("cup")).replace(
        "a owl:NamedIndividual, k:SemanticEnvironmentMap", "a owl:NamedIndividual"
    )
    world, (finding,) = read(text)
    assert [body.id for body in world.bodies] == ["cup"]
    assert finding.individual == individual("room")


def test_a_finding_is_a_sentence(read: ReadMap) -> None:
    _, (finding,) = read(room_map(body_turtle("cup", 'k:mass "heavy"')))
    assert str(finding) == (
        f"warning: {individual('cup')}, {knowrob_iri('mass')}: 'heavy' is not a finite number of 0 or more; "
        "it stays a fact and is not used"
    )


@pytest.mark.parametrize("tags", ['"{"', '"[1]"', f'"{"[" * 10_000}"', "e:Jo"])
def test_invalid_json_tags_remain_a_fact_with_a_finding(tags: str, read: ReadMap) -> None:
    world, (finding,) = read(room_map(body_turtle("cup", f"ms:tags {tags}")))
    assert (world.bodies[0].tags, len(world.bodies[0].facts)) == ((), 1)
    assert finding.individual == individual("cup")


@pytest.mark.parametrize("material", ["e:Steel", '"steel"', '[ ms:index 0 ; ms:name "a" ; e:shiny true ]'])
def test_materials_of_another_form_remain_facts(material: str, read: ReadMap) -> None:
    world, (finding,) = read(room_map(body_turtle("cup", f"ms:material {material}")))
    assert (world.bodies[0].materials, len(world.bodies[0].facts)) == ((), 1)
    assert finding.individual == individual("cup")
