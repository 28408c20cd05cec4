"""Questions about what things are made of."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import IndividualName, MapName, Missing, Row, question
from mindstage.knowledge.questions.words import member_lines, not_described, statement_line, thing_text
from mindstage.knowledge.reasoning import Index, Part
from mindstage.knowledge.vocabulary import CHILD, CONSTRAINT, THING, TYPE, knowrob
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
    if thing := whole or part:
        if map and map not in kb.index.maps_of.get(thing, ()):
            yield from not_described(kb.index, thing, map)
            return
        what = (
            f"no part of {local_name(whole)}" if part and whole else "a part of nothing" if part else "made of nothing"
        )
        why = f"{local_name(part or thing)} is {what}: neither child, parent nor a property of parts leads there"
        yield Missing(kb.index.class_of(thing) or THING, CHILD, why)


class HandleOf(Row, frozen=True, kw_only=True):
    """A handle of a thing."""

    about: ClassVar[str] = "handle"
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
        for found in _handles(index, individual):
            for place in index.maps_of.get(individual, ()):
                yield HandleOf(individual=individual, handle=found, map=place)
        return
    for each in index.members(_HANDLE) if handle is None else (handle,):
        if index.is_member(each, _HANDLE):
            for up in index.wholes(each, through_joints=True):
                places = () if index.is_member(up.thing, CONSTRAINT) else index.maps_of.get(up.thing, ())
                for place in places:
                    yield HandleOf(individual=up.thing, handle=each, map=place)


def _handles(index: Index, individual: Iri) -> Iterator[Iri]:
    parts = () if index.is_member(individual, CONSTRAINT) else index.parts(individual, through_joints=True)
    return (down.thing for down in parts if index.is_member(down.thing, _HANDLE))


@handle_of.because
def _why_handle(kb: KnowledgeBase, row: HandleOf) -> Iterator[str]:
    yield from _chain_lines(kb.index.parts(row.individual, through_joints=True), row.handle)
    yield from member_lines(kb.index, row.handle, _HANDLE)


@handle_of.lacking
def _no_handle(
    kb: KnowledgeBase, individual: Iri | None = None, handle: Iri | None = None, map: Iri | None = None
) -> Iterator[Missing]:
    index = kb.index
    if handle and not index.is_member(handle, _HANDLE):
        yield Missing(index.class_of(handle) or THING, TYPE, f"{thing_text(index, handle)} is no Handle")
    elif individual and map and map not in index.maps_of.get(individual, ()):
        yield from not_described(index, individual, map)
    elif individual is not None:
        others = ", ".join(local_name(each) for each in _handles(index, individual))
        lacks = f"has another handle, {others}" if others else "has no handle: none of its parts is a Handle"
        yield Missing(index.class_of(individual) or THING, CHILD, f"{thing_text(index, individual)} {lacks}")
    elif handle:
        why = f"{thing_text(index, handle)} is the handle of nothing: it is a part of nothing"
        yield Missing(index.class_of(handle) or THING, CHILD, why)


def _chain_lines(parts: Iterator[Part], part: Iri) -> Iterator[str]:
    for down in parts:
        if down.thing == part:
            yield from map(statement_line, down.chain)
            return
