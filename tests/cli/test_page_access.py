"""Who may come to the page that a command serves."""

from __future__ import annotations

import json
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

from tests.cli.typed import Run

PATIENCE_S = 120.0


@pytest.mark.parametrize("verb", [("demo",), ("spawn", "bundled:kitchen")])
def test_a_page_for_others_needs_a_token_and_that_is_told_before_anything_is_read(
    run: Run, verb: tuple[str, ...]
) -> None:
    ended = run(*verb, "--host", "0.0.0.0", "--for", "0")
    assert ended.exit_code == 2
    assert "--host" in ended.stderr
    assert "--token" in ended.stderr
    assert ended.stdout == ""


def test_a_page_with_a_token_is_for_those_who_know_it() -> None:
    command = [sys.executable, "-m", "mindstage", "spawn", "bundled:kitchen", "--plain-boxes", "--json"]
    command += ["--host", "0.0.0.0", "--token", "sesame", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        try:
            assert running.stdout is not None
            url = ""
            text = ""
            for line in running.stdout:
                text += line
                try:
                    url = json.loads(text)["url"]
                except json.JSONDecodeError:
                    continue
                break
            with pytest.raises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(url, timeout=PATIENCE_S)
            assert refused.value.code == 401
            request = urllib.request.Request(url, headers={"Authorization": "Bearer sesame"})
            with urllib.request.urlopen(request, timeout=PATIENCE_S) as page:
                assert b"Mindstage" in page.read()
        finally:
            running.terminate()
            running.wait(PATIENCE_S)
