"""The headless browser: commands, and errors if it is missing or crashes."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from mindstage.errors import BrowserCrashedError, BrowserNotFoundError
from mindstage.viewer.screenshot import HeadlessBrowser, find_browser
from tests.viewer.waiting import wait_until


def program(folder: Path, *lines: str) -> Path:
    """An executable that is not a browser."""
    path = folder / "no-browser"
    path.write_text("\n".join(["#!/bin/sh", *lines, ""]))
    path.chmod(0o755)
    return path


def test_a_page_is_opened_evaluated_and_captured(chromium: Path) -> None:
    with HeadlessBrowser(chromium, size=(200, 100), timeout_s=120.0) as browser:
        browser.navigate("data:text/html,<title>Here</title><body style='background:red'>")
        wait_until(lambda: browser.evaluate("document.title") == "Here", "the page is loaded")
        assert browser.evaluate("[innerWidth, innerHeight]") == [200, 100]
        picture = browser.screenshot()
        assert picture.startswith(b"\x89PNG")
        assert int.from_bytes(picture[16:20], "big") == 200
        with pytest.raises(BrowserCrashedError, match=r"an error on the page: .*nothing is not defined"):
            browser.evaluate("nothing.at.all")
        with pytest.raises(BrowserCrashedError, match=r"refuses Page.fly"):
            browser._send_command("Page.fly")
        with pytest.raises(BrowserCrashedError, match="cannot open the page"):
            browser.navigate("http://127.0.0.1:1/")
        folder = browser._folder
    browser.close()
    assert not folder.exists()
    with pytest.raises(BrowserCrashedError, match="it was closed"):
        browser.screenshot()


def test_without_a_browser_the_error_names_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("mindstage.viewer.screenshot.BROWSERS", ("chromium", "google-chrome"))
    with pytest.raises(BrowserNotFoundError, match=r"install Chromium or Chrome.*searched for chromium, google-chrome"):
        find_browser()
    with pytest.raises(BrowserNotFoundError, match="there is no program 'netscape'"):
        find_browser("netscape")


def test_a_program_that_exits_at_once_is_reported_with_its_last_output(tmp_path: Path) -> None:
    sulking = program(tmp_path, "echo cannot open display >&2", "exit 3")
    with pytest.raises(BrowserNotFoundError, match=r"does not start: .*it has ended: cannot open display"):
        HeadlessBrowser(sulking, timeout_s=20.0)
    with pytest.raises(BrowserNotFoundError, match="does not start"):
        HeadlessBrowser(tmp_path / "none", timeout_s=20.0)


def test_a_program_that_never_answers_is_killed(tmp_path: Path) -> None:
    mute = program(tmp_path, f"echo $$ > {tmp_path / 'pid'}", "exec sleep 600")
    with pytest.raises(BrowserNotFoundError, match=r"did not answer Target.createTarget within 5 s"):
        HeadlessBrowser(mute, timeout_s=5.0)
    pid = int((tmp_path / "pid").read_text())
    end = time.monotonic() + 20.0
    while is_running(pid):
        assert time.monotonic() < end, "the process is still running"
        time.sleep(0.05)


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
