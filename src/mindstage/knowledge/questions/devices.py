"""Questions about devices: what an action is done with.

They follow restrictions that promise a value of some class, as the questions about storage do.
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
    expression_text,
    membership_lines,
    missing_instance,
    restriction_line,
    subclass_line,
    subproperty_line,
)
from mindstage.knowledge.reasoning import ClassRestriction, Reasoner, named_classes
from mindstage.knowledge.vocabulary import knowrob
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["ActionDevice", "ActionDeviceInMap", "device_for_action", "device_for_action_in_environment"]

_DEVICE_USED = knowrob("deviceUsed")


class ActionDevice(AnswerRow, frozen=True, kw_only=True):
    """A class of things that an action needs."""

    action: ClassName
    device: ClassName
    told_by: ClassName
    """The action's own class, or the one above it that says so."""


@question
def device_for_action(
    kb: KnowledgeBase, action: ClassName | None = None, device: ClassName | None = None
) -> Iterator[ActionDevice]:
    """What an action is done with; what its own class says comes before what it inherits.

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
def _explain_device(kb: KnowledgeBase, row: ActionDevice) -> Iterator[str]:
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
    kb: KnowledgeBase, action: Iri | None = None, device: Iri | None = None
) -> Iterator[MissingKnowledge]:
    property = local_name(_DEVICE_USED)
    if action is not None:
        told = ", ".join(
            expression_text(owned.restriction.filler) for owned in _device_restrictions(kb.reasoner, action)
        )
        but = f"it needs {told}" if told else f"neither it nor an ancestor of it says {property} some …"
        yield MissingKnowledge(action, _DEVICE_USED, f"{local_name(action)} has no such {property}: {but}")
    elif device is not None:
        needed = _all_devices(kb.reasoner)
        above = next((cls for cls in kb.reasoner.classes.above(device) if cls in needed), None)
        hint = f"; ask about {local_name(above)}, which it is" if above else ""
        why = f"no action needs a {local_name(device)}: no {property} names it{hint}"
        yield MissingKnowledge(device, _DEVICE_USED, why, is_filler=True)
    else:
        yield MissingKnowledge(knowrob("PhysicalDevice"), _DEVICE_USED, f"no class says {property} some …")


def _all_devices(reasoner: Reasoner) -> set[Iri]:
    told = (owned.restriction for owned in reasoner.restrictions_on(_DEVICE_USED))
    return {device for each in told if each.implies_existence() for device in named_classes(each.filler)}


class ActionDeviceInMap(AnswerRow, frozen=True, kw_only=True):
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
) -> Iterator[ActionDeviceInMap]:
    """What, in a map, an action is done with.

    Examples:
        device_for_action_in_environment BakingFood
    """
    for each in _all_actions(kb.reasoner) if action is None else (action,):
        seen = set()
        for need in _find_devices(kb.reasoner, each):
            for here, place in members_in(kb.reasoner, need.device, individual, map):
                if (here, place) not in seen:
                    seen.add((here, place))
                    yield ActionDeviceInMap(action=each, individual=here, device=need.device, map=place)


@device_for_action_in_environment.explain
def _explain_device_in_map(kb: KnowledgeBase, row: ActionDeviceInMap) -> Iterator[str]:
    for need in _find_devices(kb.reasoner, row.action):
        if need.device == row.device:
            yield from _explain_device(kb, need)
    yield from membership_lines(kb.reasoner, row.individual, row.device)


@device_for_action_in_environment.missing
def _missing_device_in_map(
    kb: KnowledgeBase, action: Iri | None = None, individual: Iri | None = None, map: Iri | None = None
) -> Iterator[MissingKnowledge]:
    needs = list(_find_devices(kb.reasoner, action)) if action else []
    if action and not needs:
        yield from _missing_device(kb, action)
    for need in needs:
        yield missing_instance(need.device, individual, map)
    if action is None:
        names = f"{local_name(_DEVICE_USED)} names a class that it is of"
        yield from unspecified(kb.reasoner, individual, map, _DEVICE_USED, f"is needed by no action: no {names}")
