"""The comparison of worlds: which differences it reports, and how large their errors are."""

from __future__ import annotations

import json
import random
from math import cos, inf, nan, pi, sin

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.kitchenette import MAP, kitchenette
from tests.worlds import poses, vectors, worlds

from mindstage.scene import (
    MECHANICAL_KINDS,
    Attachment,
    BodyId,
    BodyPhysics,
    ChangeKind,
    Iri,
    Light,
    LightType,
    Material,
    Pose,
    Vector,
    World,
    WorldDiff,
    diff,
)

KITCHEN = kitchenette()
MUG = KITCHEN.body("Mug")


def with_body(world: World, id: str, **changes: object) -> World:
    return replace(world, bodies=tuple(replace(body, **changes) if body.id == id else body for body in world.bodies))


def with_mug(**changes: object) -> World:
    return with_body(KITCHEN, "Mug", **changes)


def rows(found: WorldDiff) -> list[tuple[str, str, float | None]]:
    return [(change.id, change.field, change.error) for change in found.changed]


def shuffled(world: World, rng: random.Random) -> World:
    def mixed(items: tuple) -> tuple:
        return tuple(rng.sample(items, len(items)))

    def inside(items: tuple) -> tuple:
        return mixed(tuple(replace(item, tags=mixed(item.tags), facts=mixed(item.facts)) for item in items))

    return replace(
        world,
        bodies=inside(world.bodies),
        joints=inside(world.joints),
        lights=inside(world.lights),
        attachments=mixed(world.attachments),
        facts=mixed(world.facts),
        resources=mixed(tuple(replace(item, facts=mixed(item.facts)) for item in world.resources)),
    )


# -- equal worlds ------------------------------------------------------------------------------------------------------


@given(world=worlds(wild_tags=True, labels=True))
def test_a_world_is_identical_to_itself(world: World) -> None:
    found = diff(world, world)
    assert found == WorldDiff()
    assert found.identical()
    assert set(found.max_error.values()) == {0.0}
    assert found.lost_facts == 0


@given(a=worlds(labels=True), b=worlds(labels=True), rng=st.randoms(use_true_random=False))
def test_the_order_of_parts_does_not_affect_the_diff(a: World, b: World, rng: random.Random) -> None:
    assert diff(a, shuffled(a, rng)) == WorldDiff()
    assert diff(shuffled(a, rng), shuffled(b, rng)) == diff(a, b)


@given(a=worlds(max_bodies=3), b=worlds(max_bodies=3))
def test_swapping_the_worlds_mirrors_the_diff(a: World, b: World) -> None:
    there, back = diff(a, b), diff(b, a)
    assert there.max_error == back.max_error
    assert (there.only_in_a, there.only_in_b) == (back.only_in_b, back.only_in_a)
    assert (there.lost_facts, there.gained_facts) == (back.gained_facts, back.lost_facts)
    assert there.identical() == back.identical()


def test_empty_worlds_are_identical() -> None:
    assert diff(World(iri=Iri(MAP + "map")), World(iri=Iri(MAP + "map"))) == WorldDiff()


# -- errors ------------------------------------------------------------------------------------------------------------


@given(world=worlds(min_bodies=1), distance=st.floats(1e-6, 100.0))
def test_the_error_of_a_moved_body_is_its_displacement(world: World, distance: float) -> None:
    body = replace(world.bodies[0], pose=Pose((0.0, 2.0, 3.0)))
    before = replace(world, bodies=(body, *world.bodies[1:]))
    after = with_body(before, body.id, pose=Pose((distance, 2.0, 3.0)))
    found = diff(before, after)
    assert rows(found) == [(body.id, "pose.position", distance)]
    assert found.max_error == {**diff(before, before).max_error, "translation_m": distance}


@given(here=vectors(-1000.0, 1000.0), there=vectors(-1000.0, 1000.0))
def test_the_error_of_a_translation_is_the_distance(here: Vector, there: Vector) -> None:
    found = diff(with_mug(pose=Pose(here)), with_mug(pose=Pose(there)))
    distance = sum((x - y) ** 2 for x, y in zip(here, there, strict=True)) ** 0.5
    assert found.max_error["translation_m"] == pytest.approx(distance, rel=1e-12, abs=1e-150)


