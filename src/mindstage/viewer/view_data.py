"""Data for the scripts that Mindstage adds to viser's page, sent through viser's own connection.

viser sends one message for each change of each node, which takes most of the time of an update when hundreds of bodies
move. Here many values are one message with arrays: an update of a node below `/mindstage/`, which never exists. The
script `viewData.js` takes these messages out of the queue of viser's page before viser handles them. Since viser orders
and keeps them like its own messages, later clients receive the latest values too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from viser import _messages

from mindstage.scene.transforms import Array

__all__ = ["BLOCK_SIZE", "FirstData", "PoseBlocks", "send_view_data"]

_PREFIX = "/mindstage/"
BLOCK_SIZE = 64
"""Number of nodes whose poses are sent together: fewer make an update of many nodes slower, more one of few larger."""
_POSE_LENGTH = 7
"""The number of values of a pose: x y z and w x y z."""


def send_view_data(scene: viser.SceneApi, topic: str, values: Mapping[str, Any]) -> None:
    """Sends values to the scripts in the views; newer values with the same keys replace older ones.

    Args:
        scene: the scene of the server, or of one client.
        topic: what the values are, such as "poses/3".
        values: values for MessagePack; arrays are sent as they are.
    """
    scene._queue_scene_message(_messages.SceneNodeUpdateMessage(f"{_PREFIX}{topic}", dict(values)))


class FirstData:
    """Values that clients receive before all that is sent later, even if the values have changed since.

    viser moves a message that replaces another one to the end of what it sends to a new client.
    """

    def __init__(self, scene: viser.SceneApi, topic: str) -> None:
        """Sends nothing yet.

        Args:
            scene: the scene of the server.
            topic: what the values are.
        """
        self._scene, self._topic = scene, topic
        self._message: _messages.SceneNodeUpdateMessage | None = None

    def send(self, values: Mapping[str, Any]) -> None:
        """Sends values to all clients; those that connect later receive them at this place."""
        self._message = _messages.SceneNodeUpdateMessage(f"{_PREFIX}{self._topic}", dict(values))
        self._scene._queue_scene_message(self._message)

    def replace(self, values: Mapping[str, Any]) -> None:
        """Replaces the values for clients that connect later."""
        if self._message is None:
            self.send(values)
        else:
            self._message.updates = dict(values)


class PoseBlocks:
    """The poses of many nodes, sent in blocks: a block with a changed pose is sent as one array. Not thread-safe."""

    def __init__(self, scene: viser.SceneApi, *, topic: str = "poses") -> None:
        """Creates no block yet.

        Args:
            scene: the scene of the server.
            topic: the first part of the topics of the blocks; different for each object of a scene.
        """
        self._scene, self._topic = scene, topic
        self._names: list[str] = []
        self._free: list[int] = []
        self._rows: NDArray[np.float32] = np.zeros((0, _POSE_LENGTH), np.float32)
        self._renamed: set[int] = set()
        """Blocks whose names must be sent."""

    def add(self, name: str) -> int:
        """Adds a node, and returns its row."""
        if self._free:
            row = self._free.pop()
            self._names[row] = name
        else:
            row = len(self._names)
            self._names.append(name)
            if row >= len(self._rows):
                grown = np.zeros((max(BLOCK_SIZE, 2 * len(self._rows)), _POSE_LENGTH), np.float32)
                grown[: len(self._rows)] = self._rows
                self._rows = grown
        self._renamed.add(row // BLOCK_SIZE)
        return row

    def remove(self, rows: Iterable[int]) -> None:
        """Removes nodes; their rows are used again."""
        for row in rows:
            self._names[row] = ""
            self._free.append(row)
            self._renamed.add(row // BLOCK_SIZE)

    def set_poses(self, rows: NDArray[np.intp], poses: Array) -> None:
        """Sets poses, and sends the blocks that they are in.

        Args:
            rows: the rows of the nodes, n.
            poses: positions [m] and unit quaternions (w, x, y, z), n x 7.
        """
        self._rows[rows] = poses
        for block in np.unique(rows // BLOCK_SIZE).tolist():
            names = self._names[block * BLOCK_SIZE : (block + 1) * BLOCK_SIZE]
            if block in self._renamed:
                self._renamed.discard(block)
                send_view_data(self._scene, f"{self._topic}/{block}", {"names": names})
            start = block * BLOCK_SIZE
            # A copy: viser may send the array after it has changed again.
            send_view_data(
                self._scene, f"{self._topic}/{block}", {"poses": self._rows[start : start + len(names)].copy()}
            )
