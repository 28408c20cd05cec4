"""glTF: a world as one binary file (.glb) that viewers, browsers and game engines show.

A node is a body; what hangs on it are the nodes below. Its extras hold its id and class. The file's own axes are
glTF's (y up, z forward), all of which its one root turns; below that everything is as the world has it.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.errors import MapUnwritable
from mindstage.exports.mesh_files import fitted, load_triangles
from mindstage.exports.solids import Triangles, solid
from mindstage.world import Body, Colour, Light, LightKind, Pose, Shape, ShapeKind, World
from mindstage.world.frames import xyzw_from_wxyz
from mindstage.world.geometry import Array, compose, invert, unit_pose

__all__ = ["Glb", "glb"]

_ROOT_ROTATION = (-0.5, -0.5, -0.5, 0.5)
"""From x forward, y left, z up to z forward, x left, y up; x y z w."""
_FLOAT, _INDEX = 5126, 5125
_VERTICES, _ELEMENTS = 34962, 34963
_LIGHTS = "KHR_lights_punctual"
_LARGEST = 1e30
"""What single precision, which all of glTF's numbers have, can hold with ease [m]."""
_PLAIN: Colour = (0.8, 0.8, 0.8)
"""Of what has no colour."""


class Glb(NamedTuple):
    """A file, and what it does not say."""

    data: bytes
    notes: tuple[str, ...]


def glb(world: World, *, find_mesh: Callable[[str], Path | None] = lambda name: None) -> Glb:
    """A world as binary glTF 2.0.

    Args:
        world: what is written.
        find_mesh: the file that a body's mesh is, if it is at hand; what is in it is copied.

    Raises:
        MapUnwritable: something stands where no number leads.
    """
    document = _Document(world, find_mesh)
    document.write()
    return Glb(document.data(), tuple(document.notes))


