"""Loading: files and all that they import go into a store, each as a graph of its own, or none of them does."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path

import pyoxigraph as ox

from mindstage.errors import SourceUnreadable
from mindstage.knowledge.findings import Finding, Severity
from mindstage.knowledge.reading.assumptions import Assumption
from mindstage.knowledge.robots import ClassNames, looks_like_robot
from mindstage.knowledge.sources.files import SUFFIXES, SourceFile, read_file
from mindstage.knowledge.sources.intake import read_map_file, taken_in
from mindstage.knowledge.sources.packages import Packages, file_named
from mindstage.knowledge.sources.robot_sources import RobotSources
from mindstage.knowledge.sources.source import Source
from mindstage.knowledge.stores.triplestore import TripleStore
from mindstage.knowledge.vocabulary import IMPORTS, ONTOLOGY, TYPE, VERSION_IRI

__all__ = ["Loading"]


def _kept_in_memory(file: SourceFile) -> Callable[[], SourceFile]:
    return lambda: file


@dataclass(slots=True)
class Loading:
    """One call to load, which either leads somewhere or leaves no trace."""

    store: TripleStore
    packages: Packages
    sources: dict[Path, Source]
    """All that is loaded, by resolved path; new ones join at the end. It is of no use after a failure."""
    keep: Callable[[SourceFile], Callable[[], SourceFile]] = _kept_in_memory
    """Keeps a text, and says how to get it back."""
    descriptions: Iterable[Path] = ()
    """Of robots, whose links maps may name."""
    follows: bool = True
    """Whether imports may name files that are not loaded yet."""
    findings: list[Finding] = field(default_factory=list)
    assumptions: list[Assumption] = field(default_factory=list)
    _unmet: list[tuple[Source, str]] = field(default_factory=list)

    def run(self, maps: Iterable[Path], ontologies: Iterable[Path]) -> None:
        """Loads files and everything that they import, each once.

        Raises:
            SourceUnreadable: one of the files cannot be read; the store is as it was.
        """
        self._run([*((path, True, True) for path in maps), *((path, False, True) for path in ontologies)])

    def run_again(self, sources: Iterable[Source]) -> None:
        """Loads what was loaded once and taken out since.

        Raises:
            SourceUnreadable: one of the files cannot be read; the store is as it was.
        """
        self._run([(source.path, source.asked_for, source.given) for source in sources])

    def _run(self, wanted: Iterable[tuple[Path, bool, bool]]) -> None:
        before = self.sources.keys() | set()
        try:
            robots = self._robots()
            wanted = [(path.resolve(), asked_for, given) for path, asked_for, given in wanted]
            # A link is what its name says only where the classes are known, so robots come after the ontologies.
            late = [each for each in wanted if each[1] and (robots.robots or looks_like_robot(each[0]))]
            for wave in ([each for each in wanted if each not in late], late):
                known = self.sources.keys() | set()
                for path, asked_for, given in wave:
                    self._load(path, robots, asked_for=asked_for, given=given)
                self._follow_imports(known)
            self.findings += robots.findings
            self.assumptions += robots.assumptions
        except BaseException:
            for path in self.sources.keys() - before:
                self.store.remove_graph(ox.NamedNode(path.as_uri()))
            raise
        missing = self._missing({iri for _, iri in self._unmet})
        for importer, iri in self._unmet:
            if iri in missing:
                self._miss(importer, iri, "which is not among the sources and in none of the given folders of packages")

    def _robots(self) -> RobotSources:
        robots = RobotSources(self.packages, ClassNames(self.store))
        for path in self.descriptions:
            robots.add(path.resolve())
        return robots

    def _load(
        self, path: Path, robots: RobotSources | None = None, *, asked_for: bool = False, given: bool = False
    ) -> None:
        if known := self.sources.get(path):
            asked_for, given = known.asked_for or asked_for, known.given or given
            self.sources[path] = replace(known, asked_for=asked_for, given=given)
            return
        file = read_map_file(path, robots) if asked_for and robots else read_file(path)
        graph = ox.NamedNode(file.iri)
        try:
            self._store(file, graph)
        except SyntaxError as error:
            repaired = file.repaired(error)
            file = self._load_repaired(taken_in(repaired, robots) if asked_for and robots else repaired, graph)
        self.findings += file.findings()
        self.sources[path] = Source(str(path), graph, self.store, self.keep(file), asked_for, given)

    def _load_repaired(self, file: SourceFile, graph: ox.NamedNode) -> SourceFile:
        try:
            self._store(file, graph)
        except SyntaxError as error:
            raise file.unreadable(error) from error
        return file

    def _store(self, file: SourceFile, graph: ox.NamedNode) -> None:
        try:
            self.store.load(file.data, file.format, base_iri=file.iri, to_graph=graph)
        except MemoryError as error:
            cause = "it, or a single text in it, is too long to be held in memory"
            raise SourceUnreadable(str(file.path), cause=cause) from error

    def unneeded(self) -> set[Path]:
        """Those that nobody gave and no other one imports any more."""
        needed = [path for path, source in self.sources.items() if source.given]
        for path in needed:
            found = (self._locate(self.sources[path], iri) for iri in self.sources[path].imports())
            needed += [path for path in found if path in self.sources and path not in needed]
        return self.sources.keys() - set(needed)

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
                    self._load(path)
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
            path = file_named(iri, importer.path)
            if path is not None and path not in self.sources and path.suffix.lower() not in SUFFIXES:
                what = f"but the suffix {path.suffix!r} is that of no format that can be read"
                self._miss(importer, iri, what, Severity.ERROR)
                return None
        if path is not None and path in self.sources:
            return path
        if path is not None and not self.follows:
            self._miss(importer, iri, "but imports of it are not followed", Severity.ERROR)
            return None
        if path is not None and path.is_file():
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
        self.findings.append(Finding(severity, importer.name, IMPORTS, what, did))


def _plain(iri: str) -> str:
    """Ontologies are imported with and without the mark that their names are split at."""
    return iri.rstrip("#/")
