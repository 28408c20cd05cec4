"""A folder with the worlds that were read from maps, so that another process with the same files need not read them.

An entry belongs to the contents of all loaded files, the conventions that were given, and the program that read them,
with what packages add to it:
none of it can change without another key. An entry that is damaged or of another format counts as missing. The least
recently used entries are deleted.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from hashlib import blake2b
from pathlib import Path

import msgspec

from mindstage.files import atomic_write, modules_of
from mindstage.maps.dialects.conventions import Assumption
from mindstage.rdf.graphs import Finding, gc_paused
from mindstage.registry import Group, fingerprint
from mindstage.scene import Iri, World

__all__ = ["WorldCache", "WorldReading"]

_SUFFIX = ".world"
_DIGEST_BYTES = 16
_MAX_BYTES = 64 << 20
"""Total size from which the least recently used entries are deleted."""
_BLANK_NODE = b"_:"
_PACKAGES = ("", "scene", "rdf", "maps/rdf_mapping", "maps/dialects", "maps/io", "maps/urdf", "knowledge")
"""The folders with the modules that read worlds."""


class WorldReading(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What reading a map gives."""

    world: World
    findings: tuple[Finding, ...] = ()
    assumptions: tuple[Assumption, ...] = ()


class WorldCache:
    """The entries in a folder, which several processes may use at once."""

    def __init__(self, folder: Path, *, max_bytes: int = _MAX_BYTES) -> None:
        """Reads nothing yet.

        Args:
            folder: an existing folder of this cache only.
            max_bytes: the total size of the entries [bytes].
        """
        self._folder = folder
        self._max_bytes = max_bytes

    def get(self, map: Iri, sources: bytes) -> WorldReading | None:
        """The entry of a map; None if there is none.

        Args:
            sources: a digest of everything that it was read from.
        """
        path = self._path(map, sources)
        try:
            data = path.read_bytes()
        except OSError:
            return None
        digest, encoded = data[:_DIGEST_BYTES], data[_DIGEST_BYTES:]
        if blake2b(encoded, digest_size=_DIGEST_BYTES).digest() != digest:
            return None
        try:
            with gc_paused():
                found = msgspec.msgpack.decode(encoded, type=WorldReading)
        except msgspec.DecodeError:
            return None
        with suppress(OSError):  # it is the most recently used one now
            os.utime(path)
        return found

    def put(self, map: Iri, sources: bytes, reading: WorldReading) -> bool:
        """Adds or replaces an entry; returns whether it was written.

        A reading with labels of blank nodes is not, since another process has other labels for them. Neither is one
        that cannot be, for example since the disk is full: it is read from the map again.
        """
        encoded = msgspec.msgpack.encode(reading)
        if _BLANK_NODE in encoded or len(encoded) > self._max_bytes:
            return False
        path = self._path(map, sources)
        try:
            atomic_write(path, blake2b(encoded, digest_size=_DIGEST_BYTES).digest() + encoded)
        except OSError:
            return False
        self._delete_oldest(path)
        return True

    def _path(self, map: Iri, sources: bytes) -> Path:
        readers = fingerprint(Group.DIALECTS, Group.FORMATS)
        key = blake2b(msgspec.msgpack.encode((_program(), readers, map, sources)), digest_size=_DIGEST_BYTES)
        return self._folder / f"{key.hexdigest()}{_SUFFIX}"

    def _delete_oldest(self, newest: Path) -> None:
        with suppress(OSError):
            entries = [(entry.stat(), entry.path) for entry in os.scandir(self._folder) if _is_entry(entry.name)]
            total = sum(status.st_size for status, _ in entries)
            for status, path in sorted(entries, key=lambda each: each[0].st_mtime_ns):
                if total <= self._max_bytes:
                    return
                if path != str(newest):
                    with suppress(FileNotFoundError):  # another process has deleted it
                        os.unlink(path)
                    total -= status.st_size


def _is_entry(name: str) -> bool:
    return name.endswith(_SUFFIX)


@cache
def _program() -> Sequence[tuple[str, int, int]]:
    return modules_of(Path(__file__).parents[1], _PACKAGES)
