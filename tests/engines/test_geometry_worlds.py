"""Random worlds with random geometry in MuJoCo."""

from __future__ import annotations

import contextlib

import mujoco
import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mindstage.engines.mujoco import MujocoEngine, world_to_mjcf
from mindstage.errors import SimulationDivergedError
from mindstage.scene import BodyGeometry, BodyId, CollisionShape, CollisionShapeType, Pose, World, diff
from mindstage.scene.edits import Spawn
from mindstage.scene.transforms import quat_rotate
from tests.engines.contract import apply_force_for, current_pose
from tests.engines.geometries import as_vector, bin_geometry, cabinet_geometry, geometry
from tests.engines.scenes import FLOOR, LIMIT_M, body, prismatic_joint, world
from tests.worlds import worlds

lengths = st.floats(0.0, 2.0)
places = st.floats(-1.0, 1.0)
points = st.tuples(places, places, places)
quaternions = st.tuples(*[st.floats(0.1, 1.0)] * 4).map(
    lambda q: tuple((np.array(q) / np.linalg.norm(q)).tolist()),
)


@st.composite
def collision_shapes(draw: st.DrawFn) -> CollisionShape:
    """Collision shapes of all types, including flat, thin and rotated ones."""
    return CollisionShape(
        type=draw(st.sampled_from(CollisionShapeType)),
        size=(draw(lengths), draw(lengths), draw(lengths)),
        pose=Pose(draw(points), draw(quaternions)),
        points=tuple(draw(st.lists(points, max_size=10))),
    )


@st.composite
def geometries(draw: st.DrawFn) -> BodyGeometry:
    more = {
        name: draw(st.none() | st.floats(0.0, most))
        for name, most in (("friction", 2.0), ("restitution", 1.0), ("density", 8000.0))
    }
    return geometry(*draw(st.lists(collision_shapes(), max_size=5)), **more)


@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow])
@given(described=worlds(max_bodies=5), made=st.lists(geometries(), min_size=5, max_size=5))
def test_any_world_with_any_geometry_is_returned_unchanged_and_runs(described: World, made: list[BodyGeometry]) -> None:
    used_geometry = {body.id: body_geometry for body, body_geometry in zip(described.bodies, made, strict=False)}
    engine = MujocoEngine()
    assert engine.apply(Spawn(described, geometry=used_geometry)).report.ok
    assert diff(described, engine.snapshot()).identical(0.0)
    with contextlib.suppress(SimulationDivergedError):  # a body moved a kilometer into another may well diverge
        engine.step(0.02)
        assert np.isfinite(engine.poses()[1]).all()
    mujoco.MjModel.from_xml_string(world_to_mjcf(described, geometry=used_geometry).text)


def test_a_crowd_of_geometries_in_one_place_does_not_explode() -> None:
    crate = bin_geometry((0.3, 0.3, 0.2))
    bodies = [body(f"b{i}", (0, 0, 1), (0.3, 0.3, 0.2), "dynamic", 1.0, gravity=False) for i in range(270)]
    engine = MujocoEngine()
    assert engine.apply(Spawn(world(*bodies), geometry={BodyId(f"b{i}"): crate for i in range(270)})).report.ok
    engine.step(0.02)
    assert np.abs(engine.poses()[1][:, :3] - (0, 0, 1)).max() < 1e-6


gaps = st.floats(-0.003, 0.003)


@settings(max_examples=15)
@given(
    wide=st.floats(0.3, 0.9),
    high=st.floats(0.12, 0.3),
    between=st.lists(gaps, min_size=2, max_size=2),
    beside=gaps,
    turn=st.floats(0.0, 6.0),
)
def test_drawers_open_in_an_inaccurate_map(
    wide: float, high: float, between: list[float], beside: float, turn: float
) -> None:
    """Three drawers, one above the other, and a cupboard beside them, with small gaps or overlaps."""
    quaternion = (float(np.cos(turn / 2)), 0.0, 0.0, float(np.sin(turn / 2)))

    def at(x: float, y: float, z: float) -> tuple[float, float, float]:
        return as_vector(quat_rotate(quaternion, (x, y, z)))

    size, case, cupboard = (0.5, wide, high), (0.52, wide + 0.04, 3 * high + 0.1), (0.52, 0.4, 3 * high + 0.1)
    heights = np.cumsum([0.1 + high / 2, high + between[0], high + between[1]]).tolist()
    drawers = [
        body(f"drawer{i}", at(0.01, 0, z), size, "dynamic", 3.0, quaternion=quaternion) for i, z in enumerate(heights)
    ]
    slides = [
        prismatic_joint(f"slide{i}", "case", f"drawer{i}", at(0, 0, z), quaternion=quaternion)
        for i, z in enumerate(heights)
    ]
    center = case[2] / 2 + 0.05
    engine = MujocoEngine()
    engine.apply(
        Spawn(
            world(
                FLOOR,
                body("case", at(0, 0, center), case, quaternion=quaternion),
                body("cupboard", at(0.01, wide / 2 + 0.2 + beside, center), cupboard, quaternion=quaternion),
                *drawers,
                *slides,
            ),
            geometry={
                BodyId("case"): cabinet_geometry(case),
                BodyId("cupboard"): cabinet_geometry(cupboard),
                **{BodyId(f"drawer{i}"): bin_geometry(size) for i in range(3)},
            },
        )
    )
    engine.step(0.5)
    for i in range(3):
        apply_force_for(engine, f"drawer{i}", at(20.0, 0, 0), 1.2)
        direction = quat_rotate((quaternion[0], 0, 0, -quaternion[3]), current_pose(engine, f"drawer{i}")[:3])
        assert abs(direction[0] - 0.01 - LIMIT_M) < 0.001, (i, direction)
