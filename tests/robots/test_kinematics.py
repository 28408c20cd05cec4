"""Forward and inverse kinematics, compared with closed forms."""

from __future__ import annotations

import sys
from math import atan2, cos, hypot, pi, sin

import numpy as np
import pytest

from mindstage.errors import InvalidArgumentError, RobotLibraryError
from mindstage.robots import planning, robot_kinematics
from mindstage.robots.models.robot_model import (
    Arm,
    BaseType,
    RobotBase,
    RobotJoint,
    RobotJointType,
    RobotLink,
    RobotMimic,
    RobotModel,
)
from mindstage.robots.robot_kinematics import BASE_JOINTS, RobotKinematics
from mindstage.scene import Pose
from mindstage.scene.transforms import normalized_pose_array, pose_array

UPPER_M, LOWER_M = 0.4, 0.3


def planar_arm(*, base: BaseType = BaseType.FIXED, elbow: tuple[float, float] = (-2.5, 2.5)) -> RobotModel:
    """A lift and two hinges about z, of which the links are in the xy plane; a third hinge follows the second one."""
    joints = (
        RobotJoint(
            name="lift", type=RobotJointType.PRISMATIC, parent="root", child="tower",
            origin=Pose((0.1, 0.0, 0.5)), axis=(0.0, 0.0, 1.0), lower=0.0, upper=0.5,
        ),
        RobotJoint(
            name="shoulder", type=RobotJointType.REVOLUTE, parent="tower", child="upper",
            axis=(0.0, 0.0, 1.0), lower=-2.8, upper=2.8,
        ),
        RobotJoint(
            name="elbow", type=RobotJointType.REVOLUTE, parent="upper", child="lower",
            origin=Pose((UPPER_M, 0.0, 0.0)), axis=(0.0, 0.0, 1.0), lower=elbow[0], upper=elbow[1],
        ),
        RobotJoint(
            name="hand_joint", type=RobotJointType.FIXED, parent="lower", child="hand", origin=Pose((LOWER_M, 0.0, 0.0))
        ),
        RobotJoint(
            name="finger", type=RobotJointType.REVOLUTE, parent="hand", child="tip", axis=(0.0, 0.0, 1.0),
            mimic=RobotMimic(joint="elbow", multiplier=-1.0, offset=0.1),
        ),
    )  # fmt: skip
    links = tuple(RobotLink(name=name) for name in ("root", "tower", "upper", "lower", "hand", "tip"))
    arm = Arm(name="arm", joints=("lift", "shoulder", "elbow"), base_link="root", tip_link="hand")
    return RobotModel(name="planar", links=links, joints=joints, base=RobotBase(type=base, link="root"), arms=(arm,))


def closed_form(lift: float, shoulder: float, elbow: float) -> tuple[float, float, float]:
    x = 0.1 + UPPER_M * cos(shoulder) + LOWER_M * cos(shoulder + elbow)
    return x, UPPER_M * sin(shoulder) + LOWER_M * sin(shoulder + elbow), 0.5 + lift


@pytest.mark.parametrize("positions", [(0.0, 0.0, 0.0), (0.2, 0.7, -1.1), (0.5, -2.0, 2.2)])
def test_forward_kinematics_is_the_closed_form(positions: tuple[float, float, float]) -> None:
    robot = RobotKinematics(planar_arm())
    pose = robot.pose("hand", dict(zip(("lift", "shoulder", "elbow"), positions, strict=True)))
    assert pose[:3] == pytest.approx(closed_form(*positions))
    yaw = 2 * atan2(pose[6], pose[3])
    assert cos(yaw - positions[1] - positions[2]) == pytest.approx(1.0)


def test_a_joint_that_mimics_another_one_follows_it() -> None:
    pose = RobotKinematics(planar_arm()).pose("tip", {"elbow": 0.8})
    assert 2 * atan2(pose[6], pose[3]) == pytest.approx(0.8 + (-0.8 + 0.1))


