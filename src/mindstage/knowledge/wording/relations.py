"""Relations: who hangs on whom, told by the parent, by the child, or by both."""

from __future__ import annotations

from collections.abc import Container, Mapping

from mindstage.knowledge.vocabulary import CHILD, PARENT
from mindstage.knowledge.wording.statements import SubjectReader
from mindstage.world import Iri

__all__ = ["AttachmentReader"]


class AttachmentReader:
    """What bodies say about one another, as a forest; a statement that would spoil it stays a fact."""

    def __init__(self, bodies: Mapping[Iri, SubjectReader], constraints: Container[Iri]) -> None:
        """Listens to all bodies.

        Args:
            bodies: what is told about each.
            constraints: individuals that join others; a body may name one it is an end of.
        """
        self.ends: dict[tuple[Iri, Iri], Iri] = {}
        """By constraint and role (`parents` or `child`), the body that says to be that end of it."""
        self.parents: dict[Iri, Iri] = {}
        """By child."""
        self._ancestor: dict[Iri, Iri] = {}
        for body, heard in bodies.items():
            self._read_relations(body, heard, bodies, constraints)

    def _read_relations(
        self, body: Iri, reader: SubjectReader, bodies: Container[Iri], constraints: Container[Iri]
    ) -> None:
        told = [(index, role, other) for role in (CHILD, PARENT) for index, other in reader.references(role)]
        for index, role, other in sorted(told):
            if other in bodies:
                parent, child = (body, other) if role == CHILD else (other, body)
                if problem := self._attach(parent, child):
                    reader.warn(role, problem, "the relation stays a fact")
                else:
                    reader.consume(index)
            elif other in constraints:
                self.ends.setdefault((other, PARENT if role == CHILD else CHILD), body)
            else:
                reader.warn(role, f"{other} is no body of this map", "the relation stays a fact")

    def _attach(self, parent: Iri, child: Iri) -> str:
        """What speaks against it; nothing if it is done."""
        if child in self.parents:
            other = self.parents[child]
            return "" if other == parent else f"{child} already hangs on {other} and cannot hang on {parent} too"
        if self._root(parent) == child:
            return f"{child} would hang on itself, by way of {parent}"
        self.parents[child] = parent
        self._ancestor[child] = parent
        return ""

    def _root(self, body: Iri) -> Iri:
        # Each walk halves the way for the next one, so that long chains cost no more than short ones.
        towards = self._ancestor
        while (up := towards.get(body)) is not None:
            if up in towards:
                towards[body] = towards[up]
            body = up
        return body
