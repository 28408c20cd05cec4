"""A server under load: many spawns, one by one and in flight, and readers.

Spawns are compared with one call for the same models at a server of its own, which was just started. Each is timed
twice: until the last response, and until the physics engine has the models, which a call for the joint positions waits
for. Reads are compared with a bare websocket server; the rounds of both alternate, since other processes may run.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Awaitable, Callable, Iterator
from statistics import median
from typing import Any, NamedTuple

import websockets
from websockets.asyncio.client import connect

from benchmarks import Measure
from benchmarks.ros import CALLS, ECHO, POSE, call, once, p99, script, serving

ROUNDS = 3
READ_ROUNDS = 7
IN_FLIGHT = 200
READ_INTERVAL_S = 0.01


class Cost(NamedTuple):
    """The time that spawns take [s]."""

    answered_s: float
    """Until the last response."""
    simulated_s: float
    """Until the engine has a model with all of them."""
    reads_s: tuple[float, ...] = ()
    """The times of calls of another client meanwhile."""


Spawn = Callable[[Any, int], Awaitable[None]]


def measure() -> Iterator[Measure]:
    yield from reading()
    yield from spawning(100, "one after the other", one_by_one, at_most=5.0)
    yield from spawning(1000, f"{IN_FLIGHT} in flight", in_flight, at_most=3.0)


def reading() -> Iterator[Measure]:
    with serving("bundled:kitchen") as port:
        url = f"ws://127.0.0.1:{port}"
        answer = asyncio.run(once(url, POSE))
        with script(ECHO, answer) as echo_port:
            echo = f"ws://127.0.0.1:{echo_port}"
            for clients in (1, 10, 100):
                asyncio.run(call(url, clients, CALLS // 4))
                asyncio.run(call(echo, clients, CALLS // 4))
                pairs = [
                    tuple(1 / asyncio.run(call(each, clients, CALLS)).per_s for each in (url, echo))
                    for _ in range(READ_ROUNDS)
                ]
                ours, theirs = sorted(pairs, key=lambda pair: pair[0] / pair[1])[READ_ROUNDS // 2]
                yield Measure(
                    what=f"get_model_pose while playing, {clients} clients ({1 / ours:,.0f} and {1 / theirs:,.0f} Hz)",
                    ours=ours,
                    peer=f"websockets {websockets.__version__}, bare",
                    theirs=theirs,
                    at_least=0.7,
                )


def spawning(count: int, how: str, spawn: Spawn, *, at_most: float) -> Iterator[Measure]:
    ours, together = [], []
    for _ in range(ROUNDS):
        together.append(asyncio.run(timed(all_at_once, count)))
        ours.append(asyncio.run(timed(spawn, count)))
    what, peer = f"{count} spawn_model calls, {how}", f"one call for {count}"
    for name, index, aim in (("answered", 0, at_most), ("simulated", 1, at_most)):
        yield Measure(
            what=f"{what}, {name}",
            ours=median(each[index] for each in ours),
            peer=peer,
            theirs=median(each[index] for each in together),
            at_most=aim,
        )
    if count >= 1000:
        yield Measure(what=f"spawn_semantic_map of {count}", ours=max(each.answered_s for each in together), at_most=60)
        reads = [time_s for each in ours for time_s in each.reads_s]
        yield Measure(what="p99 of a reader meanwhile", ours=p99(reads))
        yield Measure(what="longest call of a reader meanwhile", ours=max(reads), at_most=1.0)


async def timed(spawn: Spawn, count: int) -> Cost:
    with serving("bundled:kitchen") as port:
        url = f"ws://127.0.0.1:{port}"
        async with connect(url, compression=None, max_size=None) as socket:
            await ask(socket, "mindstage/get_joint_positions", {})
            reads: list[float] = []
            reader = asyncio.create_task(read(url, reads))
            start = time.perf_counter()
            await spawn(socket, count)
            answered_s = time.perf_counter() - start
            await ask(socket, "mindstage/get_joint_positions", {})
            simulated_s = time.perf_counter() - start
            reader.cancel()
            await asyncio.gather(reader, return_exceptions=True)
    return Cost(answered_s, simulated_s, tuple(reads))


async def all_at_once(socket: Any, count: int) -> None:
    response = await ask(socket, "spawn_semantic_map", {"models": [model(number) for number in range(count)]})
    assert response["success"], response


async def one_by_one(socket: Any, count: int) -> None:
    for number in range(count):
        response = await ask(socket, "spawn_model", model(number))
        assert response["success"], response


async def in_flight(socket: Any, count: int) -> None:
    free = asyncio.Semaphore(IN_FLIGHT)

    async def receive() -> None:
        for number in range(count):
            response = json.loads(await socket.recv())
            assert response["id"] == number, "the responses are out of order"
            assert response["values"]["success"], response
            free.release()

    receiver = asyncio.create_task(receive())
    for number in range(count):
        await free.acquire()
        await socket.send(request("spawn_model", model(number), id=number))
    await receiver


async def read(url: str, times: list[float]) -> None:
    async with connect(url, compression=None) as socket:
        while True:
            start = time.perf_counter()
            await ask(socket, "get_model_pose", {"id": "fridge"})
            times.append(time.perf_counter() - start)
            await asyncio.sleep(READ_INTERVAL_S)


async def ask(socket: Any, service: str, args: dict[str, Any]) -> dict[str, Any]:
    await socket.send(request(service, args))
    response = json.loads(await socket.recv())
    assert response["result"], response
    values: dict[str, Any] = response["values"]
    return values


def request(service: str, args: dict[str, Any], *, id: int = 0) -> str:
    return json.dumps({"op": "call_service", "id": id, "service": f"/unreal/{service}", "args": args})


def model(number: int) -> dict[str, Any]:
    """A loose cube in a grid beside the kitchen."""
    position = {"x": 5.0 + 0.3 * (number % 32), "y": 0.3 * (number // 32), "z": 0.05}
    pose = {"position": position, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
    physics = {"mobility": 2, "gravity": True, "mass": 0.2}
    return {"id": f"cube{number}", "name": "Cube", "pose": pose, "physics_properties": physics}
