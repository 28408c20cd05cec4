"""Joint ranges that are not symmetric about the spawned position, in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import PoseUnreachableError
from mindstage.scene import AngularLimits, AxisMotion, BodyId, Joint, LinearLimits, Pose, World
from mindstage.scene.edits import SetPoses, Spawn
from mindstage.scene.transforms import quat_rotate
from tests.engines.scenes import FLOOR, body, prismatic_joint, revolute_joint, world

CASE = body("case", (0, 0, 0.5), (0.6, 0.6, 1.0))
DRAWER = body("drawer", (0, 0, 0.5), (0.58, 0.5, 0.2), "dynamic", 5.0)


@pytest.fixture
def engine() -> Iterator[MujocoEngine]:
    made = MujocoEngine()
    yield made
    made.close()


def drawer(joint: Joint) -> World:
    opening = LinearLimits(x=AxisMotion.LIMITED, limit=0.2, x_middle=0.2)
    return world(FLOOR, CASE, DRAWER, replace(joint, linear=opening))


def final_position(engine: MujocoEngine, force: float) -> float:
    for _ in range(300):
        engine.apply_force(BodyId("drawer"), (force, 0.0, 0.0))
        engine.step(0.01)
    ids, poses = engine.poses()
    return float(poses[ids.index(BodyId("drawer"))][0])


@pytest.mark.parametrize(("force", "end"), [(40.0, 0.4), (-40.0, 0.0)])
def test_a_closed_drawer_opens_in_one_direction_only(engine: MujocoEngine, force: float, end: float) -> None:
    assert engine.apply(Spawn(drawer(prismatic_joint("slide", "case", "drawer", (0.3, 0, 0.5))))).report.ok
    assert final_position(engine, force) == pytest.approx(end, abs=0.002)


@pytest.mark.parametrize(("force", "end"), [(40.0, 0.0), (-40.0, -0.4)])
def test_swapping_parent_and_child_reverses_the_range(engine: MujocoEngine, force: float, end: float) -> None:
    assert engine.apply(Spawn(drawer(prismatic_joint("slide", "drawer", "case", (0.3, 0, 0.5))))).report.ok
    assert final_position(engine, force) == pytest.approx(end, abs=0.002)


def test_a_door_can_be_set_within_its_range_only(engine: MujocoEngine) -> None:
    swing = AngularLimits(swing1=AxisMotion.LIMITED, swing1_limit=0.8, swing1_middle=0.7)  # from -0.1 to 1.5
    door = body("door", (0, 0.3, 0.5), (0.04, 0.6, 1.0), "dynamic", 8.0)
    frame = body("frame", (0, -0.1, 0.5), (0.1, 0.1, 1.0))
    engine.apply(
        Spawn(world(FLOOR, frame, door, replace(revolute_joint("hinge", "frame", "door", (0, 0, 0.5)), angular=swing)))
    )

    def rotated(angle: float) -> Pose:
        quaternion = (np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2))
        x, y, z = quat_rotate(quaternion, (0, 0.3, 0)).tolist()
        return Pose((x, y, z + 0.5), quaternion)

    for angle in (-0.1, 1.5, 0.0):
        engine.apply(SetPoses({BodyId("door"): rotated(angle)}))
    for angle, end in ((-0.2, "-0.1"), (pi / 2, "1.5")):
        with pytest.raises(PoseUnreachableError, match=f"limited to {end}"):
            engine.apply(SetPoses({BodyId("door"): rotated(angle)}))


def test_a_middle_that_is_not_finite_is_refused(engine: MujocoEngine) -> None:
    invalid = LinearLimits(x=AxisMotion.LIMITED, limit=0.2, x_middle=float("nan"))
    report = engine.apply(
        Spawn(world(CASE, DRAWER, replace(prismatic_joint("slide", "case", "drawer", (0, 0, 0)), linear=invalid)))
    ).report
    assert "not all finite" in report.failed_joints[0].reason
