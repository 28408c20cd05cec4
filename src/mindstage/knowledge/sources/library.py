"""The library: every source of a knowledge base, wherever it is kept, and what each says to the letter."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path

import pyoxigraph as ox

from mindstage.errors import SourceUnreadable, StoreUnusable
from mindstage.knowledge.bundled import bundled_ontology
from mindstage.knowledge.findings import Finding, Severity
from mindstage.knowledge.graph import Graph, graph_of, united
from mindstage.knowledge.reading.assumptions import Assumption
from mindstage.knowledge.reading.census import Census, census_of
from mindstage.knowledge.reading.conventions import Conventions
from mindstage.knowledge.reasoning.derivation import DERIVED
from mindstage.knowledge.robots import looks_like_robot, read_robot
from mindstage.knowledge.sources.files import read_file
from mindstage.knowledge.sources.loading import Loading
from mindstage.knowledge.sources.packages import Packages, file_named
from mindstage.knowledge.sources.source import Source
from mindstage.knowledge.stores.endpoint import Endpoint
from mindstage.knowledge.stores.endpointstore import EndpointStore
from mindstage.knowledge.stores.localstore import LocalStore
from mindstage.knowledge.stores.stored import StoreContents, StoreFolder
from mindstage.knowledge.stores.triplestore import TripleStore
from mindstage.world import Iri

__all__ = ["Library", "StrPath"]

StrPath = str | os.PathLike[str]

_CHANGED = "it has changed since it was stored"


class Library:
    """All sources, in memory, in a folder, or with more of them at an endpoint."""

    def __init__(self, *, folder: StrPath | None = None, endpoint: Endpoint | None = None) -> None:
        """Opens it; a folder's sources that have changed since are read anew.

        Raises:
            StoreUnusable: the folder cannot be used, for the reason it gives.
        """
        self._folder = None if folder is None else StoreFolder(Path(folder).absolute())
        self._endpoint = None if endpoint is None else EndpointStore(endpoint)
        self.store: TripleStore = self._endpoint or (self._folder.store if self._folder else LocalStore())
        self.sources: dict[Path, Source] = {}
        self.findings: dict[Finding, None] = {}
        self.conventions: dict[Path, Conventions] = {}
        self.assumptions: list[Assumption] = []
        """What was decided about robots' descriptions."""
        self._loading_findings: dict[Finding, None] = {}
        self._robots: dict[Path, None] = {}
        self._packages = Packages()
        self._bundled: Path | None = None
        self._maps: dict[str, tuple[Iri, ...]] = {}
        self._told: dict[str, tuple[Graph, Census]] = {}
        self._labels: set[str] = set()

    # -- loading -------------------------------------------------------------------------------------------------------

    def open(self, *, bundled: bool) -> None:
        """Brings in what the folder holds, or the bundled ontology.

        Raises:
            StoreUnusable: the folder was made with the bundled ontology, and shall do without.
        """
        if self._folder is None or self._folder.is_new:
            self._bundled = bundled_ontology() if bundled else None
            self.load([], [self._bundled] if self._bundled else [])
            return
        told = self._folder.contents
        if told.bundled and not bundled:
            cause = "it was made with the bundled ontology"
            raise StoreUnusable(str(self._folder.path), cause=cause, remedy="make another one without it")
        self._bundled = Path(told.bundled) if told.bundled else None
        self._packages = Packages(map(Path, told.packages))
        self._robots = dict.fromkeys(map(Path, told.robots))
        self.sources = self._folder.sources()
        self.conventions = {Path(path): each for path, each in told.conventions.items()}
        self.assumptions = list(told.assumptions)
        self._loading_findings = dict.fromkeys(told.findings)
        self.findings.update(self._loading_findings)
        self._renew(self._folder)

    def load(
        self,
        maps: Iterable[StrPath],
        ontologies: Iterable[StrPath],
        conventions: Conventions = Conventions(),  # noqa: B008 - it is frozen
        robots: Iterable[StrPath] = (),
        follow_imports: bool = True,
    ) -> list[ox.NamedNode]:
        """Reads files and all that they import, and gives the graphs that are new.

        Raises:
            SourceUnreadable: one of the files cannot be read, for the reason it gives; nothing has changed then.
            StoreUnusable: the folder can only be read.
        """
        entries = [os.fspath(entry) for entry in ontologies]
        folders = [Path(entry) for entry in entries if not entry.startswith("package:") and Path(entry).is_dir()]
        packages = Packages([*self._packages.folders, *folders])
        files = [_found(entry, packages) for entry in entries if Path(entry) not in folders]
        paths = [_found(os.fspath(entry), packages) for entry in maps]
        new = {path.resolve() for path in (*paths, *files)} - self.sources.keys()
        loading = self._loading(packages, self.sources)
        given = dict.fromkeys(_found(os.fspath(entry), packages).resolve() for entry in robots)
        loading.descriptions = list(given)
        loading.follows = follow_imports
        with self._folder.changing() if self._folder and (new or self._folder.is_new) else nullcontext():
            loading.run(paths, files)
            graphs = [ox.NamedNode(path.as_uri()) for path in loading.sources if path not in self.sources]
            self._robots |= given
            if conventions != Conventions():
                self.conventions |= dict.fromkeys((path.resolve() for path in paths), conventions)
            self._take(loading)
        return graphs

    @property
    def packages(self) -> tuple[Path, ...]:
        """The folders of ROS packages."""
        return tuple(self._packages.folders)

    def find(self, name: str) -> Path | None:
        """The file that a name in some map stands for, if it is here: one of a package, or beside the map."""
        if name.startswith("package:"):
            try:
                return self._packages.find(name)
            except ValueError:
                return None
        beside = (file_named(name, source.path) for source in self.sources.values() if source.asked_for)
        return next((path for path in beside if path is not None and path.is_file()), None)

    def _loading(self, packages: Packages, sources: dict[Path, Source]) -> Loading:
        loading = Loading(self.store, packages, dict(sources))
        if self._folder:
            loading.keep = self._folder.keep
        return loading

    def _take(self, loading: Loading) -> None:
        self._packages, self.sources = loading.packages, loading.sources
        self._loading_findings |= dict.fromkeys(loading.findings)
        self.findings |= dict.fromkeys(loading.findings)
        self.assumptions += loading.assumptions
        if self._folder and not self._folder.read_only:
            contents = StoreContents(
                bundled=str(self._bundled) if self._bundled else None,
                packages=tuple(map(str, self._packages.folders)),
                robots=tuple(map(str, self._robots)),
                conventions={str(path): each for path, each in self.conventions.items()},
                assumptions=tuple(self.assumptions),
                findings=tuple(self._loading_findings),
            )
            self._folder.hold(contents, self.sources.values())

    def close(self) -> None:
        """Lets go of files, processes and connections; any number of times."""
        self.store.close()

    # -- what has changed since ----------------------------------------------------------------------------------------

    def _renew(self, folder: StoreFolder) -> None:
        """Reads anew what has changed since it was stored, the ontology of another Mindstage among it, and says so."""
        changed = [self.sources[path] for path in folder.changed() if path != self._bundled]
        if folder.read_only:
            for source in changed:
                self._note(Severity.WARNING, source.path, _CHANGED, "the stored one stays: the folder is read-only")
            return
        again = [source for source in changed if self._can_be_read(source.path)]
        old = self.sources.get(self._bundled) if self._bundled and not folder.has(bundled_ontology()) else None
        if not again and not old:
            return
        with folder.changing():
            self._read_anew(again, outdated=old)
        for source in (*again, *([old] if old else [])):
            self._note(Severity.WARNING, source.path, _CHANGED, "it was read anew")

    def _read_anew(self, again: Sequence[Source], *, outdated: Source | None) -> None:
        self.store.remove_graph(DERIVED)  # it may not follow any more
        before = dict.fromkeys(self.sources)
        for source in (*again, *([outdated] if outdated else [])):
            self._forget(self.sources.pop(source.path))
        loading = self._loading(self._packages, self.sources)
        loading.descriptions = [path for path in self._robots if path.is_file()]
        if outdated:
            self._bundled = bundled_ontology()
            loading.run([], [self._bundled])
        loading.run_again(again)
        for path in loading.unneeded():
            self._forget(loading.sources.pop(path))
        order = [path for path in (*before, *loading.sources) if path in loading.sources]
        loading.sources = {path: loading.sources[path] for path in dict.fromkeys(order)}
        self._take(loading)

    def _forget(self, source: Source) -> None:
        if isinstance(source.graph, ox.NamedNode):
            self.store.remove_graph(source.graph)
        for finding in [finding for finding in self._loading_findings if finding.individual == source.name]:
            self._loading_findings.pop(finding)
            self.findings.pop(finding, None)

    def _can_be_read(self, path: Path) -> bool:
        try:
            if looks_like_robot(path):
                read_robot(path, self._packages)
                return True
            file = read_file(path)
            try:
                deque(ox.parse(file.data, file.format, base_iri=file.iri), maxlen=0)
            except SyntaxError as error:
                file.repaired(error)
        except SourceUnreadable as error:
            self._note(Severity.ERROR, path, f"{_CHANGED}, and: {error}", "the stored one stays")
            return False
        return True

    def _note(self, severity: Severity, path: Path, what: str, did: str) -> None:
        self.findings[Finding(severity, str(path), "", what, did)] = None

    # -- what they say -------------------------------------------------------------------------------------------------

    def all(self) -> list[Source]:
        """Every source, the endpoint's graphs after the files."""
        return [*self.sources.values(), *(self._endpoint.sources() if self._endpoint else ())]

    def of_maps(self) -> list[Source]:
        """Those that worlds may be made from."""
        return [source for source in self.all() if source.asked_for or source.has_maps()]

    def of_sizes(self) -> Iterator[Source]:
        """Ontologies that tell sizes; the sources of maps speak for themselves."""
        maps = {source.name for source in self.of_maps()}
        return (source for source in self.all() if source.name not in maps and source.has_sizes())

    def maps_in(self, source: Source) -> tuple[Iri, ...]:
        """The maps that a source tells of, in its order; it is parsed only where there are several."""
        if source.name not in self._maps:
            maps = source.maps()
            is_plain = len(maps) < 2 and not any(map.startswith("_:") for map in maps)
            self._maps[source.name] = tuple(maps if is_plain else self.tells(source)[1])
        return self._maps[source.name]

    def told_of(self, map: Iri) -> tuple[Graph, Census]:
        """What the sources of a map say: those that tell of it, and those given as maps that tell of none at all."""
        maps = [(source, self.maps_in(source)) for source in self.of_maps()]
        told = [self.tells(source) for source, there in maps if map in there or not there]
        if len(told) == 1:
            return told[0]
        graph = united([graph for graph, _ in told])
        return graph, census_of(graph)

    def tells(self, source: Source) -> tuple[Graph, Census]:
        """What a source says, exactly; only those that worlds are made from are ever read in this way.

        Raises:
            SourceUnreadable: it says something about statements, for which a world has no place.
        """
        if source.name not in self._told:
            try:
                graph = graph_of(source.quads(), self._labels)
            except ValueError as error:
                raise SourceUnreadable(source.name, cause=str(error)) from error
            self._told[source.name] = graph, census_of(graph)
        return self._told[source.name]


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
