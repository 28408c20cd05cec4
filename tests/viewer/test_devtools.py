"""The DevTools pipe, tested with a program that sends malformed, late and partial messages."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mindstage.errors import BrowserCrashedError
from mindstage.viewer.devtools import CdpPipe

PATIENCE_S = 60.0
"""Time limit of commands that are expected to succeed [s]."""
HEAD = """
import json, os, sys, time
def ask():
    data = b""
    while not data.endswith(b"\\0"):
        piece = os.read(3, 1 << 16)
        if not piece:
            sys.exit(0)
        data += piece
    return json.loads(data[:-1])
def say(text, step=1 << 20):
    data = text.encode() + b"\\0"
    while data:
        data = data[os.write(4, data[:step]):]
def answer(asked, **result):
    say(json.dumps({"id": asked["id"], "result": result}))
"""

Start = Callable[[str], CdpPipe]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Starts a program that uses `ask`, `say` and `answer`."""
    started: list[CdpPipe] = []

    def run(body: str) -> CdpPipe:
        path = tmp_path / "fake-browser"
        path.write_text(f"#!{sys.executable}\n{HEAD}{body}")
        path.chmod(0o755)
        started.append(CdpPipe(path, [], folder=tmp_path))
        started[-1].start()
        return started[-1]

    yield run
    for each in started:
        each.close()


def test_a_reply_may_come_byte_by_byte(start: Start) -> None:
    devtools = start("""
asked = ask()
say(json.dumps({"id": asked["id"], "result": {"title": "né", "asked": asked}}), step=1)
""")
    result = devtools.send("Page.title", {"of": 1}, session="S", timeout_s=PATIENCE_S)
    assert result["title"] == "né"
    assert result["asked"] == {"id": 1, "method": "Page.title", "params": {"of": 1}, "sessionId": "S"}


def test_events_and_late_replies_are_ignored(start: Start) -> None:
    devtools = start("""
first = ask()
say(json.dumps({"method": "Page.loaded", "params": {}}) + "\\0" + json.dumps({"id": first["id"], "result": {"n": 1}})
    + "\\0" + json.dumps({"method": "Page.fired"}))
second = ask()
say(json.dumps({"id": first["id"], "result": {"n": "late"}}))
answer(second, n=2)
""")
    assert devtools.send("A", timeout_s=PATIENCE_S) == {"n": 1}
    assert devtools.send("B", timeout_s=PATIENCE_S) == {"n": 2}


def test_messages_larger_than_a_pipe_go_both_ways(start: Start) -> None:
    devtools = start("asked = ask()\nanswer(asked, text=asked['params']['text'])")
    text = "x" * 3_000_000
    assert devtools.send("Echo", {"text": text}, timeout_s=PATIENCE_S) == {"text": text}


def test_an_error_is_raised_with_its_message(start: Start) -> None:
    devtools = start("""
say(json.dumps({"id": ask()["id"], "error": {"code": -32601, "message": "'Page.fly' was not found"}}))
say(json.dumps({"id": ask()["id"], "error": {}}))
answer(ask(), fine=True)
""")
    with pytest.raises(BrowserCrashedError, match=r"refuses Page.fly: 'Page.fly' was not found"):
        devtools.send("Page.fly", timeout_s=PATIENCE_S)
    with pytest.raises(BrowserCrashedError, match=r"refuses Page.fly: no reason given"):
        devtools.send("Page.fly", timeout_s=PATIENCE_S)
    assert devtools.send("Page.walk", timeout_s=PATIENCE_S) == {"fine": True}


@pytest.mark.parametrize("reply", ["not JSON", '{"id": "one"}', "[]"])
def test_an_invalid_reply_is_an_error(start: Start, reply: str) -> None:
    devtools = start(f"ask()\nsay({reply!r})")
    with pytest.raises(BrowserCrashedError, match="its reply is not valid"):
        devtools.send("A", timeout_s=PATIENCE_S)


def test_no_reply_ends_in_time_and_the_process_is_killed(start: Start, tmp_path: Path) -> None:
    note = f"open({str(tmp_path / 'asked')!r}, 'w').close()"
    devtools = start(f"answer(ask())\nask()\nos.write(4, b'{{')\nask()\n{note}\ntime.sleep(1000)")
    devtools.send("Start", timeout_s=PATIENCE_S)
    with pytest.raises(BrowserCrashedError, match=r"did not answer A within 0\.2 s"):
        devtools.send("A", timeout_s=0.2)
    assert not devtools.has_exited
    devtools.close()
    assert devtools.has_exited
    assert not (tmp_path / "asked").exists(), "a process that does not reply was asked to close"


def test_a_process_that_does_not_read_cannot_block_the_caller(start: Start) -> None:
    devtools = start("answer(ask())\ntime.sleep(1000)")
    devtools.send("Start", timeout_s=PATIENCE_S)
    with pytest.raises(BrowserCrashedError, match=r"did not answer A within 0\.2 s"):
        devtools.send("A", {"text": "x" * 3_000_000}, timeout_s=0.2)


@pytest.mark.parametrize("before", ["", "os.write(4, b'{')\n"])
def test_a_crash_is_noticed_at_once_with_the_last_line_of_the_log(start: Start, before: str) -> None:
    devtools = start(f"ask()\n{before}print('first\\nout of memory\\n', file=sys.stderr)\nsys.exit(1)")
    with pytest.raises(BrowserCrashedError, match="it has ended: out of memory"):
        devtools.send("A", timeout_s=PATIENCE_S)
    assert devtools.has_exited
    with pytest.raises(BrowserCrashedError, match="it has ended: out of memory"):
        devtools.send("B", timeout_s=PATIENCE_S)


def test_closing_asks_first_and_twice_is_harmless(start: Start, tmp_path: Path) -> None:
    devtools = start(f"""
asked = ask()
open({str(tmp_path / "asked")!r}, "w").write(asked["method"])
answer(asked)
""")
    devtools.close()
    devtools.close()
    assert (tmp_path / "asked").read_text() == "Browser.close"
    assert devtools.has_exited
    with pytest.raises(BrowserCrashedError, match="it was closed"):
        devtools.send("A", timeout_s=PATIENCE_S)


def test_no_file_stays_open(start: Start) -> None:
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else None
    devtools = start("answer(ask())")
    devtools.send("A", timeout_s=PATIENCE_S)
    devtools.close()
    if before is not None:
        assert len(os.listdir("/proc/self/fd")) == before


def test_a_signal_during_the_start_is_handled_when_the_process_can_be_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "fake-browser"
    program.write_text(f"#!{sys.executable}\nimport time\ntime.sleep(60)\n")
    program.chmod(0o755)
    devtools = CdpPipe(program, [], folder=tmp_path)
    popen = subprocess.Popen

    def interrupted(*args: Any, **kwargs: Any) -> Any:
        process = popen(*args, **kwargs)
        os.kill(os.getpid(), signal.SIGINT)
        return process

    monkeypatch.setattr(subprocess, "Popen", interrupted)
    with pytest.raises(KeyboardInterrupt):
        devtools.start()
    assert not devtools.has_exited
    devtools.close()
    assert devtools.has_exited
