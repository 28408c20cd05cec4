"""The folder of a persistent knowledge base.

    FOLDER/
      mindstage.json   the manifest: what is loaded; always replaced as a whole
      triples/         the triple store
      texts/           the text of each source, by its hash, from which worlds are read
      index.*          what questions need, see `store_index`

The field `whole` of the manifest is false during a change: if the process dies meanwhile, the folder is recognized as
incomplete.
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
from mindstage.knowledge.store import OxigraphStore
from mindstage.knowledge.store_index import IndexFile
from mindstage.maps.dialects.conventions import Assumption, UnitConventions
from mindstage.maps.io.files import Source, SourceFile, SourceHeader
from mindstage.rdf.graphs import Finding, QuadSource

__all__ = ["FORMAT_VERSION", "SourceArchive", "SourceRecord", "StoreDirectory", "StoreManifest"]

FORMAT_VERSION = 3
_MANIFEST, _TRIPLES, _TEXTS = "mindstage.json", "triples", "texts"
_RECREATE_HINT = "delete the folder and load the sources into it again"


class SourceRecord(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
):
    """A source in the state in which it was loaded."""

    path: str
    format: str
    """Its media type."""
    content_hash: str = ""
    """The hash of the parsed text, which is also the name of the stored text."""
    file_hash: str = ""
    """The hash of the file."""
    size: int = 0
    modified_ns: int = 0
    is_map: bool = False
    is_explicit: bool = False
    graph: str = ""
    """The name of its graph; empty for the URL of the file, as in folders of version 1."""
    ontology: str = ""
    prefixes: dict[str, str] = {}

    def of(self, source: Source) -> SourceRecord:
        """The same text as this source."""
        return replace(
            self,
            is_map=source.is_map,
            is_explicit=source.is_explicit,
            graph=source.graph.value if isinstance(source.graph, ox.NamedNode) else "",
            ontology=source.header.ontology,
            prefixes=dict(source.header.prefixes),
        )

    def source(
        self, graph: ox.NamedNode | ox.DefaultGraph, store: QuadSource, load_text: Callable[[], SourceFile]
    ) -> Source:
        """The source, with its statements in a graph of a store."""
        header = SourceHeader(self.ontology, self.prefixes)
        return Source(self.path, graph, store, load_text, self.is_map, self.is_explicit, header)


class StoreManifest(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
):
    """The contents of a folder."""

    format_version: int = FORMAT_VERSION
    complete: bool = True
    bundled_ontology: str | None = None
    """The path of the bundled ontology; None for a knowledge base without it."""
    packages: tuple[str, ...] = ()
    urdf: tuple[str, ...] = ()
    """The robot descriptions that maps were read with."""
    sources: tuple[SourceRecord, ...] = ()
    conventions: dict[str, UnitConventions] = {}
    assumptions: tuple[Assumption, ...] = ()
    findings: tuple[Finding, ...] = ()


class SourceArchive(msgspec.Struct, frozen=True, kw_only=True):
    """All sources with their texts, and all statements."""

    manifest: StoreManifest
    texts: tuple[bytes, ...]
    """One for each source of the manifest."""
    statements: bytes
    """N-Quads."""


class StoreDirectory:
    """An open folder, used by this process exclusively."""

    def __init__(self, folder: Path) -> None:
        """Opens or creates a folder.

        Raises:
            StoreError: the folder is not a store, of a newer format, incomplete, or used by another process.
        """
        self.path = folder
        self.is_new = not (folder / _MANIFEST).exists()
        if self.is_new:
            self._create()
        self.read_only = not os.access(folder, os.W_OK)
        self.manifest = self._read_manifest()
        self.index = IndexFile(folder, folder / _TRIPLES, read_only=self.read_only)
        self.store = self._open_store()
        self.index.on_opened()
        if not self.manifest.complete and not self.is_new:
            self.store.close()
            raise StoreError(
                str(folder), cause="it is half-written: a process died while filling it", remedy=_RECREATE_HINT
            )
        self._records = {record.path: record for record in self.manifest.sources}
        self._unsynchronized: list[Path] = []
        self.store.before_write = self.index.invalidate

    # -- sources -------------------------------------------------------------------------------------------------------

    def sources(self) -> dict[Path, Source]:
        """The loaded sources; their texts are read on demand."""
        return {
            Path(record.path): record.source(
                ox.NamedNode(record.graph or Path(record.path).as_uri()), self.store, self._text_loader(record)
            )
            for record in self.manifest.sources
        }

    def changed_sources(self) -> list[Path]:
        """Sources whose files have changed; deleted files do not count."""
        return [Path(record.path) for record in self.manifest.sources if _has_changed(record)]

    def contains_version_of(self, path: Path) -> bool:
        """Whether a source has the same content as a file."""
        file_hash = sha256(path.read_bytes()).hexdigest()
        return any(record.file_hash == file_hash for record in self.manifest.sources)

    # -- changes -------------------------------------------------------------------------------------------------------

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Marks the folder as incomplete until `commit`; restores the manifest after an error.

        Raises:
            StoreError: the folder is read-only.
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
        """Checks that the folder can be written.

        Raises:
            StoreError: the folder is read-only.
        """
        if self.read_only:
            raise StoreError(str(self.path), cause="it is read-only", remedy="copy it, and use the copy")

    def store_text(self, file: SourceFile) -> Callable[[], SourceFile]:
        """Stores the text of a source, and returns a function that reads it."""
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
            atomic_write(path, file.data)
            self._unsynchronized.append(path)
        self._records[record.path] = record
        return self._text_loader(record)

    def commit(self, manifest: StoreManifest, sources: Iterable[Source]) -> None:
        """Writes the manifest with these sources, which completes a transaction."""
        records = tuple(self._records[source.name].of(source) for source in sources)
        manifest = replace(manifest, format_version=FORMAT_VERSION, sources=records)
        if manifest != self.manifest:
            self._synchronize_texts()
            self.store.flush()
            self._write_manifest(manifest)
            self._delete_unused_texts()

    def close(self) -> None:
        """Closes the folder. May be called repeatedly."""
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
            for copy in self.path.glob(f"{_TRIPLES}-*-*"):  # left by a process that was killed
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
            if version != FORMAT_VERSION:
                cause = f"it has format version {version}, and this version of Mindstage reads {FORMAT_VERSION}"
                remedy = "use a newer Mindstage" if version > FORMAT_VERSION else _RECREATE_HINT
                raise StoreError(str(self.path), cause=cause, remedy=remedy)
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
            raise StoreError(str(self.path), cause=f"its format {record.format} is unknown", remedy=_RECREATE_HINT)

        def read() -> SourceFile:
            try:
                return SourceFile(Path(record.path), (self.path / _TEXTS / record.content_hash).read_bytes(), format)
            except OSError as error:
                raise self._os_error(error) from error

        return read

    def _synchronize_texts(self) -> None:
        """Makes the new texts survive a power failure; together, since each would wait for the disk by itself."""
        paths, self._unsynchronized = self._unsynchronized, []
        for path in (*paths, *([self.path / _TEXTS] if paths and hasattr(os, "O_DIRECTORY") else [])):
            descriptor = os.open(path, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)

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
        return False  # the file is gone; the stored text is used


class _ManifestVersion(msgspec.Struct):
    format_version: int
