"""Putting: a new thing comes to stand on something, or in it, where there is room for it and it stays."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from mindstage.engines.contract import Capability, Engine, SpawnNoteKind
from mindstage.errors import BodyNotFoundError, InvalidArgumentError, NoFreePlacementError
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reasoning import EntityType
from mindstage.stage.spots import PlacementSampler, PlacementSurface, support_surfaces
from mindstage.world import Body, BodyGeometry, BodyId, BodyPhysics, GeometryMap, Iri, Mobility, Pose, Vector, World
from mindstage.world.geometry import Array, normalize, quat_conjugate, quat_multiply, quat_rotate

if TYPE_CHECKING:
    from mindstage.stage.stage import Simulation

__all__ = ["PlacementResult", "make_body", "place_body"]

_MAX_ATTEMPTS = 12
"""So many free spots are tried out before it is given up."""
_SETTLE_STEP_S, _MAX_SETTLE_S = 0.1, 3.0
"""How often it is looked whether a thing has come to rest, and how long at most [s of the world]."""
_REST_TOLERANCE_M = 0.0005
"""What moves by less in such a piece rests."""
_MAX_SLIDE_M = 0.03
"""A thing that slid farther than this did not stay."""
_MIN_UPRIGHT_COSINE = 0.966
"""Cosine of fifteen degrees: what leans more has fallen over."""


class PlacementResult(msgspec.Struct, frozen=True, kw_only=True, rename={"support_id": "holder", "attempts": "tried"}):
    """What became of it."""

    id: BodyId
    support_id: BodyId
    """What it stands on, or in."""
    pose: Pose
    """Where it came to rest."""
    attempts: int
    """How many spots it took."""


def make_body(simulation: Simulation, cls: str, *, id: str | None = None, size: Vector | None = None) -> Body:
    """A thing of a class, as heavy and, unless told otherwise, as large as such things are.

    Raises:
        NameNotFoundError: there is no such class.
        InvalidArgumentError: nobody knows how large things of that class are.
    """
    kb = simulation.knowledge
    iri = kb.names.find(cls, EntityType.CLASS)
    large = size or kb.shape_rule(iri).size
    if large is None:
        remedy = f"say it (ms:typicalSize of {local_name(iri)}), or give a body of your own"
        raise InvalidArgumentError(local_name(iri), cause="nobody told how large such a thing is", remedy=remedy)
    name = BodyId(id or _free_id(local_name(iri), simulation.state.ids))
    physics = BodyPhysics(mobility=Mobility.DYNAMIC, gravity=True)
    return Body(
        id=name, iri=Iri(_iri_prefix(simulation.worlds) + name), cls=iri, pose=Pose(), size=large, physics=physics
    )


def place_body(
    simulation: Simulation, body: Body, geometry: BodyGeometry | None, *, support_id: str, inside: bool
) -> PlacementResult:
    """Puts a body on another one, or into it.

    Every free spot is tried out until the thing stays: it is dropped there by a millimetre, and looked at until it
    rests. Where the engine can save its state nothing else in the world notices the trials; elsewhere the time that
    they take passes for all.

    Args:
        stage: where.
        body: what; its pose does not matter.
        form: what it is made of.
        where: the id of the holder. What is wanted inside may come into a part of it, or into a drawer that slides in
            it.
        inside: whether it goes into the holder, or onto it.

    Raises:
        BodyNotFoundError: there is no such holder.
        NoFreePlacementError: nothing in or on it is free, large enough and level, or the thing does not stay anywhere there.
    """
    frame, forms = simulation.state, simulation.geometry
    bodies = {each.id: each for world in simulation.worlds for each in world.bodies}
    rows = {id: row for row, id in enumerate(frame.ids)}
    if support_id not in rows:
        raise BodyNotFoundError(support_id, known=frame.ids)
    said = f"{'into' if inside else 'on'} {support_id}"
    holders = list(_placement_surfaces(simulation, BodyId(support_id), bodies, forms, rows, frame.poses, inside=inside))
    if not holders:
        lack = "nobody knows of room in it" if inside else "none of its sides looks up"
        raise NoFreePlacementError(body.id, said, reason=lack)
    crowd = PlacementSampler(bodies, forms, frame.ids, frame.poses, _enclosing_body_ids(simulation))
    reasons, tried = list[str](), 0
    for holder in holders:
        spots, why = crowd.candidate_poses(body, geometry, holder)
        if why:
            reasons.append(why)
        for spot in _sample_poses(spots, _MAX_ATTEMPTS - tried):
            tried += 1
            rested = _try_placement(simulation, msgspec.structs.replace(body, pose=spot), geometry)
            if rested is not None:
                return PlacementResult(id=body.id, support_id=holder.body_id, pose=rested, attempts=tried)
            reasons.append("it does not stay there")
    raise NoFreePlacementError(body.id, said, reason="; ".join(dict.fromkeys(reasons)))


# -- where -------------------------------------------------------------------------------------------------------------


def _placement_surfaces(
    simulation: Simulation,
    id: BodyId,
    bodies: dict[BodyId, Body],
    geometry: GeometryMap,
    rows: dict[BodyId, int],
    poses: Array,
    *,
    inside: bool,
) -> Iterator[PlacementSurface]:
    """The places of a body; inside, also those of what hangs on it and slides in it. The lowest shelf comes last."""
    found = []
    for each in (id, *(_attached_bodies(simulation.worlds, id) if inside else ())):
        if each in rows and each in bodies:
            found += list(support_surfaces(bodies[each], geometry.get(each), poses[rows[each]], inside=inside))
    yield from sorted(found, key=lambda holder: (holder.body_id != id, -holder.size[0] * holder.size[1]))


def _attached_bodies(worlds: Iterable[World], id: BodyId) -> list[BodyId]:
    """What hangs on a body at any depth, and what moves by a constraint with those: its drawers, not its case."""
    below: dict[BodyId, list[BodyId]] = {}
    beside: dict[BodyId, list[BodyId]] = {}
    moves = set[BodyId]()
    for world in worlds:
        moves |= {body.id for body in world.bodies if body.physics.is_dynamic}
        for hold in world.attachments:
            below.setdefault(hold.parent, []).append(hold.child)
        for joint in world.joints:
            beside.setdefault(joint.parent, []).append(joint.child)
            beside.setdefault(joint.child, []).append(joint.parent)
    fixed, waiting = {id: None}, [id]
    while waiting:
        for child in below.get(waiting.pop(), ()):
            if child not in fixed:
                fixed[child] = None
                waiting.append(child)
    joined = {other: None for each in fixed if each not in moves for other in beside.get(each, ()) if other in moves}
    return [*list(fixed)[1:], *joined]


def _enclosing_body_ids(simulation: Simulation) -> frozenset[str]:
    """What encloses the place, and so is in nobody's way."""
    return frozenset(id for report in simulation.reports for id in report.ids_with_note(SpawnNoteKind.ENCLOSURE))


