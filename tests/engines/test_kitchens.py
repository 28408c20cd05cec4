"""Whole kitchens in MuJoCo: at rest, doors open by their handles, and contents move along."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mindstage.engines import SpawnNoteKind
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.scene import AxisMotion, BodyId, Joint, World
from mindstage.scene.edits import Spawn
from mindstage.scene.joint_kinematics import joint_reach
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
    assert engine.apply(Spawn(kitchen)).report.ok
    ids, before = engine.poses()
    engine.step(10.0)
    after = engine.poses()[1]
    assert np.isfinite(after).all()
    assert not any(warnings_of(engine))
    moved = np.linalg.norm(after[:, :3] - before[:, :3], axis=1)
    assert moved.max() < 0.01, ids[int(moved.argmax())]


def doors_and_drawers(kitchen: World, engine: MujocoEngine) -> Iterator[tuple[Joint, BodyId]]:
    """Each movable joint, with the handle of the body that moves (or that body itself)."""
    movable = engine.joint_positions()
    bodies = {body.id: body for body in kitchen.bodies}
    children: dict[BodyId, list[BodyId]] = {}
    for attachment in kitchen.attachments:
        children.setdefault(attachment.parent, []).append(attachment.child)
    for joint in kitchen.joints:
        if joint.id not in movable:
            continue
        moving = next(end for end in (joint.child, joint.parent) if bodies[end].physics.is_dynamic)
        stack, handle = [moving], moving
        while stack:
            part = stack.pop()
            stack += children.get(part, [])
            if "Handle" in bodies[part].cls or "handle" in part:
                handle = part
        yield joint, handle


def opened(engine: MujocoEngine, joint: Joint, handle: BodyId, sign: int) -> float:
    """The displacement of a joint when its handle is pulled for three seconds or until it stops [m or rad]."""
    slides = joint.linear.x is not AxisMotion.LOCKED
    axis = (1.0, 0, 0) if slides else ((0, 0, 1.0) if joint.angular.swing1 is not AxisMotion.LOCKED else (0, 1.0, 0))
    direction = quat_rotate(normalize(joint.pose.quaternion), axis)
    start = current_pose(engine, handle)
    pose = np.full(3, np.inf)
    for _ in range(60):
        before, pose = pose, current_pose(engine, handle)[:3]
        if np.linalg.norm(pose - before) < 1e-6:
            break
        force = direction if slides else np.cross(direction, pose - joint.pose.position)
        engine.apply_force(handle, tuple((sign * 35.0 * force / np.linalg.norm(force)).tolist()), tuple(pose.tolist()))
        engine.step(0.05)
    end = current_pose(engine, handle)
    if slides:
        return float(np.linalg.norm(end[:3] - start[:3]))
    return float(quat_angle(start[3:], end[3:]))


@pytest.mark.parametrize("kitchen", ["bundled", pytest.param("laboratory", marks=pytest.mark.slow)], indirect=True)
def test_every_door_and_drawer_opens_to_its_limit_by_its_handle(kitchen: World) -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(kitchen))
    closed = engine.save_state()
    tested = 0
    for joint, handle in doors_and_drawers(kitchen, engine):
        slides = joint.linear.x is not AxisMotion.LOCKED
        limit = max(reach or 0.0 for reach in joint_reach(joint))
        tolerance = 0.001 if slides else np.radians(0.5)
        reached = []
        for sign in (1, -1):
            engine.restore_state(closed)
            reached.append(opened(engine, joint, handle, sign))
        assert abs(max(reached) - limit) < tolerance, (handle, reached)
        if handle not in (joint.parent, joint.child):
            assert min(reached) < 5 * tolerance, f"{handle} is pushed into the furniture: {reached}"
        tested += 1
    assert tested >= 16


@pytest.mark.parametrize(
    ("thing", "container"), [("coffee_mug_1", "drawer_right_1"), ("frying_pan_1", "drawer_right_2")]
)
def test_the_contents_of_a_drawer_move_with_it_and_stay_inside(bundled: World, thing: str, container: str) -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(bundled))
    joint, handle = next((c, h) for c, h in doors_and_drawers(bundled, engine) if container in (c.parent, c.child))
    before = {id: current_pose(engine, id) for id in (thing, container)}
    sign = max((1, -1), key=lambda sign: _tried(engine, joint, handle, sign))
    opened(engine, joint, handle, sign)
    after = {id: current_pose(engine, id) for id in (thing, container)}
    assert np.linalg.norm(after[container][:3] - before[container][:3]) > 0.4
    size = bundled.body(container).size
    assert size is not None
    drawer_from_thing = quat_rotate(quat_conjugate(after[container][3:]), after[thing][:3] - after[container][:3])
    assert (np.abs(drawer_from_thing) < np.array(size) / 2).all()


def _tried(engine: MujocoEngine, joint: Joint, handle: BodyId, sign: int) -> float:
    state = engine.save_state()
    reached = opened(engine, joint, handle, sign)
    engine.restore_state(state)
    return reached


def test_the_milk_stays_in_the_fridge_when_its_door_is_opened(bundled: World) -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(bundled))
    milk = next(body.id for body in bundled.bodies if "milk" in body.id)
    before = current_pose(engine, milk)
    joint, handle = next((c, h) for c, h in doors_and_drawers(bundled, engine) if "fridge" in h)
    assert max(_tried(engine, joint, handle, sign) for sign in (1, -1)) > 1.5
    assert np.linalg.norm(current_pose(engine, milk)[:3] - before[:3]) < 0.01


def test_only_the_enclosures_of_the_laboratory_are_found(laboratory: World) -> None:
    report = MujocoEngine().apply(Spawn(laboratory)).report
    enclosures = {
        laboratory.body(note.ids[0]).cls.split("#")[1] for note in report.notes if note.kind is SpawnNoteKind.ENCLOSURE
    }
    assert enclosures == {"IAIPanorama", "LabBlackBox", "IAILabWalls"}
