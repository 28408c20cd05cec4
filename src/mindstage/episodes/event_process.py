"""Detection of events beside a recording, in a process of its own with a lower priority.

It gets the messages that are written to the file, through a pipe, and returns events while the recording goes on. The
recording never waits for it: what does not fit into the pipe is kept, and if that is too much, or the process ends, its
events are detected when the file is read. The process ends with the one that started it, also if that one is killed.
"""

from __future__ import annotations

import atexit
import logging
import os
import select
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from mindstage.episodes.detection import EventDetector
from mindstage.episodes.geometry_file import decode_geometry
from mindstage.episodes.messages import EpisodeTopic
from mindstage.episodes.recording import EpisodeEvent
from mindstage.episodes.structure import EpisodeState
from mindstage.scene import BodyGeometry, BodyId

__all__ = ["DetectionFaultReply", "EventProcess", "EventsReply", "FinalReply", "end_idle", "serve"]

_CODE = "from mindstage.episodes.event_process import serve; serve()"
_NICE = 10
"""How much lower the priority of the process is."""
_PARENT_POLL_S = 1.0
"""Interval at which the process looks whether the one that started it has ended [s]."""
_IDLE_S = 20.0
"""Time for which a process without a recording is kept for the next one [s]."""
_MAX_UNSENT_BYTES = 1 << 28
"""Memory for frames that wait; about an hour with 10 moving bodies."""
_PIPE_BYTES = 1 << 20
_MAX_READ_BYTES = 1 << 16
_MAX_MESSAGE_BYTES = 1 << 30
_MAX_RESTING_FRAMES = 30
"""Frames without any change that are searched for events, at the begin and at the end of each rest."""
_log = logging.getLogger("mindstage.episodes")

_TOPICS = tuple(EpisodeTopic)
_NUMBERS = {topic: number for number, topic in enumerate(_TOPICS)}


class _Begin(msgspec.Struct, tag=0, array_like=True):
    """A recording begins."""

    has_joints: bool
    has_contacts: bool


class _Frame(msgspec.Struct, tag=1, array_like=True):
    """What has changed since the frame before; at first the state of all bodies."""

    time_ns: int
    messages: list[tuple[int, bytes]]
    """The number of the topic, and the data."""


class _Geometry(msgspec.Struct, tag=2, array_like=True):
    data: bytes
    """As `encode_geometry`."""


class _Finish(msgspec.Struct, tag=3, array_like=True):
    """The recording has ended."""


class EventsReply(msgspec.Struct, tag=0, array_like=True):
    """Frames are done."""

    frames: int
    """The number of frames that are done so far."""
    events: tuple[EpisodeEvent, ...]
    """Those that were found to have begun or ended, each as it is now."""


class DetectionFaultReply(msgspec.Struct, tag=1, array_like=True):
    """Events could not be detected in some frames, or not from some time on."""

    cause: str
    has_ended: bool = False
    """Whether no more are detected."""


class FinalReply(msgspec.Struct, tag=2, array_like=True):
    """The recording is done."""

    events: bytes
    """All events as JSON."""


_Request = _Begin | _Frame | _Geometry | _Finish
_Reply = EventsReply | DetectionFaultReply | FinalReply
_ENCODER = msgspec.msgpack.Encoder()


def _framed(message: _Request | _Reply) -> bytes:
    data = _ENCODER.encode(message)
    return len(data).to_bytes(4, "little") + data


class _Inbox:
    """Divides a stream of bytes into messages."""

    def __init__(self, type: Any) -> None:
        self._decoder = msgspec.msgpack.Decoder(type)
        self._data = bytearray()

    def add(self, data: bytes) -> Iterator[Any]:
        """Takes bytes; yields the messages that are complete.

        Raises:
            ValueError: they are none.
            MsgspecError: they are none.
        """
        self._data += data
        at = 0
        while len(self._data) - at >= 4:
            size = int.from_bytes(self._data[at : at + 4], "little")
            if size > _MAX_MESSAGE_BYTES:
                raise ValueError(f"a message of {size:,} bytes")
            end = at + 4 + size
            if end > len(self._data):
                break
            yield self._decoder.decode(bytes(self._data[at + 4 : end]))
            at = end
        del self._data[:at]


# -- in the process that records ---------------------------------------------------------------------------------------


