"""What the servers of rosbridge_suite accept and how they refuse; and what Mindstage's own server refuses like them.

`tests/ros/test_real_rosbridge.py` uses a real one that is running, if its address is given.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import cbor2
import msgspec
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

from mindstage.bridge import Compression, LocalNode, Refusal, RosbridgeClient, RosbridgeServer
from mindstage.errors import FailureResponseError, ServiceCallError
from tests.bridge.raw_client import TIMEOUT_S, RawClient, eventually

Message = dict[str, Any]

# Fields with their types, as `basic_type_check` and the code after it require them; * marks those that must be given.
# Source: rosbridge_library/capabilities/*.py, branch ros1 of 2023-09-27 and branch ros2 of 2026.
STRING, NUMBER, BOOLEAN, OBJECT = (str,), (int, float), (bool,), (dict,)
ROS_1: dict[str, dict[str, tuple[type, ...]]] = {
    "advertise": {"topic*": STRING, "type*": STRING},
    "unadvertise": {"topic*": STRING},
    "publish": {"topic*": STRING, "msg": OBJECT},
    "subscribe": {
        "topic*": STRING,
        "type": STRING,
        "throttle_rate": (int,),
        "fragment_size": (int,),
        "queue_length": (int,),
        "compression": STRING,
    },
    "unsubscribe": {"topic*": STRING},
    "call_service": {"service*": STRING, "fragment_size": (int, type(None)), "compression": STRING},
    "advertise_service": {"service*": STRING, "type*": STRING},
    "unadvertise_service": {"service*": STRING},
    "service_response": {"service*": STRING, "id*": STRING, "values*": OBJECT, "result*": BOOLEAN},
}
ROS_2 = ROS_1 | {
    "advertise": ROS_1["advertise"] | {"latch": BOOLEAN, "queue_size": (int,), "qos": OBJECT},
    "publish": ROS_1["publish"] | {"type": STRING, "latch": BOOLEAN, "queue_size": (int,), "qos": OBJECT},
    "subscribe": ROS_1["subscribe"] | {"qos": OBJECT},
    "call_service": ROS_1["call_service"] | {"timeout": NUMBER},
    "send_action_goal": {
        "action*": STRING,
        "action_type*": STRING,
        "fragment_size": (int, type(None)),
        "compression": STRING,
    },
    "cancel_action_goal": {"action*": STRING},
    "advertise_action": {"action*": STRING, "type*": STRING},
    "unadvertise_action": {"action*": STRING},
    "action_feedback": {"action*": STRING, "id*": STRING, "values*": OBJECT},
    "action_result": {
        "action*": STRING,
        "id*": STRING,
        "values*": OBJECT,
        "status*": (int,),
        "result*": BOOLEAN,
    },
}
FORMATS = {1: (ROS_1, "AutobahnPython/23.1.2", 8, 4, 2), 2: (ROS_2, "TornadoServer/6.4", 40, 30, 20)}
"""By version of ROS: the fields, the name of the websocket server, and the levels of errors, warnings and info."""


def violations(message: Message, fields: dict[str, dict[str, tuple[type, ...]]]) -> list[str]:
    """Why a server of rosbridge_suite refuses an operation."""
    expected = fields.get(message["op"])
    if expected is None:
        return [f"unknown operation {message['op']}"]
    found = [f"no {name[:-1]}" for name in expected if name.endswith("*") and name[:-1] not in message]
    for name, types in expected.items():
        value = message.get(name.rstrip("*"), ...)
        # `isinstance` as there; but a bool would be a mistake where an integer is expected.
        if value is not ... and (not isinstance(value, types) or (isinstance(value, bool) and bool not in types)):
            found.append(f"{name} is {value!r}")
    return found


class SuiteServer:
    """A server that logs on `/rosout` as those of rosbridge_suite do, records operations and refuses on request."""

    def __init__(self, ros: int) -> None:
        self.fields, header, self.error, self.warning, self.info = FORMATS[ros]
        self.ros = ros
        self.received: list[Message] = []
        self.refuse: Callable[[Message], str | None] = lambda _: None
        self._connection: ServerConnection | None = None
        self._server = serve(self._handle, "127.0.0.1", 0, server_header=header)
        self.url = f"ws://127.0.0.1:{self._server.socket.getsockname()[1]}"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def _handle(self, connection: ServerConnection) -> None:
        self._connection = connection
        try:
            for frame in connection:
                message = msgspec.json.decode(frame)
                self.received.append(message)
                if cause := self.refuse(message):
                    self.log(self.error, f"{message['op']}: {cause}", message.get("id"))
                elif message["op"] == "call_service" and message["service"].startswith("/rosapi/"):
                    self.send(
                        op="service_response", id=message["id"], service=message["service"], values={}, result=True
                    )
                elif message["op"] == "subscribe":
                    self.log(self.info, f"Subscribed to {message['topic']}")
        except ConnectionClosed:
            pass

    def log(self, level: int, text: str, id: object = None) -> None:
        line = f"[Client 7] [id: {id}] {text}" if id is not None else f"[Client 7] {text}"
        stamp = {"secs": 1, "nsecs": 0} if self.ros == 1 else {"sec": 1, "nanosec": 0}
        entry: Message = {"level": level, "name": "/rosbridge_websocket", "msg": line, "file": "", "function": "log"}
        entry |= {"line": 1, "stamp": stamp} if self.ros == 2 else {"line": 1, "header": {"stamp": stamp}, "topics": []}
        self.send(op="publish", topic="/rosout", msg=entry)

    def send(self, **message: Any) -> None:
        assert self._connection is not None
        self._connection.send(msgspec.json.encode(message).decode())

    def of(self, op: str, **fields: Any) -> list[Message]:
        """The received operations with these fields."""
        return [
            each
            for each in list(self.received)
            if each["op"] == op and all(each.get(key) == value for key, value in fields.items())
        ]

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join(TIMEOUT_S)


@pytest.fixture(params=[1, 2], ids=["ros1", "ros2"])
def suite(request: pytest.FixtureRequest) -> Iterator[SuiteServer]:
    with ExitStack() as stack:
        server = SuiteServer(request.param)
        stack.callback(server.close)
        yield server


@pytest.fixture
def member(suite: SuiteServer) -> Iterator[RosbridgeClient]:
    with RosbridgeClient(suite.url) as member:
        yield member.wait_connected(TIMEOUT_S)


def test_every_operation_has_the_fields_that_rosbridge_suite_accepts(
    suite: SuiteServer, member: RosbridgeClient
) -> None:
    """Every operation of a client, with every option."""

    def fail(_: object) -> None:
        raise ValueError("broken")

    def fail_typed(_: object) -> None:
        raise FailureResponseError("not now", response={"success": False})

    member.advertise("/plain", "std_msgs/String")
    member.advertise("/latched", "std_msgs/String", latch=True)
    member.publish("/plain", "std_msgs/String", {"data": "a"})
    subscription = member.subscribe(
        "/in", print, type="std_msgs/String", throttle_ms=100, queue_length=3, compression=Compression.CBOR
    )
    member.subscribe("/untyped", print)
    member.create_service("/good", "std_srvs/Trigger", lambda _: {"success": True})
    member.create_service("/bad", "std_srvs/Trigger", fail)
    member.create_service("/typed", "std_srvs/Trigger", fail_typed)
    pending = member.call_service_async("/theirs", {"a": 1}, timeout_s=2.5)
    for number, name in enumerate(("/good", "/bad", "/typed", "/gone")):
        suite.send(op="call_service", id=f"service_request:{name}:{number}", service=name, args={})
    eventually(lambda: len(suite.of("service_response")) == 4)
    if suite.ros == 2:
        member.create_action_server("/go", "x/Go", lambda goal: goal.feedback({"step": 1}))
        member.create_action_server("/fail", "x/Go", fail)
        for name in ("/go", "/fail"):
            suite.send(op="send_action_goal", id=f"action_goal:{name}:1", action=name, action_type="x/Go", args={})
        eventually(lambda: len(suite.of("action_result")) == 2)
        goal = member.send_goal("/their_action", "x/Go", {"n": 1}, on_feedback=print)
        goal.cancel()
        assert member.wait_advertised(TIMEOUT_S)
        member.destroy_action_server("/go")
        eventually(lambda: suite.of("cancel_action_goal") and suite.of("unadvertise_action"))
    assert member.wait_advertised(TIMEOUT_S)
    subscription.close()
    member.unadvertise("/plain")
    member.destroy_service("/good")
    eventually(lambda: suite.of("unadvertise_service"))
    assert [(each, bad) for each in suite.received if (bad := violations(each, suite.fields))] == []
    assert {each["op"] for each in suite.received} == set(suite.fields)
    responses = {
        each["service"]: (each["result"], each["values"], each.get("reason")) for each in suite.of("service_response")
    }
    assert responses == {
        "/good": (True, {"success": True}, None),
        "/bad": (False, {}, "/bad failed: ValueError: broken"),
        "/typed": (False, {"success": False}, "not now"),
        "/gone": (False, {}, "Service /gone does not exist"),
    }
    if suite.ros == 2:
        (failed,) = suite.of("action_result", action="/fail")
        assert (failed["values"], failed["reason"]) == ({}, "/fail failed: ValueError: broken")
    assert not pending.done()
    assert member.refusals == ()


def test_the_log_is_subscribed_before_anything_else(suite: SuiteServer) -> None:
    with RosbridgeClient(suite.url) as early:
        early.create_service("/early", "std_srvs/Trigger", dict)
        early.wait_connected(TIMEOUT_S)
        eventually(lambda: suite.of("advertise_service"))
        assert suite.received[0]["topic"] == "/rosout"
        assert early.is_rosbridge_suite


def test_a_refusal_in_the_log_is_of_the_operation_that_caused_it(suite: SuiteServer, member: RosbridgeClient) -> None:
    suite.refuse = lambda message: "no such type" if str(message.get("type", "")).startswith("none") else None
    seen: list[Refusal] = []
    remove = member.add_refusal_listener(seen.append)
    member.create_service("/service", "none/Service", dict)
    member.advertise("/topic", "none_msgs/Message")
    member.subscribe("/topic_in", print, type="none_of_these/Message")
    expected = [("advertise_service", "/service"), ("advertise", "/topic"), ("subscribe", "/topic_in")]
    eventually(lambda: [(each.operation, each.name) for each in seen] == expected)
    assert member.refusals == tuple(seen)
    assert str(seen[0]) == "advertise_service /service: advertise_service: no such type"
    late: list[Refusal] = []
    member.add_refusal_listener(late.append)
    eventually(lambda: late == seen)
    remove()
    # Messages on a refused topic are not sent, since each of them would be refused.
    member.publish("/topic", "none_msgs/Message", {})
    member.publish("/other", "std_msgs/String", {"data": "a"})
    eventually(lambda: suite.of("publish"))
    assert {each["topic"] for each in suite.of("publish")} == {"/other"}


def test_other_lines_of_the_log_are_no_refusals(suite: SuiteServer, member: RosbridgeClient) -> None:
    member.create_service("/mine", "std_srvs/Trigger", dict)
    eventually(lambda: suite.of("advertise_service"))
    own_id = suite.of("advertise_service")[0]["id"]
    suite.log(suite.info, "Advertised service /mine.", own_id)
    suite.log(suite.error, "advertise: of another client", "advertise:/mine:0badcafe")
    suite.log(suite.error, "service_response: of another client", "service_request:/theirs:1")
    suite.log(suite.error, "without an id")
    suite.log(suite.warning, "No match found for service, cancelling service advertisement for: /theirs")
    suite.send(op="publish", topic="/rosout", msg={"msg": f"[id: {own_id}] no level"})
    suite.log(suite.warning, "No match found for service, cancelling service advertisement for: /mine")
    eventually(lambda: member.refusals)  # the log is read in order, so the others have been read
    assert [(each.operation, each.name) for each in member.refusals] == [("advertise_service", "/mine")]


def test_a_call_whose_response_is_refused_ends(suite: SuiteServer, member: RosbridgeClient) -> None:
    suite.refuse = lambda message: "no field sum" if message["op"] == "service_response" else None
    member.create_service("/add", "x/Add", lambda _: {"sum": 3})
    suite.send(op="call_service", id="service_request:/add:1", service="/add", args={})
    eventually(lambda: len(suite.of("service_response")) == 2)
    first, second = suite.of("service_response", id="service_request:/add:1")
    assert (first["values"], first["result"]) == ({"sum": 3}, True)
    assert (second["values"], second["result"]) == ({}, False)
    suite.send(op="call_service", id="service_request:/add:2", service="/add", args={})
    eventually(lambda: len(suite.of("service_response")) == 4)  # one more for each call, although all are refused
    assert [each.name for each in member.refusals] == ["/add"]


def test_a_call_that_is_refused_without_a_response_ends(suite: SuiteServer, member: RosbridgeClient) -> None:
    suite.refuse = lambda message: "Expected field compression" if message["op"] == "call_service" else None
    with pytest.raises(ServiceCallError, match="Expected field compression"):
        member.call_service("/theirs", {}, timeout_s=TIMEOUT_S)


# -- Mindstage's own server --------------------------------------------------------------------------------------------


def test_refusals_of_the_own_server_are_of_their_operation(
    server: RosbridgeServer, local_node: LocalNode, client: Callable[..., RosbridgeClient]
) -> None:
    local_node.create_service("/taken", "std_srvs/Trigger", dict)
    local_node.advertise("/numbers", "std_msgs/Int32")
    seen: list[Refusal] = []
    member = client(on_refusal=seen.append)
    assert not member.is_rosbridge_suite
    member.create_service("/taken", "std_srvs/Trigger", dict)
    member.advertise("/numbers", "std_msgs/String")
    member.subscribe("/numbers", print, type="std_msgs/String")
    expected = [("advertise_service", "/taken"), ("advertise", "/numbers"), ("subscribe", "/numbers")]
    eventually(lambda: [(each.operation, each.name) for each in seen] == expected)
    assert "belongs to the local node" in seen[0].cause


def test_the_reason_of_a_failed_call_reaches_callers_at_the_own_server(client: Callable[..., RosbridgeClient]) -> None:
    def fail(_: object) -> None:
        raise FailureResponseError("not now", response={"success": False})

    provider, caller = client(), client()
    provider.create_service("/fail", "std_srvs/Trigger", fail)
    for one in (provider, caller):  # the first call arrives after the advertisement, on the same connection
        with pytest.raises(ServiceCallError, match="not now"):
            one.call_service("/fail", timeout_s=TIMEOUT_S)


@pytest.mark.parametrize(
    ("type", "message", "cause"),
    [
        ("std_msgs/Int32", {"data": "seven"}, "msg.data: it is not of the type std_msgs/Int32: expected int, got str"),
        ("std_msgs/msg/Int32", {"data": 2**40}, "data"),
        ("std_msgs/String", {"text": "a"}, "text"),
        ("geometry_msgs/Point", [1, 2, 3], "object"),
    ],
)
def test_a_message_of_another_type_is_refused(
    make_raw_client: Callable[..., RawClient], local_node: LocalNode, type: str, message: object, cause: str
) -> None:
    received: list[Any] = []
    local_node.subscribe("/topic", received.append)
    sender = make_raw_client()
    sender.send_operation(op="advertise", topic="/topic", type=type)
    sender.send_operation(op="publish", id="p:1", topic="/topic", msg=message)
    assert cause in sender.receive("status", id="p:1", level="error")["msg"]
    assert not received


def test_messages_of_a_type_that_is_unknown_or_left_out_in_part_are_delivered(
    make_raw_client: Callable[..., RawClient], local_node: LocalNode
) -> None:
    received: list[Any] = []
    local_node.subscribe("/point", received.append)
    local_node.subscribe("/unknown", received.append)
    sender = make_raw_client()
    sender.send_operation(op="advertise", topic="/point", type="geometry_msgs/Point")
    sender.send_operation(op="advertise", topic="/unknown", type="my_msgs/Anything")
    sender.send_operation(op="publish", topic="/point", msg={"x": 1})
    sender.send_operation(op="publish", topic="/unknown", msg={"any": ["thing"]})
    eventually(lambda: len(received) == 2)
    assert sorted(received, key=str) == [{"any": ["thing"]}, {"x": 1}]


def test_a_number_of_another_type_in_a_subscription_is_refused(make_raw_client: Callable[..., RawClient]) -> None:
    client = make_raw_client()
    client.send('{"op":"subscribe","id":"s:1","topic":"/a","throttle_rate":0.0}')
    assert "throttle_rate" in client.receive("status", id="s:1", level="error")["msg"]


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity"])
def test_numbers_that_json_does_not_have_get_a_response_with_the_id(
    make_raw_client: Callable[..., RawClient], number: str
) -> None:
    client = make_raw_client()
    client.send(f'{{"op":"call_service","id":"c:1","service":"/a","args":{{"x":{number}}}}}')
    response = client.receive("service_response", id="c:1")
    assert not response["result"]
    assert "send null" in response["values"]
    client.send(f'{{"op":"call_service","id":["c"],"service":"/a","args":{{"x":{number}}}}}')
    assert client.receive("status", level="error").get("id") is None


@pytest.mark.parametrize("value", [2**80, -(2**80), cbor2.CBORTag(100, 1)])
def test_cbor_values_that_json_does_not_have_get_a_response_with_the_id(
    make_raw_client: Callable[..., RawClient], value: object
) -> None:
    client = make_raw_client()
    call = {"op": "call_service", "id": "c:1", "service": "/a", "args": {"x": value}}
    client.send(cbor2.dumps(call))
    assert "JSON cannot represent it" in client.receive("service_response", id="c:1", result=False)["values"]
    client.send(cbor2.dumps({**call, "args": {"x": 2**40}}))
    assert client.receive("service_response", id="c:1")["result"] is False  # no such service
