"""Who hangs on whom and who is joined to whom, whichever side tells it."""

from __future__ import annotations

import pytest

from mindstage.knowledge import Severity
from mindstage.world import (
    AngularMotion,
    Attachment,
    Fact,
    Iri,
    LinearMotion,
    Literal,
    Motion,
    Pose,
    Reference,
    Resource,
    Soft,
    Tag,
)
from tests.knowledge.maps import XSD, Read, body, constraint, knowrob, m, room

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
    links = [body("b0"), *(body(f"b{n}", f"k:parent :b{n - 1}", at=f"{n} 0 0") for n in range(1, 400))]
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


def test_a_limit_that_is_not_told_is_nought_and_that_is_said(read: Read) -> None:
    joint = constraint("slide", "a", "b").replace('k:limit "0.45"^^xsd:float ;', "")
    world, (finding,) = read(room(body("a"), body("b"), joint))
    assert world.constraints[0].linear == LinearMotion(x=Motion.LIMITED)
    assert (finding.individual, finding.property) == (m("slide-linear"), knowrob("limit"))


def test_a_constraint_without_pose_is_left_out_and_named(read: Read) -> None:
    joint = constraint("slide", "a", "b").replace(" ; k:pose :slide-pose", "")
    world, (error,) = read(room(body("a"), body("b"), joint))
    assert world.constraints == ()
    assert (error.severity, error.individual, error.property) == (Severity.ERROR, m("slide"), knowrob("pose"))


def test_of_two_ends_the_first_counts(read: Read) -> None:
    world, (finding,) = read(room(body("a"), body("b"), body("c"), constraint("slide", "a", "b", "k:child :c")))
    assert world.constraints[0].child == "b"
    assert world.constraints[0].facts == (Fact(knowrob("child"), Reference(m("c"))),)
    assert finding.individual == m("slide")


def test_one_motion_that_cannot_be_understood_is_locked_and_stays_a_fact(read: Read) -> None:
    joint = constraint("slide", "a", "b").replace("k:xMotion 1", "k:xMotion 7")
    world, findings = read(room(body("a"), body("b"), joint))
    assert world.constraints[0].linear.x is Motion.LOCKED
    (part,) = world.resources
    assert part == Resource(m("slide-linear"), (Fact(knowrob("xMotion"), Literal("7", Iri(XSD + "integer"))),))
    assert {finding.individual for finding in findings} == {m("slide-linear")}
