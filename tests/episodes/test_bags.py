"""Bags as recordings: the truth is computed with matrices, and the bags are written by rosbags alone."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from itertools import pairwise
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from mindstage.episodes import Recording
from mindstage.episodes.bags import RosBag
from mindstage.errors import BodyNotFoundError, EpisodeError, EpisodeFileError, EpisodeTimeError
from mindstage.scene import BodyId, Iri
from tests.episodes.bag_files import BAG_FORMATS, JointReading, Transform, matrix, matrix_of_pose, write_bag
from tests.kitchenette import kitchenette

each_format = pytest.mark.parametrize("format", BAG_FORMATS)
TIMES = np.arange(31) / 10.0


def pose_of(bag: RosBag, id: str, time_s: float) -> Any:
    frame = bag.frame_at(time_s)
    return matrix_of_pose(frame.poses[frame.ids.index(BodyId(id))])


def map_pose(id: str) -> Any:
    pose = kitchenette().body(id).pose
    return matrix_of_pose([*pose.position, *pose.quaternion])


def drive(time_s: float) -> Any:
    """The base of a robot on an arc."""
    return matrix([0.3 * time_s, 0.1 * time_s**2, 0.0], yaw=0.4 * time_s)


def reach(time_s: float) -> Any:
    """The hand of a robot in its base."""
    return matrix([0.5, 0.02 * time_s, 0.9], pitch=0.2 * time_s, roll=-0.3)


HELD = matrix([0.01, 0.02, 0.15], yaw=pi / 3)
"""The mug in the hand."""
ODOM = matrix([1.0, -2.0, 0.0], yaw=0.5)
"""The odometry's origin in the map."""


def carried_mug() -> list[Transform]:
    messages = [Transform(0.0, "map", "odom", ODOM, static=True)]
    for time in TIMES:
        messages += [
            Transform(time, "odom", "base_link", drive(time)),
            Transform(time, "base_link", "hand", reach(time)),
            Transform(time, "hand", "Mug", HELD),
        ]
    return messages


@each_format
def test_a_body_in_the_hand_of_a_robot_is_where_the_product_of_the_matrices_is(format: str, tmp_path: Path) -> None:
    bag = RosBag(write_bag(tmp_path, format, carried_mug(), start_s=1.7e9), kitchenette())
    assert isinstance(bag, Recording)
    assert (bag.begin_s, bag.end_s) == (0.0, pytest.approx(3.0, abs=1e-9))
    assert bag.start_unix_s == pytest.approx(1.7e9, abs=1e-6)
    assert [frame.time_s for frame in bag.frames()] == pytest.approx(TIMES, abs=1e-9)
    for time in TIMES:
        truth = ODOM @ drive(time) @ reach(time) @ HELD
        np.testing.assert_allclose(pose_of(bag, "Mug", min(time + 1e-6, bag.end_s)), truth, atol=1e-9)


@each_format
def test_what_has_no_frame_stays_as_in_the_map_and_is_listed(format: str, tmp_path: Path) -> None:
    world = kitchenette()
    bag = RosBag(write_bag(tmp_path, format, carried_mug()), world)
    assert bag.matched == {"Mug": "Mug"}
    assert set(bag.unmatched_frames) == {"odom", "base_link", "hand"}
    assert set(bag.unmatched_bodies) == {body.id for body in world.bodies} - {"Mug"}
    text = "\n".join(bag.findings)
    assert "base_link" in text
    assert "7 bodies without a frame" in text
    last = bag.frame_at(bag.end_s).world()
    assert {body.id: body.pose for body in last.bodies if body.id != "Mug"} == {
        body.id: body.pose for body in world.bodies if body.id != "Mug"
    }


def test_times_are_those_of_the_simulation_if_the_clock_is_simulated(tmp_path: Path) -> None:
    bag = RosBag(write_bag(tmp_path, "sqlite3", carried_mug(), start_s=12.0), kitchenette())
    assert bag.start_unix_s is None
    assert bag.begin_s == 0.0


def test_a_transform_without_a_stamp_has_the_time_at_which_it_was_recorded(tmp_path: Path) -> None:
    messages = [
        Transform(-5.0, "map", "Mug", matrix([time, 0.0, 0.0]), logged_s=time) for time in (0.0, 0.5, 1.0)
    ]  # -5 + 5 is 0
    bag = RosBag(write_bag(tmp_path, "mcap", messages, start_s=5.0), kitchenette())
    assert [frame.time_s for frame in bag.frames()] == pytest.approx([0.0, 0.5, 1.0])


