"""A server and its visitors' browsers, played by lists: what they would have been sent, and what is there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

import numpy as np

__all__ = ["Client", "Node", "Scene", "Server"]

Told = list[tuple[str, str]]


class Node:
    """A node that tells what becomes of it."""

    def __init__(self, scene: Scene, name: str, **properties: Any) -> None:
        vars(self).update({"visible": True, "scene": scene, "name": name} | properties)

    def __setattr__(self, attribute: str, value: Any) -> None:
        self.scene.told.append((self.name, attribute))
        vars(self)[attribute] = value

    def remove(self) -> None:
        self.scene.told.append((self.name, "remove"))
        for name in [name for name in self.scene.nodes if f"{name}/".startswith(f"{self.name}/")]:
            del self.scene.nodes[name]

    def on_click(self, react: Callable[[Any], None]) -> None:
        vars(self)["click"] = react

    def on_update(self, react: Callable[[Any], None]) -> None:
        vars(self)["update"] = react


class Scene:
    """Nodes by name."""

    def __init__(self) -> None:
        self.told: Told = []
        self.nodes: dict[str, Node] = {}
        self.world_axes = Node(self, "axes")

    def add(self, name: str, *content: Any, **properties: Any) -> Node:
        self.told.append((name, "add"))
        self.nodes[name] = Node(self, name, content=content, **properties)
        return self.nodes[name]

    add_frame = add_glb = add_mesh_simple = add_line_segments = add_grid = add_label = add_transform_controls = add
    add_light_hemisphere = add_light_directional = add_light_point = add

    def add_batched_glb(self, name: str, data: bytes, turns: Any, places: Any, **properties: Any) -> Node:
        return self.add(name, data, batched_wxyzs=turns, batched_positions=places, **properties)

    def add_batched_meshes_simple(
        self, name: str, vertices: Any, faces: Any, turns: Any, places: Any, **properties: Any
    ) -> Node:
        return self.add(name, vertices, faces, batched_wxyzs=turns, batched_positions=places, **properties)

    def get_handle_by_name(self, name: str) -> Node | None:
        return self.nodes.get(name)

    def configure_default_lights(self, **_: Any) -> None: ...
    def configure_environment_map(self, *_: Any, **__: Any) -> None: ...
    def set_background_image(self, *_: Any, **__: Any) -> None: ...

    @contextmanager
    def listening(self) -> Iterator[Told]:
        """What is sent in the meantime."""
        heard: Told = []
        start = len(self.told)
        yield heard
        heard += self.told[start:]


class Client:
    """A visitor's browser."""

    def __init__(self, number: int, *, aspect: float = 1.5) -> None:
        self.client_id, self.scene, self.atomic = number, Scene(), nullcontext
        self.camera = Node(
            self.scene, "camera", position=np.array([9.0, 0, 9]), look_at=np.zeros(3), fov=0.7, aspect=aspect
        )


class Server:
    """A server whose visitors come and go by hand."""

    def __init__(self) -> None:
        self.scene, self.atomic = Scene(), nullcontext
        self.initial_camera = Node(self.scene, "camera")
        self.come: list[Callable[[Any], None]] = []
        self.gone: list[Callable[[Any], None]] = []

    def on_client_connect(self, react: Callable[[Any], None]) -> None:
        self.come.append(react)

    def on_client_disconnect(self, react: Callable[[Any], None]) -> None:
        self.gone.append(react)

    def welcome(self, client: Client) -> Client:
        for react in self.come:
            react(client)
        return client

    def see_off(self, client: Client) -> None:
        for react in self.gone:
            react(client)
