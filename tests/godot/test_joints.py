"""Joints in Godot's Jolt physics: free, limited and locked axes, and the ends of ranges."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from mindstage.engines.remote.godot import GodotEngine
from mindstage.scene import AngularLimits, AxisMotion, BodyId, Iri, Joint, LinearLimits, Pose
from mindstage.scene.edits import Spawn
from mindstage.scene.transforms import quat_angle
from tests.engines.contract import current_pose
from tests.engines.scenes import body, world

FREE, LIMITED, LOCKED = AxisMotion
LIMIT_M, LIMIT_RAD = 0.2, 0.3
WITHIN_M, WITHIN_RAD = 0.002, 0.0087


@pytest.fixture(scope="module")
def engine(godot: Path) -> Iterator[GodotEngine]:
    with closing(GodotEngine(godot)) as engine:
        yield engine


@pytest.mark.parametrize(
    ("linear", "angular"),
    [
        ((FREE, LIMITED, LOCKED), (LOCKED, LOCKED, LOCKED)),
        ((LOCKED, FREE, LIMITED), (LIMITED, LOCKED, FREE)),
        ((LIMITED, LOCKED, FREE), (FREE, FREE, FREE)),
        ((LIMITED, LIMITED, LIMITED), (LOCKED, LOCKED, LOCKED)),
        ((LOCKED, LOCKED, LOCKED), (LIMITED, LOCKED, LOCKED)),
        ((LOCKED, LOCKED, LOCKED), (LOCKED, LOCKED, LOCKED)),
    ],
)
def test_any_combination_of_axes_moves_as_described(
    engine: GodotEngine, linear: tuple[AxisMotion, ...], angular: tuple[AxisMotion, ...]
) -> None:
    engine.clear()
    joint = Joint(
        id=BodyId("joint"),
        iri=Iri("http://example.org/maps/scene.owl#joint"),
        parent=BodyId("base"),
        child=BodyId("arm"),
        pose=Pose((0.3, 0, 1)),
        linear=LinearLimits(x=linear[0], y=linear[1], z=linear[2], limit=LIMIT_M),
        angular=AngularLimits(swing1=angular[0], swing2=angular[1], twist=angular[2], swing1_limit=LIMIT_RAD),
    )
    arm = body("arm", (0.5, 0, 1), (0.3, 0.1, 0.1), "dynamic", 1.0, gravity=False)
    assert engine.apply(Spawn(world(body("base", (0, 0, 1), (0.2, 0.2, 0.2)), arm, joint))).report.ok
    for _ in range(75):
        x, y, z = current_pose(engine, "arm")[:3].tolist()
        engine.apply_force(BodyId("arm"), (6.0, 5.0, 4.0), (x + 0.005, y + 0.003, z + 0.002))
        engine.step(0.02)
    position = engine.joint_positions().get(BodyId("joint"), (0.0,) * 6)
    for motion, reached in zip(linear, position[:3], strict=True):
        if motion is LOCKED:
            assert abs(reached) < WITHIN_M
        elif motion is LIMITED:
            assert abs(reached) < LIMIT_M + WITHIN_M
        else:
            assert abs(reached) > LIMIT_M
    if angular[0] is LIMITED:
        assert abs(position[5]) < LIMIT_RAD + WITHIN_RAD
    if angular == (LOCKED, LOCKED, LOCKED):
        assert quat_angle(current_pose(engine, "arm")[3:], [1, 0, 0, 0]) < WITHIN_RAD
