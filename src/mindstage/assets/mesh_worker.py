"""The process that reads mesh files: strangers made them, and their readers may hang, crash or take all memory.

Each line in is a request (`{"path", "out", "convex_parts"}`), each line out an answer (`{"path", "why"}`; without a reason,
what was read lies at `out`). It loads trimesh, and where wanted coacd, which nobody else has to.
"""

from __future__ import annotations

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
"""Of addresses, of which much is never used [bytes]."""
_MAX_FILE_BYTES = 256 * 1024**2
_MAX_FACES = 2_000_000
_MAX_IMAGE_PIXELS = 1024
"""Along one side; larger ones are made smaller."""
_MAX_COLORS = 24
_MAX_CONVEX_PARTS = 24
_MAX_HULL_DIRECTIONS = 512

# To x forward, y left, z up, from y up and z forward (glTF, and COLLADA unless it says otherwise).
_FROM_Y_UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


class MeshRejected(Exception):
    """A file is not taken, for the reason given."""


def main() -> int:
    """Answers requests until there are no more."""
    _limit_memory()
    for line in sys.stdin:
        request = json.loads(line)
        why = ""
        try:
            _import_mesh(Path(request["path"]), Path(request["out"]), decompose=request["pieces"])
        except MeshRejected as error:
            why = str(error)
        except MemoryError:
            why = "reading it takes too much memory"
        except Exception as error:  # whatever a reader stumbles over
            why = " ".join(f"it cannot be read: {type(error).__name__}: {error}".split())[:300]
        print(json.dumps({"path": request["path"], "why": why}), flush=True)  # noqa: T201
    return 0


def _import_mesh(path: Path, out: Path, *, decompose: bool) -> None:
    """Reads one file and writes what is in it as arrays."""
    if not path.is_file():
        raise MeshRejected("it is no file")
    if path.stat().st_size > _MAX_FILE_BYTES:
        raise MeshRejected(f"it has more than {_MAX_FILE_BYTES // 1024**2} MB")
    skins = list(_load_visuals(path))
    if not skins:
        raise MeshRejected("there are no triangles in it")
    if sum(len(skin["faces"]) for skin in skins) > _MAX_FACES:
        raise MeshRejected(f"it has more than {_MAX_FACES:,} triangles")
    points = np.concatenate([skin["points"] for skin in skins])
    if not np.ptp(points, axis=0).max() > 0.0:
        raise MeshRejected("all of its points are one")
    arrays: dict[str, Any] = {}
    for number, skin in enumerate(skins):
        arrays |= {f"{name}_{number}": value for name, value in skin.items() if value is not None}
    for number, piece in enumerate(_convex_parts(skins, points) if decompose else [_hull(points)]):
        arrays[f"piece_{number}"] = piece
    with out.open("wb") as file:
        np.savez_compressed(file, **arrays)


# -- what is seen ------------------------------------------------------------------------------------------------------