@pytest.mark.parametrize("distance", [5e-324, 1e-200, 1e200])
def test_tiny_and_huge_translations_are_measured_exactly(distance: float) -> None:
    found = diff(with_mug(pose=Pose((0.0, 0.0, 0.0))), with_mug(pose=Pose((0.0, distance, 0.0))))
    assert found.max_error["translation_m"] == distance


@pytest.mark.parametrize("angle", [1e-12, 1e-6, 0.5, pi])
def test_the_error_of_a_rotated_body_is_the_angle(angle: float) -> None:
    turned = Pose(MUG.pose.position, (cos(angle / 2), 0.0, sin(angle / 2), 0.0))
    found = diff(KITCHEN, with_mug(pose=turned))
    assert found.max_error["rotation_rad"] == pytest.approx(angle, rel=1e-12)
    assert [change.field for change in found.changed] == ["pose.quaternion"]


@given(pose=poses(), factor=st.sampled_from((-1.0, 2.0, -0.5, 2.0**-700, 2.0**700)))
def test_sign_and_norm_of_a_quaternion_are_ignored(pose: Pose, factor: float) -> None:
    assume(all(part * factor / factor == part for part in pose.quaternion))  # no underflow
    w, x, y, z = pose.quaternion
    other = Pose(pose.position, (w * factor, x * factor, y * factor, z * factor))
    assert diff(with_mug(pose=pose), with_mug(pose=other)) == WorldDiff()


def test_a_unit_in_the_sixth_decimal_of_a_quaternion_is_measured() -> None:
    # The difference between the two kitchens of the thesis.
    a, b = (with_mug(pose=Pose((0.0, 0.0, 0.0), (w, 0.0, 0.0, 0.707107))) for w in (0.707106, 0.707107))
    assert diff(a, b).max_error["rotation_rad"] == pytest.approx(1e-6 / 0.707107, rel=1e-5)


def test_a_zero_quaternion_equals_only_itself() -> None:
    zeros = with_mug(pose=Pose(MUG.pose.position, (0.0, 0.0, 0.0, 0.0)))
    assert rows(diff(KITCHEN, zeros)) == [("Mug", "pose.quaternion", None)]
    assert diff(zeros, zeros) == WorldDiff()


def test_the_error_of_a_size_is_its_largest_difference() -> None:
    a, b = with_mug(size=(177.512833, 177.512833, 60.0)), with_mug(size=(29.585472, 29.585472, 10.0))
    assert diff(a, b).max_error["size_m"] == 177.512833 - 29.585472


def test_max_error_has_the_largest_error_of_each_kind() -> None:
    after = with_body(with_mug(physics=replace(MUG.physics, mass_kg=0.5)), "Drawer", pose=Pose((1.95, 0.0, 0.75)))
    after = with_body(after, "Fridge", pose=Pose((2.5, 1.0, 0.9)), size=(0.6, 0.6, 1.75))
    found = diff(KITCHEN, after).max_error
    assert found["translation_m"] == 0.5
    assert found["mass_kg"] == 0.2
    assert found["size_m"] == pytest.approx(0.05)
    assert found["rotation_rad"] == found["limit"] == found["stiffness"] == 0.0


def test_material_colors_have_an_error_and_names_have_none() -> None:
    wood, steel = (Material(name=name, color=(0.5, 0.25, 0.0)) for name in ("Wood", "Steel"))
    paler = replace(wood, color=(0.5, 0.5, 0.125))
    found = diff(with_mug(materials=(steel, wood)), with_mug(materials=(steel, paler)))
    assert rows(found) == [("Mug", "materials[1].color", 0.25)]
    assert found.max_error["color"] == 0.25
    found = diff(with_mug(materials=(wood,)), with_mug(materials=(steel,)))
    assert rows(found) == [("Mug", "materials", None)]
    found = diff(with_mug(materials=(wood,)), with_mug(materials=(replace(wood, color=None),)))
    assert rows(found) == [("Mug", "materials[0].color", None)]


def test_materials_keep_their_order() -> None:
    wood, steel = Material(name="Wood"), Material(name="Steel")
    found = diff(with_mug(materials=(wood, steel)), with_mug(materials=(steel, wood)))
    assert rows(found) == [("Mug", "materials", None)]
    assert found.changed[0].a == (("Wood", ""), ("Steel", ""))


# -- what is no number -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("other", [None, nan, inf, -inf])
def test_a_missing_mass_exceeds_any_tolerance(other: float | None) -> None:
    found = diff(KITCHEN, with_mug(physics=replace(MUG.physics, mass_kg=other)))
    assert rows(found) == [("Mug", "physics.mass_kg", None)]
    assert not found.identical(1e308)
    assert found.max_error["mass_kg"] == 0.0


