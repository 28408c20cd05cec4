"""A robot in MuJoCo: motions reach their goals within all limits, and stop when they are blocked or canceled."""

from __future__ import annotations

import math
import pickle
import threading
from collections.abc import Generator, Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.bridge.calls import ServerGoalHandle
from mindstage.engines import NullEngine
from mindstage.engines.base import Capability, Contact
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import CommandRefusedError, RobotModelError, RobotNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.robots import add_robot, find_robot
from mindstage.robots.control import PERIOD_S, JointGoal, MotionFailure, MotionOutcome, held_bodies
from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import BaseType, RobotModel
from mindstage.robots.robot import Robot
from mindstage.robots.trajectories import JointTrajectory, TrajectoryPoint
from mindstage.ros.robot_controllers import await_motion
from mindstage.ros.service import GoalCanceledError, GoalContext
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose, Vector, World
from mindstage.scene.edits import SetPoses
from mindstage.scene.transforms import pose_inverse, pose_multiply
from mindstage.simulation import Simulation

AHEAD = {"shoulder_pitch_joint": 2.5, "elbow_joint": 1.6, "wrist_pitch_joint": 0.67}
"""The hand is in front of the robot, and points forward."""


@pytest.fixture(scope="module")
def model() -> RobotModel:
    return load_model("mobile_manipulator")


@pytest.fixture
def sim() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, threaded=False) as sim:
        yield sim


@pytest.fixture
def robot(sim: Simulation, model: RobotModel) -> Robot:
    return add_robot(sim, model)


def box(id: str, position: Vector, size: Vector, *, mass_kg: float | None = None) -> World:
    mobility = Mobility.STATIC if mass_kg is None else Mobility.DYNAMIC
    iri = Iri(f"http://example.org/test#{id}")
    physics = BodyPhysics(mobility=mobility, mass_kg=mass_kg)
    body = Body(id=BodyId(id), iri=iri, cls=Iri(f"{iri}Class"), pose=Pose(position), size=size, physics=physics)
    return World(iri=Iri("http://example.org/test"), bodies=(body,))


