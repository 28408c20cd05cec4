"""Putting: a new thing comes to stand on something, or in it, where there is room for it and it stays."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from mindstage.engines.contract import Ability, Engine, NoteKind
from mindstage.errors import ArgumentRefused, BodyUnknown, SpotMissing
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reasoning import NameKind
from mindstage.stage.spots import Crowd, Holder, places_of
from mindstage.world import Body, BodyId, Form, Forms, Iri, Mobility, Physics, Pose, Vector, World
from mindstage.world.geometry import Array, conjugate, multiply, rotate, unit

if TYPE_CHECKING:
    from mindstage.stage.stage import Stage

__all__ = ["Put", "put", "thing_of"]

_TRIES = 12
"""So many free spots are tried out before it is given up."""
_PIECE_S, _LONGEST_S = 0.1, 3.0
"""How often it is looked whether a thing has come to rest, and how long at most [s of the world]."""
_STILL_M = 0.0005
"""What moves by less in such a piece rests."""
_AWAY_M = 0.03
"""A thing that slid farther than this did not stay."""
_UPRIGHT = 0.966
"""Cosine of fifteen degrees: what leans more has fallen over."""


class Put(msgspec.Struct, frozen=True, kw_only=True):
    """What became of it."""

    id: BodyId
    holder: BodyId
    """What it stands on, or in."""
    pose: Pose
    """Where it came to rest."""
    tried: int
    """How many spots it took."""


def thing_of(stage: Stage, cls: str, *, id: str | None = None, size: Vector | None = None) -> Body:
    """A thing of a class, as heavy and, unless told otherwise, as large as such things are.

    Raises:
        NameUnknown: there is no such class.
        ArgumentRefused: nobody knows how large things of that class are.
    """
    kb = stage.knowledge
    iri = kb.names.find(cls, NameKind.CLASS)
    large = size or kb.shape_rule(iri).size
    if large is None:
        remedy = f"say it (ms:typicalSize of {local_name(iri)}), or give a body of your own"
        raise ArgumentRefused(local_name(iri), cause="nobody told how large such a thing is", remedy=remedy)
    name = BodyId(id or _free_id(local_name(iri), stage.frame.ids))
    physics = Physics(mobility=Mobility.DYNAMIC, gravity=True)
    return Body(id=name, iri=Iri(_base(stage.worlds) + name), cls=iri, pose=Pose(), size=large, physics=physics)


def put(stage: Stage, body: Body, form: Form | None, *, where: str, inside: bool) -> Put:
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
        BodyUnknown: there is no such holder.
        SpotMissing: nothing in or on it is free, large enough and level, or the thing does not stay anywhere there.
    """
    frame, forms = stage.frame, stage.forms
    bodies = {each.id: each for world in stage.worlds for each in world.bodies}
    rows = {id: row for row, id in enumerate(frame.ids)}
    if where not in rows:
        raise BodyUnknown(where, known=frame.ids)
    said = f"{'into' if inside else 'on'} {where}"
    holders = list(_holders(stage, BodyId(where), bodies, forms, rows, frame.poses, inside=inside))
    if not holders:
        lack = "nobody knows of room in it" if inside else "none of its sides looks up"
        raise SpotMissing(body.id, said, reason=lack)
    crowd = Crowd(bodies, forms, frame.ids, frame.poses, _ghosts(stage))
    reasons, tried = list[str](), 0
    for holder in holders:
        spots, why = crowd.spots(body, form, holder)
        if why:
            reasons.append(why)
        for spot in _spread(spots, _TRIES - tried):
            tried += 1
            rested = _tried(stage, msgspec.structs.replace(body, pose=spot), form)
            if rested is not None:
                return Put(id=body.id, holder=holder.body, pose=rested, tried=tried)
            reasons.append("it does not stay there")
    raise SpotMissing(body.id, said, reason="; ".join(dict.fromkeys(reasons)))


# -- where -------------------------------------------------------------------------------------------------------------


