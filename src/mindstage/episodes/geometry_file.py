"""Body geometry as bytes, without loss: meshes as raw arrays, equal ones once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec
import numpy as np

from mindstage.scene import (
    AttachedLight,
    BodyGeometry,
    BodyId,
    CollisionShape,
    GeometryMap,
    GeometrySource,
    PbrMaterial,
    SupportSurface,
    VisualMesh,
)
from mindstage.scene.geometry import Inertia

__all__ = ["decode_geometry", "encode_geometry"]


class _ArrayRecord(msgspec.Struct, frozen=True, array_like=True):
    dtype: str
    shape: tuple[int, ...]
    data: bytes


class _VisualRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    points: _ArrayRecord
    faces: _ArrayRecord
    material: PbrMaterial
    normals: _ArrayRecord | None = None
    uv: _ArrayRecord | None = None
    image: _ArrayRecord | None = None


class _ShapeRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What geometries with the same key have in common."""

    visuals: tuple[_VisualRecord, ...]
    collision_shapes: tuple[CollisionShape, ...]
    shape_name: str
    friction: float | None = None
    restitution: float | None = None
    density: float | None = None
    inertia: Inertia | None = None
    support_surfaces: tuple[SupportSurface, ...] = ()
    lights: tuple[AttachedLight, ...] = ()


class _BodyRecord(msgspec.Struct, frozen=True, kw_only=True):
    key: str
    source: GeometrySource
    reason: str


class _GeometryFile(msgspec.Struct, frozen=True, kw_only=True):
    format_version: int = 1
    bodies: dict[BodyId, _BodyRecord]
    shapes: dict[str, _ShapeRecord]
    """By key; the others are in earlier files."""


_DTYPES = {"<f8", "<f4", "<u4", "<i8", "<i4", "|u1"}


def encode_geometry(geometry: GeometryMap, *, known: Iterable[str] = ()) -> bytes:
    """The geometry of bodies as MessagePack.

    Args:
        geometry: the geometry by body.
        known: keys of geometries that are left out, since they are known where the bytes are read.
    """
    shapes = {each.key: each for each in geometry.values()}
    for key in known:
        shapes.pop(key, None)
    file = _GeometryFile(
        bodies={id: _BodyRecord(key=each.key, source=each.source, reason=each.reason) for id, each in geometry.items()},
        shapes={key: _shape_record(each) for key, each in shapes.items()},
    )
    return msgspec.msgpack.encode(file)


def decode_geometry(data: bytes, *, known: Mapping[str, BodyGeometry] | None = None) -> dict[BodyId, BodyGeometry]:
    """The geometry in bytes that `encode_geometry` has made.

    Args:
        known: geometries of the keys that were left out.

    Raises:
        ValueError: the bytes are not valid, or a key is missing.
    """
    file = msgspec.msgpack.decode(data, type=_GeometryFile)
    shapes = dict(known or {})
    for key, record in file.shapes.items():
        shapes[key] = BodyGeometry(
            key=key,
            visuals=tuple(map(_visual, record.visuals)),
            collision_shapes=record.collision_shapes,
            shape_name=record.shape_name,
            friction=record.friction,
            restitution=record.restitution,
            density=record.density,
            inertia=record.inertia,
            support_surfaces=record.support_surfaces,
            lights=record.lights,
        )
    if missing := {record.key for record in file.bodies.values()} - shapes.keys():
        raise ValueError(f"geometry is missing: {', '.join(sorted(missing)[:3])}")
    return {id: _of_body(shapes[record.key], record) for id, record in file.bodies.items()}


def _of_body(shape: BodyGeometry, record: _BodyRecord) -> BodyGeometry:
    return BodyGeometry(
        key=shape.key,
        visuals=shape.visuals,
        collision_shapes=shape.collision_shapes,
        source=record.source,
        reason=record.reason,
        shape_name=shape.shape_name,
        friction=shape.friction,
        restitution=shape.restitution,
        density=shape.density,
        inertia=shape.inertia,
        support_surfaces=shape.support_surfaces,
        lights=shape.lights,
    )


def _shape_record(geometry: BodyGeometry) -> _ShapeRecord:
    return _ShapeRecord(
        visuals=tuple(map(_visual_record, geometry.visuals)),
        collision_shapes=geometry.collision_shapes,
        shape_name=geometry.shape_name,
        friction=geometry.friction,
        restitution=geometry.restitution,
        density=geometry.density,
        inertia=geometry.inertia,
        support_surfaces=geometry.support_surfaces,
        lights=geometry.lights,
    )


def _visual_record(visual: VisualMesh) -> _VisualRecord:
    return _VisualRecord(
        points=_array_record(visual.points),
        faces=_array_record(visual.faces),
        material=visual.material,
        normals=None if visual.normals is None else _array_record(visual.normals),
        uv=None if visual.uv is None else _array_record(visual.uv),
        image=None if visual.image is None else _array_record(visual.image),
    )


def _visual(record: _VisualRecord) -> VisualMesh:
    return VisualMesh(
        _array(record.points),
        _array(record.faces),
        record.material,
        None if record.normals is None else _array(record.normals),
        None if record.uv is None else _array(record.uv),
        None if record.image is None else _array(record.image),
    )


def _array_record(array: Any) -> _ArrayRecord:
    little = np.ascontiguousarray(array, dtype=np.asarray(array).dtype.newbyteorder("<"))
    return _ArrayRecord(little.dtype.str, little.shape, little.tobytes())


def _array(record: _ArrayRecord) -> Any:
    if record.dtype not in _DTYPES:
        raise ValueError(f"unknown type of numbers {record.dtype!r}")
    return (
        np.frombuffer(record.data, dtype=record.dtype)
        .reshape(record.shape)
        .astype(np.dtype(record.dtype).newbyteorder("="))
    )
