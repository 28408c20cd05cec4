"""Ten thousand messages that mean harm, or nothing: the hub stays up, its memory flat, its other clients unaffected."""

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
from tests.bridge.talking import RawClient, eventually, raw_subscriber

Talkers = Callable[..., RawClient]

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


def harm(dice: random.Random) -> str | bytes:
    """One message: noise, a piece of something right, or something right that means nothing."""
    kind = dice.randrange(8)
    if kind == 0:
        return dice.randbytes(dice.randrange(200))
    if kind == 1:
        return "".join(dice.choices('{}[]",:\\ntrue0.1e-é\u2028\x00', k=dice.randrange(200)))
    if kind == 2:
        return '{"op":"publish","topic":"/a","msg":' + dice.choice("[{") * dice.randrange(70, 5000)
    text = msgspec.json.encode(anything_said(dice)).decode()
    if kind == 3:
        cut = dice.randrange(len(text))
        return text[:cut] + chr(dice.randrange(32, 300)) + text[cut + dice.randrange(3) :]
    if kind == 4:
        operation = Publish(topic="/a", msg=msgspec.Raw(text.encode()))
        frame = bytearray(MessageEncoder(operation).frames(Compression.CBOR)[0])  # type: ignore[arg-type]  # it is bytes
        frame[dice.randrange(len(frame))] = dice.randrange(256)
        return bytes(frame)
    return text


def anything_said(dice: random.Random) -> dict[str, Any]:
    return {"op": dice.choice(OPS)} | {key: anything(dice) for key in dice.sample(KEYS, dice.randrange(12))}


def anything(dice: random.Random, depth: int = 0) -> Any:
    kind = dice.randrange(9 if depth < 3 else 7)
    if kind < 3:
        return dice.choice(NAMES)
    if kind == 7:
        return [anything(dice, depth + 1) for _ in range(dice.randrange(4))]
    if kind == 8:
        return {dice.choice(KEYS): anything(dice, depth + 1) for _ in range(dice.randrange(4))}
    return (None, dice.random() < 0.5, dice.randrange(-3, 10), 10.0 ** dice.randrange(-300, 300))[kind - 3]


def attack(talker: Talkers, seed: int, messages: int) -> int:
    """Sends, and comes back whenever it is thrown out; tells how often that was."""
    dice = random.Random(seed)
    client = talker(max_queue=None)
    thrown_out = 0
    for number in range(messages):
        if number % 500 != 499:
            client.send(harm(dice))
            continue
        client.socket.send(b"\xff\xfe no UTF-8", text=True)
        assert client.wait_closed()[0] == 1007  # for it, nothing else is left
        client = talker(max_queue=None)
        thrown_out += 1
    client.close()
    return thrown_out


def test_the_hub_survives_and_nobody_else_notices(
    hub: LocalNode, server: RosbridgeServer, talker: Talkers, caplog: pytest.LogCaptureFixture
) -> None:
    hub.create_service("/add", "x/Add", lambda args: {"sum": args["a"] + args["b"]})
    good = talker()
    good.send_operation(op="subscribe", topic="/good", type="x/Good")
    good.send_operation(op="advertise", topic="/good", type="x/Good")
    good.call_service("/add", {"a": 0, "b": 0})
    expected = hub_at_rest(hub)
    with ThreadPoolExecutor(4) as pool:
        attacks = [pool.submit(attack, talker, seed, MESSAGES // 4) for seed in range(4)]
        rounds = 0
        while rounds < 20 or not all(each.done() for each in attacks):
            assert good.call_service("/add", {"a": rounds, "b": 1})["values"] == {"sum": rounds + 1}
            good.send_operation(op="publish", topic="/good", msg={"n": rounds})
            assert good.receive("publish", topic="/good")["msg"] == {"n": rounds}
            rounds += 1
    assert [each.result() for each in attacks] == [5, 5, 5, 5]
    eventually(lambda: server.client_count == 1)
    assert hub_at_rest(hub) == expected
    assert good.received == []
    assert not [each for each in caplog.records if each.levelname == "ERROR"], "a defect, however harmless"


def test_harm_leaves_nothing_in_the_memory(hub: LocalNode, server: RosbridgeServer, talker: Talkers) -> None:
    attack(talker, 0, 500)  # whatever is made but once is made
    eventually(lambda: server.client_count == 0)
    tracemalloc.start()
    try:
        for seed in (1, 2):
            attack(talker, seed, 500)
            eventually(lambda: server.client_count == 0)
            gc.collect()
        left, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert left < 1_000_000
    assert most < 50_000_000


def hub_at_rest(hub: LocalNode) -> tuple[Any, ...]:
    """What the hub knows; it must know nothing of those who are gone."""
    told = hub.graph_info()
    waiting = hub.broker.services.providers.pending_count() + hub.broker.actions.providers.pending_count()
    return told.services, told.actions, [each.name for each in told.topics], len(told.peers), waiting


def test_a_flood_of_remarks_drops_the_one_who_caused_it_and_does_not_read(server: RosbridgeServer) -> None:
    flooder = raw_subscriber(server.port)
    wrong = b"\x81\x82" + bytes(4) + b"[]"
    with pytest.raises((ConnectionResetError, BrokenPipeError)):
        flooder.sendall(wrong * 2_000_000)
    flooder.close()
    eventually(lambda: server.client_count == 0)


def test_noise_before_a_handshake_harms_nobody(hub: LocalNode, server: RosbridgeServer, talker: Talkers) -> None:
    hub.create_service("/settle", "x/X", lambda _: None)
    dice = random.Random(1)
    for _ in range(50):
        with socket.create_connection(("127.0.0.1", server.port)) as stranger:
            stranger.sendall(dice.choice([b"", b"GET / HTTP/1.1\r\n\r\n", dice.randbytes(500)]))
    assert talker().call_service("/settle")["result"]
