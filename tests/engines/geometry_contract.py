"""The contract of engines for body geometry; an engine adds a subclass with an `engine` fixture (see `contract.py`)."""

from __future__ import annotations

import numpy as np
import pytest

from mindstage.engines import Capability, Engine, SpawnNoteKind, SpawnReport
from mindstage.scene import BodyGeometry, BodyId, BodyPhysics, CollisionShape, CollisionShapeType, Mobility, Pose, diff
from mindstage.scene.edits import Attach, Delete, Detach, SetPhysics, SetPoses, Spawn
from mindstage.scene.transforms import normalize, quat_angle, quat_rotate
from tests.engines.contract import apply_force_for, current_pose, displacement
from tests.engines.geometries import (
    as_vector,
    bin_geometry,
    box_shape,
    cabinet_geometry,
    geometry,
    single_shape_geometry,
    table_geometry,
    wedge_geometry,
)
from tests.engines.scenes import FLOOR, LIMIT_M, body, prismatic_joint, room, world

CRATE = (0.4, 0.4, 0.3)


def geometry_map(**geometries: BodyGeometry) -> dict[BodyId, BodyGeometry]:
    return {BodyId(id): body_geometry for id, body_geometry in geometries.items()}


def room_geometry() -> dict[BodyId, BodyGeometry]:
    """Geometry for `scenes.room`: a cabinet, a drawer for the mug, and a fridge with a shelf."""
    return geometry_map(
        cabinet=cabinet_geometry((0.6, 0.6, 1.0)),
        drawer=bin_geometry((0.58, 0.55, 0.2)),
        fridge=cabinet_geometry((0.6, 0.6, 1.8), shelves=(0.1,)),
    )


def ids_of_notes(report: SpawnReport, type: SpawnNoteKind) -> set[str]:
    return {id for note in report.notes if note.kind is type for id in note.ids}


class GeometryDescriptionContract:
    """The contract of all engines, with and without physics."""

    def test_a_snapshot_of_a_world_with_geometry_equals_the_spawned_world(self, engine: Engine) -> None:
        assert engine.apply(Spawn(room(), geometry=room_geometry())).report.ok
        assert diff(room(), engine.snapshot()).identical(0.0)

    def test_geometry_of_a_missing_body_is_ignored(self, engine: Engine) -> None:
        assert engine.apply(Spawn(world(FLOOR), geometry=geometry_map(ghost=bin_geometry(CRATE)))).report.ok
        assert engine.poses()[0] == ("floor",)


