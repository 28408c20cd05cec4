"""What a map of dialect 1 says of one thing is what stands in its world; the rest of it stays as facts."""

from __future__ import annotations

import math

import pytest

from mindstage.knowledge import Severity
from mindstage.world import (
    Anonymous,
    Fact,
    Iri,
    LightKind,
    Literal,
    Material,
    Mobility,
    Physics,
    Pose,
    Reference,
    Resource,
    Shape,
    ShapeKind,
    Tag,
)
from tests.knowledge.maps import OWL, RDFS, XSD, Read, body, knowrob, m, room

RDF_TYPE = Iri("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")


# -- bodies ------------------------------------------------------------------------------------------------------------


def test_every_field_of_a_body_is_read(read: Read) -> None:
    world, findings = read(
        room(
            body(
                "cup",
                'k:mobility "dynamic"',
                'k:mass "0.3"^^xsd:float',
                "k:gravity true ; k:overlapEvents false",
                'k:depthOfObject "0.1"^^xsd:float ; k:widthOfObject "0.2"^^xsd:float',
                'k:heightOfObject "0.3"^^xsd:float',
                'k:pathToCadModel "package://robcog/Cup/Cup.dae"',
                'k:tagsData "SemLog;Class,Cup;Id,c1;Other;k,v;"',
                'rdfs:label "my cup"',
                'ms:shape "cylinder"',
                'ms:material [ ms:index 1 ; ms:name "rim" ], [ ms:index 0 ; ms:name "glaze" ; ms:colour "1 0 0.5" ]',
            )
        )
    )
    (cup,) = world.bodies
    assert findings == ()
    assert (cup.id, cup.iri, cup.cls, cup.label) == ("cup", m("cup"), knowrob("Cup"), "my cup")
    assert cup.pose == Pose((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0))
    assert cup.size == (0.1, 0.2, 0.3)
    assert cup.physics == Physics(mobility=Mobility.DYNAMIC, gravity=True, overlap_events=False, mass_kg=0.3)
    assert cup.mesh == "package://robcog/Cup/Cup.dae"
    assert cup.shape == Shape(kind=ShapeKind.CYLINDER)
    assert cup.materials == (Material(name="glaze", colour=(1.0, 0.0, 0.5)), Material(name="rim"))
    assert cup.tags == (
        Tag(type="SemLog", key="Class", value="Cup"),
        Tag(type="SemLog", key="Id", value="c1"),
        Tag(type="Other", key="k", value="v"),
    )
    assert cup.facts == ()
    assert (world.iri, world.name, world.facts, world.resources) == (m("room"), "room", (), ())


def test_what_is_not_told_is_none(read: Read) -> None:
    world, findings = read(room(body("cup")))
    (cup,) = world.bodies
    assert (cup.label, cup.size, cup.mesh, cup.shape, cup.physics) == (None, None, None, None, Physics())
    assert (cup.materials, cup.tags, cup.facts, findings) == ((), (), (), ())


def test_digits_are_those_of_the_file(read: Read) -> None:
    # As 32-bit floats, which is what the datatype says and what an RDF store keeps, none of these would survive.
    mass = 'k:mass "177.512833"^^xsd:float'
    at, turned = "0.1 16777217.000001 -0.000000", "0.707107 -0.000000 0.000000 0.707106781186548"
    world, _ = read(room(body("cup", mass, at=at, turned=turned)))
    (cup,) = world.bodies
    assert cup.physics.mass_kg == 177.512833
    assert cup.pose == Pose((0.1, 16777217.000001, -0.0), (0.707107, -0.0, 0.0, 0.707106781186548))
    assert math.copysign(1.0, cup.pose.position[2]) == -1.0


def test_a_name_of_a_part_that_we_would_not_give_is_kept(read: Read) -> None:
    world, findings = read(
        room(
            ":cup a k:Cup ; k:describedInMap :room ; k:pose :XyZ .",
            ':XyZ a k:Pose ; k:translation "1 2 3" ; k:quaternion "1 0 0 0" .',
        )
    )
    assert world.bodies[0].facts == (Fact(knowrob("pose"), Reference(m("XyZ"))),)
    assert (world.resources, findings) == ((), ())


