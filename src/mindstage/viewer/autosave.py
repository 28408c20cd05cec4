"""Autosave: what was edited is kept on the disk, and offered again if the program ended before it was saved.

Every process keeps a folder: snapshots of the whole world, and beside each a journal of the edits that were made after
it, as the JSON of `scene.edits`. An edit that needs more than its JSON, such as one that adds bodies, makes a snapshot
instead, as physics does that moves something. Each file is on the disk before an older one is deleted, so that a killed
process leaves the newest state that it has written.
"""

from __future__ import annotations

import logging
import os
import secrets
import shutil
import threading
import time
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from weakref import WeakSet

import msgspec
import numpy as np
import zstandard
from msgspec.structs import replace

from mindstage.access.policies import FILE
from mindstage.engines.base import Engine
from mindstage.episodes.episode import parts_of_spawned
from mindstage.episodes.geometry_file import decode_geometry, encode_geometry
from mindstage.errors import InvalidArgumentError, MindstageError
from mindstage.files import atomic_write, cache_dir, file_lock
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyGeometry, BodyId, GeometryMap, Iri, World
from mindstage.scene.edits import Attach, BodyEdit, Delete, Detach, Edit, SetPoses, edit_from_json, edit_to_json
from mindstage.simulation import Simulation, StateSnapshot
from mindstage.simulation.imagined import match_world
from mindstage.simulation.observation import as_client
from mindstage.viewer.server import CLIENT, ClientSession, EmptyRequest, RpcChannel

__all__ = ["Autosave", "SavedSession"]

_POLL_S = 0.2
"""Wall time between two writings of the journal [s]."""
_SNAPSHOT_S = 4.0
"""Wall time between two snapshots while bodies move [s]."""
_RETRY_S = 30.0
"""Wall time after which writing is tried again that has failed [s]."""
_MAX_SESSIONS = 10
"""The number of ended sessions that are kept."""
_ABANDONED_S = 3600.0
"""Age of a folder without a snapshot that is deleted [s]."""
_JOIN_S = 30.0
"""How long closing waits for the last writing [s]."""
_RESTORE_S = 300.0
"""Timeout of giving restored bodies their states [s]."""
_FOLDER = "autosave"
_OWNER = "owner"
"""The file that the process locks whose session it is."""
_TOPIC = "autosave"
_UNCHANGING = {"question", "highlight", "skill"}
"""Kinds of reports after which the world is as before."""
_JOURNALED = (Attach, BodyEdit, Delete, Detach, SetPoses)
"""Edits that their JSON describes completely."""
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


T = TypeVar("T", bound=msgspec.Struct)


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


class _Taken(NamedTuple):
    """What the engine thread takes for a snapshot."""

    present: World
    spawned: tuple[World, ...]
    geometry: GeometryMap
    knowledge: KnowledgeBase
    poses: np.ndarray
    waiting: int
    """The number of edits that are older."""


class _Store:
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

    def write_snapshot(self, taken: _Taken, steps: tuple[str, ...], knowledge: bytes) -> None:
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

    def forget(self) -> None:
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


