"""What an episode consists of, whatever it was read from: frames, events and edits of a world over time.

A `Recording` is read by the detection of events, by questions about other times, by replays and by exports. Times are
seconds since the begin of the episode; at a time at which several frames were recorded, the last one counts.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import StrEnum
from typing import Any, NamedTuple, Protocol, runtime_checkable

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.engines.base import Contact, PoseArray
from mindstage.errors import EpisodeError, EpisodeTimeError
from mindstage.ranges import Time, checked
from mindstage.scene import NO_GEOMETRY, BodyGeometry, BodyId, GeometryMap, World
from mindstage.scene.edits import Edit, edit_from_json
from mindstage.scene.transforms import Array, normalize, pose_array, pose_from_array, quat_angle

__all__ = [
    "FAULT_EDIT",
    "RESTING_TOLERANCE",
    "DriveState",
    "EpisodeEdit",
    "EpisodeEvent",
    "EpisodeEventKind",
    "EpisodeFrame",
    "EventState",
    "FrameRecording",
    "Recording",
]

FAULT_EDIT = "fault"
"""The kind of an edit that states that something that is derived from a recording could not be made; its details are
the part, such as "events", and the cause."""
RESTING_TOLERANCE = 1e-3
"""A body that was moved when it was spawned keeps its described pose within this of the pose it got [m, rad]."""
_ROUNDING = 1e-12
"""Poses that differ by less are equal [m, rad]."""


class DriveState(NamedTuple):
    """The state of a joint of a robot, as in `sensor_msgs/JointState`."""

    position: float
    """As in the description of the robot [m or rad]."""
    velocity: float
    effort: float
    """Of its drive [N or Nm]."""


class EpisodeFrame(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The state of a world at one time."""

    time_s: float
    """Time since the begin of the episode [s]."""
    structure: World
    """The world apart from its poses, which are those of an earlier time; the same object until anything else changes,
    such as an attachment."""
    ids: tuple[BodyId, ...]
    """The bodies that exist; the same object until one is added or removed."""
    poses: PoseArray
    """n x 7: position [m] and quaternion (w, x, y, z) in the world frame, in the order of `ids`."""
    joint_positions: Mapping[BodyId, tuple[float, ...]] | None = None
    """Displacement of each joint since it was spawned: x, y, z [m], twist, swing2, swing1 [rad]; None if unknown."""
    contacts: tuple[Contact, ...] | None = None
    """Contacts of the bodies that are awake; None if contacts were not recorded."""
    drives: Mapping[str, DriveState] = {}
    """The joints of robots by id."""
    unmoved_poses: PoseArray | None = None
    """n x 7: where the engine has the bodies while their pose is that of `structure`, which may differ: a map rounds
    quaternions, and an engine moves bodies out of what they overlap. None if the poses are those of `structure`."""

    def world(self) -> World:
        """The world at this time, as a snapshot of the engine. A body that has not moved is that of `structure`."""
        bodies = {body.id: body for body in self.structure.bodies}
        described = pose_array(bodies[id].pose for id in self.ids)
        unmoved = described if self.unmoved_poses is None else self.unmoved_poses
        is_moved = (unmoved != self.poses).any(axis=1)
        if self.unmoved_poses is not None and is_moved.any():
            is_moved[is_moved] = ~_are_at_rest(self.poses[is_moved], unmoved[is_moved], described[is_moved])
        now = [bodies[id] for id in self.ids]
        for row in np.flatnonzero(is_moved).tolist():
            now[row] = replace(now[row], pose=pose_from_array(self.poses[row]))
        return replace(self.structure, bodies=tuple(now))

    def present(self) -> World:
        """The world with every body exactly where the engine has it; see `unmoved_poses`."""
        bodies = {body.id: body for body in self.structure.bodies}
        pairs = zip(self.ids, self.poses, strict=True)
        return replace(
            self.structure, bodies=tuple(replace(bodies[id], pose=pose_from_array(row)) for id, row in pairs)
        )


