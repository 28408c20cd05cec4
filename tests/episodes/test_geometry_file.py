"""Geometry in episodes: every field is written and read again, and shapes that are known are left out."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from mindstage.episodes.geometry_file import decode_geometry, encode_geometry
from mindstage.scene import BodyId, CollisionShape, LightType, PbrMaterial, Pose, VisualMesh
from mindstage.scene.geometry import AttachedLight, BodyGeometry, GeometrySource, Inertia, SupportSurface
from mindstage.scene.mesh import box

MESH = box((0.2, 0.3, 0.4))
CHANCE = np.random.default_rng(5)
FULL = BodyGeometry(
    key="full",
    visuals=(
        VisualMesh(
            MESH.points,
            MESH.faces,
            PbrMaterial(name="oak", color=(0.5, 0.25, 0.125), roughness=0.75, opacity=0.5),
            MESH.normals,
            CHANCE.random((len(MESH.points), 2)),
            CHANCE.integers(0, 256, (4, 3, 4), dtype=np.uint8),
        ),
        VisualMesh(MESH.points * 2.0, MESH.faces, PbrMaterial()),
    ),
    collision_shapes=(CollisionShape(size=(0.2, 0.3, 0.4), pose=Pose((0.0, 0.1, 0.2))),),
    source=GeometrySource.MESH,
    reason="mug.obj",
    shape_name="mesh",
    friction=0.625,
    restitution=0.25,
    density=700.0,
    inertia=Inertia(mass_kg=0.5, center=(0.0, 0.0, 0.1), tensor=(1.0, 2.0, 3.0, 0.1, 0.2, 0.3)),
    support_surfaces=(SupportSurface(center=(0.0, 0.0, 0.2), size=(0.2, 0.3), clearance=0.5, is_inside=True),),
    lights=(AttachedLight(type=LightType.SPOT, pose=Pose((0.0, 0.0, 1.0)), color=(1.0, 0.5, 0.25), intensity=3.0),),
)
PLAIN = BodyGeometry(key="plain", visuals=(), collision_shapes=(), reason="a box")


def assert_equal(one: Any, other: Any) -> None:
    """Geometries and visuals compare their arrays by value and type."""
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    elif isinstance(one, BodyGeometry | VisualMesh):
        for field in fields(one):
            if field.compare:
                assert_equal(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, tuple):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_equal(a, b)
    else:
        assert one == other


def test_every_field_of_every_body_is_read_as_it_was_written() -> None:
    twin = replace(FULL, source=GeometrySource.ONTOLOGY, reason="as its class")
    written = {BodyId("mug"): FULL, BodyId("twin"): twin, BodyId("crate"): PLAIN}
    read = decode_geometry(encode_geometry(written))
    assert list(read) == list(written)
    for id, geometry in written.items():
        assert_equal(read[id], geometry)


def test_shapes_that_are_known_are_left_out_and_needed_again() -> None:
    written = {BodyId("mug"): FULL, BodyId("crate"): PLAIN}
    data = encode_geometry(written, known=["full", "nothing"])
    assert len(data) < 300 < len(encode_geometry(written))
    read = decode_geometry(data, known={"full": replace(FULL, source=GeometrySource.MAP, reason="")})
    assert_equal(read[BodyId("mug")], FULL)
    assert_equal(read[BodyId("crate")], PLAIN)
    with pytest.raises(ValueError, match="geometry is missing: full"):
        decode_geometry(data)
