"""Maps of KnowRob 1: perceptions, matrices, parts and joints, whole and broken."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest

from mindstage.knowledge import KnowledgeBase, save_map
from mindstage.knowledge.dialects.poses import MatrixPose, pose_from_matrix
from mindstage.scene import World, diff
from mindstage.scene.transforms import quaternion_from_matrix, rotation_matrix
from tests.knowledge.maps import ReadMap, assert_worlds_equal, knowledge_base_from
from tests.knowledge.other_maps import (
    check_round_trip,
    finding_texts,
    joint_range,
    knowrob1_map,
    matrix_turtle,
    perception,
)

CUP = ":cup a k:Cup ; k:describedInMap :old ."
BOX = 'k:depthOfObject "{}"^^xsd:float ; k:widthOfObject "{}"^^xsd:float ; k:heightOfObject "{}"^^xsd:float'


def box(name: str, cls: str, at: tuple[float, ...], size: tuple[float, ...], *facts: str) -> str:
    more = "".join(f" ; {fact}" for fact in facts)
    return (
        f":{name} a k:{cls} ; k:orientation :m-{name} ; {BOX.format(*size)}{more} .\n{matrix_turtle(f'm-{name}', *at)}"
    )


CUPBOARD = box("cupboard", "Cupboard", (0, 0, 1), (0.6, 0.8, 1.0), "k:properPhysicalParts :door, :hinge")
DOOR = box("door", "Door", (0.31, 0, 1), (0.02, 0.8, 1.0), "k:properPhysicalParts :handle")
HANDLE = box("handle", "Handle", (0.35, 0.3, 1), (0.02, 0.02, 0.2))
HINGE = """:hinge a k:HingedJoint ; k:connectedTo-Rigidly :door ; k:turnRadius "0.7" ;
    k:minJointValue "-0.1"^^xsd:float ; k:maxJointValue "1.57"^^xsd:float ."""


# -- where things are --------------------------------------------------------------------------------------------------


def test_the_newest_perception_counts_and_the_others_stay_facts(read: ReadMap, tmp_path: Path) -> None:
    text = knowrob1_map(
        CUP, perception("cup", "200", 2, 0, 1), perception("cup", "1000", 3, 0, 1), perception("cup", "99", 1, 0, 1)
    )
    world = check_round_trip(read, text, tmp_path)
    assert world.body("cup").pose.position == (3.0, 0.0, 1.0)
    assert sum("#see-cup" in resource.iri for resource in world.resources) == 3


def test_a_perception_with_a_date_is_newer_than_one_without(read: ReadMap) -> None:
    dated = """:see a k:SemanticMapPerception ; k:objectActedOn :cup ; k:startTime "2011-05-04T12:00:00Z" ;
        k:eventOccursAt [ k:translation "5 0 1" ; k:quaternion "1 0 0 0" ] ."""
    undated = f":seen k:objectActedOn :cup ; k:eventOccursAt :somewhere . {matrix_turtle('somewhere', 1, 0, 1)}"
    world, _ = read(knowrob1_map(CUP, undated, dated))
    assert world.body("cup").pose.position == (5.0, 0.0, 1.0)


def test_a_perception_that_cannot_be_understood_gives_way_to_the_one_before(read: ReadMap, tmp_path: Path) -> None:
    text = knowrob1_map(CUP, perception("cup", "1", 1, 2, 3), perception("cup", "2", 4, 5, 6, m11="nan"))
    assert check_round_trip(read, text, tmp_path).body("cup").pose.position == (1.0, 2.0, 3.0)
    assert "'nan' as m11, which is not a finite number; it tells no place" in finding_texts(read(text)[1], "cup")


@pytest.mark.parametrize(
    ("statement", "found"),
    [
        ("", ""),
        (":see k:objectActedOn :cup ; k:eventOccursAt :nowhere .", "nowhere is not described anywhere"),
        (perception("cup", "1", 1, 2, 3, m00=None), "does not tell m00"),
        (perception("cup", "1", 1, 2, 3, m00=0, m11=0), "lie in one plane"),
        (perception("cup", "1", 1, 2, 3, m33=0), "m33, is 0"),
        (perception("cup", "1", 1, 2, 3, m00=1e308), "too large to reckon with"),
        (perception("cup", "1", 1, 2, 3, m33=1e-320), "too large to reckon with"),
        (perception("cup", "1", 1, 2, 3, m03="0,5"), "'0,5' as m03"),
    ],
)
def test_without_a_place_a_thing_is_left_out_and_named(
    read: ReadMap, tmp_path: Path, statement: str, found: str
) -> None:
    text = knowrob1_map(
        CUP, statement, ":table a k:Table ; k:orientation :m ; k:describedInMap :old .", matrix_turtle("m", 0, 0, 0)
    )
    assert [body.id for body in check_round_trip(read, text, tmp_path).bodies] == ["table"]
    told = finding_texts(read(text)[1], "cup")
    assert found in told
    assert "it is left out; what is said about it is kept" in told


def test_a_matrix_off_a_rotation_becomes_the_nearest_one(read: ReadMap) -> None:
    stretched = knowrob1_map(CUP, perception("cup", "1", 0, 0, 1, m00=0, m01=-2, m10=2, m11=0))
    world, findings = read(stretched)
    np.testing.assert_allclose(world.body("cup").pose.quaternion, (np.cos(pi / 4), 0, 0, np.sin(pi / 4)), atol=1e-12)
    assert "it is off a rotation by 1; the nearest rotation counts" in finding_texts(findings, "cup")


def test_a_position_in_the_last_row_is_found(read: ReadMap) -> None:
    rows = knowrob1_map(CUP, perception("cup", "1", 0, 0, 0, m30=1, m31=2, m32=3, m00=0, m01=1, m10=-1, m11=0))
    world, findings = read(rows)
    assert world.body("cup").pose.position == (1.0, 2.0, 3.0)
    assert rotation_matrix(world.body("cup").pose.quaternion)[0, 1] == pytest.approx(-1.0)
    assert "rows are taken as columns" in finding_texts(findings, "cup")


def test_left_handed_matrices_lose_their_mirror_and_that_is_said_aloud(read: ReadMap, tmp_path: Path) -> None:
    path = tmp_path / "mirrored.ttl"
    path.write_text(knowrob1_map(CUP, perception("cup", "1", 1, 2, 3, m00=0, m01=1, m10=1, m11=0)), encoding="utf-8")
    knowledge = knowledge_base_from(path)
    turned = rotation_matrix(knowledge.world().body("cup").pose.quaternion)
    np.testing.assert_allclose(turned, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    [told] = [assumption for assumption in knowledge.assumptions() if assumption.topic == "handedness"]
    assert "1 of 1 matrices are left-handed: cup" in told.evidence


def test_any_rotation_comes_back_from_its_matrix() -> None:
    random = np.random.default_rng(4)
    for _ in range(100):
        quaternion = random.normal(size=4)
        quaternion /= np.linalg.norm(quaternion) * np.sign(quaternion[0])
        matrix = np.eye(4)
        matrix[:3, :3] = rotation_matrix(quaternion)
        found = pose_from_matrix(matrix)
        assert isinstance(found, MatrixPose)
        assert (found.mirrored, found.repairs) == (False, ())
        np.testing.assert_allclose(found.pose.quaternion, quaternion, atol=1e-9)
    for half_turn in np.diag([1, -1, -1.0]), np.diag([-1, 1, -1.0]), np.diag([-1, -1, 1.0]):
        np.testing.assert_allclose(rotation_matrix(quaternion_from_matrix(half_turn)), half_turn, atol=1e-12)


def test_lengths_below_zero_are_lengths(read: ReadMap, tmp_path: Path) -> None:
    text = knowrob1_map(box("cupboard", "Cupboard", (0, 0, 1), (0.6, 0.8, -1.0)))
    assert check_round_trip(read, text, tmp_path).body("cupboard").size == (0.6, 0.8, 1.0)
    assert finding_texts(read(text)[1], "cupboard") == ""


# -- who belongs to the map, and what hangs together -------------------------------------------------------------------


def test_parts_belong_to_the_map_of_their_whole(read: ReadMap, tmp_path: Path) -> None:
    other = ":elsewhere a k:SemanticEnvironmentMap . :mug a k:Cup ; k:orientation :m-mug . " + matrix_turtle(
        "m-mug", 9, 9, 9
    )
    text = knowrob1_map(CUPBOARD, ":cupboard k:describedInMap :old .", DOOR, HANDLE, HINGE, other)
    path = tmp_path / "two.ttl"
    path.write_text(text, encoding="utf-8")
    world = knowledge_base_from(path).world("old")
    assert {body.id for body in world.bodies} == {"cupboard", "door", "handle"}
    assert [constraint.id for constraint in world.joints] == ["hinge"]


def test_questions_know_who_lives_in_a_map_that_does_not_say_it(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(knowrob1_map(CUPBOARD, DOOR, HANDLE, HINGE), encoding="utf-8")
    knowledge = knowledge_base_from(path, bundled_ontology=True)
    assert {row.handle.rpartition("#")[2] for row in knowledge.ask("handle_of", individual="cupboard")} == {"handle"}


def test_what_is_fixed_goes_with_its_whole_and_what_is_hinged_moves(read: ReadMap, tmp_path: Path) -> None:
    world = check_round_trip(read, knowrob1_map(CUPBOARD, DOOR, HANDLE, HINGE), tmp_path)
    assert {(each.parent, each.child) for each in world.attachments} == {("door", "handle")}
    [hinge] = world.joints
    assert (hinge.parent, hinge.child) == ("cupboard", "door")
    assert joint_range(hinge) == pytest.approx((-0.1, 1.57), abs=1e-15)
    # The handle is on the left, seen from inside; the door turns about the upright edge 0.7 m away from it.
    assert hinge.pose.position == pytest.approx((0.31, -0.4, 1.0))
    np.testing.assert_allclose(rotation_matrix(hinge.pose.quaternion)[:, 0], (0, 0, -1), atol=1e-12)
    assert world.body("door").physics.is_dynamic


def test_a_joint_says_itself_where_it_is_and_which_way_it_goes(read: ReadMap, tmp_path: Path) -> None:
    slide = """:slide a k:PrismaticJoint ; k:connectedTo-Rigidly :cupboard, :drawer ; k:direction [
        k:vectorX "0.0"^^xsd:float ; k:vectorY "-2.0"^^xsd:float ; k:vectorZ "0"^^xsd:float ] ;
        k:minJointValue "0"^^xsd:float ; k:maxJointValue "0.35"^^xsd:float ."""
    drawer = box("drawer", "Drawer", (0, 0, 1.2), (0.5, 0.7, 0.2))
    cupboard = CUPBOARD.replace(":door, :hinge", ":drawer, :slide")
    text = knowrob1_map(cupboard, drawer, slide, perception("slide", "1", 0.1, 0.2, 0.3))
    [constraint] = check_round_trip(read, text, tmp_path).joints
    assert constraint.pose.position == (0.1, 0.2, 0.3)
    assert joint_range(constraint) == (0.0, 0.35)
    np.testing.assert_allclose(rotation_matrix(constraint.pose.quaternion)[:, 0], (0, -1, 0), atol=1e-12)


def test_a_joint_with_its_ends_turned_round_says_so(read: ReadMap, tmp_path: Path) -> None:
    text = knowrob1_map(CUPBOARD, DOOR, HANDLE, HINGE.replace('"-0.1"', '"3.5"'))
    [hinge] = check_round_trip(read, text, tmp_path).joints
    assert joint_range(hinge) == pytest.approx((1.57, 3.5))
    assert "its least value 3.5 is more than its greatest 1.57" in finding_texts(read(text)[1], "hinge")


@pytest.mark.parametrize(
    ("hinge", "about_whom", "found"),
    [
        (HINGE.replace("HingedJoint", "WobblyJoint"), "hinge", "WobblyJoint is no known kind of joint"),
        (
            HINGE.replace('k:maxJointValue "1.57"^^xsd:float', 'k:maxJointValue "inf"'),
            "hinge",
            "it may move without end",
        ),
        (":hinge a k:HingedJoint .", "hinge", "its parent is missing"),
        (":hinge a k:HingedJoint . :cupboard k:hingedTo :door .", "hinge", "it may move without end"),
        (":lost a k:HingedJoint ; k:describedInMap :old .", "lost", "its parent is missing"),
        (":cupboard k:hingedTo :door .", "cupboard", "no joint tells how far"),
    ],
)
def test_a_joint_that_tells_too_little_ends_in_a_finding(
    read: ReadMap, tmp_path: Path, hinge: str, about_whom: str, found: str
) -> None:
    text = knowrob1_map(CUPBOARD, DOOR, HANDLE, hinge)
    check_round_trip(read, text, tmp_path)
    assert found in finding_texts(read(text)[1], about_whom)


def test_parts_in_a_circle_end_in_a_finding(read: ReadMap, tmp_path: Path) -> None:
    text = knowrob1_map(CUPBOARD, DOOR, HANDLE, ":handle k:properPhysicalParts :cupboard .")
    check_round_trip(read, text, tmp_path)
    assert any("would be its own ancestor" in finding.problem for finding in read(text)[1])


def test_parts_told_in_the_frame_of_their_whole_are_found_there(tmp_path: Path) -> None:
    whole = box("cupboard", "Cupboard", (5, 0, 1), (0.6, 0.8, 1.0), "k:properPhysicalParts :door")
    door = box("door", "Door", (0.31, 0, 0), (0.02, 0.8, 1.0), "k:properPhysicalParts :handle")
    path = tmp_path / "nested.ttl"
    path.write_text(
        knowrob1_map(whole, door, box("handle", "Handle", (0.05, 0.3, 0), (0.02, 0.02, 0.2))), encoding="utf-8"
    )
    knowledge = knowledge_base_from(path)
    assert knowledge.world().body("handle").pose.position == pytest.approx((5.36, 0.3, 1.0))
    [told] = [assumption for assumption in knowledge.assumptions() if assumption.topic == "poses of parts"]
    assert told.value == "in the frame of what they are parts of"


# -- the sample --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sample(shared_data: Path) -> KnowledgeBase:
    return knowledge_base_from(shared_data / "maps" / "knowrob1-ccrl.owl", bundled_ontology=True)


@pytest.fixture(scope="module")
def laboratory(sample: KnowledgeBase) -> World:
    return sample.world()


def test_the_sample_is_there_as_a_whole(sample: KnowledgeBase, laboratory: World) -> None:
    assert (len(laboratory.bodies), len(laboratory.attachments)) == (59, 33)
    assert not [finding for finding in sample.findings() if finding.severity.value == "error"]
    by_about = {assumption.topic: assumption for assumption in sample.assumptions()}
    assert "55 of 59" in by_about["handedness"].evidence
    assert by_about["poses of parts"].value == "in the frame of the map"


def test_the_sample_stands_upright(laboratory: World) -> None:
    heights = {
        body.id: body.pose.position[2] + np.array((-0.5, 0.5)) * body.size[2] for body in laboratory.bodies if body.size
    }
    assert min(low for low, _ in heights.values()) == pytest.approx(0.2)
    # What stands on one another in the room does so here: oven on cupboard, cupboard on oven, drawers in their row.
    assert heights["oven0"][0] == pytest.approx(heights["cupboard12"][1], abs=0.001)
    assert heights["cupboard11"][0] == pytest.approx(heights["oven0"][1], abs=0.001)
    up = [rotation_matrix(body.pose.quaternion)[2, 2] for body in laboratory.bodies]
    np.testing.assert_allclose(up, 1.0, atol=1e-9)


def test_the_sample_comes_back_from_a_file(laboratory: World, tmp_path: Path) -> None:
    save_map(laboratory, tmp_path / "back.owl")
    assert_worlds_equal(laboratory, knowledge_base_from(tmp_path / "back.owl", bundled_ontology=True).world())
    assert diff(laboratory, laboratory).lost_facts == 0
