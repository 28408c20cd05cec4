"""Standard input as a map, and standard output that cannot be written."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from mindstage.maps import bundled_kitchen

MINDSTAGE = [sys.executable, "-m", "mindstage"]
TIMEOUT_S = 120.0


def run(
    *arguments: str, typed: bytes | None = None, stdout: int = subprocess.PIPE
) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [*MINDSTAGE, *arguments], input=typed, stdout=stdout, stderr=subprocess.PIPE, timeout=TIMEOUT_S, check=False
    )


@pytest.mark.parametrize("name", ["-", "/dev/stdin"])
def test_a_map_is_read_from_a_pipe(name: str) -> None:
    if not Path("/dev/stdin").exists():
        pytest.skip("the system has no /dev/stdin")
    done = run("analyze", name, "--json", typed=bundled_kitchen().read_bytes())
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["objects"] == 254


def test_a_piped_map_may_be_turtle_and_be_compared_and_converted(tmp_path: Path) -> None:
    out = tmp_path / "kitchen.ttl"
    assert run("convert", "-", str(out), typed=bundled_kitchen().read_bytes()).returncode == 0
    compared = run("compare", "-", str(bundled_kitchen()), "--json", typed=out.read_bytes())
    assert compared.returncode == 0, compared.stderr
    assert json.loads(compared.stdout)["identical"] is True


@pytest.mark.parametrize(("typed", "message"), [(b"", b"nothing was written to it"), (b"hello", b"indicate a format")])
def test_input_that_is_no_map_is_an_error(typed: bytes, message: bytes) -> None:
    done = run("validate", "-", typed=typed)
    assert done.returncode == 2
    assert message in done.stderr
    assert b"Traceback" not in done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
@pytest.mark.parametrize(
    "arguments",
    [
        ("questions", "--json"),
        ("questions",),
        ("--help",),
        ("--version",),
        ("sparql", "ASK {}", "--json"),
        ("validate", "bundled:kitchen", "--json"),
        ("compare", "bundled:kitchen", "bundled:kitchen"),
    ],
)
def test_a_full_disk_behind_standard_output_is_an_error_without_traceback(arguments: tuple[str, ...]) -> None:
    with Path("/dev/full").open("wb") as full:
        done = run(*arguments, stdout=full.fileno())
    assert done.returncode == 2
    assert done.stderr == b"mindstage: error: standard output cannot be written: No space left on device\n"


def test_an_error_is_reported_even_if_its_json_cannot_be_written() -> None:
    if not Path("/dev/full").exists():
        pytest.skip("the system has no /dev/full")
    with Path("/dev/full").open("wb") as full:
        done = run("sparql", "ASK {", "--json", stdout=full.fileno())
    assert done.returncode == 2
    assert done.stderr.startswith(b"mindstage: error: the query cannot be answered")
    assert b"Traceback" not in done.stderr


def test_a_reader_that_closes_the_pipe_causes_no_traceback() -> None:
    with subprocess.Popen(
        [*MINDSTAGE, "questions", "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(TIMEOUT_S) == 141
