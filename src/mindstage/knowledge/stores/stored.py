"""Stored knowledge: a folder that keeps what a knowledge base has loaded and been told, from one process to the next.

    FOLDER/
      mindstage.json   what was loaded, when it was last whole; written anew, never into
      triples/         the statements
      texts/           each source to the letter, by its hash: worlds are read from these

The word `whole` in the first is taken away before anything changes and put back after: a process that dies in between
leaves a folder that says so.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path

import msgspec
import pyoxigraph as ox
from msgspec.structs import replace

from mindstage.errors import StoreUnusable
from mindstage.files import atomic_write
from mindstage.knowledge.findings import Finding
from mindstage.knowledge.reading.assumptions import Assumption
from mindstage.knowledge.reading.conventions import Conventions
from mindstage.knowledge.sources.files import SourceFile
from mindstage.knowledge.sources.source import Source
from mindstage.knowledge.stores.localstore import LocalStore

__all__ = ["FORMAT_VERSION", "Record", "StoreContents", "StoreFolder"]

FORMAT_VERSION = 1
_CONTENTS, _TRIPLES, _TEXTS = "mindstage.json", "triples", "texts"
_ANEW = "delete the folder and load the sources into it again"


class Record(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One source, as it was when it was loaded."""

    path: str
    format: str
    """Its media type."""
    text: str
    """The hash of what was parsed, which names the text."""
    hash: str
    """Of the file itself."""
    size: int
    modified_ns: int
    asked_for: bool = False
    given: bool = False


