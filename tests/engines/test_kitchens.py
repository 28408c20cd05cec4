"""Whole kitchens in MuJoCo: they stand still, every door opens by its handle, and what is inside comes along."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mindstage.engines import MujocoEngine, SpawnNoteKind
from mindstage.knowledge import KnowledgeBase, bundled_kitchen
from mindstage.scene import AxisMotion, BodyId, Joint, World
from mindstage.scene.transforms import normalize, quat_angle, quat_conjugate, quat_rotate
from tests.engines.contract import current_pose


def read(*paths: Path) -> World:
    knowledge = KnowledgeBase()
    knowledge.load(paths)
    return knowledge.world()


@pytest.fixture(scope="module")
def bundled() -> World:
    return read(bundled_kitchen())


@pytest.fixture(scope="module")
def laboratory(shared_data: Path) -> World:
    return read(shared_data / "maps" / "iai-kitchen-original.owl")


@pytest.fixture(params=["bundled", "laboratory"])
def kitchen(request: pytest.FixtureRequest) -> World:
    return request.getfixturevalue(request.param)


def warnings_of(engine: MujocoEngine) -> list[int]:
    return [warning.number for warning in engine._cache.model().data.warning]


def test_an_undisturbed_kitchen_stays_at_rest(kitchen: World) -> None:
    engine = MujocoEngine()
    assert engine.spawn(kitchen).ok
    ids, before = engine.poses()
    engine.step(10.0)
    after = engine.poses()[1]
    assert np.isfinite(after).all()
    assert not any(warnings_of(engine))
    moved = np.linalg.norm(after[:, :3] - before[:, :3], axis=1)
    assert moved.max() < 0.01, ids[int(moved.argmax())]


def doors_and_drawers(kitchen: World, engine: MujocoEngine) -> Iterator[tuple[Joint, BodyId]]:
    """Each constraint that can move, and the handle on the side that moves (or that side itself)."""
    movable = engine.joint_positions()
    bodies = {body.id: body for body in kitchen.bodies}
    children: dict[BodyId, list[BodyId]] = {}
    for attachment in kitchen.attachments:
        children.setdefault(attachment.parent, []).append(attachment.child)
    for constraint in kitchen.joints:
        if constraint.id not in movable:
            continue
        moving = next(end for end in (constraint.child, constraint.parent) if bodies[end].physics.is_dynamic)
        waiting, handle = [moving], moving
        while waiting:
            part = waiting.pop()
            waiting += children.get(part, [])
            if "Handle" in bodies[part].cls or "handle" in part:
                handle = part
        yield constraint, handle


def opened(engine: MujocoEngine, constraint: Joint, handle: BodyId, way: int) -> float:
    """How far a joint gets when its handle is pulled for three seconds, or until it goes no further [m or rad]."""
    slides = constraint.linear.x is not AxisMotion.LOCKED
    axis = (
        (1.0, 0, 0) if slides else ((0, 0, 1.0) if constraint.angular.swing1 is not AxisMotion.LOCKED else (0, 1.0, 0))
    )
    direction = quat_rotate(normalize(constraint.pose.quaternion), axis)
    start = current_pose(engine, handle)
    place = np.full(3, np.inf)
    for _ in range(60):
        before, place = place, current_pose(engine, handle)[:3]
        if np.linalg.norm(place - before) < 1e-6:
            break
        force = direction if slides else np.cross(direction, place - constraint.pose.position)
        engine.apply_force(handle, tuple((way * 35.0 * force / np.linalg.norm(force)).tolist()), tuple(place.tolist()))
        engine.step(0.05)
    end = current_pose(engine, handle)
    if slides:
        return float(np.linalg.norm(end[:3] - start[:3]))
    return float(quat_angle(start[3:], end[3:]))


def test_every_door_and_drawer_opens_to_its_limit_by_its_handle(kitchen: World) -> None:
    engine = MujocoEngine()
    engine.spawn(kitchen)
    closed = engine.save_state()
    tried = 0
    for constraint, handle in doors_and_drawers(kitchen, engine):
        slides = constraint.linear.x is not AxisMotion.LOCKED
        limit = constraint.linear.limit if slides else max(a for a in _limits(constraint) if a)
        tolerance = 0.001 if slides else np.radians(0.5)
        reached = []
        for way in (1, -1):
            engine.restore_state(closed)
            reached.append(opened(engine, constraint, handle, way))
            if abs(reached[-1] - limit) < tolerance:
                break
        assert abs(max(reached) - limit) < tolerance, (handle, reached)
        tried += 1
    assert tried >= 16


def _limits(constraint: Joint) -> tuple[float, float]:
    angular = constraint.angular
    return (
        angular.swing1_limit if angular.swing1 is AxisMotion.LIMITED else 0.0,
        angular.swing2_limit if angular.swing2 is AxisMotion.LIMITED else 0.0,
    )


@pytest.mark.parametrize(
    ("thing", "container"), [("coffee_mug_1", "drawer_right_1"), ("frying_pan_1", "drawer_right_2")]
)
def test_the_contents_of_a_drawer_move_with_it_and_stay_inside(bundled: World, thing: str, container: str) -> None:
    engine = MujocoEngine()
    engine.spawn(bundled)
    constraint, handle = next((c, h) for c, h in doors_and_drawers(bundled, engine) if container in (c.parent, c.child))
    before = {id: current_pose(engine, id) for id in (thing, container)}
    way = max((1, -1), key=lambda way: _tried(engine, constraint, handle, way))
    opened(engine, constraint, handle, way)
    after = {id: current_pose(engine, id) for id in (thing, container)}
    assert np.linalg.norm(after[container][:3] - before[container][:3]) > 0.4
    size = bundled.body(container).size
    assert size is not None
    drawer_from_thing = quat_rotate(quat_conjugate(after[container][3:]), after[thing][:3] - after[container][:3])
    assert (np.abs(drawer_from_thing) < np.array(size) / 2).all()


def _tried(engine: MujocoEngine, constraint: Joint, handle: BodyId, way: int) -> float:
    state = engine.save_state()
    reached = opened(engine, constraint, handle, way)
    engine.restore_state(state)
    return reached


def test_the_milk_stays_in_the_fridge_when_its_door_is_opened(bundled: World) -> None:
    engine = MujocoEngine()
    engine.spawn(bundled)
    milk = next(body.id for body in bundled.bodies if "milk" in body.id)
    before = current_pose(engine, milk)
    constraint, handle = next((c, h) for c, h in doors_and_drawers(bundled, engine) if "fridge" in h)
    assert max(_tried(engine, constraint, handle, way) for way in (1, -1)) > 0.7
    assert np.linalg.norm(current_pose(engine, milk)[:3] - before[:3]) < 0.01


def test_only_the_enclosures_of_the_laboratory_are_found(laboratory: World) -> None:
    report = MujocoEngine().spawn(laboratory)
    shells = {
        laboratory.body(note.ids[0]).cls.split("#")[1] for note in report.notes if note.kind is SpawnNoteKind.ENCLOSURE
    }
    assert shells == {"IAIPanorama", "LabBlackBox", "IAILabWalls"}
