"""Questions about purposes: where items are stored, and which devices actions are done with.

Both follow restrictions that imply existence (someValuesFrom, a qualified cardinality of at least 1). A restriction
that only excludes fillers (allValuesFrom) gives no answer: a mug contains nothing but drinks, but does not store them.

SOMA states purposes by dispositions: a device has a disposition that affords a task, and a storage place has the
disposition Storage, which affords to be the place of what its trigger classifies. Both are followed as well, for
classes and for individuals of maps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from mindstage.knowledge.claims import Claim, ClaimKind
from mindstage.knowledge.explain import (
    expression_text,
    individual_text,
    membership_lines,
    missing_description,
    missing_instance,
    restriction_line,
    restriction_text,
    statement_line,
    subclass_line,
    subproperty_line,
)
from mindstage.knowledge.owl import Expression, IntersectionOf, NamedClass, Restriction, named_classes
from mindstage.knowledge.questions import (
    AnswerRow,
    AskedArguments,
    ClassName,
    IndividualName,
    MapName,
    MissingKnowledge,
    QuestionContext,
    question,
)
from mindstage.knowledge.reasoner import Reasoner
from mindstage.knowledge.reasoner_classes import ClassRestriction
from mindstage.knowledge.reasoner_properties import ObjectTriple
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import (
    AFFORDS_TASK,
    AFFORDS_TRIGGER,
    CLASSIFIES,
    HAS_DISPOSITION,
    STORAGE,
    TASK_AFFORDED_BY,
    THING,
    knowrob,
)
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
_MAX_LIMITS = 3
"""The number of restrictions that a reason names."""


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
    reasoner: Reasoner, individual: Iri | None, map: Iri | None, property: Iri, reason: str, *, fillers: bool
) -> Iterator[MissingKnowledge]:
    """The missing statement about an individual, or about everything in a map.

    Args:
        individual: the individual; None for all.
        map: the map; None for all.
        property: the property of the missing restrictions.
        reason: the rest of the sentence about the individual.
        fillers: whether its classes are missing as fillers of the restrictions, rather than as owners.
    """
    places = reasoner.maps_of.get(individual, ()) if individual else tuple(each for each in reasoner.members_by_map)
    if not (map in places and reasoner.members_by_map[map] if map else places):
        yield from missing_description(reasoner, individual, map)
        return
    chosen = [members for place, members in reasoner.members_by_map.items() if map in {None, place}]
    members = {individual} if individual else {member for members in chosen for member in members}
    classes = sorted({cls for member in members for cls in reasoner.types_of(member)})
    classless = (member for member in sorted(members) if not reasoner.types_of(member))
    restrictions = ((None, cls) if fillers else (cls, None) for cls in classes)
    claims = (
        *(Claim(kind=ClaimKind.NO_CLASS, subject=member) for member in classless),
        *(
            Claim(kind=ClaimKind.NO_RESTRICTION, subject=subject, property=property, object=filler)
            for subject, filler in restrictions
        ),
    )
    if individual:
        cls, owner = reasoner.class_of(individual) or THING, individual_text(reasoner, individual)
    else:
        cls, owner = THING, f"everything in {local_name(map) if map else 'all maps'}"
    yield MissingKnowledge(cls, property, f"{owner} {reason}", claims=claims)


# -- dispositions ------------------------------------------------------------------------------------------------------


class _Affordance(NamedTuple):
    """A class whose members have a disposition for something."""

    owner: Iri
    purpose: Iri
    """The task that the disposition affords, or the class of what is stored."""
    lines: tuple[str, ...]
    """The restrictions that state it."""


def _conjuncts(expression: Expression | None) -> Iterator[Expression]:
    """The expressions that every instance of an expression is an instance of."""
    if isinstance(expression, IntersectionOf):
        for member in expression.members:
            yield from _conjuncts(member)
    elif expression is not None:
        yield expression


def _tasks(reasoner: Reasoner, disposition: Expression | None) -> Iterator[tuple[Iri, tuple[str, ...]]]:
    """The tasks that a disposition affords, with the restrictions that state it."""
    affords = set(reasoner.properties.sub_properties(AFFORDS_TASK))
    afforded = list(reasoner.restrictions_on(TASK_AFFORDED_BY))
    for each in _conjuncts(disposition):
        if isinstance(each, Restriction) and each.property in affords and not each.inverse:
            yield from ((task, ()) for task in named_classes(each.filler))
        elif isinstance(each, NamedClass):
            for owned in reasoner.restrictions(each.iri):
                if owned.restriction.property in affords and not owned.restriction.inverse:
                    line = restriction_line(owned.cls, owned.restriction)
                    yield from ((task, (line,)) for task in named_classes(owned.restriction.filler))
            for owned in afforded:
                if owned.restriction.implies_existence() and reasoner.subsuming_class(
                    owned.restriction.filler, each.iri
                ):
                    yield owned.cls, (restriction_line(owned.cls, owned.restriction),)


def _stored(reasoner: Reasoner, disposition: Expression | None) -> Iterator[tuple[Iri, tuple[str, ...]]]:
    """The classes of what a disposition to store things is for."""
    parts = list(_conjuncts(disposition))
    if not any(isinstance(each, NamedClass) and reasoner.is_a(each.iri, STORAGE) for each in parts):
        return
    triggers = set(reasoner.properties.sub_properties(AFFORDS_TRIGGER))
    for each in parts:
        if isinstance(each, Restriction) and each.property in triggers:
            for role in _conjuncts(each.filler):
                if isinstance(role, Restriction) and role.property == CLASSIFIES:
                    yield from ((item, ()) for item in named_classes(role.filler))


def _affordances(
    reasoner: Reasoner,
    purposes: Callable[[Reasoner, Expression | None], Iterator[tuple[Iri, tuple[str, ...]]]],
) -> Iterator[_Affordance]:
    """The classes with dispositions, and what these are for; nothing in a knowledge base without SOMA."""
    for owned in reasoner.restrictions_on(HAS_DISPOSITION):
        if owned.restriction.implies_existence():
            line = restriction_line(owned.cls, owned.restriction)
            for purpose, lines in purposes(reasoner, owned.restriction.filler):
                yield _Affordance(owned.cls, purpose, (line, *lines))


def _disposed_individuals(reasoner: Reasoner) -> Iterator[tuple[Iri, Iri, ObjectTriple]]:
    """The individuals that have a disposition as a node of its own, the tasks that it affords, and the statement."""
    properties = reasoner.properties
    for individual in sorted(set(properties.candidate_subjects(HAS_DISPOSITION, backwards=False))):
        for disposition in properties.values(HAS_DISPOSITION, individual):
            statement = ObjectTriple(individual, HAS_DISPOSITION, disposition)
            for cls in reasoner.types_of(disposition):
                yield from ((individual, task, statement) for task, _ in _tasks(reasoner, NamedClass(cls)))
            for value in properties.values(AFFORDS_TASK, disposition):
                tasks = (value,) if reasoner.is_class(value) else reasoner.types_of(value)
                yield from ((individual, task, statement) for task in tasks)


class ActionDevice(AnswerRow, frozen=True, kw_only=True):
    """A class of devices that an action needs."""

    action: ClassName
    device: ClassName
    source: ClassName
    """The action's class, or the superclass that has the restriction."""


