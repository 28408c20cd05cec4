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

from mindstage.errors import StoreError
from mindstage.files import atomic_write
from mindstage.knowledge.dialects.conventions import Assumption, UnitConventions
from mindstage.knowledge.io.files import Source, SourceFile
from mindstage.knowledge.rdf import Finding
from mindstage.knowledge.store import OxigraphStore

__all__ = ["FORMAT_VERSION", "SourceRecord", "StoreDirectory", "StoreManifest"]

FORMAT_VERSION = 1
_MANIFEST, _TRIPLES, _TEXTS = "mindstage.json", "triples", "texts"
_RECREATE_HINT = "delete the folder and load the sources into it again"


class SourceRecord(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    rename={"content_hash": "text", "file_hash": "hash", "is_map": "asked_for", "is_explicit": "given"},
):
    """One source, as it was when it was loaded."""

    path: str
    format: str
    """Its media type."""
    content_hash: str
    """The hash of what was parsed, which names the text."""
    file_hash: str
    """Of the file itself."""
    size: int
    modified_ns: int
    is_map: bool = False
    is_explicit: bool = False


class StoreManifest(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    rename={"complete": "whole", "bundled_ontology": "bundled", "urdf_files": "robots"},
):
    """What a folder holds."""

    format_version: int = FORMAT_VERSION
    complete: bool = True
    bundled_ontology: str | None = None
    """Where the bundled ontology lay; None for a knowledge base without it."""
    packages: tuple[str, ...] = ()
    urdf_files: tuple[str, ...] = ()
    """Descriptions that maps were read with."""
    sources: tuple[SourceRecord, ...] = ()
    conventions: dict[str, UnitConventions] = {}
    assumptions: tuple[Assumption, ...] = ()
    findings: tuple[Finding, ...] = ()


