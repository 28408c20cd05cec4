"""ROS services and topics over rosbridge, compared with a bare websocket server and with a roslibpy provider.

Servers, providers and clients are separate processes on the loopback interface. Each client makes its next call after
the previous response; rates are those of all clients together.
"""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from statistics import median, quantiles
from typing import Any, NamedTuple

import roslibpy
import websockets
from websockets.asyncio.client import connect

from benchmarks import Measure
from benchmarks.knowledge import BUNDLED
from mindstage.bridge.conversions_unreal import spawn_request
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import encode

ROUNDS = 3
CALLS = 2000
MANY = 50
SUBSCRIBERS = 10
LISTEN_S = 5.0
POSE = {"op": "call_service", "service": "/unreal/get_model_pose", "args": {"id": "fridge"}}

ECHO = """
import asyncio, sys
from websockets.asyncio.server import serve
answer = sys.argv[1]
async def echo(socket):
    async for message in socket:
        await socket.send(answer)
async def main():
    async with serve(echo, "127.0.0.1", 0, compression=None) as server:
        print(server.sockets[0].getsockname()[1], flush=True)
        await asyncio.Future()
asyncio.run(main())
"""
PROVIDER = """
import sys, time, roslibpy
ros = roslibpy.Ros("127.0.0.1", int(sys.argv[1]), transport="asyncio")
ros.run()
def answer(request, response):
    response.update(success=True, pose=%s)
    return True
roslibpy.Service(ros, "/provider/get_model_pose", "world_control_msgs/GetModelPose").advertise(answer)
print("ready", flush=True)
time.sleep(3600)
"""
SIMULATION = """
import sys, time
from msgspec.structs import replace
from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.maps import bundled_kitchen
from mindstage.ros import RosInterface
knowledge = KnowledgeBase()
knowledge.load(bundled_kitchen())
world = knowledge.world()
bodies = [replace(body, id=f"{body.id}-{copy}") for copy in range(2) for body in world.bodies][:500]
simulation = Simulation(knowledge, NullEngine())
with simulation, LocalNode() as node, RosbridgeServer(node, port=0) as server, RosInterface(simulation, node):
    simulation.spawn(replace(world, bodies=tuple(bodies), joints=(), attachments=()))
    simulation.play()
    print(server.port, flush=True)
    while True:
        time.sleep(1.0)
        print(time.process_time(), flush=True)
"""


class Calls(NamedTuple):
    """Rate and latency of calls."""

    per_s: float
    """Calls of all clients per second."""
    p50_s: float
    p99_s: float


def measure() -> Iterator[Measure]:
    with ExitStack() as stack:
        port = stack.enter_context(serving("bundled:kitchen", "--paused"))
        url = f"ws://127.0.0.1:{port}"
        answer = asyncio.run(once(url, POSE))
        echo = f"ws://127.0.0.1:{stack.enter_context(script(ECHO, answer))}"
        for clients in (1, MANY):
            ours, theirs = rounds(clients, url), rounds(clients, echo)
            of_clients = f"{clients} client{'s' if clients > 1 else ''}"
            peer = f"websockets {websockets.__version__}, bare"
            yield Measure(
                what=f"a call of get_model_pose, {of_clients} ({ours.per_s:,.0f} and {theirs.per_s:,.0f} per second)",
                ours=1 / ours.per_s,
                peer=peer,
                theirs=1 / theirs.per_s,
                at_most=2.0,
            )
            yield Measure(what=f"p50 of get_model_pose, {of_clients}", ours=ours.p50_s, peer=peer, theirs=theirs.p50_s)
            yield Measure(what=f"p99 of get_model_pose, {of_clients}", ours=ours.p99_s, peer=peer, theirs=theirs.p99_s)
        stack.enter_context(script(PROVIDER % json.loads(answer)["values"]["pose"], str(port)))
        yield from against_roslibpy(port)
    yield from spawning()
    yield from listening()


def against_roslibpy(port: int) -> Iterator[Measure]:
    """Calls of the same client to the simulation and, through the same server, to a roslibpy provider."""
    ros = roslibpy.Ros("127.0.0.1", port, transport="asyncio")
    ros.run()
    type = "world_control_msgs/GetModelPose"
    ours, theirs = (roslibpy.Service(ros, f"/{where}/get_model_pose", type) for where in ("unreal", "provider"))
    request = roslibpy.ServiceRequest({"id": "fridge"})
    times = [(timed(lambda: ours.call(request)), timed(lambda: theirs.call(request))) for _ in range(300)]
    ros.close()
    mine, other = zip(*times, strict=True)
    peer = f"roslibpy {roslibpy.__version__} provider"
    what = "a call of get_model_pose by roslibpy"
    yield Measure(what=f"{what}, p50", ours=median(mine), peer=peer, theirs=median(other), at_most=1.0)
    yield Measure(what=f"{what}, p99", ours=p99(mine), peer=peer, theirs=p99(other))


