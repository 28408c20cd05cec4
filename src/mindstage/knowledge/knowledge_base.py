"""The knowledge base: what was loaded, as one store for questions and as one world for each map."""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from threading import RLock
from typing import Self

import pyoxigraph as ox

from mindstage.errors import AmbiguousMapError, InvalidArgumentError, MapNotFoundError
from mindstage.knowledge.analysis import MapStatistics, map_statistics
from mindstage.knowledge.answering import Answering
from mindstage.knowledge.bulk import gc_paused
from mindstage.knowledge.bundled import map_path
from mindstage.knowledge.findings import Finding, Severity
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reading.assumptions import Assumption
from mindstage.knowledge.reading.census import individuals_by_map, without_other_maps
from mindstage.knowledge.reading.conventions import UnitConventions
from mindstage.knowledge.reading.dialects import read_world
from mindstage.knowledge.reading.excerpt import SourceMap
from mindstage.knowledge.reading.origin import SourceMapView
from mindstage.knowledge.shaping import ShapeRule, ShapeRuleResolver
from mindstage.knowledge.sources.library import SourceRegistry, StrPath
from mindstage.knowledge.stores.endpoint import SparqlEndpoint
from mindstage.knowledge.stores.triplestore import TripleStore
from mindstage.knowledge.taxonomy import ClassHierarchy
from mindstage.knowledge.vocabulary import EQUIVALENT_CLASS, SUBCLASS_OF
from mindstage.knowledge.wording.nesting import nest_blank_nodes
from mindstage.world import Iri, World
from mindstage.world.display import counted

__all__ = ["KnowledgeBase"]