def wrapped(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


# -- state -------------------------------------------------------------------------------------------------------------


def test_joint_positions_are_those_of_mujoco(sim: Simulation, robot: Robot) -> None:
    robot.run(robot.moving_to({"lift_joint": 0.7, "elbow_joint": 2.0}))

    def read(engine: MujocoEngine) -> dict[str, float]:
        data = engine.compiled().data
        names = ("lift_joint", "elbow_joint", "shoulder_pan_joint")
        return {name: float(data.joint(f"joint:{name}:0").qpos[0]) for name in names}

    for joint, position in sim.engine.run(read).items():
        assert robot.joint_positions()[joint] == pytest.approx(position + robot.placed.zero[joint], abs=1e-9)


def test_a_robot_stands_still_without_commands(sim: Simulation, robot: Robot) -> None:
    before, pose = robot.joint_positions(), robot.base_pose()
    sim.step(3.0)
    assert robot.joint_positions() == pytest.approx(before, abs=1e-3)
    assert robot.base_pose() == pytest.approx(pose, abs=1e-3)


def test_link_poses_follow_the_joints(robot: Robot) -> None:
    before = robot.link_pose("lift_link")
    robot.run(robot.moving_to({"lift_joint": robot.joint_positions()["lift_joint"] + 0.2}))
    assert (robot.link_pose("lift_link") - before)[:3].tolist() == pytest.approx([0.0, 0.0, 0.2], abs=0.002)
    grasp = pose_multiply(pose_inverse(robot.link_pose("gripper_link")), robot.grasp_pose())
    assert grasp[:3].tolist() == pytest.approx(robot.gripper().grasp_pose.position, abs=1e-9)


# -- trajectories ------------------------------------------------------------------------------------------------------


def test_a_trajectory_is_followed_and_reached(sim: Simulation, robot: Robot) -> None:
    trajectory = robot.trajectory_to(AHEAD | {"lift_joint": 0.8, "shoulder_pan_joint": -1.0})
    goal = robot.start_trajectory(trajectory)
    worst = 0.0
    while goal.status is MotionOutcome.ACTIVE:
        sim.step(0.02)
        worst = max(worst, *(abs(error) for error in goal.errors().values()))
    assert goal.result
    assert goal.result.outcome is MotionOutcome.SUCCEEDED
    assert worst < 0.02
    assert goal.elapsed_s == pytest.approx(trajectory.duration_s, abs=0.3)
    positions = robot.joint_positions()
    assert positions["lift_joint"] == pytest.approx(0.8, abs=0.002)
    assert positions["shoulder_pan_joint"] == pytest.approx(-1.0, abs=0.005)
    sim.step(2.0)
    assert robot.joint_positions() == pytest.approx(positions, abs=0.005)


@pytest.mark.parametrize("seed", range(3))
def test_no_limit_is_exceeded_on_the_way(sim: Simulation, robot: Robot, seed: int) -> None:
    random = np.random.default_rng(seed)
    drives = robot.controller.drives.joints
    joints = [each for name, each in drives.items() if name not in robot.gripper().joints]
    ends = {}
    for drive in joints:
        assert drive.joint.lower is not None
        assert drive.joint.upper is not None
        ends[drive.name] = random.choice([drive.joint.lower, drive.joint.upper, random.uniform(-0.3, 0.3)])
        ends[drive.name] = float(np.clip(ends[drive.name], drive.joint.lower, drive.joint.upper))
    ends |= {"shoulder_pitch_joint": 2.2, "elbow_joint": 1.3}  # away from the robot itself
    ends |= {"shoulder_pan_joint": float(random.uniform(-1.0, 1.0)), "lift_joint": float(random.choice([0.4, 1.0]))}
    goal = robot.start_trajectory(robot.trajectory_to(ends, speed=1.0))
    while goal.status is MotionOutcome.ACTIVE:
        sim.step(0.01)
        for name, state in robot.joint_states().items():
            if name in ends:
                joint = drives[name].joint
                assert joint.lower - 2e-3 <= state.position <= joint.upper + 2e-3, name
                assert abs(state.velocity) <= joint.velocity * 1.03, name
                assert abs(state.effort) <= joint.effort * 1.001, name
    assert goal.result, goal.result


def test_a_refused_trajectory_moves_nothing(sim: Simulation, robot: Robot) -> None:
    before = robot.joint_positions()
    too_far = JointTrajectory(("lift_joint",), (TrajectoryPoint(positions=(1.5,), time_s=10.0),))
    with pytest.raises(CommandRefusedError, match=r"lift_joint = 1.5 m: its upper limit is 1 m"):
        robot.start_trajectory(too_far)
    with pytest.raises(CommandRefusedError, match="'wheel'"):
        robot.trajectory_to({"wheel": 1.0})
    sim.step(0.5)
    assert robot.joint_positions() == pytest.approx(before, abs=1e-3)
    assert not robot.controller.is_active


def test_a_canceled_trajectory_stops_within_a_fifth_of_a_second_and_holds(sim: Simulation, robot: Robot) -> None:
    goal = robot.start_trajectory(robot.trajectory_to({"shoulder_pan_joint": 1.8}, speed=1.0))
    sim.step(0.7)
    assert robot.joint_velocities()["shoulder_pan_joint"] > 1.5
    goal.cancel()
    largest = 0.0
    for _ in range(20):
        sim.step(0.01)
        largest = max(largest, abs(robot.joint_efforts()["shoulder_pan_joint"]))
    assert goal.status is MotionOutcome.CANCELED
    assert largest < 45.0  # it brakes, and is not stopped with the largest moment, 120 Nm
    stopped = robot.joint_positions()["shoulder_pan_joint"]
    assert abs(robot.joint_velocities()["shoulder_pan_joint"]) < 0.05
    sim.step(1.0)
    assert robot.joint_positions()["shoulder_pan_joint"] == pytest.approx(stopped, abs=0.01)
    assert stopped < 1.6


def test_a_goal_over_ros_stops_as_quickly_if_its_thread_never_wakes_up(sim: Simulation, robot: Robot) -> None:
    motion = robot.start_trajectory(robot.trajectory_to({"shoulder_pan_joint": 1.8}, speed=1.0))
    handle = ServerGoalHandle("follow_joint_trajectory", "1", {}, lambda goal_id, values: None)
    reached, release = threading.Event(), threading.Event()

    def wait_for_cancel(timeout_s: float) -> bool:
        """The thread of a handler that is not scheduled any more."""
        reached.set()
        return release.wait(20.0)

    context = GoalContext(
        "follow_joint_trajectory",
        timeout_s=60.0,
        is_cancelled=lambda: handle.cancel_requested,
        send_feedback=lambda message: None,
        wait_for_cancel=wait_for_cancel,
        on_cancel=handle.on_cancel,
    )
    ended: list[BaseException] = []

    def handler() -> None:
        try:
            await_motion(motion, context, lambda: None)
        except GoalCanceledError as error:
            ended.append(error)

    thread = threading.Thread(target=handler, daemon=True)
    thread.start()
    assert reached.wait(20.0)
    sim.step(0.7)
    assert robot.joint_velocities()["shoulder_pan_joint"] > 1.5
    handle.request_cancel()
    sim.step(0.2)
    assert motion.status is MotionOutcome.CANCELED
    assert motion.result is not None
    assert motion.result.duration_s <= 0.7 + 2 * PERIOD_S  # it ended in the next period
    assert abs(robot.joint_velocities()["shoulder_pan_joint"]) < 0.05
    release.set()
    thread.join(20.0)
    assert len(ended) == 1


def test_what_is_halted_stops_where_it_is(sim: Simulation, robot: Robot) -> None:
    goal = robot.start_trajectory(robot.trajectory_to({"shoulder_pan_joint": 1.8}, speed=1.0))
    sim.step(0.7)
    at = robot.joint_positions()["shoulder_pan_joint"]
    robot.halt()
    sim.step(0.1)
    halted = robot.joint_positions()["shoulder_pan_joint"] - at
    assert goal.status is MotionOutcome.CANCELED
    robot.stop()
    sim.reset()
    goal = robot.start_trajectory(robot.trajectory_to({"shoulder_pan_joint": 1.8}, speed=1.0))
    sim.step(0.7)
    at = robot.joint_positions()["shoulder_pan_joint"]
    goal.cancel()
    sim.step(0.1)
    assert halted < 0.8 * (robot.joint_positions()["shoulder_pan_joint"] - at)


def test_closing_a_motion_stops_the_robot(sim: Simulation, robot: Robot) -> None:
    motion = robot.moving_to({"shoulder_pan_joint": 1.8})
    for _ in range(30):
        sim.step(next(motion))
    motion.close()
    sim.step(0.3)
    at = robot.joint_positions()["shoulder_pan_joint"]
    sim.step(1.0)
    assert 0.05 < at < 1.7
    assert robot.joint_positions()["shoulder_pan_joint"] == pytest.approx(at, abs=0.005)


def test_a_newer_goal_replaces_an_older_one_of_the_same_joints_only(sim: Simulation, robot: Robot) -> None:
    head = robot.point_head(pan=1.5)
    pan = robot.start_trajectory(robot.trajectory_to({"shoulder_pan_joint": 1.8}, speed=0.3))
    sim.step(0.4)
    back = robot.start_trajectory(robot.trajectory_to({"shoulder_pan_joint": -0.5}))
    assert pan.status is MotionOutcome.CANCELED
    assert pan.result is not None
    assert pan.result.failure is MotionFailure.REPLACED
    assert robot.run(robot.waiting(back))
    assert robot.run(robot.waiting(head))
    assert robot.joint_positions()["shoulder_pan_joint"] == pytest.approx(-0.5, abs=0.01)
    assert robot.joint_positions()["head_pan_joint"] == pytest.approx(1.5, abs=0.01)


def test_joints_that_a_newer_goal_does_not_use_stop(sim: Simulation, robot: Robot) -> None:
    both = robot.start_trajectory(robot.trajectory_to({"shoulder_pan_joint": 1.8, "head_pan_joint": 2.0}, speed=1.0))
    sim.step(0.6)
    robot.point_head(pan=0.0)
    assert both.status is MotionOutcome.CANCELED
    sim.step(0.25)
    at = robot.joint_positions()["shoulder_pan_joint"]
    sim.step(1.0)
    assert robot.joint_positions()["shoulder_pan_joint"] == pytest.approx(at, abs=0.005)
    assert robot.joint_positions()["head_pan_joint"] == pytest.approx(0.0, abs=0.01)


def test_an_arm_that_is_blocked_stops_and_names_the_obstacle(sim: Simulation, robot: Robot) -> None:
    robot.run(robot.moving_to(AHEAD))
    x, _, z = robot.grasp_pose()[:3].tolist()
    sim.spawn(box("pillar", (x, 0.4, z), (0.3, 0.1, 0.4)), ground=False)
    result = robot.run(robot.moving_to({"shoulder_pan_joint": 1.5}, speed=0.2))
    assert not result
    assert result.outcome is MotionOutcome.FAILED
    assert result.failure is MotionFailure.BLOCKED
    assert "pillar" in result.obstacles
    assert "'pillar'" in result.reason
    assert "does not move at its largest effort" in result.reason
    sim.step(0.5)
    assert max(abs(effort) for effort in robot.joint_efforts().values()) < 40.0  # it does not go on pushing
    assert deepest_contact(sim) < 0.005


def test_the_motion_after_a_halt_starts_where_the_joint_is(sim: Simulation, robot: Robot) -> None:
    """It was held back, so that it is far from where it should have been; that it is to yield there is not awaited."""
    robot.run(robot.moving_to(AHEAD))
    x, _, z = robot.grasp_pose()[:3].tolist()
    sim.spawn(box("pillar", (x, 0.4, z), (0.3, 0.1, 0.4)), ground=False)
    goal = robot.start_trajectory(robot.trajectory_to({"shoulder_pan_joint": 1.5}, speed=0.4))
    assert isinstance(goal, JointGoal)
    while goal.status is not MotionOutcome.FAILED:
        desired, at = goal.desired("shoulder_pan_joint"), robot.joint_positions()["shoulder_pan_joint"]
        if desired is not None and desired[0] - at > 0.12:
            break
        sim.step(0.004)
    robot.halt()
    points = [TrajectoryPoint(positions=(at - 0.2 * t,), velocities=(0.0,), time_s=t) for t in (0.0, 1.0)]
    goal = robot.start_trajectory(JointTrajectory(("shoulder_pan_joint",), tuple(points)))
    sim.step(1.5)
    assert goal.status is MotionOutcome.SUCCEEDED


def deepest_contact(sim: Simulation) -> float:
    return max((contact.depth_m for contact in sim.engine.run(lambda engine: engine.contacts())), default=0.0)


# -- base --------------------------------------------------------------------------------------------------------------


def test_a_path_is_driven_to_its_end_within_the_speed_limits(sim: Simulation, robot: Robot) -> None:
    goal = robot.start_driving([(1.0, 0.0, 0.0), (1.0, 1.0, math.pi / 2), (0.0, 1.0, math.pi)])
    fastest = 0.0
    while goal.result is None:
        sim.step(0.02)
        odometry = robot.odometry()
        fastest = max(fastest, math.hypot(odometry.vx, odometry.vy))
        assert abs(odometry.wz) <= robot.model.base.turn_velocity * 1.03
    assert goal.result, goal.result
    x, y, yaw = robot.base_pose()
    assert (x, y) == pytest.approx((0.0, 1.0), abs=0.012)
    assert wrapped(yaw - math.pi) == pytest.approx(0.0, abs=0.02)
    assert 0.6 < fastest <= robot.model.base.velocity * 1.03


def test_the_base_is_slow_at_a_corner_and_does_not_overshoot_it(sim: Simulation, robot: Robot) -> None:
    goal = robot.start_driving([(0.2, 0.0, 0.0), (0.2, 0.2, 0.0)])
    farthest, fastest = 0.0, 0.0
    while goal.result is None:
        sim.step(0.01)
        odometry = robot.odometry()
        farthest = max(farthest, robot.base_pose()[0])
        fastest = max(fastest, math.hypot(odometry.vx, odometry.vy))
    assert goal.result, goal.result
    assert farthest < 0.21
    assert fastest > 0.3


def test_odometry_is_exact_and_starts_where_the_robot_was_added(sim: Simulation, model: RobotModel) -> None:
    yaw = 0.8
    robot = add_robot(sim, model, Pose((2.0, -1.0, 0.0), (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))))
    assert robot.odometry().x == pytest.approx(0.0, abs=1e-6)
    robot.run(robot.driving([(2.5, -0.4, 2.0)]))
    odometry, (x, y, now) = robot.odometry(), robot.base_pose()
    assert 2.0 + math.cos(yaw) * odometry.x - math.sin(yaw) * odometry.y == pytest.approx(x, abs=1e-6)
    assert -1.0 + math.sin(yaw) * odometry.x + math.cos(yaw) * odometry.y == pytest.approx(y, abs=1e-6)
    assert wrapped(odometry.yaw + yaw - now) == pytest.approx(0.0, abs=1e-6)


