"""Attachments and joints, given by either of the two individuals."""

from __future__ import annotations

import pytest

from mindstage.rdf import Severity
from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    Iri,
    IriRef,
    LinearLimits,
    Literal,
    NamedResource,
    Pose,
    PropertyAssertion,
    SoftLimit,
    Tag,
)
from tests.maps.small_maps import XSD, ReadMap, body_turtle, individual, knowrob_iri, room_map, slide_joint

# -- attachments -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "statements", [":table k:child :cup .", ":cup k:parent :table .", ":table k:child :cup . :cup k:parent :table ."]
)
def test_either_body_may_give_an_attachment(statements: str, read: ReadMap) -> None:
    world, findings = read(room_map(body_turtle("table"), body_turtle("cup"), statements))
    assert [(each.parent, each.child) for each in world.attachments] == [("table", "cup")]
    assert [body.facts for body in world.bodies] == [(), ()]
    assert findings == ()


def test_a_second_parent_is_kept_as_a_fact_and_reported(read: ReadMap) -> None:
    world, (finding,) = read(room_map(body_turtle("a"), body_turtle("b"), body_turtle("cup", "k:parent :a, :b")))
    assert world.attachments == (Attachment(parent=world.bodies[0].id, child=world.bodies[2].id),)
    assert world.body("cup").facts == (PropertyAssertion(knowrob_iri("parent"), IriRef(individual("b"))),)
    assert finding.individual == individual("cup")
    assert individual("a") in finding.problem
    assert individual("b") in finding.problem


def test_a_cycle_is_broken_where_it_closes(read: ReadMap) -> None:
    world, (finding,) = read(
        room_map(body_turtle("a", "k:child :b"), body_turtle("b", "k:child :c"), body_turtle("c", "k:child :a"))
    )
    assert [(each.parent, each.child) for each in world.attachments] == [("a", "b"), ("b", "c")]
    assert world.body("c").facts == (PropertyAssertion(knowrob_iri("child"), IriRef(individual("a"))),)
    assert finding.individual == individual("c")


def test_no_body_is_attached_to_itself(read: ReadMap) -> None:
    world, (finding,) = read(room_map(body_turtle("a", "k:child :a")))
    assert world.attachments == ()
    assert finding.individual == individual("a")


def test_a_relation_to_an_unknown_individual_is_kept_as_a_fact_and_reported(read: ReadMap) -> None:
    world, (finding,) = read(room_map(body_turtle("a", "k:child :ghost")))
    assert world.bodies[0].facts == (PropertyAssertion(knowrob_iri("child"), IriRef(individual("ghost"))),)
    assert individual("ghost") in finding.problem


def test_a_long_chain_is_read(read: ReadMap) -> None:
    links = [
        body_turtle("b0"),
        *(body_turtle(f"b{n}", f"k:parent :b{n - 1}", position=f"{n} 0 0") for n in range(1, 400)),
    ]
    world, findings = read(room_map(*links))
    assert len(world.attachments) == 399
    assert findings == ()


# -- joints ------------------------------------------------------------------------------------------------------------


def test_every_field_of_a_joint_is_read(read: ReadMap) -> None:
    world, findings = read(
        room_map(
            body_turtle("case"),
            body_turtle("drawer"),
            slide_joint("slide", "case", "drawer", 'k:tagsData "SemLog;Id,s1;"', "ms:disableCollision false"),
        )
    )
    (slide,) = world.joints
    assert findings == ()
    assert (slide.id, slide.parent, slide.child) == ("slide", "case", "drawer")
    assert slide.pose == Pose((1.0, 2.0, 3.0))
    assert slide.linear == LinearLimits(x=AxisMotion.LIMITED, limit=0.45)
    assert slide.angular == AngularLimits(
        twist=AxisMotion.FREE,
        swing1_limit=0.1,
        swing2_limit=0.2,
        twist_limit=0.3,
        swing_soft_limit=SoftLimit(enabled=True, stiffness=4.0, damping=5.0),
    )
    assert slide.disable_collision is False
    assert slide.tags == (Tag(type="SemLog", key="Id", value="s1"),)
    assert (slide.facts, world.attachments, world.resources) == ((), (), ())


