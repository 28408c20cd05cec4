"""Plans: what engines are told beyond the world, and that edits keep it true."""

from __future__ import annotations

import numpy as np

from mindstage.engines.planning import Planner
from mindstage.world import NO_FORMS, BodyId, Form, Mobility, Physics, World
from mindstage.world.geometry import Array, pose_array, rotate, unit_pose

from .forms_contract import furnished
from .scenes import FLOOR, body, hold, room, world

NOBODY = np.zeros((0, 7))


def planner_of(world: World, forms: dict[BodyId, Form] | None = None) -> tuple[Planner, Array]:
    """A planner, and where everything stands."""
    planner = Planner()
    planner.add(world, NOBODY, forms=forms or NO_FORMS)
    return planner, pose_array(body.pose for body in world.bodies)


def test_a_plan_names_every_body_with_what_of_it_can_be_touched() -> None:
    planner, _ = planner_of(room(), furnished())
    plan = planner.plan()
    assert set(plan.bodies) == {body.id for body in room().bodies}
    assert len(plan.bodies[BodyId("drawer")].solids) == 5
    assert len(plan.bodies[BodyId("mug")].solids) == 1
    assert plan.bodies[BodyId("mug")].mass_kg == 0.3


def test_a_plain_box_with_contents_is_planned_as_its_plates() -> None:
    planner, _ = planner_of(room())
    drawer = planner.plan().bodies[BodyId("drawer")]
    assert len(drawer.solids) == 5
    assert all(max(abs(c) for c in solid.pose.position) > 0 for solid in drawer.solids)


def test_what_hangs_on_something_is_told_by_its_top_and_where_it_is_there() -> None:
    knob = body("knob", (0.35, 0.1, 0.3), (0.02, 0.02, 0.02), "kinematic", 0.01)
    described = world(*room().bodies, knob, *room().constraints, *room().attachments, hold("drawer_handle", "knob"))
    planner, _ = planner_of(described)
    plan = planner.plan().bodies[BodyId("knob")]
    assert (plan.top, plan.mobility) == ("drawer", Mobility.DYNAMIC)
    np.testing.assert_allclose(plan.hold.position, (0.35, 0.1, 0.0), atol=1e-12)


def test_the_ends_of_a_constraint_and_all_that_hangs_there_are_apart() -> None:
    joined = {("cabinet", "drawer"), ("cabinet", "drawer_handle"), ("door", "fridge"), ("door_handle", "fridge")}
    plain, formed = (planner_of(room(), forms)[0].plan().apart for forms in ({}, furnished()))
    assert formed == joined
    assert plain == joined | {("cabinet", "mug")}, "the mug stands in the cabinet's box"


def test_a_joints_frames_lie_on_each_other() -> None:
    planner, where = planner_of(room())
    rows = {body.id: row for row, body in enumerate(room().bodies)}
    joint = planner.plan().joints[BodyId("door_hinge")]
    assert (joint.parent, joint.child, joint.loop) == ("fridge", "door", False)
    for id, frame in ((joint.parent, joint.of_parent), (joint.child, joint.of_child)):
        pose = where[rows[id]]
        seen = pose[:3] + rotate(pose[3:], unit_pose(frame)[:3])
        np.testing.assert_allclose(seen, (0.302, 2.3, 0.9), atol=1e-12)


def test_two_plans_of_the_same_are_equal_and_an_edit_changes_only_what_it_is_about() -> None:
    planner, where = planner_of(room(), furnished())
    before = planner.plan()
    assert planner.plan() == before
    planner.set_physics(BodyId("crate"), Physics(mobility=Mobility.DYNAMIC, mass_kg=9.0))
    planner.settle(where)
    after = planner.plan()
    changed = {id for id in after.bodies if after.bodies[id] != before.bodies[id]}
    assert changed == {"crate"}
    assert (after.apart, after.joints) == (before.apart, before.joints)


def test_a_copy_decides_on_its_own() -> None:
    planner, where = planner_of(room(), furnished())
    before, twin = planner.plan(), planner.copy()
    twin.remove([BodyId("fridge")])
    twin.settle(np.delete(where, [body.id for body in room().bodies].index(BodyId("fridge")), axis=0))
    assert BodyId("fridge") not in twin.plan().bodies
    assert planner.plan() == before


def test_what_was_removed_leaves_nothing_behind() -> None:
    planner, where = planner_of(room(), furnished())
    planner.remove(list(planner.inventory.ids))
    planner.settle(where[:0])
    plan = planner.plan()
    assert (dict(plan.bodies), plan.apart, dict(plan.joints)) == ({}, frozenset(), {})
    assert planner.add(world(FLOOR), NOBODY).ok
    assert not planner.forms
