"""The examples in docs/how-to/prolog.md."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.prolog.test_cli import run

DOCS = Path(__file__).resolve().parents[2] / "docs" / "how-to"
PAGE = (DOCS / "prolog.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("page", "least"), [("prolog.md", 10), ("asking.md", 1)])
def test_sessions_in_the_documentation_print_what_they_show(page: str, least: int, prolog: Path) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    sessions = re.findall(r"^```prolog\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    asked = re.findall(r"^\?- (.*)$", "".join(sessions), re.MULTILINE)
    assert len(asked) >= least
    promised = re.sub(r"^\?- .*\n", "", "\n".join(sessions), flags=re.MULTILINE)
    printed = run("bundled:kitchen", typed="\n".join(asked) + "\n").stdout
    assert printed.strip() == promised.strip()


def test_python_examples_in_the_documentation_run(
    prolog: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_rules.pl").write_text("my_rule(1).\n", encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    exec(compile(code, "prolog.md", "exec"), {})


def test_the_documentation_lists_every_predicate_of_the_thesis(prolog: Path) -> None:
    done = run(
        "-g",
        "module_property(mindstage_veit2019_compat, exports(Names)), forall(member(Name/_, Names), (write(Name), nl))",
    )
    names = set(done.stdout.split())
    assert len(names) > 20
    assert not {name for name in names if not re.search(rf"`.*\b{name}\b.*`", PAGE)}
