"""GLB: the skins of a form as one binary glTF file for the browser, which knows metal, roughness, glow and textures.

The page's library works out normals by itself, smooth wherever triangles share a point. So points are shared here only
where a skin has normals, and every flat face has points of its own.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.viewport.palette import linear
from mindstage.viewport.solids import Mesh
from mindstage.world import Colour
from mindstage.world.forms import Skin, Surface

__all__ = ["glb", "mean_colour", "mesh_of"]

_FLOAT, _INDEX = 5126, 5125
_VERTICES, _ELEMENTS = 34962, 34963
_METALNESS = 0.3
"""So much of it is left in the page, where nothing is there to be mirrored: pure metal would be black."""
_STRENGTH = "KHR_materials_emissive_strength"


def mesh_of(skins: Iterable[Skin]) -> Mesh:
    """All triangles of several skins as one mesh; a single one keeps its place on its picture."""
    meshes = [_mesh(skin) for skin in skins]
    if len(meshes) == 1:
        return meshes[0]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts, strict=False)]
    vertices = [np.zeros((0, 3), np.float32), *(mesh.vertices for mesh in meshes)]
    return Mesh(np.concatenate(vertices), np.concatenate([np.zeros((0, 3), np.uint32), *faces]))


def _mesh(skin: Skin) -> Mesh:
    if skin.normals is not None:
        uv = None if skin.uv is None else skin.uv.astype(np.float32)
        return Mesh(skin.points.astype(np.float32), skin.faces.astype(np.uint32), uv)
    corners = skin.faces.reshape(-1)
    uv = None if skin.uv is None else skin.uv[corners].astype(np.float32)
    faces = np.arange(corners.size, dtype=np.uint32).reshape(-1, 3)
    return Mesh(skin.points[corners].astype(np.float32), faces, uv)


def glb(skins: Iterable[Skin]) -> bytes:
    """A binary glTF 2.0 file; its axes are the body's, since the page turns everything itself."""
    writer = _Writer()
    groups: dict[tuple[Surface, int | None], list[Skin]] = {}
    for skin in skins:
        # One draw call for all that is made of one material.
        groups.setdefault((skin.surface, None if skin.image is None else id(skin)), []).append(skin)
    pictured = any(skin.image is not None for group in groups.values() for skin in group)
    for (surface, _), group in groups.items():
        writer.add(surface, group, pictured=pictured)
    return writer.data()


class _Writer:
    def __init__(self) -> None:
        self.accessors: list[dict[str, Any]] = []
        self.views: list[dict[str, Any]] = []
        self.primitives: list[dict[str, Any]] = []
        self.materials: list[dict[str, Any]] = []
        self.textures: list[dict[str, Any]] = []
        self.binary = bytearray()

    def add(self, surface: Surface, skins: list[Skin], *, pictured: bool) -> None:
        mesh = mesh_of(skins)
        if not mesh.faces.size:
            return
        attributes = {"POSITION": self._accessor(mesh.vertices, "VEC3")}
        if pictured:  # the page joins all into one mesh, for which they must have the same attributes
            uv = mesh.uv if mesh.uv is not None else np.zeros((len(mesh.vertices), 2), np.float32)
            attributes["TEXCOORD_0"] = self._accessor(uv, "VEC2")
        indices = self._accessor(mesh.faces.reshape(-1), "SCALAR")
        self.primitives.append({"attributes": attributes, "indices": indices, "material": len(self.materials)})
        self.materials.append(self._material(surface, skins[0].image))

    def data(self) -> bytes:
        """The file: a header, what there is as JSON, and its numbers."""
        told: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}
        if self.primitives:
            told |= {"nodes": [{"mesh": 0}], "meshes": [{"primitives": self.primitives}], "materials": self.materials}
            told |= {"accessors": self.accessors, "bufferViews": self.views}
            told |= {"buffers": [{"byteLength": len(self.binary)}], "extensionsUsed": [_STRENGTH]}
        else:
            told["nodes"] = [{}]
        if self.textures:
            told |= {"images": self.textures, "textures": [{"source": row} for row in range(len(self.textures))]}
        text = msgspec.json.encode(told)
        chunks = _chunk(b"JSON", text + b" " * (-len(text) % 4)) + _chunk(b"BIN\0", bytes(self.binary))
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def _accessor(self, rows: NDArray[Any], kind: str) -> int:
        target, component = (_ELEMENTS, _INDEX) if kind == "SCALAR" else (_VERTICES, _FLOAT)
        accessor = {
            "bufferView": self._view(rows.tobytes(), target=target),
            "componentType": component,
            "type": kind,
            "count": len(rows),
        }
        if kind == "VEC3":
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def _view(self, content: bytes, *, target: int | None = None) -> int:
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content)}
        self.views.append(view if target is None else view | {"target": target})
        self.binary += content + bytes(-len(content) % 4)
        return len(self.views) - 1

    def _material(self, surface: Surface, image: NDArray[np.uint8] | None) -> dict[str, Any]:
        colour = linear(np.array(surface.colour)).tolist()
        shine: dict[str, Any] = {
            "baseColorFactor": [*colour, surface.opacity],
            "metallicFactor": _METALNESS * surface.metalness,
            "roughnessFactor": surface.roughness,
        }
        if image is not None:
            shine["baseColorTexture"] = {"index": self._texture(image)}
        material: dict[str, Any] = {"pbrMetallicRoughness": shine, "name": surface.material}
        if surface.glow > 0.0:
            material["emissiveFactor"] = colour
            material["extensions"] = {_STRENGTH: {"emissiveStrength": surface.glow}}
        if surface.opacity < 1.0 or (image is not None and image[..., 3].min() < 255):
            material["alphaMode"] = "BLEND"
        return material

    def _texture(self, image: NDArray[np.uint8]) -> int:
        self.textures.append({"bufferView": self._view(_png(image)), "mimeType": "image/png"})
        return len(self.textures) - 1


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack("<I4s", len(content), kind) + content


def _png(image: NDArray[np.uint8]) -> bytes:
    """A picture of red, green, blue and opacity as a PNG file."""
    height, width, _ = image.shape
    # Each row begins with the number of its filter: none.
    rows = np.concatenate([np.zeros((height, 1), np.uint8), image.reshape(height, -1)], axis=1)
    head = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(rows.tobytes(), 6)), (b"IEND", b""))
    chunks = [
        struct.pack(">I", len(part)) + kind + part + struct.pack(">I", zlib.crc32(kind + part)) for kind, part in parts
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def mean_colour(skins: Iterable[Skin]) -> Colour:
    """Of a whole form, by the area that each colour has."""
    total, weight = np.zeros(3), 1e-12
    for skin in skins:
        first, second, third = (skin.points[skin.faces[:, corner]] for corner in range(3))
        area = float(np.linalg.norm(np.cross(second - first, third - first), axis=1).sum())
        total, weight = total + area * np.array(skin.surface.colour), weight + area
    red, green, blue = (total / weight).tolist()
    return red, green, blue