def _sample_poses(poses: list[Pose], count: int) -> Iterator[Pose]:
    """The best spot, and then some from all over the rest: where one does not hold, its neighbor hardly does."""
    if not poses or count <= 0:
        return
    rows = np.unique(np.linspace(0, len(poses) - 1, count).astype(int))
    yield from (poses[row] for row in rows.tolist())


# -- whether it stays --------------------------------------------------------------------------------------------------


def _try_placement(simulation: Simulation, body: Body, geometry: BodyGeometry | None) -> Pose | None:
    """Where a body comes to rest, if it stays; then it is there, and else it never was."""
    world = World(iri=simulation.worlds[0].iri, name=simulation.worlds[0].name, bodies=(body,))
    forms = {body.id: geometry} if geometry is not None else {}

    def rehearse(engine: Engine) -> Pose | None:
        before = engine.save_state() if Capability.SAVE in engine.capabilities else None
        engine.spawn(world, geometry=forms)
        rested = _settle(engine, body)
        if before is not None:
            engine.restore_state(before)
        else:
            engine.delete([body.id])
        return rested

    patience_s = simulation.timeout_s + 10 * _MAX_SETTLE_S
    rested = simulation.run_on_engine(rehearse, label="put", timeout_s=patience_s, edits=True)
    if rested is not None:
        simulation.spawn(
            msgspec.structs.replace(world, bodies=(msgspec.structs.replace(body, pose=rested),)),
            geometry=forms,
            persistent=False,
        )
    return rested


def _settle(engine: Engine, body: Body) -> Pose | None:
    start, before, passed = _current_pose(engine, body.id), _current_pose(engine, body.id), 0.0
    while passed < _MAX_SETTLE_S:
        engine.step(_SETTLE_STEP_S)
        passed += _SETTLE_STEP_S
        now = _current_pose(engine, body.id)
        if np.linalg.norm(now[:3] - start[:3]) > _MAX_SLIDE_M or _upright_cosine(start, now) < _MIN_UPRIGHT_COSINE:
            return None
        if passed > 2 * _SETTLE_STEP_S and np.abs(now - before).max() < _REST_TOLERANCE_M:
            position, quaternion = now[:3].tolist(), now[3:].tolist()
            return Pose((position[0], position[1], position[2]), tuple(quaternion))
        before = now
    return None


def _current_pose(engine: Engine, id: BodyId) -> Array:
    ids, poses = engine.poses()
    row: Array = poses[ids.index(id)].copy()
    row[3:] = normalize(row[3:])
    return row


def _upright_cosine(start: Array, now: Array) -> float:
    turned = quat_multiply(now[3:], quat_conjugate(start[3:]))
    return float(quat_rotate(turned, (0.0, 0.0, 1.0))[2])


# -- names -------------------------------------------------------------------------------------------------------------


def _free_id(name: str, taken: Iterable[str]) -> str:
    used = set(taken)
    plain = re.sub(r"[^\w.-]", "_", name)
    return next(id for number in range(1, len(used) + 2) if (id := f"{plain}_{number}") not in used)


def _iri_prefix(worlds: Iterable[World]) -> str:
    """What the IRIs of a map's individuals begin with."""
    for world in worlds:
        for body in world.bodies:
            if body.iri.endswith(body.id):
                return body.iri.removesuffix(body.id)
        return f"{world.iri}#"
    return "http://mindstage.org/put#"
