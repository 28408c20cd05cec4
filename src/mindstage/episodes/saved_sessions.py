"""The folder in which a process saves the world that is edited, in case it ends before its user has saved it.

There are snapshots of the whole world, and beside each a journal of the edits that were made after it, as the JSON of
`scene.edits`. Each file is on the disk before an older one is deleted, so that a killed process leaves the newest state
that it has written.
"""

from __future__ import annotations

import logging
import os
import secrets
import shutil
import time
import zlib
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import zstandard
from msgspec.structs import replace

from mindstage.episodes.episode import parts_of_spawned
from mindstage.episodes.geometry_file import decode_geometry, encode_geometry
from mindstage.errors import MindstageError
from mindstage.files import atomic_write, cache_dir, file_lock
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyGeometry, GeometryMap, Iri, World
from mindstage.scene.edits import Attach, BodyEdit, Delete, Detach, Edit, SetPoses, edit_from_json, edit_to_json
from mindstage.simulation import Simulation
from mindstage.simulation.imagined import match_world

__all__ = ["JOURNALED", "SavedSession", "SessionFolder", "TakenWorld", "ended_sessions"]

JOURNALED = (Attach, BodyEdit, Delete, Detach, SetPoses)
"""Edits that their JSON describes completely, which a journal may have."""
_RESTORE_S = 300.0
"""Timeout of giving restored bodies their states [s]."""
_MAX_SESSIONS = 10
"""The number of ended sessions that are kept."""
_ABANDONED_S = 3600.0
"""Age of a folder without a snapshot that is deleted [s]."""
_FOLDER = "autosave"
_OWNER = "owner"
"""The file that the process locks whose session it is."""
_log = logging.getLogger(__name__)


class _Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """The file of a snapshot."""

    format_version: int = 1
    origin: Iri
    """The first map of the process."""
    name: str
    saved_unix_s: float
    steps: tuple[str, ...]
    """The labels of the undo history, oldest first."""
    present: World
    spawned: tuple[World, ...]
    geometry: bytes
    """Without the shapes, which are in files of their own."""
    shapes: tuple[str, ...]
    knowledge: str


def _write(path: Path, data: bytes, *, level: int = 1) -> None:
    packed = zstandard.ZstdCompressor(level=level, write_checksum=True).compress(data)
    atomic_write(path, packed, durable=True)


def _read(path: Path) -> bytes:
    """The content of a file.

    Raises:
        OSError: it cannot be read.
        ValueError: it is damaged.
    """
    try:
        return zstandard.ZstdDecompressor().decompress(path.read_bytes())
    except zstandard.ZstdError as error:
        raise ValueError(f"{path.name} is damaged: {error}") from error


def _line(edit: Edit) -> bytes:
    text = edit_to_json(edit)
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _edits_of(path: Path) -> Iterator[Edit]:
    """The edits of a journal until the first line that was not written completely."""
    with suppress(FileNotFoundError):
        for line in path.read_bytes().splitlines(keepends=True):
            checksum, _, text = line.partition(b" ")
            if not text.endswith(b"\n") or checksum != b"%08x" % zlib.crc32(text[:-1]):
                return
            yield edit_from_json(text)


class SavedSession:
    """What a process has saved in its folder."""

    def __init__(self, folder: Path) -> None:
        """Reads the newest snapshot that is whole, and its journal.

        Raises:
            ValueError: there is none.
        """
        self.folder = folder
        numbers = sorted((int(path.stem.partition("-")[2]) for path in folder.glob("snapshot-*.zst")), reverse=True)
        for number in numbers:
            try:
                self._snapshot = msgspec.msgpack.decode(_read(folder / f"snapshot-{number}.zst"), type=_Snapshot)
                self.edits = tuple(_edits_of(folder / f"journal-{number}.txt"))
                self._knowledge = _read(folder / self._snapshot.knowledge)
                self.geometry = self._read_geometry()
                break
            except (OSError, ValueError, msgspec.MsgspecError, MindstageError) as error:
                _log.warning("%s: snapshot %d cannot be used: %s", folder, number, error)
        else:
            raise ValueError(f"{folder} has no snapshot")

    def _read_geometry(self) -> GeometryMap:
        known: dict[str, BodyGeometry] = {}
        for name in self._snapshot.shapes:
            known |= {each.key: each for each in decode_geometry(_read(self.folder / name)).values()}
        return decode_geometry(self._snapshot.geometry, known=known)

    @property
    def origin(self) -> Iri:
        """The first map of the process."""
        return self._snapshot.origin

    @property
    def present(self) -> World:
        """The world at the snapshot, before the edits."""
        return self._snapshot.present

    def describe(self) -> dict[str, object]:
        """What a page asks about."""
        steps = [*self._snapshot.steps, *(edit.label for edit in self.edits)]
        return {
            "name": self._snapshot.name,
            "saved_unix_s": self._snapshot.saved_unix_s,
            "edits": len(steps),
            "last": steps[-1] if steps else "",
        }

    def restore(self, simulation: Simulation) -> tuple[str, ...]:
        """Makes the saved world that of a simulation, as an edit that can be undone; returns what is different.

        Raises:
            MindstageError: it cannot be restored; the simulation has its former world then.
        """
        present, spawned = self._snapshot.present, self._snapshot.spawned
        parts = tuple(parts_of_spawned(present, spawned))
        merged = replace(
            parts[0],
            **{
                name: tuple(each for part in parts for each in getattr(part, name))
                for name in ("bodies", "joints", "attachments", "lights", "facts", "resources")
            },
        )
        knowledge = KnowledgeBase.from_bytes(self._knowledge)
        simulation.replace_world(
            merged, knowledge=knowledge, geometry=self.geometry, title=f"{self._snapshot.name} restored"
        )
        notes = simulation.engine.run(
            lambda engine: match_world(engine, present, worlds=(merged,)),
            label="restore",
            edits=True,
            timeout_s=_RESTORE_S,
        )
        failed = []
        for edit in self.edits:
            try:
                simulation.apply(edit)
            except MindstageError as error:
                failed.append(f"{edit.label}: {error}")
        return (*notes, *failed)


