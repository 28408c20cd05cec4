"""GLB: the skins of a form as one binary glTF file for the browser, which knows metal, roughness, glow and textures.

The page's library works out normals by itself, smooth wherever triangles share a point. So points are shared here only
where a skin has normals, and every flat face has points of its own.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from msgspec.structs import replace

from mindstage.exports.gltf_file import GltfFile
from mindstage.world import Colour
from mindstage.world.forms import Skin, Surface
from mindstage.world.meshes import TriangleMesh

__all__ = ["glb", "mean_colour", "mesh_of"]

_METALNESS = 0.3
"""So much of it is left in the page, where nothing is there to be mirrored: pure metal would be black."""


def mesh_of(skins: Iterable[Skin]) -> TriangleMesh:
    """All triangles of several skins as one mesh; a single one keeps its place on its picture."""
    meshes = [_mesh(skin) for skin in skins]
    if len(meshes) == 1:
        return meshes[0]
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    faces = [mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts, strict=False)]
    vertices = [np.zeros((0, 3)), *(mesh.points for mesh in meshes)]
    return TriangleMesh(np.concatenate(vertices), np.concatenate([np.zeros((0, 3), np.uint32), *faces]))


def _mesh(skin: Skin) -> TriangleMesh:
    if skin.normals is not None:
        uv = None if skin.uv is None else skin.uv.astype(np.float64)
        return TriangleMesh(skin.points.astype(np.float64), skin.faces.astype(np.uint32), uv=uv)
    corners = skin.faces.reshape(-1)
    uv = None if skin.uv is None else skin.uv[corners].astype(np.float64)
    faces = np.arange(corners.size, dtype=np.uint32).reshape(-1, 3)
    return TriangleMesh(skin.points[corners].astype(np.float64), faces, uv=uv)


def glb(skins: Iterable[Skin]) -> bytes:
    """A binary glTF 2.0 file; its axes are the body's, since the page turns everything itself."""
    groups: dict[tuple[Surface, int | None], list[Skin]] = {}
    for skin in skins:
        # One draw call for all that is made of one material.
        groups.setdefault((skin.surface, None if skin.image is None else id(skin)), []).append(skin)
    pictured = any(skin.image is not None for group in groups.values() for skin in group)
    joined = [_joined(surface, group, pictured=pictured) for (surface, _), group in groups.items()]
    file = GltfFile("form")
    primitives = [file.skin(skin) for skin in joined if skin.faces.size]
    file.nodes.append({"mesh": file.mesh("form", lambda: primitives)} if primitives else {})
    return file.data()


def _joined(surface: Surface, skins: list[Skin], *, pictured: bool) -> Skin:
    """Skins of one material as one, of less metal than it is."""
    mesh = mesh_of(skins)
    uv = mesh.uv
    if pictured and uv is None:  # the page joins all into one mesh, for which they must have the same attributes
        uv = np.zeros((len(mesh.points), 2))
    shown = replace(surface, metalness=_METALNESS * surface.metalness)
    return Skin(mesh.points, mesh.faces, shown, uv=uv, image=skins[0].image)


def mean_colour(skins: Iterable[Skin]) -> Colour:
    """Of a whole form, by the area that each colour has."""
    total, weight = np.zeros(3), 1e-12
    for skin in skins:
        first, second, third = (skin.points[skin.faces[:, corner]] for corner in range(3))
        area = float(np.linalg.norm(np.cross(second - first, third - first), axis=1).sum())
        total, weight = total + area * np.array(skin.surface.colour), weight + area
    red, green, blue = (total / weight).tolist()
    return red, green, blue
