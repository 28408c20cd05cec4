"""Axes and ranges of doors and drawers that a map does not give: tall doors, handles, casings, and contradictions."""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.maps.dialects.joints import HingeEvidence, InferredAxis, infer_hinge_axis
from mindstage.scene import AxisMotion, Joint, Pose, World
from mindstage.scene.joint_kinematics import ObservedBox, axis_ranges
from mindstage.scene.transforms import Array, quat_rotate, rotation_matrix
from tests.cases import each_case
from tests.maps.dialect_maps import check_round_trip, finding_texts, joint_range, knowrob1_map, matrix_turtle
from tests.maps.small_maps import ReadMap, room_map

UP = np.array([0.0, 0.0, 1.0])
YAWS = (0.0, pi / 2, pi, -pi / 2, 0.4)


class Place(NamedTuple):
    """A frame in the plane; its x axis points to the front of a casing, y to its left."""

    yaw: float = 0.0
    origin: tuple[float, float, float] = (3.0, -2.0, 0.0)

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        return float(np.cos(self.yaw / 2)), 0.0, 0.0, float(np.sin(self.yaw / 2))

    def point(self, *offset: float) -> Array:
        return np.array(self.origin) + quat_rotate(np.array(self.quaternion), np.array(offset))

    def direction(self, *vector: float) -> Array:
        return quat_rotate(np.array(self.quaternion), np.array(vector))

    def box(self, offset: tuple[float, ...], size: tuple[float, float, float]) -> ObservedBox:
        x, y, z = self.point(*offset).tolist()
        return ObservedBox(Pose((x, y, z), self.quaternion), size)


def moved(point: Array, inferred: InferredAxis, angle: float) -> Array:
    """A point after a rotation about an inferred axis."""
    unit = inferred.axis / np.linalg.norm(inferred.axis)
    quaternion = np.array([np.cos(angle / 2), *(np.sin(angle / 2) * unit)])
    return inferred.origin + quat_rotate(quaternion, point - inferred.origin)


def assert_opens(inferred: InferredAxis, place: Place, door: ObservedBox, handle: ObservedBox | None) -> None:
    """Positive rotation moves the door to the front, and its handle at least half of the door's width."""
    assert inferred.opens == 1
    way = moved(door.center, inferred, pi / 2) - door.center
    assert float(way @ place.direction(1, 0, 0)) > 0.1
    if handle is not None:
        travel = moved(handle.center, inferred, pi / 2) - handle.center
        assert np.linalg.norm(travel) > 0.6 * min(door.half_extents[1:]) * 2


SIDES = {"left": (0, 1, 0), "right": (0, -1, 0), "top": (0, 0, 1), "bottom": (0, 0, -1)}


@each_case("yaw", YAWS)
@each_case("thickness", [0.0, 0.02, 0.06])
@each_case("size", [(0.5, 0.7), (0.6, 0.6), (0.4, 0.5)])
@each_case("side", SIDES)
def test_a_door_turns_about_the_edge_opposite_to_its_handle(
    side: str, size: tuple[float, float], thickness: float, yaw: float
) -> None:
    place, outer = Place(yaw), np.array(SIDES[side])
    door = place.box((0.3, 0.0, 1.0), (thickness, *size))
    half = np.array([0.0, *size]) / 2
    handle = place.box(tuple(np.array([0.34, 0.0, 1.0]) + 0.9 * half * outer), (0.03, 0.1, 0.03))
    casing = place.box((0.0, 0.0, 1.0), (0.58, *size))
    inferred, conflicts = infer_hinge_axis(HingeEvidence(parent=casing, child=door, handle=handle))
    assert conflicts == ()
    np.testing.assert_allclose(inferred.origin, door.center - place.direction(*(half * outer)), atol=1e-3)
    assert abs(float(inferred.axis @ UP)) == pytest.approx(float(side in ("left", "right")))
    assert_opens(inferred, place, door, handle)