class _Interpreter:
    """A process that detects the events of one recording after the other."""

    def __init__(self) -> None:
        """Starts it.

        Raises:
            OSError: it does not start.
        """
        self.owner = os.getpid()
        package_folder = str(Path(__file__).resolve().parents[2])
        search_path = os.pathsep.join(filter(None, (package_folder, os.environ.get("PYTHONPATH", ""))))
        self.output, theirs = os.pipe()  # not its standard output, to which others may print
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-c", _CODE, str(self.owner), str(theirs)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                bufsize=0,
                pass_fds=(theirs,),
                env={**os.environ, "PYTHONPATH": search_path, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
                start_new_session=True,  # Ctrl-C is handled by this process
            )
        except BaseException:
            os.close(self.output)
            raise
        finally:
            os.close(theirs)
        assert self.process.stdin is not None
        self.input = self.process.stdin.fileno()
        for fd in (self.input, self.output):
            os.set_blocking(fd, False)
        if sys.platform == "linux":
            import fcntl

            with suppress(OSError):  # more than the user may have
                fcntl.fcntl(self.input, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)

    def kill(self) -> None:
        """Ends it."""
        self.process.kill()
        os.close(self.output)
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()

    @classmethod
    def take(cls) -> _Interpreter:
        """One without a recording, or a new one."""
        with _lock:
            while _idle:
                known, timer = _idle.pop()
                timer.cancel()
                if known.owner != os.getpid():  # this process is a fork of its owner
                    continue
                if known.process.poll() is None:
                    return known
                known.kill()
        return cls()

    def give_back(self) -> None:
        """Keeps it for the next recording, for some time."""
        timer = threading.Timer(_IDLE_S, self._expire)
        timer.daemon = True
        with _lock:
            if _idle:
                self.kill()
                return
            _idle.append((self, timer))
        timer.start()

    def _expire(self) -> None:
        with _lock:
            found = [each for each in _idle if each[0] is self]
            _idle[:] = [each for each in _idle if each[0] is not self]
        if found:
            self.kill()


_idle: list[tuple[_Interpreter, threading.Timer]] = []
_lock = threading.Lock()


@atexit.register
def end_idle() -> None:
    """Ends the process that waits for the next recording, if there is one."""
    while _idle:
        interpreter, _ = _idle.pop()
        if interpreter.owner == os.getpid():
            interpreter.kill()


os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)


class EventProcess:
    """The detection of the events of one recording; used by one thread. Only `exchange` waits for replies."""

    def __init__(self, *, has_joints: bool, has_contacts: bool) -> None:
        """Starts the process.

        Args:
            has_joints: whether frames have the positions of joints.
            has_contacts: whether they have contacts.
        """
        self.frames = 0
        """The number of frames that are done."""
        self.final_events: bytes | None = None
        """All events as JSON, when the process has ended regularly."""
        self._sent: deque[float] = deque()
        """When the frames were added that are not done yet, by the clock `time.monotonic` [s]."""
        self._unsent: deque[bytes] = deque()
        self._unsent_bytes = 0
        self._offset = 0
        """How much of the first of them was written."""
        self._replied_s = 0.0
        self._inbox = _Inbox(_Reply)
        self._replies: list[_Reply] = []
        self._resting_frames = 0
        self._skipped: deque[_Frame] = deque(maxlen=_MAX_RESTING_FRAMES)
        self._interpreter: _Interpreter | None = None
        try:
            self._interpreter = _Interpreter.take()
        except Exception as error:  # states are recorded all the same
            self._fail(f"the process that detects them does not start: {error}")
        self._send(_Begin(has_joints, has_contacts))

    @property
    def has_ended(self) -> bool:
        """Whether nothing follows but the replies that were not taken."""
        return self._interpreter is None

    @property
    def waiting_frames(self) -> int:
        """The number of frames that are not done yet."""
        return len(self._sent)

    @property
    def delay_s(self) -> float:
        """For how long the oldest frame that is not done has been waiting [s]."""
        try:
            return time.monotonic() - self._sent[0]
        except IndexError:  # also if it was done just now
            return 0.0

    @property
    def silent_s(self) -> float:
        """For how long nothing was replied although a frame is waiting [s]."""
        try:
            return time.monotonic() - max(self._sent[0], self._replied_s)
        except IndexError:
            return 0.0

    def add_frame(self, time_ns: int, messages: Sequence[tuple[EpisodeTopic, bytes]]) -> None:
        """Takes the messages of a frame; the middle of long rests is left out."""
        if self.has_ended:
            return
        frame = _Frame(time_ns, [(_NUMBERS[topic], data) for topic, data in messages])
        self._resting_frames = 0 if messages else self._resting_frames + 1
        if self._resting_frames > _MAX_RESTING_FRAMES:
            self._skipped.append(frame)
            return
        self._add_skipped()
        self._add(frame)

    def _add_skipped(self) -> None:
        while self._skipped:
            self._add(self._skipped.popleft())

    def _add(self, frame: _Frame) -> None:
        if not self.has_ended:
            self._sent.append(time.monotonic())
            self._send(frame)

    def add_geometry(self, data: bytes) -> None:
        """Takes geometry of bodies, as `encode_geometry`, with their collision shapes."""
        self._send(_Geometry(data))

    def finish(self) -> None:
        """No frame follows."""
        self._add_skipped()
        self._send(_Finish())

    def _send(self, request: _Request) -> None:
        if self.has_ended:
            return
        data = _framed(request)
        self._unsent.append(data)
        self._unsent_bytes += len(data)
        if self._unsent_bytes > _MAX_UNSENT_BYTES:
            self._fail(f"their detection is {self.delay_s:.0f} s behind, and too much waits for it")

    def exchange(self, timeout_s: float = 0.0) -> list[_Reply]:
        """Writes what there is to be written, and returns what was replied.

        Args:
            timeout_s: how long it waits until something can be written or read [s].
        """
        if self._interpreter is not None:
            fd, to = self._interpreter.output, self._interpreter.input
            readable, writable, _ = select.select([fd], [to] if self._unsent else [], [], timeout_s)
            try:
                if writable:
                    self._write(to)
                if readable:
                    self._read(fd)
            except (OSError, ValueError, msgspec.MsgspecError) as error:
                self._fail(f"the process that detects them has failed: {error}")
        replies, self._replies = self._replies, []
        return replies

    def _write(self, fd: int) -> None:
        with suppress(BlockingIOError):
            while self._unsent:
                data = memoryview(self._unsent[0])[self._offset :]
                written = os.write(fd, data)
                self._unsent_bytes -= written
                self._offset += written
                if written == len(data):
                    self._unsent.popleft()
                    self._offset = 0

    def _read(self, fd: int) -> None:
        data = os.read(fd, _MAX_READ_BYTES)
        if not data:
            assert self._interpreter is not None
            self._fail(f"the process that detects them has ended, with the status {self._interpreter.process.wait()}")
        self._replied_s = time.monotonic()
        for reply in self._inbox.add(data):
            self._replies.append(reply)
            match reply:
                case EventsReply():
                    while self.frames < reply.frames:
                        self._sent.popleft()
                        self.frames += 1
                case DetectionFaultReply(has_ended=True):
                    self.kill()
                    break
                case FinalReply():
                    self.final_events = reply.events
                    if self._interpreter is not None:
                        self._interpreter.give_back()
                        self._interpreter = None

    def _fail(self, cause: str) -> None:
        self.kill()
        self._replies.append(DetectionFaultReply(f"{cause}; they are detected when the file is read", has_ended=True))

    def kill(self) -> None:
        """Ends the process, if it has not ended."""
        interpreter, self._interpreter = self._interpreter, None
        if interpreter is not None:
            interpreter.kill()
        self._sent.clear()
        self._unsent.clear()


