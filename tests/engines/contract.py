"""The contract of engines: what every implementation of `mindstage.engines.Engine` must do, as reusable test classes.

To test a new engine, write a subclass of `DescriptionContract` (an engine without physics) or `PhysicsContract` (an
engine that simulates), and a fixture `engine` that yields an empty engine for each test:

    class TestMyEngine(PhysicsContract):
        @pytest.fixture
        def engine(self) -> Iterator[Engine]:
            engine = MyEngine()
            yield engine
            engine.close()

Tolerances are class attributes; an engine that computes in single precision overrides them. Tests of optional
capabilities are skipped for engines that do not declare them. An engine that differs from the contract by design
overrides the test and states the reason. Collision shapes and visual meshes have a contract of their own, in
`geometry_contract.py`.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
import numpy as np
import pytest

from mindstage.engines import Capability, DynamicsScale, Engine, SpawnNoteKind, SpawnReport
from mindstage.errors import AttachmentError, BodyNotFoundError, EngineClosedError, PoseUnreachableError
from mindstage.scene import (
    AngularLimits,
    AxisMotion,
    Body,
    BodyId,
    BodyPhysics,
    Joint,
    JointMimic,
    LinearLimits,
    Material,
    Mobility,
    Pose,
    World,
    diff,
)
from mindstage.scene.edits import Attach, Delete, Detach, SetLabel, SetMaterials, SetPhysics, SetPoses, Spawn
from mindstage.scene.transforms import normalize, quat_angle, quat_rotate
from tests.engines.geometries import box_shape, geometry
from tests.engines.scenes import (
    FLOOR,
    LIMIT_M,
    LIMIT_RAD,
    attachment,
    body,
    fixed_joint,
    prismatic_joint,
    revolute_joint,
    room,
    world,
)

ALL_FREE = LinearLimits(x=AxisMotion.FREE, y=AxisMotion.FREE, z=AxisMotion.FREE)
NO_LIMITS = AngularLimits(swing1=AxisMotion.FREE, swing2=AxisMotion.FREE, twist=AxisMotion.FREE)


def current_pose(engine: Engine, id: str) -> np.ndarray:
    ids, poses = engine.poses()
    return poses[ids.index(BodyId(id))]


def displacement(engine: Engine, id: str, start: np.ndarray) -> float:
    """Distance of a body from its position in a start pose [m]."""
    return float(np.linalg.norm(current_pose(engine, id)[:3] - start[:3]))


def apply_force_for(engine: Engine, id: str, force: tuple[float, float, float], duration_s: float) -> None:
    """Applies a force [N] at the body's origin for a duration [s]."""
    for _ in range(round(duration_s / 0.01)):
        x, y, z = current_pose(engine, id)[:3].tolist()
        engine.apply_force(BodyId(id), force, (x, y, z))
        engine.step(0.01)


def notes_of(report: SpawnReport, kind: SpawnNoteKind) -> list[tuple[str, ...]]:
    """The ids of the notes of one kind."""
    return [note.ids for note in report.notes if note.kind is kind]


def overlap_pairs(ids: tuple[str, ...]) -> list[frozenset[str]]:
    """The pairs of an overlap note: its first body with each of the others."""
    return [frozenset((ids[0], other)) for other in ids[1:]]


def gripper(multiplier: float) -> World:
    """Two fingers that slide along x; the right one, with a tip, mimics the left one."""
    base = body("base", (0, 0, 0.5), (0.2, 0.2, 0.2))
    left = body("left", (0.0, 0.2, 1.0), (0.05, 0.05, 0.1), "dynamic", 0.5)
    right = body("right", (0.0, -0.2, 1.0), (0.05, 0.05, 0.1), "dynamic", 0.5)
    tip = body("tip", (0.0, -0.2, 1.1), (0.02, 0.02, 0.02), "kinematic", 0.1)
    follows = JointMimic(joint=BodyId("left_slide"), multiplier=multiplier)
    return world(
        base, left, right, tip, attachment("right", "tip"),
        prismatic_joint("left_slide", "base", "left", (0, 0.2, 1.0)),
        prismatic_joint("right_slide", "base", "right", (0, -0.2, 1.0), mimic=follows),
    )  # fmt: skip


