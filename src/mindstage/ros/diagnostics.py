"""Diagnostics: rejected operations with their reasons, and the health of the engine; and publishers of topics."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from typing import Any, Generic, TypeVar

from mindstage.access.resources import without_paths
from mindstage.bridge import LocalNode, Node, Refusal, RosbridgeClient
from mindstage.bridge.conversions import ConversionNote
from mindstage.engines import SpawnReport
from mindstage.errors import BridgeError, MindstageError, WorldError
from mindstage.msgs import Message, RosVersion, builtin_interfaces, diagnostic_msgs, encode, std_msgs, type_name
from mindstage.simulation import Simulation

__all__ = ["DiagnosticsPublisher", "Publisher", "SubscriberCount", "health_status"]


M = TypeVar("M", bound=Message)

_POLL_INTERVAL_S = 1.0
"""Interval at which another server is asked for the subscribers of a topic [s]."""


class Publisher(Generic[M]):
    """Publishes messages of one type on one topic, in the format of one version of ROS."""

    def __init__(
        self,
        node: Node,
        topic: str,
        type: type[M],
        *,
        ros: RosVersion = RosVersion.TWO,
        latch: bool = False,
    ) -> None:
        self.topic = topic
        self._node = node
        self._type = type_name(type, ros)
        self._ros = ros
        self._subscribers = SubscriberCount(node, topic)
        node.advertise(topic, self._type, latch=latch)

    @property
    def has_subscribers(self) -> bool:
        """Whether a message might be received; if not, it need not be created."""
        return self._subscribers.has_any

    @property
    def is_transmitted(self) -> bool:
        """Whether messages are sent: always at another server, which is asked for subscribers too rarely for events."""
        return self._node.has_subscribers(self.topic)

    def publish(self, message: M) -> None:
        """Publishes a message."""
        self.publish_encoded(encode(message, ros=self._ros))

    def publish_encoded(self, values: object) -> None:
        """Publishes a message that is already encoded as a JSON object."""
        self._node.publish(self.topic, self._type, values)

    def close(self) -> None:
        """Ends the announcement of the topic."""
        self._node.unadvertise(self.topic)


class SubscriberCount:
    """Whether a topic has subscribers: known at a broker in this process, polled at another server."""

    def __init__(self, node: Node, topic: str, *, now: Callable[[], float] = time.monotonic) -> None:
        self._node = node
        self._topic = topic
        self._now = now
        self._last_answer = True
        self._last_poll_s = -_POLL_INTERVAL_S
        self._pending: Future[Any] | None = None

    @property
    def has_any(self) -> bool:
        """Whether there are subscribers; also true if it is unknown."""
        might_have = self._node.has_subscribers(self._topic)
        if isinstance(self._node, LocalNode) or not might_have:
            return might_have
        if self._pending is not None and self._pending.done():
            self._last_answer, self._pending = _has_subscribers(self._pending), None
        if isinstance(self._node, RosbridgeClient) and self._node.has_rosapi is False:
            return True
        if self._pending is None and self._now() - self._last_poll_s >= _POLL_INTERVAL_S:
            self._last_poll_s = self._now()
            self._poll()
        return self._last_answer

    def _poll(self) -> None:
        try:
            self._pending = self._node.call_service_async("/rosapi/subscribers", {"topic": self._topic}, timeout_s=5.0)
        except BridgeError:
            self._last_answer = True


def _has_subscribers(response: Future[Any]) -> bool:
    """Returns the result of a poll; true if the server cannot answer it."""
    try:
        return bool(response.result()["subscribers"])
    except (BridgeError, KeyError, TypeError):
        return True


class DiagnosticsPublisher:
    """Publishes on `/mindstage/diagnostics` why an operation failed; some responses have no field for it."""

    def __init__(self, publisher: Publisher[diagnostic_msgs.DiagnosticArray], simulation: Simulation) -> None:
        self._publisher = publisher
        self._simulation = simulation

    def report_refusal(self, operation: str, error: WorldError) -> None:
        """Publishes an error of the world as a warning."""
        fields = vars(error)
        id = str(fields.get("body") or fields.get("child") or "")
        self._publish([_status(diagnostic_msgs.Level.WARN, operation, str(error), id, {"code": error.code})])

    def report_error(self, operation: str, error: MindstageError) -> None:
        """Publishes any other error."""
        self._publish([_status(diagnostic_msgs.Level.ERROR, operation, str(error), "", {"code": error.code})])

    def report_late_end(self, call: str, error: BaseException | None) -> None:
        """Publishes the end of a call that was answered before it; see `EngineAccess.on_late_end`."""
        level = diagnostic_msgs.Level.OK if error is None else diagnostic_msgs.Level.ERROR
        text = "it has ended" if error is None else f"it has failed: {error}"
        self._publish([_status(level, call, text, "", {"code": "LateEnd"})])

    def report_server_refusal(self, refusal: Refusal) -> None:
        """Publishes that the rosbridge server refused an operation of this simulation."""
        operation = f"{refusal.operation} {refusal.name}"
        self._publish([_status(diagnostic_msgs.Level.ERROR, operation, refusal.cause, "", {"code": "ServerRefusal"})])

    def report_failures(self, operation: str, reasons: Iterable[tuple[str, str]]) -> None:
        """Publishes partial failures: the id of each object, and the reason."""
        self._publish(_status(diagnostic_msgs.Level.WARN, operation, reason, id, {}) for id, reason in reasons)

    def report_spawn(self, operation: str, report: SpawnReport) -> None:
        """Publishes what could not be spawned."""
        lists = (report.failed_bodies, report.failed_joints, report.failed_attachments)
        self.report_failures(operation, [(failure.id, failure.reason) for failures in lists for failure in failures])

    def report_notes(self, operation: str, notes: Iterable[ConversionNote]) -> None:
        """Publishes what was assumed in a conversion."""
        self._publish(
            _status(diagnostic_msgs.Level.OK, operation, note.text, id, {"field": note.field})
            for note in notes
            for id in note.ids
        )

    def _publish(self, statuses: Iterable[diagnostic_msgs.DiagnosticStatus]) -> None:
        if self._publisher.is_transmitted and (status := tuple(statuses)):
            header = std_msgs.Header(stamp=builtin_interfaces.Time.at(self._simulation.state.time_s))
            self._publisher.publish(diagnostic_msgs.DiagnosticArray(header=header, status=status))


def health_status(
    simulation: Simulation, *, response_time_s: float | None, error: MindstageError | None
) -> diagnostic_msgs.DiagnosticArray:
    """Returns the health of the engine as a message.

    Args:
        response_time_s: response time of the engine [s], or None.
        error: why there was no response, or None.
    """
    snapshot = simulation.state
    if error is not None:
        level, text = diagnostic_msgs.Level.ERROR, str(error)
    elif snapshot.error:
        level, text = diagnostic_msgs.Level.WARN, f"the simulation is paused: {snapshot.error}"
    else:
        level, text = diagnostic_msgs.Level.OK, "playing" if snapshot.playing else "paused"
    values = {
        "time_s": f"{snapshot.time_s:.3f}",
        "bodies": str(len(snapshot.ids)),
        "speed": f"{snapshot.speed:g}",
        "real_time_factor": f"{snapshot.real_time_factor:.3f}",
        "expected_rebuild_s": f"{snapshot.expected_rebuild_s:.3f}",
        "answered_in_s": "" if response_time_s is None else f"{response_time_s:.6f}",
    }
    status = _status(level, f"engine {simulation.engine.name}", text, "", values)
    return diagnostic_msgs.DiagnosticArray(
        header=std_msgs.Header(stamp=builtin_interfaces.Time.at(snapshot.time_s)), status=(status,)
    )


def _status(
    level: diagnostic_msgs.Level, name: str, text: str, id: str, values: Mapping[str, str]
) -> diagnostic_msgs.DiagnosticStatus:
    key_values = {"id": id, **values}
    return diagnostic_msgs.DiagnosticStatus(
        level=level,
        name=f"mindstage: {name}",
        message=without_paths(text),
        hardware_id=id,
        values=tuple(diagnostic_msgs.KeyValue(key=key, value=value) for key, value in key_values.items()),
    )
