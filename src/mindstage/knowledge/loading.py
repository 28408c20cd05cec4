"""Loading: files and all that they import go into a store, each as a graph of its own, or none of them does."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path

import pyoxigraph as ox

from mindstage.errors import SourceUnreadable
from mindstage.knowledge.files import SourceFile, read_file
from mindstage.knowledge.findings import Finding, Severity
from mindstage.knowledge.packages import Packages, file_named
from mindstage.knowledge.vocabulary import (
    DESCRIBED_IN_MAP,
    IMPORTS,
    ON_PROPERTY,
    ONTOLOGY,
    SEMANTIC_MAP,
    TYPE,
    VERSION_IRI,
)
from mindstage.knowledge.words import SIZE
from mindstage.world import Iri

__all__ = ["Loading", "Source"]


@dataclass(frozen=True, slots=True)
class Source:
    """One file in the store."""

    file: SourceFile
    graph: ox.NamedNode
    store: ox.Store
    asked_for: bool
    """Whether it was named as a map, and not only imported or given as an ontology."""

    def imports(self) -> list[str]:
        """What it names as its imports, in one order."""
        told = self.store.quads_for_pattern(None, ox.NamedNode(IMPORTS), None, self.graph)
        return sorted(quad.object.value for quad in told if isinstance(quad.object, ox.NamedNode))

    def has_maps(self) -> bool:
        """Whether it tells of a map or of something in one."""
        return self._tells(DESCRIBED_IN_MAP) or self._tells(TYPE, SEMANTIC_MAP)

    def has_sizes(self) -> bool:
        """Whether it tells how large the things of some class are."""
        return any(self._tells(ON_PROPERTY, word.property) for word in SIZE)

    def _tells(self, property: Iri, value: Iri | None = None) -> bool:
        node = None if value is None else ox.NamedNode(value)
        told = self.store.quads_for_pattern(None, ox.NamedNode(property), node, self.graph)
        return next(told, None) is not None


@dataclass(slots=True)
class Loading:
    """One call to load, which either leads somewhere or leaves no trace."""

    store: ox.Store
    packages: Packages
    sources: dict[Path, Source]
    """All that is loaded, by resolved path; new ones join at the end. It is of no use after a failure."""
    findings: list[Finding] = field(default_factory=list)
    _unmet: list[tuple[Source, str]] = field(default_factory=list)

    def run(self, maps: Iterable[Path], ontologies: Iterable[Path]) -> None:
        """Loads files and everything that they import, each once.

        Raises:
            SourceUnreadable: one of the files cannot be read; the store is as it was.
        """
        before = self.sources.keys() | set()
        try:
            for path in maps:
                self._load(path.resolve(), asked_for=True)
            for path in ontologies:
                self._load(path.resolve(), asked_for=False)
            self._follow_imports(before)
        except BaseException:
            for path in self.sources.keys() - before:
                self.store.remove_graph(ox.NamedNode(path.as_uri()))
            raise
        missing = self._missing({iri for _, iri in self._unmet})
        for importer, iri in self._unmet:
            if iri in missing:
                self._miss(importer, iri, "which is not among the sources and in none of the given folders of packages")

    def _load(self, path: Path, *, asked_for: bool) -> None:
        if known := self.sources.get(path):
            self.sources[path] = replace(known, asked_for=known.asked_for or asked_for)
            return
        file = read_file(path)
        graph = ox.NamedNode(file.iri)
        try:
            self.store.load(file.data, file.format, base_iri=file.iri, to_graph=graph)
        except SyntaxError as error:
            raise file.unreadable(error) from error
        self.sources[path] = Source(file, graph, self.store, asked_for)

    # -- imports -------------------------------------------------------------------------------------------------------

    def _follow_imports(self, done: Collection[Path]) -> None:
        waiting = [source for path, source in self.sources.items() if path not in done]
        while waiting:
            importer = waiting.pop(0)
            for iri in importer.imports():
                path = self._locate(importer, iri)
                if path is None or path in self.sources:
                    continue
                try:
                    self._load(path, asked_for=False)
                except SourceUnreadable as error:
                    self._miss(importer, iri, str(error), Severity.ERROR)
                else:
                    waiting.append(self.sources[path])

    def _locate(self, importer: Source, iri: str) -> Path | None:
        """The file that an import names. Nothing is ever fetched: other schemes must be met by what is here."""
        path: Path | None = None
        if iri.startswith("package:"):
            try:
                path = self.packages.find(iri)
            except ValueError as error:
                self._miss(importer, iri, str(error), Severity.ERROR)
                return None
        elif iri.startswith("file:"):
            path = file_named(iri, importer.file.path)
        if path is not None and (path in self.sources or path.is_file()):
            return path
        self._unmet.append((importer, iri))
        return None

    def _missing(self, iris: Collection[str]) -> set[str]:
        """Those imports that are not here under another name either: that of an ontology, or the end of a path."""
        if not iris:
            return set()
        paths = [path.as_posix() for path in self.sources]
        ontologies = self.store.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(ONTOLOGY))
        versions = self.store.quads_for_pattern(None, ox.NamedNode(VERSION_IRI), None)
        named = chain((quad.subject for quad in ontologies), (quad.object for quad in versions))
        names = {_plain(name.value) for name in named if isinstance(name, ox.NamedNode)}

        def is_here(iri: str) -> bool:
            tail = "/" + iri.removeprefix("package:").lstrip("/")
            return any(path.endswith(tail) for path in paths) if iri.startswith("package:") else _plain(iri) in names

        return {iri for iri in iris if not is_here(iri)}

    def _miss(self, importer: Source, iri: str, why: str, severity: Severity = Severity.WARNING) -> None:
        what, did = f"it imports {iri}, {why}", "went on without it"
        self.findings.append(Finding(severity, str(importer.file.path), IMPORTS, what, did))


def _plain(iri: str) -> str:
    """Ontologies are imported with and without the mark that their names are split at."""
    return iri.rstrip("#/")