def test_frames_without_stamps_are_put_on_the_clock_of_the_others(tmp_path: Path) -> None:
    start = 1.7e9
    stamped = [Transform(time, "map", "hand", drive(time), logged_s=start + time) for time in TIMES]
    unstamped = [Transform(0.0, "hand", "Mug", matrix([time, 0, 0]), logged_s=start + time) for time in TIMES]
    messages = sorted([*stamped, *unstamped], key=lambda each: each.logged_s or 0.0)
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette())
    assert bag.end_s == pytest.approx(3.0)
    np.testing.assert_allclose(pose_of(bag, "Mug", 1.5 + 1e-5), drive(1.5) @ matrix([1.5, 0, 0]), atol=1e-4)


def test_bodies_attached_to_a_moved_body_follow_it(tmp_path: Path) -> None:
    door = [Transform(time, "map", "FridgeDoor", matrix([time, 1.0, 0.5], yaw=-time)) for time in TIMES]
    bag = RosBag(write_bag(tmp_path, "mcap", door), kitchenette())
    door_from_handle = np.linalg.inv(map_pose("FridgeDoor")) @ map_pose("FridgeHandle")
    for time in TIMES:
        at = min(time + 1e-6, bag.end_s)
        truth = matrix([time, 1.0, 0.5], yaw=-time) @ door_from_handle
        np.testing.assert_allclose(pose_of(bag, "FridgeHandle", at), truth, atol=1e-9)
    assert "FridgeHandle" not in bag.unmatched_bodies


@each_format
def test_joint_states_move_doors_and_drawers_with_their_handles(format: str, tmp_path: Path) -> None:
    messages = [JointReading(time, {"DrawerSlide": -0.1 * time, "FridgeHinge": -0.2 * time}) for time in TIMES]
    bag = RosBag(write_bag(tmp_path, format, messages), kitchenette())
    assert bag.matched_joints == {"DrawerSlide": "DrawerSlide", "FridgeHinge": "FridgeHinge"}
    hinge = matrix([1.68, 1.3, 0.9])
    for time in TIMES:
        at = min(time + 1e-6, bag.end_s)
        np.testing.assert_allclose(
            pose_of(bag, "DrawerHandle", at), matrix([-0.1 * time, 0, 0]) @ map_pose("DrawerHandle"), atol=1e-9
        )
        turned = hinge @ matrix([0, 0, 0], yaw=-0.2 * time) @ np.linalg.inv(hinge)
        np.testing.assert_allclose(pose_of(bag, "FridgeDoor", at), turned @ map_pose("FridgeDoor"), atol=1e-9)
        np.testing.assert_allclose(pose_of(bag, "FridgeHandle", at), turned @ map_pose("FridgeHandle"), atol=1e-9)
        joints = bag.frame_at(at).joint_positions
        assert joints is not None
        assert joints[BodyId("DrawerSlide")] == pytest.approx((-0.1 * time, 0, 0, 0, 0, 0))
        assert joints[BodyId("FridgeHinge")] == pytest.approx((0, 0, 0, 0, 0, -0.2 * time))


def test_a_joint_whose_child_is_what_holds_it_moves_the_other_body(tmp_path: Path) -> None:
    world = kitchenette()
    slide = world.joints[0]
    reversed_world = replace(world, joints=(replace(slide, parent=slide.child, child=slide.parent), world.joints[1]))
    bag = RosBag(
        write_bag(tmp_path, "mcap", [JointReading(0.0, {"DrawerSlide": 0.1}), JointReading(1.0, {"DrawerSlide": 0.3})]),
        reversed_world,
    )
    # The child moves by 0.3 m relative to the parent, so the parent moves by -0.3 m relative to the child.
    np.testing.assert_allclose(pose_of(bag, "Drawer", 1.0), matrix([-0.3, 0, 0]) @ map_pose("Drawer"), atol=1e-9)
    np.testing.assert_allclose(pose_of(bag, "Cupboard", 1.0), map_pose("Cupboard"), atol=1e-12)


