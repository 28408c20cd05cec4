"""Patterns: what POSIX means by an extended regular expression, quickly whatever it is."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.ros.simulation.patterns import Pattern, PatternRefused

PIECES = ("a", "b", ".", "[ab]", "[^a]", "(a|b)", "(ab)", "^", "$", "(a|)", "[[:digit:]]", r"\.", "()")
COUNTS = ("", "*", "+", "?", "{2}", "{1,}", "{0,2}")
TEXTS = ("", "a", "b", "ab", "ba", "aab", "abab", "a.b", "x1", "aaa", "bbb1")


@pytest.mark.parametrize(
    ("pattern", "text", "found"),
    [
        ("drawer", "sink_drawer_1", True),
        ("^drawer", "sink_drawer_1", False),
        ("^sink.*1$", "sink_drawer_1", True),
        ("(door|drawer)_handle$", "fridge_door_handle", True),
        ("[[:digit:]]{2}", "cup_12", True),
        ("[[:digit:]]{3}", "cup_12", False),
        ("[^a-z_]", "cup_a", False),
        ("[]x]", "]", True),
        ("[a-]", "-", True),
        (r"a\.b", "a.b", True),
        (r"a\.b", "axb", False),
        ("", "anything", True),
        ("é", "café", True),
        ("a||b", "zzz", True),
        ("(^a)|b$", "xxb", True),
    ],
)
def test_it_finds_what_posix_finds(pattern: str, text: str, found: bool) -> None:
    assert Pattern(pattern).found_in(text) is found


@pytest.mark.parametrize(
    "pattern",
    ["(", ")", "[", "[[:nope:]]", "a{2", "a{x}", "a{3,2}", "a{1000}", "*a", "+", "a|*", "\\", r"\d", "[z-a]", "[[.a.]]",
     "((a{200}){200}){200}", "(" * 5000],
)  # fmt: skip
def test_what_is_no_pattern_is_refused_in_words(pattern: str) -> None:
    with pytest.raises(PatternRefused, match="is no extended regular expression: "):
        Pattern(pattern)


def test_no_pattern_makes_it_think_for_long() -> None:
    """Python's own matcher needs longer than the universe for these."""
    assert not Pattern("(a+)+$").found_in("a" * 5000 + "b")
    assert not Pattern("(a|aa)*c").found_in("a" * 5000)
    assert Pattern("(a?){50}a{50}").found_in("a" * 50)


@given(st.lists(st.tuples(st.sampled_from(PIECES), st.sampled_from(COUNTS)), max_size=5), st.sampled_from(TEXTS))
def test_it_agrees_with_another_matcher(parts: list[tuple[str, str]], text: str) -> None:
    pattern = "".join(piece + ("" if piece in "^$" else count) for piece, count in parts)
    pythons = pattern.replace("[[:digit:]]", "[0-9]").replace("$", r"\Z")
    assert Pattern(pattern).found_in(text) is bool(re.search(pythons, text, re.DOTALL))


def test_it_agrees_with_grep() -> None:
    """POSIX's own words: where Python's and POSIX's patterns differ, this one is POSIX's."""
    grep = shutil.which("grep")
    if grep is None:
        pytest.skip("grep is not installed")
    for pattern in ("^(a|b)+$", "[[:alpha:]]_[[:digit:]]", "x{0}y", "[]a]+", "a.c", "[^]]"):
        lines = ["ab", "a_1", "y", "]a", "abc", "]", "xyz"]
        told = subprocess.run([grep, "-E", pattern], input="\n".join(lines), text=True, capture_output=True).stdout  # noqa: PLW1510
        assert told.split() == [line for line in lines if Pattern(pattern).found_in(line)], pattern
