"""Printed pictures: they differ by word, have the shape of the surface, and are reproducible."""

from __future__ import annotations

import numpy as np
import pytest

from mindstage.textures.prints import book_cover, book_spine, clock_face, package_wrap, round_label, wall_picture

WHITE = (0.95, 0.94, 0.91)


def test_a_wrap_has_the_proportions_of_the_package_and_two_equal_main_sides() -> None:
    image = package_wrap("milk", 0.08, 0.12, 0.2, WHITE)
    height, width, _ = image.shape
    assert width / height == pytest.approx(0.4 / 0.2, rel=0.02)
    first, second = image[:, : int(0.3 * width)], image[:, width // 2 : width // 2 + int(0.3 * width)]
    assert np.abs(first.astype(int) - second).mean() < 4.0
    assert np.abs(image.astype(int) - package_wrap("juice", 0.08, 0.12, 0.2, WHITE)).mean() > 5.0


def test_the_lower_left_corner_has_the_color_of_the_paper() -> None:
    for image in (
        package_wrap("rice", 0.08, 0.12, 0.2, (0.2, 0.4, 0.6)),
        book_cover("soups", 0.2, 0.25, (0.2, 0.4, 0.6)),
    ):
        assert image[-1, 0].tolist() == [51, 102, 153, 255]


@pytest.mark.parametrize("word", ["milk", "breakfast cereal", "x", "dishwasher tablets of the very long kind"])
def test_every_word_fits(word: str) -> None:
    image = round_label(word, 0.24, 0.08, WHITE)
    assert image.dtype == np.uint8
    assert image.shape[2] == 4
    assert (image[..., 3] == 255).all()


def test_a_spine_is_upright_and_a_clock_is_round() -> None:
    spine = book_spine("cookbook", 0.044, 0.25, (0.3, 0.4, 0.6))
    assert spine.shape[0] / spine.shape[1] == pytest.approx(0.25 / 0.044, rel=0.03)
    face = clock_face(0.3, WHITE)
    assert face.shape[0] == face.shape[1]
    assert not np.array_equal(wall_picture(0.7, 0.5, WHITE), wall_picture(0.7, 0.51, WHITE)[: face.shape[0]])