class TakenWorld(NamedTuple):
    """What the engine thread takes for a snapshot."""

    present: World
    spawned: tuple[World, ...]
    geometry: GeometryMap
    knowledge: KnowledgeBase
    poses: np.ndarray
    waiting: int
    """The number of edits that are older."""


class SessionFolder:
    """The folder of this process; used by one thread."""

    def __init__(self, origin: Iri) -> None:
        self.origin = origin
        self.folder = cache_dir(_FOLDER) / secrets.token_hex(8)
        self._number = 0
        self._shapes: dict[str, set[str]] = {}
        """The keys of the geometries in each file of shapes."""
        self._journal: int | None = None
        self._owned = ExitStack()
        self._former: list[str] = []
        """Files that the snapshot before needs."""

    def write_snapshot(self, taken: TakenWorld, steps: tuple[str, ...], knowledge: bytes) -> None:
        """Writes a snapshot with an empty journal, then deletes what only older ones need but the last.

        Raises:
            OSError: the disk is full, for example.
        """
        if not self.folder.exists():
            self.folder.mkdir(parents=True, mode=0o700)
            self._owned.enter_context(file_lock(self.folder / _OWNER, timeout_s=1.0))
        keys = {each.key for each in taken.geometry.values()}
        new = keys.difference(*self._shapes.values())
        if new:
            name = f"shapes-{len(self._shapes)}-{secrets.token_hex(4)}.zst"
            first = {each.key: (id, each) for id, each in taken.geometry.items()}
            _write(self.folder / name, encode_geometry(dict(first[key] for key in new)))
            self._shapes[name] = new
        knowledge_name = f"knowledge-{sha256(knowledge).hexdigest()[:24]}.zst"
        if not (self.folder / knowledge_name).exists():
            _write(self.folder / knowledge_name, knowledge)
        snapshot = _Snapshot(
            origin=self.origin,
            name=taken.present.name or "the world",
            saved_unix_s=time.time(),
            steps=steps,
            present=taken.present,
            spawned=taken.spawned,
            geometry=encode_geometry(taken.geometry, known=keys),
            shapes=tuple(name for name, known in self._shapes.items() if known & keys),
            knowledge=knowledge_name,
        )
        number = self._number + 1
        _write(self.folder / f"snapshot-{number}.zst", msgspec.msgpack.encode(snapshot))
        self._number = number
        self._close_journal()
        kept = [f"snapshot-{number}.zst", f"journal-{number}.txt", *snapshot.shapes, knowledge_name]
        for path in self.folder.iterdir():
            if path.name not in {*kept, *self._former, _OWNER}:
                path.unlink(missing_ok=True)
        self._shapes = {name: known for name, known in self._shapes.items() if name in {*kept, *self._former}}
        self._former = kept

    def append(self, edits: Iterable[Edit]) -> None:
        """Writes edits to the journal of the last snapshot, and waits until they are on the disk.

        Raises:
            OSError: the disk is full, for example.
        """
        if not (data := b"".join(map(_line, edits))):
            return
        if self._journal is None:
            path = self.folder / f"journal-{self._number}.txt"
            self._journal = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        os.write(self._journal, data)
        os.fsync(self._journal)

    def delete(self) -> None:
        """Deletes all that was saved."""
        self.close()
        shutil.rmtree(self.folder, ignore_errors=True)
        self._number, self._shapes, self._former = 0, {}, []

    def close(self) -> None:
        """Leaves what was saved."""
        self._close_journal()
        self._owned.close()

    def _close_journal(self) -> None:
        if self._journal is not None:
            os.close(self._journal)
            self._journal = None


def ended_sessions(origin: Iri) -> Iterator[tuple[SavedSession, ExitStack]]:
    """The sessions of a map whose processes have ended, the newest first; deletes the oldest ones of all maps.

    Each comes with its lock, which is released unless the caller takes it (`pop_all`).
    """
    ended = 0
    for folder in sorted(cache_dir(_FOLDER).iterdir(), key=_modified_s, reverse=True):
        with ExitStack() as lock, suppress(OSError):
            lock.enter_context(file_lock(folder / _OWNER, timeout_s=0.0))
            ended += 1
            if not any(folder.glob("snapshot-*.zst")):
                if time.time() - _modified_s(folder) > _ABANDONED_S:
                    shutil.rmtree(folder, ignore_errors=True)
            elif ended > _MAX_SESSIONS:
                shutil.rmtree(folder, ignore_errors=True)
            elif (session := _session(folder)) is not None and session.origin == origin:
                yield session, lock


def _session(folder: Path) -> SavedSession | None:
    try:
        return SavedSession(folder)
    except ValueError as error:
        _log.warning("%s", error)
        return None


def _modified_s(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:  # deleted meanwhile
        return 0.0
