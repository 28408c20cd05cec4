"""Geometry, size and mass of bodies, given or estimated."""

from __future__ import annotations

import builtins
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import SpawnNote, SpawnNoteKind
from mindstage.engines.entity_registry import EntityRegistry
from mindstage.scene import BodyGeometry, BodyId, GeometryMap, PrimitiveType, Vector
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.collision_shapes import (
    CollisionShapeBatch,
    CompiledGeometry,
    compile_geometry,
    fallback_collision_shape,
)
from mindstage.scene.geometry import Inertia
from mindstage.scene.transforms import Array, quat_rotate

__all__ = ["ASSUMED_SIZE_M", "MASS_RANGE_KG", "MassProperties", "inertia_matrix"]

_id_of = builtins.id  # the methods here have a parameter named `id`

ASSUMED_SIZE_M = 0.1
MASS_RANGE_KG = (1e-5, 1e7)
"""Range of masses that can be simulated together: from a feather to a ship."""
_ASSUMED_DENSITY = 200.0
"""Mean density of furniture and full cupboards in their bounding boxes [kg/m³]."""
_ASSUMED_MASS_RANGE_KG = (0.01, 100.0)
"""Range of estimated masses."""
_ROUND_SHAPE_FACTOR = 0.8
"""Scale of a box that lies about as much inside a round shape as outside."""


