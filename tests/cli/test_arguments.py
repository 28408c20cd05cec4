"""Positional arguments that begin with a minus, among options."""

from __future__ import annotations

from typing import Annotated, Any

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from mindstage.cli.options import VerbCommand
from tests.cli.runner import Run, json_output

KITCHEN = ("--map", "bundled:kitchen")


@pytest.mark.parametrize("tolerance", ["-1", "-0.5", "-1e-3"])
def test_negative_numbers_are_arguments_of_a_question(run: Run, tolerance: str) -> None:
    result = run("ask", "identical_maps", "kitchen", "kitchen", tolerance, *KITCHEN)
    assert result.exit_code == 2
    assert f"tolerance {float(tolerance)}: it must be a finite number at least 0" in result.stderr
    between = json_output(run("ask", "identical_maps", *KITCHEN, "kitchen", "--json", "kitchen", tolerance))
    assert f"tolerance {float(tolerance)}: it must be a finite number at least 0" in between["error"]["message"]


def test_an_unknown_option_is_an_error_beside_negative_numbers_too(run: Run) -> None:
    result = run("ask", "identical_maps", "kitchen", "kitchen", "-1", "--mapp", "bundled:kitchen")
    assert result.exit_code == 2
    assert "No such option: --mapp" in result.output


_numbers = st.one_of(st.integers(-1000, 1000), st.floats(-1e9, 1e9)).map(str)
_words = st.sampled_from(["milk", "a b", "ros://x", "1", "."])
_options = st.sampled_from([["--flag"], ["--no-page"], ["--name", "-3"], ["--name=-3"], ["-n", "x"], ["-n-3"]])


@given(
    st.lists(
        st.one_of(
            _numbers.map(lambda text: ([text], True)),
            _words.map(lambda text: ([text], True)),
            _options.map(lambda args: (args, False)),
        ),
        max_size=8,
    ),
    st.booleans(),
)
def test_positional_arguments_keep_their_order_among_options(parts: list[tuple[list[str], bool]], ended: bool) -> None:
    app, seen = typer.Typer(), dict[str, Any]()

    def verb(
        args: Annotated[list[str] | None, typer.Argument()] = None,
        *,
        flag: Annotated[bool, typer.Option("--flag")] = False,
        page: Annotated[bool, typer.Option("--page/--no-page")] = True,
        name: Annotated[list[str] | None, typer.Option("--name", "-n")] = None,
    ) -> None:
        seen.update(args=args or [], flag=flag, page=page, name=name or [])

    app.command(cls=VerbCommand)(verb)
    given_args = [arg for args, _ in parts for arg in args]
    result = CliRunner().invoke(app, [*given_args, *(["--", "--flag", "-4"] if ended else [])])
    assert result.exit_code == 0, result.output
    options = [args for args, is_positional in parts if not is_positional]
    assert seen["args"] == [args[0] for args, is_positional in parts if is_positional] + ["--flag", "-4"] * ended
    assert seen["flag"] is (["--flag"] in options)
    assert seen["page"] is (["--no-page"] not in options)
    assert len(seen["name"]) == sum(args[0].startswith(("--name", "-n")) for args in options)
