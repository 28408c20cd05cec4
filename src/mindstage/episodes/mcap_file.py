"""Episode files: MCAP with ROS 2 messages, written such that an interrupted or damaged file stays readable.

A file consists of chunks, which are compressed and have checksums. The first message of a chunk is its head: the
episode, the number of the chunk, and the chunk that its state is relative to. A file with an end is read by its index;
one without, or with damage, is searched for chunks whose checksum is right, wherever they are.
"""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from contextlib import suppress
from hashlib import blake2b
from io import BytesIO
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

import msgspec

from mindstage.episodes.messages import ChunkHead, EpisodeDecoder, EpisodeEncoder, EpisodeTopic, schema_text
from mindstage.errors import EpisodeError, EpisodeFileError

try:
    import zstandard
    from mcap.data_stream import ReadDataStream
    from mcap.opcode import Opcode
    from mcap.records import Attachment, AttachmentIndex, Channel, Chunk, ChunkIndex, Footer
    from mcap.writer import MCAP0_MAGIC, CompressionType, Writer
except ModuleNotFoundError as error:
    raise EpisodeError(f"{error.name} is not installed; install it with `pip install 'mindstage[episodes]'`") from error

__all__ = [
    "CONTENTS_FOLDER",
    "FORMAT_VERSION",
    "EpisodeFile",
    "EpisodeFileWriter",
    "EpisodeLoss",
    "FileChunk",
    "StoredMessage",
    "repair",
]

FORMAT_VERSION = 3
"""Version of episode files; those of another one are refused."""
_MAX_CHUNK_BYTES = 1 << 28
"""Largest decompressed size of a chunk, and of an attachment."""
_CHUNK_MARK = b"\x04\0\0\0zstd"
"""The name of the compression in a chunk record."""
_MARK_OFFSET = 9 + 8 + 8 + 8 + 4
"""The position of that name in the record: after opcode, length, two times, size and checksum."""
_FOOTER_BYTES = 9 + 20
_LOSSES = "losses.json"
_CONTENTS = "contents.json"
CONTENTS_FOLDER = "contents"
"""The folder beside episodes with what they have in common, by digest."""
_ELSEWHERE = ".digest"
"""The suffix of an attachment with the digest of one that is in that folder."""
_MAX_COPIED_BYTES = 1 << 18
_PARSE_ERRORS = (ValueError, EOFError, OverflowError, struct.error)
"""What the library raises for records that are not valid."""
_REMEDY = "`mindstage episode repair` writes a file of what is readable"


class EpisodeLoss(msgspec.Struct, frozen=True, kw_only=True):
    """A part of a recording that cannot be read."""

    begin_s: float | None
    """Time of the last readable frame before it [s]; None if it is not a part of the frames, or is at their begin."""
    end_s: float | None
    """Time of the first readable state after it [s]; None if there is none."""
    cause: str


class _Contents(msgspec.Struct, frozen=True):
    """The last attachment, which says what a whole file has."""

    chunks: int
    attachments: dict[str, str]
    """The digest of each."""


class StoredMessage(NamedTuple):
    """A message of a chunk."""

    topic: EpisodeTopic | None
    """None for a topic that is not of this program."""
    time_ns: int
    data: bytes


class FileChunk(NamedTuple):
    """A chunk of a file."""

    number: int
    offset: int
    end: int
    """Its record is between these positions in the file."""
    begin_ns: int
    end_ns: int
    """Times of its first and last message."""
    topics: frozenset[EpisodeTopic]


class _DamageError(Exception):
    """A record is not what its checksum or the index says."""


# -- writing -----------------------------------------------------------------------------------------------------------


