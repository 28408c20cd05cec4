"""The changes of a knowledge base for a copy of its statements that is kept in step, such as that of Prolog.

The reader asks for the changes when it needs the statements after `on_change` was called. The first reply, and that
after a large change, is a copy of all statements; later ones are the statements that were added or removed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import count
from typing import NamedTuple
from weakref import WeakKeyDictionary

import pyoxigraph as ox

from mindstage.knowledge.knowledge_base import KnowledgeBase
from mindstage.knowledge.owl import node_label
from mindstage.knowledge.store import OxigraphStore, term_from_node
from mindstage.rdf.graphs import RdfTerm
from mindstage.scene import Iri

__all__ = ["MAX_COPIED_STATEMENTS", "ChangeFeed", "StatementChange", "StoreCopy"]


MAX_COPIED_STATEMENTS = 1_000_000
"""The maximum number of statements of a store that is copied."""
_MAX_PENDING = 5000
"""The maximum number of changed statements that are reported one by one; after more, the store is copied again."""
_STATEMENT_ABOUT_STATEMENT = re.compile(rb"(?m)^(?:<<\(|\S+ \S+ <<\().*\n?")
"""A line of N-Quads with a statement about a statement (RDF 1.2), which is not copied."""
_numbers = count(1)
_feeds: WeakKeyDictionary[KnowledgeBase, ChangeFeed] = WeakKeyDictionary()


class StatementChange(NamedTuple):
    """A statement of a graph that was added or removed."""

    subject: Iri
    property: Iri
    value: RdfTerm
    graph: Iri
    is_asserted: bool
    """Whether the graph contains the statement now."""


class StoreCopy(NamedTuple):
    """All statements of a store."""

    name: str
    """The name that the reader gives to get the changes since."""
    quads: bytes
    """N-Quads."""


class ChangeFeed:
    """Collects the changes of one knowledge base since its reader last asked for them."""

    @classmethod
    def of(cls, knowledge: KnowledgeBase) -> ChangeFeed:
        """The feed of a knowledge base, which all readers in turn share."""
        if knowledge not in _feeds:
            _feeds[knowledge] = cls(knowledge)
        return _feeds[knowledge]

    def __init__(self, knowledge: KnowledgeBase) -> None:
        self._store = knowledge.store  # not the knowledge base, so that it can be released
        self._name = f"copy_{next(_numbers)}"
        self._changed: dict[ox.Quad, None] | None = None
        """Statements that may have been added or removed; None if anything may have changed."""
        self._is_stale = False
        self.on_change: Callable[[], None] = lambda: None
        """Called with the first change since the last reply, in any thread, while the knowledge base is locked."""
        knowledge.on_change(self._collect)

    def _collect(self, quads: Sequence[ox.Quad] | None) -> None:
        if quads is None or (self._changed is not None and len(self._changed) > _MAX_PENDING):
            self._changed = None
        elif self._changed is not None:
            self._changed.update(dict.fromkeys(quads))
        if not self._is_stale:
            self._is_stale = True
            self.on_change()

    def changes(self, copied: str) -> StoreCopy | list[StatementChange] | None:
        """What has changed since the last call; the knowledge base must be locked.

        Args:
            copied: the name of the copy that the reader has.

        Returns:
            A copy, or the changes since; None if the store cannot be copied: an endpoint, or one that is too large.
        """
        changed, self._changed, self._is_stale = self._changed, {}, False
        if not isinstance(self._store, OxigraphStore) or len(self._store) > MAX_COPIED_STATEMENTS:
            self._changed = None
            return None
        if changed is None or copied != self._name:
            return StoreCopy(self._name, _STATEMENT_ABOUT_STATEMENT.sub(b"", self._store.dump()))
        return [change for quad in changed if (change := self._change(quad))]

    def _change(self, quad: ox.Quad) -> StatementChange | None:
        subject, graph = node_label(quad.subject), node_label(quad.graph_name)
        value = term_from_node(quad.object)
        if subject is None or graph is None or value.kind == "triple":
            return None
        found = self._store.quads_for_pattern(quad.subject, quad.predicate, quad.object, quad.graph_name)
        is_asserted = next(iter(found), None) is not None
        return StatementChange(subject, Iri(quad.predicate.value), value, graph, is_asserted)
