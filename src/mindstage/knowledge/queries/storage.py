"""Questions about purposes: where items are stored, and which devices actions are done with.

Both follow restrictions that imply existence (someValuesFrom, a qualified cardinality of at least 1). A restriction
that only excludes fillers (allValuesFrom) gives no answer: a mug contains nothing but drinks, but does not store them.
"""

from __future__ import annotations

from collections.abc import Iterator

from mindstage.knowledge.explain import (
    expression_text,
    individual_text,
    membership_lines,
    missing_description,
    missing_instance,
    restriction_line,
    subclass_line,
    subproperty_line,
)
from mindstage.knowledge.owl import named_classes
from mindstage.knowledge.questions import (
    AnswerRow,
    ClassName,
    IndividualName,
    MapName,
    MissingKnowledge,
    QuestionContext,
    question,
)
from mindstage.knowledge.rdf import local_name
from mindstage.knowledge.reasoner import Reasoner
from mindstage.knowledge.reasoner_classes import ClassRestriction
from mindstage.knowledge.vocabulary import THING, knowrob
from mindstage.scene import Iri

__all__ = [
    "ActionDevice",
    "ActionDeviceInMap",
    "StoragePlace",
    "StoragePlaceInMap",
    "device_for_action",
    "device_for_action_in_environment",
    "storage_place",
    "storage_place_in_environment",
]

_DEVICE_USED = knowrob("deviceUsed")
_CONTAINER_FOR = knowrob("typePrimaryFunction-containerFor")


def _members_in(reasoner: Reasoner, cls: Iri, individual: Iri | None, map: Iri | None) -> Iterator[tuple[Iri, Iri]]:
    """Individuals of a class, with the maps that describe them."""
    if individual is None:
        for place in sorted(reasoner.members_by_map) if map is None else (map,):
            for member in reasoner.members(cls, place):
                yield member, place
    elif reasoner.is_member(individual, cls):
        for place in sorted(reasoner.maps_of.get(individual, ())):
            if map in {None, place}:
                yield individual, place


def _missing_use(
    reasoner: Reasoner, individual: Iri | None, map: Iri | None, property: Iri, reason: str
) -> Iterator[MissingKnowledge]:
    """The missing statement about an individual, or about everything in a map."""
    places = reasoner.maps_of.get(individual, ()) if individual else tuple(each for each in reasoner.members_by_map)
    if not (map in places and reasoner.members_by_map[map] if map else places):
        yield from missing_description(reasoner, individual, map)
    elif individual:
        yield MissingKnowledge(
            reasoner.class_of(individual) or THING, property, f"{individual_text(reasoner, individual)} {reason}"
        )
    else:
        yield MissingKnowledge(THING, property, f"everything in {local_name(map) if map else 'all maps'} {reason}")


class ActionDevice(AnswerRow, frozen=True, kw_only=True):
    """A class of devices that an action needs."""

    action: ClassName
    device: ClassName
    told_by: ClassName
    """The action's class, or the superclass that has the restriction."""


@question(
    sentences=(
        "what [device] is used for {action}",
        "what do i need (for|to) {action}",
        "what can {device} be used for",
        "what is {device} [used] for",
        "what can i do with {device}",
        "which devices are [used] for {action}",
        "what kind of device is used for {action}",
        "what does one need for {action}",
    )
)
def device_for_action(
    kb: QuestionContext, action: ClassName | None = None, device: ClassName | None = None
) -> Iterator[ActionDevice]:
    """Which devices an action is done with; those of its own class come before inherited ones.

    Examples:
        device_for_action BakingFood
        device_for_action device=Dishwasher
    """
    for each in _all_actions(kb.reasoner) if action is None else (action,):
        yield from _find_devices(kb.reasoner, each)


def _find_devices(reasoner: Reasoner, action: Iri) -> Iterator[ActionDevice]:
    seen = set()
    for owned in _device_restrictions(reasoner, action):
        for device in named_classes(owned.restriction.filler):
            if device not in seen:
                seen.add(device)
                yield ActionDevice(action=action, device=device, told_by=owned.cls)


def _device_restrictions(reasoner: Reasoner, action: Iri) -> Iterator[ClassRestriction]:
    uses = set(reasoner.properties.sub_properties(_DEVICE_USED))
    for owned in reasoner.restrictions(action):
        if (
            owned.restriction.property in uses
            and owned.restriction.implies_existence()
            and not owned.restriction.inverse
        ):
            yield owned


def _all_actions(reasoner: Reasoner) -> list[Iri]:
    owners = {owned.cls for owned in reasoner.restrictions_on(_DEVICE_USED)}
    return sorted({below for owner in owners for below in reasoner.classes.below(owner)})


