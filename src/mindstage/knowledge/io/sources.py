"""The library: every source of a knowledge base, wherever it is kept, and what each says to the letter."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path

import pyoxigraph as ox

from mindstage.errors import SourceParseError, StoreError
from mindstage.knowledge.bundled import bundled_ontology
from mindstage.knowledge.findings import Finding, Severity
from mindstage.knowledge.graph import Graph, graph_from_quads, merge_graphs
from mindstage.knowledge.reading.assumptions import Assumption
from mindstage.knowledge.reading.census import MapMembers, individuals_by_map
from mindstage.knowledge.reading.conventions import UnitConventions
from mindstage.knowledge.reasoning.derivation import INFERRED_GRAPH
from mindstage.knowledge.robots import is_urdf, read_urdf
from mindstage.knowledge.sources.files import read_file
from mindstage.knowledge.sources.loading import LoadTransaction
from mindstage.knowledge.sources.packages import RosPackagePath, file_from_iri
from mindstage.knowledge.sources.source import Source
from mindstage.knowledge.stores.endpoint import SparqlEndpoint
from mindstage.knowledge.stores.endpointstore import SparqlEndpointStore
from mindstage.knowledge.stores.localstore import OxigraphStore
from mindstage.knowledge.stores.stored import StoreDirectory, StoreManifest
from mindstage.knowledge.stores.triplestore import TripleStore
from mindstage.world import Iri

__all__ = ["SourceRegistry", "StrPath"]

StrPath = str | os.PathLike[str]

_CHANGED_MESSAGE = "it has changed since it was stored"


class SourceRegistry:
    """All sources, in memory, in a folder, or with more of them at an endpoint."""

    def __init__(self, *, folder: StrPath | None = None, endpoint: SparqlEndpoint | None = None) -> None:
        """Opens it; a folder's sources that have changed since are read anew.

        Raises:
            StoreError: the folder cannot be used, for the reason it gives.
        """
        self._directory = None if folder is None else StoreDirectory(Path(folder).absolute())
        self._endpoint = None if endpoint is None else SparqlEndpointStore(endpoint)
        self.store: TripleStore = self._endpoint or (self._directory.store if self._directory else OxigraphStore())
        self.sources: dict[Path, Source] = {}
        self.findings: dict[Finding, None] = {}
        self.conventions: dict[Path, UnitConventions] = {}
        self.assumptions: list[Assumption] = []
        """What was decided about robots' descriptions."""
        self._loading_findings: dict[Finding, None] = {}
        self._urdf_paths: dict[Path, None] = {}
        self._package_path = RosPackagePath()
        self._bundled: Path | None = None
        self._maps_by_source: dict[str, tuple[Iri, ...]] = {}
        self._graphs: dict[str, tuple[Graph, MapMembers]] = {}
        self._used_labels: set[str] = set()

    # -- loading -------------------------------------------------------------------------------------------------------

    def open(self, *, bundled: bool) -> None:
        """Brings in what the folder holds, or the bundled ontology.

        Raises:
            StoreError: the folder was made with the bundled ontology, and shall do without.
        """
        if self._directory is None or self._directory.is_new:
            self._bundled = bundled_ontology() if bundled else None
            self.load([], [self._bundled] if self._bundled else [])
            return
        told = self._directory.manifest
        if told.bundled_ontology and not bundled:
            cause = "it was made with the bundled ontology"
            raise StoreError(str(self._directory.path), cause=cause, remedy="make another one without it")
        self._bundled = Path(told.bundled_ontology) if told.bundled_ontology else None
        self._package_path = RosPackagePath(map(Path, told.packages))
        self._urdf_paths = dict.fromkeys(map(Path, told.urdf_files))
        self.sources = self._directory.sources()
        self.conventions = {Path(path): each for path, each in told.conventions.items()}
        self.assumptions = list(told.assumptions)
        self._loading_findings = dict.fromkeys(told.findings)
        self.findings.update(self._loading_findings)
        self._reload_changed(self._directory)

    def load(
        self,
        maps: Iterable[StrPath],
        ontologies: Iterable[StrPath],
        conventions: UnitConventions = UnitConventions(),  # noqa: B008 - it is frozen
        urdf_files: Iterable[StrPath] = (),
        follow_imports: bool = True,
    ) -> list[ox.NamedNode]:
        """Reads files and all that they import, and gives the graphs that are new.

        Raises:
            SourceParseError: one of the files cannot be read, for the reason it gives; nothing has changed then.
            StoreError: the folder can only be read.
        """
        entries = [os.fspath(entry) for entry in ontologies]
        folders = [Path(entry) for entry in entries if not entry.startswith("package:") and Path(entry).is_dir()]
        packages = RosPackagePath([*self._package_path.folders, *folders])
        files = [_resolve_entry(entry, packages) for entry in entries if Path(entry) not in folders]
        paths = [_resolve_entry(os.fspath(entry), packages) for entry in maps]
        new = {path.resolve() for path in (*paths, *files)} - self.sources.keys()
        loading = self._new_transaction(packages, self.sources)
        given = dict.fromkeys(_resolve_entry(os.fspath(entry), packages).resolve() for entry in urdf_files)
        loading.urdf_paths = list(given)
        loading.follow_imports = follow_imports
        with self._directory.transaction() if self._directory and (new or self._directory.is_new) else nullcontext():
            loading.run(paths, files)
            graphs = [ox.NamedNode(path.as_uri()) for path in loading.sources if path not in self.sources]
            self._urdf_paths |= given
            if conventions != UnitConventions():
                self.conventions |= dict.fromkeys((path.resolve() for path in paths), conventions)
            self._commit(loading)
        return graphs

    @property
    def packages(self) -> tuple[Path, ...]:
        """The folders of ROS packages."""
        return tuple(self._package_path.folders)

    def find_file(self, name: str) -> Path | None:
        """The file that a name in some map stands for, if it is here: one of a package, or beside the map."""
        if name.startswith("package:"):
            try:
                return self._package_path.find(name)
            except ValueError:
                return None
        beside = (file_from_iri(name, source.path) for source in self.sources.values() if source.is_map)
        return next((path for path in beside if path is not None and path.is_file()), None)

    def _new_transaction(self, packages: RosPackagePath, sources: dict[Path, Source]) -> LoadTransaction:
        loading = LoadTransaction(self.store, packages, dict(sources))
        if self._directory:
            loading.store_text = self._directory.store_text
        return loading

    def _commit(self, transaction: LoadTransaction) -> None:
        self._package_path, self.sources = transaction.packages, transaction.sources
        self._loading_findings |= dict.fromkeys(transaction.findings)
        self.findings |= dict.fromkeys(transaction.findings)
        self.assumptions += transaction.assumptions
        if self._directory and not self._directory.read_only:
            contents = StoreManifest(
                bundled_ontology=str(self._bundled) if self._bundled else None,
                packages=tuple(map(str, self._package_path.folders)),
                urdf_files=tuple(map(str, self._urdf_paths)),
                conventions={str(path): each for path, each in self.conventions.items()},
                assumptions=tuple(self.assumptions),
                findings=tuple(self._loading_findings),
            )
            self._directory.commit(contents, self.sources.values())

    def close(self) -> None:
        """Lets go of files, processes and connections; any number of times."""
        self.store.close()

    # -- what has changed since ----------------------------------------------------------------------------------------

    def _reload_changed(self, directory: StoreDirectory) -> None:
        """Reads anew what has changed since it was stored, the ontology of another Mindstage among it, and says so."""
        changed = [self.sources[path] for path in directory.changed_sources() if path != self._bundled]
        if directory.read_only:
            for source in changed:
                self._add_finding(
                    Severity.WARNING, source.path, _CHANGED_MESSAGE, "the stored one stays: the folder is read-only"
                )
            return
        again = [source for source in changed if self._can_be_read(source.path)]
        old = (
            self.sources.get(self._bundled)
            if self._bundled and not directory.contains_version_of(bundled_ontology())
            else None
        )
        if not again and not old:
            return
        with directory.transaction():
            self._reload(again, outdated=old)
        for source in (*again, *([old] if old else [])):
            self._add_finding(Severity.WARNING, source.path, _CHANGED_MESSAGE, "it was read anew")

    def _reload(self, changed: Sequence[Source], *, outdated: Source | None) -> None:
        self.store.remove_graph(INFERRED_GRAPH)  # it may not follow any more
        before = dict.fromkeys(self.sources)
        for source in (*changed, *([outdated] if outdated else [])):
            self._remove(self.sources.pop(source.path))
        loading = self._new_transaction(self._package_path, self.sources)
        loading.urdf_paths = [path for path in self._urdf_paths if path.is_file()]
        if outdated:
            self._bundled = bundled_ontology()
            loading.run([], [self._bundled])
        loading.reload(changed)
        for path in loading.unreferenced():
            self._remove(loading.sources.pop(path))
        order = [path for path in (*before, *loading.sources) if path in loading.sources]
        loading.sources = {path: loading.sources[path] for path in dict.fromkeys(order)}
        self._commit(loading)

    def _remove(self, source: Source) -> None:
        if isinstance(source.graph, ox.NamedNode):
            self.store.remove_graph(source.graph)
        for finding in [finding for finding in self._loading_findings if finding.individual == source.name]:
            self._loading_findings.pop(finding)
            self.findings.pop(finding, None)

    def _can_be_read(self, path: Path) -> bool:
        try:
            if is_urdf(path):
                read_urdf(path, self._package_path)
                return True
            file = read_file(path)
            try:
                deque(ox.parse(file.data, file.format, base_iri=file.iri), maxlen=0)
            except SyntaxError as error:
                file.repair(error)
        except SourceParseError as error:
            self._add_finding(Severity.ERROR, path, f"{_CHANGED_MESSAGE}, and: {error}", "the stored one stays")
            return False
        return True

    def _add_finding(self, severity: Severity, path: Path, problem: str, action: str) -> None:
        self.findings[Finding(severity, str(path), "", problem, action)] = None

    # -- what they say -------------------------------------------------------------------------------------------------

    def all_sources(self) -> list[Source]:
        """Every source, the endpoint's graphs after the files."""
        return [*self.sources.values(), *(self._endpoint.sources() if self._endpoint else ())]

    def map_sources(self) -> list[Source]:
        """Those that worlds may be made from."""
        return [source for source in self.all_sources() if source.is_map or source.has_maps()]

    def size_sources(self) -> Iterator[Source]:
        """Ontologies that tell sizes; the sources of maps speak for themselves."""
        maps = {source.name for source in self.map_sources()}
        return (source for source in self.all_sources() if source.name not in maps and source.has_class_sizes())

    def maps_in(self, source: Source) -> tuple[Iri, ...]:
        """The maps that a source tells of, in its order; it is parsed only where there are several."""
        if source.name not in self._maps_by_source:
            maps = source.maps()
            is_plain = len(maps) < 2 and not any(map.startswith("_:") for map in maps)
            self._maps_by_source[source.name] = tuple(maps if is_plain else self.source_graph(source)[1])
        return self._maps_by_source[source.name]

    def map_graph(self, map: Iri) -> tuple[Graph, MapMembers]:
        """What the sources of a map say: those that tell of it, and those given as maps that tell of none at all."""
        maps = [(source, self.maps_in(source)) for source in self.map_sources()]
        told = [self.source_graph(source) for source, there in maps if map in there or not there]
        if len(told) == 1:
            return told[0]
        graph = merge_graphs([graph for graph, _ in told])
        return graph, individuals_by_map(graph)

    def source_graph(self, source: Source) -> tuple[Graph, MapMembers]:
        """What a source says, exactly; only those that worlds are made from are ever read in this way.

        Raises:
            SourceParseError: it says something about statements, for which a world has no place.
        """
        if source.name not in self._graphs:
            try:
                graph = graph_from_quads(source.quads(), self._used_labels)
            except ValueError as error:
                raise SourceParseError(source.name, cause=str(error)) from error
            self._graphs[source.name] = graph, individuals_by_map(graph)
        return self._graphs[source.name]


def _resolve_entry(entry: str, packages: RosPackagePath) -> Path:
    if not entry.startswith("package:"):
        return Path(entry)
    try:
        path = packages.find(entry)
    except ValueError as error:
        raise SourceParseError(entry, cause=str(error)) from error
    if path is None:
        folders = ", ".join(map(str, packages.folders)) or "none; give one as an ontology"
        raise SourceParseError(entry, cause=f"no folder of packages has it; searched: {folders}")
    return path
