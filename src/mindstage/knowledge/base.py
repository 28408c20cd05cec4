"""The knowledge base: what was loaded, as one store for questions and as one world for each map."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path

import pyoxigraph as ox

from mindstage.errors import MapAmbiguous, MapMissing, SourceUnreadable
from mindstage.knowledge import bundled
from mindstage.knowledge.analysis import Analysis, analyse
from mindstage.knowledge.answering import Answering
from mindstage.knowledge.census import Census, census_of, without_strangers
from mindstage.knowledge.dialects import read_world
from mindstage.knowledge.excerpt import Excerpt
from mindstage.knowledge.findings import Finding, Severity
from mindstage.knowledge.graph import Graph, graph_of, united
from mindstage.knowledge.hierarchy import ClassHierarchy
from mindstage.knowledge.loading import Loading, Source
from mindstage.knowledge.names import local_name
from mindstage.knowledge.nesting import nested
from mindstage.knowledge.packages import Packages
from mindstage.knowledge.vocabulary import EQUIVALENT_CLASS, SUBCLASS_OF
from mindstage.world import Iri, World

__all__ = ["KnowledgeBase"]

StrPath = str | os.PathLike[str]


class KnowledgeBase(Answering):
    """Loads semantic maps and ontologies, and tells what they say.

    >>> from mindstage.knowledge import KnowledgeBase, bundled_kitchen
    >>> knowledge = KnowledgeBase()
    >>> knowledge.load(bundled_kitchen())
    >>> world = knowledge.world()
    """

    def __init__(self, *, bundled_ontology: bool = True) -> None:
        """Makes a knowledge base that knows nothing but, unless told otherwise, the bundled household ontology."""
        self._store = ox.Store()
        self._packages = Packages()
        self._sources: dict[Path, Source] = {}
        self._findings: dict[Finding, None] = {}
        self._told: dict[Path, tuple[Graph, Census]] = {}
        self._labels: set[str] = set()
        self._worlds: dict[Iri, World] = {}
        if bundled_ontology:
            self.load((), ontologies=bundled.bundled_ontology())

    def load(self, paths: StrPath | Iterable[StrPath], *, ontologies: StrPath | Iterable[StrPath] = ()) -> None:
        """Reads files and all that they import, transitively and each once.

        An import that is not there, or cannot be read, is a finding; the rest is loaded. Nothing is ever fetched.

        Args:
            paths: a map or several; more may follow later, and they stay apart.
            ontologies: files, `package://NAME/rest`, or folders of ROS packages that such names are looked up in.

        Raises:
            SourceUnreadable: one of the files cannot be read, for the reason it gives; nothing has changed then.
        """
        entries = _listed(ontologies)
        folders = [Path(entry) for entry in entries if not entry.startswith("package:") and Path(entry).is_dir()]
        packages = Packages([*self._packages.folders, *folders])
        files = [_found(entry, packages) for entry in entries if Path(entry) not in folders]
        loading = Loading(self._store, packages, dict(self._sources))
        loading.run([_found(path, packages) for path in _listed(paths)], files)
        self._packages, self._sources = packages, loading.sources
        self._findings.update(dict.fromkeys(loading.findings))
        self._changed()

    def maps(self) -> tuple[Iri, ...]:
        """The maps that are loaded, in the order of their sources."""
        found = (map for source in self._map_sources() for map in self._tells(source)[1])
        return tuple(dict.fromkeys(found))

    def world(self, map: str | None = None) -> World:
        """One map as plain data.

        Args:
            map: its IRI or local name; None for the only one.

        Raises:
            MapMissing: there is none, or none of that name.
            MapAmbiguous: nobody said which one of several, or several have that local name.
        """
        iri = self._chosen(map)
        if iri not in self._worlds:
            graph, census = self._told_of(iri)
            self._worlds[iri] = read_world(
                Excerpt(
                    map=iri,
                    graph=nested(without_strangers(graph, iri, census)),
                    members=census[iri],
                    background=[nested(self._tells(source)[0]) for source in self._background()],
                    hierarchy=self._hierarchy,
                    report=self._report,
                )
            )
        return self._worlds[iri]

    def analyse(self, map: str | None = None) -> Analysis:
        """One map in numbers.

        Raises:
            MapMissing: there is none, or none of that name.
            MapAmbiguous: nobody said which one of several, or several have that local name.
        """
        iri = self._chosen(map)
        graph, census = self._told_of(iri)
        return analyse(iri, graph, census[iri], self._hierarchy)

    def findings(self) -> tuple[Finding, ...]:
        """What was odd in the sources so far; loading and reading worlds adds to it."""
        return tuple(self._findings)

    # -- classes -------------------------------------------------------------------------------------------------------

    def ancestors(self, cls: Iri) -> tuple[Iri, ...]:
        """The superclasses of a class, the nearest first, without itself."""
        return self._hierarchy.ancestors(cls)

    def descendants(self, cls: Iri) -> frozenset[Iri]:
        """The subclasses of a class at any depth, without itself."""
        return self._hierarchy.descendants(cls)

    def is_a(self, cls: Iri, ancestor: Iri) -> bool:
        """Whether one class is the other or below it."""
        return self._hierarchy.is_a(cls, ancestor)

    @cached_property
    def _hierarchy(self) -> ClassHierarchy:
        """Built when it is first needed, and again after more was loaded."""
        pairs = []
        for property in (SUBCLASS_OF, EQUIVALENT_CLASS):
            for quad in self._store.quads_for_pattern(None, ox.NamedNode(property), None):
                if isinstance(quad.subject, ox.NamedNode) and isinstance(quad.object, ox.NamedNode):
                    pairs.append((Iri(quad.subject.value), Iri(quad.object.value)))
                    if property == EQUIVALENT_CLASS:
                        pairs.append((Iri(quad.object.value), Iri(quad.subject.value)))
        return ClassHierarchy(pairs)

    # -- maps ----------------------------------------------------------------------------------------------------------

    def _map_sources(self) -> list[Source]:
        return [source for source in self._sources.values() if source.asked_for or source.has_maps()]

    def _chosen(self, wanted: str | None) -> Iri:
        maps = self.maps()
        named = [map for map in maps if wanted is None or wanted == map]
        named = named or [map for map in maps if wanted == local_name(map)]
        if len(named) == 1:
            return named[0]
        if named:
            raise MapAmbiguous(named)
        files = ", ".join(str(path) for path, source in self._sources.items() if source.asked_for)
        raise MapMissing(wanted=wanted if wanted and maps else files, known=maps)

    def _told_of(self, map: Iri) -> tuple[Graph, Census]:
        """What the sources of a map say: those that tell of it, and those given as maps that tell of none at all."""
        told = [self._tells(source) for source in self._map_sources()]
        told = [(graph, census) for graph, census in told if map in census or not census]
        if len(told) == 1:
            return told[0]
        graph = united([graph for graph, _ in told])
        return graph, census_of(graph)

    def _tells(self, source: Source) -> tuple[Graph, Census]:
        """What a source says, exactly; only those that worlds are made from are ever read in this way."""
        path = source.file.path
        if path not in self._told:
            quads = ox.parse(source.file.data, source.file.format, base_iri=source.file.iri)
            try:
                graph = graph_of(quads, self._labels)
            except ValueError as error:
                raise SourceUnreadable(str(path), cause=str(error)) from error
            self._told[path] = graph, census_of(graph)
        return self._told[path]

    def _background(self) -> Iterator[Source]:
        """Ontologies that tell sizes; the sources of maps speak for themselves."""
        maps = self._map_sources()
        return (source for source in self._sources.values() if source.has_sizes() and source not in maps)

    def _report(self, severity: Severity, individual: str, property: str, what: str, did: str) -> None:
        self._findings[Finding(severity, individual, property, what, did)] = None


def _listed(paths: StrPath | Iterable[StrPath]) -> list[str]:
    return [os.fspath(path) for path in ([paths] if isinstance(paths, str | os.PathLike) else paths)]


def _found(entry: str, packages: Packages) -> Path:
    if not entry.startswith("package:"):
        return Path(entry)
    try:
        path = packages.find(entry)
    except ValueError as error:
        raise SourceUnreadable(entry, cause=str(error)) from error
    if path is None:
        folders = ", ".join(map(str, packages.folders)) or "none; give one as an ontology"
        raise SourceUnreadable(entry, cause=f"no folder of packages has it; searched: {folders}")
    return path
