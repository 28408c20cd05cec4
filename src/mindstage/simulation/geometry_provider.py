"""The geometry of the bodies of a simulation: fitted when a world is spawned, and kept until it is cleared."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from threading import Lock
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from mindstage.access.resources import require_granted
from mindstage.engines.base import SpawnFailure, SpawnNote, SpawnNoteKind, SpawnReport
from mindstage.knowledge import KnowledgeBase
from mindstage.rdf.vocabulary import HAS_POSE, PIVOT
from mindstage.scene import NO_GEOMETRY, BodyGeometry, BodyId, GeometryMap, GeometrySource, World
from mindstage.scene.edits import Spawn

if TYPE_CHECKING:
    from mindstage.geometry.fit import FittedGeometry, MeshProvider
    from mindstage.geometry.immovable import ImmovableBodies

__all__ = ["GeometryProvider", "with_geometry_notes", "with_immovable_notes"]

_SOURCE_TEXTS = {
    GeometrySource.MESH: "from meshes",
    GeometrySource.ONTOLOGY: "from the shape rules of their classes",
    GeometrySource.CLASS_NAME: "inferred from the names of their classes",
    GeometrySource.MAP: "the primitive shapes of the map",
}


class GeometryProvider:
    """Fits geometry to bodies, and keeps it, also of deleted bodies."""

    def __init__(self, knowledge: KnowledgeBase, *, primitive_shapes: bool, meshes: MeshProvider | None) -> None:
        """Creates a provider without geometry.

        Args:
            knowledge: the source of shape rules for classes.
            primitive_shapes: whether a body without a mesh has its primitive shape; otherwise shape rules are used.
            meshes: the source of meshes.
        """
        self._knowledge = knowledge
        self._primitive_shapes, self._meshes = primitive_shapes, meshes
        self._mesh_names: frozenset[str | None] = frozenset()
        self._geometry: dict[BodyId, BodyGeometry] = {}
        self._immovable: frozenset[BodyId] = frozenset()
        self._uncertain_poses: frozenset[BodyId] = frozenset()
        self._excluded_pairs: frozenset[tuple[BodyId, BodyId]] = frozenset()
        self._cached: tuple[tuple[BodyId, ...], GeometryMap] = ((), NO_GEOMETRY)
        self._lock = Lock()

    def copy(self) -> GeometryProvider:
        """Another provider with the same geometry and sources."""
        copy = self.for_knowledge(self._knowledge)
        with self._lock:
            copy._geometry, copy._immovable, copy._cached = dict(self._geometry), self._immovable, self._cached
            copy._excluded_pairs, copy._uncertain_poses = self._excluded_pairs, self._uncertain_poses
        return copy

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_lock", "_cached")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= {**state, "_lock": Lock(), "_cached": ((), NO_GEOMETRY)}

    def for_knowledge(self, knowledge: KnowledgeBase) -> GeometryProvider:
        """Another provider, without geometry, whose shape rules are those of a knowledge base."""
        other = GeometryProvider(knowledge, primitive_shapes=self._primitive_shapes, meshes=self._meshes)
        other._mesh_names = self._mesh_names
        return other

    def fit(self, world: World, *, geometry: GeometryMap | None = None) -> FittedGeometry:
        """Fits geometry to the bodies of a world, unless it is given.

        Raises:
            ResourceRefusedError: a client of a port names a mesh that is not granted.
        """
        from mindstage.geometry.fit import FitNote, FittedGeometry, fit_geometry

        self.require_granted(world)
        if geometry is not None:
            return FittedGeometry(geometry)
        if not self._primitive_shapes:
            return fit_geometry(world, self._knowledge, meshes=self._meshes)
        if self._meshes is None:
            return FittedGeometry(NO_GEOMETRY)
        found = self._meshes.geometry_for(world.bodies)
        return FittedGeometry(found.geometry, tuple(FitNote((), text) for text in found.notes))

    def require_granted(self, world: World) -> None:
        """Checks the meshes that a world names.

        Raises:
            ResourceRefusedError: a client of a port names a mesh that is not granted.
        """
        names = {body.mesh for body in world.bodies}
        require_granted(names, known=self._mesh_names)
        self._mesh_names |= names

    def find_immovable(self, world: World) -> ImmovableBodies:
        """The dynamic bodies of a world that cannot be loose, by their class or size."""
        from mindstage.geometry.immovable import find_immovable_bodies

        return find_immovable_bodies(world, self._knowledge)

    def find_uncertain_poses(self, world: World) -> frozenset[BodyId]:
        """The bodies whose pose, or the height of the origin of whose mesh, is doubtful by a finding about the map."""
        doubted = {each.individual for each in self._knowledge.findings() if each.property in (HAS_POSE, PIVOT)}
        return frozenset(each.id for each in world.bodies if each.iri in doubted or each.cls in doubted)

    @property
    def immovable(self) -> frozenset[BodyId]:
        """The bodies that were spawned as immovable ones."""
        return self._immovable

    def respawn(self, world: World, *, ground: bool) -> Spawn:
        """The edit that spawns a world as it was spawned before."""
        return Spawn(
            world,
            geometry=self.for_world(world),
            immovable=self._immovable,
            uncertain_poses=self._uncertain_poses,
            excluded_pairs=self._excluded_pairs,
            ground=ground,
        )

    def add(self, edit: Spawn, failed: Iterable[SpawnFailure] = ()) -> None:
        """Keeps the geometry of spawned bodies; a failed body may have the id of one that exists."""
        failed_ids = {failure.id for failure in failed}
        with self._lock:
            self._excluded_pairs |= edit.excluded_pairs
            self._immovable |= edit.immovable - failed_ids
            self._uncertain_poses |= edit.uncertain_poses - failed_ids
            self._geometry |= {id: fitted for id, fitted in edit.geometry.items() if id not in failed_ids}
            self._cached = ((), NO_GEOMETRY)

    def restore(self, geometry: GeometryMap) -> None:
        """Keeps the geometry of restored bodies."""
        with self._lock:
            self._geometry |= geometry
            self._cached = ((), NO_GEOMETRY)

    def for_world(self, world: World) -> GeometryMap:
        """The geometry with which a world was spawned."""
        return {body.id: self._geometry[body.id] for body in world.bodies if body.id in self._geometry}

    def for_ids(self, ids: tuple[BodyId, ...]) -> GeometryMap:
        """The geometry of bodies; the same object for the same tuple."""
        with self._lock:
            cached_ids, geometry = self._cached
            if cached_ids is not ids:
                geometry = MappingProxyType({id: self._geometry[id] for id in ids if id in self._geometry})
                self._cached = (ids, geometry)
            return geometry


def with_geometry_notes(report: SpawnReport, fitted: FittedGeometry, ids: Iterable[BodyId]) -> SpawnReport:
    """Adds notes on the sources of the bodies' geometry to a report."""
    spawned = set(ids) - {failure.id for failure in report.failed_bodies}
    count = Counter(geometry.source for id, geometry in fitted.geometry.items() if id in spawned)
    notes = [SpawnNote(SpawnNoteKind.SHAPE, note.ids, note.text) for note in fitted.notes]
    if count:
        counts = ", ".join(f"{count[source]} {text}" for source, text in _SOURCE_TEXTS.items() if count[source])
        notes.insert(0, SpawnNote(SpawnNoteKind.SHAPE, (), f"geometry: {counts}"))
    return replace(report, notes=(*report.notes, *notes)) if notes else report


def with_immovable_notes(report: SpawnReport, immovable: ImmovableBodies) -> SpawnReport:
    """Adds notes on dynamic bodies that are simulated as static ones to a report."""
    notes = [SpawnNote(SpawnNoteKind.IMMOVABLE, ids, text) for ids, text in immovable.notes]
    return replace(report, notes=(*report.notes, *notes)) if notes else report
