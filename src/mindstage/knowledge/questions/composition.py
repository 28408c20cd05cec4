"""Questions about what things are made of."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import IndividualName, MapName, Missing, Row, question
from mindstage.knowledge.questions.words import member_lines, statement_line
from mindstage.knowledge.reasoning import Part
from mindstage.knowledge.vocabulary import CHILD, CONSTRAINT, knowrob
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["HandleOf", "PartOf", "handle_of", "part_of"]

_HANDLE = knowrob("Handle")


class PartOf(Row, frozen=True, kw_only=True):
    """A thing that is a part of another one, at any depth."""

    part: IndividualName
    whole: IndividualName
    depth: int
    """1 for a part, 2 for a part of a part, and so on."""
    map: MapName
    """The map that the whole is described in."""


@question
def part_of(
    kb: KnowledgeBase,
    part: IndividualName | None = None,
    whole: IndividualName | None = None,
    map: MapName | None = None,
) -> Iterator[PartOf]:
    """Parts and wholes to any depth, whichever side tells of it; give the one to get the other.

    What a constraint joins is no part of it, nor of one another.

    Examples:
        part_of whole=fridge_door
        part_of fridge_door_handle
    """
    index = kb.index
    if part is not None and whole is None:
        for up in index.wholes(part):
            for place in index.maps_of.get(up.thing, ()):
                yield PartOf(part=part, whole=up.thing, depth=up.depth, map=place)
        return
    for place in sorted(index.residents) if map is None else (map,):
        for each in sorted(index.residents[place]) if whole is None else (whole,):
            if place in index.maps_of.get(each, ()):
                for down in index.parts(each):
                    yield PartOf(part=down.thing, whole=each, depth=down.depth, map=place)


@part_of.because
def _chain(kb: KnowledgeBase, row: PartOf) -> Iterator[str]:
    yield from _chain_lines(kb.index.parts(row.whole), row.part)


@part_of.lacking
def _no_parts(
    kb: KnowledgeBase, part: Iri | None = None, whole: Iri | None = None, map: Iri | None = None
) -> Iterator[Missing]:
    if (thing := whole or part) and (cls := kb.index.class_of(thing)):
        other = "part" if whole else "whole"
        why = f"{local_name(thing)} has no such {other}: neither child, parent nor a property of parts leads there"
        yield Missing(cls, CHILD, why)


class HandleOf(Row, frozen=True, kw_only=True):
    """A handle of a thing."""

    individual: IndividualName
    handle: IndividualName
    map: MapName
    """The map that the thing is described in."""


@question
def handle_of(
    kb: KnowledgeBase,
    individual: IndividualName | None = None,
    handle: IndividualName | None = None,
    map: MapName | None = None,
) -> Iterator[HandleOf]:
    """The handles of a thing: parts, at any depth, that are Handles; or all that a handle is the handle of.

    What hangs on a thing by a constraint counts as a part here: the handle of an oven's door is the oven's.

    Examples:
        handle_of fridge_door
    """
    index = kb.index
    if individual is not None:
        if index.is_member(individual, CONSTRAINT):
            return
        for down in index.parts(individual, through_joints=True):
            if index.is_member(down.thing, _HANDLE):
                for place in index.maps_of.get(individual, ()):
                    yield HandleOf(individual=individual, handle=down.thing, map=place)
        return
    for each in index.members(_HANDLE) if handle is None else (handle,):
        if index.is_member(each, _HANDLE):
            for up in index.wholes(each, through_joints=True):
                places = () if index.is_member(up.thing, CONSTRAINT) else index.maps_of.get(up.thing, ())
                for place in places:
                    yield HandleOf(individual=up.thing, handle=each, map=place)


@handle_of.because
def _why_handle(kb: KnowledgeBase, row: HandleOf) -> Iterator[str]:
    yield from _chain_lines(kb.index.parts(row.individual, through_joints=True), row.handle)
    yield from member_lines(kb.index, row.handle, _HANDLE)


@handle_of.lacking
def _no_handle(
    kb: KnowledgeBase, individual: Iri | None = None, handle: Iri | None = None, map: Iri | None = None
) -> Iterator[Missing]:
    if individual and (cls := kb.index.class_of(individual)):
        yield Missing(
            cls, CHILD, f"{local_name(individual)} ({local_name(cls)}) has no handle: none of its parts is a Handle"
        )


def _chain_lines(parts: Iterator[Part], part: Iri) -> Iterator[str]:
    for down in parts:
        if down.thing == part:
            yield from map(statement_line, down.chain)
            return
