"""Sources of a knowledge base: loading of files and their imports, from memory, a store folder or an endpoint.

Each file becomes a graph of the store. Statements that a dialect leaves implicit are appended to a map's text before it
is stored: membership in a map (see `membership`), and poses and joints from robot descriptions. The store and the exact
text therefore agree. A robot description given as a map is converted to one. Loading is atomic: if a file cannot be
read, the store is unchanged.
"""

from __future__ import annotations

import os
import re
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import blake2b
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import msgspec
import pyoxigraph as ox

from mindstage.access.resources import is_inside, is_outside_request
from mindstage.errors import InvalidArgumentError, ReferenceRefusedError, SourceParseError, StoreError
from mindstage.knowledge.names import NameIndex
from mindstage.knowledge.owl_rl import INFERRED_GRAPH
from mindstage.knowledge.reasoner import Reasoner
from mindstage.knowledge.store import OxigraphStore
from mindstage.knowledge.tell import RUNTIME_GRAPH
from mindstage.maps.dialects.conventions import Assumption, UnitConventions
from mindstage.maps.dialects.membership import (
    MapMembers,
    individuals_by_map,
    inferred_membership,
    is_membership,
    with_inferred_membership,
    without_other_maps,
)
from mindstage.maps.io.files import (
    SUFFIXES,
    Source,
    SourceFile,
    SourceHeader,
    bundled_ontology,
    is_bundled,
    read_file,
    read_header,
    same_file,
    soma_alignment,
)
from mindstage.maps.io.formats import MapFormat, read_with, readable_suffixes
from mindstage.maps.io.ros_packages import RosPackagePath, file_from_iri
from mindstage.maps.io.xml import external_reference
from mindstage.maps.urdf.in_maps import ClassNameIndex, UrdfSources, is_urdf, linked_individuals
from mindstage.maps.urdf.xacro_process import XacroRequest, requested_arguments
from mindstage.rdf.graphs import (
    BUNDLED_GRAPHS,
    FILE_GRAPHS,
    PRESENT_GRAPH,
    Finding,
    Graph,
    Severity,
    TripleStore,
    graph_from_quads,
    local_name,
    merge_graphs,
    namespace_of,
)
from mindstage.rdf.vocabulary import (
    DUL,
    HAS_POSE,
    IMPORTS,
    ONTOLOGY,
    POSE_PROPERTIES,
    RDF,
    SEMANTIC_MAP,
    SOMA_NAMESPACES,
    TYPE,
    VERSION_IRI,
)
from mindstage.scene import Iri, IriRef, PropertyAssertion
from mindstage.unicode_json import values_without_surrogates

if TYPE_CHECKING:  # few knowledge bases are kept in a folder or at an endpoint
    from mindstage.knowledge.endpoint import SparqlEndpoint, SparqlEndpointStore
    from mindstage.knowledge.store_folder import StoreDirectory, StoreManifest
    from mindstage.knowledge.store_index import IndexBuilder, StoreIndex

__all__ = ["LoadTransaction", "SourceRegistry", "StrPath", "preprocess", "read_map_file"]


RESERVED_GRAPHS = frozenset({RUNTIME_GRAPH, INFERRED_GRAPH, PRESENT_GRAPH})
_END_TAG = re.compile(rb"</([\w.-]+:)?RDF\s*>")
_BEGIN_IMPLIED, _END_IMPLIED = "The statements below are implied:", "The statements above are implied."
_IMPLIED = re.compile(rf"(?:<!--|#) {_BEGIN_IMPLIED}(?: -->)?\n(.*?)(?:<!--|#) {_END_IMPLIED}".encode(), re.DOTALL)
"""The statements that `preprocess` has appended to a text, between two comments."""
_IS_MAP = PropertyAssertion(TYPE, IriRef(SEMANTIC_MAP))
_MAX_REFUSED_NAMES = 5
_ALIGNED_NAMESPACES = (*SOMA_NAMESPACES, DUL)
_ALIGNED_MARKERS = tuple(namespace.rpartition("/")[2].rstrip("#").encode() for namespace in _ALIGNED_NAMESPACES)
"""The names of the files of SOMA and DUL: a text that uses their terms contains one, whatever its prefixes are."""
_MAP_MARKERS = (b"SemanticEnvironmentMap", b"describedInMap")
_POSE = local_name(HAS_POSE).encode()
_POSE_MARKERS = tuple(local_name(property).encode() for property in POSE_PROPERTIES)


StrPath = str | os.PathLike[str]
_CHANGED_MESSAGE = "it has changed since it was stored"


