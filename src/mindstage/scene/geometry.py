"""Forms: what a body looks like and what of it can be touched.

A map says how large a drawer is; a form says that it is open at the top. Forms are worked out when a world is spawned
(from mesh files, else from what is known about classes) and are no part of `World`: nothing of them is logged or
written back. All lengths are meters in the body's own frame, whose origin is the middle of the body's size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

from numpy import uint8, uint32
from numpy.typing import NDArray

from mindstage.scene.model import IDENTITY, BodyId, Color, FrozenStruct, LightType, Pose, Vector
from mindstage.scene.transforms import Array

__all__ = [
    "NO_GEOMETRY",
    "AttachedLight",
    "BodyGeometry",
    "CollisionShape",
    "CollisionShapeType",
    "GeometryMap",
    "GeometrySource",
    "PbrMaterial",
    "SupportSurface",
    "VisualMesh",
]


class CollisionShapeType(StrEnum):
    """The convex things that every engine can let collide."""

    BOX = "box"
    SPHERE = "sphere"
    """An ellipsoid, where its extents differ."""
    CYLINDER = "cylinder"
    """Its axis is the z of its own pose."""
    HULL = "hull"
    """The smallest convex body round its points."""


class CollisionShape(FrozenStruct, frozen=True, kw_only=True, rename={"type": "kind"}):
    """One convex part that can be touched."""

    type: CollisionShapeType = CollisionShapeType.BOX
    size: Vector
    """Extents along its own axes."""
    pose: Pose = IDENTITY
    """Of its middle, in the body's frame; its quaternion has norm 1."""
    points: tuple[Vector, ...] = ()
    """Of a hull, in the solid's own frame."""


class PbrMaterial(
    FrozenStruct, frozen=True, kw_only=True, rename={"name": "material", "color": "colour", "emission": "glow"}
):
    """How light falls back from a skin: glTF's metallic-roughness model, linear factors from 0 to 1."""

    name: str = ""
    """In a word ("wood"), for people and reports."""
    color: Color = (0.8, 0.8, 0.8)
    """sRGB, as `Material.colour` is."""
    metalness: float = 0.0
    roughness: float = 0.8
    opacity: float = 1.0
    emission: float = 0.0
    """How much of its color it gives off by itself."""


@dataclass(frozen=True, slots=True, eq=False)
class VisualMesh:
    """What is seen: one closed surface of triangles."""

    points: Array
    """n x 3."""
    faces: NDArray[uint32]
    """m x 3 numbers of points, counterclockwise seen from outside."""
    material: PbrMaterial
    normals: Array | None = None
    """n x 3, of norm 1; None where each face has its own."""
    uv: Array | None = None
    """n x 2, where it has an image: from that image's lower left corner (0, 0) to its upper right one."""
    image: NDArray[uint8] | None = None
    """h x w x 4 (sRGB and opacity): the texture, multiplied by the surface's color."""


class SupportSurface(
    FrozenStruct,
    frozen=True,
    kw_only=True,
    rename={"center": "centre", "clearance": "height", "is_inside": "inside", "normal": "up"},
):
    """A level rectangle on which something can be put, parallel to one of the body's sides."""

    center: Vector
    """On the surface itself."""
    size: tuple[float, float]
    """Along the other two axes than `up`'s, in their order: x and y, unless the body lies on its side."""
    clearance: float | None = None
    """Free above it; None where there is nothing above."""
    is_inside: bool = False
    """Whether it is in the body (a shelf, a drawer's floor) rather than on it."""
    normal: Vector = (0.0, 0.0, 1.0)
    """Where it looks; along one of the body's axes."""


class AttachedLight(FrozenStruct, frozen=True, kw_only=True, rename={"type": "kind", "color": "colour"}):
    """Light that a body gives."""

    type: LightType = LightType.POINT
    pose: Pose = IDENTITY
    """In the body's frame."""
    color: Color = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    """As that of `Light`."""


class GeometrySource(StrEnum):
    """Where a form comes from, the most trusted first."""

    MESH = "mesh"
    """A mesh file."""
    ONTOLOGY = "knowledge"
    """The ontology says how things of that class are shaped."""
    CLASS_NAME = "name"
    """A word in the class's name, which no ontology knows: a guess."""
    MAP = "map"
    """The map's own shape, or a box of its size."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyGeometry:
    """What a body is made of. Forms of one key are the same, so engines and pages build each only once."""

    key: str
    """A digest of everything below but `source` and `reason`."""
    visuals: tuple[VisualMesh, ...]
    collision_shapes: tuple[CollisionShape, ...]
    source: GeometrySource = GeometrySource.MAP
    reason: str = ""
    """One line for reports: "a drawer, because ms:Drawer is shaped as one; open to the top"."""
    shape_name: str = "box"
    """The name of the shape ("case", "drawer", "mesh")."""
    friction: float | None = None
    """Sliding, against something alike; None leaves it to the engine."""
    restitution: float | None = None
    density: float | None = None
    """Of its solids [kg/m³]; it counts where a map gives no mass."""
    support_surfaces: tuple[SupportSurface, ...] = ()
    lights: tuple[AttachedLight, ...] = ()
    _draw: Callable[[], tuple[str, tuple[VisualMesh, ...]]] | None = field(default=None, repr=False, compare=False)
    """Computes `key` and `visuals` when one of them is first read, unless they were given."""

    @classmethod
    def deferred(cls, draw: Callable[[], tuple[str, tuple[VisualMesh, ...]]], **fields: Any) -> Self:
        """A form whose `key` and `visuals` are computed when they are first read: physics alone needs neither.

        Args:
            draw: computes both; it is called at most once a thread, and must return the same objects each time.
            fields: all other fields.
        """
        form = cls(key="", visuals=(), _draw=draw, **fields)
        # A slot that is not set is looked up by `__getattr__`.
        object.__delattr__(form, "key")
        object.__delattr__(form, "visuals")
        return form

    if not TYPE_CHECKING:  # mypy would take any attribute for one that exists

        def __getattr__(self, name: str) -> Any:
            if name not in ("key", "visuals"):
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            key, visuals = self._draw()
            object.__setattr__(self, "key", key)
            object.__setattr__(self, "visuals", visuals)
            return key if name == "key" else visuals


GeometryMap = Mapping[BodyId, BodyGeometry]
"""The forms of a world's bodies; a body without one is its `PrimitiveShape`, in its size."""

NO_GEOMETRY: GeometryMap = MappingProxyType({})