def _holders(
    stage: Stage,
    id: BodyId,
    bodies: dict[BodyId, Body],
    forms: Forms,
    rows: dict[BodyId, int],
    poses: Array,
    *,
    inside: bool,
) -> Iterator[Holder]:
    """The places of a body; inside, also those of what hangs on it and slides in it. The lowest shelf comes last."""
    found = []
    for each in (id, *(_parts(stage.worlds, id) if inside else ())):
        if each in rows and each in bodies:
            found += list(places_of(bodies[each], forms.get(each), poses[rows[each]], inside=inside))
    yield from sorted(found, key=lambda holder: (holder.body != id, -holder.size[0] * holder.size[1]))


def _parts(worlds: Iterable[World], id: BodyId) -> list[BodyId]:
    """What hangs on a body at any depth, and what moves by a constraint with those: its drawers, not its case."""
    below: dict[BodyId, list[BodyId]] = {}
    beside: dict[BodyId, list[BodyId]] = {}
    moves = set[BodyId]()
    for world in worlds:
        moves |= {body.id for body in world.bodies if body.physics.simulates}
        for hold in world.attachments:
            below.setdefault(hold.parent, []).append(hold.child)
        for joint in world.constraints:
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


def _ghosts(stage: Stage) -> frozenset[str]:
    """What encloses the place, and so is in nobody's way."""
    return frozenset(id for report in stage.reports for id in report.noted(NoteKind.SHELL))


def _spread(spots: list[Pose], count: int) -> Iterator[Pose]:
    """The best spot, and then some from all over the rest: where one does not hold, its neighbour hardly does."""
    if not spots or count <= 0:
        return
    rows = np.unique(np.linspace(0, len(spots) - 1, count).astype(int))
    yield from (spots[row] for row in rows.tolist())


# -- whether it stays --------------------------------------------------------------------------------------------------


def _tried(stage: Stage, body: Body, form: Form | None) -> Pose | None:
    """Where a body comes to rest, if it stays; then it is there, and else it never was."""
    world = World(iri=stage.worlds[0].iri, name=stage.worlds[0].name, bodies=(body,))
    forms = {body.id: form} if form is not None else {}

    def rehearse(engine: Engine) -> Pose | None:
        before = engine.save() if Ability.SAVE in engine.abilities else None
        engine.spawn(world, forms=forms)
        rested = _rest(engine, body)
        if before is not None:
            engine.restore(before)
        else:
            engine.delete([body.id])
        return rested

    patience_s = stage.timeout_s + 10 * _LONGEST_S
    rested = stage.call(rehearse, what="put", timeout_s=patience_s, edits=True)
    if rested is not None:
        stage.spawn(
            msgspec.structs.replace(world, bodies=(msgspec.structs.replace(body, pose=rested),)),
            forms=forms,
            lasting=False,
        )
    return rested


def _rest(engine: Engine, body: Body) -> Pose | None:
    start, before, passed = _pose(engine, body.id), _pose(engine, body.id), 0.0
    while passed < _LONGEST_S:
        engine.step(_PIECE_S)
        passed += _PIECE_S
        now = _pose(engine, body.id)
        if np.linalg.norm(now[:3] - start[:3]) > _AWAY_M or _lean(start, now) < _UPRIGHT:
            return None
        if passed > 2 * _PIECE_S and np.abs(now - before).max() < _STILL_M:
            position, quaternion = now[:3].tolist(), now[3:].tolist()
            return Pose((position[0], position[1], position[2]), tuple(quaternion))
        before = now
    return None


def _pose(engine: Engine, id: BodyId) -> Array:
    ids, poses = engine.poses()
    row: Array = poses[ids.index(id)].copy()
    row[3:] = unit(row[3:])
    return row


def _lean(start: Array, now: Array) -> float:
    turned = multiply(now[3:], conjugate(start[3:]))
    return float(rotate(turned, (0.0, 0.0, 1.0))[2])


# -- names -------------------------------------------------------------------------------------------------------------


def _free_id(name: str, taken: Iterable[str]) -> str:
    used = set(taken)
    plain = re.sub(r"[^\w.-]", "_", name)
    return next(id for number in range(1, len(used) + 2) if (id := f"{plain}_{number}") not in used)


def _base(worlds: Iterable[World]) -> str:
    """What the IRIs of a map's individuals begin with."""
    for world in worlds:
        for body in world.bodies:
            if body.iri.endswith(body.id):
                return body.iri.removesuffix(body.id)
        return f"{world.iri}#"
    return "http://mindstage.org/put#"