def _load_visuals(path: Path) -> Iterator[dict[str, Any]]:
    import trimesh

    scene = trimesh.load_scene(path, process=False)
    turn = _FROM_Y_UP if _y_is_up(path) else np.eye(3)
    for node in sorted(scene.graph.nodes_geometry):
        placed, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        linear, moved = turn @ placed[:3, :3], turn @ placed[:3, 3]
        points = np.asarray(mesh.vertices, dtype=np.float64) @ linear.T + moved
        faces = np.asarray(mesh.faces, dtype=np.int64)
        if not np.isfinite(points).all():
            raise MeshRejected("some of its numbers are none")
        if faces.min() < 0 or faces.max() >= len(points):
            raise MeshRejected("it has triangles between points that it does not have")
        if np.linalg.det(linear) < 0.0:
            faces = faces[:, ::-1]
        normals = _normals(mesh, linear)
        for rows, surface, uv, image in _split_by_color(mesh):
            used, renamed = np.unique(faces[rows], return_inverse=True)
            yield {
                "points": points[used],
                "faces": renamed.reshape(-1, 3).astype(np.uint32),
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
                told = re.search(rb"<up_axis>\s*(\w+)", file.read(256 * 1024))
            return told is None or told[1].upper() == b"Y_UP"
        case _:
            return False


def _normals(mesh: Any, linear: Any) -> Any:
    """Those that the file has; others would be guessed, and wrong at every edge."""
    if "vertex_normals" not in mesh._cache.cache:
        return None
    normals = np.asarray(mesh.vertex_normals, dtype=np.float64)
    if normals.shape != mesh.vertices.shape or not np.isfinite(normals).all():
        return None
    turned = normals @ np.linalg.inv(linear) if abs(np.linalg.det(linear)) > 0.0 else normals
    lengths = np.linalg.norm(turned, axis=1, keepdims=True)
    return turned / np.where(lengths > 0.0, lengths, 1.0)


_DEFAULT_MATERIAL = (0.8, 0.8, 0.8, 0.0, 0.8, 1.0)
"""Red, green, blue (sRGB), metalness, roughness, opacity."""


def _split_by_color(mesh: Any) -> Iterator[tuple[Any, tuple[float, ...], Any, Any]]:
    """Which faces have which surface, texture coordinates and texture."""
    everything = np.arange(len(mesh.faces))
    visual = mesh.visual
    match getattr(visual, "kind", None):
        case "texture":
            surface, image = _material(visual.material)
            uv: Any = np.zeros(0) if visual.uv is None else np.asarray(visual.uv, dtype=np.float64)
            whole = image is not None and uv.shape == (len(mesh.vertices), 2) and bool(np.isfinite(uv).all())
            yield everything, surface, uv if whole else None, image if whole else None
        case "face" | "vertex":
            colors = np.asarray(visual.face_colors, dtype=np.float64)[:, :4] / 255.0
            # Colors that run into one another become bands: a skin has one color.
            steps = 255 if len(np.unique(colors, axis=0)) <= _MAX_COLORS else 2
            found, which = np.unique(np.round(colors * steps) / steps, axis=0, return_inverse=True)
            for number, (red, green, blue, opacity) in enumerate(found.tolist()):
                surface = (red, green, blue, 0.0, 0.8, opacity)
                yield np.flatnonzero(which.reshape(-1) == number), surface, None, None
        case _:
            yield everything, _DEFAULT_MATERIAL, None, None


def _material(material: Any) -> tuple[tuple[float, ...], Any]:
    """A surface, and its texture."""
    if hasattr(material, "baseColorFactor"):
        factor, texture = material.baseColorFactor, material.baseColorTexture
        metalness, roughness = material.metallicFactor, material.roughnessFactor
        linear = True
    else:
        factor, texture = getattr(material, "diffuse", None), getattr(material, "image", None)
        metalness, roughness, linear = 0.0, 0.8, False
    color: Any = np.ones(4) if texture is not None else np.array([0.8, 0.8, 0.8, 1.0])
    if factor is not None:
        # trimesh gives factors as bytes.
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
    from PIL import Image  # a texture is one of its images already

    Image.MAX_IMAGE_PIXELS = 64_000_000
    with suppress(OSError, ValueError, Image.DecompressionBombError, Image.DecompressionBombWarning):
        image = texture.convert("RGBA")
        image.thumbnail((_MAX_IMAGE_PIXELS, _MAX_IMAGE_PIXELS))
        return np.asarray(image, dtype=np.uint8)
    return None


# -- what is touched ---------------------------------------------------------------------------------------------------


def _convex_parts(visuals: list[dict[str, Any]], points: Any) -> list[Any]:
    """Convex pieces that together are the mesh."""
    import coacd

    coacd.set_log_level("off")
    starts = np.cumsum([0, *(len(skin["points"]) for skin in visuals)])
    faces = np.concatenate([skin["faces"].astype(np.int64) + at for skin, at in zip(visuals, starts, strict=False)])
    # Points that coincide become one: at seams of textures a surface would seem to be open.
    whole, renamed = np.unique(np.round(points / np.ptp(points, axis=0).max(), 6), axis=0, return_inverse=True)
    faces = renamed.reshape(-1)[faces]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    # A quarter of the search that it does by default: a few seconds for each mesh, and pieces hardly worse.
    parts = coacd.run_coacd(
        coacd.Mesh(whole, faces), threshold=0.06, max_convex_hull=_MAX_CONVEX_PARTS, preprocess_resolution=30,
        resolution=1000, mcts_iterations=50, mcts_nodes=12, mcts_max_depth=2, seed=1,
    )  # fmt: skip
    scale = np.ptp(points, axis=0).max()
    return [_hull(np.asarray(corners) * scale) for corners, _ in parts if len(corners) >= 4] or [_hull(points)]


def _hull(points: Any) -> Any:
    """The points that lie farthest out, each in one of many directions: what is between them is within a hair."""
    steps = np.arange(_MAX_HULL_DIRECTIONS) + 0.5
    down, around = np.arccos(1.0 - 2.0 * steps / _MAX_HULL_DIRECTIONS), np.pi * (1.0 + 5**0.5) * steps
    directions = np.stack([np.cos(around) * np.sin(down), np.sin(around) * np.sin(down), np.cos(down)], axis=1)
    # What is thin is stretched first, or its edges would be missed; the eight corners always count.
    spread = np.ptp(points, axis=0)
    stretched = (points - points.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    directions = np.concatenate([directions, corners, np.eye(3), -np.eye(3)])
    farthest = {int(row) for start in range(0, len(directions), 64) for row in
                np.argmax(stretched @ directions[start : start + 64].T, axis=0)}  # fmt: skip
    return points[sorted(farthest)]


def _limit_memory() -> None:
    with suppress(ImportError, ValueError, OSError):  # not everywhere is there a limit
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, hard))


if __name__ == "__main__":
    sys.exit(main())
