"""Robot descriptions as maps: links, joints and meshes, valid and invalid."""

from __future__ import annotations

import struct
from math import pi
from pathlib import Path

import numpy as np
import pytest

from mindstage.engines import NullEngine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import InvalidArgumentError, SourceParseError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import save_map
from mindstage.maps.urdf import is_urdf
from mindstage.maps.urdf.to_world import urdf_to_world
from mindstage.maps.urdf.urdf_model import UrdfLink, UrdfRobot
from mindstage.scene import AxisMotion, BodyId, Iri, Joint, JointMimic, Mobility, PrimitiveType, World
from mindstage.scene.edits import Spawn
from mindstage.scene.transforms import rotation_matrix
from mindstage.simulation import Simulation
from tests.maps.dialect_maps import joint_range
from tests.maps.small_maps import assert_worlds_equal, knowledge_base_from
from tests.maps.small_urdf import (
    KITCHEN_URDF,
    LoadedRobot,
    box_urdf,
    joint_urdf,
    link_urdf,
    load_robot,
    robot_urdf,
)

LIMIT = '<limit lower="{}" upper="{}"/>'


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "kitchen.urdf"


# -- valid descriptions ------------------------------------------------------------------------------------------------


def test_links_are_bodies_at_the_poses_given_by_joints(file: Path) -> None:
    world = load_robot(file, KITCHEN_URDF).world
    assert (world.iri, world.name) == ("http://mindstage.org/urdf/kitchen.owl#kitchen", "kitchen")
    assert world.body("counter_main").pose.position == (1.0, 0.0, 0.45)
    assert world.body("counter_main-piece2").pose.position == (1.0, 0.0, 0.92)
    assert world.body("counter_drawer_main").pose.position == pytest.approx((0.95, 0.4, 0.7))
    assert world.body("fridge_door_link").pose.position == pytest.approx((0.67, 1.6, 1.0))
    assert world.body("fridge").size == (0.6, 0.6, 2.0)
    assert world.body("world").size == (0.0, 0.0, 0.0)


def test_shapes_colors_and_masses_are_read(file: Path) -> None:
    world = load_robot(file, KITCHEN_URDF).world
    handle, lamp = world.body("counter_drawer_handle"), world.body("lamp_42")
    assert handle.shape is not None
    assert (handle.shape.type, handle.size) == (PrimitiveType.CYLINDER, (0.02, 0.02, 0.4))
    np.testing.assert_allclose(rotation_matrix(handle.pose.quaternion)[:, 2], (0, -1, 0), atol=1e-6)
    assert (handle.materials[0].name, handle.materials[0].color) == ("steel", (0.6, 0.6, 0.65))
    assert lamp.shape is not None
    assert (lamp.shape.type, lamp.size) == (PrimitiveType.SPHERE, (0.2, 0.2, 0.2))
    assert world.body("counter_drawer_main").physics.mass_kg == 4.5
    pieces = [world.body(id).physics.mass_kg for id in ("counter_main", "counter_main-piece2")]
    assert sum(mass or 0.0 for mass in pieces) == pytest.approx(60.0)


def test_classes_of_links_are_inferred_from_their_names(file: Path) -> None:
    loaded = load_robot(file, KITCHEN_URDF)
    classes = {body.id: body.cls.rpartition("#")[2] for body in loaded.world.bodies}
    expected = {
        "counter_drawer_handle": "Handle",
        "counter_drawer_main": "Drawer",
        "fridge_door_link": "Door",
        "world": "Link",
    }
    assert expected.items() <= classes.items()
    [assumed] = [each for each in loaded.knowledge.assumptions() if each.topic == "classes"]
    assert "counter_drawer_main is a Drawer" in assumed.evidence


