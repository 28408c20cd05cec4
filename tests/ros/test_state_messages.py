"""Messages of the state of the world: joints, markers, highlights and transforms, with values by hand."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.errors import EngineError
from mindstage.msgs import RosVersion, encode
from mindstage.ros.frames import FrameNames, FrameTransforms, FrameTree, joint_frames
from mindstage.ros.publishers import (
    highlight_groups,
    joint_state_message,
    tf_message,
    tf_static_message,
    world_marker_array,
)
from mindstage.scene import (
    AngularLimits,
    AxisMotion,
    Body,
    BodyId,
    Joint,
    LinearLimits,
    Material,
    Pose,
    PrimitiveShape,
    PrimitiveType,
    World,
)
from tests.kitchenette import kitchenette

MUG, DRAWER, FLOOR = BodyId("Mug"), BodyId("Drawer"), BodyId("Floor")
STAMP = {"sec": 2, "nanosec": 500_000_000}
ROUND = Pose((2.0, 0.0, 0.85), (0.5, 0.5, -0.5, 0.5))
"""A pose whose numbers are all different in an order other than w, x, y, z."""


@pytest.fixture
def sim() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        sim.edits.move(MUG, replace(ROUND, position=(2.0, 0.25, 0.85)))
        sim.step(2.5)
        yield sim


@pytest.mark.parametrize("ros", [RosVersion.ONE, RosVersion.TWO], ids=str)
def test_transforms_have_their_frames_and_the_scalar_part_last(ros: RosVersion) -> None:
    poses = np.array([(1.0, 2.0, 3.0, 0.5, 0.5, -0.5, 0.5), (4.0, 5.0, 6.0, 1.0, 0.0, 0.0, 0.0)])
    transforms = FrameTransforms(("map", "a"), ("a", "b"), poses)
    found = tf_message(transforms, time_s=2.5, ros=ros)["transforms"]
    assert [(each["header"]["frame_id"], each["child_frame_id"]) for each in found] == [("map", "a"), ("a", "b")]
    stamps = [each["header"]["stamp"] for each in found]
    assert stamps == [STAMP if ros is RosVersion.TWO else {"secs": 2, "nsecs": 500_000_000}] * 2
    assert found[0]["transform"] == {
        "translation": {"x": 1.0, "y": 2.0, "z": 3.0},
        "rotation": {"x": 0.5, "y": -0.5, "z": 0.5, "w": 0.5},
    }
    static = tf_static_message(transforms, time_s=2.5, ros=ros)["transforms"]
    assert static[1:] == found
    assert (static[0]["header"]["frame_id"], static[0]["child_frame_id"]) == ("map", "world")
    assert static[0]["transform"]["translation"] == {"x": 0.0, "y": 0.0, "z": 0.0}
    assert static[0]["transform"]["rotation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    with pytest.raises(EngineError, match="not finite"):
        tf_message(FrameTransforms(("map",), ("a",), poses[:1] * math.nan), time_s=0.0, ros=ros)


def test_every_axis_of_every_joint_has_its_position(sim: Simulation) -> None:
    slide, hinge = kitchenette().joints
    ball = replace(
        hinge,
        id=BodyId("Ball"),
        linear=LinearLimits(y=AxisMotion.FREE),
        angular=AngularLimits(twist=AxisMotion.LIMITED, twist_limit=1.0, swing2=AxisMotion.FREE),
    )
    fixed = replace(hinge, id=BodyId("Fixed"), angular=AngularLimits())
    joints: list[Joint] = [slide, ball, fixed, hinge, replace(slide, id=BodyId("Lost"))]
    positions = {
        each.id: tuple(10.0 * number + axis for axis in range(6)) for number, each in enumerate(joints[:4], start=1)
    }
    found = joint_state_message(sim.state, joints, positions)
    assert dict(zip(found.name, found.position, strict=True)) == {
        "DrawerSlide": 10.0,
        "Ball/y": 21.0,
        "Ball/twist": 23.0,
        "Ball/swing2": 24.0,
        "FridgeHinge": 45.0,
    }
    assert found.header.frame_id == "world"
    assert encode(found.header)["stamp"] == STAMP


def markers_of(sim: Simulation, bodies: list[Body]) -> list[dict[str, Any]]:
    return list(world_marker_array(sim.state, bodies, ros=RosVersion.TWO)["markers"])


def test_every_body_is_a_marker_and_those_of_before_are_removed_first(sim: Simulation) -> None:
    sim.highlight([DRAWER], (0.25, 0.5, 0.75))
    bodies = list(sim.snapshot().bodies)
    bodies[0] = replace(
        bodies[0],
        materials=(Material(name="red", color=(0.1, 0.2, 0.3)),),
        shape=PrimitiveShape(type=PrimitiveType.CYLINDER),
    )
    bodies[1] = replace(bodies[1], shape=PrimitiveShape(type=PrimitiveType.SPHERE), size=None)
    first, *markers = markers_of(sim, bodies[:-1])
    assert first["action"] == 3, "DELETEALL"
    assert [each["text"] for each in markers] == list(sim.state.ids)
    assert len({each["id"] for each in markers}) == len(markers)
    assert {each["action"] for each in markers} == {0}
    assert {(each["header"]["frame_id"], each["ns"]) for each in markers} == {("world", "mindstage")}
    by_text = {each["text"]: each for each in markers}
    assert by_text["Mug"]["pose"] == {
        "position": {"x": 2.0, "y": 0.25, "z": 0.85},
        "orientation": {"x": 0.5, "y": -0.5, "z": 0.5, "w": 0.5},
    }
    assert by_text["Floor"]["scale"] == {"x": 6.0, "y": 6.0, "z": 0.1}
    assert by_text["Floor"]["color"] == {"r": 0.1, "g": 0.2, "b": 0.3, "a": 1.0}
    assert by_text["Drawer"]["color"] == {"r": 0.25, "g": 0.5, "b": 0.75, "a": 1.0}
    assert by_text["Cupboard"]["scale"] == {"x": 0.05, "y": 0.05, "z": 0.05}, "its size is unknown"
    assert by_text["Mug"]["scale"] == by_text["Cupboard"]["scale"], "nothing is known about it"
    assert [by_text[name]["type"] for name in ("Floor", "Cupboard", "Drawer", "Mug")] == [3, 2, 1, 1]
    assert len(set(by_text["Fridge"]["color"].values())) == 2, "gray"


def test_every_group_of_highlights_is_in_the_message(sim: Simulation) -> None:
    sim.highlight([DRAWER, MUG], (1.0, 0.0, 0.0), label="first")
    sim.highlight([FLOOR], (0.0, 0.0, 1.0), label="second")
    found = highlight_groups(sim.state).groups
    assert [(each.ids, each.label) for each in found] == [((DRAWER, MUG), "first"), ((FLOOR,), "second")]
    colors = [(each.color.r, each.color.g, each.color.b, each.color.a) for each in found]
    assert colors == [(1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)]


# -- frames ------------------------------------------------------------------------------------------------------------


def test_the_frame_of_a_joint_is_fixed_to_what_it_moves_for_either_order_of_its_bodies() -> None:
    world = kitchenette()
    slide = world.joints[0]
    for joint in (slide, replace(slide, parent=slide.child, child=slide.parent)):
        (found,) = joint_frames(replace(world, joints=(joint,)), [world])
        assert (found.moving, found.fixed) == (DRAWER, "Cupboard")
        assert found.moving_from_joint[:3] == pytest.approx([0.0, 0.0, 0.0])
        assert found.fixed_from_joint[:3] == pytest.approx([-0.05, 0.0, 0.25])
    moved = replace(
        world, bodies=tuple(replace(each, pose=ROUND) if each.id == DRAWER else each for each in world.bodies)
    )
    (found,) = joint_frames(replace(moved, joints=(slide,)), [world])
    assert found.moving_from_joint[:3] == pytest.approx([0.0, 0.0, 0.0]), "as it was spawned"
    (found,) = joint_frames(replace(world, joints=(slide,)), [])
    assert found.moving_from_joint[:3] == pytest.approx([0.0, 0.0, 0.0]), "where it is, if a client has added it"
    assert found.fixed_from_joint[:3] == pytest.approx([-0.05, 0.0, 0.25])


@pytest.mark.parametrize("first", ["Floor", "Cupboard", "Drawer", "FridgeDoor"])
def test_the_tree_has_joints_between_bodies_and_splits_what_moves_from_what_does_not(first: str) -> None:
    world = kitchenette()
    world = replace(world, bodies=tuple(sorted(world.bodies, key=lambda body: body.id != first)))
    tree = FrameTree(world, [world], FrameNames())
    ids = tuple(body.id for body in world.bodies)
    poses = np.array([(*body.pose.position, *body.pose.quaternion) for body in world.bodies])
    poses[ids.index(DRAWER), 0] -= 0.25
    moving, static = tree.transforms(ids, poses)
    parents = dict(zip((*moving.children, *static.children), (*moving.parents, *static.parents), strict=True))
    assert parents == {
        "Floor": "map",
        "Cupboard": "map",
        "Fridge": "map",
        "Mug": "map",
        "DrawerSlide": "Cupboard",
        "Drawer": "DrawerSlide",
        "DrawerHandle": "Drawer",
        "FridgeHinge": "Fridge",
        "FridgeDoor": "FridgeHinge",
        "FridgeHandle": "FridgeDoor",
    }
    assert {"DrawerSlide", "FridgeHinge", "Mug"} <= set(moving.children)
    assert {"Floor", "Cupboard", "Fridge"} <= set(static.children)
    by_child = dict(zip(moving.children, moving.poses, strict=True)) | dict(
        zip(static.children, static.poses, strict=True)
    )
    assert by_child["DrawerSlide"][:3] == pytest.approx([-0.3, 0.0, 0.25]), "0.05 m and the 0.25 m by which it is open"
    assert by_child["Drawer"][:3] == pytest.approx([0.0, 0.0, 0.0])
    assert by_child["DrawerHandle"][:3] == pytest.approx([-0.02, 0.0, 0.0]), "the handle has stayed"
    rest = [id for id in ids if id != "Cupboard"]
    moving, static = tree.transforms(rest, poses[[ids.index(id) for id in rest]])
    parents = dict(zip((*moving.children, *static.children), (*moving.parents, *static.parents), strict=True))
    assert "Cupboard" not in parents
    assert parents["DrawerSlide"] == "map", "what held it is gone"


def test_a_preferred_frame_is_used_where_it_is_free() -> None:
    names = FrameNames()
    assert names.assign(["a b", "a_b", "x"]) == ["a_b_2", "a_b", "x"]
    names.prefer({"x": "gripper/x", "a b": "a_b"})
    assert names.assign(["x", "a b", "a_b"]) == ["gripper/x", "a_b_2", "a_b"]
    assert (names.id_of("gripper/x"), names.id_of("x"), names.id_of("a_b")) == ("x", None, "a_b")
    assert names.assign(["y x", "x2"]) == ["y_x", "x2"]
    empty = FrameTree(World(iri=kitchenette().iri), [], names)
    moving, static = empty.transforms((), np.zeros((0, 7)))
    assert (moving.children, static.children) == ((), ())
