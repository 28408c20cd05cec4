"""Messages on `/mindstage/diagnostics`: every failure with its level, object, reason and kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any, cast

import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.bridge import Refusal
from mindstage.bridge.conversions import ConversionNote
from mindstage.engines.base import SpawnFailure, SpawnReport
from mindstage.errors import BodyNotFoundError, BridgeError, InvalidArgumentError
from mindstage.msgs import RosVersion, diagnostic_msgs, encode
from mindstage.ros.diagnostics import DiagnosticsPublisher, Publisher, SubscriberCount, health_status
from mindstage.scene import BodyId
from tests.kitchenette import kitchenette

TOPIC, TYPE = "/mindstage/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"
OK, WARN, ERROR = 0, 1, 2
Status = tuple[int, str, str, dict[str, str]]


class FakeNode:
    """A node of another server: keeps what is published, and answers polls when the test lets it."""

    def __init__(self) -> None:
        self.published: list[Any] = []
        self.topics: list[tuple[str, str, bool]] = []
        self.polls: list[Future[Any]] = []
        self.is_wanted = True
        self.refuses = False

    def advertise(self, topic: str, type: str, *, latch: bool = False) -> None:
        self.topics.append((topic, type, latch))

    def unadvertise(self, topic: str) -> None:
        self.topics = [each for each in self.topics if each[0] != topic]

    def has_subscribers(self, topic: str) -> bool:
        return self.is_wanted

    def publish(self, topic: str, type: str, values: Any) -> None:
        assert (topic, type) == (TOPIC, TYPE)
        self.published.append(values)

    def call_service_async(self, service: str, values: Any, *, timeout_s: float) -> Future[Any]:
        assert (service, values) == ("/rosapi/subscribers", {"topic": TOPIC})
        if self.refuses:
            raise BridgeError("it is gone")
        self.polls.append(Future())
        return self.polls[-1]

    def taken(self) -> list[Status]:
        """The statuses of the messages since the last call: level, name, text, and the values."""
        messages, self.published = self.published, []
        return [found for message in messages for found in statuses(message)]


def statuses(message: Any) -> list[Status]:
    found = []
    for each in message["status"]:
        values = {pair["key"]: pair["value"] for pair in each["values"]}
        assert each["hardware_id"] == values.pop("id")
        if each["hardware_id"]:
            values["id"] = each["hardware_id"]
        level = each["level"]
        found.append((level if isinstance(level, int) else ord(level), each["name"], each["message"], values))
    return found


@pytest.fixture
def node() -> FakeNode:
    return FakeNode()


@pytest.fixture
def sim() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        sim.step(1.5)
        yield sim


@pytest.fixture
def diagnostics(node: FakeNode, sim: Simulation) -> DiagnosticsPublisher:
    return DiagnosticsPublisher(Publisher(cast("Any", node), TOPIC, diagnostic_msgs.DiagnosticArray), sim)


NOT_FOUND = BodyNotFoundError(BodyId("Mugg"), known=["Mug"])
REPORT = SpawnReport(
    failed_bodies=(SpawnFailure("a", "no size"), SpawnFailure("b", "taken")),
    failed_joints=(SpawnFailure("j", "no child"),),
    failed_attachments=(SpawnFailure("c", "no parent"),),
)
NOTES = [ConversionNote("facts", ("Mug", "Drawer"), "they are lost"), ConversionNote("class", ("Lamp",), "unknown")]


@pytest.mark.parametrize(
    ("report", "expected"),
    [
        (
            lambda to: to.report_refusal("move", NOT_FOUND),
            [(WARN, "mindstage: move", str(NOT_FOUND), {"id": "Mugg", "code": "BodyNotFoundError"})],
        ),
        (
            lambda to: to.report_error("ask", InvalidArgumentError("x", cause="is wrong", remedy="give y")),
            [(ERROR, "mindstage: ask", "x: is wrong; give y", {"code": "InvalidArgumentError"})],
        ),
        (
            lambda to: to.report_late_end("step", None),
            [(OK, "mindstage: step", "it has ended", {"code": "LateEnd"})],
        ),
        (
            lambda to: to.report_late_end("step", ValueError("no")),
            [(ERROR, "mindstage: step", "it has failed: no", {"code": "LateEnd"})],
        ),
        (
            lambda to: to.report_server_refusal(Refusal(operation="subscribe", name="/tf", cause="no such type")),
            [(ERROR, "mindstage: subscribe /tf", "no such type", {"code": "ServerRefusal"})],
        ),
        (
            lambda to: to.report_spawn("spawn", REPORT),
            [
                (WARN, "mindstage: spawn", "no size", {"id": "a"}),
                (WARN, "mindstage: spawn", "taken", {"id": "b"}),
                (WARN, "mindstage: spawn", "no child", {"id": "j"}),
                (WARN, "mindstage: spawn", "no parent", {"id": "c"}),
            ],
        ),
        (
            lambda to: to.report_notes("load", NOTES),
            [
                (OK, "mindstage: load", "they are lost", {"id": "Mug", "field": "facts"}),
                (OK, "mindstage: load", "they are lost", {"id": "Drawer", "field": "facts"}),
                (OK, "mindstage: load", "unknown", {"id": "Lamp", "field": "class"}),
            ],
        ),
        (lambda to: to.report_spawn("spawn", SpawnReport()), []),
        (lambda to: to.report_notes("load", []), []),
    ],
)
def test_every_failure_is_published_with_its_object_reason_and_kind(
    node: FakeNode,
    diagnostics: DiagnosticsPublisher,
    report: Callable[[DiagnosticsPublisher], None],
    expected: list[Status],
) -> None:
    report(diagnostics)
    assert len(node.published) == bool(expected), "in one message"
    if expected:
        assert node.published[0]["header"]["stamp"] == {"sec": 1, "nanosec": 500_000_000}
    assert node.taken() == expected


def test_without_a_listener_nothing_is_published(node: FakeNode, diagnostics: DiagnosticsPublisher) -> None:
    node.is_wanted = False
    diagnostics.report_refusal("move", NOT_FOUND)
    assert node.published == []


# -- health ------------------------------------------------------------------------------------------------------------


def test_the_health_has_the_state_of_the_engine_in_numbers(sim: Simulation) -> None:
    ((level, name, text, values),) = statuses(encode(health_status(sim, response_time_s=0.0125, error=None)))
    assert (level, name, text) == (OK, "mindstage: engine null", "paused")
    assert values["time_s"] == "1.500"
    assert (values["bodies"], values["speed"], values["answered_in_s"]) == ("8", "1", "0.012500")
    assert values.keys() == {"time_s", "bodies", "speed", "real_time_factor", "expected_rebuild_s", "answered_in_s"}
    sim.play(speed=2.5)
    ((level, _, text, values),) = statuses(encode(health_status(sim, response_time_s=None, error=None)))
    assert (level, text, values["speed"], values["answered_in_s"]) == (OK, "playing", "2.5", "")
    sim.pause()
    ((level, _, text, _),) = statuses(encode(health_status(sim, response_time_s=None, error=NOT_FOUND)))
    assert (level, text) == (ERROR, str(NOT_FOUND))


# -- publishers --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ros", "type"), [(RosVersion.ONE, "diagnostic_msgs/DiagnosticArray"), (RosVersion.TWO, TYPE)], ids=str
)
@pytest.mark.parametrize("latch", [False, True])
def test_a_topic_is_announced_in_the_format_of_its_version_until_it_is_closed(
    node: FakeNode, ros: RosVersion, type: str, latch: bool
) -> None:
    publisher = Publisher(cast("Any", node), TOPIC, diagnostic_msgs.DiagnosticArray, ros=ros, latch=latch)
    other = Publisher(cast("Any", node), "/other", diagnostic_msgs.DiagnosticArray)
    assert node.topics[0] == (TOPIC, type, latch)
    publisher.close()
    assert [topic for topic, _, _ in node.topics] == [other.topic]


def test_another_server_is_asked_for_subscribers_at_most_once_a_second(node: FakeNode) -> None:
    now = 100.0
    count = SubscriberCount(cast("Any", node), TOPIC, now=lambda: now)
    assert count.has_any, "it is not known yet"
    assert count.has_any
    assert len(node.polls) == 1
    node.polls[0].set_result({"subscribers": []})
    assert not count.has_any
    now += 0.9
    assert not count.has_any
    assert len(node.polls) == 1
    now += 0.1
    assert not count.has_any
    node.polls[1].set_result({"subscribers": ["/rviz"]})
    assert count.has_any
    now += 5.0
    assert count.has_any
    now += 5.0
    assert count.has_any
    assert len(node.polls) == 3, "an answer is waited for before the next poll"
    node.polls[2].set_result({"subscribers": []})
    assert not count.has_any


@pytest.mark.parametrize("answer", [{"other": 1}, None, BridgeError("no rosapi")], ids=str)
def test_a_server_that_cannot_tell_is_published_to(node: FakeNode, answer: Any) -> None:
    now = 100.0
    count = SubscriberCount(cast("Any", node), TOPIC, now=lambda: now)
    assert count.has_any
    node.polls[0].set_result({"subscribers": []})
    assert not count.has_any
    now += 1.0
    assert not count.has_any
    if isinstance(answer, Exception):
        node.polls[1].set_exception(answer)
    else:
        node.polls[1].set_result(answer)
    assert count.has_any
    node.polls[2:] = []
    now += 10.0
    node.refuses = True
    assert count.has_any, "nor can it be asked"
    node.is_wanted = False
    assert not count.has_any, "the connection is closed"