def test_segments_that_follow_a_telescope_count_for_its_reach() -> None:
    segments = [
        RobotJoint(
            name=f"segment_{n}", type=RobotJointType.PRISMATIC, parent=f"link_{n}", child=f"link_{n + 1}",
            axis=(1.0, 0.0, 0.0), lower=0.0, upper=0.2,
            mimic=RobotMimic(joint="segment_0") if n else None,
        )
        for n in range(3)
    ]  # fmt: skip
    wrist = RobotJoint(
        name="wrist", type=RobotJointType.REVOLUTE, parent="link_3", child="hand", axis=(0.0, 0.0, 1.0),
        lower=-2.0, upper=2.0,
    )  # fmt: skip
    links = tuple(RobotLink(name=name) for name in ("link_0", "link_1", "link_2", "link_3", "hand"))
    arm = Arm(name="arm", joints=("segment_0", "wrist"), base_link="link_0", tip_link="hand")
    base = RobotBase(type=BaseType.FIXED, link="link_0")
    model = RobotModel(name="telescope", links=links, joints=(*segments, wrist), base=base, arms=(arm,))
    robot = RobotKinematics(model)
    found = robot.solve_ik("hand", Pose((0.57, 0.0, 0.0), (cos(0.4), 0.0, 0.0, sin(0.4))))
    assert found, found.reason
    assert found.positions == pytest.approx({"segment_0": 0.19, "wrist": 0.8}, abs=1e-3)
    assert robot.pose("hand", found.positions)[0] == pytest.approx(0.57, abs=1e-3)
    far = robot.solve_ik("hand", Pose((0.7, 0.0, 0.0)))
    assert far.reason == "the target is 0.1 m beyond reach"


def test_inverse_kinematics_finds_the_closed_form() -> None:
    robot = RobotKinematics(planar_arm())
    x, y, z = closed_form(0.3, 0.6, 1.2)
    found = robot.solve_ik("hand", Pose((x, y, z)), free="xyz", seed={"elbow": 0.5})
    assert found, found.reason
    cosine = ((x - 0.1) ** 2 + y**2 - UPPER_M**2 - LOWER_M**2) / (2 * UPPER_M * LOWER_M)
    assert abs(cos(found.positions["elbow"]) - cosine) < 5e-3
    assert found.positions["lift"] == pytest.approx(0.3, abs=1e-3)
    assert closed_form(*found.positions.values()) == pytest.approx((x, y, z), abs=1e-3)


def test_both_solutions_are_found() -> None:
    x, y, z = closed_form(0.3, 0.6, 1.2)
    solutions = RobotKinematics(planar_arm()).solutions("hand", Pose((x, y, z)), free="xyz")
    elbows = sorted(each.positions["elbow"] for each in solutions)
    assert elbows == pytest.approx([-1.2, 1.2], abs=0.02)


def test_a_root_pose_moves_the_target() -> None:
    robot = RobotKinematics(planar_arm())
    root = normalized_pose_array(Pose((2.0, 1.0, 0.0), (cos(pi / 4), 0.0, 0.0, sin(pi / 4))))
    x, y, z = closed_form(0.1, 0.3, 0.4)
    found = robot.solve_ik("hand", Pose((2.0 - y, 1.0 + x, z)), free="xyz", root_pose=root)
    assert found, found.reason
    assert robot.pose("hand", found.positions, root_pose=root)[:3] == pytest.approx((2 - y, 1 + x, z), abs=1e-3)


def test_a_target_beyond_reach_is_reported_with_the_distance() -> None:
    found = RobotKinematics(planar_arm()).solve_ik("hand", Pose((2.1, 0.0, 0.7)), free="xyz")
    assert not found
    assert found.reason == "the target is 1.3 m beyond the reach of 0.7 m"


