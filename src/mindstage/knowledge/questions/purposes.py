"""Purposes: what questions about storage and about devices have in common."""

from __future__ import annotations

from collections.abc import Iterator

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import Missing
from mindstage.knowledge.questions.words import not_described, thing_text
from mindstage.knowledge.reasoning import Index
from mindstage.knowledge.vocabulary import THING
from mindstage.world import Iri

__all__ = ["members_in", "of_no_use"]


def members_in(index: Index, cls: Iri, individual: Iri | None, map: Iri | None) -> Iterator[tuple[Iri, Iri]]:
    """Individuals of a class and their maps."""
    if individual is None:
        for place in sorted(index.residents) if map is None else (map,):
            for member in index.members(cls, place):
                yield member, place
    elif index.is_member(individual, cls):
        for place in sorted(index.maps_of.get(individual, ())):
            if map in {None, place}:
                yield individual, place


def of_no_use(index: Index, individual: Iri | None, map: Iri | None, property: Iri, why: str) -> Iterator[Missing]:
    """What nobody told of a thing, or of all that is in a map."""
    places = index.maps_of.get(individual, ()) if individual else tuple(each for each in index.residents)
    if not (map in places and index.residents[map] if map else places):
        yield from not_described(index, individual, map)
    elif individual:
        yield Missing(index.class_of(individual) or THING, property, f"{thing_text(index, individual)} {why}")
    else:
        yield Missing(THING, property, f"everything in {local_name(map) if map else 'all maps'} {why}")