def test_velocities_are_integrated_in_the_frame_of_the_base(sim: Simulation, robot: Robot) -> None:
    for _ in range(60):
        robot.drive(0.3, 0.0, 0.5)
        sim.step(0.05)
    odometry = robot.odometry()
    assert (odometry.vx, odometry.vy, odometry.wz) == pytest.approx((0.3, 0.0, 0.5), abs=0.02)
    # On a circle of radius 0.6 m that starts at the origin, toward x; the ramps shorten the time.
    x, y, yaw = robot.base_pose()
    assert math.hypot(x, y - 0.6) == pytest.approx(0.6, abs=0.05)
    assert 1.2 < yaw < 1.5


def test_the_base_stops_when_no_velocity_is_commanded_any_more(sim: Simulation, robot: Robot) -> None:
    goal = robot.drive(0.5)
    sim.step(0.45)
    assert goal.status is MotionOutcome.ACTIVE
    sim.step(1.5)
    assert goal.status is MotionOutcome.CANCELED
    assert goal.result is not None
    assert goal.result.failure is MotionFailure.TIMEOUT
    at = robot.base_pose()
    sim.step(1.0)
    assert robot.base_pose() == pytest.approx(at, abs=1e-3)


@pytest.mark.parametrize(
    ("velocity", "words"),
    [((2.0, 0.0, 0.0), "2 m/s"), ((0.6, 0.6, 0.0), "0.8485 m/s"), ((0.0, 0.0, 4.0), "4 rad/s")],
)
def test_a_velocity_beyond_the_limits_is_refused(robot: Robot, velocity, words: str) -> None:
    with pytest.raises(CommandRefusedError, match=words):
        robot.drive(*velocity)


