"""Frames of tf: names that ROS accepts, and a tree whose composition gives the poses, for any world."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from mindstage.errors import BodyNotFoundError
from mindstage.ros.frames import ROOT_FRAME, FrameNames, FrameTransforms, FrameTree
from mindstage.ros.state import StateReader
from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Joint,
    LinearLimits,
    Mobility,
    Pose,
    World,
)
from mindstage.scene.transforms import normalize, pose_multiply
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette

VALID = re.compile(r"[A-Za-z0-9_.-][A-Za-z0-9_./-]*")


@given(st.lists(st.text(max_size=6), max_size=20))
def test_frame_ids_are_valid_unique_and_stable(ids: list[str]) -> None:
    names = FrameNames()
    frames = names.assign(ids)
    assert all(VALID.fullmatch(frame) for frame in frames)
    assert not {"map", "world"} & set(frames)
    assert len(set(frames)) == len(set(ids))
    assert names.assign(reversed(ids)) == frames[::-1]
    assert [names.id_of(frame) for frame in frames] == ids
    unchanged = [id for id in ids if VALID.fullmatch(id) and id not in {"map", "world"}]
    assert names.assign(unchanged) == unchanged


def test_a_valid_id_that_comes_later_does_not_change_a_frame_id() -> None:
    names = FrameNames()
    assert names.assign(["a b", "map"]) == ["a_b", "map_2"]
    assert names.assign(["a_b", "a b", "/a"]) == ["a_b_2", "a_b", "a"]
    assert names.id_of("nobody") is None


def composed(*parts: FrameTransforms) -> dict[str, Any]:
    edges = {
        child: (parent, pose)
        for part in parts
        for parent, child, pose in zip(part.parents, part.children, part.poses, strict=True)
    }
    assert sum(len(part.children) for part in parts) == len(edges)

    def pose_of(frame: str) -> Any:
        if frame == ROOT_FRAME:
            return np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        parent, pose = edges[frame]
        return pose_multiply(pose_of(parent), pose)  # a cycle would not end

    return {frame: pose_of(frame) for frame in edges}


numbers = st.floats(-3.0, 3.0)
poses = st.builds(
    lambda x, y, z, turn: Pose((x, y, z), turn),
    numbers,
    numbers,
    numbers,
    st.tuples(numbers, numbers, numbers, numbers).filter(lambda turn: sum(part * part for part in turn) > 1e-2),
)
IDS = tuple(map(BodyId, "abcdefg"))
pairs = st.tuples(st.sampled_from(IDS), st.sampled_from(IDS))
joints = st.builds(
    lambda number, ends, pose, hinge: Joint(
        id=BodyId(f"j{number}"),
        iri=Iri(f"http://x.org/#j{number}"),
        parent=ends[0],
        child=ends[1],
        pose=pose,
        angular=AngularLimits(swing1=AxisMotion.FREE if hinge else AxisMotion.LOCKED),
        linear=LinearLimits(),
    ),
    st.integers(0, 5),
    pairs.filter(lambda ends: ends[0] != ends[1]),
    poses,
    st.booleans(),
)
bodies = st.tuples(
    *(
        st.builds(
            lambda pose, mobility, name=id: Body(
                id=name, iri=Iri(f"http://x.org/#{name}"), cls=Iri("http://x.org/#Thing"), pose=pose,
                size=(1.0, 1.0, 1.0), physics=BodyPhysics(mobility=mobility),
            ),
            poses,
            st.sampled_from([*Mobility, None]),
        )
        for id in IDS
    )
)  # fmt: skip
worlds = st.builds(
    lambda bodies, joints, attachments: World(
        iri=Iri("http://x.org/#map"), bodies=bodies, joints=joints, attachments=attachments
    ),
    bodies,
    st.lists(joints, max_size=4, unique_by=lambda joint: joint.id).map(tuple),
    st.lists(pairs, max_size=5).map(lambda ends: tuple(Attachment(parent=one, child=other) for one, other in ends)),
)


@given(worlds, st.tuples(*(poses for _ in IDS)), st.sets(st.sampled_from(IDS)))
def test_composed_transforms_are_the_poses_even_with_cycles_and_removed_bodies(
    world: World, now: tuple[Pose, ...], removed: set[BodyId]
) -> None:
    tree = FrameTree(world, [world], FrameNames())
    rows = {id: np.array([*pose.position, *pose.quaternion]) for id, pose in zip(IDS, now, strict=True)}
    for ids in (IDS, tuple(id for id in reversed(IDS) if id not in removed)):
        poses = np.array([rows[id] for id in ids]).reshape(-1, 7)
        there = composed(*tree.transforms(ids, poses))
        assert {frame for frame in there if not frame.startswith("j")} == set(ids)
        for id in ids:
            expected, found = rows[id].copy(), there[id]
            expected[3:] = normalize(expected[3:])
            assert found[:3] == pytest.approx(expected[:3], abs=1e-9)
            assert abs(np.dot(found[3:], expected[3:])) == pytest.approx(1.0, abs=1e-9)


def test_poses_are_in_the_frame_of_a_body_by_its_id_or_its_frame_id(simulation: Simulation) -> None:
    strange = replace(kitchenette().bodies[-1], id=BodyId("my mug"), iri=Iri("http://x.org/#m"), pose=Pose((0, 9, 1)))
    simulation.spawn(World(iri=Iri("http://x.org/#map"), bodies=(strange,)))
    reader = StateReader(simulation)
    for frame in ("my mug", "my_mug", "/my_mug"):
        assert reader.to_world_frame(Pose((1.0, 2.0, 3.0)), frame).position == pytest.approx((1.0, 11.0, 4.0))
    with pytest.raises(BodyNotFoundError):
        reader.to_world_frame(Pose(), "my-mug")
