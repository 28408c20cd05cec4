"""What fitting takes and gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from mindstage.knowledge.shaping import ShapeRule
from mindstage.world import Body, BodyGeometry, BodyId, GeometryMap, Iri

__all__ = ["FitNote", "FittedGeometry", "MeshGeometries", "MeshProvider", "ShapeRuleProvider"]


class FitNote(NamedTuple):
    """Something that had to be decided, or could not be done as told."""

    ids: tuple[BodyId, ...]
    text: str


@dataclass(frozen=True, slots=True)
class FittedGeometry:
    """The forms of a world's bodies."""

    geometry: GeometryMap
    """Of all bodies that have a size."""
    notes: tuple[FitNote, ...] = ()


class ShapeRuleProvider(Protocol):
    """Who knows how things of a class are shaped; a `KnowledgeBase` does."""

    def shape_rule(self, cls: Iri, /) -> ShapeRule:
        """How things of a class are shaped."""


class MeshGeometries(Protocol):
    """What was found in mesh files."""

    @property
    def geometry(self) -> Mapping[BodyId, BodyGeometry]:
        """Of the bodies that have one."""

    @property
    def notes(self) -> Sequence[str]:
        """What had to be decided, and which files are of no use."""


class MeshProvider(Protocol):
    """Who finds the meshes that maps name."""

    def geometry_for(self, bodies: Sequence[Body], /) -> MeshGeometries:
        """The forms of those bodies for which there are mesh files."""
