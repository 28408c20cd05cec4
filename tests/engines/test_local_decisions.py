"""Bodies that are added to a running world: decided with the bodies near them, as if with all of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mindstage.engines import physics_model
from mindstage.engines.base import SpawnNoteKind
from mindstage.engines.kinematic_tree import build_kinematic_forest
from mindstage.engines.physics_model import PhysicsModelBuilder
from mindstage.scene import Body, BodyId, BodyPhysics, Mobility, Pose, World
from mindstage.scene.edits import SetPhysics, Spawn
from mindstage.scene.transforms import normalize, pose_array
from tests.engines.scenes import attachment, body, prismatic_joint, world
from tests.kitchenette import kitchenette


def poses_of(builder: PhysicsModelBuilder) -> Any:
    poses = pose_array(each.pose for each in builder.registry.bodies.values())
    poses[:, 3:] = normalize(poses[:, 3:])
    return poses


def built(start: World, added: list[World], options: Mapping[str, bool] = {}) -> tuple[PhysicsModelBuilder, list[Any]]:
    """A builder to which worlds were added one after the other, and the reports."""
    builder = PhysicsModelBuilder()
    reports = [builder.apply(Spawn(start, **options), np.zeros((0, 7))).report]
    reports += [builder.apply(Spawn(each, **options), poses_of(builder)).report for each in added]
    return builder, reports


def decisions(builder: PhysicsModelBuilder) -> tuple[object, ...]:
    chosen = builder.collision_filter
    return chosen.excluded_pairs, chosen.non_colliding, chosen.wall_panels, chosen.contents


def by_kind(report: Any) -> list[tuple[str, frozenset[str]]]:
    """The notes; that on the ground without its bodies, which are the new ones only if a ground exists."""
    notes = ((note.kind, frozenset(note.ids)) for note in report.notes)
    return sorted((kind.value, frozenset() if kind is SpawnNoteKind.GROUND else ids) for kind, ids in notes)


def assert_same_as_with_all(start: World, added: list[World], options: Mapping[str, bool] = {}) -> PhysicsModelBuilder:
    local, local_reports = built(start, added, options)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(physics_model, "_MAX_LOCAL_BODIES", -1)
        whole, whole_reports = built(start, added, options)
    assert decisions(local) == decisions(whole)
    assert list(map(by_kind, local_reports)) == list(map(by_kind, whole_reports))
    local.order_forest()
    reference = build_kinematic_forest(local.registry, local.mass_properties.approximate_masses())
    assert list(local.forest.groups.items()) == list(reference.groups.items())
    assert local.forest.root_of == reference.root_of
    assert (
        local.loose_roots
        == {root for root, tree in reference.tree_roots().items() if reference.groups[tree].is_dynamic}
        == whole.loose_roots
    )
    assert local.settled.keys() == whole.settled.keys()
    assert (local.ground, local._below_ground) == (whole.ground, whole._below_ground)
    return local


def crowd() -> World:
    """A cabinet with two drawers, a shelf with an open box, and scattered blocks."""
    parts: list[Any] = [
        body("cabinet", (0.0, 0.0, 0.5), (0.6, 0.6, 1.0)),
        body("upper", (0.05, 0.0, 0.75), (0.5, 0.5, 0.3), "dynamic", 4.0),
        body("lower", (0.05, 0.0, 0.25), (0.5, 0.5, 0.3), "dynamic", 5.0),
        body("handle", (0.33, 0.0, 0.75), (0.04, 0.2, 0.04), "dynamic", 0.1),
        body("shelf", (2.0, 0.0, 0.5), (0.4, 1.0, 0.04)),
        body("box", (2.0, 0.0, 0.7), (0.38, 0.38, 0.36), "dynamic", 1.0),
        body("pearl", (2.0, 0.0, 0.65), (0.05, 0.05, 0.05), "dynamic", 0.02),
        prismatic_joint("upper_slide", "cabinet", "upper", (0.0, 0.0, 0.75)),
        prismatic_joint("lower_slide", "lower", "cabinet", (0.0, 0.0, 0.25)),
        attachment("upper", "handle"),
    ]
    parts += [body(f"block{n}", (4.0 + n, 1.0, 0.1), (0.2, 0.2, 0.2), "dynamic", 1.0) for n in range(8)]
    return world(*parts)


positions = st.tuples(st.floats(-0.5, 2.5), st.floats(-0.5, 0.5), st.floats(0.0, 1.2))
extents = st.tuples(*[st.floats(0.02, 1.5)] * 3)
turns = st.sampled_from([(1.0, 0.0, 0.0, 0.0), (0.7071, 0.0, 0.0, 0.7071), (0.9, 0.3, 0.1, 0.2)])
new_bodies = st.lists(
    st.tuples(positions, extents, st.sampled_from(["static", "dynamic", "kinematic"]), turns), min_size=1, max_size=5
)


@settings(max_examples=60, deadline=None)
@given(new_bodies, st.sampled_from([{}, {"ground": True}, {"settle": False}]))
def test_bodies_near_a_new_one_suffice_for_its_decisions(
    table: list[tuple[Any, Any, str, Any]], options: Mapping[str, bool]
) -> None:
    added = [
        world(body(f"new{number}", at, size, mobility, quaternion=turn))
        for number, (at, size, mobility, turn) in enumerate(table)
    ]
    assert_same_as_with_all(crowd(), added, options)


def test_a_box_among_jointed_drawers_becomes_hollow_on_the_right_side() -> None:
    """Which side is open depends on the drawers, which are not near the new item themselves."""
    start = crowd()
    tall = world(body("pearl2", (0.0, 0.2, 0.05), (0.04, 0.04, 0.04), "dynamic", 0.02))
    builder = assert_same_as_with_all(start, [tall])
    assert "pearl2" in builder.collision_filter.contents["cabinet"]


def test_a_second_item_in_a_hollow_body_keeps_the_first() -> None:
    item = world(body("pearl2", (2.1, 0.1, 0.65), (0.04, 0.04, 0.04), "dynamic", 0.02))
    builder = assert_same_as_with_all(crowd(), [item])
    assert set(builder.collision_filter.contents["box"]) == {"pearl", "pearl2"}


def test_a_body_that_is_attached_or_on_a_joint_is_decided_like_a_single_one() -> None:
    attached = world(body("cup", (2.0, 0.4, 0.57), (0.08, 0.08, 0.1), "dynamic", 0.2))
    attached = msgspec.structs.replace(attached, attachments=(attachment("shelf", "cup"),))
    door = world(body("door", (0.32, 0.0, 0.25), (0.02, 0.5, 0.3), "dynamic", 2.0))
    door = msgspec.structs.replace(door, joints=(prismatic_joint("door_slide", "cabinet", "door", (0.3, 0.0, 0.25)),))
    assert_same_as_with_all(crowd(), [attached, door])


def test_a_removed_body_can_be_added_again() -> None:
    builder, _ = built(crowd(), [])
    builder.remove([BodyId("pearl")])
    pearl = body("pearl", (2.0, 0.0, 0.65), (0.05, 0.05, 0.05), "dynamic", 0.02)
    builder.apply(Spawn(world(pearl)), poses_of(builder))
    assert builder.collision_filter.contents["box"] == ("pearl",)
    radii = builder.mass_properties.bounding_radii(builder.registry.ids)
    sizes = [each.size for each in builder.registry.bodies.values()]
    assert radii == pytest.approx(np.linalg.norm(sizes, axis=1) / 2)


def test_items_in_a_kitchen_are_decided_as_with_all_bodies() -> None:
    kitchen = kitchenette()
    items = [
        World(iri=kitchen.iri, bodies=(moved(each, f"{each.id}_{number}", number),))
        for number, each in enumerate(each for each in kitchen.bodies if each.physics.is_dynamic)
    ]
    assert_same_as_with_all(kitchen, items)


def moved(source: Body, id: str, number: int) -> Body:
    x, y, z = source.pose.position
    pose = Pose((x + 0.03 * number, y + 0.02, z + 0.01), source.pose.quaternion)
    return msgspec.structs.replace(source, id=BodyId(id), pose=pose)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(["remove", "static", "dynamic", "heavy"]), st.integers(0, 15)), max_size=6))
def test_the_forest_after_edits_is_the_one_of_the_remaining_bodies(edits: list[tuple[str, int]]) -> None:
    builder, _ = built(crowd(), [])
    for edit, number in edits:
        ids = builder.registry.ids
        id = ids[number % len(ids)]
        if edit == "remove":
            builder.remove([id])
        else:
            mobility = Mobility.DYNAMIC if edit == "heavy" else Mobility(edit)
            physics = BodyPhysics(mobility=mobility, mass_kg=50.0 if edit == "heavy" else None)
            builder.apply(SetPhysics(id, physics), poses_of(builder))
        builder.order_forest()
        masses = builder.mass_properties.approximate_masses()
        reference = build_kinematic_forest(builder.registry, masses, simulated_joints=builder.simulated_joints)
        assert list(builder.forest.groups.items()) == list(reference.groups.items())
        assert builder.forest == reference