def test_the_position_of_a_joint_is_measured_if_its_door_has_a_frame(tmp_path: Path) -> None:
    hinge = matrix([1.68, 1.3, 0.9])
    messages = [
        Transform(
            time,
            "map",
            "FridgeDoor",
            hinge @ matrix([0, 0, 0], yaw=-0.25 * time) @ np.linalg.inv(hinge) @ map_pose("FridgeDoor"),
        )
        for time in TIMES
    ]
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette())
    joints = bag.frame_at(2.0 + 1e-6).joint_positions
    assert joints is not None
    assert joints[BodyId("FridgeHinge")] == pytest.approx((0, 0, 0, 0, 0, -0.5), abs=1e-9)


def test_a_name_that_is_no_joint_is_listed(tmp_path: Path) -> None:
    bag = RosBag(write_bag(tmp_path, "mcap", [JointReading(0.0, {"shoulder": 1.0, "DrawerSlide": 0.1})]), kitchenette())
    assert bag.unmatched_joints == ("shoulder",)
    assert any("shoulder" in line for line in bag.findings)


# -- the tree of frames ------------------------------------------------------------------------------------------------


def test_a_frame_that_changes_its_parent_follows_the_new_one(tmp_path: Path) -> None:
    messages = []
    for time in TIMES:
        messages += [
            Transform(time, "map", "hand", drive(time)),
            Transform(time, "hand", "Mug", HELD) if time >= 1.0 else Transform(time, "map", "Mug", ODOM),
        ]
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette())
    for time in TIMES:
        truth = drive(time) @ HELD if time >= 1.0 else ODOM
        np.testing.assert_allclose(pose_of(bag, "Mug", min(time + 1e-6, bag.end_s)), truth, atol=1e-9)


def test_frames_that_exchange_parent_and_child_are_no_cycle(tmp_path: Path) -> None:
    messages = [
        Transform(0.0, "map", "a", drive(1.0)),
        Transform(0.0, "a", "Mug", HELD),
        Transform(1.0, "map", "Mug", drive(2.0)),
        Transform(1.0, "Mug", "a", HELD),
    ]
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette())
    np.testing.assert_allclose(pose_of(bag, "Mug", 0.0), drive(1.0) @ HELD, atol=1e-9)
    np.testing.assert_allclose(pose_of(bag, "Mug", 1.0), drive(2.0), atol=1e-9)
    assert not any("cycle" in line for line in bag.findings)


def test_a_cycle_of_frames_is_reported_and_its_body_stays_as_in_the_map(tmp_path: Path) -> None:
    messages = [
        Transform(0.0, "map", "Cupboard", map_pose("Cupboard")),
        Transform(0.0, "b", "Mug", HELD),
        Transform(0.0, "Mug", "b", HELD),
    ]
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette())
    np.testing.assert_allclose(pose_of(bag, "Mug", 0.0), map_pose("Mug"), atol=1e-12)
    assert any("cycle" in line for line in bag.findings)


def test_a_parent_that_comes_late_is_reported_and_the_body_waits_as_in_the_map(tmp_path: Path) -> None:
    messages = [Transform(time, "hand", "Mug", HELD) for time in TIMES]
    messages += [Transform(time, "map", "hand", ODOM) for time in TIMES if time >= 2.0]
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette())
    np.testing.assert_allclose(pose_of(bag, "Mug", 1.9), map_pose("Mug"), atol=1e-12)
    np.testing.assert_allclose(pose_of(bag, "Mug", 2.01), ODOM @ HELD, atol=1e-9)
    assert any("Mug" in line and "20 of 31 times" in line for line in bag.findings)


def test_a_parent_that_never_comes_is_reported(tmp_path: Path) -> None:
    messages = [Transform(time, "camera", "Mug", HELD) for time in TIMES]
    messages += [Transform(0.0, "map", "base_link", ODOM)]
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette())
    np.testing.assert_allclose(pose_of(bag, "Mug", 1.0), map_pose("Mug"), atol=1e-12)
    assert any("Mug is never connected to map" in line for line in bag.findings)
    assert any("2 trees" in line for line in bag.findings)


def test_poses_are_relative_to_the_frame_of_the_map_even_if_it_is_not_the_root(tmp_path: Path) -> None:
    earth = matrix([100.0, 50.0, 3.0], yaw=1.0)
    messages = [
        Transform(0.0, "earth", "map", earth, static=True),
        Transform(0.0, "earth", "Mug", earth @ ODOM),
        Transform(1.0, "earth", "Mug", earth @ HELD),
    ]
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette())
    np.testing.assert_allclose(pose_of(bag, "Mug", 0.0), ODOM, atol=1e-9)
    np.testing.assert_allclose(pose_of(bag, "Mug", 1.0), HELD, atol=1e-9)


