"""`Episode`: a recorded simulation, read from its file.

The state at a time is read from the chunk of that time and the last one with the state of all bodies, at most 30
seconds earlier, whatever the length of the episode.
"""

from __future__ import annotations

import logging
import math
import os
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from threading import RLock
from types import MappingProxyType
from typing import NamedTuple, Self

import msgspec
import numpy as np
from msgspec.structs import replace

from mindstage.engines import make_engine
from mindstage.episodes.detection import detect_events
from mindstage.episodes.geometry_file import decode_geometry
from mindstage.episodes.mcap_file import FORMAT_VERSION, EpisodeFile, EpisodeLoss, FileChunk, StoredMessage
from mindstage.episodes.messages import ChunkHead, EpisodeDecoder, EpisodeTopic, WorldRecord
from mindstage.episodes.recorder import FINAL_EVENTS, EpisodeHeader
from mindstage.episodes.recording import FAULT_EDIT, EpisodeEdit, EpisodeEvent, EpisodeFrame, EventState
from mindstage.episodes.structure import EpisodeState, WorldStructure
from mindstage.errors import EpisodeFileError, EpisodeTimeError, without_surrogates
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.questions import WorldState
from mindstage.ranges import Time, checked
from mindstage.scene import NO_GEOMETRY, BodyGeometry, BodyId, GeometryMap, World
from mindstage.simulation.imagined import match_world
from mindstage.simulation.simulation import Simulation

__all__ = ["Episode", "parts_of_spawned"]

_KEPT_CHUNKS = 8
_KEPT_BASES = 4
_RESUME_TIMEOUT_S = 120.0
_log = logging.getLogger("mindstage.episodes")


class _ReadChunk(NamedTuple):
    frames: tuple[EpisodeFrame, ...]
    times: tuple[float, ...]
    edits: tuple[EpisodeEdit, ...]
    events: tuple[EpisodeEvent, ...]
    structures: Mapping[int, WorldStructure]


