"""Shape rules: what is known of the form of a class's things, as plain values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mindstage.world import Colour, FormSource, Iri, LightKind, Surface, Vector

__all__ = ["BODY", "PLAIN", "Lighting", "Parameter", "ShapeRule", "Substance"]

Parameter = bool | int | float | str

BODY = "body"
"""The role of whatever has no other: the material of the thing as a whole."""

PLAIN = "box"
"""The kind of what nobody knows better."""


@dataclass(frozen=True, slots=True)
class Substance:
    """What a part of a thing is made of."""

    surface: Surface
    density: float | None = None
    """[kg/m3]."""
    friction: float | None = None
    """Sliding, against something alike."""
    restitution: float | None = None


@dataclass(frozen=True, slots=True)
class Lighting:
    """The light that a thing gives."""

    kind: LightKind
    colour: Colour = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    """[cd], or [lx] of a directional one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeRule:
    """What is known of the form of a class's things."""

    cls: Iri
    kind: str = PLAIN
    """The name of a form: "drawer", say."""
    source: FormSource = FormSource.MAP
    why: str = ""
    """Who says so, in one line."""
    parameters: Mapping[str, Parameter]
    """As the form names them: `shelf_count`. A form need not have all of them."""
    substances: Mapping[str, Substance]
    """By role; that of `BODY` is always there."""
    light: Lighting | None = None
    size: Vector | None = None
    """Of a typical one: depth, width, height [m]."""
    doubts: tuple[str, ...] = ()
    """What was told and could not be taken as told."""

    @property
    def substance(self) -> Substance:
        """Of the thing as a whole."""
        return self.substances[BODY]
