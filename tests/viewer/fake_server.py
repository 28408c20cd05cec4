"""A fake of viser's server and clients that records messages and nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

import numpy as np

__all__ = ["FakeClient", "FakeNode", "FakeScene", "FakeServer"]

SentMessages = list[tuple[str, str]]


class FakeNode:
    """A node that records changes."""

    def __init__(self, scene: FakeScene, name: str, **properties: Any) -> None:
        vars(self).update({"visible": True, "scene": scene, "name": name} | properties)

    def __setattr__(self, attribute: str, value: Any) -> None:
        self.scene.messages.append((self.name, attribute))
        vars(self)[attribute] = value

    def remove(self) -> None:
        self.scene.messages.append((self.name, "remove"))
        for name in [name for name in self.scene.nodes if f"{name}/".startswith(f"{self.name}/")]:
            del self.scene.nodes[name]

    def on_click(self, callback: Callable[[Any], None]) -> None:
        vars(self)["click"] = callback

    def on_update(self, callback: Callable[[Any], None]) -> None:
        vars(self)["update"] = callback


class FakeScene:
    """A scene: nodes by name, and the messages that were sent."""

    def __init__(self) -> None:
        self.messages: SentMessages = []
        self.nodes: dict[str, FakeNode] = {}
        self.data: dict[str, dict[str, Any]] = {}
        self.sent_data: list[tuple[str, tuple[str, ...]]] = []
        self.world_axes = FakeNode(self, "axes")

    def add(self, name: str, *content: Any, **properties: Any) -> FakeNode:
        self.messages.append((name, "add"))
        self.nodes[name] = FakeNode(self, name, content=content, **properties)
        return self.nodes[name]

    add_frame = add_glb = add_mesh_simple = add_line_segments = add_grid = add_label = add_transform_controls = add
    add_icosphere = add
    add_light_hemisphere = add_light_directional = add_light_point = add

    def add_batched_glb(self, name: str, data: bytes, wxyzs: Any, positions: Any, **properties: Any) -> FakeNode:
        return self.add(name, data, batched_wxyzs=wxyzs, batched_positions=positions, **properties)

    def add_batched_meshes_simple(
        self, name: str, vertices: Any, faces: Any, wxyzs: Any, positions: Any, **properties: Any
    ) -> FakeNode:
        return self.add(name, vertices, faces, batched_wxyzs=wxyzs, batched_positions=positions, **properties)

    def _queue_scene_message(self, message: Any) -> None:
        """Applies data for the scripts: poses are set on the nodes of a block."""
        topic = message.name.removeprefix("/mindstage/")
        data = self.data.setdefault(topic, {})
        data.update(message.updates)
        self.sent_data.append((topic, tuple(message.updates)))
        if "poses" not in message.updates:
            return
        for name, row in zip(data["names"], data["poses"], strict=True):
            node = self.nodes.get(name)
            if node is None or np.array_equal(vars(node).get("row", ()), row):
                continue
            vars(node)["row"] = row
            node.position, node.wxyz = row[:3], row[3:]

    def get_handle_by_name(self, name: str) -> FakeNode | None:
        return self.nodes.get(name)

    def configure_default_lights(self, **_: Any) -> None: ...
    def configure_environment_map(self, *_: Any, **__: Any) -> None: ...
    def set_background_image(self, *_: Any, **__: Any) -> None: ...

    @contextmanager
    def recording(self) -> Iterator[SentMessages]:
        """The messages sent within the context."""
        messages: SentMessages = []
        start = len(self.messages)
        yield messages
        messages += self.messages[start:]


class FakeClient:
    """A connected client."""

    def __init__(self, number: int, *, aspect: float = 1.5) -> None:
        self.client_id, self.scene, self.atomic = number, FakeScene(), nullcontext
        self.camera = FakeNode(
            self.scene, "camera", position=np.array([9.0, 0, 9]), look_at=np.zeros(3), fov=0.7, aspect=aspect
        )


class FakeServer:
    """A server whose clients are connected and disconnected by calls."""

    def __init__(self) -> None:
        self.scene, self.atomic = FakeScene(), nullcontext
        self.initial_camera = FakeNode(self.scene, "camera")
        self.connect_callbacks: list[Callable[[Any], None]] = []
        self.disconnect_callbacks: list[Callable[[Any], None]] = []

    def on_client_connect(self, callback: Callable[[Any], None]) -> None:
        self.connect_callbacks.append(callback)

    def on_client_disconnect(self, callback: Callable[[Any], None]) -> None:
        self.disconnect_callbacks.append(callback)

    def connect(self, client: FakeClient) -> FakeClient:
        for callback in self.connect_callbacks:
            callback(client)
        return client

    def disconnect(self, client: FakeClient) -> None:
        for callback in self.disconnect_callbacks:
            callback(client)
