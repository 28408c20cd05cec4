"""Questions about maps: which there are, and who is in them."""

from __future__ import annotations

from collections.abc import Iterator
from operator import itemgetter
from typing import TYPE_CHECKING

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import ClassName, IndividualName, MapName, Missing, Row, question
from mindstage.knowledge.questions.words import member_lines, not_described, not_here, statement_line
from mindstage.knowledge.reasoning import Statement
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, SEMANTIC_MAP, THING, TYPE
from mindstage.world import Iri

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


@maps.because
def _known(kb: KnowledgeBase, row: KnownMap) -> Iterator[str]:
    if SEMANTIC_MAP in kb.index.types.get(row.map, ()):
        yield statement_line(Statement(row.map, TYPE, SEMANTIC_MAP))
    yield f"{row.individuals} say describedInMap {local_name(row.map)}; their poses and limits are not counted"


@maps.lacking
def _no_maps(kb: KnowledgeBase, map: Iri | None = None) -> Iterator[Missing]:
    yield from not_described(kb.index, None, map)


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
        for each in index.described_in(place, individual):
            yield InMap(individual=each, cls=index.class_of(each), map=place)


@everything_in_map.because
def _described(kb: KnowledgeBase, row: InMap) -> Iterator[str]:
    yield statement_line(Statement(row.individual, DESCRIBED_IN_MAP, row.map))


@everything_in_map.lacking
def _nothing_there(kb: KnowledgeBase, individual: Iri | None = None, map: Iri | None = None) -> Iterator[Missing]:
    yield from not_described(kb.index, individual, map)


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
    if cls is not None and individual is None:
        members, maps_of = index.members(cls, map), index.maps_of
        here = [(place, each) for each in members for place in ((map,) if map else maps_of.get(each, ()))]
        for place, each in sorted(here, key=itemgetter(0)):  # they are in order within a map already
            yield MapClass(cls=cls, individual=each, map=place)
        return
    for place in sorted(index.residents) if map is None else (map,):
        for each in index.described_in(place, individual):
            classes = {above: None for told in index.types_of(each) for above in index.classes.above(told)}
            for above in classes if cls is None else [cls] if cls in classes else []:
                yield MapClass(cls=above, individual=each, map=place)


@individual_of_class.because
def _member(kb: KnowledgeBase, row: MapClass) -> Iterator[str]:
    yield from member_lines(kb.index, row.individual, row.cls)


@individual_of_class.lacking
def _nobody(
    kb: KnowledgeBase, cls: Iri | None = None, individual: Iri | None = None, map: Iri | None = None
) -> Iterator[Missing]:
    index = kb.index
    places = index.maps_of.get(individual, ()) if individual else ()
    if individual and not (map in places if map else places):
        yield from not_described(index, individual, map)
    elif cls:
        yield not_here(cls, individual, map)
    elif individual:
        yield Missing(THING, TYPE, f"nobody says what {local_name(individual)} is: it has no type")
    else:
        yield from not_described(index, None, map)
