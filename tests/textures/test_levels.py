"""Textures in decreasing resolutions, and their files in the cache."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from mindstage.textures import baking
from mindstage.textures.baking import texture_levels, texture_set


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    texture_set("oak_board")  # baked once, in the cache of all tests
    monkeypatch.setenv("MINDSTAGE_CACHE", str(tmp_path))
    return tmp_path / "textures"


def test_each_level_is_the_mean_of_the_one_before(cache: Path) -> None:
    levels = texture_levels("oak_board", 512)
    assert [level.shape for level in levels] == [(2, 512 >> n, 512 >> n, 4) for n in range(10)]
    textures = texture_set("oak_board")
    assert np.array_equal(levels[0][0, ..., :3], textures.color)
    assert np.array_equal(levels[0][1, ..., :2], textures.normal[..., :2])
    assert np.array_equal(levels[0][1, ..., 2], textures.roughness)
    for larger, smaller in pairwise(levels):
        corners = [larger[:, row::2, column::2].astype(float) for row in (0, 1) for column in (0, 1)]
        assert np.abs(np.mean(corners, axis=0) - smaller).max() <= 0.5


@pytest.mark.parametrize(("pixels", "first"), [(256, 256), (200, 256), (129, 256), (128, 128), (3, 4), (1, 1)])
def test_the_first_level_is_as_large_as_needed(cache: Path, pixels: int, first: int) -> None:
    assert texture_levels("oak_board", pixels)[0].shape == (2, first, first, 4)


def test_levels_are_stored_and_a_damaged_file_is_computed_again(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = texture_levels("oak_board", 64)
    (path,) = cache.glob("oak_board-*.npy")
    with monkeypatch.context() as patch:
        patch.setattr(baking, "texture_set", None)  # the file is enough
        assert all(map(np.array_equal, texture_levels("oak_board", 64), before))
    path.write_bytes(path.read_bytes()[:5000])
    assert all(map(np.array_equal, texture_levels("oak_board", 64), before))
