"""Visual meshes as glTF, read back by trimesh."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace

from mindstage.scene import PbrMaterial, VisualMesh
from mindstage.viewer.appearance import mean_color, merge_visuals, visuals_to_glb

WOOD = PbrMaterial(name="wood", color=(0.7, 0.5, 0.3), roughness=0.6)
STEEL = PbrMaterial(name="steel", color=(0.8, 0.8, 0.8), metalness=1.0, roughness=0.3)
POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.uint32)
NORMALS = np.tile([0.0, 0.0, 1.0], (4, 1))
UV = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])


def wedge(surface: PbrMaterial = WOOD, **more: Any) -> VisualMesh:
    return VisualMesh(POINTS, FACES, surface, **more)


def read(*visuals: VisualMesh) -> list[Any]:
    scene = trimesh.load_scene(io.BytesIO(visuals_to_glb(visuals)), file_type="glb", process=False)
    return list(scene.geometry.values())


def test_only_meshes_with_normals_share_vertices() -> None:
    assert len(merge_visuals([wedge()]).points) == 12
    assert len(merge_visuals([wedge(normals=NORMALS)]).points) == 4
    both = merge_visuals([wedge(), wedge(normals=NORMALS)])
    assert both.points[both.faces] == pytest.approx(np.concatenate([POINTS[FACES]] * 2))
    assert len(merge_visuals([]).faces) == 0


def test_the_triangles_are_those_of_the_visual_mesh() -> None:
    (mesh,) = read(wedge())
    assert mesh.vertices[mesh.faces] == pytest.approx(POINTS[FACES])
    assert mesh.volume == pytest.approx(1 / 6)


def test_meshes_of_one_material_are_one_primitive() -> None:
    assert len(read(wedge(), wedge(), wedge(STEEL))) == 2


def test_materials_keep_their_pbr_factors() -> None:
    (mesh,) = read(wedge(replace(STEEL, opacity=0.5, emission=2.0)))
    material = mesh.visual.material
    assert (material.roughnessFactor, material.alphaMode) == (0.3, "BLEND")
    assert 0.1 < material.metallicFactor < 0.5, "pure metal would be black without an environment map"
    assert material.baseColorFactor / 255 == pytest.approx([0.604, 0.604, 0.604, 0.5], abs=0.005)
    assert material.emissiveFactor == pytest.approx([0.604] * 3, abs=0.001)


def test_a_texture_is_on_the_mesh_that_has_it() -> None:
    image = np.zeros((2, 3, 4), np.uint8)
    image[..., 0], image[..., 3] = 200, 255
    textured, plain = read(wedge(uv=UV, image=image), wedge(STEEL))
    texture = textured.visual.material.baseColorTexture
    assert texture.size == (3, 2)
    assert np.array_equal(np.asarray(texture.convert("RGBA")), image)
    assert plain.visual.material.baseColorTexture is None
    assert textured.visual.uv == pytest.approx(UV[FACES].reshape(-1, 2)), "glTF flips v"


def test_no_meshes_give_a_valid_file() -> None:
    assert read() == []
    assert read(VisualMesh(np.zeros((0, 3)), np.zeros((0, 3), np.uint32), WOOD)) == []


def test_the_mean_color_is_weighted_by_area() -> None:
    small = VisualMesh(POINTS * 0.1, FACES, replace(WOOD, color=(0.0, 0.0, 0.0)))
    assert mean_color([wedge(), small]) == pytest.approx(np.array(WOOD.color) / 1.01)
    assert mean_color([]) == (0.0, 0.0, 0.0)
