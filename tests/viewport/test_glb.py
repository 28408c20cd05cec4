"""Forms as files for the browser, read back by another library."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace

from mindstage.viewport.glb import glb, mean_colour, mesh_of
from mindstage.world import Skin, Surface

WOOD = Surface(material="wood", colour=(0.7, 0.5, 0.3), roughness=0.6)
STEEL = Surface(material="steel", colour=(0.8, 0.8, 0.8), metalness=1.0, roughness=0.3)
POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.uint32)
NORMALS = np.tile([0.0, 0.0, 1.0], (4, 1))
UV = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])


def wedge(surface: Surface = WOOD, **more: Any) -> Skin:
    return Skin(POINTS, FACES, surface, **more)


def read(*skins: Skin) -> list[Any]:
    scene = trimesh.load_scene(io.BytesIO(glb(skins)), file_type="glb", process=False)
    return list(scene.geometry.values())


def test_flat_faces_share_no_points_and_round_ones_do() -> None:
    assert len(mesh_of([wedge()]).points) == 12
    assert len(mesh_of([wedge(normals=NORMALS)]).points) == 4
    both = mesh_of([wedge(), wedge(normals=NORMALS)])
    assert both.points[both.faces] == pytest.approx(np.concatenate([POINTS[FACES]] * 2))
    assert len(mesh_of([]).faces) == 0


def test_the_triangles_are_those_of_the_skin() -> None:
    (mesh,) = read(wedge())
    assert mesh.vertices[mesh.faces] == pytest.approx(POINTS[FACES])
    assert mesh.volume == pytest.approx(1 / 6)


def test_skins_of_one_surface_are_drawn_at_once() -> None:
    assert len(read(wedge(), wedge(), wedge(STEEL))) == 2


def test_a_surface_is_told_with_all_that_light_does_on_it() -> None:
    (mesh,) = read(wedge(replace(STEEL, opacity=0.5, glow=2.0)))
    material = mesh.visual.material
    assert (material.roughnessFactor, material.alphaMode) == (0.3, "BLEND")
    assert 0.1 < material.metallicFactor < 0.5, "in an empty place pure metal would be black"
    assert material.baseColorFactor / 255 == pytest.approx([0.604, 0.604, 0.604, 0.5], abs=0.005)
    assert material.emissiveFactor == pytest.approx([0.604] * 3, abs=0.001)


def test_a_picture_is_on_the_skin_that_has_it() -> None:
    image = np.zeros((2, 3, 4), np.uint8)
    image[..., 0], image[..., 3] = 200, 255
    pictured, plain = read(wedge(uv=UV, image=image), wedge(STEEL))
    texture = pictured.visual.material.baseColorTexture
    assert texture.size == (3, 2)
    assert np.array_equal(np.asarray(texture.convert("RGBA")), image)
    assert plain.visual.material.baseColorTexture is None
    assert pictured.visual.uv == pytest.approx(UV[FACES].reshape(-1, 2)), "the picture is upside down"


def test_nothing_is_a_file_too() -> None:
    assert read() == []
    assert read(Skin(np.zeros((0, 3)), np.zeros((0, 3), np.uint32), WOOD)) == []


def test_the_colour_of_a_whole_is_that_of_its_larger_parts() -> None:
    small = Skin(POINTS * 0.1, FACES, replace(WOOD, colour=(0.0, 0.0, 0.0)))
    assert mean_colour([wedge(), small]) == pytest.approx(np.array(WOOD.colour) / 1.01)
    assert mean_colour([]) == (0.0, 0.0, 0.0)
