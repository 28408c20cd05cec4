"""Recording: a running simulation is written to an episode file.

The engine thread only takes references to the published arrays, at the rate of the recording and after each edit; a
thread of the recorder finds what has changed, and writes it. What is older than a second is on the disk. Events are
detected in another process: states are recorded whatever happens there.
"""

from __future__ import annotations

import dataclasses
import hashlib
import logging
import os
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import chain
from pathlib import Path
from threading import Event, Lock, Thread, get_ident
from typing import Any, NamedTuple, Protocol

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.assets.gltf import world_to_glb
from mindstage.engines.base import Capability, Contact, Engine, PoseArray
from mindstage.episodes.event_process import DetectionFaultReply, EventProcess, EventsReply
from mindstage.episodes.geometry_file import encode_geometry
from mindstage.episodes.mcap_file import FORMAT_VERSION, EpisodeFileWriter
from mindstage.episodes.messages import ChunkHead, EpisodeEncoder, EpisodeTopic
from mindstage.episodes.recording import (
    FAULT_EDIT,
    DriveState,
    EpisodeEdit,
    EpisodeEvent,
    EpisodeEventKind,
    EpisodeFrame,
    EventState,
    Recording,
)
from mindstage.episodes.structure import WorldStructure
from mindstage.errors import EpisodeError, EpisodeFileError, MindstageError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps.io.write import write_map
from mindstage.ranges import Frequency, checked
from mindstage.robots import robots_of
from mindstage.scene import BodyGeometry, BodyId, GeometryMap, Mobility, World
from mindstage.simulation import Simulation
from mindstage.simulation.observation import SKILL_EDIT, as_client

__all__ = ["FINAL_EVENTS", "EpisodeHeader", "RecordedState", "Recorder", "RecordingFolder", "write_episode"]

_POLL_S = 0.1
"""Wall time between two turns of the writing thread [s]."""
_CHUNK_WALL_S = 0.6
"""Wall time after which a chunk is written, so that a killed process loses less than a second."""
_CHUNK_FRAMES = 120
"""Seeking decodes a chunk."""
_CHUNK_S = 4.5
"""Episode time of a chunk: damage costs as much [s]."""
_CHUNK_BYTES = 1 << 20
_BASE_S = 30.0
"""Episode time after which a chunk begins with the state of all bodies."""
_MAX_RATE_HZ = 1000.0
FINAL_EVENTS = "events.json.zst"
"""The attachment with the final events."""
_STOP_TIMEOUT_S = 60.0
"""Wall time without any progress after which it is an error that a file is not finished [s]."""
_WAIT_S = 0.5
"""Wall time between two looks at the progress [s]."""
_LATE_S = 5.0
"""Wall time after which it is a warning that a frame has not been searched for events [s]."""
_SILENT_S = 10.0
"""Wall time without a reply of the detection of events after which a file is flushed without its last events [s]."""
_MAX_LIVE_EVENTS = 50
"""The number of events that are kept for whoever looks at the recording."""
_DRIVE_DIGITS = (7, 5, 3)
"""Digits after the point of positions, velocities and efforts, so that a robot at rest is written once."""
_NONE: NDArray[np.intp] = np.zeros(0, dtype=np.intp)
_log = logging.getLogger("mindstage.episodes")


class RecordedState(Protocol):
    """The part of `StateSnapshot` that is recorded."""

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """The bodies that exist; the same object until one is added or removed."""

    @property
    def poses(self) -> PoseArray:
        """N x 7, in the order of `ids`."""


