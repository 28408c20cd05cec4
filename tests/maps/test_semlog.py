"""Maps of dialect 1: every field of the world is read, and all other statements are kept as facts."""

from __future__ import annotations

import math

import pytest

from mindstage.rdf import Severity
from mindstage.scene import (
    BlankNode,
    BodyPhysics,
    Iri,
    IriRef,
    LightType,
    Literal,
    Material,
    Mobility,
    NamedResource,
    Pose,
    PrimitiveShape,
    PrimitiveType,
    PropertyAssertion,
    Tag,
)
from tests.maps.small_maps import OWL, RDFS, XSD, ReadMap, body_turtle, individual, knowrob_iri, room_map

RDF_TYPE = Iri("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")


# -- bodies ------------------------------------------------------------------------------------------------------------


def test_every_field_of_a_body_is_read(read: ReadMap) -> None:
    world, findings = read(
        room_map(
            body_turtle(
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
    assert (cup.id, cup.iri, cup.cls, cup.label) == ("cup", individual("cup"), knowrob_iri("Cup"), "my cup")
    assert cup.pose == Pose((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0))
    assert cup.size == (0.1, 0.2, 0.3)
    assert cup.physics == BodyPhysics(mobility=Mobility.DYNAMIC, gravity=True, overlap_events=False, mass_kg=0.3)
    assert cup.mesh == "package://robcog/Cup/Cup.dae"
    assert cup.shape == PrimitiveShape(type=PrimitiveType.CYLINDER)
    assert cup.materials == (Material(name="glaze", color=(1.0, 0.0, 0.5)), Material(name="rim"))
    assert cup.tags == (
        Tag(type="SemLog", key="Class", value="Cup"),
        Tag(type="SemLog", key="Id", value="c1"),
        Tag(type="Other", key="k", value="v"),
    )
    assert cup.facts == ()
    assert (world.iri, world.name, world.facts, world.resources) == (individual("room"), "room", (), ())


def test_missing_values_are_none(read: ReadMap) -> None:
    world, findings = read(room_map(body_turtle("cup")))
    (cup,) = world.bodies
    assert (cup.label, cup.size, cup.mesh, cup.shape, cup.physics) == (None, None, None, None, BodyPhysics())
    assert (cup.materials, cup.tags, cup.facts, findings) == ((), (), (), ())


def test_numbers_keep_the_digits_of_the_file(read: ReadMap) -> None:
    # As 32-bit floats, which the datatype means and an RDF store keeps, these would be rounded.
    mass = 'k:mass "177.512833"^^xsd:float'
    at, turned = "0.1 16777217.000001 -0.000000", "0.707107 -0.000000 0.000000 0.707106781186548"
    world, _ = read(room_map(body_turtle("cup", mass, position=at, quaternion=turned)))
    (cup,) = world.bodies
    assert cup.physics.mass_kg == 177.512833
    assert cup.pose == Pose((0.1, 16777217.000001, -0.0), (0.707107, -0.0, 0.0, 0.707106781186548))
    assert math.copysign(1.0, cup.pose.position[2]) == -1.0


def test_unusual_names_of_nested_resources_are_kept(read: ReadMap) -> None:
    world, findings = read(
        room_map(
            ":cup a k:Cup ; k:describedInMap :room ; k:pose :XyZ .",
            ':XyZ a k:Pose ; k:translation "1 2 3" ; k:quaternion "1 0 0 0" .',
        )
    )
    assert world.bodies[0].facts == (PropertyAssertion(knowrob_iri("pose"), IriRef(individual("XyZ"))),)
    assert (world.resources, findings) == ((), ())


def test_other_statements_about_a_nested_resource_are_kept(read: ReadMap) -> None:
    world, _ = read(room_map(body_turtle("cup"), ':cup-pose rdfs:comment "measured by hand" .'))
    assert world.bodies[0].facts == (PropertyAssertion(knowrob_iri("pose"), IriRef(individual("cup-pose"))),)
    comment = PropertyAssertion(Iri(RDFS + "comment"), Literal("measured by hand"))
    assert world.resources == (NamedResource(individual("cup-pose"), (comment,)),)


def test_a_pose_may_be_a_blank_node(read: ReadMap) -> None:
    world, _ = read(
        room_map(':cup a k:Cup ; k:describedInMap :room ; k:pose [ k:translation "1 2 3" ; k:quaternion "1 0 0 0" ] .')
    )
    assert world.bodies[0].pose == Pose((1.0, 2.0, 3.0))
    assert world.bodies[0].facts == ()


def test_two_bodies_may_share_a_pose(read: ReadMap) -> None:
    world, findings = read(
        room_map(
            ":a a k:Cup ; k:describedInMap :room ; k:pose :here .",
            ":b a k:Cup ; k:describedInMap :room ; k:pose :here .",
            ':here a k:Pose ; k:translation "1 2 3" ; k:quaternion "1 0 0 0" .',
        )
    )
    assert [each.pose.position for each in world.bodies] == [(1.0, 2.0, 3.0)] * 2
    assert findings == ()


def test_the_most_specific_class_is_the_class_and_the_others_are_facts(read: ReadMap) -> None:
    world, _ = read(
        room_map(
            body_turtle("cup", cls="k:DrinkingVessel, k:CoffeeCup, owl:Thing"),
            "k:CoffeeCup rdfs:subClassOf k:Cup . k:Cup rdfs:subClassOf k:DrinkingVessel .",
        )
    )
    assert world.bodies[0].cls == knowrob_iri("CoffeeCup")
    assert {fact.value for fact in world.bodies[0].facts} == {
        IriRef(knowrob_iri("DrinkingVessel")),
        IriRef(Iri(OWL + "Thing")),
    }


def test_of_equally_specific_classes_the_first_counts(read: ReadMap) -> None:
    world, _ = read(
        room_map(body_turtle("cup", cls="k:Mug, k:Cup"), "k:Cup rdfs:subClassOf k:Mug . k:Mug rdfs:subClassOf k:Cup .")
    )
    assert world.bodies[0].cls == knowrob_iri("Mug")
    assert world.bodies[0].facts == (PropertyAssertion(RDF_TYPE, IriRef(knowrob_iri("Cup"))),)


def test_a_body_without_a_class_is_an_owl_thing_and_reported(read: ReadMap) -> None:
    world, (finding,) = read(
        room_map(':x k:describedInMap :room ; k:pose [ k:translation "1 2 3"; k:quaternion "1 0 0 0" ].')
    )
    assert world.bodies[0].cls == OWL + "Thing"
    assert world.bodies[0].facts == ()
    assert (finding.severity, finding.individual) == (Severity.WARNING, individual("x"))


def test_a_body_may_be_a_blank_node(read: ReadMap) -> None:
    world, _ = read(
        room_map(
            body_turtle("tray", "k:child _:milk"),
            '_:milk a k:Milk ; k:describedInMap :room ; k:pose [ k:translation "1 2 3" ; k:quaternion "1 0 0 0" ] .',
        )
    )
    assert [each.id for each in world.bodies] == ["tray", "milk"]
    assert world.bodies[1].iri == "_:milk"
    assert [(each.parent, each.child) for each in world.attachments] == [("tray", "milk")]


def test_statements_beyond_the_fields_are_facts(read: ReadMap) -> None:
    world, findings = read(
        room_map(
            body_turtle(
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
        PropertyAssertion(Iri(e + "glued"), Literal("true", boolean)),
        PropertyAssertion(Iri(e + "length"), Literal("0.040", Iri(XSD + "float"))),
    )
    (cup,) = world.bodies
    assert (cup.label, findings) == ("cup", ())
    assert set(cup.facts) == {
        PropertyAssertion(Iri(RDFS + "label"), Literal("cup", language="en")),
        PropertyAssertion(Iri(RDFS + "label"), Literal("Tasse", language="de")),
        PropertyAssertion(Iri(e + "owner"), IriRef(Iri(e + "Jo"))),
        PropertyAssertion(Iri(e + "since"), Literal("2019-03-14", Iri(XSD + "date"))),
        PropertyAssertion(Iri(e + "size"), Literal("1.50", Iri(XSD + "float"))),
        PropertyAssertion(Iri(e + "handle"), BlankNode(handle)),
    }


@pytest.mark.parametrize(
    ("statement", "value"),
    [
        ('k:mobility "Dynamic"', BodyPhysics(mobility=Mobility.DYNAMIC)),
        ('k:gravity "1"^^xsd:boolean', BodyPhysics(gravity=True)),
        ('k:mass "0.5"^^xsd:double', BodyPhysics(mass_kg=0.5)),
        ('k:mass "0.5"', BodyPhysics(mass_kg=0.5)),
    ],
)
def test_alternative_notations_are_read_and_kept(statement: str, value: BodyPhysics, read: ReadMap) -> None:
    world, findings = read(room_map(body_turtle("cup", statement)))
    assert world.bodies[0].physics == value
    assert len(world.bodies[0].facts) == 1
    assert findings == ()


@pytest.mark.parametrize("text", ["SemLog;Class,Cup", "k,v;", "SemLog;", ";;", "SemLog;Class,Cup;;"])
def test_tags_that_would_be_written_differently_are_kept_as_facts(text: str, read: ReadMap) -> None:
    world, _ = read(room_map(body_turtle("cup", f'k:tagsData "{text}"')))
    assert world.bodies[0].facts == (PropertyAssertion(knowrob_iri("tagsData"), Literal(text)),)


def test_a_comma_in_the_value_of_a_tag_is_kept(read: ReadMap) -> None:
    world, _ = read(room_map(body_turtle("cup", 'k:tagsData "A;k,1,2;"')))
    assert world.bodies[0].tags == (Tag(type="A", key="k", value="1,2"),)


# -- lights ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", LightType)
def test_every_field_of_a_light_is_read(kind: LightType, read: ReadMap) -> None:
    cls = f"ms:{kind.value.capitalize()}Light"
    world, findings = read(
        room_map(body_turtle("lamp", 'ms:colour "1 0.5 0.25" ; ms:intensity "800"^^xsd:double', cls=cls))
    )
    (lamp,) = world.lights
    assert (lamp.id, lamp.type, lamp.color, lamp.intensity) == ("lamp", kind, (1.0, 0.5, 0.25), 800.0)
    assert (lamp.pose.position, lamp.facts, world.bodies, findings) == ((1.0, 2.0, 3.0), (), (), ())


# -- the map and other resources ---------------------------------------------------------------------------------------


def test_a_label_of_the_map_is_its_name(read: ReadMap) -> None:
    world, _ = read(room_map(':room rdfs:label "The kitchen" ; e:floor 2 .'))
    assert world.name == "The kitchen"
    assert world.facts == (
        PropertyAssertion(Iri("http://example.org/terms#floor"), Literal("2", Iri(XSD + "integer"))),
    )


def test_other_subjects_become_resources(read: ReadMap) -> None:
    world, _ = read(room_map("k:Cup a owl:Class .", "[] a owl:AllDifferent .", "e:Jo e:likes e:Cy ."))
    assert [resource.iri for resource in world.resources] == [knowrob_iri("Cup"), "_:b1", "http://example.org/terms#Jo"]


def test_duplicate_ids_are_renamed_and_reported(read: ReadMap) -> None:
    other = body_turtle("cup").replace(":cup", "<http://elsewhere.org/maps#cup>").replace("cup>-pose", "cup-pose>")
    world, (finding,) = read(room_map(body_turtle("cup"), other))
    assert [each.id for each in world.bodies] == ["cup", "cup-2"]
    assert finding.individual == "http://elsewhere.org/maps#cup"


def test_an_explicit_id_takes_precedence_over_a_local_name(read: ReadMap) -> None:
    world, _ = read(room_map(body_turtle("cup"), body_turtle("mug", 'ms:id "cup"'), body_turtle("jug", 'ms:id "cup"')))
    assert [(each.iri, each.id) for each in world.bodies] == [
        (individual("cup"), "cup-2"),
        (individual("mug"), "cup"),
        (individual("jug"), "jug"),
    ]
