"""Questions about maps: which there are, and who is in them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mindstage.knowledge.questions.question import ClassName, IndividualName, MapName, Row, question
from mindstage.knowledge.questions.words import member_lines, statement_line
from mindstage.knowledge.reasoning import Statement
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["InMap", "KnownMap", "MapClass", "everything_in_map", "individual_of_class", "maps"]


class KnownMap(Row, frozen=True, kw_only=True):
    """A map, and how much is in it."""

    map: MapName
    individuals: int


@question
def maps(kb: KnowledgeBase, map: MapName | None = None) -> Iterator[KnownMap]:
    """Which semantic maps there are.

    Examples:
        maps
    """
    index = kb.index
    for each in sorted(index.residents) if map is None else (map,):
        yield KnownMap(map=each, individuals=len(index.residents[each]))


class InMap(Row, frozen=True, kw_only=True):
    """Something that is described in a map."""

    individual: IndividualName
    cls: ClassName | None
    """The most special class that it is said to be of."""
    map: MapName


@question
def everything_in_map(
    kb: KnowledgeBase, individual: IndividualName | None = None, map: MapName | None = None
) -> Iterator[InMap]:
    """Everything that is described in a map: objects and constraints.

    Examples:
        everything_in_map
        everything_in_map milk_carton_1
    """
    index = kb.index
    for place in sorted(index.residents) if map is None else (map,):
        if individual is None:
            found = sorted(index.residents[place])
        else:
            found = [individual] if place in index.maps_of.get(individual, ()) else []
        for each in found:
            yield InMap(individual=each, cls=index.class_of(each), map=place)


@everything_in_map.because
def _described(kb: KnowledgeBase, row: InMap) -> Iterator[str]:
    yield statement_line(Statement(row.individual, DESCRIBED_IN_MAP, row.map))


class MapClass(Row, frozen=True, kw_only=True):
    """An individual of a class, or of one below it."""

    cls: ClassName
    individual: IndividualName
    map: MapName


@question
def individual_of_class(
    kb: KnowledgeBase,
    cls: ClassName | None = None,
    individual: IndividualName | None = None,
    map: MapName | None = None,
) -> Iterator[MapClass]:
    """Individuals of a class in a map, those of its subclasses included; or the classes of an individual.

    Examples:
        individual_of_class Handle
        individual_of_class individual=milk_carton_1
    """
    index = kb.index
    for place in sorted(index.residents) if map is None else (map,):
        if individual is not None:
            found = [individual] if place in index.maps_of.get(individual, ()) else []
        else:
            found = sorted(index.residents[place]) if cls is None else index.members(cls, place)
        for each in found:
            classes = {above: None for told in index.types.get(each, ()) for above in index.classes.above(told)}
            for above in classes if cls is None else [cls] if cls in classes else []:
                yield MapClass(cls=above, individual=each, map=place)


@individual_of_class.because
def _member(kb: KnowledgeBase, row: MapClass) -> Iterator[str]:
    yield from member_lines(kb.index, row.individual, row.cls)
