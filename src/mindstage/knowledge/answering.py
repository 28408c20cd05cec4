"""Answering: the side of a knowledge base that questions are put to.

Nothing here is made before the first question comes. What changes is looked at again, and nothing else is; answers are
kept until then. Any thread may ask and tell: one takes its turn after the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import chain
from threading import RLock
from typing import TYPE_CHECKING, Any, TypeVar, overload

import pyoxigraph as ox

from mindstage.errors import InvalidArgumentError
from mindstage.knowledge.reasoning import NameIndex, Reasoner
from mindstage.knowledge.reasoning.derivation import INFERRED_GRAPH, InferredTriples, materialize_owl_rl
from mindstage.knowledge.reasoning.expressions import node_label
from mindstage.knowledge.reasoning.properties import node_from_label
from mindstage.knowledge.remembering import AnswerCache
from mindstage.knowledge.teaching import RUNTIME_GRAPH, AssertableValue, AssertionStore
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, TYPE, xsd
from mindstage.world import Body, FactValue, Iri, IriRef, Joint, Light, Literal, PropertyAssertion, World

if TYPE_CHECKING:
    from mindstage.knowledge.questions import AnswerRow, Answers, Question
    from mindstage.knowledge.stores.sparql import SparqlResult
    from mindstage.knowledge.stores.triplestore import TripleStore

__all__ = ["Answering"]

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
