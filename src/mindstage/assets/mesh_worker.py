"""The worker process that imports mesh files, which may make their readers hang, crash or exhaust memory.

Each input line is a request (`{"path", "out", "pieces", "hull_reason", "keep_axes"}`), each output line a response
(`{"path", "why", "kind"}`). If the reason is empty, the imported arrays are in the file `out`, with the hull reason of
the request. Otherwise the kind is "file" if the file is the cause, "cache" if `out` could not be written, and
"transient" if another cause may pass. Only this process imports trimesh and coacd.
"""

from __future__ import annotations

import errno
import json
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from mindstage.scene.colors import linear_to_srgb

__all__ = ["main"]

MEMORY_LIMIT = 6 * 1024**3
"""Limit of the address space [bytes]; much of it is never used."""
_MAX_FILE_BYTES = 256 * 1024**2
_MAX_FACES = 2_000_000
_MAX_IMAGE_PIXELS = 1024
"""Maximum width and height; larger images are scaled down."""
_MAX_COLORS = 24
_MAX_CONVEX_PARTS, _MIN_CONVEX_PARTS, _MAX_CONVEX_COMPONENTS = 24, 8, 48
"""Number of parts of a decomposition, and of those of what remains beside connected parts that are nearly convex."""
_MAX_BULGE, _MAX_OUT = 0.03, 0.01
"""Distance between a surface and its hull up to which it is nearly convex, and by how much a part that is left out
protrudes from another one; relative to the largest extent of the mesh."""
_SAMPLES_PER_AREA, _FIRST_SAMPLES = 8_000, 200
"""Number of samples for each squared extent of the mesh, and of those on the hull that are tried first."""
_MAX_HULL_DIRECTIONS = 512

# From y up and z forward (glTF, and COLLADA by default) to x forward, y left, z up.
_FROM_Y_UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


class MeshImportError(Exception):
    """A mesh file that cannot be used, with the reason."""


class _CacheError(Exception):
    """The imported arrays cannot be written, with the reason."""


_TRANSIENT_ERRORS = frozenset({errno.EIO, errno.ENOSPC, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN})
"""Errors of the operating system that do not lie in the file."""


def main() -> int:
    """Processes requests until the input ends."""
    _limit_memory()
    for line in sys.stdin:
        request = json.loads(line)
        reason, kind = "", "file"
        try:
            _import_mesh(
                Path(request["path"]),
                Path(request["out"]),
                decompose=request["pieces"],
                hull_reason=request.get("hull_reason", ""),
                keep_axes=request.get("keep_axes", False),
            )
        except MeshImportError as error:
            reason = str(error)
        except _CacheError as error:
            reason, kind = str(error), "cache"
        except MemoryError:
            reason, kind = "importing it needs too much memory", "transient"
        except Exception as error:  # any exception of a reader
            reason = " ".join(f"it cannot be read: {type(error).__name__}: {error}".split())[:300]
            kind = "transient" if isinstance(error, OSError) and error.errno in _TRANSIENT_ERRORS else "file"
        print(json.dumps({"path": request["path"], "why": reason, "kind": kind}), flush=True)  # noqa: T201
    return 0


def _import_mesh(path: Path, out: Path, *, decompose: bool, hull_reason: str, keep_axes: bool) -> None:
    """Imports one file and writes its content as arrays."""
    if not path.is_file():
        raise MeshImportError("it is not a file")
    if path.stat().st_size > _MAX_FILE_BYTES:
        raise MeshImportError(f"it has more than {_MAX_FILE_BYTES // 1024**2} MB")
    visuals = list(_load_visuals(path, keep_axes=keep_axes))
    if not visuals:
        raise MeshImportError("it has no triangles")
    if sum(len(visual["faces"]) for visual in visuals) > _MAX_FACES:
        raise MeshImportError(f"it has more than {_MAX_FACES:,} triangles")
    points = np.concatenate([visual["points"] for visual in visuals])
    if not np.ptp(points, axis=0).max() > 0.0:
        raise MeshImportError("all of its points coincide")
    arrays: dict[str, Any] = {"hull_reason": np.array(hull_reason)}
    for number, visual in enumerate(visuals):
        arrays |= {f"{name}_{number}": value for name, value in visual.items() if value is not None}
    for number, part in enumerate(_convex_parts(visuals, points) if decompose else [_hull(points)]):
        arrays[f"piece_{number}"] = part
    try:
        with out.open("wb") as file:
            np.savez_compressed(file, **arrays)
    except OSError as error:
        raise _CacheError(error.strerror or str(error)) from error


