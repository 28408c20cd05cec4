"""Visual meshes, materials and textures of an MJCF file, with the files that it refers to.

Meshes are Wavefront OBJ and pictures PNG, which MuJoCo and other programs read. Geometries with equal keys share
their meshes, and each texture is written once.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from xml.etree import ElementTree

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.rendering.appearance import takes_body_color
from mindstage.scene import BodyGeometry, Color, PbrMaterial, VisualMesh
from mindstage.scene.mesh import face_cross_products, face_normals
from mindstage.scene.transforms import Array
from mindstage.textures.baking import texture_set
from mindstage.textures.images import image_png

__all__ = ["VisualAssets", "format_color"]

_TEXTURE_PX = 1024
"""Longest side of textures."""
_MIN_AREA_M2 = 1e-12
"""Meshes of less area are left out: MuJoCo refuses them."""
_MIN_POINTS = 4
"""Points that MuJoCo requires of a mesh."""
_OTHER_CHARACTERS = re.compile(r"[^A-Za-z0-9_.-]+")
_HEADLIGHT = {"ambient": "0.45 0.45 0.45", "diffuse": "0.5 0.5 0.5", "specular": "0.1 0.1 0.1"}
_SKY = {
    "name": "sky",
    "type": "skybox",
    "builtin": "gradient",
    "rgb1": "0.93 0.94 0.95",
    "rgb2": "0.72 0.78 0.85",
    "width": "256",
    "height": "1536",
}


class VisualAssets:
    """The assets that visual geoms refer to; `files` has the contents of their files."""

    def __init__(self, root: ElementTree.Element, assets: ElementTree.Element, folder: str) -> None:
        """Adds daylight and a sky, and no assets yet.

        Args:
            root: the element of the model.
            assets: the element that the assets are added to.
            folder: the folder of the files, relative to that of the MJCF file.
        """
        ElementTree.SubElement(ElementTree.SubElement(root, "visual"), "headlight", _HEADLIGHT)
        ElementTree.SubElement(assets, "texture", _SKY)
        self.files: dict[str, bytes] = {}
        self.left_out = 0
        """Visual meshes without an area."""
        self._assets, self._folder = assets, folder
        self._meshes: dict[tuple[str, int], str | None] = {}
        self._materials: dict[tuple[PbrMaterial, str], str] = {}
        self._textures: dict[str | tuple[tuple[int, ...], bytes], str] = {}

    def geoms(self, name: str, geometry: BodyGeometry, color: Color | None) -> Iterator[dict[str, str]]:
        """Adds the assets of a body; yields the attributes `mesh` and `material` of each of its geoms.

        Args:
            name: the name of the body, which names meshes that no earlier body has.
            geometry: the geometry.
            color: the body's own color, which replaces that of solid materials without a picture.
        """
        for number, visual in enumerate(geometry.visuals):
            mesh = self._mesh(name, geometry.key, number, visual)
            if mesh is not None:
                own = color if takes_body_color(visual) else None
                yield {"mesh": mesh, "material": self._material(visual, own)}

    def _mesh(self, name: str, key: str, number: int, visual: VisualMesh) -> str | None:
        found = (key, number)
        if found not in self._meshes:
            self._meshes[found] = self._add_mesh(f"{name}:{number + 1}", visual) if _has_area(visual) else None
        self.left_out += self._meshes[found] is None
        return self._meshes[found]

    def _add_mesh(self, name: str, visual: VisualMesh) -> str:
        path = self._add_file(name, ".obj", _wavefront(visual))
        # A shell may have no volume.
        ElementTree.SubElement(self._assets, "mesh", {"name": name, "file": path, "inertia": "shell"})
        return name

    def _material(self, visual: VisualMesh, color: Color | None) -> str:
        material = visual.material if color is None else replace(visual.material, color=color)
        texture = self._texture(visual)
        if (material, texture) not in self._materials:
            name = f"{material.texture or material.name or 'material'}-{len(self._materials) + 1}"
            self._materials[material, texture] = name
            attributes = {
                "name": name,
                "rgba": format_color(*material.color, material.opacity),
                "emission": repr(material.emission),
                "metallic": repr(material.metalness),
                "roughness": repr(material.roughness),
                "specular": repr(round(1.0 - material.roughness, 7)),
            } | ({"texture": texture} if texture else {})
            ElementTree.SubElement(self._assets, "material", attributes)
        return self._materials[material, texture]

    def _texture(self, visual: VisualMesh) -> str:
        """The name of the picture or texture of a mesh; empty for none."""
        image, texture = visual.image, visual.material.texture
        if visual.uv is None or (image is None and not texture):
            return ""
        key = texture if image is None else (image.shape, image.tobytes())
        if key not in self._textures:
            name = texture if image is None else f"print-{len(self._textures) + 1}"
            pixels = texture_set(texture).color if image is None else image[..., :3]
            path = self._add_file(name, ".png", image_png(pixels, longest_px=_TEXTURE_PX))
            ElementTree.SubElement(self._assets, "texture", {"name": name, "type": "2d", "file": path})
            self._textures[key] = name
        return self._textures[key]

    def _add_file(self, name: str, suffix: str, content: bytes) -> str:
        stem = base = _OTHER_CHARACTERS.sub("_", name)
        count = 2
        while (path := f"{self._folder}/{stem}{suffix}") in self.files:
            stem, count = f"{base}-{count}", count + 1
        self.files[path] = content
        return path


def format_color(*parts: float) -> str:
    """A color, with few digits: MuJoCo reads single precision and refuses subnormal numbers."""
    return " ".join(f"{part:.7f}" for part in parts)


def _has_area(visual: VisualMesh) -> bool:
    if len(visual.points) < _MIN_POINTS or not len(visual.faces):
        return False
    return bool(np.linalg.norm(face_cross_products(visual.points, visual.faces), axis=1).sum() > 2 * _MIN_AREA_M2)


def _wavefront(visual: VisualMesh) -> bytes:
    """The mesh as OBJ, with a normal for each face if it has none for its points."""
    points, faces = visual.points, visual.faces.astype(np.int64)
    if visual.normals is None:
        normals = face_normals(points, faces)
        normal_faces = np.repeat(np.arange(len(faces))[:, None], 3, axis=1)
    else:
        normals, normal_faces = visual.normals, faces
    lines = [*_lines("v %.7g %.7g %.7g", points), *_lines("vn %.5f %.5f %.5f", normals)]
    if visual.uv is None:
        rows, form = np.stack([faces, normal_faces], axis=2), "f %d//%d %d//%d %d//%d"
    else:
        lines += _lines("vt %.7g %.7g", visual.uv)
        rows, form = np.stack([faces, faces, normal_faces], axis=2), "f %d/%d/%d %d/%d/%d %d/%d/%d"
    lines += _lines(form, rows.reshape(len(faces), -1) + 1)
    return ("\n".join(lines) + "\n").encode()


def _lines(form: str, rows: Array | NDArray[np.int64]) -> Sequence[str]:
    return [form % tuple(row) for row in rows.tolist()]
