"""MujocoEngine fulfills the contract, and properties that only MuJoCo has."""

from __future__ import annotations

import contextlib
import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from mindstage.engines import SpawnNoteKind
from mindstage.engines.mujoco import MujocoEngine, model_cache
from mindstage.errors import SimulationDivergedError
from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Joint,
    LinearLimits,
    Mobility,
    Pose,
    SoftLimit,
    Vector,
    World,
    diff,
)
from mindstage.scene.edits import Attach, Delete, SetPhysics, SetPoses, Spawn
from mindstage.scene.transforms import normalize, quat_angle
from tests.cases import each_case
from tests.engines.actuator_contract import ActuatorContract
from tests.engines.contract import PhysicsContract, apply_force_for, current_pose
from tests.engines.geometry_contract import GeometryContract
from tests.engines.scenes import FLOOR, attachment, body, fixed_joint, prismatic_joint, revolute_joint, room, world
from tests.worlds import worlds


class TestMujocoEngine(PhysicsContract, ActuatorContract, GeometryContract):
    rest_tolerance_m = 0.002

    @pytest.fixture
    def engine(self) -> MujocoEngine:
        return MujocoEngine()


@given(described=worlds(max_bodies=8))
def test_any_world_is_returned_unchanged_by_the_engine(described: World) -> None:
    engine = MujocoEngine()
    report = engine.apply(Spawn(described)).report
    assert report.ok, report
    found = diff(described, engine.snapshot())
    assert found.identical(0.0), found
    ids, poses = engine.poses()
    assert np.isfinite(poses).all()
    given_poses = {b.id: b.pose for b in described.bodies}
    settled = {note.ids[0] for note in report.notes if note.kind is SpawnNoteKind.SETTLED}
    for _ in described.bodies:  # what is connected with it moves along
        for link in (*described.attachments, *described.joints):
            settled |= {link.parent, link.child} if not settled.isdisjoint((link.parent, link.child)) else set()
    for id, row in zip(ids, poses, strict=True):
        if id in settled:  # moved out of an overlap, which is reported
            continue
        pose = given_poses[id]
        assert np.abs(row[:3] - pose.position).max() <= 1e-12 * max(1.0, *map(abs, pose.position))
        assert quat_angle(row[3:], normalize(pose.quaternion)) <= 1e-12


@given(described=worlds(max_bodies=6))
def test_any_world_runs_or_reports_why_it_cannot(described: World) -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(described))
    with contextlib.suppress(SimulationDivergedError):  # a joint frame a kilometer away may well diverge
        engine.step(0.1)
        assert np.isfinite(engine.poses()[1]).all()


def model_of(engine: MujocoEngine) -> object:
    return engine._cache.model().model


def test_masses_in_the_model_are_exactly_the_given_ones() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(room()))
    compiled = engine._cache.model()
    for described in room().bodies:
        if described.physics.mass_kg:
            assert compiled.model.body_mass[compiled.body_ids[described.id]] == described.physics.mass_kg


def test_the_snapshot_is_read_from_the_simulation() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(room()))
    assert {body.id for body in engine.snapshot().bodies} == set(engine._cache.model().rows)
    assert not engine._cache.stale
    compiled = engine._cache.model()
    compiled.data.xpos[compiled.body_ids[BodyId("crate")]] = (7.0, 8.0, 9.0)
    assert engine.snapshot().body("crate").pose.position == (7.0, 8.0, 9.0)


def test_consecutive_edits_cost_one_recompile(monkeypatch: pytest.MonkeyPatch) -> None:
    compile_count = []
    original = model_cache.compile_model
    monkeypatch.setattr(model_cache, "compile_model", lambda blueprint: compile_count.append(1) or original(blueprint))
    engine = MujocoEngine()
    engine.apply(Spawn(room()))
    engine.step(0.01)
    compile_count.clear()
    for i in range(20):
        engine.apply(Spawn(world(body(f"new{i}", (5, i, 1), (0.1, 0.1, 0.1), "dynamic", 1.0))))
    engine.apply(SetPhysics(BodyId("mug"), BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=1.0)))
    engine.apply(SetPoses({BodyId("new3"): Pose((7, 7, 1))}))
    engine.apply(Attach(BodyId("drawer"), BodyId("mug")))
    engine.apply(Delete((BodyId("new4"),)))
    engine.restore_state(engine.save_state())
    assert current_pose(engine, "new3")[0] == 7
    assert compile_count == []
    engine.step(0.01)
    assert compile_count == [1]


