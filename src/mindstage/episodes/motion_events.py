"""Motions of bodies and joints, and the events that they mean: opening, closing, falling, tipping over, sliding."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import PoseArray
from mindstage.episodes.contact_events import ContactTracker
from mindstage.episodes.event_log import EventLog
from mindstage.episodes.recording import EpisodeEventKind
from mindstage.episodes.tracking import HISTORY_S, BodyTable, DetectionThresholds, JointTable, MotionSample
from mindstage.scene import BodyId
from mindstage.scene.bounding_boxes import Indices
from mindstage.scene.transforms import Array, quat_angle, quat_conjugate, quat_rotate

__all__ = [
    "FallDetector",
    "FlightClock",
    "JointMotionDetector",
    "SlideDetector",
    "TipDetector",
    "free_flight_begin",
    "heights_since",
    "vertical_acceleration",
]

Mask = NDArray[np.bool_]

_GRAVITY_M_S2 = 9.81


@dataclass(slots=True, eq=False)
class _JointRun:
    """One monotone motion of a joint."""

    direction: int
    """1 away from the closed position, -1 towards it."""
    begin_s: float
    start: float
    """The position at the begin."""
    last: float
    """The farthest position so far."""
    last_s: float
    """When it was reached."""
    event: str | None = None
    paused_s: float | None = None


class JointMotionDetector:
    """Opening and closing: one event for each motion of a joint in one direction."""

    def __init__(self, thresholds: DetectionThresholds, log: EventLog) -> None:
        self._limits = thresholds
        self._log = log
        self._runs: dict[int, _JointRun] = {}
        self._history: deque[tuple[float, Array]] = deque()
        self._joints: JointTable | None = None

    def update(self, sample: MotionSample, positions: Mapping[BodyId, tuple[float, ...]] | None) -> None:
        """Takes the joint positions of a sample; without them they are computed from poses."""
        joints = sample.table.joints
        if self._joints is None or self._joints.ids != joints.ids:
            self.finish()
            self._history.clear()
        self._joints = joints
        if not joints.ids:
            return
        now = joints.positions(positions, sample.poses)
        openness = np.abs(now - joints.closed)
        start_s, start = sample.time_s, openness
        for at, each in reversed(self._history):
            start_s, start = at, each
            if at <= sample.time_s - self._limits.window_s + 1e-9:
                break
        rate = (openness - start) / max(sample.time_s - start_s, 1e-9)
        enter, leave = (
            np.where(joints.is_prismatic, self._limits.move_m_s[k], self._limits.turn_rad_s[k]) for k in (0, 1)
        )
        for index in np.flatnonzero(np.abs(rate) > enter).tolist():
            direction = 1 if rate[index] > 0 else -1
            run = self._runs.get(index)
            if run is not None and run.direction != direction:
                self._stop(index)
                run = None
            if run is None:
                begin_s, begin = self._onset(index, direction, sample.time_s, float(openness[index]))
                self._runs[index] = _JointRun(direction, begin_s, begin, begin, begin_s)
        for index in list(self._runs):
            self._follow(index, float(openness[index]), float(rate[index]), float(leave[index]), sample)
        if not self._history or sample.time_s - self._history[-1][0] >= 1 / 130:
            self._history.append((sample.time_s, openness))
        while len(self._history) > 1 and self._history[1][0] <= sample.time_s - HISTORY_S:
            self._history.popleft()

    def finish(self) -> None:
        """Ends the motions that had paused when the recording ended."""
        for index, run in list(self._runs.items()):
            if run.paused_s is not None:
                self._stop(index)
        self._runs.clear()

    def _least(self, index: int) -> float:
        """Displacement from which a joint has moved."""
        assert self._joints is not None
        return self._limits.still_m if self._joints.is_prismatic[index] else _STILL_RAD

    def _onset(self, index: int, direction: int, time_s: float, position: float) -> tuple[float, float]:
        """The time and the position at which the present motion began."""
        begin_s, begin = time_s, position
        least = self._least(index)
        for at, each in reversed(self._history):
            value = float(each[index])
            if direction * (begin - value) > 0.0:
                begin_s, begin = at, value
            elif direction * (value - begin) > least or begin_s - at > self._limits.min_duration_s:
                break
        # It has begun when it has left the position at which it was before.
        for at, each in self._history:
            if at >= begin_s and direction * (float(each[index]) - begin) <= least:
                found = at
                begin_s = max(begin_s, found)
            elif at > begin_s:
                break
        return begin_s, begin

    def _follow(self, index: int, position: float, rate: float, leave: float, sample: MotionSample) -> None:
        run, joints = self._runs[index], self._joints
        assert joints is not None
        if run.direction * (position - run.last) > self._least(index) / 4:
            run.last_s = sample.time_s
            run.last = position
        travel = run.direction * (run.last - run.start)
        limit = self._limits.joint_min_m if joints.is_prismatic[index] else self._limits.joint_min_rad
        if run.event is None and travel >= limit:
            run.event = self._add(index, run)
        if run.direction * rate >= leave:
            run.paused_s = None
        elif run.paused_s is None:
            run.paused_s = sample.time_s
        if run.paused_s is not None and sample.time_s - run.last_s >= self._limits.min_duration_s:
            self._stop(index)

    def _add(self, index: int, run: _JointRun) -> str:
        joints = self._joints
        assert joints is not None
        return self._log.add(
            EpisodeEventKind.OPEN if run.direction > 0 else EpisodeEventKind.CLOSE,
            run.begin_s,
            thing=joints.moving[index],
            other=joints.holding[index],
            joint=joints.ids[index],
        )

    def _stop(self, index: int) -> None:
        run, joints = self._runs.pop(index), self._joints
        assert joints is not None
        if run.event is None:
            return
        end_s = run.last_s
        for at, each in reversed(self._history):
            if abs(float(each[index]) - run.last) > self._least(index) or at < run.begin_s:
                break
            end_s = min(end_s, at)
        unit = "m" if joints.is_prismatic[index] else "rad"
        closed = float(joints.closed[index])
        ends = [abs(end - closed) for end in (float(joints.low[index]), float(joints.high[index]))]
        reach = max((end for end in ends if np.isfinite(end)), default=np.inf)
        text = f"{joints.ids[index]} moved from {run.start:.3f} to {run.last:.3f} {unit} from its closed position"
        if np.isfinite(reach) and reach > 0.0:
            text += f", {run.last / reach:.0%} of its range"
        amount = abs(run.last - run.start)
        self._log.end(run.event, end_s, amount=amount, evidence=(text + ".",))


_STILL_RAD = 0.005
"""Turn of a hinge from which it has moved: 2 mm at the rim of a door of 0.4 m."""


class FlightClock:
    """Since when bodies have had no contact."""

    def __init__(self) -> None:
        self.since = np.zeros(0)
        """n [s]; NaN for a body with a contact. The time of the last sample with one."""

    def update(self, sample: MotionSample, flies: Mask) -> None:
        """Takes which bodies have no contact in a sample."""
        n = len(sample.table.ids)
        if sample.rows_before is not None and len(self.since):
            rows = sample.rows_before
            self.since = np.where(rows >= 0, self.since[rows], np.nan)
        elif not len(self.since):
            self.since = np.full(n, np.nan)
        begins = flies & np.isnan(self.since)
        self.since = np.where(flies, np.where(begins, sample.time_s - sample.step_s, self.since), np.nan)


def heights_since(sample: MotionSample, row: int, since_s: float) -> tuple[Array, Array]:
    """The times relative to a sample [s] and the heights [m] of a body from a time to that of the sample."""
    found = [(at - sample.time_s, float(poses[row, 2])) for at, poses in sample.history if at >= since_s - _ROUNDING_S]
    found.append((0.0, float(sample.poses[row, 2])))
    table = np.array(found)
    return table[:, 0], table[:, 1]


def vertical_acceleration(times: Array, heights: Array, window_s: float) -> float | None:
    """The mean acceleration over the last part of a motion [m/s²]; None if there are too few samples.

    Args:
        times: times of the samples, the last one is 0 [s].
        heights: the heights at these times [m].
        window_s: the length of the last part [s].
    """
    first = int(np.searchsorted(times, -window_s - _ROUNDING_S, side="left"))
    first = max(min(first, len(times) - 3), 0)
    if len(times) - first < 3 or times[first] > -0.6 * window_s:
        return None
    return 2.0 * float(np.polyfit(times[first:], heights[first:], 2)[0])


def free_flight_begin(times: Array, heights: Array, window_s: float, tolerance_m: float) -> float:
    """The time from which heights agree with the parabola of a free flight through the last ones [s].

    Args:
        times: see `vertical_acceleration`, as the next ones.
        heights: see there.
        window_s: the parabola fits this last part [s].
        tolerance_m: the largest deviation from it [m].
    """
    lifted = heights + _GRAVITY_M_S2 / 2 * times**2
    first = min(int(np.searchsorted(times, -window_s - _ROUNDING_S)), max(len(times) - 2, 0))
    slope, height = np.polyfit(times[first:], lifted[first:], 1)
    agrees = np.abs(lifted - slope * times - height) <= tolerance_m
    apart = np.flatnonzero(~agrees)
    return float(times[min(apart[-1] + 1, len(times) - 1) if len(apart) else 0])


class FallDetector:
    """Free falls: no contact, nothing that holds the body, and the acceleration of gravity."""

    def __init__(self, thresholds: DetectionThresholds, log: EventLog) -> None:
        self._limits = thresholds
        self._log = log
        self._clock = FlightClock()
        self._falls: dict[BodyId, tuple[str, float]] = {}
        """The event of each body that falls, and the height at which it began [m]."""

    def update(self, sample: MotionSample, contact_counts: Indices, held: Mask) -> None:
        """Takes a sample.

        Args:
            contact_counts: the number of contacts of the rigid group of each body.
            held: which bodies are attached to a mover or gripped.
        """
        table, limits = sample.table, self._limits
        flies = table.is_free & table.is_subject & table.has_gravity & ~held & (contact_counts == 0)
        flies &= ~sample.jumped & ~sample.is_new
        self._clock.update(sample, flies)
        for id in list(self._falls):
            if id not in table.row or not flies[table.row[id]] or self._is_caught(table.row[id], sample):
                self._end(id, sample)
        sinks = sample.velocities[:, 2] < -limits.fall_min_height_m / HISTORY_S
        falls = flies & sinks & (sample.time_s - self._clock.since >= limits.min_duration_s - _ROUNDING_S)
        for row in np.flatnonzero(falls).tolist():
            if table.ids[row] not in self._falls:
                self._begin(row, sample)

    def _is_caught(self, row: int, sample: MotionSample) -> bool:
        """Whether a force stops the fall of a body: it does not accelerate downwards any more."""
        times, heights = heights_since(sample, row, sample.time_s - self._limits.window_s)
        acceleration = vertical_acceleration(times, heights, self._limits.window_s)
        return acceleration is not None and acceleration > -self._limits.fall_min_acceleration_m_s2

    def _begin(self, row: int, sample: MotionSample) -> None:
        limits, id = self._limits, sample.table.ids[row]
        times, heights = heights_since(sample, row, float(self._clock.since[row]))
        acceleration = vertical_acceleration(times, heights, limits.window_s)
        if acceleration is None or acceleration > -limits.fall_min_acceleration_m_s2:
            return
        start = free_flight_begin(times, heights, limits.window_s, limits.flight_tolerance_m)
        top = float(heights[times >= start - _ROUNDING_S].max())
        if top - heights[-1] < limits.fall_min_height_m:
            return
        self._falls[id] = (self._log.add(EpisodeEventKind.FALL, sample.time_s + start, thing=id), top)

    def _end(self, id: BodyId, sample: MotionSample) -> None:
        event, top = self._falls.pop(id)
        row = sample.table.row.get(id)
        if row is None or sample.jumped[row]:
            self._log.end(event, sample.time_s - sample.step_s, evidence=("It was put elsewhere while it fell.",))
            return
        height = max(top - float(sample.poses[row, 2]), 0.0)
        text = f"It fell by {height:.2f} m without a contact, at the acceleration of gravity."
        self._log.end(event, sample.time_s, amount=height, evidence=(text,))


_ROUNDING_S = 1e-6


class TipDetector:
    """Bodies that tip over: the axis that was vertical when they rested turns away while nothing holds them."""

    def __init__(self, thresholds: DetectionThresholds, log: EventLog) -> None:
        self._limits = thresholds
        self._log = log
        self._upright = np.zeros((0, 3))
        """n x 3: the vertical direction in the frame of each body when it rested last."""
        self._since = np.zeros(0)
        """n: the last time at which that axis was vertical [s]."""
        self._rest_s = np.zeros(0)
        """n: since when each body has not turned [s]."""
        self._touched_s = np.zeros(0)
        """n: when each body was in contact last [s]."""
        self._state = np.zeros(0, dtype=np.int8)
        """n: 0 upright or tilted, 1 tips over, 2 turned in flight or by a hand, until it rests."""
        self._events: dict[BodyId, str] = {}

    def update(self, sample: MotionSample, contact_counts: Indices, held: Mask) -> None:
        """Takes a sample; see `FallDetector.update`."""
        table, limits, time_s = sample.table, self._limits, sample.time_s
        self._set_rows(sample)
        self._touched_s[contact_counts > 0] = time_s
        fresh = sample.jumped | sample.is_new
        for id in [id for id in self._events if id not in table.row or fresh[table.row[id]]]:
            self._log.end(self._events.pop(id), time_s - sample.step_s)
            if id in table.row:
                self._state[table.row[id]] = 0
        turns = sample.turning > _TURNING_RAD_S
        self._rest_s[turns] = time_s
        rests = ~turns & (time_s - self._rest_s >= _REST_S) & table.is_subject
        settled = np.flatnonzero(fresh | (rests & ((self._since < time_s - _REST_S) | (self._state != 0))))
        candidates = np.flatnonzero((turns | (self._state == 1)) & table.is_subject & ~fresh)
        if len(candidates):
            axis = quat_rotate(sample.poses[candidates, 3:], self._upright[candidates])
            tilt = np.arccos(np.clip(axis[:, 2], -1.0, 1.0))
            self._since[candidates[tilt <= limits.tip_begin_rad]] = time_s
            over = candidates[(tilt > limits.tip_min_rad) & (self._state[candidates] == 0)]
            for row in over.tolist():
                in_flight = time_s - self._touched_s[row] > limits.min_duration_s
                self._state[row] = 2 if held[row] or in_flight else 1
                if self._state[row] == 1:
                    id = table.ids[row]
                    self._events[id] = self._log.add(EpisodeEventKind.TIP_OVER, float(self._since[row]), thing=id)
        for row in settled.tolist():
            id = table.ids[row]
            if id in self._events and not fresh[row]:
                axis = quat_rotate(sample.poses[row, 3:], self._upright[row])
                angle = float(np.arccos(np.clip(axis[2], -1.0, 1.0)))
                text = f"The axis that was vertical turned by {np.degrees(angle):.0f} degrees."
                self._log.end(self._events.pop(id), self._end_s(row, sample), amount=angle, evidence=(text,))
        self._state[settled] = 0
        self._upright[settled] = quat_rotate(quat_conjugate(sample.poses[settled, 3:]), _UP)
        self._since[settled] = time_s
        still = table.is_subject & ~turns & (self._state == 0)
        self._since[still & (self._since >= time_s - sample.step_s - _ROUNDING_S)] = time_s

    def _end_s(self, row: int, sample: MotionSample) -> float:
        """The first time from which the orientation has been as it is now [s]."""
        found = sample.time_s
        for time_s, poses in reversed(sample.history):
            if float(quat_angle(poses[row, 3:], sample.poses[row, 3:])) > self._limits.tip_begin_rad:
                break
            found = time_s
        return found

    def _set_rows(self, sample: MotionSample) -> None:
        n = len(sample.table.ids)
        rows = sample.rows_before
        if rows is None and len(self._since):
            return
        upright = quat_rotate(quat_conjugate(sample.poses[:, 3:]), _UP)
        since, rest, touched = np.full(n, sample.time_s), np.full(n, sample.time_s), np.full(n, sample.time_s)
        state = np.zeros(n, dtype=np.int8)
        if rows is not None and len(self._since):
            known = rows >= 0
            old = rows[known]
            upright[known], since[known], rest[known] = self._upright[old], self._since[old], self._rest_s[old]
            touched[known], state[known] = self._touched_s[old], self._state[old]
        self._upright, self._since, self._rest_s, self._touched_s, self._state = upright, since, rest, touched, state


_UP = np.array([0.0, 0.0, 1.0])
_TURNING_RAD_S = 0.1
"""Angular speed from which a body turns [rad/s]."""
_REST_S = 0.2
"""A body that has not turned for this time rests [s]."""


@dataclass(slots=True, eq=False)
class _Place:
    """Where a body is on one of its supports, and the motion from there if it has begun."""

    rest: Array
    """Where it rested last, in the frame of the support [m]."""
    rest_s: float
    """The last time at which it was there [s]."""
    seen_s: float = -np.inf
    """When it was looked at last, since nothing has changed after that [s]."""
    samples: int = 1
    """The number of samples of which `rest` is the mean."""
    path: deque[tuple[float, Array]] = field(default_factory=deque)
    """Where it has been since, as far back as its end is dated; empty while it rests."""
    progress: Array | None = None
    """The last place that differs from the one before by more than `still_m`."""
    progress_s: float = 0.0
    farthest_m: float = 0.0
    event: str | None = None


class SlideDetector:
    """Bodies that move along what supports them, relative to it, however slowly: the distance decides.

    A body rests while it stays within `still_m` of one place. It has stopped when it has stayed within `still_m` for
    longer than it needed for that distance at its mean speed so far, and at least for `min_duration_s`.
    """

    def __init__(self, thresholds: DetectionThresholds, log: EventLog, contacts: ContactTracker) -> None:
        self._limits = thresholds
        self._log = log
        self._contacts = contacts
        self._places: dict[tuple[BodyId, BodyId | None], _Place] = {}
        self._ids: tuple[BodyId, ...] = ()
        self._poses = np.zeros((0, 7))
        """n x 7: the poses of the sample before."""
        self._counts = np.zeros(0, dtype=np.intp)
        """n: the numbers of supports then."""

    def update(self, sample: MotionSample, agents: Mapping[BodyId, str | None]) -> None:
        """Takes a sample.

        Args:
            sample: the sample, after the contacts have taken it.
            agents: the bodies that are held, and by what.
        """
        table = sample.table
        is_supported = table.is_subject & (self._contacts.support_counts > 0) & ~sample.jumped
        for key in [key for key in self._places if not self._is_on(key, sample, is_supported)]:
            self._leave(key, sample)
        rows = np.flatnonzero(is_supported & self._may_move(sample))
        tilts = set(rows[self._tilts(rows, sample)].tolist())
        for row in rows.tolist():
            id = table.ids[row]
            keys = [
                (id, support)
                for support in self._contacts.supports_of(id)
                if support is None or not table.is_mover[table.row[support]]
            ]
            for key in keys:
                self._follow(key, row, sample, is_tilting=row in tilts)
            self._report(id, keys, sample, agents.get(id))

    def _may_move(self, sample: MotionSample) -> Mask:
        """Which bodies have changed since the sample before, or what they rest on, or have not stopped."""
        table, counts = sample.table, self._contacts.support_counts
        if table.ids != self._ids:
            changed = np.ones(len(table.ids), dtype=bool)
        else:
            changed = (sample.poses != self._poses).any(axis=1) | (counts != self._counts)
            moved = {table.ids[row] for row in np.flatnonzero(changed).tolist()}
            for (id, support), place in self._places.items():
                if place.path or support in moved:
                    changed[table.row[id]] = True
        self._ids, self._poses, self._counts = table.ids, sample.poses.copy(), counts.copy()
        return changed

    def finish(self) -> None:
        """Ends the motions that had stopped when the recording ended."""
        for place in self._places.values():
            if place.event is not None and self._stopped_s(place) < place.path[-1][0] - self._limits.min_duration_s:
                self._end(place)

    def _is_on(self, key: tuple[BodyId, BodyId | None], sample: MotionSample, is_supported: Mask) -> bool:
        id, support = key
        row = sample.table.row.get(id)
        return row is not None and bool(is_supported[row]) and self._contacts.is_supported_by(id, support)

    def _leave(self, key: tuple[BodyId, BodyId | None], sample: MotionSample) -> None:
        """Ends what a body does on a support that it has no more."""
        place = self._places.pop(key)
        if place.event is not None:
            row = sample.table.row.get(key[0])
            gone_s = sample.time_s - sample.step_s
            is_gone = row is None or bool(sample.jumped[row]) or (key[1] is not None and key[1] not in sample.table.row)
            end_s = gone_s if is_gone else self._contacts.support_end_s(*key, sample.time_s)
            self._end(place, min(end_s, self._stopped_s(place)))

    def _follow(self, key: tuple[BodyId, BodyId | None], row: int, sample: MotionSample, *, is_tilting: bool) -> None:
        """Takes where a body is on one of its supports."""
        limits, time_s = self._limits, sample.time_s
        now = _relative(sample.poses, row, key[1], sample.table)
        place = self._places.get(key)
        if place is None or (is_tilting and place.event is None):
            self._places[key] = _Place(now, time_s, seen_s=time_s)
            return
        if not place.path:
            self._rest(place, now, key[1], sample)
            return
        assert place.progress is not None
        if is_tilting:  # the slide ends where the body begins to tip
            self._end(place, place.progress_s)
            self._places[key] = _Place(now, time_s, seen_s=time_s)
            return
        place.path.append((time_s, now))
        if np.linalg.norm(now - place.progress) > limits.still_m:
            place.progress, place.progress_s = now, time_s
            place.farthest_m = max(place.farthest_m, _horizontal(now - place.rest, key[1], sample))
            while len(place.path) > 1 and place.path[1][0] <= time_s - HISTORY_S:
                place.path.popleft()
        speed = place.farthest_m / max(place.progress_s - place.rest_s, 1e-9)
        pause_s = max(limits.min_duration_s, 2.0 * limits.still_m / max(speed, 1e-9))
        if time_s - place.progress_s > pause_s or time_s - self._stopped_s(place) >= pause_s:
            if place.event is not None:
                self._end(place)
                self._places[key] = _Place(now, time_s, seen_s=time_s)
            elif time_s - place.progress_s > pause_s:  # it may go on: the distance from where it rested counts
                place.path.clear()
                if place.farthest_m < limits.still_m:
                    self._places[key] = _Place(now, time_s, seen_s=time_s)

    def _rest(self, place: _Place, now: Array, support: BodyId | None, sample: MotionSample) -> None:
        """Takes where a body is that has rested so far."""
        limits = self._limits
        if place.rest_s >= place.seen_s:
            place.rest_s = sample.time_s - sample.step_s
        place.seen_s = sample.time_s
        distance = _horizontal(now - place.rest, support, sample)
        if distance <= limits.rest_m:
            place.rest_s = sample.time_s
        if distance <= limits.still_m and place.samples < _REST_SAMPLES:
            place.samples += 1
            place.rest = place.rest + (now - place.rest) / place.samples
        elif distance > limits.still_m:
            place.progress, place.progress_s = now, sample.time_s
            place.path.append((sample.time_s, now))
            place.farthest_m = distance

    def _report(
        self, id: BodyId, keys: list[tuple[BodyId, BodyId | None]], sample: MotionSample, agent: str | None
    ) -> None:
        """Adds the slide of a body that has moved far enough along all its supports.

        What rests on two bodies and moves along one of them is carried by the other one.
        """
        places = [(key, place) for key in keys if (place := self._places.get(key)) is not None]
        if not places or any(place.event is not None for _, place in places):
            return
        key, place = min(places, key=lambda each: each[1].farthest_m if each[1].path else 0.0)
        if place.path and place.farthest_m >= self._limits.slide_min_m:
            begin_s = max(place.rest_s, self._contacts.support_begin_s(*key))
            place.event = self._log.add(EpisodeEventKind.SLIDE, begin_s, thing=id, other=key[1], agent=agent)

    @staticmethod
    def _tilts(rows: Indices, sample: MotionSample) -> Mask:
        """Which bodies tip rather than slide: their vertical axes turn."""
        if not len(rows):
            return np.zeros(0, dtype=bool)
        start_s, start = sample.window
        up = quat_rotate(sample.poses[rows, 3:], quat_rotate(quat_conjugate(start[rows, 3:]), _UP))
        angles = np.arccos(np.clip(up[:, 2], -1.0, 1.0))
        return np.asarray(angles > _TILT_RAD_S * max(sample.time_s - start_s, 1e-9))

    def _stopped_s(self, place: _Place) -> float:
        """The first time from which a body has been where it is now on its support [s]."""
        found = place.path[-1][0]
        now = np.mean([at for time_s, at in place.path if time_s >= found - _STOP_S], axis=0)
        for time_s, at in reversed(place.path):
            if np.linalg.norm(at - now) > self._limits.rest_m:
                break
            found = time_s
        return found

    def _end(self, place: _Place, time_s: float | None = None) -> None:
        if place.event is not None:
            support = self._log.event(place.event).other
            text = f"It moved by {place.farthest_m:.3f} m relative to {support or 'the ground'}, which supported it."
            end_s = self._stopped_s(place) if time_s is None else time_s
            self._log.end(place.event, end_s, amount=place.farthest_m, evidence=(text,))
            place.event = None


_REST_SAMPLES = 90
_STOP_S = 0.1
"""The time over which the place is averaged at which a body has stopped [s]."""
_TILT_RAD_S = 0.5
"""Speed at which the vertical axis of a body turns from which it tips rather than slides [rad/s]."""


def _relative(poses: PoseArray, row: int, support: BodyId | None, table: BodyTable) -> Array:
    """The position of a body in the frame of its support [m]."""
    position = poses[row, :3]
    if support is None:
        return np.array(position)
    base = poses[table.row[support]]
    return quat_rotate(quat_conjugate(base[3:]), position - base[:3])


def _horizontal(shift: Array, support: BodyId | None, sample: MotionSample) -> float:
    """The horizontal length of a displacement in the frame of a support [m]."""
    if support is not None:
        shift = quat_rotate(sample.poses[sample.table.row[support], 3:], shift)
    return float(np.hypot(shift[0], shift[1]))