class EpisodeFileWriter:
    """Writes an episode file. What was written before `end_chunk` survives the end of the process."""

    def __init__(self, path: Path, *, is_self_contained: bool = True) -> None:
        """Creates the file.

        Args:
            path: where it is written.
            is_self_contained: whether large attachments are in the file; otherwise they are files of the folder
                `contents` beside it, named by their digests, so that episodes have them in common.

        Raises:
            EpisodeFileError: it exists, or cannot be created.
        """
        self.path = path
        self._folder = None if is_self_contained else path.parent / CONTENTS_FOLDER
        try:
            self._stream = path.open("xb")
        except FileExistsError as error:
            raise EpisodeFileError(str(path), cause="it exists", remedy="delete it, or choose another name") from error
        except OSError as error:
            raise EpisodeFileError(str(path), cause=error.strerror or str(error)) from error
        self._writer = Writer(self._stream, chunk_size=_MAX_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="mindstage")
        schemas = {
            type: self._writer.register_schema(type, "ros2msg", schema_text(type).encode())
            for type in dict.fromkeys(topic.type for topic in EpisodeTopic)
        }
        self._channels = {topic: self._channel(topic, schemas[topic.type]) for topic in EpisodeTopic}
        self._chunks = 0
        self._attached: dict[str, tuple[str, bytes]] = {}
        """The media type and the content of the last attachment of each name; no content if it is large."""
        self._digests: dict[str, str] = {}

    def _channel(self, topic: EpisodeTopic, schema: int) -> int:
        is_latched = topic in {EpisodeTopic.TF_STATIC, EpisodeTopic.MARKERS}
        durability = 1 if is_latched else 2
        qos = (
            f"- history: 1\n  depth: 10\n  reliability: 1\n  durability: {durability}\n"
            "  deadline:\n    sec: 9223372036\n    nsec: 854775807\n"
            "  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n  liveliness: 1\n"
            "  liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n"
            "  avoid_ros_namespace_conventions: false\n"
        )
        return self._writer.register_channel(topic.value[0], "cdr", schema, {"offered_qos_profiles": qos})

    def add(self, topic: EpisodeTopic, time_ns: int, data: bytes) -> None:
        """Adds a message to the chunk in progress."""
        self._writer.add_message(self._channels[topic], time_ns, data, time_ns)

    def add_attachment(self, name: str, media_type: str, data: bytes, *, time_ns: int = 0) -> None:
        """Adds an attachment; it is compressed if its name ends with ".zst".

        Of several with the same name the last one counts. Those of up to a quarter of a megabyte are written again at
        the end of the file.

        Raises:
            OSError: the disk is full, for example.
        """
        content = zstandard.compress(data, 10) if name.endswith(".zst") else data
        self._digests[name] = _digest(content)
        if self._folder is not None and len(content) > _MAX_COPIED_BYTES:
            _store(self._folder, self._digests[name], content)
            self.add_attachment(f"{name}{_ELSEWHERE}", "text/plain", self._digests.pop(name).encode(), time_ns=time_ns)
            return
        self._attached[name] = (media_type, content if len(content) <= _MAX_COPIED_BYTES else b"")
        self._writer.add_attachment(time_ns, time_ns, name, media_type, content)
        self._stream.flush()

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Adds metadata, which other programs show; it has no checksum, so nothing is read from it here."""
        self._writer.add_metadata(name, dict(values))

    def end_chunk(self) -> None:
        """Writes the chunk in progress, if it has a message, to the disk.

        Raises:
            OSError: the disk is full, for example.
        """
        self._chunks += 1
        self._writer.flush()  # type: ignore[no-untyped-call]
        os.fdatasync(self._stream.fileno())

    def close(self) -> None:
        """Writes the index and closes the file; may be called repeatedly.

        Raises:
            OSError: the disk is full, for example.
        """
        if self._stream.closed:
            return
        try:
            contents = msgspec.json.encode(_Contents(self._chunks, self._digests))
            self._attached[_CONTENTS] = ("application/json", contents)
            for name, (media_type, content) in (*self._attached.items(), (_CONTENTS, self._attached[_CONTENTS])):
                if content:
                    self._writer.add_attachment(0, 0, name, media_type, content)
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._stream.flush()
            os.fsync(self._stream.fileno())
        finally:
            self._stream.close()


# -- reading -----------------------------------------------------------------------------------------------------------


class EpisodeFile:
    """An open episode file."""

    def __init__(self, path: Path) -> None:
        """Opens a file.

        Raises:
            EpisodeFileError: it does not exist, is no MCAP file, was not written by this program, or nothing in it is
                readable.
        """
        self.path = path
        try:
            with path.open("rb") as stream:
                if not os.fstat(stream.fileno()).st_size:
                    raise EpisodeFileError(str(path), cause="it is empty")
                self._data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise EpisodeFileError(str(path), cause=error.strerror or str(error)) from error
        self._channels: dict[int, EpisodeTopic] = {}
        self._episode: str | None = None
        self._attachments: dict[str, list[tuple[int, int]]] = {}
        """The positions of the records, by name; the last one counts, and the others are for the case of damage."""
        self._first_frames: dict[int, int] = {}
        """The time of the first frame of each chunk, when the file was searched [ns]."""
        self._contents: _Contents | None = None
        self._damage: list[EpisodeLoss] = []
        self.is_scanned = False
        """Whether the file was searched for readable chunks, since it has no end or is damaged."""
        try:
            try:
                self._chunks = self._read_index()
                self._contents = self._read_contents()
            except (_DamageError, *_PARSE_ERRORS) as error:
                self._cause = str(error)
                self._scan()
            self._read_first()
        except BaseException:
            self.close()
            raise

    def _read_first(self) -> None:
        """Checks that the file is an episode and is not empty."""
        if not self._chunks and not self.is_scanned:
            cause = "it is no episode: it has none of Mindstage's topics"
            raise EpisodeFileError(str(self.path), cause=cause, remedy="other recordings are read with `read_bag`")
        if self._chunks and self._episode is None:
            with suppress(EpisodeFileError):  # then the file was searched, and others were found or none
                self.read(self._chunks[0].number)
        if not self._chunks:
            is_mcap = self._data[:8] == MCAP0_MAGIC
            cause = f"nothing in it is readable: {self._cause}" if is_mcap else "it is not an MCAP file"
            raise EpisodeFileError(str(self.path), cause=cause)

    def close(self) -> None:
        """Closes the file; may be called repeatedly."""
        self._data.close()

    @property
    def size_bytes(self) -> int:
        """The size of the file."""
        return len(self._data)

    @property
    def chunks(self) -> tuple[FileChunk, ...]:
        """The readable chunks, as far as that was checked, in the order of their numbers."""
        return self._chunks

    def with_topic(self, topic: EpisodeTopic) -> Iterator[FileChunk]:
        """Yields the chunks with messages on a topic."""
        return (chunk for chunk in self._chunks if topic in chunk.topics)

    def chunk_at(self, time_ns: int) -> FileChunk:
        """The last chunk that begins at or before a time, or the first one."""
        row = bisect_right(self._chunks, time_ns, key=lambda chunk: chunk.begin_ns)
        return self._chunks[max(0, row - 1)]

    def chunk(self, number: int) -> FileChunk | None:
        """The chunk with a number; None if it is lost or there is none."""
        row = bisect_right(self._chunks, number, key=lambda chunk: chunk.number) - 1
        return self._chunks[row] if row >= 0 and self._chunks[row].number == number else None

    def read(self, number: int) -> tuple[ChunkHead, list[StoredMessage]]:
        """The head of a chunk, and its other messages.

        Raises:
            EpisodeFileError: it is lost.
        """
        for _ in range(2):
            if (chunk := self.chunk(number)) is None:
                break
            try:
                head, messages = self._read_chunk(chunk.offset, chunk.end)
                if head.number != number or self._episode not in {None, head.episode}:
                    raise _DamageError(f"chunk {head.number} of {head.episode} is in the place of chunk {number}")
                self._episode = head.episode
            except _DamageError as error:
                self._cause = str(error)
                self._scan()
            else:
                return head, messages
        raise EpisodeFileError(str(self.path), cause=f"chunk {number} is damaged", remedy=_REMEDY)

    def attachment(self, name: str) -> bytes | None:
        """The content of an attachment, decompressed; None if there is none of that name.

        Raises:
            EpisodeFileError: it is damaged.
        """
        if f"{name}{_ELSEWHERE}" in self._attachments:
            return self._stored(name, (self.attachment(f"{name}{_ELSEWHERE}") or b"").decode())
        cause = "it is lost"
        digest = None if self._contents is None else self._contents.attachments.get(name)
        for offset, end in reversed(self._attachments.get(name, ())):
            try:
                content = self._read_attachment(offset, end).data
                if digest is None or _digest(content) == digest:  # another one was replaced
                    return _decompressed(content) if name.endswith(".zst") else content
            except _DamageError as error:
                cause = str(error)
        if name in self._attachments or digest is not None:
            raise EpisodeFileError(str(self.path), cause=f"{name}: {cause}")
        return None

    def reference(self, name: str) -> bytes | None:
        """The digest of an attachment that is in the folder beside the file; None if it is not there."""
        found = f"{name}{_ELSEWHERE}"
        return self.attachment(found) if found in self._attachments else None

    def _stored(self, name: str, digest: str) -> bytes:
        """An attachment that is in the folder beside the file."""
        path = self.path.parent / CONTENTS_FOLDER / digest
        try:
            content = path.read_bytes()
            if _digest(content) != digest:
                raise EpisodeFileError(str(self.path), cause=f"{name}: {path} is damaged")
            return _decompressed(content) if name.endswith(".zst") else content
        except OSError as error:
            remedy = f"copy the folder {CONTENTS_FOLDER!r} along with the episode"
            cause = f"{name} is in {path}: {error.strerror or error}"
            raise EpisodeFileError(str(self.path), cause=cause, remedy=remedy) from error

    def attachment_names(self) -> tuple[str, ...]:
        """The names of the attachments, in the order of the file."""
        return tuple(name.removesuffix(_ELSEWHERE) for name in self._attachments if name != _CONTENTS)

    def losses(self) -> tuple[EpisodeLoss, ...]:
        """What cannot be read. The whole file is checked."""
        if not self.is_scanned:
            try:
                for chunk in self._chunks:
                    head, _ = self._read_chunk(chunk.offset, chunk.end)
                    if (head.episode, head.number) != (self._episode, chunk.number):
                        raise _DamageError(f"chunk {head.number} is in the place of chunk {chunk.number}")
                for positions in self._attachments.values():
                    for position in positions:
                        self._read_attachment(*position)
            except _DamageError as error:
                self._cause = str(error)
                self._scan()
        return (*self.gaps, *self._missing())

    def _missing(self) -> Iterator[EpisodeLoss]:
        """What should be in the folder beside the file, and is not."""
        for name in self._attachments:
            if name.endswith(_ELSEWHERE):
                try:
                    self.attachment(name.removesuffix(_ELSEWHERE))
                except EpisodeFileError as error:
                    yield EpisodeLoss(begin_s=None, end_s=None, cause=error.cause)

    @property
    def gaps(self) -> tuple[EpisodeLoss, ...]:
        """What is known to be lost without a check: what a repair has noted, and what a search did not find."""
        earlier: tuple[EpisodeLoss, ...] = ()
        if _LOSSES in self._attachments:
            earlier = msgspec.json.decode(self.attachment(_LOSSES) or b"[]", type=tuple[EpisodeLoss, ...])
        return (*earlier, *self._damage)

    # -- records -------------------------------------------------------------------------------------------------------

    def _read_index(self) -> tuple[FileChunk, ...]:
        """Reads the index at the end of the file.

        Raises:
            _DamageError: there is none, or its checksum is wrong.
        """
        data, size = self._data, len(self._data)
        if data[:8] != MCAP0_MAGIC or data[-8:] != MCAP0_MAGIC or size < 16 + _FOOTER_BYTES:
            raise _DamageError("it has no end: the recording was interrupted, or the file was cut off")
        start = size - 8 - _FOOTER_BYTES
        if struct.unpack_from("<BQ", data, start) != (Opcode.FOOTER, 20):
            raise _DamageError("its end is damaged")
        footer = Footer.read(_stream(data[start + 9 : start + 29]))
        if not 0 < footer.summary_start <= start:
            raise _DamageError("it has no index")
        if zlib.crc32(data[footer.summary_start : start + 25]) != footer.summary_crc:
            raise _DamageError("the checksum of its index is wrong")
        indices: list[ChunkIndex] = []
        position = footer.summary_start
        while position < start:
            opcode, length = struct.unpack_from("<BQ", data, position)
            record = _stream(data[position + 9 : position + 9 + length])
            if opcode == Opcode.CHANNEL:
                self._add_channel(Channel.read(record))
            elif opcode == Opcode.CHUNK_INDEX:
                indices.append(ChunkIndex.read(record))
            elif opcode == Opcode.ATTACHMENT_INDEX:
                found = AttachmentIndex.read(record)
                self._attachments.setdefault(found.name, []).append((found.offset, found.offset + found.length))
            position += 9 + length
        if EpisodeTopic.CHUNKS not in self._channels.values():
            return ()
        return tuple(
            FileChunk(
                number,
                index.chunk_start_offset,
                index.chunk_start_offset + index.chunk_length,
                index.message_start_time,
                index.message_end_time,
                frozenset(self._channels[id] for id in index.message_index_offsets if id in self._channels),
            )
            for number, index in enumerate(indices)
        )

    def _add_channel(self, channel: Channel) -> None:
        topic = next((topic for topic in EpisodeTopic if topic.value[0] == channel.topic), None)
        if topic is not None and channel.message_encoding == "cdr":
            self._channels[channel.id] = topic

    def _read_chunk(self, offset: int, end: int) -> tuple[ChunkHead, list[StoredMessage]]:
        """Reads and checks a chunk.

        Raises:
            _DamageError: it is damaged.
        """
        content = self._chunk_content(offset, end)
        messages: list[StoredMessage] = []
        position, size = 0, len(content)
        while position + 9 <= size:
            opcode, length = struct.unpack_from("<BQ", content, position)
            start, position = position + 9, position + 9 + length
            if position > size:
                raise _DamageError("a message is longer than its chunk")
            if opcode == Opcode.MESSAGE:
                channel, _, time_ns, _ = struct.unpack_from("<HIQQ", content, start)
                messages.append(StoredMessage(self._channels.get(channel), time_ns, content[start + 22 : position]))
            elif opcode == Opcode.CHANNEL:
                self._add_channel(Channel.read(_stream(content[start:position])))
        if not messages or messages[0].topic is not EpisodeTopic.CHUNKS:
            raise _DamageError("a chunk has no head")
        try:
            return EpisodeDecoder.chunk(messages[0].data), messages[1:]
        except ValueError as error:
            raise _DamageError(str(error)) from error

    def _chunk_content(self, offset: int, end: int) -> bytes:
        if not 0 < offset < end <= len(self._data) or end - offset < _MARK_OFFSET:
            raise _DamageError("a chunk is cut off")
        if struct.unpack_from("<BQ", self._data, offset) != (Opcode.CHUNK, end - offset - 9):
            raise _DamageError("there is no chunk where the index says")
        try:
            chunk = Chunk.read(_stream(self._data[offset + 9 : end]))
        except _PARSE_ERRORS as error:
            raise _DamageError("a chunk is damaged") from error
        if chunk.compression != "zstd":
            raise _DamageError(f"a chunk has the unknown compression {chunk.compression!r}")
        content = _decompressed(chunk.data)
        if len(content) != chunk.uncompressed_size or zlib.crc32(content) != chunk.uncompressed_crc:
            raise _DamageError("the checksum of a chunk is wrong")
        return content

    def _read_attachment(self, offset: int, end: int) -> Attachment:
        """Reads and checks an attachment.

        Raises:
            _DamageError: it is damaged.
        """
        record = self._data[offset + 9 : end]
        try:
            if struct.unpack_from("<BQ", self._data, offset) != (Opcode.ATTACHMENT, end - offset - 9):
                raise _DamageError("there is no attachment where the index says")
            if zlib.crc32(record[:-4]) != struct.unpack("<I", record[-4:])[0]:
                raise _DamageError("the checksum of an attachment is wrong")
            attachment: Attachment = Attachment.read(_stream(record))
        except _PARSE_ERRORS as error:
            raise _DamageError("an attachment is damaged") from error
        return attachment

    def _read_contents(self) -> _Contents | None:
        """The list of contents; None if there is none that is readable."""
        for position in self._attachments.get(_CONTENTS, ()):
            try:
                return msgspec.json.decode(self._read_attachment(*position).data, type=_Contents)
            except (_DamageError, msgspec.MsgspecError):
                continue
        return None

    # -- damaged files -------------------------------------------------------------------------------------------------

    def _scan(self) -> None:
        """Searches the file for chunks and attachments whose checksums are right."""
        self.is_scanned = True
        self._damage, self._attachments = [], {}
        try:
            index: tuple[FileChunk, ...] | None = self._read_index()
        except (_DamageError, *_PARSE_ERRORS):
            index, self._attachments = None, {}
        self._channels = self._channels or dict(enumerate(EpisodeTopic, 1))  # as they are written
        found: dict[int, FileChunk] = {}
        others = 0
        position = self._data.find(_CHUNK_MARK)
        while position >= 0:
            offset = position - _MARK_OFFSET
            try:
                chunk, head = self._checked_chunk(offset)
            except _DamageError:
                pass
            else:
                self._episode = self._episode or head.episode
                others += head.episode != self._episode
                if head.episode == self._episode:
                    found.setdefault(head.number, chunk)
            position = self._data.find(_CHUNK_MARK, position + 1)
        self._chunks = tuple(found[number] for number in sorted(found))
        if index is None:
            self._scan_attachments()
        self._contents = self._read_contents()
        count = len(index) if index is not None else None if self._contents is None else self._contents.chunks
        self._report_damage(others, count)

    def _checked_chunk(self, offset: int) -> tuple[FileChunk, ChunkHead]:
        if offset < len(MCAP0_MAGIC):
            raise _DamageError("a chunk is cut off")
        (length,) = struct.unpack_from("<Q", self._data, offset + 1)
        end = offset + 9 + length
        head, messages = self._read_chunk(offset, end)
        times = [message.time_ns for message in messages]
        frames = [message.time_ns for message in messages[head.repeated :] if message.topic is EpisodeTopic.CLOCK]
        if frames:
            self._first_frames[head.number] = frames[0]
        topics = frozenset(message.topic for message in messages if message.topic is not None)
        first = min(times, default=0)
        return FileChunk(head.number, offset, end, first, max(times, default=first), topics), head

    def _scan_attachments(self) -> None:
        ends = {chunk.offset: chunk.end for chunk in self._chunks}
        offsets = sorted(ends)
        position, size = len(MCAP0_MAGIC), len(self._data)
        while position + 9 <= size:
            if position in ends:
                position = ends[position]
                continue
            opcode, length = struct.unpack_from("<BQ", self._data, position)
            end = position + 9 + length
            is_record = 0 < opcode <= Opcode.DATA_END and end <= size
            if is_record and opcode == Opcode.ATTACHMENT:
                try:
                    self._attachments.setdefault(self._read_attachment(position, end).name, []).append((position, end))
                except _DamageError:
                    is_record = False
            if is_record and opcode != Opcode.CHUNK:
                position = end
                continue
            row = bisect_right(offsets, position)
            if row == len(offsets):
                return
            position = offsets[row]

    def _report_damage(self, others: int, count: int | None) -> None:
        """Lists what is lost of a file.

        Args:
            others: the number of chunks of other episodes.
            count: the number of chunks that it had; None if it is unknown.
        """
        if not self._chunks:
            return
        before, readable = -1, None
        for chunk in self._chunks:
            if chunk.number > before + 1:
                begin = min((ns for number, ns in self._first_frames.items() if number >= chunk.number), default=None)
                end_s = None if begin is None else begin / 1e9
                self._damage.append(EpisodeLoss(begin_s=readable, end_s=end_s, cause=_lost(chunk.number - before - 1)))
            before, readable = chunk.number, chunk.end_ns / 1e9
        if others:
            cause = f"{others} chunks are of another episode"
            self._damage.append(EpisodeLoss(begin_s=None, end_s=None, cause=cause))
        if count is None:
            self._damage.append(EpisodeLoss(begin_s=readable, end_s=None, cause=self._cause))
        elif count > before + 1:
            self._damage.append(EpisodeLoss(begin_s=readable, end_s=None, cause=_lost(count - before - 1)))
        expected = self._attachments if self._contents is None else self._contents.attachments
        for name in expected:
            try:
                self.attachment(name)
            except EpisodeFileError as error:
                self._damage.append(EpisodeLoss(begin_s=None, end_s=None, cause=error.cause))


def _lost(count: int) -> str:
    return "a chunk is lost" if count == 1 else f"{count} chunks are lost"


def _store(folder: Path, digest: str, content: bytes) -> None:
    """Writes a file of the folder, unless it is there."""
    path = folder / digest
    if path.exists() and _digest(path.read_bytes()) == digest:
        return
    folder.mkdir(exist_ok=True)
    part = folder / f".{uuid4().hex}"
    part.write_bytes(content)
    part.replace(path)


def _digest(content: bytes) -> str:
    return blake2b(content, digest_size=16).hexdigest()


def _stream(data: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(data))


def _decompressed(data: bytes) -> bytes:
    """Decompresses data.

    Raises:
        _DamageError: it is damaged, or too large.
    """
    try:
        if not 0 <= zstandard.frame_content_size(data) <= _MAX_CHUNK_BYTES:
            raise _DamageError("compressed data has no valid size")
        return zstandard.decompress(data)
    except zstandard.ZstdError as error:
        raise _DamageError("compressed data is damaged") from error


def repair(path: str | os.PathLike[str], output: str | os.PathLike[str]) -> tuple[EpisodeLoss, ...]:
    """Writes a whole file with everything that is readable in a damaged one.

    Args:
        path: the damaged file, which is not changed.
        output: the file to write.

    Returns:
        What was lost, which `Episode.losses` of the written file lists, too.

    Raises:
        EpisodeFileError: nothing is readable, or the output exists or cannot be written.
    """
    file = EpisodeFile(Path(path))
    try:
        losses = file.losses()
        chunks = _restorable(file)
        dropped = [chunk for chunk in file.chunks if chunk.number not in chunks]
        if dropped:
            cause = f"{len(dropped)} chunks are relative to a lost one"
            begin_s, end_s = dropped[0].begin_ns / 1e9, dropped[-1].end_ns / 1e9
            losses = (*losses, EpisodeLoss(begin_s=begin_s, end_s=end_s, cause=cause))
        if not chunks:
            raise EpisodeFileError(str(path), cause="nothing in it is readable")
        _write_repaired(file, Path(output), chunks, losses)
    finally:
        file.close()
    return losses


def _restorable(file: EpisodeFile) -> dict[int, int]:
    """The new numbers of the chunks whose base is readable."""
    numbers: dict[int, int] = {}
    for chunk in file.chunks:
        head, _ = file.read(chunk.number)
        if head.base == chunk.number or _base(head, numbers) is not None:
            numbers[chunk.number] = len(numbers)
    return numbers


def _base(head: ChunkHead, numbers: Mapping[int, int]) -> int | None:
    """The new number of the base of a chunk; None if it is lost, and the one after it, too."""
    return numbers.get(head.base, numbers.get(head.base + 1))


def _write_repaired(
    file: EpisodeFile, output: Path, numbers: Mapping[int, int], losses: tuple[EpisodeLoss, ...]
) -> None:
    writer = EpisodeFileWriter(output)
    try:
        for name in file.attachment_names():
            if name == _LOSSES:
                continue
            try:
                content = file.attachment(name)
            except EpisodeFileError:  # listed as a loss; one of the folder beside the file may be copied there later
                name, content = f"{name}{_ELSEWHERE}", file.reference(name)
            if content is not None:
                writer.add_attachment(name, "application/octet-stream", content)
        if losses:
            writer.add_attachment(_LOSSES, "application/json", msgspec.json.encode(losses))
        for number, new_number in numbers.items():
            head, messages = file.read(number)
            renumbered = head._replace(number=new_number, base=_base(head, numbers) or 0)
            first_ns = messages[0].time_ns if messages else 0
            writer.add(EpisodeTopic.CHUNKS, first_ns, EpisodeEncoder.chunk(renumbered))
            for message in messages:
                if message.topic is not None:
                    writer.add(message.topic, message.time_ns, message.data)
            writer.end_chunk()
        writer.close()
    except OSError as error:
        raise EpisodeFileError(str(output), cause=error.strerror or str(error)) from error
    finally:
        writer.close()
