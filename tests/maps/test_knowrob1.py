"""Maps of KnowRob 1: perceptions, matrices, parts and joints, whole and broken."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest

from mindstage.knowledge import KnowledgeBase
from mindstage.maps import save_map
from mindstage.maps.dialects.poses import MatrixPose, pose_from_matrix
from mindstage.scene import World, diff
from mindstage.scene.transforms import quaternion_from_matrix, rotation_matrix
from tests.maps.dialect_maps import (
    check_round_trip,
    finding_texts,
    joint_range,
    knowrob1_map,
    matrix_turtle,
    perception,
)
from tests.maps.small_maps import ReadMap, assert_worlds_equal, knowledge_base_from

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


# -- poses -------------------------------------------------------------------------------------------------------------


def test_the_latest_perception_gives_the_pose_and_the_others_are_kept(read: ReadMap, tmp_path: Path) -> None:
    text = knowrob1_map(
        CUP, perception("cup", "200", 2, 0, 1), perception("cup", "1000", 3, 0, 1), perception("cup", "99", 1, 0, 1)
    )
    world = check_round_trip(read, text, tmp_path)
    assert world.body("cup").pose.position == (3.0, 0.0, 1.0)
    assert sum("#see-cup" in resource.iri for resource in world.resources) == 3


def test_a_perception_with_a_date_is_later_than_one_without(read: ReadMap) -> None:
    dated = """:see a k:SemanticMapPerception ; k:objectActedOn :cup ; k:startTime "2011-05-04T12:00:00Z" ;
        k:eventOccursAt [ k:translation "5 0 1" ; k:quaternion "1 0 0 0" ] ."""
    undated = f":seen k:objectActedOn :cup ; k:eventOccursAt :somewhere . {matrix_turtle('somewhere', 1, 0, 1)}"
    world, _ = read(knowrob1_map(CUP, undated, dated))
    assert world.body("cup").pose.position == (5.0, 0.0, 1.0)


def test_an_invalid_perception_is_replaced_by_the_previous_one(read: ReadMap, tmp_path: Path) -> None:
    text = knowrob1_map(CUP, perception("cup", "1", 1, 2, 3), perception("cup", "2", 4, 5, 6, m11="nan"))
    assert check_round_trip(read, text, tmp_path).body("cup").pose.position == (1.0, 2.0, 3.0)
    assert "'nan' as m11, which is not a finite number; this pose is ignored" in finding_texts(read(text)[1], "cup")


@pytest.mark.parametrize(
    ("statement", "found"),
    [
        ("", ""),
        (":see k:objectActedOn :cup ; k:eventOccursAt :nowhere .", "nowhere is not described anywhere"),
        (perception("cup", "1", 1, 2, 3, m00=None), "does not give m00"),
        (perception("cup", "1", 1, 2, 3, m00=0, m11=0), "linearly dependent"),
        (perception("cup", "1", 1, 2, 3, m33=0), "m33, is 0"),
        (perception("cup", "1", 1, 2, 3, m00=1e308), "too large"),
        (perception("cup", "1", 1, 2, 3, m33=1e-320), "too large"),
        (perception("cup", "1", 1, 2, 3, m03="0,5"), "'0,5' as m03"),
    ],
)
def test_an_individual_without_a_pose_is_omitted_and_reported(
    read: ReadMap, tmp_path: Path, statement: str, found: str
) -> None:
    text = knowrob1_map(
        CUP, statement, ":table a k:Table ; k:orientation :m ; k:describedInMap :old .", matrix_turtle("m", 0, 0, 0)
    )
    assert [body.id for body in check_round_trip(read, text, tmp_path).bodies] == ["table"]
    texts = finding_texts(read(text)[1], "cup")
    assert found in texts
    assert "it is omitted; its statements are kept" in texts


def test_a_matrix_that_is_not_a_rotation_becomes_the_nearest_one(read: ReadMap) -> None:
    stretched = knowrob1_map(CUP, perception("cup", "1", 0, 0, 1, m00=0, m01=-2, m10=2, m11=0))
    world, findings = read(stretched)
    np.testing.assert_allclose(world.body("cup").pose.quaternion, (np.cos(pi / 4), 0, 0, np.sin(pi / 4)), atol=1e-12)
    assert "it differs from a rotation by 1; the nearest rotation is used" in finding_texts(findings, "cup")


def test_a_position_in_the_last_row_is_read(read: ReadMap) -> None:
    rows = knowrob1_map(CUP, perception("cup", "1", 0, 0, 0, m30=1, m31=2, m32=3, m00=0, m01=1, m10=-1, m11=0))
    world, findings = read(rows)
    assert world.body("cup").pose.position == (1.0, 2.0, 3.0)
    assert rotation_matrix(world.body("cup").pose.quaternion)[0, 1] == pytest.approx(-1.0)
    assert "the matrix is transposed" in finding_texts(findings, "cup")


def test_left_handed_matrices_are_converted_and_reported(read: ReadMap, tmp_path: Path) -> None:
    path = tmp_path / "mirrored.ttl"
    path.write_text(knowrob1_map(CUP, perception("cup", "1", 1, 2, 3, m00=0, m01=1, m10=1, m11=0)), encoding="utf-8")
    knowledge = knowledge_base_from(path)
    turned = rotation_matrix(knowledge.world().body("cup").pose.quaternion)
    np.testing.assert_allclose(turned, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    [assumption] = [assumption for assumption in knowledge.assumptions() if assumption.topic == "handedness"]
    assert "1 of 1 matrices are left-handed: cup" in assumption.evidence


def test_any_rotation_survives_conversion_to_a_matrix() -> None:
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


def test_negative_lengths_become_positive(read: ReadMap, tmp_path: Path) -> None:
    text = knowrob1_map(box("cupboard", "Cupboard", (0, 0, 1), (0.6, 0.8, -1.0)))
    assert check_round_trip(read, text, tmp_path).body("cupboard").size == (0.6, 0.8, 1.0)
    assert finding_texts(read(text)[1], "cupboard") == ""


# -- membership and attachments ----------------------------------------------------------------------------------------


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


def test_questions_use_inferred_membership(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(knowrob1_map(CUPBOARD, DOOR, HANDLE, HINGE), encoding="utf-8")
    knowledge = knowledge_base_from(path, bundled_ontology=True)
    assert {row.handle.rpartition("#")[2] for row in knowledge.ask("handle_of", individual="cupboard")} == {"handle"}


def test_fixed_parts_are_attached_and_hinged_parts_move(read: ReadMap, tmp_path: Path) -> None:
    world = check_round_trip(read, knowrob1_map(CUPBOARD, DOOR, HANDLE, HINGE), tmp_path)
    assert {(each.parent, each.child) for each in world.attachments} == {("door", "handle")}
    [hinge] = world.joints
    assert (hinge.parent, hinge.child) == ("cupboard", "door")
    assert joint_range(hinge) == pytest.approx((-0.1, 1.57), abs=1e-15)
    # The handle is on the left, seen from inside; the door turns about the upright edge 0.7 m away from it.
    assert hinge.pose.position == pytest.approx((0.31, -0.4, 1.0))
    np.testing.assert_allclose(rotation_matrix(hinge.pose.quaternion)[:, 0], (0, 0, -1), atol=1e-12)
    assert world.body("door").physics.is_dynamic


def test_position_and_axis_of_a_joint_are_read(read: ReadMap, tmp_path: Path) -> None:
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


def test_swapped_joint_limits_are_reported(read: ReadMap, tmp_path: Path) -> None:
    text = knowrob1_map(CUPBOARD, DOOR, HANDLE, HINGE.replace('"-0.1"', '"3.5"'))
    [hinge] = check_round_trip(read, text, tmp_path).joints
    assert joint_range(hinge) == pytest.approx((1.57, 3.5))
    assert "its lower limit 3.5 is above its upper limit 1.57" in finding_texts(read(text)[1], "hinge")


@pytest.mark.parametrize(
    ("hinge", "subject", "found"),
    [
        (HINGE.replace("HingedJoint", "WobblyJoint"), "hinge", "WobblyJoint is an unknown type of joint"),
        (
            HINGE.replace('k:maxJointValue "1.57"^^xsd:float', 'k:maxJointValue "inf"'),
            "hinge",
            "it opens outwards, by 1.57 rad",
        ),
        (":hinge a k:HingedJoint .", "hinge", "its parent is missing"),
        (":hinge a k:HingedJoint . :cupboard k:hingedTo :door .", "hinge", "it opens outwards, by 1.57 rad"),
        (":lost a k:HingedJoint ; k:describedInMap :old .", "lost", "its parent is missing"),
        (":cupboard k:hingedTo :door .", "cupboard", "no joint gives their motion"),
    ],
)
def test_an_incomplete_joint_is_reported(read: ReadMap, tmp_path: Path, hinge: str, subject: str, found: str) -> None:
    text = knowrob1_map(CUPBOARD, DOOR, HANDLE, hinge)
    check_round_trip(read, text, tmp_path)
    assert found in finding_texts(read(text)[1], subject)


def test_a_cycle_of_parts_is_reported(read: ReadMap, tmp_path: Path) -> None:
    text = knowrob1_map(CUPBOARD, DOOR, HANDLE, ":handle k:properPhysicalParts :cupboard .")
    check_round_trip(read, text, tmp_path)
    assert any("would be its own ancestor" in finding.problem for finding in read(text)[1])


def test_poses_of_parts_relative_to_their_whole_are_recognized(tmp_path: Path) -> None:
    whole = box("cupboard", "Cupboard", (5, 0, 1), (0.6, 0.8, 1.0), "k:properPhysicalParts :door")
    door = box("door", "Door", (0.31, 0, 0), (0.02, 0.8, 1.0), "k:properPhysicalParts :handle")
    path = tmp_path / "nested.ttl"
    path.write_text(
        knowrob1_map(whole, door, box("handle", "Handle", (0.05, 0.3, 0), (0.02, 0.02, 0.2))), encoding="utf-8"
    )
    knowledge = knowledge_base_from(path)
    assert knowledge.world().body("handle").pose.position == pytest.approx((5.36, 0.3, 1.0))
    [assumption] = [assumption for assumption in knowledge.assumptions() if assumption.topic == "poses of parts"]
    assert assumption.value == "in the frame of their wholes"


# -- the sample --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sample(shared_data: Path) -> KnowledgeBase:
    return knowledge_base_from(shared_data / "maps" / "knowrob1-ccrl.owl", bundled_ontology=True)


@pytest.fixture(scope="module")
def laboratory(sample: KnowledgeBase) -> World:
    return sample.world()


def test_the_sample_is_read_completely(sample: KnowledgeBase, laboratory: World) -> None:
    assert (len(laboratory.bodies), len(laboratory.attachments)) == (59, 33)
    assert not [finding for finding in sample.findings() if finding.severity.value == "error"]
    by_about = {assumption.topic: assumption for assumption in sample.assumptions()}
    assert "55 of 59" in by_about["handedness"].evidence
    assert by_about["poses of parts"].value == "in the frame of the map"


def test_the_sample_is_upright(laboratory: World) -> None:
    heights = {
        body.id: body.pose.position[2] + np.array((-0.5, 0.5)) * body.size[2] for body in laboratory.bodies if body.size
    }
    assert min(low for low, _ in heights.values()) == pytest.approx(0.2)
    # As in the real room, the oven is on a cupboard, a cupboard on the oven, and the drawers are in a row.
    assert heights["oven0"][0] == pytest.approx(heights["cupboard12"][1], abs=0.001)
    assert heights["cupboard11"][0] == pytest.approx(heights["oven0"][1], abs=0.001)
    up = [rotation_matrix(body.pose.quaternion)[2, 2] for body in laboratory.bodies]
    np.testing.assert_allclose(up, 1.0, atol=1e-9)


def test_the_sample_survives_a_round_trip(laboratory: World, tmp_path: Path) -> None:
    save_map(laboratory, tmp_path / "back.owl")
    assert_worlds_equal(laboratory, knowledge_base_from(tmp_path / "back.owl", bundled_ontology=True).world())
    assert diff(laboratory, laboratory).lost_facts == 0