class StoreContents(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a folder holds."""

    format_version: int = FORMAT_VERSION
    whole: bool = True
    bundled: str | None = None
    """Where the bundled ontology lay; None for a knowledge base without it."""
    packages: tuple[str, ...] = ()
    robots: tuple[str, ...] = ()
    """Descriptions that maps were read with."""
    sources: tuple[Record, ...] = ()
    conventions: dict[str, Conventions] = {}
    assumptions: tuple[Assumption, ...] = ()
    findings: tuple[Finding, ...] = ()


class StoreFolder:
    """One folder, held by this process alone as long as it is open."""

    def __init__(self, folder: Path) -> None:
        """Opens a folder, or makes it.

        Raises:
            StoreUnusable: it is no such folder, of a newer format, half-written, or held by another process.
        """
        self.path = folder
        self.is_new = not (folder / _CONTENTS).exists()
        if self.is_new:
            self._make()
        self.read_only = not os.access(folder, os.W_OK)
        self.contents = self._read()
        self.store = self._open()
        if not self.contents.whole and not self.is_new:
            self.store.close()
            raise StoreUnusable(str(folder), cause="it is half-written: a process died while filling it", remedy=_ANEW)
        self._records = {record.path: record for record in self.contents.sources}

    # -- what it holds -------------------------------------------------------------------------------------------------

    def sources(self) -> dict[Path, Source]:
        """What was loaded, without parsing any of it."""
        return {
            Path(record.path): Source(
                name=record.path,
                graph=ox.NamedNode(Path(record.path).as_uri()),
                store=self.store,
                read=self._reader(record),
                asked_for=record.asked_for,
                given=record.given,
            )
            for record in self.contents.sources
        }

    def changed(self) -> list[Path]:
        """Sources whose files say something else now; one that is gone has not changed."""
        return [Path(record.path) for record in self.contents.sources if _has_changed(record)]

    def has(self, path: Path) -> bool:
        """Whether some source says just what a file says."""
        told = sha256(path.read_bytes()).hexdigest()
        return any(record.hash == told for record in self.contents.sources)

    # -- change --------------------------------------------------------------------------------------------------------

    @contextmanager
    def changing(self) -> Iterator[None]:
        """The folder is not whole until somebody tells what it holds, or all is put back after an error.

        Raises:
            StoreUnusable: it can only be read.
        """
        self.check_writable()
        before = self.contents
        self._write(replace(before, whole=False))
        try:
            yield
        except BaseException:
            self._write(before)
            raise

    def check_writable(self) -> None:
        """Does nothing where it can be written.

        Raises:
            StoreUnusable: it can only be read.
        """
        if self.read_only:
            raise StoreUnusable(str(self.path), cause="it can only be read", remedy="copy it, and use the copy")

    def keep(self, file: SourceFile) -> Callable[[], SourceFile]:
        """Keeps a text, and says how to get it back."""
        state = file.path.stat()
        record = Record(
            path=str(file.path),
            format=file.format.media_type,
            text=sha256(file.data).hexdigest(),
            hash=sha256(file.path.read_bytes()).hexdigest(),
            size=state.st_size,
            modified_ns=state.st_mtime_ns,
        )
        path = self.path / _TEXTS / record.text
        if not path.exists():
            path.parent.mkdir(exist_ok=True)
            atomic_write(path, file.data, durable=True)
        self._records[record.path] = record
        return self._reader(record)

    def hold(self, contents: StoreContents, sources: Iterable[Source]) -> None:
        """Tells what the folder holds from now on, these sources among it."""
        told = ((self._records[source.name], source) for source in sources)
        records = (replace(record, asked_for=each.asked_for, given=each.given) for record, each in told)
        contents = replace(contents, sources=tuple(records))
        if contents != self.contents:
            self.store.flush()
            self._write(contents)
            self._forget_texts()

    def close(self) -> None:
        """Lets go of the folder; any number of times."""
        self.store.close()

    # -- files ---------------------------------------------------------------------------------------------------------

    def _make(self) -> None:
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            if next(self.path.iterdir(), None) is not None:
                cause, remedy = "there are other files in it", "name a new folder, or one that a store was made in"
                raise StoreUnusable(str(self.path), cause=cause, remedy=remedy)
            self._write(StoreContents(whole=False))
        except (FileExistsError, NotADirectoryError) as error:
            raise StoreUnusable(str(self.path), cause="a file is in its place", remedy="name a new folder") from error
        except OSError as error:
            raise self._unusable(error) from error

    def _open(self) -> LocalStore:
        if not self.read_only:
            for copy in self.path.glob(f"{_TRIPLES}-as-asked-*"):  # of a process that was killed
                shutil.rmtree(copy, ignore_errors=True)
        try:
            return LocalStore(self.path / _TRIPLES, read_only=self.read_only)
        except OSError as error:
            if "lock" in str(error).lower():
                cause = "another process holds it"
                raise StoreUnusable(str(self.path), cause=cause, remedy="wait until that has ended") from error
            raise self._unusable(error) from error
        except RuntimeError as error:
            raise StoreUnusable(str(self.path), cause=str(error), remedy=_ANEW) from error

    def _read(self) -> StoreContents:
        try:
            data = (self.path / _CONTENTS).read_bytes()
            version = msgspec.json.decode(data, type=_Version).format_version
            if version > FORMAT_VERSION:
                cause = f"it is of format {version}, and this version knows {FORMAT_VERSION}"
                raise StoreUnusable(str(self.path), cause=cause, remedy="use a newer Mindstage")
            contents = msgspec.json.decode(data, type=StoreContents)
        except OSError as error:
            raise self._unusable(error) from error
        except msgspec.DecodeError as error:
            raise StoreUnusable(str(self.path), cause=f"{_CONTENTS}: {error}", remedy=_ANEW) from error
        return contents

    def _write(self, contents: StoreContents) -> None:
        contents_json = msgspec.json.format(msgspec.json.encode(contents), indent=1)
        atomic_write(self.path / _CONTENTS, contents_json, durable=True)
        self.contents = contents

    def _reader(self, record: Record) -> Callable[[], SourceFile]:
        format = ox.RdfFormat.from_media_type(record.format)
        if format is None:
            raise StoreUnusable(str(self.path), cause=f"nobody knows the format {record.format}", remedy=_ANEW)

        def read() -> SourceFile:
            try:
                return SourceFile(Path(record.path), (self.path / _TEXTS / record.text).read_bytes(), format)
            except OSError as error:
                raise self._unusable(error) from error

        return read

    def _forget_texts(self) -> None:
        needed = {record.text for record in self.contents.sources}
        for path in (self.path / _TEXTS).glob("*"):
            if path.name not in needed:
                path.unlink(missing_ok=True)

    def _unusable(self, error: OSError) -> StoreUnusable:
        return StoreUnusable(str(self.path), cause=error.strerror or str(error))


def _has_changed(record: Record) -> bool:
    try:
        state = Path(record.path).stat()
        if (state.st_size, state.st_mtime_ns) == (record.size, record.modified_ns):
            return False
        return sha256(Path(record.path).read_bytes()).hexdigest() != record.hash
    except OSError:
        return False  # what was kept is all there is


class _Version(msgspec.Struct):
    format_version: int