def test_joints_keep_their_axes_and_asymmetric_ranges(file: Path) -> None:
    world = load_robot(file, KITCHEN_URDF).world
    drawer, door = sorted(world.joints, key=lambda each: each.id)
    assert (drawer.id, drawer.parent, drawer.child) == ("drawer_slide", "counter_main", "counter_drawer_main")
    assert (joint_range(drawer), drawer.linear.soft_limit.damping) == ((0.0, 0.48), 2.5)
    np.testing.assert_allclose(rotation_matrix(drawer.pose.quaternion)[:, 0], (-1, 0, 0), atol=1e-12)
    assert joint_range(door) == pytest.approx((-0.1, 1.9), abs=1e-15)
    assert door.pose.position == pytest.approx((0.67, 1.9, 1.0))
    np.testing.assert_allclose(rotation_matrix(door.pose.quaternion)[:, 0], (0, 0, -1), atol=1e-12)


def test_links_without_a_movable_joint_are_static(file: Path) -> None:
    world = load_robot(file, KITCHEN_URDF).world
    dynamic = {body.id for body in world.bodies if body.physics.mobility is Mobility.DYNAMIC}
    assert dynamic == {"counter_drawer_main", "counter_drawer_handle", "fridge_door_link"}
    assert ("world", "fridge") in {(each.parent, each.child) for each in world.attachments}


@pytest.mark.parametrize(
    ("type", "free"),
    [
        ("continuous", {"twist"}),
        ("planar", {"y", "z", "twist"}),
        ("floating", {"x", "y", "z", "twist", "swing1", "swing2"}),
    ],
)
def test_joints_without_limits_are_free_according_to_their_type(file: Path, type: str, free: set[str]) -> None:
    text = robot_urdf(
        link_urdf("base", box_urdf("1 1 1")),
        link_urdf("wheel", box_urdf("1 1 1")),
        joint_urdf("j", type, "base", "wheel"),
    )
    [constraint] = load_robot(file, text).world.joints
    assert constraint.angular.twist_limit == constraint.linear.limit == 0.0, "a free axis has no limit"
    motions = {axis: getattr(constraint.linear, axis) for axis in "xyz"}
    motions |= {axis: getattr(constraint.angular, axis) for axis in ("twist", "swing1", "swing2")}
    assert {axis for axis, motion in motions.items() if motion is AxisMotion.FREE} == free


def test_a_joint_whose_range_excludes_zero_is_at_the_closest_limit(file: Path) -> None:
    slide = joint_urdf("j", "prismatic", "base", "arm", '<axis xyz="1 0 0"/>' + LIMIT.format("0.2", "0.5"))
    world = load_robot(file, robot_urdf(link_urdf("base"), link_urdf("arm", box_urdf("1 1 1")), slide)).world
    assert world.body("arm").pose.position == pytest.approx((0.2, 0.0, 0.0))
    assert joint_range(world.joints[0]) == pytest.approx((0.0, 0.3))


def test_rpy_angles_are_about_fixed_axes_and_compose_along_the_chain(file: Path) -> None:
    first = joint_urdf("a", "fixed", "base", "mid", xyz="1 0 0", rpy=f"0 0 {pi / 2}")
    text = robot_urdf(
        link_urdf("base"), link_urdf("mid"), link_urdf("tip", box_urdf("1 2 3", rpy=f"{pi / 2} 0 {pi / 2}")), first
    )
    text = text.replace("</robot>", joint_urdf("b", "fixed", "mid", "tip", xyz="0 2 0") + "</robot>")
    tip = load_robot(file, text).world.body("tip")
    assert tip.pose.position == pytest.approx((-1.0, 0.0, 0.0))
    expected = np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 0]])  # half a turn about z, after a quarter about x
    np.testing.assert_allclose(rotation_matrix(tip.pose.quaternion), expected, atol=1e-12)


def test_everything_survives_a_round_trip_including_xml(file: Path, tmp_path: Path) -> None:
    world = load_robot(file, KITCHEN_URDF).world
    save_map(world, tmp_path / "back.owl")
    assert_worlds_equal(world, knowledge_base_from(tmp_path / "back.owl", bundled_ontology=True).world())
    assert "transmission" in str(world.facts)
    assert 'damping="2.5"' in str(next(each.facts for each in world.joints if each.id == "drawer_slide"))