@device_for_action.explain
def _explain_device(kb: QuestionContext, row: ActionDevice) -> Iterator[str]:
    yield from subclass_line(kb.reasoner.classes.path(row.action, row.told_by))
    for owned in _device_restrictions(kb.reasoner, row.told_by):
        if owned.cls == row.told_by and row.device in named_classes(owned.restriction.filler):
            yield restriction_line(owned.cls, owned.restriction)
            yield from subproperty_line(
                kb.reasoner.properties.implication_path(owned.restriction.property, _DEVICE_USED)
            )
            return


@device_for_action.missing
def _missing_device(
    kb: QuestionContext, action: Iri | None = None, device: Iri | None = None
) -> Iterator[MissingKnowledge]:
    property = local_name(_DEVICE_USED)
    if action is not None:
        fillers = ", ".join(
            expression_text(owned.restriction.filler) for owned in _device_restrictions(kb.reasoner, action)
        )
        but = f"it needs {fillers}" if fillers else f"neither it nor an ancestor of it has {property} some …"
        yield MissingKnowledge(action, _DEVICE_USED, f"{local_name(action)} has no such {property}: {but}")
    elif device is not None:
        needed = _all_devices(kb.reasoner)
        above = next((cls for cls in kb.reasoner.classes.above(device) if cls in needed), None)
        hint = f"; ask about its ancestor {local_name(above)}" if above else ""
        why = f"no action needs a {local_name(device)}: no {property} names it{hint}"
        yield MissingKnowledge(device, _DEVICE_USED, why, is_filler=True)
    else:
        yield MissingKnowledge(knowrob("PhysicalDevice"), _DEVICE_USED, f"no class has {property} some …")


def _all_devices(reasoner: Reasoner) -> set[Iri]:
    restrictions = (owned.restriction for owned in reasoner.restrictions_on(_DEVICE_USED))
    return {device for each in restrictions if each.implies_existence() for device in named_classes(each.filler)}


class ActionDeviceInMap(AnswerRow, frozen=True, kw_only=True):
    """A device in a map that an action is done with."""

    action: ClassName
    individual: IndividualName
    device: ClassName
    """The class that the action needs."""
    map: MapName


@question(
    sentences=(
        "where can i [do] {action}",
        "with what can i [do] {action}",
        "what [here] can i use for {action}",
        "which (thing|object) can i use for {action}",
        "what can {individual} do",
        "how do i {action}",
        "what is {individual} good for",
    )
)
def device_for_action_in_environment(
    kb: QuestionContext,
    action: ClassName | None = None,
    individual: IndividualName | None = None,
    map: MapName | None = None,
) -> Iterator[ActionDeviceInMap]:
    """Which individuals in a map an action is done with.

    Examples:
        device_for_action_in_environment BakingFood
    """
    for each in _all_actions(kb.reasoner) if action is None else (action,):
        seen = set()
        for need in _find_devices(kb.reasoner, each):
            for member, place in _members_in(kb.reasoner, need.device, individual, map):
                if (member, place) not in seen:
                    seen.add((member, place))
                    yield ActionDeviceInMap(action=each, individual=member, device=need.device, map=place)


@device_for_action_in_environment.explain
def _explain_device_in_map(kb: QuestionContext, row: ActionDeviceInMap) -> Iterator[str]:
    for need in _find_devices(kb.reasoner, row.action):
        if need.device == row.device:
            yield from _explain_device(kb, need)
    yield from membership_lines(kb.reasoner, row.individual, row.device)


@device_for_action_in_environment.missing
def _missing_device_in_map(
    kb: QuestionContext, action: Iri | None = None, individual: Iri | None = None, map: Iri | None = None
) -> Iterator[MissingKnowledge]:
    needs = list(_find_devices(kb.reasoner, action)) if action else []
    if action and not needs:
        yield from _missing_device(kb, action)
    for need in needs:
        yield missing_instance(need.device, individual, map)
    if action is None:
        reason = f"is needed by no action: no {local_name(_DEVICE_USED)} names one of its classes"
        yield from _missing_use(kb.reasoner, individual, map, _DEVICE_USED, reason)


class StoragePlace(AnswerRow, frozen=True, kw_only=True):
    """A class of places that items of another class are stored in."""

    item: ClassName
    place: ClassName
    because_of: ClassName
    """The class that the place is for: the item's own, or one of its superclasses."""
    generality: int
    """The number of classes between `item` and `because_of`; the most specific answers, with the fewest, come first."""