class StoreDirectory:
    """One folder, held by this process alone as long as it is open."""

    def __init__(self, folder: Path) -> None:
        """Opens a folder, or makes it.

        Raises:
            StoreError: it is no such folder, of a newer format, half-written, or held by another process.
        """
        self.path = folder
        self.is_new = not (folder / _MANIFEST).exists()
        if self.is_new:
            self._create()
        self.read_only = not os.access(folder, os.W_OK)
        self.manifest = self._read_manifest()
        self.store = self._open_store()
        if not self.manifest.complete and not self.is_new:
            self.store.close()
            raise StoreError(
                str(folder), cause="it is half-written: a process died while filling it", remedy=_RECREATE_HINT
            )
        self._records = {record.path: record for record in self.manifest.sources}

    # -- what it holds -------------------------------------------------------------------------------------------------

    def sources(self) -> dict[Path, Source]:
        """What was loaded, without parsing any of it."""
        return {
            Path(record.path): Source(
                name=record.path,
                graph=ox.NamedNode(Path(record.path).as_uri()),
                store=self.store,
                load_text=self._text_loader(record),
                is_map=record.is_map,
                is_explicit=record.is_explicit,
            )
            for record in self.manifest.sources
        }

    def changed_sources(self) -> list[Path]:
        """Sources whose files say something else now; one that is gone has not changed."""
        return [Path(record.path) for record in self.manifest.sources if _has_changed(record)]

    def contains_version_of(self, path: Path) -> bool:
        """Whether some source says just what a file says."""
        told = sha256(path.read_bytes()).hexdigest()
        return any(record.file_hash == told for record in self.manifest.sources)

    # -- change --------------------------------------------------------------------------------------------------------

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """The folder is not whole until somebody tells what it holds, or all is put back after an error.

        Raises:
            StoreError: it can only be read.
        """
        self.check_writable()
        before = self.manifest
        self._write_manifest(replace(before, complete=False))
        try:
            yield
        except BaseException:
            self._write_manifest(before)
            raise

    def check_writable(self) -> None:
        """Does nothing where it can be written.

        Raises:
            StoreError: it can only be read.
        """
        if self.read_only:
            raise StoreError(str(self.path), cause="it can only be read", remedy="copy it, and use the copy")

    def store_text(self, file: SourceFile) -> Callable[[], SourceFile]:
        """Keeps a text, and says how to get it back."""
        state = file.path.stat()
        record = SourceRecord(
            path=str(file.path),
            format=file.format.media_type,
            content_hash=sha256(file.data).hexdigest(),
            file_hash=sha256(file.path.read_bytes()).hexdigest(),
            size=state.st_size,
            modified_ns=state.st_mtime_ns,
        )
        path = self.path / _TEXTS / record.content_hash
        if not path.exists():
            path.parent.mkdir(exist_ok=True)
            atomic_write(path, file.data, durable=True)
        self._records[record.path] = record
        return self._text_loader(record)

    def commit(self, manifest: StoreManifest, sources: Iterable[Source]) -> None:
        """Tells what the folder holds from now on, these sources among it."""
        told = ((self._records[source.name], source) for source in sources)
        records = (replace(record, is_map=each.is_map, is_explicit=each.is_explicit) for record, each in told)
        manifest = replace(manifest, sources=tuple(records))
        if manifest != self.manifest:
            self.store.flush()
            self._write_manifest(manifest)
            self._delete_unused_texts()

    def close(self) -> None:
        """Lets go of the folder; any number of times."""
        self.store.close()

    # -- files ---------------------------------------------------------------------------------------------------------

    def _create(self) -> None:
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            if next(self.path.iterdir(), None) is not None:
                cause, remedy = "there are other files in it", "name a new folder, or one that a store was made in"
                raise StoreError(str(self.path), cause=cause, remedy=remedy)
            self._write_manifest(StoreManifest(complete=False))
        except (FileExistsError, NotADirectoryError) as error:
            raise StoreError(str(self.path), cause="a file is in its place", remedy="name a new folder") from error
        except OSError as error:
            raise self._os_error(error) from error

    def _open_store(self) -> OxigraphStore:
        if not self.read_only:
            for copy in self.path.glob(f"{_TRIPLES}-as-asked-*"):  # of a process that was killed
                shutil.rmtree(copy, ignore_errors=True)
        try:
            return OxigraphStore(self.path / _TRIPLES, read_only=self.read_only)
        except OSError as error:
            if "lock" in str(error).lower():
                cause = "another process holds it"
                raise StoreError(str(self.path), cause=cause, remedy="wait until that has ended") from error
            raise self._os_error(error) from error
        except RuntimeError as error:
            raise StoreError(str(self.path), cause=str(error), remedy=_RECREATE_HINT) from error

    def _read_manifest(self) -> StoreManifest:
        try:
            data = (self.path / _MANIFEST).read_bytes()
            version = msgspec.json.decode(data, type=_ManifestVersion).format_version
            if version > FORMAT_VERSION:
                cause = f"it is of format {version}, and this version knows {FORMAT_VERSION}"
                raise StoreError(str(self.path), cause=cause, remedy="use a newer Mindstage")
            contents = msgspec.json.decode(data, type=StoreManifest)
        except OSError as error:
            raise self._os_error(error) from error
        except msgspec.DecodeError as error:
            raise StoreError(str(self.path), cause=f"{_MANIFEST}: {error}", remedy=_RECREATE_HINT) from error
        return contents

    def _write_manifest(self, manifest: StoreManifest) -> None:
        contents_json = msgspec.json.format(msgspec.json.encode(manifest), indent=1)
        atomic_write(self.path / _MANIFEST, contents_json, durable=True)
        self.manifest = manifest

    def _text_loader(self, record: SourceRecord) -> Callable[[], SourceFile]:
        format = ox.RdfFormat.from_media_type(record.format)
        if format is None:
            raise StoreError(str(self.path), cause=f"nobody knows the format {record.format}", remedy=_RECREATE_HINT)

        def read() -> SourceFile:
            try:
                return SourceFile(Path(record.path), (self.path / _TEXTS / record.content_hash).read_bytes(), format)
            except OSError as error:
                raise self._os_error(error) from error

        return read

    def _delete_unused_texts(self) -> None:
        needed = {record.content_hash for record in self.manifest.sources}
        for path in (self.path / _TEXTS).glob("*"):
            if path.name not in needed:
                path.unlink(missing_ok=True)

    def _os_error(self, error: OSError) -> StoreError:
        return StoreError(str(self.path), cause=error.strerror or str(error))


def _has_changed(record: SourceRecord) -> bool:
    try:
        state = Path(record.path).stat()
        if (state.st_size, state.st_mtime_ns) == (record.size, record.modified_ns):
            return False
        return sha256(Path(record.path).read_bytes()).hexdigest() != record.file_hash
    except OSError:
        return False  # what was kept is all there is


class _ManifestVersion(msgspec.Struct):
    format_version: int