class DescriptionContract:
    """The contract of all engines, with and without physics."""

    pose_tolerance = 1e-12
    """Maximum deviation of poses before the first step from the spawned ones [m, rad]."""
    placement_tolerance = 1e-9
    """Maximum deviation of poses after `set_pose`, including those of attached bodies [m, rad]."""

    def test_a_snapshot_equals_the_spawned_world(self, engine: Engine) -> None:
        assert engine.apply(Spawn(room())).report.ok
        assert diff(room(), engine.snapshot()).identical(0.0)

    def test_poses_before_the_first_step_are_the_described_ones(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        engine.snapshot()  # forces the engine to build its model
        ids, poses = engine.poses()
        described = {b.id: b.pose for b in room().bodies}
        assert set(ids) == set(described)
        for id, pose in zip(ids, poses, strict=True):
            assert np.abs(pose[:3] - described[id].position).max() <= self.pose_tolerance
            assert quat_angle(pose[3:], described[id].quaternion) <= self.pose_tolerance

    def test_a_duplicate_id_fails_and_the_rest_is_spawned(self, engine: Engine) -> None:
        engine.apply(Spawn(world(FLOOR)))
        report = engine.apply(Spawn(world(FLOOR, body("box", (0, 0, 1), (1, 1, 1))))).report
        assert [failure.id for failure in report.failed_bodies] == ["floor"]
        assert "taken" in report.failed_bodies[0].reason
        assert engine.poses()[0] == ("floor", "box")

    def test_a_joint_to_a_missing_body_and_a_cycle_of_attachments_fail_with_reasons(self, engine: Engine) -> None:
        boxes = [body(name, (i, 0, 1), (0.1, 0.1, 0.1)) for i, name in enumerate("ab")]
        report = engine.apply(
            Spawn(
                world(*boxes, prismatic_joint("s", "a", "ghost", (0, 0, 1)), attachment("a", "b"), attachment("b", "a"))
            )
        ).report
        assert not report.ok
        assert (report.bodies, report.joints, report.attachments) == (2, 0, 1)
        assert "ghost" in report.failed_joints[0].reason
        assert "cycle" in report.failed_attachments[0].reason

    @pytest.mark.parametrize("position", [(float("nan"), 0.0, 0.0), (float("inf"), 0.0, 0.0)])
    def test_a_pose_that_is_not_finite_fails(self, engine: Engine, position: tuple[float, float, float]) -> None:
        report = engine.apply(Spawn(world(body("box", position, (1, 1, 1))))).report
        assert "finite" in report.failed_bodies[0].reason

    def test_a_zero_quaternion_fails(self, engine: Engine) -> None:
        report = engine.apply(Spawn(world(body("box", (0, 0, 0), (1, 1, 1), quaternion=(0.0, 0.0, 0.0, 0.0))))).report
        assert "quaternion" in report.failed_bodies[0].reason

    def test_deleting_a_body_deletes_its_joints_and_attachments(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        engine.apply(Delete((BodyId("door"),)))
        snapshot = engine.snapshot()
        assert "door" not in {b.id for b in snapshot.bodies}
        assert "door_hinge" not in {c.id for c in snapshot.joints}
        assert all("door" not in (a.parent, a.child) for a in snapshot.attachments)
        assert {"door_handle", "fridge", "drawer"} <= {b.id for b in snapshot.bodies}

    def test_an_unknown_body_is_refused_with_similar_names_and_nothing_changes(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        with pytest.raises(BodyNotFoundError, match=r"near: .*'drawer'"):
            engine.apply(Delete((BodyId("mug"), BodyId("drawr"))))
        assert diff(room(), engine.snapshot()).identical(0.0)

    @pytest.mark.parametrize("multiplier", [1.0, -0.5])
    def test_a_joint_that_mimics_another_one_follows_poses_that_are_set(
        self, engine: Engine, multiplier: float
    ) -> None:
        engine.apply(Spawn(gripper(multiplier)))
        start = current_pose(engine, "right")
        engine.apply(SetPoses({BodyId("left"): Pose((0.1, 0.2, 1.0))}))
        moved = current_pose(engine, "right")
        assert moved[0] - start[0] == pytest.approx(0.1 * multiplier, abs=self.placement_tolerance)
        assert current_pose(engine, "tip")[0] == pytest.approx(moved[0], abs=self.placement_tolerance)
        engine.apply(SetPoses({BodyId("right"): Pose((0.2 * multiplier, -0.2, 1.0))}))
        assert current_pose(engine, "left")[0] == pytest.approx(0.2, abs=self.placement_tolerance)
        assert diff(gripper(multiplier), engine.snapshot()).only_in_b == ()
        assert [joint.mimic for joint in engine.snapshot().joints] == [
            joint.mimic for joint in gripper(multiplier).joints
        ]

    def test_a_joint_whose_master_is_deleted_moves_independently(self, engine: Engine) -> None:
        engine.apply(Spawn(gripper(1.0)))
        engine.apply(Delete((BodyId("left"),)))
        [joint] = engine.snapshot().joints
        assert (joint.id, joint.mimic) == ("right_slide", None)
        engine.apply(SetPoses({BodyId("right"): Pose((0.1, -0.2, 1.0))}))
        assert current_pose(engine, "right")[0] == pytest.approx(0.1, abs=self.placement_tolerance)

    def test_attached_bodies_move_with_their_parent(self, engine: Engine) -> None:
        engine.apply(
            Spawn(
                world(
                    body("table", (1, 2, 3), (1, 1, 0.1), "kinematic"),
                    body("lamp", (1.3, 2, 3.2), (0.1, 0.1, 0.3), "kinematic"),
                    attachment("table", "lamp"),
                )
            )
        )
        rotation = normalize([1.0, 0.0, 0.0, 1.0])
        engine.apply(SetPoses({BodyId("table"): Pose((5, 5, 5), tuple(rotation.tolist()))}))
        lamp = current_pose(engine, "lamp")
        np.testing.assert_allclose(
            lamp[:3], np.add((5, 5, 5), quat_rotate(rotation, [0.3, 0, 0.2])), atol=self.placement_tolerance
        )
        assert quat_angle(lamp[3:], rotation) < self.placement_tolerance

    def test_moving_an_attached_child_keeps_its_parent_and_the_attachment(self, engine: Engine) -> None:
        engine.apply(
            Spawn(
                world(
                    body("table", (0, 0, 1), (1, 1, 0.1), "kinematic"),
                    body("lamp", (0, 0, 1.2), (0.1, 0.1, 0.3), "kinematic"),
                    attachment("table", "lamp"),
                )
            )
        )
        engine.apply(SetPoses({BodyId("lamp"): Pose((0.4, 0, 1.2))}))
        assert displacement(engine, "table", np.array([0, 0, 1.0])) < self.pose_tolerance
        engine.apply(SetPoses({BodyId("table"): Pose((1, 0, 1))}))
        np.testing.assert_allclose(current_pose(engine, "lamp")[:3], (1.4, 0, 1.2), atol=self.placement_tolerance)

    def test_attaching_and_detaching_keep_poses(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        before = {id: current_pose(engine, id) for id in ("crate", "mug")}
        engine.apply(Attach(BodyId("crate"), BodyId("mug")))
        assert max(displacement(engine, id, start) for id, start in before.items()) < self.placement_tolerance
        engine.apply(Detach(BodyId("mug")))
        assert max(displacement(engine, id, start) for id, start in before.items()) < self.placement_tolerance

    def test_a_cycle_of_attachments_is_refused(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        with pytest.raises(AttachmentError, match="cycle"):
            engine.apply(Attach(BodyId("drawer_handle"), BodyId("drawer")))

    def test_changed_materials_and_physics_are_in_the_snapshot(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        steel, heavy = (Material(name="steel"),), BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=7.0, gravity=False)
        engine.apply(SetMaterials(BodyId("mug"), steel))
        engine.apply(SetPhysics(BodyId("mug"), heavy))
        mug = engine.snapshot().body("mug")
        assert (mug.materials, mug.physics) == (steel, heavy)

    def test_a_changed_label_is_in_the_snapshot_and_in_saved_states(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        mug, before = BodyId("mug"), engine.snapshot().body("mug")
        engine.apply(SetLabel(mug, "cup of Ann"))
        assert engine.snapshot().body("mug") == msgspec.structs.replace(before, label="cup of Ann")
        engine.apply(SetLabel(mug, ""))
        assert engine.snapshot().body("mug").label is None
        with pytest.raises(BodyNotFoundError):
            engine.apply(SetLabel(BodyId("mugg"), "cup"))
        if Capability.SAVE in engine.capabilities:
            engine.apply(SetLabel(mug, "cup"))
            state = engine.save_state()
            engine.apply(SetLabel(mug, "glass"))
            engine.restore_state(state)
            assert engine.snapshot().body("mug").label == "cup"
        engine.apply(Delete((mug,)))
        engine.apply(Spawn(world(before)))
        assert engine.snapshot().body("mug").label == before.label, "a new body has its own label"

    def test_highlights_stay_until_they_are_removed(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        engine.highlight([BodyId("mug"), BodyId("door")], (1.0, 0.0, 0.0))
        engine.highlight([BodyId("mug")], (0.0, 1.0, 0.0))
        assert dict(engine.highlights()) == {"mug": (0.0, 1.0, 0.0), "door": (1.0, 0.0, 0.0)}
        engine.highlight([BodyId("door")], None)
        engine.apply(Delete((BodyId("mug"),)))
        assert dict(engine.highlights()) == {}

    def test_restoring_a_state_restores_all_bodies(self, engine: Engine) -> None:
        if Capability.SAVE not in engine.capabilities:
            pytest.skip("the engine has no SAVE capability")
        engine.apply(Spawn(room()))
        engine.step(0.3)
        state, snapshot, time_s = engine.save_state(), engine.snapshot(), engine.time_s
        engine.apply(SetPoses({BodyId("crate"): Pose((3, 3, 3))}))
        engine.apply(Delete((BodyId("mug"),)))
        engine.step(0.2)
        engine.restore_state(state)
        assert engine.time_s == time_s
        assert diff(snapshot, engine.snapshot()).identical(0.0)

    def test_a_fork_and_its_original_are_independent(self, engine: Engine) -> None:
        if Capability.FORK not in engine.capabilities:
            pytest.skip("the engine has no FORK capability")
        engine.apply(Spawn(room()))
        engine.highlight([BodyId("mug")], (1.0, 0.0, 0.0))
        before, time_s = engine.snapshot(), engine.time_s
        fork = engine.fork()
        assert diff(before, fork.snapshot()).identical(0.0)
        assert fork.time_s == time_s
        assert fork.highlights() == engine.highlights()
        fork.apply(SetPoses({BodyId("crate"): Pose((3, 3, 3))}))
        fork.apply(SetPhysics(BodyId("fridge"), BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=9.0)))
        fork.highlight([BodyId("mug")], None)
        fork.apply(Delete((BodyId("mug"),)))
        fork.apply(Attach(BodyId("cabinet"), BodyId("fridge")))
        fork.apply(Spawn(world(body("mug", (4, 4, 1), (0.3, 0.3, 0.3), "dynamic", 1.0))))
        assert diff(before, engine.snapshot()).identical(0.0)
        assert engine.highlights() == {BodyId("mug"): (1.0, 0.0, 0.0)}
        forked = fork.snapshot()
        engine.apply(Delete((BodyId("crate"), BodyId("cabinet"))))
        engine.close()
        assert diff(forked, fork.snapshot()).identical(0.0)
        fork.step(0.1)
        assert fork.time_s == pytest.approx(time_s + 0.1, abs=1e-6)
        fork.clear()
        assert fork.apply(Spawn(room())).report.ok

    def test_clearing_removes_everything_and_spawning_again_works(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        engine.clear()
        assert engine.snapshot().bodies == ()
        assert engine.apply(Spawn(room())).report.ok

    def test_time_advances_by_the_requested_duration(self, engine: Engine) -> None:
        engine.apply(Spawn(world(FLOOR)))
        for _ in range(300):
            engine.step(1 / 60)
        assert engine.time_s == pytest.approx(5.0, abs=0.01)

    def test_closing_twice_is_harmless_and_later_calls_are_refused(self, engine: Engine) -> None:
        engine.close()
        engine.close()
        with pytest.raises(EngineClosedError):
            engine.snapshot()

    def test_the_ids_of_poses_are_the_same_object_until_a_body_is_added(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        assert engine.poses()[0] is engine.poses()[0]


class PhysicsContract(DescriptionContract):
    """The contract of engines that simulate physics."""

    attachment_tolerance = 1e-6
    """Maximum change of rigid attachments, and of bodies that nothing touches, while time passes [m, rad]."""
    limit_tolerance_m = 0.001
    limit_tolerance_rad = np.radians(0.5)
    rest_tolerance_m = 0.002

    # -- joints that mimic others

    @pytest.mark.parametrize("multiplier", [1.0, -0.5])
    def test_a_joint_that_mimics_another_one_moves_with_it(self, engine: Engine, multiplier: float) -> None:
        engine.apply(Spawn(gripper(multiplier)))
        apply_force_for(engine, "left", (8.0, 0.0, 0.0), 0.6)
        engine.step(0.5)
        left, right = (float(current_pose(engine, id)[0]) for id in ("left", "right"))
        assert left > 0.1
        assert right == pytest.approx(multiplier * left, abs=0.005)
        assert float(current_pose(engine, "tip")[0]) == pytest.approx(right, abs=self.attachment_tolerance)

    def test_a_joint_that_mimics_none_that_exists_moves_independently_which_is_noted(self, engine: Engine) -> None:
        lost = world(*(part for part in (*gripper(1.0).bodies, gripper(1.0).joints[1])))
        report = engine.apply(Spawn(lost)).report
        assert report.ok
        assert any("moves independently" in note.text for note in report.notes if note.kind is SpawnNoteKind.JOINT)

    # -- bodies

    def test_a_dropped_body_rests_on_the_floor(self, engine: Engine) -> None:
        engine.apply(Spawn(world(FLOOR, body("box", (0, 0, 1), (0.2, 0.2, 0.2), "dynamic", 1.0))))
        engine.step(3.0)
        np.testing.assert_allclose(current_pose(engine, "box")[:3], (0, 0, 0.1), atol=self.rest_tolerance_m)
        before = current_pose(engine, "box")
        engine.step(2.0)
        assert displacement(engine, "box", before) < 1e-4

    def test_a_static_body_stays_whatever_hits_it(self, engine: Engine) -> None:
        shelf = body("shelf", (0, 0, 1), (1, 1, 0.05), mass=1.0)
        engine.apply(Spawn(world(FLOOR, shelf, body("anvil", (0.4, 0, 2), (0.3, 0.3, 0.3), "dynamic", 80.0))))
        engine.apply_force(BodyId("shelf"), (1000.0, 0.0, 0.0))
        engine.step(2.0)
        assert displacement(engine, "shelf", np.array([0, 0, 1.0])) == 0.0

    def test_without_gravity_a_body_floats(self, engine: Engine) -> None:
        engine.apply(Spawn(world(FLOOR, body("balloon", (0, 0, 1), (0.2, 0.2, 0.2), "dynamic", 0.1, gravity=False))))
        engine.step(2.0)
        assert displacement(engine, "balloon", np.array([0, 0, 1.0])) < self.attachment_tolerance

    def test_a_kinematic_body_does_not_fall_and_pushes_others(self, engine: Engine) -> None:
        engine.apply(
            Spawn(
                world(
                    FLOOR,
                    body("pusher", (0, 0, 0.25), (0.1, 0.5, 0.3), "kinematic"),
                    body("box", (0.3, 0, 0.1), (0.2, 0.2, 0.2), "dynamic", 1.0),
                )
            )
        )
        engine.step(0.5)
        assert displacement(engine, "pusher", np.array([0, 0, 0.25])) == 0.0
        for step in range(1, 41):
            engine.apply(SetPoses({BodyId("pusher"): Pose((0.01 * step, 0, 0.25))}))
            engine.step(0.02)
        assert current_pose(engine, "pusher")[0] == pytest.approx(0.4)
        assert current_pose(engine, "box")[0] > 0.5

    def test_a_force_accelerates_the_given_mass(self, engine: Engine) -> None:
        engine.apply(Spawn(world(body("puck", (0, 0, 0), (0.2, 0.2, 0.2), "dynamic", 2.5, gravity=False))))
        for _ in range(50):
            engine.apply_force(BodyId("puck"), (5.0, 0.0, 0.0))
            engine.step(0.02)
        assert current_pose(engine, "puck")[0] == pytest.approx(0.5 * (5.0 / 2.5) * 1.0**2, rel=0.01)

    @pytest.mark.parametrize("mass", [None, 0.0])
    def test_a_dynamic_body_without_mass_gets_a_reported_estimate(self, engine: Engine, mass: float | None) -> None:
        report = engine.apply(Spawn(world(FLOOR, body("box", (0, 0, 0.5), (0.5, 0.5, 0.5), "dynamic", mass)))).report
        assert [note.ids for note in report.notes if note.kind is SpawnNoteKind.MASS_ESTIMATED] == [("box",)]
        engine.step(1.0)
        assert engine.snapshot().body("box").physics.mass_kg == mass  # a snapshot has described values, not estimates

    # -- joints

    def drawer(self, engine: Engine, **more: object) -> None:
        report = engine.apply(
            Spawn(
                world(
                    FLOOR,
                    body("case", (0, 0, 0.5), (0.6, 0.6, 1.0)),
                    body("drawer", (0, 0, 0.5), (0.58, 0.5, 0.2), "dynamic", 5.0),
                    prismatic_joint("slide", "case", "drawer", (0.3, 0, 0.5), **more),
                )
            )
        ).report
        assert report.ok

    @pytest.mark.parametrize("direction", [1, -1])
    def test_a_pushed_drawer_slides_to_its_limit_and_not_beyond(self, engine: Engine, direction: int) -> None:
        self.drawer(engine)
        for _ in range(300):
            engine.apply_force(BodyId("drawer"), (40.0 * direction, 5.0, 0.0))
            engine.step(0.01)
        pose = current_pose(engine, "drawer")
        assert abs(pose[0] - direction * LIMIT_M) < self.limit_tolerance_m
        assert np.abs(pose[1:3] - (0, 0.5)).max() < 0.001
        assert quat_angle(pose[3:], [1, 0, 0, 0]) < self.limit_tolerance_rad

    def test_a_drawer_slides_along_its_rotated_joint_frame(self, engine: Engine) -> None:
        self.drawer(engine, quaternion=(0.7071067811865476, 0.0, 0.0, 0.7071067811865476))
        apply_force_for(engine, "drawer", (30.0, 40.0, 0.0), 3.0)
        np.testing.assert_allclose(current_pose(engine, "drawer")[:3], (0, LIMIT_M, 0.5), atol=self.limit_tolerance_m)

    def test_an_open_drawer_stays_open(self, engine: Engine) -> None:
        self.drawer(engine)
        apply_force_for(engine, "drawer", (30.0, 0.0, 0.0), 0.2)
        engine.step(1.0)
        before = current_pose(engine, "drawer")
        assert 0.005 < before[0] < LIMIT_M
        engine.step(5.0)
        assert displacement(engine, "drawer", before) < 0.001

    def test_a_fridge_door_swings_to_its_limit_when_its_handle_is_pulled(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        start = current_pose(engine, "door")
        apply_force_for(engine, "door_handle", (25.0, 0.0, 0.0), 4.0)
        angle = quat_angle(current_pose(engine, "door")[3:], start[3:])
        assert abs(angle - LIMIT_RAD) < self.limit_tolerance_rad

    def test_a_handle_moves_rigidly_with_its_door(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        door, handle = current_pose(engine, "door"), current_pose(engine, "door_handle")
        offset = handle[:3] - door[:3]
        apply_force_for(engine, "door_handle", (25.0, 0.0, 0.0), 1.5)
        door, handle = current_pose(engine, "door"), current_pose(engine, "door_handle")
        assert quat_angle(door[3:], [1, 0, 0, 0]) > 0.1
        np.testing.assert_allclose(handle[:3], door[:3] + quat_rotate(door[3:], offset), atol=self.attachment_tolerance)
        assert quat_angle(door[3:], handle[3:]) < self.attachment_tolerance

    def test_a_mug_in_a_drawer_moves_with_it(self, engine: Engine) -> None:
        report = engine.apply(Spawn(room())).report
        assert any(note.kind is SpawnNoteKind.HOLLOW and note.ids[0] == "drawer" for note in report.notes)
        start = current_pose(engine, "mug")
        apply_force_for(engine, "drawer_handle", (15.0, 0.0, 0.0), 4.0)
        engine.step(1.0)
        drawer, mug = current_pose(engine, "drawer"), current_pose(engine, "mug")
        assert drawer[0] == pytest.approx(LIMIT_M, abs=self.limit_tolerance_m)
        assert abs(mug[0] - drawer[0]) < 0.29 - 0.04
        assert abs(mug[1] - drawer[1]) < 0.275 - 0.04
        assert mug[2] == pytest.approx(start[2], abs=0.01)

    @pytest.mark.parametrize("gap", [0.001, 0.0, -0.001])
    def test_drawers_open_past_adjacent_bodies(self, engine: Engine, gap: float) -> None:
        """Maps are accurate to a millimeter: two drawers, one above the other, and a cupboard beside them."""
        parts: list[Body | Joint] = [FLOOR, body("case", (0, 0, 0.5), (0.6, 0.6, 1.0))]
        for name, z in (("low", 0.4), ("high", 0.6 + gap)):
            parts += [
                body(name, (0.01, 0, z), (0.58, 0.5, 0.2), "dynamic", 5.0),
                prismatic_joint(f"{name}_slide", "case", name, (0.3, 0, z)),
            ]
        engine.apply(Spawn(world(*parts, body("cupboard", (0.01, 0.5 + gap, 0.5), (0.6, 0.5, 1.0)))))
        for name in ("low", "high"):
            apply_force_for(engine, name, (25.0, 0.0, 0.0), 2.0)
            assert current_pose(engine, name)[0] == pytest.approx(0.01 + LIMIT_M, abs=self.limit_tolerance_m)

    def test_a_joint_with_swapped_parent_and_child_works_the_same(self, engine: Engine) -> None:
        engine.apply(
            Spawn(
                world(
                    FLOOR,
                    body("case", (0, 0, 0.5), (0.6, 0.6, 1.0)),
                    body("drawer", (0, 0, 0.5), (0.58, 0.5, 0.2), "dynamic", 5.0),
                    prismatic_joint("slide", "drawer", "case", (0.3, 0, 0.5)),
                )
            )
        )
        apply_force_for(engine, "drawer", (40.0, 0.0, 0.0), 3.0)
        np.testing.assert_allclose(current_pose(engine, "drawer")[:3], (LIMIT_M, 0, 0.5), atol=self.limit_tolerance_m)
        assert displacement(engine, "case", np.array([0, 0, 0.5])) == 0.0

    def test_a_locked_joint_holds(self, engine: Engine) -> None:
        engine.apply(
            Spawn(
                world(
                    FLOOR,
                    body("wall", (0, 0, 1), (0.1, 1, 2)),
                    body("shelf", (0.3, 0, 1), (0.4, 0.8, 0.04), "dynamic", 3.0),
                    fixed_joint("screw", "wall", "shelf", (0.05, 0, 1)),
                    body("box", (0.35, 0, 1.3), (0.2, 0.2, 0.2), "dynamic", 5.0),
                )
            )
        )
        engine.step(3.0)
        assert displacement(engine, "shelf", np.array([0.3, 0, 1.0])) < 0.001
        assert current_pose(engine, "box")[2] == pytest.approx(1.12, abs=0.005)

    def test_a_joint_that_constrains_nothing_changes_nothing(self, engine: Engine) -> None:
        """As floating joints in descriptions of robots and places, of which each thing has one to the root."""
        table, cup = (
            body("table", (0, 0, 0.4), (1.0, 1.0, 0.8)),
            body("cup", (0.2, 0, 0.85), (0.1, 0.1, 0.1), "dynamic", 0.3),
        )
        slab = body("slab", (0, 0, 1.0), (0.5, 0.5, 0.1), "dynamic", 1.0)
        floating = [
            msgspec.structs.replace(fixed_joint(f"of_{id}", "table", id, (0, 0, 0)), linear=ALL_FREE, angular=NO_LIMITS)
            for id in ("cup", "slab")
        ]
        engine.apply(Spawn(world(FLOOR, table, cup, slab, *floating)))
        engine.step(2.0)
        assert displacement(engine, "cup", np.array([0.2, 0, 0.85])) < 0.002
        assert current_pose(engine, "slab")[2] > 0.85

    def test_a_joint_connects_two_dynamic_bodies(self, engine: Engine) -> None:
        engine.apply(
            Spawn(
                world(
                    FLOOR,
                    body("heavy", (0, 0, 2), (0.4, 0.4, 0.4), "dynamic", 10.0),
                    body("light", (0.45, 0, 2), (0.4, 0.2, 0.2), "dynamic", 1.0),
                    revolute_joint("pin", "light", "heavy", (0.2, 0, 2)),
                )
            )
        )
        engine.step(2.0)
        heavy, light = current_pose(engine, "heavy"), current_pose(engine, "light")
        pin_of_heavy = heavy[:3] + quat_rotate(heavy[3:], [0.2, 0, 0])
        pin_of_light = light[:3] + quat_rotate(light[3:], [-0.25, 0, 0])
        assert np.linalg.norm(pin_of_heavy - pin_of_light) < 0.001
        assert heavy[2] < 0.3

    def test_a_second_joint_on_a_body_holds_too(self, engine: Engine) -> None:
        engine.apply(
            Spawn(
                world(
                    FLOOR,
                    body("left", (0, 1, 1), (0.2, 0.2, 0.2)),
                    body("right", (0, -1, 1), (0.2, 0.2, 0.2)),
                    body("bar", (0, 0, 1), (0.1, 1.7, 0.1), "dynamic", 3.0),
                    fixed_joint("a", "left", "bar", (0, 0.9, 1)),
                    fixed_joint("b", "right", "bar", (0, -0.9, 1)),
                )
            )
        )
        apply_force_for(engine, "bar", (50.0, 0.0, 0.0), 1.0)
        assert displacement(engine, "bar", np.array([0, 0, 1.0])) < 0.002

    # -- overlaps

    def test_overlapping_bodies_do_not_explode_and_are_reported(self, engine: Engine) -> None:
        boxes = [body(f"box{i}", (0.03 * i, 0.02 * i, 0.3), (0.4, 0.4, 0.6), "dynamic", 5.0) for i in range(12)]
        report = engine.apply(Spawn(world(FLOOR, *boxes))).report
        pairs = [
            pair for note in report.notes if note.kind is SpawnNoteKind.OVERLAP for pair in overlap_pairs(note.ids)
        ]
        assert len(set(pairs)) == len(pairs) == 12 * 11 / 2
        engine.step(3.0)
        for i, box in enumerate(boxes):
            assert displacement(engine, f"box{i}", np.array(box.pose.position)) < 0.01

    def test_an_enclosure_collides_with_nothing_and_is_reported(self, engine: Engine) -> None:
        shell = body("walls", (0, 0, 1.5), (8, 8, 3.2))
        report = engine.apply(Spawn(msgspec.structs.replace(room(), bodies=(*room().bodies, shell)))).report
        assert [note.ids[0] for note in report.notes if note.kind is SpawnNoteKind.ENCLOSURE] == ["walls"]
        engine.step(2.0)
        assert current_pose(engine, "crate")[2] == pytest.approx(0.15, abs=self.rest_tolerance_m)

    def test_bodies_that_only_touch_still_collide(self, engine: Engine) -> None:
        report = engine.apply(
            Spawn(
                world(
                    FLOOR,
                    body("table", (0, 0, 0.35), (1, 1, 0.7)),
                    body("mug", (0, 0, 0.75), (0.1, 0.1, 0.1), "dynamic", 0.3),
                )
            )
        ).report
        assert not [note for note in report.notes if note.kind is SpawnNoteKind.OVERLAP]
        engine.step(2.0)
        assert displacement(engine, "mug", np.array([0, 0, 0.75])) < self.rest_tolerance_m

    # -- rest

    def test_a_cup_12_mm_deep_in_a_table_rests_on_it_and_keeps_its_pose_in_snapshots(self, engine: Engine) -> None:
        table = body("table", (0, 0, 0.35), (1, 1, 0.7))
        spawned = world(FLOOR, table, body("cup", (0.1, 0.2, 0.738), (0.08, 0.08, 0.1), "dynamic", 0.3))
        report = engine.apply(Spawn(spawned)).report
        assert notes_of(report, SpawnNoteKind.EMBEDDED) == [("cup", "table")]
        assert not notes_of(report, SpawnNoteKind.OVERLAP)
        engine.step(2.0)
        assert np.allclose(current_pose(engine, "cup")[:3], (0.1, 0.2, 0.75), atol=self.rest_tolerance_m)
        assert diff(spawned, engine.snapshot()).identical(0.0)

    @pytest.mark.parametrize("yaw_rad", [0.0, 0.4])
    def test_a_box_half_in_the_floor_is_lifted_out_of_it(self, engine: Engine, yaw_rad: float) -> None:
        turned = (float(np.cos(yaw_rad / 2)), 0.0, 0.0, float(np.sin(yaw_rad / 2)))
        box = body("box", (0, 0, 0.0), (0.4, 0.3, 0.5), "dynamic", 2.0, quaternion=turned)
        report = engine.apply(Spawn(world(FLOOR, box))).report
        (note,) = [note for note in report.notes if note.kind is SpawnNoteKind.SETTLED]
        assert note.ids == ("box", "floor")
        assert "250 mm" in note.text
        assert diff(world(FLOOR, box), engine.snapshot()).identical(0.0), "nothing was simulated yet"
        engine.step(2.0)
        assert np.allclose(current_pose(engine, "box")[:3], (0, 0, 0.25), atol=self.rest_tolerance_m)
        assert engine.snapshot().body("box").pose.position[2] == pytest.approx(0.25, abs=self.rest_tolerance_m)

    def test_what_stands_on_a_lifted_table_is_lifted_with_it(self, engine: Engine) -> None:
        table = body("table", (0, 0, 0.2), (1, 1, 0.7), "dynamic", 20.0)
        cup = body("cup", (0.2, 0, 0.6), (0.08, 0.08, 0.1), "dynamic", 0.3)
        engine.apply(Spawn(world(FLOOR, table, cup)))
        engine.step(2.0)
        assert current_pose(engine, "table")[2] == pytest.approx(0.35, abs=self.rest_tolerance_m)
        assert current_pose(engine, "cup")[2] == pytest.approx(0.75, abs=2 * self.rest_tolerance_m)

    def test_a_body_stuck_in_fixed_ones_stays_and_is_reported(self, engine: Engine) -> None:
        block = body("block", (0, 0, 2.0), (4, 4, 4))
        lamp = body("lamp", (0, 0, 2.0), (0.2, 0.2, 2.0), "dynamic", 1.0)
        solid = geometry(box_shape((-2.0, -2.0, -2.0), (2.0, 2.0, 1.99)))
        report = engine.apply(Spawn(world(FLOOR, block, lamp), geometry={BodyId("block"): solid})).report
        engine.step(1.0)
        assert displacement(engine, "lamp", np.array([0, 0, 2.0])) < 1e-3
        assert any("stuck" in note.text for note in report.notes if "lamp" in note.ids)

    def test_what_is_added_inside_an_arm_is_solid_as_soon_as_that_was_out_of_it(self, engine: Engine) -> None:
        """The tip of the arm, 0.3 m before its middle, begins 3 cm behind the face of the block."""
        rail, arm = body("rail", (0, 0, 0.2), (0.1,) * 3), body("arm", (0, 0, 0.5), (0.6, 0.04, 0.04), "dynamic", 1.0)
        engine.apply(Spawn(world(rail, arm, prismatic_joint("slide", "rail", "arm", (0, 0, 0.5)))))
        report = engine.apply(Spawn(world(body("block", (0.37, 0, 0.5), (0.2, 0.2, 0.2))))).report
        assert any("do not collide" in note.text for note in report.notes)
        apply_force_for(engine, "arm", (8.0, 0.0, 0.0), 0.5)
        assert current_pose(engine, "arm")[0] > 0.02
        apply_force_for(engine, "arm", (-8.0, 0.0, 0.0), 1.0)
        engine.step(0.3)
        assert current_pose(engine, "arm")[0] < -0.04
        apply_force_for(engine, "arm", (8.0, 0.0, 0.0), 1.5)
        assert current_pose(engine, "arm")[0] == pytest.approx(-0.03, abs=0.005)

    def test_an_immovable_body_stays_and_keeps_its_described_mobility(self, engine: Engine) -> None:
        wall = body("wall", (0, 0, 1.5), (0.2, 4, 3), "dynamic", 500.0)
        engine.apply(Spawn(world(wall), immovable=frozenset({BodyId("wall")})))
        engine.step(0.5)
        assert displacement(engine, "wall", np.array([0, 0, 1.5])) < self.placement_tolerance
        assert diff(world(wall), engine.snapshot()).identical(0.0)
        engine.apply(SetPhysics(BodyId("wall"), BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=500.0)))
        engine.step(0.5)
        assert current_pose(engine, "wall")[2] < 1.0

    def test_bodies_with_nothing_below_them_fall_to_a_reported_ground(self, engine: Engine) -> None:
        table = body("table", (0, 0, 0.35), (1, 1, 0.7))
        boxes = [body(f"box{x}", (x, 0, 0.8), (0.2, 0.2, 0.2), "dynamic", 1.0) for x in (2, 3)]
        cup = body("cup", (0, 0, 0.75), (0.1, 0.1, 0.1), "dynamic", 0.2)
        spawned = world(table, cup, *boxes)
        report = engine.apply(Spawn(spawned, ground=True)).report
        assert notes_of(report, SpawnNoteKind.GROUND) == [("box2", "box3")]
        assert diff(spawned, engine.snapshot()).identical(0.0)
        engine.step(1.5)
        for box in boxes:
            assert current_pose(engine, box.id)[2] == pytest.approx(0.1, abs=self.rest_tolerance_m)
        assert current_pose(engine, "cup")[2] == pytest.approx(0.75, abs=self.rest_tolerance_m)

    def test_a_ground_above_something_else_ends_around_the_bodies_that_need_it(self, engine: Engine) -> None:
        floor = body("floor", (0, 0, -0.05), (6, 6, 0.1))
        valley = body("valley", (20, 0, -6.0), (10, 10, 0.2))
        mug, lost = (body(id, (x, 0, 0.1), (0.2, 0.2, 0.2), "dynamic", 0.5) for id, x in (("mug", 0), ("lost", -4)))
        stone = body("stone", (20, 0, 1.0), (0.2, 0.2, 0.2), "dynamic", 0.5)
        engine.apply(Spawn(world(floor, valley, mug, lost, stone), ground=True))
        engine.step(2.0)
        heights = {id: current_pose(engine, id)[2] for id in ("mug", "lost", "stone")}
        assert heights == pytest.approx({"mug": 0.1, "lost": 0.0, "stone": -5.8}, abs=2 * self.rest_tolerance_m)

    def test_a_ground_is_removed_when_a_floor_is_spawned(self, engine: Engine) -> None:
        engine.apply(Spawn(world(body("box", (0, 0, 1.0), (0.2, 0.2, 0.2), "dynamic", 1.0)), ground=True))
        assert not notes_of(engine.apply(Spawn(world(FLOOR), ground=True)).report, SpawnNoteKind.GROUND)
        engine.step(1.0)
        assert current_pose(engine, "box")[2] == pytest.approx(0.1, abs=self.rest_tolerance_m)

    def test_a_body_that_falls_out_of_the_place_is_stopped_and_reported_once(self, engine: Engine) -> None:
        engine.apply(Spawn(world(FLOOR, body("box", (30, 0, 0.5), (0.2, 0.2, 0.2), "dynamic", 1.0))))
        for _ in range(30):
            engine.step(0.1)
            engine.poses()
        height_m = current_pose(engine, "box")[2]
        engine.step(0.5)
        assert current_pose(engine, "box")[2] == pytest.approx(height_m, abs=1e-3)
        assert -14.0 < height_m < -10.0
        assert [note.ids for note in engine.notes if note.kind is SpawnNoteKind.STOPPED] == [("box",)]
        assert engine.snapshot().body("box").physics.mobility is Mobility.DYNAMIC

    def test_a_fall_is_measured_from_what_is_loose_and_ends_on_what_is_below(self, engine: Engine) -> None:
        """A street far below the place does not move the limit, and what falls onto it is not stopped before."""
        street = body("street", (20, 0, -40.0), (10, 10, 0.2))
        lost, caught = (
            body(id, (x, 0, 0.1), (0.2, 0.2, 0.2), "dynamic", 1.0) for id, x in (("lost", -9), ("caught", 20))
        )
        engine.apply(Spawn(world(body("floor", (0, 0, -0.05), (6, 6, 0.1)), street, lost, caught)))
        for _ in range(40):
            engine.step(0.1)
            engine.poses()
        assert -14.0 < current_pose(engine, "lost")[2] < -10.0
        assert current_pose(engine, "caught")[2] == pytest.approx(-39.8, abs=2 * self.rest_tolerance_m)

    # -- edits of a running world

    def running_room(self, engine: Engine) -> dict[str, np.ndarray]:
        """A room with an open drawer, a moving door and a crate at rest."""
        engine.apply(Spawn(room()))
        apply_force_for(engine, "drawer_handle", (20.0, 0.0, 0.0), 2.0)
        apply_force_for(engine, "door_handle", (25.0, 0.0, 0.0), 0.6)
        return {id: current_pose(engine, id) for id in engine.poses()[0]}

    def edits(self) -> Iterable[tuple[str, object]]:
        yield (
            "spawn",
            lambda engine: engine.apply(Spawn(world(body("new", (4, 4, 1), (0.2, 0.2, 0.2), "dynamic", 1.0)))).report,
        )
        yield "delete", lambda engine: engine.apply(Delete((BodyId("fridge"),)))
        yield "attach", lambda engine: engine.apply(Attach(BodyId("cabinet"), BodyId("fridge")))
        yield (
            "mass",
            lambda engine: engine.apply(
                SetPhysics(BodyId("crate"), BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=9.0))
            ),
        )
        yield "materials", lambda engine: engine.apply(SetMaterials(BodyId("crate"), (Material(name="oak"),)))
        yield "label", lambda engine: engine.apply(SetLabel(BodyId("crate"), "box"))
        yield "static pose", lambda engine: engine.apply(SetPoses({BodyId("floor"): Pose((0, 0, -0.0500001))}))

    @pytest.mark.parametrize("edit", ["spawn", "delete", "attach", "mass", "materials", "label", "static pose"])
    def test_an_edit_keeps_all_other_poses_and_velocities(self, engine: Engine, edit: str) -> None:
        before = self.running_room(engine)
        door_before = current_pose(engine, "door")
        engine.step(0.01)
        speed_before = displacement(engine, "door", door_before)
        poses = {id: current_pose(engine, id) for id in before}
        dict(self.edits())[edit](engine)  # type: ignore[operator]
        for id in set(poses) & set(engine.poses()[0]) - {"floor"}:
            assert displacement(engine, id, poses[id]) < self.attachment_tolerance, id
        if edit != "delete":
            engine.step(0.01)
            assert displacement(engine, "door", poses["door"]) == pytest.approx(speed_before, rel=0.2, abs=1e-5)
        engine.step(0.5)
        assert displacement(engine, "drawer", before["drawer"]) < 0.002
        assert displacement(engine, "crate", before["crate"]) < 0.002

    def test_a_body_in_flight_keeps_its_velocity_through_an_edit(self, engine: Engine) -> None:
        engine.apply(Spawn(world(FLOOR, body("ball", (0, 0, 5), (0.1, 0.1, 0.1), "dynamic", 1.0))))
        engine.step(0.5)
        engine.apply(Spawn(world(body("other", (3, 0, 1), (0.1, 0.1, 0.1), "dynamic", 1.0))))
        engine.step(0.3)
        assert current_pose(engine, "ball")[2] == pytest.approx(5 - 0.5 * 9.81 * 0.8**2, abs=0.03)

    def test_a_mug_falls_when_its_table_is_deleted(self, engine: Engine) -> None:
        engine.apply(
            Spawn(
                world(
                    FLOOR,
                    body("table", (0, 0, 0.35), (1, 1, 0.7)),
                    body("mug", (0, 0, 0.75), (0.1, 0.1, 0.1), "dynamic", 0.3),
                )
            )
        )
        engine.step(3.0)
        engine.apply(Delete((BodyId("table"),)))
        engine.step(2.0)
        assert current_pose(engine, "mug")[2] == pytest.approx(0.05, abs=self.rest_tolerance_m)

    @pytest.mark.parametrize("mobility", ["static", "kinematic"])
    def test_a_mug_falls_when_its_table_is_moved_away(self, engine: Engine, mobility: str) -> None:
        engine.apply(
            Spawn(
                world(
                    FLOOR,
                    body("table", (0, 0, 0.35), (1, 1, 0.7), mobility),
                    body("mug", (0, 0, 0.75), (0.1, 0.1, 0.1), "dynamic", 0.3),
                )
            )
        )
        engine.step(3.0)
        engine.apply(SetPoses({BodyId("table"): Pose((5, 0, 0.35))}))
        engine.step(2.0)
        assert current_pose(engine, "mug")[2] == pytest.approx(0.05, abs=self.rest_tolerance_m)

    def test_a_drawer_whose_cabinet_is_deleted_falls_to_the_floor(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        engine.step(0.5)
        engine.apply(Delete((BodyId("cabinet"),)))
        engine.step(2.0)
        assert current_pose(engine, "drawer")[2] < 0.12

    def test_a_body_attached_to_a_door_swings_with_it_and_falls_when_detached(self, engine: Engine) -> None:
        note = body("note", (0.35, 2.1, 1.0), (0.004, 0.1, 0.1), "dynamic", 0.01)
        engine.apply(Spawn(msgspec.structs.replace(room(), bodies=(*room().bodies, note))))
        engine.apply(Attach(BodyId("door"), BodyId("note")))
        apply_force_for(engine, "door_handle", (25.0, 0.0, 0.0), 4.0)
        assert quat_angle(current_pose(engine, "note")[3:], [1, 0, 0, 0]) == pytest.approx(
            LIMIT_RAD, abs=self.limit_tolerance_rad
        )
        engine.apply(Detach(BodyId("note")))
        engine.step(2.0)
        assert current_pose(engine, "note")[2] < 0.1

    def test_set_pose_moves_a_joint_and_refuses_poses_beyond_its_limits(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        engine.apply(SetPoses({BodyId("drawer"): Pose((0.2, 0, 0.3))}))
        np.testing.assert_allclose(
            current_pose(engine, "drawer_handle")[:3], (0.52, 0, 0.3), atol=self.attachment_tolerance
        )
        for forbidden in [(0.6, 0, 0.3), (0.2, 0.1, 0.3)]:
            with pytest.raises(PoseUnreachableError, match="drawer_slide"):
                engine.apply(SetPoses({BodyId("drawer"): Pose(forbidden)}))
        np.testing.assert_allclose(current_pose(engine, "drawer")[:3], (0.2, 0, 0.3), atol=self.attachment_tolerance)

    def test_joint_positions_refer_to_the_parent_in_the_map(self, engine: Engine) -> None:
        if Capability.JOINTS not in engine.capabilities:
            pytest.skip("the engine has no JOINTS capability")
        self.drawer(engine)
        engine.apply(SetPoses({BodyId("drawer"): Pose((0.2, 0, 0.5))}))
        np.testing.assert_allclose(
            engine.joint_positions()[BodyId("slide")], (0.2, 0, 0, 0, 0, 0), atol=self.attachment_tolerance
        )

    def test_a_dynamic_body_made_static_stays_in_the_air(self, engine: Engine) -> None:
        engine.apply(Spawn(room()))
        engine.step(0.1)
        engine.apply(SetPhysics(BodyId("crate"), BodyPhysics(mobility=Mobility.STATIC)))
        before = current_pose(engine, "crate")
        engine.step(1.0)
        assert displacement(engine, "crate", before) < self.placement_tolerance

    def test_a_restored_world_continues_exactly_as_before(self, engine: Engine) -> None:
        if Capability.SAVE not in engine.capabilities:
            pytest.skip("the engine has no SAVE capability")
        self.running_room(engine)
        state = engine.save_state()
        engine.step(0.5)
        first = engine.poses()[1]
        engine.restore_state(state)
        engine.step(0.5)
        np.testing.assert_array_equal(engine.poses()[1], first)

    def test_a_fork_continues_exactly_as_its_original(self, engine: Engine) -> None:
        if Capability.FORK not in engine.capabilities:
            pytest.skip("the engine has no FORK capability")
        self.running_room(engine)
        engine.step(0.0017)  # less than a time step is left over
        engine.apply_force(BodyId("crate"), (30.0, 0.0, 5.0))
        forks = [engine.fork(), engine.fork().fork()]
        forks[1].apply(Spawn(world(body("new", (4, 4, 1), (0.2, 0.2, 0.2), "dynamic", 1.0))))
        forks[1].step(1.0)
        for each in (engine, forks[0]):
            each.step(0.0304)
            each.step(0.5)
        np.testing.assert_array_equal(engine.poses()[1], forks[0].poses()[1])
        assert engine.time_s == forks[0].time_s
        if Capability.JOINTS in engine.capabilities:
            assert engine.joint_positions() == forks[0].joint_positions()

    def test_contacts_carry_the_weight_of_a_body_at_rest(self, engine: Engine) -> None:
        if Capability.CONTACTS not in engine.capabilities:
            pytest.skip("the engine has no CONTACTS capability")
        lower = body("lower", (0, 0, 0.2), (0.4, 0.4, 0.4), "dynamic", 3.0)
        upper = body("upper", (0.05, 0, 0.5), (0.2, 0.2, 0.2), "dynamic", 2.0)
        engine.apply(Spawn(world(upper, FLOOR, lower)))
        for _ in range(30):  # forces are those of the last step, and nothing sleeps while it is touched
            engine.apply_force(BodyId("upper"), (0.0, 0.0, 1e-3))
            engine.step(0.02)
        contacts = {(each.a, each.b): each for each in engine.contacts()}
        assert set(contacts) == {("upper", "lower"), ("floor", "lower")}
        on_lower, on_floor = contacts[BodyId("upper"), BodyId("lower")], contacts[BodyId("floor"), BodyId("lower")]
        assert on_lower.force_n == pytest.approx(2.0 * 9.81, rel=0.02)
        assert on_floor.force_n == pytest.approx(5.0 * 9.81, rel=0.02)
        np.testing.assert_allclose(on_lower.normal, (0, 0, -1), atol=1e-3)
        np.testing.assert_allclose(on_floor.normal, (0, 0, 1), atol=1e-3)
        np.testing.assert_allclose(on_lower.position, (0.05, 0.0, 0.4), atol=5e-3)
        assert -1e-3 < on_lower.depth_m < 2e-3

    def test_a_contact_with_the_added_ground_has_no_second_body(self, engine: Engine) -> None:
        if Capability.CONTACTS not in engine.capabilities:
            pytest.skip("the engine has no CONTACTS capability")
        crate = body("crate", (0, 0, 0.2), (0.4, 0.4, 0.4), "dynamic", 3.0)
        engine.apply(Spawn(world(crate), ground=True))
        engine.step(0.1)
        assert [(each.a, each.b) for each in engine.contacts()] == [("crate", None)]

    def test_scaled_mass_and_friction_change_the_motion_and_not_the_description(self, engine: Engine) -> None:
        if Capability.SCALE_DYNAMICS not in engine.capabilities:
            pytest.skip("the engine has no SCALE_DYNAMICS capability")
        crates = [body(f"crate{row}", (0, 2.0 * row, 0.2), (0.4, 0.4, 0.4), "dynamic", 2.0) for row in range(3)]
        engine.apply(Spawn(world(FLOOR, *crates)))
        engine.step(0.5)
        before, original = engine.snapshot(), engine.fork()
        heavy, slippery = BodyId("crate1"), BodyId("crate2")
        engine.scale_dynamics({heavy: DynamicsScale(mass=2.0)})
        engine.scale_dynamics({heavy: DynamicsScale(mass=4.0), slippery: DynamicsScale(friction=0.25)})
        assert diff(before, engine.snapshot()).identical(0.0)
        engine.apply(
            Spawn(world(body("new", (4, 4, 1), (0.2, 0.2, 0.2), "dynamic", 1.0)))
        )  # a new model keeps the factors
        start = {each.id: current_pose(engine, each.id) for each in crates}
        for _ in range(25):
            for each in crates:
                engine.apply_force(each.id, (25.0, 0.0, 0.0))
                original.apply_force(each.id, (25.0, 0.0, 0.0))
            engine.step(0.02)
            original.step(0.02)
        moved = {each.id: displacement(engine, each.id, start[each.id]) for each in crates}
        unscaled = {each.id: displacement(original, each.id, start[each.id]) for each in crates}
        assert moved["crate0"] == pytest.approx(unscaled["crate0"], rel=0.02)
        assert moved["crate1"] < 0.001 < 0.1 < unscaled["crate1"], "8 kg with a friction of 0.8 need 63 N"
        assert moved["crate2"] == pytest.approx((25.0 / 2.0 - 0.2 * 9.81) / 2 * 0.5**2, rel=0.05)
        for invalid in (0.0, -1.0, float("nan"), float("inf")):
            with pytest.raises(ValueError, match=r"mass .* above 0"):
                engine.scale_dynamics({heavy: DynamicsScale(mass=invalid)})
        with pytest.raises(BodyNotFoundError):
            engine.scale_dynamics({slippery: DynamicsScale(), BodyId("nothing"): DynamicsScale()})

    def test_an_undisturbed_room_stays_at_rest(self, engine: Engine) -> None:
        still: World = msgspec.structs.replace(room(), bodies=tuple(b for b in room().bodies if b.id != "crate"))
        engine.apply(Spawn(still))
        ids, before = engine.poses()
        engine.step(10.0)
        after = engine.poses()[1]
        assert np.isfinite(after).all()
        worst = np.linalg.norm(after[:, :3] - before[:, :3], axis=1)
        assert worst.max() < 0.01, ids[int(worst.argmax())]
