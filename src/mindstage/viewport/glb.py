"""GLB: the skins of a form as one binary glTF file for the browser, which knows metal, roughness, glow and textures.

The page's library works out normals by itself, smooth wherever triangles share a point. So points are shared here only
where a skin has normals, and every flat face has points of its own.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from msgspec.structs import replace

from mindstage.exports.gltf_file import GltfWriter
from mindstage.world import Color
from mindstage.world.forms import PbrMaterial, VisualMesh
from mindstage.world.meshes import TriangleMesh

__all__ = ["mean_color", "merge_visuals", "visuals_to_glb"]

_MAX_METALNESS = 0.3
"""So much of it is left in the page, where nothing is there to be mirrored: pure metal would be black."""


def merge_visuals(visuals: Iterable[VisualMesh]) -> TriangleMesh:
    """All triangles of several skins as one mesh; a single one keeps its place on its picture."""
    meshes = [_mesh(skin) for skin in visuals]
    if len(meshes) == 1:
        return meshes[0]
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    faces = [mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts, strict=False)]
    vertices = [np.zeros((0, 3)), *(mesh.points for mesh in meshes)]
    return TriangleMesh(np.concatenate(vertices), np.concatenate([np.zeros((0, 3), np.uint32), *faces]))


def _mesh(visual: VisualMesh) -> TriangleMesh:
    if visual.normals is not None:
        uv = None if visual.uv is None else visual.uv.astype(np.float64)
        return TriangleMesh(visual.points.astype(np.float64), visual.faces.astype(np.uint32), uv=uv)
    corners = visual.faces.reshape(-1)
    uv = None if visual.uv is None else visual.uv[corners].astype(np.float64)
    faces = np.arange(corners.size, dtype=np.uint32).reshape(-1, 3)
    return TriangleMesh(visual.points[corners].astype(np.float64), faces, uv=uv)


def visuals_to_glb(visuals: Iterable[VisualMesh]) -> bytes:
    """A binary glTF 2.0 file; its axes are the body's, since the page turns everything itself."""
    groups: dict[tuple[PbrMaterial, int | None], list[VisualMesh]] = {}
    for skin in visuals:
        # One draw call for all that is made of one material.
        groups.setdefault((skin.material, None if skin.image is None else id(skin)), []).append(skin)
    pictured = any(skin.image is not None for group in groups.values() for skin in group)
    joined = [_merge_by_material(surface, group, textured=pictured) for (surface, _), group in groups.items()]
    file = GltfWriter("form")
    primitives = [file.visual_primitive(skin) for skin in joined if skin.faces.size]
    file.nodes.append({"mesh": file.mesh("form", lambda: primitives)} if primitives else {})
    return file.data()


def _merge_by_material(material: PbrMaterial, visuals: list[VisualMesh], *, textured: bool) -> VisualMesh:
    """Skins of one material as one, of less metal than it is."""
    mesh = merge_visuals(visuals)
    uv = mesh.uv
    if textured and uv is None:  # the page joins all into one mesh, for which they must have the same attributes
        uv = np.zeros((len(mesh.points), 2))
    shown = replace(material, metalness=_MAX_METALNESS * material.metalness)
    return VisualMesh(mesh.points, mesh.faces, shown, uv=uv, image=visuals[0].image)


def mean_color(visuals: Iterable[VisualMesh]) -> Color:
    """Of a whole form, by the area that each color has."""
    total, weight = np.zeros(3), 1e-12
    for skin in visuals:
        first, second, third = (skin.points[skin.faces[:, corner]] for corner in range(3))
        area = float(np.linalg.norm(np.cross(second - first, third - first), axis=1).sum())
        total, weight = total + area * np.array(skin.material.color), weight + area
    red, green, blue = (total / weight).tolist()
    return red, green, blue
