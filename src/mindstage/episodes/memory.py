"""Many episodes as one memory: a folder of episode files, with an index of what happened in them.

The index is an SQLite database with the events, things and classes of each file. A question about events reads nothing
else, and one about the state at a time opens the one file that it is about. Each episode has a digest of its rows,
which is checked when the index is opened; an index that something else has changed is refused. A file is indexed when
the memory is opened and the index does not have it, or has it with another content; a file that cannot be read is
listed by `problems`.
"""

from __future__ import annotations

import hashlib
import os
import sqlite3
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import RLock
from typing import Any, NamedTuple, Self
from urllib.parse import quote, unquote_to_bytes

import msgspec

from mindstage.episodes.history import EpisodeHistory, open_episode
from mindstage.errors import (
    EpisodeError,
    EpisodeFileError,
    InvalidArgumentError,
    MindstageError,
    without_surrogates,
)
from mindstage.knowledge.history import EventFilter, PastEvent, WorldState
from mindstage.ranges import Index, checked
from mindstage.scene import Body, Iri
from mindstage.scene.display import counted

__all__ = ["EpisodeMemory", "MemoryProblem"]

INDEX_NAME = "episodes.index.sqlite"
_VERSION = 2
"""The version of the tables; an index of another version is made again."""
_LOCK_TIMEOUT_S = 30.0
"""Longest time for which another process may be writing to the index [s]."""
_OPEN_FILES = 4
_HASH_BLOCK_BYTES = 1 << 20
_MAX_VARIABLES = 500
"""Of one SQL statement; SQLite allows at least 999."""
_SCHEMA = """
create table episodes (
    number integer primary key, name text not null unique, size integer not null, modified_ns integer not null,
    digest blob not null, begin_s real, end_s real, start_unix_s real, problem text,
    rows_digest blob not null
);
create table events (
    episode integer not null references episodes on delete cascade, id text not null, kind text not null,
    begin_s real not null, end_s real, thing text not null, other text, agent text, joint text, amount real,
    evidence text not null
);
create table things (
    number integer primary key, iri text not null, id text not null, class text not null, unique (iri, id, class)
);
create table presence (
    episode integer not null references episodes on delete cascade, thing integer not null references things,
    primary key (episode, thing)
) without rowid;
create index events_by_kind on events (kind);
create index events_by_thing on events (thing, kind);
create index events_by_episode on events (episode);
create index things_by_id on things (id);
create index things_by_class on things (class);
create index presence_by_thing on presence (thing);
"""
_ROWS = (
    "select name, begin_s, end_s, start_unix_s, problem from episodes where number = ?",
    "select * from events where episode = ? order by rowid",
    "select things.* from presence join things on number = thing where episode = ? order by number",
)
"""What `rows_digest` is made of: all rows of an episode but those that only say whether its file has changed."""
_EVENT_COLUMNS = "id, kind, events.begin_s, events.end_s, thing, other, agent, joint, amount, evidence"


class MemoryProblem(NamedTuple):
    """A file of a memory that cannot be read."""

    path: Path
    cause: str


