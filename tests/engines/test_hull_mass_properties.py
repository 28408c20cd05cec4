"""The mass properties of convex hulls equal those of MuJoCo's own convex hulls, in any orientation and precision."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from mindstage.scene import CollisionShape, CollisionShapeType
from mindstage.scene.collision_shapes import compile_geometry
from mindstage.scene.mesh import convex_hull

SHAPES = {
    "box": np.array([(x, y, z) for x in (-0.3, 0.3) for y in (-0.2, 0.2) for z in (-0.05, 0.05)]),
    "wedge": np.array([(0, 0, 0), (0, 0.3, 0), (0.4, 0, 0), (0.4, 0.3, 0), (0.4, 0, 0.2), (0.4, 0.3, 0.2)]),
    "plate": np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.4, 0.4) for z in (-0.002, 0.002)]),
    "cone": np.array(
        [(0.1 * np.cos(t), 0.1 * np.sin(t), 0.0) for t in np.linspace(0, 2 * np.pi, 24, endpoint=False)] + [(0, 0, 0.3)]
    ),
}


def mujoco_inertia(points: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass [kg], center of mass [m] and inertia tensor [kg m²] of the hull of points, with a density of 1000 kg/m³."""
    spec = mujoco.MjSpec()
    spec.add_mesh(name="hull", uservert=points.ravel().tolist(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX)
    body = spec.worldbody.add_body(name="body")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="hull", density=1000.0)
    model = spec.compile()
    axes = Rotation.from_quat(model.body_iquat[1], scalar_first=True).as_matrix()
    return float(model.body_mass[1]), model.body_ipos[1], axes @ np.diag(model.body_inertia[1]) @ axes.T


@settings(max_examples=25, deadline=None)
@given(
    name=st.sampled_from(sorted(SHAPES)),
    rotation=st.tuples(*[st.floats(-np.pi, np.pi)] * 3),
    offset=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    is_single_precision=st.booleans(),
)
def test_tilted_hulls_have_the_mass_properties_of_mujoco(
    name: str, rotation: tuple[float, ...], offset: tuple[float, ...], is_single_precision: bool
) -> None:
    points = SHAPES[name] @ Rotation.from_euler("xyz", rotation).as_matrix().T + offset
    if is_single_precision:  # mesh files round to single precision, so the corners of a face are not coplanar
        points = points.astype(np.float32).astype(np.float64)
    extents = tuple(np.ptp(points, axis=0).tolist())
    shape = CollisionShape(
        type=CollisionShapeType.HULL,
        size=extents,
        points=tuple(map(tuple, points.tolist())),  # type: ignore[arg-type]
    )
    compiled = compile_geometry((shape,))
    mass, center, inertia = mujoco_inertia(points)
    assert compiled.volume * 1000.0 == pytest.approx(mass, rel=2e-3)
    assert compiled.volume == pytest.approx(ConvexHull(points).volume, rel=1e-4)
    assert np.allclose(compiled.center_of_mass, center, atol=1e-4)
    assert np.allclose(compiled.inertia * compiled.volume * 1000.0, inertia, atol=5e-3 * np.trace(inertia))


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_no_point_is_outside_a_tilted_hull_in_single_precision(name: str) -> None:
    turns = Rotation.random(20, random_state=1)
    for turn in turns:
        points = (SHAPES[name] @ turn.as_matrix().T + 2.0).astype(np.float32).astype(np.float64)
        hull = convex_hull(points)
        assert hull is not None
        heights = np.einsum("pi,fi->pf", points, hull.normals)
        of_faces = np.einsum("fi,fi->f", hull.points[hull.faces[:, 0]], hull.normals)
        assert (heights - of_faces).max() < 1e-6
        edges = np.sort(np.concatenate([hull.faces[:, [0, 1]], hull.faces[:, [1, 2]], hull.faces[:, [2, 0]]]), axis=1)
        assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all(), "closed"