# -- in the process that detects ---------------------------------------------------------------------------------------


def serve() -> None:
    """Detects the events of one recording after the other, until the process that started this one ends."""
    parent, output = map(int, sys.argv[1:])
    with suppress(OSError):
        os.nice(_NICE)
    inbox = _Inbox(_Request)
    detection: _Detection | None = None
    while True:
        if not select.select([0], [], [], _PARENT_POLL_S)[0]:
            if os.getppid() != parent:  # a fork of it can hold the pipe open
                return
            continue
        data = os.read(0, _MAX_READ_BYTES)
        if not data:
            return
        replies: list[_Reply] = []
        for request in inbox.add(data):
            if isinstance(request, _Begin):
                detection = _Detection(request)
            elif detection is not None:
                replies += detection.take(request)
                if detection.has_ended:
                    detection = None
        for reply in _joined(replies):
            message = memoryview(_framed(reply))
            while message:
                message = message[os.write(output, message) :]


def _joined(replies: Sequence[_Reply]) -> Iterator[_Reply]:
    """Replies to frames that follow one another as one."""
    last: EventsReply | None = None
    for reply in replies:
        if last is not None and isinstance(reply, EventsReply):
            last = EventsReply(reply.frames, last.events + reply.events)
            continue
        if last is not None:
            yield last
        last = reply if isinstance(reply, EventsReply) else None
        if last is None:
            yield reply
    if last is not None:
        yield last


class _Detection:
    """The detection of the events of a recording."""

    def __init__(self, begin: _Begin) -> None:
        self._begin = begin
        self._state = EpisodeState()
        self._geometry: dict[BodyId, BodyGeometry] = {}
        self._detector = EventDetector(geometry=self._geometry)
        self._frames = self._faults = 0
        self.has_ended = False

    def take(self, request: _Frame | _Geometry | _Finish) -> Iterator[_Reply]:
        """Takes what comes from the recording."""
        try:
            match request:
                case _Frame():
                    for number, data in request.messages:
                        self._state.apply(_TOPICS[number], data)
                    frame = self._state.frame(
                        request.time_ns, has_joints=self._begin.has_joints, has_contacts=self._begin.has_contacts
                    )
                    events = self._detector.update(frame)
                    self._frames += 1
                    yield EventsReply(self._frames, events)
                case _Geometry():
                    known = {each.key: each for each in self._geometry.values()}
                    self._geometry.update(decode_geometry(request.data, known=known))
                case _Finish():
                    yield EventsReply(self._frames, self._detector.finish())
        except Exception as error:
            _log.exception("the detection of events ended")
            yield DetectionFaultReply(f"the detection ended: {type(error).__name__}: {error}", has_ended=True)
            self.has_ended = True
            return
        for fault in self._detector.faults[self._faults :]:
            yield DetectionFaultReply(f"the detection failed at {fault.begin_s:g} s: {fault.cause}")
        self._faults = len(self._detector.faults)
        if isinstance(request, _Finish):
            yield FinalReply(msgspec.json.encode(self._detector.events))
