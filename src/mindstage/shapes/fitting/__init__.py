"""Fitting: from what is known of classes to the forms of a world's bodies, each as it stands there.

Nothing is changed in the world. Meshes come first, where somebody has them; all else is built from shapes to the very
size that the map tells.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

import numpy as np

from mindstage.knowledge.shaping import ShapeRule
from mindstage.shapes.fitting.facing import (
    CABINET_SHAPES,
    CLOSING_SHAPES,
    FRONTED_SHAPES,
    HANDLE_SHAPES,
    OrientationSolver,
)
from mindstage.shapes.fitting.fitted import FitNote, FittedGeometry, MeshGeometries, MeshProvider, ShapeRuleProvider
from mindstage.shapes.fitting.making import GeometryFitter
from mindstage.shapes.fitting.setting import SceneContext
from mindstage.world import BodyGeometry, BodyId, GeometrySource, Iri, World

__all__ = ["FitNote", "FittedGeometry", "MeshGeometries", "MeshProvider", "ShapeRuleProvider", "fit_geometry"]

_NEIGHBORHOOD_SHAPES = (
    *CABINET_SHAPES,
    *CLOSING_SHAPES,
    *FRONTED_SHAPES,
    "tub",
    "basket",
    "bin",
    "bowl",
    "pot",
    "pan",
    "sink",
    "rack",
    "counter",
    "wall",
    "shell",
)
"""What is near them tells how they are open."""


def fit_geometry(world: World, knowledge: ShapeRuleProvider, *, meshes: MeshProvider | None = None) -> FittedGeometry:
    """The forms of all bodies of a world that have a size.

    Args:
        world: what is to be shown.
        knowledge: who knows how classes are shaped.
        meshes: who finds mesh files, which come before all else.
    """
    forms: dict[BodyId, BodyGeometry] = {}
    notes = _Notes()
    if meshes is not None:
        found = meshes.geometry_for(world.bodies)
        forms |= found.geometry
        notes.notes += [FitNote((), text) for text in found.notes]
    rules = {cls: knowledge.shape_rule(cls) for cls in dict.fromkeys(body.cls for body in world.bodies)}
    if world.bodies:
        _fit(SceneContext(world, rules), forms, notes)
    notes.add_class_notes(world, rules, forms)
    return FittedGeometry(
        MappingProxyType({body.id: forms[body.id] for body in world.bodies if body.id in forms}), notes.to_tuple()
    )


def _fit(context: SceneContext, geometry: dict[BodyId, BodyGeometry], notes: _Notes) -> None:
    """Adds the forms of all bodies that have none yet."""
    alone = np.ones(len(context.bodies), dtype=bool)
    alone[list(context.parents)] = False
    around, crowded = context.neighborhoods(
        context.has_shape(*_NEIGHBORHOOD_SHAPES) | (context.has_shape(*HANDLE_SHAPES) & alone)
    )
    faces, maker = OrientationSolver(context, around), GeometryFitter(context, around)
    for row, body in enumerate(context.bodies):
        if body.id in geometry or body.size is None:
            continue
        facing = faces.orientation_of(row)
        if min(body.size) <= 0.0:
            notes.add("has no extent along one of its axes, so it stays as the map has it", body.id)
            continue
        form, doubt = maker.geometry(row, facing)
        if doubt:
            notes.add(f"cannot be built as told: {doubt}", body.id)
        if form is not None:
            geometry[body.id] = form
            if facing.is_guess and form.shape_name != "box":
                notes.add(
                    f"is a {form.shape_name}, and nothing tells where its front is: it looks to the middle", body.id
                )
    for row in crowded:
        notes.add("stands in a crowd, so nobody looked at what is in it", context.bodies[row].id)


class _Notes:
    """Remarks, those of one text together."""

    def __init__(self) -> None:
        self.notes: list[FitNote] = []
        self._ids: dict[str, list[BodyId]] = {}

    def add(self, text: str, id: BodyId) -> None:
        self._ids.setdefault(text, []).append(id)

    def add_class_notes(self, world: World, rules: Mapping[Iri, ShapeRule], fitted_ids: Iterable[BodyId]) -> None:
        """What was guessed by names, and what was told that cannot be."""
        shown = set(fitted_ids)
        for body in world.bodies:
            rule = rules[body.cls]
            if body.id in shown and rule.source is GeometrySource.CLASS_NAME:
                self.add(f"is shaped as a {rule.shape_type} by a guess: {rule.reason}", body.id)
            for doubt in rule.issues:
                self.add(doubt, body.id)

    def to_tuple(self) -> tuple[FitNote, ...]:
        told = (FitNote(tuple(ids), f"{_join_ids(ids)}: {text}") for text, ids in self._ids.items())
        return (*self.notes, *told)


def _join_ids(ids: list[BodyId]) -> str:
    return ", ".join(ids[:3]) + (f" and {len(ids) - 3} more" if len(ids) > 3 else "")