@question(
    sentences=(
        "what [device] is used for {action}",
        "what do i need (for|to) {action}",
        "what can {device} be used for",
        "what is {device} [used] for",
        "what can i do with {device}",
        "which devices are [used] for {action}",
        "which (device|tool) can {action}",
        "which (device|tool) do i need (for|to) {action}",
        "what kind of device is used for {action}",
        "what does one need for {action}",
    )
)
def device_for_action(
    kb: QuestionContext, action: ClassName | None = None, device: ClassName | None = None
) -> Iterator[ActionDevice]:
    """Which devices an action is done with; those of its own class come before inherited ones.

    Devices that have a disposition which affords the action follow. If no action names the given device itself, the
    answers are those that need a subclass of it: who needs a baking oven needs an oven.

    Examples:
        device_for_action BakingFood
        device_for_action device=Dishwasher
    """
    for each in _all_actions(kb.reasoner) if action is None else (action,):
        yield from _find_devices(kb.reasoner, each, device)


def _find_devices(reasoner: Reasoner, action: Iri, device: Iri | None = None) -> Iterator[ActionDevice]:
    """The devices that an action needs, or that afford it.

    Args:
        device: the only class that is wanted; one that no restriction names stands for its subclasses.
    """
    needs = list(_needed_classes(reasoner, action))
    is_named = device is not None and device in _all_devices(reasoner)
    seen = set()
    for needed, source in needs:
        found = needed
        if device is not None:
            matches = device in reasoner.equivalents(needed) if is_named else reasoner.is_a(needed, device)
            found = device if matches else needed
        if found not in seen and device in {None, found}:
            seen.add(found)
            yield ActionDevice(action=action, device=found, source=source)