@pytest.mark.parametrize("number", [None, nan, inf])
def test_nan_equals_nan(number: float | None) -> None:
    odd = with_mug(physics=BodyPhysics(mass_kg=number), pose=Pose((number or nan, 0.0, 0.0)))
    # A copy through text, so that the two share no objects.
    again = with_mug(physics=BodyPhysics(mass_kg=number and float(str(number))), pose=Pose((number or nan, -0.0, 0.0)))
    assert diff(odd, again) == WorldDiff()


def test_nan_in_a_vector_exceeds_any_tolerance() -> None:
    found = diff(with_mug(size=(1.0, nan, 3.0)), with_mug(size=(1.0, 2.0, 3.0)))
    assert rows(found) == [("Mug", "size", None)]
    found = diff(with_mug(size=(1.0, nan, 3.0)), with_mug(size=(1.0, nan, 3.5)))
    assert rows(found) == [("Mug", "size", None)]


def test_a_missing_size_differs_from_nan() -> None:
    assert rows(diff(with_mug(size=None), with_mug(size=(nan, nan, nan)))) == [("Mug", "size", None)]


# -- structure ---------------------------------------------------------------------------------------------------------


@given(world=worlds(min_bodies=1))
def test_a_removed_body_is_only_in_a_and_its_statements_are_lost(world: World) -> None:
    removed, *rest = world.bodies
    without = replace(world, bodies=tuple(rest))
    found = diff(world, without)
    assert found.only_in_a == (removed.id,)
    assert found.only_in_b == ()
    assert found.lost_facts == len(removed.facts) + len(removed.tags)
    assert {statement.id for statement in found.lost} <= {removed.id}
    assert not found.identical(1e308)
    assert diff(without, world).only_in_b == (removed.id,)


def test_removed_joints_and_lights_are_only_in_a() -> None:
    lamp = Light(id=BodyId("Lamp"), iri=Iri(MAP + "Lamp"), type=LightType.POINT, pose=Pose())
    found = diff(replace(KITCHEN, lights=(lamp,)), replace(KITCHEN, joints=KITCHEN.joints[:1]))
    assert found.only_in_a == ("FridgeHinge", "Lamp")
    assert diff(KITCHEN, replace(KITCHEN, lights=(lamp,))).only_in_b == ("Lamp",)


def test_a_body_is_not_matched_with_a_joint_of_the_same_id() -> None:
    slide, hinge = KITCHEN.joints
    swapped = replace(KITCHEN, joints=(slide, replace(hinge, id=BodyId("Mug"))), bodies=KITCHEN.bodies[:-1])
    found = diff(KITCHEN, swapped)
    assert found.only_in_a == ("FridgeHinge", "Mug")
    assert found.only_in_b == ("Mug",)


def test_another_parent_is_a_change_of_the_child() -> None:
    slide, _ = KITCHEN.attachments
    moved = Attachment(parent=BodyId("Fridge"), child=BodyId("FridgeHandle"))
    found = diff(KITCHEN, replace(KITCHEN, attachments=(slide, moved)))
    assert rows(found) == [("FridgeHandle", "attachment.parent", None)]
    assert (found.changed[0].a, found.changed[0].b) == ("FridgeDoor", "Fridge")
    assert found.changed[0].kind is ChangeKind.STRUCTURE


def test_a_removed_attachment_is_a_change_of_the_child() -> None:
    found = diff(KITCHEN, replace(KITCHEN, attachments=KITCHEN.attachments[1:]))
    assert [(change.id, change.a, change.b) for change in found.changed] == [("DrawerHandle", "Drawer", None)]


def test_two_parents_of_one_child_are_compared() -> None:
    second = Attachment(parent=BodyId("Mug"), child=BodyId("DrawerHandle"))
    both = replace(KITCHEN, attachments=(*KITCHEN.attachments, second))
    assert diff(both, replace(both, attachments=both.attachments[::-1])) == WorldDiff()
    (change,) = diff(both, KITCHEN).changed
    assert (change.a, change.b) == (("Drawer", "Mug"), "Drawer")


