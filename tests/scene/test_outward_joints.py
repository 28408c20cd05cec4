"""Ranges on both sides of the closed position are limited to the outside where handle and casing show it."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from msgspec.structs import replace
from tests.cases import each_case
from tests.engines.scenes import attachment, body, prismatic_joint, revolute_joint, world

from mindstage.scene import AngularLimits, AxisMotion, Body, Joint, LinearLimits, Mobility, Pose, Tag, World
from mindstage.scene.joint_kinematics import (
    ObservedBox,
    OutwardJoint,
    axis_ranges,
    coupled_positions,
    front_side,
    handles_by_body,
    outward_joints,
)
from mindstage.scene.transforms import quat_multiply, quat_rotate
from mindstage.scene.world_model import BodyId, Iri, JointMimic

YAWS = (0.0, pi / 2, pi, 0.7)


def turned(world_: World, yaw: float) -> World:
    """A world turned about the vertical through the origin."""
    rotation = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])

    def pose(old: Pose) -> Pose:
        x, y, z = quat_rotate(rotation, np.array(old.position)).tolist()
        w, i, j, k = quat_multiply(rotation, np.array(old.quaternion)).tolist()
        return Pose((x, y, z), (w, i, j, k))

    return replace(
        world_,
        bodies=tuple(replace(each, pose=pose(each.pose)) for each in world_.bodies),
        joints=tuple(replace(each, pose=pose(each.pose)) for each in world_.joints),
    )


def cupboard(*, handles: bool = True, side: int = 1) -> World:
    """A cupboard with its front at +x: a drawer, a door hinged at +y or -y, and a flap hinged at its foot."""
    parts: list[Body | Joint] = [
        body("case", (0, 0, 1.0), (0.6, 0.8, 1.6)),
        body("drawer", (0.03, 0, 0.4), (0.54, 0.78, 0.2), "dynamic", 4.0),
        body("door", (0.31, 0, 1.2), (0.02, 0.78, 0.5), "dynamic", 4.0),
        body("flap", (0.31, 0, 1.7), (0.02, 0.78, 0.2), "dynamic", 2.0),
        prismatic_joint("slide", "case", "drawer", (0.3, 0, 0.4)),
        revolute_joint("hinge", "case", "door", (0.32, side * 0.39, 1.2)),
        replace(
            revolute_joint("tilt", "case", "flap", (0.32, 0, 1.6)),
            angular=AngularLimits(swing2=AxisMotion.LIMITED, swing2_limit=1.0),
        ),
    ]
    if not handles:
        return world(*parts)
    grips = [("drawer", (0.32, 0, 0.4)), ("door", (0.34, -side * 0.3, 1.2)), ("flap", (0.34, 0, 1.75))]
    knob = Iri("http://example.org/things.owl#BarHandle")
    bodies = [replace(body(f"{id}_grip", at, (0.03, 0.1, 0.02), "kinematic", 0.1), cls=knob) for id, at in grips]
    return world(*parts, *bodies, *(attachment(id, f"{id}_grip") for id, _ in grips))


def limited(world_: World) -> dict[BodyId, OutwardJoint]:
    bodies = {each.id: each for each in world_.bodies}
    parents = {each.child: each.parent for each in world_.attachments}
    return outward_joints(world_.joints, bodies, handles_by_body(bodies, parents))


def interval(joint: Joint) -> tuple[float, float]:
    [found] = [each for each in axis_ranges(joint) if each.motion is AxisMotion.LIMITED]
    return found.middle - found.limit, found.middle + found.limit


@each_case("yaw", YAWS)
@each_case("side", [1, -1])
def test_doors_and_drawers_with_handles_open_outwards_only(side: int, yaw: float) -> None:
    found = limited(turned(cupboard(side=side), yaw))
    assert interval(found[BodyId("slide")].joint) == pytest.approx((0.0, 0.45))
    # Turning on takes a door hinged at +y outwards, which extends to -y.
    expected = (0.0, pi / 4) if side == 1 else (-pi / 4, 0.0)
    assert interval(found[BodyId("hinge")].joint) == pytest.approx(expected)
    assert interval(found[BodyId("tilt")].joint) == pytest.approx((0.0, 1.0))
    assert "slide would let drawer slide 0.45 m into case; its handle is 29 cm" in found[BodyId("slide")].text
    assert "so it only opens outwards" in found[BodyId("hinge")].text


@pytest.mark.parametrize("yaw", YAWS)
def test_what_is_in_the_front_of_its_casing_needs_no_handle(yaw: float) -> None:
    """There is room behind a drawer whose one end is in the front; one in the middle of its case shows no front."""
    found = limited(turned(cupboard(handles=False), yaw))
    assert interval(found[BodyId("hinge")].joint) == pytest.approx((0.0, pi / 4))
    assert "on that side of its casing" in found[BodyId("hinge")].text
    assert interval(found[BodyId("slide")].joint) == pytest.approx((0.0, 0.45))
    assert "its other end is 6 cm from the back" in found[BodyId("slide")].text
    middle = [replace(each, pose=Pose((0.0, 0, 0.4), each.pose.quaternion)) for each in cupboard().bodies[1:2]]
    old = cupboard(handles=False)
    inside = replace(old, bodies=(old.bodies[0], *middle, *old.bodies[2:]))
    assert BodyId("slide") not in limited(turned(inside, yaw))


@pytest.mark.parametrize("yaw", YAWS)
@pytest.mark.parametrize("side", [1, -1])
def test_sliding_doors_stay_before_their_casing(yaw: float, side: int) -> None:
    old = cupboard(handles=False)
    leaf = body("door", (0.33, side * 0.2, 1.0), (0.02, 0.42, 1.5), "dynamic", 4.0)
    slide = replace(
        prismatic_joint("slide", "case", "door", (0.33, side * 0.2, 1.0)),
        linear=LinearLimits(y=AxisMotion.LIMITED, limit=0.38),
    )
    found = limited(turned(replace(old, bodies=(old.bodies[0], leaf), joints=(slide,)), yaw))
    assert interval(found[BodyId("slide")].joint) == pytest.approx((-0.38, 0.0) if side == 1 else (0.0, 0.38))


def test_swapping_parent_and_child_reverses_the_range() -> None:
    swapped = cupboard()
    joints = tuple(replace(each, parent=each.child, child=each.parent) for each in swapped.joints)
    found = limited(replace(swapped, joints=joints))
    assert interval(found[BodyId("slide")].joint) == pytest.approx((-0.45, 0.0))
    assert interval(found[BodyId("hinge")].joint) == pytest.approx((-pi / 4, 0.0))


def test_the_joints_of_a_robot_keep_the_ranges_of_its_model() -> None:
    """A lift on a mast, at half of its height, is not a drawer."""
    old = cupboard()
    parts = tuple(replace(each, tags=(Tag(type="robot", key="name", value="helper"),)) for each in old.bodies)
    assert len(limited(old)) == 3
    assert limited(replace(old, bodies=parts)) == {}


def test_a_range_on_one_side_is_kept_as_it_is() -> None:
    old = cupboard()
    opening = LinearLimits(x=AxisMotion.LIMITED, limit=0.2, x_middle=-0.2)
    joints = (replace(old.joints[0], linear=opening), *old.joints[1:])
    assert BodyId("slide") not in limited(replace(old, joints=joints)), "although it opens backwards"
    play = LinearLimits(x=AxisMotion.LIMITED, limit=0.2, x_middle=0.195)
    joints = (replace(old.joints[0], linear=play), *old.joints[1:])
    assert BodyId("slide") not in limited(replace(old, joints=joints))


def test_doors_in_walls_swing_doors_and_knobs_keep_both_directions() -> None:
    wall = body("wall", (0, 1.5, 1.0), (0.1, 2.0, 2.0))
    door = body("door", (0, 0, 1.0), (0.05, 0.9, 2.0), "dynamic", 15.0)
    knob = body("knob", (0.1, 1.5, 1.0), (0.03, 0.04, 0.04), "dynamic", 0.1)
    turn = replace(
        revolute_joint("turn", "wall", "knob", (0.1, 1.5, 1.0)),
        angular=AngularLimits(twist=AxisMotion.LIMITED, twist_limit=1.0),
    )
    assert limited(world(wall, door, knob, revolute_joint("hinge", "wall", "door", (0, 0.45, 1.0)), turn)) == {}


def test_a_room_is_no_casing() -> None:
    room = body("room", (0, 0, 1.5), (6.0, 5.0, 3.0))
    door = body("door", (2.9, 0, 1.0), (0.05, 0.9, 2.0), "dynamic", 15.0)
    assert limited(world(room, door, revolute_joint("hinge", "room", "door", (2.9, 0.45, 1.0)))) == {}


def test_a_handle_on_the_inside_of_a_door_does_not_turn_it_round() -> None:
    old = cupboard()
    bodies = tuple(
        replace(each, pose=Pose((0.28, -0.3, 1.2))) if each.id == "door_grip" else each for each in old.bodies
    )
    assert interval(limited(replace(old, bodies=bodies))[BodyId("hinge")].joint) == pytest.approx((0.0, pi / 4))


def test_without_evidence_there_is_no_front() -> None:
    case, drawer = cupboard().bodies[:2]
    drawer = replace(drawer, pose=Pose((0.0, 0, 0.4), drawer.pose.quaternion))
    assert front_side(ObservedBox.of(drawer), ObservedBox.of(case), None, np.array([1.0, 0, 0])) is None
    assert case.physics.mobility is Mobility.STATIC


# -- coupled joints ----------------------------------------------------------------------------------------------------


def chain(*mimics: JointMimic | None) -> dict[BodyId, Joint]:
    joints = [prismatic_joint(f"j{n}", "a", "b", (0, 0, 0), mimic=each) for n, each in enumerate(mimics)]
    return {joint.id: joint for joint in joints}


def test_positions_follow_along_a_chain_in_both_directions() -> None:
    joints = chain(
        None,
        JointMimic(joint=BodyId("j0"), multiplier=2.0, offset=0.1),
        JointMimic(joint=BodyId("j1"), multiplier=-1.0),
        None,
    )
    assert coupled_positions(joints, BodyId("j0"), 0.2) == pytest.approx({"j1": 0.5, "j2": -0.5})
    assert coupled_positions(joints, BodyId("j2"), -0.5) == pytest.approx({"j1": 0.5, "j0": 0.2})
    assert coupled_positions(joints, BodyId("j3"), 1.0) == {}


def test_a_circle_of_followers_ends_and_a_multiplier_of_zero_has_no_effect_on_the_master() -> None:
    joints = chain(JointMimic(joint=BodyId("j1")), JointMimic(joint=BodyId("j0")))
    assert coupled_positions(joints, BodyId("j0"), 0.3) == {"j1": 0.3}
    still = chain(None, JointMimic(joint=BodyId("j0"), multiplier=0.0, offset=0.2))
    assert coupled_positions(still, BodyId("j1"), 0.1) == {}
    assert coupled_positions(still, BodyId("j0"), 0.1) == {"j1": 0.2}
