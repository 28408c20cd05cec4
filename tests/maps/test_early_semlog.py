"""Early SemLog maps: mobility in tags only, constraints without membership, and an invalid DTD."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.maps import MapFormat, save_map, write_map
from mindstage.rdf import Severity
from mindstage.scene import Mobility
from tests.maps.small_maps import (
    ReadMap,
    assert_worlds_equal,
    body_turtle,
    individual,
    knowledge_base_from,
    knowrob_iri,
    room_map,
    slide_joint,
)


def tagged(name: str, *tags: str, at: str = "1.0 2.0 3.0") -> str:
    joined = "".join(f"{tag};" for tag in tags)
    return body_turtle(name, f'k:tagsData "SemLog;Class,Cup;{joined}"', position=at)


def without_membership(text: str, name: str) -> str:
    """The map without the membership statement of an individual."""
    start = text.index(f":{name} a owl:NamedIndividual, k:Constraint")
    return text[:start] + text[start:].replace(" ; k:describedInMap :room", "", 1)


def test_mobility_is_read_from_tags(read: ReadMap) -> None:
    world, findings = read(room_map(tagged("cup", "Mobility,Dynamic"), tagged("wall", "Mobility,Static", at="0 0 0")))
    assert world.body("cup").physics.mobility is Mobility.DYNAMIC
    assert world.body("wall").physics.mobility is Mobility.STATIC
    assert world.body("cup").tags[-1].value == "Dynamic", "the tag stays"
    assert findings == ()
    again, _ = read(write_map(world, format=MapFormat.TURTLE))
    assert_worlds_equal(world, again)


def test_a_property_takes_precedence_over_a_tag(read: ReadMap) -> None:
    text = body_turtle("pan", 'k:mobility "static"', 'k:tagsData "SemLog;Mobility,Dynamic;"', position="0 0 0")
    world, _ = read(room_map(tagged("cup", "Mobility,Dynamic"), text))
    assert world.body("pan").physics.mobility is Mobility.STATIC


def test_an_invalid_mobility_tag_is_reported(read: ReadMap) -> None:
    cup, pan = tagged("cup", "Mobility,Dynamic"), tagged("pan", "Mobility,Sometimes", at="0 0 0")
    world, (finding,) = read(room_map(cup, pan))
    assert world.body("pan").physics.mobility is None
    assert (finding.individual, finding.property) == (individual("pan"), knowrob_iri("mobility"))
    assert "'Sometimes'" in finding.problem


def test_a_constraint_belongs_to_the_map_of_its_bodies(read: ReadMap, tmp_path: Path) -> None:
    text = room_map(body_turtle("base"), body_turtle("door", position="0 0 0"), slide_joint("hinge", "base", "door"))
    world, findings = read(without_membership(text, "hinge"))
    assert [joint.id for joint in world.joints] == ["hinge"]
    assert not [finding for finding in findings if finding.severity is Severity.ERROR]
    save_map(world, tmp_path / "out.ttl")
    assert_worlds_equal(world, knowledge_base_from(tmp_path / "out.ttl").world())


def test_a_constraint_that_its_bodies_refer_to_belongs_to_their_map(read: ReadMap) -> None:
    text = room_map(
        body_turtle("base", "k:child :hinge"),
        body_turtle("door", "k:parent :hinge", position="0 0 0"),
        slide_joint("hinge", "x", "y"),
    )
    text = without_membership(text, "hinge").replace("k:parent :x ; k:child :y", 'e:note "none"')
    world, _ = read(text)
    (joint,) = world.joints
    assert (joint.parent, joint.child) == ("base", "door")


def test_a_constraint_without_a_map_is_kept(read: ReadMap) -> None:
    world, _ = read(without_membership(room_map(body_turtle("base"), slide_joint("hinge", "x", "y")), "hinge"))
    assert world.joints == ()
    assert individual("hinge") in {resource.iri for resource in world.resources}


def test_a_constraint_belongs_to_the_map_of_its_bodies_only(tmp_path: Path) -> None:
    first = without_membership(
        room_map(body_turtle("base"), body_turtle("door", position="0 0 0"), slide_joint("hinge", "base", "door")),
        "hinge",
    )
    second = room_map(body_turtle("cup"), map="other").replace(":room", ":other")
    (tmp_path / "first.ttl").write_text(first, encoding="utf-8")
    (tmp_path / "second.ttl").write_text(second, encoding="utf-8")
    knowledge = knowledge_base_from(tmp_path / "first.ttl", tmp_path / "second.ttl")
    assert [joint.id for joint in knowledge.world("room").joints] == ["hinge"]
    assert knowledge.world("other").joints == ()
    assert knowledge.map_statistics("room").constraints == 1


@pytest.mark.parametrize("spoil", [True, False])
def test_the_kitchen_of_the_thesis_as_an_early_map_is_the_same_kitchen(
    spoil: bool, shared_data: Path, tmp_path: Path
) -> None:
    text = (shared_data / "maps" / "iai-kitchen-original.owl").read_text(encoding="utf-8")
    expected = knowledge_base_from(shared_data / "maps" / "iai-kitchen-original.owl").world()
    early = []
    for block in text.split("\n\n"):
        lines = block.split("\n")
        mobility = next((line.split(">")[1].split("<")[0] for line in lines if "knowrob:mobility " in line), "")
        lines = [
            line for line in lines if not any(f"knowrob:{word} " in line for word in ("mobility", "mass", "gravity"))
        ]
        if mobility:
            lines = [
                line.replace(";</knowrob:tagsData", f";Mobility,{mobility.title()};</knowrob:tagsData")
                for line in lines
            ]
        if any("&knowrob;Constraint" in line for line in lines):
            lines = [line for line in lines if "describedInMap" not in line]
        early.append("\n".join(lines))
    corrupted = "\n\n".join(early)
    if spoil:
        corrupted = corrupted.replace('<!ENTITY owl "', '<!ENTITY owl"').replace(
            "<owl:Ontology rdf:about=", '<owl:Ontology rdf:about="x" rdf:about='
        )
    (tmp_path / "early.owl").write_text(corrupted, encoding="utf-8")
    world = knowledge_base_from(tmp_path / "early.owl").world()
    assert len(world.joints) == len(expected.joints) == 22
    assert [body.physics.mobility for body in world.bodies] == [body.physics.mobility for body in expected.bodies]
    assert {body.physics.mass_kg for body in world.bodies} == {None}
    assert [body.pose for body in world.bodies] == [body.pose for body in expected.bodies]
    save_map(world, tmp_path / "out.owl")
    assert_worlds_equal(world, knowledge_base_from(tmp_path / "out.owl").world())
