"""Whole kitchens with geometry in MuJoCo: furniture opens, and nothing jams, falls through or creeps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from mindstage.engines import SpawnNoteKind, SpawnReport
from mindstage.engines.mujoco import MujocoEngine
from mindstage.geometry.fit import fit_geometry
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.scene import AxisMotion, Body, BodyId, BodyPhysics, GeometryMap, Iri, Joint, Mobility, Pose, World
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.edits import Spawn
from mindstage.scene.joint_kinematics import joint_reach
from mindstage.scene.transforms import normalize, pose_array, quat_angle, quat_rotate
from tests.engines.contract import current_pose
from tests.engines.test_kitchens import doors_and_drawers, opened


class Kitchen(NamedTuple):
    """A map with the geometry of its bodies."""

    world: World
    geometry: GeometryMap
    knowledge: KnowledgeBase

    def spawned(self, *more: Body) -> tuple[MujocoEngine, SpawnReport]:
        """An engine with the kitchen and additional bodies."""
        engine = MujocoEngine()
        report = engine.apply(Spawn(self.world, geometry=self.geometry)).report
        if more:
            extra = World(iri=Iri("http://example.org/more.owl#map"), bodies=more)
            assert engine.apply(Spawn(extra, geometry=fit_geometry(extra, self.knowledge).geometry)).report.ok
        return engine, report


def read(path: Path) -> Kitchen:
    knowledge = KnowledgeBase()
    knowledge.load([path])
    world = knowledge.world()
    return Kitchen(world, fit_geometry(world, knowledge).geometry, knowledge)


@pytest.fixture(scope="module")
def bundled() -> Kitchen:
    return read(bundled_kitchen())


@pytest.fixture(scope="module")
def laboratory(shared_data: Path) -> Kitchen:
    return read(shared_data / "maps" / "iai-kitchen-original.owl")


@pytest.fixture(params=["bundled", "laboratory"])
def kitchen(request: pytest.FixtureRequest) -> Kitchen:
    return request.getfixturevalue(request.param)


def overlapping(report: SpawnReport) -> int:
    """The number of overlapping pairs, reported or not."""
    return sum(len(note.ids) - 1 for note in report.notes if note.kind is SpawnNoteKind.OVERLAP)


def test_an_undisturbed_kitchen_with_geometry_stays_at_rest_and_falls_asleep(kitchen: Kitchen) -> None:
    engine, report = kitchen.spawned()
    assert report.ok
    ids, before = engine.poses()
    engine.step(10.0)
    moved = np.linalg.norm(engine.poses()[1][:, :3] - before[:, :3], axis=1)
    assert moved.max() < 0.01, ids[int(moved.argmax())]
    assert (engine._cache.model().data.tree_asleep >= 0).all(), "something never comes to rest"


def test_geometry_excludes_fewer_pairs_than_boxes(kitchen: Kitchen) -> None:
    boxes = MujocoEngine().apply(Spawn(kitchen.world)).report
    with_geometry = kitchen.spawned()[1]
    assert overlapping(with_geometry) < overlapping(boxes)
    assert not [note for note in with_geometry.notes if note.kind is SpawnNoteKind.HOLLOW]


def test_free_bodies_penetrate_nothing(bundled: Kitchen) -> None:
    """So every body in the kitchen is supported by the body on or in which it is."""
    report = bundled.spawned()[1]
    assert [note.text for note in report.notes if note.kind is SpawnNoteKind.OVERLAP] == []


def test_every_door_and_drawer_with_geometry_opens_to_its_limit_by_its_handle(kitchen: Kitchen) -> None:
    engine, _ = kitchen.spawned()
    engine.step(1.0)
    closed = engine.save_state()
    tested = 0
    for joint, handle in doors_and_drawers(kitchen.world, engine):
        limit = max(reach or 0.0 for reach in joint_reach(joint))
        tolerance = 0.001 if joint.linear.x is not AxisMotion.LOCKED else np.radians(0.5)
        reached = []
        for sign in (1, -1):
            engine.restore_state(closed)
            reached.append(opened(engine, joint, handle, sign))
            if abs(reached[-1] - limit) < tolerance:
                break
        assert abs(max(reached) - limit) < tolerance, (handle, reached)
        tested += 1
    assert tested >= 16


# -- manipulation ------------------------------------------------------------------------------------------------------


def copy_of(world: World, like: str, position: np.ndarray) -> Body:
    """A copy of a body at another position, upright."""
    model = world.body(like)
    x, y, z = position.tolist()
    physics = BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=0.4, gravity=True)
    return Body(
        id=BodyId("brought"), iri=Iri("http://example.org/more.owl#brought"), cls=model.cls,
        pose=Pose((x, y, z)), size=model.size, physics=physics,
    )  # fmt: skip


def pulled(engine: MujocoEngine, joint: Joint, handle: BodyId) -> Iterator[float]:
    """Opens and closes a joint by its handle; returns both displacements [m or rad]."""
    closed = engine.save_state()
    displacement = {}
    for sign in (1, -1):
        engine.restore_state(closed)
        displacement[sign] = opened(engine, joint, handle, sign)
    engine.restore_state(closed)
    sign = max(displacement, key=displacement.__getitem__)
    yield opened(engine, joint, handle, sign)
    opened(engine, joint, handle, -sign)
    engine.step(1.0)
    positions = engine.joint_positions()[joint.id]
    yield max(positions, key=abs) * np.sign(displacement[sign])


def joint_of(kitchen: Kitchen, engine: MujocoEngine, name: str) -> tuple[Joint, BodyId]:
    return next((c, h) for c, h in doors_and_drawers(kitchen.world, engine) if name in (c.parent, c.child))


def test_a_mug_placed_in_a_drawer_stays_in_it_while_it_opens_and_closes(bundled: Kitchen) -> None:
    drawer = bundled.world.body("drawer_left_4")
    assert drawer.size is not None
    mug = copy_of(bundled.world, "coffee_mug_1", np.add(drawer.pose.position, (0.0, 0.0, 0.02)))
    engine, _ = bundled.spawned(mug)
    engine.step(1.0)
    joint, handle = joint_of(bundled, engine, "drawer_left_4")
    for _ in pulled(engine, joint, handle):
        offset = current_pose(engine, "brought")[:3] - current_pose(engine, "drawer_left_4")[:3]
        assert (np.abs(offset) < np.array(drawer.size) / 2).all(), offset


def test_milk_stays_in_the_fridge_with_the_door_closed_and_open(bundled: Kitchen) -> None:
    engine, _ = bundled.spawned()
    milk = next(body.id for body in bundled.world.bodies if "milk" in body.id)
    before = current_pose(engine, milk)
    engine.step(2.0)
    joint, handle = joint_of(bundled, engine, "fridge_door")
    assert next(pulled(engine, joint, handle)) > 0.7
    after = current_pose(engine, milk)
    assert np.linalg.norm(after[:3] - before[:3]) < 0.01
    assert quat_angle(after[3:], before[3:]) < 0.05


def free_spot(kitchen: Kitchen, host: Body, size: tuple[float, float, float]) -> np.ndarray:
    """A position for a body of a size on a host, with no other body near."""
    place = max(kitchen.geometry[host.id].support_surfaces, key=lambda place: place.size[0] * place.size[1])
    others = [body for body in kitchen.world.bodies if body.size and body is not host]
    poses = pose_array(body.pose for body in others)
    poses[:, 3:] = normalize(poses[:, 3:])
    low, high = OrientedBoxes.from_poses(poses, np.array([body.size for body in others])).bounds()
    x, y = np.array(place.size) / 2 - np.array(size[:2])
    for dx, dy in np.stack(np.meshgrid(np.linspace(-x, x, 7), np.linspace(-y, y, 15)), axis=-1).reshape(-1, 2):
        local = np.add(place.center, (dx, dy, size[2] / 2 + 0.002))
        position = host.pose.position + quat_rotate(normalize(host.pose.quaternion), local)
        reach = np.array(size) / 2 + (0.05, 0.05, 0.0)
        if not ((low < position + reach) & (high > position - reach)).all(axis=1).any():
            return np.asarray(position)
    pytest.fail(f"there is no free spot on {host.id}")


@pytest.mark.parametrize("kind", ["plate_1", "coffee_mug_1", "cereal_bowl_1"])
def test_objects_placed_on_the_counter_rest_there(bundled: Kitchen, kind: str) -> None:
    counter = bundled.world.body("counter_left")
    size = bundled.world.body(kind).size
    assert size is not None
    position = free_spot(bundled, counter, size)
    engine, _ = bundled.spawned(copy_of(bundled.world, kind, position))
    engine.step(3.0)
    placed = current_pose(engine, "brought")
    assert np.linalg.norm(placed[:3] - position) < 0.01
    assert quat_angle(placed[3:], [1, 0, 0, 0]) < 0.02
