"""Fragments, PNG and CBOR: the ways a message is packed, ours and other people's."""

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

from mindstage.bridge.encodings import read_cbor, read_png, write_cbor, write_png
from mindstage.bridge.protocol import (
    BridgeLimits,
    Compression,
    FragmentBuffer,
    MessageDecoder,
    MessageEncoder,
    Publish,
    split_fragments,
)
from mindstage.errors import MessageValidationError


def assembly(**limits: Any) -> FragmentBuffer:
    return FragmentBuffer(msgspec.structs.replace(BridgeLimits(), **limits))


# -- fragments ---------------------------------------------------------------------------------------------------------


@given(texts=st.lists(st.text(max_size=60), min_size=1, max_size=4), size=st.integers(1, 20), order=st.randoms())
def test_pieces_in_any_order_and_mixed_become_their_texts(texts: list[str], size: int, order: random.Random) -> None:
    pieces = [
        (key, number, len(cuts), piece)
        for key, text in enumerate(texts)
        for cuts in [split_fragments(text, size, max_fragments=1000)]
        for number, piece in enumerate(cuts)
    ]
    order.shuffle(pieces)
    joining, whole = assembly(), {}
    for key, number, total, piece in pieces:
        text = joining.add(key, number, total, piece, 0.0)
        if text is not None:
            whole[key] = text
    assert whole == dict(enumerate(texts))
    assert len(joining) == 0


def test_pieces_grow_rather_than_become_too_many() -> None:
    assert len(split_fragments("x" * 1000, 1, max_fragments=10)) == 10
    assert split_fragments("", 5, max_fragments=10) == [""]


@pytest.mark.parametrize(
    ("limits", "pieces", "match"),
    [
        ({"fragments": 5}, [(0, 6, "a")], "it has 6 fragments; at most 5"),
        ({}, [(0, 2, "a"), (1, 3, "b")], "total is 3, and 2 in earlier fragments"),
        ({}, [(2, 2, "a")], "num is 2 of 2"),
        ({}, [(0, 2, "a"), (0, 2, "b")], "fragment 0 was received twice with different data"),
        ({"message_bytes": 5}, [(0, 3, "abc"), (1, 3, "def")], "incomplete messages have 6 bytes; at most 5"),
    ],
)
def test_pieces_that_fit_together_in_no_way_are_refused_and_forgotten(
    limits: dict[str, int], pieces: list[tuple[int, int, str]], match: str
) -> None:
    joining = assembly(**limits)
    *before, (num, total, data) = pieces
    for each in before:
        assert joining.add("m", *each, 0.0) is None
    with pytest.raises(MessageValidationError, match=match):
        joining.add("m", num, total, data, 0.0)
    assert len(joining) == 0


def test_the_same_piece_twice_is_harmless() -> None:
    joining = assembly()
    assert joining.add("m", 0, 2, "a", 0.0) is None
    assert joining.add("m", 0, 2, "a", 0.0) is None
    assert joining.add("m", 1, 2, "b", 0.0) == "ab"


def test_only_so_many_messages_may_be_incomplete() -> None:
    joining = assembly(fragmented_messages=2)
    joining.add("a", 0, 2, "", 0.0)
    joining.add("b", 0, 2, "", 0.0)
    with pytest.raises(MessageValidationError, match="2 messages are incomplete"):
        joining.add("c", 0, 2, "", 0.0)
    assert joining.add("a", 1, 2, "!", 0.0) == "!"


def test_a_message_whose_pieces_stop_coming_is_forgotten() -> None:
    joining = assembly(fragment_timeout_s=10.0)
    joining.add("old", 0, 2, "a", 0.0)
    joining.add("young", 0, 2, "a", 5.0)
    assert joining.expire(10.0) == []
    assert joining.expire(10.1) == ["old"]
    assert joining.add("young", 1, 2, "b", 11.0) == "ab"


def test_a_fragment_inside_a_fragment_is_refused() -> None:
    inner = '{"op":"fragment","id":"i","data":"{}","num":0,"total":1}'
    outer = msgspec.json.encode({"op": "fragment", "id": "o", "data": inner, "num": 0, "total": 1}).decode()
    with pytest.raises(MessageValidationError, match="nested in another") as refused:
        MessageDecoder(BridgeLimits()).decode(outer, 0.0)
    assert refused.value.id == "i"


# -- PNG ---------------------------------------------------------------------------------------------------------------

texts = st.text(st.characters(exclude_categories=["Cs"]))


@given(texts)
def test_a_text_survives_as_pixels(text: str) -> None:
    assert read_png(write_png(text), max_bytes=10_000).rstrip("\n") == text.rstrip("\n")


def test_others_can_read_our_images() -> None:
    text = '{"op":"publish","topic":"/map","msg":{"data":"é' + "0,100," * 1000 + '"}}'
    image = Image.open(io.BytesIO(base64.b64decode(write_png(text))))
    assert image.mode == "RGB"
    assert image.tobytes().decode().rstrip("\n") == text