class MassProperties:
    """Geometry and mass properties of the bodies in a registry."""

    def __init__(self, registry: EntityRegistry) -> None:
        self.geometry: dict[BodyId, BodyGeometry] = {}
        self._registry = registry
        self._compiled: dict[int, tuple[object, CompiledGeometry]] = {}
        """By identity of a tuple of collision shapes, which is stored beside it to keep it alive."""
        self._radii: tuple[tuple[BodyId, ...], Array] = ((), np.zeros(0))
        """The result of `bounding_radii` and the bodies that it is for."""

    def copy(self, registry: EntityRegistry) -> MassProperties:
        """The same geometry for a copy of the registry; compiled geometry is immutable and shared."""
        result = MassProperties(registry)
        result.geometry, result._compiled, result._radii = dict(self.geometry), self._compiled, self._radii
        return result

    def add(self, ids: Iterable[BodyId], geometry: GeometryMap) -> list[SpawnNote]:
        """Adds geometry of new bodies; returns a note for each with invalid numbers."""
        notes = []
        for id in ids:
            if id not in geometry:
                continue
            self.geometry[id], invalid = _without_invalid_numbers(geometry[id])
            if count := self.compiled(id).invalid_count:
                invalid.append(f"{count} of its collision shapes")
            if invalid:
                text = f"{id}'s geometry has invalid numbers: {', '.join(invalid)} left out"
                notes.append(SpawnNote(SpawnNoteKind.SHAPE, (id,), text))
        return notes

    def remove(self, ids: Iterable[BodyId]) -> None:
        """Removes geometry of bodies."""
        for id in ids:
            self.geometry.pop(id, None)
        self._radii = ((), np.zeros(0))

    def size(self, id: BodyId) -> Vector:
        """Size of a body, assumed if the map has none [m]."""
        return self._registry.bodies[id].size or (ASSUMED_SIZE_M,) * 3

    def sizes(self, ids: Iterable[BodyId]) -> Array:
        """Sizes of bodies, n x 3 [m]."""
        bodies, default = self._registry.bodies, (ASSUMED_SIZE_M,) * 3
        return np.array([bodies[id].size or default for id in ids], dtype=float).reshape(-1, 3)

    def compiled(self, id: BodyId) -> CompiledGeometry:
        """Collision shapes of a body; without geometry, its primitive shape in its size."""
        geometry = self.geometry.get(id)
        if geometry is None:
            return compile_geometry((fallback_collision_shape(self._registry.bodies[id], self.size(id)),))
        cached = self._compiled.get(_id_of(geometry.collision_shapes))
        if cached is None:
            cached = self._compiled[_id_of(geometry.collision_shapes)] = (
                geometry.collision_shapes,
                compile_geometry(geometry.collision_shapes),
            )
        return cached[1]

    def has_own_geometry(self, id: BodyId) -> bool:
        """Whether a body's collision shapes differ from the box of its size."""
        return id in self.geometry and not self.compiled(id).is_box_of_size(self.size(id))

    # -- arrays ---------------------------------------------------------------------------------------------------

    def has_geometry_mask(self, ids: Sequence[BodyId]) -> NDArray[np.bool_] | None:
        """`has_own_geometry` of bodies; None if no body has geometry."""
        return np.array([self.has_own_geometry(id) for id in ids], dtype=bool) if self.geometry else None

    def collision_shape_batch(self, ids: Sequence[BodyId], poses: Array) -> CollisionShapeBatch | None:
        """Collision shapes of bodies at their poses; None if no body has geometry."""
        return CollisionShapeBatch.from_compiled(poses, [self.compiled(id) for id in ids]) if self.geometry else None

    def local_boxes(self, ids: Sequence[BodyId]) -> tuple[Array, Array]:
        """Boxes around collision shapes in the frames of their bodies: centers and sizes, k x 3 [m]."""
        centers, sizes = np.zeros((len(ids), 3)), self.sizes(ids)
        rows = [row for row, id in enumerate(ids) if id in self.geometry]
        if rows:
            low, high = np.array([self.compiled(ids[row]).bounds for row in rows]).transpose(1, 0, 2)
            centers[rows], sizes[rows] = (low + high) / 2, high - low
        return centers, sizes

    def overlap_boxes(self, ids: Sequence[BodyId], body_poses: Array) -> OrientedBoxes:
        """Boxes for overlap tests: around collision shapes, and smaller than round primitive shapes."""
        poses, (centers, sizes) = body_poses.copy(), self.local_boxes(ids)
        poses[:, :3] += quat_rotate(body_poses[:, 3:], centers)
        for row, id in enumerate(ids):
            shape = self._registry.bodies[id].shape
            if shape is None or shape.type is PrimitiveType.BOX or id in self.geometry:
                continue
            if shape.type is PrimitiveType.SPHERE:
                poses[row, 3:] = (1.0, 0.0, 0.0, 0.0)
                sizes[row] *= _ROUND_SHAPE_FACTOR
            else:
                sizes[row, :2] *= _ROUND_SHAPE_FACTOR
        return OrientedBoxes.from_poses(poses, sizes)

    def bounding_radii(self, ids: tuple[BodyId, ...]) -> Array:
        """For each body, the radius of a sphere about its position that contains its box and its shapes, n [m].

        Args:
            ids: all bodies of the registry; if bodies were added since the last call, only theirs are computed.
        """
        known, radii = self._radii
        if known is not ids:
            if ids[: len(known)] != known:
                known, radii = (), radii[:0]
            added = ids[len(known) :]
            corners = self.sizes(added) / 2
            for row, id in enumerate(added):
                if id in self.geometry:
                    corners[row] = np.maximum(corners[row], np.abs(self.compiled(id).bounds).max(axis=0))
            radii = np.concatenate([radii, np.linalg.norm(corners, axis=1)])
            self._radii = ids, radii
        return radii

    def mass_distribution(self, id: BodyId) -> CompiledGeometry | Inertia:
        """What has the center of mass and the moments of inertia of a body: its own, or its collision shapes."""
        geometry = self.geometry.get(id)
        return self.compiled(id) if geometry is None or geometry.inertia is None else geometry.inertia

    def center_of_mass(self, id: BodyId) -> Array:
        """The center of mass of a body, in its frame [m]."""
        found = self.mass_distribution(id)
        return np.asarray(found.center if isinstance(found, Inertia) else found.center_of_mass, dtype=float)

    # -- masses --------------------------------------------------------------------------------------------------

    def mass(self, id: BodyId, *, is_dynamic: bool) -> float:
        """The given mass within `MASS_RANGE_KG`, an estimate for dynamic bodies, or 0 [kg]."""
        given = self._given_mass(id)
        if given:
            lowest, highest = MASS_RANGE_KG
            return min(max(given, lowest), highest)
        return self._estimated_mass(id) if is_dynamic else 0.0

    def approximate_masses(self) -> dict[BodyId, float]:
        """Given masses, and estimates for all other bodies [kg]."""
        return {id: self.mass(id, is_dynamic=True) for id in self._registry.bodies}

    def _given_mass(self, id: BodyId) -> float | None:
        """The mass that the world states, otherwise that of the geometry [kg]."""
        stated, geometry = self._registry.bodies[id].physics.mass_kg, self.geometry.get(id)
        return stated if stated or geometry is None or geometry.inertia is None else geometry.inertia.mass_kg

    def _estimated_mass(self, id: BodyId) -> float:
        geometry = self.geometry.get(id)
        if geometry is not None and geometry.density is not None:
            mass = self.compiled(id).volume * geometry.density
        else:
            depth, width, height = self.size(id)
            mass = depth * width * height * _ASSUMED_DENSITY
        lowest, highest = _ASSUMED_MASS_RANGE_KG
        return float(min(max(mass, lowest), highest))

    def assumption_notes(self, ids: Iterable[BodyId], is_dynamic: Callable[[BodyId], bool]) -> list[SpawnNote]:
        """Notes on sizes, mobilities and masses that the map does not give."""
        bodies = [self._registry.bodies[id] for id in ids]
        notes = []
        if unsized := tuple(body.id for body in bodies if body.size is None):
            text = f"{len(unsized)} bodies have no size; cubes of {ASSUMED_SIZE_M} m are assumed"
            notes.append(SpawnNote(SpawnNoteKind.SIZE_ASSUMED, unsized, text))
        if immobile := tuple(body.id for body in bodies if body.physics.mobility is None):
            text = f"{len(immobile)} bodies have no mobility; static is assumed"
            notes.append(SpawnNote(SpawnNoteKind.MOBILITY_ASSUMED, immobile, text))
        lowest, highest = MASS_RANGE_KG
        for body in bodies:
            given = self._given_mass(body.id)
            if given and not lowest <= given <= highest:
                text = (
                    f"{body.id} has a mass of {given:.3g} kg: {self.mass(body.id, is_dynamic=True):g} kg is simulated"
                )
                notes.append(SpawnNote(SpawnNoteKind.CLAMPED, (body.id,), text))
        for body in bodies:
            if not self._given_mass(body.id) and is_dynamic(body.id):
                geometry = self.geometry.get(body.id)
                source = "its size" if geometry is None or geometry.density is None else "its geometry and material"
                mass_kg = self._estimated_mass(body.id)
                text = f"{body.id} is dynamic without a mass: {mass_kg:.3g} kg estimated from {source}"
                notes.append(SpawnNote(SpawnNoteKind.MASS_ESTIMATED, (body.id,), text))
        return notes


