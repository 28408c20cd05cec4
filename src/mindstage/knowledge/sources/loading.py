"""Loading: files and all that they import go into a store, each as a graph of its own, or none of them does."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path

import pyoxigraph as ox

from mindstage.errors import SourceParseError
from mindstage.knowledge.findings import Finding, Severity
from mindstage.knowledge.reading.assumptions import Assumption
from mindstage.knowledge.robots import ClassNameIndex, is_urdf
from mindstage.knowledge.sources.files import SUFFIXES, SourceFile, read_file
from mindstage.knowledge.sources.intake import preprocess, read_map_file
from mindstage.knowledge.sources.packages import RosPackagePath, file_from_iri
from mindstage.knowledge.sources.robot_sources import UrdfSources
from mindstage.knowledge.sources.source import Source
from mindstage.knowledge.stores.triplestore import TripleStore
from mindstage.knowledge.vocabulary import IMPORTS, ONTOLOGY, TYPE, VERSION_IRI

__all__ = ["LoadTransaction"]


def _keep_in_memory(file: SourceFile) -> Callable[[], SourceFile]:
    return lambda: file


@dataclass(slots=True)
class LoadTransaction:
    """One call to load, which either leads somewhere or leaves no trace."""

    store: TripleStore
    packages: RosPackagePath
    sources: dict[Path, Source]
    """All that is loaded, by resolved path; new ones join at the end. It is of no use after a failure."""
    store_text: Callable[[SourceFile], Callable[[], SourceFile]] = _keep_in_memory
    """Keeps a text, and says how to get it back."""
    urdf_paths: Iterable[Path] = ()
    """Of robots, whose links maps may name."""
    follow_imports: bool = True
    """Whether imports may name files that are not loaded yet."""
    findings: list[Finding] = field(default_factory=list)
    assumptions: list[Assumption] = field(default_factory=list)
    _unresolved_imports: list[tuple[Source, str]] = field(default_factory=list)

    def run(self, maps: Iterable[Path], ontologies: Iterable[Path]) -> None:
        """Loads files and everything that they import, each once.

        Raises:
            SourceParseError: one of the files cannot be read; the store is as it was.
        """
        self._run([*((path, True, True) for path in maps), *((path, False, True) for path in ontologies)])

    def reload(self, sources: Iterable[Source]) -> None:
        """Loads what was loaded once and taken out since.

        Raises:
            SourceParseError: one of the files cannot be read; the store is as it was.
        """
        self._run([(source.path, source.is_map, source.is_explicit) for source in sources])

    def _run(self, requested: Iterable[tuple[Path, bool, bool]]) -> None:
        before = self.sources.keys() | set()
        try:
            robots = self._load_urdfs()
            requested = [(path.resolve(), asked_for, given) for path, asked_for, given in requested]
            # A link is what its name says only where the classes are known, so robots come after the ontologies.
            late = [each for each in requested if each[1] and (robots.urdf_robots or is_urdf(each[0]))]
            for wave in ([each for each in requested if each not in late], late):
                known = self.sources.keys() | set()
                for path, asked_for, given in wave:
                    self._load(path, robots, is_map=asked_for, is_explicit=given)
                self._follow_imports(known)
            self.findings += robots.findings
            self.assumptions += robots.assumptions
        except BaseException:
            for path in self.sources.keys() - before:
                self.store.remove_graph(ox.NamedNode(path.as_uri()))
            raise
        missing = self._not_loaded({iri for _, iri in self._unresolved_imports})
        for importer, iri in self._unresolved_imports:
            if iri in missing:
                self._report_missing_import(
                    importer, iri, "which is not among the sources and in none of the given folders of packages"
                )

    def _load_urdfs(self) -> UrdfSources:
        robots = UrdfSources(self.packages, ClassNameIndex(self.store))
        for path in self.urdf_paths:
            robots.add(path.resolve())
        return robots

    def _load(
        self, path: Path, urdf_sources: UrdfSources | None = None, *, is_map: bool = False, is_explicit: bool = False
    ) -> None:
        if known := self.sources.get(path):
            is_map, is_explicit = known.is_map or is_map, known.is_explicit or is_explicit
            self.sources[path] = replace(known, is_map=is_map, is_explicit=is_explicit)
            return
        file = read_map_file(path, urdf_sources) if is_map and urdf_sources else read_file(path)
        graph = ox.NamedNode(file.iri)
        try:
            self._store_graph(file, graph)
        except SyntaxError as error:
            repaired = file.repair(error)
            file = self._load_repaired(
                preprocess(repaired, urdf_sources) if is_map and urdf_sources else repaired, graph
            )
        self.findings += file.findings()
        self.sources[path] = Source(str(path), graph, self.store, self.store_text(file), is_map, is_explicit)

    def _load_repaired(self, file: SourceFile, graph: ox.NamedNode) -> SourceFile:
        try:
            self._store_graph(file, graph)
        except SyntaxError as error:
            raise file.parse_error(error) from error
        return file

    def _store_graph(self, file: SourceFile, graph: ox.NamedNode) -> None:
        try:
            self.store.load(file.data, file.format, base_iri=file.iri, to_graph=graph)
        except MemoryError as error:
            cause = "it, or a single text in it, is too long to be held in memory"
            raise SourceParseError(str(file.path), cause=cause) from error

    def unreferenced(self) -> set[Path]:
        """Those that nobody gave and no other one imports any more."""
        needed = [path for path, source in self.sources.items() if source.is_explicit]
        for path in needed:
            found = (self._resolve_import(self.sources[path], iri) for iri in self.sources[path].imported_iris())
            needed += [path for path in found if path in self.sources and path not in needed]
        return self.sources.keys() - set(needed)

    # -- imports -------------------------------------------------------------------------------------------------------

    def _follow_imports(self, loaded: Collection[Path]) -> None:
        waiting = [source for path, source in self.sources.items() if path not in loaded]
        while waiting:
            importer = waiting.pop(0)
            for iri in importer.imported_iris():
                path = self._resolve_import(importer, iri)
                if path is None or path in self.sources:
                    continue
                try:
                    self._load(path)
                except SourceParseError as error:
                    self._report_missing_import(importer, iri, str(error), Severity.ERROR)
                else:
                    waiting.append(self.sources[path])

    def _resolve_import(self, importer: Source, iri: str) -> Path | None:
        """The file that an import names. Nothing is ever fetched: other schemes must be met by what is here."""
        path: Path | None = None
        if iri.startswith("package:"):
            try:
                path = self.packages.find(iri)
            except ValueError as error:
                self._report_missing_import(importer, iri, str(error), Severity.ERROR)
                return None
        elif iri.startswith("file:"):
            path = file_from_iri(iri, importer.path)
            if path is not None and path not in self.sources and path.suffix.lower() not in SUFFIXES:
                what = f"but the suffix {path.suffix!r} is that of no format that can be read"
                self._report_missing_import(importer, iri, what, Severity.ERROR)
                return None
        if path is not None and path in self.sources:
            return path
        if path is not None and not self.follow_imports:
            self._report_missing_import(importer, iri, "but imports of it are not followed", Severity.ERROR)
            return None
        if path is not None and path.is_file():
            return path
        self._unresolved_imports.append((importer, iri))
        return None

    def _not_loaded(self, iris: Collection[str]) -> set[str]:
        """Those imports that are not here under another name either: that of an ontology, or the end of a path."""
        if not iris:
            return set()
        paths = [path.as_posix() for path in self.sources]
        ontologies = self.store.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(ONTOLOGY))
        versions = self.store.quads_for_pattern(None, ox.NamedNode(VERSION_IRI), None)
        named = chain((quad.subject for quad in ontologies), (quad.object for quad in versions))
        names = {_without_trailing_separator(name.value) for name in named if isinstance(name, ox.NamedNode)}

        def is_here(iri: str) -> bool:
            tail = "/" + iri.removeprefix("package:").lstrip("/")
            return (
                any(path.endswith(tail) for path in paths)
                if iri.startswith("package:")
                else _without_trailing_separator(iri) in names
            )

        return {iri for iri in iris if not is_here(iri)}

    def _report_missing_import(
        self, importer: Source, iri: str, reason: str, severity: Severity = Severity.WARNING
    ) -> None:
        what, did = f"it imports {iri}, {reason}", "went on without it"
        self.findings.append(Finding(severity, importer.name, IMPORTS, what, did))


def _without_trailing_separator(iri: str) -> str:
    """Ontologies are imported with and without the mark that their names are split at."""
    return iri.rstrip("#/")
