"""Recordings made of transforms: the frames of tf as the bodies of a known map.

Frames are bodies of the map where their names agree, and the positions of joints move what the joints of the map move.
What is attached to a moved body moves with it; all other bodies stay as in the map. What could not be used is listed in
the result, never dropped silently.

Times are those in the headers of the log. Where all stamps of a frame are 0, the times at which it was recorded
take their place. A transform that comes late is sorted in. Where the clock was set back (the stamps of one frame
decrease by more than `CLOCK_RESET_S`), what follows continues after it, at the distance in which it was recorded; this
is a finding.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.kinematic_tree import AXIS_NAMES, joint_coordinates, movable_axes
from mindstage.episodes.detection import detect_events
from mindstage.episodes.recording import EpisodeEdit, EpisodeEvent, EpisodeFrame, Recording
from mindstage.errors import BodyNotFoundError, EpisodeError, EpisodeTimeError
from mindstage.scene import NO_GEOMETRY, BodyId, GeometryMap, Joint, World
from mindstage.scene.display import counted, short_name
from mindstage.scene.joint_kinematics import coupled_positions, first_movable_axis, moving_body
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_array,
    pose_inverse,
    pose_multiply,
    quat_multiply,
)

__all__ = ["CLOCK_RESET_S", "MAX_GAP_S", "TransformLog", "TransformRecording", "listed"]

MAX_GAP_S = 0.5
"""Two transforms of a frame that are farther apart are not interpolated; until the second one the first one holds. Many
programs publish a transform only when it changes."""
CLOCK_RESET_S = 1.0
"""A frame whose stamps decrease by more than this shows that the clock was set back [s]."""
_MAP_FRAMES = ("map", "world", "/map", "/world")
_MOST_NAMED = 8
"""Number of names in a finding."""
_MOST_FINDINGS = 100
_NS = 1e-9
_FIRST_WALL_TIME_NS = 10**17
"""In March 1973: earlier stamps are those of a simulated clock."""
_IDENTITY = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


@dataclass(slots=True)
class _Samples:
    """The transforms of one frame, or the positions of one joint."""

    stamps: list[int] = field(default_factory=list)
    """The times in the headers [ns]."""
    logged: list[int] = field(default_factory=list)
    """When each was recorded [ns]."""
    times: list[float] = field(default_factory=list)
    """Since the begin of the recording [s]; set by `_Timeline`."""
    values: list[Any] = field(default_factory=list)
    parents: list[str] = field(default_factory=list)


class TransformLog:
    """The transforms and joint positions of a file, in the order of recording."""

    def __init__(self) -> None:
        """Starts empty."""
        self.moving: dict[str, _Samples] = {}
        """By the name of the frame, without a leading slash; values are poses in the frame of the parent."""
        self.static: dict[str, _Samples] = {}
        """As `moving`."""
        self.joints: dict[str, _Samples] = {}
        """By the name of the joint."""
        self.findings: list[str] = []
        """What was irregular, one sentence each."""

    def add_transform(
        self, child: str, parent: str, pose: Sequence[float], *, stamp_ns: int, logged_ns: int, is_static: bool = False
    ) -> None:
        """Adds a transform; one that is not finite, or whose frame is its own parent, is left out with a finding.

        Args:
            child: the frame; a leading slash is dropped, as of the parent.
            parent: the frame that the pose is in.
            pose: x y z [m], then w x y z of any norm.
            stamp_ns: the time in the header [ns]; 0 if it has none.
            logged_ns: when it was recorded [ns].
            is_static: whether it holds from then on, or until another static one.
        """
        child, parent = child.lstrip("/"), parent.lstrip("/")
        x, y, z, w, i, j, k = pose
        size = math.sqrt(w * w + i * i + j * j + k * k)
        # Plain numbers: arrays of seven would take most of the time of reading a bag.
        if not math.isfinite(x + y + z + size) or size < 1e-6 or child == parent:
            cause = "is its own parent" if child == parent else f"has the invalid pose {list(pose)}"
            text = f"a transform of {child} {cause}; such transforms are left out"
            if text not in self.findings and len(self.findings) < _MOST_FINDINGS:
                self.findings.append(text)
            return
        samples = (self.static if is_static else self.moving).setdefault(child, _Samples())
        samples.stamps.append(stamp_ns)
        samples.logged.append(logged_ns)
        samples.values.append((x, y, z, w / size, i / size, j / size, k / size))
        samples.parents.append(parent)

    def add_joint(self, name: str, position: float, *, stamp_ns: int, logged_ns: int) -> None:
        """Adds a position of a joint [m or rad], relative to the map."""
        samples = self.joints.setdefault(name, _Samples())
        samples.stamps.append(stamp_ns)
        samples.logged.append(logged_ns)
        samples.values.append(position)

    def __bool__(self) -> bool:
        return bool(self.moving or self.static or self.joints)


class TransformRecording:
    """The transforms of a file as a `Recording` of a map."""

    def __init__(
        self,
        log: TransformLog,
        world: World,
        *,
        name: str,
        bodies: Mapping[str, BodyId] | None = None,
        map_frame: str | None = None,
        relative: bool | Collection[str] = False,
        rate_hz: float | None = 30.0,
        geometry: GeometryMap = NO_GEOMETRY,
        events: Callable[[Recording], tuple[EpisodeEvent, ...]] | None = None,
    ) -> None:
        """Matches the frames with the map and computes the poses of all bodies.

        Args:
            log: what was read, which is not changed afterwards; not empty.
            world: the map, whose bodies and joints were recorded.
            name: see `Recording`.
            bodies: the ids of the bodies of frames whose names do not show it. By default a frame is the body whose id,
                IRI, or local name of its IRI is the name of the frame, without a leading slash.
            map_frame: the frame in which the poses of the map are; by default `map` or `world`, or the only root.
            relative: frames whose origin is not that of their body, or True for all: such a body has its pose in the
                map when the frame is first seen, and then moves with the frame.
            rate_hz: the most frames per second; None for a frame at each stamp.
            geometry: the geometry of the bodies, as of `Simulation.geometry`.
            events: detects the events when they are first asked for; by default `detect_events`.

        Raises:
            EpisodeError: the frame of the map is not clear.
            BodyNotFoundError: `bodies` names a body that is not in the map.
        """
        self.name = name
        self.geometry = geometry
        self.spawned = (world,)
        self.world = world
        """The map."""
        self._detect = events
        known = {body.id for body in world.bodies}
        for id in (bodies or {}).values():
            if id not in known:
                raise BodyNotFoundError(id, known=sorted(known), world=world.name)
        self._findings = log.findings
        clock = _Timeline(log, self._findings)
        self.start_unix_s = clock.start_unix_s
        self._times = clock.frame_times(rate_hz)
        tree = _TransformTree(log, self._times, map_frame, self._findings, name)
        self.map_frame = tree.map_frame
        """The frame in which the poses of the map are; empty if there are no transforms."""
        self._match(log, tree, bodies or {})
        self._move(log, tree, relative)

    # -- what was found ------------------------------------------------------------------------------------------------

    matched: Mapping[str, BodyId]
    """The body of each frame that is one."""
    matched_joints: Mapping[str, BodyId]
    """The joint of each name in `/joint_states` that is one."""
    unmatched_frames: tuple[str, ...]
    """Frames that are no body or joint of the map, such as those of a robot that is not in it."""
    unmatched_joints: tuple[str, ...]
    """Names in `/joint_states` that are no joint of the map."""
    unmatched_bodies: tuple[BodyId, ...]
    """Bodies that have no frame and that nothing moves: they stay as in the map."""

    @property
    def findings(self) -> tuple[str, ...]:
        """What was irregular, and what was done about it, one sentence each."""
        lines = list(self._findings)
        for names, text in (
            (self.unmatched_frames, "no body of the map; their motion is not shown"),
            (self.unmatched_joints, "no joint of the map; their positions are not used"),
        ):
            if names:
                lines.append(f"{listed(names)}: {text}")
        if self.unmatched_bodies:
            count = counted(len(self.unmatched_bodies), "body")
            lines.append(f"{count} without a frame stay as in the map: {listed(self.unmatched_bodies)}")
        return tuple(lines)

    # -- the recording -------------------------------------------------------------------------------------------------

    @property
    def begin_s(self) -> float:
        """See `Recording`."""
        return 0.0

    @property
    def end_s(self) -> float:
        """See `Recording`."""
        return float(self._times[-1])

    def frame_at(self, time_s: float) -> EpisodeFrame:
        """See `Recording`."""
        if not self.begin_s <= time_s <= self.end_s:
            raise EpisodeTimeError(self.name, time_s=time_s, begin_s=self.begin_s, end_s=self.end_s)
        return self._frame(bisect_right(self._times, time_s) - 1)

    def frames(self, begin_s: float | None = None, end_s: float | None = None) -> Iterator[EpisodeFrame]:
        """See `Recording`."""
        begin = 0 if begin_s is None else bisect_left(self._times, begin_s)
        end = len(self._times) if end_s is None else bisect_right(self._times, end_s)
        return (self._frame(row) for row in range(begin, end))

    def events(self) -> tuple[EpisodeEvent, ...]:
        """See `Recording`."""
        return self._events

    def edits(self) -> tuple[EpisodeEdit, ...]:
        """See `Recording`; a bag has none."""
        return ()

    @cached_property
    def _events(self) -> tuple[EpisodeEvent, ...]:
        return detect_events(self) if self._detect is None else self._detect(self)

    def _frame(self, row: int) -> EpisodeFrame:
        poses = self._map_poses.copy()
        if self._moved_rows:
            poses[self._moved_rows] = self._moved_poses[:, row]
        joints = {id: tuple(positions[row].tolist()) for id, positions in self._joint_positions.items()}
        return EpisodeFrame(
            time_s=float(self._times[row]),
            structure=self.world,
            ids=self._ids,
            poses=poses,
            joint_positions=joints or None,
        )

    # -- reading -------------------------------------------------------------------------------------------------------

    def _match(self, log: TransformLog, tree: _TransformTree, given: Mapping[str, BodyId]) -> None:
        """Finds the bodies and joints that the frames and the names of joints stand for."""
        by_name = _by_name((body.id, body.iri) for body in self.world.bodies)
        joints = {joint.id: joint for joint in self.world.joints}
        joint_by_name = _by_name((joint.id, joint.iri) for joint in self.world.joints)
        given = {frame.lstrip("/"): id for frame, id in given.items()}
        matched: dict[str, BodyId] = {}
        unmatched: list[str] = []
        for frame in tree.names:
            id = given.get(frame) or by_name.get(frame)
            if id in matched.values():
                first = next(other for other, taken in matched.items() if taken == id)
                self._findings.append(f"the frames {first} and {frame} are both the body {id}; {first} is used")
                unmatched.append(frame)
            elif id is not None:
                matched[frame] = id
            elif frame not in joint_by_name and frame != tree.map_frame and frame not in {"map", "world"}:
                unmatched.append(frame)
        for frame in sorted(given.keys() - set(tree.names)):
            self._findings.append(f"there is no frame {frame}, which is given as that of {given[frame]}")
        self.matched, self.unmatched_frames = matched, tuple(unmatched)

        found: dict[str, tuple[BodyId, int]] = {}
        for name in log.joints:
            base, _, axis = name.rpartition("/") if name.rpartition("/")[2] in AXIS_NAMES else (name, "", "")
            joint_id = joint_by_name.get(base.lstrip("/"))
            index = None if joint_id is None else _axis_index(joints[joint_id], axis)
            if joint_id is not None and index is not None:
                found[name] = (joint_id, index)
        self._joint_axes = found
        self.matched_joints = {name: id for name, (id, _) in found.items()}
        self.unmatched_joints = tuple(name for name in log.joints if name not in found)

    def _move(self, log: TransformLog, tree: _TransformTree, relative: bool | Collection[str]) -> None:
        """Computes the poses of all bodies that move, at all times."""
        world, times = self.world, self._times
        self._ids = tuple(body.id for body in world.bodies)
        rows = {id: row for row, id in enumerate(self._ids)}
        self._map_poses = pose_array(body.pose for body in world.bodies)
        known = self._map_poses.copy()
        known[:, 3:] = normalize(known[:, 3:])
        moved: dict[BodyId, Array] = {}
        for frame, id in self.matched.items():
            at_frame, is_known = tree.poses(frame)
            start = known[rows[id]]
            if not is_known.any():
                self._findings.append(
                    f"the frame {frame} is never connected to {tree.map_frame}; {id} is as in the map"
                )
                continue
            first = int(np.argmax(is_known))
            if relative is True or (relative is not False and frame in {each.lstrip("/") for each in relative}):
                frame_from_body = pose_multiply(pose_inverse(at_frame[first]), start)
                at_frame = pose_multiply(at_frame, frame_from_body)
            if not is_known.all():
                missing = ~is_known
                # Where the frame is not connected, the body stays where it was seen last; before, as in the map.
                last = np.maximum.accumulate(np.where(is_known, np.arange(len(times)), -1))
                at_frame = np.where((last >= 0)[:, None], at_frame[np.maximum(last, 0)], start)
                self._findings.append(
                    f"the frame {frame} is not connected to {tree.map_frame} at {missing.sum():,} of {len(times):,} "
                    f"times, first at {times[int(np.argmax(missing))]:.3f} s; {id} stays where it was"
                )
            moved[id] = at_frame
        self._joint_positions: dict[BodyId, Array] = {}
        motion = _JointMotion(world, known, rows)
        displacements = self._displacements(log)
        motion.follow(moved, displacements)
        for joint in world.joints:
            positions = motion.measured(joint, moved, displacements, len(times))
            if positions is not None:
                self._joint_positions[joint.id] = positions
        seen = set(self.matched.values())
        moved = {id: poses for id, poses in moved.items() if id in seen or (poses != known[rows[id]]).any()}
        self._moved_rows = [rows[id] for id in moved]
        self._moved_poses = np.array([moved[id] for id in moved]).reshape(len(moved), len(times), 7)
        self.unmatched_bodies = tuple(id for id in self._ids if id not in moved)

    def _displacements(self, log: TransformLog) -> dict[BodyId, Array]:
        """The coordinates of each joint that was recorded, times x 6, with those that mimic it."""
        joints = {joint.id: joint for joint in self.world.joints}
        found: dict[BodyId, Array] = {}
        for name, (id, index) in self._joint_axes.items():
            samples = log.joints[name]
            stamps, values = np.array(samples.times), np.array(samples.values)
            order = np.argsort(stamps, kind="stable")
            positions = found.setdefault(id, np.zeros((len(self._times), 6)))
            positions[:, index] = _interpolated(stamps[order], values[order], self._times)
        for id in list(found):
            axis = first_movable_axis(joints[id])
            others = coupled_positions(joints, id, 1.0) if axis is not None else {}
            for other in others:
                other_axis = first_movable_axis(joints[other])
                if other not in found and other_axis is not None and axis is not None:
                    found[other] = np.zeros((len(self._times), 6))
                    found[other][:, other_axis] = [
                        coupled_positions(joints, id, float(value))[other] for value in found[id][:, axis]
                    ]
        return found


# -- time --------------------------------------------------------------------------------------------------------------


class _Timeline:
    """One time axis for all messages: it sets their times, in seconds since the first of them."""

    def __init__(self, log: TransformLog, findings: list[str]) -> None:
        moving = [*log.moving.values(), *log.joints.values()]
        _add_missing_stamps(moving)
        _shift_after_resets(moving, findings)
        stamps = [stamp for samples in moving for stamp in samples.stamps]
        if not stamps:
            stamps = [stamp for samples in log.static.values() for stamp in samples.logged]
        begin = min(stamps)
        self.start_unix_s = begin * _NS if begin > _FIRST_WALL_TIME_NS else None
        """None if the stamps are those of a simulation, which begin near 0."""
        for samples in moving:
            samples.times = [(stamp - begin) * _NS for stamp in samples.stamps]
        start = min(logged for samples in (moving or log.static.values()) for logged in samples.logged)
        for samples in log.static.values():
            # Stamps of static transforms are often those of another program's start: the first one holds from the
            # begin, a later one from when it was recorded.
            samples.times = [(logged - start) * _NS for logged in samples.logged]
        self._times = sorted({time for samples in moving for time in samples.times}) or [0.0]

    def frame_times(self, rate_hz: float | None) -> Array:
        """The times of the frames of the recording: stamps, at most `rate_hz` of them per second, and the last one."""
        if rate_hz is None:
            return np.array(self._times)
        period, kept = 0.999 / rate_hz, [self._times[0]]
        for time in self._times:
            if time - kept[-1] >= period:
                kept.append(time)
        if kept[-1] != self._times[-1]:
            kept.append(self._times[-1])
        return np.array(kept)


def _add_missing_stamps(moving: Sequence[_Samples]) -> None:
    """Sets the stamps of frames that have none from when they were recorded, on the clock of the others."""
    unstamped = [samples for samples in moving if not any(samples.stamps)]
    offsets = [
        stamp - logged
        for samples in moving
        if any(samples.stamps)
        for stamp, logged in zip(samples.stamps, samples.logged, strict=True)
    ]
    offset = int(np.median(offsets)) if offsets else 0
    for samples in unstamped:
        samples.stamps = [logged + offset for logged in samples.logged]


def _shift_after_resets(moving: Sequence[_Samples], findings: list[str]) -> None:
    """Shifts the stamps of what was recorded after the clock was set back to after those before."""
    limit = int(CLOCK_RESET_S / _NS)
    resets: list[tuple[int, int, int]] = []
    for samples in moving:
        for row in range(1, len(samples.stamps)):
            back = samples.stamps[row - 1] - samples.stamps[row]
            if back > limit:
                logged = samples.logged[row]
                resets.append((logged, back, max(logged - samples.logged[row - 1], 0)))
    shift = 0
    starts: list[int] = []
    shifts = [0]
    for logged, back, pause in sorted(resets):
        if starts and logged - starts[-1] < limit:
            continue  # the same reset, seen by another frame
        shift += back + pause
        starts.append(logged)
        shifts.append(shift)
        findings.append(f"the clock is set back by {back * _NS:.3f} s; what follows is shifted by {shift * _NS:.3f} s")
    if starts:
        for samples in moving:
            samples.stamps = [
                stamp + shifts[bisect_right(starts, logged)]
                for stamp, logged in zip(samples.stamps, samples.logged, strict=True)
            ]


def _interpolated(stamps: Array, values: Array, times: Array) -> Array:
    """Values at times: interpolated, or the one before where the next one is far; the first one before it."""
    before = np.clip(np.searchsorted(stamps, times, side="right") - 1, 0, len(stamps) - 1)
    after = np.minimum(before + 1, len(stamps) - 1)
    gap = stamps[after] - stamps[before]
    share = np.where((gap > 0.0) & (gap <= MAX_GAP_S), (times - stamps[before]) / np.where(gap > 0.0, gap, 1.0), 0.0)
    share = np.clip(share, 0.0, 1.0)
    return np.asarray(values[before] + share * (values[after] - values[before]))


# -- transforms --------------------------------------------------------------------------------------------------------


class _Link(NamedTuple):
    """One frame in the frames of its parents, at all times."""

    poses: Array
    """Times x 7."""
    parents: NDArray[np.intp]
    """The number of the parent at each time; -1 where the frame has none yet."""


class _TransformTree:
    """The frames of a bag at given times; each frame may change its parent."""

    def __init__(
        self, log: TransformLog, times: Array, map_frame: str | None, findings: list[str], source: str
    ) -> None:
        self._log, self._times, self._findings = log, times, findings
        children = [*log.moving, *(frame for frame in log.static if frame not in log.moving)]
        parents = [parent for samples in (*log.moving.values(), *log.static.values()) for parent in samples.parents]
        self.names = tuple(dict.fromkeys([*children, *parents]))
        """All frames, those with a transform first."""
        self._number = {name: number for number, name in enumerate(self.names)}
        self._links: dict[int, _Link | None] = {}
        roots = [name for name in dict.fromkeys(parents) if name not in children]
        self.map_frame = self._find_map_frame(map_frame, roots, source)
        if len(roots) > 1:
            findings.append(f"there are {len(roots)} trees of frames, with the roots {listed(sorted(roots))}")
        for frame in sorted(log.moving.keys() & log.static.keys()):
            findings.append(f"the frame {frame} is in /tf and /tf_static; once it is in /tf, that counts")
        self._map_from_root: tuple[Array, NDArray[np.intp]] | None = None

    def _find_map_frame(self, given: str | None, roots: Sequence[str], source: str) -> str:
        if given is not None:
            if given.lstrip("/") not in self.names:
                known = listed(sorted(self.names)) or "none"
                raise EpisodeError(f"{source} has no frame {given}; it has {known}")
            return given.lstrip("/")
        for name in _MAP_FRAMES:
            if name in self.names:
                return name
        if not self.names:
            return ""
        if len(roots) != 1:
            known = listed(sorted(roots)) or "none, its frames are a cycle"
            raise EpisodeError(f"{source} has no frame map or world; give map_frame, such as one of its roots: {known}")
        return roots[0]

    def poses(self, frame: str) -> tuple[Array, NDArray[np.bool_]]:
        """The poses of a frame in that of the map, times x 7, and at which times it is connected to it."""
        if self._map_from_root is None:
            self._map_from_root = self._to_root(self._number[self.map_frame])
        root_from_map, map_root = self._map_from_root
        root_from_frame, root = self._to_root(self._number[frame])
        is_known = (root == map_root) & (root >= 0)
        return pose_multiply(pose_inverse(root_from_map), root_from_frame), is_known

    def _to_root(self, number: int) -> tuple[Array, NDArray[np.intp]]:
        """The poses of a frame in its root at each time, and the number of the root; -1 in a cycle."""
        count = len(self._times)
        poses, at = np.tile(_IDENTITY, (count, 1)), np.full(count, number, dtype=np.intp)
        is_open = np.ones(count, dtype=bool)
        for _ in range(len(self.names) + 1):
            for node in np.unique(at[is_open]).tolist():
                rows = np.flatnonzero(is_open & (at == node))
                link = self._link(node)
                if link is None:
                    is_open[rows] = False
                    continue
                has_parent = link.parents[rows] >= 0
                is_open[rows[~has_parent]] = False
                rows = rows[has_parent]
                poses[rows] = pose_multiply(link.poses[rows], poses[rows])
                at[rows] = link.parents[rows]
            if not is_open.any():
                break
        if is_open.any():
            names = listed([self.names[node] for node in np.unique(at[is_open]).tolist()])
            text = f"the frames {names} are a cycle at {self._times[int(np.argmax(is_open))]:.3f} s"
            if text not in self._findings:
                self._findings.append(text)
            at[is_open] = -1
        return poses, at

    def _link(self, number: int) -> _Link | None:
        """The transforms of a frame at all times; None for a root."""
        if number not in self._links:
            name = self.names[number]
            moving, static = self._log.moving.get(name), self._log.static.get(name)
            link = None if static is None else self._static_link(static)
            self._links[number] = link if moving is None else self._moving_link(moving, link)
        return self._links[number]

    def _static_link(self, samples: _Samples) -> _Link:
        rows = np.maximum(np.searchsorted(np.array(samples.times), self._times, side="right") - 1, 0)
        return _Link(np.array(samples.values)[rows], self._parent_numbers(samples)[rows])

    def _moving_link(self, samples: _Samples, otherwise: _Link | None) -> _Link:
        """Interpolates between neighbors with the same parent that are not far apart."""
        order = np.argsort(np.array(samples.times), kind="stable")
        stamps, values = np.array(samples.times)[order], np.array(samples.values)[order]
        parents = self._parent_numbers(samples)[order]
        last = np.searchsorted(stamps, self._times, side="right") - 1
        before = np.maximum(last, 0)
        after = np.minimum(before + 1, len(stamps) - 1)
        gap = stamps[after] - stamps[before]
        between = (gap > 0.0) & (gap <= MAX_GAP_S) & (parents[after] == parents[before])
        share = np.where(between, (self._times - stamps[before]) / np.where(gap > 0.0, gap, 1.0), 0.0)[:, None]
        poses = np.concatenate(
            [
                (1.0 - share) * values[before, :3] + share * values[after, :3],
                _slerp(values[before, 3:], values[after, 3:], share),
            ],
            axis=1,
        )
        poses[share[:, 0] == 0.0] = values[before[share[:, 0] == 0.0]]
        numbers = np.where(last >= 0, parents[before], -1)
        if otherwise is not None:
            early = last < 0
            poses[early], numbers[early] = otherwise.poses[early], otherwise.parents[early]
        return _Link(poses, numbers)

    def _parent_numbers(self, samples: _Samples) -> NDArray[np.intp]:
        return np.array([self._number[parent] for parent in samples.parents], dtype=np.intp)


def _slerp(start: Array, end: Array, share: Array) -> Array:
    """Spherical linear interpolation of unit quaternions along the shorter arc (Shoemake 1985)."""
    cosine = np.sum(start * end, axis=1, keepdims=True)
    end = np.where(cosine < 0.0, -end, end)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    sine = np.sin(angle)
    is_small = sine < 1e-6
    divisor = np.where(is_small, 1.0, sine)
    first = np.where(is_small, 1.0 - share, np.sin((1.0 - share) * angle) / divisor)
    second = np.where(is_small, share, np.sin(share * angle) / divisor)
    return normalize(first * start + second * end)


# -- bodies that follow ------------------------------------------------------------------------------------------------


class _JointMotion:
    """Moves the bodies without a frame that are attached to moved bodies, or held by joints."""

    def __init__(self, world: World, map_poses: Array, rows: Mapping[BodyId, int]) -> None:
        bodies = {body.id: body for body in world.bodies}
        self._at = {id: map_poses[row] for id, row in rows.items()}
        self._joints: dict[BodyId, Joint] = {}
        """The joint that moves a body."""
        self.parents: dict[BodyId, BodyId] = {}
        """The body that each body follows."""
        for attachment in world.attachments:
            if attachment.parent in bodies and attachment.child in bodies:
                self.parents.setdefault(attachment.child, attachment.parent)
        self._ends: dict[BodyId, tuple[BodyId, BodyId]] = {}
        for joint in world.joints:
            if joint.parent in bodies and joint.child in bodies:
                moving, holder = (body.id for body in moving_body(joint, bodies[joint.parent], bodies[joint.child]))
                self._ends[joint.id] = (moving, holder)
                if moving not in self.parents:
                    self.parents[moving], self._joints[moving] = holder, joint

    def follow(self, moved: dict[BodyId, Array], displacements: Mapping[BodyId, Array]) -> None:
        """Adds the poses of the bodies that follow a moved one or are moved by a joint, times x 7, to `moved`."""
        done = set(moved)
        for id in self.parents:
            chain = []
            while id not in done and id in self.parents and id not in chain:
                chain.append(id)
                id = self.parents[id]
            for each in reversed(chain):
                done.add(each)
                poses = self._pose(each, moved, displacements)
                if poses is not None:
                    moved[each] = poses

    def _pose(self, id: BodyId, moved: Mapping[BodyId, Array], displacements: Mapping[BodyId, Array]) -> Array | None:
        parent, joint = self.parents[id], self._joints.get(id)
        coordinates = None if joint is None else displacements.get(joint.id)
        if coordinates is None:
            if parent not in moved:
                return None
            return pose_multiply(moved[parent], pose_multiply(pose_inverse(self._at[parent]), self._at[id]))
        assert joint is not None
        fixed_from_joint, moving_from_joint = (
            pose_multiply(pose_inverse(self._at[each]), normalized_pose_array(joint.pose)) for each in (parent, id)
        )
        motion = _joint_motion(coordinates)
        if id != joint.child:
            motion = pose_inverse(motion)
        at = moved.get(parent, self._at[parent])
        return pose_multiply(
            pose_multiply(pose_multiply(at, fixed_from_joint), motion), pose_inverse(moving_from_joint)
        )

    def measured(
        self, joint: Joint, moved: Mapping[BodyId, Array], displacements: Mapping[BodyId, Array], count: int
    ) -> Array | None:
        """The coordinates of a joint, times x 6: as recorded, or from the poses of its bodies; None if none moved."""
        if joint.id in displacements:
            return displacements[joint.id]
        if joint.id not in self._ends or not {joint.parent, joint.child} & moved.keys():
            return None
        axes = movable_axes(joint)
        if not axes:
            return None
        frame = normalized_pose_array(joint.pose)
        ends = []
        for id in (joint.parent, joint.child):
            at = moved.get(id, np.tile(self._at[id], (count, 1)))
            ends.append(pose_multiply(at, pose_multiply(pose_inverse(self._at[id]), frame)))
        relative = pose_multiply(pose_inverse(ends[0]), ends[1])
        return np.array([joint_coordinates(each, axes) for each in relative])


def _joint_motion(coordinates: Array) -> Array:
    """The child's joint frame in the parent's, n x 7, for n x 6 coordinates (see `kinematic_tree`)."""
    turn = np.tile([1.0, 0.0, 0.0, 0.0], (len(coordinates), 1))
    for index in (5, 4, 3):
        step = np.zeros((len(coordinates), 4))
        step[:, 0] = np.cos(coordinates[:, index] / 2)
        step[:, 1 + index % 3] = np.sin(coordinates[:, index] / 2)
        turn = quat_multiply(turn, step)
    return np.concatenate([coordinates[:, :3], turn], axis=1)


# -- names -------------------------------------------------------------------------------------------------------------


def _by_name(entities: Iterable[tuple[BodyId, str]]) -> dict[str, BodyId]:
    """The ids by all names that a frame can have: ids first, then IRIs, their local names, and ids as valid frames."""
    pairs = list(entities)
    found: dict[str, BodyId] = {}
    for names in (
        ((id, id) for id, _ in pairs),
        ((iri, id) for id, iri in pairs),
        _unique((short_name(iri), id) for id, iri in pairs),
        _unique((re.sub(r"[^A-Za-z0-9_./-]", "_", id).lstrip("/"), id) for id, _ in pairs),
    ):
        for name, id in names:
            found.setdefault(name, id)
    return found


def _unique(pairs: Iterable[tuple[str, BodyId]]) -> Iterator[tuple[str, BodyId]]:
    by_name: dict[str, set[BodyId]] = defaultdict(set)
    for name, id in pairs:
        by_name[name].add(id)
    return ((name, next(iter(ids))) for name, ids in by_name.items() if len(ids) == 1)


def _axis_index(joint: Joint, axis: str) -> int | None:
    return AXIS_NAMES.index(axis) if axis else first_movable_axis(joint)


def listed(names: Sequence[str]) -> str:
    """Returns names for a sentence, the first ones if there are many."""
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {more:,} more" if more > 0 else "")
