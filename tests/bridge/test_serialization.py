"""Binary formats of ROS 1 and ROS 2: the bytes are those of rosbags, for messages of every type of both."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from mindstage.bridge.encodings import serialize
from mindstage.errors import MessageValidationError
from mindstage.msgs import RosVersion, geometry_msgs, message_type, message_types, std_msgs, type_name
from mindstage.msgs import builtin_interfaces as builtin
from mindstage.msgs.schema.base import fields_of, struct_of

BOUNDS = {"int8": 8, "int16": 16, "int32": 32, "int64": 64, "uint8": 8, "uint16": 16, "uint32": 32, "uint64": 63}


STORES = {RosVersion.ONE: get_typestore(Stores.ROS1_NOETIC), RosVersion.TWO: get_typestore(Stores.ROS2_HUMBLE)}


def values(primitive: str, enum: Any) -> st.SearchStrategy[Any]:
    if enum is not None:
        return st.sampled_from(list(enum))
    if primitive == "string":
        return st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=5)
    if primitive == "bool":
        return st.booleans()
    if primitive.startswith("float"):
        return st.floats(width=int(primitive[5:]), allow_nan=False, allow_infinity=False)
    bits = BOUNDS[primitive]
    low, high = (0, 2**bits - 1) if primitive.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return st.integers(low, high)


def messages(cls: Any) -> st.SearchStrategy[Any]:
    """Messages of a type with values in the ranges of their fields."""
    if struct_of(cls) in (builtin.Time, builtin.Duration):  # rosbags reads all nanoseconds as uint32
        first = 0 if struct_of(cls) is builtin.Time else -(2**31)
        return st.builds(struct_of(cls), sec=st.integers(first, 2**31 - 1), nanosec=st.integers(0, 10**9 - 1))
    parts: dict[str, st.SearchStrategy[Any]] = {}
    for field in fields_of(cls):
        inner = messages(field.message) if field.message else values(field.primitive, field.enum)
        if field.length is None:
            parts[field.name] = inner
        elif field.primitive == "uint8" and not field.enum:
            parts[field.name] = st.binary(max_size=5)
        else:
            size = {"min_size": field.length, "max_size": field.length or 3}
            parts[field.name] = st.lists(inner, **size).map(tuple)
    return st.builds(struct_of(cls), **parts)


def plain(value: Any) -> Any:
    """Converts a message of rosbags to plain values."""
    if is_dataclass(value):
        names = [field.name for field in fields(value) if field.name not in NOT_FIELDS and not field.name.isupper()]
        return {name: plain(getattr(value, name)) for name in names}
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain(each) for each in value] if isinstance(value, list) else value


def expected(cls: Any, message: Any, ros: RosVersion) -> Any:
    """Converts one of our messages to plain values with the names of rosbags."""
    found = {}
    for field in fields_of(cls):
        if struct_of(cls).only_in.get(field.name, ros) is ros:
            value = getattr(message, field.name)
            if field.message and field.length is None:
                found[field.name] = expected(field.message, value, ros)
            elif field.message:
                found[field.name] = [expected(field.message, each, ros) for each in value]
            else:
                found[field.name] = list(value) if isinstance(value, tuple | bytes) else value
    return found


NOT_FIELDS = {"__msgtype__", "structure_needs_at_least_one_member"}
NAMES = {
    ros: sorted(
        name
        for name, cls in message_types().items()
        if not hasattr(cls, "__args__") and type_name(cls, RosVersion.TWO) in store.types
    )
    for ros, store in STORES.items()
}


@pytest.mark.parametrize("ros", list(RosVersion))
@settings(max_examples=60)
@given(data=st.data())
def test_bytes_are_those_of_rosbags(ros: RosVersion, data: Any) -> None:
    cls = message_type(data.draw(st.sampled_from(NAMES[ros])))
    message = data.draw(messages(cls))
    store, name = STORES[ros], type_name(cls, RosVersion.TWO)
    written = serialize(message, ros=ros)
    if ros is RosVersion.ONE:
        read, again = store.deserialize_ros1(written, name), store.serialize_ros1
    else:
        read, again = store.deserialize_cdr(written, name), store.serialize_cdr
    assert plain(read) == msgspec.to_builtins(expected(cls, message, ros))
    assert bytes(again(read, name)) == written


def test_the_formats_differ_in_padding_text_and_header() -> None:
    header = std_msgs.Header(stamp=builtin.Time(sec=1, nanosec=2), frame_id="ab")
    message = geometry_msgs.PointStamped(header=header, point=geometry_msgs.Point(x=1.0))
    point = b"\0\0\0\0\0\0\xf0?" + bytes(16)
    stamp = b"\1\0\0\0\2\0\0\0"
    assert serialize(message, ros=RosVersion.ONE) == bytes(4) + stamp + b"\2\0\0\0ab" + point
    assert serialize(message, ros=RosVersion.TWO) == b"\0\1\0\0" + stamp + b"\3\0\0\0ab\0" + b"\0" + point


def test_a_value_out_of_range_is_an_error() -> None:
    with pytest.raises(MessageValidationError, match="std_msgs/msg/UInt8"):
        serialize(std_msgs.UInt8(data=256), ros=RosVersion.TWO)
