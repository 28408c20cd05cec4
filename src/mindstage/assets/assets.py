"""Assets: for each body whose mesh is at hand, the form that the mesh gives it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mindstage.assets.catalogue import Catalogue, Found
from mindstage.assets.levels import levels_of
from mindstage.assets.reading import MeshFile, read_meshes
from mindstage.world import Body, BodyId, Form, FormSource, Pose, Skin, Solid, SolidKind, Vector
from mindstage.world.geometry import Array, fitting_scale

__all__ = ["Assets", "MeshForms"]

_EVEN = 0.02
"""Factors that differ by less than this part are one."""
_ASIDE = 0.01
"""A mesh whose middle is farther from its origin than this part of its extent is moved."""
_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From y up to z up, x kept: many modellers' files are so, and neither OBJ nor STL says it."""
_UNTOLD = frozenset({".obj", ".stl"})


class MeshForms(NamedTuple):
    """What the meshes gave."""

    forms: dict[BodyId, Form]
    notes: tuple[str, ...]
    """What was changed about a mesh to fit, and what could not be read."""


class Assets:
    """Mesh files in some folders."""

    def __init__(
        self,
        folders: Iterable[Path] = (),
        *,
        find_file: Callable[[str], Path | None] = lambda name: None,
        cache: Path | None = None,
    ) -> None:
        """Looks through the folders.

        Args:
            folders: where meshes may lie, at any depth.
            find_file: the file that a map's own name of a mesh stands for (`KnowledgeBase.find_file`).
            cache: where what was read is kept; by default in the user's cache.
        """
        self._catalogue = Catalogue(folders, find_file=find_file)
        self._cache = cache
        self._fitted: dict[tuple[str, Vector | None], tuple[Form, str]] = {}

    def forms(self, bodies: Sequence[Body]) -> MeshForms:
        """The forms of those bodies whose meshes are at hand and can be read; never fails because of a file."""
        found = {body.id: hit for body in bodies if (hit := self._catalogue.find(body)) is not None}
        read, refused = read_meshes((hit.path for hit in found.values()), folder=self._cache)
        forms: dict[BodyId, Form] = {}
        fitted: dict[str, list[BodyId]] = {}
        for body in bodies:
            hit = found.get(body.id)
            if hit is None or (mesh := read.get(hit.path)) is None:
                continue
            forms[body.id], what = self._form(mesh, hit, body.size)
            if what:
                fitted.setdefault(what, []).append(body.id)
        notes = [*self._catalogue.notes]
        notes += [f"the mesh {path} is left out: {why}" for path, why in refused.items()]
        notes += [f"{_listed(ids)}: {what}" for what, ids in fitted.items()]
        return MeshForms(forms, tuple(notes))

    def _form(self, mesh: MeshFile, hit: Found, size: Vector | None) -> tuple[Form, str]:
        key = (mesh.digest, size)
        if key not in self._fitted:
            self._fitted[key] = _fitted(mesh, hit, size)
        return self._fitted[key]


def _fitted(mesh: MeshFile, hit: Found, size: Vector | None) -> tuple[Form, str]:
    """A mesh as large as its body and in its middle, and what that took."""
    turn = _turn(mesh, size)
    corners = np.array([mesh.low, mesh.high]) @ turn.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    extents = high - low
    scale = fitting_scale(extents, size)
    # A body's origin is the middle of its size; without one, the mesh's own origin is all there is to go by.
    middle = (low + high) / 2 if size is not None else np.zeros(3)
    digest = hashlib.sha256(repr((mesh.digest, turn.tolist(), scale.tolist(), middle.tolist())).encode())
    skins = tuple(_skin(skin, turn, scale, middle) for skin in mesh.skins)
    # Pieces are cut out of a grid, and may stand out of the mesh by a part of a cell.
    solids = tuple(_solid((np.clip(piece @ turn.T, low, high) - middle) * scale) for piece in mesh.pieces)
    form = Form(
        key=digest.hexdigest()[:32],
        skins=skins,
        solids=solids,
        source=FormSource.MESH,
        why=f"the mesh {hit.path.name}, found by its {hit.by}",
        kind="mesh",
        places=levels_of(skins, solids),
    )
    return form, _changes(mesh, turn, scale, np.abs(middle) / np.where(extents > 0.0, extents, 1.0))


def _turn(mesh: MeshFile, size: Vector | None) -> Array:
    """Whether the mesh has y up: taken so where only then it is as large as its body, all ways alike."""
    if size is None or mesh.path.suffix.lower() not in _UNTOLD or not all(size):
        return np.eye(3)
    extents = mesh.high - mesh.low
    uneven = [float(np.ptp(ratio) / ratio.max()) for ratio in (extents / size, extents[[0, 2, 1]] / size)]
    return _Y_UP if uneven[0] > 5 * _EVEN and uneven[1] < _EVEN else np.eye(3)


def _skin(skin: Skin, turn: Array, scale: Array, middle: Array) -> Skin:
    normals = None
    if skin.normals is not None:
        normals = skin.normals @ turn.T / scale
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = normals / np.where(lengths > 0.0, lengths, 1.0)
    points = (skin.points @ turn.T - middle) * scale
    return Skin(points, skin.faces, skin.surface, normals, skin.uv, skin.image)


def _solid(points: Array) -> Solid:
    low, high = points.min(axis=0), points.max(axis=0)
    centre = (low + high) / 2
    return Solid(
        kind=SolidKind.HULL,
        size=_vector(high - low),
        pose=Pose(_vector(centre)),
        points=tuple(map(_vector, points - centre)),
    )


def _changes(mesh: MeshFile, turn: Array, scale: Array, aside: Array) -> str:
    """What was done to a mesh, in words."""
    done = []
    if not np.array_equal(turn, np.eye(3)):
        done.append("is turned from y up to z up")
    if np.any(scale != 1.0):
        even = np.ptp(scale) / scale.max() < _EVEN
        factor = f"{scale.mean():.4g}" if even else " x ".join(f"{part:.4g}" for part in scale)
        done.append(f"is scaled by {factor} to the map's size")
    if aside.max() > _ASIDE:
        done.append("is moved to have its middle where the map has the body's")
    return f"the mesh {mesh.path.name} {' and '.join(done)}" if done else ""


def _listed(ids: Sequence[BodyId]) -> str:
    return ", ".join(ids[:3]) + (f" and {len(ids) - 3} more" if len(ids) > 3 else "")


def _vector(row: Array) -> Vector:
    x, y, z = row.tolist()
    return x, y, z
