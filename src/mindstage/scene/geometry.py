"""Geometry of bodies: visual meshes, collision shapes, support surfaces and lights.

The size of a drawer is part of the map; that it is open at the top is part of its geometry. Geometry is computed when a
world is spawned (from mesh files, otherwise from the shape rules of classes) and is not part of `World`: it is neither
logged nor written back. All lengths are in meters in the body frame, whose origin is the center of the body's size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

from mindstage.scene.world_model import IDENTITY, BodyId, Color, FrozenStruct, LightType, Pose, PosedStruct, Vector

if TYPE_CHECKING:  # NumPy is not needed to refer to geometry
    from numpy import uint8, uint32
    from numpy.typing import NDArray

    from mindstage.scene.transforms import Array

__all__ = [
    "NO_GEOMETRY",
    "AttachedLight",
    "BodyGeometry",
    "CollisionShape",
    "CollisionShapeType",
    "GeometryMap",
    "GeometrySource",
    "Inertia",
    "PbrMaterial",
    "SupportSurface",
    "VisualMesh",
]


class CollisionShapeType(StrEnum):
    """The convex collision shapes that every engine supports."""

    BOX = "box"
    SPHERE = "sphere"
    """An ellipsoid if the extents differ."""
    CYLINDER = "cylinder"
    """Its axis is the z axis of its pose."""
    HULL = "hull"
    """The convex hull of its points."""


class CollisionShape(PosedStruct, frozen=True, kw_only=True):
    """A convex collision shape."""

    type: CollisionShapeType = CollisionShapeType.BOX
    size: Vector
    """Extents along the axes of its pose."""
    pose: Pose = IDENTITY
    """Pose of its center in the body frame; the quaternion has norm 1."""
    points: tuple[Vector, ...] = ()
    """The vertices of a hull, in the frame of its pose."""


class PbrMaterial(FrozenStruct, frozen=True, kw_only=True):
    """A material in glTF's metallic-roughness model, with linear factors from 0 to 1."""

    name: str = ""
    """A word ("wood"), for reports."""
    color: Color = (0.8, 0.8, 0.8)
    """sRGB, as `Material.color`."""
    metalness: float = 0.0
    roughness: float = 0.8
    opacity: float = 1.0
    emission: float = 0.0
    """Emissive factor, multiplied by the color."""
    texture: str = ""
    """Name of a procedural texture, whose color, roughness and normal maps modify the surface; empty for none."""


@dataclass(frozen=True, slots=True, eq=False)
class VisualMesh:
    """A closed triangle mesh with one material."""

    points: Array
    """n x 3."""
    faces: NDArray[uint32]
    """m x 3 indices of points, counterclockwise seen from outside."""
    material: PbrMaterial
    normals: Array | None = None
    """n x 3 unit vertex normals; None for flat shading, with one normal per face."""
    uv: Array | None = None
    """n x 2 texture coordinates of the image, else of the texture of the material: (0, 0) is the lower left corner,
    (1, 1) the upper right one, and outside of these the image repeats."""
    image: NDArray[uint8] | None = None
    """h x w x 4, sRGB and opacity: an own picture, multiplied by the color of the material; the color map of a texture
    is then not used."""


class SupportSurface(
    FrozenStruct,
    frozen=True,
    kw_only=True,
):
    """A rectangle on which objects can be placed, parallel to one side of the body."""

    center: Vector
    """Center of the rectangle, on the surface."""
    size: tuple[float, float]
    """Extents along the two axes across `normal`, in their order: x and y, unless the body lies on its side."""
    clearance: float | None = None
    """Free height above the surface; None if nothing is above it."""
    is_inside: bool = False
    """Whether it is inside the body (a shelf, the bottom of a drawer) rather than on top of it."""
    normal: Vector = (0.0, 0.0, 1.0)
    """Upward unit vector of the surface, along an axis of the body."""


