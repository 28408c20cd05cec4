"""Topics at a hub: who hears what, in which order, how often and in which form."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import cbor2
import msgspec
import pytest

from mindstage.bridge import BridgeLimits, Compression, LocalNode, RosbridgeServer
from mindstage.bridge.broker import PLAIN_FORMAT, Peer, ReplyFormat, ThrottledQueue
from mindstage.bridge.protocol import MessageDecoder, MessageEncoder, Publish, Subscribe
from mindstage.errors import AdvertiseError, MessageValidationError
from tests.bridge.talking import RawClient, eventually

Talkers = Callable[..., RawClient]


@pytest.fixture(autouse=True)
def settling(hub: LocalNode) -> None:
    async def settle(_: object) -> None:
        pass

    hub.create_service("/settle", "std_srvs/Empty", settle)


def listen(client: RawClient, topic: str = "/words", **wishes: Any) -> None:
    client.send_operation(op="subscribe", topic=topic, **wishes)
    client.flush()


def test_a_message_reaches_all_who_listen_and_nobody_else(hub: LocalNode, talker: Talkers) -> None:
    speaker, near, far, deaf = (talker() for _ in range(4))
    listen(near, id="s", type="std_msgs/String")
    listen(far, "words")  # as it spells the topic, so it hears it
    heard: list[Any] = []
    hub.subscribe("/words", heard.append)
    speaker.send_operation(op="advertise", topic="/words", type="std_msgs/msg/String")
    speaker.send_operation(op="publish", id="p", topic="/words", msg={"data": "hello"})
    assert near.receive("publish") == {"op": "publish", "topic": "/words", "msg": {"data": "hello"}}
    assert far.receive("publish") == {"op": "publish", "topic": "words", "msg": {"data": "hello"}}
    eventually(lambda: heard == [{"data": "hello"}])
    deaf.flush()
    assert deaf.received == []


def test_this_process_publishes_to_its_clients_and_to_itself(hub: LocalNode, talker: Talkers) -> None:
    class Words(msgspec.Struct):
        data: str

    client = talker()
    heard: list[Any] = []
    assert not hub.has_subscribers("/words")
    listen(client)
    assert hub.has_subscribers("words")
    subscription = hub.subscribe("/words", heard.append)
    hub.publish("/words", "std_msgs/String", Words("hello"))
    assert client.receive("publish")["msg"] == {"data": "hello"}
    eventually(lambda: heard == [{"data": "hello"}])
    subscription.close()
    subscription.close()
    hub.publish("/words", "std_msgs/String", Words("again"))
    assert client.receive("publish")["msg"] == {"data": "again"}
    assert heard == [{"data": "hello"}]


def test_messages_keep_their_order_and_none_is_lost(hub: LocalNode, talker: Talkers) -> None:
    clients = [talker() for _ in range(3)]
    heard: list[int] = []
    hub.subscribe("/count", lambda message: heard.append(message["n"]))
    for client in clients:
        listen(client, "/count")
    for n in range(1000):
        hub.publish("/count", "x/Count", {"n": n})
    for client in clients:
        assert [client.receive("publish")["msg"]["n"] for _ in range(1000)] == list(range(1000))
    eventually(lambda: heard == list(range(1000)))


def test_several_subscriptions_of_one_client_hear_a_message_once(talker: Talkers) -> None:
    client = talker()
    listen(client, id=1)
    listen(client, id=2)
    client.send_operation(op="advertise", topic="/words", type="x/Words")
    client.send_operation(op="publish", topic="/words", msg={"n": 1})
    client.send_operation(op="unsubscribe", id=1, topic="/words")
    client.send_operation(op="publish", topic="/words", msg={"n": 2})
    client.send_operation(op="unsubscribe", topic="/words")
    client.send_operation(op="publish", topic="/words", msg={"n": 3})
    client.flush()
    assert [each["msg"]["n"] for each in client.received] == [1, 2]


def test_the_last_message_of_a_latched_topic_greets_newcomers(hub: LocalNode, talker: Talkers) -> None:
    hub.advertise("/map", "x/Map", latch=True)
    hub.publish("/map", "x/Map", {"edition": 1})
    hub.publish("/map", "x/Map", {"edition": 2})
    late = talker()
    listen(late, "/map")
    assert [each["msg"]["edition"] for each in late.received] == [2]
    hub.unadvertise("/map")
    later = talker()
    listen(later, "/map")
    assert later.received == []


def test_a_topic_has_one_type(hub: LocalNode, talker: Talkers) -> None:
    hub.advertise("/words", "std_msgs/String")
    client = talker()
    client.send_operation(op="advertise", id="a", topic="/words", type="std_msgs/Bool")
    assert "is std_msgs/String, not std_msgs/Bool" in client.receive("status", id="a")["msg"]
    client.send_operation(op="subscribe", id="s", topic="/words", type="std_msgs/Bool")
    assert "is std_msgs/String, not std_msgs/Bool" in client.receive("status", id="s")["msg"]
    with pytest.raises(AdvertiseError, match="its type is std_msgs/String"):
        hub.publish("/words", "std_msgs/Bool", {})
    with pytest.raises(MessageValidationError, match="the type of /words is std_msgs/String"):
        hub.subscribe("/words", print, type="std_msgs/Bool")
    client.send_operation(op="publish", id="p", topic="/unheard_of", msg={})
    assert "/unheard_of is not advertised; advertise it first" in client.receive("status", id="p")["msg"]


def test_remarks_come_as_gravely_as_they_were_wished_for(talker: Talkers) -> None:
    client = talker()
    client.send_operation(op="unsubscribe", id=1, topic="/words")
    client.flush()
    assert client.received == []
    client.send_operation(op="set_level", level="warning")
    client.send_operation(op="unsubscribe", id=2, topic="/words")
    assert "not subscribed" in client.receive("status", id=2)["msg"]
    client.send_operation(op="unadvertise", id=3, topic="/words")
    assert "did not advertise" in client.receive("status", id=3)["msg"]
    client.send_operation(op="set_level", level="none")
    client.send_operation(op="publish", id=4, topic="/unheard_of", msg={})
    client.flush()
    assert client.received == []


def test_a_topic_is_forgotten_with_the_last_who_cares(hub: LocalNode, talker: Talkers) -> None:
    speaker, listener = talker(), talker()
    speaker.send_operation(op="advertise", topic="/words", type="x/Words")
    speaker.flush()
    listen(listener)
    (topic,) = hub.graph_info().topics
    assert (topic.name, topic.type, len(topic.publishers), len(topic.subscribers)) == ("/words", "x/Words", 1, 1)
    speaker.close()
    eventually(lambda: not hub.graph_info().topics[0].publishers)
    listener.close()
    eventually(lambda: not hub.graph_info().topics)


def test_each_listener_gets_the_form_it_wants(hub: LocalNode, talker: Talkers) -> None:
    message = {"ranges": [1.0, 2.0, 3.0], "text": "é" * 100}
    plain, image, binary, pieces = (talker() for _ in range(4))
    listen(plain)
    listen(image, compression="png")
    listen(binary, compression="cbor")
    listen(pieces, fragment_size=50)
    hub.publish("/words", "x/Words", message)
    assert plain.receive("publish")["msg"] == message
    assert read(image.receive("png")) == message
    frame = binary.socket.recv(20.0)
    assert isinstance(frame, bytes)
    told = cbor2.loads(frame)
    assert told["topic"] == "/words"
    assert told["msg"]["ranges"].tag == 86
    first = pieces.receive("fragment")
    reader = MessageDecoder(BridgeLimits())
    reader.decode(msgspec.json.encode(first).decode(), 0.0)
    whole = [
        reader.decode(msgspec.json.encode(pieces.receive("fragment")).decode(), 0.0) for _ in range(first["total"] - 1)
    ]
    assert isinstance(whole[-1], Publish)
    assert msgspec.json.decode(whole[-1].msg) == message


def read(message: dict[str, Any]) -> Any:
    operation = MessageDecoder(BridgeLimits()).decode(msgspec.json.encode(message).decode(), 0.0)
    assert isinstance(operation, Publish)
    return msgspec.json.decode(operation.msg)


def test_a_handler_that_breaks_hears_the_next_message(hub: LocalNode, caplog: pytest.LogCaptureFixture) -> None:
    heard = []

    def fragile(message: dict[str, int]) -> None:
        heard.append(message["n"])
        if message["n"] == 1:
            raise ZeroDivisionError

    async def also(message: dict[str, int]) -> None:
        fragile(message)

    hub.subscribe("/count", fragile)
    hub.subscribe("/count", also)
    for n in range(3):
        hub.publish("/count", "x/Count", {"n": n})
    eventually(lambda: len(heard) == 6)
    assert sorted(heard) == [0, 0, 1, 1, 2, 2]
    assert caplog.text.count("the handler of messages on /count failed") == 2


def test_a_slow_handler_misses_the_oldest_and_hears_the_last(hub: LocalNode) -> None:
    heard: list[int] = []
    release = threading.Event()

    def slow(message: dict[str, int]) -> None:
        release.wait(20.0)
        heard.append(message["n"])

    hub.subscribe("/count", slow)
    for n in range(3000):
        hub.publish("/count", "x/Count", {"n": n})
    hub.graph_info()  # all of them were passed on
    release.set()
    eventually(lambda: heard and heard[-1] == 2999)
    assert len(heard) <= 1100
    assert heard == sorted(heard)


def test_one_client_may_only_have_so_many_subscriptions(talker: Talkers) -> None:
    with LocalNode(limits=BridgeLimits(subscriptions=2)) as hub, RosbridgeServer(hub, port=0) as server:
        hub.create_service("/settle", "x/X", lambda _: None)
        client = talker(server.url)
        for number in range(3):
            client.send_operation(op="subscribe", id=number, topic=f"/t{number}")
        assert "a client has at most 2 subscriptions" in client.receive("status", id=2)["msg"]
        client.send_operation(op="unsubscribe", topic="/t0")
        listen(client, "/t2")
        assert [each.name for each in hub.graph_info().topics] == ["/t1", "/t2"]


# -- feeds, on a clock that the test turns -----------------------------------------------------------------------------


class Turned:
    """A loop's clock, by hand."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self._due: list[tuple[float, Callable[[], object]]] = []

    def call_later(self, delay_s: float, function: Callable[[], object]) -> Any:
        entry = (self.now_s + delay_s, function)
        self._due.append(entry)
        due = self._due

        class Handle:
            def cancel(self) -> None:
                if entry in due:
                    due.remove(entry)

        return Handle()

    def turn(self, seconds: float) -> None:
        until = self.now_s + seconds
        while ready := sorted((each for each in self._due if each[0] <= until + 1e-9), key=lambda each: each[0]):
            self._due.remove(ready[0])
            self.now_s = ready[0][0]
            ready[0][1]()
        self.now_s = until