@each_case("yaw", YAWS)
@each_case("corner", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
@each_case("with_handle", [True, False])
@each_case("width", [0.45, 0.52, 0.9])
def test_a_tall_door_whose_hinge_is_at_a_corner_turns_about_a_vertical_axis(
    width: float, with_handle: bool, corner: tuple[int, int], yaw: float
) -> None:
    place, half = Place(yaw), np.array([0.0, width, 2.16]) / 2
    door = place.box((0.3, 0.0, 1.3), (0.0, width, 2.16))
    side = np.array([0.0, *corner])
    handle = place.box((0.32, -0.9 * half[1] * corner[0], 1.3 + 0.9 * half[2] * corner[1]), (0.03, 0.03, 0.03))
    evidence = HingeEvidence(
        parent=place.box((0.0, 0.0, 1.3), (0.6, width, 2.16)),
        child=door,
        handle=handle if with_handle else None,
        origin=door.center + place.direction(*(half * side)),
    )
    inferred, _ = infer_hinge_axis(evidence)
    assert abs(float(inferred.axis @ UP)) == pytest.approx(1.0)
    assert_opens(inferred, place, door, evidence.handle)
    assert "tall turns about a vertical axis" in inferred.evidence


@each_case("yaw", YAWS)
@each_case("side", [1, -1])
def test_a_hinge_at_the_corner_next_to_the_handle_turns_about_the_far_edge(side: int, yaw: float) -> None:
    place, half = Place(yaw), np.array([0.0, 0.5, 0.87]) / 2
    door = place.box((0.16, 0.0, 2.3), (0.0, 0.5, 0.87))
    handle = place.box((0.2, -0.1 * side, 2.3 - half[2] + 0.07), (0.003, 0.13, 0.003))
    origin = door.center + place.direction(0.0, side * half[1], -half[2])
    casing = place.box((0.0, 0.0, 2.3), (0.31, 0.5, 0.87))
    inferred, _ = infer_hinge_axis(HingeEvidence(parent=casing, child=door, handle=handle, origin=origin))
    assert abs(float(inferred.axis @ UP)) == pytest.approx(1.0), "not about the edge 7 cm from the handle"
    assert_opens(inferred, place, door, handle)


@each_case("yaw", YAWS)
@each_case("leaf", [1, -1])
def test_two_doors_of_one_casing_turn_about_its_sides(leaf: int, yaw: float) -> None:
    place = Place(yaw)
    casing, door = place.box((0, 0, 1), (0.6, 1.0, 0.8)), place.box((0.31, leaf * 0.25, 1), (0.02, 0.5, 0.8))
    inferred, _ = infer_hinge_axis(HingeEvidence(parent=casing, child=door))
    np.testing.assert_allclose(inferred.origin, place.point(0.31, leaf * 0.5, 1.0), atol=1e-9)
    assert_opens(inferred, place, door, None)


@pytest.mark.parametrize("cls", ["Oven", "Dishwasher", "Refrigerator"])
def test_doors_of_ovens_fold_down_and_those_of_fridges_do_not(cls: str) -> None:
    place = Place(0.4)
    casing, door = place.box((0, 0, 0.5), (0.6, 0.6, 0.7)), place.box((0.31, 0, 0.5), (0.02, 0.6, 0.7))
    inferred, _ = infer_hinge_axis(HingeEvidence(parent=casing, child=door, class_names=["Door", cls]))
    folds = cls != "Refrigerator"
    assert (abs(float(inferred.axis @ UP)) < 0.5) is folds
    assert bool(inferred.origin[2] < 0.2) is folds
    assert_opens(inferred, place, door, None)


def test_the_z_axis_of_a_hinge_decides_between_the_edges_at_a_corner() -> None:
    place, half = Place(), np.array([0.0, 0.3, 0.14])
    door = place.box((0.31, 0.0, 2.1), (0.0, 0.6, 0.28))
    evidence = HingeEvidence(
        parent=place.box((0.0, 0.0, 2.1), (0.6, 0.6, 0.28)),
        child=door,
        origin=door.center + half,
        frame=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    )
    inferred, _ = infer_hinge_axis(evidence)
    assert abs(float(inferred.axis @ place.direction(0, 1, 0))) == pytest.approx(1.0)
    assert_opens(inferred, place, door, None)


def test_the_radius_is_the_distance_of_the_handle_from_the_axis() -> None:
    place = Place(pi / 2)
    door, handle = place.box((0.31, 0, 1), (0.02, 0.8, 0.8)), place.box((0.34, -0.35, 1), (0.02, 0.02, 0.2))
    casing = place.box((0, 0, 1), (0.6, 0.8, 0.8))
    inferred, _ = infer_hinge_axis(HingeEvidence(parent=casing, child=door, handle=handle, radius=0.7))
    np.testing.assert_allclose(inferred.origin, place.point(0.31, 0.35, 1), atol=1e-9)


def test_a_given_line_is_used_unless_the_handle_is_on_it() -> None:
    place = Place(0.4)
    door, handle = place.box((0.31, 0, 1), (0.02, 0.8, 0.8)), place.box((0.34, -0.35, 1), (0.02, 0.02, 0.2))
    casing = place.box((0, 0, 1), (0.6, 0.8, 0.8))

    def infer(at: tuple[float, ...], axis: Array) -> tuple[InferredAxis, tuple[str, ...]]:
        return infer_hinge_axis(
            HingeEvidence(parent=casing, child=door, handle=handle, origin=place.point(*at), axis=axis)
        )

    odd = infer((0.31, 0.3, 1.0), UP)  # within the panel, and far enough from the handle
    assert odd[1] == ()
    np.testing.assert_array_equal(odd[0].origin, place.point(0.31, 0.3, 1.0))
    np.testing.assert_array_equal(odd[0].axis, UP)
    on_handle, conflicts = infer((0.31, -0.38, 1.0), UP)
    assert conflicts[0] == "with the given position and axis, its handle is 3 cm from the axis of a door of 80 cm"
    np.testing.assert_allclose(on_handle.origin, place.point(0.31, 0.4, 1.0), atol=1e-9)
    assert_opens(on_handle, place, door, handle)
    normal, conflicts = infer((0.31, 0.4, 1.0), place.direction(1, 0, 0))
    assert "the axis is the normal of the door" in conflicts[0]
    np.testing.assert_allclose(normal.origin, place.point(0.31, 0.4, 1.0), atol=1e-9)
    assert_opens(normal, place, door, handle)


def test_a_hinge_at_the_middle_of_a_door_with_a_handle_is_the_pose_of_the_door() -> None:
    place = Place(0.4)
    door, handle = place.box((0.31, 0, 1), (0.02, 0.8, 0.8)), place.box((0.34, -0.35, 1), (0.02, 0.02, 0.2))
    casing = place.box((0, 0, 1), (0.6, 0.8, 0.8))
    evidence = HingeEvidence(parent=casing, child=door, handle=handle, origin=door.center)
    inferred, conflicts = infer_hinge_axis(evidence)
    assert conflicts == ("the given position is the middle of the door, which has a handle",)
    np.testing.assert_allclose(inferred.origin, place.point(0.31, 0.4, 1), atol=1e-9)
    pivot, conflicts = infer_hinge_axis(
        HingeEvidence(parent=casing, child=door, handle=handle, origin=door.center, axis=UP)
    )
    assert conflicts == ()
    np.testing.assert_array_equal(pivot.origin, door.center)


def test_a_handle_on_the_inside_does_not_turn_a_door_round() -> None:
    place = Place(pi)
    casing, door = place.box((0, 0, 1), (0.6, 0.6, 0.6)), place.box((0.31, 0, 1), (0.02, 0.6, 0.6))
    inside = place.box((0.28, -0.25, 1), (0.02, 0.02, 0.1))
    inferred, _ = infer_hinge_axis(HingeEvidence(parent=casing, child=door, handle=inside))
    assert_opens(inferred, place, door, None)


@given(
    yaw=st.floats(-pi, pi),
    width=st.floats(0.3, 1.2),
    height=st.floats(0.3, 2.4),
    share=st.floats(0.5, 0.95),
    lift=st.floats(-0.3, 0.3),
    side=st.sampled_from((1, -1)),
)
def test_a_door_with_a_handle_at_its_side_always_opens_outwards(
    yaw: float, width: float, height: float, share: float, lift: float, side: int
) -> None:
    place = Place(yaw)
    door = place.box((0.3, 0.0, 1.3), (0.02, width, height))
    handle = place.box((0.33, side * share * width / 2, 1.3 + lift * height / 2), (0.02, 0.02, 0.1))
    casing = place.box((0.0, 0.0, 1.3), (0.56, width, height))
    inferred, _ = infer_hinge_axis(HingeEvidence(parent=casing, child=door, handle=handle))
    np.testing.assert_allclose(inferred.origin, place.point(0.3, -side * width / 2, 1.3), atol=1e-3)
    assert inferred.opens == 1
    assert float((moved(door.center, inferred, 0.5) - door.center) @ place.direction(1, 0, 0)) > 0.0


# -- KnowRob 1 ---------------------------------------------------------------------------------------------------------


def thing(name: str, cls: str, at: Array, size: tuple[float, ...], place: Place, *facts: str) -> str:
    rows = rotation_matrix(np.array(place.quaternion))
    elements = {f"m{i}{j}": float(rows[i, j]) for i in range(3) for j in range(3)}
    extents = zip(("depth", "width", "height"), size, strict=True)
    lengths = " ; ".join(f'k:{axis}OfObject "{extent}"^^xsd:float' for axis, extent in extents)
    more = "".join(f" ; {fact}" for fact in facts)
    return f":{name} a k:{cls} ; k:orientation :m-{name} ; {lengths}{more} .\n" + matrix_turtle(
        f"m-{name}", *at.tolist(), **elements
    )


def hinge(name: str, at: Array, axes: Array, *facts: str) -> str:
    """A hinge with a left-handed frame: x is the normal of the door, y points away from it, z is the axis."""
    elements = {f"m{i}{j}": float(axes[j][i]) for i in range(3) for j in range(3)}
    more = "".join(f" ; {fact}" for fact in facts)
    return f":{name} a k:HingedJoint ; k:orientation :m-{name}{more} .\n" + matrix_turtle(
        f"m-{name}", *at.tolist(), **elements
    )


def wardrobe(place: Place, *, knob: bool = True, frames: bool = True) -> str:
    """A wardrobe with two doors of no thickness, each with a hinge at a corner, and one of them with a knob."""
    doors = []
    for leaf in (1, -1):
        center = np.array([0.29, leaf * 0.2616, 1.2973])
        corner = place.point(*(center + np.array([0.0, leaf * 0.2616, leaf * 1.0824])))
        x, y = place.direction(1, 0, 0), place.direction(0, leaf, 0)
        axes = np.array([x, y, -np.cross(x, y)] if frames else np.eye(3))
        grip = f", :knob{leaf}" if knob and leaf == 1 else ""
        parts = f"k:properPhysicalParts :hinge{leaf}{grip}"
        doors += [
            thing(
                f"door{leaf}", "Door", place.point(*center), (0.0, 0.5232, 2.1648), place, parts, "k:hingedTo :closet"
            ),
            hinge(f"hinge{leaf}", corner, axes),
        ]
    doors.append(
        thing("knob1", "ControlKnob", place.point(0.301, 0.02, 1.3), (0.03, 0.03, 0.03), place) if knob else ""
    )
    parts = "k:properPhysicalParts :door1, :door-1"
    closet = thing("closet", "Closet", place.point(0, 0, 1.2973), (0.58, 1.0464, 2.1648), place, parts)
    member = ":closet k:describedInMap :old ."
    return knowrob1_map(closet, member, *doors)


@pytest.mark.parametrize("yaw", YAWS[:4])
@pytest.mark.parametrize("knob", [True, False])
@pytest.mark.parametrize("frames", [True, False])
def test_the_doors_of_a_wardrobe_open_outwards_about_vertical_axes(
    read: ReadMap, tmp_path: Path, frames: bool, knob: bool, yaw: float
) -> None:
    place = Place(yaw)
    world = check_round_trip(read, wardrobe(place, knob=knob, frames=frames), tmp_path)
    assert len(world.joints) == 2
    for joint in world.joints:
        axis = rotation_matrix(np.array(joint.pose.quaternion))[:, 0]
        np.testing.assert_allclose(np.abs(axis), UP, atol=1e-6)
        assert joint_range(joint) == pytest.approx((0.0, pi / 2))
        door = np.array(world.body(joint.child).pose.position)
        opened = moved(door, InferredAxis(np.array(joint.pose.position), axis, ""), pi / 2)
        assert float((opened - door) @ place.direction(1, 0, 0)) > 0.25


def test_an_impossible_direction_is_replaced_and_reported(read: ReadMap, tmp_path: Path) -> None:
    place = Place()
    parts = "k:properPhysicalParts :handle, :hinge", "k:hingedTo :case"
    text = knowrob1_map(
        thing("case", "Cupboard", place.point(0, 0, 1), (0.6, 0.6, 0.8), place, "k:properPhysicalParts :door"),
        ":case k:describedInMap :old .",
        thing("door", "Door", place.point(0.31, 0, 1), (0.02, 0.6, 0.8), place, *parts),
        thing("handle", "Handle", place.point(0.34, -0.27, 1), (0.02, 0.02, 0.1), place),
        hinge(
            "hinge", place.point(0.31, -0.3, 1), np.eye(3), "k:direction [ k:vectorX 0 ; k:vectorY 0 ; k:vectorZ 1 ]"
        ),
    )
    [joint] = check_round_trip(read, text, tmp_path).joints
    assert joint.pose.position == pytest.approx(tuple(place.point(0.31, 0.3, 1)))
    found = finding_texts(read(text)[1], "hinge")
    assert "with the given position and axis, its handle is 3 cm from the axis of a door of 60 cm" in found
    assert "it is inferred instead" in found


@pytest.mark.parametrize("name", ["SlidingDoor", "Drawer"])
def test_a_drawer_without_limits_slides_out_by_its_depth(read: ReadMap, tmp_path: Path, name: str) -> None:
    place = Place(pi / 2)
    parts = "k:properPhysicalParts :handle, :slide", "k:prismaticallyConnectedTo :case"
    text = knowrob1_map(
        thing("case", "Cupboard", place.point(0, 0, 1), (0.6, 0.6, 0.8), place, "k:properPhysicalParts :drawer"),
        ":case k:describedInMap :old .",
        thing("drawer", name, place.point(0.02, 0, 1), (0.5, 0.58, 0.2), place, *parts),
        thing("handle", "Handle", place.point(0.3, 0, 1), (0.02, 0.1, 0.02), place),
        ":slide a k:PrismaticJoint .",
    )
    [joint] = check_round_trip(read, text, tmp_path).joints
    assert joint_range(joint) == pytest.approx((0.0, 0.5))
    axis = rotation_matrix(np.array(joint.pose.quaternion))[:, 0]
    np.testing.assert_allclose(axis, place.direction(1, 0, 0), atol=1e-9)
    assert "it opens outwards, by 0.5 m" in finding_texts(read(text)[1], "slide")


# -- AMEVA -------------------------------------------------------------------------------------------------------------


def ameva_thing(name: str, cls: str, at: Array, place: Place, *facts: str) -> str:
    """An individual in centimeters and Unreal's left-handed frame, with a quaternion x y z w."""
    w, _, _, z = place.quaternion
    x, y, height = (100.0 * at).tolist()
    more = "".join(f" ; {fact}" for fact in facts)
    return f""":{name} a owl:NamedIndividual, k:{cls} ; k:describedInMap :room ; k:maskColor "FF" ;
    k:pose :{name}-p{more} .
:{name}-p a owl:NamedIndividual, k:Pose ; k:translation "{x:.4f} {-y:.4f} {height:.4f}" ;
    k:quaternion "0.0 0.0 {-z:.8f} {w:.8f}" ."""


AMEVA_SIZES = {
    "Case": (58.0, 60.0, 150.0),
    "Door": (2.0, 58.0, 80.0),
    "Drawer": (50.0, 58.0, 28.0),
    "Rack": (42.0, 50.0, 14.0),
    "IAIHandle": (4.0, 4.0, 12.0),
}


def ameva_map(place: Place, *, handles: bool, side: int, flap: bool = False) -> str:
    """A casing with a door above a drawer, and a rack in it."""
    classes = [
        f"k:{cls} a owl:Class ; rdfs:subClassOf "
        + ", ".join(
            f'[a owl:Restriction ; owl:onProperty k:{axis}OfObject ; owl:hasValue "{extent}"^^xsd:float]'
            for axis, extent in zip(("depth", "width", "height"), size, strict=True)
        )
        + " ."
        for cls, size in AMEVA_SIZES.items()
    ]
    dynamic = 'k:mobility "dynamic"'
    hinge_at = (0.3, 0.0, 0.65) if flap else (0.31, side * 0.29, 1.05)
    grip_at = (0.33, 0.0, 1.4) if flap else (0.33, -side * 0.26, 1.05)
    things = [
        ameva_thing("case", "Case", place.point(0, 0, 0.75), place, "k:child :door, :drawer, :rack"),
        ameva_thing("door", "Door", place.point(0.3, 0, 1.05), place, "k:parent :case", dynamic),
        ameva_thing("drawer", "Drawer", place.point(0.03, 0, 0.3), place, "k:parent :case", dynamic),
        ameva_thing("rack", "Rack", place.point(0.0, 0, 1.05), place, "k:parent :case", dynamic),
        ameva_thing("hinge", "RevoluteJoint", place.point(*hinge_at), place, "k:parent :door"),
        ameva_thing("slide", "LinearJoint", place.point(0.28, 0, 0.3), place, "k:parent :drawer"),
        ameva_thing("rails", "LinearJoint", place.point(-0.2, 0, 1.0), place, "k:parent :rack"),
    ]
    if handles:
        things += [
            ameva_thing("grip", "IAIHandle", place.point(*grip_at), place, "k:parent :door"),
            ameva_thing("pull", "IAIHandle", place.point(0.31, 0, 0.3), place, "k:parent :drawer"),
        ]
    return room_map(*classes, *things)


def movable_range(joint: Joint) -> tuple[int, float, float]:
    [(number, found)] = [(n, r) for n, r in enumerate(axis_ranges(joint)) if r.motion is AxisMotion.LIMITED]
    return number, found.middle - found.limit, found.middle + found.limit


def open_shift(world: World, joint: Joint) -> Array:
    """How far the body of a joint is from its closed position when the joint is fully open."""
    number, lower, upper = movable_range(joint)
    assert 0.0 in (round(lower, 9), round(upper, 9)), "its range has only one side"
    position = lower if abs(lower) > abs(upper) else upper
    axis = quat_rotate(np.array(joint.pose.quaternion), np.eye(3)[number % 3])
    if number < 3:
        return np.asarray(position * axis)
    center = np.array(world.body(joint.child).pose.position)
    return moved(center, InferredAxis(np.array(joint.pose.position), axis, ""), position) - center


@pytest.mark.parametrize("yaw", YAWS)
@pytest.mark.parametrize("handles", [True, False])
@pytest.mark.parametrize(("side", "flap"), [(1, False), (-1, False), (1, True)])
def test_doors_drawers_and_racks_of_ameva_maps_only_open_outwards(
    read: ReadMap, side: int, flap: bool, handles: bool, yaw: float
) -> None:
    place = Place(yaw)
    world, findings = read(ameva_map(place, handles=handles, side=side, flap=flap))
    joints = {joint.id: joint for joint in world.joints}
    front = place.direction(1, 0, 0)
    for id, travel in (("slide", 0.5), ("rails", 0.42)):
        np.testing.assert_allclose(open_shift(world, joints[id]), travel * front, atol=1e-4)
    assert float(open_shift(world, joints["hinge"]) @ front) > 0.25
    assert movable_range(joints["hinge"])[0] == (4 if flap else 5)
    text = "\n".join(finding.action for finding in findings if "neither an axis" in finding.problem)
    assert "drawer slides out along the joint's x axis" in text
    assert "door turns about" in text
    assert "outwards by at most a right angle" in text
    assert ("its handle is" in text) is handles
    assert "2 other doors and drawers of case face that side" in text or "on that side of its casing" in text


def test_what_has_no_front_may_move_both_ways(read: ReadMap) -> None:
    place = Place()
    case = ameva_thing("case", "Case", place.point(0, 0, 0.75), place, "k:child :drawer")
    drawer = ameva_thing("drawer", "Drawer", place.point(0, 0, 0.3), place, "k:parent :case", 'k:mobility "dynamic"')
    slide = ameva_thing("slide", "LinearJoint", place.point(0, 0, 0.3), place, "k:parent :drawer")
    classes = ameva_map(place, handles=False, side=1).partition(":case ")[0]
    world, findings = read("\n".join((classes, case, drawer, slide)))
    assert movable_range(world.joints[0]) == (0, pytest.approx(-0.5), pytest.approx(0.5))
    assert any("either way" in finding.action for finding in findings)
