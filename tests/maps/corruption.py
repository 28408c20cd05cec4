"""Corruption of files by random cuts, swaps, bit flips and replaced values; a seed reproduces it."""

from __future__ import annotations

import re
from collections.abc import Callable
from random import Random

__all__ = ["INVALID_TEXTS", "corrupted"]

INVALID_TEXTS = (
    *(
        "",
        " ",
        "nan",
        "inf",
        "-INF",
        "1,5",
        "1e999",
        "-1e308",
        "1e-320",
        "0",
        "-0.0",
        "-1",
        "2",
        "9" * 400,
        "0x1F",
        "1_0",
    ),
    *(
        "0 0 0",
        "0 0 0 0",
        "1 2",
        "1 2 3 4 5",
        "nan nan nan",
        "0 0 0 nan",
        "1e200 1e200 1e200",
        "1e-200 0 0 0",
        "[1,2,3]",
    ),
    *("true", "maybe", "SemLog;k,v;", ";;,;", "A,b", "½", "١٢٣", "\u202e1.0", "1.0\t2.0\n3.0", "x" * 5000),
    *("2010-02-30T25:61:00", "timepoint_99999999999999999999", "9999-12-31T23:59:59-99:00", "package://../../x.dae"),
)
"""Invalid and extreme values for numbers, rows of numbers, dates, tags and paths."""

_NUMBER = re.compile(rb"(?<![\w.#-])-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(?![\w.#-])")
_NAME = re.compile(rb"(?<=[;#])[A-Za-z_][\w.-]{2,}(?=[\"'>\s])")
_MAX_SLICE = 400
"""Maximum size of a cut or a swap [bytes]; a truncation may be larger."""

Corruption = Callable[[bytes, Random], bytes]


def corrupted(data: bytes, seed: int) -> bytes:
    """Returns a corrupted file; seed 0 leaves it unchanged."""
    if not seed:
        return data
    random = Random(seed)
    kinds = random.choices(_MUTATIONS, _WEIGHTS, k=random.choice((1, 1, 2, 3, 6)))
    for mutation in kinds:
        data = mutation(data, random)
    return data


def _slice(data: bytes, random: Random) -> tuple[int, int]:
    start = random.randrange(len(data) + 1)
    return start, min(len(data), start + int(_MAX_SLICE ** random.random()))


def _delete_slice(data: bytes, random: Random) -> bytes:
    start, end = _slice(data, random)
    return data[:start] + data[end:]


def _truncate(data: bytes, random: Random) -> bytes:
    return data[: random.randrange(len(data) + 1)]


def _double(data: bytes, random: Random) -> bytes:
    start, end = _slice(data, random)
    return data[:end] + data[start:end] * random.randint(1, 3) + data[end:]


def _swap(data: bytes, random: Random) -> bytes:
    (a, b), (c, d) = sorted([_slice(data, random), _slice(data, random)])
    c = max(b, c)
    d = max(c, d)
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def _flip(data: bytes, random: Random) -> bytes:
    flipped = bytearray(data)
    for _ in range(random.randint(1, 12) if data else 0):
        flipped[random.randrange(len(flipped))] ^= 1 << random.randrange(8)
    return bytes(flipped)


def _insert(data: bytes, random: Random) -> bytes:
    at = random.randrange(len(data) + 1)
    signs = (
        b"<",
        b">",
        b"&",
        b'"',
        b"'",
        b"\0",
        b"]]>",
        b"-->",
        b"<![CDATA[",
        b"&#0;",
        b"\xff\xfe",
        b"xmlns:a=",
        b"/>",
    )
    return data[:at] + random.choice(signs) * random.choice((1, 1, 2, 300)) + data[at:]


def _replace_number(data: bytes, random: Random) -> bytes:
    return _replace(data, random, _NUMBER, [text.encode() for text in INVALID_TEXTS])


def _replace_name(data: bytes, random: Random) -> bytes:
    """Replaces names by others of the file, so that references point to other individuals."""
    names = sorted(set(_NAME.findall(data)))
    return _replace(data, random, _NAME, names) if names else data


def _replace(data: bytes, random: Random, pattern: re.Pattern[bytes], others: list[bytes]) -> bytes:
    spans = [match.span() for match in pattern.finditer(data)]
    chosen = random.sample(spans, min(len(spans), random.choice((1, 2, 5, 20, 200))))
    for start, end in sorted(chosen, reverse=True):
        data = data[:start] + random.choice(others) + data[end:]
    return data


def _shuffle_lines(data: bytes, random: Random) -> bytes:
    lines = data.splitlines(keepends=True)
    for _ in range(random.randint(1, 8) if lines else 0):
        line = lines.pop(random.randrange(len(lines)))
        if random.random() < 0.7:
            lines.insert(random.randrange(len(lines) + 1), line)
        if not lines:
            break
    return b"".join(lines)


_MUTATIONS: tuple[Corruption, ...] = (
    *(_delete_slice, _truncate, _double, _swap, _flip, _insert),
    *(_replace_number, _replace_name, _shuffle_lines),
)
_WEIGHTS = (2, 1, 2, 2, 2, 2, 6, 6, 3)
"""Mutations that keep a file well-formed are more frequent, as others rarely reach the readers."""