def test_the_only_root_is_the_frame_of_the_map(tmp_path: Path) -> None:
    bag = RosBag(write_bag(tmp_path, "mcap", [Transform(0.0, "room", "Mug", HELD)]), kitchenette())
    assert bag.map_frame == "room"


def test_the_frame_of_the_map_must_be_given_if_there_are_several_roots(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "mcap", [Transform(0.0, "room", "Mug", HELD), Transform(0.0, "lab", "Cupboard", HELD)])
    with pytest.raises(EpisodeError, match=r"map_frame.*lab, room"):
        RosBag(path, kitchenette())
    bag = RosBag(path, kitchenette(), map_frame="/lab")
    np.testing.assert_allclose(pose_of(bag, "Cupboard", 0.0), HELD, atol=1e-9)
    with pytest.raises(EpisodeError, match="no frame attic"):
        RosBag(path, kitchenette(), map_frame="attic")


def test_between_two_transforms_position_and_rotation_are_interpolated(tmp_path: Path) -> None:
    start, end = matrix([0, 0, 0], yaw=0.2), matrix([0.4, 0.2, 0], yaw=0.9)
    messages = [Transform(0.0, "map", "Mug", start), Transform(0.4, "map", "Mug", end)]
    messages.insert(1, Transform(0.1, "map", "other", start))
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette())
    np.testing.assert_allclose(pose_of(bag, "Mug", 0.11), matrix([0.1, 0.05, 0], yaw=0.375), atol=1e-9)


def test_a_body_whose_transform_is_published_when_it_changes_does_not_drift(tmp_path: Path) -> None:
    messages = [
        Transform(0.0, "map", "Mug", ODOM),
        *(Transform(time, "map", "other", ODOM) for time in TIMES),
        Transform(3.0, "map", "Mug", HELD),
    ]
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette())
    np.testing.assert_allclose(pose_of(bag, "Mug", 2.95), ODOM, atol=1e-12)
    np.testing.assert_allclose(pose_of(bag, "Mug", 3.0), HELD, atol=1e-12)


def test_a_static_transform_that_is_replaced_holds_until_then(tmp_path: Path) -> None:
    messages: list[Transform] = []
    for time in TIMES:
        if time == 0.0:
            messages.append(Transform(time, "map", "table", ODOM, static=True))
        if time == 2.0:
            messages.append(Transform(time, "map", "table", drive(1.0), static=True))
        messages.append(Transform(time, "table", "Mug", HELD))
    bag = RosBag(write_bag(tmp_path, "sqlite3", messages), kitchenette())
    np.testing.assert_allclose(pose_of(bag, "Mug", 1.95), ODOM @ HELD, atol=1e-9)
    np.testing.assert_allclose(pose_of(bag, "Mug", 2.05), drive(1.0) @ HELD, atol=1e-9)


# -- time --------------------------------------------------------------------------------------------------------------


def test_transforms_that_come_late_are_sorted_in(tmp_path: Path) -> None:
    messages = [Transform(time, "map", "hand", drive(time)) for time in TIMES]
    messages += [Transform(time, "hand", "Mug", HELD, logged_s=time + 0.8) for time in TIMES]
    messages.sort(key=lambda each: each.logged_s or each.time_s)
    bag = RosBag(write_bag(tmp_path, "mcap", messages, start_s=10.0), kitchenette())
    assert bag.end_s == pytest.approx(3.0)
    for time in TIMES:
        np.testing.assert_allclose(pose_of(bag, "Mug", min(time + 1e-6, bag.end_s)), drive(time) @ HELD, atol=1e-9)
    assert not any("clock" in line for line in bag.findings)


def test_after_the_clock_was_set_back_the_recording_goes_on(tmp_path: Path) -> None:
    first = [Transform(time, "map", "Mug", drive(time)) for time in TIMES]
    again = [Transform(time, "map", "Mug", drive(-time), logged_s=3.1 + time) for time in TIMES]
    bag = RosBag(write_bag(tmp_path, "ros1", [*first, *again], start_s=10.0), kitchenette())
    times = [frame.time_s for frame in bag.frames()]
    assert all(after > before for before, after in pairwise(times))
    assert bag.end_s == pytest.approx(6.1)
    np.testing.assert_allclose(pose_of(bag, "Mug", 1.0 + 1e-6), drive(1.0), atol=1e-9)
    np.testing.assert_allclose(pose_of(bag, "Mug", 4.1 + 1e-6), drive(-1.0), atol=1e-9)
    assert any("clock is set back by 3.000 s" in line for line in bag.findings)


