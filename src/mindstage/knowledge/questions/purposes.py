"""Questions about what things are for: where something is kept, and what an action needs.

Both follow restrictions that promise a value of some class (someValuesFrom, a qualified cardinality of at least 1).
What only excludes others (allValuesFrom) is no answer: a mug holds nothing but drinks and is no place to keep them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import ClassName, IndividualName, MapName, Missing, Row, question
from mindstage.knowledge.questions.words import expression_text, implies_line, is_line, member_lines, restriction_line
from mindstage.knowledge.reasoning import AllOf, AnyOf, ClassRestriction, Expression, Index, Named
from mindstage.knowledge.vocabulary import TYPE, knowrob
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = [
    "CONTAINER_FOR",
    "DEVICE_USED",
    "Device",
    "DeviceHere",
    "Storage",
    "StorageHere",
    "device_for_action",
    "device_for_action_in_environment",
    "storage_place",
    "storage_place_in_environment",
]

CONTAINER_FOR = knowrob("typePrimaryFunction-containerFor")
DEVICE_USED = knowrob("deviceUsed")


# -- places ------------------------------------------------------------------------------------------------------------


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
        for owned in index.naming(CONTAINER_FOR, above):
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
        for owned in index.stating(CONTAINER_FOR)
        if owned.restriction.promises() and place in {None, owned.cls}
        for filler in _classes_in(owned.restriction.filler)
    )
    return sorted({below for filler in dict.fromkeys(fillers) for below in index.classes.below(filler)})


def _classes_in(expression: Expression | None) -> Iterator[Iri]:
    match expression:
        case Named(iri):
            yield iri
        case AnyOf(members) | AllOf(members):
            for member in members:
                yield from _classes_in(member)


@storage_place.because
def _why_there(kb: KnowledgeBase, row: Storage) -> Iterator[str]:
    index = kb.index
    yield from is_line(index.classes.path(row.item, row.because_of))
    for owned in index.naming(CONTAINER_FOR, row.because_of):
        if owned.cls == row.place and owned.restriction.promises():
            yield restriction_line(owned.cls, owned.restriction)
            yield from implies_line(index.properties.path(owned.restriction.property, CONTAINER_FOR))
            return


@storage_place.lacking
def _no_place(kb: KnowledgeBase, item: Iri | None = None, place: Iri | None = None) -> Iterator[Missing]:
    property = local_name(CONTAINER_FOR)
    if item is None:
        cls = place or knowrob("Container")
        yield Missing(cls, CONTAINER_FOR, f"{local_name(cls)} keeps nothing: it does not say {property} some …")
    else:
        name = local_name(item)
        where = "has no container" if place is None else f"is not kept in {local_name(place)}"
        who = f"no {property}" if place is None else f"no {property} of {local_name(place)}"
        yield Missing(item, CONTAINER_FOR, f"{name} {where}: {who} names {name} or an ancestor of it")


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
            for here, place in _members(index, storage.place, individual, map):
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
    if not storages:
        yield from _no_place(kb, item)
    for storage in storages:
        yield _not_here(storage.place, individual, map)


# -- devices -----------------------------------------------------------------------------------------------------------


class Device(Row, frozen=True, kw_only=True):
    """A class of things that an action needs."""

    action: ClassName
    device: ClassName
    told_by: ClassName
    """The action's own class, or the one above it that says so."""


@question
def device_for_action(
    kb: KnowledgeBase, action: ClassName | None = None, device: ClassName | None = None
) -> Iterator[Device]:
    """What an action is done with; what its own class says comes before what it inherits.

    Examples:
        device_for_action BakingFood
        device_for_action device=Dishwasher
    """
    for each in _actions(kb.index) if action is None else (action,):
        yield from _devices(kb.index, each)


def _devices(index: Index, action: Iri) -> Iterator[Device]:
    seen = set()
    for owned in _needs(index, action):
        for device in _classes_in(owned.restriction.filler):
            if device not in seen:
                seen.add(device)
                yield Device(action=action, device=device, told_by=owned.cls)


