"""The knowledge base: what was loaded, as one store for questions and as one world for each map.

Answering: the side of a knowledge base that questions are put to.

Nothing here is made before the first question comes. What changes is looked at again, and nothing else is; answers are
kept until then. Any thread may ask and tell: one takes its turn after the other.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import chain
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any, Self, TypeVar, overload

import pyoxigraph as ox

from mindstage.errors import AmbiguousMapError, InvalidArgumentError, MapNotFoundError
from mindstage.knowledge.dialects import read_world
from mindstage.knowledge.dialects.conventions import Assumption, UnitConventions
from mindstage.knowledge.dialects.membership import individuals_by_map, without_other_maps
from mindstage.knowledge.dialects.source_map import SourceMap
from mindstage.knowledge.endpoint import SparqlEndpoint
from mindstage.knowledge.graph_diff import SourceMapView
from mindstage.knowledge.io.files import map_path
from mindstage.knowledge.io.sources import SourceRegistry, StrPath
from mindstage.knowledge.map_statistics import MapStatistics, map_statistics
from mindstage.knowledge.names import NameIndex
from mindstage.knowledge.owl import node_label
from mindstage.knowledge.owl_rl import INFERRED_GRAPH, InferredTriples, materialize_owl_rl
from mindstage.knowledge.questions import AnswerCache
from mindstage.knowledge.rdf import Finding, Severity, TripleStore, gc_paused, local_name
from mindstage.knowledge.rdf_mapping.nested import nest_blank_nodes
from mindstage.knowledge.reasoner import Reasoner
from mindstage.knowledge.reasoner_properties import node_from_label
from mindstage.knowledge.shape_rules import ShapeRule, ShapeRuleResolver
from mindstage.knowledge.taxonomy import ClassHierarchy
from mindstage.knowledge.tell import RUNTIME_GRAPH, AssertableValue, AssertionStore
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, EQUIVALENT_CLASS, SUBCLASS_OF, TYPE, xsd
from mindstage.scene import Body, FactValue, Iri, IriRef, Joint, Light, Literal, PropertyAssertion, World
from mindstage.scene.display import counted

if TYPE_CHECKING:
    from mindstage.knowledge.questions import AnswerRow, Answers, Question
    from mindstage.knowledge.rdf import SparqlResult

__all__ = ["Answering", "KnowledgeBase"]


R = TypeVar("R", bound="AnswerRow")


class Answering:
    """Asked, taught and queried; `KnowledgeBase` is what it knows."""

    lock: RLock
    """Held by whoever asks or tells, and by whoever takes several looks at the index that must fit together."""
    _store: TripleStore
    _worlds: dict[Iri, World]

    if TYPE_CHECKING:

        def maps(self) -> tuple[Iri, ...]: ...  # noqa: D102
        def world(self, map: str | None = None) -> World: ...  # noqa: D102

    @overload
    def ask(self, question: Question[R], **args: object) -> Answers[R]: ...
    @overload
    def ask(self, question: str, **args: object) -> Answers[Any]: ...
    def ask(self, question: Question[Any] | str, **args: object) -> Answers[Any]:
        """All answers to a question.

        >>> from mindstage.knowledge import KnowledgeBase
        >>> [row.place for row in KnowledgeBase().ask("storage_place", item="CowsMilk")]
        ['http://knowrob.org/kb/knowrob.owl#Refrigerator']

        Args:
            question: its name, or the question itself, whose rows a type checker then knows.
            args: names short, with prefix or whole; what is left out is asked for.

        Raises:
            QuestionNotFoundError: there is none of that name.
            InvalidArgumentError: it has no such argument, or the argument no such value.
            NameNotFoundError: nothing has that name.
            AmbiguousNameError: several things have it.
        """
        key = (question, *args.items())
        remembered = self._answer_cache  # what is worked out while something changes goes where nobody looks any more
        try:
            if (known := remembered.get(key)) is not None:
                return known
        except TypeError:  # a list, say, which the question itself refuses
            key = ()
        asked = _question(question)
        answers = asked.ask(self, args)  # type: ignore[arg-type]
        if key and not asked.uses_current_state:
            remembered.put(key, answers)
        return answers

    def explain(self, question: Question[R] | str, row: R) -> tuple[str, ...]:
        """The statements and classes that led to an answer, one a line; none where the answer is plainly told.

        Raises:
            QuestionNotFoundError: there is none of that name.
            InvalidArgumentError: the row is no answer to this question.
        """
        asked = _question(question)
        if not isinstance(row, asked.row):
            raise InvalidArgumentError(asked.name, cause=f"{type(row).__name__} is no answer to it")
        return asked.explain_answer(self, row)  # type: ignore[arg-type]

    def tell(self, subject: str, property: str, value: AssertableValue) -> bool:
        """Adds a statement; the next question knows it. What the worlds of maps hold stays as their files tell it.

        Gives False where it was said already.

        Of a class it means all its members: `tell("Breadbasket", "typePrimaryFunction-containerFor", "Bread")`. A
        subject that nobody knows yet must be given with prefix or whole, and becomes a class by "subClassOf" and an
        individual by "type".

        Raises:
            NameNotFoundError: nothing has one of the names.
            AmbiguousNameError: several things have it.
            InvalidArgumentError: the three make no statement.
        """
        with self.lock:
            quads = AssertionStore(self._store, self.reasoner, self.names).tell(subject, property, value)
            self._invalidate(quads)
        return bool(quads)

    def retract(self, subject: str, property: str, value: AssertableValue) -> bool:
        """Takes a statement back, whether it was told or read from a source; False where nobody said it.

        What follows from other statements is not touched, and neither are files or the worlds read from them. What
        `derive` has added is dropped, since it may not follow any more.

        Raises:
            NameNotFoundError: nothing has one of the names.
            AmbiguousNameError: several things have it.
            InvalidArgumentError: the three make no statement.
        """
        with self.lock:
            quads = AssertionStore(self._store, self.reasoner, self.names).retract(subject, property, value)
            self._invalidate(quads)
            if quads:
                self.forget_derived()
        return bool(quads)

    def derive(self) -> int:
        """Adds all that follows from what is known by the rules of OWL 2 RL, and says how many statements that is.

        Nobody needs it for the usual questions, which follow classes, parts and places themselves. It finds the rest:
        things that are the same because a property has one value only, say, and what follows from that. What is told or
        loaded later is not in it until somebody derives again, and a retraction drops it. The worlds of maps stay as
        they are.

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
        """Drops what was derived; False where nothing was."""
        with self.lock:
            if not InferredTriples(self._store):
                return False
            self._store.remove_graph(INFERRED_GRAPH)
            self._invalidate_all()
        return True

    def sparql(self, query: str, *, timeout_s: float = 30.0, allow_service: bool = False) -> SparqlResult:
        """Puts a SPARQL 1.1 query to the store: all sources are one graph, and each is one of its own besides.

        The prefixes knowrob, ms, owl, rdf, rdfs, xsd, dul and soma are known. It runs in a process of its own, which
        takes no more than 2 GiB and ends with its time. An endpoint gets the query as it is, and answers it alone.

        Args:
            query: SELECT, ASK, CONSTRUCT or DESCRIBE.
            timeout_s: how long it may take [s]; it is stopped then.
            allow_service: whether it may ask other servers (SERVICE).

        Raises:
            SparqlSyntaxError: it is no query, asks for what it may not, or for more than can be had.
            SparqlTimeoutError: it did not end in time.
            EndpointUnreachableError: nobody answers at the endpoint.
            EndpointError: the endpoint says no.
        """
        return self._store.query(query, timeout_s=timeout_s, allow_service=allow_service)

    # -- for the questions ---------------------------------------------------------------------------------------------

    @cached_property
    def reasoner(self) -> Reasoner:
        """What follows from everything that is known."""
        return Reasoner(self._store)

    @cached_property
    def names(self) -> NameIndex:
        """What things are called."""
        return NameIndex(self._store, self.reasoner)

    def facts_of(self, individual: Iri, *, runtime_only: bool = False) -> tuple[PropertyAssertion, ...]:
        """What the store says of an individual besides its classes and maps; only what was told at run time, if asked.

        Things without a name are named by their labels in the store.
        """
        graph = RUNTIME_GRAPH if runtime_only else None
        quads = self._store.quads_for_pattern(node_from_label(individual), None, None, graph)
        quads = (quad for quad in quads if quad.graph_name != INFERRED_GRAPH)
        told = (quad for quad in quads if quad.predicate.value not in {TYPE, DESCRIBED_IN_MAP})
        facts = {PropertyAssertion(Iri(quad.predicate.value), _value(quad.object)) for quad in told}
        return tuple(sorted(facts, key=repr))

    def scene_entity(self, individual: Iri, map: Iri) -> Body | Joint | Light | None:
        """What an individual is in the world of a map, where it has a place there."""
        if map not in self._scene_entities:
            world = self.world(map) if map in self.maps() else World(iri=map)
            things: Iterable[Body | Joint | Light] = chain(world.bodies, world.joints, world.lights)
            self._scene_entities[map] = {each.iri: each for each in things}
        return self._scene_entities[map].get(individual)

    @cached_property
    def _answer_cache(self) -> AnswerCache:
        return AnswerCache()

    @cached_property
    def _scene_entities(self) -> dict[Iri, dict[Iri, Body | Joint | Light]]:
        return {}

    def _invalidate(self, quads: Sequence[ox.Quad]) -> None:
        """Looks again at what these statements are about, which were added or removed."""
        nodes = (node for quad in quads for node in quad.triple)
        self.names.add(Iri(node.value) for node in nodes if isinstance(node, ox.NamedNode))
        if self.reasoner.update(quads):  # the world of a map may have been read with other classes
            self._worlds.clear()
            self._drop_cached("_placed", "_hierarchy")
        self._drop_cached("_remembered", "_shaping")

    def _invalidate_all(self, graphs: Iterable[ox.NamedNode] | None = None) -> None:
        """Forgets what followed from what was known before; what was asked about is looked at again.

        Args:
            graphs: all that was added; None where something else has changed.
        """
        if graphs is not None and "index" in self.__dict__:
            names = [name for graph in graphs for name in self.reasoner.add_graph(graph)]
            self.names.add(names)
        self._worlds.clear()
        self._drop_cached(*(() if graphs is not None else ("index", "names")))
        self._drop_cached("_placed", "_hierarchy", "_remembered", "_shaping")

    def _drop_cached(self, *names: str) -> None:
        for name in names:
            self.__dict__.pop(name, None)


def _question(question: Question[R] | str) -> Question[Any]:
    from mindstage.knowledge.questions import get_question

    return get_question(question) if isinstance(question, str) else question


def _value(node: object) -> FactValue:
    if isinstance(node, ox.Literal):
        datatype = None if node.language or node.datatype.value == xsd("string") else Iri(node.datatype.value)
        return Literal(node.value, datatype, node.language)
    return IriRef(node_label(node) or Iri(str(node)))


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