def test_there_are_at_most_as_many_frames_as_asked_for(tmp_path: Path) -> None:
    messages = [Transform(step / 200.0, "map", "Mug", drive(step / 200.0)) for step in range(401)]
    path = write_bag(tmp_path, "mcap", messages)
    few = [frame.time_s for frame in RosBag(path, kitchenette(), rate_hz=10.0).frames()]
    assert len(few) == 21
    assert few[-1] == pytest.approx(2.0)
    assert len(list(RosBag(path, kitchenette(), rate_hz=None).frames())) == 401


def test_a_time_outside_of_the_bag_is_an_error(tmp_path: Path) -> None:
    bag = RosBag(write_bag(tmp_path, "mcap", carried_mug()), kitchenette())
    with pytest.raises(EpisodeTimeError, match=r"no state at 3\.5 s"):
        bag.frame_at(3.5)
    assert [frame.time_s for frame in bag.frames(0.95, 1.25)] == pytest.approx([1.0, 1.1, 1.2])


# -- names -------------------------------------------------------------------------------------------------------------


def test_frames_are_matched_by_id_by_iri_and_by_the_given_names(tmp_path: Path) -> None:
    world = kitchenette()
    bodies = tuple(
        replace(body, iri=Iri("http://example.org/m#cup_17")) if body.id == "Mug" else body for body in world.bodies
    )
    messages = [
        Transform(0.0, "map", "cup_17", HELD),
        Transform(0.0, "map", "/Drawer", ODOM),
        Transform(0.0, "map", "fridge_main", drive(1.0)),
    ]
    bag = RosBag(
        write_bag(tmp_path, "ros1", messages),
        replace(world, bodies=bodies),
        bodies={"/fridge_main": BodyId("Fridge")},
    )
    assert bag.matched == {"cup_17": "Mug", "Drawer": "Drawer", "fridge_main": "Fridge"}
    np.testing.assert_allclose(pose_of(bag, "Fridge", 0.0), drive(1.0), atol=1e-9)


def test_two_frames_of_one_body_are_reported(tmp_path: Path) -> None:
    messages = [Transform(0.0, "map", "Mug", HELD), Transform(0.0, "map", "marker_3", ODOM)]
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette(), bodies={"marker_3": BodyId("Mug")})
    assert any("Mug and marker_3 are both" in line for line in bag.findings)


def test_a_given_body_that_does_not_exist_is_an_error(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "mcap", carried_mug())
    with pytest.raises(BodyNotFoundError, match="Mugg"):
        RosBag(path, kitchenette(), bodies={"hand": BodyId("Mugg")})


def test_a_given_frame_that_does_not_exist_is_reported(tmp_path: Path) -> None:
    bag = RosBag(write_bag(tmp_path, "mcap", carried_mug()), kitchenette(), bodies={"left_hand": BodyId("Fridge")})
    assert any("no frame left_hand" in line for line in bag.findings)


def test_a_frame_with_another_origin_moves_its_body_from_its_pose_in_the_map(tmp_path: Path) -> None:
    messages = [Transform(time, "map", "marker", drive(time + 1.0)) for time in TIMES]
    path = write_bag(tmp_path, "mcap", messages)
    bag = RosBag(path, kitchenette(), bodies={"marker": BodyId("Mug")}, relative=["marker"])
    np.testing.assert_allclose(pose_of(bag, "Mug", 0.0), map_pose("Mug"), atol=1e-9)
    marker_from_mug = np.linalg.inv(drive(1.0)) @ map_pose("Mug")
    np.testing.assert_allclose(pose_of(bag, "Mug", 2.0 + 1e-6), drive(3.0) @ marker_from_mug, atol=1e-9)


# -- files that are no bags --------------------------------------------------------------------------------------------


def test_a_file_that_does_not_exist_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(EpisodeFileError, match="no such file"):
        RosBag(tmp_path / "none.bag", kitchenette())