def test_swapped_roles_are_kept(read: ReadMap) -> None:
    world, _ = read(
        room_map(
            body_turtle("drawer", 'k:mobility "dynamic"'),
            body_turtle("case", 'k:mobility "static"'),
            slide_joint("slide", "drawer", "case"),
        )
    )
    assert (world.joints[0].parent, world.joints[0].child) == ("drawer", "case")


def test_a_body_may_refer_to_its_joint(read: ReadMap) -> None:
    joint = slide_joint("slide", "case", "drawer").replace(" ; k:child :drawer", "", 1)
    world, findings = read(room_map(body_turtle("case"), body_turtle("drawer", "k:parent :slide"), joint))
    (slide,) = world.joints
    assert (slide.parent, slide.child) == ("case", "drawer")
    assert world.body("drawer").facts == (PropertyAssertion(knowrob_iri("parent"), IriRef(individual("slide"))),)
    assert findings == ()


@pytest.mark.parametrize("end", ["ghost", "slide"])
def test_a_joint_without_one_of_its_bodies_is_omitted_and_reported(end: str, read: ReadMap) -> None:
    text = room_map(body_turtle("case"), slide_joint("slide", "case", end))
    world, findings = read(text)
    assert world.joints == ()
    (error,) = (finding for finding in findings if finding.severity is Severity.ERROR)
    assert (error.individual, error.property) == (individual("slide"), knowrob_iri("child"))
    # All of its statements are kept, with its nested resources.
    assert {resource.iri for resource in world.resources} == {
        individual(f"slide{part}") for part in ("", "-pose", "-linear", "-angular")
    }


def test_missing_motions_are_locked_and_reported(read: ReadMap) -> None:
    world, findings = read(
        room_map(
            body_turtle("a"), body_turtle("b"), body_turtle("slide", "k:parent :a ; k:child :b", cls="k:Constraint")
        )
    )
    assert world.joints[0].linear == LinearLimits()
    assert {finding.property for finding in findings} == {
        knowrob_iri("linearConstraint"),
        knowrob_iri("angularConstraint"),
    }


def test_a_missing_limit_is_zero_and_reported(read: ReadMap) -> None:
    joint = slide_joint("slide", "a", "b").replace('k:limit "0.45"^^xsd:float ;', "")
    world, (finding,) = read(room_map(body_turtle("a"), body_turtle("b"), joint))
    assert world.joints[0].linear == LinearLimits(x=AxisMotion.LIMITED)
    assert (finding.individual, finding.property) == (individual("slide-linear"), knowrob_iri("limit"))


def test_a_joint_without_a_pose_is_omitted_and_reported(read: ReadMap) -> None:
    joint = slide_joint("slide", "a", "b").replace(" ; k:pose :slide-pose", "")
    world, (error,) = read(room_map(body_turtle("a"), body_turtle("b"), joint))
    assert world.joints == ()
    assert (error.severity, error.individual, error.property) == (
        Severity.ERROR,
        individual("slide"),
        knowrob_iri("pose"),
    )


def test_the_first_of_two_parents_counts(read: ReadMap) -> None:
    world, (finding,) = read(
        room_map(body_turtle("a"), body_turtle("b"), body_turtle("c"), slide_joint("slide", "a", "b", "k:child :c"))
    )
    assert world.joints[0].child == "b"
    assert world.joints[0].facts == (PropertyAssertion(knowrob_iri("child"), IriRef(individual("c"))),)
    assert finding.individual == individual("slide")


def test_an_invalid_motion_is_locked_and_kept_as_a_fact(read: ReadMap) -> None:
    joint = slide_joint("slide", "a", "b").replace("k:xMotion 1", "k:xMotion 7")
    world, findings = read(room_map(body_turtle("a"), body_turtle("b"), joint))
    assert world.joints[0].linear.x is AxisMotion.LOCKED
    (part,) = world.resources
    assert part == NamedResource(
        individual("slide-linear"), (PropertyAssertion(knowrob_iri("xMotion"), Literal("7", Iri(XSD + "integer"))),)
    )
    assert {finding.individual for finding in findings} == {individual("slide-linear")}
