"""Fragments, PNG compression and CBOR."""

from __future__ import annotations

import base64
import io
import math
import random
import struct
import tracemalloc
import zlib
from contextlib import suppress
from typing import Any

import cbor2
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from mindstage.access.limits import BridgeLimits
from mindstage.bridge.encodings import read_cbor, read_png, write_cbor, write_png
from mindstage.bridge.protocol import (
    Compression,
    FragmentBuffer,
    MessageDecoder,
    MessageEncoder,
    Publish,
    split_fragments,
)
from mindstage.errors import MessageValidationError
from tests.cases import each_case


def fragment_buffer(**limits: Any) -> FragmentBuffer:
    return FragmentBuffer(msgspec.structs.replace(BridgeLimits(), **limits))


# -- fragments ---------------------------------------------------------------------------------------------------------


@given(texts=st.lists(st.text(max_size=60), min_size=1, max_size=4), size=st.integers(1, 20), order=st.randoms())
def test_interleaved_fragments_in_any_order_are_joined(texts: list[str], size: int, order: random.Random) -> None:
    parts = [
        (key, number, len(fragments), data)
        for key, text in enumerate(texts)
        for fragments in [split_fragments(text, size, max_fragments=1000)]
        for number, data in enumerate(fragments)
    ]
    order.shuffle(parts)
    buffer, texts_by_key = fragment_buffer(), {}
    for key, number, total, data in parts:
        text = buffer.add(key, number, total, data, 0.0)
        if text is not None:
            texts_by_key[key] = text
    assert texts_by_key == dict(enumerate(texts))
    assert len(buffer) == 0


def test_fragments_become_larger_to_limit_their_number() -> None:
    assert len(split_fragments("x" * 1000, 1, max_fragments=10)) == 10
    assert split_fragments("", 5, max_fragments=10) == [""]


@each_case(
    ("limits", "parts", "match"),
    [
        ({"fragments": 5}, [(0, 6, "a")], "it has 6 fragments; at most 5"),
        ({}, [(0, 2, "a"), (1, 3, "b")], "total is 3, and 2 in earlier fragments"),
        ({}, [(2, 2, "a")], "num is 2 of 2"),
        ({}, [(0, 2, "a"), (0, 2, "b")], "fragment 0 was received twice with different data"),
        ({"message_bytes": 5}, [(0, 3, "abc"), (1, 3, "def")], "incomplete messages have 6 bytes; at most 5"),
    ],
)
def test_inconsistent_fragments_are_rejected_and_discarded(
    limits: dict[str, int], parts: list[tuple[int, int, str]], match: str
) -> None:
    buffer = fragment_buffer(**limits)
    *before, (num, total, data) = parts
    for each in before:
        assert buffer.add("m", *each, 0.0) is None
    with pytest.raises(MessageValidationError, match=match):
        buffer.add("m", num, total, data, 0.0)
    assert len(buffer) == 0


def test_a_duplicate_fragment_is_harmless() -> None:
    buffer = fragment_buffer()
    assert buffer.add("m", 0, 2, "a", 0.0) is None
    assert buffer.add("m", 0, 2, "a", 0.0) is None
    assert buffer.add("m", 1, 2, "b", 0.0) == "ab"


def test_the_number_of_incomplete_messages_is_limited() -> None:
    buffer = fragment_buffer(fragmented_messages=2)
    buffer.add("a", 0, 2, "", 0.0)
    buffer.add("b", 0, 2, "", 0.0)
    with pytest.raises(MessageValidationError, match="2 messages are incomplete"):
        buffer.add("c", 0, 2, "", 0.0)
    assert buffer.add("a", 1, 2, "!", 0.0) == "!"


def test_an_incomplete_message_expires() -> None:
    buffer = fragment_buffer(fragment_timeout_s=10.0)
    buffer.add("old", 0, 2, "a", 0.0)
    buffer.add("young", 0, 2, "a", 5.0)
    assert buffer.expire(10.0) == []
    assert buffer.expire(10.1) == ["old"]
    assert buffer.add("young", 1, 2, "b", 11.0) == "ab"


def test_a_fragment_inside_a_fragment_is_rejected() -> None:
    inner = '{"op":"fragment","id":"i","data":"{}","num":0,"total":1}'
    outer = msgspec.json.encode({"op": "fragment", "id": "o", "data": inner, "num": 0, "total": 1}).decode()
    with pytest.raises(MessageValidationError, match="nested in another") as refused:
        MessageDecoder(BridgeLimits()).decode(outer, 0.0)
    assert refused.value.id == "i"


# -- PNG ---------------------------------------------------------------------------------------------------------------