def test_it_is_stable_for_ten_seconds_and_its_drawer_opens_in_one_direction(file: Path) -> None:
    engine = MujocoEngine()
    assert engine.apply(Spawn(load_robot(file, KITCHEN_URDF).world)).report.ok
    before = engine.poses()[1]
    engine.step(10.0)
    assert np.abs(engine.poses()[1] - before).max() < 0.005
    for force, end in ((-40.0, 0.48), (40.0, 0.0)):
        for _ in range(400):
            engine.apply_force(BodyId("counter_drawer_handle"), (force, 0.0, 0.0))
            engine.step(0.01)
        assert engine.joint_positions()[BodyId("drawer_slide")][0] == pytest.approx(end, abs=0.003)
    engine.close()


def test_questions_are_answered_from_a_description(file: Path) -> None:
    knowledge = load_robot(file, KITCHEN_URDF).knowledge
    answers = knowledge.ask("handle_of", individual="http://mindstage.org/urdf/kitchen.owl#counter_drawer_main")
    assert [row.handle.rpartition("#")[2] for row in answers] == ["counter_drawer_handle"]


def test_unusual_characters_in_names_are_escaped(file: Path, tmp_path: Path) -> None:
    world = load_robot(
        file, robot_urdf(link_urdf("left door <1>".replace("<", "&lt;").replace(">", "&gt;"), box_urdf("1 1 1")))
    ).world
    save_map(world, tmp_path / "back.owl")
    assert_worlds_equal(world, knowledge_base_from(tmp_path / "back.owl", bundled_ontology=True).world())
    assert world.bodies[0].cls.endswith("#Door")


# -- meshes ------------------------------------------------------------------------------------------------------------


def mesh(name: str, *, scale: str = "", xyz: str = "0 0 0", role: str = "visual") -> str:
    geometry = f'<mesh filename="{name}"{scale and f" scale={scale!r}"}/>'
    return f'<{role}><origin xyz="{xyz}"/><geometry>{geometry}</geometry></{role}>'


def test_a_link_that_is_named_like_the_map_gets_another_iri() -> None:
    links = (UrdfLink(name="room"), UrdfLink(name="lamp"))
    robot = UrdfRobot(name="home", links=links, joints=())
    converted = urdf_to_world(robot, map=Iri("http://example.org/home.owl#room")).world
    iris = [body.iri for body in converted.bodies]
    assert converted.iri == "http://example.org/home.owl#room"
    assert len({converted.iri, *iris}) == 3
    assert "http://example.org/home.owl#lamp" in iris


def test_the_size_of_a_mesh_is_read_from_its_file(file: Path, tmp_path: Path) -> None:
    meshes = tmp_path / "packages" / "kitchen_meshes" / "meshes"
    meshes.mkdir(parents=True)
    corners = [(0, 0, 0), (2, 0, 0), (0, 4, 6)]
    facet = struct.pack("<12fH", 0, 0, 1, *(float(x) for corner in corners for x in corner), 0)
    (meshes / "cup.stl").write_bytes(bytes(80) + struct.pack("<I", 1) + facet)
    (tmp_path / "text.stl").write_text(
        "solid cup\n facet normal 0 0 1\n  outer loop\n"
        + "".join(f"   vertex {x} {y} {z}\n" for x, y, z in corners)
        + "  endloop\n endfacet\nendsolid cup\n",
        encoding="utf-8",
    )
    (tmp_path / "cup.obj").write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "f 1 2 3\n", encoding="utf-8"
    )
    scaled = mesh("package://kitchen_meshes/meshes/cup.stl", scale="0.1 0.1 0.1", xyz="0 0 1")
    links = (link_urdf("cup", scaled), link_urdf("mug", mesh("cup.obj")), link_urdf("pot", mesh("text.stl")))
    file.write_text(robot_urdf(*links), encoding="utf-8")
    world = LoadedRobot(file, ontologies=(tmp_path / "packages",)).world
    cup, mug = world.body("cup"), world.body("mug")
    assert cup.mesh == "package://kitchen_meshes/meshes/cup.stl"
    assert cup.size == pytest.approx((0.2, 0.4, 0.6))
    assert cup.pose.position == pytest.approx((0.1, 0.2, 1.3))
    assert mug.size == pytest.approx((2.0, 4.0, 6.0))
    assert world.body("pot").size == pytest.approx((2.0, 4.0, 6.0))


