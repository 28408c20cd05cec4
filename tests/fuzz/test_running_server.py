"""A running server after random requests to all of its ports: it answers, and has done nothing that it must not."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fuzz.running_server import RunningServer, ServerFuzzer

SEED = int(os.environ.get("MINDSTAGE_FUZZ_SEED", "1"))
CI_S, SLOW_S = 30.0, 600.0
BOUND_S = 10.0
"""Longest time for an answer on a machine that does other things, too; the benchmark has the time on an idle one."""


@pytest.fixture
def server(tmp_path: Path) -> Iterator[RunningServer]:
    server = RunningServer(tmp_path)
    yield server
    server.stop()


def fuzz(server: RunningServer, seconds: float) -> None:
    fuzzer = ServerFuzzer(server, SEED)
    try:
        fuzzer.run(seconds)
    finally:
        fuzzer.close()
    times = server.measure()
    print(f"seed {SEED}: sent {fuzzer.sent}; answers after it [s]: {times}")
    server.check_intact()
    assert max(times.values()) < BOUND_S, times


def test_a_server_works_after_random_requests_at_all_ports(server: RunningServer) -> None:
    fuzz(server, CI_S)


@pytest.mark.slow
def test_a_server_works_after_ten_minutes_of_random_requests(server: RunningServer) -> None:
    fuzz(server, SLOW_S)


def test_what_the_server_must_not_do_is_noticed(server: RunningServer) -> None:
    server.check_intact()
    with (server.folder / "offences.txt").open("a") as file:
        file.write("socket.connect: 192.0.2.1\n")
    with pytest.raises(AssertionError, match=r"192\.0\.2\.1"):
        server.check_intact()
