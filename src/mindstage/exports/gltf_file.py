"""GltfFile: a binary glTF 2.0 file while it is being put together; what is alike stands in it once."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterable
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.world import Color, LightType, PbrMaterial, VisualMesh
from mindstage.world.colors import srgb_to_linear
from mindstage.world.geometry import Array
from mindstage.world.meshes import TriangleMesh

__all__ = ["GltfWriter"]

_FLOAT, _INDEX = 5126, 5125
_VERTICES, _ELEMENTS = 34962, 34963
_LIGHTS, _STRENGTH = "KHR_lights_punctual", "KHR_materials_emissive_strength"
_MAX_TRANSPARENT_OPACITY = 0.999
_TYPES = {2: "VEC2", 3: "VEC3"}


class GltfWriter:
    """Nodes, meshes, materials, textures and lights."""

    def __init__(self, name: str) -> None:
        """Begins a file without nodes; the first one that is added is the root of its only scene."""
        self.nodes: list[dict[str, Any]] = []
        self._name = name
        self._lists: dict[str, list[dict[str, Any]]] = {}
        self._lights: list[dict[str, Any]] = []
        self._extensions: set[str] = set()
        self._binary = bytearray()
        self._cache: dict[object, Any] = {}

    def data(self) -> bytes:
        """The file: a header, what there is as JSON, and its numbers."""
        told: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "Mindstage"},
            "scene": 0,
            "scenes": [{"name": self._name, "nodes": [0]}],
            "nodes": self.nodes,
        } | self._lists
        if self._binary:
            told["buffers"] = [{"byteLength": len(self._binary)}]
        if self._extensions:
            told["extensionsUsed"] = sorted(self._extensions)
        if self._lights:
            told["extensions"] = {_LIGHTS: {"lights": self._lights}}
        text = msgspec.json.encode(told)
        chunks = _chunk(b"JSON", text + b" " * (-len(text) % 4))
        if self._binary:
            chunks += _chunk(b"BIN\0", bytes(self._binary))
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    # -- what nodes refer to -------------------------------------------------------------------------------------------

    def mesh(self, key: object, make: Callable[[], Iterable[dict[str, Any]]]) -> int:
        """The number of a mesh; its primitives are made only for the first of that key."""
        return int(self._cached(("mesh", key), lambda: self._add("meshes", {"primitives": list(make())})))

    def visual_primitive(self, visual: VisualMesh) -> dict[str, Any]:
        """A primitive with a surface of its own."""
        primitive = self.mesh_primitive(TriangleMesh(visual.points, visual.faces, visual.normals))
        if visual.uv is not None:
            # glTF counts from the upper edge of an image.
            primitive["attributes"]["TEXCOORD_0"] = self._accessor(
                np.column_stack([visual.uv[:, 0], 1.0 - visual.uv[:, 1]])
            )
        image = None if visual.uv is None or visual.image is None else visual.image
        return primitive | {"material": self.material(visual.material, image=image)}

    def mesh_primitive(self, mesh: TriangleMesh) -> dict[str, Any]:
        """A primitive without a material; flat faces where there are no normals."""
        attributes = {"POSITION": self._accessor(mesh.points, bounds=True)}
        if mesh.normals is not None:
            attributes["NORMAL"] = self._accessor(mesh.normals)
        view = self._append(mesh.faces.reshape(-1).astype("<u4"), _ELEMENTS)
        indices = {"bufferView": view, "componentType": _INDEX, "type": "SCALAR", "count": mesh.faces.size}
        return {"attributes": attributes, "indices": self._add("accessors", indices)}

    def material(self, pbr_material: PbrMaterial, *, image: NDArray[np.uint8] | None = None, name: str = "") -> int:
        """The number of a material."""
        texture = None if image is None else self._texture(image)

        def make() -> int:
            light = srgb_to_linear(np.array(pbr_material.color)).tolist()
            pbr: dict[str, Any] = {
                "baseColorFactor": [*light, pbr_material.opacity],
                "metallicFactor": pbr_material.metalness,
                "roughnessFactor": pbr_material.roughness,
            }
            if texture is not None:
                pbr["baseColorTexture"] = {"index": texture}
            material: dict[str, Any] = {"pbrMetallicRoughness": pbr}
            if title := name or pbr_material.name:
                material["name"] = title
            if pbr_material.opacity < _MAX_TRANSPARENT_OPACITY or (image is not None and image[..., 3].min() < 255):
                material["alphaMode"] = "BLEND"
            if pbr_material.emission > 0.0:
                material["emissiveFactor"] = [part * min(pbr_material.emission, 1.0) for part in light]
            if pbr_material.emission > 1.0:
                self._extensions.add(_STRENGTH)
                material["extensions"] = {_STRENGTH: {"emissiveStrength": pbr_material.emission}}
            return self._add("materials", material)

        return int(self._cached(("material", pbr_material, texture, name), make))

    def light(self, type: LightType, color: Color, intensity: float, *, name: str) -> dict[str, Any]:
        """What a node gets to shine."""
        told: dict[str, Any] = {"type": type.value, "color": color, "intensity": intensity, "name": name}
        if type is LightType.SPOT:
            told["spot"] = {}
        self._extensions.add(_LIGHTS)
        self._lights.append(told)
        return {"extensions": {_LIGHTS: {"light": len(self._lights) - 1}}}

    # -- numbers -------------------------------------------------------------------------------------------------------

    def _cached(self, key: object, make: Callable[[], Any]) -> Any:
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]

    def _texture(self, pixels: NDArray[np.uint8]) -> int:
        def make() -> int:
            from PIL import Image

            png = io.BytesIO()
            Image.fromarray(pixels).save(png, "png")
            content = png.getvalue()
            view = self._append_bytes(content)
            image = self._add("images", {"bufferView": view, "mimeType": "image/png"})
            return self._add("textures", {"source": image})

        return int(self._cached(("texture", pixels.shape, pixels.tobytes()), make))

    def _accessor(self, rows: Array, *, bounds: bool = False) -> int:
        numbers = rows.astype("<f4")
        view = self._append(numbers, _VERTICES)
        kind = _TYPES[rows.shape[1]]
        accessor: dict[str, Any] = {"bufferView": view, "componentType": _FLOAT, "type": kind, "count": len(rows)}
        if bounds:
            accessor |= {"min": numbers.min(axis=0).tolist(), "max": numbers.max(axis=0).tolist()}
        return self._add("accessors", accessor)

    def _append(self, numbers: NDArray[Any], target: int) -> int:
        view = self._append_bytes(numbers.tobytes())
        self._lists["bufferViews"][view]["target"] = target
        return view

    def _append_bytes(self, content: bytes) -> int:
        self._binary += b"\0" * (-len(self._binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(content)}
        self._binary += content
        return self._add("bufferViews", view)

    def _add(self, name: str, value: dict[str, Any]) -> int:
        values = self._lists.setdefault(name, [])
        values.append(value)
        return len(values) - 1


def _chunk(type: bytes, content: bytes) -> bytes:
    content += b"\0" * (-len(content) % 4)
    return struct.pack("<I4s", len(content), type) + content