# -- visual meshes -------------------------------------------------------------------------------------------------


def _load_visuals(path: Path, *, keep_axes: bool) -> Iterator[dict[str, Any]]:
    import trimesh

    scene = trimesh.load_scene(path, process=False)
    rotation = _FROM_Y_UP if not keep_axes and _y_is_up(path) else np.eye(3)
    for node in sorted(scene.graph.nodes_geometry):
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        linear, translation = rotation @ transform[:3, :3], rotation @ transform[:3, 3]
        points = np.asarray(mesh.vertices, dtype=np.float64) @ linear.T + translation
        faces = np.asarray(mesh.faces, dtype=np.int64)
        if not np.isfinite(points).all():
            raise MeshImportError("it has numbers that are not finite")
        if faces.min() < 0 or faces.max() >= len(points):
            raise MeshImportError("it has triangles with invalid vertex indices")
        if np.linalg.det(linear) < 0.0:
            faces = faces[:, ::-1]
        normals = _normals(mesh, linear)
        if len(points) == 3 * len(faces) and normals is None and getattr(mesh.visual, "kind", None) is None:
            points, new_index = np.unique(points, axis=0, return_inverse=True)  # STL has no indices
            faces = new_index.reshape(-1)[faces]
        for rows, surface, uv, image in _split_by_color(mesh):
            used, new_index = np.unique(faces[rows], return_inverse=True)
            yield {
                "points": points[used],
                "faces": new_index.reshape(-1, 3).astype(np.uint32),
                "normals": None if normals is None else normals[used],
                "surface": np.array(surface),
                "uv": None if uv is None else uv[used],
                "image": image,
            }


def _y_is_up(path: Path) -> bool:
    match path.suffix.lower():
        case ".glb" | ".gltf":
            return True
        case ".dae":
            with path.open("rb") as file:
                match = re.search(rb"<up_axis>\s*(\w+)", file.read(256 * 1024))
            return match is None or match[1].upper() == b"Y_UP"
        case _:
            return False


def _normals(mesh: Any, linear: Any) -> Any:
    """The normals of the file; computed ones would be wrong at every sharp edge."""
    if "vertex_normals" not in mesh._cache.cache:
        return None
    normals = np.asarray(mesh.vertex_normals, dtype=np.float64)
    if normals.shape != mesh.vertices.shape or not np.isfinite(normals).all():
        return None
    rotated = normals @ np.linalg.inv(linear) if abs(np.linalg.det(linear)) > 0.0 else normals
    lengths = np.linalg.norm(rotated, axis=1, keepdims=True)
    return rotated / np.where(lengths > 0.0, lengths, 1.0)


_DEFAULT_MATERIAL = (0.8, 0.8, 0.8, 0.0, 0.8, 1.0)
"""Red, green, blue (sRGB), metalness, roughness, opacity."""


def _split_by_color(mesh: Any) -> Iterator[tuple[Any, tuple[float, ...], Any, Any]]:
    """Yields the faces of each material with the material, texture coordinates and texture."""
    all_faces = np.arange(len(mesh.faces))
    visual = mesh.visual
    match getattr(visual, "kind", None):
        case "texture":
            surface, image = _material(visual.material)
            uv: Any = np.zeros(0) if visual.uv is None else np.asarray(visual.uv, dtype=np.float64)
            has_texture = image is not None and uv.shape == (len(mesh.vertices), 2) and bool(np.isfinite(uv).all())
            yield all_faces, surface, uv if has_texture else None, image if has_texture else None
        case "face" | "vertex":
            colors = np.asarray(visual.face_colors, dtype=np.float64)[:, :4] / 255.0
            # Color gradients are quantized, since a visual mesh has one color.
            steps = 255 if len(np.unique(colors, axis=0)) <= _MAX_COLORS else 2
            colors_found, color_index = np.unique(np.round(colors * steps) / steps, axis=0, return_inverse=True)
            for number, (red, green, blue, opacity) in enumerate(colors_found.tolist()):
                surface = (red, green, blue, 0.0, 0.8, opacity)
                yield np.flatnonzero(color_index.reshape(-1) == number), surface, None, None
        case _:
            yield all_faces, _DEFAULT_MATERIAL, None, None


