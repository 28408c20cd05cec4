"""Broadcast: what the face tells unasked: time, poses, joints, forms, lights, and how the engine is.

Nothing is made that nobody hears. What does not change is told once a second, for those who came late.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import msgspec
import numpy as np

from mindstage.bridge import Node
from mindstage.engines import Capability
from mindstage.errors import MindstageError, SimulationTimeoutError
from mindstage.msgs import (
    RosVersion,
    builtin_interfaces,
    diagnostic_msgs,
    mindstage_msgs,
    rosgraph_msgs,
    sensor_msgs,
    tf2_msgs,
    visualization_msgs,
)
from mindstage.ros.diagnostics import health_status
from mindstage.ros.highlights import highlight_groups
from mindstage.ros.outlet import Publisher
from mindstage.ros.pictures import joint_state_message, tf_message, world_marker_array
from mindstage.ros.sight import StateReader
from mindstage.stage import StateSnapshot

__all__ = ["PublishRates", "StatePublisher"]

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