class AttachedLight(PosedStruct, frozen=True, kw_only=True):
    """A light source that is attached to a body."""

    type: LightType = LightType.POINT
    pose: Pose = IDENTITY
    """In the body frame."""
    color: Color = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    """As `Light.intensity`: [cd] or [lx]."""


class Inertia(FrozenStruct, frozen=True, kw_only=True):
    """Mass, center of mass and moments of inertia of a body, in its frame."""

    mass_kg: float
    center: Vector = (0.0, 0.0, 0.0)
    """Center of mass [m]."""
    tensor: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """xx, yy, zz, xy, xz, yz about the center of mass, along the axes of the body [kg m²]."""


class GeometrySource(StrEnum):
    """Where the geometry of a body comes from, in decreasing priority."""

    MESH = "mesh"
    """A mesh file."""
    ONTOLOGY = "ontology"
    """A shape rule that the ontology states for the class or a superclass."""
    CLASS_NAME = "class_name"
    """A word in the name of a class that no ontology defines: a guess."""
    MAP = "map"
    """The primitive shape in the map, otherwise a box."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyGeometry:
    """The geometry of a body. Geometries with equal keys are equal, so engines and viewers build each once."""

    key: str
    """A digest of all other fields except `source` and `reason`."""
    visuals: tuple[VisualMesh, ...]
    collision_shapes: tuple[CollisionShape, ...]
    source: GeometrySource = GeometrySource.MAP
    reason: str = ""
    """One line for reports: "knowrob:Drawer is shaped as ms:DrawerForm; its front is where its handle is"."""
    shape_name: str = "box"
    """The name of the shape template ("case", "drawer"), or "mesh"."""
    friction: float | None = None
    """Coefficient of sliding friction against the same material; None selects the default of the engine."""
    restitution: float | None = None
    density: float | None = None
    """Density of the collision shapes [kg/m³]; used if the map states no mass."""
    inertia: Inertia | None = None
    """Mass distribution; None for that of the collision shapes. A mass that the map states replaces its mass, and
    scales its moments."""
    support_surfaces: tuple[SupportSurface, ...] = ()
    lights: tuple[AttachedLight, ...] = ()
    _draw: Callable[[], tuple[str, tuple[VisualMesh, ...]]] | None = field(default=None, repr=False, compare=False)
    """Computes `key` and `visuals` when one of them is first read, unless they were given."""

    @classmethod
    def deferred(cls, draw: Callable[[], tuple[str, tuple[VisualMesh, ...]]], **fields: Any) -> Self:
        """Returns geometry whose `key` and `visuals` are computed on first access: physics alone needs neither.

        Args:
            draw: computes both. It is called at most once per thread and must return the same objects each time.
            fields: all other fields.
        """
        geometry = cls(key="", visuals=(), _draw=draw, **fields)
        # Access to an unset slot falls back to `__getattr__`.
        object.__delattr__(geometry, "key")
        object.__delattr__(geometry, "visuals")
        return geometry

    def __getstate__(self) -> list[Any]:
        """The fields, without computing `key` and `visuals` if that is deferred and was not done yet."""
        deferred = ("key", "visuals") if self._draw is not None else ()
        return [None if name in deferred else getattr(self, name) for name in self.__slots__]

    def __setstate__(self, state: list[Any]) -> None:
        for name, value in zip(self.__slots__, state, strict=True):
            if value is not None or name not in ("key", "visuals"):
                object.__setattr__(self, name, value)

    if not TYPE_CHECKING:  # otherwise mypy accepts any attribute

        def __getattr__(self, name: str) -> Any:
            if name not in ("key", "visuals"):
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            key, visuals = self._draw()
            object.__setattr__(self, "key", key)
            object.__setattr__(self, "visuals", visuals)
            return key if name == "key" else visuals


GeometryMap = Mapping[BodyId, BodyGeometry]
"""Geometry by body id; a body without an entry has its `PrimitiveShape`, scaled to its size."""

NO_GEOMETRY: GeometryMap = MappingProxyType({})