@pytest.mark.parametrize("name", ["x.bag", "x.mcap", "x.db3", "x.txt"])
def test_a_file_with_other_content_is_an_error(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(b"neither a bag nor anything else" * 40)
    with pytest.raises(EpisodeFileError, match="cannot be read as a bag"):
        RosBag(path, kitchenette())


def test_a_folder_without_metadata_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(EpisodeFileError, match=r"metadata\.yaml"):
        RosBag(tmp_path, kitchenette())


@each_format
def test_a_truncated_bag_is_an_error_or_a_part_of_it(format: str, tmp_path: Path) -> None:
    path = write_bag(tmp_path, format, carried_mug())
    file = path if path.is_file() else next(each for each in path.iterdir() if each.suffix in {".mcap", ".db3"})
    data = file.read_bytes()
    for share in (0.3, 0.6, 0.9):
        file.write_bytes(data[: int(share * len(data))])
        try:
            bag = RosBag(path, kitchenette())
        except EpisodeFileError:
            continue
        for frame in bag.frames():
            truth = ODOM @ drive(frame.time_s) @ reach(frame.time_s) @ HELD
            row = frame.ids.index(BodyId("Mug"))
            np.testing.assert_allclose(matrix_of_pose(frame.poses[row]), truth, atol=1e-6)


def test_an_mcap_file_without_its_folder_can_be_read(tmp_path: Path) -> None:
    folder = write_bag(tmp_path, "mcap", carried_mug())
    bag = RosBag(next(folder.glob("*.mcap")), kitchenette())
    np.testing.assert_allclose(pose_of(bag, "Mug", 1.0 + 1e-6), ODOM @ drive(1.0) @ reach(1.0) @ HELD, atol=1e-9)


def test_transforms_that_are_not_finite_are_left_out_and_reported(tmp_path: Path) -> None:
    broken = matrix([float("nan"), 0.0, 0.0])
    messages = [Transform(0.0, "map", "Mug", ODOM), Transform(0.1, "map", "Mug", broken)]
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette())
    np.testing.assert_allclose(pose_of(bag, "Mug", bag.end_s), ODOM, atol=1e-9)
    assert any("invalid pose" in line for line in bag.findings)


@pytest.mark.parametrize("is_negated", [False, True])
def test_rotations_are_interpolated_along_the_shorter_arc(is_negated: bool, tmp_path: Path) -> None:
    start, end = matrix([0, 0, 0], yaw=3.0), matrix([0, 0, 0], yaw=-3.0)  # 0.283 rad apart, across pi
    messages = [
        Transform(0.0, "map", "Mug", start),
        Transform(0.2, "map", "other", start),
        Transform(0.4, "map", "Mug", end, is_negated=is_negated),
    ]
    bag = RosBag(write_bag(tmp_path, "mcap", messages), kitchenette())
    half = Rotation.from_matrix(pose_of(bag, "Mug", 0.21)[:3, :3]).as_euler("xyz")[2]
    assert abs(half) == pytest.approx(pi, abs=1e-6)


def test_messages_that_cannot_be_decoded_are_left_out_and_counted(tmp_path: Path) -> None:
    readings = [JointReading(time_s, {"DrawerSlide": -0.1 * time_s}) for time_s in (0.0, 1.0, 2.0, 3.0)]
    moved = [Transform(time_s, "map", "Mug", ODOM) for time_s in (0.0, 1.0, 2.0, 3.0)]
    folder = write_bag(tmp_path, "sqlite3", [*readings, *moved])
    (path,) = folder.glob("*.db3")
    with closing(sqlite3.connect(path)) as database, database:
        topic = "select id from topics where name = '/joint_states'"
        database.execute(f"update messages set data = x'00010000' where topic_id = ({topic}) and timestamp > 1.5e9")
    bag = RosBag(folder, kitchenette())
    assert "2 messages of /joint_states cannot be decoded and are left out" in bag.findings
    np.testing.assert_allclose(pose_of(bag, "Mug", 2.0), ODOM, atol=1e-9)


def test_a_bag_without_transforms_and_joint_states_is_an_error_with_the_topics_that_it_has(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    text = store.types["std_msgs/msg/String"]
    path = tmp_path / "talk"
    with Writer(path, version=9) as writer:
        for topic in ("/chatter", "/answers"):
            connection = writer.add_connection(topic, "std_msgs/msg/String", typestore=store)
            writer.write(connection, 1_000_000_000, store.serialize_cdr(text(data="hello"), "std_msgs/msg/String"))
    with pytest.raises(
        EpisodeFileError, match=r"no transforms and no joint states; it has the topics .*/answers.*/chatter"
    ):
        RosBag(path, kitchenette())
