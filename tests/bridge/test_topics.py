"""Topics: routing, order, throttling and encoding of messages."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from typing import Any

import cbor2
import msgspec
import pytest
from rosbags.typesys import Stores, get_typestore

from mindstage.access.limits import BridgeLimits
from mindstage.bridge import Compression, LocalNode, RosbridgeServer
from mindstage.bridge.broker import PLAIN_FORMAT, Peer, ReplyFormat, ThrottledQueue
from mindstage.bridge.protocol import MessageDecoder, MessageEncoder, Publish, Subscribe
from mindstage.errors import AdvertiseError, MessageValidationError
from mindstage.msgs import RosVersion
from tests.bridge.raw_client import TIMEOUT_S, RawClient, eventually

RawClientFactory = Callable[..., RawClient]


@pytest.fixture(autouse=True)
def settling(local_node: LocalNode) -> None:
    async def settle(_: object) -> None:
        pass

    local_node.create_service("/settle", "std_srvs/Empty", settle)


def subscribed_messages(client: RawClient, topic: str = "/words", **options: Any) -> None:
    client.send_operation(op="subscribe", topic=topic, **options)
    client.flush()


def test_a_message_is_sent_to_its_subscribers_only(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    publisher, near, relative, idle_subscriber = (make_raw_client() for _ in range(4))
    subscribed_messages(near, id="s", type="std_msgs/String")
    subscribed_messages(relative, "words")  # messages have the name of the subscription
    messages: list[Any] = []
    local_node.subscribe("/words", messages.append)
    publisher.send_operation(op="advertise", topic="/words", type="std_msgs/msg/String")
    publisher.send_operation(op="publish", id="p", topic="/words", msg={"data": "hello"})
    assert near.receive("publish") == {"op": "publish", "topic": "/words", "msg": {"data": "hello"}}
    assert relative.receive("publish") == {"op": "publish", "topic": "words", "msg": {"data": "hello"}}
    eventually(lambda: messages == [{"data": "hello"}])
    idle_subscriber.flush()
    assert idle_subscriber.received == []


def test_a_local_node_publishes_to_clients_and_itself(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    class Words(msgspec.Struct):
        data: str

    client = make_raw_client()
    messages: list[Any] = []
    assert not local_node.has_subscribers("/words")
    subscribed_messages(client)
    assert local_node.has_subscribers("words")
    subscription = local_node.subscribe("/words", messages.append)
    local_node.publish("/words", "std_msgs/String", Words("hello"))
    assert client.receive("publish")["msg"] == {"data": "hello"}
    eventually(lambda: messages == [{"data": "hello"}])
    subscription.close()
    subscription.close()
    local_node.publish("/words", "std_msgs/String", Words("again"))
    assert client.receive("publish")["msg"] == {"data": "again"}
    assert messages == [{"data": "hello"}]


def test_messages_arrive_in_order_without_loss(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    clients = [make_raw_client() for _ in range(3)]
    messages: list[int] = []
    local_node.subscribe("/count", lambda message: messages.append(message["n"]))
    for client in clients:
        subscribed_messages(client, "/count")
    for n in range(1000):
        local_node.publish("/count", "x/Count", {"n": n})
    for client in clients:
        assert [client.receive("publish")["msg"]["n"] for _ in range(1000)] == list(range(1000))
    eventually(lambda: messages == list(range(1000)))


def test_several_subscriptions_of_one_client_receive_a_message_once(make_raw_client: RawClientFactory) -> None:
    client = make_raw_client()
    subscribed_messages(client, id=1)
    subscribed_messages(client, id=2)
    client.send_operation(op="advertise", topic="/words", type="x/Words")
    client.send_operation(op="publish", topic="/words", msg={"n": 1})
    client.send_operation(op="unsubscribe", id=1, topic="/words")
    client.send_operation(op="publish", topic="/words", msg={"n": 2})
    client.send_operation(op="unsubscribe", topic="/words")
    client.send_operation(op="publish", topic="/words", msg={"n": 3})
    client.flush()
    assert [each["msg"]["n"] for each in client.received] == [1, 2]


def test_a_new_subscriber_receives_the_latched_message(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    local_node.advertise("/map", "x/Map", latch=True)
    local_node.publish("/map", "x/Map", {"edition": 1})
    local_node.publish("/map", "x/Map", {"edition": 2})
    late = make_raw_client()
    subscribed_messages(late, "/map")
    assert [each["msg"]["edition"] for each in late.received] == [2]
    local_node.unadvertise("/map")
    later = make_raw_client()
    subscribed_messages(later, "/map")
    assert later.received == []


def test_a_topic_has_one_type(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    local_node.advertise("/words", "std_msgs/String")
    client = make_raw_client()
    client.send_operation(op="advertise", id="a", topic="/words", type="std_msgs/Bool")
    assert "is std_msgs/String, not std_msgs/Bool" in client.receive("status", id="a")["msg"]
    client.send_operation(op="subscribe", id="s", topic="/words", type="std_msgs/Bool")
    assert "is std_msgs/String, not std_msgs/Bool" in client.receive("status", id="s")["msg"]
    with pytest.raises(AdvertiseError, match="its type is std_msgs/String"):
        local_node.publish("/words", "std_msgs/Bool", {})
    with pytest.raises(MessageValidationError, match="the type of /words is std_msgs/String"):
        local_node.subscribe("/words", print, type="std_msgs/Bool")
    client.send_operation(op="publish", id="p", topic="/unheard_of", msg={})
    assert "/unheard_of is not advertised; advertise it first" in client.receive("status", id="p")["msg"]


def test_status_messages_are_filtered_by_level(make_raw_client: RawClientFactory) -> None:
    client = make_raw_client()
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


def test_a_topic_is_removed_with_its_last_subscriber(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    publisher, subscriber = make_raw_client(), make_raw_client()
    publisher.send_operation(op="advertise", topic="/words", type="x/Words")
    publisher.flush()
    subscribed_messages(subscriber)
    (topic,) = local_node.graph_info().topics
    assert (topic.name, topic.type, len(topic.publishers), len(topic.subscribers)) == ("/words", "x/Words", 1, 1)
    publisher.close()
    eventually(lambda: not local_node.graph_info().topics[0].publishers)
    subscriber.close()
    eventually(lambda: not local_node.graph_info().topics)


def test_each_subscriber_receives_its_encoding(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    message = {"ranges": [1.0, 2.0, 3.0], "text": "é" * 100}
    plain, image, binary, fragmented = (make_raw_client() for _ in range(4))
    subscribed_messages(plain)
    subscribed_messages(image, compression="png")
    subscribed_messages(binary, compression="cbor")
    subscribed_messages(fragmented, fragment_size=50)
    local_node.publish("/words", "x/Words", message)
    assert plain.receive("publish")["msg"] == message
    assert read(image.receive("png")) == message
    frame = binary.socket.recv(20.0)
    assert isinstance(frame, bytes)
    decoded = cbor2.loads(frame)
    assert decoded["topic"] == "/words"
    assert decoded["msg"]["ranges"].tag == 86
    first = fragmented.receive("fragment")
    reader = MessageDecoder(BridgeLimits())
    reader.decode(msgspec.json.encode(first).decode(), 0.0)
    messages = [
        reader.decode(msgspec.json.encode(fragmented.receive("fragment")).decode(), 0.0)
        for _ in range(first["total"] - 1)
    ]
    assert isinstance(messages[-1], Publish)
    assert msgspec.json.decode(messages[-1].msg) == message


def read(message: dict[str, Any]) -> Any:
    operation = MessageDecoder(BridgeLimits()).decode(msgspec.json.encode(message).decode(), 0.0)
    assert isinstance(operation, Publish)
    return msgspec.json.decode(operation.msg)


def test_a_failing_handler_receives_the_next_message(local_node: LocalNode, caplog: pytest.LogCaptureFixture) -> None:
    messages = []

    def fragile(message: dict[str, int]) -> None:
        messages.append(message["n"])
        if message["n"] == 1:
            raise ZeroDivisionError

    async def also(message: dict[str, int]) -> None:
        fragile(message)

    local_node.subscribe("/count", fragile)
    local_node.subscribe("/count", also)
    for n in range(3):
        local_node.publish("/count", "x/Count", {"n": n})
    eventually(lambda: len(messages) == 6)
    assert sorted(messages) == [0, 0, 1, 1, 2, 2]
    assert caplog.text.count("the handler of messages on /count failed") == 2


def test_a_slow_handler_misses_the_oldest_messages(local_node: LocalNode) -> None:
    messages: list[int] = []
    release = threading.Event()

    def slow(message: dict[str, int]) -> None:
        release.wait(20.0)
        messages.append(message["n"])

    local_node.subscribe("/count", slow)
    for n in range(3000):
        local_node.publish("/count", "x/Count", {"n": n})
    local_node.graph_info()  # waits until all were forwarded
    release.set()
    eventually(lambda: messages and messages[-1] == 2999)
    assert len(messages) <= 1100
    assert messages == sorted(messages)


def test_subscriptions_of_a_client_are_limited(make_raw_client: RawClientFactory) -> None:
    with LocalNode(limits=BridgeLimits(subscriptions=2)) as local_node, RosbridgeServer(local_node, port=0) as server:
        local_node.create_service("/settle", "x/X", lambda _: None)
        client = make_raw_client(server.url)
        for number in range(3):
            client.send_operation(op="subscribe", id=number, topic=f"/t{number}")
        assert "a client has at most 2 subscriptions" in client.receive("status", id=2)["msg"]
        client.send_operation(op="unsubscribe", topic="/t0")
        subscribed_messages(client, "/t2")
        assert [each.name for each in local_node.graph_info().topics] == ["/t1", "/t2"]


# -- feeds, on a clock that the test turns -----------------------------------------------------------------------------


class Turned:
    """A loop whose clock is advanced by the test."""

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
        self.received: list[int] = []
        self.routes: list[ReplyFormat] = []

    def deliver(
        self, outgoing: MessageEncoder, reply_format: ReplyFormat = PLAIN_FORMAT, *, sender: Peer | None = None
    ) -> None:
        assert isinstance(outgoing.operation, Publish)
        self.received.append(msgspec.json.decode(outgoing.operation.msg))
        self.routes.append(reply_format)


def fed(*requests: Subscribe) -> tuple[ThrottledQueue, Ear, Turned]:
    clock, peer = Turned(), Ear()
    queue = ThrottledQueue(clock, peer)  # type: ignore[arg-type]  # a part of the interface of a loop
    for request in requests:
        queue.add(request)
    return queue, peer, clock


def message(number: int) -> MessageEncoder:
    return MessageEncoder(Publish(topic="/t", msg=msgspec.Raw(b"%d" % number)))


def test_a_throttled_queue_sends_the_newest_message() -> None:
    queue, peer, clock = fed(Subscribe(topic="/t", throttle_rate=100))
    for number in range(10):  # one each 30 ms
        queue.push(message(number), peer)
        clock.turn(0.03)
    assert peer.received == [0, 3, 6, 9]
    clock.turn(1.0)
    for number in (10, 11, 12):
        queue.push(message(number), peer)
    assert peer.received == [0, 3, 6, 9, 10]
    clock.turn(0.1)
    assert peer.received == [0, 3, 6, 9, 10, 12]


def test_a_throttled_queue_with_a_length_drops_the_oldest() -> None:
    queue, peer, clock = fed(Subscribe(topic="/t", throttle_rate=100, queue_length=3))
    for number in range(10):
        queue.push(message(number), peer)
    clock.turn(1.0)
    assert peer.received == [0, 7, 8, 9]


def test_a_queue_waits_for_a_congested_peer() -> None:
    queue, peer, clock = fed(Subscribe(topic="/t", queue_length=2))
    peer.congested = True
    for number in range(5):
        queue.push(message(number), peer)
    clock.turn(1.0)
    assert peer.received == []
    peer.congested = False
    clock.turn(0.1)
    assert peer.received == [3, 4]


def test_without_a_queue_length_messages_are_sent_to_a_congested_peer() -> None:
    queue, peer, _ = fed(Subscribe(topic="/t"))
    peer.congested = True
    for number in range(3):
        queue.push(message(number), peer)
    assert peer.received == [0, 1, 2]


def test_the_options_of_several_subscriptions_are_combined() -> None:
    slow = Subscribe(id="slow", topic="/t", throttle_rate=1000, fragment_size=500, compression=Compression.PNG)
    fast = Subscribe(id="fast", topic="/t", throttle_rate=100, fragment_size=900)
    queue, peer, clock = fed(slow, fast)
    for number in range(4):
        queue.push(message(number), peer)
        clock.turn(0.1)
    assert peer.received == [0, 1, 2, 3]
    assert peer.routes[0] == ReplyFormat(Compression.PNG, 500)
    assert queue.remove("fast")
    assert not queue.remove("fast")
    clock.turn(5.0)
    peer.received.clear()
    for number in range(4):
        queue.push(message(number), peer)
        clock.turn(0.1)
    assert peer.received == [0]


def test_a_stopped_queue_sends_nothing_more() -> None:
    queue, peer, clock = fed(Subscribe(topic="/t", throttle_rate=100))
    queue.push(message(0), peer)
    queue.push(message(1), peer)
    queue.remove(None)
    clock.turn(1.0)
    assert peer.received == [0]


def test_a_throttled_client_receives_one_message_per_interval(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    client = make_raw_client()
    subscribed_messages(client, "/count", throttle_rate=3_600_000)
    for n in range(100):
        local_node.publish("/count", "x/Count", {"n": n})
    client.flush()
    assert [each["msg"] for each in client.received] == [{"n": 0}]


@pytest.mark.parametrize(
    ("type", "message", "text"),
    [
        ("std_msgs/String", {"data": 7}, r"msg\.data: .*std_msgs/String: expected str, got int"),
        ("std_msgs/String", {"date": "x"}, r"msg\.date: .*no such field"),
        ("std_msgs/String", "x", "msg: .*expected object, got str"),
        ("geometry_msgs/msg/PoseStamped", {"pose": {"position": {"x": "far"}}}, r"msg\.pose\.position\.x: .*expected"),
        ("std_msgs/UInt8", {"data": 256}, r"msg\.data"),
    ],
)
def test_a_message_of_the_wrong_type_is_refused(
    local_node: LocalNode, make_raw_client: RawClientFactory, type: str, message: Any, text: str
) -> None:
    client, messages = make_raw_client(), list[Any]()
    local_node.subscribe("/words", messages.append)
    client.send_operation(op="advertise", topic="/words", type=type)
    client.send_operation(op="publish", id="p", topic="/words", msg=message)
    status = client.receive("status", id="p")
    assert status["level"] == "error"
    assert re.search(text, status["msg"]), status["msg"]
    client.send_operation(op="publish", topic="/words", msg={})  # missing fields have defaults
    eventually(lambda: messages == [{}])


def test_messages_with_the_names_of_ros_1_and_of_unregistered_types_are_accepted(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    client, messages = make_raw_client(), list[Any]()
    for topic, type, message in (
        ("/a", "std_msgs/Header", {"seq": 1, "stamp": {"secs": 1, "nsecs": 2}, "frame_id": "x"}),
        ("/b", "std_msgs/Header", {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "x"}),
        ("/c", "their_msgs/Thing", {"anything": [1]}),
    ):
        local_node.subscribe(topic, messages.append)
        client.send_operation(op="advertise", topic=topic, type=type)
        client.send_operation(op="publish", topic=topic, msg=message)
        eventually(lambda message=message: messages[-1:] == [message])


@pytest.mark.parametrize("ros", list(RosVersion))
def test_a_raw_subscriber_receives_the_bytes_that_ros_serializes(
    local_node: LocalNode, make_raw_client: RawClientFactory, ros: RosVersion
) -> None:
    local_node.set_ros(ros, lambda: 12.5)
    store = get_typestore(Stores.ROS1_NOETIC if ros is RosVersion.ONE else Stores.ROS2_HUMBLE)
    read = store.deserialize_ros1 if ros is RosVersion.ONE else store.deserialize_cdr
    raw, plain = make_raw_client(), make_raw_client()
    header = {"seq": 3} if ros is RosVersion.ONE else {}
    message = {
        "header": {**header, "stamp": {"secs": 1, "nsecs": 2}, "frame_id": "map"},
        "point": {"x": 1.0, "y": -2.5, "z": 3.0},
    }
    local_node.advertise("/point", "geometry_msgs/PointStamped", latch=True)
    local_node.publish("/point", "geometry_msgs/PointStamped", message)
    for client, compression in ((raw, "cbor-raw"), (plain, "none")):
        client.send_operation(op="subscribe", topic="point", compression=compression)
    for _ in range(2):  # the latched message, and a new one
        frame = cbor2.loads(raw.socket.recv(timeout=TIMEOUT_S))
        assert (frame["op"], frame["topic"]) == ("publish", "point")
        assert (frame["msg"]["secs"], frame["msg"]["nsecs"]) == (12, 500_000_000)
        found = read(frame["msg"]["bytes"], "geometry_msgs/msg/PointStamped")
        assert (found.header.stamp.sec, found.header.stamp.nanosec, found.header.frame_id) == (1, 2, "map")
        assert (found.point.x, found.point.y, found.point.z) == (1.0, -2.5, 3.0)
        if ros is RosVersion.ONE:
            assert found.header.seq == 3
        assert plain.receive("publish")["msg"] == message
        local_node.publish("/point", "geometry_msgs/PointStamped", message)


def test_a_raw_subscription_needs_a_registered_type_and_valid_messages(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    client = make_raw_client()
    local_node.advertise("/theirs", "their_msgs/Thing")
    for topic in ("/theirs", "/unheard_of"):
        client.send_operation(op="subscribe", id="s", topic=topic, compression="cbor-raw")
        assert "use cbor" in client.receive("status", id="s")["msg"]
    client.send_operation(op="subscribe", topic="/words", type="std_msgs/String", compression="cbor-raw")
    client.flush()
    local_node.publish("/words", "std_msgs/String", {"data": 7})
    assert "cannot be serialized" in client.receive("status")["msg"]


def test_a_topic_that_is_not_advertised_any_more_counts_no_longer(make_raw_client: RawClientFactory) -> None:
    with (
        LocalNode(limits=BridgeLimits(advertisements=3)) as local_node,
        RosbridgeServer(local_node, port=0) as server,
    ):
        client = make_raw_client(server.url)

        def advertise(topic: str) -> str:
            client.send_operation(op="advertise", id=topic, topic=topic, type="std_msgs/String")
            client.flush()
            statuses, client.received = client.received, []
            return "".join(status["msg"] for status in statuses)

        local_node.create_service("/settle", "std_srvs/Empty", lambda _: None)
        assert [advertise(topic) for topic in ("/a", "/b", "/c")] == ["", "", ""]
        assert "3 topics of one client" in advertise("/d")
        client.send_operation(op="unadvertise", topic="/a")
        assert advertise("/d") == ""
        assert "3 topics of one client" in advertise("/e"), "only one was free"