def test_a_robot_that_drives_into_a_wall_stops_and_says_so(sim: Simulation, robot: Robot) -> None:
    sim.spawn(box("wall", (1.5, 0.0, 0.5), (0.1, 3.0, 1.0)), ground=False)
    result = robot.run(robot.driving([(3.0, 0.0, 0.0)]))
    assert result.outcome is MotionOutcome.FAILED
    assert result.failure is MotionFailure.BLOCKED
    assert result.reason == "blocked by 'wall'"
    assert result.obstacles == ("wall",)
    assert 0.9 < robot.base_pose()[0] < 1.3
    sim.step(0.5)
    assert deepest_contact(sim) < 0.002
    for _ in range(20):
        goal = robot.drive(0.5)
        sim.step(0.05)
        if goal.result is not None:
            break
    assert goal.result is not None
    assert goal.result.obstacles == ("wall",)
    assert robot.run(robot.driving([(0.5, 0.0, 0.0)]))  # away from it


def test_a_differential_base_never_moves_sideways(sim: Simulation, model: RobotModel) -> None:
    base = replace(model.base, type=BaseType.DIFFERENTIAL)
    robot = add_robot(sim, replace(model, base=base), name="differential")
    with pytest.raises(CommandRefusedError, match="sideways"):
        robot.drive(0.1, 0.1)
    for _ in range(20):
        robot.drive(0.3, 0.0, 0.8)
        sim.step(0.05)
        assert abs(robot.odometry().vy) < 0.02
    robot.run(robot.driving([(0.0, 0.0, 0.0)]))
    goal = robot.start_driving([(0.8, 0.6, 1.5), (0.0, 1.0, 0.0)])
    while goal.result is None:
        sim.step(0.02)
        assert abs(robot.odometry().vy) < 0.03
    assert goal.result, goal.result
    assert robot.base_pose() == pytest.approx((0.0, 1.0, 0.0), abs=0.02)
    goal = robot.start_driving([(-0.5, 1.0, 0.0)])  # behind it: backward, without turning
    while goal.result is None:
        sim.step(0.02)
        assert abs(robot.odometry().wz) < 0.05
    assert robot.base_pose() == pytest.approx((-0.5, 1.0, 0.0), abs=0.02)


