"""Look-ups in the tree of a robot: a small tree whose answers are written by hand, and what does not fit in a tree."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.robots.drives import finger_links_by_finger, links_moved_by
from mindstage.robots.models.link_tree import LinkTree, shape_points, sorted_tree
from mindstage.robots.models.robot_model import (
    BaseType,
    Gripper,
    GripperType,
    RobotBase,
    RobotJoint,
    RobotJointType,
    RobotLink,
    RobotMimic,
    RobotModel,
)
from mindstage.scene import Pose
from mindstage.scene.geometry import BodyGeometry, CollisionShape, CollisionShapeType

BOX = CollisionShape(type=CollisionShapeType.BOX, size=(0.2, 0.4, 0.6))
SOLID = BodyGeometry("box", (), (BOX,))


def link(name: str, *, is_solid: bool = True) -> RobotLink:
    return RobotLink(name=name, geometry=SOLID if is_solid else None)


def joint(
    name: str, parent: str, child: str, type: RobotJointType = RobotJointType.REVOLUTE, **more: object
) -> RobotJoint:
    return RobotJoint(name=name, parent=parent, child=child, type=type, **more)  # type: ignore[arg-type]


FIXED = RobotJointType.FIXED
LINKS = [
    link("base"),
    link("arm"),
    link("frame", is_solid=False),
    link("hand"),
    link("left"),
    link("right"),
    link("box"),
]
JOINTS = [
    joint("shoulder", "base", "arm"),
    joint("flange", "arm", "frame", FIXED),
    joint("mount", "frame", "hand", FIXED),
    joint("thumb", "hand", "left"),
    joint("finger", "hand", "right", mimic=RobotMimic(joint="thumb", multiplier=-1.0)),
    joint("screws", "base", "box", FIXED),
]
"""base -shoulder- arm - frame - hand -thumb- left, -finger- right; base - box; unnamed ones are fixed."""


@pytest.fixture(scope="module")
def tree() -> LinkTree:
    return LinkTree(LINKS, JOINTS)


def test_joints_above_and_between_links_are_in_order(tree: LinkTree) -> None:
    assert [each.name for each in tree.ancestors("left")] == ["thumb", "mount", "flange", "shoulder"]
    assert list(tree.ancestors("base")) == []
    chain = tree.chain("arm", "right")
    assert chain is not None
    assert [each.name for each in chain] == ["flange", "mount", "finger"]
    assert tree.chain("hand", "hand") == ()
    assert tree.chain("hand", "box") is None
    assert tree.chain("left", "arm") is None, "only downwards"
    assert {name: tree.depth(name) for name in tree.links} == {
        "base": 0,
        "arm": 1,
        "frame": 2,
        "hand": 3,
        "left": 4,
        "right": 4,
        "box": 1,
    }


def test_links_below_and_beside_a_link(tree: LinkTree) -> None:
    assert tree.root == "base"
    assert tree.subtree("arm") == ["arm", "frame", "hand", "left", "right"]
    assert tree.subtree("box") == ["box"]
    assert tree.rigid_links("arm") == ["arm", "frame", "hand"]
    assert tree.rigid_links("base") == ["base", "box"]
    assert tree.rigid_neighbors(["hand"]) == ["arm"], "without itself, and without what has no shape"
    assert tree.rigid_neighbors(["box", "left"]) == ["base"]
    assert tree.rigid_neighbors(["arm", "hand"]) == []


def test_links_beside_one_movable_joint_are_neighbors_with_all_that_is_fixed_to_them(tree: LinkTree) -> None:
    assert tree.neighbors() == {
        ("arm", "base"),
        ("base", "hand"),
        ("arm", "box"),
        ("box", "hand"),
        ("arm", "left"),
        ("hand", "left"),
        ("arm", "right"),
        ("hand", "right"),
    }


def test_followers_are_listed_by_what_they_follow(tree: LinkTree) -> None:
    assert {name: [each.name for each in joints] for name, joints in tree.followers.items()} == {"thumb": ["finger"]}


def test_poses_and_points_are_in_the_frame_of_the_root_or_of_a_link() -> None:
    turn = joint("shoulder", "base", "arm", axis=(0.0, 0.0, 1.0), origin=Pose((1.0, 0.0, 0.0)))
    reach = joint("reach", "arm", "hand", RobotJointType.PRISMATIC, axis=(1.0, 0.0, 0.0), origin=Pose((0.0, 0.0, 2.0)))
    tree = LinkTree([link("base"), link("arm"), link("hand")], [turn, reach])
    positions = {"shoulder": math.pi / 2, "reach": 0.5}
    poses = tree.poses(positions)
    assert poses["hand"][:3] == pytest.approx([1.0, 0.5, 2.0])
    below = tree.poses_below("arm", positions)
    assert below.keys() == {"arm", "hand"}
    assert below["hand"] == pytest.approx([0.5, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0])
    points = tree.points(["hand"], poses)
    assert len(points) == 8
    # the box is 0.2 m long along its own x, which is y of the root now
    assert points.min(axis=0) == pytest.approx([0.8, 0.4, 1.7])
    assert points.max(axis=0) == pytest.approx([1.2, 0.6, 2.3])
    assert [len(each) for each in tree.points_by_shape(["hand", "base"], poses)] == [8, 8]
    assert tree.points([], poses).shape == (0, 3)


# -- what is no tree ---------------------------------------------------------------------------------------------------


def test_joints_are_sorted_from_the_root_down() -> None:
    links, joints, notes = sorted_tree(
        [link("c"), link("b"), link("a")], [joint("two", "b", "c"), joint("one", "a", "b")]
    )
    assert [each.name for each in links] == ["a", "b", "c"]
    assert [each.name for each in joints] == ["one", "two"]
    assert notes == []


def test_what_closes_a_loop_or_is_apart_is_left_out_and_noted() -> None:
    links = [link("alone"), link("a"), link("b"), link("c"), link("x"), link("y")]
    given = [
        joint("one", "a", "b"),
        joint("two", "b", "c", mimic=RobotMimic(joint="other")),
        joint("again", "a", "c"),
        joint("other", "x", "y"),
    ]
    kept, joints, notes = sorted_tree(links, given)
    assert [each.name for each in kept] == ["a", "b", "c"], "of several roots that with the most links"
    assert [each.name for each in joints] == ["one", "two"]
    assert joints[1].mimic is None, "what it follows is left out"
    assert [(note.subject, note.text, note.is_guess) for note in notes] == [
        ("again", "it is left out, since c is already moved by two", False),
        ("alone", "it is left out, since no joint connects it to a", False),
        ("x", "it is left out, since no joint connects it to a", False),
        ("y", "it is left out, since no joint connects it to a", False),
    ]
    _, joints, _ = sorted_tree(links[1:4], [given[0], replace(given[1], mimic=RobotMimic(joint="one"))])
    assert joints[1].mimic == RobotMimic(joint="one")


def test_a_circle_begins_at_the_first_link() -> None:
    kept, joints, _ = sorted_tree([link("a"), link("b")], [joint("one", "a", "b"), joint("two", "b", "a")])
    assert [each.name for each in kept] == ["a", "b"]
    assert [each.name for each in joints] == ["one"]


# -- what joints and fingers move --------------------------------------------------------------------------------------


def test_a_joint_moves_all_links_below_it_and_each_finger_has_its_own() -> None:
    links = [*LINKS, link("left_tip"), link("right_tip"), link("nail")]
    joints = [
        *JOINTS,
        joint("left_end", "left", "left_tip", FIXED),
        joint("right_end", "right", "right_tip", FIXED),
        joint("nail_end", "right_tip", "nail", FIXED),
    ]
    model = RobotModel(
        name="r", links=tuple(links), joints=tuple(joints), base=RobotBase(type=BaseType.FIXED, link="base")
    )
    moved = {each.name: links_moved_by(model, each) for each in joints}
    assert moved["finger"] == {"right", "right_tip", "nail"}
    assert moved["shoulder"] == {each.name for each in links} - {"base", "box"}
    assert moved["screws"] == {"box"}
    gripper = Gripper(
        name="g",
        type=GripperType.OTHER,
        link="hand",
        joints=("thumb",),
        finger_links=("left_tip", "nail", "right_tip"),
        grasp_pose=Pose(),
        open_positions=(1.0,),
        closed_positions=(0.0,),
        max_opening_m=0.1,
    )
    assert set(finger_links_by_finger(model, gripper)) == {
        frozenset({"left", "left_tip"}),
        frozenset({"right", "right_tip", "nail"}),
    }


# -- points of shapes --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("type", [each for each in CollisionShapeType if each is not CollisionShapeType.HULL])
def test_the_points_of_a_shape_reach_its_bounds_and_stay_on_it(type: CollisionShapeType) -> None:
    size = (0.2, 0.2, 0.2) if type is CollisionShapeType.SPHERE else (0.2, 0.4, 0.6)
    points = shape_points(CollisionShape(type=type, size=size))
    half = np.array(size) / 2
    assert points.max(axis=0) == pytest.approx(half, abs=1e-9)
    assert points.min(axis=0) == pytest.approx(-half, abs=1e-9)
    relative = points / half
    match type:
        case CollisionShapeType.BOX:
            assert np.abs(relative) == pytest.approx(1.0)
            assert len(np.unique(points, axis=0)) == 8
        case CollisionShapeType.CYLINDER:
            assert np.hypot(relative[:, 0], relative[:, 1]) == pytest.approx(1.0)
            assert np.abs(relative[:, 2]) == pytest.approx(1.0)
        case _:
            assert np.linalg.norm(relative, axis=1) == pytest.approx(1.0)


def test_the_points_of_a_moved_hull_are_in_the_frame_of_the_body() -> None:
    corners = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    pose = Pose((5.0, 0.0, 0.0), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))
    points = shape_points(CollisionShape(type=CollisionShapeType.HULL, size=(1.0, 1.0, 1.0), points=corners, pose=pose))
    expected = [[5.0, 0.0, 0.0], [5.0, 1.0, 0.0], [4.0, 0.0, 0.0], [5.0, 0.0, 1.0]]
    assert points == pytest.approx(np.array(expected))