def test_what_else_is_said_of_a_part_stays_with_it(read: Read) -> None:
    world, _ = read(room(body("cup"), ':cup-pose rdfs:comment "measured by hand" .'))
    assert world.bodies[0].facts == (Fact(knowrob("pose"), Reference(m("cup-pose"))),)
    comment = Fact(Iri(RDFS + "comment"), Literal("measured by hand"))
    assert world.resources == (Resource(m("cup-pose"), (comment,)),)


def test_a_pose_without_a_name_is_a_pose(read: Read) -> None:
    world, _ = read(
        room(':cup a k:Cup ; k:describedInMap :room ; k:pose [ k:translation "1 2 3" ; k:quaternion "1 0 0 0" ] .')
    )
    assert world.bodies[0].pose == Pose((1.0, 2.0, 3.0))
    assert world.bodies[0].facts == ()


def test_two_bodies_may_share_a_pose(read: Read) -> None:
    world, findings = read(
        room(
            ":a a k:Cup ; k:describedInMap :room ; k:pose :here .",
            ":b a k:Cup ; k:describedInMap :room ; k:pose :here .",
            ':here a k:Pose ; k:translation "1 2 3" ; k:quaternion "1 0 0 0" .',
        )
    )
    assert [thing.pose.position for thing in world.bodies] == [(1.0, 2.0, 3.0)] * 2
    assert findings == ()


def test_the_most_telling_class_is_the_class_and_the_others_are_facts(read: Read) -> None:
    world, _ = read(
        room(
            body("cup", cls="k:DrinkingVessel, k:CoffeeCup, owl:Thing"),
            "k:CoffeeCup rdfs:subClassOf k:Cup . k:Cup rdfs:subClassOf k:DrinkingVessel .",
        )
    )
    assert world.bodies[0].cls == knowrob("CoffeeCup")
    assert {fact.value for fact in world.bodies[0].facts} == {
        Reference(knowrob("DrinkingVessel")),
        Reference(Iri(OWL + "Thing")),
    }


def test_of_classes_that_tell_the_same_the_first_counts(read: Read) -> None:
    world, _ = read(
        room(body("cup", cls="k:Mug, k:Cup"), "k:Cup rdfs:subClassOf k:Mug . k:Mug rdfs:subClassOf k:Cup .")
    )
    assert world.bodies[0].cls == knowrob("Mug")
    assert world.bodies[0].facts == (Fact(RDF_TYPE, Reference(knowrob("Cup"))),)


def test_a_body_without_class_is_a_thing_and_that_is_said(read: Read) -> None:
    world, (finding,) = read(
        room(':x k:describedInMap :room ; k:pose [ k:translation "1 2 3"; k:quaternion "1 0 0 0" ].')
    )
    assert world.bodies[0].cls == OWL + "Thing"
    assert world.bodies[0].facts == ()
    assert (finding.severity, finding.individual) == (Severity.WARNING, m("x"))


def test_a_body_without_name_is_a_body(read: Read) -> None:
    world, _ = read(
        room(
            body("tray", "k:child _:milk"),
            '_:milk a k:Milk ; k:describedInMap :room ; k:pose [ k:translation "1 2 3" ; k:quaternion "1 0 0 0" ] .',
        )
    )
    assert [thing.id for thing in world.bodies] == ["tray", "milk"]
    assert world.bodies[1].iri == "_:milk"
    assert [(each.parent, each.child) for each in world.attachments] == [("tray", "milk")]


def test_statements_beyond_the_fields_are_facts(read: Read) -> None:
    world, findings = read(
        room(
            body(
                "cup",
                'rdfs:label "cup"@en, "Tasse"@de',
                'e:owner e:Jo ; e:since "2019-03-14"^^xsd:date ; e:size "1.50"^^xsd:float',
                'e:handle [ e:length "0.040"^^xsd:float ; e:glued true ]',
            )
        )
    )
    e = "http://example.org/terms#"
    boolean = Iri(XSD + "boolean")
    handle = (
        Fact(Iri(e + "glued"), Literal("true", boolean)),
        Fact(Iri(e + "length"), Literal("0.040", Iri(XSD + "float"))),
    )
    (cup,) = world.bodies
    assert (cup.label, findings) == ("cup", ())
    assert set(cup.facts) == {
        Fact(Iri(RDFS + "label"), Literal("cup", language="en")),
        Fact(Iri(RDFS + "label"), Literal("Tasse", language="de")),
        Fact(Iri(e + "owner"), Reference(Iri(e + "Jo"))),
        Fact(Iri(e + "since"), Literal("2019-03-14", Iri(XSD + "date"))),
        Fact(Iri(e + "size"), Literal("1.50", Iri(XSD + "float"))),
        Fact(Iri(e + "handle"), Anonymous(handle)),
    }


