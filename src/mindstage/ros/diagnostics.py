"""Diagnostics: what the world refused, why, and about which body; and how the engine is, like a heartbeat.

Outlet: a topic on which the face publishes, and whether it is worth the trouble.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from typing import Any, Generic, TypeVar

from mindstage.bridge import LocalNode, Node
from mindstage.bridge.conversions import ConversionNote
from mindstage.engines import SpawnReport
from mindstage.errors import BridgeError, MindstageError, ServiceCallError, ServiceNotFoundError, WorldError
from mindstage.msgs import Message, RosVersion, builtin_interfaces, diagnostic_msgs, encode, std_msgs, type_name
from mindstage.simulation import Simulation

__all__ = ["DiagnosticsPublisher", "Publisher", "SubscriberCount", "health_status"]


M = TypeVar("M", bound=Message)

_POLL_INTERVAL_S = 1.0
"""So often someone else's hub is asked who listens [s]."""


class Publisher(Generic[M]):
    """Publishes one type on one topic, in the words of one ROS."""

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
        """Whether anyone may be listening; what nobody hears need not be made."""
        return self._subscribers.has_any

    def publish(self, message: M) -> None:
        """Publishes; a message that nobody hears is no error."""
        self.publish_encoded(encode(message, ros=self._ros))

    def publish_encoded(self, values: object) -> None:
        """Publishes what somebody else has written as JSON objects, for speed."""
        self._node.publish(self.topic, self._type, values)

    def close(self) -> None:
        """Publishes nothing more."""
        self._node.unadvertise(self.topic)


class SubscriberCount:
    """Whether a topic has any: our own hub knows it, another one is asked now and then."""

    def __init__(self, node: Node, topic: str, *, now: Callable[[], float] = time.monotonic) -> None:
        self._node = node
        self._topic = topic
        self._now = now
        self._last_answer = True
        self._last_poll_s = -_POLL_INTERVAL_S
        self._pending: Future[Any] | None = None

    @property
    def has_any(self) -> bool:
        """Whether there are; also where nobody can tell."""
        here = self._node.has_subscribers(self._topic)
        if isinstance(self._node, LocalNode) or not here:
            return here
        if self._pending is not None and self._pending.done():
            self._last_answer, self._pending = _has_subscribers(self._pending), None
        if self._pending is None and self._now() - self._last_poll_s >= _POLL_INTERVAL_S:
            self._last_poll_s = self._now()
            self._poll()
        return self._last_answer

    def _poll(self) -> None:
        try:
            self._pending = self._node.call_service_async("/rosapi/subscribers", {"topic": self._topic}, timeout_s=5.0)
        except BridgeError:
            self._last_answer = True


def _has_subscribers(asked: Future[Any]) -> bool:
    """What the other hub says; one that cannot tell may have listeners."""
    try:
        return bool(asked.result()["subscribers"])
    except (ServiceNotFoundError, ServiceCallError, KeyError, TypeError):
        return True
    except BridgeError:
        return True


class DiagnosticsPublisher:
    """Tells on `/mindstage/diagnostics` why something was refused or broke: some replies have no room for a reason."""

    def __init__(self, publisher: Publisher[diagnostic_msgs.DiagnosticArray], simulation: Simulation) -> None:
        self._publisher = publisher
        self._simulation = simulation

    def report_refusal(self, operation: str, error: WorldError) -> None:
        """The world says no."""
        facts = vars(error)
        about = str(facts.get("body") or facts.get("child") or "")
        self._publish([_status(diagnostic_msgs.Level.WARN, operation, str(error), about, {"kind": error.code})])

    def report_error(self, operation: str, error: MindstageError) -> None:
        """The reason lies elsewhere."""
        self._publish([_status(diagnostic_msgs.Level.ERROR, operation, str(error), "", {"kind": error.code})])

    def report_failures(self, operation: str, reasons: Iterable[tuple[str, str]]) -> None:
        """Some of many things did not go: the id of each, and why."""
        self._publish([_status(diagnostic_msgs.Level.WARN, operation, reason, id, {}) for id, reason in reasons])

    def report_spawn(self, operation: str, report: SpawnReport) -> None:
        """What could not be spawned."""
        lists = (report.failed_bodies, report.failed_joints, report.failed_attachments)
        self.report_failures(operation, [(failure.id, failure.reason) for failures in lists for failure in failures])

    def report_notes(self, operation: str, notes: Iterable[ConversionNote]) -> None:
        """What was assumed on the way in."""
        told = ((remark, id) for remark in notes for id in remark.ids)
        self._publish(
            [
                _status(diagnostic_msgs.Level.OK, operation, remark.text, id, {"field": remark.field})
                for remark, id in told
            ]
        )

    def _publish(self, status: list[diagnostic_msgs.DiagnosticStatus]) -> None:
        if status:
            header = std_msgs.Header(stamp=builtin_interfaces.Time.at(self._simulation.state.time_s))
            self._publisher.publish(diagnostic_msgs.DiagnosticArray(header=header, status=tuple(status)))


def health_status(
    simulation: Simulation, *, response_time_s: float | None, error: MindstageError | None
) -> diagnostic_msgs.DiagnosticArray:
    """How the engine is.

    Args:
        stage: whose.
        took_s: how long its answer took [s].
        trouble: why there was none.
    """
    frame = simulation.state
    if error is not None:
        level, text = diagnostic_msgs.Level.ERROR, str(error)
    elif frame.error:
        level, text = diagnostic_msgs.Level.WARN, f"the world stands still: {frame.error}"
    else:
        level, text = diagnostic_msgs.Level.OK, "playing" if frame.playing else "paused"
    values = {
        "time_s": f"{frame.time_s:.3f}",
        "bodies": str(len(frame.ids)),
        "speed": f"{frame.speed:g}",
        "real_time_factor": f"{frame.real_time_factor:.3f}",
        "answered_in_s": "" if response_time_s is None else f"{response_time_s:.6f}",
    }
    status = _status(level, f"engine {simulation.engine_name}", text, "", values)
    return diagnostic_msgs.DiagnosticArray(
        header=std_msgs.Header(stamp=builtin_interfaces.Time.at(frame.time_s)), status=(status,)
    )


def _status(
    level: diagnostic_msgs.Level, name: str, text: str, ids: str, values: Mapping[str, str]
) -> diagnostic_msgs.DiagnosticStatus:
    told = {"id": ids, **values}
    return diagnostic_msgs.DiagnosticStatus(
        level=level,
        name=f"mindstage: {name}",
        message=text,
        hardware_id=ids,
        values=tuple(diagnostic_msgs.KeyValue(key=key, value=value) for key, value in told.items()),
    )