def _are_at_rest(poses: Array, unmoved: Array, described: Array) -> NDArray[np.bool_]:
    """Whether bodies count as unmoved: those that the engine moved at the spawn, as long as they rest there."""
    rounded = np.column_stack([described[:, :3], normalize(described[:, 3:])])
    is_displaced = np.abs(unmoved - rounded).max(axis=1) > _ROUNDING
    tolerance = np.where(is_displaced, RESTING_TOLERANCE, _ROUNDING)
    is_near = np.abs(poses[:, :3] - unmoved[:, :3]).max(axis=1) <= tolerance
    return np.asarray(is_near & (quat_angle(poses[:, 3:], unmoved[:, 3:]) <= tolerance))


class EpisodeEventKind(StrEnum):
    """The kinds of events, named as the classes of the ontology that stand for them."""

    CONTACT = "Contact"
    """Two bodies touch."""
    SUPPORT = "SupportedBy"
    """A body rests on another one."""
    CONTAINMENT = "ContainedIn"
    """A body is inside another one."""
    GRASP = "Grasping"
    """A body is held: attached to an agent's body, pulled by a force, or touched by a hand from both sides."""
    PICK_UP = "PickingUp"
    """A held body leaves its support."""
    PUT_DOWN = "PuttingDown"
    """A held body gets a support."""
    SLIDE = "Sliding"
    """A body moves along its support."""
    TRANSPORT = "Transporting"
    """A held body is moved to another place, between its supports."""
    OPEN = "Opening"
    """A joint moves away from its closed position."""
    CLOSE = "Closing"
    """A joint moves towards its closed position."""
    FALL = "Falling"
    """A body falls freely."""
    TIP_OVER = "TippingOver"
    """The vertical axis of a body turns by more than 45 degrees while nothing holds it."""
    COLLISION = "Colliding"
    """A contact begins with an impulse."""
    PERFORM = "Performing"
    """A robot performs a skill."""


class EventState(StrEnum):
    """How certain an event is."""

    PROVISIONAL = "provisional"
    """It was found while the recording ran; what came later may end it, change it or withdraw it."""
    WITHDRAWN = "withdrawn"
    """It was found while the recording ran, and was none."""
    FINAL = "final"
    """It follows from the whole recording."""


class EpisodeEvent(msgspec.Struct, frozen=True, kw_only=True):
    """Something that happened, with its participants, its interval, and what it was concluded from."""

    id: str
    """Unique in the episode, such as "PickingUp_3"."""
    kind: EpisodeEventKind
    begin_s: float
    end_s: float | None
    """None while it lasts, and at the end of a recording if it had not ended."""
    thing: BodyId
    """The body that the event is about."""
    other: BodyId | None = None
    """The second participant: what it touches, rests on, is in, or left; None for the ground or without one."""
    agent: str | None = None
    """What caused it: the body that holds the thing, or the name of the client that pulled it."""
    joint: BodyId | None = None
    """The joint that moved."""
    amount: float | None = None
    """Impulse [N s] of contacts and collisions, distance [m] of motions, height [m] of falls, angle [rad] of tipping;
    of opening and closing the travel of the joint [m] or [rad]."""
    evidence: tuple[str, ...] = ()
    """What the event was concluded from, one sentence each, with measured values."""
    state: EventState = EventState.FINAL
    """Events of a recording that runs, or was interrupted, are provisional."""


class EpisodeEdit(msgspec.Struct, frozen=True, kw_only=True):
    """A change of the world that physics did not cause, or a request to the simulation, such as a question."""

    time_s: float
    kind: str
    """What was done: "spawn", "delete", "set poses", "attach", "detach", "set physics", "reset", "highlight",
    "question", "imagination" …"""
    client: str = ""
    """Who did it, such as "viewer", "ROS: /client_3", "Python"."""
    ids: tuple[BodyId, ...] = ()
    """The bodies that it is about."""
    details: Mapping[str, Any] = {}
    """Arguments and results, as JSON values; `edit` is an `Edit` of the world, and `edits` are several."""

    def edits(self, geometry: Iterable[BodyGeometry]) -> tuple[Edit, ...]:
        """The edits of the world that it consists of, to make them again.

        Args:
            geometry: the geometries of the recording.

        Raises:
            InvalidArgumentError: one is not known here, or its geometry is missing.
        """
        found = (*((self.details["edit"],) if "edit" in self.details else ()), *self.details.get("edits", ()))
        return tuple(each if isinstance(each, Edit) else edit_from_json(each, geometry=geometry) for each in found)


