"""Embodiment: the forms of all that is on a stage, and what the report of a spawn says of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from threading import Lock
from types import MappingProxyType
from typing import TYPE_CHECKING

from msgspec.structs import replace

from mindstage.engines.contract import SpawnFailure, SpawnNote, SpawnNoteKind, SpawnReport
from mindstage.world import NO_GEOMETRY, BodyGeometry, BodyId, GeometryMap, GeometrySource, World

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase
    from mindstage.shapes.fitting import FittedGeometry, MeshProvider

__all__ = ["GeometryProvider", "with_geometry_notes"]

_SOURCE_TEXTS = {
    GeometrySource.MESH: "from meshes",
    GeometrySource.ONTOLOGY: "from what is known of their classes",
    GeometrySource.CLASS_NAME: "guessed by the names of their classes",
    GeometrySource.MAP: "plain, since nobody knows better",
}


class GeometryProvider:
    """Works forms out, and keeps them as long as somebody may bring their bodies back."""

    def __init__(self, knowledge: KnowledgeBase, *, shapes: bool, meshes: MeshProvider | None) -> None:
        """Has none yet.

        Args:
            knowledge: who knows how classes are shaped.
            shapes: whether it is asked; else a body without a mesh is its shape in its size.
            meshes: who finds mesh files.
        """
        self._knowledge = knowledge
        self._shapes, self._meshes = shapes, meshes
        self._geometry: dict[BodyId, BodyGeometry] = {}
        self._cached: tuple[tuple[BodyId, ...], GeometryMap] = ((), NO_GEOMETRY)
        self._lock = Lock()

    def set_knowledge(self, knowledge: KnowledgeBase) -> None:
        """Asks somebody else from now on."""
        self._knowledge = knowledge

    def fit(self, world: World, *, geometry: GeometryMap | None = None) -> FittedGeometry:
        """The forms of a world that is about to be spawned, unless they are given; a large one takes a while."""
        from mindstage.shapes.fitting import FitNote, FittedGeometry, fit_geometry

        if geometry is not None:
            return FittedGeometry(geometry)
        if self._shapes:
            return fit_geometry(world, self._knowledge, meshes=self._meshes)
        if self._meshes is None:
            return FittedGeometry(NO_GEOMETRY)
        found = self._meshes.geometry_for(world.bodies)
        return FittedGeometry(found.geometry, tuple(FitNote((), text) for text in found.notes))

    def add(self, geometry: GeometryMap, *, failed: Iterable[SpawnFailure] = ()) -> None:
        """Keeps the forms of what was spawned; what failed may be called like something that is there already."""
        without = {failure.id for failure in failed}
        with self._lock:
            self._geometry = {**self._geometry, **{id: form for id, form in geometry.items() if id not in without}}
            self._cached = ((), NO_GEOMETRY)

    def for_world(self, world: World) -> GeometryMap:
        """The forms with which a world was spawned."""
        return {body.id: self._geometry[body.id] for body in world.bodies if body.id in self._geometry}

    def clear(self) -> None:
        """Forgets all of them."""
        with self._lock:
            self._geometry, self._cached = {}, ((), NO_GEOMETRY)

    def for_ids(self, ids: tuple[BodyId, ...]) -> GeometryMap:
        """The forms of bodies that are there; the same object for the same tuple."""
        with self._lock:
            known, forms = self._cached
            if known is not ids:
                forms = MappingProxyType({id: self._geometry[id] for id in ids if id in self._geometry})
                self._cached = (ids, forms)
            return forms


def with_geometry_notes(report: SpawnReport, fitted: FittedGeometry, ids: Iterable[BodyId]) -> SpawnReport:
    """The same report with what was decided about the forms of these bodies."""
    there = set(ids) - {failure.id for failure in report.failed_bodies}
    count = Counter(form.source for id, form in fitted.geometry.items() if id in there)
    notes = [SpawnNote(SpawnNoteKind.SHAPE, remark.ids, remark.text) for remark in fitted.notes]
    if count:
        words = ", ".join(f"{count[source]} {text}" for source, text in _SOURCE_TEXTS.items() if count[source])
        notes.insert(0, SpawnNote(SpawnNoteKind.SHAPE, (), f"forms: {words}"))
    return replace(report, notes=(*report.notes, *notes)) if notes else report
