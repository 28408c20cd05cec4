"""Access to the page that a command serves."""

from __future__ import annotations

import json
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

from tests.cli.runner import Run

TIMEOUT_S = 120.0


@pytest.mark.parametrize("verb", [("demo",), ("spawn", "bundled:kitchen")])
def test_a_public_page_requires_a_token_before_the_map_is_read(run: Run, verb: tuple[str, ...]) -> None:
    result = run(*verb, "--host", "0.0.0.0", "--for", "0")
    assert result.exit_code == 2
    assert "--host" in result.stderr
    assert "--token" in result.stderr
    assert result.stdout == ""


def test_a_page_with_a_token_rejects_requests_without_it() -> None:
    command = [sys.executable, "-m", "mindstage", "spawn", "bundled:kitchen", "--primitive-shapes", "--json"]
    command += ["--host", "0.0.0.0", "--token", "sesame", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            url = ""
            text = ""
            for line in process.stdout:
                text += line
                try:
                    url = json.loads(text)["url"]
                except json.JSONDecodeError:
                    continue
                break
            with pytest.raises(urllib.error.HTTPError) as error:
                urllib.request.urlopen(url, timeout=TIMEOUT_S)
            assert error.value.code == 401
            request = urllib.request.Request(url, headers={"Authorization": "Bearer sesame"})
            with urllib.request.urlopen(request, timeout=TIMEOUT_S) as page:
                assert b"Mindstage" in page.read()
        finally:
            process.terminate()
            process.wait(TIMEOUT_S)