def test_a_dense_path_is_driven_without_stops_by_a_differential_base(sim: Simulation, model: RobotModel) -> None:
    base = replace(model.base, type=BaseType.DIFFERENTIAL)
    robot = add_robot(sim, replace(model, base=base), name="differential")
    angles = np.linspace(0.05, math.pi / 2, 30)
    arc = [(math.sin(angle), 1.0 - math.cos(angle), float(angle)) for angle in angles]
    goal = robot.start_driving(arc)
    speeds = []
    while goal.result is None:
        sim.step(0.05)
        speeds.append(robot.odometry().vx)
        assert abs(robot.odometry().vy) < 0.05
    assert goal.result, goal.result
    assert goal.elapsed_s < 4.5
    assert min(speeds[10:-16]) > 0.3


def test_a_base_is_put_elsewhere_at_once(sim: Simulation, robot: Robot) -> None:
    goal = robot.drive(0.5)
    sim.step(0.2)
    robot.set_base_pose(-1.0, 2.0, 1.0)
    assert goal.status is MotionOutcome.CANCELED
    sim.step(0.5)
    assert robot.base_pose() == pytest.approx((-1.0, 2.0, 1.0), abs=1e-3)


# -- gripper -----------------------------------------------------------------------------------------------------------


def give(sim: Simulation, robot: Robot, *, mass_kg: float = 0.5) -> Vector:
    """Puts a box on a pillar between the open fingers."""
    robot.run(robot.moving_to(AHEAD | {"lift_joint": 0.5}))
    assert robot.run(robot.gripping("", 0.12))
    x, y, z = robot.grasp_pose()[:3].tolist()
    sim.spawn(box("carton", (x, y, z), (0.07, 0.07, 0.2), mass_kg=mass_kg), ground=False)
    sim.spawn(box("pillar", (x, y, z - 0.35), (0.1, 0.1, 0.5)), ground=False)
    sim.step(0.2)
    return x, y, z


