"""The bridge: service calls of roslibpy clients, compared with a bare websockets server that sends the same response.

The clients, the server and a roslibpy service provider are separate processes on the loopback interface, with JSON.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from statistics import median, quantiles
from typing import Any, NamedTuple

import roslibpy
import websockets
from websockets.asyncio.server import ServerConnection, serve

from benchmarks import Measure
from mindstage.access.limits import BridgeLimits
from mindstage.bridge import LocalNode, RosbridgeServer

_BARE = f"a bare websockets {websockets.__version__} server"
_ROUNDS = 5
_CALLS = 1500
_POSE = {"position": {"x": 1.25, "y": -2.5, "z": 0.8125}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.6, "w": 0.8}}
_ANSWERS: dict[str, dict[str, Any]] = {
    "/get_model_pose": {"pose": _POSE, "success": True},
    "/kitchen": {"models": [{"id": f"body_{number}", "pose": _POSE, "tags": []} for number in range(700)]},
}
"""Responses by service: a pose, and one of about the size of a kitchen."""


class _Calls(NamedTuple):
    """Times of calls [us]."""

    each: float
    """Total time divided by the number of calls."""
    p50: float
    p99: float


def measure() -> Iterator[Measure]:
    with ExitStack() as stack:
        bare = stack.enter_context(_process("bare"))
        node = stack.enter_context(_process("node"))
        stack.enter_context(_process("provider", str(node)))
        for service, clients in (("/get_model_pose", 1), ("/get_model_pose", 50), ("/kitchen", 1)):
            calls = _CALLS if service == "/get_model_pose" else _CALLS // 10
            targets = [(bare, service), (node, service), (node, "/provider" + service)]
            theirs, ours, provided = _alternating(targets, clients=clients, calls=calls)
            what = f"{service}, {clients} roslibpy client{'s' if clients > 1 else ''}"
            # For one client the aim applies to the median, since single delays dominate the mean on a loaded machine.
            one = clients == 1
            yield Measure(
                what=f"a call of {what}", ours=ours.each, unit="us", peer=_BARE, theirs=theirs.each,
                at_most=None if one else 2.0,
            )  # fmt: skip
            yield Measure(
                what="… p50", ours=ours.p50, unit="us", peer=_BARE, theirs=theirs.p50, at_most=2.0 if one else None
            )
            yield Measure(what="… p99", ours=ours.p99, unit="us", peer=_BARE, theirs=theirs.p99)
            yield Measure(
                what="… by a roslibpy provider", ours=provided.each, unit="us", peer=_BARE, theirs=theirs.each
            )
            yield Measure(what="… p99", ours=provided.p99, unit="us", peer=_BARE, theirs=theirs.p99)


def _alternating(targets: list[tuple[int, str]], *, clients: int, calls: int) -> list[_Calls]:
    """The medians of each target; they alternate, so that other load affects all equally."""
    taken: list[list[_Calls]] = [[] for _ in targets]
    for _ in range(_ROUNDS):
        for (port, service), rounds in zip(targets, taken, strict=True):
            rounds.append(_call(port, service, clients=clients, calls=calls))
    return [_Calls(*(median(each[field] for each in rounds) for field in range(3))) for rounds in taken]


def _call(port: int, service: str, *, clients: int, calls: int) -> _Calls:
    """Makes `calls` calls in total; each client makes its next call after the previous response."""
    connections = [roslibpy.Ros("127.0.0.1", port, transport="asyncio") for _ in range(clients)]
    for each in connections:
        each.run()
    latencies: list[float] = []
    done = threading.Semaphore(0)

    def begin(proxy: roslibpy.Service, left: int) -> None:
        start = time.perf_counter()

        def on_response(_: object) -> None:
            latencies.append(time.perf_counter() - start)
            if left > 1:
                begin(proxy, left - 1)
            else:
                done.release()

        def on_error(error: object) -> None:
            raise RuntimeError(f"{service} failed: {error}")

        proxy.call(roslibpy.ServiceRequest({"id": "cup"}), on_response, on_error)

    start = time.perf_counter()
    for each in connections:
        begin(roslibpy.Service(each, service, "x/X"), calls // clients)
    for _ in connections:
        if not done.acquire(timeout=120.0):
            raise TimeoutError(f"{service} did not answer")
    seconds = time.perf_counter() - start
    for each in connections:
        each.close()
    cuts = quantiles(latencies, n=100)
    return _Calls(1e6 * seconds / len(latencies), 1e6 * cuts[49], 1e6 * cuts[98])


# -- the other processes -----------------------------------------------------------------------------------------------


@contextmanager
def _process(*role: str) -> Iterator[int]:
    """Runs a process of this module; yields its port."""
    command = [sys.executable, "-m", "benchmarks.bridge", *role]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            yield int(process.stdout.readline())
        finally:
            process.stdin.close()
            process.wait(20.0)


def _run_role(role: str, *rest: str) -> None:
    """Runs a role until stdin is closed."""
    if role == "node":
        _run_node()
    elif role == "provider":
        _run_provider(int(rest[0]))
    else:
        asyncio.run(_run_bare())


def _run_node() -> None:
    with LocalNode(limits=BridgeLimits()) as node, RosbridgeServer(node, port=0) as server:
        for service, answer in _ANSWERS.items():
            node.create_service(service, "x/X", _handler(answer))
        print(server.port, flush=True)
        sys.stdin.read()


def _handler(answer: dict[str, Any]) -> Any:
    async def handler(_: object) -> dict[str, Any]:
        return answer

    return handler


def _run_provider(port: int) -> None:
    ros = roslibpy.Ros("127.0.0.1", port, transport="asyncio")
    ros.run()
    for service, answer in _ANSWERS.items():

        def handler(_: Any, response: Any, answer: dict[str, Any] = answer) -> bool:
            response.update(answer)
            return True

        roslibpy.Service(ros, "/provider" + service, "x/X").advertise(handler)
    time.sleep(0.5)
    print(port, flush=True)
    sys.stdin.read()
    ros.close()


async def _run_bare() -> None:
    async def answer(connection: ServerConnection) -> None:
        async for frame in connection:
            call = json.loads(frame)
            service = call["service"]
            values = _ANSWERS[service]
            response = {
                "op": "service_response",
                "id": call["id"],
                "service": service,
                "values": values,
                "result": True,
            }
            await connection.send(json.dumps(response))

    async with serve(answer, "127.0.0.1", 0, compression=None, max_size=None) as server:
        print(next(iter(server.sockets)).getsockname()[1], flush=True)
        await asyncio.to_thread(sys.stdin.read)


if __name__ == "__main__":
    _run_role(*sys.argv[1:])
