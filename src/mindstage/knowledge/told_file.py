"""Told files: what was told, as a Turtle file that can be loaded like any ontology.

A statement is written behind what the file says already, whoever wrote that. To take one back the file is written anew,
which is only done to files that began here: others may hold comments, or numbers to the letter.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import pyoxigraph as ox

from mindstage.errors import InvalidArgumentError
from mindstage.files import atomic_write
from mindstage.knowledge.base import KnowledgeBase
from mindstage.knowledge.reasoning.namebook import PREFIXES
from mindstage.knowledge.teaching import RUNTIME_GRAPH, AssertableValue

__all__ = ["AssertionFile"]

_FIRST_LINE = "# Told to Mindstage, which writes this file anew when something is taken back.\n"


class AssertionFile:
    """One file, and the knowledge base that its statements are understood by."""

    def __init__(self, path: Path, knowledge: KnowledgeBase) -> None:
        """Loads the file where there is one.

        Raises:
            InvalidArgumentError: it is not called like a Turtle file.
            SourceParseError: it cannot be read.
        """
        if path.suffix.lower() != ".ttl":
            raise InvalidArgumentError(str(path), cause="what is told is written as Turtle", remedy="call it .ttl")
        self.path = path.resolve()
        self._knowledge = knowledge
        if path.exists():
            knowledge.load((), ontologies=path)

    def tell(self, subject: str, property: str, value: AssertableValue) -> bool:
        """Adds a statement; False where it was known before.

        Raises:
            NameNotFoundError: nothing has one of the names.
            AmbiguousNameError: several things have it.
            InvalidArgumentError: the three make no statement.
            OSError: the file cannot be written.
        """
        known = set(self._quads(RUNTIME_GRAPH))
        self._knowledge.tell(subject, property, value)
        new = [quad.triple for quad in self._quads(RUNTIME_GRAPH) if quad not in known]
        if new:
            before = self.path.read_text(encoding="utf-8") if self.path.exists() else _FIRST_LINE
            declared = ox.parse(before, ox.RdfFormat.TURTLE, base_iri=self.path.as_uri())
            for _ in declared:
                pass
            self._write(f"{before.rstrip()}\n\n{_turtle(new, declared.prefixes)}")
        return bool(new)

    def retract(self, subject: str, property: str, value: AssertableValue) -> bool:
        """Takes a statement back; False where the file does not say it.

        Raises:
            NameNotFoundError: nothing has one of the names.
            AmbiguousNameError: several things have it.
            InvalidArgumentError: the three make no statement, or the file began elsewhere.
            OSError: the file cannot be written.
        """
        if not self.path.read_text(encoding="utf-8").startswith(_FIRST_LINE):
            cause = "others wrote it, and what they wrote besides statements would be lost"
            raise InvalidArgumentError(str(self.path), cause=cause, remedy="take the statement out by hand")
        graph = ox.NamedNode(self.path.as_uri())
        before = self._quads(graph)
        self._knowledge.retract(subject, property, value)
        left = self._quads(graph)
        if len(left) == len(before):
            return False
        self._write(f"{_FIRST_LINE}\n{_turtle(_without_orphaned_blank_nodes(left), {})}")
        return True

    def _quads(self, graph: ox.NamedNode) -> list[ox.Quad]:
        return list(self._knowledge.store.quads_for_pattern(None, None, None, graph))

    def _write(self, text: str) -> None:
        atomic_write(self.path, text.encode())


def _turtle(triples: list[ox.Triple], declared: Mapping[str, str]) -> str:
    """Statements, after those prefixes of ours that they use and that nobody has declared yet."""
    text = (ox.serialize(triples, format=ox.RdfFormat.TURTLE, prefixes=PREFIXES) or b"").decode()
    body = "".join(line for line in text.splitlines(keepends=True) if not line.startswith("@prefix "))
    used = (name for name in PREFIXES if re.search(rf"(?<!\w){name}:", body))
    head = [f"@prefix {name}: <{PREFIXES[name]}> .\n" for name in used if declared.get(name) != PREFIXES[name]]
    return "".join([*head, "\n" if head else "", body])


def _without_orphaned_blank_nodes(quads: list[ox.Quad]) -> list[ox.Triple]:
    """Statements without those about things that have no name and that nothing speaks of any more."""
    while True:
        spoken_of = {quad.object for quad in quads}
        left = [quad for quad in quads if not isinstance(quad.subject, ox.BlankNode) or quad.subject in spoken_of]
        if len(left) == len(quads):
            return [quad.triple for quad in left]
        quads = left
