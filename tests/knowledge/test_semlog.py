"""What a map of dialect 1 says is what stands in its world; the rest of it stays as facts."""

from __future__ import annotations

import math

import pytest

from mindstage.knowledge import Severity
from mindstage.world import (
    AngularMotion,
    Anonymous,
    Attachment,
    Fact,
    Iri,
    LightKind,
    LinearMotion,
    Literal,
    Material,
    Mobility,
    Motion,
    Physics,
    Pose,
    Reference,
    Resource,
    Shape,
    ShapeKind,
    Soft,
    Tag,
)
from tests.knowledge.maps import OWL, RDFS, XSD, Read, body, constraint, knowrob, m, room

RDF_TYPE = Iri("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")


def float_fact(property: str, text: str) -> Fact:
    return Fact(knowrob(property), Literal(text, Iri(XSD + "float")))


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
    world, _ = read(
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
    assert cup.label == "cup"
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


# -- sizes -------------------------------------------------------------------------------------------------------------


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


# -- relations ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "told", [":table k:child :cup .", ":cup k:parent :table .", ":table k:child :cup . :cup k:parent :table ."]
)
def test_either_side_may_tell_a_relation(told: str, read: Read) -> None:
    world, findings = read(room(body("table"), body("cup"), told))
    assert [(each.parent, each.child) for each in world.attachments] == [("table", "cup")]
    assert [thing.facts for thing in world.bodies] == [(), ()]
    assert findings == ()


def test_a_second_parent_is_a_fact_and_named(read: Read) -> None:
    world, (finding,) = read(room(body("a"), body("b"), body("cup", "k:parent :a, :b")))
    assert world.attachments == (Attachment(parent=world.bodies[0].id, child=world.bodies[2].id),)
    assert world.body("cup").facts == (Fact(knowrob("parent"), Reference(m("b"))),)
    assert finding.individual == m("cup")
    assert m("a") in finding.what
    assert m("b") in finding.what


def test_a_circle_is_cut_where_it_closes(read: Read) -> None:
    world, (finding,) = read(room(body("a", "k:child :b"), body("b", "k:child :c"), body("c", "k:child :a")))
    assert [(each.parent, each.child) for each in world.attachments] == [("a", "b"), ("b", "c")]
    assert world.body("c").facts == (Fact(knowrob("child"), Reference(m("a"))),)
    assert finding.individual == m("c")


def test_nothing_hangs_on_itself(read: Read) -> None:
    world, (finding,) = read(room(body("a", "k:child :a")))
    assert world.attachments == ()
    assert finding.individual == m("a")


def test_a_relation_to_something_unknown_is_a_fact_and_named(read: Read) -> None:
    world, (finding,) = read(room(body("a", "k:child :ghost")))
    assert world.bodies[0].facts == (Fact(knowrob("child"), Reference(m("ghost"))),)
    assert m("ghost") in finding.what


def test_a_long_chain_is_read_in_one_go(read: Read) -> None:
    links = [body("b0"), *(body(f"b{n}", f"k:parent :b{n - 1}") for n in range(1, 400))]
    world, findings = read(room(*links))
    assert len(world.attachments) == 399
    assert findings == ()


# -- constraints -------------------------------------------------------------------------------------------------------


def test_every_field_of_a_constraint_is_read(read: Read) -> None:
    world, findings = read(
        room(
            body("case"),
            body("drawer"),
            constraint("slide", "case", "drawer", 'k:tagsData "SemLog;Id,s1;"', "ms:disableCollision false"),
        )
    )
    (slide,) = world.constraints
    assert findings == ()
    assert (slide.id, slide.parent, slide.child) == ("slide", "case", "drawer")
    assert slide.pose == Pose((1.0, 2.0, 3.0))
    assert slide.linear == LinearMotion(x=Motion.LIMITED, limit=0.45)
    assert slide.angular == AngularMotion(
        twist=Motion.FREE,
        swing1_limit=0.1,
        swing2_limit=0.2,
        twist_limit=0.3,
        swing_soft=Soft(enabled=True, stiffness=4.0, damping=5.0),
    )
    assert slide.disable_collision is False
    assert slide.tags == (Tag(type="SemLog", key="Id", value="s1"),)
    assert (slide.facts, world.attachments, world.resources) == ((), (), ())


def test_roles_stay_upside_down(read: Read) -> None:
    world, _ = read(
        room(
            body("drawer", 'k:mobility "dynamic"'),
            body("case", 'k:mobility "static"'),
            constraint("slide", "drawer", "case"),
        )
    )
    assert (world.constraints[0].parent, world.constraints[0].child) == ("drawer", "case")


def test_a_body_may_tell_which_end_it_is(read: Read) -> None:
    joint = constraint("slide", "case", "drawer").replace(" ; k:child :drawer", "", 1)
    world, findings = read(room(body("case"), body("drawer", "k:parent :slide"), joint))
    (slide,) = world.constraints
    assert (slide.parent, slide.child) == ("case", "drawer")
    assert world.body("drawer").facts == (Fact(knowrob("parent"), Reference(m("slide"))),)
    assert findings == ()


