"""Designs: the kinds of shape, each a class whose fields are its parameters and whose `draw` makes it.

Lengths are meters and wishes: a wall of 15 mm is thinner where a fifth of the size is less. Names of fields are those
that an ontology uses (`ms:wall 0.012`).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, ClassVar

import msgspec

from mindstage.shapes import finishes
from mindstage.shapes.draft import GeometryBuilder
from mindstage.world.forms import PbrMaterial
from mindstage.world.values import FrozenStruct

__all__ = ["Count", "Fraction", "Length", "MaterialRoles", "PositiveFraction", "ShapeTemplate", "Thickness"]

Length = Annotated[float, msgspec.Meta(ge=0.0, le=1000.0)]
"""[m]."""
Thickness = Annotated[float, msgspec.Meta(ge=1e-4, le=1000.0)]
"""[m]; of what cannot be left out."""
Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
PositiveFraction = Annotated[float, msgspec.Meta(ge=0.05, le=1.0)]
"""A share of what cannot be left out."""
Count = Annotated[int, msgspec.Meta(ge=0, le=64)]

MaterialRoles = Mapping[str, PbrMaterial | str]
"""The surfaces that a shape has: each with what it is unless somebody says, or the role whose surface it shares."""


class ShapeTemplate(FrozenStruct, frozen=True, kw_only=True):
    """What all kinds of shape are."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.PLAIN})

    name: ClassVar[str] = ""
    """The name of the shape in ontologies (`ms:shapedAs`); by default the class's name in lower case."""

    @classmethod
    def shape_name(cls) -> str:
        """The name of the shape in ontologies."""
        return cls.name or cls.__name__.lower()

    def build(self, builder: GeometryBuilder) -> None:
        """Draws the shape in the draft's size; raises `TemplateDoesNotFit` where that leaves no room for it."""
        self._build(builder)

    def _build(self, builder: GeometryBuilder) -> None:
        raise NotImplementedError(f"{type(self).__name__} has to say how it is drawn")

    def material_of(self, role: str, materials: Mapping[str, PbrMaterial]) -> PbrMaterial:
        """What a role's surface is, by what was given."""
        while role not in materials:
            told = self.roles[role]
            if isinstance(told, PbrMaterial):
                return told
            role = told
        return materials[role]
