"""SOMA maps: localizations, shapes, colors and joints behind chains of nodes, valid and invalid."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest

from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import LengthUnit, QuaternionOrder, UnitConventions, save_map
from mindstage.scene import BodyId, PrimitiveType, World
from mindstage.scene.edits import Spawn
from mindstage.scene.transforms import rotation_matrix
from tests.maps.dialect_maps import check_round_trip, finding_texts, joint_range, matrix_turtle, soma_map
from tests.maps.small_maps import ReadMap, assert_worlds_equal, knowledge_base_from

BOX = "a soma:BoxShape ; soma:hasDepth {} ; soma:hasWidth {} ; soma:hasHeight {}"


def located(
    name: str,
    cls: str = "soma:Cup",
    *facts: str,
    at: str = "1.0 2.0 3.0",
    turned: str = "0.0 0.0 0.0 1.0",
    shape: str = BOX.format(0.5, 0.6, 0.7),
    more: str = "",
) -> str:
    """An individual with the node chains of these maps."""
    joined = "".join(f" ; {fact}" for fact in facts)
    return f"""
    :{name} a owl:NamedIndividual, {cls} ;
        soma:hasShape [ a soma:Shape ; dul:hasRegion [ {shape} ] ] ;
        soma:hasLocalization [ a soma:Localization ; soma:hasSpaceRegion [ a soma:6DPose ;
            k:quaternion "{turned}"^^soma:array_double ; k:translation "{at}"^^soma:array_double {more} ] ]{joined} ."""


def jointed(cls: str, parent: str = "case", child: str = "door", *facts: str) -> str:
    joined = "".join(f" ; {fact}" for fact in facts)
    return f"urdf:hasJoint [ a {cls} ; urdf:hasParentLink :{parent} ; urdf:hasChildLink :{child}{joined} ]"


LIMITS = "urdf:hasJointLimits [ a urdf:JointLimits ; urdf:hasLowerLimit {} ; urdf:hasUpperLimit {} ]"
DOOR_JOINT = """:door_joint a owl:Class ; rdfs:subClassOf urdf:RevoluteJoint , [ a owl:Restriction ;
    owl:onProperty urdf:hasJointLimits ; owl:hasValue [ urdf:hasLowerLimit 0.0 ; urdf:hasUpperLimit 1.57 ] ] ."""
CASE = located("case", "soma:Refrigerator", jointed(":door_joint"), "soma:hasPhysicalComponent :door", at="0 0 1")
DOOR = located(
    "door", "soma:Door", "soma:hasPhysicalComponent :handle", at="-0.27 0 1", shape=BOX.format(0.04, 0.6, 0.7)
)
HANDLE = located("handle", "soma:DesignedHandle", at="-0.3 -0.25 1", shape=BOX.format(0.02, 0.02, 0.3))


# -- individuals -------------------------------------------------------------------------------------------------------


def test_the_localization_gives_the_pose(read: ReadMap, tmp_path: Path) -> None:
    world = check_round_trip(read, soma_map(located("cup", turned="0.0 0.0 0.6 0.8")), tmp_path)
    assert (world.iri, world.name) == ("http://example.org/old.owl#old", "old")
    [cup] = world.bodies
    assert cup.pose.position == (1.0, 2.0, 3.0)
    assert cup.pose.quaternion == (0.8, 0.0, 0.0, 0.6)
    assert cup.size == (0.5, 0.6, 0.7)
    assert cup.cls.endswith("#Cup")


@pytest.mark.parametrize(
    ("shape", "kind", "size"),
    [
        ("a soma:SphereShape ; soma:hasRadius 0.25", PrimitiveType.SPHERE, (0.5, 0.5, 0.5)),
        ("a soma:CylinderShape ; soma:hasRadius 0.25 ; soma:hasLength 2.0", PrimitiveType.CYLINDER, (0.5, 0.5, 2.0)),
        ("a soma:CylinderShape ; soma:hasRadius 0.25 ; soma:hasLength 0.5", PrimitiveType.CYLINDER, (0.5, 0.5, 0.5)),
    ],
)
def test_spheres_and_cylinders_are_read(
    read: ReadMap, tmp_path: Path, shape: str, kind: PrimitiveType, size: tuple[float, ...]
) -> None:
    [ball] = check_round_trip(read, soma_map(located("ball", shape=shape)), tmp_path).bodies
    assert ball.shape is not None
    assert (ball.shape.type, ball.size) == (kind, size)


def test_mesh_and_color_are_read(read: ReadMap, tmp_path: Path) -> None:
    color = 'soma:hasColor [ dul:hasRegion [ soma:hasRGBValue "51 102 255"^^soma:array_double ] ]'
    shape = 'a soma:MeshShape ; soma:hasFilePath "package://kitchen/cup.dae"'
    [cup] = check_round_trip(read, soma_map(located("cup", "soma:Cup", color, shape=shape)), tmp_path).bodies
    assert (cup.mesh, cup.size) == ("package://kitchen/cup.dae", None)
    assert cup.materials[0].color == pytest.approx((0.2, 0.4, 1.0))


def test_a_pose_relative_to_another_individual_is_read(read: ReadMap, tmp_path: Path) -> None:
    table = located("table", "soma:Table", at="1 0 0", turned=f"0 0 {np.sin(pi / 4)} {np.cos(pi / 4)}")
    plate = located("plate", more="; soma:isDescribedRelativeTo :table", at="0.5 0 1")
    cup = located("cup", more="; soma:isDescribedRelativeTo :plate", at="0 0 0.1")
    world = check_round_trip(read, soma_map(table, plate, cup), tmp_path)
    assert world.body("plate").pose.position == pytest.approx((1.0, 0.5, 1.0))
    assert world.body("cup").pose.position == pytest.approx((1.0, 0.5, 1.1))


@pytest.mark.parametrize("frame", [":moon", ":cup", '"base_link"'])
def test_a_pose_relative_to_an_unknown_frame_is_relative_to_the_map(read: ReadMap, tmp_path: Path, frame: str) -> None:
    text = soma_map(located("cup", more=f"; soma:isDescribedRelativeTo {frame}"))
    assert check_round_trip(read, text, tmp_path).body("cup").pose.position == (1.0, 2.0, 3.0)
    assert "read as relative to the map" in finding_texts(read(text)[1], "cup")


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        ({"turned": "0 0 0 0"}, "four that are not all 0"),
        ({"at": "1 2 nan"}, "three finite numbers"),
        ({"at": "1,4 0,9 0,75"}, "three finite numbers"),
        ({"at": "1 2"}, "three finite numbers"),
    ],
)
def test_an_individual_with_an_invalid_pose_is_omitted(
    read: ReadMap, tmp_path: Path, arguments: dict[str, str], found: str
) -> None:
    text = soma_map(located("cup", **arguments), located("mug"))  # type: ignore[arg-type]
    assert [body.id for body in check_round_trip(read, text, tmp_path).bodies] == ["mug"]
    assert found in finding_texts(read(text)[1], "cup")
    assert "it is omitted" in finding_texts(read(text)[1], "cup")


def test_a_cyclic_localization_is_reported(read: ReadMap, tmp_path: Path) -> None:
    circle = (
        ":cup a soma:Cup ; soma:hasLocalization :here . :here soma:hasSpaceRegion :there . :there dul:hasRegion :here ."
    )
    text = soma_map(circle, located("mug"))
    assert [body.id for body in check_round_trip(read, text, tmp_path).bodies] == ["mug"]
    assert "its localization has no pose" in finding_texts(read(text)[1], "cup")


def test_another_individual_is_not_a_localization(read: ReadMap, tmp_path: Path) -> None:
    text = soma_map(":cup a soma:Cup ; soma:hasLocalization :mug .", located("mug"))
    assert [body.id for body in check_round_trip(read, text, tmp_path).bodies] == ["mug"]
    assert "its localization has no pose" in finding_texts(read(text)[1], "cup")


def test_a_body_without_an_iri_is_read_and_reported(read: ReadMap, tmp_path: Path) -> None:
    nameless = located("cup").replace(":cup a", "[] a", 1)
    text = soma_map(nameless, located("mug"))
    world = check_round_trip(read, text, tmp_path)
    assert {body.id for body in world.bodies} == {"mug", "unnamed1"}
    assert any("it has no IRI" in finding.problem for finding in read(text)[1])


def test_the_user_may_override_the_conventions(tmp_path: Path) -> None:
    path = tmp_path / "map.ttl"
    cup = located("cup", at="100 200 300", turned="0.8 0 0 0.6", shape=BOX.format(50, 60, 70))
    path.write_text(soma_map(cup), encoding="utf-8")
    knowledge = KnowledgeBase(bundled_ontology=False)
    knowledge.load(path, conventions=UnitConventions(units=LengthUnit.CENTIMETERS, quaternion=QuaternionOrder.WXYZ))
    [body] = knowledge.world().bodies
    assert (body.pose.position, body.pose.quaternion) == ((1.0, 2.0, 3.0), (0.8, 0.0, 0.0, 0.6))
    assert body.size == (0.5, 0.6, 0.7)
    assumptions = {assumption.topic: assumption for assumption in knowledge.assumptions()}
    assert (assumptions["units"].overridden, assumptions["quaternion"].overridden, assumptions["frame"].overridden) == (
        True,
        True,
        False,
    )


def test_bodies_in_the_vocabulary_of_dialect_1_are_joined_too(read: ReadMap, tmp_path: Path) -> None:
    door = """:door a soma:Door ; k:describedInMap :old ;
        k:pose [ k:translation "-0.27 0 1" ; k:quaternion "1 0 0 0" ] ."""
    world = check_round_trip(read, soma_map(DOOR_JOINT, CASE, door), tmp_path)
    assert [(each.parent, each.child) for each in world.joints] == [("case", "door")]


def test_a_map_may_mix_two_dialects(read: ReadMap, tmp_path: Path) -> None:
    old = ":mug a k:Cup ; k:orientation :m . " + matrix_turtle("m", 4, 5, 6)
    world = check_round_trip(read, soma_map(located("cup"), old), tmp_path)
    assert {body.id: body.pose.position for body in world.bodies} == {"cup": (1, 2, 3), "mug": (4, 5, 6)}


# -- joints and attachments --------------------------------------------------------------------------------------------


def test_a_door_turns_about_the_edge_away_from_its_handle_and_away_from_its_case(read: ReadMap, tmp_path: Path) -> None:
    world = check_round_trip(read, soma_map(DOOR_JOINT, CASE, DOOR, HANDLE), tmp_path)
    [hinge] = world.joints
    assert (hinge.parent, hinge.child) == ("case", "door")
    assert joint_range(hinge) == (0.0, 1.57)
    assert hinge.pose.position == pytest.approx((-0.27, 0.3, 1.0))
    axis = rotation_matrix(hinge.pose.quaternion)[:, 0]
    np.testing.assert_allclose(axis, (0, 0, -1), atol=1e-12)  # turning on takes the handle, on the right, towards -x
    assert {(each.parent, each.child) for each in world.attachments} == {("door", "handle")}
    assert world.body("door").physics.is_dynamic
    assert world.body("case").physics.mobility is None


def test_a_door_opens_in_the_engine_as_far_as_its_joint_allows(read: ReadMap) -> None:
    engine = MujocoEngine()
    assert engine.apply(Spawn(read(soma_map(DOOR_JOINT, CASE, DOOR, HANDLE))[0])).report.ok
    for _ in range(400):
        ids, poses = engine.poses()
        outwards = rotation_matrix(poses[ids.index(BodyId("handle"))][3:])[:, 0]
        engine.apply_force(BodyId("handle"), tuple((-6.0 * outwards).tolist()))  # type: ignore[arg-type]
        engine.step(0.01)
    angle = engine.joint_positions()[BodyId("case-joint")][3]
    engine.close()
    assert angle == pytest.approx(1.57, abs=0.01)


def test_the_position_of_a_joint_is_read(read: ReadMap, tmp_path: Path) -> None:
    joint = jointed(
        "urdf:PrismaticJoint",
        "case",
        "door",
        LIMITS.format("-0.1", "0.3"),
        'urdf:hasAxisVector "0 0 2"',
        'urdf:hasOrigin [ urdf:hasXYZ "0.1 0 0" ]',
    )
    case = located("case", "soma:Case", joint, at="1 1 1", turned=f"{np.sin(pi / 4)} 0 0 {np.cos(pi / 4)}")
    [slide] = check_round_trip(read, soma_map(case, DOOR, HANDLE), tmp_path).joints
    assert joint_range(slide) == pytest.approx((-0.1, 0.3), abs=1e-15)
    assert slide.pose.position == pytest.approx((1.1, 1.0, 1.0))
    np.testing.assert_allclose(rotation_matrix(slide.pose.quaternion)[:, 0], (0, -1, 0), atol=1e-12)


@pytest.mark.parametrize(
    ("joint", "found"),
    [
        (jointed(":door_joint", "case", "ghost"), "ghost is not a body of this map; the joint is kept as a fact"),
        (jointed(":door_joint", "case", "case"), "connects it to itself"),
        (jointed("urdf:TelescopicJoint"), "TelescopicJoint is an unknown type of joint"),
        (jointed("urdf:RevoluteJoint"), "it opens outwards, by 1.57 rad"),
        (jointed("urdf:RevoluteJoint", "case", "door", LIMITS.format("2.0", "1.0")), "the two are swapped"),
        (jointed("urdf:RevoluteJoint", "case", "door", LIMITS.format('"x"', "1.0")), "not two finite numbers"),
        ("urdf:hasJoint :nowhere", "its joint is not described anywhere"),
        (f"{jointed(':door_joint')}, [ urdf:hasChildLink :door ]", "a second joint"),
    ],
)
def test_an_invalid_joint_is_reported(read: ReadMap, tmp_path: Path, joint: str, found: str) -> None:
    text = soma_map(DOOR_JOINT, located("case", "soma:Case", joint, at="0 0 1"), DOOR, HANDLE)
    check_round_trip(read, text, tmp_path)
    assert found in finding_texts(read(text)[1], "case")


def test_cyclic_and_missing_components_are_reported(read: ReadMap, tmp_path: Path) -> None:
    around = located("case", "soma:Case", "soma:hasPhysicalComponent :door, :moon"), ":handle dul:hasComponent :case ."
    text = soma_map(*around, DOOR, HANDLE)
    assert len(check_round_trip(read, text, tmp_path).attachments) == 2
    findings = read(text)[1]
    assert any("would be its own ancestor" in finding.problem for finding in findings)
    assert "moon is not a body of this map" in finding_texts(findings, "case")


# -- the sample --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sample(shared_data: Path) -> KnowledgeBase:
    return knowledge_base_from(shared_data / "maps" / "soma-iai-room.owl", bundled_ontology=True)


@pytest.fixture(scope="module")
def kitchen(sample: KnowledgeBase) -> World:
    return sample.world()


def test_the_sample_is_read_completely(sample: KnowledgeBase, kitchen: World) -> None:
    # 14 handles are fixed to drawers, 3 to doors; the dishwasher and a drawer without a joint to their blocks.
    assert (len(kitchen.bodies), len(kitchen.joints), len(kitchen.attachments)) == (49, 17, 19)
    assert not [finding for finding in sample.findings() if finding.severity.value == "error"]
    assert {joint_range(each) for each in kitchen.joints} == {(0.0, 0.48), (0.0, 1.57), (0.0, 2.0)}
    assert {"units", "quaternion", "mobility", "joints: position"} <= {each.topic for each in sample.assumptions()}
    assert kitchen.body("kitchen_island_counter_top").materials


def test_the_sample_is_on_the_ground(kitchen: World) -> None:
    for wall in ("kitchen_wall_north", "kitchen_wall_west", "kitchen_wall_east_1"):
        body = kitchen.body(wall)
        assert body.size is not None
        assert body.pose.position[2] - body.size[2] / 2 == pytest.approx(0.0)
    assert kitchen.body("kitchen_island_counter_top").pose.position[2] > kitchen.body("kitchen_island").pose.position[2]


def test_the_sample_is_stable_for_ten_seconds_and_survives_a_round_trip(kitchen: World, tmp_path: Path) -> None:
    engine = MujocoEngine()
    assert engine.apply(Spawn(kitchen)).report.ok
    before = engine.poses()[1]
    engine.step(10.0)
    after = engine.poses()[1]
    engine.close()
    assert np.isfinite(after).all()
    assert np.abs(after[:, :3] - before[:, :3]).max() < 0.01
    save_map(kitchen, tmp_path / "back.owl")
    assert_worlds_equal(kitchen, knowledge_base_from(tmp_path / "back.owl", bundled_ontology=True).world())


def test_questions_are_answered_from_the_sample(sample: KnowledgeBase) -> None:
    drawers = sample.ask("individual_of_class", cls="http://www.ease-crc.org/ont/SOMA.owl#Drawer", map="IAI-Kitchen")
    assert len(list(drawers)) == 15
