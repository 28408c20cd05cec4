"""Questions about maps: which there are, and who is in them."""

from __future__ import annotations

from collections.abc import Iterator
from operator import itemgetter
from typing import TYPE_CHECKING

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import (
    AnswerRow,
    ClassName,
    IndividualName,
    MapName,
    MissingKnowledge,
    question,
)
from mindstage.knowledge.questions.words import membership_lines, missing_description, missing_instance, statement_line
from mindstage.knowledge.reasoning import ObjectTriple
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, SEMANTIC_MAP, THING, TYPE
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["InstanceOfClass", "MapInfo", "MapMember", "everything_in_map", "individual_of_class", "maps"]


class MapInfo(AnswerRow, frozen=True, kw_only=True):
    """A map, and how much is in it."""

    map: MapName
    individuals: int


@question
def maps(kb: KnowledgeBase, map: MapName | None = None) -> Iterator[MapInfo]:
    """Which semantic maps there are.

    Examples:
        maps
    """
    index = kb.reasoner
    for each in sorted(index.members_by_map) if map is None else (map,):
        yield MapInfo(map=each, individuals=len(index.members_by_map[each]))


@maps.explain
def _explain_map(kb: KnowledgeBase, row: MapInfo) -> Iterator[str]:
    if SEMANTIC_MAP in kb.reasoner.types.get(row.map, ()):
        yield statement_line(ObjectTriple(row.map, TYPE, SEMANTIC_MAP))
    yield f"{row.individuals} say describedInMap {local_name(row.map)}; their poses and limits are not counted"


@maps.missing
def _missing_maps(kb: KnowledgeBase, map: Iri | None = None) -> Iterator[MissingKnowledge]:
    yield from missing_description(kb.reasoner, None, map)


class MapMember(AnswerRow, frozen=True, kw_only=True):
    """Something that is described in a map."""

    individual: IndividualName
    cls: ClassName | None
    """The most special class that it is said to be of."""
    map: MapName


@question
def everything_in_map(
    kb: KnowledgeBase, individual: IndividualName | None = None, map: MapName | None = None
) -> Iterator[MapMember]:
    """Everything that is described in a map: objects and constraints.

    Examples:
        everything_in_map
        everything_in_map milk_carton_1
    """
    index = kb.reasoner
    for place in sorted(index.members_by_map) if map is None else (map,):
        for each in index.individuals_in(place, individual):
            yield MapMember(individual=each, cls=index.class_of(each), map=place)


@everything_in_map.explain
def _explain_membership(kb: KnowledgeBase, row: MapMember) -> Iterator[str]:
    yield statement_line(ObjectTriple(row.individual, DESCRIBED_IN_MAP, row.map))


@everything_in_map.missing
def _missing_members(
    kb: KnowledgeBase, individual: Iri | None = None, map: Iri | None = None
) -> Iterator[MissingKnowledge]:
    yield from missing_description(kb.reasoner, individual, map)


class InstanceOfClass(AnswerRow, frozen=True, kw_only=True):
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
) -> Iterator[InstanceOfClass]:
    """Individuals of a class in a map, those of its subclasses included; or the classes of an individual.

    Examples:
        individual_of_class Handle
        individual_of_class individual=milk_carton_1
    """
    index = kb.reasoner
    if cls is not None and individual is None:
        members, maps_of = index.members(cls, map), index.maps_of
        here = [(place, each) for each in members for place in ((map,) if map else maps_of.get(each, ()))]
        for place, each in sorted(here, key=itemgetter(0)):  # they are in order within a map already
            yield InstanceOfClass(cls=cls, individual=each, map=place)
        return
    for place in sorted(index.members_by_map) if map is None else (map,):
        for each in index.individuals_in(place, individual):
            classes = {above: None for told in index.types_of(each) for above in index.classes.above(told)}
            for above in classes if cls is None else [cls] if cls in classes else []:
                yield InstanceOfClass(cls=above, individual=each, map=place)


@individual_of_class.explain
def _explain_class(kb: KnowledgeBase, row: InstanceOfClass) -> Iterator[str]:
    yield from membership_lines(kb.reasoner, row.individual, row.cls)


@individual_of_class.missing
def _missing_individuals(
    kb: KnowledgeBase, cls: Iri | None = None, individual: Iri | None = None, map: Iri | None = None
) -> Iterator[MissingKnowledge]:
    index = kb.reasoner
    places = index.maps_of.get(individual, ()) if individual else ()
    if individual and not (map in places if map else places):
        yield from missing_description(index, individual, map)
    elif cls:
        yield missing_instance(cls, individual, map)
    elif individual:
        yield MissingKnowledge(THING, TYPE, f"nobody says what {local_name(individual)} is: it has no type")
    else:
        yield from missing_description(index, None, map)