def spawning() -> Iterator[Measure]:
    with serving("--paused") as port:
        times = []
        for _ in range(2 * ROUNDS + 1):
            times.append(asyncio.run(spawn(f"ws://127.0.0.1:{port}", 1)).p50_s)
            asyncio.run(once(f"ws://127.0.0.1:{port}", {"op": "call_service", "service": "/unreal/unload_world"}))
        yield Measure(what="spawn the kitchen, 1 client, MuJoCo", ours=median(times), at_most=1.0)
    with serving("--paused", "--engine", "null") as port:
        calls = asyncio.run(spawn(f"ws://127.0.0.1:{port}", MANY))
        what = f"spawn a kitchen per client, {MANY} concurrent clients, no physics"
        yield Measure(what=f"{what}, p50", ours=calls.p50_s)
        yield Measure(what=f"{what}, p99", ours=calls.p99_s, at_most=10.0)


def listening() -> Iterator[Measure]:
    with script(SIMULATION) as port:
        counts, ordered = asyncio.run(listen(f"ws://127.0.0.1:{port}"))
    assert ordered, "transforms came out of order"
    what = f"/tf of 500 bodies at 30 Hz, {SUBSCRIBERS} subscribers: rate of the slowest"
    yield Measure(what=what, ours=min(counts), unit="Hz", at_least=28)


# -- processes -------------------------------------------------------------------------------------------------------


@contextmanager
def serving(*args: str) -> Iterator[int]:
    """Runs `mindstage serve`; yields its port."""
    command = [sys.executable, "-m", "mindstage", "serve", *args, "--port", "0"]
    with started(command) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if found := re.search(r"ws://127\.0\.0\.1:(\d+)", line):
                yield int(found[1])
                return
        raise RuntimeError("the server did not start")


@contextmanager
def script(text: str, *args: str) -> Iterator[int]:
    """Runs a script; yields the port that it prints, or 0."""
    with started([sys.executable, "-c", text, *args]) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        yield int(line) if line.strip().isdigit() else 0


@contextmanager
def started(command: list[str]) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


# -- clients ---------------------------------------------------------------------------------------------------------


def rounds(clients: int, url: str) -> Calls:
    """The medians of several rounds, after a warm-up round."""
    asyncio.run(call(url, clients, CALLS // 4))
    results = [asyncio.run(call(url, clients, CALLS)) for _ in range(ROUNDS)]
    return Calls(*(median(each) for each in zip(*results, strict=True)))


async def call(url: str, clients: int, calls: int) -> Calls:
    text = json.dumps(POSE)
    sockets = [await connect(url, compression=None) for _ in range(clients)]
    times: list[float] = []

    async def work(socket: Any) -> None:
        for _ in range(calls // clients):
            start = time.perf_counter()
            await socket.send(text)
            await socket.recv()
            times.append(time.perf_counter() - start)

    start = time.perf_counter()
    await asyncio.gather(*(work(socket) for socket in sockets))
    wall_s = time.perf_counter() - start
    for socket in sockets:
        await socket.close()
    return Calls(len(times) / wall_s, median(times), p99(times))


async def once(url: str, message: dict[str, Any]) -> str:
    async with connect(url, compression=None, max_size=None) as socket:
        await socket.send(json.dumps(message))
        return str(await socket.recv())


async def spawn(url: str, clients: int) -> Calls:
    knowledge = KnowledgeBase()
    knowledge.load(BUNDLED / "kitchen.owl")
    request = json.dumps(encode(spawn_request(knowledge.world())))
    times: list[float] = []

    async def work(number: int) -> None:
        own = re.sub(r'("(?:id|id_first_model|id_second_model|parent_id|child_id)": ")', rf"\g<1>{number}-", request)
        message = f'{{"op": "call_service", "service": "/unreal/spawn_semantic_map", "timeout": 60, "args": {own}}}'
        async with connect(url, compression=None, max_size=None) as socket:
            start = time.perf_counter()
            await socket.send(message)
            answer = json.loads(await socket.recv())
            times.append(time.perf_counter() - start)
            assert answer["values"]["success"], str(answer)[:500]

    start = time.perf_counter()
    await asyncio.gather(*(work(number) for number in range(clients)))
    return Calls(clients / (time.perf_counter() - start), median(times), p99(times))


async def listen(url: str) -> tuple[list[float], bool]:
    """The message rate of each subscriber [Hz], and whether all messages arrived in order."""
    rates: list[float] = []
    ordered: list[bool] = []

    async def work() -> None:
        async with connect(url, compression=None, max_size=None) as socket:
            await socket.send(json.dumps({"op": "subscribe", "topic": "/tf", "type": "tf2_msgs/TFMessage"}))
            await socket.recv()
            stamps = []
            end = time.perf_counter() + LISTEN_S
            while time.perf_counter() < end:
                text = str(await socket.recv())
                stamp = re.search(r'"sec":(\d+),"nanosec":(\d+)', text)
                assert stamp is not None
                stamps.append((int(stamp[1]), int(stamp[2])))
            rates.append(len(stamps) / LISTEN_S)
            ordered.append(stamps == sorted(stamps))

    await asyncio.gather(*(work() for _ in range(SUBSCRIBERS)))
    return rates, all(ordered)


def timed(function: Callable[[], object]) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def p99(times: Any) -> float:
    return quantiles(times, n=100)[98] if len(times) > 1 else times[0]