@pytest.mark.parametrize("end", ["ghost", "slide"])
def test_a_constraint_whose_end_is_missing_is_left_out_and_named(end: str, read: Read) -> None:
    text = room(body("case"), constraint("slide", "case", end))
    world, findings = read(text)
    assert world.constraints == ()
    (error,) = (finding for finding in findings if finding.severity is Severity.ERROR)
    assert (error.individual, error.property) == (m("slide"), knowrob("child"))
    # All of it is still there, the parts included.
    assert {resource.iri for resource in world.resources} == {
        m(f"slide{part}") for part in ("", "-pose", "-linear", "-angular")
    }


def test_motions_that_are_not_told_are_locked_and_that_is_said(read: Read) -> None:
    world, findings = read(room(body("a"), body("b"), body("slide", "k:parent :a ; k:child :b", cls="k:Constraint")))
    assert world.constraints[0].linear == LinearMotion()
    assert {finding.property for finding in findings} == {knowrob("linearConstraint"), knowrob("angularConstraint")}


def test_one_motion_that_cannot_be_understood_is_locked_and_stays_a_fact(read: Read) -> None:
    joint = constraint("slide", "a", "b").replace("k:xMotion 1", "k:xMotion 7")
    world, findings = read(room(body("a"), body("b"), joint))
    assert world.constraints[0].linear.x is Motion.LOCKED
    (part,) = world.resources
    assert part == Resource(m("slide-linear"), (Fact(knowrob("xMotion"), Literal("7", Iri(XSD + "integer"))),))
    assert {finding.individual for finding in findings} == {m("slide-linear")}


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


# -- what cannot be taken ----------------------------------------------------------------------------------------------


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
def test_a_pose_that_is_none_leaves_its_body_out_and_names_it(at: str, turned: str, read: Read) -> None:
    world, findings = read(room(body("cup", at=at, turned=turned), body("mug", "k:parent :cup")))
    assert [thing.id for thing in world.bodies] == ["mug"]
    assert {resource.iri for resource in world.resources} == {m("cup"), m("cup-pose")}
    (error,) = (finding for finding in findings if finding.severity is Severity.ERROR)
    assert error.individual == m("cup")
    assert any(finding.individual == m("cup-pose") for finding in findings)
    assert any(finding.individual == m("mug") and m("cup") in finding.what for finding in findings)


@pytest.mark.parametrize("pose", ["", "k:pose :nowhere ;", 'k:pose "1 2 3" ;', "k:pose :cup ;", "k:pose :room ;"])
def test_no_pose_leaves_its_body_out_and_names_it(pose: str, read: Read) -> None:
    world, findings = read(room(f':cup a k:Cup ; {pose} k:describedInMap :room ; k:translation "1 2 3" .'))
    assert world.bodies == ()
    assert world.resources[0].iri == m("cup")
    assert [finding.individual for finding in findings if finding.severity is Severity.ERROR] == [m("cup")]


def test_of_two_poses_the_first_counts(read: Read) -> None:
    world, (finding,) = read(
        room(body("cup"), ':cup k:pose :other . :other k:translation "4 5 6" ; k:quaternion "1 0 0 0" .')
    )
    (cup,) = world.bodies
    assert cup.pose.position == (1.0, 2.0, 3.0)
    assert cup.facts == tuple(Fact(knowrob("pose"), Reference(m(name))) for name in ("cup-pose", "other"))
    assert [resource.iri for resource in world.resources] == [m("other")]
    assert finding.individual == m("cup")


def test_a_pose_that_is_one_counts_before_a_pose_that_is_none(read: Read) -> None:
    world, _ = read(
        room(
            ":cup a k:Cup ; k:describedInMap :room ; k:pose :bad, :good .",
            ':bad k:translation "a b c" . :good k:translation "4 5 6" ; k:quaternion "1 0 0 0" .',
        )
    )
    (cup,) = world.bodies
    assert cup.pose.position == (4.0, 5.0, 6.0)
    # The one that counts comes first, so that the writer gives its name to it.
    assert cup.facts == tuple(Fact(knowrob("pose"), Reference(m(name))) for name in ("good", "bad"))


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
def test_a_value_that_cannot_be_understood_is_a_fact_and_named(property: str, text: str, read: Read) -> None:
    world, (finding,) = read(room(body("cup", f'k:{property} "{text}"')))
    (cup,) = world.bodies
    assert (cup.physics, cup.size) == (Physics(), None)
    assert cup.facts == (Fact(knowrob(property), Literal(text)),)
    assert (finding.individual, finding.property) == (m("cup"), knowrob(property))
    assert text in finding.what


def test_of_two_masses_the_first_counts(read: Read) -> None:
    world, (finding,) = read(room(body("cup", 'k:mass "2.0"^^xsd:float, "3.0"^^xsd:float')))
    assert world.bodies[0].physics.mass_kg == 2.0
    assert world.bodies[0].facts == (float_fact("mass", "3.0"),)
    assert finding.property == knowrob("mass")


def test_materials_that_are_not_whole_stay_facts(read: Read) -> None:
    world, (finding,) = read(room(body("cup", "ms:material [ ms:index 0 ]")))
    assert world.bodies[0].materials == ()
    assert len(world.bodies[0].facts) == 1
    assert finding.individual == m("cup")


def test_a_map_that_nobody_calls_one_is_a_map_and_that_is_said(read: Read) -> None:
    text = room(body("cup")).replace("a owl:NamedIndividual, k:SemanticEnvironmentMap", "a owl:NamedIndividual")
    world, (finding,) = read(text)
    assert [thing.id for thing in world.bodies] == ["cup"]
    assert finding.individual == m("room")
