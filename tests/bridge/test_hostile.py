"""Ten thousand random messages: the server keeps running, its memory stays constant, other clients are not affected."""

from __future__ import annotations

import gc
import random
import socket
import tracemalloc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import msgspec
import pytest

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.bridge.protocol import Compression, MessageEncoder, Publish
from tests.bridge.raw_client import RawClient, eventually, raw_subscriber

RawClientFactory = Callable[..., RawClient]

MESSAGES = 10_000
OPS = (
    "advertise", "unadvertise", "publish", "subscribe", "unsubscribe", "advertise_service", "unadvertise_service",
    "call_service", "service_response", "advertise_action", "unadvertise_action", "send_action_goal",
    "cancel_action_goal", "action_feedback", "action_result", "status", "set_level", "auth", "fragment", "png", "zip",
)  # fmt: skip
KEYS = (
    "id", "topic", "type", "msg", "service", "args", "values", "result", "action", "action_type", "status", "feedback",
    "latch", "throttle_rate", "queue_length", "fragment_size", "compression", "timeout", "level", "data", "num",
    "total", "token", "mac", "t", "end",
)  # fmt: skip
NAMES = ("/a", "b", "/settle", "/add", "/../x", "", "/" * 50, "x" * 2000, "\x00", "é")


def random_frame(rng: random.Random) -> str | bytes:
    """Returns a random frame: noise, a part of a valid message, or a valid message with random values."""
    kind = rng.randrange(8)
    if kind == 0:
        return rng.randbytes(rng.randrange(200))
    if kind == 1:
        return "".join(rng.choices('{}[]",:\\ntrue0.1e-é\u2028\x00', k=rng.randrange(200)))
    if kind == 2:
        return '{"op":"publish","topic":"/a","msg":' + rng.choice("[{") * rng.randrange(70, 5000)
    text = msgspec.json.encode(random_operation(rng)).decode()
    if kind == 3:
        cut = rng.randrange(len(text))
        return text[:cut] + chr(rng.randrange(32, 300)) + text[cut + rng.randrange(3) :]
    if kind == 4:
        operation = Publish(topic="/a", msg=msgspec.Raw(text.encode()))
        frame = bytearray(MessageEncoder(operation).frames(Compression.CBOR)[0])  # type: ignore[arg-type]  # it is bytes
        frame[rng.randrange(len(frame))] = rng.randrange(256)
        return bytes(frame)
    return text


def random_operation(rng: random.Random) -> dict[str, Any]:
    return {"op": rng.choice(OPS)} | {key: random_value(rng) for key in rng.sample(KEYS, rng.randrange(12))}


def random_value(rng: random.Random, depth: int = 0) -> Any:
    kind = rng.randrange(9 if depth < 3 else 7)
    if kind < 3:
        return rng.choice(NAMES)
    if kind == 7:
        return [random_value(rng, depth + 1) for _ in range(rng.randrange(4))]
    if kind == 8:
        return {rng.choice(KEYS): random_value(rng, depth + 1) for _ in range(rng.randrange(4))}
    return (None, rng.random() < 0.5, rng.randrange(-3, 10), 10.0 ** rng.randrange(-300, 300))[kind - 3]


def attack(make_raw_client: RawClientFactory, seed: int, messages: int) -> int:
    """Sends random messages, reconnects when it is disconnected, and returns how often it was."""
    rng = random.Random(seed)
    client = make_raw_client(max_queue=None)
    disconnected = 0
    for number in range(messages):
        if number % 500 != 499:
            client.send(random_frame(rng))
            continue
        client.socket.send(b"\xff\xfe no UTF-8", text=True)
        assert client.wait_closed()[0] == 1007  # invalid UTF-8
        client = make_raw_client(max_queue=None)
        disconnected += 1
    client.close()
    return disconnected


def test_random_messages_do_not_affect_other_clients(
    local_node: LocalNode, server: RosbridgeServer, make_raw_client: RawClientFactory, caplog: pytest.LogCaptureFixture
) -> None:
    local_node.create_service("/add", "x/Add", lambda args: {"sum": args["a"] + args["b"]})
    good = make_raw_client()
    good.send_operation(op="subscribe", topic="/good", type="x/Good")
    good.send_operation(op="advertise", topic="/good", type="x/Good")
    good.call_service("/add", {"a": 0, "b": 0})
    expected = graph_when_idle(local_node)
    with ThreadPoolExecutor(4) as pool:
        attacks = [pool.submit(attack, make_raw_client, seed, MESSAGES // 4) for seed in range(4)]
        rounds = 0
        while rounds < 20 or not all(each.done() for each in attacks):
            assert good.call_service("/add", {"a": rounds, "b": 1})["values"] == {"sum": rounds + 1}
            good.send_operation(op="publish", topic="/good", msg={"n": rounds})
            assert good.receive("publish", topic="/good")["msg"] == {"n": rounds}
            rounds += 1
    assert [each.result() for each in attacks] == [5, 5, 5, 5]
    eventually(lambda: server.client_count == 1)
    assert graph_when_idle(local_node) == expected
    assert good.received == []
    assert not [each for each in caplog.records if each.levelname == "ERROR"], "an internal error was logged"


def test_random_messages_leak_no_memory(
    local_node: LocalNode, server: RosbridgeServer, make_raw_client: RawClientFactory
) -> None:
    attack(make_raw_client, 0, 500)  # fills the caches
    eventually(lambda: server.client_count == 0)
    tracemalloc.start()
    try:
        for seed in (1, 2):
            attack(make_raw_client, seed, 500)
            eventually(lambda: server.client_count == 0)
            gc.collect()
        current, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert current < 1_000_000
    assert peak < 50_000_000


def graph_when_idle(local_node: LocalNode) -> tuple[Any, ...]:
    """Returns the graph and the pending requests, which must not contain disconnected clients."""
    graph = local_node.graph_info()
    waiting = local_node.broker.services.providers.pending_count() + local_node.broker.actions.providers.pending_count()
    return graph.services, graph.actions, [each.name for each in graph.topics], len(graph.peers), waiting


def test_a_client_that_causes_errors_and_does_not_read_is_disconnected(server: RosbridgeServer) -> None:
    flooder = raw_subscriber(server.port)
    wrong = b"\x81\x82" + bytes(4) + b"[]"
    with pytest.raises((ConnectionResetError, BrokenPipeError)):
        flooder.sendall(wrong * 2_000_000)
    flooder.close()
    eventually(lambda: server.client_count == 0)


def test_invalid_handshakes_do_not_affect_other_clients(
    local_node: LocalNode, server: RosbridgeServer, make_raw_client: RawClientFactory
) -> None:
    local_node.create_service("/settle", "x/X", lambda _: None)
    rng = random.Random(1)
    for _ in range(50):
        with socket.create_connection(("127.0.0.1", server.port)) as other_client:
            other_client.sendall(rng.choice([b"", b"GET / HTTP/1.1\r\n\r\n", rng.randbytes(500)]))
    assert make_raw_client().call_service("/settle")["result"]
