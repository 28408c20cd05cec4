"""Embodiment: the forms of all that is on a stage, and what the report of a spawn says of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from threading import Lock
from types import MappingProxyType
from typing import TYPE_CHECKING

from msgspec.structs import replace

from mindstage.engines.contract import Failure, Note, NoteKind, SpawnReport
from mindstage.world import NO_FORMS, BodyId, Form, Forms, FormSource, World

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase
    from mindstage.shapes.fitting import Fitted, MeshSource

__all__ = ["Embodiment", "told_of"]

_SOURCES = {
    FormSource.MESH: "from meshes",
    FormSource.KNOWLEDGE: "from what is known of their classes",
    FormSource.NAME: "guessed by the names of their classes",
    FormSource.MAP: "plain, since nobody knows better",
}


class Embodiment:
    """Works forms out, and keeps them as long as somebody may bring their bodies back."""

    def __init__(self, knowledge: KnowledgeBase, *, shapes: bool, meshes: MeshSource | None) -> None:
        """Has none yet.

        Args:
            knowledge: who knows how classes are shaped.
            shapes: whether it is asked; else a body without a mesh is its shape in its size.
            meshes: who finds mesh files.
        """
        self._knowledge = knowledge
        self._shapes, self._meshes = shapes, meshes
        self._all: dict[BodyId, Form] = {}
        self._there: tuple[tuple[BodyId, ...], Forms] = ((), NO_FORMS)
        self._keeping = Lock()

    def learn(self, knowledge: KnowledgeBase) -> None:
        """Asks somebody else from now on."""
        self._knowledge = knowledge

    def fit(self, world: World, *, given: Forms | None = None) -> Fitted:
        """The forms of a world that is about to be spawned, unless they are given; a large one takes a while."""
        from mindstage.shapes.fitting import Fitted, Remark, forms_for

        if given is not None:
            return Fitted(given)
        if self._shapes:
            return forms_for(world, self._knowledge, meshes=self._meshes)
        if self._meshes is None:
            return Fitted(NO_FORMS)
        found = self._meshes.forms(world.bodies)
        return Fitted(found.forms, tuple(Remark((), text) for text in found.notes))

    def add(self, forms: Forms, *, failed: Iterable[Failure] = ()) -> None:
        """Keeps the forms of what was spawned; what failed may be called like something that is there already."""
        without = {failure.id for failure in failed}
        with self._keeping:
            self._all = {**self._all, **{id: form for id, form in forms.items() if id not in without}}
            self._there = ((), NO_FORMS)

    def all_of(self, world: World) -> Forms:
        """The forms with which a world was spawned."""
        return {body.id: self._all[body.id] for body in world.bodies if body.id in self._all}

    def clear(self) -> None:
        """Forgets all of them."""
        with self._keeping:
            self._all, self._there = {}, ((), NO_FORMS)

    def of(self, ids: tuple[BodyId, ...]) -> Forms:
        """The forms of bodies that are there; the same object for the same tuple."""
        with self._keeping:
            known, forms = self._there
            if known is not ids:
                forms = MappingProxyType({id: self._all[id] for id in ids if id in self._all})
                self._there = (ids, forms)
            return forms


def told_of(report: SpawnReport, fitted: Fitted, ids: Iterable[BodyId]) -> SpawnReport:
    """The same report with what was decided about the forms of these bodies."""
    there = set(ids) - {failure.id for failure in report.failed_bodies}
    count = Counter(form.source for id, form in fitted.forms.items() if id in there)
    notes = [Note(NoteKind.SHAPE, remark.ids, remark.text) for remark in fitted.notes]
    if count:
        words = ", ".join(f"{count[source]} {text}" for source, text in _SOURCES.items() if count[source])
        notes.insert(0, Note(NoteKind.SHAPE, (), f"forms: {words}"))
    return replace(report, notes=(*report.notes, *notes)) if notes else report