class _Document:
    def __init__(self, world: World, find_mesh: Callable[[str], Path | None]) -> None:
        self.world, self.find_mesh = world, find_mesh
        self.nodes: list[dict[str, Any]] = []
        self.meshes: list[dict[str, Any]] = []
        self.materials: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.views: list[dict[str, Any]] = []
        self.lights: list[dict[str, Any]] = []
        self.binary = bytearray()
        self.notes: list[str] = []
        self._surfaces: dict[object, dict[str, Any]] = {}
        self._numbers: dict[object, int] = {}
        self._files: dict[Path, Triangles | None] = {}

    def write(self) -> None:
        """Fills the document."""
        world = self.world
        rows = {body.id: self._row(body.id, body.pose) for body in world.bodies}
        numbers = {body.id: number for number, body in enumerate(world.bodies, 1)}
        parents = {attachment.child: attachment.parent for attachment in world.attachments}
        extras = {"iri": world.iri, "name": world.name}
        self.nodes.append({"name": world.name, "rotation": _ROOT_ROTATION, "extras": extras})
        for body in world.bodies:
            row = rows[body.id]
            if body.id in parents:
                row = compose(invert(rows[parents[body.id]]), row)
            self.nodes.append(self._body(body, row))
        for child, number in numbers.items():
            above = numbers[parents[child]] if child in parents else 0
            self._hang(number, above)
        for light in world.lights:
            self._hang(len(self.nodes), 0)
            self.nodes.append(self._light(light))
        self._tell()

    def data(self) -> bytes:
        """The file: a header, what there is as JSON, and its numbers."""
        told: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "Mindstage"},
            "scene": 0,
            "scenes": [{"name": self.world.name, "nodes": [0]}],
            "nodes": self.nodes,
        }
        lists = {
            "meshes": self.meshes,
            "materials": self.materials,
            "accessors": self.accessors,
            "bufferViews": self.views,
        }
        told |= {name: each for name, each in lists.items() if each}
        if self.binary:
            told["buffers"] = [{"byteLength": len(self.binary)}]
        if self.lights:
            told |= {"extensionsUsed": [_LIGHTS], "extensions": {_LIGHTS: {"lights": self.lights}}}
        text = msgspec.json.encode(told)
        chunks = _chunk(b"JSON", text + b" " * (-len(text) % 4))
        if self.binary:
            chunks += _chunk(b"BIN\0", bytes(self.binary))
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    # -- nodes ---------------------------------------------------------------------------------------------------------

    def _hang(self, number: int, above: int) -> None:
        self.nodes[above].setdefault("children", []).append(number)

    def _row(self, id: str, pose: Pose) -> Array:
        row = unit_pose(pose)
        if not np.isfinite(row).all():
            raise MapUnwritable(repr(id), cause="its pose is none")
        return row

    def _body(self, body: Body, row: Array) -> dict[str, Any]:
        extras: dict[str, Any] = {"id": body.id, "class": body.cls, "iri": body.iri}
        physics = body.physics
        if physics.mobility is not None:
            extras["mobility"] = physics.mobility.value
        if physics.mass_kg is not None and isfinite(physics.mass_kg):
            extras["mass_kg"] = physics.mass_kg
        if body.label:
            extras["label"] = body.label
        node = {"name": body.id, "extras": extras} | _placed(row)
        mesh = self._mesh(body)
        return node if mesh is None else node | {"mesh": mesh}

    def _light(self, light: Light) -> dict[str, Any]:
        told: dict[str, Any] = {"type": light.kind.value, "color": light.colour, "intensity": light.intensity}
        if light.kind is LightKind.SPOT:
            told["spot"] = {}
        self.lights.append(told | {"name": light.id})
        node = {"name": light.id, "extras": {"id": light.id, "iri": light.iri}}
        node |= {"extensions": {_LIGHTS: {"light": len(self.lights) - 1}}}
        return node | _placed(self._row(light.id, light.pose))

    def _tell(self) -> None:
        world = self.world
        unsized = sum(body.size is None for body, node in zip(world.bodies, self.nodes[1:], strict=False))
        shown = [
            (unsized, "bodies have no size; those without a mesh are nodes that show nothing"),
            (len(world.constraints), "constraints have no place in glTF; they are left out"),
            (sum(len(body.facts) for body in world.bodies) + len(world.resources), "facts and resources are left out"),
            (sum(len(body.tags) for body in world.bodies), "tags are left out"),
        ]
        self.notes += [f"{count} {what}" for count, what in shown if count]

    # -- looks ---------------------------------------------------------------------------------------------------------

    def _mesh(self, body: Body) -> int | None:
        surface = self._surface(body)
        if surface is None:
            return None
        named = next((material for material in body.materials if material.colour), None)
        material = self._material(named.name if named else "", (named and named.colour) or _PLAIN)
        key = ("mesh", id(surface), material)
        if key not in self._numbers:
            self._numbers[key] = len(self.meshes)
            self.meshes.append({"primitives": [surface | {"material": material}]})
        return self._numbers[key]

    def _surface(self, body: Body) -> dict[str, Any] | None:
        path = self.find_mesh(body.mesh) if body.mesh else None
        if path is not None and (file := self._file(path)) is not None:
            return self._kept((path, body.size), lambda: fitted(file, body.size))
        if body.size is None:
            return None
        size, kind = body.size, (body.shape or Shape()).kind
        if not all(0.0 <= extent <= _LARGEST for extent in size):
            raise MapUnwritable(repr(body.id), cause=f"its size {size} is none")
        return self._kept((kind, size), lambda: solid(ShapeKind(kind), size))

    def _file(self, path: Path) -> Triangles | None:
        if path not in self._files:
            self._files[path] = load_triangles(path)
            if self._files[path] is None:
                self.notes.append(f"no mesh could be read from {path}; boxes and the like stand for it")
        return self._files[path]

    def _kept(self, key: object, make: Callable[[], Triangles]) -> dict[str, Any]:
        """The numbers of a surface, which stand in the file once."""
        if key not in self._surfaces:
            triangles = make()
            attributes = {"POSITION": self._numbers_of(triangles.points, bounds=True)}
            if triangles.normals is not None:
                attributes["NORMAL"] = self._numbers_of(triangles.normals)
            indices = self._append(triangles.faces.reshape(-1).astype("<u4"), _ELEMENTS)
            accessor = {"bufferView": indices, "componentType": _INDEX, "type": "SCALAR", "count": triangles.faces.size}
            self.accessors.append(accessor)
            self._surfaces[key] = {"attributes": attributes, "indices": len(self.accessors) - 1}
        return self._surfaces[key]

    def _numbers_of(self, rows: Array, *, bounds: bool = False) -> int:
        numbers = rows.astype("<f4")
        view = self._append(numbers, _VERTICES)
        accessor: dict[str, Any] = {"bufferView": view, "componentType": _FLOAT, "type": "VEC3", "count": len(rows)}
        if bounds:
            accessor |= {"min": numbers.min(axis=0).tolist(), "max": numbers.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def _append(self, numbers: NDArray[Any], target: int) -> int:
        content = numbers.tobytes()
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content), "target": target}
        self.views.append(view)
        self.binary += content
        return len(self.views) - 1

    def _material(self, name: str, colour: Colour) -> int:
        key = ("material", name, colour)
        if key not in self._numbers:
            self._numbers[key] = len(self.materials)
            surface = {"baseColorFactor": [*map(_linear, colour), 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8}
            self.materials.append({"pbrMetallicRoughness": surface} | ({"name": name} if name else {}))
        return self._numbers[key]


def _placed(row: Array) -> dict[str, Sequence[float]]:
    return {"translation": (row[:3] + 0.0).tolist(), "rotation": (xyzw_from_wxyz(row[3:]) + 0.0).tolist()}


def _linear(part: float) -> float:
    """As much light as a screen's value stands for (the curve of sRGB, IEC 61966-2-1)."""
    part = min(max(part, 0.0), 1.0)
    return part / 12.92 if part <= 0.04045 else float(((part + 0.055) / 1.055) ** 2.4)


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack("<I4s", len(content), kind) + content