@pytest.mark.parametrize("name", ["package://../../etc/passwd", "http://example.org/cup.stl", "gone.stl", "cup.dae"])
def test_a_mesh_without_a_file_has_a_path_and_no_size(file: Path, name: str) -> None:
    [cup] = load_robot(file, robot_urdf(link_urdf("cup", mesh(name)))).world.bodies
    assert (cup.mesh, cup.size) == (name, None)


def test_a_visual_mesh_takes_the_size_of_its_collision_geometry(file: Path) -> None:
    [cup] = load_robot(
        file, robot_urdf(link_urdf("cup", mesh("gone.dae"), box_urdf("1 2 3", role="collision")))
    ).world.bodies
    assert (cup.mesh, cup.size) == ("gone.dae", (1.0, 2.0, 3.0))


# -- invalid descriptions ----------------------------------------------------------------------------------------------


# -- joints that mimic others ------------------------------------------------------------------------------------------

SLIDE = '<axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="20" velocity="1"/>'


def gripper_urdf(mimic: str = '<mimic joint="left_joint"/>', *more: str, limit: str = SLIDE) -> str:
    """A hand with two fingers, of which the right one mimics the left one, as in the description of the Panda."""
    return robot_urdf(
        link_urdf("hand", box_urdf("0.1 0.2 0.1")),
        link_urdf("left", box_urdf("0.02 0.01 0.05"), '<inertial><mass value="0.05"/></inertial>'),
        link_urdf("right", box_urdf("0.02 0.01 0.05"), '<inertial><mass value="0.05"/></inertial>'),
        joint_urdf("left_joint", "prismatic", "hand", "left", limit, xyz="0 0.02 0.2"),
        joint_urdf("right_joint", "prismatic", "hand", "right", limit, mimic, xyz="0 -0.02 0.2", rpy="0 0 3.141592654"),
        *more,
    )


def joint_named(world: World, name: str) -> Joint:
    return next(joint for joint in world.joints if joint.id == name)


def test_a_joint_mimics_another_one_and_survives_a_round_trip(file: Path, tmp_path: Path) -> None:
    world = load_robot(file, gripper_urdf('<mimic joint="left_joint" multiplier="-2.5"/>')).world
    assert joint_named(world, "right_joint").mimic == JointMimic(joint=BodyId("left_joint"), multiplier=-2.5)
    assert joint_named(world, "left_joint").mimic is None
    for suffix in ("owl", "ttl"):
        save_map(world, tmp_path / f"out.{suffix}")
        assert_worlds_equal(world, knowledge_base_from(tmp_path / f"out.{suffix}").world(world.iri))


def test_a_follower_rests_where_its_master_puts_it(file: Path) -> None:
    limit = '<axis xyz="0 1 0"/><limit lower="0.01" upper="0.04"/>'
    mimic = '<mimic joint="left_joint" multiplier="2" offset="0.005"/>'
    world = load_robot(file, gripper_urdf(mimic, limit=limit)).world
    assert world.body("left").pose.position == pytest.approx((0, 0.03, 0.2))
    assert world.body("right").pose.position == pytest.approx((0, -0.02 - 0.025, 0.2), abs=1e-9)
    follower = joint_named(world, "right_joint")
    assert follower.mimic == JointMimic(joint=BodyId("left_joint"), multiplier=2.0)
    assert follower.linear.x_middle - follower.linear.limit == pytest.approx(0.01 - 0.025)


