"""Scenery in MuJoCo: contacts excluded for bodies out of reach, and kinematic bodies that do not move."""

from __future__ import annotations

import mujoco
import pytest

from mindstage.engines.kinematic_tree import movable_axes
from mindstage.engines.mujoco import MujocoEngine
from mindstage.engines.mujoco.compiler import cull_static_contacts
from mindstage.engines.mujoco.model_cache import ModelCache
from mindstage.scene import BodyId, Pose, World
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.edits import SetPoses, Spawn
from mindstage.scene.transforms import pose_array
from tests.cases import each_case
from tests.engines.contract import apply_force_for, current_pose
from tests.engines.scenes import FLOOR, body, prismatic_joint, revolute_joint, world


def with_wall(x: float, *, y: float = 0.0) -> World:
    """A drawer that opens by 0.45 m, to x = 0.75 m; a door that turns about (0, 2.3); and a wall."""
    return world(
        FLOOR,
        body("wall", (x, y, 1.0), (0.1, 0.5, 2.0)),
        body("cabinet", (0, 0, 0.5), (0.6, 0.6, 1.0)),
        body("drawer", (0, 0, 0.3), (0.6, 0.55, 0.2), "dynamic", 5.0),
        prismatic_joint("drawer_slide", "cabinet", "drawer", (0, 0, 0.3)),
        body("fridge", (0, 2, 0.9), (0.6, 0.6, 1.7)),
        body("door", (0.322, 2, 0.9), (0.04, 0.6, 1.7), "dynamic", 8.0),
        revolute_joint("door_hinge", "fridge", "door", (0.302, 2.3, 0.9)),
    )


def unreached(position: World) -> set[str]:
    """The bodies that never reach the scenery, computed from the input of a model."""
    cache = ModelCache(0.002)
    cache.apply(Spawn(position))
    model_input = cache.model_input()
    fixed = [found for found in position.bodies if found.id in {"floor", "wall"}]
    scenery = OrientedBoxes.from_poses(
        pose_array(found.pose for found in fixed), model_input.sizes[[model_input.rows[found.id] for found in fixed]]
    )
    axes = {joint.id: movable_axes(joint) for joint in position.joints}
    return set(cull_static_contacts(model_input, axes, scenery))


@each_case(("x", "is_unreached"), [(2.0, True), (0.9, True), (0.79, False), (0.6, False), (-0.9, True)])
def test_the_swept_box_of_a_drawer_extends_slightly_beyond_its_limit(x: float, *, is_unreached: bool) -> None:
    assert ("drawer" in unreached(with_wall(x))) is is_unreached


@pytest.mark.parametrize(("x", "is_unreached"), [(2.0, True), (1.05, True), (0.9, False)])
def test_a_door_is_assumed_to_turn_fully(x: float, *, is_unreached: bool) -> None:
    assert ("door" in unreached(with_wall(x, y=2.3))) is is_unreached


def test_the_swept_box_of_an_open_drawer_includes_its_way_back() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(with_wall(-0.65)))
    engine.apply(SetPoses({BodyId("drawer"): Pose((0.3, 0, 0.3))}))
    engine.apply(Spawn(world(body("lamp", (5, 5, 1), (0.1, 0.1, 0.1)))))  # forces a new model
    apply_force_for(engine, "drawer", (-20.0, 0.0, 0.0), 2.0)
    assert current_pose(engine, "drawer")[0] == pytest.approx(-0.3, abs=0.005)


def test_a_wall_within_reach_stops_a_drawer() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(with_wall(0.6)))
    apply_force_for(engine, "drawer", (20.0, 0.0, 0.0), 2.0)
    assert current_pose(engine, "drawer")[0] == pytest.approx(0.6 - 0.05 - 0.3, abs=0.005)


def test_a_wall_added_later_stops_a_drawer() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(with_wall(2.0)))
    engine.step(0.01)
    engine.apply(SetPoses({BodyId("wall"): Pose((0.6, 0, 1.0))}))
    apply_force_for(engine, "drawer", (20.0, 0.0, 0.0), 2.0)
    assert current_pose(engine, "drawer")[0] == pytest.approx(0.25, abs=0.005)


def test_a_kinematic_body_is_scenery_until_it_moves_and_then_needs_no_new_model() -> None:
    engine = MujocoEngine()
    engine.apply(
        Spawn(
            world(
                FLOOR, body("one", (0, 0, 1), (1, 1, 0.1), "kinematic"), body("two", (3, 0, 1), (1, 1, 1), "kinematic")
            )
        )
    )
    engine.step(0.01)
    assert engine._cache.model().model.nv == 0
    engine.apply(SetPoses({BodyId("one"): Pose((0, 0, 2))}))
    model = engine._cache.model().model
    engine.apply(SetPoses({BodyId("two"): Pose((3, 0, 2))}))
    engine.apply(SetPoses({BodyId("one"): Pose((0, 0, 3))}))
    assert engine._cache.model().model is model
    assert model.nv == 12
    assert [current_pose(engine, id)[2] for id in ("one", "two")] == [3.0, 2.0]


def test_the_first_move_of_a_kinematic_body_carries_what_it_supports() -> None:
    engine = MujocoEngine()
    engine.apply(
        Spawn(
            world(
                FLOOR,
                body("tray", (0, 0, 1), (1, 1, 0.1), "kinematic"),
                body("cup", (0, 0, 1.1), (0.1,) * 3, "dynamic", 0.3),
            )
        )
    )
    engine.step(2.0)  # the cup falls asleep
    engine.apply(SetPoses({BodyId("tray"): Pose((5, 0, 1))}))
    engine.step(1.5)
    assert current_pose(engine, "cup")[2] == pytest.approx(0.05, abs=0.01)


def test_contacts_with_scenery_out_of_reach_are_excluded() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(with_wall(2.0)))
    compiled = engine._cache.model()
    pairs = {(int(each) >> 16, int(each) & 0xFFFF) for each in compiled.model.exclude_signature}
    assert (0, compiled.body_ids[BodyId("drawer")]) in pairs
    mujoco.mj_forward(compiled.model, compiled.data)
    assert compiled.data.ncon == 0
