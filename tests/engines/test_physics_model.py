"""Plans: what engines are told beyond the world, and that edits keep it true."""

from __future__ import annotations

import numpy as np

from mindstage.engines.physics_model import PhysicsModelBuilder
from mindstage.scene import NO_GEOMETRY, BodyGeometry, BodyId, BodyPhysics, Mobility, World
from mindstage.scene.transforms import Array, normalized_pose_array, pose_array, quat_rotate
from tests.engines.geometry_contract import room_geometry
from tests.engines.scenes import FLOOR, attachment, body, room, world

NOBODY = np.zeros((0, 7))


def planner_of(world: World, forms: dict[BodyId, BodyGeometry] | None = None) -> tuple[PhysicsModelBuilder, Array]:
    """A planner, and where everything stands."""
    planner = PhysicsModelBuilder()
    planner.add(world, NOBODY, geometry=forms or NO_GEOMETRY)
    return planner, pose_array(body.pose for body in world.bodies)


def test_a_model_has_every_body_with_its_collision_shapes() -> None:
    planner, _ = planner_of(room(), room_geometry())
    plan = planner.build_model()
    assert set(plan.bodies) == {body.id for body in room().bodies}
    assert len(plan.bodies[BodyId("drawer")].collision_shapes) == 5
    assert len(plan.bodies[BodyId("mug")].collision_shapes) == 1
    assert plan.bodies[BodyId("mug")].mass_kg == 0.3


def test_a_box_with_contents_is_modeled_as_wall_panels() -> None:
    planner, _ = planner_of(room())
    drawer = planner.build_model().bodies[BodyId("drawer")]
    assert len(drawer.collision_shapes) == 5
    assert all(max(abs(c) for c in solid.pose.position) > 0 for solid in drawer.collision_shapes)


def test_an_attached_body_has_a_root_and_a_pose_in_it() -> None:
    knob = body("knob", (0.35, 0.1, 0.3), (0.02, 0.02, 0.02), "kinematic", 0.01)
    described = world(*room().bodies, knob, *room().joints, *room().attachments, attachment("drawer_handle", "knob"))
    planner, _ = planner_of(described)
    plan = planner.build_model().bodies[BodyId("knob")]
    assert (plan.root, plan.mobility) == ("drawer", Mobility.DYNAMIC)
    np.testing.assert_allclose(plan.pose_in_root.position, (0.35, 0.1, 0.0), atol=1e-12)


def test_the_ends_of_a_joint_and_all_attached_bodies_are_excluded_pairs() -> None:
    joined = {("cabinet", "drawer"), ("cabinet", "drawer_handle"), ("door", "fridge"), ("door_handle", "fridge")}
    plain, formed = (planner_of(room(), forms)[0].build_model().excluded_pairs for forms in ({}, room_geometry()))
    assert formed == joined
    assert plain == joined | {("cabinet", "mug")}, "the mug stands in the cabinet's box"


def test_the_two_frames_of_a_joint_coincide() -> None:
    planner, where = planner_of(room())
    rows = {body.id: row for row, body in enumerate(room().bodies)}
    joint = planner.build_model().joints[BodyId("door_hinge")]
    assert (joint.parent, joint.child, joint.closes_loop) == ("fridge", "door", False)
    for id, frame in ((joint.parent, joint.parent_from_joint), (joint.child, joint.child_from_joint)):
        pose = where[rows[id]]
        seen = pose[:3] + quat_rotate(pose[3:], normalized_pose_array(frame)[:3])
        np.testing.assert_allclose(seen, (0.302, 2.3, 0.9), atol=1e-12)


def test_models_of_equal_worlds_are_equal_and_an_edit_changes_only_its_part() -> None:
    planner, where = planner_of(room(), room_geometry())
    before = planner.build_model()
    assert planner.build_model() == before
    planner.set_physics(BodyId("crate"), BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=9.0))
    planner.update_collisions(where)
    after = planner.build_model()
    changed = {id for id in after.bodies if after.bodies[id] != before.bodies[id]}
    assert changed == {"crate"}
    assert (after.excluded_pairs, after.joints) == (before.excluded_pairs, before.joints)


def test_a_copy_is_independent() -> None:
    planner, where = planner_of(room(), room_geometry())
    before, twin = planner.build_model(), planner.copy()
    twin.remove([BodyId("fridge")])
    twin.update_collisions(np.delete(where, [body.id for body in room().bodies].index(BodyId("fridge")), axis=0))
    assert BodyId("fridge") not in twin.build_model().bodies
    assert planner.build_model() == before


def test_removed_bodies_leave_nothing_behind() -> None:
    planner, where = planner_of(room(), room_geometry())
    planner.remove(list(planner.registry.ids))
    planner.update_collisions(where[:0])
    plan = planner.build_model()
    assert (dict(plan.bodies), plan.excluded_pairs, dict(plan.joints)) == ({}, frozenset(), {})
    assert planner.add(world(FLOOR), NOBODY).ok
    assert not planner.geometry