class GeometryContract(GeometryDescriptionContract):
    """The contract of engines that simulate physics."""

    rest_tolerance_m = 0.003
    limit_tolerance_m = 0.001

    # -- collision shapes

    def test_a_ball_dropped_into_an_open_box_rests_on_its_floor(self, engine: Engine) -> None:
        ball = body("ball", (0.05, 0.03, 0.6), (0.08, 0.08, 0.08), "dynamic", 0.2)
        engine.apply(
            Spawn(
                world(FLOOR, body("crate", (0, 0, 0.15), CRATE), ball),
                geometry=geometry_map(
                    crate=bin_geometry(CRATE), ball=single_shape_geometry(CollisionShapeType.SPHERE, (0.08, 0.08, 0.08))
                ),
            )
        )
        engine.step(3.0)
        assert current_pose(engine, "ball")[2] == pytest.approx(0.02 + 0.04, abs=self.rest_tolerance_m)

    def test_the_space_under_a_table_is_free(self, engine: Engine) -> None:
        report = engine.apply(
            Spawn(
                world(
                    FLOOR,
                    body("table", (0, 0, 0.35), (1.2, 0.8, 0.7)),
                    body("box", (0, 0, 0.1), (0.2, 0.2, 0.2), "dynamic", 1.0),
                    body("mug", (0, 0, 0.75), (0.08, 0.08, 0.1), "dynamic", 0.3),
                ),
                geometry=geometry_map(table=table_geometry((1.2, 0.8, 0.7))),
            )
        ).report
        assert not ids_of_notes(report, SpawnNoteKind.OVERLAP) | ids_of_notes(report, SpawnNoteKind.HOLLOW)
        apply_force_for(engine, "box", (0.0, 12.0, 0.0), 1.5)
        assert current_pose(engine, "box")[1] > 0.5
        assert current_pose(engine, "mug")[2] == pytest.approx(0.75, abs=self.rest_tolerance_m)

    @pytest.mark.parametrize(
        ("type", "size", "rotation", "height"),
        [
            (CollisionShapeType.CYLINDER, (0.2, 0.2, 0.1), (1.0, 0, 0, 0), 0.05),
            (CollisionShapeType.CYLINDER, (0.2, 0.2, 0.3), (0.7071067811865476, 0.7071067811865476, 0, 0), 0.1),
            (CollisionShapeType.SPHERE, (0.2, 0.2, 0.2), (1.0, 0, 0, 0), 0.1),
            (CollisionShapeType.BOX, (0.2, 0.2, 0.1), (0.7071067811865476, 0.7071067811865476, 0, 0), 0.1),
        ],
    )
    def test_each_type_of_collision_shape_rests_at_its_height(
        self,
        engine: Engine,
        type: CollisionShapeType,
        size: tuple[float, float, float],
        rotation: tuple[float, ...],
        height: float,
    ) -> None:
        item = body("thing", (0, 0, height + 0.05), size, "dynamic", 1.0, quaternion=rotation)
        engine.apply(Spawn(world(FLOOR, item), geometry=geometry_map(thing=single_shape_geometry(type, size))))
        engine.step(2.0)
        assert current_pose(engine, "thing")[2] == pytest.approx(height, abs=self.rest_tolerance_m)

    def test_a_hull_has_slopes(self, engine: Engine) -> None:
        size = (0.6, 0.4, 0.3)
        item = body("thing", (0.15, 0, 0.6), (0.1, 0.1, 0.1), "dynamic", 0.5)
        report = engine.apply(
            Spawn(
                world(FLOOR, body("ramp", (0, 0, 0.15), size), item),
                geometry=geometry_map(
                    ramp=wedge_geometry(size), thing=single_shape_geometry(CollisionShapeType.SPHERE, (0.1, 0.1, 0.1))
                ),
            )
        ).report
        assert report.ok
        engine.step(2.0)
        assert current_pose(engine, "thing")[0] < -0.3, "the ball did not roll down"

    def test_geometry_without_collision_shapes_collides_with_nothing(self, engine: Engine) -> None:
        engine.apply(
            Spawn(
                world(
                    FLOOR, body("light", (0, 0, 0.5), (1, 1, 0.1)), body("box", (0, 0, 1), (0.2,) * 3, "dynamic", 1.0)
                ),
                geometry=geometry_map(light=geometry()),
            )
        )
        engine.step(2.0)
        assert current_pose(engine, "box")[2] == pytest.approx(0.1, abs=self.rest_tolerance_m)

    def test_invalid_collision_shapes_are_left_out_and_reported(self, engine: Engine) -> None:
        broken = geometry(
            CollisionShape(size=(float("nan"), 1.0, 1.0)),
            box_shape((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1)),
            friction=float("nan"),
            density=-5.0,
        )
        box = body("box", (0, 0, 1), (0.2, 0.2, 0.2), "dynamic", 1.0)
        report = engine.apply(Spawn(world(FLOOR, box), geometry=geometry_map(box=broken))).report
        assert ids_of_notes(report, SpawnNoteKind.SHAPE) == {"box"}
        engine.step(2.0)
        assert current_pose(engine, "box")[2] == pytest.approx(0.1, abs=self.rest_tolerance_m)

    # -- collisions

    def test_boxes_that_overlap_only_as_boxes_still_collide(self, engine: Engine) -> None:
        """A crate inside the free half of another one: neither passes through the other."""
        small, large = (0.2, 0.2, 0.3), (0.6, 0.4, 0.3)
        report = engine.apply(
            Spawn(
                world(
                    FLOOR,
                    body("large", (0, 0, 0.15), large),
                    body("small", (0.05, 0, 0.17), small, "dynamic", 1.0),
                ),
                geometry=geometry_map(large=bin_geometry(large), small=bin_geometry(small)),
            )
        ).report
        assert not ids_of_notes(report, SpawnNoteKind.OVERLAP)
        apply_force_for(engine, "small", (15.0, 0.0, 0.0), 2.0)
        pose = current_pose(engine, "small")
        assert 0.1 < pose[0] < 0.22, "it tilts against the wall of the other crate and stops"
        assert pose[2] > 0.1

    def test_overlapping_collision_shapes_do_not_explode_and_are_reported(self, engine: Engine) -> None:
        report = engine.apply(
            Spawn(
                world(
                    body("one", (0, 0, 1), CRATE, "dynamic", 2.0, gravity=False),
                    body("two", (0.1, 0.1, 1.05), CRATE, "dynamic", 2.0, gravity=False),
                ),
                geometry=geometry_map(one=bin_geometry(CRATE), two=bin_geometry(CRATE)),
            )
        ).report
        assert ids_of_notes(report, SpawnNoteKind.OVERLAP) == {"one", "two"}
        engine.step(1.0)
        assert displacement(engine, "one", np.array([0, 0, 1.0])) < 1e-4

    def test_a_body_that_penetrates_its_support_is_pushed_out_and_reported(self, engine: Engine) -> None:
        """Maps place objects at the lower sides of boxes, but the floor of a container has a thickness."""
        mug = body("mug", (0, 0, 0.015 + 0.05), (0.08, 0.08, 0.1), "dynamic", 0.3)
        report = engine.apply(
            Spawn(
                world(FLOOR, body("crate", (0, 0, 0.15), CRATE), mug), geometry=geometry_map(crate=bin_geometry(CRATE))
            )
        ).report
        assert ids_of_notes(report, SpawnNoteKind.EMBEDDED) == {"mug", "crate"}
        assert not ids_of_notes(report, SpawnNoteKind.OVERLAP)
        engine.step(2.0)
        pose = current_pose(engine, "mug")
        assert pose[2] == pytest.approx(0.02 + 0.05, abs=self.rest_tolerance_m)
        assert abs(pose[0]) < 0.002
        assert abs(pose[1]) < 0.002

    def test_a_body_with_geometry_is_not_made_hollow(self, engine: Engine) -> None:
        report = engine.apply(Spawn(room(), geometry=room_geometry())).report
        assert not ids_of_notes(report, SpawnNoteKind.HOLLOW)
        assert "drawer" not in ids_of_notes(report, SpawnNoteKind.OVERLAP)

    # -- contents

    def test_a_mug_stays_in_its_drawer_while_it_opens_and_closes(self, engine: Engine) -> None:
        engine.apply(Spawn(room(), geometry=room_geometry()))
        engine.step(1.0)  # the mug is 2 cm above the drawer's floor
        for force, limit in ((15.0, LIMIT_M), (-15.0, -LIMIT_M)):
            apply_force_for(engine, "drawer_handle", (force, 0.0, 0.0), 4.0)
            engine.step(1.0)
            drawer, mug = current_pose(engine, "drawer"), current_pose(engine, "mug")
            assert drawer[0] == pytest.approx(limit, abs=self.limit_tolerance_m)
            assert abs(mug[0] - drawer[0]) < 0.29
            assert abs(mug[1] - drawer[1]) < 0.275
            assert 0.2 + 0.02 < mug[2] < 0.3

    def test_milk_stays_on_its_shelf_while_the_door_swings(self, engine: Engine) -> None:
        milk = body("milk", (0, 2, 1.1), (0.08, 0.08, 0.2), "dynamic", 1.0)
        described = world(*room().bodies, milk, *room().joints, *room().attachments)
        report = engine.apply(Spawn(described, geometry=room_geometry())).report
        assert not ids_of_notes(report, SpawnNoteKind.HOLLOW)
        apply_force_for(engine, "door_handle", (25.0, 0.0, 0.0), 4.0)
        assert quat_angle(current_pose(engine, "door")[3:], [1, 0, 0, 0]) > 0.7
        assert displacement(engine, "milk", np.array([0, 2, 1.1])) < self.rest_tolerance_m

    # -- mass

    def test_a_given_mass_takes_precedence_over_density(self, engine: Engine) -> None:
        crate = body("crate", (0, 0, 0), CRATE, "dynamic", 2.5, gravity=False)
        engine.apply(Spawn(world(crate), geometry=geometry_map(crate=bin_geometry(CRATE, density=700.0))))
        for _ in range(50):
            engine.apply_force(BodyId("crate"), (5.0, 0.0, 0.0))
            engine.step(0.02)
        assert current_pose(engine, "crate")[0] == pytest.approx(0.5 * (5.0 / 2.5) * 1.0**2, rel=0.01)
        assert quat_angle(current_pose(engine, "crate")[3:], [1, 0, 0, 0]) < 1e-3, (
            "the force was not applied at the center of mass"
        )

    def test_without_a_mass_density_determines_it(self, engine: Engine) -> None:
        crate = body("crate", (0, 0, 1), CRATE, "dynamic", None, gravity=False)
        report = engine.apply(
            Spawn(world(crate), geometry=geometry_map(crate=bin_geometry(CRATE, density=700.0)))
        ).report
        note = next(note for note in report.notes if note.kind is SpawnNoteKind.MASS_ESTIMATED)
        floor, ends, sides = 0.4 * 0.4 * 0.02, 0.02 * 0.4 * 0.28, 0.36 * 0.02 * 0.28
        mass = 700.0 * (floor + 2 * ends + 2 * sides)
        assert f"{mass:.3g} kg" in note.text
        for _ in range(50):
            engine.apply_force(BodyId("crate"), (2 * mass, 0.0, 0.0))
            engine.step(0.02)
        assert current_pose(engine, "crate")[0] == pytest.approx(1.0, rel=0.01)

    def test_a_body_tips_over_towards_its_center_of_mass(self, engine: Engine) -> None:
        """A base with a heavy arm: its bounding box would be stable, but the arm tips it over."""
        size = (0.6, 0.1, 0.4)
        arm = geometry(
            box_shape((-0.3, -0.05, -0.2), (-0.2, 0.05, 0.2)),
            box_shape((-0.2, -0.05, 0.1), (0.3, 0.05, 0.2)),
        )
        engine.apply(
            Spawn(world(FLOOR, body("arm", (0, 0, 0.201), size, "dynamic", 3.0)), geometry=geometry_map(arm=arm))
        )
        engine.step(2.0)
        assert quat_angle(current_pose(engine, "arm")[3:], [1, 0, 0, 0]) > 0.3

    # -- surfaces

    @pytest.mark.parametrize(("friction", "slides"), [(0.9, False), (0.2, True)])
    def test_a_box_slides_down_a_ramp_only_with_low_friction(
        self, engine: Engine, friction: float, slides: bool
    ) -> None:
        rotation = normalize([np.cos(np.radians(15)), 0.0, -np.sin(np.radians(15)), 0.0])  # 30 degrees
        up = quat_rotate(rotation, [0.0, 0.0, 0.02 + 0.05 + 0.0005])
        size = (2.0, 0.6, 0.04)
        engine.apply(
            Spawn(
                world(
                    body("ramp", (0, 0, 1), size, quaternion=tuple(rotation.tolist())),
                    body(
                        "box",
                        as_vector(up + np.array([0.0, 0.0, 1.0])),
                        (0.2, 0.2, 0.1),
                        "dynamic",
                        1.0,
                        quaternion=tuple(rotation.tolist()),
                    ),
                ),
                geometry=geometry_map(
                    ramp=single_shape_geometry(CollisionShapeType.BOX, size, friction=friction),
                    box=single_shape_geometry(CollisionShapeType.BOX, (0.2, 0.2, 0.1), friction=friction),
                ),
            )
        )
        before = current_pose(engine, "box")
        engine.step(0.5)
        distance = displacement(engine, "box", before)
        expected = 0.5 * 9.81 * (0.5 - friction * np.cos(np.radians(30))) * 0.5**2
        assert distance == pytest.approx(expected, rel=0.15) if slides else distance < 0.01

    def test_a_ball_bounces_by_its_restitution(self, engine: Engine) -> None:
        size = (0.1, 0.1, 0.1)
        balls = [body(name, (x, 0, 1.0), size, "dynamic", 0.2) for name, x in (("rubber", 0.0), ("clay", 1.0))]
        engine.apply(
            Spawn(
                world(FLOOR, *balls),
                geometry=geometry_map(
                    rubber=single_shape_geometry(CollisionShapeType.SPHERE, size, restitution=0.8),
                    clay=single_shape_geometry(CollisionShapeType.SPHERE, size, restitution=0.0),
                ),
            )
        )
        highest = dict.fromkeys(("rubber", "clay"), 0.0)
        engine.step((2 * 0.95 / 9.81) ** 0.5 + 0.1)  # both have hit the floor by now
        for _ in range(60):
            engine.step(0.01)
            highest = {id: max(height, float(current_pose(engine, id)[2])) for id, height in highest.items()}
        assert highest["rubber"] == pytest.approx(0.05 + 0.8**2 * 0.95, abs=0.1)
        assert highest["clay"] < 0.08

    # -- edits

    def test_geometry_moves_with_its_body_and_survives_edits(self, engine: Engine) -> None:
        ball = body("ball", (0, 0, 0.8), (0.08, 0.08, 0.08), "dynamic", 0.2)
        engine.apply(
            Spawn(
                world(
                    FLOOR, body("crate", (2, 0, 0.15), CRATE, "kinematic"), body("other", (5, 5, 1), (1, 1, 1)), ball
                ),
                geometry=geometry_map(
                    crate=bin_geometry(CRATE), ball=single_shape_geometry(CollisionShapeType.SPHERE, (0.08, 0.08, 0.08))
                ),
            )
        )
        engine.apply(SetPoses({BodyId("crate"): Pose((0, 0, 0.15))}))
        engine.apply(Delete((BodyId("other"),)))
        engine.apply(SetPhysics(BodyId("crate"), BodyPhysics(mobility=Mobility.STATIC)))
        engine.apply(Spawn(world(body("new", (6, 6, 1), (0.2, 0.2, 0.2), "dynamic", 1.0))))
        engine.apply(Attach(BodyId("floor"), BodyId("crate")))
        engine.apply(Detach(BodyId("crate")))
        engine.step(3.0)
        assert current_pose(engine, "ball")[2] == pytest.approx(0.06, abs=self.rest_tolerance_m)

    def test_restoring_a_state_restores_geometry(self, engine: Engine) -> None:
        if Capability.SAVE not in engine.capabilities:
            pytest.skip("the engine has no SAVE capability")
        engine.apply(Spawn(room(), geometry=room_geometry()))
        state = engine.save_state()
        engine.clear()
        engine.restore_state(state)
        apply_force_for(engine, "drawer_handle", (15.0, 0.0, 0.0), 4.0)
        drawer, mug = current_pose(engine, "drawer"), current_pose(engine, "mug")
        assert drawer[0] == pytest.approx(LIMIT_M, abs=self.limit_tolerance_m)
        assert abs(mug[0] - drawer[0]) < 0.29

    def test_a_respawned_body_has_its_new_geometry_or_none(self, engine: Engine) -> None:
        mug = body("mug", (0, 0, 0.8), (0.08, 0.08, 0.1), "dynamic", 0.3)
        crate = world(body("crate", (0, 0, 0.15), CRATE))
        engine.apply(Spawn(world(FLOOR)))
        for geometries, height in ((geometry_map(crate=bin_geometry(CRATE)), 0.07), ({}, 0.35)):
            engine.apply(Spawn(crate, geometry=geometries))
            engine.apply(Spawn(world(mug)))
            engine.step(2.0)
            assert current_pose(engine, "mug")[2] == pytest.approx(height, abs=self.rest_tolerance_m)
            engine.apply(Delete((BodyId("crate"), BodyId("mug"))))

    def test_an_undisturbed_room_with_geometry_stays_at_rest(self, engine: Engine) -> None:
        described = room()
        resting = [b for b in described.bodies if b.id not in {"crate", "mug"}]
        mug = body("mug", (0.05, 0.1, 0.271), (0.08, 0.08, 0.1), "dynamic", 0.3)
        engine.apply(Spawn(world(*resting, mug, *described.joints, *described.attachments), geometry=room_geometry()))
        ids, before = engine.poses()
        engine.step(10.0)
        worst = np.linalg.norm(engine.poses()[1][:, :3] - before[:, :3], axis=1)
        assert worst.max() < 0.01, ids[int(worst.argmax())]

    # -- adjacent furniture

    def test_drawers_without_a_gap_between_them_slide_past_each_other(self, engine: Engine) -> None:
        size = (0.55, 0.6, 0.2)
        case = body("case", (0, 0, 0.4), (0.57, 0.64, 0.64))
        drawers = [body(f"drawer{i}", (0.01, 0, 0.2 + 0.2 * i), size, "dynamic", 4.0) for i in range(3)]
        slides = [prismatic_joint(f"slide{i}", "case", f"drawer{i}", (0.0, 0, 0.2 + 0.2 * i)) for i in range(3)]
        geometries = geometry_map(case=cabinet_geometry((0.57, 0.64, 0.64))) | {
            BodyId(f"drawer{i}"): bin_geometry(size) for i in range(3)
        }
        engine.apply(Spawn(world(FLOOR, case, *drawers, *slides), geometry=geometries))
        for i in range(3):
            apply_force_for(engine, f"drawer{i}", (25.0, 0.0, 0.0), 2.0)
            assert current_pose(engine, f"drawer{i}")[0] == pytest.approx(0.01 + LIMIT_M, abs=self.limit_tolerance_m)

    def test_a_door_swings_although_its_neighbor_touches_it(self, engine: Engine) -> None:
        """The edge of a door with a hinge at its front moves outwards slightly when it turns."""
        panel = geometry(box_shape((-0.02, -0.3, -0.9), (0.02, 0.3, 0.9)))
        neighbor = body("neighbor", (0.322, 1.4, 0.9), (0.04, 0.6, 1.8))
        described = room()
        others = [b for b in described.bodies if b.id not in {"crate", "mug"}]
        parts = world(*others, neighbor, *described.joints, *described.attachments)
        engine.apply(Spawn(parts, geometry=room_geometry() | geometry_map(door=panel, neighbor=panel)))
        apply_force_for(engine, "door_handle", (25.0, 0.0, 0.0), 4.0)
        assert quat_angle(current_pose(engine, "door")[3:], [1, 0, 0, 0]) == pytest.approx(np.pi / 4, abs=0.01)
