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
from collections.abc import Callable, Iterator, Sequence
from enum import StrEnum
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

THINGS = (
    *("fridge", "table", "oven", "dishwasher", "counter_left", "milk_carton_1", "plate_3", "fridge_door"),
    *("drawer_left_1", "sink", "counter_right", "cereal_box_1"),
)
QUESTIONS: Sequence[Callable[[str, str], tuple[str, dict[str, str]]]] = (
    lambda thing, _: ("where_is", {"thing": thing}),
    lambda _, __: ("storage_place_in_environment", {"item": "CowsMilk"}),
    lambda _, __: ("articulated_parts", {}),
    lambda thing, other: ("path", {"start": thing, "goal": other}),
    lambda _, __: ("where_is", {}),
    lambda thing, _: ("nearest", {"thing": thing}),
    lambda thing, other: ("distance", {"thing": thing, "other": other}),
    lambda _, __: ("how_many", {"cls": "Cupboard"}),
    lambda thing, _: ("what_is", {"individual": thing}),
    lambda thing, _: ("in_room", {"thing": thing}),
)
"""Questions about the state and about the maps, asked in turn about pairs of things."""


class World(StrEnum):
    """What the world does meanwhile."""

    PAUSED = "paused"
    PLAYING = "playing"
    MOVED = "playing, a body is moved 10 times per second"


def measure() -> Iterator[Measure]:
    for world in World:
        with serving("bundled:kitchen", *(("--paused",) if world is World.PAUSED else ())) as port:
            url = f"ws://127.0.0.1:{port}"
            _run(url, WARM_UP_S, world)
            asked, read = _run(url, RUN_S, world)
        asks, reads = [each for times in asked for each in times], [each for times in read for each in times]
        means = [mean(times) for times in asked]
        what = f"{CLIENTS} clients ask and {CLIENTS} read, {world}"
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


def _run(url: str, duration_s: float, world: World) -> tuple[list[list[float]], list[list[float]]]:
    """The times of the calls of each asking and of each reading client [s]."""
    command = [sys.executable, "-m", __name__, url, str(duration_s)]
    kinds = ("ask", "read", *(("move",) if world is World.MOVED else ()))
    processes = [subprocess.Popen([*command, kind], stdout=subprocess.PIPE, text=True) for kind in kinds]
    try:
        outputs = [process.communicate(timeout=duration_s + 120.0)[0] for process in processes]
    finally:
        for process in processes:
            process.kill()
    asked, read = (json.loads(output) for output in outputs[:2])
    return asked, read


# -- clients -----------------------------------------------------------------------------------------------------------


async def _clients(url: str, duration_s: float, kind: str) -> list[list[float]]:
    end_s = time.perf_counter() + duration_s
    if kind == "move":
        return [await _client(url, end_s, _move, pause_s=0.1)]
    make = _question if kind == "ask" else lambda _: POSE
    return list(await asyncio.gather(*(_client(url, end_s, make, first=number) for number in range(CLIENTS))))


async def _client(
    url: str, end_s: float, make: Callable[[int], dict[str, Any]], *, first: int = 0, pause_s: float = 0.0
) -> list[float]:
    times: list[float] = []
    async with connect(url, compression=None, max_size=None, open_timeout=60, ping_interval=None) as socket:
        for turn in count(first):
            start_s = time.perf_counter()
            if start_s >= end_s:
                return times
            await socket.send(json.dumps(make(turn)))
            response: dict[str, Any] = json.loads(await socket.recv())
            assert response["result"], response
            times.append(time.perf_counter() - start_s)
            await asyncio.sleep(pause_s)
    return times


def _question(turn: int) -> dict[str, Any]:
    thing, other = THINGS[turn % len(THINGS)], THINGS[turn // 2 % len(THINGS) - 1]
    question, args = QUESTIONS[turn % len(QUESTIONS)](thing, other)
    call = {"question": question, "args": json.dumps(args)}
    return {"op": "call_service", "service": "/mindstage/ask", "timeout": 60, "args": call}


def _move(turn: int) -> dict[str, Any]:
    position, quaternion = (
        {"x": 1.0 + 0.01 * (turn % 100), "y": 0.0, "z": 1.5},
        {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    )
    args = {"id": "milk_carton_1", "pose": {"position": position, "orientation": quaternion}}
    return {"op": "call_service", "service": "/unreal/set_model_pose", "args": args}


if __name__ == "__main__":
    print(json.dumps(asyncio.run(_clients(sys.argv[1], float(sys.argv[2]), sys.argv[3]))))