class Autosave:
    """Saves what is edited, in a thread of its own, and offers what an earlier process has saved; see the module."""

    interval_s = 1.0

    def __init__(self, simulation: Simulation, channel: RpcChannel, *, is_unsaved: Callable[[], bool]) -> None:
        """Starts; nothing is written before the first edit.

        Args:
            simulation: the simulation.
            channel: the channel of the pages; they are asked whether to restore what is offered.
            is_unsaved: whether there is anything that was not saved as a map.
        """
        self._simulation, self._channel, self._is_unsaved = simulation, channel, is_unsaved
        self._version = simulation.edits.version
        """The history whose world need not be saved."""
        self._edits: deque[Edit] = deque()
        self._is_due = False
        """Whether a snapshot is needed, since the journal does not describe what has happened."""
        self._is_stated = False
        """Whether a statement was added or removed."""
        self._known: WeakSet[KnowledgeBase] = WeakSet()
        self._knowledge = b""
        self._last: _Taken | None = None
        self._last_s = self._failed_s = float("-inf")
        self._error = ""
        self._offer: SavedSession | None = None
        self._offered = ExitStack()
        """Holds the lock of the folder that is offered."""
        self._lock = threading.RLock()
        self._closing = threading.Event()
        worlds = simulation.worlds
        self._store = _Store(worlds[0].iri if worlds else Iri(""))
        channel.register("autosave.restore", EmptyRequest, self._restore, FILE, queue="files")
        channel.register("autosave.discard", EmptyRequest, self._discard, FILE, queue="files")
        self._watch(simulation.knowledge)
        self._publish()
        self._remove = simulation.observers.add(self)
        self._thread = threading.Thread(target=self._run, name="mindstage-autosave", daemon=True)
        self._thread.start()

    def forget(self) -> None:
        """Deletes what was saved since all of it is in a file of the user now."""
        with self._lock:
            self._edits.clear()
            self._version, self._last = self._simulation.edits.version, None
            self._is_due = self._is_stated = False
            self._store.forget()

    def close(self) -> None:
        """Writes what is left; deletes it if nothing is unsaved."""
        self._closing.set()
        self._thread.join(timeout=_JOIN_S)
        self._remove()
        with self._lock:
            if self._is_unsaved():
                self._store.close()
            else:
                self._store.forget()
            self._offered.close()

    # -- observing, in any thread --------------------------------------------------------------------------------------

    def on_state(self, state: StateSnapshot, engine: Engine, *, edited: bool, rebuild_pending: bool) -> None:
        """See `SimulationObserver`."""

    def on_edit(self, kind: str, *, client: str, ids: Iterable[BodyId], details: Mapping[str, Any]) -> None:
        """See `SimulationObserver`."""
        edits = details.get("edits") or ([details["edit"]] if "edit" in details else ())
        if edits and all(isinstance(each, _JOURNALED) for each in edits):
            self._edits.extend(edits)
        elif kind not in _UNCHANGING:
            self._is_due = True

    # -- in the thread -------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        self._find_offer()
        while not self._closing.wait(_POLL_S):
            self._try_to_save()
        self._failed_s = float("-inf")
        self._try_to_save()

    def _try_to_save(self) -> None:
        if time.monotonic() < self._failed_s + _RETRY_S:
            return
        try:
            with self._lock:
                self._save()
        except (MindstageError, OSError) as error:
            self._failed_s = time.monotonic()
            if str(error) != self._error:
                _log.warning("edits could not be saved automatically: %s", error)
            self._set_error(str(error))
        else:
            self._set_error("")

    def _set_error(self, text: str) -> None:
        if text != self._error:
            self._error = text
            self._publish()

    def _save(self) -> None:
        simulation, last = self._simulation, self._last
        if last is None and simulation.edits.version == self._version and not self._is_stated:
            self._edits.clear()  # nothing of it is a step of the history
            self._is_due = False
            return
        is_late = time.monotonic() > self._last_s + _SNAPSHOT_S
        if last is None or self._is_due or (is_late and not np.array_equal(last.poses, simulation.state.poses)):
            self._save_snapshot()
            return
        edits = [self._edits.popleft() for _ in range(len(self._edits))]
        try:
            self._store.append(edits)
        except OSError:
            self._is_due = True  # these edits are not in the journal
            raise

    def _save_snapshot(self) -> None:
        simulation = self._simulation

        def take(engine: Engine) -> _Taken:
            self._is_due = False
            return _Taken(
                engine.snapshot(),
                simulation.worlds,
                dict(simulation.geometry),
                simulation.knowledge,
                np.array(engine.poses()[1]),
                len(self._edits),
            )

        taken = simulation.engine.run(take, label="autosave")
        try:
            # Steps first: they may be newer than the world, which is written again then.
            self._store.write_snapshot(taken, simulation.edits.history.undo[::-1], self._knowledge_of(taken.knowledge))
        except BaseException:
            self._is_due = True
            raise
        for _ in range(taken.waiting):
            self._edits.popleft()
        self._last, self._last_s = taken, time.monotonic()

    def _knowledge_of(self, knowledge: KnowledgeBase) -> bytes:
        """The statements as bytes, made again only if they have changed."""
        if self._watch(knowledge) or (self._last is not None and self._last.knowledge is not knowledge):
            self._knowledge = b""
        if not self._knowledge:
            self._knowledge = knowledge.to_bytes()
        return self._knowledge

    def _watch(self, knowledge: KnowledgeBase) -> bool:
        """Whether a knowledge base is new; its changes are noticed from now on."""
        if knowledge in self._known:
            return False
        self._known.add(knowledge)
        knowledge.on_change(lambda _: self._on_statements())
        return True

    def _on_statements(self) -> None:
        self._knowledge, self._is_due, self._is_stated = b"", True, True

    # -- the offer -----------------------------------------------------------------------------------------------------

    def _find_offer(self) -> None:
        """Takes the newest session of the same map whose process has ended, and deletes the oldest ones."""
        folders = sorted(cache_dir(_FOLDER).iterdir(), key=_modified_s, reverse=True)
        ended = 0
        for folder in folders:
            with ExitStack() as stack, suppress(OSError):
                stack.enter_context(file_lock(folder / _OWNER, timeout_s=0.0))
                ended += 1
                if not any(folder.glob("snapshot-*.zst")):
                    if time.time() - _modified_s(folder) > _ABANDONED_S:
                        shutil.rmtree(folder, ignore_errors=True)
                elif ended > _MAX_SESSIONS:
                    shutil.rmtree(folder, ignore_errors=True)
                elif self._offer is None:
                    self._take_offer(folder, stack)
        self._publish()

    def _take_offer(self, folder: Path, lock: ExitStack) -> None:
        try:
            session = SavedSession(folder)
        except ValueError as error:
            _log.warning("%s", error)
            return
        if session.origin == self._store.origin:
            self._offered = lock.pop_all()
            self._offer = session

    def _publish(self) -> None:
        offer = None if self._offer is None else self._offer.describe()
        self._channel.publish(_TOPIC, {"offer": offer, "error": self._error})

    def _taken_offer(self) -> SavedSession:
        with self._lock:
            if self._offer is None:
                raise InvalidArgumentError("the saved edits", cause="another window has restored or discarded them")
            offer, self._offer = self._offer, None
        self._publish()
        return offer

    def _restore(self, session: ClientSession, _: EmptyRequest) -> dict[str, object]:
        offer = self._taken_offer()
        try:
            with as_client(CLIENT, trusted=True):  # the meshes that the world names were granted before
                notes = offer.restore(self._simulation)
            with self._lock:
                self._save_snapshot()
        except BaseException:
            with self._lock:
                self._offer = offer
            self._publish()
            raise
        self._delete(offer)
        text = f"restored the unsaved edits of {offer.describe()['name']}; Undo brings back the world before"
        self._channel.tell_others(session, text)
        return {**offer.describe(), "notes": notes}

    def _discard(self, session: ClientSession, _: EmptyRequest) -> None:
        offer = self._taken_offer()
        self._delete(offer)
        self._channel.tell_others(session, f"discarded the unsaved edits of {offer.describe()['name']}")

    def _delete(self, offer: SavedSession) -> None:
        shutil.rmtree(offer.folder, ignore_errors=True)
        self._offered.close()


def _modified_s(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:  # deleted meanwhile
        return 0.0
