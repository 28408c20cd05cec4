"""Robots in MJCF files: bare MuJoCo simulates them as the engine does."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.robots import add_robot
from mindstage.robots.robot import Robot
from mindstage.scene import BodyId, Pose
from mindstage.simulation import Simulation


def saved(sim: Simulation, folder: Path, *, robots: bool = True) -> mujoco.MjModel:
    sim.save(folder / "robot.mjcf", robots=robots)
    return mujoco.MjModel.from_xml_path(str(folder / "robot.mjcf"))


def bare_positions(model: mujoco.MjModel, robot: Robot, duration_s: float) -> dict[BodyId, np.ndarray]:
    """Where the links are after a time, from the keyframe with the commands on."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("commands").id)
    for _ in range(round(duration_s / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return {id: data.body(id).xpos.copy() for id in robot.link_ids.values()}


def link_positions(robot: Robot) -> dict[BodyId, np.ndarray]:
    return {id: robot.link_pose(link)[:3].copy() for link, id in robot.link_ids.items()}


@pytest.mark.parametrize("name", ["mobile_manipulator", "panda"])
def test_a_saved_robot_moves_in_bare_mujoco_as_in_the_engine(name: str, tmp_path: Path) -> None:
    with Simulation(KnowledgeBase(), MujocoEngine()) as sim:
        robot = add_robot(sim, name, Pose((0.3, -0.2, 0.0)))
        sim.step(0.5)
        arm = robot.model.arms[0]
        now = robot.joint_positions()
        middle = {each: now[each] for each in arm.joints}
        for each in arm.joints:
            joint = robot.model.joint(each)
            if joint.lower is not None and joint.upper is not None:
                middle[each] = 0.7 * now[each] + 0.15 * (joint.lower + joint.upper)
        motion = robot.moving_to(middle)
        for _ in range(10):  # the file is written on the way, so that commands and positions differ
            sim.step(next(motion))
        motion.close()
        sim.step(0.5)
        commands = {each.actuator: each for each in robot.controller.drives.joints.values()}
        first = commands[robot.joint_ids[arm.joints[0]]]
        state = sim.engine.run(lambda engine: engine.actuator_states())[first.actuator]
        sim.engine.run(lambda engine: engine.set_commands({first.actuator: state.command + 0.05}))
        model = saved(sim, tmp_path)
        assert {model.actuator(i).name for i in range(model.nu)} == robot.controller.drives.actuators
        limits = {each.name: each.effort_limit for each in robot.controller.drives.records}
        for number in range(model.nu):
            limit = limits[model.actuator(number).name]
            assert tuple(model.actuator_forcerange[number]) == pytest.approx((-limit, limit))
        before = link_positions(robot)
        bare = bare_positions(model, robot, 1.0)
        sim.step(1.0)
        after = link_positions(robot)
        moved = max(float(np.linalg.norm(after[id] - before[id])) for id in bare)
        assert moved > 0.01
        for id, position in bare.items():
            np.testing.assert_allclose(position, after[id], atol=1e-3, err_msg=str(id))


def test_a_file_without_robots_has_no_actuators(tmp_path: Path) -> None:
    with Simulation(KnowledgeBase(), MujocoEngine()) as sim:
        add_robot(sim, "mobile_manipulator")
        assert saved(sim, tmp_path, robots=False).nu == 0
