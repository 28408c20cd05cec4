"""Procedural textures: they repeat without seams, are neutral and reproducible, and their maps are valid."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mindstage.errors import TextureNotFoundError
from mindstage.files import cache_dir
from mindstage.textures import (
    TextureLayout,
    TextureMap,
    TextureSet,
    texture_info,
    texture_jpeg,
    texture_names,
    texture_set,
)
from mindstage.textures.baking import bake, content_version
from tests.cases import each_case

EACH = each_case("name", texture_names())
_baked: dict[str, TextureSet] = {}


def baked(name: str) -> TextureSet:
    if name not in _baked:
        _baked[name] = bake(texture_info(name))
    return _baked[name]


def steps(image: NDArray[np.uint8], axis: int) -> NDArray[np.float64]:
    """Mean differences between neighboring lines, the last of them across the edge."""
    lines = image.astype(float)
    differences = np.abs(np.roll(lines, -1, axis=axis) - lines)
    return np.asarray(differences.mean(axis=tuple(each for each in range(image.ndim) if each != axis)))


@EACH
def test_edges_match(name: str) -> None:
    texture = baked(name)
    for image in (texture.color, texture.roughness, texture.normal):
        for axis in (0, 1):
            change = steps(image, axis)
            assert change[-1] <= change[:-1].max() + 1.0, "the step across the edge is larger than any inside"


@EACH
def test_the_color_is_neutral_and_bright_on_average(name: str) -> None:
    linear = (baked(name).color.reshape(-1, 3) / 255.0) ** 2.2
    mean = linear.mean(axis=0)
    assert np.ptp(mean) < 0.02, "it would change the hue of the material"
    assert mean.min() > 0.5
    assert baked(name).mean_shade() == pytest.approx(mean.mean(), abs=0.02)


@EACH
def test_normals_are_unit_vectors_that_point_outwards(name: str) -> None:
    normal = baked(name).normal.reshape(-1, 3) / 127.5 - 1.0
    assert np.abs(np.linalg.norm(normal, axis=1) - 1.0).max() < 0.015
    assert normal[:, 2].min() > 0.0
    assert np.abs(normal[:, :2].mean(axis=0)).max() < 0.02, "the surface is level on average"


@EACH
def test_roughness_lowers_that_of_the_material_at_most_to_a_quarter(name: str) -> None:
    assert baked(name).roughness.mean() > 0.25 * 255


def test_baking_twice_gives_the_same_images() -> None:
    one, other = baked("parquet"), bake(texture_info("parquet"))
    for field in ("color", "roughness", "normal"):
        assert np.array_equal(getattr(one, field), getattr(other, field))


def test_normals_follow_the_height_upwards_and_to_the_right() -> None:
    """The upper edge of a tile, which slopes down into the joint, faces upwards: green is above one half."""
    texture = baked("wall_tiles")
    pixels = len(texture.normal)
    tile = pixels // 4  # four tiles in each direction; the image starts with a joint
    middle = tile // 2
    edge = texture.normal[: tile // 6, middle].astype(int) - 128
    assert edge[:, 1].max() > 10
    assert texture.normal[middle, tile - tile // 6 : tile, 0].max() > 138, "its right edge faces right"


@pytest.mark.parametrize(("name", "count"), [("floor_tiles", 3), ("wall_tiles", 4)])
def test_tiles_have_their_size_in_meters(name: str, count: int) -> None:
    texture = baked(name)
    dark = texture.color[..., 0].astype(float).mean(axis=0)
    joints = np.flatnonzero(dark < dark.mean() - 1.5 * dark.std())
    groups = np.split(joints, np.flatnonzero(np.diff(joints) > 4) + 1)
    centers = [float(group.mean()) for group in groups]
    widths = np.diff(centers) * texture.size[0] / texture.color.shape[1]
    assert widths[len(widths) // 2] == pytest.approx(texture.size[0] / count, rel=0.05)


def test_the_grain_of_wood_is_along_u() -> None:
    for name in texture_names():
        if texture_info(name).layout is TextureLayout.GRAIN and "board" in name and name != "lacquered_board":
            along, across = (steps(baked(name).color, axis).mean() for axis in (1, 0))
            if name == "cardboard":
                continue
            assert across > 1.3 * along, name


def test_a_texture_is_cached_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mindstage.textures import baking

    monkeypatch.setenv("MINDSTAGE_CACHE", str(tmp_path))
    monkeypatch.setattr(baking, "_baked", {})
    outdated = cache_dir("textures") / "mirror-0123456789abcdef.png"
    outdated.write_bytes(b"of an earlier version")
    first = texture_set("mirror")
    (path,) = cache_dir("textures").iterdir()
    assert path.name == f"mirror-{content_version()}.png"
    monkeypatch.setattr(baking, "_baked", {})
    again = texture_set("mirror")
    assert again is not first
    assert np.array_equal(again.normal, first.normal)
    monkeypatch.setattr(baking, "_baked", {})
    path.write_bytes(b"damaged")
    assert np.array_equal(texture_set("mirror").normal, first.normal)
    assert texture_set("mirror") is texture_set("mirror")


def test_an_unknown_texture_is_an_error_with_similar_names() -> None:
    with pytest.raises(TextureNotFoundError, match=r"'oak_bord'.*oak_board"):
        texture_set("oak_bord")


def test_images_have_the_channels_of_gltf() -> None:
    image = Image.open(io.BytesIO(texture_jpeg("wall_tiles", TextureMap.ROUGHNESS, 256)))
    assert image.size == (256, 256)
    _, green, blue = np.moveaxis(np.asarray(image, dtype=float), -1, 0)
    assert blue.mean() > 250, "the metalness is that of the material"
    assert green.mean() == pytest.approx(baked("wall_tiles").roughness.mean(), abs=3)


def test_the_documentation_lists_every_texture() -> None:
    text = Path(__file__, "../../../docs/how-to/materials.md").resolve().read_text(encoding="utf-8")
    for name in texture_names():
        info = texture_info(name)
        row = f"| `{name}` | {info.size[0]:g} x {info.size[1]:g} | {info.layout} | {info.description} |"
        assert row in text