def test_a_link_that_ends_no_arm_is_moved_by_the_joints_before_it() -> None:
    kinematics = RobotKinematics(planar_arm())
    wanted = {"lift": 0.2, "shoulder": 0.7, "elbow": -0.4}
    found = kinematics.solve_ik("lower", kinematics.pose("lower", wanted))
    assert found, found.reason
    assert found.positions.keys() == {"lift", "shoulder", "elbow"}
    assert {name: found.positions[name] for name in wanted} == pytest.approx(wanted, abs=1e-3)


def test_a_target_above_the_lift_names_its_limit() -> None:
    found = RobotKinematics(planar_arm()).solve_ik("hand", Pose((0.6, 0.0, 1.15)), free="xyz")
    assert not found
    assert found.limits == ("lift",)
    assert "150 mm" in found.reason
    assert "lift is at its upper limit 0.5 m" in found.reason


def test_a_target_below_the_lift_names_its_limit() -> None:
    found = RobotKinematics(planar_arm()).solve_ik("hand", Pose((0.6, 0.0, 0.35)), free="xyz")
    assert not found
    assert found.limits == ("lift",)
    assert "150 mm" in found.reason
    assert "lift is at its lower limit 0 m" in found.reason


def test_the_limit_of_the_elbow_is_named_and_kept() -> None:
    x, y, z = closed_form(0.3, 0.6, 1.2)
    found = RobotKinematics(planar_arm(elbow=(-0.4, 0.4))).solve_ik("hand", Pose((x, y, z)), free="xyz")
    assert not found
    assert "elbow" in found.limits
    assert abs(found.positions["elbow"]) <= 0.4


def test_joints_that_may_not_move_keep_their_positions() -> None:
    robot = RobotKinematics(planar_arm())
    seed = {"lift": 0.2, "shoulder": 0.3, "elbow": 0.9}
    x, y, _ = closed_form(0.2, -0.5, 1.3)
    found = robot.solve_ik("hand", Pose((x, y, 0.7)), joints=("shoulder", "elbow"), seed=seed, free="xyz")
    assert found, found.reason
    assert set(found.positions) == {"shoulder", "elbow"}
    assert not robot.solve_ik("hand", Pose((x, y, 0.8)), joints=("shoulder", "elbow"), seed=seed, free="xyz")


def test_a_base_that_drives_brings_the_hand_anywhere_on_the_floor() -> None:
    robot = RobotKinematics(planar_arm(base=BaseType.PLANAR))
    joints = (*BASE_JOINTS, "lift", "shoulder", "elbow")
    target = Pose((4.0, -3.0, 0.8), (cos(1.0), 0.0, 0.0, sin(1.0)))
    found = robot.solve_ik("hand", target, joints=joints)
    assert found, found.reason
    pose = robot.pose("hand", found.positions, root_pose=np.array(found.root_pose))
    assert pose == pytest.approx(pose_array([target])[0], abs=2e-3)
    assert hypot(*found.root_pose[:2]) > 3.0


@pytest.mark.parametrize(("library", "use"), [("mink", "_libraries"), ("daqp", "_libraries"), ("ompl.base", "_ompl")])
def test_a_library_that_is_not_installed_is_named_with_the_remedy(
    library: str, use: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = planning if use == "_ompl" else robot_kinematics
    load = getattr(module, use)
    load.cache_clear()
    monkeypatch.setitem(sys.modules, library, None)
    try:
        with pytest.raises(RobotLibraryError, match=rf"{library} is not installed.*mindstage\[robots\]"):
            load()
    finally:
        load.cache_clear()


def test_unknown_frames_and_joints_are_refused() -> None:
    robot = RobotKinematics(planar_arm())
    with pytest.raises(InvalidArgumentError, match=r"palm: .*no such gripper or link.*hand"):
        robot.pose("palm", {})
    with pytest.raises(InvalidArgumentError, match=r"wrist: .*no such joint"):
        robot.solve_ik("hand", Pose(), joints=("wrist",))
    with pytest.raises(InvalidArgumentError, match="none of the joints moves it"):
        robot.solve_ik("tower", Pose(), joints=("elbow",))
