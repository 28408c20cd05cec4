"""Loading: files and all that they import go into a store, each as a graph of its own, or none of them does."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
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
    asked_for: bool
    """Whether it was named as a map, and not only imported or given as an ontology."""
    imports: tuple[str, ...]
    names: frozenset[str]
    """What its ontology is called; what others import under these names is here."""
    has_maps: bool
    has_sizes: bool


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
        for importer, iri in self._unmet:
            if not self._is_here(iri):
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
        self.sources[path] = self._source(file, graph, asked_for=asked_for)

    def _source(self, file: SourceFile, graph: ox.NamedNode, *, asked_for: bool) -> Source:
        def told(property: Iri, value: Iri | None = None) -> Iterator[ox.Quad]:
            node = None if value is None else ox.NamedNode(value)
            return self.store.quads_for_pattern(None, ox.NamedNode(property), node, graph)

        def any_told(property: Iri, value: Iri | None = None) -> bool:
            return next(told(property, value), None) is not None

        names = {quad.subject.value for quad in told(TYPE, ONTOLOGY) if isinstance(quad.subject, ox.NamedNode)}
        names |= {quad.object.value for quad in told(VERSION_IRI) if isinstance(quad.object, ox.NamedNode)}
        return Source(
            file,
            asked_for,
            imports=tuple(sorted(quad.object.value for quad in told(IMPORTS) if isinstance(quad.object, ox.NamedNode))),
            names=frozenset(map(_plain, names)),
            has_maps=any_told(DESCRIBED_IN_MAP) or any_told(TYPE, SEMANTIC_MAP),
            has_sizes=any(any_told(ON_PROPERTY, word.property) for word in SIZE),
        )

    # -- imports -------------------------------------------------------------------------------------------------------

    def _follow_imports(self, done: Collection[Path]) -> None:
        waiting = [source for path, source in self.sources.items() if path not in done]
        while waiting:
            importer = waiting.pop(0)
            for iri in importer.imports:
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

    def _is_here(self, iri: str) -> bool:
        if iri.startswith("package:"):
            tail = "/" + iri.removeprefix("package:").lstrip("/")
            return any(path.as_posix().endswith(tail) for path in self.sources)
        return any(_plain(iri) in source.names for source in self.sources.values())

    def _miss(self, importer: Source, iri: str, why: str, severity: Severity = Severity.WARNING) -> None:
        what, did = f"it imports {iri}, {why}", "went on without it"
        self.findings.append(Finding(severity, str(importer.file.path), IMPORTS, what, did))


def _plain(iri: str) -> str:
    """Ontologies are imported with and without the mark that their names are split at."""
    return iri.rstrip("#/")
