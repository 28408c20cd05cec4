"""The knowledge base: loaded maps and ontologies as one triple store for questions, and each map as a world.

Nothing is indexed before it is first used. A change updates only what depends on it, and answers are cached until then.
Methods may be called from any thread: `KnowledgeBase.lock` serializes them.
"""

from __future__ import annotations

import atexit
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from threading import Lock, RLock
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast, overload
from weakref import ref

import msgspec
import pyoxigraph as ox

from mindstage.access.limits import Timeout
from mindstage.errors import AmbiguousMapError, InvalidArgumentError, MapNotFoundError
from mindstage.knowledge.history import NOW, EpisodeSource, QuestionTime, histories_of, time_arguments
from mindstage.knowledge.names import NameIndex
from mindstage.knowledge.over_time import argument_names, ask_over_time, episode_source, state_of_time
from mindstage.knowledge.owl import node_label
from mindstage.knowledge.owl_rl import INFERRED_GRAPH, InferredTriples, materialize_owl_rl
from mindstage.knowledge.questions import AnswerRow, Answers, Question, StateAccess, get_question
from mindstage.knowledge.reasoner import Reasoner
from mindstage.knowledge.sources import SourceRegistry, StrPath
from mindstage.knowledge.tell import RUNTIME_GRAPH, AssertableValue, AssertionStore
from mindstage.maps.dialects.conventions import Assumption, AssumptionSink, UnitConventions
from mindstage.maps.dialects.map_statistics import MapStatistics, map_statistics
from mindstage.maps.dialects.membership import individuals_by_map, without_other_maps
from mindstage.maps.dialects.source_map import MeshBounds, SourceMap
from mindstage.maps.io.files import event_ontology, map_path
from mindstage.ranges import Time, checked
from mindstage.rdf.graphs import (
    PREFIXES,
    PRESENT_GRAPH,
    Finding,
    FindingSink,
    ObjectNode,
    Severity,
    SparqlResult,
    TripleStore,
    gc_paused,
    local_name,
    node_to_look_up,
    quads_with_property,
)
from mindstage.rdf.taxonomy import ClassHierarchy
from mindstage.rdf.vocabulary import (
    DESCRIBED_IN_MAP,
    EQUIVALENT_CLASS,
    FIRST,
    INTERSECTION_OF,
    OWL,
    OWL_CLASS,
    REST,
    SUBCLASS_OF,
    TYPE,
    xsd,
)
from mindstage.scene import Body, FactValue, Iri, IriRef, Joint, Light, Literal, PropertyAssertion, Vector, World
from mindstage.scene.display import counted

if TYPE_CHECKING:  # not every program needs these
    from mindstage.knowledge.endpoint import SparqlEndpoint
    from mindstage.knowledge.shape_rules import ShapeRule, ShapeRuleResolver
    from mindstage.knowledge.sparql_query import QueryPrefixes
    from mindstage.knowledge.world_cache import WorldCache
    from mindstage.maps.io.graph_diff import SourceMapView
    from mindstage.maps.urdf.xacro_process import XacroRequest

__all__ = ["AnswerCache", "KnowledgeBase"]


R = TypeVar("R", bound=AnswerRow)
T = TypeVar("T")
CacheKey = tuple[object, ...]
_MAX_DERIVED = 8
"""The number of values that `KnowledgeBase.cached` keeps; each may be a simulated map."""


class _KnowledgeArchive(msgspec.Struct, frozen=True, kw_only=True):
    sources: bytes
    worlds: dict[Iri, World]
    """The worlds that were read."""
    assumptions: tuple[Assumption, ...] = ()
    """Those that were made of them."""


class AnswerCache:
    """The most recent answers, up to a maximum number of rows."""

    def __init__(self, max_rows: int = 50_000) -> None:
        """Creates an empty cache.

        Args:
            max_rows: the maximum number of rows; an answer without rows counts as one.
        """
        self._max_rows = max_rows
        self._row_count = 0
        self._lock = Lock()
        self._answers: dict[CacheKey, Answers[Any]] = {}

    def get(self, key: CacheKey) -> Answers[Any] | None:
        """The cached answers for a key; None if there are none.

        Raises:
            TypeError: the key is not hashable.
        """
        return self._answers.get(key)

    def put(self, key: CacheKey, answers: Answers[Any]) -> None:
        """Caches answers, and removes the oldest ones as needed."""
        size = max(1, len(answers))
        with self._lock:
            if size > self._max_rows or key in self._answers:
                return
            while self._row_count + size > self._max_rows:
                self._row_count -= max(1, len(self._answers.pop(next(iter(self._answers)))))
            self._answers[key] = answers
            self._row_count += size


