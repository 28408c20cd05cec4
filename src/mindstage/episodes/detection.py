"""Detection of events in recordings and in running worlds: the same code, one frame after the other.

detector = EventDetector(geometry=simulation.geometry)
for frame in frames:
for event in detector.update(frame):
print(event)  # it has begun, or it has ended
detector.finish()
print(detector.events)
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import PoseArray
from mindstage.episodes.contact_events import ContactTracker
from mindstage.episodes.event_log import EventLog
from mindstage.episodes.handling_events import HandlingDetector
from mindstage.episodes.motion_events import FallDetector, JointMotionDetector, SlideDetector, TipDetector
from mindstage.episodes.recording import EpisodeEvent, EpisodeFrame, Recording
from mindstage.episodes.smoothing import LINE_S, estimate_noise, smoothed_poses, thresholds_for
from mindstage.episodes.tracking import AgentTracker, BodyTable, DetectionThresholds, MotionTracker
from mindstage.errors import EpisodeError
from mindstage.ranges import Length, NotNegative, checked
from mindstage.scene import NO_GEOMETRY, BodyId, GeometryMap
from mindstage.scene.transforms import pose_array

__all__ = ["DetectionFault", "EventDetector", "detect_events"]

_log = logging.getLogger("mindstage.episodes")


class DetectionFault(NamedTuple):
    """A time in which events could not be detected, for a reason that is a fault of the program or of the frames."""

    begin_s: float
    """The time of the first frame that failed [s]."""
    end_s: float
    """That of the last one [s]."""
    cause: str


class EventDetector:
    """Detects events from frames, in the order of time.

    It goes on after a fault: events that had not ended end there, and what holds in the frame after it begins anew.

    A frame is processed when the next one has arrived, or 0.27 s later if positions have noise, since they are smoothed
    (see `smoothing`). Most events are certain a tenth of a second after they have begun; their times are those of the
    frames all the same.
    """

    @checked
    def __init__(
        self,
        *,
        geometry: GeometryMap = NO_GEOMETRY,
        thresholds: DetectionThresholds | None = None,
        agents: Collection[BodyId] = (),
        noise_m: Length = 0.0,
        step_s: NotNegative = 1 / 30,
    ) -> None:
        """Creates a detector that has seen no frame.

        Args:
            geometry: the geometry of the bodies, by which contacts are found where none were recorded; a body without
                an entry is its primitive shape.
            thresholds: by default those that `DetectionThresholds` documents.
            agents: bodies that can hold others, besides those that are described as parts of robots, hands or grippers,
                and those that move by themselves.
            noise_m: standard deviation of positions along an axis, as of `estimate_noise` [m]; with it, frames are
                processed 0.27 s later.
            step_s: time between frames [s], which matters for noise only.
        """
        limits = DetectionThresholds() if thresholds is None else thresholds
        self.thresholds = thresholds_for(limits, noise_m, step_s)
        """The thresholds, raised to what noise does not exceed."""
        self._noise_m = noise_m
        self.faults: list[DetectionFault] = []
        """When it failed, and why."""
        self._geometry = geometry
        self._named_agents = frozenset(agents)
        self._log = EventLog()
        self._begin()
        self._frames: list[EpisodeFrame] = []
        """The last frames, which are processed when those after them are known by which they are smoothed."""
        self._next = 0
        """The index of the first of them that is not processed yet."""
        self._finished = False

    def _begin(self) -> None:
        """Begins with no frame seen; the events so far stay."""
        self._motion = MotionTracker(self.thresholds)
        self._contacts = ContactTracker(self.thresholds, self._geometry, self._log)
        self._agents = AgentTracker(self._named_agents)
        self._joints = JointMotionDetector(self.thresholds, self._log)
        self._handling = HandlingDetector(self.thresholds, self._log, self._contacts, self._agents)
        self._falls = FallDetector(self.thresholds, self._log)
        self._tips = TipDetector(self.thresholds, self._log)
        self._slides = SlideDetector(self.thresholds, self._log, self._contacts)
        self._table: BodyTable | None = None
        self._last_poses = np.zeros((0, 7))
        self._last_rows: Mapping[BodyId, int] = {}

    @property
    def events(self) -> tuple[EpisodeEvent, ...]:
        """All events so far, in the order of their begin; those that last have no end. Final after `finish`."""
        return self._log.events

    def update(self, frame: EpisodeFrame) -> tuple[EpisodeEvent, ...]:
        """Takes a frame; returns the events that were found to have begun or ended, each as it is now.

        An event is returned once or twice: when it begins, with no end, and when it ends, with the same id, or when it
        is withdrawn. Of two frames of the same time the last one counts.

        Raises:
            EpisodeError: the frame is earlier than the one before, or the detector is finished.
        """
        if self._finished:
            raise EpisodeError("the detection is finished; create another EventDetector")
        if self._frames:
            last = self._frames[-1]
            if not frame.time_s >= last.time_s:
                raise EpisodeError(f"a frame at {frame.time_s:g} s came after one at {last.time_s:g} s")
            if frame.time_s == last.time_s:
                self._frames.pop()
        self._frames.append(frame)
        self._process_until(frame.time_s - LINE_S if self._noise_m else self._frames[-2:][0].time_s)
        return self._log.take_changed()

    def finish(self) -> tuple[EpisodeEvent, ...]:
        """Ends the detection; returns the events that were found to have begun or ended since the last frame.

        Calling it twice is harmless.
        """
        if not self._finished:
            self._finished = True
            self._process_until(np.inf)
            self._log.is_final = True
        return self._log.take_changed()

    def _process_until(self, time_s: float) -> None:
        """Processes the frames until a time [s], and forgets those that smoothing needs no more."""
        while self._next < len(self._frames):
            frame = self._frames[self._next]
            if frame.time_s > time_s or (frame is self._frames[-1] and not self._finished):
                break
            self._try(self._next, is_last=self._finished and self._next == len(self._frames) - 1)
            self._next += 1
        while self._next > 1 and self._frames[0].time_s < self._frames[self._next - 1].time_s - LINE_S:
            del self._frames[0]
            self._next -= 1
        if not self._noise_m:
            count = max(self._next - 1, 0)
            del self._frames[:count]
            self._next -= count

    def _try(self, index: int, *, is_last: bool) -> None:
        """Processes a frame; any error is a fault of this frame."""
        frame = self._frames[index]
        try:
            self._process(frame, smoothed_poses(self._frames, index, noise_m=self._noise_m))
            if is_last:
                for each in (self._contacts, self._joints, self._handling, self._slides):
                    each.finish()
        except Exception as error:  # events are derived: whatever fails here must not end a recording
            begin_s, cause = frame.time_s, f"{type(error).__name__}: {error}"
            if self._table is None and self.faults:  # nothing was processed since the last one
                begin_s = self.faults.pop().begin_s
            else:
                _log.exception("events at %g s could not be detected", frame.time_s)
            self.faults.append(DetectionFault(begin_s, frame.time_s, cause))
            self._log.end_all(frame.time_s, f"Its end is unknown: the detection of events failed ({cause}).")
            self._begin()

    def _process(self, frame: EpisodeFrame, poses: PoseArray) -> None:
        table = self._table
        if table is None or table.ids != frame.ids or table.structure is not frame.structure:
            table = BodyTable.from_frame(frame, table)
        unknown = np.asarray(~np.isfinite(poses).all(axis=1))
        if unknown.any():  # a diverged simulation, a lost marker: it is where it was
            self._fill(poses, unknown, table)
        sample = self._motion.sample(frame.time_s, table, poses)
        self._last_poses, self._last_rows = poses, table.row
        self._contacts.update(sample, frame.contacts)
        self._joints.update(sample, frame.joint_positions)
        held = self._handling.update(sample)
        counts, agents = table.group_sums(self._contacts.contact_counts), self._handling.agents
        self._falls.update(sample, counts, held)
        held[[table.row[id] for id in agents]] = True
        self._tips.update(sample, counts, held)
        self._slides.update(sample, agents)
        self._motion.keep()
        self._table = table

    def _fill(self, poses: PoseArray, unknown: NDArray[np.bool_], table: BodyTable) -> None:
        """Replaces poses that are not finite by the last known ones, or by those of the structure."""
        by_id = {body.id: body for body in table.structure.bodies}
        for row in np.flatnonzero(unknown).tolist():
            id = table.ids[row]
            before = self._last_rows.get(id)
            pose = self._last_poses[before] if before is not None else pose_array([by_id[id].pose])[0]
            poses[row] = pose if np.isfinite(pose).all() else (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


@checked
def detect_events(
    recording: Recording,
    *,
    thresholds: DetectionThresholds | None = None,
    agents: Collection[BodyId] = (),
    noise_m: Length | None = None,
) -> tuple[EpisodeEvent, ...]:
    """Returns all events of a recording, in the order of their begin; faults are logged.

    Args:
        thresholds: see `EventDetector`.
        agents: see there.
        noise_m: see there; by default it is estimated.
    """
    estimate_m, step_s = estimate_noise(recording)
    detector = EventDetector(
        geometry=recording.geometry,
        thresholds=thresholds,
        agents=agents,
        noise_m=estimate_m if noise_m is None else noise_m,
        step_s=step_s,
    )
    for frame in recording.frames():
        detector.update(frame)
    detector.finish()
    return detector.events