@pytest.mark.parametrize(("mode", "channels"), [("L", 1), ("RGB", 3), ("RGBA", 4)])
@pytest.mark.parametrize("filter", range(5))
def test_we_can_read_other_peoples_images(mode: str, channels: int, filter: int) -> None:
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
    """The pixels as a writer of one fixed filter stores them, straight from the definition of the filters."""
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


@pytest.mark.parametrize(
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
def test_what_is_no_image_of_a_text_is_refused(image: bytes, match: str) -> None:
    with pytest.raises(MessageValidationError, match=match):
        read_png(base64.b64encode(image).decode(), max_bytes=1 << 20)


def test_an_image_that_would_fill_the_memory_is_not_unpacked() -> None:
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


def test_a_compressed_comment_is_not_unpacked_without_limit() -> None:
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
def test_a_damaged_image_is_refused_or_read_and_nothing_else(at: int, damage: bytes, cut: bool) -> None:
    image = base64.b64decode(write_png('{"op":"publish"}' * 5))
    broken = image[:at] + damage + (b"" if cut else image[at + len(damage) :])
    with suppress(MessageValidationError):
        assert isinstance(read_png(base64.b64encode(broken).decode(), max_bytes=10_000), str)


def test_an_image_may_come_in_pieces_of_both_kinds() -> None:
    operation = Publish(topic="/map", msg=msgspec.Raw(msgspec.json.encode({"data": list(range(500))})))
    (whole,) = MessageEncoder(operation).frames(Compression.PNG)
    data = msgspec.json.decode(whole)["data"]
    pieces = [
        {"op": "png", "id": "p", "num": n, "total": 2, "data": each} for n, each in enumerate((data[:99], data[99:]))
    ]
    reader = MessageDecoder(BridgeLimits())
    assert reader.decode(msgspec.json.encode(pieces[1]).decode(), 0.0) is None
    read = reader.decode(msgspec.json.encode(pieces[0]).decode(), 0.0)
    assert isinstance(read, Publish)
    assert bytes(read.msg) == bytes(operation.msg)


# -- CBOR --------------------------------------------------------------------------------------------------------------


def test_numbers_travel_as_typed_arrays() -> None:
    written = write_cbor(b'{"ranges":[1.0,2.5,-3.0],"mixed":[1,2.5],"one":[1.5]}')
    assert cbor2.loads(written) == {
        "ranges": cbor2.CBORTag(86, struct.pack("<3d", 1.0, 2.5, -3.0)), "mixed": [1, 2.5], "one": [1.5],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("tag", "kind"),
    [(65, ">H"), (66, ">I"), (67, ">Q"), (69, "<H"), (70, "<I"), (71, "<Q"), (72, "<b"), (73, ">h"), (74, ">i"),
     (75, ">q"), (77, "<h"), (78, "<i"), (79, "<q"), (80, ">e"), (81, ">f"), (82, ">d"), (84, "<e"), (85, "<f"),
     (86, "<d")],
)  # fmt: skip
def test_every_kind_of_typed_array_is_read(tag: int, kind: str) -> None:
    numbers = [1, 2, 100]
    packed = b"".join(struct.pack(kind, number) for number in numbers)
    assert msgspec.json.decode(read_cbor(cbor2.dumps(cbor2.CBORTag(tag, packed)), depth=8)) == numbers


def test_bytes_become_base64_as_rosbridge_writes_them() -> None:
    data = cbor2.dumps({"a": b"\0\1", "b": cbor2.CBORTag(64, b"\0\1"), "c": float("nan")})
    assert read_cbor(data, depth=8) == b'{"a":"AAE=","b":"AAE=","c":null}'


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xa1\x61",  # cut off
        b"\x9b\x7f\xff\xff\xff\xff\xff\xff\xff",  # promises more than there is on earth
        b"\x81" * 100 + b"\x00",  # too deep
        b"\xd8\x1c\x82\x01\xd8\x1d\x00",  # holds itself
        b"\xd8\x1c\x81\xd8\x1d\x00",  # holds itself, and nothing else
        b"\xc2\x41\x01",  # a number of any size
        b"\xd8\x41\x43abc",  # shorts of three bytes
        b"\xd8\x56\x83\x01\x02\x03",  # doubles that are no bytes
        b"\xa1\x80\x01",  # a list as a key
        b"\x62\xff\xff",  # no UTF-8
        b"\xf7",  # undefined
    ],
)
def test_cbor_that_json_cannot_say_is_refused(data: bytes) -> None:
    with pytest.raises(MessageValidationError, match="not CBOR, or JSON cannot represent it"):
        read_cbor(data, depth=64)


def test_a_small_frame_cannot_grow_large_by_sharing() -> None:
    # Each level holds the one before twice: 40 levels would be a tera of values.
    data = b"\xd8\x1c\x82\x00\x00"
    for level in range(40):
        data = b"\xd8\x1c\x83" + data + b"\xd8\x1d" + bytes([40 - level]) + b"\xd8\x1d" + bytes([40 - level])
    with pytest.raises(MessageValidationError):
        read_cbor(data, depth=64)