class KnowledgeBase(Answering):
    """Loads semantic maps and ontologies, and tells what they say.

    >>> from mindstage.knowledge import KnowledgeBase, bundled_kitchen
    >>> knowledge = KnowledgeBase()
    >>> knowledge.load(bundled_kitchen())
    >>> world = knowledge.world()
    """

    def __init__(
        self,
        *,
        bundled_ontology: bool = True,
        store: StrPath | None = None,
        endpoint: SparqlEndpoint | str | None = None,
    ) -> None:
        """Makes a knowledge base that knows nothing but, unless told otherwise, the bundled household ontology.

        Args:
            bundled_ontology: whether it knows that; a folder keeps what it was made with.
            store: a folder that keeps all that is loaded and told, and has it again when it is opened the next time.
                A source that has changed since is then read anew, and a finding says so.
            endpoint: a SPARQL server, with whose statements those loaded here are joined. What is told goes there.

        Raises:
            StoreError: the folder cannot be used, for the reason it gives.
            InvalidArgumentError: the endpoint's address is none, or both were given.
        """
        if store is not None and endpoint is not None:
            cause = "it is kept in a folder or at an endpoint, not in both"
            raise InvalidArgumentError("a knowledge base", cause=cause, remedy="give one of them")
        self.lock = RLock()
        self._registry = SourceRegistry(
            folder=store, endpoint=SparqlEndpoint(endpoint) if isinstance(endpoint, str) else endpoint
        )
        self._store = self._registry.store
        self._worlds: dict[Iri, World] = {}
        self._assumptions: dict[tuple[Iri, str], Assumption] = {}
        try:
            self._registry.open(bundled=bundled_ontology)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        names = [local_name(map) for map in self.maps()]
        listed = f" ({', '.join(names[:3])}{', …' if names[3:] else ''})" if names else ""
        sources = counted(len(self._registry.sources), "source")
        return f"<{type(self).__name__}: {counted(len(names), 'map')}{listed}, {sources}>"

    def close(self) -> None:
        """Lets go of the folder, which others may then open, and of processes; any number of times."""
        self._registry.close()

    def load(
        self,
        paths: StrPath | Iterable[StrPath],
        *,
        ontologies: StrPath | Iterable[StrPath] = (),
        conventions: UnitConventions = UnitConventions(),  # noqa: B008 - it is frozen
        urdf_files: StrPath | Iterable[StrPath] = (),
        follow_imports: bool = True,
    ) -> None:
        """Reads files and all that they import, transitively and each once.

        An import that is not there, or cannot be read, is a finding; the rest is loaded. Nothing is ever fetched.

        Args:
            paths: a map or several, or robots' descriptions (URDF, xacro); more may follow later, and they stay apart.
                "bundled:kitchen" is the kitchen that comes with Mindstage.
            ontologies: files, `package://NAME/rest`, or folders of ROS packages that such names are looked up in.
            conventions: units, frame and order of quaternions of these maps; what is None in it is decided by what the
                maps hold, and told as one of the `assumption_notes`.
            robots: descriptions that hold the places and joints of these maps, where those only name links.
            follow_imports: False for what a stranger wrote: then no other file is read, whatever it imports.

        Raises:
            SourceParseError: one of the files cannot be read, for the reason it gives; nothing has changed then.
            StoreError: the folder can only be read.
        """
        with self.lock:
            read = self._registry.load(
                list(map(map_path, _as_list(paths))),
                _as_list(ontologies),
                conventions,
                _as_list(urdf_files),
                follow_imports=follow_imports,
            )
            self._invalidate_all(read)

    def ontologies_only(self) -> KnowledgeBase:
        """Another one, in memory, that knows the same ontologies and no map: a map read there may be one of these anew.

        What is at an endpoint, or was told meanwhile, it does not know.
        """
        with self.lock:
            maps = {source.name for source in self._registry.map_sources()}
            ontologies = [path for path in self._registry.sources if str(path) not in maps]
            other = KnowledgeBase(bundled_ontology=False)
            other.load((), ontologies=[*self._registry.packages, *ontologies], follow_imports=False)
            return other

    @property
    def store(self) -> TripleStore:
        """Where its statements are kept."""
        return self._store

    def sources(self) -> tuple[Path, ...]:
        """The files that are loaded, imported ones among them."""
        return tuple(self._registry.sources)

    def maps(self) -> tuple[Iri, ...]:
        """The maps that are loaded, in the order of their sources."""
        found = (map for source in self._registry.map_sources() for map in self._registry.maps_in(source))
        return tuple(dict.fromkeys(found))

    def world(self, map: str | None = None) -> World:
        """One map as plain data.

        Args:
            map: its IRI or local name; None for the only one.

        Raises:
            MapNotFoundError: there is none, or none of that name.
            AmbiguousMapError: nobody said which one of several, or several have that local name.
        """
        with self.lock:
            iri = self._resolve_map(map)
            if iri not in self._worlds:
                with gc_paused():
                    self._worlds[iri] = read_world(self._source_map(iri))
            return self._worlds[iri]

    def source_view(self, map: str | None = None) -> SourceMapView:
        """What the sources tell of one map, before anybody makes a world of it.

        Raises:
            MapNotFoundError: there is none, or none of that name.
            AmbiguousMapError: nobody said which one of several, or several have that local name.
        """
        with self.lock:
            return SourceMapView(self._source_map(self._resolve_map(map)))

    def find_file(self, name: str) -> Path | None:
        """The file that the name of a mesh stands for (`package://…`, or a path beside its map), if it is at hand."""
        return self._registry.find_file(name)

    def map_statistics(self, map: str | None = None) -> MapStatistics:
        """One map in numbers.

        Raises:
            MapNotFoundError: there is none, or none of that name.
            AmbiguousMapError: nobody said which one of several, or several have that local name.
        """
        with self.lock:
            iri = self._resolve_map(map)
            graph, census = self._registry.map_graph(iri)
            return map_statistics(iri, graph, census[iri], self._taxonomy)

    def findings(self) -> tuple[Finding, ...]:
        """What was odd in the sources so far; loading and reading worlds adds to it."""
        return tuple(self._registry.findings)

    def assumptions(self) -> tuple[Assumption, ...]:
        """What had to be decided about the maps whose worlds were read so far, with the evidence."""
        return (*self._registry.assumptions, *self._assumptions.values())

    # -- classes -------------------------------------------------------------------------------------------------------

    def ancestors(self, cls: Iri) -> tuple[Iri, ...]:
        """The superclasses of a class, the nearest first, without itself."""
        return self._taxonomy.ancestors(cls)

    def descendants(self, cls: Iri) -> frozenset[Iri]:
        """The subclasses of a class at any depth, without itself."""
        return self._taxonomy.descendants(cls)

    def is_a(self, cls: Iri, ancestor: Iri) -> bool:
        """Whether one class is the other or below it."""
        return self._taxonomy.is_a(cls, ancestor)

    def shape_rule(self, cls: Iri) -> ShapeRule:
        """How things of a class are shaped, what of and whether they give light, as far as it is known or guessed."""
        with self.lock:
            return self._shape_resolver.rule(cls)

    @cached_property
    def _shape_resolver(self) -> ShapeRuleResolver:
        return ShapeRuleResolver(self._store, self._taxonomy)

    @cached_property
    def _taxonomy(self) -> ClassHierarchy:
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

    def _resolve_map(self, requested: str | None) -> Iri:
        maps = self.maps()
        named = [map for map in maps if requested is None or requested == map]
        named = named or [map for map in maps if requested == local_name(map)]
        if len(named) == 1:
            return named[0]
        if named:
            raise AmbiguousMapError(named)
        files = ", ".join(source.name for source in self._registry.all_sources() if source.is_map)
        raise MapNotFoundError(requested=requested if requested and maps else files, known=maps)

    def _source_map(self, map: Iri) -> SourceMap:
        graph, census = self._registry.map_graph(map)
        graph = nest_blank_nodes(without_other_maps(graph, map, census))
        # Nesting gives other labels to what has no name, individuals of the map among it.
        members = census[map] if graph.keys() >= set(census[map]) else individuals_by_map(graph).get(map, ())
        return SourceMap(
            map=map,
            graph=graph,
            members=members,
            ontologies=[
                nest_blank_nodes(self._registry.source_graph(source)[0]) for source in self._registry.size_sources()
            ],
            hierarchy=self._taxonomy,
            report=self._add_finding,
            add_assumption=self._add_assumption,
            conventions=self._conventions_of(map),
        )

    def _conventions_of(self, map: Iri) -> UnitConventions:
        """What the user said about the sources that tell of a map."""
        library = self._registry
        told = (
            library.conventions.get(source.path) for source in library.map_sources() if map in library.maps_in(source)
        )
        return next((each for each in told if each), UnitConventions())

    def _add_assumption(self, assumption: Assumption) -> None:
        self._assumptions[assumption.map, assumption.topic] = assumption

    def _add_finding(self, severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
        self._registry.findings[Finding(severity, individual, property, problem, action)] = None


def _as_list(paths: StrPath | Iterable[StrPath]) -> list[str]:
    return [os.fspath(path) for path in ([paths] if isinstance(paths, str | os.PathLike) else paths)]
