"""The topics of an episode file, and its messages in CDR, the encoding of ROS 2.

All topics have ROS message types, so that rosbags, `ros2 bag` and Foxglove read a file without Mindstage. The names in
transforms and contacts are encoded once, and put between blocks of numbers.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from functools import cache
from importlib.resources import files
from math import isnan, nan
from typing import NamedTuple

import msgspec
import numpy as np

from mindstage.engines.base import Contact, PoseArray
from mindstage.episodes.recording import DriveState, EpisodeEdit, EpisodeEvent, EpisodeEventKind, EventState
from mindstage.scene import Body, BodyId, PrimitiveType, Vector

__all__ = [
    "AXIS_NAMES",
    "ROOT_FRAME",
    "ChunkHead",
    "EpisodeDecoder",
    "EpisodeEncoder",
    "EpisodeTopic",
    "WorldRecord",
    "schema_text",
]

AXIS_NAMES = ("x", "y", "z", "twist", "swing2", "swing1")
"""The six numbers of a joint, in order."""
ROOT_FRAME = "world"
"""The frame in which all poses are given."""
_HEADER = b"\x00\x01\x00\x00"
"""The encapsulation of CDR with little-endian numbers; alignment is counted from its end."""
_MAX_TEXTS = 1 << 16
"""The number of encoded names that are kept."""
_DEFAULT_COLOR = (0.7, 0.7, 0.7)
_DEFAULT_SIZE_M = 0.05
_CUBE, _SPHERE, _CYLINDER, _ADD, _DELETE_ALL = 1, 2, 3, 0, 3
"""These are codes of visualization_msgs/Marker."""
_MARKER_TYPES = {PrimitiveType.SPHERE: _SPHERE, PrimitiveType.CYLINDER: _CYLINDER}


class EpisodeTopic(Enum):
    """The topics of an episode, in the order of their channels: name and type."""

    CHUNKS = ("/mindstage/chunks", "mindstage_msgs/msg/EpisodeChunk")
    WORLD = ("/mindstage/world", "mindstage_msgs/msg/EpisodeWorld")
    TF = ("/tf", "tf2_msgs/msg/TFMessage")
    TF_STATIC = ("/tf_static", "tf2_msgs/msg/TFMessage")
    JOINTS = ("/joint_states", "sensor_msgs/msg/JointState")
    CONTACTS = ("/mindstage/contacts", "mindstage_msgs/msg/EpisodeContacts")
    CLOCK = ("/clock", "rosgraph_msgs/msg/Clock")
    MARKERS = ("/markers", "visualization_msgs/msg/MarkerArray")
    EDITS = ("/mindstage/edits", "mindstage_msgs/msg/EpisodeEdit")
    EVENTS = ("/mindstage/events", "mindstage_msgs/msg/EpisodeEvent")
    DRIVES = ("/robot_joint_states", "sensor_msgs/msg/JointState")

    @property
    def type(self) -> str:
        """The name of the message type."""
        return self.value[1]


class ChunkHead(NamedTuple):
    """The first message of a chunk; see `EpisodeChunk.msg`."""

    episode: str
    number: int
    base: int
    structure: int
    digest: str
    """Of that structure."""
    repeated: int


class WorldRecord(NamedTuple):
    """A world apart from its poses, or its changes; see `EpisodeWorld.msg`."""

    number: int
    complete: bool
    json: bytes
    digest: str


# -- definitions -------------------------------------------------------------------------------------------------------

_BUILTIN_TYPES = {"bool", "byte", "char", "string", "wstring", "float32", "float64"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}


@cache
def schema_text(type: str) -> str:
    """The definition of a message type and of all types in it, as one `ros2msg` schema.

    Args:
        type: its name, such as "tf2_msgs/msg/TFMessage".
    """
    package, name = type.replace("/msg/", "/").split("/")
    definitions: dict[str, str] = {}
    waiting = [(package, name)]
    while waiting:
        package, name = waiting.pop(0)
        if f"{package}/{name}" in definitions:
            continue
        lines, used = _definition(package, name)
        definitions[f"{package}/{name}"] = "\n".join(lines)
        waiting += used
    first, *others = definitions.items()
    line = "=" * 80
    return first[1] + "".join(f"\n{line}\nMSG: {name}\n{text}" for name, text in others) + "\n"


def _definition(package: str, name: str) -> tuple[list[str], list[tuple[str, str]]]:
    """The declarations of a message type without comments, and the message types in it."""
    if (package, name) == ("builtin_interfaces", "Duration"):
        return ["int32 sec", "uint32 nanosec"], []  # the common definition has the signed fraction of ROS 1
    path = files("mindstage.msgs") / "definitions" / package / "msg" / f"{name}.msg"
    lines, used = [], []
    for line in path.read_text(encoding="utf-8").splitlines():
        declaration, _, comment = line.partition("#")
        if not declaration.strip() or "@ros1_only" in comment:
            continue
        field, *rest = declaration.split()
        base = field.partition("[")[0]
        if base not in _BUILTIN_TYPES:
            owner, _, local = base.rpartition("/")
            used.append((owner or package, local))
            field = f"{owner or package}/{local}{field[len(base) :]}"
        lines.append(" ".join([field, *rest]))
    return lines, used


# -- CDR ---------------------------------------------------------------------------------------------------------------


class _CdrWriter:
    """Appends values with CDR's alignment."""

    def __init__(self) -> None:
        self.data = bytearray()

    def message(self) -> bytes:
        """The message with its encapsulation."""
        return _HEADER + self.data

    def align(self, size: int) -> None:
        """Fills up to a multiple of a size."""
        self.data += b"\0" * (-len(self.data) % size)

    def numbers(self, format: str, *values: float) -> None:
        """Appends numbers of one `struct` format."""
        self.align(struct.calcsize(format))
        self.data += struct.pack(f"<{len(values)}{format}", *values)

    def string(self, text: str) -> None:
        """Appends a string."""
        data = text.encode()
        self.numbers("I", len(data) + 1)
        self.data += data + b"\0"

    def strings(self, texts: Sequence[str]) -> None:
        """Appends a sequence of strings."""
        self.numbers("I", len(texts))
        for text in texts:
            self.string(text)

    def stamp(self, time_ns: int) -> None:
        """Appends a time."""
        self.numbers("i", time_ns // 1_000_000_000)
        self.numbers("I", time_ns % 1_000_000_000)


class _CdrReader:
    """Reads values with CDR's alignment.

    Raises:
        ValueError: the message ends too early, or a string is not UTF-8.
    """

    def __init__(self, data: bytes) -> None:
        if data[:4] != _HEADER:
            raise ValueError("a message is not little-endian CDR")
        self.data = memoryview(data)[4:]
        self.position = 0

    def align(self, size: int) -> None:
        self.position += -self.position % size

    def number(self, format: str) -> int:
        size = struct.calcsize(format)
        self.align(size)
        try:
            (value,) = struct.unpack_from(f"<{format}", self.data, self.position)
        except struct.error as error:
            raise ValueError("a message ends too early") from error
        self.position += size
        return int(value)

    def floats(self, count: int) -> tuple[float, ...]:
        self.align(8)
        if self.position + 8 * count > len(self.data):
            raise ValueError("a message ends too early")
        values: tuple[float, ...] = struct.unpack_from(f"<{count}d", self.data, self.position)
        self.position += 8 * count
        return values

    def string(self) -> str:
        length = self.number("I")
        end = self.position + length
        if not length or end > len(self.data):
            raise ValueError("a message ends too early")
        text = bytes(self.data[self.position : end - 1]).decode()
        self.position = end
        return text

    def strings(self) -> tuple[str, ...]:
        return tuple(self.string() for _ in range(self.number("I")))

    def stamp(self) -> int:
        seconds = self.number("i")
        return seconds * 1_000_000_000 + self.number("I")


def _stamp(time_ns: int) -> bytes:
    return struct.pack("<iI", time_ns // 1_000_000_000, time_ns % 1_000_000_000)


_CONTACT = struct.Struct("<8d")
_TF_ORDER = np.array([0, 1, 2, 4, 5, 6, 3])
"""From x y z, w x y z to x y z, x y z w."""
_POSE_ORDER = np.array([0, 1, 2, 6, 3, 4, 5])
"""The other way round."""
_read_count = struct.Struct("<I").unpack_from


class EpisodeEncoder:
    """Encodes the messages of an episode; times are nanoseconds since its begin."""

    def __init__(self) -> None:
        self._texts: dict[tuple[int, tuple[str, ...]], bytes] = {}

    def _strings(self, start: int, *texts: str) -> bytes:
        """Strings that begin at a position modulo 8, filled up to a multiple of 8."""
        known = self._texts.get((start, texts))
        if known is None:
            if len(self._texts) >= _MAX_TEXTS:
                self._texts.clear()
            writer = _CdrWriter()
            writer.data += bytes(start)
            for text in texts:
                writer.string(text)
            writer.align(8)
            known = self._texts[start, texts] = bytes(writer.data[start:])
        return known

    def transforms(self, time_ns: int, ids: Sequence[BodyId], poses: PoseArray) -> bytes:
        """A `tf2_msgs/TFMessage` with the poses of at least one body, n x 7."""
        stamp, numbers = _stamp(time_ns), poses[:, _TF_ORDER].tobytes()
        pieces, start = [_HEADER, struct.pack("<I", len(ids))], 4
        for row, id in enumerate(ids):
            pieces += (stamp, self._strings(start, ROOT_FRAME, id), numbers[56 * row : 56 * row + 56])
            start = 0
        return b"".join(pieces)

    def joints(self, time_ns: int, positions: Mapping[str, float]) -> bytes:
        """A `sensor_msgs/JointState`."""
        return self._joint_state(time_ns, list(positions), [list(positions.values()), (), ()])

    def drives(self, time_ns: int, states: Mapping[str, DriveState]) -> bytes:
        """A `sensor_msgs/JointState` with the states of at least one joint of a robot."""
        return self._joint_state(time_ns, list(states), list(zip(*states.values(), strict=True)))

    @staticmethod
    def _joint_state(time_ns: int, names: Sequence[str], columns: Sequence[Sequence[float]]) -> bytes:
        writer = _CdrWriter()
        writer.stamp(time_ns)
        writer.string("")
        writer.strings(names)
        for column in columns:
            writer.numbers("I", len(column))
            if column:
                writer.numbers("d", *column)
        return writer.message()

    def contacts(self, time_ns: int, contacts: Sequence[Contact]) -> bytes:
        """A `mindstage_msgs/EpisodeContacts`."""
        pieces, start = [_HEADER, _stamp(time_ns), struct.pack("<I", len(contacts))], 4
        for each in contacts:
            numbers = _CONTACT.pack(*each.position, *each.normal, each.force_n, each.depth_m)
            pieces += (self._strings(start, each.a, each.b or ""), numbers)
            start = 0
        return b"".join(pieces)

    @staticmethod
    def clock(time_ns: int) -> bytes:
        """A `rosgraph_msgs/Clock`."""
        return _HEADER + _stamp(time_ns)

    @staticmethod
    def chunk(head: ChunkHead) -> bytes:
        """A `mindstage_msgs/EpisodeChunk`."""
        writer = _CdrWriter()
        writer.string(head.episode)
        writer.numbers("Q", head.number, head.base, head.structure)
        writer.string(head.digest)
        writer.numbers("I", head.repeated)
        return writer.message()

    @staticmethod
    def world(time_ns: int, record: WorldRecord) -> bytes:
        """A `mindstage_msgs/EpisodeWorld`."""
        writer = _CdrWriter()
        writer.stamp(time_ns)
        writer.numbers("Q", record.number)
        writer.numbers("B", record.complete)
        writer.string(record.json.decode())
        writer.string(record.digest)
        return writer.message()

    @staticmethod
    def edit(time_ns: int, edit: EpisodeEdit) -> bytes:
        """A `mindstage_msgs/EpisodeEdit`."""
        writer = _CdrWriter()
        writer.stamp(time_ns)
        writer.string(edit.kind)
        writer.string(edit.client)
        writer.strings(edit.ids)
        writer.string(msgspec.json.encode(edit.details, enc_hook=_plain_value).decode())
        return writer.message()

    @staticmethod
    def event(time_ns: int, event: EpisodeEvent) -> bytes:
        """A `mindstage_msgs/EpisodeEvent`."""
        writer = _CdrWriter()
        writer.stamp(time_ns)
        writer.string(event.id)
        writer.string(event.kind.value)
        writer.numbers("d", event.begin_s, nan if event.end_s is None else event.end_s)
        for text in (event.thing, event.other, event.agent, event.joint):
            writer.string(text or "")
        writer.numbers("d", nan if event.amount is None else event.amount)
        writer.strings(event.evidence)
        writer.string(event.state.value)
        return writer.message()

    @staticmethod
    def markers(time_ns: int, bodies: Iterable[Body]) -> bytes:
        """A `visualization_msgs/MarkerArray` with a marker for each body, which moves with the body's frame."""
        drawn = tuple(bodies)
        writer = _CdrWriter()
        writer.numbers("I", len(drawn) + 1)
        _add_marker(writer, time_ns, ROOT_FRAME, 0, _CUBE, _DELETE_ALL, (1.0, 1.0, 1.0), _DEFAULT_COLOR)
        for number, body in enumerate(drawn):
            shape = _CUBE if body.shape is None else _MARKER_TYPES.get(body.shape.type, _CUBE)
            size = body.size or (_DEFAULT_SIZE_M,) * 3
            _add_marker(writer, time_ns, body.id, number, shape, _ADD, size, body.color or _DEFAULT_COLOR)
        return writer.message()


def _add_marker(
    writer: _CdrWriter, time_ns: int, frame: str, number: int, type: int, action: int, scale: Vector, color: Vector
) -> None:
    writer.align(4)
    writer.stamp(time_ns)
    writer.string(frame)
    writer.string("bodies")
    writer.numbers("i", number, type, action)
    writer.numbers("d", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, *scale)
    writer.numbers("f", *color, 1.0)
    writer.stamp(0)  # lifetime
    writer.numbers("B", True)  # frame_locked
    writer.numbers("I", 0, 0)  # points, colors
    writer.string("")  # texture_resource
    writer.stamp(0)  # texture: header
    writer.string("")
    writer.string("")  # its format
    writer.numbers("I", 0, 0)  # its data, uv_coordinates
    writer.string(frame)  # text
    writer.string("")  # mesh_resource
    writer.string("")  # mesh_file
    writer.numbers("I", 0)
    writer.numbers("B", False)  # mesh_use_embedded_materials


class EpisodeDecoder:
    """Decodes the messages of an episode.

    Raises:
        ValueError: a message ends too early, or is not valid in another way.
    """

    @staticmethod
    def transforms(data: bytes) -> tuple[list[BodyId], PoseArray]:
        """The bodies of a `tf2_msgs/TFMessage`, and their poses, n x 7."""
        if data[:4] != _HEADER:
            raise ValueError("a message is not little-endian CDR")
        ids, starts, at = [], [], 8
        try:
            for _ in range(_read_count(data, 4)[0]):
                at += 8  # the time
                at += 4 + _read_count(data, at)[0] + 3 & ~3  # the frame
                first = at + 4
                at = first + _read_count(data, at)[0]
                ids.append(BodyId(data[first : at - 1].decode()))
                at += 4 - at & 7  # numbers are aligned in what follows the encapsulation of 4 bytes
                starts.append(at)
                at += 56
        except struct.error as error:
            raise ValueError("a message ends too early") from error
        if at > len(data) or not all(ids):
            raise ValueError("a message ends too early")
        numbers = np.frombuffer(data, dtype="<f8", count=(len(data) - 4) // 8, offset=4)
        poses: PoseArray = numbers[np.array(starts, dtype=np.intp)[:, None] // 8 + _POSE_ORDER].astype(float)
        return ids, poses

    @staticmethod
    def joints(data: bytes) -> dict[str, float]:
        """The positions of a `sensor_msgs/JointState` by name."""
        reader = _CdrReader(data)
        reader.stamp()
        reader.string()
        names = reader.strings()
        return dict(zip(names, reader.floats(reader.number("I")), strict=True))

    @staticmethod
    def drives(data: bytes) -> dict[str, DriveState]:
        """The states of joints of robots by name, of a `sensor_msgs/JointState`."""
        reader = _CdrReader(data)
        reader.stamp()
        reader.string()
        names = reader.strings()
        columns = [reader.floats(reader.number("I")) for _ in DriveState._fields]
        return {name: DriveState(*row) for name, *row in zip(names, *columns, strict=True)}

    @staticmethod
    def contacts(data: bytes) -> tuple[Contact, ...]:
        """The contacts of a `mindstage_msgs/EpisodeContacts`."""
        reader = _CdrReader(data)
        reader.stamp()
        found = []
        for _ in range(reader.number("I")):
            a, b = reader.string(), reader.string()
            px, py, pz, nx, ny, nz, force, depth = reader.floats(8)
            contact = Contact(
                a=BodyId(a), b=BodyId(b) if b else None, position=(px, py, pz), normal=(nx, ny, nz),
                force_n=force, depth_m=depth,
            )  # fmt: skip
            found.append(contact)
        return tuple(found)

    @staticmethod
    def chunk(data: bytes) -> ChunkHead:
        """The head of a chunk."""
        reader = _CdrReader(data)
        episode = reader.string()
        number, base, structure = (reader.number("Q") for _ in range(3))
        return ChunkHead(episode, number, base, structure, reader.string(), reader.number("I"))

    @staticmethod
    def world(data: bytes) -> WorldRecord:
        """A world, or its changes."""
        reader = _CdrReader(data)
        reader.stamp()
        number, is_complete = reader.number("Q"), bool(reader.number("B"))
        return WorldRecord(number, is_complete, reader.string().encode(), reader.string())

    @staticmethod
    def edit(data: bytes) -> EpisodeEdit:
        """An edit or request."""
        reader = _CdrReader(data)
        time_s = reader.stamp() / 1e9
        kind, client = reader.string(), reader.string()
        ids = tuple(map(BodyId, reader.strings()))
        return EpisodeEdit(
            time_s=time_s, kind=kind, client=client, ids=ids, details=msgspec.json.decode(reader.string())
        )

    @staticmethod
    def event(data: bytes) -> EpisodeEvent:
        """An event."""
        reader = _CdrReader(data)
        reader.stamp()
        id, kind = reader.string(), reader.string()
        begin, end = reader.floats(2)
        thing, other, agent, joint = (reader.string() for _ in range(4))
        (amount,) = reader.floats(1)
        return EpisodeEvent(
            id=id,
            kind=EpisodeEventKind(kind),
            begin_s=begin,
            end_s=None if isnan(end) else end,
            thing=BodyId(thing),
            other=BodyId(other) if other else None,
            agent=agent or None,
            joint=BodyId(joint) if joint else None,
            amount=None if isnan(amount) else amount,
            evidence=reader.strings(),
            state=EventState(reader.string()),
        )


def _plain_value(value: object) -> object:
    """A value that JSON does not have, such as a number of NumPy that a program passed, as one that it has."""
    if hasattr(value, "to_edit_json"):
        return value.to_edit_json()
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)