def _material(material: Any) -> tuple[tuple[float, ...], Any]:
    """The material's properties, and its texture."""
    if hasattr(material, "baseColorFactor"):
        factor, texture = material.baseColorFactor, material.baseColorTexture
        metalness, roughness = material.metallicFactor, material.roughnessFactor
        linear = True
    else:
        factor, texture = getattr(material, "diffuse", None), getattr(material, "image", None)
        metalness, roughness, linear = 0.0, 0.8, False
    color: Any = np.ones(4) if texture is not None else np.array([0.8, 0.8, 0.8, 1.0])
    if factor is not None:
        # trimesh returns factors as bytes
        color = np.asarray(factor, dtype=np.float64).reshape(-1)
        color = color / 255.0 if np.asarray(factor).dtype.kind in "ui" else color
        color = np.append(color, 1.0)[:4]
        color[:3] = linear_to_srgb(color[:3]) if linear else color[:3]
    values = [1.0 if value is None else float(value) for value in (metalness, roughness)]
    if linear and metalness is None:
        values[0] = 0.0
    numbers = np.clip(np.nan_to_num([*color[:3], *values, color[3]]), 0.0, 1.0)
    return tuple(numbers.tolist()), None if texture is None else _image(texture)


def _image(texture: Any) -> Any:
    from PIL import Image  # a texture is a Pillow image

    Image.MAX_IMAGE_PIXELS = 64_000_000
    with suppress(OSError, ValueError, Image.DecompressionBombError, Image.DecompressionBombWarning):
        image = texture.convert("RGBA")
        image.thumbnail((_MAX_IMAGE_PIXELS, _MAX_IMAGE_PIXELS))
        return np.asarray(image, dtype=np.uint8)
    return None


# -- collision shapes ----------------------------------------------------------------------------------------------


def _convex_parts(visuals: list[dict[str, Any]], points: Any) -> list[Any]:
    """Convex parts whose union approximates the mesh.

    What is nearly convex is its hull: the mesh, or the connected parts that it was built of, such as boards. Only the
    others are decomposed, which takes seconds.
    """
    starts = np.cumsum([0, *(len(visual["points"]) for visual in visuals)])
    faces = np.concatenate(
        [visual["faces"].astype(np.int64) + start for visual, start in zip(visuals, starts, strict=False)]
    )
    # Merge points that coincide: at texture seams the surface would appear to be open.
    scale = np.ptp(points, axis=0).max()
    merged, new_index = np.unique(np.round(points / scale, 6), axis=0, return_inverse=True)
    faces = new_index.reshape(-1)[faces]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    if not len(faces) or _nearly_convex_hull(merged, faces) is not None:
        return [_hull(points)]
    convex, others = _components(merged, faces)
    if len(convex) > _MAX_CONVEX_COMPONENTS:
        convex, others = [], [faces]
    parts = [merged[np.unique(component)] for component in convex]
    if others:
        parts += _decomposed(merged, np.concatenate(others), max(_MAX_CONVEX_PARTS - len(parts), _MIN_CONVEX_PARTS))
    return [_hull(part * scale) for part in parts] or [_hull(points)]


