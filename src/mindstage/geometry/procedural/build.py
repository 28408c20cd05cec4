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

from mindstage.errors import InvalidShapeError, ShapeNotFoundError, suggestion
from mindstage.geometry.procedural import SHAPE_TEMPLATES
from mindstage.geometry.procedural.builder import (
    AxisPermutation,
    BodySide,
    GeometryBuilder,
    LocalSupportSurface,
    ShapeTemplate,
    TemplateDoesNotFit,
    turn_between,
)
from mindstage.geometry.procedural.primitives import BoxShape
from mindstage.scene import IDENTITY, Pose, Vector
from mindstage.scene.geometry import (
    AttachedLight,
    BodyGeometry,
    CollisionShape,
    GeometrySource,
    PbrMaterial,
    SupportSurface,
    VisualMesh,
)

__all__ = ["build_geometry", "template_by_name"]

_MIN_SIZE_M = 1e-5
_MAX_SIZE_M = 1e5
_CACHE_SIZE = 8192
"""Forms that are remembered."""


def template_by_name(shape_name: str, parameters: Mapping[str, Any] | None = None) -> ShapeTemplate:
    """A design by its name and its parameters' names.

    Args:
        kind: one of `SHAPE_TEMPLATES`.
        parameters: values, or what can be read as one: "0.012" for a length, "+x" for a side.

    Raises:
        ShapeNotFoundError: there is no such kind.
        InvalidShapeError: it has no such parameter, or the parameter cannot be that.
    """
    design = SHAPE_TEMPLATES.get(shape_name)
    if design is None:
        raise ShapeNotFoundError(shape_name, known=SHAPE_TEMPLATES)
    given = dict(parameters or {})
    if strange := next((name for name in given if name not in design.__struct_fields__), None):
        fields = design.__struct_fields__
        hint = suggestion(strange, fields, none="it has none")
        raise InvalidShapeError(shape_name, reason=f"it has no parameter {strange!r}; {hint}")
    try:
        return msgspec.convert(given, design, strict=False)
    except msgspec.ValidationError as error:
        raise InvalidShapeError(shape_name, reason=str(error)) from error