texts = st.text(st.characters(exclude_categories=["Cs"]))


@given(texts)
def test_png_compression_survives_a_round_trip(text: str) -> None:
    assert read_png(write_png(text), max_bytes=10_000).rstrip("\n") == text.rstrip("\n")


def test_pillow_reads_the_images() -> None:
    text = '{"op":"publish","topic":"/map","msg":{"data":"é' + "0,100," * 1000 + '"}}'
    image = Image.open(io.BytesIO(base64.b64decode(write_png(text))))
    assert image.mode == "RGB"
    assert image.tobytes().decode().rstrip("\n") == text


@each_case(("mode", "channels"), [("L", 1), ("RGB", 3), ("RGBA", 4)])
@each_case("filter", range(5))
def test_images_of_other_encoders_are_read(mode: str, channels: int, filter: int) -> None:
    text = "".join(random.Random(filter).choices('{"abc",é:[0123]}', k=5000)).encode()
    data = text if channels < 4 else b"".join(text[i : i + 3].ljust(3, b"\n") + b"\xff" for i in range(0, len(text), 3))
    width = math.isqrt(len(data) // channels)
    height = -(-len(data) // (channels * width))
    image = Image.frombytes(mode, (width, height), data.ljust(channels * width * height, b"\n"))
    packed = filtered(image.tobytes(), width * channels, channels, filter)
    read = read_png(
        base64.b64encode(png(width, height, {1: 0, 3: 2, 4: 6}[channels], packed)).decode(), max_bytes=20_000
    )
    assert read.rstrip("\n").encode() == text.rstrip(b"\n")
    saved = io.BytesIO()
    image.save(saved, "png")  # with filters of Pillow's choice
    assert read_png(base64.b64encode(saved.getvalue()).decode(), max_bytes=20_000) == read


def png(width: int, height: int, color: int, rows: bytes, bits: int = 8) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, color, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def filtered(pixels: bytes, row: int, step: int, kind: int) -> bytes:
    """Applies one PNG filter to all rows, as the specification defines it."""
    out = bytearray()
    above = bytes(row)
    for start in range(0, len(pixels), row):
        here = pixels[start : start + row]
        out.append(kind)
        for i, value in enumerate(here):
            left = here[i - step] if i >= step else 0
            corner = above[i - step] if i >= step else 0
            near = min((left, above[i], corner), key=lambda it: abs(left + above[i] - corner - it))
            out.append((value - (0, left, above[i], (left + above[i]) // 2, near)[kind]) % 256)
        above = here
    return bytes(out)


@each_case(
    ("image", "match"),
    [
        (b"", "not a PNG"),
        (b"GIF89a", "wrong signature"),
        (png(1, 1, 2, b"\0abc")[:20], "not a PNG"),
        (png(1, 1, 2, b"\0abc")[:40], "cannot be decoded"),
        (png(1, 1, 2, b"\0abc")[:-20] + b"x" * 20, "cannot be decoded"),
        (png(1, 1, 3, b"\0abc"), "only 8-bit"),
        (png(1, 1, 2, b"\0abc", bits=16), "only 8-bit"),
        (png(0, 1, 2, b""), "only 8-bit"),
        (png(1, 1, 2, b"\7abc"), "cannot be decoded"),
        (png(2, 1, 2, b"\0abc"), "cannot be decoded"),
        (png(1, 1, 2, b"\0\xff\xff\xff"), "not UTF-8"),
        (png(2**31, 2**31, 2, b""), "pixels have"),
        (png(40_000, 40_000, 2, b"\0" * 1000), "pixels have"),
    ],
)
def test_invalid_images_are_rejected(image: bytes, match: str) -> None:
    with pytest.raises(MessageValidationError, match=match):
        read_png(base64.b64encode(image).decode(), max_bytes=1 << 20)


def test_an_image_that_is_too_large_is_not_decompressed() -> None:
    bomb = base64.b64encode(png(1000, 300, 2, b"\0" * 60_000_000)).decode()
    read_png(write_png(""), max_bytes=3)  # loads Pillow
    tracemalloc.start()
    try:
        assert read_png(bomb, max_bytes=1 << 20) == "\0" * 900_000, "more pixels than the header says"
        with pytest.raises(MessageValidationError, match="its pixels have 900000 bytes; at most 899999"):
            read_png(bomb, max_bytes=899_999)
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_a_compressed_comment_is_limited() -> None:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    image = png(1, 1, 2, b"\0abc")
    comment = chunk(b"zTXt", b"Comment\0\0" + zlib.compress(b"x" * 100_000_000))
    tracemalloc.start()
    try:
        with pytest.raises(MessageValidationError, match="cannot be decoded"):
            read_png(base64.b64encode(image[:33] + comment + image[33:]).decode(), max_bytes=1 << 20)
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


@given(st.integers(0, 200), st.binary(min_size=1, max_size=8), st.booleans())
def test_a_damaged_image_is_read_or_rejected(at: int, damage: bytes, cut: bool) -> None:
    image = base64.b64decode(write_png('{"op":"publish"}' * 5))
    broken = image[:at] + damage + (b"" if cut else image[at + len(damage) :])
    with suppress(MessageValidationError):
        assert isinstance(read_png(base64.b64encode(broken).decode(), max_bytes=10_000), str)


def test_an_image_can_be_fragmented_in_both_ways() -> None:
    operation = Publish(topic="/map", msg=msgspec.Raw(msgspec.json.encode({"data": list(range(500))})))
    (texts_by_key,) = MessageEncoder(operation).frames(Compression.PNG)
    data = msgspec.json.decode(texts_by_key)["data"]
    parts = [
        {"op": "png", "id": "p", "num": n, "total": 2, "data": each} for n, each in enumerate((data[:99], data[99:]))
    ]
    reader = MessageDecoder(BridgeLimits())
    assert reader.decode(msgspec.json.encode(parts[1]).decode(), 0.0) is None
    read = reader.decode(msgspec.json.encode(parts[0]).decode(), 0.0)
    assert isinstance(read, Publish)
    assert bytes(read.msg) == bytes(operation.msg)


# -- CBOR --------------------------------------------------------------------------------------------------------------


def test_numbers_are_typed_arrays() -> None:
    written = write_cbor(b'{"ranges":[1.0,2.5,-3.0],"mixed":[1,2.5],"one":[1.5]}')
    assert cbor2.loads(written) == {
        "ranges": cbor2.CBORTag(86, struct.pack("<3d", 1.0, 2.5, -3.0)), "mixed": [1, 2.5], "one": [1.5],
    }  # fmt: skip


@each_case(
    ("tag", "kind"),
    [(65, ">H"), (66, ">I"), (67, ">Q"), (69, "<H"), (70, "<I"), (71, "<Q"), (72, "<b"), (73, ">h"), (74, ">i"),
     (75, ">q"), (77, "<h"), (78, "<i"), (79, "<q"), (80, ">e"), (81, ">f"), (82, ">d"), (84, "<e"), (85, "<f"),
     (86, "<d")],
)  # fmt: skip
def test_every_kind_of_typed_array_is_read(tag: int, kind: str) -> None:
    numbers = [1, 2, 100]
    packed = b"".join(struct.pack(kind, number) for number in numbers)
    assert msgspec.json.decode(read_cbor(cbor2.dumps(cbor2.CBORTag(tag, packed)), depth=8)) == numbers


def test_bytes_become_base64_as_in_rosbridge() -> None:
    data = cbor2.dumps({"a": b"\0\1", "b": cbor2.CBORTag(64, b"\0\1"), "c": float("nan")})
    assert read_cbor(data, depth=8) == b'{"a":"AAE=","b":"AAE=","c":null}'


@each_case(
    "data",
    [
        b"",
        b"\xa1\x61",  # cut off
        b"\x9b\x7f\xff\xff\xff\xff\xff\xff\xff",  # a length that exceeds any memory
        b"\x81" * 100 + b"\x00",  # too deep
        b"\xd8\x1c\x82\x01\xd8\x1d\x00",  # contains itself
        b"\xd8\x1c\x81\xd8\x1d\x00",  # contains only itself
        b"\xc2\x41\x01",  # a bignum
        b"\xd8\x41\x43abc",  # uint16 array of three bytes
        b"\xd8\x56\x83\x01\x02\x03",  # float64 array that is not a byte string
        b"\xa1\x80\x01",  # a list as a key
        b"\x62\xff\xff",  # invalid UTF-8
        b"\xf7",  # undefined
    ],
)
def test_cbor_that_json_cannot_represent_is_rejected(data: bytes) -> None:
    with pytest.raises(MessageValidationError, match="not CBOR, or JSON cannot represent it"):
        read_cbor(data, depth=64)


def test_shared_values_are_rejected() -> None:
    # Each level contains the previous one twice: 40 levels would be 2**40 values.
    data = b"\xd8\x1c\x82\x00\x00"
    for level in range(40):
        data = b"\xd8\x1c\x83" + data + b"\xd8\x1d" + bytes([40 - level]) + b"\xd8\x1d" + bytes([40 - level])
    with pytest.raises(MessageValidationError):
        read_cbor(data, depth=64)
