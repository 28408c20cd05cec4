"""Data for the scripts in the view, with a fake scene that applies it."""

from __future__ import annotations

from typing import Any

import numpy as np

from mindstage.viewer.view_data import BLOCK_SIZE, PoseBlocks
from tests.viewer.fake_server import FakeScene


def blocks_of(scene: FakeScene, count: int) -> tuple[PoseBlocks, np.ndarray]:
    """Blocks with some nodes, and the rows of the nodes."""
    blocks = PoseBlocks(scene)  # type: ignore[arg-type]
    for number in range(count):
        scene.add_frame(f"/n{number}")
    return blocks, np.array([blocks.add(f"/n{number}") for number in range(count)])


def sent(scene: FakeScene) -> list[str]:
    """The topics sent so far, as they are counted."""
    return [topic for topic, keys in scene.sent_data if "poses" in keys]


def position(scene: FakeScene, name: str) -> Any:
    return vars(scene.nodes[name])["position"]


def test_a_block_is_sent_only_if_one_of_its_poses_is_set() -> None:
    scene = FakeScene()
    blocks, rows = blocks_of(scene, 3 * BLOCK_SIZE)
    blocks.set_poses(rows, np.tile([1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0], (len(rows), 1)))
    assert sent(scene) == ["poses/0", "poses/1", "poses/2"]
    assert position(scene, f"/n{3 * BLOCK_SIZE - 1}").tolist() == [1.0, 2.0, 3.0]
    scene.sent_data.clear()
    blocks.set_poses(rows[[BLOCK_SIZE]], np.array([[4.0, 5.0, 6.0, 1.0, 0.0, 0.0, 0.0]]))
    assert scene.sent_data == [("poses/1", ("poses",))], "the names are not sent again"
    assert position(scene, f"/n{BLOCK_SIZE}").tolist() == [4.0, 5.0, 6.0]
    assert position(scene, f"/n{BLOCK_SIZE + 1}").tolist() == [1.0, 2.0, 3.0]


def test_rows_of_removed_nodes_are_used_again() -> None:
    scene = FakeScene()
    blocks, rows = blocks_of(scene, 3)
    blocks.set_poses(rows, np.tile([1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0], (3, 1)))
    blocks.remove([1])
    scene.add_frame("/new")
    assert blocks.add("/new") == 1
    blocks.set_poses(np.array([1]), np.array([[7.0, 8.0, 9.0, 1.0, 0.0, 0.0, 0.0]]))
    assert scene.data["poses/0"]["names"] == ["/n0", "/new", "/n2"]
    assert position(scene, "/new").tolist() == [7.0, 8.0, 9.0]
    assert position(scene, "/n1").tolist() == [1.0, 2.0, 3.0], "the removed node is not moved"


def test_a_sent_pose_does_not_change_afterwards() -> None:
    scene = FakeScene()
    blocks, rows = blocks_of(scene, 1)
    blocks.set_poses(rows, np.array([[1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0]]))
    queued = scene.data["poses/0"]["poses"]
    blocks.set_poses(rows, np.array([[4.0, 5.0, 6.0, 1.0, 0.0, 0.0, 0.0]]))
    assert queued[0, :3].tolist() == [1.0, 2.0, 3.0], "viser may send it later"