def test_a_rest_position_out_of_range_is_reported(file: Path) -> None:
    loaded = load_robot(file, gripper_urdf('<mimic joint="left_joint" offset="0.1"/>'))
    assert "whose rest position puts it at 0.1, out of its range" in loaded.findings_for("right_joint")
    follower = joint_named(loaded.world, "right_joint")
    assert follower.linear.x_middle + follower.linear.limit == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("mimic", "found"),
    [
        ('<mimic joint="thumb"/>', "'thumb', which is not a joint with one axis"),
        ('<mimic joint="right_joint"/>', "'right_joint', which mimics it in turn"),
        ("<mimic/>", "which is not a joint with one axis"),
        ('<mimic joint="left_joint" multiplier="many"/>', "multiplier='many' of <mimic> is not a finite number"),
    ],
)
def test_an_invalid_mimic_is_reported(file: Path, mimic: str, found: str) -> None:
    loaded = load_robot(file, gripper_urdf(mimic))
    assert found in loaded.findings_for("right_joint")
    assert len(loaded.world.joints) == 2


def test_fingers_move_together_and_opening_either_moves_the_master(file: Path) -> None:
    loaded = load_robot(file, gripper_urdf())
    with Simulation(loaded.knowledge, MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(loaded.world)
        for name in ("right_joint", "left_joint"):
            assert sim.joint(name).open(), name
            positions = [sim.joint(each).position for each in ("left_joint", "right_joint")]
            assert min(positions) > 0.03
            assert positions[0] == pytest.approx(positions[1], abs=0.001)
            assert sim.joint(name).close()
            assert sim.joint("left_joint").position == pytest.approx(0.0, abs=0.01)
        snapshot = sim.snapshot()
    assert [joint.mimic for joint in snapshot.joints] == [joint.mimic for joint in loaded.world.joints]


def test_a_follower_moves_its_master_without_physics(file: Path) -> None:
    loaded = load_robot(file, gripper_urdf('<mimic joint="left_joint" multiplier="0.5"/>'))
    with Simulation(loaded.knowledge, NullEngine(), primitive_shapes=True) as sim:
        sim.spawn(loaded.world)
        assert sim.joint("right_joint").move_to(0.02)
        assert sim.joint("left_joint").position == pytest.approx(0.04)
        with pytest.raises(InvalidArgumentError, match="out of range"):
            sim.joint("right_joint").move_to(0.03)


BASE = link_urdf("base", box_urdf("1 1 1"))
ARM = link_urdf("arm", box_urdf("1 1 1"))


@pytest.mark.parametrize(
    ("elements", "whom", "found"),
    [
        ((BASE, joint_urdf("j", "hinged", "base", "arm"), ARM), "j", "'hinged' is not a type of joint"),
        ((BASE, ARM, joint_urdf("j", "revolute", "base", "arm", LIMIT.format(2, 1))), "j", "the two are swapped"),
        ((BASE, ARM, joint_urdf("j", "revolute", "base", "arm")), "j", "it has no limit"),
        ((BASE, ARM, joint_urdf("j", "prismatic", "base", "arm", '<axis xyz="0 0 0"/>')), "j", "its axis is 0 0 0"),
        ((BASE, ARM, joint_urdf("j", "fixed", "base", "arm", xyz="0 nan 0")), "j", "is not three finite numbers"),
        ((BASE, ARM, joint_urdf("j", "fixed", "base", "leg")), "", "j: it joins leg, which is not a link"),
        ((BASE, ARM, joint_urdf("j", "fixed", "arm", "arm")), "", "j: it joins a link to itself"),
        (
            (BASE, ARM, joint_urdf("j", "continuous", "base", "arm", '<mimic joint="k"/>')),
            "j",
            "it moves independently",
        ),
        ((BASE, BASE), "base", "its name is taken"),
        ((link_urdf("base", box_urdf("1 1")),), "base", "a box has no size"),
        ((link_urdf("base", box_urdf("1 1 -1")),), "base", "a box has no size"),
        ((link_urdf("base", "<visual><geometry/></visual>"),), "base", "has no box, cylinder, sphere or mesh"),
        ((link_urdf("base", '<inertial><mass value="-3"/></inertial>'),), "base", "its mass is -3 kg"),
        ((BASE, ARM), "", "2 links have no parent"),
        ((BASE, ARM, *(joint_urdf(n, "fixed", "base", "arm") for n in "jk")), "k", "arm is already a child of base"),
    ],
)
def test_invalid_elements_are_reported(
    file: Path, tmp_path: Path, elements: tuple[str, ...], whom: str, found: str
) -> None:
    loaded = load_robot(file, robot_urdf(*elements))
    assert loaded.world.bodies
    assert found in (loaded.findings_for(whom) if whom else str(loaded.findings))
    save_map(loaded.world, tmp_path / "back.owl")
    assert_worlds_equal(loaded.world, knowledge_base_from(tmp_path / "back.owl", bundled_ontology=True).world())


def test_links_in_a_loop_have_poses(file: Path) -> None:
    circle = [joint_urdf(f"j{n}", "fixed", f"l{n}", f"l{(n + 1) % 3}", xyz="1 0 0") for n in range(3)]
    loaded = load_robot(file, robot_urdf(*(link_urdf(f"l{n}", box_urdf("1 1 1")) for n in range(3)), *circle))
    assert len(loaded.world.bodies) == 3
    assert len(loaded.world.attachments) == 2
    assert "would be its own ancestor" in str(loaded.findings)


def test_a_chain_of_a_thousand_links_is_read(file: Path) -> None:
    links = [link_urdf(f"l{n}", box_urdf("0.1 0.1 0.1")) for n in range(1000)]
    joints = [joint_urdf(f"j{n}", "fixed", f"l{n}", f"l{n + 1}", xyz="0.1 0 0") for n in range(999)]
    assert load_robot(file, robot_urdf(*links, *joints)).world.body("l999").pose.position == pytest.approx(
        (99.9, 0.0, 0.0)
    )


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("<!DOCTYPE robot [<!ENTITY a 'aaaa'>]>" + robot_urdf(BASE)[21:], "document type"),
        ("<!DOCTYPE robot SYSTEM 'http://example.org/x.dtd'>" + robot_urdf(BASE)[21:], "document type"),
        (robot_urdf(BASE)[:-20], "not well-formed XML"),
        (robot_urdf("<a>" * 300 + "</a>" * 300), "more than 200 deep"),
        (robot_urdf(), "has no link"),
        (robot_urdf(BASE) + "<more/>", "not well-formed XML"),
    ],
)
def test_an_invalid_file_is_refused_with_its_cause(file: Path, text: str, cause: str) -> None:
    with pytest.raises(SourceParseError, match=cause):
        load_robot(file, text)


