"""Paints of highlighted and dimmed bodies."""

from __future__ import annotations

import numpy as np
import pytest

from mindstage.rendering.appearance import HIGHLIGHT_OPACITY, OCCLUDER_OPACITY, Paint, dimmed, highlighted
from mindstage.scene.colors import srgb_to_linear

RED = (1.0, 0.0, 0.0)


def test_a_highlighted_body_has_the_color_of_its_highlight() -> None:
    assert highlighted(Paint((0.5, 0.5, 0.5)), RED) == Paint(RED)


def test_a_highlighted_body_has_a_minimum_opacity() -> None:
    assert highlighted(Paint((0.5, 0.5, 0.5), 0.1), RED) == Paint(RED, HIGHLIGHT_OPACITY)


def test_dimmed_bodies_are_paler_and_occluders_transparent() -> None:
    red, green, _ = dimmed(Paint(RED)).color
    assert 0.5 < red < 1.0
    assert 0.0 < green < red
    assert dimmed(Paint(RED)).opacity == 1.0
    assert dimmed(Paint(RED), as_occluder=True).opacity == OCCLUDER_OPACITY
    assert dimmed(Paint(RED, 0.1), as_occluder=True).opacity == 0.1, "a lower opacity is kept"


def test_srgb_is_converted_to_linear() -> None:
    linear = srgb_to_linear(np.array([0.0, 0.04045, 0.5, 1.0, 7.0]))
    assert linear == pytest.approx([0.0, 0.0031308, 0.2140411, 1.0, 1.0], abs=1e-6)