class Ear(Peer):
    congested = False

    def __init__(self) -> None:
        super().__init__("/ear")
        self.heard: list[int] = []
        self.routes: list[ReplyFormat] = []

    def deliver(
        self, outgoing: MessageEncoder, route: ReplyFormat = PLAIN_FORMAT, *, sender: Peer | None = None
    ) -> None:
        assert isinstance(outgoing.operation, Publish)
        self.heard.append(msgspec.json.decode(outgoing.operation.msg))
        self.routes.append(route)


def fed(*requests: Subscribe) -> tuple[ThrottledQueue, Ear, Turned]:
    clock, ear = Turned(), Ear()
    feed = ThrottledQueue(clock, ear)  # type: ignore[arg-type]  # all it needs of a loop
    for request in requests:
        feed.add(request)
    return feed, ear, clock


def message(number: int) -> MessageEncoder:
    return MessageEncoder(Publish(topic="/t", msg=msgspec.Raw(b"%d" % number)))


def test_a_throttled_feed_sends_the_newest_when_it_is_time() -> None:
    feed, ear, clock = fed(Subscribe(topic="/t", throttle_rate=100))
    for number in range(10):  # one each 30 ms
        feed.push(message(number), ear)
        clock.turn(0.03)
    assert ear.heard == [0, 3, 6, 9]
    clock.turn(1.0)
    for number in (10, 11, 12):
        feed.push(message(number), ear)
    assert ear.heard == [0, 3, 6, 9, 10]
    clock.turn(0.1)
    assert ear.heard == [0, 3, 6, 9, 10, 12]