class Episode:
    """A recorded simulation, which can be asked about any time; a `Recording`.

    >>> with Episode("run.mcap") as episode:
    ...     world = episode.frame_at(3.2).world()
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Opens an episode file.

        Args:
            path: the file. Of an interrupted or damaged one the readable part is used, and `losses` lists the rest.

        Raises:
            EpisodeFileError: it does not exist, is no episode, or nothing in it is readable.
        """
        self.path = Path(path)
        self._lock = RLock()
        self._events_lock = RLock()
        self._file = EpisodeFile(self.path)
        self._chunks: OrderedDict[int, _ReadChunk] = OrderedDict()
        self._bases: OrderedDict[int, EpisodeState] = OrderedDict()
        self._structures: dict[int, WorldStructure] = {}
        self._closed = False
        try:
            self.header = self._read_header()
            """What was recorded, and how."""
            self._first = next(self.frames(), None)
            if self._first is None:
                raise EpisodeFileError(str(path), cause="no frame in it is readable")
        except BaseException:
            self._file.close()
            raise

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Self:
        """Opens an episode file; see `Episode`."""
        return cls(path)

    def _read_header(self) -> EpisodeHeader:
        content = self._file.attachment("episode.json")
        if content is None:
            raise EpisodeFileError(str(self.path), cause="the description of the episode is lost")
        try:
            header = msgspec.json.decode(content, type=EpisodeHeader)
        except msgspec.MsgspecError as error:
            raise EpisodeFileError(str(self.path), cause=f"the description of the episode: {error}") from error
        if (version := header.format_version) != FORMAT_VERSION:
            cause = f"it has format version {version}, and this version of Mindstage reads {FORMAT_VERSION}"
            remedy = "use a newer Mindstage" if version > FORMAT_VERSION else "record it again"
            raise EpisodeFileError(str(self.path), cause=cause, remedy=remedy)
        return header

    def close(self) -> None:
        """Closes the file; may be called repeatedly."""
        self._closed = True
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        if self._closed:
            return f"<{type(self).__name__} {self.name}: closed>"
        return f"<{type(self).__name__} {self.name}: {self.end_s - self.begin_s:.2f} s, {self.header.engine}>"

    # -- what it is ----------------------------------------------------------------------------------------------------

    @property
    def name(self) -> str:
        """The name of the file without its suffix."""
        return without_surrogates(self.path.stem)

    @property
    def begin_s(self) -> float:
        """The time of the first frame [s]."""
        assert self._first is not None
        return self._first.time_s

    @cached_property
    def end_s(self) -> float:
        """The time of the last frame [s]."""
        for chunk in reversed(self._file.chunks):
            try:
                times = self._read(chunk.number).times
            except EpisodeFileError:
                continue
            if times:
                return times[-1]
        return self.begin_s

    @property
    def start_unix_s(self) -> float | None:
        """The wall time at which the episode began, in seconds since 1970."""
        return self.header.start_unix_s

    @property
    def size_bytes(self) -> int:
        """The size of the file."""
        return self._file.size_bytes

    @property
    def losses(self) -> tuple[EpisodeLoss, ...]:
        """What could not be read; the whole file is checked whenever this is used."""
        with self._lock:
            found = self._file.losses()
            return (*found, *self._unreadable())

    def _unreadable(self) -> Iterator[EpisodeLoss]:
        """The times of whole chunks that are relative to lost ones."""
        begin_s: float | None = None
        cause: str | None = None
        for chunk in self._file.chunks:
            try:
                times = self._read(chunk.number).times
            except EpisodeFileError as error:
                cause = cause or error.cause
                continue
            if cause is not None and times:
                yield EpisodeLoss(begin_s=begin_s, end_s=times[0], cause=cause)
                cause = None
            begin_s = times[-1] if times else begin_s
        if cause is not None:
            yield EpisodeLoss(begin_s=begin_s, end_s=None, cause=cause)

    @property
    def spawned(self) -> tuple[World, ...]:
        """The worlds as they were at the begin, one per map."""
        assert self._first is not None
        return self.spawned_at(self._first.time_s)

    @cached_property
    def geometry(self) -> GeometryMap:
        """The geometry of all bodies, as far as it is known; of a body that was replaced, that of the last one."""
        with self._lock:
            found: dict[BodyId, BodyGeometry] = {}
            known: dict[str, BodyGeometry] = {}
            for name in self._file.attachment_names():
                if not (name.startswith("geometry-") and name.endswith(".msgpack.zst")):
                    continue
                try:
                    found |= decode_geometry(self._file.attachment(name) or b"", known=known)
                except (ValueError, msgspec.MsgspecError) as error:
                    raise EpisodeFileError(str(self.path), cause=f"{name}: {error}") from error
                known |= {each.key: each for each in found.values()}
            return MappingProxyType(found) if found else NO_GEOMETRY

    # -- states --------------------------------------------------------------------------------------------------------

    @checked
    def frame_at(self, time_s: Time) -> EpisodeFrame:
        """The last frame at or before a time [s].

        Raises:
            EpisodeTimeError: the time is before the begin or after the end.
            EpisodeFileError: the frames of that time are lost.
        """
        with self._lock:
            return self._frame_at(time_s)[0]

    def _frame_at(self, time_s: float) -> tuple[EpisodeFrame, int]:
        if not self.begin_s <= time_s <= self.end_s:
            raise EpisodeTimeError(self.name, time_s=time_s, begin_s=self.begin_s, end_s=self.end_s)
        for loss in self._file.gaps:
            if loss.begin_s is not None and loss.end_s is not None and loss.begin_s < time_s < loss.end_s:
                raise self._lost(time_s)
        chunk: FileChunk | None = self._file.chunk_at(math.floor(time_s * 1e9 + 0.5))
        while chunk is not None:
            read = self._read(chunk.number)
            if row := bisect_right(read.times, time_s):
                return read.frames[row - 1], chunk.number
            if chunk.number and self._file.chunk(chunk.number - 1) is None:
                break
            chunk = self._file.chunk(chunk.number - 1)
        raise self._lost(time_s)

    def _lost(self, time_s: float) -> EpisodeFileError:
        return EpisodeFileError(
            str(self.path), cause=f"the state at {time_s:g} s is lost", remedy="`losses` lists what is lost"
        )

    @checked
    def frames(self, begin_s: Time | None = None, end_s: Time | None = None) -> Iterator[EpisodeFrame]:
        """All readable frames between two times [s], both included, in the order of time."""
        with self._lock:
            self._check_open()
            first = 0 if begin_s is None else self._file.chunk_at(math.floor(begin_s * 1e9)).number - 1
        number = first
        while True:
            with self._lock:
                chunk = next((each for each in self._file.chunks if each.number >= number), None)
                if chunk is None or (end_s is not None and chunk.begin_ns / 1e9 > end_s):
                    return
                number = chunk.number + 1
                try:
                    frames = self._read(chunk.number).frames
                except EpisodeFileError:  # listed by `losses`
                    continue
            for frame in frames:
                if (begin_s is None or frame.time_s >= begin_s) and (end_s is None or frame.time_s <= end_s):
                    yield frame

    @checked
    def state_at(self, time_s: Time) -> WorldState:
        """The state that questions about a time [s] look at.

        Raises:
            EpisodeTimeError: the time is before the begin or after the end.
            EpisodeFileError: the frames of that time are lost.
        """
        frame = self.frame_at(time_s)
        ids = set(frame.ids)
        return WorldState(
            world=frame.world(),
            spawned=self.spawned_at(time_s),
            joint_positions=frame.joint_positions,
            source=self.header.engine,
            geometry={id: each for id, each in self.geometry.items() if id in ids},
        )

    @checked
    def spawned_at(self, time_s: Time) -> tuple[World, ...]:
        """The worlds that were spawned until a time [s], as they were described."""
        return self._structure_at(time_s).spawned

    @checked
    def immovable_at(self, time_s: Time) -> frozenset[BodyId]:
        """The dynamic bodies that were simulated as static ones at a time [s]."""
        return self._structure_at(time_s).immovable

    def _structure_at(self, time_s: float) -> WorldStructure:
        with self._lock:
            frame, number = self._frame_at(time_s)
            structures = self._read(number).structures.values()
            return next(each for each in structures if each.world is frame.structure)

    @checked
    def resume(self, time_s: Time, *, engine: str = "mujoco") -> Simulation:
        """Continues the simulation from a time [s], at rest: velocities are not recorded.

        `reset` of the returned simulation, which the caller closes, restores the worlds as they were spawned.

        Args:
            engine: the name of the engine.

        Raises:
            EpisodeTimeError: the time is before the begin or after the end.
            EpisodeFileError: the frames of that time, the geometry or the knowledge base are lost.
            EngineUnavailableError: the engine is not installed.
        """
        frame, spawned = self.frame_at(time_s), self.spawned_at(time_s)
        simulation = Simulation(self.knowledge(), make_engine(engine))
        try:
            present = frame.present()
            for part in parts_of_spawned(present, spawned):
                simulation.spawn(part, geometry=self.geometry)
            notes = simulation.engine.run(
                lambda engine: match_world(engine, present, worlds=spawned),
                label="resume",
                edits=True,
                timeout_s=_RESUME_TIMEOUT_S,
            )
        except BaseException:
            simulation.close()
            raise
        for note in notes:
            _log.warning("%s at %g s: %s", self.name, time_s, note)
        return simulation

    # -- knowledge and maps --------------------------------------------------------------------------------------------

    def knowledge(self) -> KnowledgeBase:
        """A new knowledge base with all statements of the recorded one, at the end of the recording if it was stopped.

        Raises:
            EpisodeFileError: it is damaged, or was not recorded.
        """
        content = self._attachment("knowledge.msgpack.zst", "the knowledge base")
        try:
            return KnowledgeBase.from_bytes(content)
        except (ValueError, msgspec.MsgspecError) as error:
            raise EpisodeFileError(str(self.path), cause=f"the knowledge base: {error}") from error

    @property
    def map_at_begin(self) -> str:
        """The world at the begin as the text of a semantic map (OWL in RDF/XML).

        Raises:
            EpisodeFileError: it is lost.
        """
        return self._attachment("map-begin.owl.zst", "the map at the begin").decode()

    @property
    def map_at_end(self) -> str:
        """The same at the end.

        Raises:
            EpisodeFileError: it is lost, for example since the recording was interrupted.
        """
        return self._attachment("map-end.owl.zst", "the map at the end").decode()

    def _attachment(self, name: str, what: str) -> bytes:
        with self._lock:
            self._check_open()
            content = self._file.attachment(name)
        if content is None:
            raise EpisodeFileError(str(self.path), cause=f"{what} is not in the file")
        return content

    # -- edits and events ----------------------------------------------------------------------------------------------

    def edits(self) -> tuple[EpisodeEdit, ...]:
        """All edits and requests, in the order of time."""
        with self._lock:
            return tuple(edit for chunk in self._readable(EpisodeTopic.EDITS) for edit in chunk.edits)

    def faults(self) -> tuple[str, ...]:
        """What is derived from the recording and could not be made, such as events at some time, and why."""
        return tuple(f"{edit.details['part']}: {edit.details['cause']}" for edit in self._faults())

    def _faults(self) -> Iterator[EpisodeEdit]:
        return (edit for edit in self.edits() if edit.kind == FAULT_EDIT)

    def events(self) -> tuple[EpisodeEvent, ...]:
        """All events, in the order of their begin; those of a recording without events are detected now, once.

        Those of an interrupted recording are provisional.
        """
        with self._events_lock:  # states can be read while events are detected
            return self._events

    @cached_property
    def _events(self) -> tuple[EpisodeEvent, ...]:
        if not self.header.has_events:
            return detect_events(self)
        with self._lock:
            found = {event.id: event for chunk in self._readable(EpisodeTopic.EVENTS) for event in chunk.events}
            final = self._final_events()
        if final is None and any(edit.details["part"] == "events" for edit in self._faults()):
            return detect_events(self)  # the recording went on without their detection
        if final is not None:
            stated = {id: event for id, event in found.items() if event.state is EventState.FINAL}
            found = stated | {event.id: event for event in final}
        events = (event for event in found.values() if event.state is not EventState.WITHDRAWN)
        return tuple(sorted(events, key=lambda event: event.begin_s))

    def _final_events(self) -> tuple[EpisodeEvent, ...] | None:
        """The events of the whole recording; None if it was interrupted, or they are lost."""
        try:
            content = self._file.attachment(FINAL_EVENTS)
            return None if content is None else msgspec.json.decode(content, type=tuple[EpisodeEvent, ...])
        except (EpisodeFileError, msgspec.MsgspecError) as error:
            _log.warning("%s: the final events are lost: %s", self.path, error)
            return None

    def _readable(self, topic: EpisodeTopic) -> Iterator[_ReadChunk]:
        for chunk in tuple(self._file.with_topic(topic)):
            try:
                yield self._read(chunk.number)
            except EpisodeFileError:  # listed by `losses`
                continue

    # -- chunks --------------------------------------------------------------------------------------------------------

    def _read(self, number: int) -> _ReadChunk:
        """The content of a chunk; the last ones are kept.

        Raises:
            EpisodeFileError: it is damaged, or what it is relative to.
        """
        self._check_open()
        if number in self._chunks:
            self._chunks.move_to_end(number)
            return self._chunks[number]
        head, messages = self._file.read(number)
        try:
            read = self._decode(head, messages)
        except (ValueError, msgspec.MsgspecError) as error:
            raise EpisodeFileError(str(self.path), cause=f"chunk {number}: {error}") from error
        self._chunks[number] = read
        if len(self._chunks) > _KEPT_CHUNKS:
            self._chunks.popitem(last=False)
        return read

    def _check_open(self) -> None:
        if self._closed:
            raise EpisodeFileError(str(self.path), cause="it was closed", remedy="open it again")

    def _decode(self, head: ChunkHead, messages: list[StoredMessage]) -> _ReadChunk:
        state = self._state_before(head, messages)
        structures = {state.structure.number: state.structure}
        frames: list[EpisodeFrame] = []
        edits: list[EpisodeEdit] = []
        events: list[EpisodeEvent] = []
        for message in messages[head.repeated :]:
            match message.topic:
                case EpisodeTopic.CLOCK:
                    if not np.isfinite(state.poses).all():
                        raise ValueError("a body has no pose")
                    frames.append(
                        state.frame(
                            message.time_ns,
                            has_joints=self.header.has_joints,
                            has_contacts=self.header.has_contacts,
                        )
                    )
                case EpisodeTopic.EDITS:
                    edits.append(EpisodeDecoder.edit(message.data))
                case EpisodeTopic.EVENTS:
                    events.append(EpisodeDecoder.event(message.data))
                case topic:
                    state.apply(topic, message.data)
                    if topic is EpisodeTopic.WORLD:
                        structures[state.structure.number] = self._kept(state.structure)
                        state.structure = structures[state.structure.number]
        times = tuple(frame.time_s for frame in frames)
        if any(before > after for before, after in pairwise(times)):
            raise ValueError("its times decrease")
        return _ReadChunk(tuple(frames), times, tuple(edits), tuple(events), structures)

    def _kept(self, structure: WorldStructure) -> WorldStructure:
        """The one object for a structure."""
        return self._structures.setdefault(structure.number, structure)

    def _state_before(self, head: ChunkHead, messages: list[StoredMessage]) -> EpisodeState:
        """The state at the begin of a chunk."""
        repeated = messages[: head.repeated]
        structure = self._structure(head, repeated)
        if head.base == head.number:
            state = EpisodeState(structure)
        else:
            state = self._base(head.base).copy()
            state.use(structure)
        for message in repeated:
            if message.topic is not EpisodeTopic.WORLD:
                state.apply(message.topic, message.data)
        return state

    def _base(self, number: int) -> EpisodeState:
        """The state that chunks are relative to, from the chunk with that number or the one after it."""
        if number not in self._bases:
            try:
                head, messages = self._file.read(number)
            except EpisodeFileError:
                head, messages = self._file.read(number + 1)
            if head.base != head.number:
                raise ValueError(f"chunk {head.number} is no base")
            self._bases[number] = self._state_before(head, messages)
            if len(self._bases) > _KEPT_BASES:
                self._bases.popitem(last=False)
        return self._bases[number]

    def _structure(self, head: ChunkHead, repeated: list[StoredMessage]) -> WorldStructure:
        """The structure at the begin of a chunk, from it and as many chunks before it as are needed."""
        records: dict[int, WorldRecord] = {}
        earlier = iter(
            [each.number for each in reversed(tuple(self._file.with_topic(EpisodeTopic.WORLD)))]
            if head.structure not in self._structures
            else ()
        )
        messages: Iterable[StoredMessage] = repeated
        while True:
            for message in messages:
                if message.topic is EpisodeTopic.WORLD:
                    record = EpisodeDecoder.world(message.data)
                    if record.complete or record.number not in records:
                        records[record.number] = record
            structure = _folded(records, head.structure, self._structures)
            if structure is not None:
                if structure.digest != head.digest:
                    raise ValueError(f"world {head.structure} is another one than that of the chunk")
                return self._kept(structure)
            number = next((number for number in earlier if number < head.number), None)
            if number is None:
                raise ValueError(f"world {head.structure}, or a change before it, is lost")
            try:
                _, messages = self._file.read(number)
            except EpisodeFileError:  # what is in it is in another one, too
                messages = ()

    def __iter__(self) -> Iterator[EpisodeFrame]:
        return self.frames()


