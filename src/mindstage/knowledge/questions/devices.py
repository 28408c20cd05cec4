"""Questions about devices: what an action is done with.

They follow restrictions that promise a value of some class, as the questions about storage do.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.purposes import members_in, of_no_use
from mindstage.knowledge.questions.question import ClassName, IndividualName, MapName, Missing, Row, question
from mindstage.knowledge.questions.words import (
    expression_text,
    implies_line,
    is_line,
    member_lines,
    not_here,
    restriction_line,
)
from mindstage.knowledge.reasoning import ClassRestriction, Index, classes_in
from mindstage.knowledge.vocabulary import knowrob
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["Device", "DeviceHere", "device_for_action", "device_for_action_in_environment"]

_DEVICE_USED = knowrob("deviceUsed")


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
        for device in classes_in(owned.restriction.filler):
            if device not in seen:
                seen.add(device)
                yield Device(action=action, device=device, told_by=owned.cls)


def _needs(index: Index, action: Iri) -> Iterator[ClassRestriction]:
    uses = set(index.properties.sub_properties(_DEVICE_USED))
    for owned in index.restrictions(action):
        if owned.restriction.property in uses and owned.restriction.promises() and not owned.restriction.inverse:
            yield owned


def _actions(index: Index) -> list[Iri]:
    owners = {owned.cls for owned in index.stating(_DEVICE_USED)}
    return sorted({below for owner in owners for below in index.classes.below(owner)})


@device_for_action.because
def _why_device(kb: KnowledgeBase, row: Device) -> Iterator[str]:
    yield from is_line(kb.index.classes.path(row.action, row.told_by))
    for owned in _needs(kb.index, row.told_by):
        if owned.cls == row.told_by and row.device in classes_in(owned.restriction.filler):
            yield restriction_line(owned.cls, owned.restriction)
            yield from implies_line(kb.index.properties.path(owned.restriction.property, _DEVICE_USED))
            return


@device_for_action.lacking
def _no_device(kb: KnowledgeBase, action: Iri | None = None, device: Iri | None = None) -> Iterator[Missing]:
    property = local_name(_DEVICE_USED)
    if action is not None:
        told = ", ".join(expression_text(owned.restriction.filler) for owned in _needs(kb.index, action))
        but = f"it needs {told}" if told else f"neither it nor an ancestor of it says {property} some …"
        yield Missing(action, _DEVICE_USED, f"{local_name(action)} has no such {property}: {but}")
    elif device is not None:
        needed = _needed_devices(kb.index)
        above = next((cls for cls in kb.index.classes.above(device) if cls in needed), None)
        hint = f"; ask about {local_name(above)}, which it is" if above else ""
        why = f"no action needs a {local_name(device)}: no {property} names it{hint}"
        yield Missing(device, _DEVICE_USED, why, as_value=True)
    else:
        yield Missing(knowrob("PhysicalDevice"), _DEVICE_USED, f"no class says {property} some …")


def _needed_devices(index: Index) -> set[Iri]:
    told = (owned.restriction for owned in index.stating(_DEVICE_USED))
    return {device for each in told if each.promises() for device in classes_in(each.filler)}


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
            for here, place in members_in(kb.index, need.device, individual, map):
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
    if action and not needs:
        yield from _no_device(kb, action)
    for need in needs:
        yield not_here(need.device, individual, map)
    if action is None:
        names = f"{local_name(_DEVICE_USED)} names a class that it is of"
        yield from of_no_use(kb.index, individual, map, _DEVICE_USED, f"is needed by no action: no {names}")