def test_a_throttled_feed_with_a_queue_drops_the_oldest() -> None:
    feed, ear, clock = fed(Subscribe(topic="/t", throttle_rate=100, queue_length=3))
    for number in range(10):
        feed.push(message(number), ear)
    clock.turn(1.0)
    assert ear.heard == [0, 7, 8, 9]


def test_a_feed_with_a_queue_waits_for_a_peer_that_cannot_follow() -> None:
    feed, ear, clock = fed(Subscribe(topic="/t", queue_length=2))
    ear.congested = True
    for number in range(5):
        feed.push(message(number), ear)
    clock.turn(1.0)
    assert ear.heard == []
    ear.congested = False
    clock.turn(0.1)
    assert ear.heard == [3, 4]


def test_a_feed_without_a_queue_waits_for_nobody() -> None:
    feed, ear, _ = fed(Subscribe(topic="/t"))
    ear.congested = True
    for number in range(3):
        feed.push(message(number), ear)
    assert ear.heard == [0, 1, 2]


def test_subscriptions_of_one_peer_agree_on_the_most_demanding() -> None:
    slow = Subscribe(id="slow", topic="/t", throttle_rate=1000, fragment_size=500, compression=Compression.PNG)
    fast = Subscribe(id="fast", topic="/t", throttle_rate=100, fragment_size=900)
    feed, ear, clock = fed(slow, fast)
    for number in range(4):
        feed.push(message(number), ear)
        clock.turn(0.1)
    assert ear.heard == [0, 1, 2, 3]
    assert ear.routes[0] == ReplyFormat(Compression.PNG, 500)
    assert feed.remove("fast")
    assert not feed.remove("fast")
    clock.turn(5.0)
    ear.heard.clear()
    for number in range(4):
        feed.push(message(number), ear)
        clock.turn(0.1)
    assert ear.heard == [0]


def test_a_stopped_feed_sends_nothing_more() -> None:
    feed, ear, clock = fed(Subscribe(topic="/t", throttle_rate=100))
    feed.push(message(0), ear)
    feed.push(message(1), ear)
    feed.remove(None)
    clock.turn(1.0)
    assert ear.heard == [0]


def test_a_throttled_client_hears_one_message_in_its_time(hub: LocalNode, talker: Talkers) -> None:
    client = talker()
    listen(client, "/count", throttle_rate=3_600_000)
    for n in range(100):
        hub.publish("/count", "x/Count", {"n": n})
    client.flush()
    assert [each["msg"] for each in client.received] == [{"n": 0}]
