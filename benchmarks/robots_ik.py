"""Inverse kinematics of robots, compared with mink alone on the same model; and motion planning in the kitchen."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from math import degrees
from statistics import median
from typing import Any, NamedTuple

import mink
import numpy as np

from benchmarks import Measure
from benchmarks.mujoco import copies_of, kitchen_world
from mindstage.engines.mujoco import MujocoEngine
from mindstage.engines.mujoco.mujoco_kinematics import FRAME_SITE
from mindstage.errors import RobotNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.robots import add_robot
from mindstage.robots.collisions import CollisionChecker
from mindstage.robots.models.reading import load_model
from mindstage.robots.navigation import plan_base
from mindstage.robots.planning import plan_arm
from mindstage.robots.robot_kinematics import IkResult, RobotKinematics
from mindstage.scene import Pose
from mindstage.scene.transforms import Array
from mindstage.simulation import Simulation

TARGETS = 100
ROUNDS = 5
ROBOTS = ("mobile_manipulator", "panda", "stretch", "pr2")
TOLERANCE_M, TOLERANCE_RAD = 0.001, np.radians(0.5)
MINK_ITERATIONS = 60


def measure() -> Iterator[Measure]:
    for name in ROBOTS:
        try:
            yield from _inverse_kinematics(name)
        except RobotNotFoundError as error:
            yield Measure(what=f"{name}: {error.remedy}", ours=0.0, unit="")
    yield from _planning()


class _Arm(NamedTuple):
    kinematics: RobotKinematics
    frame: str
    joints: tuple[str, ...]
    home: Mapping[str, float]
    targets: list[Array]


def _arm(name: str) -> _Arm:
    """An arm, and poses of its gripper in random positions of its joints."""
    model = load_model(name)
    kinematics, arm = RobotKinematics(model), model.arms[0]
    frame, home = kinematics.frame_of(arm), dict(model.home_positions)
    limits = np.array([kinematics.limits(joint) for joint in arm.joints])
    limits = np.where(np.isfinite(limits), limits, [-np.pi, np.pi])
    rows = np.random.default_rng(0).uniform(limits[:, 0], limits[:, 1], (TARGETS, len(limits)))
    targets = [kinematics.pose(frame, {**home, **dict(zip(arm.joints, row, strict=True))}) for row in rows.tolist()]
    return _Arm(kinematics, frame, arm.joints, home, targets)


def _inverse_kinematics(name: str) -> Iterator[Measure]:
    arm = _arm(name)
    peer = f"mink {version('mink')}, daqp"
    ours, theirs = [], []
    for _ in range(ROUNDS):  # in turns, since other programs run, too
        ours.append(_timed(lambda: _solve(arm)))
        theirs.append(_timed(lambda: _solve_with_mink(arm)))
    results: list[IkResult] = ours[0][1]
    alone: list[tuple[int, bool]] = theirs[0][1]
    iterations, mink_iterations = sum(each.iterations for each in results), sum(count for count, _ in alone)
    yield Measure(
        what=f"{name}: an iteration",
        ours=median(t for t, _ in ours) / iterations,
        peer=peer,
        theirs=median(t for t, _ in theirs) / mink_iterations,
        at_most=1.2,
    )
    yield Measure(
        what=f"{name}: a target, several attempts of ours",
        ours=median(t for t, _ in ours) / TARGETS,
        peer=f"{peer}, one attempt",
        theirs=median(t for t, _ in theirs) / TARGETS,
    )
    reached = [each for each in results if each]
    found = sum(is_reached for _, is_reached in alone)
    what = f"{name}: targets reached (mink alone: {100 * found / TARGETS:.0f} %)"
    yield Measure(what=what, ours=100 * len(reached) / TARGETS, unit="%", at_least=98.0)
    worst_m, worst_rad = (max(getattr(each, key) for each in reached) for key in _ERRORS)
    yield Measure(what=f"{name}: largest error of position", ours=1000 * worst_m, unit="mm", at_most=1.0)
    yield Measure(what=f"{name}: largest error of rotation", ours=degrees(worst_rad), unit="degrees", at_most=0.5)


_ERRORS = ("position_error_m", "rotation_error_rad")


def _timed(function: Callable[[], Any]) -> tuple[float, Any]:
    start = time.perf_counter()
    result = function()
    return time.perf_counter() - start, result


def _solve(arm: _Arm) -> list[IkResult]:
    return [arm.kinematics.solve_ik(arm.frame, target, joints=arm.joints, seed=arm.home) for target in arm.targets]


def _solve_with_mink(arm: _Arm) -> list[tuple[int, bool]]:
    """What mink's own examples do: a frame task, a posture task, the limits, until the error is small."""
    chain = arm.kinematics._chain(arm.frame)
    configuration = mink.Configuration(chain.model)
    frame_task = mink.FrameTask(FRAME_SITE, "site", 1.0, 0.3, lm_damping=1e-2)
    posture_task = mink.PostureTask(chain.model, cost=1e-3)
    limits = [mink.ConfigurationLimit(chain.model)]
    home, found = chain.coordinates(arm.home), []
    for target in arm.targets:
        frame_task.set_target(mink.SE3(wxyz_xyz=np.concatenate([target[3:], target[:3]])))
        posture_task.set_target(home)
        configuration.update(home)
        count, is_reached = 0, False
        while count < MINK_ITERATIONS and not is_reached:
            velocity = mink.solve_ik(configuration, [frame_task, posture_task], 1.0, "daqp", 1e-6, limits=limits)
            configuration.integrate_inplace(velocity, 1.0)
            error = frame_task.compute_error(configuration)
            position, rotation = np.linalg.norm(error[:3]), np.linalg.norm(error[3:])
            is_reached = bool(position <= TOLERANCE_M and rotation <= TOLERANCE_RAD)
            count += 1
        found.append((count, is_reached))
    return found


def _planning() -> Iterator[Measure]:
    """Wall times of plans in the bundled kitchen."""
    knowledge = KnowledgeBase()
    knowledge.load([bundled_kitchen()])
    with Simulation(knowledge, MujocoEngine()) as simulation:
        simulation.spawn()
        robot = add_robot(simulation, "mobile_manipulator", Pose((0.9, 0.6, 0.0)))
        checker = CollisionChecker(robot, joints=robot.model.arms[0].joints)
        state = np.array(checker.start)
        seconds, _ = _timed(lambda: [checker.find(state) for _ in range(500)])
        yield Measure(what="kitchen: a state tested for collisions", ours=1e6 * seconds / 500, unit="µs")
        seconds, _ = _timed(lambda: plan_base(robot, (-1.2, -1.2, np.pi)))
        yield Measure(what="kitchen: a way of the base", ours=seconds)
        times = []
        for seed in range(5):
            seconds, _ = _timed(lambda seed=seed: plan_arm(robot, "", Pose((0.9, 1.15, 0.95)), free="xyz", seed=seed))
            times.append(seconds)
        yield Measure(what="kitchen: a motion of the arm", ours=median(times))
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(copies_of(kitchen_world(), 20))
        robot = add_robot(simulation, "mobile_manipulator", Pose((0.9, 0.6, 0.0)))
        simulation.step(0.5)
        seconds, _ = _timed(lambda: CollisionChecker(robot, joints=robot.model.arms[0].joints, base_moves=True))
        yield Measure(what="a collision checker for a base among 5,080 bodies", ours=seconds, unit="s", at_most=0.5)