class KnowledgeBase:
    """Loads semantic maps and ontologies, reads worlds from the maps and answers questions about both.

    >>> from mindstage.knowledge import KnowledgeBase
    >>> from mindstage.maps import bundled_kitchen
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
        """Creates a knowledge base that contains the bundled household ontology only, or nothing.

        Args:
            bundled_ontology: whether to load the bundled ontology; an existing folder keeps the choice that it was
                created with.
            store: a folder that persists everything that is loaded and asserted. Sources that have changed since the
                folder was last open are read again, which is reported as a finding.
            endpoint: a SPARQL server whose statements are joined with the sources that are loaded here. Assertions are
                written to it.

        Raises:
            StoreError: the folder cannot be used, for the stated reason.
            InvalidArgumentError: the endpoint's address is not a URL, or both `store` and `endpoint` were given.
        """
        if store is not None and endpoint is not None:
            cause = "it is kept in a folder or at an endpoint, not in both"
            raise InvalidArgumentError("a knowledge base", cause=cause, remedy="give one of them")
        self.lock = RLock()
        """Serializes reads and writes; hold it for several reads of `reasoner` that must be consistent."""
        if isinstance(endpoint, str):
            from mindstage.knowledge.endpoint import SparqlEndpoint

            endpoint = SparqlEndpoint(endpoint)
        self._registry = SourceRegistry(folder=store, endpoint=endpoint)
        self._store = self._registry.store
        self._worlds: dict[Iri, World] = {}
        self._stated_worlds: dict[Iri, World] = {}
        """Those that follow from the statements of their maps alone, as far as they were read."""
        self._assumptions: dict[tuple[Iri, str], Assumption] = {}
        self._mesh_bounds: MeshBounds | None = None
        self._world_cache: WorldCache | None = None
        self._is_as_loaded = True
        self._is_index_due = False
        self._at_exit: Callable[[], None] | None = None
        self._change_callbacks: list[Callable[[Sequence[ox.Quad] | None], None]] = []
        self._episodes: tuple[EpisodeSource, ...] = ()
        try:
            self._registry.open(bundled=bundled_ontology)
        except BaseException:
            self.close()
            raise
        if store is not None:
            self._at_exit = partial(_save_index_of, ref(self))
            atexit.register(self._at_exit)

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
        """Ends the query processes and closes the folder, which others may then open. May be called repeatedly."""
        if self._at_exit is not None:
            self._at_exit()
            atexit.unregister(self._at_exit)
            self._at_exit = None
        self._registry.close()
        self._drop_cached("_answer_cache")  # answers about classes refer to the knowledge base

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs for an equal knowledge base, which is kept in memory there.

        Raises:
            TypeError: there is a SPARQL endpoint.
        """
        with self.lock:
            kept = ("_registry", "_worlds", "_assumptions", "_mesh_bounds")
            return {name: self.__dict__[name] for name in kept}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self.lock = RLock()
        self._store = self._registry.store
        self._world_cache, self._is_as_loaded = None, False
        self._is_index_due, self._at_exit = False, None
        self._stated_worlds = {}
        self._change_callbacks = []
        self._episodes = ()

    def to_bytes(self) -> bytes:
        """All sources, statements, worlds and assumptions; `from_bytes` makes an equal knowledge base of them anywhere.

        Raises:
            InvalidArgumentError: there is a SPARQL endpoint.
        """
        with self.lock:
            assumptions = tuple(self._assumptions.values())
            archive = _KnowledgeArchive(
                sources=self._registry.to_bytes(), worlds=dict(self._worlds), assumptions=assumptions
            )
        return msgspec.msgpack.encode(archive)

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """A knowledge base in memory, from what `to_bytes` has returned; no file is read.

        Raises:
            ValueError: the bytes are not valid.
        """
        archive = msgspec.msgpack.decode(data, type=_KnowledgeArchive)
        knowledge = cls(bundled_ontology=False)
        knowledge._registry = SourceRegistry.from_bytes(archive.sources)
        knowledge._store = knowledge._registry.store
        knowledge._worlds = dict(archive.worlds)
        knowledge._assumptions = {(each.map, each.topic): each for each in archive.assumptions}
        return knowledge

    def _save_index(self) -> None:
        """Saves what questions need in the folder of the store, if it is not there."""
        with self.lock:
            if "reasoner" in self.__dict__ and self._registry.needs_index():
                self._registry.save_index(self.reasoner, self.names)
            self._is_index_due = False

    # -- sources and maps ----------------------------------------------------------------------------------------------

    def load(
        self,
        paths: StrPath | Iterable[StrPath],
        *,
        ontologies: StrPath | Iterable[StrPath] = (),
        conventions: UnitConventions = UnitConventions(),  # noqa: B008 - it is frozen
        urdf: StrPath | Iterable[StrPath] = (),
        xacro: XacroRequest = None,
        follow_imports: bool = True,
        untrusted: bool = False,
    ) -> None:
        """Reads files and everything that they import, transitively and each file once.

        An import that is missing or cannot be read is reported as a finding, and the rest is loaded. Nothing is ever
        fetched from the network.

        Args:
            paths: one or several maps or robot descriptions (URDF, xacro). Maps from different calls stay separate.
                "bundled:kitchen" is the kitchen that comes with Mindstage.
            ontologies: files, `package://NAME/rest`, or folders of ROS packages to resolve such names in.
            conventions: units, handedness and quaternion order of these maps; what is None is detected from the maps
                and listed by `assumptions`.
            urdf: robot descriptions that hold the poses and joints of maps that only name links.
            xacro: whether these robot descriptions are expanded if they contain xacro; by default those whose name ends
                in `.xacro`. A mapping gives the values of their arguments (`xacro:arg`), and asks for it too. Give
                False for names that the user has not chosen. The macros can only compute, and read files beside the
                description, in its package and in the given folders of packages.
            follow_imports: whether what they import is read; otherwise it is a finding.
            untrusted: True for files that came over a port: nothing else is read for them, and one that refers to
                something else is refused. An import of an ontology that is loaded already is accepted, by its IRI, its
                version or the end of its path in a package; a path (`file:`) never is.

        Raises:
            SourceParseError: one of the files cannot be read, for the stated reason; nothing has changed then.
            ReferenceRefusedError: an untrusted file refers to something that is not loaded; nothing has changed then.
            StoreError: the folder is read-only.
        """
        with self.lock:
            read = self._registry.load(
                list(map(map_path, _as_list(paths))),
                _as_list(ontologies),
                conventions,
                _as_list(urdf),
                follow_imports=follow_imports,
                xacro=xacro,
                untrusted=untrusted,
                builds_index="reasoner" not in self.__dict__,
            )
            self._invalidate_all(read)

    def ontologies_only(self) -> KnowledgeBase:
        """Another knowledge base, in memory, with the same ontologies and no map: the same map can be loaded there.

        Statements at an endpoint and assertions made at run time are not copied.
        """
        with self.lock:
            maps = {source.name for source in self._registry.map_sources()}
            ontologies = [path for path in self._registry.sources if str(path) not in maps]
            other = KnowledgeBase(bundled_ontology=False)
            other.load((), ontologies=[*self._registry.packages, *ontologies], follow_imports=False)
            return other

    @property
    def store(self) -> TripleStore:
        """The triple store with all statements."""
        return self._store

    def sources(self) -> tuple[Path, ...]:
        """The files that are loaded, including imported ones."""
        return tuple(self._registry.sources)

    def source_graph(self, path: StrPath) -> ox.NamedNode:
        """The name of the graph with the statements of a loaded file.

        It is the IRI of the ontology that the file declares, else `urn:mindstage:file:NAME`; that of a bundled file is
        `urn:mindstage:bundled:NAME`.

        Raises:
            InvalidArgumentError: the file is not loaded.
        """
        source = self._registry.sources.get(Path(path).resolve())
        if source is None or not isinstance(source.graph, ox.NamedNode):
            raise InvalidArgumentError(os.fspath(path), cause="it is not loaded", remedy="load it first")
        return source.graph

    def package_folder(self, name: str) -> Path | None:
        """The folder of a ROS package in one of the folders that were loaded; None if there is none."""
        return self._registry.package_folder(name)

    def on_change(self, callback: Callable[[Sequence[ox.Quad] | None], None]) -> None:
        """Registers a callback for every change of the store, with the lock held.

        Args:
            callback: receives the statements that were added or removed; None if any others may have been as well.
        """
        self._change_callbacks.append(callback)

    def is_stated(self, quad: ox.Quad) -> bool:
        """Whether the store has a statement in its graph."""
        return any(each == quad for each in self._store.quads_for_pattern(*quad.triple))

    def repeat_changes(self, changes: Iterable[tuple[ox.Quad, bool]]) -> None:
        """Repeats changes of an equal knowledge base, of which `on_change` has reported the statements.

        Args:
            changes: statements that were changed, each with whether it `is_stated` afterwards.
        """
        with self.lock:
            quads = []
            for quad, is_stated in changes:
                (self._store.add if is_stated else self._store.remove)(quad)
                quads.append(quad)
            self._invalidate(quads)

    def maps(self) -> tuple[Iri, ...]:
        """The maps that are loaded, in the order of their sources."""
        found = (map for source in self._registry.map_sources() for map in self._registry.maps_in(source))
        return tuple(dict.fromkeys(found))

    def world(self, map: str | None = None) -> World:
        """One map as a world.

        Args:
            map: its IRI or local name; None for the only one.

        Raises:
            MapNotFoundError: no map is loaded, or none has that name.
            AmbiguousMapError: several maps are loaded and no name was given, or several have that local name.
        """
        with self.lock:
            iri = self._resolve_map(map)
            if iri not in self._worlds:
                self._worlds[iri] = self._cached_world(iri) if self._world_cache else self._read_world(iri)
            return self._worlds[iri]

    def use_world_cache(self, folder: StrPath) -> None:
        """Takes worlds from a folder if they were read from the same files before, and otherwise writes them there.

        Args:
            folder: an existing folder of such worlds only; old ones are deleted.
        """
        from mindstage.knowledge.world_cache import WorldCache

        self._world_cache = WorldCache(Path(folder))

    def source_view(self, map: str | None = None) -> SourceMapView:
        """The statements of one map as its sources contain them, before a world is read from them.

        Raises:
            MapNotFoundError: no map is loaded, or none has that name.
            AmbiguousMapError: several maps are loaded and no name was given, or several have that local name.
        """
        from mindstage.maps.io.graph_diff import SourceMapView

        with self.lock:
            source_map = self._source_map(self._resolve_map(map))
            implied = self._registry.implied_members(source_map.map)
            names = self._registry.current_names(source_map.map)
            source_map = replace(source_map, implied_members=implied, current_names=names)
            return SourceMapView(source_map, world=self._stated_worlds.get(source_map.map))

    def find_file(self, name: str) -> Path | None:
        """The file that a mesh name refers to (`package://…`, or a path relative to its map); None if there is none."""
        return self._registry.find_file(name)

    def use_meshes(self, bounds: MeshBounds) -> None:
        """Takes the boxes of bodies from their meshes, where a map gives only world-aligned sizes or mesh pivots.

        Worlds that have been read already stay as they are.

        Args:
            bounds: reads the bounds of meshes (`MeshLibrary.bounds`).
        """
        with self.lock:
            self._mesh_bounds = bounds

    def stated_classes(self, individual: str) -> tuple[Iri, ...]:
        """The classes that an individual is stated to have, without those of OWL; empty for anything else."""
        quads = self._store.quads_for_pattern(node_to_look_up(Iri(individual)), ox.NamedNode(TYPE), None)
        names = (Iri(quad.object.value) for quad in quads if isinstance(quad.object, ox.NamedNode))
        return tuple(sorted({name for name in names if not name.startswith(OWL)}))

    def map_statistics(self, map: str | None = None) -> MapStatistics:
        """Counts of the classes, individuals, objects, joints and relations of one map.

        Raises:
            MapNotFoundError: no map is loaded, or none has that name.
            AmbiguousMapError: several maps are loaded and no name was given, or several have that local name.
        """
        with self.lock:
            iri = self._resolve_map(map)
            graph, census = self._registry.map_graph(iri)
            return map_statistics(iri, graph, census[iri], self._taxonomy)

    def findings(self) -> tuple[Finding, ...]:
        """Problems found in the sources so far; loading sources and reading worlds adds to them."""
        return tuple(self._registry.findings)

    def assumptions(self) -> tuple[Assumption, ...]:
        """Conventions that were detected for the maps whose worlds were read so far, with the evidence."""
        return (*self._registry.assumptions, *self._assumptions.values())

    # -- questions -----------------------------------------------------------------------------------------------------

    @overload
    def ask(self, question: Question[R], /, *positional: object, **args: object) -> Answers[R]: ...
    @overload
    def ask(self, question: str, /, *positional: object, **args: object) -> Answers[Any]: ...
    def ask(self, question: Question[Any] | str, /, *positional: object, **args: object) -> Answers[Any]:
        """All answers to a question.

        A question with several words, or with a question mark, is a plain sentence: `ask("where is the milk?")`. How it
        was understood is `Answers.question`, `Answers.args` and `Answers.notes`.

        Examples:
            >>> from mindstage.knowledge import KnowledgeBase
            >>> [row.place for row in KnowledgeBase().ask("storage_place", "CowsMilk")]
            ['http://knowrob.org/kb/knowrob.owl#Refrigerator']

        Args:
            question: its name, the question itself, which types the rows, or a sentence.
            *positional: arguments in the order of the question; None leaves one open.
            **args: arguments by name; those that are left out are open. Names of entities are local, with a prefix, or
                whole IRIs. A class stands for all its individuals where an individual is asked for. Of an episode (see
                `add_episode`) `at` is a time [s since its begin] that the question is about instead of the present;
                `during=(begin, end)`, `since` and `until` are an interval, in which each answer gets the intervals in
                which it is one; `episode` is the name of one of several.

        Raises:
            EpisodeError: there is no episode, or there are several and none is named.
            EpisodeTimeError: the episode has no state at that time.
            QuestionNotFoundError: no question has that name.
            SentenceNotUnderstoodError: no question is put like this sentence, or it has an unknown name.
            AmbiguousSentenceError: the sentence may mean several questions.
            InvalidArgumentError: the question has no such argument, or the value is not valid for it.
            NameNotFoundError: a name is unknown.
            AmbiguousNameError: several entities have a name.
        """
        time, args = time_arguments(args, declared=argument_names(question))
        declared, known, notes = _resolve_question(self, question, positional, args, is_past=time != NOW)
        if time != NOW or declared.about_past:
            return ask_over_time(self, declared, known, time=time, episodes=self._episodes, notes=notes)
        key = (declared, notes, *known.items())
        cache = self._answer_cache  # a change during the question drops this cache, and with it an outdated answer
        try:
            if (cached := cache.get(key)) is not None:
                return cached
        except TypeError:  # an unhashable value such as a list, which the question itself refuses
            key = ()
        answers = declared.ask(self, known, notes=notes)
        if self._is_index_due:
            self._save_index()
        if key and not declared.uses_current_state:
            cache.put(key, answers)
        return answers

    def add_episode(self, episode: object, *, name: str | None = None) -> str:
        """Makes an episode the past of this knowledge base: questions can be about any time of it.

        Args:
            episode: a `Recording` such as `Episode`, a `History`, or an `EpisodeSource` with many episodes.
            name: its name, by default its own.

        Returns:
            The name; empty for a source with many.

        Raises:
            InvalidArgumentError: it is none of these, or there is an episode of that name.
        """
        source = episode_source(episode, name)
        names = source.names()
        if known := {*names} & {each for source in self._episodes for each in source.names()}:
            cause, remedy = "there is an episode of that name", "give another name, or remove the other one"
            raise InvalidArgumentError(f"the episode {min(known)}", cause=cause, remedy=remedy)
        with self.lock:
            if event_ontology().resolve() not in self._registry.sources:
                self.load((), ontologies=event_ontology())
            self._episodes = (*self._episodes, source)
        return names[0] if len(names) == 1 else ""

    def remove_episode(self, name: str) -> None:
        """Forgets an episode, or all of a source that has it.

        Raises:
            InvalidArgumentError: there is none of that name.
        """
        histories_of(self._episodes, name)
        self._episodes = tuple(each for each in self._episodes if name not in each.names())

    @property
    def episodes(self) -> tuple[EpisodeSource, ...]:
        """The sources of episodes that were added."""
        return self._episodes

    def explain(self, question: Question[R] | str, row: R) -> tuple[str, ...]:
        """The statements and classes that led to an answer, one per line; empty for a question without explanations.

        Raises:
            QuestionNotFoundError: no question has that name.
            InvalidArgumentError: the row is not an answer to this question.
        """
        declared = _question(question)
        if not isinstance(row, declared.row):
            raise InvalidArgumentError(declared.name, cause=f"{type(row).__name__} is no answer to it")
        return declared.explain_answer(self, row)

    # -- statements ----------------------------------------------------------------------------------------------------

    def tell(self, subject: str, property: str, value: AssertableValue) -> bool:
        """Asserts a statement, which all later questions use. The worlds of maps are still read from their files only.

        A statement about a class holds for all its members: `tell("Breadbasket", "typePrimaryFunction-containerFor",
        "Bread")`. An unknown subject must be given with a prefix or as a whole IRI, and becomes a class by "subClassOf"
        or an individual by "type".

        Returns:
            Whether the statement is new.

        Raises:
            NameNotFoundError: a name is unknown.
            AmbiguousNameError: several entities have a name.
            InvalidArgumentError: the three do not form a statement.
        """
        with self.lock:
            quads = AssertionStore(self._store, self.reasoner, self.names).tell(subject, property, value)
            self._invalidate(quads)
        return bool(quads)

    def retract(self, subject: str, property: str, value: AssertableValue) -> bool:
        """Removes a statement, whether it was asserted at run time or read from a source.

        Statements that it was inferred from stay, and so do files and the worlds read from them. What `materialize` has
        added is dropped, since it may no longer follow.

        Returns:
            Whether there was such a statement.

        Raises:
            NameNotFoundError: a name is unknown.
            AmbiguousNameError: several entities have a name.
            InvalidArgumentError: the three do not form a statement.
        """
        with self.lock:
            quads = AssertionStore(self._store, self.reasoner, self.names).retract(subject, property, value)
            self._invalidate(quads)
            if quads:
                self.forget_derived()
        return bool(quads)

    def materialize(self) -> int:
        """Adds everything that follows by the rules of OWL 2 RL, and returns the number of statements added.

        The usual questions do not need it, since they follow classes, parts and poses themselves. It finds the rest,
        for example individuals that are the same because a property is functional, and what follows from that. It does
        not cover statements asserted or loaded later, and a retraction drops it. The worlds of maps do not change.

        Raises:
            ReasonerUnavailableError: the extra "closure" is not installed.
        """
        with self.lock:
            self.forget_derived()
            quads = list(materialize_owl_rl(self._store.quads_for_pattern(None, None, None)))
            self._store.extend(quads)
            self._invalidate_all()
        return len(quads)

    def forget_derived(self) -> bool:
        """Drops what `materialize` has added; returns whether there was anything."""
        with self.lock:
            if not InferredTriples(self._store):
                return False
            self._store.remove_graph(INFERRED_GRAPH)
            self._invalidate_all()
        return True

    @checked
    def sparql(
        self,
        query: str,
        *,
        timeout_s: Timeout = 30.0,
        allow_service: bool = False,
        present: StateAccess | None = None,
        at: Time | None = None,
        episode: str | None = None,
    ) -> SparqlResult:
        """Runs a SPARQL 1.1 query: the default graph is the union of all sources, and each source is a named graph.

        A graph has the name of the ontology in its file, else `urn:mindstage:file:NAME`. FROM and GRAPH also accept the
        name and the URL of the file. The graph `urn:mindstage:present` has the current state in the vocabulary of the
        map; it is made for a query that names it, and is never part of the union. So are the graphs
        `urn:mindstage:episode:NAME` with the events of episodes, see `mindstage.knowledge.event_graph`; all of them are
        made for a query with GRAPH and a variable.

        The prefixes knowrob, ms, owl, rdf, rdfs, xsd, dul and soma are declared, and those that the loaded files
        declare, unless they differ. The query runs in a separate process that is limited to 2 GiB of memory and ends at
        the timeout. With an endpoint, the server alone evaluates it.

        Args:
            query: SELECT, ASK, CONSTRUCT or DESCRIBE.
            timeout_s: time limit [s].
            allow_service: whether the query may use other servers (SERVICE).
            present: access to the current state; without it, that of the maps.
            at: a time of an episode [s], the state of which is then that of `urn:mindstage:present`.
            episode: the episode, if there are several; without `at`, the time is its end.

        Raises:
            SparqlSyntaxError: the query is not valid, not allowed, or its answer too large.
            EpisodeError: there is no episode, or there are several and none is named, or they have too many events.
            EpisodeTimeError: the episode has no state at that time.
            SparqlTimeoutError: the time limit was exceeded.
            EndpointUnreachableError: the endpoint does not respond.
            EndpointError: the endpoint refuses the query.
        """
        from mindstage.knowledge.sparql_query import SparqlText

        text, prefixes = SparqlText(query), self._prefix_table
        prefixes.check(text)
        names = prefixes.namespaces
        if at is not None or episode is not None:
            present = state_of_time(self, QuestionTime(at_s=at, episode=episode), self._episodes)
        events: dict[str, bytes] = {}
        if self._episodes:
            from mindstage.knowledge.event_graph import episode_statements

            events = episode_statements(text, names, self._episodes)
        state = b"".join(events.values()) if events else None
        if text.mentions(PRESENT_GRAPH.value, names):
            from mindstage.knowledge.present import present_statements

            state = (state or b"") + present_statements(self, present or StateAccess(self))
        if not self._registry.has_endpoint:
            aliases, known = self._registry.graph_names()
            text = text.with_graph_names(aliases, {*known, *events}, names)
        result = self._store.query(
            text.text, timeout_s=timeout_s, allow_service=allow_service, prefixes=names, present=state
        )
        return result.with_columns(text.sorted_columns(result.columns))

    # -- classes -------------------------------------------------------------------------------------------------------

    def ancestors(self, cls: Iri) -> tuple[Iri, ...]:
        """The superclasses of a class, the nearest first, without the class itself."""
        return self._taxonomy.ancestors(cls)

    def descendants(self, cls: Iri) -> frozenset[Iri]:
        """The subclasses of a class at any depth, without the class itself."""
        return self._taxonomy.descendants(cls)

    def is_a(self, cls: Iri, ancestor: Iri) -> bool:
        """Whether a class is another class or one of its subclasses."""
        return self._taxonomy.is_a(cls, ancestor)

    def shape_rule(self, cls: Iri) -> ShapeRule:
        """The shape, material and light of objects of a class, as far as they are declared or can be guessed."""
        with self.lock:
            return self._shape_resolver.rule(cls)

    # -- for the questions ---------------------------------------------------------------------------------------------

    @cached_property
    def reasoner(self) -> Reasoner:
        """The reasoner over all statements."""
        self._registry.prepare_endpoint()
        saved = self._registry.saved_index()
        self._is_index_due = saved is None and self._registry.needs_index()
        return saved.reasoner(self._store) if saved else Reasoner(self._store)

    @cached_property
    def names(self) -> NameIndex:
        """The index of names."""
        saved = self._registry.saved_index()
        reasoner = self.reasoner
        self._registry.release_saved_index()
        return saved.name_index(self._store, reasoner) if saved else NameIndex(self._store, reasoner)

    def facts_of(self, individual: Iri, *, runtime_only: bool = False) -> tuple[PropertyAssertion, ...]:
        """The asserted statements about an individual, without its classes and its map; blank nodes by label.

        Args:
            individual: its IRI, or `_:label`.
            runtime_only: whether to give only what was asserted at run time.
        """
        graph = RUNTIME_GRAPH if runtime_only else None
        quads = self._store.quads_for_pattern(node_to_look_up(individual), None, None, graph)
        facts = {
            PropertyAssertion(Iri(quad.predicate.value), _value(quad.object))
            for quad in quads
            if quad.graph_name != INFERRED_GRAPH and quad.predicate.value not in {TYPE, DESCRIBED_IN_MAP}
        }
        return tuple(sorted(facts, key=repr))

    def statements(
        self, *, property: Iri | None = None, runtime_only: bool = False
    ) -> tuple[tuple[Iri, PropertyAssertion], ...]:
        """All asserted statements with a property, or all that were asserted at run time, with their subjects."""
        predicate = None if property is None else node_to_look_up(property)
        if isinstance(predicate, ox.BlankNode):  # not an IRI
            return ()
        quads = self._store.quads_for_pattern(None, predicate, None, RUNTIME_GRAPH if runtime_only else None)
        return tuple(
            (Iri(quad.subject.value), PropertyAssertion(Iri(quad.predicate.value), _value(quad.object)))
            for quad in quads
            if quad.graph_name != INFERRED_GRAPH and isinstance(quad.subject, ox.NamedNode)
        )

    def scene_entity(self, individual: Iri, map: Iri) -> Body | Joint | Light | None:
        """The body, joint or light of a map that an individual describes; None if it has no pose there."""
        if map not in self._scene_entities:
            world = self.world(map) if map in self.maps() else World(iri=map)
            entities: Iterable[Body | Joint | Light] = chain(world.bodies, world.joints, world.lights)
            self._scene_entities[map] = {each.iri: each for each in entities}
        return self._scene_entities[map].get(individual)

    @cached_property
    def _prefix_table(self) -> QueryPrefixes:
        from mindstage.knowledge.sparql_query import QueryPrefixes

        declared = ((path.name, source.header.prefixes) for path, source in self._registry.sources.items())
        return QueryPrefixes(PREFIXES, declared)

    @cached_property
    def _answer_cache(self) -> AnswerCache:
        return AnswerCache()

    def cached(self, key: object, make: Callable[[], T]) -> T:
        """A value that depends on the statements only, which is made once and kept until they change.

        The most recent values are kept. Another thread may make the same value meanwhile; one of them is kept then.
        """
        kept = self._derived
        if key not in kept:
            value = make()
            with self.lock:
                while len(kept) >= _MAX_DERIVED:
                    del kept[next(iter(kept))]
                kept.setdefault(key, value)
            return value
        return cast("T", kept[key])

    @cached_property
    def _derived(self) -> dict[object, object]:
        return {}

    @cached_property
    def _scene_entities(self) -> dict[Iri, dict[Iri, Body | Joint | Light]]:
        return {}

    @cached_property
    def _shape_resolver(self) -> ShapeRuleResolver:
        from mindstage.knowledge.shape_rules import ShapeRuleResolver

        return ShapeRuleResolver(self._store, self._taxonomy)

    @cached_property
    def _taxonomy(self) -> ClassHierarchy:
        """Built when it is first needed, and again after more was loaded."""
        self._registry.prepare_endpoint()
        pairs = []
        intersections = {
            quad.subject: self._list_members(quad.object) for quad in quads_with_property(self._store, INTERSECTION_OF)
        }
        for cls, members in intersections.items():
            if isinstance(cls, ox.NamedNode):
                pairs += [(Iri(cls.value), member) for member in members]
        for property in (SUBCLASS_OF, EQUIVALENT_CLASS):
            for quad in quads_with_property(self._store, property):
                if not isinstance(quad.subject, ox.NamedNode):
                    continue
                if isinstance(quad.object, ox.NamedNode):
                    pairs.append((Iri(quad.subject.value), Iri(quad.object.value)))
                    if property == EQUIVALENT_CLASS:
                        pairs.append((Iri(quad.object.value), Iri(quad.subject.value)))
                elif isinstance(quad.object, ox.BlankNode):
                    pairs += [(Iri(quad.subject.value), member) for member in intersections.get(quad.object, ())]
        return ClassHierarchy(pairs)

    def _list_members(self, node: ObjectNode) -> list[Iri]:
        """The named resources in an RDF list."""
        members: list[Iri] = []
        nodes = [node]
        for each in nodes:
            if isinstance(each, ox.BlankNode):
                first = self._store.quads_for_pattern(each, ox.NamedNode(FIRST), None)
                members += [Iri(quad.object.value) for quad in first if isinstance(quad.object, ox.NamedNode)]
                rest = self._store.quads_for_pattern(each, ox.NamedNode(REST), None)
                nodes += [quad.object for quad in rest if quad.object not in nodes]
        return members

    def _invalidate(self, quads: Sequence[ox.Quad]) -> None:
        """Updates what depends on these statements, which were added or removed."""
        self._is_as_loaded = False
        nodes = (node for quad in quads for node in quad.triple)
        self.names.add(Iri(node.value) for node in nodes if isinstance(node, ox.NamedNode))
        if self.reasoner.update(quads):  # the world of a map may have been read with other classes
            self._worlds.clear()
            self._drop_cached("_scene_entities", "_taxonomy")
        self._stated_worlds.clear()
        self._drop_cached("_answer_cache", "_derived", "_shape_resolver")
        self._report_change(quads)

    def _report_change(self, quads: Sequence[ox.Quad] | None) -> None:
        for callback in self._change_callbacks:
            callback(quads)

    def _invalidate_all(self, graphs: Iterable[ox.NamedNode] | None = None) -> None:
        """Drops everything that was derived from the statements.

        Args:
            graphs: the graphs that were added, which an existing reasoner and name index are updated with; None if
                anything else has changed.
        """
        if graphs is None:
            self._is_as_loaded = False
            self._drop_cached("reasoner", "names")
        elif "reasoner" in self.__dict__:
            names = [name for graph in graphs for name in self.reasoner.add_graph(graph)]
            self.names.add(names)
        self._worlds.clear()
        self._stated_worlds.clear()
        self._drop_cached(
            "_scene_entities", "_taxonomy", "_answer_cache", "_derived", "_shape_resolver", "_prefix_table"
        )
        self._report_change(None)

    def _drop_cached(self, *names: str) -> None:
        for name in names:
            self.__dict__.pop(name, None)

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
        from mindstage.maps.rdf_mapping.nested import nest_blank_nodes

        graph, census = self._registry.map_graph(map)
        graph = nest_blank_nodes(without_other_maps(graph, map, census))
        # Nesting relabels blank nodes, which individuals of the map may be.
        members = census[map] if graph.keys() >= set(census[map]) else individuals_by_map(graph).get(map, ())
        return SourceMap(
            map=map,
            graph=graph,
            members=members,
            ontologies=[
                nest_blank_nodes(self._registry.source_graph(source)[0])
                for source in self._registry.class_geometry_sources()
            ],
            hierarchy=self._taxonomy,
            report=self._add_finding,
            add_assumption=self._add_assumption,
            conventions=self._conventions_of(map),
            mesh_bounds=self._mesh_bounds,
            is_untrusted=self._registry.is_untrusted,
        )

    def _read_world(
        self, map: Iri, *, report: FindingSink | None = None, assume: AssumptionSink | None = None
    ) -> World:
        """Reads a map; findings and assumptions are added to those of this knowledge base, unless there are sinks."""
        from mindstage.knowledge.map_checks import report_implausible
        from mindstage.knowledge.portable_bodies import with_portable_bodies
        from mindstage.maps.dialects.detection import read_world  # many questions need no world

        with gc_paused():
            source_map = self._source_map(map)
            report, assume = report or source_map.report, assume or source_map.add_assumption
            source_map = replace(source_map, report=report, add_assumption=assume)
            bounds = _RecordedBounds(source_map.mesh_bounds)
            stated = read_world(replace(source_map, mesh_bounds=bounds))
            if source_map.conventions == UnitConventions() and not bounds.found:
                self._stated_worlds[map] = stated
            world = with_portable_bodies(stated, source_map, self.shape_rule)
            report_implausible(world, source_map, self._declared_classes)
            return world

    def _declared_classes(self) -> Iterator[Iri]:
        quads = self._store.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(OWL_CLASS))
        return (Iri(quad.subject.value) for quad in quads if isinstance(quad.subject, ox.NamedNode))

    def _cached_world(self, map: Iri) -> World:
        """The world of a map from the cache, or else read and written there."""
        from mindstage.knowledge.world_cache import WorldReading

        sources = self._registry.digest() if self._is_as_loaded and self._mesh_bounds is None else None
        if self._world_cache is None or sources is None:
            return self._read_world(map)
        reading = self._world_cache.get(map, sources)
        if reading is None:
            findings: list[Finding] = []
            assumptions: list[Assumption] = []

            def assume(assumption: Assumption) -> None:
                assumptions.append(assumption)

            world = self._read_world(map, report=lambda *fields: findings.append(Finding(*fields)), assume=assume)
            reading = WorldReading(world=world, findings=tuple(findings), assumptions=tuple(assumptions))
            self._world_cache.put(map, sources, reading)
        self._registry.findings |= dict.fromkeys(reading.findings)
        for assumption in reading.assumptions:
            self._add_assumption(assumption)
        return reading.world

    def _conventions_of(self, map: Iri) -> UnitConventions:
        """The conventions that were given for the sources that describe a map."""
        registry = self._registry
        given = (
            registry.conventions.get(source.path)
            for source in registry.map_sources()
            if map in registry.maps_in(source)
        )
        return next((each for each in given if each), UnitConventions())

    def _add_assumption(self, assumption: Assumption) -> None:
        self._assumptions[assumption.map, assumption.topic] = assumption

    def _add_finding(self, severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
        self._registry.findings[Finding(severity, individual, property, problem, action)] = None


class _RecordedBounds:
    """Bounds of meshes, and whether any was found."""

    def __init__(self, bounds: MeshBounds | None) -> None:
        self._bounds = bounds
        self.found = False

    def __call__(self, meshes: Sequence[tuple[str | None, Iri]]) -> Sequence[tuple[Vector, Vector] | None]:
        bounds = self._bounds(meshes) if self._bounds else [None] * len(meshes)
        self.found |= any(bounds)
        return bounds


def _resolve_question(
    kb: KnowledgeBase,
    question: Question[Any] | str,
    positional: Sequence[object],
    args: Mapping[str, object],
    *,
    is_past: bool,
) -> tuple[Question[Any], Mapping[str, object], tuple[str, ...]]:
    """The question of a sentence, its arguments, and how it was understood; of any other question, the question."""
    if not isinstance(question, str) or question.isidentifier():  # without loading the matcher
        declared = _question(question)
        return declared, declared.bind(positional, args), ()
    from mindstage.knowledge.sentences import resolve_question

    return resolve_question(kb, question, args, positional=positional, is_past=is_past)


def _save_index_of(knowledge: ref[KnowledgeBase]) -> None:
    """Saves the index of a knowledge base that still exists."""
    if (existing := knowledge()) is not None:
        existing._save_index()


def _question(question: Question[R] | str) -> Question[Any]:
    return get_question(question) if isinstance(question, str) else question


def _value(node: object) -> FactValue:
    if isinstance(node, ox.Literal):
        datatype = None if node.language or node.datatype.value == xsd("string") else Iri(node.datatype.value)
        return Literal(node.value, datatype, node.language)
    return IriRef(node_label(node) or Iri(str(node)))


def _as_list(paths: StrPath | Iterable[StrPath]) -> list[str]:
    return [os.fspath(path) for path in ([paths] if isinstance(paths, str | os.PathLike) else paths)]
