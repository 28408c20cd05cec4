"""Support surfaces of meshes."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mindstage.assets.library import find_support_surfaces
from mindstage.scene import PbrMaterial, VisualMesh


def box_visual(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> VisualMesh:
    """A visual mesh of boxes, each given by two corners."""
    made = [trimesh.creation.box(bounds=np.array(corners)) for corners in boxes]
    mesh = trimesh.util.concatenate(made)
    return VisualMesh(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.uint32), PbrMaterial())


def test_a_block_has_one_support_surface() -> None:
    (surface,) = find_support_surfaces([box_visual(((-0.5, -0.4, -0.3), (0.5, 0.4, 0.3)))])
    assert surface.center == pytest.approx((0.0, 0.0, 0.3))
    assert surface.size == pytest.approx((1.0, 0.8))
    assert (surface.clearance, surface.is_inside) == (None, False)


def test_the_seat_of_a_bench_is_a_support_surface_and_its_back_is_not() -> None:
    seat, back = ((-0.5, -0.25, 0.4), (0.5, 0.25, 0.45)), ((-0.5, 0.22, 0.45), (0.5, 0.25, 0.9))
    (surface,) = find_support_surfaces([box_visual(seat, back)])
    assert surface.center[2] == pytest.approx(0.45)
    assert not surface.is_inside


def test_lower_shelves_are_inside_with_their_clearance() -> None:
    boards = [((-0.4, -0.15, z), (0.4, 0.15, z + 0.02)) for z in (0.0, 0.4, 0.8)]
    surfaces = find_support_surfaces([box_visual(boards[0]), box_visual(*boards[1:])])
    assert [surface.center[2] for surface in surfaces] == pytest.approx([0.82, 0.42, 0.02])
    assert [surface.is_inside for surface in surfaces] == [False, True, True]
    assert [surface.clearance for surface in surfaces[1:]] == pytest.approx([0.4, 0.4])


def test_a_ball_and_a_slope_have_no_support_surface() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    wedge = trimesh.creation.box((1.0, 1.0, 0.1))
    wedge.apply_transform(trimesh.transformations.rotation_matrix(0.4, (0, 1, 0)))
    for mesh in (ball, wedge):
        assert not find_support_surfaces(
            [VisualMesh(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.uint32), PbrMaterial())]
        )