def test_sleeping_bodies_stay_asleep_through_an_edit_elsewhere() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(room()))
    engine.step(3.0)
    asleep = int((engine._cache.model().data.tree_asleep >= 0).sum())
    assert asleep == 4
    engine.apply(Spawn(world(body("distant", (8, 8, 1), (0.1, 0.1, 0.1), "dynamic", 1.0))))
    engine.step(0.004)
    assert int((engine._cache.model().data.tree_asleep >= 0).sum()) == asleep


MOTIONS = [
    (linear, angular)
    for linear in itertools.product(AxisMotion, repeat=3)
    for angular in [
        (AxisMotion.LOCKED,) * 3,
        (AxisMotion.LIMITED, AxisMotion.LOCKED, AxisMotion.FREE),
        (AxisMotion.FREE,) * 3,
    ]
]


@each_case(("linear", "angular"), MOTIONS)
def test_any_combination_of_axes_moves_as_described(
    linear: tuple[AxisMotion, ...], angular: tuple[AxisMotion, ...]
) -> None:
    joint = Joint(
        id=BodyId("joint"),
        iri=Iri("http://example.org/maps/scene.owl#joint"),
        parent=BodyId("base"),
        child=BodyId("arm"),
        pose=Pose((0.3, 0, 1)),
        linear=LinearLimits(x=linear[0], y=linear[1], z=linear[2], limit=0.2),
        angular=AngularLimits(swing1=angular[0], swing2=angular[1], twist=angular[2], swing1_limit=0.3),
    )
    engine = MujocoEngine()
    base, arm = (
        body("base", (0, 0, 1), (0.2, 0.2, 0.2)),
        body("arm", (0.5, 0, 1), (0.3, 0.1, 0.1), "dynamic", 1.0, gravity=False),
    )
    assert engine.apply(Spawn(world(base, arm, joint))).report.ok
    for _ in range(150):
        x, y, z = current_pose(engine, "arm")[:3].tolist()
        engine.apply_force(BodyId("arm"), (6.0, 5.0, 4.0), (x + 0.005, y + 0.003, z + 0.002))
        engine.step(0.01)
    pose = engine.joint_positions().get(BodyId("joint"))
    if all(motion is AxisMotion.FREE for motion in (*linear, *angular)):
        assert pose is None
        return
    pose = pose or (0.0,) * 6
    for motion, reached in zip(linear, pose[:3], strict=True):
        if motion is AxisMotion.LOCKED:
            assert abs(reached) < 1e-3
        elif motion is AxisMotion.LIMITED:
            assert abs(reached) < 0.2 + 2e-3
        else:
            assert abs(reached) > 0.2
    if angular[0] is AxisMotion.LIMITED:
        assert abs(pose[5]) < 0.3 + 0.02
    if angular[1] is AxisMotion.LOCKED and angular[0] is AxisMotion.LOCKED:
        assert quat_angle(current_pose(engine, "arm")[3:], [1, 0, 0, 0]) < 1e-6


def test_a_soft_limit_yields_like_a_spring_of_its_stiffness() -> None:
    stiffness, force = 400.0, 40.0
    soft = LinearLimits(
        x=AxisMotion.LIMITED, limit=0.1, soft_limit=SoftLimit(enabled=True, stiffness=stiffness, damping=60.0)
    )
    joint = Joint(
        id=BodyId("joint"),
        iri=Iri("http://example.org/maps/scene.owl#joint"),
        parent=BodyId("base"),
        child=BodyId("arm"),
        pose=Pose((0, 0, 1)),
        linear=soft,
    )
    engine = MujocoEngine()
    engine.apply(
        Spawn(
            world(
                body("base", (-1, 0, 1), (0.2, 0.2, 0.2)),
                body("arm", (0, 0, 1), (0.3, 0.1, 0.1), "dynamic", 2.0),
                joint,
            )
        )
    )
    apply_force_for(engine, "arm", (force, 0.0, 0.0), 6.0)
    friction = 2.0 * 1.0 * 1.05  # the friction of the slide, with a margin
    beyond = current_pose(engine, "arm")[0] - 0.1
    assert (force - friction) / stiffness * 0.9 < beyond < force / stiffness * 1.05