@pytest.mark.parametrize(
    ("told", "value"),
    [
        ('k:mobility "Dynamic"', Physics(mobility=Mobility.DYNAMIC)),
        ('k:gravity "1"^^xsd:boolean', Physics(gravity=True)),
        ('k:mass "0.5"^^xsd:double', Physics(mass_kg=0.5)),
        ('k:mass "0.5"', Physics(mass_kg=0.5)),
    ],
)
def test_another_way_to_say_it_is_understood_and_kept(told: str, value: Physics, read: Read) -> None:
    world, findings = read(room(body("cup", told)))
    assert world.bodies[0].physics == value
    assert len(world.bodies[0].facts) == 1
    assert findings == ()


@pytest.mark.parametrize("text", ["SemLog;Class,Cup", "k,v;", "SemLog;", ";;", "SemLog;Class,Cup;;"])
def test_tags_that_would_come_back_otherwise_stay_as_they_are(text: str, read: Read) -> None:
    world, _ = read(room(body("cup", f'k:tagsData "{text}"')))
    assert world.bodies[0].facts == (Fact(knowrob("tagsData"), Literal(text)),)


def test_a_comma_in_a_tags_value_belongs_to_it(read: Read) -> None:
    world, _ = read(room(body("cup", 'k:tagsData "A;k,1,2;"')))
    assert world.bodies[0].tags == (Tag(type="A", key="k", value="1,2"),)


# -- lights ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", LightKind)
def test_every_field_of_a_light_is_read(kind: LightKind, read: Read) -> None:
    cls = f"ms:{kind.value.capitalize()}Light"
    world, findings = read(room(body("lamp", 'ms:colour "1 0.5 0.25" ; ms:intensity "800"^^xsd:double', cls=cls)))
    (lamp,) = world.lights
    assert (lamp.id, lamp.kind, lamp.colour, lamp.intensity) == ("lamp", kind, (1.0, 0.5, 0.25), 800.0)
    assert (lamp.pose.position, lamp.facts, world.bodies, findings) == ((1.0, 2.0, 3.0), (), (), ())


# -- the map and all the rest ------------------------------------------------------------------------------------------


def test_a_label_of_the_map_is_its_name(read: Read) -> None:
    world, _ = read(room(':room rdfs:label "The kitchen" ; e:floor 2 .'))
    assert world.name == "The kitchen"
    assert world.facts == (Fact(Iri("http://example.org/terms#floor"), Literal("2", Iri(XSD + "integer"))),)


def test_everything_else_in_the_source_is_a_resource(read: Read) -> None:
    world, _ = read(room("k:Cup a owl:Class .", "[] a owl:AllDifferent .", "e:Jo e:likes e:Cy ."))
    assert [resource.iri for resource in world.resources] == [knowrob("Cup"), "_:b1", "http://example.org/terms#Jo"]


def test_ids_are_unique_and_a_second_one_is_named(read: Read) -> None:
    other = body("cup").replace(":cup", "<http://elsewhere.org/maps#cup>").replace("cup>-pose", "cup-pose>")
    world, (finding,) = read(room(body("cup"), other))
    assert [thing.id for thing in world.bodies] == ["cup", "cup-2"]
    assert finding.individual == "http://elsewhere.org/maps#cup"


def test_an_id_of_its_own_comes_before_a_local_name(read: Read) -> None:
    world, _ = read(room(body("cup"), body("mug", 'ms:id "cup"'), body("jug", 'ms:id "cup"')))
    assert [(thing.iri, thing.id) for thing in world.bodies] == [
        (m("cup"), "cup-2"),
        (m("mug"), "cup"),
        (m("jug"), "jug"),
    ]
