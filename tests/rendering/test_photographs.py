"""Photographs of four maps by each renderer, compared with reference pictures; and defects that the comparison notices.

The references are made by scripts/make_photographs.py. The tolerance is wide enough for other graphics drivers.
"""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from mindstage.pictures import simulation_scene
from mindstage.rendering import Screenshot
from mindstage.rendering.rasterizer import render_picture
from mindstage.rendering.render_scene import RenderScene
from mindstage.scene import PbrMaterial, VisualMesh
from mindstage.simulation.pictures import ScenePhotographer
from tests.rendering.photographs import MAPS, RENDERERS, SIZE, path_traced, photographed, reference_path
from tests.rendering.similarity import picture_similarity, read_picture

LEAST_SIMILARITY = 0.9

each_map = pytest.mark.parametrize("name", MAPS)


def samples_of(name: str, request: pytest.FixtureRequest) -> Path | None:
    """The folder of sample maps, where a map is one of them; skips where there are none."""
    return request.getfixturevalue("shared_data") if MAPS[name].startswith("maps/") else None


@each_map
def test_pictures_of_mujoco_are_as_the_references(name: str, request: pytest.FixtureRequest) -> None:
    with photographed(name, samples_of(name, request)) as sim:
        picture = RENDERERS["mujoco"](sim)
    assert picture_similarity(picture, read_picture(reference_path(name, "mujoco"))) > LEAST_SIMILARITY


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if MAPS[name].startswith("maps/") else []) for name in MAPS]
)
def test_path_traced_pictures_are_as_the_references(name: str, request: pytest.FixtureRequest) -> None:
    pytest.importorskip("mitsuba", reason="needs the extra render")
    with photographed(name, samples_of(name, request)) as sim:
        picture = RENDERERS["path"](sim)
    assert picture_similarity(picture, read_picture(reference_path(name, "path"))) > LEAST_SIMILARITY


# -- planted defects ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scene() -> RenderScene:
    """The scene of the bundled kitchen."""
    with photographed("kitchen", None) as sim:
        return simulation_scene(sim, Screenshot(size=SIZE))


def similarity_of(scene: RenderScene) -> float:
    picture: NDArray[np.uint8] = render_picture(scene, SIZE)
    return picture_similarity(picture, read_picture(reference_path("kitchen", "mujoco")))


def with_items(scene: RenderScene, id: str, **fields: object) -> RenderScene:
    assert id in {item.id for item in scene.items}
    items = tuple(msgspec.structs.replace(item, **fields) if item.id == id else item for item in scene.items)
    return msgspec.structs.replace(scene, items=items)


def test_a_missing_body_is_noticed(scene: RenderScene) -> None:
    assert similarity_of(with_items(scene, "table", shown=False)) < LEAST_SIMILARITY


def test_a_wrong_color_is_noticed(scene: RenderScene) -> None:
    (item,) = (each for each in scene.items if each.id == "fridge")
    red = PbrMaterial(color=(0.8, 0.2, 0.2))
    painted = tuple(VisualMesh(each.points, each.faces, red, each.normals) for each in item.visuals)
    assert similarity_of(with_items(scene, "fridge", visuals=painted)) < LEAST_SIMILARITY


def test_a_moved_camera_is_noticed(scene: RenderScene) -> None:
    camera = scene.camera
    x, y, z = camera.position
    moved = msgspec.structs.replace(camera, position=(x + 0.25, y, z))
    assert similarity_of(msgspec.structs.replace(scene, camera=moved)) < LEAST_SIMILARITY


def test_missing_shadows_are_noticed(scene: RenderScene) -> None:
    bare = tuple(msgspec.structs.replace(item, casts_shadow=False) for item in scene.items)
    assert similarity_of(msgspec.structs.replace(scene, items=bare)) < LEAST_SIMILARITY


# -- planted defects of path-traced pictures, in the quickest map ------------------------------------------------------


@pytest.fixture(scope="module")
def traced_scene() -> RenderScene:
    pytest.importorskip("mitsuba", reason="needs the extra render")
    with photographed("kitchenette", None) as sim:
        return ScenePhotographer.of(sim).scene(aspect=SIZE[0] / SIZE[1])


def traced_similarity(scene: RenderScene, **settings: float) -> float:
    return picture_similarity(path_traced(scene, **settings), read_picture(reference_path("kitchenette", "path")))


def test_a_body_that_is_missing_in_a_path_traced_picture_is_noticed(traced_scene: RenderScene) -> None:
    assert traced_similarity(with_items(traced_scene, "Cupboard", shown=False)) < LEAST_SIMILARITY


def test_a_wrong_lens_shift_is_noticed(traced_scene: RenderScene) -> None:
    camera = traced_scene.camera
    assert camera.vertical_shift > 0.3
    moved = msgspec.structs.replace(camera, vertical_shift=camera.vertical_shift - 0.05)
    assert traced_similarity(msgspec.structs.replace(traced_scene, camera=moved)) < LEAST_SIMILARITY


def test_half_a_stop_of_exposure_is_noticed(traced_scene: RenderScene) -> None:
    assert traced_similarity(traced_scene, exposure_ev=0.5) < LEAST_SIMILARITY


def test_other_noise_of_path_tracing_is_tolerated(traced_scene: RenderScene) -> None:
    assert traced_similarity(traced_scene, seed=7) > LEAST_SIMILARITY


def test_noise_and_small_shifts_of_colors_are_tolerated(scene: RenderScene) -> None:
    reference = read_picture(reference_path("kitchen", "mujoco")).astype(float)
    noise = np.random.default_rng(1).normal(0.0, 4.0, reference.shape)
    shifted = np.clip(reference * 0.985 + noise, 0, 255).astype(np.uint8)
    assert picture_similarity(shifted, reference.astype(np.uint8)) > LEAST_SIMILARITY