class EpisodeMemory:
    """The episodes of a folder, as a source for `KnowledgeBase.add_episode`.

    >>> with EpisodeMemory("runs") as memory:
    ...     knowledge.add_episode(memory)
    ...     knowledge.ask("occurs", "PickingUp")
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        index: str | os.PathLike[str] | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> None:
        """Opens a folder, and indexes the files that are new or have changed.

        Args:
            folder: the folder; files that end with .mcap, also in its subfolders, are episodes, whose names are their
                paths in the folder without this suffix.
            index: the file of the index, by default in the folder; in memory if the folder cannot be written to.
            progress: called with the number of files that were looked at, and the number of all files.

        Raises:
            InvalidArgumentError: there is no such folder.
            EpisodeFileError: the file of the index is something else, or damaged.
        """
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise InvalidArgumentError(str(folder), cause="it is no folder", remedy="give a folder of episode files")
        self.index = Path(index) if index is not None else self.folder / INDEX_NAME
        """The file of the index."""
        self._lock = RLock()
        self._open_files: OrderedDict[str, EpisodeHistory] = OrderedDict()
        self._database = self._connect()
        try:
            self._follow_files(progress, retried=True)
        except BaseException:
            self._database.close()
            raise

    def _connect(self) -> sqlite3.Connection:
        writable = os.access(self.index if self.index.exists() else self.index.parent, os.W_OK)
        database = sqlite3.connect(
            self.index if writable else ":memory:",
            check_same_thread=False,
            timeout=_LOCK_TIMEOUT_S,
            isolation_level=None,
        )
        try:
            with self._errors(), _transaction(database):
                (version,) = database.execute("pragma user_version").fetchone()
                if version != _VERSION:
                    tables = database.execute("select name from sqlite_master where type = 'table'").fetchall()
                    if version == 0 and tables:
                        raise EpisodeFileError(str(self.index), cause="it is a database of something else")
                    for (name,) in tables:
                        database.execute(f'drop table "{name}"')
                    for statement in (*_SCHEMA.split(";")[:-1], f"pragma user_version = {_VERSION}"):
                        database.execute(statement)
                _check_rows(database)
            database.execute("pragma foreign_keys = on")
        except BaseException:
            database.close()
            raise
        return database

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Names the index in errors of the database: it is locked, damaged, or no database."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if "locked" not in str(error):
                raise self._index_error(error) from error
            cause = f"another process has been writing to it for {_LOCK_TIMEOUT_S:g} s"
            raise EpisodeFileError(str(self.index), cause=cause, remedy="wait for it, or give another index") from error
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:  # the latter for names in a damaged schema
            raise self._index_error(error) from error

    def _index_error(self, error: Exception) -> EpisodeFileError:
        remedy = "remove it: it will be made again"
        return EpisodeFileError(str(self.index), cause=f"it is no index: {' '.join(str(error).split())}", remedy=remedy)

    def close(self) -> None:
        """Closes the index and the files; may be called repeatedly."""
        with self._lock:
            while self._open_files:
                _close(self._open_files.popitem()[1])
            self._database.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.folder}: {counted(len(self.names()), 'episode')}>"

    # -- the index -----------------------------------------------------------------------------------------------------

    def update(self, *, progress: Callable[[int, int], None] | None = None) -> int:
        """Indexes the files that are new or have changed, and forgets those that are gone.

        A file with the size and the time of modification that the index has is not read; one with the same content,
        such as a copy, is not indexed again. A file that could not be read is tried again when the memory is opened.
        Several processes may do this at the same time.

        Returns:
            The number of files that were indexed.

        Raises:
            EpisodeFileError: the index is damaged, or another process does not stop writing to it.
        """
        return self._follow_files(progress, retried=False)

    def _follow_files(self, progress: Callable[[int, int], None] | None, *, retried: bool) -> int:
        done = 0
        with self._lock, self._errors():
            rows = self._database.execute("select name, size, modified_ns, digest, problem from episodes")
            known: dict[str, tuple[int, int, bytes, str | None]] = {name: rest for name, *rest in rows}
            paths = {self._name(path): path for path in sorted(self.folder.rglob("*.mcap")) if path.is_file()}
            for at, (name, path) in enumerate(paths.items()):
                status = path.stat()
                stamp = status.st_size, status.st_mtime_ns
                size, modified_ns, digest, problem = known.get(name, (None, None, b"", None))
                if (size, modified_ns) != stamp or (retried and problem is not None):
                    now = _digest(path)
                    if now == digest and problem is None:
                        sql = "update episodes set modified_ns = ? where name = ?"
                        self._database.execute(sql, (status.st_mtime_ns, name))
                    else:
                        found = self._index(name, path, stamp, now)
                        done += now != digest or found != problem
                if progress is not None:
                    progress(at + 1, len(paths))
            gone = [(name,) for name in known.keys() - paths.keys()]
            if gone:
                with _transaction(self._database):
                    self._database.executemany("delete from episodes where name = ?", gone)
        return done

    def _name(self, path: Path) -> str:
        """The name of an episode; one that is not UTF-8 is percent-encoded."""
        name = path.relative_to(self.folder).with_suffix("").as_posix()
        return name if name == without_surrogates(name) else quote(os.fsencode(name))

    def _index(self, name: str, path: Path, stamp: tuple[int, int], digest: bytes) -> str | None:
        """Reads a file into the index; returns why it cannot be read."""
        self._drop(name)
        times: tuple[float | None, ...] = (None, None, None)
        things: list[tuple[str, ...]] = []
        events: list[tuple[object, ...]] = []
        problem = None
        try:
            history = open_episode(path, name=name)
            try:
                things = [(each.iri, each.id, each.cls) for each in history.bodies()]
                events = [_event_row(event) for event in history.events()]
                times = (history.begin_s, history.end_s, history.start_unix_s)
            finally:
                _close(history)
        except MindstageError as error:
            problem, things = str(error), []
        database = self._database
        with _transaction(database):
            database.execute("delete from episodes where name = ?", (name,))
            own = "name, size, modified_ns, digest, begin_s, end_s, start_unix_s, problem, rows_digest"
            values = (name, *stamp, digest, *times, problem, b"")
            columns = ", ".join("?" * len(values))
            number = database.execute(f"insert into episodes ({own}) values ({columns})", values).lastrowid
            assert number is not None, "a row was inserted"
            database.executemany("insert or ignore into things (iri, id, class) values (?, ?, ?)", things)
            present = "select ?, number from things where iri = ? and id = ? and class = ?"
            database.executemany(f"insert or ignore into presence {present}", [(number, *each) for each in things])
            columns = ", ".join("?" * 11)
            database.executemany(f"insert into events values ({columns})", [(number, *each) for each in events])
            digest = _rows_digest(database, number)
            database.execute("update episodes set rows_digest = ? where number = ?", (digest, number))
        return problem

    @property
    def problems(self) -> tuple[MemoryProblem, ...]:
        """The files that cannot be read."""
        rows = self._rows("select name, problem from episodes where problem is not null order by name")
        return tuple(MemoryProblem(self.path(name), problem) for name, problem in rows)

    def path(self, name: str) -> Path:
        """The file of an episode."""
        path = self.folder / f"{name}.mcap"
        return path if path.exists() else self.folder / os.fsdecode(unquote_to_bytes(f"{name}.mcap"))

    def _rows(self, sql: str, values: Sequence[object] = ()) -> list[tuple[Any, ...]]:
        with self._lock, self._errors():
            return self._database.execute(sql, values).fetchall()

    # -- as a source of episodes ---------------------------------------------------------------------------------------

    def names(self) -> Sequence[str]:
        """See `EpisodeSource`; the episodes that can be read, the first recorded first."""
        sql = "select name from episodes where problem is null order by start_unix_s, name"
        return [name for (name,) in self._rows(sql)]

    def history(self, name: str) -> _IndexedEpisode:
        """See `EpisodeSource`.

        Raises:
            EpisodeError: there is no such episode.
        """
        sql = "select number, begin_s, end_s, start_unix_s from episodes where name = ? and problem is null"
        found = self._rows(sql, (name,))
        if not found:
            raise EpisodeError(f"{self.folder} has no episode {name!r}")
        return _IndexedEpisode(self, name, *found[0])

    def find_events(self, wanted: EventFilter) -> Iterable[PastEvent]:
        """See `EpisodeSource`."""
        conditions, values = ["problem is null"], list[object]()
        for column, allowed in (("kind", wanted.kinds), ("thing", wanted.things)):
            if allowed is not None and len(allowed) <= _MAX_VARIABLES:
                conditions.append(f"{column} in ({', '.join('?' * len(allowed))})")
                values += sorted(allowed)
        if wanted.episode is not None:
            conditions.append("name = ?")
            values.append(wanted.episode)
        if wanted.begin_s is not None:
            conditions.append("(events.end_s is null or events.end_s >= ?)")
            values.append(wanted.begin_s)
        if wanted.end_s is not None:
            conditions.append("events.begin_s <= ?")
            values.append(wanted.end_s)
        sql = (
            f"select name, episodes.end_s, {_EVENT_COLUMNS} from events join episodes on number = episode "
            f"where {' and '.join(conditions)} order by start_unix_s, name, events.begin_s, events.rowid"
        )
        found = (_event(*row) for row in self._rows(sql, values))
        return (event for event in found if wanted.accepts(event))

    def find_individual(self, name: str) -> Iri | None:
        """See `EpisodeSource`."""
        present = "exists (select 1 from presence where thing = number)"
        sql = (
            f"select iri from things where iri = ? and {present} "
            f"union select iri from things where id = ? and {present}"
        )
        found = self._rows(sql, (name, name))
        return Iri(found[0][0]) if found else None

    def individuals_of(self, classes: Collection[Iri]) -> Sequence[Iri]:
        """See `EpisodeSource`."""
        found: dict[Iri, None] = {}
        listed = sorted(classes)
        for at in range(0, len(listed), _MAX_VARIABLES):
            part = listed[at : at + _MAX_VARIABLES]
            sql = (
                f"select distinct iri from things where class in ({', '.join('?' * len(part))}) "
                "and exists (select 1 from presence where thing = number) order by iri"
            )
            found |= {Iri(iri): None for (iri,) in self._rows(sql, part)}
        return tuple(found)

    @checked
    def individuals(self, number: Index) -> Mapping[str, Iri]:
        """See `History`; of the episode with a number in the index."""
        rows = self._rows("select id, iri from presence join things on number = thing where episode = ?", (number,))
        return {name: Iri(iri) for id, iri in rows for name in (id, iri)}

    # -- files ---------------------------------------------------------------------------------------------------------

    def opened(self, name: str) -> EpisodeHistory:
        """An episode, read from its file; the latest ones stay open.

        Raises:
            EpisodeFileError: it can no longer be read.
        """
        with self._lock:
            if name in self._open_files:
                self._open_files.move_to_end(name)
                return self._open_files[name]
            while len(self._open_files) >= _OPEN_FILES:
                self._drop(next(iter(self._open_files)))
            self._open_files[name] = open_episode(self.path(name), name=name)
            return self._open_files[name]

    def _drop(self, name: str) -> None:
        if (history := self._open_files.pop(name, None)) is not None:
            _close(history)


class _IndexedEpisode:
    """The `History` of a file in the index; the file is opened only for its states."""

    def __init__(
        self, memory: EpisodeMemory, name: str, number: int, begin_s: float, end_s: float, start_unix_s: float | None
    ) -> None:
        self.name, self.begin_s, self.end_s, self.start_unix_s = name, begin_s, end_s, start_unix_s
        self._memory, self._number = memory, number

    def __eq__(self, other: object) -> bool:
        key = (self._memory, self._number, self.name)
        return isinstance(other, _IndexedEpisode) and key == (other._memory, other._number, other.name)

    def __hash__(self) -> int:
        return hash((self._memory, self._number))

    def state_at(self, time_s: float) -> WorldState:
        """See `History`."""
        return self._memory.opened(self.name).state_at(time_s)

    def states(self, begin_s: float | None = None, end_s: float | None = None) -> Iterator[tuple[float, WorldState]]:
        """See `History`."""
        return self._memory.opened(self.name).states(begin_s, end_s)

    def events(self) -> Sequence[PastEvent]:
        """See `History`."""
        return tuple(self._memory.find_events(EventFilter(episode=self.name)))

    def edits(self) -> Sequence[tuple[float, str, str, tuple[Iri, ...]]]:
        """See `History`."""
        return self._memory.opened(self.name).edits()

    def individuals(self) -> Mapping[str, Iri]:
        """See `History`."""
        return self._memory.individuals(self._number)

    def bodies(self) -> Sequence[Body]:
        """See `History`."""
        return self._memory.opened(self.name).bodies()

    def resume(self, time_s: float) -> Any:
        """See `History`."""
        return self._memory.opened(self.name).resume(time_s)


def _close(history: EpisodeHistory) -> None:
    with suppress(MindstageError):
        history.close()


def _digest(path: Path) -> bytes:
    made = hashlib.blake2b(digest_size=16)
    with path.open("rb") as file:
        while block := file.read(_HASH_BLOCK_BYTES):
            made.update(block)
    return made.digest()


def _rows_digest(database: sqlite3.Connection, number: int) -> bytes:
    """The digest of what the index says of an episode, as it is read from there."""
    rows = [database.execute(sql, (number,)).fetchall() for sql in _ROWS]
    return hashlib.blake2b(msgspec.msgpack.encode(rows), digest_size=16).digest()


def _check_rows(database: sqlite3.Connection) -> None:
    """Raises `sqlite3.DatabaseError` if a row is not as it was written, or is missing in an index of the database."""
    (report,) = database.execute("pragma integrity_check(1)").fetchone()
    if report != "ok":
        raise sqlite3.DatabaseError(report)
    for number, name, digest in database.execute("select number, name, rows_digest from episodes").fetchall():
        if _rows_digest(database, number) != digest:
            raise sqlite3.DatabaseError(f"the rows of episode {name!r} are not those that were written")


@contextmanager
def _transaction(database: sqlite3.Connection) -> Iterator[None]:
    """Locks a database for writing, and writes all that is done in the `with` block, or nothing."""
    database.execute("begin immediate")
    try:
        yield
    except BaseException:
        database.rollback()
        raise
    database.commit()


def _event_row(event: PastEvent) -> tuple[object, ...]:
    evidence = msgspec.json.encode(event.evidence).decode()
    own = (event.id, event.kind, event.begin_s, event.end_s, event.thing, event.other, event.agent, event.joint)
    return (*own, event.amount, evidence)


def _event(
    episode: str,
    episode_end_s: float,
    id: str,
    kind: str,
    begin_s: float,
    end_s: float | None,
    thing: str,
    other: str | None,
    agent: str | None,
    joint: str | None,
    amount: float | None,
    evidence: str,
) -> PastEvent:
    return PastEvent(
        episode=episode,
        episode_end_s=episode_end_s,
        id=id,
        kind=kind,
        begin_s=begin_s,
        end_s=end_s,
        thing=Iri(thing),
        other=None if other is None else Iri(other),
        agent=agent,
        joint=None if joint is None else Iri(joint),
        amount=amount,
        evidence=() if evidence == "[]" else msgspec.json.decode(evidence, type=tuple[str, ...]),
    )
