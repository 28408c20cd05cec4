"""Publishes the state of a simulation: clock, transforms, joint states, markers, highlights and health.

A message is created only if its topic has subscribers. `/tf` has the transforms that change by motion, `/tf_static` all
others, when one of them has changed. Unchanged values are published once a second, for late
subscribers. Frequent messages with many elements are encoded as JSON objects directly.
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

from mindstage.access.limits import Rate
from mindstage.bridge import Node
from mindstage.bridge.conversions import color_from_message, color_message
from mindstage.engines import Capability, PoseArray
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
from mindstage.ranges import check_fields
from mindstage.ros.diagnostics import DiagnosticsPublisher, Publisher, health_status
from mindstage.ros.frames import ROOT_FRAME, FrameTransforms
from mindstage.ros.state import StateReader
from mindstage.scene import AxisMotion, Body, BodyId, Color, Joint, PrimitiveType
from mindstage.simulation import Simulation, StateSnapshot
from mindstage.simulation.observation import as_client

__all__ = [
    "HighlightSubscriber",
    "PublishRates",
    "StatePublisher",
    "highlight_groups",
    "joint_state_message",
    "tf_message",
    "tf_static_message",
    "world_marker_array",
]

_WORLD_FRAME = "world"
_NAMESPACE = "mindstage"
_DEFAULT_SIZE_M = 0.05
_DEFAULT_COLOR: Color = (0.7, 0.7, 0.7)
_AXES = ("x", "y", "z", "twist", "swing2", "swing1")
_MARKER_TYPES = {
    PrimitiveType.SPHERE: visualization_msgs.MarkerType.SPHERE,
    PrimitiveType.CYLINDER: visualization_msgs.MarkerType.CYLINDER,
}
_IDLE_PUBLISH_INTERVAL_S = 1.0
_PING_INTERVAL_S = 2.0
_POLL_INTERVAL_S = 0.05
"""Interval at which the loss of the engine and changes of highlights are detected [s]."""
_log = logging.getLogger("mindstage.ros")


class HighlightSubscriber:
    """Highlights bodies on request of a message."""

    def __init__(self, simulation: Simulation, diagnostics: DiagnosticsPublisher) -> None:
        self._simulation = simulation
        self._diagnostics = diagnostics

    def on_highlight(self, message: mindstage_msgs.HighlightGroup) -> None:
        """Highlights the bodies; ids without a body are published on the diagnostics."""
        color = color_from_message(message.color) if message.color.a > 0.0 else None
        result = self._simulation.highlight(message.ids, color, label=message.label, missing_ok=True)
        self._diagnostics.report_failures("highlight", [(each.id, each.reason) for each in result.unhighlighted])


def highlight_groups(snapshot: StateSnapshot) -> mindstage_msgs.HighlightGroups:
    """Returns all highlights in a snapshot."""
    groups = (
        mindstage_msgs.HighlightGroup(ids=group.ids, color=color_message(group.color), label=group.label)
        for group in snapshot.highlight_groups
    )
    return mindstage_msgs.HighlightGroups(groups=tuple(groups))


EncodedMessage = dict[str, Any]


def tf_message(transforms: FrameTransforms, *, time_s: float, ros: RosVersion) -> EncodedMessage:
    """Returns transforms as a `tf2_msgs/TFMessage`, with the simulated time [s] as their time stamp.

    Raises:
        EngineError: the engine returned poses that are not finite.
    """
    stamp = builtin_interfaces.Time.at(time_s)
    # One header for each parent, which its children share.
    headers = {
        parent: encode(std_msgs.Header(stamp=stamp, frame_id=parent), ros=ros) for parent in set(transforms.parents)
    }
    rows = _finite_rows(transforms.poses)
    return {
        "transforms": [
            {
                "header": headers[parent],
                "child_frame_id": child,
                "transform": {
                    "translation": {"x": x, "y": y, "z": z},
                    "rotation": {"x": i, "y": j, "z": k, "w": w},
                },
            }
            for parent, child, (x, y, z, w, i, j, k) in zip(transforms.parents, transforms.children, rows, strict=True)
        ]
    }


def tf_static_message(transforms: FrameTransforms, *, time_s: float, ros: RosVersion) -> EncodedMessage:
    """Returns static transforms as a `tf2_msgs/TFMessage`, with that of the frame `world`, which is the root.

    Raises:
        EngineError: the engine returned poses that are not finite.
    """
    world = FrameTransforms(
        (ROOT_FRAME, *transforms.parents),
        (_WORLD_FRAME, *transforms.children),
        np.concatenate([[[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]], transforms.poses]),
    )
    return tf_message(world, time_s=time_s, ros=ros)


def joint_state_message(
    snapshot: StateSnapshot, joints: Iterable[Joint], positions: Mapping[BodyId, tuple[float, ...]]
) -> sensor_msgs.JointState:
    """Returns the displacement of every joint since it was spawned; a joint with several axes has several names."""
    names: list[str] = []
    numbers: list[float] = []
    for joint in joints:
        if joint.id not in positions:
            continue
        axes = [index for index, axis in enumerate(_AXES) if _axis_motion(joint, axis) is not AxisMotion.LOCKED]
        for index in axes:
            names.append(joint.id if len(axes) == 1 else f"{joint.id}/{_AXES[index]}")
            numbers.append(positions[joint.id][index])
    return sensor_msgs.JointState(header=_header(snapshot), name=tuple(names), position=tuple(numbers))


def world_marker_array(snapshot: StateSnapshot, bodies: Iterable[Body], *, ros: RosVersion) -> EncodedMessage:
    """Returns every body as a marker, in a `visualization_msgs/MarkerArray` that replaces the one before."""
    descriptions = {body.id: body for body in bodies}
    header = _header(snapshot)
    blank = encode(visualization_msgs.Marker(header=header, ns=_NAMESPACE), ros=ros)
    markers: list[EncodedMessage] = [{**blank, "action": int(visualization_msgs.MarkerAction.DELETEALL)}]
    for number, (id, (x, y, z, w, i, j, k)) in enumerate(zip(snapshot.ids, _finite_rows(snapshot.poses), strict=True)):
        body = descriptions.get(id)
        width, depth, height = body.size if body and body.size else (_DEFAULT_SIZE_M,) * 3
        red, green, blue = snapshot.highlights.get(id) or _color(body)
        marker_type = (
            _MARKER_TYPES.get(body.shape.type, visualization_msgs.MarkerType.CUBE)
            if body and body.shape
            else visualization_msgs.MarkerType.CUBE
        )
        pose = {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": i, "y": j, "z": k, "w": w}}
        markers.append(
            {
                **blank,
                "id": number,
                "type": int(marker_type),
                "pose": pose,
                "scale": {"x": width, "y": depth, "z": height},
                "color": {"r": red, "g": green, "b": blue, "a": 1.0},
                "text": id,
            }
        )
    return {"markers": markers}


def _header(snapshot: StateSnapshot) -> std_msgs.Header:
    return std_msgs.Header(stamp=builtin_interfaces.Time.at(snapshot.time_s), frame_id=_WORLD_FRAME)


def _finite_rows(poses: PoseArray) -> list[list[float]]:
    if not np.isfinite(poses).all():
        raise EngineError("the engine returned poses that are not finite")
    rows: list[list[float]] = poses.tolist()
    return rows


def _axis_motion(joint: Joint, axis: str) -> AxisMotion:
    motion: AxisMotion = getattr(joint.linear if axis in {"x", "y", "z"} else joint.angular, axis)
    return motion


def _color(body: Body | None) -> Color:
    return (body.color if body else None) or _DEFAULT_COLOR


class PublishRates(msgspec.Struct, frozen=True, kw_only=True):
    """Rate of each topic while the simulation is playing [Hz]; 0 disables it."""

    clock: Rate = 30.0
    tf: Rate = 30.0
    joint_states: Rate = 30.0
    robots: Rate = 50.0
    """Joint states, odometry and the states of controllers of robots."""
    markers: Rate = 5.0
    health: Rate = 1.0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(slots=True)
class _PeriodicTask:
    """A topic that is published periodically."""

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
        publish_robots: Callable[[StateSnapshot], None],
        extra_tick: Callable[[], None],
    ) -> None:
        """Starts to publish.

        Args:
            node: node that publishes.
            state_reader: source of the state.
            namespace: namespace of the topics of this simulation.
            ros: version of ROS for names and formats.
            rates: rates of the topics.
            publish_robots: publishes the states of robots.
            extra_tick: called regularly.
        """
        self._state_reader = state_reader
        self._simulation = state_reader.simulation
        self._ros = ros
        self._extra_tick = extra_tick
        space = "/".join(("", *filter(None, namespace.split("/"))))
        self._clock = Publisher(node, "/clock", rosgraph_msgs.Clock, ros=ros)
        self._tf = Publisher(node, "/tf", tf2_msgs.TFMessage, ros=ros)
        self._tf_static = Publisher(node, "/tf_static", tf2_msgs.TFMessage, ros=ros, latch=True)
        self._joints = Publisher(node, f"{space}/joint_states", sensor_msgs.JointState, ros=ros)
        self._markers = Publisher(node, f"{space}/world", visualization_msgs.MarkerArray, ros=ros)
        self._highlights = Publisher(node, f"{space}/highlights", mindstage_msgs.HighlightGroups, ros=ros, latch=True)
        self._health = Publisher(node, "/mindstage/health", diagnostic_msgs.DiagnosticArray, ros=ros, latch=True)
        self._last_static: FrameTransforms | None = None
        self._last_highlights: object = None
        self._last_error: object = None
        topics = (
            (rates.clock, self._publish_clock),
            (rates.tf, self._publish_tf),
            (rates.joint_states, self._publish_joint_states),
            (rates.robots, publish_robots),
            (rates.markers, self._publish_markers),
        )
        self._tasks = [_PeriodicTask(1.0 / rate, publish) for rate, publish in topics if rate > 0.0]
        self._tick_interval_s = 1.0 / rates.health if rates.health > 0.0 else None
        self._closing = threading.Event()
        self._threads = [
            threading.Thread(target=partial(_run_as_ros, run), name=f"mindstage-ros-{name}", daemon=True)
            for name, run in (("topics", self._run), ("health", self._health_loop))
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stops publishing; calling it again is harmless."""
        if self._closing.is_set():
            return
        self._closing.set()
        for thread in self._threads:
            thread.join(_PING_INTERVAL_S + 5.0)
        for publisher in (
            self._clock,
            self._tf,
            self._tf_static,
            self._joints,
            self._markers,
            self._highlights,
            self._health,
        ):
            publisher.close()

    # -- threads -------------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        next_poll_s = 0.0
        while True:
            now = time.monotonic()
            due_s = min([next_poll_s, *(task.next_time for task in self._tasks)])
            if self._closing.wait(max(0.0, due_s - now)):
                return
            now = time.monotonic()
            for task in self._tasks:
                if task.next_time <= now:
                    task.next_time = max(task.next_time + task.period_s, now)
                    self._with_error_log(partial(self._run_task, task, now))
            if next_poll_s <= now:
                next_poll_s = now + _POLL_INTERVAL_S
                self._with_error_log(self._publish_highlights)

    def _run_task(self, task: _PeriodicTask, now: float) -> None:
        snapshot = self._simulation.state
        if _is_unchanged(snapshot, task.last_state) and now - task.last_time < _IDLE_PUBLISH_INTERVAL_S:
            return
        task.last_state, task.last_time = snapshot, now
        task.publish(snapshot)

    def _publish_highlights(self) -> None:
        snapshot = self._simulation.state
        if snapshot.highlight_groups is not self._last_highlights:
            self._last_highlights = snapshot.highlight_groups
            self._highlights.publish(highlight_groups(snapshot))
        if self._simulation.engine.error is not self._last_error:
            self._last_error = self._simulation.engine.error
            self._health.publish(
                health_status(self._simulation, response_time_s=None, error=self._simulation.engine.error)
            )
        self._extra_tick()

    def _health_loop(self) -> None:
        while self._tick_interval_s is not None and not self._closing.wait(self._tick_interval_s):
            self._with_error_log(self._publish_health)

    def _with_error_log(self, publish: Callable[[], None]) -> None:
        try:
            publish()
        except MindstageError as error:
            _log.debug("not published: %s", error)  # it is published in the health
        except Exception:
            _log.exception("a topic could not be published")

    # -- topics --------------------------------------------------------------------------------------------------------

    def _publish_clock(self, snapshot: StateSnapshot) -> None:
        if self._clock.has_subscribers:
            self._clock.publish(rosgraph_msgs.Clock(clock=builtin_interfaces.Time.at(snapshot.time_s)))

    def _publish_tf(self, snapshot: StateSnapshot) -> None:
        if not (self._tf.has_subscribers or self._tf_static.has_subscribers):
            return
        tree = self._state_reader.frame_tree(now_s=time.monotonic())
        moving, static = tree.transforms(snapshot.ids, snapshot.poses)
        is_new = self._last_static is None or not static.equals(self._last_static)
        if is_new and self._tf_static.has_subscribers:
            self._tf_static.publish_encoded(tf_static_message(static, time_s=snapshot.time_s, ros=self._ros))
            self._last_static = static
        if self._tf.has_subscribers:
            self._tf.publish_encoded(tf_message(moving, time_s=snapshot.time_s, ros=self._ros))

    def _publish_joint_states(self, snapshot: StateSnapshot) -> None:
        if self._joints.has_subscribers and Capability.JOINTS in self._simulation.engine.capabilities:
            positions = self._simulation.engine.run(lambda engine: engine.joint_positions(), label="joint positions")
            of_robots = frozenset[str]().union(*self._state_reader.robot_joints().values())
            joints = [joint for joint in self._state_reader.world().joints if joint.id not in of_robots]
            self._joints.publish(joint_state_message(snapshot, joints, positions))

    def _publish_markers(self, snapshot: StateSnapshot) -> None:
        if self._markers.has_subscribers:
            self._markers.publish_encoded(
                world_marker_array(snapshot, self._state_reader.world().bodies, ros=self._ros)
            )

    def _publish_health(self) -> None:
        ping_error: MindstageError | None = None
        response_time_s = None
        try:
            response_time_s = self._simulation.engine.ping(timeout_s=_PING_INTERVAL_S)
        except SimulationTimeoutError as error:
            ping_error = self._simulation.engine.error or error
        except MindstageError as error:
            ping_error = error
        self._last_error = self._simulation.engine.error
        self._health.publish(health_status(self._simulation, response_time_s=response_time_s, error=ping_error))


def _run_as_ros(run: Callable[[], None]) -> None:
    with as_client("ROS"):
        run()


def _is_unchanged(snapshot: StateSnapshot, before: StateSnapshot | None) -> bool:
    """Whether two snapshots have the same content."""
    return before is snapshot or (
        before is not None
        and (snapshot.time_s, snapshot.revision, snapshot.ids) == (before.time_s, before.revision, before.ids)
        and np.array_equal(snapshot.poses, before.poses)
    )
