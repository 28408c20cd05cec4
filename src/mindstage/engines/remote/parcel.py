"""Parcel: what of a world can travel as JSON, and why the rest cannot.

JSON has no NaN and no infinity. An engine in the same process would spawn what it can of such a world and list the
rest, so a far one does too. The same holds for forms.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TypeVar

import msgspec

from mindstage.bridge.description import to_json, world_to_json
from mindstage.engines.contract import Failure, Note, NoteKind, SpawnReport
from mindstage.engines.inventory import Inventory
from mindstage.engines.solids import prepare
from mindstage.errors import MessageRefused
from mindstage.world import Body, BodyId, Constraint, Form, Forms, Light, World

__all__ = ["packed", "packed_forms"]

P = TypeVar("P", Body, Constraint, Light)


def packed(world: World) -> tuple[str, SpawnReport]:
    """A world as JSON, and a report of what had to be left out.

    Raises:
        MessageRefused: what is said about the map as a whole cannot travel.
    """
    try:
        return world_to_json(world), SpawnReport()
    except MessageRefused:
        pass  # one part of it cannot, and now it is looked which
    refused = Inventory().add(world)
    reasons = {failure.id: failure.reason for failure in (*refused.failed_bodies, *refused.failed_constraints)}
    bodies, no_bodies = _parted(world.bodies, reasons)
    lights, no_lights = _parted(world.lights, reasons)
    constraints, no_constraints = _parted(world.constraints, reasons)
    rest = msgspec.structs.replace(world, bodies=bodies, lights=lights, constraints=constraints)
    return world_to_json(rest), SpawnReport(failed_bodies=no_bodies + no_lights, failed_constraints=no_constraints)


def packed_forms(forms: Forms) -> tuple[dict[BodyId, Form], tuple[Note, ...]]:
    """Forms without the solids that nobody can build, and a note for each that had some."""
    usable: dict[str, tuple[Form, int]] = {}
    kept: dict[BodyId, Form] = {}
    notes: list[Note] = []
    for id, form in forms.items():
        if form.key not in usable:
            ready = prepare(form.solids)
            usable[form.key] = replace(form, solids=ready.solids) if ready.left_out else form, ready.left_out
        kept[id], left_out = usable[form.key]
        if left_out:
            text = f"{left_out} solids of {id}'s form have numbers that mean nothing; nothing touches them"
            notes.append(Note(NoteKind.SHAPE, (id,), text))
    return kept, tuple(notes)


def _parted(parts: Iterable[P], reasons: dict[str, str]) -> tuple[tuple[P, ...], tuple[Failure, ...]]:
    """What can travel, and what cannot, in the words of other engines where they would refuse it as well."""
    kept: list[P] = []
    left: list[Failure] = []
    for part in parts:
        try:
            to_json(part)
        except MessageRefused as error:
            left.append(Failure(part.id, reasons.get(part.id, str(error))))
        else:
            kept.append(part)
    return tuple(kept), tuple(left)
