"""Colours by name and by number."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.errors import ColourUnknown
from mindstage.world import Colour
from mindstage.world.colours import COLOURS, NO_COLOUR, colour_from, colour_text


def test_the_named_colours_are_those_of_the_wire_in_its_order() -> None:
    assert list(COLOURS) == ["black", "red", "blue", "green", "yellow"]
    assert len(set(COLOURS.values())) == 5
    assert colour_from(NO_COLOUR) is None


@pytest.mark.parametrize(
    ("text", "colour"),
    [
        ("red", COLOURS["red"]),
        (" Red ", COLOURS["red"]),
        ("#ff8000", (1.0, 128 / 255, 0.0)),
        ("#FF8000", (1.0, 128 / 255, 0.0)),
        ("0.1,0.5,1", (0.1, 0.5, 1.0)),
        ("0, 0, 0", (0.0, 0.0, 0.0)),
        ("none", None),
    ],
)
def test_a_colour_is_read_as_people_write_it(text: str, colour: Colour | None) -> None:
    assert colour_from(text) == colour


@pytest.mark.parametrize(
    "text", ["", "purple", "#12345", "#12345g", "ff8000", "1,2,3", "-0.1,0,0", "nan,0,0", "0,0", "0,0,0,0", "a,b,c"]
)
def test_what_is_no_colour_is_refused_with_what_is(text: str) -> None:
    with pytest.raises(ColourUnknown, match="there is black, red, blue, green, yellow, none, #rrggbb, or r,g,b"):
        colour_from(text)


def test_a_misspelt_colour_gets_the_near_one() -> None:
    with pytest.raises(ColourUnknown, match="near: 'yellow'"):
        colour_from("yelow")


@given(st.tuples(*(st.integers(0, 255).map(lambda part: part / 255) for _ in range(3))))
def test_a_colour_that_is_written_is_read_again(colour: Colour) -> None:
    assert colour_from(colour_text(colour)) == colour


def test_a_known_colour_is_called_by_its_name() -> None:
    assert colour_text(COLOURS["green"]) == "green"
    assert colour_text((2.0, -1.0, 0.5)) == "#ff0080"