def _components(points: Any, faces: Any) -> tuple[list[Any], list[Any]]:
    """The faces of the connected parts of a mesh, those that are nearly convex first.

    Parts that are small, or within one that is nearly convex, are left out unless there is no other one.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    # Boards that meet at an edge are different parts: only edges of two triangles connect these.
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1) @ [len(points), 1]
    _, edges, counts = np.unique(edges, return_inverse=True, return_counts=True)
    order = np.argsort(edges.reshape(-1), kind="stable")
    ends = order[np.repeat(counts == 2, counts)].reshape(-1, 2) // 3
    links = coo_array((np.ones(len(ends)), ends.T), shape=(len(faces), len(faces)))
    labels = connected_components(links, directed=False)[1]
    order = np.argsort(labels, kind="stable")
    found = [faces[rows] for rows in np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)]
    large = [each for each in found if np.ptp(points[each.reshape(-1)], axis=0).max() > _MAX_BULGE] or found
    hulls = [_nearly_convex_hull(points, each) for each in large]
    volumes = [0.0 if hull is None else hull.volume for hull in hulls]
    kept: list[int] = []
    for number in sorted(range(len(large)), key=lambda number: -volumes[number]):
        corners = points[np.unique(large[number])]
        planes = (hulls[other].equations for other in kept if hulls[other] is not None)
        if not any((each[:, :3] @ corners.T + each[:, 3:]).max() < _MAX_OUT for each in planes):
            kept.append(number)
    return [large[n] for n in kept if hulls[n] is not None], [large[n] for n in kept if hulls[n] is None]


def _nearly_convex_hull(points: Any, faces: Any) -> Any:
    """The hull of a surface that is near it everywhere, so that nothing larger fits between them; otherwise None."""
    from scipy.spatial import ConvexHull, KDTree, QhullError

    corners = points[np.unique(faces)]
    try:
        hull = ConvexHull(corners)
    except QhullError:  # it is flat
        return None
    # Distances to samples are at least those to the surface, so that chance only makes a surface less convex.
    generator = np.random.default_rng(0)
    surface = KDTree(np.concatenate([corners, _samples(points, faces, generator)]))
    on_hull = _samples(corners, hull.simplices, generator)
    for some in (on_hull[:: max(len(on_hull) // _FIRST_SAMPLES, 1)], on_hull):
        if np.isinf(surface.query(some, distance_upper_bound=_MAX_BULGE)[0]).any():
            return None
    return hull


def _samples(points: Any, faces: Any, generator: np.random.Generator) -> Any:
    """Random points on a surface, at least one on each triangle."""
    first, second, third = (points[faces[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(second - first, third - first), axis=1) / 2
    rows = np.repeat(np.arange(len(faces)), np.ceil(area * _SAMPLES_PER_AREA).astype(np.intp))
    along = generator.random((2, len(rows), 1))
    along = np.where(along.sum(axis=0) > 1.0, 1.0 - along, along)
    return first[rows] + along[0] * (second - first)[rows] + along[1] * (third - first)[rows]


def _decomposed(points: Any, faces: Any, count: int) -> list[Any]:
    """The corners of at most so many convex parts of a surface."""
    import coacd

    coacd.set_log_level("off")
    used, faces = np.unique(faces, return_inverse=True)
    # A seventh of the default search: a few seconds for each mesh, with hardly worse parts.
    parts = coacd.run_coacd(
        coacd.Mesh(points[used], faces.reshape(-1, 3)), threshold=2 * _MAX_BULGE, max_convex_hull=count,
        preprocess_resolution=30, resolution=1000, mcts_iterations=20, mcts_nodes=12, mcts_max_depth=2, seed=1,
    )  # fmt: skip
    return [np.asarray(corners) for corners, _ in parts if len(corners) >= 4]


def _hull(points: Any) -> Any:
    """The points of a hull that are outermost in one of many directions."""
    steps = np.arange(_MAX_HULL_DIRECTIONS) + 0.5
    down, around = np.arccos(1.0 - 2.0 * steps / _MAX_HULL_DIRECTIONS), np.pi * (1.0 + 5**0.5) * steps
    directions = np.stack([np.cos(around) * np.sin(down), np.sin(around) * np.sin(down), np.cos(down)], axis=1)
    # Normalize the extents first, since edges of thin meshes would be missed; the eight corners are always included.
    extents = np.ptp(points, axis=0)
    stretched = (points - points.mean(axis=0)) / np.where(extents > 0.0, extents, 1.0)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    directions = np.concatenate([directions, corners, np.eye(3), -np.eye(3)])
    farthest = {int(row) for start in range(0, len(directions), 64) for row in
                np.argmax(stretched @ directions[start : start + 64].T, axis=0)}  # fmt: skip
    return points[sorted(farthest)]


def _limit_memory() -> None:
    with suppress(ImportError, ValueError, OSError):  # not all platforms have limits
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, hard))


if __name__ == "__main__":
    sys.exit(main())