def read_map_file(path: Path, urdf_sources: UrdfSources) -> SourceFile:
    """Reads a map file, or a robot description or a file of another format as a map.

    Raises:
        SourceParseError: it does not exist, is truncated or unsafe, or its format is unknown.
    """
    if is_urdf(path):
        return urdf_sources.urdf_as_map(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES and path.is_file() and (format := readable_suffixes().get(suffix)) is not None:
        from mindstage.maps.io.write import write_map  # few files are of other formats

        world = read_with(format, path)
        return SourceFile(path, write_map(world, format=MapFormat.TURTLE).encode(), ox.RdfFormat.TURTLE)
    return preprocess(read_file(path), urdf_sources)


def preprocess(file: SourceFile, urdf_sources: UrdfSources) -> SourceFile:
    """Appends inferred membership statements, and poses and joints from robot descriptions, to a map file.

    A file that does not parse is returned unchanged; loading it reports the error.
    """
    has_map = any(marker in file.data for marker in _MAP_MARKERS)
    if not any(marker in file.data for marker in (_POSE_MARKERS if has_map else (_POSE, *_POSE_MARKERS))):
        return file
    try:
        quads = list(ox.parse(file.data, file.format, base_iri=file.iri))
        graph = graph_from_quads(quads, set())
    except (SyntaxError, ValueError, MemoryError):
        return file
    inferred: Graph = inferred_membership(graph)
    has_links = any(True for _ in linked_individuals(graph))
    if not inferred and not has_links:
        return file
    if has_links or any(subject.startswith("_:") for subject in inferred):
        file, inferred = _as_n_triples(file, quads, inferred)
    file = _append_statements(file, inferred)
    return urdf_sources.add_linked_robots(file, with_inferred_membership(graph)) if has_links else file


def _append_statements(file: SourceFile, added: Graph) -> SourceFile:
    """Appends statements to a file, between comments by which `_implied_subjects` finds them."""
    if not added:
        return file
    if file.format != ox.RdfFormat.RDF_XML:
        lines = [f"\n# {_BEGIN_IMPLIED}\n", *_to_n_triples(added), f"# {_END_IMPLIED}\n"]
        return replace(file, data=file.data + "".join(lines).encode())
    end = max((tag.start() for tag in _END_TAG.finditer(file.data)), default=len(file.data))
    lines = [f"<!-- {_BEGIN_IMPLIED} -->\n", *_to_rdf_xml(added), f"<!-- {_END_IMPLIED} -->\n"]
    return replace(file, data=file.data[:end] + "".join(lines).encode() + file.data[end:])


def _implied_subjects(file: SourceFile) -> Iterator[Iri]:
    """Yields the subjects of the statements that `preprocess` has appended to a text."""
    for found in _IMPLIED.finditer(file.data) if _BEGIN_IMPLIED.encode() in file.data else ():
        yield from _parse_implied(file, found[1])


def _parse_implied(file: SourceFile, data: bytes) -> Graph:
    if file.format == ox.RdfFormat.RDF_XML:
        data = f'<rdf:RDF xmlns:rdf="{RDF}">'.encode() + data + b"</rdf:RDF>"
    return graph_from_quads(ox.parse(data, file.format), set())


def _derived_map(file: SourceFile) -> Assumption | None:
    """The assumption that the individuals of a file are in a map, if it has none; `preprocess` has appended the map."""
    found = next(_IMPLIED.finditer(file.data), None) if _BEGIN_IMPLIED.encode() in file.data else None
    if found is None or local_name(SEMANTIC_MAP).encode() not in found[1]:
        return None
    implied = _parse_implied(file, found[1])
    map = next((subject for subject, facts in implied.items() if _IS_MAP in facts), None)
    if map is None:
        return None
    evidence = (
        f"nothing there is a SemanticEnvironmentMap, and {len(implied) - 1} individuals have poses or belong to them"
    )
    return Assumption(map, "map", f"{local_name(map)}, derived from {file.path.name}", evidence)


def _as_n_triples(file: SourceFile, quads: Sequence[ox.Quad], added: Graph) -> tuple[SourceFile, Graph]:
    """Converts a file to N-Triples, with a stable label for each blank node that statements are added to.

    A blank node of RDF/XML or Turtle may have no label, so statements about it cannot be appended.
    """
    unused = (label for number in count(1) if (label := f"_:unnamed{number}").encode() not in file.data)
    labels: Mapping[Iri, Iri] = {subject: Iri(next(unused)) for subject in added if subject.startswith("_:")}
    data = ox.serialize((quad.triple for quad in quads), format=ox.RdfFormat.N_TRIPLES) or b""
    for subject, label in labels.items():
        data = data.replace(f"{subject} ".encode(), f"{label} ".encode())
    relabeled = {labels.get(subject, subject): facts for subject, facts in added.items()}
    return replace(file, data=data, format=ox.RdfFormat.N_TRIPLES), relabeled


def _to_n_triples(added: Graph) -> list[str]:
    return [
        f"{subject if subject.startswith('_:') else f'<{subject}>'} <{fact.property}> <{fact.value.iri}> .\n"
        for subject, facts in added.items()
        for fact in facts
        if isinstance(fact.value, IriRef)
    ]


def _to_rdf_xml(added: Graph) -> list[str]:
    from xml.sax.saxutils import quoteattr  # imports urllib, ssl and email

    return [
        f"<rdf:Description xmlns:rdf={quoteattr(RDF)} rdf:about={quoteattr(subject)}>"
        f"<p:{local_name(fact.property)} xmlns:p={quoteattr(namespace_of(fact.property))}"
        f" rdf:resource={quoteattr(fact.value.iri)}/></rdf:Description>\n"
        for subject, facts in added.items()
        for fact in facts
        if isinstance(fact.value, IriRef)
    ]


def _keep_in_memory(file: SourceFile) -> Callable[[], SourceFile]:
    return partial(same_file, file)


@dataclass(slots=True)
class LoadTransaction:
    """One atomic call of load: if it fails, the store is unchanged."""

    store: TripleStore
    packages: RosPackagePath
    sources: dict[Path, Source]
    """All loaded sources by resolved path; new ones are appended. Invalid after a failure."""
    store_text: Callable[[SourceFile], Callable[[], SourceFile]] = _keep_in_memory
    """Stores a text and returns a function that reads it."""
    urdf_paths: Iterable[Path] = ()
    """Robot descriptions whose links maps may refer to."""
    xacro_paths: Mapping[Path, Mapping[str, str]] = field(default_factory=dict)
    """The robot descriptions that are expanded if they contain xacro, by resolved path, with their arguments."""
    follow_imports: bool = True
    """Whether imported files that are not loaded yet are loaded."""
    untrusted: bool = False
    """Whether files that refer to anything that is not loaded are refused."""
    index_builder: IndexBuilder | None = None
    """Indexes what is loaded."""
    ontology_names: bool = True
    """Whether graphs are named like the ontologies in them; at an endpoint, a graph may have that name."""
    findings: list[Finding] = field(default_factory=list)
    assumptions: list[Assumption] = field(default_factory=list)
    _unresolved_imports: list[tuple[Source, str]] = field(default_factory=list)
    _may_use_soma: list[Path] = field(default_factory=list)

    def run(self, maps: Iterable[Path], ontologies: Iterable[Path]) -> None:
        """Loads files and everything that they import, each once.

        Raises:
            SourceParseError: one of the files cannot be read; the store is unchanged.
        """
        self._run([*((path, True, True) for path in maps), *((path, False, True) for path in ontologies)])

    def reload(self, sources: Iterable[Source]) -> None:
        """Loads sources that were loaded before and removed since.

        Raises:
            SourceParseError: one of the files cannot be read; the store is unchanged.
        """
        self._run([(source.path, source.is_map, source.is_explicit) for source in sources])

    def _run(self, requested: Iterable[tuple[Path, bool, bool]]) -> None:
        before = self.sources.keys() | set()
        try:
            robots = self._load_urdfs()
            requested = [(path.resolve(), is_map, is_explicit) for path, is_map, is_explicit in requested]
            # The class of a link depends on the known classes, so robot descriptions are loaded after the ontologies.
            maps = [each for each in requested if each[1] and (robots.urdf_robots or is_urdf(each[0]))]
            for batch in ([each for each in requested if each not in maps], maps):
                known = self.sources.keys() | set()
                for path, is_map, is_explicit in batch:
                    self._load(path, robots, is_map=is_map, is_explicit=is_explicit)
                self._follow_imports(known)
            if self.untrusted:
                for path, _, _ in requested:
                    self._refuse_imports(self.sources[path])
            self._align_soma()
            self.findings += robots.findings
            self.assumptions += robots.assumptions
        except BaseException:
            for path in self.sources.keys() - before:
                self.store.remove_graph(self.sources[path].graph)
            raise
        missing = self._not_loaded({iri for _, iri in self._unresolved_imports})
        for importer, iri in self._unresolved_imports:
            if iri in missing:
                self._report_missing_import(
                    importer, iri, "which is not among the sources nor in any of the given package folders"
                )

    def _load_urdfs(self) -> UrdfSources:
        robots = UrdfSources(self.packages, ClassNameIndex(self.store), self.xacro_paths, not self.follow_imports)
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
        if self.untrusted and is_explicit and (reference := external_reference(path.read_bytes())):
            raise ReferenceRefusedError(path.name, reference, remedy="remove it")
        file = read_map_file(path, urdf_sources) if is_map and urdf_sources else read_file(path)
        header = read_header(file)
        graph = self._graph_name(path, header)
        # Indexed while it is loaded, if an error ends the transaction: an import that fails is left out.
        indexed = self.index_builder.add(str(path), file, graph) if self.index_builder and is_explicit else None
        try:
            self._store_graph(file, graph)
        except SyntaxError as error:
            if self.index_builder and indexed:
                self.index_builder.discard(indexed)
                indexed = None
            repaired = file.repair(error)
            file = preprocess(repaired, urdf_sources) if is_map and urdf_sources else repaired
            header = read_header(file)
            graph = self._graph_name(path, header)
            self._load_repaired(file, graph)
        if self.index_builder and not indexed:
            self.index_builder.add(str(path), file, graph)
        self.findings += file.findings()
        if any(marker in file.data for marker in _ALIGNED_MARKERS) and not is_bundled(path, bundled_ontology()):
            self._may_use_soma.append(path)
        if is_map and (derived := _derived_map(file)):
            self.assumptions.append(derived)
        text = self.store_text(file)
        self.sources[path] = Source(str(path), graph, self.store, text, is_map, is_explicit, header)

    def _graph_name(self, path: Path, header: SourceHeader) -> ox.NamedNode:
        """A name that no other graph has, and that does not depend on the folder of the file."""
        if path.parent == bundled_ontology().parent:
            return ox.NamedNode(f"{BUNDLED_GRAPHS}{path.name}")
        by_file = f"{FILE_GRAPHS}{quote(os.fsencode(path.name))}"
        numbered = (f"{by_file}-{number}" for number in count(2))
        taken = {source.graph for source in self.sources.values()} | RESERVED_GRAPHS
        names = (header.ontology if self.ontology_names else "", by_file)
        nodes = (ox.NamedNode(name) for name in chain(filter(None, names), numbered))
        return next(node for node in nodes if node not in taken)

    def _load_repaired(self, file: SourceFile, graph: ox.NamedNode) -> None:
        try:
            self._store_graph(file, graph)
        except SyntaxError as error:
            raise file.parse_error(error) from error

    def _align_soma(self) -> None:
        """Loads the alignment of SOMA and DUL beside the household ontology, if a new source uses their terms."""
        if not any(is_bundled(path, bundled_ontology()) for path in self.sources):
            return
        for source in [self.sources[path] for path in self._may_use_soma if path in self.sources]:
            terms = source.terms_of(_ALIGNED_NAMESPACES)
            if terms:
                self.align(terms, sorted(source.maps()) or [Iri(source.name)])

    def align(self, terms: Sequence[Iri], maps: Iterable[Iri]) -> None:
        """Loads the alignment of SOMA and DUL, unless it is loaded, since these terms are used by some maps."""
        if not any(is_bundled(path, soma_alignment()) for path in self.sources):
            self._load(soma_alignment(), is_explicit=True)
        if terms:
            named = f"{', '.join(map(local_name, terms[:3]))}{f' and {len(terms) - 3} more' if terms[3:] else ''}"
            evidence = f"it uses {named}; the bundled soma.ttl, loaded as a source, states the corresponding terms"
            value = "terms of SOMA and DUL are aligned with KnowRob's"
            self.assumptions += [Assumption(each, "vocabulary", value, evidence) for each in maps]

    def _store_graph(self, file: SourceFile, graph: ox.NamedNode) -> None:
        try:
            self.store.load(file.data, file.format, base_iri=file.iri, to_graph=graph)
        except MemoryError as error:
            cause = "it, or a single literal in it, is too long to be held in memory"
            raise SourceParseError(str(file.path), cause=cause) from error

    def unreferenced(self) -> set[Path]:
        """Returns the sources that were not given by the user and are not imported any more."""
        needed = [path for path, source in self.sources.items() if source.is_explicit]
        for path in needed:
            imported = (self._resolve_import(self.sources[path], iri) for iri in self.sources[path].imported_iris())
            needed += [path for path in imported if path in self.sources and path not in needed]
        return self.sources.keys() - set(needed)

    # -- imports -------------------------------------------------------------------------------------------------------

    def _follow_imports(self, loaded: Collection[Path]) -> None:
        queue = [source for path, source in self.sources.items() if path not in loaded]
        while queue:
            importer = queue.pop(0)
            for iri in importer.imported_iris():
                path = self._resolve_import(importer, iri)
                if path is None or path in self.sources:
                    continue
                try:
                    self._load(path)
                except SourceParseError as error:
                    self._report_missing_import(importer, iri, str(error), Severity.ERROR)
                else:
                    queue.append(self.sources[path])

    def _resolve_import(self, importer: Source, iri: str) -> Path | None:
        """Returns the file that an import refers to, or None; nothing is ever downloaded."""
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
                problem = f"but its suffix {path.suffix!r} is not that of a known format"
                self._report_missing_import(importer, iri, problem, Severity.ERROR)
                return None
        if path is not None and path in self.sources:
            return path
        if path is not None and not self.follow_imports:
            self._report_missing_import(importer, iri, "but its imports are not followed", Severity.ERROR)
            return None
        if path is not None and path.is_file():
            return path
        self._unresolved_imports.append((importer, iri))
        return None

    def _refuse_imports(self, importer: Source) -> None:
        """Checks that everything that a source imports is loaded; a path is refused in any case.

        Raises:
            ReferenceRefusedError: something is not.
        """
        names = importer.import_names()
        refused = self._not_loaded(names) | {name for name in names if name.startswith("file:")}
        if refused:
            shown, more = sorted(refused)[:_MAX_REFUSED_NAMES], len(refused) - _MAX_REFUSED_NAMES
            reference = f"imports {', '.join(shown)}{f' and {more} more' if more > 0 else ''}"
            remedy = "remove the import, or load that ontology together with the map on the command line"
            raise ReferenceRefusedError(importer.path.name, reference, remedy=remedy)

    def _not_loaded(self, iris: Collection[str]) -> set[str]:
        """Returns the imports that do not match an ontology IRI, a version IRI or the end of a path either."""
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
        problem, action = f"it imports {iri}, {reason}", "it is skipped"
        self.findings.append(Finding(severity, importer.name, IMPORTS, problem, action))


def _without_trailing_separator(iri: str) -> str:
    """Removes the trailing separator of a namespace, which imports of an ontology may or may not have."""
    return iri.rstrip("#/")


class SourceRegistry:
    """All sources of a knowledge base, in memory or in a store folder, and optionally at a SPARQL endpoint."""

    def __init__(self, *, folder: StrPath | None = None, endpoint: SparqlEndpoint | None = None) -> None:
        """Opens the sources; those of a store folder that have changed since are reloaded.

        Raises:
            StoreError: the store folder cannot be used.
        """
        self._directory: StoreDirectory | None = None
        self._endpoint: SparqlEndpointStore | None = None
        if folder is not None:
            from mindstage.knowledge.store_folder import StoreDirectory

            self._directory = StoreDirectory(Path(folder).absolute())
        if endpoint is not None:
            from mindstage.knowledge.endpoint import SparqlEndpointStore

            self._endpoint = SparqlEndpointStore(endpoint)
        self.store: TripleStore = self._endpoint or (self._directory.store if self._directory else OxigraphStore())
        self.sources: dict[Path, Source] = {}
        self.findings: dict[Finding, None] = {}
        self.conventions: dict[Path, UnitConventions] = {}
        self.assumptions: list[Assumption] = []
        """Assumptions about robot descriptions."""
        self.is_untrusted = False
        """Whether a file came over a port."""
        self._loading_findings: dict[Finding, None] = {}
        self._urdf_paths: dict[Path, None] = {}
        self._package_path = RosPackagePath()
        self._bundled: Path | None = None
        self._maps_by_source: dict[str, tuple[Iri, ...]] = {}
        self._graphs: dict[str, tuple[Graph, MapMembers]] = {}
        self._used_labels: set[str] = set()
        self._saved_index: StoreIndex | None = None
        self._is_endpoint_prepared = False

    # -- loading -------------------------------------------------------------------------------------------------------

    def open(self, *, bundled: bool) -> None:
        """Loads the contents of the store folder, or else the bundled ontology.

        Raises:
            StoreError: the store folder was created with the bundled ontology, and `bundled` is false.
        """
        if self._directory is None or self._directory.is_new:
            self._bundled = bundled_ontology() if bundled else None
            self.load([], [self._bundled] if self._bundled else [])
            return
        manifest = self._directory.manifest
        if manifest.bundled_ontology and not bundled:
            cause = "it was made with the bundled ontology"
            raise StoreError(str(self._directory.path), cause=cause, remedy="create another one without it")
        self._bundled = Path(manifest.bundled_ontology) if manifest.bundled_ontology else None
        self._restore(manifest)
        self.sources = self._directory.sources()
        self._loading_findings = dict.fromkeys(manifest.findings)
        self.findings.update(self._loading_findings)
        self._reload_changed(self._directory)

    def _restore(self, manifest: StoreManifest) -> None:
        self._package_path = RosPackagePath(map(Path, manifest.packages))
        self._urdf_paths = dict.fromkeys(map(Path, manifest.urdf))
        self.conventions = {Path(path): each for path, each in manifest.conventions.items()}
        self.assumptions = list(manifest.assumptions)

    def _manifest(self, findings: Iterable[Finding]) -> StoreManifest:
        from mindstage.knowledge.store_folder import StoreManifest

        return StoreManifest(
            bundled_ontology=str(self._bundled) if self._bundled else None,
            packages=tuple(map(str, self._package_path.folders)),
            urdf=tuple(map(str, self._urdf_paths)),
            conventions={str(path): each for path, each in self.conventions.items()},
            assumptions=tuple(self.assumptions),
            findings=tuple(findings),
        )

    def load(
        self,
        maps: Iterable[StrPath],
        ontologies: Iterable[StrPath],
        conventions: UnitConventions = UnitConventions(),  # noqa: B008 - it is frozen
        urdf: Iterable[StrPath] = (),
        follow_imports: bool = True,
        *,
        xacro: XacroRequest = False,
        untrusted: bool = False,
        builds_index: bool = True,
    ) -> list[ox.NamedNode]:
        """Loads files and everything that they import, and returns the graphs that are new.

        Args:
            maps: files of maps.
            ontologies: other files, and folders of packages.
            conventions: given conventions of the maps.
            urdf: robot descriptions that maps refer to.
            follow_imports: whether imported files are loaded.
            xacro: whether the given robot descriptions are expanded if they contain xacro, or the values of their
                arguments; None for those whose name ends in `.xacro`.
            untrusted: whether files that refer to anything that is not loaded are refused.
            builds_index: whether the index of a store folder is updated; otherwise `save_index` does so later.

        Raises:
            SourceParseError: one of the files cannot be read; nothing has changed then.
            ReferenceRefusedError: an untrusted file refers to something else; nothing has changed then.
            StoreError: the store folder is read-only.
        """
        entries = [os.fspath(entry) for entry in ontologies]
        folders = [Path(entry) for entry in entries if not entry.startswith("package:") and Path(entry).is_dir()]
        packages = RosPackagePath([*self._package_path.folders, *folders])
        files = [_resolve_entry(entry, packages) for entry in entries if Path(entry) not in folders]
        paths = [_resolve_entry(os.fspath(entry), packages) for entry in maps]
        new = {path.resolve() for path in (*paths, *files)} - self.sources.keys()
        robots = [_resolve_entry(os.fspath(entry), packages) for entry in urdf]
        urdf_paths = dict.fromkeys(path.resolve() for path in robots)
        asked = False if untrusted else xacro
        transaction = self._new_transaction(
            packages,
            urdf_paths=list(urdf_paths),
            xacro_paths={
                path.resolve(): arguments
                for path in (*paths, *robots)
                if (arguments := requested_arguments(path, asked)) is not None
            },
            follow_imports=follow_imports and not untrusted,
            untrusted=untrusted,
        )
        if builds_index and new and self._directory and (self._directory.is_new or self.saved_index()):
            from mindstage.knowledge.store_index import IndexBuilder

            saved = None if self._directory.is_new and not self.sources else self.saved_index()
            transaction.index_builder = IndexBuilder(self.store, saved)
        with ExitStack() as stack:
            if builder := transaction.index_builder:
                stack.callback(builder.close)
            if self._directory and (new or self._directory.is_new):
                stack.enter_context(self._directory.transaction())
            with self._directory.store.bulk() if self._directory else nullcontext():
                transaction.run(paths, files)
            new_sources = (source for path, source in transaction.sources.items() if path not in self.sources)
            graphs = [source.graph for source in new_sources if isinstance(source.graph, ox.NamedNode)]
            self._urdf_paths |= urdf_paths
            if conventions != UnitConventions():
                self.conventions |= dict.fromkeys((path.resolve() for path in paths), conventions)
            self._commit(transaction)
            self.is_untrusted |= untrusted
            if builder:
                reasoner = builder.reasoner()
                self._maps_by_source |= builder.maps_by_source
                self.save_index(reasoner, NameIndex(self.store, reasoner))
        return graphs

    @property
    def packages(self) -> tuple[Path, ...]:
        """The folders that are searched for ROS packages."""
        return tuple(self._package_path.folders)

    def find_file(self, name: str) -> Path | None:
        """Returns the file that a map refers to: in a package, or relative to a map; None if it does not exist."""
        if name.startswith("package:"):
            try:
                path = self._package_path.find(name)
            except ValueError:
                return None
            found = [(path, folder) for folder in self._package_path.folders] if path is not None else []
        else:
            maps = (source.path for source in self.sources.values() if source.is_map)
            found = [(path, map.parent) for map in maps if (path := file_from_iri(name, map)) is not None]
        outside = is_outside_request()
        return next((path for path, root in found if path.is_file() and (not outside or is_inside(path, root))), None)

    def package_folder(self, name: str) -> Path | None:
        """The folder of a ROS package among the folders that are searched; None if there is none."""
        return self._package_path.package_folder(name)

    def _new_transaction(self, packages: RosPackagePath, **options: Any) -> LoadTransaction:
        store_text = self._directory.store_text if self._directory else _keep_in_memory
        names = self._endpoint is None
        return LoadTransaction(self.store, packages, dict(self.sources), store_text, ontology_names=names, **options)

    def _commit(self, transaction: LoadTransaction) -> None:
        self._package_path, self.sources = transaction.packages, transaction.sources
        self._loading_findings |= dict.fromkeys(transaction.findings)
        self.findings |= dict.fromkeys(transaction.findings)
        self.assumptions += transaction.assumptions
        if self._directory and not self._directory.read_only:
            self._directory.commit(self._manifest(self._loading_findings), self.sources.values())

    def close(self) -> None:
        """Closes files, subprocesses and connections; may be called repeatedly."""
        self.store.close()

    def __getstate__(self) -> dict[str, Any]:
        """All sources with their texts; those of a store folder are restored in memory.

        Raises:
            TypeError: there is an endpoint, which other processes must not be connected to unasked.
        """
        if self._endpoint is not None:
            raise TypeError("a knowledge base at a SPARQL endpoint cannot be copied to another process")
        omitted = {"_directory", "_endpoint", "_graphs", "_saved_index"}
        return {name: value for name, value in self.__dict__.items() if name not in omitted}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= {**state, "_directory": None, "_endpoint": None, "_graphs": {}, "_saved_index": None}

    # -- archives ------------------------------------------------------------------------------------------------------

    def to_bytes(self) -> bytes:
        """All sources with their texts and all statements, as MessagePack; see `from_bytes`.

        Raises:
            InvalidArgumentError: there is an endpoint.
        """
        from mindstage.knowledge.store_folder import SourceArchive, SourceRecord

        if self._endpoint is not None:
            remedy = "load the files that it was filled from"
            raise InvalidArgumentError("a knowledge base at an endpoint", cause="it cannot be copied", remedy=remedy)
        files = {source: source.load_text() for source in self.sources.values()}
        records = (SourceRecord(path=each.name, format=file.format.media_type).of(each) for each, file in files.items())
        archive = SourceArchive(
            manifest=msgspec.structs.replace(self._manifest(self.findings), sources=tuple(records)),
            texts=tuple(file.data for file in files.values()),
            statements=ox.serialize(self.store.quads_for_pattern(None, None, None), format=ox.RdfFormat.N_QUADS) or b"",
        )
        try:
            return msgspec.msgpack.encode(archive)
        except UnicodeEncodeError:  # names of files that are not UTF-8
            values = msgspec.to_builtins(archive, builtin_types=(bytes,))
            return msgspec.msgpack.encode(values_without_surrogates(values))

    @classmethod
    def from_bytes(cls, data: bytes) -> SourceRegistry:
        """Sources in memory, from what `to_bytes` has returned; their files are not read.

        Raises:
            ValueError: the bytes are not valid.
        """
        from mindstage.knowledge.store_folder import SourceArchive

        archive = msgspec.msgpack.decode(data, type=SourceArchive)
        registry = cls()
        try:
            registry.store.extend(ox.parse(archive.statements, ox.RdfFormat.N_QUADS))
        except SyntaxError as error:
            raise ValueError(f"the archived statements cannot be read: {error}") from error
        for each, text in zip(archive.manifest.sources, archive.texts, strict=True):
            path, format = Path(each.path), ox.RdfFormat.from_media_type(each.format)
            if format is None:
                raise ValueError(f"the format {each.format!r} of {each.path} is unknown")
            graph = ox.NamedNode(each.graph) if each.graph else ox.DefaultGraph()
            loader = _keep_in_memory(SourceFile(path, text, format))
            registry.sources[path] = each.source(graph, registry.store, loader)
        registry._restore(archive.manifest)
        registry.findings = dict.fromkeys(archive.manifest.findings)
        return registry

    # -- changed sources -----------------------------------------------------------------------------------------------

    def _reload_changed(self, directory: StoreDirectory) -> None:
        """Reloads and reports sources that have changed since they were stored, including the bundled ontology."""
        changed = [self.sources[path] for path in directory.changed_sources() if path != self._bundled]
        if directory.read_only:
            for source in changed:
                self._add_finding(
                    Severity.WARNING,
                    source.path,
                    _CHANGED_MESSAGE,
                    "the stored version is used: the folder is read-only",
                )
            return
        readable = [source for source in changed if self._can_be_read(source.path)]
        if not all(self._can_be_read(path) for path in self._urdf_paths if path.is_file()):
            readable = [source for source in readable if not source.is_map]  # maps would lose the poses of links
        outdated = (
            self.sources.get(self._bundled)
            if self._bundled and not directory.contains_version_of(bundled_ontology())
            else None
        )
        if not readable and not outdated:
            return
        with directory.transaction():
            self._reload(readable, outdated=outdated)
        for source in (*readable, *([outdated] if outdated else [])):
            self._add_finding(Severity.WARNING, source.path, _CHANGED_MESSAGE, "it is reloaded")

    def _reload(self, changed: Sequence[Source], *, outdated: Source | None) -> None:
        self.store.remove_graph(INFERRED_GRAPH)  # its statements may not follow any more
        before = dict.fromkeys(self.sources)
        for source in (*changed, *([outdated] if outdated else [])):
            self._remove(self.sources.pop(source.path))
        urdf_paths = [path for path in self._urdf_paths if path.is_file()]
        transaction = self._new_transaction(self._package_path, urdf_paths=urdf_paths)
        if outdated:
            self._bundled = bundled_ontology()
            transaction.run([], [self._bundled])
        transaction.reload(changed)
        for path in transaction.unreferenced():
            self._remove(transaction.sources.pop(path))
        order = [path for path in (*before, *transaction.sources) if path in transaction.sources]
        transaction.sources = {path: transaction.sources[path] for path in dict.fromkeys(order)}
        self._commit(transaction)

    def _remove(self, source: Source) -> None:
        if isinstance(source.graph, ox.NamedNode):
            self.store.remove_graph(source.graph)
        for finding in [finding for finding in self._loading_findings if finding.individual == source.name]:
            self._loading_findings.pop(finding)
            self.findings.pop(finding, None)

    def _can_be_read(self, path: Path) -> bool:
        try:
            if is_urdf(path):
                from mindstage.maps.urdf.parse import read_urdf

                read_urdf(path, self._package_path)
                return True
            file = read_file(path)
            try:
                deque(ox.parse(file.data, file.format, base_iri=file.iri), maxlen=0)
            except SyntaxError as error:
                file.repair(error)
        except SourceParseError as error:
            self._add_finding(Severity.ERROR, path, f"{_CHANGED_MESSAGE}, and: {error}", "the stored version is used")
            return False
        return True

    def _add_finding(self, severity: Severity, path: Path, problem: str, action: str) -> None:
        self.findings[Finding(severity, str(path), "", problem, action)] = None

    # -- index ---------------------------------------------------------------------------------------------------------

    def saved_index(self) -> StoreIndex | None:
        """Returns the index in the store folder, if it is that of the current statements; a damaged one is reported."""
        directory = self._directory
        if directory is None or not directory.index.may_be_current:
            self._saved_index = None
        elif self._saved_index is None and not directory.index.problem:
            self._saved_index = directory.index.load()
            if directory.index.problem:
                problem = f"its index cannot be used: {directory.index.problem}"
                self._add_finding(Severity.WARNING, directory.path, problem, "it is rebuilt")
            if self._saved_index:
                self._maps_by_source |= self._saved_index.maps_by_source
        return self._saved_index

    def needs_index(self) -> bool:
        """Whether there is a store folder without an index of the current statements."""
        directory = self._directory
        return directory is not None and not directory.read_only and not directory.index.is_current

    def release_saved_index(self) -> None:
        """Drops the index from memory; it is read again if it is needed again."""
        self._saved_index = None

    def save_index(self, reasoner: Reasoner, names: NameIndex) -> None:
        """Saves an index in the store folder."""
        if self._directory and not self._directory.read_only:
            for source in self.sources.values():
                self.maps_in(source)
            maps = {name: each for name, each in self._maps_by_source.items() if name in map(str, self.sources)}
            plain = {name: each for name, each in maps.items() if not any(map.startswith("_:") for map in each)}
            self._directory.index.save(reasoner, names, maps_by_source=plain)
            self._saved_index = None

    def prepare_endpoint(self) -> None:
        """Infers which maps the individuals at the endpoint are in, and aligns SOMA's and DUL's terms, as for files.

        The alignment is loaded beside the household ontology, if the endpoint uses these terms.

        Raises:
            EndpointUnreachableError: the server does not respond, or not in time.
            EndpointError: the server refuses the request.
        """
        if self._endpoint is None or self._is_endpoint_prepared:
            return
        self._endpoint.infer_membership()
        terms = self._endpoint.terms_of(_ALIGNED_NAMESPACES) if self._bundled else []
        self._is_endpoint_prepared = True
        if terms:
            transaction = self._new_transaction(self._package_path)
            maps = [map for source in self._endpoint.sources() for map in source.maps()]
            transaction.align(terms, dict.fromkeys(maps))
            self._commit(transaction)

    @property
    def has_endpoint(self) -> bool:
        """Whether an endpoint evaluates queries."""
        return self._endpoint is not None

    def graph_names(self) -> tuple[dict[str, str], frozenset[str]]:
        """Returns other names of graphs, which no two graphs have in common, with their names; and all their names."""
        known = frozenset(node.value for node in RESERVED_GRAPHS) | {
            source.graph.value for source in self.sources.values() if isinstance(source.graph, ox.NamedNode)
        }
        aliases: dict[str, set[str]] = {}
        for path, source in self.sources.items():
            name = source.graph.value if isinstance(source.graph, ox.NamedNode) else ""
            for other in (path.as_uri(), path.name, source.header.ontology):
                aliases.setdefault(other, set()).add(name)
        return {other: min(names) for other, names in aliases.items() if other and len(names) == 1}, known

    def digest(self) -> bytes | None:
        """Returns a digest of all sources and of how they are read; None if other programs can change the statements.

        Worlds that are read from registries with equal digests are equal.
        """
        if self._directory or self._endpoint:
            return None
        parts = blake2b(digest_size=16)
        for path, source in self.sources.items():
            file = source.load_text()
            given = repr((source.name, file.format, str(source.graph), source.is_map, self.conventions.get(path)))
            for part in (given.encode(), file.data):
                parts.update(b"%d " % len(part))
                parts.update(part)
        return parts.digest()

    # -- graphs --------------------------------------------------------------------------------------------------------

    def all_sources(self) -> list[Source]:
        """Returns every source, with the graphs of the endpoint last."""
        self.prepare_endpoint()
        return [*self.sources.values(), *(self._endpoint.sources() if self._endpoint else ())]

    def map_sources(self) -> list[Source]:
        """Returns the sources that worlds may be made from."""
        return [source for source in self.all_sources() if source.is_map or source.has_maps()]

    def class_geometry_sources(self) -> Iterator[Source]:
        """Returns the ontologies that give sizes or meshes; those in the sources of maps are read with the maps."""
        maps = {source.name for source in self.map_sources()}
        return (source for source in self.all_sources() if source.name not in maps and source.has_class_geometry())

    def maps_in(self, source: Source) -> tuple[Iri, ...]:
        """Returns the maps that a source describes, in its order.

        If there are several, they are taken from the index of the store folder, or else the source is parsed.
        """
        if source.name not in self._maps_by_source:
            maps = source.maps()
            is_plain = len(maps) < 2 and not any(map.startswith("_:") for map in maps)
            if is_plain or self.saved_index() is None or source.name not in self._maps_by_source:
                self._maps_by_source[source.name] = tuple(maps if is_plain else self.source_graph(source)[1])
        return self._maps_by_source[source.name]

    def map_graph(self, map: Iri) -> tuple[Graph, MapMembers]:
        """Returns the graph of a map: of sources that describe it, and of those given as maps that describe none."""
        maps = [(source, self.maps_in(source)) for source in self.map_sources()]
        graphs = [self.source_graph(source) for source, described in maps if map in described or not described]
        if len(graphs) == 1:
            return graphs[0]
        graph = merge_graphs([graph for graph, _ in graphs])
        return graph, individuals_by_map(graph)

    def implied_members(self, map: Iri) -> frozenset[Iri]:
        """Returns the individuals whose membership follows from the other statements about a map, and is not stated.

        The map itself is among them if its class is not stated. The result is empty if a single file with the
        statements about this map would imply something else, as it may if several sources describe the map.
        """
        graph, _ = self.map_graph(map)
        files = (source.load_text() for source in self.sources.values() if map in self.maps_in(source))
        implied = frozenset(subject for file in files for subject in _implied_subjects(file))
        if not implied:
            return implied
        members = without_other_maps(graph, map, individuals_by_map(graph))
        stated = {
            subject: [fact for fact in facts if not is_membership(fact, map)] if subject in implied else facts
            for subject, facts in members.items()
        }
        again = with_inferred_membership({subject: facts for subject, facts in stated.items() if facts})
        same = again.keys() == members.keys() and all(set(again[each]) == set(members[each]) for each in members)
        return implied if same else frozenset()

    def current_names(self, map: Iri) -> frozenset[str] | None:
        """Returns what sources of a map do not write in the old namespaces of KnowRob; None if none uses these."""
        found = [source.current_names() for source in self.sources.values() if map in self.maps_in(source)]
        used = [names for names in found if names is not None]
        return frozenset().union(*used) if used else None

    def source_graph(self, source: Source) -> tuple[Graph, MapMembers]:
        """Returns the exact statements of a source and the members of its maps; the result is cached.

        Raises:
            SourceParseError: it contains statements about statements, which a world cannot represent.
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
        raise SourceParseError(entry, cause=f"no package folder contains it; searched: {folders}")
    return path
