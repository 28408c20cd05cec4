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
from mindstage.engines.contract import SpawnFailure, SpawnNote, SpawnNoteKind, SpawnReport
from mindstage.engines.inventory import EntityRegistry
from mindstage.engines.solids import compile_geometry
from mindstage.errors import MessageValidationError
from mindstage.world import Body, BodyGeometry, BodyId, GeometryMap, Joint, Light, World

__all__ = ["encode_geometry", "encode_world"]

P = TypeVar("P", Body, Joint, Light)


def encode_world(world: World) -> tuple[str, SpawnReport]:
    """A world as JSON, and a report of what had to be left out.

    Raises:
        MessageValidationError: what is said about the map as a whole cannot travel.
    """
    try:
        return world_to_json(world), SpawnReport()
    except MessageValidationError:
        pass  # one part of it cannot, and now it is looked which
    refused = EntityRegistry().add(world)
    reasons = {failure.id: failure.reason for failure in (*refused.failed_bodies, *refused.failed_joints)}
    bodies, no_bodies = _split_encodable(world.bodies, reasons)
    lights, no_lights = _split_encodable(world.lights, reasons)
    constraints, no_constraints = _split_encodable(world.joints, reasons)
    rest = msgspec.structs.replace(world, bodies=bodies, lights=lights, joints=constraints)
    return world_to_json(rest), SpawnReport(failed_bodies=no_bodies + no_lights, failed_joints=no_constraints)


def encode_geometry(geometry: GeometryMap) -> tuple[dict[BodyId, BodyGeometry], tuple[SpawnNote, ...]]:
    """Forms without the solids that nobody can build, and a note for each that had some."""
    usable: dict[str, tuple[BodyGeometry, int]] = {}
    kept: dict[BodyId, BodyGeometry] = {}
    notes: list[SpawnNote] = []
    for id, form in geometry.items():
        if form.key not in usable:
            ready = compile_geometry(form.collision_shapes)
            usable[form.key] = (
                replace(form, collision_shapes=ready.shapes) if ready.invalid_count else form,
                ready.invalid_count,
            )
        kept[id], left_out = usable[form.key]
        if left_out:
            text = f"{left_out} solids of {id}'s form have numbers that mean nothing; nothing touches them"
            notes.append(SpawnNote(SpawnNoteKind.SHAPE, (id,), text))
    return kept, tuple(notes)


def _split_encodable(parts: Iterable[P], reasons: dict[str, str]) -> tuple[tuple[P, ...], tuple[SpawnFailure, ...]]:
    """What can travel, and what cannot, in the words of other engines where they would refuse it as well."""
    kept: list[P] = []
    left: list[SpawnFailure] = []
    for part in parts:
        try:
            to_json(part)
        except MessageValidationError as error:
            left.append(SpawnFailure(part.id, reasons.get(part.id, str(error))))
        else:
            kept.append(part)
    return tuple(kept), tuple(left)