@pytest.mark.parametrize("make", [prismatic_joint, revolute_joint, fixed_joint])
def test_a_joint_that_closes_a_loop_holds_its_locked_axes(make: object) -> None:
    arms = [
        body(name, (0.5 * i, 0, 1), (0.3, 0.1, 0.1), "dynamic", 1.0) for i, name in enumerate(("one", "two"), start=1)
    ]
    closing = make("closing", "two", "base", (1.3, 0, 1))  # type: ignore[operator]
    engine = MujocoEngine()
    report = engine.apply(
        Spawn(
            world(
                FLOOR,
                body("base", (1.6, 0, 1), (0.2, 0.2, 2.0)),
                body("wall", (0, 0, 1), (0.2, 0.2, 2.0)),
                *arms,
                fixed_joint("first", "wall", "one", (0.3, 0, 1)),
                revolute_joint("middle", "one", "two", (0.75, 0, 1)),
                closing,
            )
        )
    ).report
    assert report.ok
    assert any(note.kind is SpawnNoteKind.JOINT and "loop" in note.text for note in report.notes)
    apply_force_for(engine, "two", (0.0, 8.0, 0.0), 1.0)
    assert abs(current_pose(engine, "two")[2] - 1.0) < 0.01
    assert np.isfinite(engine.poses()[1]).all()


def test_a_diverging_body_is_named_and_the_engine_stays_usable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    engine = MujocoEngine()
    engine.apply(Spawn(room()))
    state = engine.save_state()
    engine.apply_force(BodyId("mug"), (1e30, 0.0, 0.0))
    with pytest.raises(SimulationDivergedError, match="mug"):
        engine.step(0.05)
    engine.restore_state(state)
    engine.step(0.1)
    assert np.isfinite(engine.poses()[1]).all()
    assert list(tmp_path.iterdir()) == [], "a log file was left behind"


def test_a_dynamic_body_attached_without_a_joint_moves_rigidly_and_is_reported() -> None:
    engine = MujocoEngine()
    magnet = body("magnet", (0.345, 2.1, 1.4), (0.002, 0.05, 0.05), "dynamic", 0.05)
    described = world(*room().bodies, magnet, *room().joints, *room().attachments, attachment("door", "magnet"))
    report = engine.apply(Spawn(described)).report
    assert [note.ids for note in report.notes if note.kind is SpawnNoteKind.ATTACHMENT] == [("magnet", "door")]
    apply_force_for(engine, "door_handle", (25.0, 0.0, 0.0), 4.0)
    assert quat_angle(current_pose(engine, "magnet")[3:], [1, 0, 0, 0]) == pytest.approx(np.pi / 4, abs=0.01)


def test_a_joint_takes_precedence_over_an_attachment_and_is_reported() -> None:
    engine = MujocoEngine()
    described = world(*room().bodies, *room().joints, *room().attachments, attachment("fridge", "door"))
    report = engine.apply(Spawn(described)).report
    assert report.ok
    assert any(note.kind is SpawnNoteKind.ATTACHMENT and note.ids == ("door", "fridge") for note in report.notes)
    apply_force_for(engine, "door_handle", (25.0, 0.0, 0.0), 4.0)
    assert quat_angle(current_pose(engine, "door")[3:], [1, 0, 0, 0]) == pytest.approx(np.pi / 4, abs=0.01)
    assert diff(described, engine.snapshot()).lost_facts == 0


def test_hundreds_of_bodies_in_one_place_do_not_explode() -> None:
    boxes = [body(f"b{i}", (0, 0, 1), (0.1, 0.1, 0.1), "dynamic", 1.0, gravity=False) for i in range(600)]
    engine = MujocoEngine()
    assert engine.apply(Spawn(world(*boxes))).report.ok
    engine.step(0.02)
    assert np.abs(engine.poses()[1][:, :3] - (0, 0, 1)).max() < 1e-6


# -- fast bodies


@pytest.mark.parametrize(("size", "height"), [(0.1, 50.0), (0.1, 1.0), (0.02, 0.3)])
def test_a_fast_body_is_stopped_by_a_thin_table(size: float, height: float) -> None:
    engine = MujocoEngine()
    table = body("table", (0, 0, -0.005), (1, 1, 0.01))
    cube = body("cube", (0, 0, height + size / 2), (size, size, size), "dynamic", 1.0)
    engine.apply(Spawn(world(body("floor", (0, 0, -2), (50, 50, 1)), table, cube)))
    engine.step(6.0)
    assert engine.poses()[1][2, 2] == pytest.approx(size / 2, abs=0.001)
    assert not engine.notes