def test_objects_with_equal_ids_are_compared_in_order() -> None:
    twice = replace(KITCHEN, bodies=(*KITCHEN.bodies, replace(MUG, label="the second")))
    assert diff(twice, twice) == WorldDiff()
    assert diff(twice, KITCHEN).only_in_a == ("Mug",)
    other = replace(KITCHEN, bodies=(*KITCHEN.bodies, replace(MUG, label="another")))
    assert rows(diff(twice, other)) == [("Mug", "label", None)]


# -- arguments and output-----------------------------------------------------------------------------------------------


def test_errors_up_to_the_tolerance_are_accepted() -> None:
    found = diff(with_mug(pose=Pose((0.0, 0.0, 0.0))), with_mug(pose=Pose((0.25, 0.0, 0.0))))
    assert not found.identical()
    assert not found.identical(0.2499)
    assert found.identical(0.25)
    assert found.exceeding(0.25) == ()
    assert found.exceeding(0.2) == found.changed


@pytest.mark.parametrize("tolerance", [-1e-9, nan])
def test_a_negative_or_nan_tolerance_raises_an_error(tolerance: float) -> None:
    with pytest.raises(ValueError, match="at least 0"):
        WorldDiff().identical(tolerance)


def test_the_comparison_can_be_restricted_to_kinds() -> None:
    after = with_mug(size=(1.0, 1.0, 1.0), mesh="another", label="Mug", pose=Pose((2.0, 0.0, 0.85 + 1e-6)))
    found = diff(KITCHEN, after)
    assert not found.identical(2e-6)
    assert found.identical(2e-6, kinds=MECHANICAL_KINDS)
    assert not found.identical(0.0, kinds=MECHANICAL_KINDS)
    assert not found.identical(2e-6, kinds={ChangeKind.APPEARANCE})
    assert [change.field for change in found.exceeding(2e-6, kinds={ChangeKind.APPEARANCE, ChangeKind.NAME})] == [
        "label",
        "mesh",
    ]


def test_removed_objects_count_for_any_kinds() -> None:
    assert not diff(KITCHEN, replace(KITCHEN, bodies=KITCHEN.bodies[1:])).identical(
        1e308, kinds={ChangeKind.APPEARANCE}
    )


def test_the_json_has_the_documented_fields() -> None:
    after = with_mug(pose=Pose((2.5, 0.0, 0.85)), tags=MUG.tags[:1], physics=BodyPhysics(mass_kg=inf))
    found = diff(KITCHEN, replace(after, bodies=after.bodies[1:]))
    data = json.loads(found.to_json(0.25))
    assert data["identical"] is False
    assert data["delta"] == 0.25
    assert data["max_error"] == 0.5
    assert data["errors"]["translation_m"] == 0.5
    assert {"translation_m", "rotation_rad", "size_m", "mass_kg", "limit"} <= data["errors"].keys()
    assert data["only_in_a"] == ["Floor"]
    assert data["only_in_b"] == []
    assert data["lost_facts"] == 3
    assert {"id": "Mug", "note": "SemLog;Id,Mug"} in data["lost"]
    by_field = {row["field"]: row for row in data["changed"]}
    assert by_field["pose.position"] == {
        "id": "Mug",
        "field": "pose.position",
        "kind": "translation_m",
        "a": [2.0, 0.0, 0.85],
        "b": [2.5, 0.0, 0.85],
        "error": 0.5,
    }
    assert by_field["physics.mobility"]["a"] == "dynamic"
    assert by_field["physics.mass_kg"]["b"] == "inf"
    assert by_field["physics.mass_kg"]["error"] is None
    assert by_field["tags"]["a"] == [{"type": "SemLog", "key": "Id", "value": "Mug"}]


@given(a=worlds(wild_tags=True, labels=True, max_bodies=3), b=worlds(wild_tags=True, labels=True, max_bodies=3))
def test_any_diff_can_be_encoded_as_json(a: World, b: World) -> None:
    found = diff(a, b)
    data = json.loads(found.to_json())
    assert data == json.loads(json.dumps(found.to_builtins(), allow_nan=False))
    assert len(data["changed"]) == len(found.changed)
    assert len(data["lost"]) == data["lost_facts"]


def test_a_diff_is_hashable_and_comparable() -> None:
    found = diff(KITCHEN, with_mug(label="Mug"))
    assert found == diff(KITCHEN, with_mug(label="Mug"))
    assert hash(found) == hash(diff(KITCHEN, with_mug(label="Mug")))
    with pytest.raises(AttributeError, match="immutable"):
        found.changed = ()  # type: ignore[misc]
