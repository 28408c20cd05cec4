"""Matter: what bodies are made of and what they weigh, told or assumed."""

from __future__ import annotations

import builtins
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import SpawnNote, SpawnNoteKind
from mindstage.engines.collision_shapes import (
    CollisionShapeBatch,
    CompiledGeometry,
    compile_geometry,
    fallback_collision_shape,
)
from mindstage.engines.registry import EntityRegistry
from mindstage.scene import BodyGeometry, BodyId, GeometryMap, PrimitiveType, Vector
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.transforms import Array, quat_rotate

__all__ = ["ASSUMED_SIZE_M", "MassProperties"]

_id_of = builtins.id  # the methods here have an argument `id`

ASSUMED_SIZE_M = 0.1
_ASSUMED_DENSITY = 200.0
"""[kg/m³]: furniture and full cupboards alike weigh about this much for the box that they fill."""
_ASSUMED_MASS_RANGE_KG = (0.01, 100.0)
"""No estimate is below or above these."""
_ROUND_SHAPE_FACTOR = 0.8
"""A box of this part of its size lies about as often inside something round as outside."""


class MassProperties:
    """The forms of an inventory's bodies, each made ready once."""

    def __init__(self, registry: EntityRegistry) -> None:
        self.geometry: dict[BodyId, BodyGeometry] = {}
        self._registry = registry
        self._compiled: dict[int, tuple[object, CompiledGeometry]] = {}
        """By the identity of a form's tuple of solids, which stands beside it so that it lives as long."""

    def copy(self, registry: EntityRegistry) -> MassProperties:
        """The same forms for a copy of the inventory; what was made ready never changes, so is shared."""
        twin = MassProperties(registry)
        twin.geometry, twin._compiled = dict(self.geometry), self._compiled
        return twin

    def add(self, ids: Iterable[BodyId], geometry: GeometryMap) -> list[SpawnNote]:
        """Takes the forms of bodies that came, and says what of them cannot be used."""
        notes = []
        for id in ids:
            if id not in geometry:
                continue
            self.geometry[id], strange = _without_invalid_numbers(geometry[id])
            if count := self.compiled(id).invalid_count:
                strange.append(f"{count} of its solids")
            if strange:
                text = f"{id}'s form has numbers that mean nothing: {', '.join(strange)} left out"
                notes.append(SpawnNote(SpawnNoteKind.SHAPE, (id,), text))
        return notes

    def remove(self, ids: Iterable[BodyId]) -> None:
        """Forgets the forms of bodies that went."""
        for id in ids:
            self.geometry.pop(id, None)

    def size(self, id: BodyId) -> Vector:
        """How large a body is, or is taken to be."""
        return self._registry.bodies[id].size or (ASSUMED_SIZE_M,) * 3

    def sizes(self, ids: Iterable[BodyId]) -> Array:
        """The same for many, n x 3."""
        bodies, default = self._registry.bodies, (ASSUMED_SIZE_M,) * 3
        return np.array([bodies[id].size or default for id in ids], dtype=float).reshape(-1, 3)

    def compiled(self, id: BodyId) -> CompiledGeometry:
        """What a body is made of; without a form it is its shape, in its size."""
        form = self.geometry.get(id)
        if form is None:
            return compile_geometry((fallback_collision_shape(self._registry.bodies[id], self.size(id)),))
        known = self._compiled.get(_id_of(form.collision_shapes))
        if known is None:
            known = self._compiled[_id_of(form.collision_shapes)] = (
                form.collision_shapes,
                compile_geometry(form.collision_shapes),
            )
        return known[1]

    def has_own_geometry(self, id: BodyId) -> bool:
        """Whether a body has a form that is not just one box of its size."""
        return id in self.geometry and not self.compiled(id).is_box_of_size(self.size(id))

    # -- in bulk, for decisions ----------------------------------------------------------------------------------

    def has_geometry_mask(self, ids: Sequence[BodyId]) -> NDArray[np.bool_] | None:
        """For each body `has_own_geometry`; None where no body has a form."""
        return np.array([self.has_own_geometry(id) for id in ids], dtype=bool) if self.geometry else None

    def collision_shape_batch(self, ids: Sequence[BodyId], poses: Array) -> CollisionShapeBatch | None:
        """All solids where they stand; None where no body has a form."""
        return CollisionShapeBatch.from_compiled(poses, [self.compiled(id) for id in ids]) if self.geometry else None

    def overlap_boxes(self, ids: Sequence[BodyId], body_poses: Array) -> OrientedBoxes:
        """Boxes that stand for the bodies when it comes to overlaps: round a form's solids, within round shapes."""
        poses, sizes = body_poses.copy(), self.sizes(ids)
        formed = [row for row, id in enumerate(ids) if id in self.geometry]
        if formed:
            low, high = np.array([self.compiled(ids[row]).bounds for row in formed]).transpose(1, 0, 2)
            poses[formed, :3] += quat_rotate(body_poses[formed, 3:], (low + high) / 2)
            sizes[formed] = high - low
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

    # -- masses --------------------------------------------------------------------------------------------------

    def mass(self, id: BodyId, *, is_dynamic: bool) -> float:
        """The given mass, or an estimate if the physics moves it, or 0 [kg]."""
        return self._registry.bodies[id].physics.mass_kg or (self._estimated_mass(id) if is_dynamic else 0.0)

    def approximate_masses(self) -> dict[BodyId, float]:
        """Given masses, and estimates for all others."""
        return {id: self.mass(id, is_dynamic=True) for id in self._registry.bodies}

    def _estimated_mass(self, id: BodyId) -> float:
        form = self.geometry.get(id)
        if form is not None and form.density is not None:
            mass = self.compiled(id).volume * form.density
        else:
            depth, width, height = self.size(id)
            mass = depth * width * height * _ASSUMED_DENSITY
        least, most = _ASSUMED_MASS_RANGE_KG
        return float(min(max(mass, least), most))

    def assumption_notes(self, ids: Iterable[BodyId], is_dynamic: Callable[[BodyId], bool]) -> list[SpawnNote]:
        """One note for each kind of thing that the map did not say."""
        bodies = [self._registry.bodies[id] for id in ids]
        notes = []
        if unsized := tuple(body.id for body in bodies if body.size is None):
            text = f"{len(unsized)} bodies have no size and are taken as cubes of {ASSUMED_SIZE_M} m"
            notes.append(SpawnNote(SpawnNoteKind.SIZE_ASSUMED, unsized, text))
        if unmoved := tuple(body.id for body in bodies if body.physics.mobility is None):
            text = f"{len(unmoved)} bodies have no mobility and are taken as static"
            notes.append(SpawnNote(SpawnNoteKind.MOBILITY_ASSUMED, unmoved, text))
        for body in bodies:
            if not body.physics.mass_kg and is_dynamic(body.id):
                form = self.geometry.get(body.id)
                source = "its size" if form is None or form.density is None else "its form and what it is made of"
                text = f"{body.id} can move but has no mass: {self._estimated_mass(body.id):.3g} kg estimated from {source}"
                notes.append(SpawnNote(SpawnNoteKind.MASS_ESTIMATED, (body.id,), text))
        return notes


def _without_invalid_numbers(geometry: BodyGeometry) -> tuple[BodyGeometry, list[str]]:
    """A form without the numbers that no physics could use, and the names of these."""
    told = {"friction": geometry.friction, "restitution": geometry.restitution, "density": geometry.density}
    strange = [name for name, value in told.items() if value is not None and not (isfinite(value) and value >= 0.0)]
    if not strange:
        return geometry, strange
    told |= dict.fromkeys(strange)
    usable = replace(geometry, friction=told["friction"], restitution=told["restitution"], density=told["density"])
    return usable, strange
