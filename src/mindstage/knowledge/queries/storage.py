"""Questions about places: where things of a class are kept.

They follow restrictions that promise a value of some class (someValuesFrom, a qualified cardinality of at least 1).
What only excludes others (allValuesFrom) is no answer: a mug holds nothing but drinks and is no place to keep them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.purposes import members_in, unspecified
from mindstage.knowledge.questions.question import (
    AnswerRow,
    ClassName,
    IndividualName,
    MapName,
    MissingKnowledge,
    question,
)
from mindstage.knowledge.questions.words import (
    membership_lines,
    missing_instance,
    restriction_line,
    subclass_line,
    subproperty_line,
)
from mindstage.knowledge.reasoning import Reasoner, named_classes
from mindstage.knowledge.vocabulary import knowrob
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["StoragePlace", "StoragePlaceInMap", "storage_place", "storage_place_in_environment"]

_CONTAINER_FOR = knowrob("typePrimaryFunction-containerFor")


class StoragePlace(AnswerRow, frozen=True, kw_only=True):
    """A class of things that another class is kept in."""

    item: ClassName
    place: ClassName
    because_of: ClassName
    """The class that the place is said to be for: the item's own, or one above it."""
    generality: int
    """How many classes lie between the item and that reason; the most special reasons, with the least, come first."""


@question
def storage_place(
    kb: KnowledgeBase, item: ClassName | None = None, place: ClassName | None = None
) -> Iterator[StoragePlace]:
    """Where things of a class are kept, the most special place first.

    A place is the class that says so itself; those below it inherit it.

    Examples:
        storage_place CowsMilk
        storage_place Bread
        storage_place place=Dishwasher
    """
    for each in _stored_classes(kb.reasoner, place) if item is None else (item,):
        yield from _find_storage_places(kb.reasoner, each)


def _find_storage_places(reasoner: Reasoner, item: Iri) -> list[StoragePlace]:
    found: dict[Iri, StoragePlace] = {}
    for above in reasoner.classes.above(item):
        for owned in reasoner.restrictions_with_filler(_CONTAINER_FOR, above):
            reason = (
                reasoner.subsuming_class(owned.restriction.filler, item)
                if owned.restriction.implies_existence()
                else None
            )
            if reason is not None:
                row = StoragePlace(
                    item=item,
                    place=owned.cls,
                    because_of=reason,
                    generality=reasoner.classes.count_between(item, reason),
                )
                found[owned.cls] = min(found.get(owned.cls, row), row, key=_sort_key)
    return sorted(found.values(), key=_sort_key)


def _sort_key(row: StoragePlace) -> tuple[int, str, str]:
    return row.generality, row.place, row.because_of


def _stored_classes(reasoner: Reasoner, place: Iri | None) -> list[Iri]:
    """All classes that some place is for, or this one."""
    fillers = (
        filler
        for owned in reasoner.restrictions_on(_CONTAINER_FOR)
        if owned.restriction.implies_existence() and place in {None, owned.cls}
        for filler in named_classes(owned.restriction.filler)
    )
    return sorted({below for filler in dict.fromkeys(fillers) for below in reasoner.classes.below(filler)})


@storage_place.explain
def _explain_storage(kb: KnowledgeBase, row: StoragePlace) -> Iterator[str]:
    index = kb.reasoner
    yield from subclass_line(index.classes.path(row.item, row.because_of))
    for owned in index.restrictions_with_filler(_CONTAINER_FOR, row.because_of):
        if owned.cls == row.place and owned.restriction.implies_existence():
            yield restriction_line(owned.cls, owned.restriction)
            yield from subproperty_line(index.properties.implication_path(owned.restriction.property, _CONTAINER_FOR))
            return


@storage_place.missing
def _missing_storage(
    kb: KnowledgeBase, item: Iri | None = None, place: Iri | None = None
) -> Iterator[MissingKnowledge]:
    property = local_name(_CONTAINER_FOR)
    hint = f"; {heir}" if place and (heir := _ancestor_hint(kb.reasoner, place)) else ""
    if item is None:
        who = local_name(place) if place else "no class"
        verb = "keeps nothing: it does not say" if place else "says"
        yield MissingKnowledge(place or knowrob("Container"), _CONTAINER_FOR, f"{who} {verb} {property} some …{hint}")
    else:
        name = local_name(item)
        where = "has no container" if place is None else f"is not kept in {local_name(place)}"
        who = f"no {property}" if place is None else f"no {property} of {local_name(place)}"
        why = f"{name} {where}: {who} names {name} or an ancestor of it{hint}"
        yield MissingKnowledge(item, _CONTAINER_FOR, why, is_filler=True)


def _ancestor_hint(reasoner: Reasoner, place: Iri) -> str:
    """Whom to ask about instead, where a class says nothing itself and another one above it does."""
    uses = set(reasoner.properties.sub_properties(_CONTAINER_FOR))
    for owned in reasoner.restrictions(place):
        if owned.restriction.property in uses and owned.restriction.implies_existence() and owned.cls != place:
            return f"ask about {local_name(owned.cls)}, which it is"
    return ""


class StoragePlaceInMap(AnswerRow, frozen=True, kw_only=True):
    """A thing in a map that something is kept in."""

    item: ClassName
    individual: IndividualName
    place: ClassName
    """The class that it is a place as."""
    generality: int
    map: MapName


@question
def storage_place_in_environment(
    kb: KnowledgeBase,
    item: ClassName | None = None,
    individual: IndividualName | None = None,
    map: MapName | None = None,
) -> Iterator[StoragePlaceInMap]:
    """Where, in a map, things of a class are kept; the most special place first.

    Examples:
        storage_place_in_environment CowsMilk
    """
    index = kb.reasoner
    for each in _stored_classes(index, None) if item is None else (item,):
        seen = set()
        for storage in _find_storage_places(index, each):
            for here, place in members_in(index, storage.place, individual, map):
                if (here, place) not in seen:
                    seen.add((here, place))
                    yield StoragePlaceInMap(
                        item=each, individual=here, place=storage.place, generality=storage.generality, map=place
                    )


@storage_place_in_environment.explain
def _explain_storage_in_map(kb: KnowledgeBase, row: StoragePlaceInMap) -> Iterator[str]:
    for storage in _find_storage_places(kb.reasoner, row.item):
        if storage.place == row.place:
            yield from _explain_storage(kb, storage)
    yield from membership_lines(kb.reasoner, row.individual, row.place)


@storage_place_in_environment.missing
def _missing_storage_in_map(
    kb: KnowledgeBase, item: Iri | None = None, individual: Iri | None = None, map: Iri | None = None
) -> Iterator[MissingKnowledge]:
    storages = _find_storage_places(kb.reasoner, item) if item else []
    if item and not storages:
        yield from _missing_storage(kb, item)
    for storage in storages:
        yield missing_instance(storage.place, individual, map)
    if item is None:
        says = f"says {local_name(_CONTAINER_FOR)} some …"
        yield from unspecified(
            kb.reasoner, individual, map, _CONTAINER_FOR, f"keeps nothing: no class that it is of {says}"
        )
