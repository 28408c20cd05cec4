"""Fitting: from what is known of classes to the forms of a world's bodies, each as it stands there.

Nothing is changed in the world. Meshes come first, where somebody has them; all else is built from shapes to the very
size that the map tells.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

import numpy as np

from mindstage.knowledge.shaping import ShapeRule
from mindstage.shapes.fitting.facing import CASES, CLOSING, GRIPS, LOOKING, Faces
from mindstage.shapes.fitting.fitted import Fitted, Knowing, MeshForms, MeshSource, Remark
from mindstage.shapes.fitting.making import Maker
from mindstage.shapes.fitting.setting import Setting
from mindstage.world import BodyId, Form, FormSource, Iri, World

__all__ = ["Fitted", "Knowing", "MeshForms", "MeshSource", "Remark", "forms_for"]

_HOSTS = (
    *CASES,
    *CLOSING,
    *LOOKING,
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


def forms_for(world: World, knowledge: Knowing, *, meshes: MeshSource | None = None) -> Fitted:
    """The forms of all bodies of a world that have a size.

    Args:
        world: what is to be shown.
        knowledge: who knows how classes are shaped.
        meshes: who finds mesh files, which come before all else.
    """
    forms: dict[BodyId, Form] = {}
    notes = _Notes()
    if meshes is not None:
        found = meshes.forms(world.bodies)
        forms |= found.forms
        notes.remarks += [Remark((), text) for text in found.notes]
    rules = {cls: knowledge.shape_rule(cls) for cls in dict.fromkeys(body.cls for body in world.bodies)}
    if world.bodies:
        _fit(Setting(world, rules), forms, notes)
    notes.about_classes(world, rules, forms)
    return Fitted(MappingProxyType({body.id: forms[body.id] for body in world.bodies if body.id in forms}), notes.all())


def _fit(setting: Setting, forms: dict[BodyId, Form], notes: _Notes) -> None:
    """Adds the forms of all bodies that have none yet."""
    alone = np.ones(len(setting.bodies), dtype=bool)
    alone[list(setting.parents)] = False
    around, crowded = setting.around(setting.of_kind(*_HOSTS) | (setting.of_kind(*GRIPS) & alone))
    faces, maker = Faces(setting, around), Maker(setting, around)
    for row, body in enumerate(setting.bodies):
        if body.id in forms or body.size is None:
            continue
        facing = faces.of(row)
        if min(body.size) <= 0.0:
            notes.add("has no extent along one of its axes, so it stays as the map has it", body.id)
            continue
        form, doubt = maker.form(row, facing)
        if doubt:
            notes.add(f"cannot be built as told: {doubt}", body.id)
        if form is not None:
            forms[body.id] = form
            if facing.guessed and form.kind != "box":
                notes.add(f"is a {form.kind}, and nothing tells where its front is: it looks to the middle", body.id)
    for row in crowded:
        notes.add("stands in a crowd, so nobody looked at what is in it", setting.bodies[row].id)


class _Notes:
    """Remarks, those of one text together."""

    def __init__(self) -> None:
        self.remarks: list[Remark] = []
        self._ids: dict[str, list[BodyId]] = {}

    def add(self, text: str, id: BodyId) -> None:
        self._ids.setdefault(text, []).append(id)

    def about_classes(self, world: World, rules: Mapping[Iri, ShapeRule], forms: Iterable[BodyId]) -> None:
        """What was guessed by names, and what was told that cannot be."""
        shown = set(forms)
        for body in world.bodies:
            rule = rules[body.cls]
            if body.id in shown and rule.source is FormSource.NAME:
                self.add(f"is shaped as a {rule.kind} by a guess: {rule.why}", body.id)
            for doubt in rule.doubts:
                self.add(doubt, body.id)

    def all(self) -> tuple[Remark, ...]:
        told = (Remark(tuple(ids), f"{_listed(ids)}: {text}") for text, ids in self._ids.items())
        return (*self.remarks, *told)


def _listed(ids: list[BodyId]) -> str:
    return ", ".join(ids[:3]) + (f" and {len(ids) - 3} more" if len(ids) > 3 else "")