@runtime_checkable
class Recording(Protocol):
    """A world over time."""

    @property
    def name(self) -> str:
        """A short name, such as that of the file."""

    @property
    def begin_s(self) -> float:
        """The time of the first frame [s]."""

    @property
    def end_s(self) -> float:
        """The time of the last frame [s]."""

    @property
    def start_unix_s(self) -> float | None:
        """The wall time at which the episode began, in seconds since 1970; None if it is unknown."""

    @property
    def geometry(self) -> GeometryMap:
        """The geometry of the bodies, as far as it is known."""

    @property
    def spawned(self) -> tuple[World, ...]:
        """The worlds as they were at the begin, one per map."""

    def frame_at(self, time_s: Time) -> EpisodeFrame:
        """The last frame at or before a time [s].

        Raises:
            EpisodeTimeError: the time is before the begin or after the end of the recording.
        """

    def frames(self, begin_s: Time | None = None, end_s: Time | None = None) -> Iterator[EpisodeFrame]:
        """All frames between two times [s], both included, in the order of time."""

    def events(self) -> tuple[EpisodeEvent, ...]:
        """All events, in the order of their begin; those of a recording without events are detected now, once."""

    def edits(self) -> tuple[EpisodeEdit, ...]:
        """All edits and requests, in the order of time."""


class FrameRecording:
    """A recording whose frames are all in memory."""

    @checked
    def __init__(
        self,
        frames: Iterable[EpisodeFrame],
        *,
        name: str = "recording",
        start_unix_s: Time | None = None,
        geometry: GeometryMap = NO_GEOMETRY,
        spawned: tuple[World, ...] = (),
        edits: tuple[EpisodeEdit, ...] = (),
        events: tuple[EpisodeEvent, ...] | Callable[[Recording], tuple[EpisodeEvent, ...]] = (),
        source: str = "episode",
    ) -> None:
        """Takes the frames, in the order of time.

        Args:
            frames: at least one.
            name: see `Recording`, as the next ones.
            start_unix_s: see `Recording`.
            geometry: see `Recording`.
            spawned: see `Recording`; by default the world of the first frame.
            edits: see `Recording`.
            events: the events, or a function that detects them when they are first asked for.
            source: the name of the engine that simulated it, which answers about its states have.

        Raises:
            EpisodeError: there is no frame, or the times decrease.
        """
        self._frames = tuple(frames)
        self._times = [frame.time_s for frame in self._frames]
        if not self._frames:
            raise EpisodeError(f"{name} has no frame")
        for before, after in zip(self._times, self._times[1:], strict=False):
            if not after >= before:
                raise EpisodeError(f"{name} has a frame at {after:g} s after one at {before:g} s")
        self.name = name
        self.start_unix_s = start_unix_s
        self.geometry = geometry
        self.spawned = spawned or (self._frames[0].world(),)
        self._edits = edits
        self._events = events
        self.source = source

    @property
    def begin_s(self) -> float:
        """See `Recording`."""
        return self._times[0]

    @property
    def end_s(self) -> float:
        """See `Recording`."""
        return self._times[-1]

    @checked
    def frame_at(self, time_s: Time) -> EpisodeFrame:
        """See `Recording`."""
        if not self.begin_s <= time_s <= self.end_s:
            raise EpisodeTimeError(self.name, time_s=time_s, begin_s=self.begin_s, end_s=self.end_s)
        return self._frames[bisect_right(self._times, time_s) - 1]

    @checked
    def frames(self, begin_s: Time | None = None, end_s: Time | None = None) -> Iterator[EpisodeFrame]:
        """See `Recording`."""
        begin = 0 if begin_s is None else bisect_left(self._times, begin_s)
        end = len(self._times) if end_s is None else bisect_right(self._times, end_s)
        return iter(self._frames[begin:end])

    def events(self) -> tuple[EpisodeEvent, ...]:
        """See `Recording`."""
        if not isinstance(self._events, tuple):
            self._events = self._events(self)
        return self._events

    def edits(self) -> tuple[EpisodeEdit, ...]:
        """See `Recording`."""
        return self._edits