def _without_invalid_numbers(geometry: BodyGeometry) -> tuple[BodyGeometry, list[str]]:
    """The geometry without invalid properties, and their names."""
    properties = {"friction": geometry.friction, "restitution": geometry.restitution, "density": geometry.density}
    invalid = [
        name for name, value in properties.items() if value is not None and not (isfinite(value) and value >= 0.0)
    ]
    inertia = geometry.inertia
    if inertia is not None and not _is_valid(inertia):
        invalid, inertia = [*invalid, "inertia"], None
    if not invalid:
        return geometry, invalid
    valid = {name: value for name, value in properties.items() if name not in invalid}
    cleaned = replace(
        geometry,
        friction=valid.get("friction"),
        restitution=valid.get("restitution"),
        density=valid.get("density"),
        inertia=inertia,
    )
    return cleaned, invalid


def _is_valid(inertia: Inertia) -> bool:
    """Whether a mass is positive, and moments of inertia are not negative about any axis."""
    if not all(map(isfinite, (inertia.mass_kg, *inertia.center, *inertia.tensor))) or inertia.mass_kg <= 0.0:
        return False
    moments = np.linalg.eigvalsh(inertia_matrix(inertia))
    return bool(moments[0] >= -1e-6 * max(moments[2], 1e-9))


def inertia_matrix(inertia: Inertia) -> Array:
    """The tensor as a matrix, 3 x 3 [kg m²]."""
    xx, yy, zz, xy, xz, yz = inertia.tensor
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
