"""Matter: what bodies are made of and what they weigh, told or assumed."""

from __future__ import annotations

import builtins
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.contract import Note, NoteKind
from mindstage.engines.inventory import Inventory
from mindstage.engines.parts import Parts
from mindstage.engines.solids import Prepared, plain_solid, prepare
from mindstage.world import BodyId, Form, Forms, ShapeKind, Vector
from mindstage.world.boxes import Boxes
from mindstage.world.geometry import Array, rotate

__all__ = ["SIZE_ASSUMED_M", "Matter"]

_id_of = builtins.id  # the methods here have an argument `id`

SIZE_ASSUMED_M = 0.1
_DENSITY_ASSUMED = 200.0
"""[kg/m³]: furniture and full cupboards alike weigh about this much for the box that they fill."""
_MASS_ASSUMED_KG = (0.01, 100.0)
"""No estimate is below or above these."""
_ROUND = 0.8
"""A box of this part of its size lies about as often inside something round as outside."""


class Matter:
    """The forms of an inventory's bodies, each made ready once."""

    def __init__(self, inventory: Inventory) -> None:
        self.forms: dict[BodyId, Form] = {}
        self._inventory = inventory
        self._prepared: dict[int, tuple[object, Prepared]] = {}
        """By the identity of a form's tuple of solids, which stands beside it so that it lives as long."""

    def copy(self, inventory: Inventory) -> Matter:
        """The same forms for a copy of the inventory; what was made ready never changes, so is shared."""
        twin = Matter(inventory)
        twin.forms, twin._prepared = dict(self.forms), self._prepared
        return twin

    def add(self, ids: Iterable[BodyId], forms: Forms) -> list[Note]:
        """Takes the forms of bodies that came, and says what of them cannot be used."""
        notes = []
        for id in ids:
            if id not in forms:
                continue
            self.forms[id], strange = _sensible(forms[id])
            if count := self.prepared(id).left_out:
                strange.append(f"{count} of its solids")
            if strange:
                text = f"{id}'s form has numbers that mean nothing: {', '.join(strange)} left out"
                notes.append(Note(NoteKind.SHAPE, (id,), text))
        return notes

    def remove(self, ids: Iterable[BodyId]) -> None:
        """Forgets the forms of bodies that went."""
        for id in ids:
            self.forms.pop(id, None)

    def size(self, id: BodyId) -> Vector:
        """How large a body is, or is taken to be."""
        return self._inventory.bodies[id].size or (SIZE_ASSUMED_M,) * 3

    def sizes(self, ids: Iterable[BodyId]) -> Array:
        """The same for many, n x 3."""
        bodies, default = self._inventory.bodies, (SIZE_ASSUMED_M,) * 3
        return np.array([bodies[id].size or default for id in ids], dtype=float).reshape(-1, 3)

    def prepared(self, id: BodyId) -> Prepared:
        """What a body is made of; without a form it is its shape, in its size."""
        form = self.forms.get(id)
        if form is None:
            return prepare((plain_solid(self._inventory.bodies[id], self.size(id)),))
        known = self._prepared.get(_id_of(form.solids))
        if known is None:
            known = self._prepared[_id_of(form.solids)] = (form.solids, prepare(form.solids))
        return known[1]

    def has_inside(self, id: BodyId) -> bool:
        """Whether a body has a form that is not just one box of its size."""
        return id in self.forms and not self.prepared(id).fills(self.size(id))

    # -- in bulk, for decisions ----------------------------------------------------------------------------------

    def formed(self, ids: Sequence[BodyId]) -> NDArray[np.bool_] | None:
        """For each body `has_inside`; None where no body has a form."""
        return np.array([self.has_inside(id) for id in ids], dtype=bool) if self.forms else None

    def parts(self, ids: Sequence[BodyId], where: Array) -> Parts | None:
        """All solids where they stand; None where no body has a form."""
        return Parts.of(where, [self.prepared(id) for id in ids]) if self.forms else None

    def cores(self, ids: Sequence[BodyId], where: Array) -> Boxes:
        """Boxes that stand for the bodies when it comes to overlaps: round a form's solids, within round shapes."""
        poses, sizes = where.copy(), self.sizes(ids)
        formed = [row for row, id in enumerate(ids) if id in self.forms]
        if formed:
            low, high = np.array([self.prepared(ids[row]).bounds for row in formed]).transpose(1, 0, 2)
            poses[formed, :3] += rotate(where[formed, 3:], (low + high) / 2)
            sizes[formed] = high - low
        for row, id in enumerate(ids):
            shape = self._inventory.bodies[id].shape
            if shape is None or shape.kind is ShapeKind.BOX or id in self.forms:
                continue
            if shape.kind is ShapeKind.SPHERE:
                poses[row, 3:] = (1.0, 0.0, 0.0, 0.0)
                sizes[row] *= _ROUND
            else:
                sizes[row, :2] *= _ROUND
        return Boxes.of(poses, sizes)

    # -- masses --------------------------------------------------------------------------------------------------

    def mass(self, id: BodyId, *, moves: bool) -> float:
        """The given mass, or an estimate if the physics moves it, or 0 [kg]."""
        return self._inventory.bodies[id].physics.mass_kg or (self._estimated(id) if moves else 0.0)

    def masses_to_sort_by(self) -> dict[BodyId, float]:
        """Given masses, and estimates for all others."""
        return {id: self.mass(id, moves=True) for id in self._inventory.bodies}

    def _estimated(self, id: BodyId) -> float:
        form = self.forms.get(id)
        if form is not None and form.density is not None:
            mass = self.prepared(id).volume * form.density
        else:
            depth, width, height = self.size(id)
            mass = depth * width * height * _DENSITY_ASSUMED
        least, most = _MASS_ASSUMED_KG
        return float(min(max(mass, least), most))

    def assumptions(self, ids: Iterable[BodyId], moves: Callable[[BodyId], bool]) -> list[Note]:
        """One note for each kind of thing that the map did not say."""
        bodies = [self._inventory.bodies[id] for id in ids]
        notes = []
        if unsized := tuple(body.id for body in bodies if body.size is None):
            text = f"{len(unsized)} bodies have no size and are taken as cubes of {SIZE_ASSUMED_M} m"
            notes.append(Note(NoteKind.SIZE_ASSUMED, unsized, text))
        if unmoved := tuple(body.id for body in bodies if body.physics.mobility is None):
            text = f"{len(unmoved)} bodies have no mobility and are taken as static"
            notes.append(Note(NoteKind.MOBILITY_ASSUMED, unmoved, text))
        for body in bodies:
            if not body.physics.mass_kg and moves(body.id):
                form = self.forms.get(body.id)
                source = "its size" if form is None or form.density is None else "its form and what it is made of"
                text = f"{body.id} can move but has no mass: {self._estimated(body.id):.3g} kg estimated from {source}"
                notes.append(Note(NoteKind.MASS_ESTIMATED, (body.id,), text))
        return notes


def _sensible(form: Form) -> tuple[Form, list[str]]:
    """A form without the numbers that no physics could use, and the names of these."""
    told = {"friction": form.friction, "restitution": form.restitution, "density": form.density}
    strange = [name for name, value in told.items() if value is not None and not (isfinite(value) and value >= 0.0)]
    if not strange:
        return form, strange
    told |= dict.fromkeys(strange)
    usable = replace(form, friction=told["friction"], restitution=told["restitution"], density=told["density"])
    return usable, strange