def _needed_classes(reasoner: Reasoner, action: Iri) -> Iterator[tuple[Iri, Iri]]:
    """The classes of devices that an action needs or that afford it, and the class of actions that states it."""
    for owned in _device_restrictions(reasoner, action):
        yield from ((named, owned.cls) for named in named_classes(owned.restriction.filler))
    for each in _affordances(reasoner, _tasks):
        if reasoner.is_a(action, each.purpose):
            yield each.owner, each.purpose


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
    owners.update(each.purpose for each in _affordances(reasoner, _tasks))
    return sorted({below for owner in owners for below in reasoner.classes.below(owner)})


@device_for_action.explain
def _explain_device(kb: QuestionContext, row: ActionDevice) -> Iterator[str]:
    reasoner = kb.reasoner
    yield from subclass_line(reasoner.classes.path(row.action, row.source))
    for owned in _device_restrictions(reasoner, row.source):
        named = (each for each in named_classes(owned.restriction.filler) if reasoner.is_a(each, row.device))
        if owned.cls == row.source and (needed := next(named, None)):
            yield restriction_line(owned.cls, owned.restriction)
            yield from subproperty_line(reasoner.properties.implication_path(owned.restriction.property, _DEVICE_USED))
            yield from subclass_line(reasoner.classes.path(needed, row.device))
            return
    for each in _affordances(reasoner, _tasks):
        if each.purpose == row.source and reasoner.is_a(each.owner, row.device):
            yield from each.lines
            yield from subclass_line(reasoner.classes.path(each.owner, row.device))
            return


