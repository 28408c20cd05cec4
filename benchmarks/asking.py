"""50 clients that ask in a closed loop, while 50 others read: waiting times, and how evenly they are shared.

Each client sends its next call after the response to the previous one. The clients are in two processes of their own,
so that the asking ones do not delay the reading ones; with the server and its processes they share the cores.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from itertools import count
from statistics import mean, median
from typing import Any

from websockets.asyncio.client import connect

from benchmarks import Measure
from benchmarks.ros import POSE, p99, serving

CLIENTS = 50
RUN_S = 20.0
WARM_UP_S = 5.0
ASK_P99_S = 2.0
READ_P99_S = 1.0
FAIRNESS = 3.0

QUESTIONS: Sequence[tuple[str, dict[str, str]]] = (
    ("where_is", {"thing": "milk_carton_1"}),
    ("storage_place_in_environment", {"item": "CowsMilk"}),
    ("openings", {}),
    ("path", {"start": "fridge", "goal": "table"}),
    ("where_is", {}),
    ("storage_place", {"item": "Plate"}),
    ("how_many", {"cls": "Cupboard"}),
    ("handle_of", {"individual": "fridge_door"}),
)
"""Questions about the state and about the maps, asked in turn."""


def measure() -> Iterator[Measure]:
    for is_playing in (False, True):
        with serving("bundled:kitchen", *(() if is_playing else ("--paused",))) as port:
            url = f"ws://127.0.0.1:{port}"
            _run(url, WARM_UP_S)
            asked, read = _run(url, RUN_S)
        state = "playing" if is_playing else "paused"
        asks, reads = [each for times in asked for each in times], [each for times in read for each in times]
        means = [mean(times) for times in asked]
        what = f"{CLIENTS} clients ask and {CLIENTS} read, {state}"
        yield Measure(what=f"{what}: ask, p50 ({len(asks) / RUN_S:,.0f} per second)", ours=median(asks))
        yield Measure(what=f"{what}: ask, p99", ours=p99(asks), at_most=ASK_P99_S)
        yield Measure(what=f"{what}: read, p50 ({len(reads) / RUN_S:,.0f} per second)", ours=median(reads))
        yield Measure(what=f"{what}: read, p99", ours=p99(reads), at_most=READ_P99_S)
        yield Measure(
            what=f"{what}: mean of the slowest asking client",
            ours=max(means),
            peer="the fastest one",
            theirs=min(means),
            at_most=FAIRNESS,
        )


def _run(url: str, duration_s: float) -> tuple[list[list[float]], list[list[float]]]:
    """The times of the calls of each asking and of each reading client [s]."""
    command = [sys.executable, "-m", __name__, url, str(duration_s)]
    processes = [subprocess.Popen([*command, kind], stdout=subprocess.PIPE, text=True) for kind in ("ask", "read")]
    try:
        outputs = [process.communicate(timeout=duration_s + 120.0)[0] for process in processes]
    finally:
        for process in processes:
            process.kill()
    asked, read = (json.loads(output) for output in outputs)
    return asked, read


async def _clients(url: str, duration_s: float, kind: str) -> list[list[float]]:
    end_s = time.perf_counter() + duration_s
    return list(await asyncio.gather(*(_client(url, end_s, kind, number) for number in range(CLIENTS))))


async def _client(url: str, end_s: float, kind: str, number: int) -> list[float]:
    times: list[float] = []
    async with connect(url, compression=None, max_size=None, open_timeout=60, ping_interval=None) as socket:
        for turn in count(number):
            start_s = time.perf_counter()
            if start_s >= end_s:
                return times
            await socket.send(json.dumps(_question(turn) if kind == "ask" else POSE))
            response: dict[str, Any] = json.loads(await socket.recv())
            assert response["result"], response
            times.append(time.perf_counter() - start_s)
    return times


def _question(turn: int) -> dict[str, Any]:
    question, args = QUESTIONS[turn % len(QUESTIONS)]
    call = {"question": question, "args": json.dumps(args)}
    return {"op": "call_service", "service": "/mindstage/ask", "timeout": 60, "args": call}


if __name__ == "__main__":
    print(json.dumps(asyncio.run(_clients(sys.argv[1], float(sys.argv[2]), sys.argv[3]))))