def build_geometry(
    template: ShapeTemplate,
    size: Vector,
    *,
    up: BodySide = BodySide.TOP,
    front: BodySide = BodySide.FRONT,
    materials: Mapping[str, PbrMaterial] | None = None,
    light: AttachedLight | None = None,
    friction: float | None = None,
    restitution: float | None = None,
    density: float | None = None,
    source: GeometrySource = GeometrySource.ONTOLOGY,
    reason: str = "",
) -> BodyGeometry:
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
        InvalidShapeError: the size or a parameter cannot be, or front and up lie on one axis.
    """
    given = tuple(sorted((materials or {}).items(), key=lambda item: item[0]))
    numbers = (friction, restitution, density)
    kept = (float(size[0]), float(size[1]), float(size[2]))
    form = _build_cached(template, kept, up, front, given, light, numbers)
    words = "; ".join(part for part in (reason, form.reason) if part)
    return BodyGeometry.deferred(
        lambda: (form.key, form.visuals),
        collision_shapes=form.collision_shapes,
        source=source,
        reason=words,
        shape_name=form.shape_name,
        friction=friction,
        restitution=restitution,
        density=density,
        support_surfaces=form.support_surfaces,
        lights=form.lights,
    )


@lru_cache(maxsize=_CACHE_SIZE)
def _build_cached(
    template: ShapeTemplate,
    size: Vector,
    up: BodySide,
    front: BodySide,
    materials: tuple[tuple[str, PbrMaterial], ...],
    light: AttachedLight | None,
    numbers: tuple[float | None, ...],
) -> BodyGeometry:
    _check(template, size)
    turn = turn_between(front, up)
    made, draft = _build_or_box(template, size, turn)
    solids = tuple(solid for part in draft.collision_parts if (solid := part.to_collision_shape(turn)) is not None)
    places = tuple(_support_surface(spot, turn) for spot in draft.support_surfaces)
    glows = () if light is None else (_placed_light(light, draft, turn),)
    drawing = _Drawing(made, draft, dict(materials), (made.shape_name(), solids, places, glows, numbers))
    return BodyGeometry.deferred(
        drawing.result,
        collision_shapes=solids,
        shape_name=made.shape_name(),
        reason="; ".join(draft.notes),
        support_surfaces=places,
        lights=glows,
    )


class _Drawing:
    """The key and the skins of a form, which are computed once, from what was drafted, when they are first read."""

    def __init__(
        self,
        design: ShapeTemplate,
        draft: GeometryBuilder,
        surfaces: Mapping[str, PbrMaterial],
        said: tuple[
            str,
            tuple[CollisionShape, ...],
            tuple[SupportSurface, ...],
            tuple[AttachedLight, ...],
            tuple[float | None, ...],
        ],
    ) -> None:
        self._drafted: tuple[ShapeTemplate, GeometryBuilder] | None = (design, draft)
        self._surfaces, self._said = surfaces, said
        self._result: tuple[str, tuple[VisualMesh, ...]] = ("", ())
        self._lock = Lock()

    def result(self) -> tuple[str, tuple[VisualMesh, ...]]:
        """The same objects for each caller."""
        with self._lock:
            if self._drafted is not None:
                design, draft = self._drafted
                skins = tuple(
                    VisualMesh(
                        points=draft.turn.to_body(mesh.points),
                        faces=mesh.faces,
                        normals=None if mesh.normals is None else draft.turn.to_body(mesh.normals),
                        material=design.material_of(role, self._surfaces),
                    )
                    for (role, _), mesh in draft.merged_meshes().items()
                )
                self._result = (_digest(skins, self._said), skins)
                self._drafted = None
            return self._result


def _build_or_box(
    template: ShapeTemplate, size: Vector, turn: AxisPermutation
) -> tuple[ShapeTemplate, GeometryBuilder]:
    """What was drawn, and as what: the design, or a box where that has no room."""
    draft = GeometryBuilder(turn.template_size(size), turn)
    try:
        template.build(draft)
        if draft.is_empty:
            raise TemplateDoesNotFit("nothing is left of it")
    except TemplateDoesNotFit as reason:
        draft = GeometryBuilder(turn.template_size(size), turn)
        draft.add_note(f"{reason}, so a plain box")
        template = BoxShape()
        template.build(draft)
    draft.fit_to_size()
    return template, draft


def _check(template: ShapeTemplate, size: Vector) -> None:
    kind = template.shape_name()
    if not all(_MIN_SIZE_M <= extent <= _MAX_SIZE_M for extent in size):
        told = " x ".join(f"{extent:g}" for extent in size)
        raise InvalidShapeError(kind, reason=f"its size is {told} m; each extent has to be from {_MIN_SIZE_M:g} m on")
    template_by_name(kind, msgspec.structs.asdict(template))


def _support_surface(surface: LocalSupportSurface, turn: AxisPermutation) -> SupportSurface:
    low, high = surface.low, surface.high
    x, y = ((low + high) / 2).tolist()
    extents = turn.body_size((float(high[0] - low[0]), float(high[1] - low[1]), 0.0))
    up = turn.vector_to_body((0.0, 0.0, 1.0))
    across, along = (extent for extent, share in zip(extents, up, strict=True) if share == 0.0)
    return SupportSurface(
        center=turn.vector_to_body((x, y, surface.level)),
        size=(across, along),
        clearance=surface.clearance,
        is_inside=surface.is_inside,
        normal=up,
    )


def _placed_light(light: AttachedLight, builder: GeometryBuilder, turn: AxisPermutation) -> AttachedLight:
    if light.pose != IDENTITY or builder.light is None:
        return light
    x, y, z = builder.light.tolist()
    return msgspec.structs.replace(light, pose=Pose(turn.vector_to_body((x, y, z))))


def _digest(skins: tuple[VisualMesh, ...], said: tuple[Any, ...]) -> str:
    digest = blake2b(msgspec.msgpack.encode(said), digest_size=16)
    for skin in skins:
        digest.update(msgspec.msgpack.encode((skin.material, skin.points.shape, skin.faces.shape)))
        digest.update((skin.points + 0.0).tobytes())  # -0.0 and 0.0 are one place
        digest.update(skin.faces.tobytes())
        if skin.normals is not None:
            digest.update((skin.normals + 0.0).tobytes())
    return digest.hexdigest()