def test_a_description_is_recognized_by_its_root_element(tmp_path: Path) -> None:
    path = tmp_path / "map.owl"
    path.write_text(KITCHEN_URDF, encoding="utf-8")
    assert is_urdf(path)
    assert LoadedRobot(path).world.bodies
    path.write_text("<?xml version='1.0'?><!-- <robot> --><robots/>", encoding="utf-8")
    assert not is_urdf(path)
    path.write_text("<!--a-->" * 5000 + "<robots/>", encoding="utf-8")
    assert not is_urdf(path)
    assert not is_urdf(tmp_path / "gone")


def test_an_untrusted_description_measures_no_mesh_outside_of_packages(tmp_path: Path) -> None:
    package = tmp_path / "packages" / "parts"
    package.mkdir(parents=True)
    corners = b"v 0 0 0\nv 1 2 3\n"
    (package / "part.obj").write_bytes(corners)
    (tmp_path / "secret.obj").write_bytes(corners)
    names = {"granted": "package://parts/part.obj", "beside": "secret.obj", "file": (tmp_path / "secret.obj").as_uri()}
    links = [
        link_urdf(name, f'<visual><geometry><mesh filename="{mesh}"/></geometry></visual>')
        for name, mesh in names.items()
    ]
    path = tmp_path / "robot.urdf"
    path.write_text(robot_urdf(*links), encoding="utf-8")
    for is_trusted in (True, False):
        with KnowledgeBase() as knowledge:
            knowledge.load(path, ontologies=tmp_path / "packages", follow_imports=is_trusted)
            sizes = {body.id: body.size for body in knowledge.world().bodies}
        assert sizes["granted"] == (1.0, 2.0, 3.0)
        assert {sizes["beside"], sizes["file"]} == ({(1.0, 2.0, 3.0)} if is_trusted else {None})
