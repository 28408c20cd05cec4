"""Shape rules: what is known of the form of a class's things, as plain values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mindstage.world import Color, GeometrySource, Iri, LightType, PbrMaterial, Vector

__all__ = ["DEFAULT_ROLE", "DEFAULT_SHAPE", "LightRule", "PartMaterial", "ShapeParameter", "ShapeRule"]

ShapeParameter = bool | int | float | str

DEFAULT_ROLE = "body"
"""The role of whatever has no other: the material of the thing as a whole."""

DEFAULT_SHAPE = "box"
"""The kind of what nobody knows better."""


@dataclass(frozen=True, slots=True)
class PartMaterial:
    """What a part of a thing is made of."""

    pbr_material: PbrMaterial
    density: float | None = None
    """[kg/m3]."""
    friction: float | None = None
    """Sliding, against something alike."""
    restitution: float | None = None


@dataclass(frozen=True, slots=True)
class LightRule:
    """The light that a thing gives."""

    light_type: LightType
    color: Color = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    """[cd], or [lx] of a directional one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeRule:
    """What is known of the form of a class's things."""

    cls: Iri
    shape_type: str = DEFAULT_SHAPE
    """The name of a form: "drawer", say."""
    source: GeometrySource = GeometrySource.MAP
    reason: str = ""
    """Who says so, in one line."""
    parameters: Mapping[str, ShapeParameter]
    """As the form names them: `shelf_count`. A form need not have all of them."""
    materials: Mapping[str, PartMaterial]
    """By role; that of `DEFAULT_ROLE` is always there."""
    light: LightRule | None = None
    size: Vector | None = None
    """Of a typical one: depth, width, height [m]."""
    issues: tuple[str, ...] = ()
    """What was told and could not be taken as told."""

    @property
    def default_material(self) -> PartMaterial:
        """Of the thing as a whole."""
        return self.materials[DEFAULT_ROLE]
