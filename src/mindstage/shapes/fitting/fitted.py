"""What fitting takes and gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from mindstage.knowledge.shaping import ShapeRule
from mindstage.world import Body, BodyId, Form, Forms, Iri

__all__ = ["Fitted", "Knowing", "MeshForms", "MeshSource", "Remark"]


class Remark(NamedTuple):
    """Something that had to be decided, or could not be done as told."""

    ids: tuple[BodyId, ...]
    text: str


@dataclass(frozen=True, slots=True)
class Fitted:
    """The forms of a world's bodies."""

    forms: Forms
    """Of all bodies that have a size."""
    notes: tuple[Remark, ...] = ()


class Knowing(Protocol):
    """Who knows how things of a class are shaped; a `KnowledgeBase` does."""

    def shape_rule(self, cls: Iri, /) -> ShapeRule:
        """How things of a class are shaped."""


class MeshForms(Protocol):
    """What was found in mesh files."""

    @property
    def forms(self) -> Mapping[BodyId, Form]:
        """Of the bodies that have one."""

    @property
    def notes(self) -> Sequence[str]:
        """What had to be decided, and which files are of no use."""


class MeshSource(Protocol):
    """Who finds the meshes that maps name."""

    def forms(self, bodies: Sequence[Body], /) -> MeshForms:
        """The forms of those bodies for which there are mesh files."""
