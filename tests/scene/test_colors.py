"""Parsing and formatting of colors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.cases import each_case

from mindstage.errors import InvalidColorError
from mindstage.scene import Color
from mindstage.scene.colors import COLORS, NO_COLOR, color_name, linear_to_srgb, parse_color, srgb_to_linear


def test_named_colors_are_in_the_order_of_their_message_numbers() -> None:
    assert list(COLORS) == ["black", "red", "blue", "green", "yellow"]
    assert len(set(COLORS.values())) == 5
    assert parse_color(NO_COLOR) is None


@each_case(
    ("text", "color"),
    [
        ("red", COLORS["red"]),
        (" Red ", COLORS["red"]),
        ("#ff8000", (1.0, 128 / 255, 0.0)),
        ("#FF8000", (1.0, 128 / 255, 0.0)),
        ("0.1,0.5,1", (0.1, 0.5, 1.0)),
        ("0, 0, 0", (0.0, 0.0, 0.0)),
        ("none", None),
    ],
)
def test_a_color_is_parsed_from_a_name_hex_digits_or_numbers(text: str, color: Color | None) -> None:
    assert parse_color(text) == color


@each_case(
    "text", ["", "purple", "#12345", "#12345g", "ff8000", "1,2,3", "-0.1,0,0", "nan,0,0", "0,0", "0,0,0,0", "a,b,c"]
)
def test_an_invalid_color_raises_an_error_that_lists_valid_ones(text: str) -> None:
    with pytest.raises(InvalidColorError, match="there is black, red, blue, green, yellow, none, #rrggbb, or r,g,b"):
        parse_color(text)


def test_a_misspelled_color_name_raises_an_error_with_a_suggestion() -> None:
    with pytest.raises(InvalidColorError, match="near: 'yellow'"):
        parse_color("yelow")


@given(st.tuples(*(st.integers(0, 255).map(lambda part: part / 255) for _ in range(3))))
def test_a_formatted_color_parses_to_the_same_color(color: Color) -> None:
    assert parse_color(color_name(color)) == color


def test_a_named_color_is_formatted_as_its_name() -> None:
    assert color_name(COLORS["green"]) == "green"
    assert color_name((2.0, -1.0, 0.5)) == "#ff0080"


def test_srgb_is_linear_near_black_and_has_an_exponent_of_2_4_above() -> None:
    """Values of IEC 61966-2-1: 12.92 times below 0.0031308; 0.214 is the middle gray of a screen."""
    srgb = np.array([0.0, 0.01292, 0.04045, 0.5, 1.0])
    linear = np.array([0.0, 0.001, 0.0031308, 0.2140411, 1.0])
    np.testing.assert_allclose(linear_to_srgb(linear), srgb, atol=1e-6)
    np.testing.assert_allclose(srgb_to_linear(srgb), linear, atol=1e-6)
    np.testing.assert_allclose(linear_to_srgb(np.array([-1.0, 2.0])), [0.0, 1.0])
