"""Visual meshes as glTF, read back by trimesh."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace

from mindstage.geometry import build_geometry, template_by_name
from mindstage.rendering.appearance import cached_visuals_to_glb, mean_color, merge_visuals, visuals_to_glb
from mindstage.scene import PbrMaterial, VisualMesh
from mindstage.textures import TextureMap

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


def test_patterns_are_named_by_address_and_plain_textures_are_left_out() -> None:
    def address(name: str, map: TextureMap) -> str:
        return f"/textures/{name}-{map}.jpg"

    oak, enamel = (
        build_geometry(template_by_name("panel"), (0.1, 0.5, 0.02), materials={"body": PbrMaterial(texture=texture)})
        for texture in ("oak_board", "enamel")
    )
    patterned = visuals_to_glb(oak.visuals, texture_uri=address)
    assert b"/textures/oak_board-color.jpg" in patterned
    assert b"TEXCOORD_0" in patterned
    for plain in (visuals_to_glb(enamel.visuals, texture_uri=address), visuals_to_glb(oak.visuals)):
        assert b"TEXCOORD_0" not in plain
        assert b"images" not in plain
    bare = build_geometry(template_by_name("panel"), (0.1, 0.5, 0.02), materials={"body": PbrMaterial()})
    assert len(visuals_to_glb(enamel.visuals, texture_uri=address)) <= len(visuals_to_glb(bare.visuals)) + 64


def test_a_file_names_the_images_of_textures_and_contains_none() -> None:
    oak = replace(WOOD, texture="oak_board")
    visuals = [wedge(oak, uv=UV, normals=NORMALS), wedge(oak, uv=2 * UV), wedge(STEEL)]
    content = visuals_to_glb(visuals, texture_uri=lambda name, kind: f"/t/{name}-{kind}-1.jpg")
    scene = trimesh.load_scene(io.BytesIO(content), file_type="glb", process=False)
    names = [mesh.visual.material.name for mesh in scene.geometry.values()]
    assert sorted(names) == ["steel", "texture:/t/oak_board-color-1.jpg"]
    assert b'"images"' not in content
    shapes = {len(mesh.visual.uv) == len(mesh.vertices) for mesh in scene.geometry.values()}
    assert shapes == {True}, "all primitives of a file have the same attributes"


def test_files_are_kept_for_later_runs_by_their_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINDSTAGE_CACHE", str(tmp_path))
    made = cached_visuals_to_glb([wedge()])
    (file,) = (tmp_path / "view").iterdir()
    assert made == file.read_bytes() == visuals_to_glb([wedge()])
    file.write_bytes(b"from the disk")
    assert cached_visuals_to_glb([wedge()]) == b"from the disk"
    for other in (wedge(STEEL), wedge(uv=UV), VisualMesh(2 * POINTS, FACES, WOOD)):
        assert cached_visuals_to_glb([other]) == visuals_to_glb([other])
    assert len(list((tmp_path / "view").iterdir())) == 4
