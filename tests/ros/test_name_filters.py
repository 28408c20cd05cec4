"""Name filters: POSIX extended regular expressions, matched in linear time."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.ros.service import ResultError
from mindstage.ros.simulation_interfaces import name_matcher
from tests.cases import each_case

PIECES = ("a", "b", ".", "[ab]", "[^a]", "(a|b)", "(ab)", "^", "$", "(a|)", "[[:digit:]]", r"\.", "()")
COUNTS = ("", "*", "+", "?", "{2}", "{1,}", "{0,2}")
TEXTS = ("", "a", "b", "ab", "ba", "aab", "abab", "a.b", "x1", "aaa", "bbb1")


@each_case(
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
def test_name_matcher_finds_what_posix_finds(pattern: str, text: str, found: bool) -> None:
    assert name_matcher(pattern)(text) is found


@each_case(
    "pattern",
    ["(", ")", "[", "[[:nope:]]", "a{3,2}", "a{1001}", "*a", "+", "a|*", "\\", r"\d", "[z-a]", "[[.a.]]",
     "[x[=a=]]", "((a{200}){200}){200}", "(" * 5000, "a" * 5000, "(?i)a", "(?:a)", r"(a)\1", "\ud800"],
)  # fmt: skip
def test_invalid_patterns_are_rejected(pattern: str) -> None:
    with pytest.raises(ResultError, match="is not an extended regular expression: "):
        name_matcher(pattern)


@each_case(
    ("pattern", "text", "found"),
    [
        ("^a{2$", "a{2", True),  # POSIX leaves it undefined, GNU grep takes it literally too
        ("^a{x}$", "a{x}", True),
        ("^a{300}$", "a" * 300, True),  # POSIX asks for 255 at least
        (r"^[\]]$", "]", True),  # a backslash is a literal in POSIX's brackets
        ("[[:alpha:]]", "é", False),  # the classes of the POSIX locale
        ("^a$", "b\na", False),
        ("a.b", "a\nb", True),
    ],
)
def test_undefined_behavior_of_posix_is_as_in_re2(pattern: str, text: str, found: bool) -> None:
    assert name_matcher(pattern)(text) is found


def test_matching_takes_linear_time() -> None:
    """Python's `re` takes exponential time for these."""
    assert not name_matcher("(a+)+$")("a" * 5000 + "b")
    assert not name_matcher("((a?){50}){20}b")("a" * 2000)
    assert not name_matcher("(a|aa)*c")("a" * 5000)
    assert name_matcher("(a?){50}a{50}")("a" * 50)


@given(st.lists(st.tuples(st.sampled_from(PIECES), st.sampled_from(COUNTS)), max_size=5), st.sampled_from(TEXTS))
def test_name_matcher_agrees_with_python(parts: list[tuple[str, str]], text: str) -> None:
    pattern = "".join(atom + ("" if atom in "^$" else count) for atom, count in parts)
    pythons = pattern.replace("[[:digit:]]", "[0-9]").replace("$", r"\Z")
    assert name_matcher(pattern)(text) is bool(re.search(pythons, text, re.DOTALL))


def test_name_matcher_agrees_with_grep() -> None:
    """Compares with grep, since Python and POSIX differ in some patterns."""
    grep = shutil.which("grep")
    if grep is None:
        pytest.skip("grep is not installed")
    for pattern in ("^(a|b)+$", "[[:alpha:]]_[[:digit:]]", "x{0}y", "[]a]+", "a.c", "[^]]"):
        lines = ["ab", "a_1", "y", "]a", "abc", "]", "xyz"]
        matches = subprocess.run([grep, "-E", pattern], input="\n".join(lines), text=True, capture_output=True).stdout  # noqa: PLW1510
        assert matches.split() == [line for line in lines if name_matcher(pattern)(line)], pattern