def carton(sim: Simulation) -> np.ndarray:
    return sim.state.poses[sim.state.ids.index(BodyId("carton"))]


def test_a_gripper_opens_and_closes_to_an_opening(sim: Simulation, robot: Robot) -> None:
    for opening_m in (0.1, 0.03, 0.0):
        result = robot.run(robot.gripping("", opening_m))
        assert result.outcome is MotionOutcome.SUCCEEDED
        assert not result.stalled
        assert robot.opening() == pytest.approx(opening_m, abs=0.002)
    assert not robot.held
    with pytest.raises(CommandRefusedError, match="opens from 0 to"):
        robot.start_gripping("", 0.5)
    with pytest.raises(CommandRefusedError, match="force"):
        robot.start_gripping("", 0.0, max_force_n=5000.0)
    with pytest.raises(CommandRefusedError, match="left_hand"):
        robot.start_gripping("left_hand", 0.0)


def test_a_carton_is_gripped_lifted_and_released(sim: Simulation, robot: Robot) -> None:
    _, _, z = give(sim, robot)
    result = robot.run(robot.gripping("", 0.0))
    assert result.outcome is MotionOutcome.SUCCEEDED
    assert result.stalled
    assert "'carton'" in result.reason
    assert dict(robot.held) == {"gripper": "carton"}
    assert robot.opening() == pytest.approx(0.07, abs=0.004)
    assert robot.run(robot.moving_to({"lift_joint": 0.8}))
    assert carton(sim)[2] == pytest.approx(z + 0.3, abs=0.01)
    sim.step(2.0)
    assert carton(sim)[2] == pytest.approx(z + 0.3, abs=0.02)
    assert dict(robot.held) == {"gripper": "carton"}
    assert robot.run(robot.gripping("", 0.12))
    sim.step(0.5)
    assert not robot.held
    assert carton(sim)[2] < z + 0.15


def test_the_force_of_the_fingers_is_that_of_the_command(sim: Simulation, robot: Robot) -> None:
    give(sim, robot)
    for force_n in (10.0, 25.0):
        robot.run(robot.gripping("", 0.12))
        assert robot.run(robot.gripping("", 0.0, max_force_n=force_n))
        sim.step(0.3)
        contacts = sim.engine.run(lambda engine: engine.contacts())
        forces = [
            each.force_n for each in contacts if "carton" in (each.a, each.b) and "pillar" not in (each.a, each.b)
        ]
        assert len(forces) == 2
        assert sum(forces) / 2 == pytest.approx(force_n, rel=0.1)


def test_fingers_are_not_faster_than_their_limit_when_what_they_press_slips_out(sim: Simulation, robot: Robot) -> None:
    """The drive is a spring that is bent as far as its largest force when it presses."""
    give(sim, robot)
    assert robot.run(robot.gripping("", 0.0)).stalled
    sim.engine.run(lambda engine: engine.apply(SetPoses({BodyId("carton"): Pose((3.0, 3.0, 0.1))})), edits=True)
    speeds = []
    for _ in range(50):
        sim.step(0.002)
        speeds.append(abs(robot.joint_velocities()["left_finger_joint"]))
    limit = robot.drives["left_finger_joint"].joint.velocity
    assert limit is not None
    assert 0.3 * limit < max(speeds) <= limit  # they do close farther