class EpisodeHeader(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The first attachment of an episode file."""

    format_version: int = FORMAT_VERSION
    episode: str
    """A random identifier."""
    start_unix_s: float
    """Wall time of the begin, in seconds since 1970."""
    engine: str
    rate_hz: float
    has_joints: bool
    """Whether joint positions are recorded."""
    has_contacts: bool
    """Whether contacts are recorded."""
    has_events: bool
    """Whether events were detected while it was recorded."""
    source: str = "Mindstage"


class _Capture(NamedTuple):
    """What the engine thread takes at one time."""

    time_ns: int
    ids: tuple[BodyId, ...]
    poses: PoseArray
    joints: Mapping[BodyId, tuple[float, ...]] | None
    contacts: tuple[Contact, ...] | None
    structure: WorldStructure | None
    """None if nothing but poses can have changed."""
    drives: Mapping[str, DriveState]
    """The joints of robots by id."""
    geometry: GeometryMap | None
    """The geometry of the bodies, together with the structure."""
    moved: NDArray[np.intp] | None
    """The rows of the poses that differ from those of the capture before; None if the bodies are others."""


class Recorder:
    """Records a simulation in a file until `stop`, or until the simulation is closed.

    >>> with Recorder(sim, "run.mcap"):
    ...     sim.step(10.0)
    """

    @checked
    def __init__(
        self,
        simulation: Simulation,
        path: str | os.PathLike[str],
        *,
        rate_hz: Frequency = 30.0,
        events: bool = True,
        self_contained: bool = False,
    ) -> None:
        """Starts to record; the state at this time is the first frame.

        Args:
            path: the file to write, ending with ".mcap".
            rate_hz: frames per simulated second. Edits are recorded when they are made.
            events: whether events are detected while it records; otherwise whoever reads the file detects them.
            self_contained: whether geometry, textures and maps are in the file however large they are; otherwise they
                are in the folder `contents` beside it, once for all episodes there.

        Raises:
            EpisodeFileError: the file exists or cannot be written, or the suffix is another one.
            InvalidArgumentError: the rate is not between 0 and 1000 Hz.
        """
        self.path = Path(path)
        if self.path.suffix != ".mcap":
            raise EpisodeFileError(str(path), cause="an episode file ends with .mcap", remedy="rename it")
        self.interval_s = 1.0 / rate_hz
        """Simulated time between two frames [s]."""
        self._simulation = simulation
        self._pending: deque[_Capture | EpisodeEdit | EpisodeEvent | Event] = deque()
        self._wake = Event()
        self._has_ended = False
        self._error: Exception | None = None
        self._raised = False
        self._fault: EpisodeError | None = None
        self._progress = 0
        """Counts what was written."""
        self._stopped = False
        self._frames = 0
        capabilities = simulation.engine.capabilities
        self._has_joints = Capability.JOINTS in capabilities
        self._has_contacts = Capability.CONTACTS in capabilities
        self._last: _Capture | None = None
        self._last_content = b""
        self._last_time_s = 0.0
        self._offset_s = 0.0
        self._next_ns = 0
        self._is_edited = True
        self._performances: dict[str, EpisodeEvent] = {}
        """The skills that are being performed."""
        self._performed = 0
        header = self._header(rate_hz, has_events=events)
        self._flushing: deque[tuple[Event, int]] = deque()
        """Each is set when the events of as many frames are written."""
        self._is_late = False
        self._live: dict[str, EpisodeEvent] = {}
        self._cpu_clock: int | None = None
        """The clock of the processor time of the writing thread."""
        self._detection, self._writer = self._open(header, self_contained=self_contained)
        self._thread = Thread(target=self._write, name="mindstage-recorder", daemon=True)
        self._thread.start()
        self._remove = simulation.observers.add(self)
        try:
            self._publish_now()
        except BaseException:
            self._remove()
            self._end()
            raise
        simulation.on_close(self.stop)
        simulation.observers.recorder = self

    def _open(self, header: EpisodeHeader, *, self_contained: bool) -> tuple[EventProcess | None, _EpisodeWriter]:
        file = EpisodeFileWriter(self.path, is_self_contained=self_contained)
        detection = (
            EventProcess(has_joints=header.has_joints, has_contacts=header.has_contacts) if header.has_events else None
        )
        knowledge = self._simulation.knowledge
        return detection, _EpisodeWriter(file, header, knowledge, on_fault=self._on_fault, detection=detection)

    def _header(self, rate_hz: float, *, has_events: bool) -> EpisodeHeader:
        return EpisodeHeader(
            episode=uuid.uuid4().hex,
            start_unix_s=time.time(),
            engine=self._simulation.engine.name,
            rate_hz=rate_hz,
            has_joints=self._has_joints,
            has_contacts=self._has_contacts,
            has_events=has_events,
        )

    @property
    def recording(self) -> bool:
        """Whether it is still recording: neither stopped nor failed."""
        return not self._stopped and self._error is None

    @property
    def error(self) -> EpisodeError | None:
        """Why the recording has failed, else the first fault of what is derived from it; None if there is neither.

        In spite of a fault, such as one in the detection of events, the recording goes on.
        """
        if self._error is None:
            return self._fault
        if isinstance(self._error, EpisodeError):
            return self._error
        error = EpisodeFileError(str(self.path), cause=f"recording failed: {self._error}")
        error.__cause__ = self._error
        return error

    @property
    def frames(self) -> int:
        """The number of frames so far."""
        return self._frames

    @property
    def time_s(self) -> float:
        """The time since the begin of the episode [s]."""
        return self._last.time_ns / 1e9 if self._last else 0.0

    @property
    def live_events(self) -> tuple[EpisodeEvent, ...]:
        """The last events that were found, at most 50, each as it is now; provisional, and without withdrawn ones."""
        return tuple(self._live.values())

    @property
    def events_delay_s(self) -> float:
        """For how long the oldest frame that has not been searched for events is waiting for that, in wall time [s]."""
        return 0.0 if self._detection is None else self._detection.delay_s

    def stop(self, *, progress: Callable[[float], None] | None = None) -> None:
        """Records the last state and finishes the file; may be called repeatedly.

        It takes as long as there is something to write and events to be found.

        Args:
            progress: called with the part that is done, from 0 to 1, while it waits.

        Raises:
            EpisodeError: the file could not be written, for the stated reason, or nothing was done for a minute.
        """
        if not self._stopped:
            try:
                self._is_edited = True
                self._publish_now()
            except MindstageError as error:  # the engine has failed: what was recorded is kept
                _log.warning("the last state could not be recorded: %s", error)
            self._stopped = True
            self._remove()
            self._end()
        if not self._await(self._has_ended_within, progress):
            raise EpisodeFileError(str(self.path), cause=f"nothing was written for {_STOP_TIMEOUT_S:g} s")
        if self._error is not None and not self._raised:
            self._raised = True
            assert self.error is not None
            raise self.error

    def flush(self) -> None:
        """Writes everything that was recorded so far, with its events, so that the file can be read.

        Events are missing if their detection has not replied for 10 s.

        Raises:
            EpisodeFileError: it was not written in time.
        """
        written = Event()
        self._pending.append(written)
        self._wake.set()
        if not self._await(partial(self._is_written_within, written)):
            raise EpisodeFileError(str(self.path), cause=f"nothing was written for {_STOP_TIMEOUT_S:g} s")

    def _is_written_within(self, written: Event, timeout_s: float) -> bool:
        return written.wait(timeout_s) or not self.recording

    def _has_ended_within(self, timeout_s: float) -> bool:
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _await(self, is_done: Callable[[float], bool], progress: Callable[[float], None] | None = None) -> bool:
        """Waits in steps of some time [s] until something is done; gives up if nothing is done for long."""
        seen, since_s, most = self._progress_so_far(), time.monotonic(), 1
        while not is_done(_WAIT_S):
            waiting = len(self._pending) + self._writer.waiting_jobs
            waiting += 0 if self._detection is None else self._detection.waiting_frames
            most = max(most, waiting)
            if progress is not None:
                progress(1.0 - waiting / most)
            now = self._progress_so_far()
            if now != seen:
                seen, since_s = now, time.monotonic()
            elif time.monotonic() - since_s >= _STOP_TIMEOUT_S:
                return False
        return True

    def _progress_so_far(self) -> tuple[int, float]:
        """What differs when the writing thread, or the detection of events, has done something in the meantime."""
        cpu_s = 0.0
        if self._cpu_clock is not None:
            with suppress(OSError):  # the thread has ended
                cpu_s = round(time.clock_gettime(self._cpu_clock), 1)
        return self._progress, cpu_s

    def _on_fault(self, part: str, cause: str) -> None:
        """Notes that something that is derived from the recording could not be made; called in any thread."""
        if self._fault is None:
            self._fault = EpisodeError(f"{self.path}: {part}: {cause}; the states are recorded all the same")
        _log.error("%s: %s: %s", self.path, part, cause)
        details = {"part": part, "cause": cause}
        self._pending.append(EpisodeEdit(time_s=self.time_s, kind=FAULT_EDIT, client="recorder", details=details))

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def __repr__(self) -> str:
        state = "recording" if self.recording else "failed" if self._error else "stopped"
        return f"<{type(self).__name__} {self.path}: {state}, {self._frames:,} frames>"

    def _publish_now(self) -> None:
        with as_client("recorder"):  # an error of the simulation is for its other callers
            self._simulation.engine.run(lambda _: None, label="record")

    # -- in the engine thread ------------------------------------------------------------------------------------------

    def on_edit(self, kind: str, *, client: str, ids: Iterable[BodyId] = (), details: Mapping[str, Any] = {}) -> None:
        """Records an edit or a request; called in any thread.

        Args:
            kind: see `EpisodeEdit`.
            client: who did it.
            ids: the bodies that it is about.
            details: arguments and results, as JSON values.
        """
        if self._last is None or not self.recording:
            return
        now_s = round(self._last_time_s + self._offset_s, 9)  # of the state, which need not be a frame
        edit = EpisodeEdit(time_s=now_s, kind=kind, client=client, ids=tuple(ids), details=details)
        self._pending.append(edit)
        if kind == SKILL_EDIT and (event := self._performance(edit)) is not None:
            self._pending.append(event)

    def _performance(self, edit: EpisodeEdit) -> EpisodeEvent | None:
        """The event of a skill that begins or ends; None if it had begun before the recording."""
        details = edit.details
        key = str(details["performance"])
        if "outcome" not in details:
            self._performed += 1
            call = " ".join([str(details["skill"]), *(f"{name}={value}" for name, value in details["args"].items())])
            event = EpisodeEvent(
                id=f"{EpisodeEventKind.PERFORM}_{self._performed}",
                kind=EpisodeEventKind.PERFORM,
                begin_s=edit.time_s,
                end_s=None,
                thing=edit.ids[0],
                agent=str(details["agent"]),
                evidence=(f"{edit.client} performs {call}",),
            )
            self._performances[key] = event
            return event
        begun = self._performances.pop(key, None)
        if begun is None:
            return None
        reason = f": {details['reason']}" if details.get("reason") else ""
        evidence = (*begun.evidence, f"{details['outcome']}{reason}")
        return replace(begun, end_s=max(edit.time_s, begun.begin_s), evidence=evidence)

    def on_state(self, state: RecordedState, engine: Engine, *, edited: bool, rebuild_pending: bool) -> None:
        """Records a published state if a frame is due.

        Args:
            edited: whether anything but poses may have changed.
            rebuild_pending: whether reading joints and contacts would make the engine rebuild its model.
        """
        if not self.recording:
            return
        try:
            self._observe(state, engine, edited=edited, rebuild_pending=rebuild_pending)
        except Exception as error:  # recording must not stop the simulation
            self._error = error
            self._end()
            _log.exception("recording of %s failed", self.path)

    def _observe(self, state: RecordedState, engine: Engine, *, edited: bool, rebuild_pending: bool) -> None:
        last = self._last
        time_s = state.time_s
        if last is None:
            self._offset_s = -time_s
        elif time_s < self._last_time_s or (edited and time_s != self._last_time_s):
            self._offset_s += self._last_time_s - time_s  # a saved state was restored
        self._last_time_s = time_s
        time_ns = round((time_s + self._offset_s) * 1e9)
        has_changed = edited or self._is_edited or last is None or state.ids is not last.ids
        if not has_changed and time_ns < self._next_ns:
            return
        interval_ns = round(self.interval_s * 1e9)
        if time_ns >= self._next_ns:
            # an engine steps a little more or less than the interval
            behind_ns = time_ns - self._next_ns
            self._next_ns += interval_ns * (behind_ns // interval_ns + 1) - (0 if last else interval_ns // 10)
        self._is_edited = False
        structure, geometry = None, None
        if has_changed:
            structure = WorldStructure.of_snapshot(
                engine.snapshot(),
                state.ids,
                state.poses,
                spawned=self._simulation.worlds,
                immovable=self._simulation.immovable,
            )
            geometry = self._simulation.geometry
        moved, content = None, state.poses.tobytes()
        if last is not None and last.ids is state.ids:
            is_same = content == self._last_content  # much faster than to compare numbers
            moved = _NONE if is_same else np.flatnonzero((state.poses != last.poses).any(axis=1))
        self._last_content = content
        self._last = _Capture(
            time_ns if last is None else max(time_ns, last.time_ns),
            state.ids,
            state.poses,
            self._joints(engine, structure, moved, rebuild_pending=rebuild_pending),
            self._contacts(engine, state.ids, rebuild_pending=rebuild_pending),
            structure,
            self._drives(engine, moved, rebuild_pending=rebuild_pending),
            geometry,
            moved,
        )
        self._frames += 1
        self._pending.append(self._last)

    def _joints(
        self,
        engine: Engine,
        structure: WorldStructure | None,
        moved: NDArray[np.intp] | None,
        *,
        rebuild_pending: bool,
    ) -> Mapping[BodyId, tuple[float, ...]] | None:
        """The positions of the joints; those of before if they cannot have changed."""
        if not self._has_joints:
            return None
        last = self._last
        if last is None or last.joints is None:
            return engine.joint_positions()
        if structure is None and moved is not None and not len(moved):
            return last.joints
        if rebuild_pending and structure is not None and moved is not None:
            ids = {last.ids[row] for row in moved.tolist()}
            joints = {joint.id for joint in structure.world.joints if not ids.intersection((joint.parent, joint.child))}
            if last.joints.keys() <= joints:
                return last.joints
        return engine.joint_positions()

    def _drives(
        self, engine: Engine, moved: NDArray[np.intp] | None, *, rebuild_pending: bool
    ) -> Mapping[str, DriveState]:
        """The joints of all robots; those of before if they cannot have changed."""
        last = self._last
        if last is not None and (rebuild_pending or (moved is not None and not len(moved))):
            return last.drives
        found = {}
        for robot in robots_of(self._simulation).values():
            for name, state in robot.read_joint_states(engine).items():
                row = (state.position, state.velocity, state.effort)
                found[str(robot.joint_ids[name])] = DriveState(*map(round, row, _DRIVE_DIGITS))
        return found

    def _contacts(
        self, engine: Engine, ids: tuple[BodyId, ...], *, rebuild_pending: bool
    ) -> tuple[Contact, ...] | None:
        """The contacts; while the model waits for its rebuild, those of before between the bodies that still exist."""
        if not self._has_contacts:
            return None
        if not rebuild_pending or self._last is None or self._last.contacts is None:
            return engine.contacts()
        if ids is self._last.ids:
            return self._last.contacts
        present = {*ids, None}
        return tuple(each for each in self._last.contacts if each.a in present and each.b in present)

    def _end(self) -> None:
        self._has_ended = True
        self._wake.set()

    # -- in the thread that writes -------------------------------------------------------------------------------------

    def _write(self) -> None:
        if hasattr(time, "pthread_getcpuclockid"):
            self._cpu_clock = time.pthread_getcpuclockid(get_ident())
        try:
            has_ended = False
            while not has_ended:
                # the thread is not woken for each frame, which would interrupt the engine's thread
                if not self._flushing:
                    self._wake.wait(_POLL_S)
                    self._wake.clear()
                has_ended = self._has_ended
                for _ in range(len(self._pending)):
                    self._write_item(self._pending.popleft())
                self._exchange(_POLL_S if self._flushing else 0.0)
                self._writer.flush_if_due()
                if self._writer.work():
                    self._wake.set()
                self._end_flush()
            self._write_rest()
            self._writer.work(all=True)
            self._writer.flush()
            self._finish_detection()
            self._writer.finish()
            self._write_rest()  # faults of what is written at the end
            self._writer.close()
        except Exception as error:
            self._error = self._error or error
            _log.exception("recording of %s failed", self.path)
            self._writer.abort()
        finally:
            if self._detection is not None:
                self._detection.kill()

    def _write_rest(self) -> None:
        while self._pending:
            self._write_item(self._pending.popleft())

    def _write_item(self, item: _Capture | EpisodeEdit | EpisodeEvent | Event) -> None:
        self._progress += 1
        match item:
            case _Capture():
                self._writer.add_frame(item)
            case EpisodeEdit():
                self._writer.add_edit(item)
            case EpisodeEvent():
                self._add_events((item,))
            case Event():
                self._writer.work(all=True)
                detection = self._detection
                self._flushing.append((item, 0 if detection is None else detection.frames + detection.waiting_frames))

    def _end_flush(self) -> None:
        """Writes what is wanted in the file, if its events are known."""
        detection = self._detection
        if detection is None or detection.has_ended or detection.silent_s > _SILENT_S:
            frames = float("inf")
        else:
            frames = detection.frames
        if not self._flushing or self._flushing[0][1] > frames:
            return
        for _ in range(len(self._pending)):  # faults that were found in the meantime
            self._write_item(self._pending.popleft())
        self._writer.flush()
        while self._flushing and self._flushing[0][1] <= frames:
            self._flushing.popleft()[0].set()

    def _exchange(self, timeout_s: float) -> None:
        """Passes frames on to the detection of events, and writes the events that it has found."""
        if self._detection is None:
            return
        for reply in self._detection.exchange(timeout_s):
            self._progress += 1
            match reply:
                case EventsReply():
                    self._add_events(reply.events)
                case DetectionFaultReply():
                    self._on_fault("events", reply.cause)
        is_late = self._detection.delay_s > _LATE_S
        if is_late and not self._is_late:
            _log.warning("%s: events are found %g s late or more", self.path, _LATE_S)
        self._is_late = is_late

    def _add_events(self, events: Sequence[EpisodeEvent]) -> None:
        self._writer.add_events(events)
        for event in events:
            self._live.pop(event.id, None)
            if event.state is not EventState.WITHDRAWN:
                self._live[event.id] = event
        while len(self._live) > _MAX_LIVE_EVENTS:
            del self._live[next(iter(self._live))]

    def _finish_detection(self) -> None:
        """Waits until all events are found, and attaches them."""
        if self._detection is None:
            return
        self._detection.finish()
        progress, since_s = self._progress, time.monotonic()
        while not self._detection.has_ended:
            self._exchange(_POLL_S)
            if self._progress != progress:
                progress, since_s = self._progress, time.monotonic()
            elif time.monotonic() - since_s >= _STOP_TIMEOUT_S:
                self._detection.kill()
                self._on_fault("events", f"their detection has made no progress for {_STOP_TIMEOUT_S:g} s")
        self._exchange(0.0)
        self._write_rest()
        self._writer.add_final_events(self._detection.final_events)


class RecordingFolder:
    """Records a simulation in new files of a folder, one at a time; may be used from any thread."""

    def __init__(self, simulation: Simulation, folder: Path) -> None:
        """Records nothing before `start`.

        Args:
            folder: created with the first recording, if it does not exist.
        """
        self.folder = folder
        self._simulation = simulation
        self._recorder: Recorder | None = None
        self._lock = Lock()

    @property
    def recorder(self) -> Recorder | None:
        """The recorder that is running; None if there is none."""
        recorder = self._recorder
        return recorder if recorder is not None and recorder.recording else None

    @checked
    def start(self, name: str = "", *, rate_hz: Frequency = 30.0) -> Path:
        """Starts to record.

        Args:
            name: the name of the file, without a folder; by default the current time.
            rate_hz: see `Recorder`.

        Returns:
            The path of the file.

        Raises:
            EpisodeError: a recording is running, the name has a folder, or the file exists or cannot be written.
        """
        with self._lock:
            if self.recorder is not None:
                raise EpisodeError(f"{self.recorder.path} is being recorded; stop that first")
            chosen = name.removesuffix(".mcap") or time.strftime("episode-%Y-%m-%d-%H-%M-%S")
            if Path(chosen).name != chosen or chosen.startswith("."):
                raise EpisodeFileError(name, cause="it is not the name of a file", remedy="give it without a folder")
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise EpisodeFileError(str(self.folder), cause=error.strerror or str(error)) from error
            self._recorder = Recorder(self._simulation, self.folder / f"{chosen}.mcap", rate_hz=rate_hz)
            return self._recorder.path

    def stop(self) -> Path:
        """Finishes the recording that is running, and returns its path.

        Raises:
            EpisodeError: nothing is being recorded, or the file could not be written.
        """
        with self._lock:
            if self._recorder is None:
                raise EpisodeError("nothing is being recorded")
            recorder, self._recorder = self._recorder, None
        recorder.stop()
        return recorder.path


class _EpisodeWriter:
    """Writes frames and edits to a file: only what has changed, and at the begin of each chunk what is needed."""

    def __init__(
        self,
        file: EpisodeFileWriter,
        header: EpisodeHeader,
        knowledge: KnowledgeBase,
        *,
        on_fault: Callable[[str, str], object],
        detection: EventProcess | None = None,
    ) -> None:
        self._file, self._header, self._knowledge = file, header, knowledge
        self._on_fault, self._detection = on_fault, detection
        self._encode = EpisodeEncoder()
        self._structure: WorldStructure | None = None
        self._poses: PoseArray = np.zeros((0, 7))
        self._joints: Mapping[BodyId, tuple[float, ...]] = {}
        self._contacts: tuple[Contact, ...] = ()
        self._drives: Mapping[str, DriveState] = {}
        self._time_ns = 0
        self._number = -1
        self._base = 0
        self._base_ns = 0
        self._base_structure = 0
        self._complete = (-1, -1)
        """The number of the last structure that was written as a whole, and the first chunk with it."""
        self._changes: list[bytes] = []
        """The changes of the structure in the chunk in progress, which the next one repeats."""
        self._chunk_ns = 0
        self._changed_bodies: set[BodyId] = set()
        """The bodies that have moved since the last base chunk."""
        self._changed_joints: set[BodyId] = set()
        self._knowledge_digest = b""
        self._jobs: deque[partial[None]] = deque()
        self._geometry_jobs: deque[partial[None]] = deque()
        """These are done first."""
        self._geometry_keys: set[str] = set()
        self._attached: dict[BodyId, BodyGeometry] = {}
        """That which is in the file."""
        self._geometry_files = 0
        self._frame: list[tuple[EpisodeTopic, bytes]] = []
        """The messages of the frame in progress."""
        self._held_frames: list[tuple[int, list[tuple[EpisodeTopic, bytes]]]] = []
        """Those that wait for geometry before they are searched for events."""
        self._open_since_s: float | None = None
        self._chunk_frames = 0
        self._chunk_bytes = 0

    # -- chunks --------------------------------------------------------------------------------------------------------

    def flush_if_due(self) -> None:
        """Writes the open chunk if it is old or long."""
        if self._open_since_s is None:
            return
        is_long = self._chunk_frames >= _CHUNK_FRAMES or self._chunk_bytes >= _CHUNK_BYTES
        if is_long or time.monotonic() - self._open_since_s >= _CHUNK_WALL_S:
            self.flush()

    def flush(self) -> None:
        """Writes the open chunk."""
        if self._open_since_s is not None:
            self._open_since_s = None
            self._file.end_chunk()

    def _add(self, topic: EpisodeTopic, data: bytes, time_ns: int | None = None) -> None:
        self._chunk_bytes += len(data)
        self._file.add(topic, self._time_ns if time_ns is None else time_ns, data)

    def _add_change(self, topic: EpisodeTopic, data: bytes) -> None:
        """Adds a message of the frame in progress."""
        self._add(topic, data)
        self._frame.append((topic, data))

    @property
    def waiting_jobs(self) -> int:
        """The number of attachments that are not written yet."""
        return len(self._jobs) + len(self._geometry_jobs)

    def _begin_chunk(self) -> list[tuple[EpisodeTopic, bytes]]:
        """Begins a chunk, and returns the messages that repeat what was before."""
        assert self._structure is not None
        self._open_since_s, self._chunk_frames, self._chunk_bytes = time.monotonic(), 0, 0
        self._number += 1
        self._chunk_ns = self._time_ns
        has_changed = self._changed_bodies or self._changed_joints or self._structure.number != self._base_structure
        is_base = self._number == 0 or (has_changed and self._time_ns - self._base_ns >= _BASE_S * 1e9)
        if is_base:
            self._base, self._base_ns = self._number, self._time_ns
            self._base_structure = self._structure.number
            self._changed_bodies, self._changed_joints = set(), set()
        # The chunk after a base is one, too: what follows can be read without either of them.
        is_whole = self._number - self._base <= 1
        repeated = self._whole_state() if is_whole else self._changed_state()
        self._changes = []
        base = self._number if is_whole else self._base
        structure = self._structure
        head = ChunkHead(self._header.episode, self._number, base, structure.number, structure.digest, len(repeated))
        self._add(EpisodeTopic.CHUNKS, self._encode.chunk(head))
        for topic, data in repeated:
            self._add(topic, data)
        return repeated

    def _whole_state(self) -> list[tuple[EpisodeTopic, bytes]]:
        structure, time_ns = self._structure, self._time_ns
        assert structure is not None
        messages = []
        number, chunk = self._complete
        if number < structure.number or chunk == self._number - 1:  # twice in a row
            self._complete = (structure.number, self._number if number < structure.number else chunk)
            messages.append((EpisodeTopic.WORLD, self._encode.world(time_ns, structure.complete_record())))
        moving: list[int] = []
        fixed: list[int] = []
        for row, body in enumerate(structure.world.bodies):
            is_movable = body.physics.mobility in {Mobility.DYNAMIC, Mobility.KINEMATIC}
            (moving if is_movable and body.id not in structure.immovable else fixed).append(row)
        for topic, rows in ((EpisodeTopic.TF_STATIC, fixed), (EpisodeTopic.TF, moving)):
            if rows:
                ids = [structure.ids[row] for row in rows]
                messages.append((topic, self._encode.transforms(time_ns, ids, self._poses[rows])))
        messages.append((EpisodeTopic.MARKERS, self._encode.markers(time_ns, structure.world.bodies)))
        if self._joints:
            messages.append((EpisodeTopic.JOINTS, self._encode.joints(time_ns, self._named(self._joints))))
        messages += self._drive_messages()
        messages.append((EpisodeTopic.CONTACTS, self._encode.contacts(time_ns, self._contacts)))
        return messages

    def _drive_messages(self) -> list[tuple[EpisodeTopic, bytes]]:
        states = self._drives
        return [(EpisodeTopic.DRIVES, self._encode.drives(self._time_ns, states))] if states else []

    def _changed_state(self) -> list[tuple[EpisodeTopic, bytes]]:
        structure, time_ns = self._structure, self._time_ns
        assert structure is not None
        messages = [(EpisodeTopic.WORLD, change) for change in self._changes]
        if rows := sorted(structure.rows[id] for id in self._changed_bodies if id in structure.rows):
            ids = [structure.ids[row] for row in rows]
            messages.append((EpisodeTopic.TF, self._encode.transforms(time_ns, ids, self._poses[rows])))
        if joints := {id: self._joints[id] for id in sorted(self._changed_joints) if id in self._joints}:
            messages.append((EpisodeTopic.JOINTS, self._encode.joints(time_ns, self._named(joints))))
        messages += self._drive_messages()
        messages.append((EpisodeTopic.CONTACTS, self._encode.contacts(time_ns, self._contacts)))
        return messages

    def _named(self, joints: Mapping[BodyId, Sequence[float]]) -> dict[str, float]:
        assert self._structure is not None
        names = self._structure.joint_names
        return {
            name: value
            for id, values in joints.items()
            if id in names
            for name, value in zip(names[id], values, strict=True)
        }

    # -- frames --------------------------------------------------------------------------------------------------------

    def add_frame(self, capture: _Capture) -> None:
        """Writes what has changed since the frame before."""
        if self._structure is None:
            self._add_first_frame(capture)
            return
        if self._open_since_s is not None and capture.time_ns - self._chunk_ns > _CHUNK_S * 1e9:
            self.flush()
        if self._open_since_s is None:
            self._begin_chunk()
        self._time_ns = time_ns = capture.time_ns
        moved = self._update_structure(capture)
        if len(moved):
            ids = [capture.ids[row] for row in moved.tolist()]
            self._changed_bodies.update(ids)
            self._add_change(EpisodeTopic.TF, self._encode.transforms(time_ns, ids, capture.poses[moved]))
        self._poses = capture.poses
        if capture.joints is not None and capture.joints is not self._joints:
            before = self._joints
            changed = {id: values for id, values in capture.joints.items() if before.get(id) != values}
            gone: dict[BodyId, tuple[float, ...]] = dict.fromkeys(before.keys() - capture.joints.keys(), (np.nan,) * 6)
            changed |= gone
            if changed:
                self._changed_joints.update(changed)
                if named := self._named(changed):
                    self._add_change(EpisodeTopic.JOINTS, self._encode.joints(time_ns, named))
            self._joints = capture.joints
        if capture.drives != self._drives:
            self._drives = capture.drives
            for topic, data in self._drive_messages():
                self._add_change(topic, data)
        if capture.contacts is not None and capture.contacts != self._contacts:
            self._contacts = capture.contacts
            self._add_change(EpisodeTopic.CONTACTS, self._encode.contacts(time_ns, self._contacts))
        self._end_frame()
        self.flush_if_due()

    def _end_frame(self) -> None:
        self._add(EpisodeTopic.CLOCK, self._encode.clock(self._time_ns))
        self._chunk_frames += 1
        if self._detection is not None:
            self._held_frames.append((self._time_ns, self._frame))
            self._pass_frames_on()
        self._frame = []

    def _pass_frames_on(self) -> None:
        """Passes frames to the detection of events, unless the geometry of a body in them is still to be passed on."""
        if self._detection is not None and not self._geometry_jobs:
            for time_ns, messages in self._held_frames:
                self._detection.add_frame(time_ns, messages)
            self._held_frames.clear()

    def _add_events(self, events: Iterable[EpisodeEvent]) -> None:
        for event in events:
            self._add(EpisodeTopic.EVENTS, self._encode.event(self._time_ns, event))

    def _update_structure(self, capture: _Capture) -> NDArray[np.intp]:
        """Writes a change of the structure, and returns the rows of the poses that are new or have changed."""
        before = self._structure
        assert before is not None
        if capture.structure is not None:
            if (followed := before.followed_by(capture.structure)) is not None:
                self._structure, record = followed
                self._changes.append(self._encode.world(self._time_ns, record))
                self._add_change(EpisodeTopic.WORLD, self._changes[-1])
            if capture.geometry is not None:
                self._expect_geometry(capture.geometry, capture.structure.world)
        assert self._structure is not None
        if capture.moved is not None:
            return capture.moved
        if self._structure.ids == before.ids:
            return np.flatnonzero((capture.poses != self._poses).any(axis=1))
        rows = np.array([before.rows.get(id, -1) for id in capture.ids], dtype=np.intp)
        is_new = rows < 0
        is_new[~is_new] = (capture.poses[~is_new] != self._poses[rows[~is_new]]).any(axis=1)
        return np.flatnonzero(is_new)

    def _add_first_frame(self, capture: _Capture) -> None:
        assert capture.structure is not None
        self._structure, self._poses, self._time_ns = capture.structure, capture.poses, capture.time_ns
        self._joints, self._contacts = capture.joints or {}, capture.contacts or ()
        self._drives = capture.drives
        self._file.add_attachment("episode.json", "application/json", msgspec.json.encode(self._header))
        values = msgspec.to_builtins(self._header, str_keys=True)
        self._file.add_metadata("mindstage", {name: str(value) for name, value in values.items()})
        self._frame = [each for each in self._begin_chunk() if each[0] is not EpisodeTopic.MARKERS]
        self._expect_geometry(capture.geometry or {}, self._structure.world)
        self._end_frame()
        self.flush()
        self._jobs.append(partial(self._add_map, "map-begin.owl.zst", self._structure.frame(self._poses)))
        self._jobs.append(partial(self._add_knowledge))

    def work(self, *, all: bool = False) -> bool:
        """Does one of the jobs that take long, between which frames are written, or all; returns whether there is more.

        These are the attachments: a whole kitchen as OWL and its meshes take longer than a frame may wait.
        """
        while jobs := self._geometry_jobs or self._jobs:
            job = jobs.popleft()
            try:
                job()
            except OSError:  # the disk is full, for example
                raise
            except Exception as error:  # what is derived must not end a recording
                self._on_fault(job.func.__name__.removeprefix("_add_"), f"{type(error).__name__}: {error}")
            self._pass_frames_on()
            if not all:
                break
        return bool(self._geometry_jobs or self._jobs)

    def _add_map(self, name: str, frame: EpisodeFrame) -> None:
        """Attaches a world as a semantic map."""
        text = write_map(frame.world())
        self._file.add_attachment(name, "application/rdf+xml+zstd", text.encode(), time_ns=self._time_ns)

    def _add_knowledge(self) -> None:
        """Attaches the knowledge base, if it has changed since it was attached."""
        content = self._knowledge.to_bytes()
        if (digest := hashlib.sha256(content).digest()) != self._knowledge_digest:
            self._knowledge_digest = digest
            name = "knowledge.msgpack.zst"
            self._file.add_attachment(name, "application/msgpack+zstd", content, time_ns=self._time_ns)

    def _expect_geometry(self, geometry: GeometryMap, world: World) -> None:
        """Attaches geometry before what else is to be attached; frames wait for it that are searched for events."""
        if any(self._attached.get(id) is not each for id, each in geometry.items()):
            self._geometry_jobs.append(partial(self._add_geometry, geometry, world))

    def _add_geometry(self, geometry: GeometryMap, world: World) -> None:
        """Attaches geometry that is not in the file yet, and the bodies of a world with it as glTF."""
        new = {id: each for id, each in geometry.items() if self._attached.get(id) is not each}
        if not new:
            return
        self._attached |= new
        name = f"geometry-{self._geometry_files}"
        self._geometry_files += 1
        if self._detection is not None:  # which does not look at what is seen
            shapes = {id: dataclasses.replace(each, visuals=(), lights=(), _draw=None) for id, each in new.items()}
            self._detection.add_geometry(encode_geometry(shapes, known=self._geometry_keys))
        content = encode_geometry(new, known=self._geometry_keys)
        self._file.add_attachment(f"{name}.msgpack.zst", "application/msgpack+zstd", content, time_ns=self._time_ns)
        if not self._geometry_keys >= {each.key for each in new.values()}:
            lights = world.lights if self._geometry_files == 1 else ()
            self._jobs.append(partial(self._add_gltf, f"{name}.glb.zst", new, replace(world, lights=lights)))
        self._geometry_keys |= {each.key for each in new.values()}

    def _add_gltf(self, name: str, geometry: GeometryMap, world: World) -> None:
        """Attaches bodies with their geometry, where they are, for other programs."""
        world = replace(
            world,
            bodies=tuple(body for body in world.bodies if body.id in geometry),
            joints=(),
            attachments=(),
        )
        content = world_to_glb(world, geometry=geometry).data
        self._file.add_attachment(name, "model/gltf-binary+zstd", content, time_ns=self._time_ns)

    def add_edit(self, edit: EpisodeEdit) -> None:
        """Writes an edit or a request."""
        if self._structure is None:
            return
        if self._open_since_s is None:
            self._begin_chunk()
        self._add(EpisodeTopic.EDITS, self._encode.edit(round(edit.time_s * 1e9), edit))

    def add_events(self, events: Sequence[EpisodeEvent]) -> None:
        """Writes events that were not detected here."""
        if not events or self._structure is None:
            return
        if self._open_since_s is None:
            self._begin_chunk()
        self._add_events(events)

    # -- the end -------------------------------------------------------------------------------------------------------

    def add_final_events(self, events: bytes | None) -> None:
        """Attaches the events of the whole recording as JSON, which replace the provisional ones; None adds nothing."""
        if events is not None and self._structure is not None:
            self._file.add_attachment(FINAL_EVENTS, "application/json+zstd", events, time_ns=self._time_ns)

    def finish(self) -> None:
        """Writes the rest of the file but its index."""
        self.flush()
        if self._structure is not None:
            self._jobs.append(partial(self._add_map, "map-end.owl.zst", self._structure.frame(self._poses)))
            self._jobs.append(partial(self._add_knowledge))
            self.work(all=True)

    def close(self) -> None:
        """Writes the open chunk and the index."""
        self.flush()
        self._file.close()

    def abort(self) -> None:
        """Closes the file after a failure, as far as that is possible."""
        try:
            self._file.close()
        except (OSError, ValueError) as error:
            _log.warning("%s could not be finished: %s", self._file.path, error)


def write_episode(
    recording: Recording,
    path: str | os.PathLike[str],
    *,
    knowledge: KnowledgeBase,
    immovable: frozenset[BodyId] = frozenset(),
    source: str = "",
) -> None:
    """Writes a recording of any kind, such as a bag, as an episode file, with its events and edits.

    Args:
        recording: what is written; its times become those since its begin.
        path: the file to write, ending with ".mcap", which must not exist.
        knowledge: the knowledge base that the episode is asked with.
        immovable: the dynamic bodies that cannot move, as of `Simulation.immovable`.
        source: what the recording was made from; by default its name.

    Raises:
        EpisodeFileError: the file exists or cannot be written, or the suffix is another one.
    """
    if Path(path).suffix != ".mcap":
        raise EpisodeFileError(str(path), cause="an episode file ends with .mcap", remedy="rename it")
    frames = recording.frames()
    first = next(frames)
    header = EpisodeHeader(
        episode=uuid.uuid4().hex,
        start_unix_s=recording.start_unix_s or 0.0,
        engine="none",
        rate_hz=0.0,
        has_joints=first.joint_positions is not None,
        has_contacts=first.contacts is not None,
        has_events=True,
        source=source or recording.name,
    )
    events, edits = deque(recording.events()), deque(recording.edits())

    def on_fault(part: str, cause: str) -> None:
        _log.error("%s: %s: %s", path, part, cause)

    writer = _EpisodeWriter(EpisodeFileWriter(Path(path)), header, knowledge, on_fault=on_fault)
    structure: World | None = None
    try:
        for frame in chain([first], frames):
            is_new = frame.structure is not structure
            structure = frame.structure
            world = (
                WorldStructure.of_snapshot(
                    frame.world(), frame.ids, frame.poses, spawned=recording.spawned, immovable=immovable
                )
                if is_new
                else None
            )
            time_ns = round((frame.time_s - recording.begin_s) * 1e9)
            geometry = recording.geometry if is_new else None
            joints, contacts = frame.joint_positions, frame.contacts
            drives = frame.drives
            writer.add_frame(_Capture(time_ns, frame.ids, frame.poses, joints, contacts, world, drives, geometry, None))
            while edits and edits[0].time_s <= frame.time_s:
                edit = edits.popleft()
                writer.add_edit(replace(edit, time_s=edit.time_s - recording.begin_s))
            begun = []
            while events and events[0].begin_s <= frame.time_s:
                begun.append(_shifted(events.popleft(), -recording.begin_s))
            writer.add_events(begun)
        writer.finish()
        writer.close()
    except BaseException:
        writer.abort()
        raise


def _shifted(event: EpisodeEvent, offset_s: float) -> EpisodeEvent:
    end_s = None if event.end_s is None else event.end_s + offset_s
    return replace(event, begin_s=event.begin_s + offset_s, end_s=end_s)