def test_a_fast_body_is_not_reported_for_its_own_parts_or_the_empty_air() -> None:
    engine = MujocoEngine()
    parts = body("pole", (0, 0, 50), (0.1, 0.1, 0.1), "dynamic", 1.0), body("foot", (0, 0, 49), (0.1, 0.1, 0.01))
    engine.apply(Spawn(world(body("floor", (9, 0, 0), (1, 1, 0.01)), *parts, attachment("pole", "foot"))))
    engine.step(2.0)
    assert not engine.notes


def test_a_fork_shares_the_model_and_leaves_sleeping_bodies_asleep() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(room()))
    engine.step(3.0)
    assert engine.stats().awake < engine.stats().movable
    fork = engine.fork()
    assert fork.stats() == engine.stats()
    assert fork._cache.model().model is engine._cache.model().model
    fork.step(0.5)
    assert fork.stats().awake <= engine.stats().awake
    engine.step(0.5)
    assert fork.stats() == engine.stats()
    np.testing.assert_array_equal(fork.poses()[1], engine.poses()[1])


def test_a_world_of_many_bodies_moves_like_a_part_of_it() -> None:
    """Many bodies are in several models: what is joined stays together, and names refer to the same bodies."""

    def hall(count: int) -> World:
        bodies, joints, attachments = [], [], []
        for number in range(count):
            x, y = 3.0 * (number % 20), 3.0 * (number // 20)
            bodies += [
                _block(f"post{number}", (x, y, 2.0), (0.1, 0.1, 2.0), Mobility.STATIC),
                _block(f"arm{number}", (x + 0.5, y, 2.0), (0.8, 0.05, 0.05), Mobility.DYNAMIC),
                _block(f"tip{number}", (x + 0.9, y, 2.0), (0.1, 0.1, 0.1), Mobility.DYNAMIC),
                _block(f"stone{number}", (x, y + 1.0, 2.0), (0.1, 0.1 + 0.001 * (number % 3), 0.1), Mobility.DYNAMIC),
            ]
            hinge = Joint(
                id=BodyId(f"hinge{number}"),
                iri=Iri(f"http://x.org#hinge{number}"),
                parent=BodyId(f"post{number}"),
                child=BodyId(f"arm{number}"),
                pose=Pose((x + 0.1, y, 2.0)),
                angular=AngularLimits(swing2=AxisMotion.FREE),
            )
            joints.append(hinge)
            attachments.append(Attachment(parent=BodyId(f"arm{number}"), child=BodyId(f"tip{number}")))
        return World(
            iri=Iri("http://x.org#map"), bodies=tuple(bodies), joints=tuple(joints), attachments=tuple(attachments)
        )

    found = {}
    for count in (3, 240):
        with contextlib.closing(MujocoEngine()) as engine:
            engine.apply(Spawn(hall(count), ground=False))
            engine.step(0.3)
            found[count] = {body.id: body.pose for body in engine.snapshot().bodies}
    assert len(found[240]) == 960
    for number in (0, 1, 2, 121, 239):
        start = np.array([3.0 * (number % 20), 3.0 * (number // 20), 0.0])
        for kind in ("post", "arm", "tip", "stone"):
            pose, expected = found[240][BodyId(f"{kind}{number}")], found[3][BodyId(f"{kind}{number % 3}")]
            moved = pose.position - start + np.array([3.0 * (number % 3), 0.0, 0.0])
            assert moved == pytest.approx(expected.position, abs=1e-6), kind
            assert pose.quaternion == pytest.approx(expected.quaternion, abs=1e-6), kind
        assert found[240][BodyId(f"stone{number}")].position[2] < 1.6


def _block(id: str, at: Vector, size: Vector, mobility: Mobility) -> Body:
    physics = BodyPhysics(mobility=mobility)
    iri = Iri(f"http://x.org#{id}")
    return Body(id=BodyId(id), iri=iri, cls=Iri("http://x.org#Block"), pose=Pose(at), size=size, physics=physics)