def test_fingers_whose_description_states_a_huge_effort_are_as_fast_as_others(
    sim: Simulation, model: RobotModel
) -> None:
    """That of PR2 states 1000 N m; its fingers took 43 s."""
    name = model.grippers[0].joints[0]
    joints = tuple(replace(each, effort=60_000.0) if each.name == name else each for each in model.joints)
    robot = add_robot(sim, replace(model, joints=joints))
    for opening_m in (0.12, 0.0):
        start_s = sim.state.time_s
        assert robot.run(robot.gripping("", opening_m))
        assert sim.state.time_s - start_s < 3.0
        assert robot.opening() == pytest.approx(opening_m, abs=0.002)


# -- the simulation ----------------------------------------------------------------------------------------------------


def test_robots_are_found_by_name(sim: Simulation, model: RobotModel) -> None:
    with pytest.raises(RobotNotFoundError, match="add_robot"):
        find_robot(sim)
    first = add_robot(sim, model)
    assert find_robot(sim) is first
    second = add_robot(sim, model, Pose((0.0, 2.0, 0.0)))
    assert list(sim.robots) == ["mobile_manipulator", "mobile_manipulator_2"]
    with pytest.raises(RobotNotFoundError, match="mobile_manipulator_2"):
        find_robot(sim)
    with pytest.raises(RobotModelError, match="exists"):
        add_robot(sim, model, name=first.name)
    assert second.run(second.driving([(0.5, 2.0, 0.0)]))
    assert first.base_pose() == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    find_robot(sim, first.name).remove()
    assert find_robot(sim) is second
    assert second.run(second.moving_to({"lift_joint": 0.6}))


def test_a_copy_continues_the_motion_and_the_original_does_not_notice(sim: Simulation, robot: Robot) -> None:
    goal = robot.start_trajectory(robot.trajectory_to({"lift_joint": 0.9}))
    sim.step(0.5)
    before = robot.joint_positions()
    with sim.fork(threaded=False) as copy:
        twin = find_robot(copy)
        copy.step(3.0)
        assert twin.joint_positions()["lift_joint"] == pytest.approx(0.9, abs=0.003)
        assert twin.run(twin.driving([(0.5, 0.0, 0.0)]))
    assert robot.joint_positions() == before
    assert goal.status is MotionOutcome.ACTIVE
    assert robot.run(robot.waiting(goal))
    assert robot.base_pose()[0] == pytest.approx(0.0, abs=1e-3)


def test_a_copy_in_another_process_has_the_robot(sim: Simulation, robot: Robot) -> None:
    robot.run(robot.moving_to({"lift_joint": 0.6}))
    with sim.fork(threaded=False) as copy:
        sent = pickle.loads(pickle.dumps(copy))
        twin = find_robot(sent)
        assert twin.session is sent
        assert twin.joint_positions() == pytest.approx(robot.joint_positions())
        assert twin.run(twin.moving_to({"lift_joint": 0.3}))
    assert robot.joint_positions()["lift_joint"] == pytest.approx(0.6, abs=0.003)


def test_reset_puts_the_robot_back_and_ends_its_motions(sim: Simulation, robot: Robot) -> None:
    start = robot.joint_positions()
    robot.run(robot.driving([(0.6, 0.0, 0.5)]))
    goal = robot.start_trajectory(robot.trajectory_to({"lift_joint": 0.9}))
    sim.step(0.3)
    sim.reset()
    assert goal.status is MotionOutcome.CANCELED
    assert robot.base_pose() == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    sim.step(1.0)
    assert robot.joint_positions() == pytest.approx(start, abs=1e-3)
    assert robot.run(robot.driving([(0.3, 0.0, 0.0)]))


def test_a_restored_state_ends_the_motions_that_were_started_later(sim: Simulation, robot: Robot) -> None:
    sim.step(0.1)
    saved = sim.engine.run(lambda engine: engine.save_state())
    goal = robot.start_trajectory(robot.trajectory_to({"lift_joint": 0.9}))
    sim.step(1.0)
    sim.engine.run(lambda engine: engine.restore_state(saved))
    before = robot.joint_positions()
    sim.step(1.0)
    assert goal.status is MotionOutcome.CANCELED
    assert robot.joint_positions() == pytest.approx(before, abs=1e-3)
    assert robot.run(robot.moving_to({"lift_joint": 0.5}))


