"""The physics model of a world, and its updates by edits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mindstage.engines.physics_model import PhysicsModelBuilder, build_physics_model
from mindstage.scene import NO_GEOMETRY, BodyGeometry, BodyId, BodyPhysics, Mobility, World
from mindstage.scene.edits import SetPhysics, Spawn
from mindstage.scene.transforms import Array, normalized_pose_array, pose_array, quat_rotate
from tests.engines.geometry_contract import room_geometry
from tests.engines.scenes import FLOOR, attachment, body, room, world

NO_POSES = np.zeros((0, 7))


def builder_of(world: World, geometry: dict[BodyId, BodyGeometry] | None = None) -> tuple[PhysicsModelBuilder, Array]:
    """A builder for a world, and its poses."""
    builder = PhysicsModelBuilder()
    builder.apply(Spawn(world, geometry=geometry or NO_GEOMETRY), NO_POSES)
    return builder, pose_array(body.pose for body in world.bodies)


def test_a_model_has_every_body_with_its_collision_shapes() -> None:
    builder, _ = builder_of(room(), room_geometry())
    model = build_physics_model(builder)
    assert set(model.bodies) == {body.id for body in room().bodies}
    assert len(model.bodies[BodyId("drawer")].collision_shapes) == 5
    assert len(model.bodies[BodyId("mug")].collision_shapes) == 1
    assert model.bodies[BodyId("mug")].mass_kg == 0.3


def test_contact_properties_are_those_of_the_geometry() -> None:
    id = BodyId("drawer")
    rough = replace(room_geometry()[id], friction=0.35, restitution=0.4)
    model = build_physics_model(builder_of(room(), {**room_geometry(), id: rough})[0]).bodies[id]
    assert (model.friction, model.restitution) == (0.35, 0.4)
    plain = build_physics_model(builder_of(room())[0]).bodies[id]
    assert (plain.friction, plain.restitution) == (None, None), "those of the engine"


def test_a_box_with_contents_is_modeled_as_wall_panels() -> None:
    builder, _ = builder_of(room())
    drawer = build_physics_model(builder).bodies[BodyId("drawer")]
    assert len(drawer.collision_shapes) == 5
    assert all(max(abs(c) for c in shape.pose.position) > 0 for shape in drawer.collision_shapes)


def test_an_attached_body_has_a_root_and_a_pose_in_it() -> None:
    knob = body("knob", (0.35, 0.1, 0.3), (0.02, 0.02, 0.02), "kinematic", 0.01)
    described = world(*room().bodies, knob, *room().joints, *room().attachments, attachment("drawer_handle", "knob"))
    builder, _ = builder_of(described)
    model = build_physics_model(builder).bodies[BodyId("knob")]
    assert (model.root, model.mobility) == ("drawer", Mobility.DYNAMIC)
    np.testing.assert_allclose(model.pose_in_root.position, (0.35, 0.1, 0.0), atol=1e-12)


def test_the_ends_of_a_joint_and_all_attached_bodies_are_excluded_pairs() -> None:
    excluded = {("cabinet", "drawer"), ("cabinet", "drawer_handle"), ("door", "fridge"), ("door_handle", "fridge")}
    without_geometry, with_geometry = (
        build_physics_model(builder_of(room(), geometry)[0]).excluded_pairs for geometry in ({}, room_geometry())
    )
    assert with_geometry == excluded
    assert without_geometry == excluded | {("cabinet", "mug")}, "the mug is inside the box of the cabinet"


def test_the_two_frames_of_a_joint_coincide() -> None:
    builder, poses = builder_of(room())
    rows = {body.id: row for row, body in enumerate(room().bodies)}
    joint = build_physics_model(builder).joints[BodyId("door_hinge")]
    assert (joint.parent, joint.child, joint.closes_loop) == ("fridge", "door", False)
    for id, frame in ((joint.parent, joint.parent_from_joint), (joint.child, joint.child_from_joint)):
        pose = poses[rows[id]]
        seen = pose[:3] + quat_rotate(pose[3:], normalized_pose_array(frame)[:3])
        np.testing.assert_allclose(seen, (0.302, 2.3, 0.9), atol=1e-12)


def test_models_of_equal_worlds_are_equal_and_an_edit_changes_only_its_part() -> None:
    builder, poses = builder_of(room(), room_geometry())
    before = build_physics_model(builder)
    assert build_physics_model(builder) == before
    builder.apply(SetPhysics(BodyId("crate"), BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=9.0)), NO_POSES)
    builder.update_collisions(poses)
    after = build_physics_model(builder)
    changed = {id for id in after.bodies if after.bodies[id] != before.bodies[id]}
    assert changed == {"crate"}
    assert (after.excluded_pairs, after.joints) == (before.excluded_pairs, before.joints)


def test_a_copy_is_independent() -> None:
    builder, poses = builder_of(room(), room_geometry())
    before, copy = build_physics_model(builder), builder.copy()
    copy.remove([BodyId("fridge")])
    copy.update_collisions(np.delete(poses, [body.id for body in room().bodies].index(BodyId("fridge")), axis=0))
    assert BodyId("fridge") not in build_physics_model(copy).bodies
    assert build_physics_model(builder) == before


def test_removed_bodies_leave_nothing_behind() -> None:
    builder, poses = builder_of(room(), room_geometry())
    builder.remove(list(builder.registry.ids))
    builder.update_collisions(poses[:0])
    model = build_physics_model(builder)
    assert (dict(model.bodies), model.excluded_pairs, dict(model.joints)) == ({}, frozenset(), {})
    report = builder.apply(Spawn(world(FLOOR)), NO_POSES).report
    assert report.ok
    assert not builder.geometry


def test_a_model_has_the_contact_properties_of_the_geometry() -> None:
    geometry = {BodyId("crate"): replace(room_geometry()[BodyId("drawer")], friction=0.3, restitution=0.6)}
    model = build_physics_model(builder_of(room(), geometry)[0])
    crate, door = model.bodies[BodyId("crate")], model.bodies[BodyId("door")]
    assert (crate.friction, crate.restitution) == (0.3, 0.6)
    assert (door.friction, door.restitution) == (None, None)