def parts_of_spawned(present: World, spawned: Iterable[World]) -> Iterator[World]:
    """The spawned worlds with those of their bodies and joints that exist, and what none of them describes."""
    worlds = (*spawned, replace(present, attachments=()))
    exists = {body.id for body in present.bodies}
    joints = {joint.id for joint in present.joints}
    last = {body.id: number for number, world in enumerate(worlds[:-1]) for body in world.bodies}
    known: set[BodyId] = set()
    for number, world in enumerate(worlds):
        bodies = tuple(
            body for body in world.bodies if body.id in exists and last.get(body.id, len(worlds) - 1) == number
        )
        known |= {body.id for body in bodies}
        connected = tuple(
            each for each in world.joints if each.id in joints and each.parent in known and each.child in known
        )
        joints -= {each.id for each in connected}
        attachments = tuple(each for each in world.attachments if each.parent in known and each.child in known)
        if bodies or connected or number == 0:
            yield replace(world, bodies=bodies, joints=connected, attachments=attachments)


def _folded(
    records: Mapping[int, WorldRecord], number: int, known: Mapping[int, WorldStructure]
) -> WorldStructure | None:
    """The structure with a number that results from records; None if one of them is missing.

    Raises:
        ValueError: they do not fit together.
    """
    first = number
    while first not in known and not (first in records and records[first].complete):
        if first not in records:
            return None
        first -= 1
    structure = known[first] if first in known else WorldStructure.from_record(records[first])
    for each in range(first + 1, number + 1):
        structure = structure.after(records[each])
    return structure