def test_a_robot_whose_parts_were_deleted_is_gone_until_that_is_undone(sim: Simulation, robot: Robot) -> None:
    goal = robot.start_trajectory(robot.trajectory_to({"head_pan_joint": 1.0}))
    sim.step(0.1)
    sim.edits.delete([robot.link_ids["lift_link"]])
    sim.step(0.1)
    assert not sim.robots
    assert goal.status is MotionOutcome.CANCELED
    with pytest.raises(CommandRefusedError, match="deleted"):
        robot.drive(0.1)
    sim.edits.undo()
    sim.step(0.1)
    assert find_robot(sim) is robot
    assert robot.run(robot.moving_to({"lift_joint": 0.6}))


def test_robots_are_not_part_of_a_saved_map_unless_they_are_asked_for(
    sim: Simulation, robot: Robot, tmp_path: Path
) -> None:
    sim.spawn(box("crate", (2.0, 0.0, 0.2), (0.4, 0.4, 0.4)))
    sim.save(tmp_path / "without.owl")
    sim.save(tmp_path / "with.owl", robots=True)
    without, with_robot = ((tmp_path / name).read_text() for name in ("without.owl", "with.owl"))
    assert "crate" in without
    assert "lift_link" not in without
    assert "lift_link" in with_robot


def test_a_robot_moves_while_the_simulation_plays(model: RobotModel) -> None:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as sim:
        robot = add_robot(sim, model)
        sim.play(speed=4.0)
        assert robot.run(robot.moving_to({"lift_joint": 0.7}))
        assert sim.state.playing


def test_an_engine_without_actuators_has_the_robot_but_refuses_its_motions(model: RobotModel) -> None:
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True) as sim:
        robot = add_robot(sim, model, Pose((1.0, 2.0, 0.0)))
        assert robot.base_pose() == pytest.approx((1.0, 2.0, 0.0))
        assert robot.joint_positions().keys() == robot.joint_ids.keys()
        with pytest.raises(CommandRefusedError, match="no actuators"):
            robot.drive(0.1)
        with sim.fork(physics=True) as copy:
            twin = find_robot(copy)
            assert twin.run(twin.moving_to({"lift_joint": 0.6}))


@pytest.mark.parametrize("other", [None, "own link"])
def test_fingers_on_the_ground_or_on_the_robot_itself_hold_nothing(robot: Robot, other: str | None) -> None:
    drives = robot.controller.drives
    ((name, fingers),) = drives.finger_bodies.items()
    wheel = next(id for id in drives.link_of_body if id not in drives.gripper_bodies)
    touched = wheel if other else None

    class TouchingEngine(NullEngine):
        capabilities = frozenset({Capability.CONTACTS})
        of: BodyId | None = touched

        def contacts(self) -> tuple[Contact, ...]:
            return tuple(
                Contact(a=next(iter(each)), b=self.of, position=(0, 0, 0), normal=(0, 0, 1), force_n=9.0, depth_m=0.001)
                for each in fingers
            )

    engine = TouchingEngine()
    assert held_bodies(engine, drives) == {}
    engine.of = BodyId("cup")
    assert held_bodies(engine, drives) == {name: BodyId("cup")}


def test_a_motion_that_does_not_end_is_closed_after_its_time(sim: Simulation, robot: Robot) -> None:
    start_s, closed_s = sim.state.time_s, list[float]()

    def endless() -> Generator[float, None, None]:
        try:
            while sim.state.time_s < start_s + 2.0:
                yield 0.05
        finally:
            closed_s.append(sim.state.time_s)

    with pytest.raises(TimeoutError, match=r"did not end within 0\.5 s"):
        robot.run(endless(), timeout_s=0.5)
    assert closed_s == [pytest.approx(start_s + 0.5, abs=0.051)]


def test_a_robot_gets_a_name_that_no_body_begins_with(sim: Simulation, model: RobotModel) -> None:
    sim.spawn(box(f"{model.name}.old.part", (2.0, 0.0, 0.5), (0.1, 0.1, 0.1)))
    assert add_robot(sim, model).name == f"{model.name}_2"
    assert add_robot(sim, model, Pose((0.0, 3.0, 0.0))).name == f"{model.name}_3"
