"""Building: from a design and a size to a form, which fits the size exactly.

The same design in the same size is built once. A size that has no room for a shape's parts is no error: the body
becomes a plain box, and the form says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from hashlib import blake2b
from threading import Lock
from typing import Any

import msgspec

from mindstage.errors import ShapeRefused, ShapeUnknown, suggestion
from mindstage.shapes.design import Design
from mindstage.shapes.draft import Draft, Spot, TooSmall
from mindstage.shapes.kinds import DESIGNS
from mindstage.shapes.kinds.plain import Box
from mindstage.shapes.sides import Side, Turn, turn_between
from mindstage.world import IDENTITY, Pose, Vector
from mindstage.world.forms import Form, FormSource, Glow, Place, Skin, Solid, Surface

__all__ = ["build", "design_of"]

_SMALLEST_M = 1e-5
_LARGEST_M = 1e5
_KEPT = 8192
"""Forms that are remembered."""


def design_of(kind: str, parameters: Mapping[str, Any] | None = None) -> Design:
    """A design by its name and its parameters' names.

    Args:
        kind: one of `DESIGNS`.
        parameters: values, or what can be read as one: "0.012" for a length, "+x" for a side.

    Raises:
        ShapeUnknown: there is no such kind.
        ShapeRefused: it has no such parameter, or the parameter cannot be that.
    """
    design = DESIGNS.get(kind)
    if design is None:
        raise ShapeUnknown(kind, known=DESIGNS)
    given = dict(parameters or {})
    if strange := next((name for name in given if name not in design.__struct_fields__), None):
        fields = design.__struct_fields__
        hint = suggestion(strange, fields, none="it has none")
        raise ShapeRefused(kind, reason=f"it has no parameter {strange!r}; {hint}")
    try:
        return msgspec.convert(given, design, strict=False)
    except msgspec.ValidationError as error:
        raise ShapeRefused(kind, reason=str(error)) from error


def build(
    design: Design,
    size: Vector,
    *,
    up: Side = Side.TOP,
    front: Side = Side.FRONT,
    surfaces: Mapping[str, Surface] | None = None,
    glow: Glow | None = None,
    friction: float | None = None,
    restitution: float | None = None,
    density: float | None = None,
    source: FormSource = FormSource.KNOWLEDGE,
    why: str = "",
) -> Form:
    """Makes a form of exactly a size.

    Args:
        design: what it is.
        size: along the body's own axes [m].
        up: the body's side that looks up when it stands as it should.
        front: the side from which one looks at it, reaches in or pulls.
        surfaces: what is known of the design's roles; roles that it does not have are passed over.
        glow: light that it gives; one without a pose goes to where the shape has its bulb.
        friction: of all its solids.
        restitution: of all its solids.
        density: of all its solids [kg/m³].
        source: where the form comes from.
        why: in a line, for reports; what building had to decide is added to it.

    Raises:
        ShapeRefused: the size or a parameter cannot be, or front and up lie on one axis.
    """
    given = tuple(sorted((surfaces or {}).items(), key=lambda item: item[0]))
    numbers = (friction, restitution, density)
    kept = (float(size[0]), float(size[1]), float(size[2]))
    form = _built(design, kept, up, front, given, glow, numbers)
    words = "; ".join(part for part in (why, form.why) if part)
    return Form.deferred(
        lambda: (form.key, form.skins),
        solids=form.solids,
        source=source,
        why=words,
        kind=form.kind,
        friction=friction,
        restitution=restitution,
        density=density,
        places=form.places,
        glows=form.glows,
    )


@lru_cache(maxsize=_KEPT)
def _built(
    design: Design,
    size: Vector,
    up: Side,
    front: Side,
    surfaces: tuple[tuple[str, Surface], ...],
    glow: Glow | None,
    numbers: tuple[float | None, ...],
) -> Form:
    _check(design, size)
    turn = turn_between(front, up)
    made, draft = _drafted(design, size, turn)
    solids = tuple(solid for part in draft.touchables if (solid := part.solid(turn)) is not None)
    places = tuple(_place(spot, turn) for spot in draft.spots)
    glows = () if glow is None else (_lit(glow, draft, turn),)
    drawing = _Drawing(made, draft, dict(surfaces), (made.kind(), solids, places, glows, numbers))
    return Form.deferred(
        drawing.result,
        solids=solids,
        kind=made.kind(),
        why="; ".join(draft.notes),
        places=places,
        glows=glows,
    )


class _Drawing:
    """The key and the skins of a form, which are computed once, from what was drafted, when they are first read."""

    def __init__(
        self,
        design: Design,
        draft: Draft,
        surfaces: Mapping[str, Surface],
        said: tuple[str, tuple[Solid, ...], tuple[Place, ...], tuple[Glow, ...], tuple[float | None, ...]],
    ) -> None:
        self._drafted: tuple[Design, Draft] | None = (design, draft)
        self._surfaces, self._said = surfaces, said
        self._result: tuple[str, tuple[Skin, ...]] = ("", ())
        self._lock = Lock()

    def result(self) -> tuple[str, tuple[Skin, ...]]:
        """The same objects for each caller."""
        with self._lock:
            if self._drafted is not None:
                design, draft = self._drafted
                skins = tuple(
                    Skin(
                        points=draft.turn.points(mesh.points),
                        faces=mesh.faces,
                        normals=None if mesh.normals is None else draft.turn.points(mesh.normals),
                        surface=design.surface(role, self._surfaces),
                    )
                    for (role, _), mesh in draft.meshes().items()
                )
                self._result = (_digest(skins, self._said), skins)
                self._drafted = None
            return self._result


def _drafted(design: Design, size: Vector, turn: Turn) -> tuple[Design, Draft]:
    """What was drawn, and as what: the design, or a box where that has no room."""
    draft = Draft(turn.drawn_size(size), turn)
    try:
        design.draw(draft)
        if draft.is_empty:
            raise TooSmall("nothing is left of it")
    except TooSmall as reason:
        draft = Draft(turn.drawn_size(size), turn)
        draft.note(f"{reason}, so a plain box")
        design = Box()
        design.draw(draft)
    draft.fit()
    return design, draft


def _check(design: Design, size: Vector) -> None:
    kind = design.kind()
    if not all(_SMALLEST_M <= extent <= _LARGEST_M for extent in size):
        told = " x ".join(f"{extent:g}" for extent in size)
        raise ShapeRefused(kind, reason=f"its size is {told} m; each extent has to be from {_SMALLEST_M:g} m on")
    design_of(kind, msgspec.structs.asdict(design))


def _place(spot: Spot, turn: Turn) -> Place:
    low, high = spot.low, spot.high
    x, y = ((low + high) / 2).tolist()
    extents = turn.size((float(high[0] - low[0]), float(high[1] - low[1]), 0.0))
    up = turn.vector((0.0, 0.0, 1.0))
    across, along = (extent for extent, share in zip(extents, up, strict=True) if share == 0.0)
    return Place(
        centre=turn.vector((x, y, spot.level)),
        size=(across, along),
        height=spot.height,
        inside=spot.inside,
        up=up,
    )


def _lit(glow: Glow, draft: Draft, turn: Turn) -> Glow:
    if glow.pose != IDENTITY or draft.light is None:
        return glow
    x, y, z = draft.light.tolist()
    return msgspec.structs.replace(glow, pose=Pose(turn.vector((x, y, z))))


def _digest(skins: tuple[Skin, ...], said: tuple[Any, ...]) -> str:
    digest = blake2b(msgspec.msgpack.encode(said), digest_size=16)
    for skin in skins:
        digest.update(msgspec.msgpack.encode((skin.surface, skin.points.shape, skin.faces.shape)))
        digest.update((skin.points + 0.0).tobytes())  # -0.0 and 0.0 are one place
        digest.update(skin.faces.tobytes())
        if skin.normals is not None:
            digest.update((skin.normals + 0.0).tobytes())
    return digest.hexdigest()
