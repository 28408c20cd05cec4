"""Places new bodies on or in other bodies, at collision-free poses at which they come to rest.

The free candidate poses (`scene.placement`) are simulated until the body rests, slides or falls over.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

import msgspec
import numpy as np

from mindstage.engines.base import Capability, Engine, SpawnNoteKind
from mindstage.errors import BodyNotFoundError, InvalidArgumentError, NoFreePlacementError
from mindstage.knowledge.names import EntityType
from mindstage.rdf.graphs import local_name
from mindstage.scene import (
    Body,
    BodyGeometry,
    BodyId,
    BodyPhysics,
    GeometryMap,
    Iri,
    Mobility,
    Pose,
    Vector,
    World,
)
from mindstage.scene.edits import SetPoses, Spawn
from mindstage.scene.placement import PlacementSampler, PlacementSurface, support_surfaces
from mindstage.scene.transforms import Array, normalize, pose_from_array, quat_conjugate, quat_multiply, quat_rotate
from mindstage.simulation.state import EngineSession

__all__ = [
    "FreePlaces",
    "PlacementResult",
    "enclosing_body_ids",
    "free_id",
    "iri_prefix",
    "make_body",
    "place_body",
    "place_item",
    "place_items",
]


_MAX_ATTEMPTS = 12
"""Limit of the candidates that are simulated."""
_MAX_NEAR = 36
"""How many of the poses nearest to a point are candidates."""
_SETTLE_STEP_S, _MAX_SETTLE_S = 0.1, 3.0
"""Interval of the rest test, and its limit [s of simulated time]."""
_REST_TOLERANCE_M = 0.0005
"""A body that moves by less in an interval is at rest."""
_MAX_SLIDE_M = 0.03
"""A body that slid farther is not stable."""
_MIN_UPRIGHT_COSINE = 0.966
"""Cosine of the maximal tilt of a stable body, fifteen degrees."""


class PlacementResult(msgspec.Struct, frozen=True, kw_only=True):
    """The pose of a placed body."""

    id: BodyId
    support_id: BodyId
    """The body that it is on or in."""
    pose: Pose
    """The pose at which it came to rest."""
    attempts: int
    """Number of candidates that were simulated."""
    expected_rebuild_s: float = 0.0
    """How long the engine is expected to rebuild its model before time goes on [s]."""


def make_body(simulation: EngineSession, cls: str, *, id: str | None = None, size: Vector | None = None) -> Body:
    """Creates a dynamic body of a class, by default of the size that the ontology gives for the class [m].

    Raises:
        NameNotFoundError: no class has that name.
        InvalidArgumentError: the ontology has no size for the class.
    """
    kb = simulation.knowledge
    iri = kb.names.find(cls, EntityType.CLASS)
    extents = size or kb.shape_rule(iri).size
    if extents is None:
        remedy = f"assert ms:typicalSize of {local_name(iri)}, or give a size"
        raise InvalidArgumentError(local_name(iri), cause="the size of its instances is unknown", remedy=remedy)
    name = BodyId(id or free_id(local_name(iri), simulation.state.ids))
    physics = BodyPhysics(mobility=Mobility.DYNAMIC, gravity=True)
    return Body(
        id=name, iri=Iri(iri_prefix(simulation.worlds) + name), cls=iri, pose=Pose(), size=extents, physics=physics
    )


def place_item(
    simulation: EngineSession,
    item: Body | str,
    *,
    on: str | None,
    into: str | None,
    near: Vector | None,
    title: str = "",
) -> PlacementResult:
    """Places a body, a body that exists, or a new one of a class; see `Simulation.place`."""
    support_id, inside = _holder(on, into)
    ((body, geometry),) = _items(simulation, [item])
    return place_body(simulation, body, geometry, support_id=support_id, inside=inside, near=near, title=title)


def place_items(
    simulation: EngineSession,
    items: Sequence[Body | str],
    *,
    on: str | None,
    into: str | None,
    room_for: Sequence[Body | str] = (),
    title: str = "",
) -> tuple[PlacementResult, ...]:
    """Places several bodies where all of them fit; see `Simulation.place`.

    Args:
        items: see `place_item`.
        room_for: what is not placed, but would fit beside them.
    """
    if len(items) == 1 and not room_for:
        return (place_item(simulation, items[0], on=on, into=into, near=None, title=title),)
    support_id, inside = _holder(on, into)
    known = _items(simulation, [*items, *room_for])
    names, location = ", ".join(body.id for body, _ in known), f"{'into' if inside else 'on'} {support_id}"
    if support_id in {body.id for body, _ in known}:
        raise NoFreePlacementError(names, location, reason="it cannot be placed on itself")
    places = FreePlaces(simulation, without=[body.id for body, _ in known])
    surfaces, attempts = places.surfaces(support_id, inside=inside), 0
    for packing in places.sampler.packings(known, surfaces):
        attempts += 1
        placed = [
            (msgspec.structs.replace(body, pose=pose), surface, geometry)
            for (body, geometry), (surface, pose) in zip(known, packing, strict=True)
        ][: len(items)]
        geometries = {body.id: geometry for body, _, geometry in placed if geometry is not None}
        if (rests := _try_placing(simulation, [body for body, _, _ in placed], geometries, title)) is not None:
            return tuple(
                PlacementResult(id=body.id, support_id=surface.body_id, pose=pose, attempts=attempts)
                for (body, surface, _), pose in zip(placed, rests, strict=True)
            )
    reason = "they do not stay where they fit" if attempts else "no arrangement was found in which all of them fit"
    raise NoFreePlacementError(names, location, reason=reason)


def _holder(on: str | None, into: str | None) -> tuple[str, bool]:
    """The id of the holder, and whether things are placed in it."""
    if (on is None) is (into is None):
        raise InvalidArgumentError("place", cause="it needs one holder", remedy="give either `on` or `into`")
    return on or into or "", into is not None


def _items(simulation: EngineSession, items: Sequence[Body | str]) -> list[tuple[Body, BodyGeometry | None]]:
    """Bodies that are given, exist, or are made of a class, with their geometry."""
    found: list[tuple[Body, BodyGeometry | None]] = []
    snapshot, taken = simulation.snapshot(), list(simulation.state.ids)
    for item in items:
        if isinstance(item, str) and item in simulation.state.ids:
            body = snapshot.body(BodyId(item))
            found.append((body, simulation.geometry.get(body.id)))
            continue
        body = item if isinstance(item, Body) else make_body(simulation, item)
        if not isinstance(item, Body) and body.id in taken:  # the second one of a class
            name = BodyId(free_id(local_name(body.cls), taken))
            body = msgspec.structs.replace(body, id=name, iri=Iri(iri_prefix(simulation.worlds) + name))
        taken.append(body.id)
        found.append((body, simulation.fit_geometry(body)))
    if len({body.id for body, _ in found}) < len(found):
        raise InvalidArgumentError("place", cause="a thing is given twice", remedy="give each one once")
    return found


def place_body(
    simulation: EngineSession,
    body: Body,
    geometry: BodyGeometry | None,
    *,
    support_id: str,
    inside: bool | None,
    near: Vector | None = None,
    title: str = "",
) -> PlacementResult:
    """Spawns a body on another one, or in it, at a pose at which it stays; a body that exists is moved there.

    Free candidate poses are simulated until one is stable: the body is dropped from 1 mm and observed until it rests.
    If the engine can save its state, the trials do not affect other bodies; otherwise simulated time advances for all.

    Args:
        simulation: the simulation.
        body: the body; its pose is ignored.
        geometry: its geometry.
        support_id: the id of the holder. With `inside`, surfaces of its parts and drawers are used too.
        inside: whether the body is placed in the holder, or on it; None for whichever is nearer.
        near: a point that it is placed near, in the world frame [m]; by default near the centers of surfaces.
        title: see `Simulation.place`.

    Raises:
        BodyNotFoundError: the holder does not exist.
        NoFreePlacementError: no level surface is large enough and free, or the body is stable on none.
    """
    places = FreePlaces(simulation, without=(body.id,))
    exists = body.id in places.ids
    if exists and body.id == support_id:
        raise NoFreePlacementError(body.id, f"on {support_id}", reason="it cannot be placed on itself")
    location = f"{'into' if inside else 'on'} {support_id}"
    surfaces = places.surfaces(support_id, inside=inside, near=near)
    if not surfaces:
        reason = "it has no known support surface inside" if inside else "none of its sides is level and faces up"
        raise NoFreePlacementError(body.id, location, reason=reason)
    reasons, attempts = list[str](), 0
    for surface in surfaces:
        candidates, reason = places.sampler.candidate_poses(body, geometry, surface, near=near)
        if reason:
            reasons.append(reason)
        # Near a point the first pose counts, not one far from it.
        spread = _sample_poses(candidates[: len(candidates) if near is None else _MAX_NEAR], _MAX_ATTEMPTS - attempts)
        for candidate in spread:
            attempts += 1
            placed = msgspec.structs.replace(body, pose=candidate)
            geometries = {body.id: geometry} if geometry is not None else {}
            if (rest_poses := _try_placing(simulation, [placed], geometries, title)) is not None:
                return PlacementResult(id=body.id, support_id=surface.body_id, pose=rest_poses[0], attempts=attempts)
            reasons.append("it does not stay there")
    raise NoFreePlacementError(body.id, location, reason="; ".join(dict.fromkeys(reasons)))


# -- support surfaces --------------------------------------------------------------------------------------------------


class FreePlaces:
    """Free places in the current state of a simulation; what happens later does not change them."""

    def __init__(self, simulation: EngineSession, *, without: Iterable[str] = ()) -> None:
        """Reads the state.

        Args:
            simulation: the simulation.
            without: bodies that are no obstacles, besides those that enclose the scene.
        """
        snapshot = simulation.state
        self.ids = snapshot.ids
        """The bodies that exist."""
        self._bodies = {each.id: each for world in simulation.worlds for each in world.bodies}
        self._geometry, self._worlds, self._poses = simulation.geometry, simulation.worlds, snapshot.poses
        self._rows = {id: row for row, id in enumerate(snapshot.ids)}
        ignored = enclosing_body_ids(simulation) | frozenset(without)
        self.sampler = PlacementSampler(self._bodies, self._geometry, snapshot.ids, snapshot.poses, ignored)
        """Samples free poses."""

    def surfaces(self, id: str, *, inside: bool | None, near: Vector | None = None) -> list[PlacementSurface]:
        """The level support surfaces of a body, its own before those of its parts and drawers, larger ones first.

        Args:
            id: the body.
            inside: whether surfaces in it, or on it; None for both.
            near: a point in the world frame [m]; surfaces near it are first then.

        Raises:
            BodyNotFoundError: it does not exist.
        """
        if id not in self._rows:
            raise BodyNotFoundError(id, known=self.ids)
        found: list[PlacementSurface] = []
        for where in (False, True) if inside is None else (inside,):
            for each in (BodyId(id), *(_attached_bodies(self._worlds, BodyId(id)) if where else ())):
                if each in self._rows and each in self._bodies:
                    pose = self._poses[self._rows[each]]
                    found += support_surfaces(self._bodies[each], self._geometry.get(each), pose, inside=where)
        if near is not None:
            return sorted(found, key=lambda surface: surface.distance(near))
        return sorted(found, key=lambda surface: (surface.body_id != id, -surface.size[0] * surface.size[1]))


def _attached_bodies(worlds: Iterable[World], id: BodyId) -> list[BodyId]:
    """The bodies attached to a body at any depth, and the dynamic bodies jointed to static ones of them: drawers."""
    children: dict[BodyId, list[BodyId]] = {}
    jointed: dict[BodyId, list[BodyId]] = {}
    dynamic = set[BodyId]()
    for world in worlds:
        dynamic |= {body.id for body in world.bodies if body.physics.is_dynamic}
        for attachment in world.attachments:
            children.setdefault(attachment.parent, []).append(attachment.child)
        for joint in world.joints:
            jointed.setdefault(joint.parent, []).append(joint.child)
            jointed.setdefault(joint.child, []).append(joint.parent)
    attached, pending = {id: None}, [id]
    while pending:
        for child in children.get(pending.pop(), ()):
            if child not in attached:
                attached[child] = None
                pending.append(child)
    static = (each for each in attached if each not in dynamic)
    moving = {other: None for each in static for other in jointed.get(each, ()) if other in dynamic}
    return [*list(attached)[1:], *moving]


def enclosing_body_ids(simulation: EngineSession) -> frozenset[str]:
    """Bodies that enclose the scene, such as a building, which are not obstacles."""
    return frozenset(id for report in simulation.reports for id in report.ids_with_note(SpawnNoteKind.ENCLOSURE))


def _sample_poses(poses: list[Pose], count: int) -> Iterator[Pose]:
    """Up to `count` poses spread evenly over the list, the best first: an unstable pose has unstable neighbors."""
    if not poses or count <= 0:
        return
    rows = np.unique(np.linspace(0, len(poses) - 1, count).astype(int))
    yield from (poses[row] for row in rows.tolist())


# -- stability ---------------------------------------------------------------------------------------------------------


def _try_placing(
    simulation: EngineSession, bodies: Sequence[Body], geometry: GeometryMap, title: str
) -> tuple[Pose, ...] | None:
    """Simulates bodies at their poses; if all are stable, spawns or moves them to the rest poses and returns these.

    Raises:
        PoseUnreachableError: a joint of a body does not allow the pose.
    """
    existing = set(simulation.state.ids)
    moved = {body.id: body.pose for body in bodies if body.id in existing}
    added = tuple(body for body in bodies if body.id not in existing)
    world = World(iri=simulation.worlds[0].iri, name=simulation.worlds[0].name, bodies=added) if added else None

    def simulate(engine: Engine) -> tuple[Pose, ...] | None:
        before = engine.save_state() if Capability.SAVE in engine.capabilities else None
        done = [engine.apply(Spawn(world, geometry=geometry))] if world is not None else []
        if moved:
            done.append(engine.apply(SetPoses(moved)))
        rest_poses = _settle(engine, [body.id for body in bodies])
        if before is not None:
            engine.restore_state(before)
        else:
            for each in reversed(done):
                engine.apply(each.inverse)
        return rest_poses

    timeout_s = simulation.timeout_s + 10 * _MAX_SETTLE_S
    rest_poses = simulation.engine.run(simulate, label="place", timeout_s=timeout_s, edits=True)
    if rest_poses is None:
        return None
    rests = dict(zip((body.id for body in bodies), rest_poses, strict=True))
    if world is not None:
        spawned = tuple(msgspec.structs.replace(body, pose=rests[body.id]) for body in added)
        simulation.spawn(
            msgspec.structs.replace(world, bodies=spawned), geometry=geometry, persistent=False, title=title
        )
    if moved:
        edit = SetPoses({id: rests[id] for id in moved}, title=title)
        (simulation.edits.apply if title else simulation.apply)(edit)
    return rest_poses


def _settle(engine: Engine, ids: Sequence[BodyId]) -> tuple[Pose, ...] | None:
    """Steps the engine until bodies rest; returns their poses, or None if one slid, fell over or kept moving."""
    start = before = _current_poses(engine, ids)
    elapsed_s = 0.0
    while elapsed_s < _MAX_SETTLE_S:
        engine.step(_SETTLE_STEP_S)
        elapsed_s += _SETTLE_STEP_S
        now = _current_poses(engine, ids)
        if np.any(np.linalg.norm(now[:, :3] - start[:, :3], axis=1) > _MAX_SLIDE_M):
            return None
        if min(map(_upright_cosine, start, now)) < _MIN_UPRIGHT_COSINE:
            return None
        if elapsed_s > 2 * _SETTLE_STEP_S and np.abs(now - before).max() < _REST_TOLERANCE_M:
            return tuple(pose_from_array(each) for each in now)
        before = now
    return None


def _current_poses(engine: Engine, wanted: Sequence[BodyId]) -> Array:
    ids, poses = engine.poses()
    rows: Array = poses[[ids.index(id) for id in wanted]].copy()
    rows[:, 3:] = normalize(rows[:, 3:])
    return rows


def _upright_cosine(start: Array, now: Array) -> float:
    rotation = quat_multiply(now[3:], quat_conjugate(start[3:]))
    return float(quat_rotate(rotation, (0.0, 0.0, 1.0))[2])


# -- names -------------------------------------------------------------------------------------------------------------


def free_id(name: str, taken: Iterable[str]) -> str:
    """The first id of the form name_1, name_2 … that is not taken."""
    used = set(taken)
    plain = re.sub(r"[^\w.-]", "_", name)
    return next(id for number in range(1, len(used) + 2) if (id := f"{plain}_{number}") not in used)


def iri_prefix(worlds: Iterable[World]) -> str:
    """The common prefix of the IRIs of a map's individuals."""
    for world in worlds:
        for body in world.bodies:
            if body.iri.endswith(body.id):
                return body.iri.removesuffix(body.id)
        return f"{world.iri}#"
    return "http://mindstage.org/put#"
