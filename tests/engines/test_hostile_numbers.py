"""One body with extreme numbers is refused or clamped with a reason, and never disturbs the others."""

from __future__ import annotations

import math
import re

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mindstage.engines import NullEngine, SpawnNoteKind
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import PoseUnreachableError
from mindstage.scene import Body, BodyGeometry, BodyId, CollisionShape, Joint, Pose, SoftLimit
from mindstage.scene.edits import SetPoses, Spawn
from tests.cases import each_case
from tests.engines.geometries import geometry
from tests.engines.scenes import FLOOR, body, prismatic_joint, world

TABLE = body("table", (0, 0, 0.35), (1, 1, 0.7))
CUP = body("cup", (0, 0, 0.75), (0.1, 0.1, 0.1), "dynamic", 0.2)

magnitudes = st.floats(min_value=-300.0, max_value=300.0).map(lambda exponent: 10.0**exponent)
lengths = magnitudes | st.just(0.0) | st.floats(min_value=0.001, max_value=3.0)
coordinates = st.tuples(lengths, st.sampled_from([-1.0, 1.0])).map(math.prod)
vectors = st.tuples(coordinates, coordinates, coordinates)


@st.composite
def hostile_bodies(draw: st.DrawFn) -> Body:
    """A dynamic body with at least one extreme number, next to or far from the table."""
    position = draw(vectors | st.just((5.0, 5.0, 0.5)))
    size = draw(st.tuples(lengths, lengths, lengths) | st.just((0.2, 0.2, 0.2)))
    mass = draw(st.none() | magnitudes)
    quaternion = draw(st.tuples(coordinates, coordinates, coordinates, coordinates) | st.just((1.0, 0.0, 0.0, 0.0)))
    return body("bad", position, size, draw(st.sampled_from(["dynamic", "static"])), mass, quaternion=quaternion)


@settings(max_examples=40, deadline=None)
@given(bad=hostile_bodies())
def test_a_world_with_one_hostile_body_steps_and_the_others_stay(bad: Body) -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(world(FLOOR, TABLE, CUP)))
    report = engine.apply(Spawn(world(bad), ground=True)).report
    assert report.bodies == 1 or report.failed_bodies[0].reason
    engine.step(0.5)
    ids, poses = engine.poses()
    assert np.isfinite(poses).all()
    if not _may_reach_the_table(bad):
        assert np.abs(poses[ids.index(BodyId("cup")), :3] - (0, 0, 0.75)).max() < 0.002


def _may_reach_the_table(bad: Body) -> bool:
    """Whether a body is horizontally so near to the table that it may touch it or the cup."""
    assert bad.size is not None
    return math.hypot(*bad.pose.position[:2]) <= sum(bad.size) + 2.0


@each_case(
    ("bad", "reason"),
    [
        (body("bad", (0, 0, 1), (1e300, 1, 1), "dynamic"), "size"),
        (body("bad", (1e300, 0, 1), (1, 1, 1), "dynamic"), "position"),
        (body("bad", (0, 0, 1), (1, 1, 1), "dynamic", quaternion=(1e-200, 0.0, 0.0, 0.0)), "norm of 1e-200"),
        (body("bad", (0, 0, 1), (1, 1, 1), "dynamic", quaternion=(1e200, 1.0, 0.0, 0.0)), "norm of 1e\\+200"),
    ],
)
@each_case("engine", [NullEngine, MujocoEngine])
def test_numbers_that_no_engine_can_simulate_are_refused_with_the_reason(
    bad: Body, reason: str, engine: type[NullEngine | MujocoEngine]
) -> None:
    report = engine().apply(Spawn(world(bad))).report
    (failure,) = report.failed_bodies
    assert failure.id == "bad"
    assert re.search(reason, failure.reason), failure.reason


@pytest.mark.parametrize(("given_kg", "used"), [(1e-12, "1e-05"), (1e300, "1e\\+07")])
def test_an_extreme_mass_is_clamped_and_reported_but_not_changed(given_kg: float, used: str) -> None:
    engine = MujocoEngine()
    spawned = world(FLOOR, body("ball", (0, 0, 0.1), (0.2, 0.2, 0.2), "dynamic", given_kg))
    (note,) = [note for note in engine.apply(Spawn(spawned)).report.notes if note.kind is SpawnNoteKind.CLAMPED]
    assert note.ids == ("ball",)
    assert used.replace("\\", "") in note.text
    engine.step(1.0)
    assert engine.poses()[1][1, 2] == pytest.approx(0.1, abs=0.002)
    assert engine.snapshot().body("ball").physics.mass_kg == given_kg


def test_a_body_cannot_be_moved_beyond_what_can_be_simulated() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(world(FLOOR, CUP)))
    with pytest.raises(PoseUnreachableError, match="farther than 1e\\+08 m"):
        engine.apply(SetPoses({BodyId("cup"): Pose((0.0, 0.0, 1e300))}))


@pytest.mark.parametrize("strength", [1e300, float("nan"), -1.0])
def test_a_soft_limit_that_no_engine_can_simulate_is_refused(strength: float) -> None:
    joint: Joint = prismatic_joint("slide", "table", "cup", (0, 0, 0.75))
    soft = SoftLimit(enabled=True, stiffness=strength, damping=1.0)
    linear = msgspec.structs.replace(joint.linear, soft_limit=soft)
    report = MujocoEngine().apply(Spawn(world(FLOOR, TABLE, CUP, msgspec.structs.replace(joint, linear=linear)))).report
    assert "stiffness" in report.failed_joints[0].reason


def test_collision_shapes_with_extreme_numbers_are_left_out_and_reported() -> None:
    shapes = (CollisionShape(size=(0.1, 0.1, 0.1)), CollisionShape(size=(1e300, 0.1, 0.1)))
    odd: BodyGeometry = geometry(*shapes, friction=1e300)
    engine = MujocoEngine()
    report = engine.apply(Spawn(world(FLOOR, TABLE, CUP), geometry={BodyId("cup"): odd})).report
    assert any("1 of its collision shapes" in note.text for note in report.notes)
    engine.step(1.0)
    assert engine.poses()[1][2, 2] == pytest.approx(0.75, abs=0.002)