def _needs(index: Index, action: Iri) -> Iterator[ClassRestriction]:
    uses = set(index.properties.sub_properties(DEVICE_USED))
    for owned in index.restrictions(action):
        if owned.restriction.property in uses and owned.restriction.promises() and not owned.restriction.inverse:
            yield owned


def _actions(index: Index) -> list[Iri]:
    owners = {owned.cls for owned in index.stating(DEVICE_USED)}
    return sorted({below for owner in owners for below in index.classes.below(owner)})


@device_for_action.because
def _why_device(kb: KnowledgeBase, row: Device) -> Iterator[str]:
    yield from is_line(kb.index.classes.path(row.action, row.told_by))
    for owned in _needs(kb.index, row.told_by):
        if owned.cls == row.told_by and row.device in _classes_in(owned.restriction.filler):
            yield restriction_line(owned.cls, owned.restriction)
            yield from implies_line(kb.index.properties.path(owned.restriction.property, DEVICE_USED))
            return


@device_for_action.lacking
def _no_device(kb: KnowledgeBase, action: Iri | None = None, device: Iri | None = None) -> Iterator[Missing]:
    property = local_name(DEVICE_USED)
    if action is None:
        cls = device or knowrob("PhysicalDevice")
        yield Missing(cls, DEVICE_USED, f"no action needs a {local_name(cls)}: no {property} names it")
    else:
        told = ", ".join(expression_text(owned.restriction.filler) for owned in _needs(kb.index, action))
        but = f"it needs {told}" if told else f"neither it nor an ancestor of it says {property} some …"
        yield Missing(action, DEVICE_USED, f"{local_name(action)} has no such {property}: {but}")


class DeviceHere(Row, frozen=True, kw_only=True):
    """A thing in a map that an action is done with."""

    action: ClassName
    individual: IndividualName
    device: ClassName
    """The class that it is needed as."""
    map: MapName


@question
def device_for_action_in_environment(
    kb: KnowledgeBase,
    action: ClassName | None = None,
    individual: IndividualName | None = None,
    map: MapName | None = None,
) -> Iterator[DeviceHere]:
    """What, in a map, an action is done with.

    Examples:
        device_for_action_in_environment BakingFood
    """
    for each in _actions(kb.index) if action is None else (action,):
        seen = set()
        for need in _devices(kb.index, each):
            for here, place in _members(kb.index, need.device, individual, map):
                if (here, place) not in seen:
                    seen.add((here, place))
                    yield DeviceHere(action=each, individual=here, device=need.device, map=place)


@device_for_action_in_environment.because
def _why_device_here(kb: KnowledgeBase, row: DeviceHere) -> Iterator[str]:
    for need in _devices(kb.index, row.action):
        if need.device == row.device:
            yield from _why_device(kb, need)
    yield from member_lines(kb.index, row.individual, row.device)


@device_for_action_in_environment.lacking
def _no_device_here(
    kb: KnowledgeBase, action: Iri | None = None, individual: Iri | None = None, map: Iri | None = None
) -> Iterator[Missing]:
    needs = list(_devices(kb.index, action)) if action else []
    if not needs:
        yield from _no_device(kb, action)
    for need in needs:
        yield _not_here(need.device, individual, map)


def _members(index: Index, cls: Iri, individual: Iri | None, map: Iri | None) -> Iterator[tuple[Iri, Iri]]:
    """Individuals of a class and their maps."""
    if individual is None:
        for place in sorted(index.residents) if map is None else (map,):
            for member in index.members(cls, place):
                yield member, place
    elif index.is_member(individual, cls):
        for place in sorted(index.maps_of.get(individual, ())):
            if map in {None, place}:
                yield individual, place


def _not_here(cls: Iri, individual: Iri | None, map: Iri | None) -> Missing:
    who = "no individual" if individual is None else local_name(individual)
    where = "any map" if map is None else local_name(map)
    verb = "is" if individual is None else "is not"
    return Missing(cls, TYPE, f"{who} in {where} {verb} a {local_name(cls)}")
