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

from mindstage.bridge import Participant
from mindstage.engines import Ability
from mindstage.errors import MindstageError, StageTimedOut
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
from mindstage.ros.diagnostics import health
from mindstage.ros.highlights import lit_groups
from mindstage.ros.outlet import Outlet
from mindstage.ros.pictures import joint_state, transforms, world_markers
from mindstage.ros.sight import Sight
from mindstage.stage import Frame

__all__ = ["Broadcast", "Rates"]

_STILL_S = 1.0
_PING_S = 2.0
_LOOK_S = 0.05
"""So soon is it noticed that an engine is lost, or something was lit [s]."""
_log = logging.getLogger("mindstage.ros")


class Rates(msgspec.Struct, frozen=True, kw_only=True):
    """How often each topic is told while the world plays [Hz]; 0 is never."""

    clock: float = 30.0
    tf: float = 30.0
    joint_states: float = 30.0
    markers: float = 5.0
    health: float = 1.0


@dataclass(slots=True)
class _Beat:
    """Something that is told again and again."""

    period_s: float
    tell: Callable[[Frame], None]
    due: float = 0.0
    told: Frame | None = None
    told_at: float = field(default=-_STILL_S)


class Broadcast:
    """Publishes in threads of its own until `close`."""

    def __init__(
        self,
        participant: Participant,
        sight: Sight,
        *,
        namespace: str,
        ros: RosVersion,
        rates: Rates,
        also: Callable[[], None],
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
        self._sight = sight
        self._stage = sight.stage
        self._ros = ros
        self._also = also
        space = "/".join(("", *filter(None, namespace.split("/"))))
        self._clock = Outlet(participant, "/clock", rosgraph_msgs.Clock, ros=ros)
        self._tf = Outlet(participant, "/tf", tf2_msgs.TFMessage, ros=ros)
        self._joints = Outlet(participant, f"{space}/joint_states", sensor_msgs.JointState, ros=ros)
        self._markers = Outlet(participant, f"{space}/world", visualization_msgs.MarkerArray, ros=ros)
        self._lit = Outlet(participant, f"{space}/highlights", mindstage_msgs.LitGroups, ros=ros, latch=True)
        self._health = Outlet(participant, "/mindstage/health", diagnostic_msgs.DiagnosticArray, ros=ros, latch=True)
        self._lit_told: object = None
        self._lost_told: object = None
        beats = (
            (rates.clock, self._tell_clock),
            (rates.tf, self._tell_tf),
            (rates.joint_states, self._tell_joints),
            (rates.markers, self._tell_markers),
        )
        self._beats = [_Beat(1.0 / rate, tell) for rate, tell in beats if rate > 0.0]
        self._heartbeat_s = 1.0 / rates.health if rates.health > 0.0 else None
        self._closing = threading.Event()
        self._threads = [
            threading.Thread(target=run, name=f"mindstage-ros-{name}", daemon=True)
            for name, run in (("topics", self._run), ("health", self._watch_health))
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Ends it; any number of times."""
        if self._closing.is_set():
            return
        self._closing.set()
        for thread in self._threads:
            thread.join(_PING_S + 5.0)
        for outlet in (self._clock, self._tf, self._joints, self._markers, self._lit, self._health):
            outlet.close()

    # -- again and again -----------------------------------------------------------------------------------------------

    def _run(self) -> None:
        next_look = 0.0
        while True:
            now = time.monotonic()
            due = min([next_look, *(beat.due for beat in self._beats)])
            if self._closing.wait(max(0.0, due - now)):
                return
            now = time.monotonic()
            for beat in self._beats:
                if beat.due <= now:
                    beat.due = max(beat.due + beat.period_s, now)
                    self._guarded(partial(self._beat, beat, now))
            if next_look <= now:
                next_look = now + _LOOK_S
                self._guarded(self._look)

    def _beat(self, beat: _Beat, now: float) -> None:
        frame = self._stage.frame
        if _same(frame, beat.told) and now - beat.told_at < _STILL_S:
            return
        beat.told, beat.told_at = frame, now
        beat.tell(frame)

    def _look(self) -> None:
        frame = self._stage.frame
        if frame.lit is not self._lit_told:
            self._lit_told = frame.lit
            self._lit.publish(lit_groups(frame))
        if self._stage.lost is not self._lost_told:
            self._lost_told = self._stage.lost
            self._health.publish(health(self._stage, took_s=None, trouble=self._stage.lost))
        self._also()

    def _watch_health(self) -> None:
        while self._heartbeat_s is not None and not self._closing.wait(self._heartbeat_s):
            self._guarded(self._tell_health)

    def _guarded(self, tell: Callable[[], None]) -> None:
        try:
            tell()
        except MindstageError as error:
            _log.debug("could not be told: %s", error)  # the health tells of it
        except Exception:
            _log.exception("a topic could not be told")

    # -- what is told --------------------------------------------------------------------------------------------------

    def _tell_clock(self, frame: Frame) -> None:
        if self._clock.wanted:
            self._clock.publish(rosgraph_msgs.Clock(clock=builtin_interfaces.Time.at(frame.time_s)))

    def _tell_tf(self, frame: Frame) -> None:
        if self._tf.wanted:
            self._tf.publish_written(transforms(frame, ros=self._ros))

    def _tell_joints(self, frame: Frame) -> None:
        if self._joints.wanted and Ability.JOINTS in self._stage.abilities:
            positions = self._stage.call(lambda engine: engine.joint_positions(), what="joint positions")
            self._joints.publish(joint_state(frame, self._sight.world().constraints, positions))

    def _tell_markers(self, frame: Frame) -> None:
        if self._markers.wanted:
            self._markers.publish_written(world_markers(frame, self._sight.world().bodies, ros=self._ros))

    def _tell_health(self) -> None:
        trouble: MindstageError | None = None
        took_s = None
        try:
            took_s = self._stage.ping(timeout_s=_PING_S)
        except StageTimedOut as error:
            trouble = self._stage.lost or error
        except MindstageError as error:
            trouble = error
        self._lost_told = self._stage.lost
        self._health.publish(health(self._stage, took_s=took_s, trouble=trouble))


def _same(frame: Frame, before: Frame | None) -> bool:
    """Whether nobody could tell one frame from another."""
    return before is frame or (
        before is not None
        and (frame.time_s, frame.edition, frame.ids) == (before.time_s, before.edition, before.ids)
        and np.array_equal(frame.poses, before.poses)
    )