@question(
    sentences=(
        "(what kind of|which kind of) (place|container) is {item} (stored|kept) in",
        "where is {item} (stored|kept) in general",
        "where are {item} usually (stored|kept)",
        "what is (stored|kept) in {place} in general",
        "what belongs (in|into) {place} in general",
        "what kinds of things go (in|into) {place}",
        "what kinds of things are (stored|kept) in {place}",
        "what do we (store|keep) in {place}",
    )
)
def storage_place(
    kb: QuestionContext, item: ClassName | None = None, place: ClassName | None = None
) -> Iterator[StoragePlace]:
    """Where items of a class are stored, the most specific place first.

    A place is the class that has the restriction itself; its subclasses inherit it.

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
    """All classes that some place, or this one, is for."""
    fillers = (
        filler
        for owned in reasoner.restrictions_on(_CONTAINER_FOR)
        if owned.restriction.implies_existence() and place in {None, owned.cls}
        for filler in named_classes(owned.restriction.filler)
    )
    return sorted({below for filler in dict.fromkeys(fillers) for below in reasoner.classes.below(filler)})


@storage_place.explain
def _explain_storage(kb: QuestionContext, row: StoragePlace) -> Iterator[str]:
    index = kb.reasoner
    yield from subclass_line(index.classes.path(row.item, row.because_of))
    for owned in index.restrictions_with_filler(_CONTAINER_FOR, row.because_of):
        if owned.cls == row.place and owned.restriction.implies_existence():
            yield restriction_line(owned.cls, owned.restriction)
            yield from subproperty_line(index.properties.implication_path(owned.restriction.property, _CONTAINER_FOR))
            return


@storage_place.missing
def _missing_storage(
    kb: QuestionContext, item: Iri | None = None, place: Iri | None = None
) -> Iterator[MissingKnowledge]:
    property = local_name(_CONTAINER_FOR)
    hint = f"; {ancestor}" if place and (ancestor := _ancestor_hint(kb.reasoner, place)) else ""
    if item is None:
        why = f"{local_name(place)} stores nothing: it has no" if place else "no class has"
        yield MissingKnowledge(place or knowrob("Container"), _CONTAINER_FOR, f"{why} {property} some …{hint}")
    else:
        name = local_name(item)
        where = "has no container" if place is None else f"is not kept in {local_name(place)}"
        restriction = f"no {property}" if place is None else f"no {property} of {local_name(place)}"
        why = f"{name} {where}: {restriction} names {name} or an ancestor of it{hint}"
        yield MissingKnowledge(item, _CONTAINER_FOR, why, is_filler=True)


def _ancestor_hint(reasoner: Reasoner, place: Iri) -> str:
    """Which ancestor to ask about instead of a class without a restriction of its own; empty if there is none."""
    uses = set(reasoner.properties.sub_properties(_CONTAINER_FOR))
    for owned in reasoner.restrictions(place):
        if owned.restriction.property in uses and owned.restriction.implies_existence() and owned.cls != place:
            return f"ask about its ancestor {local_name(owned.cls)}"
    return ""


class StoragePlaceInMap(AnswerRow, frozen=True, kw_only=True):
    """An individual in a map that items of a class are stored in."""

    item: ClassName
    individual: IndividualName
    place: ClassName
    """The class that stores the item."""
    generality: int
    map: MapName


@question(
    sentences=(
        "where is {item} (stored|kept)",
        "where does {item} belong",
        "where does {item} go",
        "where (should|do|can) i put {item}",
        "where do i (store|keep) {item}",
        "where should {item} be [stored|kept]",
        "what is the (storage place|place) of {item}",
        "put away {item}",
        "where do we (store|keep) {item}",
        "is {item} (stored|kept) in {individual}",
        "what is (stored|kept) in {individual}",
        "what belongs (in|into) {individual}",
        "what (goes|should go) (in|into) {individual}",
        "what should be in {individual}",
    )
)
def storage_place_in_environment(
    kb: QuestionContext,
    item: ClassName | None = None,
    individual: IndividualName | None = None,
    map: MapName | None = None,
) -> Iterator[StoragePlaceInMap]:
    """Where, in a map, items of a class are stored; the most specific place first.

    Examples:
        storage_place_in_environment CowsMilk
    """
    index = kb.reasoner
    for each in _stored_classes(index, None) if item is None else (item,):
        seen = set()
        for storage in _find_storage_places(index, each):
            for member, place in _members_in(index, storage.place, individual, map):
                if (member, place) not in seen:
                    seen.add((member, place))
                    yield StoragePlaceInMap(
                        item=each, individual=member, place=storage.place, generality=storage.generality, map=place
                    )


@storage_place_in_environment.explain
def _explain_storage_in_map(kb: QuestionContext, row: StoragePlaceInMap) -> Iterator[str]:
    for storage in _find_storage_places(kb.reasoner, row.item):
        if storage.place == row.place:
            yield from _explain_storage(kb, storage)
    yield from membership_lines(kb.reasoner, row.individual, row.place)


@storage_place_in_environment.missing
def _missing_storage_in_map(
    kb: QuestionContext, item: Iri | None = None, individual: Iri | None = None, map: Iri | None = None
) -> Iterator[MissingKnowledge]:
    storages = _find_storage_places(kb.reasoner, item) if item else []
    if item and not storages:
        yield from _missing_storage(kb, item)
    for storage in storages:
        yield missing_instance(storage.place, individual, map)
    if item is None:
        reason = f"stores nothing: none of its classes has {local_name(_CONTAINER_FOR)} some …"
        yield from _missing_use(kb.reasoner, individual, map, _CONTAINER_FOR, reason)
