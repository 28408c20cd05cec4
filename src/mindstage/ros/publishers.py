"""Broadcast: what the face tells unasked: time, poses, joints, forms, lights, and how the engine is.

Nothing is made that nobody hears. What does not change is told once a second, for those who came late.

Highlights: a message lights bodies up, whether or not anyone listens, and tells why.

Pictures: a frame as the messages by which robots know a place: transforms, joint states, markers.

There are many of them every second, so those with many parts are written as JSON objects at once.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import msgspec
import numpy as np

from mindstage.bridge import Node
from mindstage.bridge.conversions import color_from_message, color_message
from mindstage.engines import Capability
from mindstage.errors import EngineError, MindstageError, SimulationTimeoutError
from mindstage.msgs import (
    RosVersion,
    builtin_interfaces,
    diagnostic_msgs,
    encode,
    mindstage_msgs,
    rosgraph_msgs,
    sensor_msgs,
    std_msgs,
    tf2_msgs,
    visualization_msgs,
)
from mindstage.ros.diagnostics import DiagnosticsPublisher, Publisher, health_status
from mindstage.ros.state import StateReader
from mindstage.scene import AxisMotion, Body, BodyId, Color, Joint, PrimitiveType
from mindstage.simulation import Simulation, StateSnapshot

__all__ = [
    "HighlightSubscriber",
    "PublishRates",
    "StatePublisher",
    "highlight_groups",
    "joint_state_message",
    "tf_message",
    "world_marker_array",
]


class HighlightSubscriber:
    """Shows on a stage what messages want lit."""

    def __init__(self, simulation: Simulation, diagnostics: DiagnosticsPublisher) -> None:
        self._simulation = simulation
        self._diagnostics = diagnostics

    def on_highlight(self, message: mindstage_msgs.LitBodies) -> None:
        """Lights up what has a body; what has none is told on the diagnostics."""
        color = color_from_message(message.color) if message.color.a > 0.0 else None
        shown = self._simulation.highlight(message.ids, color, label=message.label, missing_ok=True)
        self._diagnostics.report_failures("highlight", [(each.id, each.reason) for each in shown.unhighlighted])


def highlight_groups(frame: StateSnapshot) -> mindstage_msgs.LitGroups:
    """All that is lit in a frame."""
    groups = (
        mindstage_msgs.LitBodies(ids=group.ids, color=color_message(group.color), label=group.label)
        for group in frame.highlight_groups
    )
    return mindstage_msgs.LitGroups(groups=tuple(groups))


_WORLD_FRAME = "world"
_NAMESPACE = "mindstage"
_DEFAULT_SIZE_M = 0.05
_GRAY: Color = (0.7, 0.7, 0.7)
_AXES = ("x", "y", "z", "twist", "swing2", "swing1")
_MARKER_TYPES = {
    PrimitiveType.SPHERE: visualization_msgs.MarkerType.SPHERE,
    PrimitiveType.CYLINDER: visualization_msgs.MarkerType.CYLINDER,
}

EncodedMessage = dict[str, Any]


def tf_message(frame: StateSnapshot, *, ros: RosVersion) -> EncodedMessage:
    """Where every body is in the world, as a `tf2_msgs/TFMessage`.

    Raises:
        EngineError: the engine tells of places that are no numbers.
    """
    header = encode(_header(frame), ros=ros)
    return {
        "transforms": [
            {
                "header": header,
                "child_frame_id": id,
                "transform": {
                    "translation": {"x": x, "y": y, "z": z},
                    "rotation": {"x": i, "y": j, "z": k, "w": w},
                },
            }
            for id, (x, y, z, w, i, j, k) in zip(frame.ids, _header_stamp(frame), strict=True)
        ]
    }


def joint_state_message(
    frame: StateSnapshot, joints: Iterable[Joint], positions: Mapping[BodyId, tuple[float, ...]]
) -> sensor_msgs.JointState:
    """How far every constraint has moved since it was spawned; one that moves in several ways has several names."""
    names: list[str] = []
    numbers: list[float] = []
    for constraint in joints:
        if constraint.id not in positions:
            continue
        axes = [at for at, axis in enumerate(_AXES) if _axis_motion(constraint, axis) is not AxisMotion.LOCKED]
        for at in axes:
            names.append(constraint.id if len(axes) == 1 else f"{constraint.id}/{_AXES[at]}")
            numbers.append(positions[constraint.id][at])
    return sensor_msgs.JointState(header=_header(frame), name=tuple(names), position=tuple(numbers))


def world_marker_array(frame: StateSnapshot, bodies: Iterable[Body], *, ros: RosVersion) -> EncodedMessage:
    """Every body as a form, as a `visualization_msgs/MarkerArray` that replaces the one before."""
    described = {body.id: body for body in bodies}
    header = _header(frame)
    blank = encode(visualization_msgs.Marker(header=header, ns=_NAMESPACE), ros=ros)
    markers: list[EncodedMessage] = [{**blank, "action": int(visualization_msgs.MarkerAction.DELETEALL)}]
    for number, (id, (x, y, z, w, i, j, k)) in enumerate(zip(frame.ids, _header_stamp(frame), strict=True)):
        body = described.get(id)
        width, depth, height = body.size if body and body.size else (_DEFAULT_SIZE_M,) * 3
        red, green, blue = frame.highlights.get(id) or _color(body)
        form = (
            _MARKER_TYPES.get(body.shape.type, visualization_msgs.MarkerType.CUBE)
            if body and body.shape
            else visualization_msgs.MarkerType.CUBE
        )
        pose = {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": i, "y": j, "z": k, "w": w}}
        markers.append(
            {
                **blank,
                "id": number,
                "type": int(form),
                "pose": pose,
                "scale": {"x": width, "y": depth, "z": height},
                "color": {"r": red, "g": green, "b": blue, "a": 1.0},
                "text": id,
            }
        )
    return {"markers": markers}


def _header(frame: StateSnapshot) -> std_msgs.Header:
    return std_msgs.Header(stamp=builtin_interfaces.Time.at(frame.time_s), frame_id=_WORLD_FRAME)


def _header_stamp(frame: StateSnapshot) -> list[list[float]]:
    if not np.isfinite(frame.poses).all():
        raise EngineError("the engine tells of places that are no numbers")
    rows: list[list[float]] = frame.poses.tolist()
    return rows


def _axis_motion(joint: Joint, axis: str) -> AxisMotion:
    motion: AxisMotion = getattr(joint.linear if axis in {"x", "y", "z"} else joint.angular, axis)
    return motion


def _color(body: Body | None) -> Color:
    colors = (material.color for material in body.materials if material.color) if body else ()
    return next(iter(colors), _GRAY)


_IDLE_PUBLISH_INTERVAL_S = 1.0
_PING_INTERVAL_S = 2.0
_POLL_INTERVAL_S = 0.05
"""So soon is it noticed that an engine is lost, or something was lit [s]."""
_log = logging.getLogger("mindstage.ros")


class PublishRates(msgspec.Struct, frozen=True, kw_only=True):
    """How often each topic is told while the world plays [Hz]; 0 is never."""

    clock: float = 30.0
    tf: float = 30.0
    joint_states: float = 30.0
    markers: float = 5.0
    health: float = 1.0


@dataclass(slots=True)
class _PeriodicTask:
    """Something that is told again and again."""

    period_s: float
    publish: Callable[[StateSnapshot], None]
    next_time: float = 0.0
    last_state: StateSnapshot | None = None
    last_time: float = field(default=-_IDLE_PUBLISH_INTERVAL_S)


class StatePublisher:
    """Publishes in threads of its own until `close`."""

    def __init__(
        self,
        node: Node,
        state_reader: StateReader,
        *,
        namespace: str,
        ros: RosVersion,
        rates: PublishRates,
        extra_tick: Callable[[], None],
    ) -> None:
        """Begins at once.

        Args:
            participant: where.
            sight: what is told of.
            namespace: of the topics that belong to this stage alone.
            ros: whose words to use.
            rates: how often.
            also: called now and then, for whoever else has to be.
        """
        self._state_reader = state_reader
        self._simulation = state_reader.simulation
        self._ros = ros
        self._extra_tick = extra_tick
        space = "/".join(("", *filter(None, namespace.split("/"))))
        self._clock = Publisher(node, "/clock", rosgraph_msgs.Clock, ros=ros)
        self._tf = Publisher(node, "/tf", tf2_msgs.TFMessage, ros=ros)
        self._joints = Publisher(node, f"{space}/joint_states", sensor_msgs.JointState, ros=ros)
        self._markers = Publisher(node, f"{space}/world", visualization_msgs.MarkerArray, ros=ros)
        self._highlights = Publisher(node, f"{space}/highlights", mindstage_msgs.LitGroups, ros=ros, latch=True)
        self._health = Publisher(node, "/mindstage/health", diagnostic_msgs.DiagnosticArray, ros=ros, latch=True)
        self._last_highlights: object = None
        self._last_error: object = None
        beats = (
            (rates.clock, self._publish_clock),
            (rates.tf, self._publish_tf),
            (rates.joint_states, self._publish_joint_states),
            (rates.markers, self._publish_markers),
        )
        self._tasks = [_PeriodicTask(1.0 / rate, tell) for rate, tell in beats if rate > 0.0]
        self._tick_interval_s = 1.0 / rates.health if rates.health > 0.0 else None
        self._closing = threading.Event()
        self._threads = [
            threading.Thread(target=run, name=f"mindstage-ros-{name}", daemon=True)
            for name, run in (("topics", self._run), ("health", self._health_loop))
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Ends it; any number of times."""
        if self._closing.is_set():
            return
        self._closing.set()
        for thread in self._threads:
            thread.join(_PING_INTERVAL_S + 5.0)
        for outlet in (self._clock, self._tf, self._joints, self._markers, self._highlights, self._health):
            outlet.close()

    # -- again and again -----------------------------------------------------------------------------------------------

    def _run(self) -> None:
        next_look = 0.0
        while True:
            now = time.monotonic()
            due = min([next_look, *(beat.next_time for beat in self._tasks)])
            if self._closing.wait(max(0.0, due - now)):
                return
            now = time.monotonic()
            for beat in self._tasks:
                if beat.next_time <= now:
                    beat.next_time = max(beat.next_time + beat.period_s, now)
                    self._with_error_log(partial(self._run_task, beat, now))
            if next_look <= now:
                next_look = now + _POLL_INTERVAL_S
                self._with_error_log(self._publish_highlights)

    def _run_task(self, task: _PeriodicTask, now: float) -> None:
        frame = self._simulation.state
        if _is_unchanged(frame, task.last_state) and now - task.last_time < _IDLE_PUBLISH_INTERVAL_S:
            return
        task.last_state, task.last_time = frame, now
        task.publish(frame)

    def _publish_highlights(self) -> None:
        frame = self._simulation.state
        if frame.highlight_groups is not self._last_highlights:
            self._last_highlights = frame.highlight_groups
            self._highlights.publish(highlight_groups(frame))
        if self._simulation.engine_error is not self._last_error:
            self._last_error = self._simulation.engine_error
            self._health.publish(
                health_status(self._simulation, response_time_s=None, error=self._simulation.engine_error)
            )
        self._extra_tick()

    def _health_loop(self) -> None:
        while self._tick_interval_s is not None and not self._closing.wait(self._tick_interval_s):
            self._with_error_log(self._publish_health)

    def _with_error_log(self, publish: Callable[[], None]) -> None:
        try:
            publish()
        except MindstageError as error:
            _log.debug("could not be told: %s", error)  # the health tells of it
        except Exception:
            _log.exception("a topic could not be told")

    # -- what is told --------------------------------------------------------------------------------------------------

    def _publish_clock(self, frame: StateSnapshot) -> None:
        if self._clock.has_subscribers:
            self._clock.publish(rosgraph_msgs.Clock(clock=builtin_interfaces.Time.at(frame.time_s)))

    def _publish_tf(self, frame: StateSnapshot) -> None:
        if self._tf.has_subscribers:
            self._tf.publish_encoded(tf_message(frame, ros=self._ros))

    def _publish_joint_states(self, frame: StateSnapshot) -> None:
        if self._joints.has_subscribers and Capability.JOINTS in self._simulation.capabilities:
            positions = self._simulation.run_on_engine(lambda engine: engine.joint_positions(), label="joint positions")
            self._joints.publish(joint_state_message(frame, self._state_reader.world().joints, positions))

    def _publish_markers(self, frame: StateSnapshot) -> None:
        if self._markers.has_subscribers:
            self._markers.publish_encoded(world_marker_array(frame, self._state_reader.world().bodies, ros=self._ros))

    def _publish_health(self) -> None:
        trouble: MindstageError | None = None
        took_s = None
        try:
            took_s = self._simulation.ping(timeout_s=_PING_INTERVAL_S)
        except SimulationTimeoutError as error:
            trouble = self._simulation.engine_error or error
        except MindstageError as error:
            trouble = error
        self._last_error = self._simulation.engine_error
        self._health.publish(health_status(self._simulation, response_time_s=took_s, error=trouble))


def _is_unchanged(frame: StateSnapshot, before: StateSnapshot | None) -> bool:
    """Whether nobody could tell one frame from another."""
    return before is frame or (
        before is not None
        and (frame.time_s, frame.revision, frame.ids) == (before.time_s, before.revision, before.ids)
        and np.array_equal(frame.poses, before.poses)
    )
