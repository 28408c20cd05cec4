"""Tables on stdout: one that is written to a file without rich has the same text as rich's."""

from __future__ import annotations

import subprocess
import sys

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mindstage.cli import output
from mindstage.cli.output import Cell, print_table

Rows = list[list[Cell]]
cells = st.one_of(
    st.none(),
    st.integers(-1000, 1000),
    st.floats(allow_nan=False),
    st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=12),
    st.sampled_from(["[bold]x[/]", "a\tb", "two\nlines", ":smile:", "é", "日本", "x" * 90]),
)
tables = st.integers(1, 4).flatmap(
    lambda count: st.tuples(
        st.lists(st.sampled_from(["thing", "?x", "a b", "größe"]), min_size=count, max_size=count),
        st.lists(st.lists(cells, min_size=count, max_size=count), max_size=5),
    )
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150, deadline=None)
@given(tables)
def test_a_table_without_rich_has_the_same_text(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, table: tuple[list[str], Rows]
) -> None:
    columns, rows = table
    capsys.readouterr()
    print_table("", columns, rows)
    ours = capsys.readouterr().out
    with monkeypatch.context() as patch:
        patch.setattr(output, "_is_plain", lambda _: False)
        print_table("", columns, rows)
    assert ours == capsys.readouterr().out


@pytest.mark.parametrize(
    ("row", "plain"), [(["cup", 1.5], True), (["cup", None], True), (["日本", 1.5], False), (["x" * 170, 1], False)]
)
def test_only_simple_tables_are_written_without_rich(row: list[Cell], plain: bool) -> None:
    code = (
        "import sys\n"
        "from mindstage.cli.output import print_table\n"
        f"print_table('', ['thing', 'size'], [{row!r}])\n"
        "print('rich' in sys.modules, file=sys.stderr)"
    )
    result = subprocess.run([sys.executable, "-X", "utf8", "-c", code], capture_output=True, text=True, check=True)
    assert result.stderr.strip() == str(not plain)
    assert result.stdout.count("\n") >= 5


@pytest.mark.parametrize("name", ["FORCE_COLOR", "TTY_COMPATIBLE"])
def test_styles_that_are_asked_for_are_written(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(name, "1")
    assert not output._is_plain(["cup"])
