"""Robots as parts of worlds, spawned in MuJoCo."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mindstage import KnowledgeBase
from mindstage.engines.base import Actuator
from mindstage.engines.edits import SetActuators
from mindstage.engines.mujoco.engine import MujocoEngine
from mindstage.robots import add_robot
from mindstage.robots.control import MotionOutcome
from mindstage.robots.drives import drives_of
from mindstage.robots.models.forward_kinematics import link_poses, rest_positions
from mindstage.robots.models.link_tree import shape_points
from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import BaseType, RobotJointType, RobotModel
from mindstage.robots.world import RobotWorld, robot_world
from mindstage.scene import Mobility, Pose
from mindstage.scene.collision_shapes import CollisionShapeBatch, compile_geometry
from mindstage.scene.edits import Spawn
from mindstage.scene.joint_kinematics import moving_body
from mindstage.scene.transforms import normalized_pose_array, pose_array, pose_multiply, quat_angle, quat_rotate
from mindstage.simulation.simulation import Simulation
from tests.cases import each_case
from tests.robots.models.installed import known_model

HERE = Pose((1.0, -2.0, 0.5), (0.9659258262890683, 0.0, 0.0, 0.25881904510252074))
"""Turned by 30 degrees."""


def spawned(placed: RobotWorld) -> MujocoEngine:
    engine = MujocoEngine()
    report = engine.apply(Spawn(placed.world, geometry=placed.geometry)).report
    assert report.ok, report
    return engine


def test_links_are_spawned_at_their_frames() -> None:
    model = known_model("pr2")
    placed = robot_world(model, HERE, name="pr2")
    local = link_poses(model.joints, placed.zero, model.root)
    root = pose_multiply(normalized_pose_array(HERE), [0, 0, model.base.height_m, 1, 0, 0, 0])
    engine = spawned(placed)
    ids, poses = engine.poses()
    rows = {id: row for row, id in enumerate(ids)}
    for link, id in placed.link_ids.items():
        expected = pose_multiply(root, local[link])
        np.testing.assert_allclose(poses[rows[id]][:3], expected[:3], atol=1e-9)
        assert quat_angle(poses[rows[id]][3:], expected[3:]) < 1e-7
    engine.close()


@pytest.mark.parametrize("name", ["mobile_manipulator", "panda", "tiago"])
def test_every_joint_moves_its_child(name: str) -> None:
    world = robot_world(known_model(name), HERE, name="robot").world
    bodies = {body.id: body for body in world.bodies}
    moved = [moving_body(joint, bodies[joint.parent], bodies[joint.child])[0].id for joint in world.joints]
    assert moved == [joint.child for joint in world.joints]


@pytest.mark.parametrize("name", ["mobile_manipulator", "stretch", "pr2"])
def test_the_engine_lets_joints_move_as_far_as_the_model_states(name: str) -> None:
    model = known_model(name)
    placed = robot_world(model, HERE, name="robot")
    engine = spawned(placed)
    found = engine.compiled().joints
    for joint in model.actuated_joints:
        if joint.lower is not None and joint.upper is not None:
            [axis] = found[placed.joint_ids[joint.name]].axes
            assert axis.limit is not None, joint.name
            middle = placed.zero[joint.name] + axis.middle
            ends = middle - axis.limit, middle + axis.limit
            assert ends == pytest.approx((joint.lower, joint.upper)), joint.name
    engine.close()


def test_joints_move_links_as_forward_kinematics_says() -> None:
    """Servos drive each joint of the arm to another position; the links must be where the joints put them."""
    model = known_model("mobile_manipulator")
    placed = robot_world(model, HERE, name="robot")
    engine = spawned(placed)
    wanted = {"lift_joint": 0.7, "shoulder_pan_joint": -0.8, "shoulder_pitch_joint": 2.0, "elbow_joint": 1.2,
              "wrist_roll_joint": 1.0, "left_finger_joint": 0.03, "head_tilt_joint": 0.5}  # fmt: skip
    drives = drives_of(model, placed, name="robot")
    drives.add_to(engine)
    engine.set_commands({name: position - placed.zero[name] for name, position in wanted.items()})
    engine.step(4.0)
    states = engine.actuator_states()
    reached = {name: states[name].position + zero for name, zero in placed.zero.items() if name in states}
    for name, position in wanted.items():
        assert reached[name] == pytest.approx(position, abs=0.01), name
    positions = rest_positions(model.joints, reached)
    assert positions["right_finger_joint"] == reached["left_finger_joint"]
    ids, poses = engine.poses()
    rows = {id: row for row, id in enumerate(ids)}
    root = poses[rows[placed.link_ids[model.root]]]
    for link, pose in link_poses(model.joints, positions, model.root).items():
        expected = pose_multiply(root, pose)
        np.testing.assert_allclose(poses[rows[placed.link_ids[link]]][:3], expected[:3], atol=1e-3, err_msg=link)
    engine.close()


AXES = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0.6, 0, -0.8), (-0.6, 0.64, 0.48))


def made_up_model(folder: Path, axis: tuple[float, ...], type: str) -> RobotModel:
    """A fixed robot with a joint that is turned in all directions, whose limits are not symmetric, and one after it."""
    box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    joint = (
        '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><origin xyz="0.3 0.2 0.9" rpy="0.3 -0.2 0.5"/>'
        '<axis xyz="{}"/><limit lower="-0.2" upper="0.7" effort="500" velocity="3"/></joint>'
    )
    x, y, z = axis
    path = folder / "robot.urdf"
    path.write_text(
        '<robot name="r"><link name="world"/><joint name="fix" type="fixed"><parent link="world"/><child link="a"/>'
        f'</joint><link name="a">{box}</link>'
        + "".join(f'<link name="{name}">{box}{inertial}</link>' for name in "bc")
        + joint.format("first", type, "a", "b", f"{x} {y} {z}")
        + joint.format("second", "revolute", "b", "c", f"{z} {x} {y}")
        + "</robot>",
        encoding="utf-8",
    )
    return load_model(path)


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("type", ["revolute", "prismatic"])
def test_a_joint_of_any_axis_moves_its_link_to_either_limit_and_no_farther(
    tmp_path: Path, axis: tuple[float, ...], type: str
) -> None:
    model = made_up_model(tmp_path, axis, type)
    placed = robot_world(model, HERE, name="robot")
    engine = spawned(placed)
    drives_of(model, placed, name="robot").add_to(engine)
    ids, poses = engine.poses()
    rows = {id: row for row, id in enumerate(ids)}
    root = poses[rows[placed.link_ids["a"]]].copy()
    for wanted, reached in (({"first": 0.5, "second": -0.1}, (0.5, -0.1)), ({"first": -2, "second": 2}, (-0.2, 0.7)),
                            ({"first": 2, "second": -2}, (0.7, -0.2))):  # fmt: skip
        engine.set_commands({name: position - placed.zero[name] for name, position in wanted.items()})
        engine.step(3.0)
        states = engine.actuator_states()
        found = {name: states[name].position + placed.zero[name] for name in wanted}
        assert tuple(found.values()) == pytest.approx(reached, abs=0.03)
        local = link_poses(model.joints, found, model.root)
        for link in "bc":
            expected, pose = pose_multiply(root, local[link]), engine.poses()[1][rows[placed.link_ids[link]]]
            np.testing.assert_allclose(pose[:3], expected[:3], atol=2e-3, err_msg=link)
            assert quat_angle(pose[3:], expected[3:]) < 2e-3
    engine.close()


def test_limits_stop_a_joint() -> None:
    model = known_model("mobile_manipulator")
    placed = robot_world(model, Pose(), name="robot")
    engine = spawned(placed)
    drives_of(model, placed, name="robot").add_to(engine)
    engine.set_commands({"shoulder_pan_joint": 3.0, "lift_joint": 2.0})
    engine.step(3.0)
    states = engine.actuator_states()
    assert states["shoulder_pan_joint"].position == pytest.approx(1.9, abs=0.02)
    assert states["lift_joint"].position == pytest.approx(1.0 - placed.zero["lift_joint"], abs=0.005)
    engine.close()


STANDING = ["mobile_manipulator", "stretch", "panda", "pr2", "tiago", "tiago_no_hand", "ur5", "pr2_mjcf", "talos"]


def within_limits(model: RobotModel, positions: dict[str, float]) -> tuple[str, float]:
    """The last joint of the first arm that turns, and a position 0.2 rad from its present one."""
    turning = {joint.name: joint for joint in model.joints if joint.type is not RobotJointType.PRISMATIC}
    joint = turning[next(name for name in reversed(model.arms[0].joints) if name in turning)]
    there = positions[joint.name] + 0.2
    return joint.name, there if joint.upper is None or there < joint.upper else there - 0.4


@each_case("name", STANDING)
def test_a_robot_stands_still_and_moves_a_joint_of_its_arm(name: str) -> None:
    model = known_model(name)
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        robot = add_robot(simulation, model)
        before = robot.joint_positions()
        simulation.step(2.0)
        after = robot.joint_positions()
        for joint in before:
            assert after[joint] == pytest.approx(before[joint], abs=5e-3), joint
        x, y, yaw = robot.base_pose()
        assert max(abs(x), abs(y), abs(yaw)) < 1e-3
        # No contact with the floor or with itself pushes it.
        contacts = simulation.engine.run(lambda engine: engine.contacts(), label="contacts", edits=False)
        assert max((contact.depth_m for contact in contacts), default=0.0) < 2e-3
        joint, position = within_limits(model, after)
        motion = robot.run(robot.moving_to({joint: position}))
        assert motion.outcome is MotionOutcome.SUCCEEDED, motion.reason
        moved = robot.joint_positions()
        assert moved[joint] == pytest.approx(position, abs=0.02)
        for other in model.arms[0].joints:
            if other != joint:
                assert moved[other] == pytest.approx(after[other], abs=0.02), other


def test_a_fixed_robot_is_static_and_a_driving_one_is_on_a_planar_joint() -> None:
    fixed = robot_world(known_model("panda"), Pose(), name="panda")
    assert fixed.base_joint_id is None
    assert fixed.world.body("panda_link0").physics.mobility is Mobility.STATIC
    driving = robot_world(known_model("stretch"), HERE, name="stretch")
    assert driving.base_joint_id == "stretch.base"
    assert driving.world.body("stretch.odom").pose.position == HERE.position
    assert driving.world.body("base_link").physics.mobility is Mobility.DYNAMIC


def test_a_base_is_moved_on_the_floor_only() -> None:
    placed = robot_world(known_model("mobile_manipulator"), HERE, name="robot")
    engine = spawned(placed)
    engine.apply(SetActuators(tuple([
            Actuator(name=axis, joint=placed.base_joint_id or "", axis=axis, effort_limit=2000.0, stiffness=8000.0,
                     damping=2000.0)
            for axis in ("x", "y", "swing1")
        ]), tuple(placed.link_ids.values())))  # fmt: skip
    engine.set_commands({"x": 0.6, "y": -0.2, "swing1": 0.5})
    engine.step(4.0)
    ids, poses = engine.poses()
    base = poses[ids.index(placed.link_ids["base_footprint"])]
    yaw = np.deg2rad(30.0)
    moved = np.array([0.6 * np.cos(yaw) + 0.2 * np.sin(yaw), 0.6 * np.sin(yaw) - 0.2 * np.cos(yaw), 0.0])
    expected = np.array(HERE.position) + moved
    np.testing.assert_allclose(base[:3], expected, atol=2e-3)
    assert quat_angle(base[3:], (np.cos((yaw + 0.5) / 2), 0, 0, np.sin((yaw + 0.5) / 2))) < 2e-3
    engine.close()


@pytest.mark.parametrize("name", ["stretch", "pr2", "tiago", "mobile_manipulator"])
def test_the_base_does_not_touch_the_floor(name: str) -> None:
    placed = robot_world(known_model(name), HERE, name="robot")
    for id, geometry in placed.geometry.items():
        pose = normalized_pose_array(placed.world.body(id).pose)
        for shape in geometry.collision_shapes:
            heights = quat_rotate(pose[3:], shape_points(shape))[:, 2] + pose[2] - HERE.position[2]
            assert heights.min() > 0.0149, id


def test_names_that_are_taken_get_a_prefix() -> None:
    model = known_model("mobile_manipulator")
    free = robot_world(model, Pose(), name="helper")
    assert free.link_ids["base_link"] == "base_link"
    second = robot_world(model, Pose(), name="helper", taken={"lift_joint"})
    assert second.link_ids["base_link"] == "helper.base_link"
    assert second.joint_ids["lift_joint"] == "helper.lift_joint"
    assert second.world.body("helper.base_link").tags[0].value == "helper"


def test_positions_are_given_or_those_of_the_model() -> None:
    model = known_model("mobile_manipulator")
    assert robot_world(model, Pose(), name="a").zero["elbow_joint"] == pytest.approx(3.1416)
    placed = robot_world(model, Pose(), name="a", positions={"elbow_joint": 9.0, "lift_joint": 0.2})
    assert placed.zero["elbow_joint"] == pytest.approx(3.15)
    assert placed.zero["lift_joint"] == pytest.approx(0.2)


def test_the_bundled_arm_rests_within_the_radius_of_the_base() -> None:
    model = known_model("mobile_manipulator")
    placed = robot_world(model, Pose(), name="robot")
    for id, geometry in placed.geometry.items():
        pose = normalized_pose_array(placed.world.body(id).pose)
        for shape in geometry.collision_shapes:
            points = quat_rotate(pose[3:], shape_points(shape)) + pose[:3]
            assert np.linalg.norm(points[:, :2], axis=1).max() <= model.base.radius_m + 0.003, id


def overlaps(name: str, positions: dict[str, float]) -> dict[tuple[str, str], float]:
    """The depths by which pairs of links of a robot overlap, by the names of the links [m]."""
    model = known_model(name)
    solid = [link for link in model.links if link.geometry is not None and link.geometry.collision_shapes]
    poses = link_poses(model.joints, rest_positions(model.joints, positions), model.root)
    rows = np.array([poses[link.name] for link in solid])
    compiled = [compile_geometry(link.geometry.collision_shapes) for link in solid if link.geometry is not None]
    batch = CollisionShapeBatch.from_compiled(rows, compiled)
    first, second = np.triu_indices(len(solid), 1)
    depths = batch.penetration_depths(first, second, np.zeros(len(first)))
    pairs = ((solid[a].name, solid[b].name) for a, b in zip(first.tolist(), second.tolist(), strict=True))
    return {(min(pair), max(pair)): depth for pair, depth in zip(pairs, depths.tolist(), strict=True) if depth > 0.0}


def test_links_of_the_bundled_robot_that_never_collide() -> None:
    """The pairs with the reason "Never" do not overlap in random positions."""
    from xml.etree import ElementTree

    from mindstage.robots.models.catalog import BUNDLED_FOLDER

    root = ElementTree.parse(BUNDLED_FOLDER / "mobile_manipulator.srdf").getroot()
    never = {
        (min(pair), max(pair))
        for each in root.findall("disable_collisions")
        if each.get("reason") == "Never" and (pair := (each.get("link1", ""), each.get("link2", "")))
    }
    assert len(never) >= 8
    model = known_model("mobile_manipulator")
    random = np.random.default_rng(4)
    for _ in range(60):
        positions = {
            joint.name: float(random.uniform(joint.lower, joint.upper))  # type: ignore[arg-type]
            for joint in model.actuated_joints
        }
        assert not never & overlaps("mobile_manipulator", positions).keys(), positions


def test_the_bundled_robot_does_not_touch_itself_at_rest() -> None:
    model = known_model("mobile_manipulator")
    found = overlaps("mobile_manipulator", dict(model.home_positions))
    assert not {pair: depth for pair, depth in found.items() if pair not in model.disabled_collisions}


def test_a_robot_without_a_base_has_no_planar_joint() -> None:
    model = known_model("ur5")
    assert model.base.type is BaseType.FIXED
    placed = robot_world(model, HERE, name="ur5")
    poses = pose_array([placed.world.body("base_link").pose])
    np.testing.assert_allclose(poses[0, :3], HERE.position, atol=1e-9)
