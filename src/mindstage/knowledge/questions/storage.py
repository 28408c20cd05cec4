"""Questions about places: where things of a class are kept.

They follow restrictions that promise a value of some class (someValuesFrom, a qualified cardinality of at least 1).
What only excludes others (allValuesFrom) is no answer: a mug holds nothing but drinks and is no place to keep them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.purposes import members_in, of_no_use
from mindstage.knowledge.questions.question import ClassName, IndividualName, MapName, Missing, Row, question
from mindstage.knowledge.questions.words import implies_line, is_line, member_lines, not_here, restriction_line
from mindstage.knowledge.reasoning import Index, classes_in
from mindstage.knowledge.vocabulary import knowrob
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["Storage", "StorageHere", "storage_place", "storage_place_in_environment"]

_CONTAINER_FOR = knowrob("typePrimaryFunction-containerFor")


class Storage(Row, frozen=True, kw_only=True):
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
) -> Iterator[Storage]:
    """Where things of a class are kept, the most special place first.

    A place is the class that says so itself; those below it inherit it.

    Examples:
        storage_place CowsMilk
        storage_place Bread
        storage_place place=Dishwasher
    """
    for each in _items(kb.index, place) if item is None else (item,):
        yield from _storages(kb.index, each)


def _storages(index: Index, item: Iri) -> list[Storage]:
    found: dict[Iri, Storage] = {}
    for above in index.classes.above(item):
        for owned in index.naming(_CONTAINER_FOR, above):
            reason = index.reason(owned.restriction.filler, item) if owned.restriction.promises() else None
            if reason is not None:
                row = Storage(
                    item=item, place=owned.cls, because_of=reason, generality=index.classes.between(item, reason)
                )
                found[owned.cls] = min(found.get(owned.cls, row), row, key=_order)
    return sorted(found.values(), key=_order)


def _order(row: Storage) -> tuple[int, str, str]:
    return row.generality, row.place, row.because_of


def _items(index: Index, place: Iri | None) -> list[Iri]:
    """All classes that some place is for, or this one."""
    fillers = (
        filler
        for owned in index.stating(_CONTAINER_FOR)
        if owned.restriction.promises() and place in {None, owned.cls}
        for filler in classes_in(owned.restriction.filler)
    )
    return sorted({below for filler in dict.fromkeys(fillers) for below in index.classes.below(filler)})


@storage_place.because
def _why_there(kb: KnowledgeBase, row: Storage) -> Iterator[str]:
    index = kb.index
    yield from is_line(index.classes.path(row.item, row.because_of))
    for owned in index.naming(_CONTAINER_FOR, row.because_of):
        if owned.cls == row.place and owned.restriction.promises():
            yield restriction_line(owned.cls, owned.restriction)
            yield from implies_line(index.properties.path(owned.restriction.property, _CONTAINER_FOR))
            return


@storage_place.lacking
def _no_place(kb: KnowledgeBase, item: Iri | None = None, place: Iri | None = None) -> Iterator[Missing]:
    property = local_name(_CONTAINER_FOR)
    hint = f"; {heir}" if place and (heir := _heir_of_place(kb.index, place)) else ""
    if item is None:
        who = local_name(place) if place else "no class"
        verb = "keeps nothing: it does not say" if place else "says"
        yield Missing(place or knowrob("Container"), _CONTAINER_FOR, f"{who} {verb} {property} some …{hint}")
    else:
        name = local_name(item)
        where = "has no container" if place is None else f"is not kept in {local_name(place)}"
        who = f"no {property}" if place is None else f"no {property} of {local_name(place)}"
        why = f"{name} {where}: {who} names {name} or an ancestor of it{hint}"
        yield Missing(item, _CONTAINER_FOR, why, as_value=True)


def _heir_of_place(index: Index, place: Iri) -> str:
    """Whom to ask about instead, where a class says nothing itself and another one above it does."""
    uses = set(index.properties.sub_properties(_CONTAINER_FOR))
    for owned in index.restrictions(place):
        if owned.restriction.property in uses and owned.restriction.promises() and owned.cls != place:
            return f"ask about {local_name(owned.cls)}, which it is"
    return ""


class StorageHere(Row, frozen=True, kw_only=True):
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
) -> Iterator[StorageHere]:
    """Where, in a map, things of a class are kept; the most special place first.

    Examples:
        storage_place_in_environment CowsMilk
    """
    index = kb.index
    for each in _items(index, None) if item is None else (item,):
        seen = set()
        for storage in _storages(index, each):
            for here, place in members_in(index, storage.place, individual, map):
                if (here, place) not in seen:
                    seen.add((here, place))
                    yield StorageHere(
                        item=each, individual=here, place=storage.place, generality=storage.generality, map=place
                    )


@storage_place_in_environment.because
def _why_here(kb: KnowledgeBase, row: StorageHere) -> Iterator[str]:
    for storage in _storages(kb.index, row.item):
        if storage.place == row.place:
            yield from _why_there(kb, storage)
    yield from member_lines(kb.index, row.individual, row.place)


@storage_place_in_environment.lacking
def _no_place_here(
    kb: KnowledgeBase, item: Iri | None = None, individual: Iri | None = None, map: Iri | None = None
) -> Iterator[Missing]:
    storages = _storages(kb.index, item) if item else []
    if item and not storages:
        yield from _no_place(kb, item)
    for storage in storages:
        yield not_here(storage.place, individual, map)
    if item is None:
        says = f"says {local_name(_CONTAINER_FOR)} some …"
        yield from of_no_use(kb.index, individual, map, _CONTAINER_FOR, f"keeps nothing: no class that it is of {says}")
