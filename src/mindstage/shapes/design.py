"""Designs: the kinds of shape, each a class whose fields are its parameters and whose `draw` makes it.

Lengths are metres and wishes: a wall of 15 mm is thinner where a fifth of the size is less. Names of fields are those
that an ontology uses (`ms:wall 0.012`).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, ClassVar

import msgspec

from mindstage.shapes import finishes
from mindstage.shapes.draft import Draft
from mindstage.world.forms import Surface
from mindstage.world.values import Value

__all__ = ["Count", "Design", "Length", "Part", "Roles", "Share", "Thickness"]

Length = Annotated[float, msgspec.Meta(ge=0.0, le=1000.0)]
"""[m]."""
Thickness = Annotated[float, msgspec.Meta(ge=1e-4, le=1000.0)]
"""[m]; of what cannot be left out."""
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Part = Annotated[float, msgspec.Meta(ge=0.05, le=1.0)]
"""A share of what cannot be left out."""
Count = Annotated[int, msgspec.Meta(ge=0, le=64)]

Roles = Mapping[str, Surface | str]
"""The surfaces that a shape has: each with what it is unless somebody says, or the role whose surface it shares."""


class Design(Value, frozen=True, kw_only=True):
    """What all kinds of shape are."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.PLAIN})

    @classmethod
    def kind(cls) -> str:
        """The name of the shape."""
        return cls.__name__.lower()

    def draw(self, draft: Draft) -> None:
        """Draws the shape in the draft's size; raises `TooSmall` where that leaves no room for it."""
        self._draw(draft)

    def _draw(self, draft: Draft) -> None:
        raise NotImplementedError(f"{type(self).__name__} has to say how it is drawn")

    def surface(self, role: str, given: Mapping[str, Surface]) -> Surface:
        """What a role's surface is, by what was given."""
        while role not in given:
            told = self.roles[role]
            if isinstance(told, Surface):
                return told
            role = told
        return given[role]
