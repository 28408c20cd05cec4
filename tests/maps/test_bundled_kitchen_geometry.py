"""Geometry of the bundled kitchen: it can be simulated as boxes without penetrations and unsupported bodies."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Iterator

import numpy as np
import pytest

from tests.maps.bundled_scene import KITCHEN, Array, Box, Joint, Scene, separation

TOUCHING = 1e-6
WALL = 0.015
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def kitchen() -> Scene:
    return Scene(KITCHEN)


@pytest.fixture(scope="module")
def containers(kitchen: Scene) -> dict[str, list[Box]]:
    """The containers of each loose item, innermost first."""
    boxes = list(kitchen.boxes.values())
    inside = {}
    for item in kitchen.movable_boxes:
        near = [box for box, gap in zip(boxes, separation(item, boxes), strict=True) if gap < -TOUCHING]
        near = [box for box in near if np.prod(box.size) > np.prod(item.size)]
        inside[item.id] = sorted(near, key=lambda box: float(np.prod(box.size)))
    return inside


@pytest.fixture(scope="module")
def supports(kitchen: Scene, containers: dict[str, list[Box]]) -> dict[str, Box]:
    """The support of each loose item that is in no container."""
    return {
        item.id: support
        for item in kitchen.movable_boxes
        if not containers[item.id]
        for support in kitchen.boxes.values()
        if abs(support.top - item.bottom) <= TOUCHING and footprint_inside(item, support)
    }


def footprint_inside(item: Box, support: Box) -> bool:
    (low, high), (floor, ceiling) = item.extent[:, :2], support.extent[:, :2]
    return bool((low >= floor - TOUCHING).all() and (high <= ceiling + TOUCHING).all())


def test_everything_is_aligned_with_the_room(kitchen: Scene) -> None:
    for box in kitchen.boxes.values():
        assert np.allclose(np.abs(box.rotation).max(axis=0), 1, atol=1e-12), box.id
        assert np.allclose(box.rotation[2], UP), f"{box.id} is not upright"


def test_only_contents_and_drawers_overlap_with_their_containers(kitchen: Scene) -> None:
    loose = {item.id for item in kitchen.movable_boxes}
    boxes = list(kitchen.boxes.values())
    wrong = []
    for index, box in enumerate(boxes[:-1]):
        rest = boxes[index + 1 :]
        for other, gap in zip(rest, separation(box, rest), strict=True):
            inner, outer = sorted((box, other), key=lambda each: float(np.prod(each.size)))
            held = inner.id in loose or (
                inner.id in kitchen.fronts_with_joints and kitchen.are_jointed(inner.id, outer.id)
            )
            if gap < -TOUCHING and not held:
                wrong.append(f"{box.id} and {other.id} by {-gap * 1000:.1f} mm")
    assert not wrong


def test_contents_keep_15_mm_from_the_walls_of_their_containers(
    kitchen: Scene, containers: dict[str, list[Box]]
) -> None:
    assert sum(bool(outer) for outer in containers.values()) >= 50
    for id, outer in containers.items():
        low, high = kitchen.boxes[id].extent
        for container in outer:
            floor, ceiling = container.extent
            margin = min((low - floor).min(), (ceiling - high).min())
            assert margin >= WALL - 1e-9, f"{id} is {margin * 1000:.1f} mm from a wall of {container.id}"


def test_contents_are_on_at_most_three_shelves_with_space_for_boards(
    kitchen: Scene, containers: dict[str, list[Box]]
) -> None:
    shelves: dict[str, dict[float, float]] = defaultdict(dict)
    for id, outer in containers.items():
        if outer:
            item, levels = kitchen.boxes[id], shelves[outer[0].id]
            level = round(item.bottom, 6)
            levels[level] = max(levels.get(level, 0), item.top)
    assert len(shelves) >= 20
    for container, levels in shelves.items():
        assert len(levels) <= 3, container
        for lower, upper in itertools.pairwise(sorted(levels)):
            assert upper - levels[lower] >= 0.02, f"no room for a board at {upper} m in {container}"


def test_loose_items_are_contained_or_supported(
    kitchen: Scene, containers: dict[str, list[Box]], supports: dict[str, Box]
) -> None:
    assert [item.id for item in kitchen.movable_boxes if not containers[item.id] and item.id not in supports] == []


def test_at_most_two_items_are_stacked(kitchen: Scene, supports: dict[str, Box]) -> None:
    stacked = {id for id, support in supports.items() if support.id in supports}
    assert stacked
    assert not [id for id in stacked if supports[supports[id].id].id in supports]


def test_loose_items_keep_their_distance(
    kitchen: Scene, containers: dict[str, list[Box]], supports: dict[str, Box]
) -> None:
    for item in kitchen.movable_boxes:
        apart = 0.003 if containers[item.id] else 0.01
        about = {box.id for box in containers[item.id]} | {item.id}
        about |= {supports[item.id].id} if item.id in supports else set()
        about |= {id for id, support in supports.items() if support.id == item.id}
        about |= {id for id, outer in containers.items() if item.id in {box.id for box in outer}}
        about |= {child.id for child in kitchen.attached_to_root[item.id]}
        others = [box for box in kitchen.boxes.values() if box.id not in about]
        gaps = separation(item, others)
        near = others[int(gaps.argmin())].id
        assert gaps.min() >= apart - 1e-9, f"{item.id} is {gaps.min() * 1000:.1f} mm from {near}"


def test_everything_is_inside_the_walls(kitchen: Scene) -> None:
    for box in kitchen.boxes.values():
        if not box.cls.startswith("WallW") and box.id not in {"floor", "window", "room_door"}:
            low, high = box.extent
            assert (low >= np.array([-2.25, -1.8, 0]) - TOUCHING).all(), box.id
            assert (high <= np.array([2.25, 1.8, 2.5]) + TOUCHING).all(), box.id


def test_heights_are_realistic(kitchen: Scene) -> None:
    for id in ("counter_left", "counter_right", "counter_west", "sink"):
        assert kitchen.boxes[id].top == pytest.approx(0.9)
    for id in ("spice_cupboard", "crockery_cupboard", "glass_cupboard"):
        assert (kitchen.boxes[id].bottom, kitchen.boxes[id].top) == pytest.approx((1.4, 2.1))
    assert kitchen.boxes["table"].top == pytest.approx(0.75)


def test_fronts_keep_a_gap_to_their_case_and_to_each_other(kitchen: Scene) -> None:
    fronts = [kitchen.boxes[id] for id in kitchen.fronts_with_joints]
    for index, front in enumerate(fronts[:-1]):
        gaps = separation(front, fronts[index + 1 :])
        assert gaps.min() >= 0.003 - 1e-9, f"{front.id} and {fronts[index + 1 + int(gaps.argmin())].id}"
    for part, joint in kitchen.fronts_with_joints.items():
        if not slides(joint):
            gap = float(separation(kitchen.boxes[part], [kitchen.boxes[joint.parent]])[0])
            assert 0.001 <= gap <= 0.003 + 1e-9, f"{part} is {gap * 1000:.1f} mm from {joint.parent}"


def test_drawers_are_in_their_case_except_for_the_front(kitchen: Scene) -> None:
    for part, joint in kitchen.fronts_with_joints.items():
        if slides(joint):
            forward = joint.rotation[:, 0]
            shift = -0.022 * forward
            box = kitchen.boxes[part].transformed(np.eye(3), joint.position, shift)
            low, high = box.extent
            floor, ceiling = kitchen.boxes[joint.parent].extent
            assert min((low - floor).min(), (ceiling - high).min()) >= -TOUCHING, part


def test_handles_are_on_the_front_of_their_part(kitchen: Scene) -> None:
    for part, joint in kitchen.fronts_with_joints.items():
        (handle,) = [child for child in kitchen.attached_to_root[part] if child.id.endswith("_handle")]
        front, forward = kitchen.boxes[part], joint.rotation[:, 0]
        assert handle.mobility == "kinematic"
        reach = abs(forward @ front.rotation) @ front.size / 2 + abs(forward @ handle.rotation) @ handle.size / 2
        assert forward @ (handle.center - front.center) == pytest.approx(reach, abs=TOUCHING), handle.id
        assert 0.03 <= abs(forward @ handle.rotation) @ handle.size <= 0.06
        flat = 1 - np.abs(forward)
        low, high = handle.extent * flat
        floor, ceiling = front.extent * flat
        assert min((low - floor).min(), (ceiling - high).min()) >= -TOUCHING, handle.id


def test_joint_frames_point_out_of_the_case(kitchen: Scene) -> None:
    for part, joint in kitchen.fronts_with_joints.items():
        (handle,) = [child for child in kitchen.attached_to_root[part] if child.id.endswith("_handle")]
        box, forward = kitchen.boxes[part], joint.rotation[:, 0]
        assert forward @ (handle.center - box.center) > 0, joint.id
        assert np.allclose(joint.rotation[:, 2], UP), joint.id
        low, high = box.extent
        assert ((joint.position >= low - TOUCHING) & (joint.position <= high + TOUCHING)).all(), (
            f"{joint.id} is off {part}"
        )


def test_each_joint_has_one_degree_of_freedom(kitchen: Scene) -> None:
    for joint in kitchen.joints:
        (moving,) = [axis for axis, motion in joint.motions.items() if motion != 2]
        assert joint.motions[moving] == 1
        assert moving in {"x", "swing1", "swing2"}
        limit = joint.limits["linear" if moving == "x" else moving]
        assert 2 * limit == (0.45 if moving == "x" else 1.570796), joint.id


def test_each_joint_is_closed_at_one_end_of_its_range_and_opens_away_from_its_case(kitchen: Scene) -> None:
    for part, joint in kitchen.fronts_with_joints.items():
        (moving,) = [axis for axis, motion in joint.motions.items() if motion != 2]
        limit, middle = joint.limits["linear" if moving == "x" else moving], joint.middles[moving]
        assert abs(middle) == limit, joint.id
        number = {"x": 0, "swing2": 1, "swing1": 2}[moving]
        axis = joint.rotation[:, number] * math.copysign(1.0, middle) * (-1 if joint.is_reversed else 1)
        arm = kitchen.boxes[part].center - joint.position
        way = axis if moving == "x" else np.cross(axis, arm)
        assert way @ joint.rotation[:, 0] > 0.1, f"{joint.id} moves {part} into its case"


def test_hinges_are_at_the_edge_of_their_door(kitchen: Scene) -> None:
    for part, joint in kitchen.fronts_with_joints.items():
        box = kitchen.boxes[part]
        offset = joint.rotation.T @ (joint.position - box.center)
        depth, width, height = np.abs(joint.rotation.T @ box.rotation) @ box.size
        if joint.motions["swing1"] == 1:
            assert offset == pytest.approx([depth / 2, math.copysign(width / 2, offset[1]), 0], abs=TOUCHING), joint.id
        elif joint.motions["swing2"] == 1:
            assert offset[2] == pytest.approx(-height / 2, abs=TOUCHING), joint.id


def test_tilting_doors_are_balanced_under_gravity(kitchen: Scene) -> None:
    tilting = [joint for joint in kitchen.joints if joint.motions["swing2"] == 1]
    assert len(tilting) == 2
    for joint in tilting:
        parts = [kitchen.boxes[joint.child], *kitchen.attached_to_root[joint.child]]
        mass = sum(part.mass for part in parts)
        center = sum(part.mass * part.center for part in parts) / mass
        assert abs(joint.rotation[:, 0] @ (center - joint.position)) < 1e-5, joint.id


def slides(joint: Joint) -> bool:
    return joint.motions["x"] == 1


def opening(kitchen: Scene, joint: Joint) -> Iterator[tuple[Array, Array]]:
    """Yields the rotations about the joint and the translations from closed to fully open."""
    if slides(joint):
        for way in np.linspace(0, joint.limits["linear"], 16):
            yield np.eye(3), way * joint.rotation[:, 0]
        return
    axis = "swing1" if joint.motions["swing1"] == 1 else "swing2"
    about = joint.rotation[:, 2 if axis == "swing1" else 1]
    out = np.cross(about, kitchen.boxes[joint.child].center - joint.position) @ joint.rotation[:, 0]
    for angle in np.linspace(0, math.copysign(joint.limits[axis], out), 61):
        yield turn(about, float(angle)), np.zeros(3)


def turn(about: Array, angle: float) -> Array:
    x, y, z = about
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def test_every_door_and_drawer_opens_fully_without_collisions(kitchen: Scene, containers: dict[str, list[Box]]) -> None:
    for part, joint in kitchen.fronts_with_joints.items():
        contents = [item for item in kitchen.movable_boxes if part in {box.id for box in containers[item.id]}]
        moving = [kitchen.boxes[part], *kitchen.attached_to_root[part], *contents]
        # A drawer slides inside its case; a door has to clear it.
        own = {box.id for box in moving} | ({joint.parent} if slides(joint) else set())
        reach = max(reach_from(joint.position, box) for box in moving) + joint.limits["linear"]
        others = [
            box
            for box in kitchen.boxes.values()
            if box.id not in own and np.linalg.norm(box.center - joint.position) < reach + np.linalg.norm(box.size) / 2
        ]
        for rotation, shift in opening(kitchen, joint):
            for box in moving:
                gaps = separation(box.transformed(rotation, joint.position, shift), others)
                hit = others[int(gaps.argmin())].id
                assert gaps.min() >= 1e-4, f"{box.id} hits {hit} by {-gaps.min() * 1000:.2f} mm while {part} opens"


def reach_from(point: Array, box: Box) -> float:
    return float(np.linalg.norm(box.center - point) + np.linalg.norm(box.size) / 2)
