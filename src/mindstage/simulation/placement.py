"""Places new bodies on or in other bodies, at collision-free poses at which they come to rest.

The free candidate poses (`scene.placement`) are simulated until the body rests, slides or falls over.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

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
    if (on is None) is (into is None):
        raise InvalidArgumentError("place", cause="it needs one holder", remedy="give either `on` or `into`")
    if isinstance(item, str) and item in simulation.state.ids:
        body = simulation.snapshot().body(BodyId(item))
        geometry = simulation.geometry.get(body.id)
    else:
        body = item if isinstance(item, Body) else make_body(simulation, item)
        geometry = simulation.fit_geometry(body)
    support_id, inside = on or into or "", into is not None
    return place_body(simulation, body, geometry, support_id=support_id, inside=inside, near=near, title=title)


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
            if exists:
                rest_pose = _try_move(simulation, placed, title)
            else:
                rest_pose = _try_placement(simulation, placed, geometry, title)
            if rest_pose is not None:
                return PlacementResult(id=body.id, support_id=surface.body_id, pose=rest_pose, attempts=attempts)
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


def _try_placement(simulation: EngineSession, body: Body, geometry: BodyGeometry | None, title: str) -> Pose | None:
    """Simulates a body at its pose; if it is stable, spawns it at the rest pose and returns that, else returns None."""
    world = World(iri=simulation.worlds[0].iri, name=simulation.worlds[0].name, bodies=(body,))
    geometries = {body.id: geometry} if geometry is not None else {}

    def simulate(engine: Engine) -> Pose | None:
        before = engine.save_state() if Capability.SAVE in engine.capabilities else None
        spawned = engine.apply(Spawn(world, geometry=geometries))
        rest_pose = _settle(engine, body)
        if before is not None:
            engine.restore_state(before)
        else:
            engine.apply(spawned.inverse)
        return rest_pose

    timeout_s = simulation.timeout_s + 10 * _MAX_SETTLE_S
    rest_pose = simulation.engine.run(simulate, label="place", timeout_s=timeout_s, edits=True)
    if rest_pose is not None:
        simulation.spawn(
            msgspec.structs.replace(world, bodies=(msgspec.structs.replace(body, pose=rest_pose),)),
            geometry=geometries,
            persistent=False,
            title=title,
        )
    return rest_pose


def _try_move(simulation: EngineSession, body: Body, title: str) -> Pose | None:
    """Simulates an existing body at its pose; if it is stable, moves it to the rest pose and returns that, else None.

    Raises:
        PoseUnreachableError: a joint of the body does not allow the pose.
    """

    def simulate(engine: Engine) -> Pose | None:
        before = engine.save_state() if Capability.SAVE in engine.capabilities else None
        start = _current_pose(engine, body.id)
        engine.apply(SetPoses({body.id: body.pose}))
        rest_pose = _settle(engine, body)
        if before is not None:
            engine.restore_state(before)
        elif rest_pose is None:
            engine.apply(SetPoses({body.id: pose_from_array(start)}))
        return rest_pose

    timeout_s = simulation.timeout_s + 10 * _MAX_SETTLE_S
    rest_pose = simulation.engine.run(simulate, label="place", timeout_s=timeout_s, edits=True)
    if rest_pose is not None:
        (simulation.edits.apply if title else simulation.apply)(SetPoses({body.id: rest_pose}, title=title))
    return rest_pose


def _settle(engine: Engine, body: Body) -> Pose | None:
    """Steps the engine until a body rests; returns its pose, or None if it slid, fell over or kept moving."""
    start = before = _current_pose(engine, body.id)
    elapsed_s = 0.0
    while elapsed_s < _MAX_SETTLE_S:
        engine.step(_SETTLE_STEP_S)
        elapsed_s += _SETTLE_STEP_S
        now = _current_pose(engine, body.id)
        if np.linalg.norm(now[:3] - start[:3]) > _MAX_SLIDE_M or _upright_cosine(start, now) < _MIN_UPRIGHT_COSINE:
            return None
        if elapsed_s > 2 * _SETTLE_STEP_S and np.abs(now - before).max() < _REST_TOLERANCE_M:
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
