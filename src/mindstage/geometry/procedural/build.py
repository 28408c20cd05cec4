"""Builds geometry from a shape template and a size, which it fits exactly.

Results are cached by template and size, visual meshes also on the disk, for later runs. A size that is too small for
the parts of a shape is no error: the result is a plain box, and its `reason` states why.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache, lru_cache
from hashlib import blake2b
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, Self

import msgspec

from mindstage.errors import InvalidShapeError, ShapeNotFoundError, suggestion
from mindstage.files import cache_dir, cached_content
from mindstage.geometry.procedural import SHAPE_TEMPLATES
from mindstage.geometry.procedural.builder import (
    AxisPermutation,
    BodySide,
    GeometryBuilder,
    LocalSupportSurface,
    ShapeTemplate,
    TemplateFitError,
    turn_between,
)
from mindstage.geometry.procedural.primitives import BoxShape
from mindstage.ranges import NotNegative, Size, checked
from mindstage.scene import IDENTITY, LightType, Pose, Vector
from mindstage.scene import mesh as mesh_module
from mindstage.scene.geometry import (
    AttachedLight,
    BodyGeometry,
    CollisionShape,
    GeometrySource,
    PbrMaterial,
    SupportSurface,
    VisualMesh,
)
from mindstage.textures.baking import content_version
from mindstage.textures.catalog import TextureInfo, texture_info

if TYPE_CHECKING:
    from numpy import generic
    from numpy.typing import NDArray

__all__ = ["build_geometry", "template_by_name"]

_MIN_SIZE_M = 1e-5
_MAX_SIZE_M = 1e5
_CACHE_SIZE = 8192
"""Number of cached geometries."""
_MAX_STORED_BYTES = 256 << 20
"""Total size of the visual meshes on the disk."""


def template_by_name(shape_name: str, parameters: Mapping[str, Any] | None = None) -> ShapeTemplate:
    """Returns a shape template with parameters.

    Args:
        shape_name: a key of `SHAPE_TEMPLATES`.
        parameters: values by field name, or text to parse: "0.012" for a length, "+x" for a side.

    Raises:
        ShapeNotFoundError: no shape has this name.
        InvalidShapeError: the shape has no such parameter, or its value is invalid.
    """
    template = SHAPE_TEMPLATES.get(shape_name)
    if template is None:
        raise ShapeNotFoundError(shape_name, known=SHAPE_TEMPLATES)
    given = dict(parameters or {})
    fields = template.__struct_fields__
    if unknown := next((name for name in given if name not in fields), None):
        hint = suggestion(unknown, fields, none="it has none")
        raise InvalidShapeError(shape_name, reason=f"it has no parameter {unknown!r}; {hint}")
    try:
        return msgspec.convert(given, template, strict=False)
    except msgspec.ValidationError as error:
        raise InvalidShapeError(shape_name, reason=str(error)) from error


@checked
def build_geometry(
    template: ShapeTemplate,
    size: Size,
    *,
    up: BodySide = BodySide.TOP,
    front: BodySide = BodySide.FRONT,
    materials: Mapping[str, PbrMaterial] | None = None,
    light: AttachedLight | None = None,
    friction: NotNegative | None = None,
    restitution: NotNegative | None = None,
    density: NotNegative | None = None,
    source: GeometrySource = GeometrySource.ONTOLOGY,
    reason: str = "",
) -> BodyGeometry:
    """Returns geometry that fits a size exactly.

    Args:
        size: extents along the axes of the body [m].
        up: the side of the body that faces up in normal use.
        front: the side from which the body is viewed, opened or pulled.
        materials: materials by role; roles that the template does not have are ignored.
        light: an attached light; without a pose it is placed at the bulb of the shape and turned with the shape.
        friction: coefficient of sliding friction of all collision shapes.
        restitution: coefficient of restitution of all collision shapes.
        density: density of all collision shapes [kg/m³].
        source: where the shape comes from.
        reason: one line for reports; remarks of the template are appended.

    Raises:
        InvalidShapeError: the size or a parameter is invalid, or front and up are on the same axis.
    """
    material_items = tuple(sorted((materials or {}).items(), key=lambda item: item[0]))
    contact = (friction, restitution, density)
    extents = (float(size[0]), float(size[1]), float(size[2]))
    arguments = template, extents, up, front, material_items, light, contact
    geometry = _build_cached(*arguments)
    return BodyGeometry.deferred(
        _CachedVisuals(arguments, geometry),
        collision_shapes=geometry.collision_shapes,
        source=source,
        reason="; ".join(part for part in (reason, geometry.reason) if part),
        shape_name=geometry.shape_name,
        friction=friction,
        restitution=restitution,
        density=density,
        support_surfaces=geometry.support_surfaces,
        lights=geometry.lights,
    )


class _CachedVisuals:
    """Returns the key and the visual meshes of a geometry; pickled as the arguments from which it was built."""

    def __init__(self, arguments: tuple[Any, ...], geometry: BodyGeometry | None = None) -> None:
        self._arguments = arguments
        self._geometry = geometry

    def __call__(self) -> tuple[str, tuple[VisualMesh, ...]]:
        self._geometry = self._geometry or _build_cached(*self._arguments)
        return self._geometry.key, self._geometry.visuals

    def __reduce__(self) -> tuple[type[_CachedVisuals], tuple[tuple[Any, ...]]]:
        return _CachedVisuals, (self._arguments,)


@lru_cache(maxsize=_CACHE_SIZE)
def _build_cached(
    template: ShapeTemplate,
    size: Vector,
    up: BodySide,
    front: BodySide,
    materials: tuple[tuple[str, PbrMaterial], ...],
    light: AttachedLight | None,
    contact: tuple[float | None, ...],
) -> BodyGeometry:
    _check(template, size)
    turn = turn_between(front, up)
    built, builder = _build_or_box(template, size, turn)
    shapes = tuple(shape for part in builder.collision_parts if (shape := part.to_collision_shape(turn)) is not None)
    surfaces = tuple(_support_surface(surface, turn) for surface in builder.support_surfaces)
    lights = () if light is None else (_placed_light(light, builder, turn),)
    others = built.shape_name(), shapes, surfaces, lights, contact
    deferred = _DeferredVisuals(built, builder, dict(materials), others, (template, size, up, front, materials))
    return BodyGeometry.deferred(
        deferred.result,
        collision_shapes=shapes,
        shape_name=built.shape_name(),
        reason="; ".join(builder.notes),
        support_surfaces=surfaces,
        lights=lights,
    )


class _DeferredVisuals:
    """Computes the key and the visual meshes of a geometry from its builder, once, on first access."""

    def __init__(
        self,
        template: ShapeTemplate,
        builder: GeometryBuilder,
        materials: Mapping[str, PbrMaterial],
        other_fields: tuple[
            str,
            tuple[CollisionShape, ...],
            tuple[SupportSurface, ...],
            tuple[AttachedLight, ...],
            tuple[float | None, ...],
        ],
        arguments: tuple[ShapeTemplate, Vector, BodySide, BodySide, tuple[tuple[str, PbrMaterial], ...]],
    ) -> None:
        self._pending: tuple[ShapeTemplate, GeometryBuilder] | None = (template, builder)
        self._materials, self._other_fields, self._arguments = materials, other_fields, arguments
        self._result: tuple[str, tuple[VisualMesh, ...]] = ("", ())
        self._lock = Lock()

    def result(self) -> tuple[str, tuple[VisualMesh, ...]]:
        """Returns the key and the visual meshes: the same objects for each call and thread."""
        with self._lock:
            if self._pending is not None:
                path = cache_dir("shapes") / f"{self._stored_name()}.meshes"
                content = cached_content(path, self._compute, max_bytes=_MAX_STORED_BYTES)
                # After a computation too, so that the arrays are the same, and read-only, whether stored or not.
                try:
                    self._result = _read_visuals(content)
                except (msgspec.DecodeError, ValueError):  # the file is damaged
                    path.unlink(missing_ok=True)
                    self._result = _read_visuals(self._compute())
                self._pending = None
            return self._result

    def _compute(self) -> bytes:
        assert self._pending is not None
        template, builder = self._pending
        visuals = tuple(_visuals(template, builder, self._materials))
        stored = _StoredVisuals(_digest(visuals, self._other_fields), tuple(map(_StoredVisual.of, visuals)))
        return msgspec.msgpack.encode(stored)

    def _stored_name(self) -> str:
        """A hash of all that the meshes depend on."""
        template, *others = self._arguments
        digest = blake2b(_code_version(), digest_size=20)
        digest.update(msgspec.msgpack.encode((template.shape_name(), template, others, self._other_fields)))
        return digest.hexdigest()


@cache
def _code_version() -> bytes:
    """A hash of the code that computes visual meshes."""
    digest = blake2b(content_version().encode())
    for path in (*sorted(Path(__file__).parent.glob("*.py")), Path(mesh_module.__file__)):
        digest.update(path.read_bytes())
    return digest.digest()


class _StoredArray(msgspec.Struct, frozen=True, array_like=True):
    type: str
    shape: tuple[int, ...]
    data: bytes

    @classmethod
    def of(cls, array: NDArray[Any] | None) -> Self | None:
        """An array as bytes."""
        return None if array is None else cls(array.dtype.str, array.shape, array.tobytes())

    def array(self) -> NDArray[Any]:
        """The array, which is read-only."""
        import numpy as np

        found: NDArray[generic] = np.frombuffer(self.data, dtype=self.type).reshape(self.shape)
        return found


class _StoredVisual(msgspec.Struct, frozen=True, array_like=True):
    material: PbrMaterial
    arrays: tuple[_StoredArray | None, ...]
    """Points, faces, normals, texture coordinates and image."""

    @classmethod
    def of(cls, visual: VisualMesh) -> Self:
        """A mesh as bytes."""
        arrays = visual.points, visual.faces, visual.normals, visual.uv, visual.image
        return cls(visual.material, tuple(map(_StoredArray.of, arrays)))


class _StoredVisuals(msgspec.Struct, frozen=True, array_like=True):
    key: str
    visuals: tuple[_StoredVisual, ...]


def _read_visuals(content: bytes) -> tuple[str, tuple[VisualMesh, ...]]:
    """The key and the visual meshes in a file.

    Raises:
        msgspec.DecodeError: it is damaged.
        ValueError: the size of an array is wrong.
    """
    stored = msgspec.msgpack.decode(content, type=_StoredVisuals)
    meshes = []
    for visual in stored.visuals:
        arrays = [None if each is None else each.array() for each in visual.arrays]
        points, faces, normals, uv, image = arrays
        if points is None or faces is None:
            raise ValueError("a mesh without points or faces")
        meshes.append(VisualMesh(points, faces, visual.material, normals, uv, image))
    return stored.key, tuple(meshes)


def _visuals(
    template: ShapeTemplate, builder: GeometryBuilder, materials: Mapping[str, PbrMaterial]
) -> Iterator[VisualMesh]:
    """Yields the visual meshes in the body frame, with texture coordinates where the material has a texture."""

    def texture_of(role: str) -> TextureInfo | None:
        name = template.material_of(role, materials).texture
        return texture_info(name) if name else None

    for (role, _), mesh in builder.merged_meshes(texture_of).items():
        yield VisualMesh(
            points=builder.turn.to_body(mesh.points),
            faces=mesh.faces,
            normals=None if mesh.normals is None else builder.turn.to_body(mesh.normals),
            material=template.material_of(role, materials),
            uv=mesh.uv,
        )
    for role, mesh, picture in builder.printed_meshes():
        material = template.material_of(role, materials)
        yield VisualMesh(
            points=builder.turn.to_body(mesh.points),
            faces=mesh.faces,
            normals=None if mesh.normals is None else builder.turn.to_body(mesh.normals),
            material=msgspec.structs.replace(material, color=(1.0, 1.0, 1.0), texture="", opacity=1.0, metalness=0.0),
            uv=mesh.uv,
            image=picture(material.color),
        )


def _build_or_box(
    template: ShapeTemplate, size: Vector, turn: AxisPermutation
) -> tuple[ShapeTemplate, GeometryBuilder]:
    """Returns the template that was built, or a box if the size is too small for it, and its builder."""
    builder = GeometryBuilder(turn.template_size(size), turn)
    try:
        template.build(builder)
        if builder.is_empty:
            raise TemplateFitError("it has no parts")
    except TemplateFitError as reason:
        builder = GeometryBuilder(turn.template_size(size), turn)
        builder.add_note(f"{reason}, so a plain box")
        template = BoxShape()
        template.build(builder)
    builder.fit_to_size()
    return template, builder


def _check(template: ShapeTemplate, size: Vector) -> None:
    shape_name = template.shape_name()
    if not all(_MIN_SIZE_M <= extent <= _MAX_SIZE_M for extent in size):
        extents = " x ".join(f"{extent:g}" for extent in size)
        raise InvalidShapeError(
            shape_name, reason=f"its size is {extents} m; extents are {_MIN_SIZE_M:g} to {_MAX_SIZE_M:g} m"
        )
    template_by_name(shape_name, msgspec.structs.asdict(template))


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
    if light.pose != IDENTITY:
        return light
    x, y, z = (0.0, 0.0, 0.0) if builder.light is None else builder.light.tolist()
    # A spot or directional light shines downwards while the shape is upright, so it is turned with the shape.
    quaternion = IDENTITY.quaternion if light.type is LightType.POINT else turn.quaternion
    return msgspec.structs.replace(light, pose=Pose(turn.vector_to_body((x, y, z)), quaternion))


def _digest(visuals: tuple[VisualMesh, ...], other_fields: tuple[Any, ...]) -> str:
    digest = blake2b(msgspec.msgpack.encode(other_fields), digest_size=16)
    for visual in visuals:
        digest.update(msgspec.msgpack.encode((visual.material, visual.points.shape, visual.faces.shape)))
        digest.update((visual.points + 0.0).tobytes())  # -0.0 and 0.0 are equal
        digest.update(visual.faces.tobytes())
        for rows in (visual.normals, visual.uv):
            if rows is not None:
                digest.update((rows + 0.0).tobytes())
        if visual.image is not None:
            digest.update(visual.image.tobytes())
    return digest.hexdigest()