@device_for_action.missing
def _missing_device(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    property, reasoner = local_name(_DEVICE_USED), kb.reasoner
    if asked.action is not None:
        needed = list(_device_restrictions(reasoner, asked.action))
        fillers = ", ".join(expression_text(owned.restriction.filler) for owned in needed)
        narrower = [
            each
            for each, _ in _needed_classes(reasoner, asked.action)
            if asked.device and reasoner.is_a(each, asked.device)
        ]
        if narrower:
            yield _narrower_device(asked.action, asked.device or THING, narrower[0])
            return
        kind = ClaimKind.NO_RESTRICTION if asked.device is None else ClaimKind.NO_NARROWER_RESTRICTION
        absent = (Claim(kind=kind, subject=asked.action, property=_DEVICE_USED, object=asked.device),)
        claims = (
            *(absent if asked.device or not needed else ()),
            *(
                Claim(kind=ClaimKind.RESTRICTION, subject=asked.action, property=_DEVICE_USED, object=named)
                for owned in needed
                for named in named_classes(owned.restriction.filler)
            ),
        )
        but = f"it needs {fillers}" if fillers else f"neither it nor an ancestor of it has {property} some …"
        reason = f"{local_name(asked.action)} has no such {property}: {but}"
        yield MissingKnowledge(asked.action, _DEVICE_USED, reason, claims=claims)
    elif asked.device is not None:
        above = next((cls for cls in reasoner.classes.above(asked.device) if cls in _all_devices(reasoner)), None)
        hint = f"; ask about its ancestor {local_name(above)}, which some action needs" if above else ""
        why = f"no action needs a {local_name(asked.device)}: no {property} names it or a subclass of it{hint}"
        claim = Claim(kind=ClaimKind.NO_NARROWER_RESTRICTION, property=_DEVICE_USED, object=asked.device)
        yield MissingKnowledge(asked.device, _DEVICE_USED, why, is_filler=True, claims=(claim,))
    else:
        claim = Claim(kind=ClaimKind.NO_RESTRICTION, property=_DEVICE_USED)
        yield MissingKnowledge(
            knowrob("PhysicalDevice"), _DEVICE_USED, f"no class has {property} some …", claims=(claim,)
        )


def _narrower_device(action: Iri, device: Iri, needed: Iri) -> MissingKnowledge:
    """The missing statement if an action needs a subclass of a device, which other actions name."""
    names = local_name(action), local_name(device), local_name(needed)
    reason = "{0} names no {1} as such, but {2}, which is a {1}: ask for device={2}".format(*names)
    claim = Claim(kind=ClaimKind.RESTRICTION, subject=action, property=_DEVICE_USED, object=needed)
    return MissingKnowledge(action, _DEVICE_USED, reason, claims=(claim,))


def _all_devices(reasoner: Reasoner) -> set[Iri]:
    """The classes of devices that actions name, those that have a disposition for one, and their equivalents."""
    restrictions = (owned.restriction for owned in reasoner.restrictions_on(_DEVICE_USED))
    named = {device for each in restrictions if each.implies_existence() for device in named_classes(each.filler)}
    named.update(each.owner for each in _affordances(reasoner, _tasks))
    return {same for device in named for same in reasoner.equivalents(device)}


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
    index = kb.reasoner
    disposed = [each for each in _disposed_individuals(index) if individual in {None, each[0]}]
    actions = {*_all_actions(index), *(below for _, task, _ in disposed for below in index.classes.below(task))}
    for each in sorted(actions) if action is None else (action,):
        seen = set()
        for member, place, device in _devices_in_map(index, each, disposed, individual, map):
            if (member, place) not in seen:
                seen.add((member, place))
                yield ActionDeviceInMap(action=each, individual=member, device=device, map=place)


def _devices_in_map(
    reasoner: Reasoner,
    action: Iri,
    disposed: Iterable[tuple[Iri, Iri, ObjectTriple]],
    individual: Iri | None,
    map: Iri | None,
) -> Iterator[tuple[Iri, Iri, Iri]]:
    """Individuals that an action can be done with, their maps, and the class that makes them suitable."""
    for need in _find_devices(reasoner, action):
        for member, place in _members_in(reasoner, need.device, individual, map):
            yield member, place, need.device
    for member, task, _ in disposed:
        for place in reasoner.maps_of.get(member, ()) if reasoner.is_a(action, task) else ():
            if map in {None, place}:
                yield member, place, reasoner.class_of(member) or THING


@device_for_action_in_environment.explain
def _explain_device_in_map(kb: QuestionContext, row: ActionDeviceInMap) -> Iterator[str]:
    needs = [need for need in _find_devices(kb.reasoner, row.action) if need.device == row.device]
    if needs:
        yield from _explain_device(kb, needs[0])
        yield from membership_lines(kb.reasoner, row.individual, row.device)
        return
    for member, task, statement in _disposed_individuals(kb.reasoner):
        if member == row.individual and kb.reasoner.is_a(row.action, task):
            yield statement_line(statement)
            yield f"{local_name(statement.object)} affords {local_name(task)}"
            yield from subclass_line(kb.reasoner.classes.path(row.action, task))
            return


@device_for_action_in_environment.missing
def _missing_device_in_map(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    needs = list(_find_devices(kb.reasoner, asked.action)) if asked.action else []
    if asked.action and not needs:
        yield from _missing_device(kb, asked)
    for need in needs:
        yield from missing_instance(kb.reasoner, need.device, asked.individual, asked.map)
    if asked.action is None:
        reason = f"is needed by no action: no {local_name(_DEVICE_USED)} names one of its classes or an ancestor of it"
        yield from _missing_use(kb.reasoner, asked.individual, asked.map, _DEVICE_USED, reason, fillers=True)


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

    A place is the class that has the restriction itself. A given place without a restriction of its own inherits those
    of its superclasses.

    Examples:
        storage_place CowsMilk
        storage_place Bread
        storage_place place=Dishwasher
    """
    for each in _stored_classes(kb.reasoner, place) if item is None else (item,):
        yield from _find_storage_places(kb.reasoner, each, place)


def _find_storage_places(reasoner: Reasoner, item: Iri, place: Iri | None = None) -> list[StoragePlace]:
    """The places for an item; only the given class, if there is one."""
    found: dict[Iri, StoragePlace] = {}
    owners = frozenset() if place is None else _owners(reasoner, place)
    for owner, reason in _places_with_reasons(reasoner, item):
        if place is None or owner in owners:
            named = place or owner
            row = StoragePlace(
                item=item,
                place=named,
                because_of=reason,
                generality=reasoner.classes.count_between(item, reason),
            )
            found[named] = min(found.get(named, row), row, key=_sort_key)
    return sorted(found.values(), key=_sort_key)


def _owners(reasoner: Reasoner, place: Iri) -> frozenset[Iri]:
    """The classes whose restrictions a place stands for: its own and equivalents', or those that it inherits."""
    own = frozenset(reasoner.equivalents(place))
    purposes = (
        owned.cls for owned in reasoner.restrictions_on(_CONTAINER_FOR) if owned.restriction.implies_existence()
    )
    stating = {*purposes, *(each.owner for each in _affordances(reasoner, _stored))}
    return own & stating or frozenset(reasoner.classes.above(place)) & stating


def _places_with_reasons(reasoner: Reasoner, item: Iri) -> Iterator[tuple[Iri, Iri]]:
    """The classes that store an item, and the class of items that each is for."""
    for above in reasoner.classes.above(item):
        for owned in reasoner.restrictions_with_filler(_CONTAINER_FOR, above):
            if owned.restriction.implies_existence():
                reason = reasoner.subsuming_class(owned.restriction.filler, item)
                if reason is not None:
                    yield owned.cls, reason
    for each in _affordances(reasoner, _stored):
        if reasoner.is_a(item, each.purpose):
            yield each.owner, each.purpose


def _sort_key(row: StoragePlace) -> tuple[int, str, str]:
    return row.generality, row.place, row.because_of


def _stored_classes(reasoner: Reasoner, place: Iri | None) -> list[Iri]:
    """All classes that some place, or this one, is for."""
    owners = None if place is None else _owners(reasoner, place)
    fillers = (
        filler
        for owned in reasoner.restrictions_on(_CONTAINER_FOR)
        if owned.restriction.implies_existence() and (owners is None or owned.cls in owners)
        for filler in named_classes(owned.restriction.filler)
    )
    afforded = (each.purpose for each in _affordances(reasoner, _stored) if owners is None or each.owner in owners)
    found = dict.fromkeys((*fillers, *afforded))
    return sorted({below for filler in found for below in reasoner.classes.below(filler)})


@storage_place.explain
def _explain_storage(kb: QuestionContext, row: StoragePlace) -> Iterator[str]:
    index = kb.reasoner
    yield from subclass_line(index.classes.path(row.item, row.because_of))
    for owned in index.restrictions_with_filler(_CONTAINER_FOR, row.because_of):
        if index.is_a(row.place, owned.cls) and owned.restriction.implies_existence():
            yield from subclass_line(index.classes.path(row.place, owned.cls))
            yield restriction_line(owned.cls, owned.restriction)
            yield from subproperty_line(index.properties.implication_path(owned.restriction.property, _CONTAINER_FOR))
            return
    for each in _affordances(index, _stored):
        if each.purpose == row.because_of and index.is_a(row.place, each.owner):
            yield from subclass_line(index.classes.path(row.place, each.owner))
            yield from each.lines
            return


@storage_place.missing
def _missing_storage(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    property, reasoner = local_name(_CONTAINER_FOR), kb.reasoner
    inherited = [
        (owner, reason)
        for owner, reason in (_places_with_reasons(reasoner, asked.item) if asked.item and asked.place else ())
        if asked.place and reasoner.is_a(asked.place, owner)
    ]
    if inherited and asked.item and asked.place:
        yield _inherited_place(asked.item, asked.place, *inherited[0])
        return
    absent = Claim(kind=ClaimKind.NO_RESTRICTION, subject=asked.place, property=_CONTAINER_FOR, object=asked.item)
    limits = [
        owned for owned in _limits(reasoner, asked.item) if asked.place is None or reasoner.is_a(asked.place, owned.cls)
    ]
    if asked.item is None:
        owner = (
            f"{local_name(asked.place)} stores nothing: neither it nor an ancestor of it has"
            if asked.place
            else "no class has"
        )
        why = f"{owner} {property} some …"
        cls, is_filler = asked.place or knowrob("Container"), False
    else:
        name, cls, is_filler = local_name(asked.item), asked.item, True
        where = "has no storage place" if asked.place is None else f"is not stored in {local_name(asked.place)}"
        owner = "no class" if asked.place is None else f"neither {local_name(asked.place)} nor an ancestor of it"
        why = f"{name} {where}: {owner} has {property} some {name} or some ancestor of it"
    claims = (
        absent,
        *(
            Claim(kind=ClaimKind.RESTRICTION, subject=owned.cls, property=_CONTAINER_FOR, object=named)
            for owned in limits
            for named in named_classes(owned.restriction.filler)
        ),
    )
    if limits:
        shown = ", ".join(
            f"{local_name(owned.cls)} ({restriction_text(owned.restriction)})" for owned in limits[:_MAX_LIMITS]
        )
        more = f" and {len(limits) - _MAX_LIMITS} more" if limits[_MAX_LIMITS:] else ""
        why += f"; {shown}{more} may contain it, which makes no storage place"
    yield MissingKnowledge(cls, _CONTAINER_FOR, why, is_filler=is_filler, claims=claims)


def _inherited_place(item: Iri, place: Iri, owner: Iri, reason: Iri) -> MissingKnowledge:
    """The missing statement if a place with restrictions of its own inherits the one that is for an item."""
    names = local_name(place), local_name(item), local_name(owner)
    why = "{0} itself is not stated to store {1}, but {2}, which it is: ask for place={2}".format(*names)
    claim = Claim(kind=ClaimKind.RESTRICTION, subject=owner, property=_CONTAINER_FOR, object=reason)
    return MissingKnowledge(item, _CONTAINER_FOR, why, is_filler=True, claims=(claim,))


def _limits(reasoner: Reasoner, item: Iri | None) -> list[ClassRestriction]:
    """The restrictions that name an item or an ancestor of it, but do not imply that something is stored."""
    if item is None:
        return []
    found = {
        owned: steps
        for above, steps in reasoner.classes.above(item).items()
        for owned in reasoner.restrictions_with_filler(_CONTAINER_FOR, above)
        if not owned.restriction.implies_existence() and reasoner.subsuming_class(owned.restriction.filler, item)
    }
    return sorted(found, key=lambda owned: (found[owned], owned.cls))


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
def _missing_storage_in_map(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    storages = _find_storage_places(kb.reasoner, asked.item) if asked.item else []
    if asked.item and not storages:
        yield from _missing_storage(kb, asked)
    for storage in storages:
        yield from missing_instance(kb.reasoner, storage.place, asked.individual, asked.map)
    if asked.item is None:
        reason = f"stores nothing: none of its classes and their ancestors has {local_name(_CONTAINER_FOR)} some …"
        yield from _missing_use(kb.reasoner, asked.individual, asked.map, _CONTAINER_FOR, reason, fillers=False)
