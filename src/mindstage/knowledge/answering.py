"""Answering: the side of a knowledge base that questions are put to.

Nothing here is made before the first question comes, and everything is made anew when what is known has changed.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar, overload

import pyoxigraph as ox

from mindstage.errors import ArgumentRefused
from mindstage.knowledge.reasoning import Index, Namebook
from mindstage.knowledge.teaching import Teachable, Teaching
from mindstage.world import Body, Iri, World

if TYPE_CHECKING:
    from mindstage.knowledge.questions import Answers, Question, Row
    from mindstage.knowledge.sparql import Table

__all__ = ["Answering"]

R = TypeVar("R", bound="Row")


class Answering:
    """Asked, taught and queried; `KnowledgeBase` is what it knows."""

    _store: ox.Store
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
            QuestionUnknown: there is none of that name.
            ArgumentRefused: it has no such argument, or the argument no such value.
            NameUnknown: nothing has that name.
            NameAmbiguous: several things have it.
        """
        return _question(question).ask(self, args)  # type: ignore[arg-type]

    def why(self, question: Question[R] | str, row: R) -> tuple[str, ...]:
        """The statements and classes that led to an answer, one a line; none where the answer is plainly told.

        Raises:
            QuestionUnknown: there is none of that name.
            ArgumentRefused: the row is no answer to this question.
        """
        asked = _question(question)
        if not isinstance(row, asked.row):
            raise ArgumentRefused(asked.name, cause=f"{type(row).__name__} is no answer to it")
        return asked.why(self, row)  # type: ignore[arg-type]

    def tell(self, subject: str, property: str, value: Teachable) -> None:
        """Adds a statement; the next question knows it. What the worlds of maps hold stays as their files tell it.

        Of a class it means all its members: `tell("Breadbasket", "typePrimaryFunction-containerFor", "Bread")`. A
        subject that nobody knows yet must be given with prefix or whole, and becomes a class by "subClassOf" and an
        individual by "type".

        Raises:
            NameUnknown: nothing has one of the names.
            NameAmbiguous: several things have it.
            ArgumentRefused: the three make no statement.
        """
        Teaching(self._store, self.index, self.names).tell(subject, property, value)
        self._changed()

    def retract(self, subject: str, property: str, value: Teachable) -> bool:
        """Takes a statement back, whether it was told or read from a source; False where nobody said it.

        What follows from other statements is not touched, and neither are files or the worlds read from them.

        Raises:
            NameUnknown: nothing has one of the names.
            NameAmbiguous: several things have it.
            ArgumentRefused: the three make no statement.
        """
        done = Teaching(self._store, self.index, self.names).retract(subject, property, value)
        self._changed()
        return done

    def sparql(self, query: str, *, timeout_s: float = 30.0) -> Table:
        """Puts a SPARQL 1.1 query to the store: all sources are one graph, and each is one of its own besides.

        The prefixes knowrob, ms, owl, rdf, rdfs, xsd, dul and soma are known. SERVICE reaches other servers, as the
        query says; nothing else does.

        Args:
            query: SELECT, ASK, CONSTRUCT or DESCRIBE.
            timeout_s: how long to wait [s]. A query that takes longer cannot be stopped: it goes on unseen, and uses a
                processor, until it or the process ends.

        Raises:
            QueryRefused: it is no query.
            QueryTimedOut: it did not end in time.
        """
        from mindstage.knowledge.sparql import run_query

        return run_query(self._store, query, timeout_s=timeout_s)

    # -- for the questions ---------------------------------------------------------------------------------------------

    @cached_property
    def index(self) -> Index:
        """What follows from everything that is known."""
        return Index(self._store)

    @cached_property
    def names(self) -> Namebook:
        """What things are called."""
        return Namebook(self._store, self.index)

    def body_of(self, individual: Iri, map: Iri) -> Body | None:
        """An individual's body in the world of a map, where it has one."""
        if map not in self._bodies:
            bodies = self.world(map).bodies if map in self.maps() else ()
            self._bodies[map] = {body.iri: body for body in bodies}
        return self._bodies[map].get(individual)

    @cached_property
    def _bodies(self) -> dict[Iri, dict[Iri, Body]]:
        return {}

    def _changed(self) -> None:
        """Forgets what followed from what was known before."""
        self._worlds.clear()
        for name in ("index", "names", "_bodies", "_hierarchy"):
            self.__dict__.pop(name, None)


def _question(question: Question[R] | str) -> Question[Any]:
    from mindstage.knowledge.questions import question_named

    return question_named(question) if isinstance(question, str) else question
