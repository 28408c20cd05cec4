"""Purposes: what questions about storage and about devices have in common."""

from __future__ import annotations

from collections.abc import Iterator

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import MissingKnowledge
from mindstage.knowledge.questions.words import individual_text, missing_description
from mindstage.knowledge.reasoning import Reasoner
from mindstage.knowledge.vocabulary import THING
from mindstage.world import Iri

__all__ = ["members_in", "unspecified"]


def members_in(reasoner: Reasoner, cls: Iri, individual: Iri | None, map: Iri | None) -> Iterator[tuple[Iri, Iri]]:
    """Individuals of a class and their maps."""
    if individual is None:
        for place in sorted(reasoner.members_by_map) if map is None else (map,):
            for member in reasoner.members(cls, place):
                yield member, place
    elif reasoner.is_member(individual, cls):
        for place in sorted(reasoner.maps_of.get(individual, ())):
            if map in {None, place}:
                yield individual, place


def unspecified(
    reasoner: Reasoner, individual: Iri | None, map: Iri | None, property: Iri, reason: str
) -> Iterator[MissingKnowledge]:
    """What nobody told of a thing, or of all that is in a map."""
    places = reasoner.maps_of.get(individual, ()) if individual else tuple(each for each in reasoner.members_by_map)
    if not (map in places and reasoner.members_by_map[map] if map else places):
        yield from missing_description(reasoner, individual, map)
    elif individual:
        yield MissingKnowledge(
            reasoner.class_of(individual) or THING, property, f"{individual_text(reasoner, individual)} {reason}"
        )
    else:
        yield MissingKnowledge(THING, property, f"everything in {local_name(map) if map else 'all maps'} {reason}")
