"""Questions about what things are made of."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import AnswerRow, IndividualName, MapName, MissingKnowledge, question
from mindstage.knowledge.questions.words import individual_text, membership_lines, missing_description, statement_line
from mindstage.knowledge.reasoning import PartOfStep, Reasoner
from mindstage.knowledge.vocabulary import CHILD, CONSTRAINT, THING, TYPE, knowrob
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["HandleOf", "PartOf", "handle_of", "part_of"]

_HANDLE_CLASS = knowrob("Handle")


class PartOf(AnswerRow, frozen=True, kw_only=True):
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
    index = kb.reasoner
    if part is not None and whole is None:
        for up in index.wholes(part):
            for place in index.maps_of.get(up.individual, ()):
                yield PartOf(part=part, whole=up.individual, depth=up.depth, map=place)
        return
    for place in sorted(index.members_by_map) if map is None else (map,):
        for each in sorted(index.members_by_map[place]) if whole is None else (whole,):
            if place in index.maps_of.get(each, ()):
                for down in index.parts(each):
                    yield PartOf(part=down.individual, whole=each, depth=down.depth, map=place)


@part_of.explain
def _explain_part(kb: KnowledgeBase, row: PartOf) -> Iterator[str]:
    yield from _part_lines(kb.reasoner.parts(row.whole), row.part)


@part_of.missing
def _missing_parts(
    kb: KnowledgeBase, part: Iri | None = None, whole: Iri | None = None, map: Iri | None = None
) -> Iterator[MissingKnowledge]:
    if thing := whole or part:
        if map and map not in kb.reasoner.maps_of.get(thing, ()):
            yield from missing_description(kb.reasoner, thing, map)
            return
        what = (
            f"no part of {local_name(whole)}" if part and whole else "a part of nothing" if part else "made of nothing"
        )
        why = f"{local_name(part or thing)} is {what}: neither child, parent nor a property of parts leads there"
        yield MissingKnowledge(kb.reasoner.class_of(thing) or THING, CHILD, why)


class HandleOf(AnswerRow, frozen=True, kw_only=True):
    """A handle of a thing."""

    default_column: ClassVar[str] = "handle"
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
    index = kb.reasoner
    if individual is not None:
        for found in _find_handles(index, individual):
            for place in index.maps_of.get(individual, ()):
                yield HandleOf(individual=individual, handle=found, map=place)
        return
    for each in index.members(_HANDLE_CLASS) if handle is None else (handle,):
        if index.is_member(each, _HANDLE_CLASS):
            for up in index.wholes(each, through_joints=True):
                places = () if index.is_member(up.individual, CONSTRAINT) else index.maps_of.get(up.individual, ())
                for place in places:
                    yield HandleOf(individual=up.individual, handle=each, map=place)


def _find_handles(reasoner: Reasoner, individual: Iri) -> Iterator[Iri]:
    parts = () if reasoner.is_member(individual, CONSTRAINT) else reasoner.parts(individual, through_joints=True)
    return (down.individual for down in parts if reasoner.is_member(down.individual, _HANDLE_CLASS))


@handle_of.explain
def _explain_handle(kb: KnowledgeBase, row: HandleOf) -> Iterator[str]:
    yield from _part_lines(kb.reasoner.parts(row.individual, through_joints=True), row.handle)
    yield from membership_lines(kb.reasoner, row.handle, _HANDLE_CLASS)


@handle_of.missing
def _missing_handle(
    kb: KnowledgeBase, individual: Iri | None = None, handle: Iri | None = None, map: Iri | None = None
) -> Iterator[MissingKnowledge]:
    index = kb.reasoner
    if handle and not index.is_member(handle, _HANDLE_CLASS):
        yield MissingKnowledge(index.class_of(handle) or THING, TYPE, f"{individual_text(index, handle)} is no Handle")
    elif individual and map and map not in index.maps_of.get(individual, ()):
        yield from missing_description(index, individual, map)
    elif individual is not None:
        others = ", ".join(local_name(each) for each in _find_handles(index, individual))
        lacks = f"has another handle, {others}" if others else "has no handle: none of its parts is a Handle"
        yield MissingKnowledge(
            index.class_of(individual) or THING, CHILD, f"{individual_text(index, individual)} {lacks}"
        )
    elif handle:
        why = f"{individual_text(index, handle)} is the handle of nothing: it is a part of nothing"
        yield MissingKnowledge(index.class_of(handle) or THING, CHILD, why)


def _part_lines(parts: Iterator[PartOfStep], part: Iri) -> Iterator[str]:
    for down in parts:
        if down.individual == part:
            yield from map(statement_line, down.path)
            return
