"""Places new bodies on or in other bodies, at collision-free poses at which they come to rest.

Candidate poses are sampled on a grid over the level support surfaces of the holder, nearest to the center first, and
tested in one batch against the collision shapes of all bodies nearby. The free ones are simulated until the body rests,
slides or falls over.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from mindstage.engines.base import Capability, Engine, SpawnNoteKind
from mindstage.engines.collision_shapes import (
    CollisionShapeBatch,
    CompiledGeometry,
    compile_geometry,
    fallback_collision_shape,
)
from mindstage.errors import BodyNotFoundError, InvalidArgumentError, NoFreePlacementError
from mindstage.knowledge.names import EntityType
from mindstage.knowledge.rdf import local_name
from mindstage.scene import (
    Body,
    BodyGeometry,
    BodyId,
    BodyPhysics,
    CollisionShape,
    GeometryMap,
    Iri,
    Mobility,
    Pose,
    SupportSurface,
    Vector,
    World,
)
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.transforms import (
    Array,
    normalize,
    pose_from_array,
    pose_multiply,
    quat_conjugate,
    quat_multiply,
    quat_rotate,
)
from mindstage.simulation.state import EngineSession

__all__ = [
    "PlacementResult",
    "PlacementSampler",
    "PlacementSurface",
    "enclosing_body_ids",
    "make_body",
    "place_body",
    "support_surfaces",
]


_MIN_UP_COSINE = 0.985
"""Cosine of the maximal slope of a support surface, ten degrees."""
_DROP_HEIGHT_M = 0.001
"""Distance above the support surface from which a body is dropped."""
_MARGIN_M = 0.004
"""Distance from the edges of the support surface."""
_MIN_GRID_STEP_M = 0.02
_MAX_CANDIDATES = 625
"""Approximate limit of the candidates for each orientation on one surface."""
_ASSUMED_SIZE_M: Vector = (0.1, 0.1, 0.1)


@dataclass(frozen=True, slots=True)
class PlacementSurface:
    """A level support surface at its current pose."""

    body_id: BodyId
    surface: SupportSurface
    pose: Array
    """The pose of its center in the world frame, seven numbers: z is up, x and y are along its sides."""
    size: tuple[float, float]
    """Extents along x and y [m]."""


def support_surfaces(
    body: Body, geometry: BodyGeometry | None, pose: Array, *, inside: bool
) -> Iterator[PlacementSurface]:
    """Yields the support surfaces of a body that are level at its current pose.

    Args:
        body: the body.
        geometry: its geometry; without one it is a box, with the upper side as the only surface.
        pose: its pose in the world frame, seven numbers.
        inside: whether surfaces in it are yielded, such as shelves, or surfaces on it.
    """
    body_pose = np.concatenate([pose[:3], normalize(pose[3:])])
    known = geometry.support_surfaces if geometry is not None else ()
    surfaces = [surface for surface in known if surface.is_inside is inside]
    if not inside and not known:
        surfaces = list(_box_surfaces(body))
    for surface in surfaces:
        if quat_rotate(body_pose[3:], surface.normal)[2] >= _MIN_UP_COSINE:
            yield _placement_surface(body.id, surface, body_pose)


def _box_surfaces(body: Body) -> Iterator[SupportSurface]:
    """The six sides of a box."""
    size = body.size or _ASSUMED_SIZE_M
    for axis in range(3):
        across = [other for other in range(3) if other != axis]
        for sign in (1.0, -1.0):
            up, center = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
            up[axis], center[axis] = sign, sign * size[axis] / 2
            extent = (size[across[0]], size[across[1]])
            yield SupportSurface(center=(center[0], center[1], center[2]), size=extent, normal=(up[0], up[1], up[2]))


def _placement_surface(id: BodyId, surface: SupportSurface, body_pose: Array) -> PlacementSurface:
    along = np.eye(3)[next(axis for axis in range(3) if axis != np.argmax(np.abs(surface.normal)))]
    x = quat_rotate(body_pose[3:], along)
    yaw = float(np.arctan2(x[1], x[0]))
    middle = body_pose[:3] + quat_rotate(body_pose[3:], surface.center)
    frame = np.array([*middle, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
    return PlacementSurface(id, surface, frame, surface.size)


class PlacementSampler:
    """Samples collision-free poses among the bodies of a world."""

    def __init__(
        self,
        bodies: Mapping[BodyId, Body],
        geometry: GeometryMap,
        ids: Sequence[BodyId],
        poses: Array,
        ignored_ids: frozenset[str],
    ) -> None:
        """Prepares the collision shapes of the obstacles.

        Args:
            bodies: the bodies by id.
            geometry: their geometry.
            ids: the bodies that exist.
            poses: their poses, n x 7, in the order of `ids`.
            ignored_ids: bodies that are not obstacles.
        """
        rows = [row for row, id in enumerate(ids) if id in bodies and id not in ignored_ids]
        self._poses = (
            np.concatenate([poses[rows, :3], normalize(poses[rows, 3:])], axis=1) if rows else np.zeros((0, 7))
        )
        cache: dict[object, CompiledGeometry] = {}
        self._compiled = [_compiled_geometry(bodies[ids[row]], geometry.get(ids[row]), cache) for row in rows]
        corners = [each.bounds for each in self._compiled]
        low, high = (np.array([pair[end] for pair in corners]).reshape(-1, 3) for end in (0, 1))
        middles = self._poses.copy()
        if rows:
            middles[:, :3] += quat_rotate(self._poses[:, 3:], (low + high) / 2)
        self._low, self._high = OrientedBoxes.from_poses(middles, high - low).bounds()

    def candidate_poses(
        self, body: Body, geometry: BodyGeometry | None, surface: PlacementSurface, *, max_tested: int | None = None
    ) -> tuple[list[Pose], str]:
        """The free poses of a body on a surface, nearest to the center first; if there are none, also the reason.

        Args:
            body: the body.
            geometry: its geometry.
            surface: the surface.
            max_tested: how many of the poses are tested, spread evenly over them; None for all.
        """
        low, high = _compiled_geometry(body, geometry, {}).bounds
        if surface.surface.clearance is not None and high[2] - low[2] > surface.surface.clearance:
            return [], f"it is {high[2] - low[2]:.2f} m high, and the clearance is {surface.surface.clearance:.2f} m"
        candidates = np.concatenate([_grid_poses(surface, low, high, quarter) for quarter in (0, 1)])
        if not len(candidates):
            return [], "it is larger than the support surface"
        order = np.argsort(np.linalg.norm(candidates[:, :3] - surface.pose[:3], axis=1), kind="stable")
        if max_tested is not None:
            order = order[np.unique(np.linspace(0, len(order) - 1, max_tested).astype(int))]
        candidates = candidates[order]
        free = self._is_free(_bounding_geometry(low, high), candidates)
        reason = "" if free.any() else "other bodies occupy the space"
        return [pose_from_array(row) for row in candidates[free]], reason

    def _is_free(self, compiled: CompiledGeometry, candidates: Array) -> Array:
        reach = float(np.linalg.norm(np.maximum(np.abs(compiled.bounds[0]), np.abs(compiled.bounds[1]))))
        low, high = candidates[:, :3].min(axis=0) - reach, candidates[:, :3].max(axis=0) + reach
        near = np.flatnonzero(np.all((self._low <= high) & (self._high >= low), axis=1))
        count = len(candidates)
        if not len(near):
            return np.ones(count, dtype=bool)
        parts = CollisionShapeBatch.from_compiled(
            np.concatenate([candidates, self._poses[near]]), [compiled] * count + [self._compiled[row] for row in near]
        )
        center = candidates[:, None, :3]
        overlap = np.all((center - reach <= self._high[near]) & (self._low[near] <= center + reach), axis=2)
        a, b = np.nonzero(overlap)
        penetrates = parts.penetration_depths(a, b + count, np.full(len(a), np.inf)) > 0.0
        return np.asarray(np.bincount(a[penetrates], minlength=count) == 0)


def _compiled_geometry(
    body: Body, geometry: BodyGeometry | None, cache: dict[object, CompiledGeometry]
) -> CompiledGeometry:
    key: object = geometry.key if geometry is not None else (body.shape, body.size)
    if key not in cache:
        cache[key] = compile_geometry(
            geometry.collision_shapes
            if geometry is not None
            else (fallback_collision_shape(body, body.size or _ASSUMED_SIZE_M),)
        )
    return cache[key]


def _bounding_geometry(low: Array, high: Array) -> CompiledGeometry:
    """The bounding box of a body as its collision shape, which also reserves the space inside its concavities."""
    (x, y, z), (a, b, c) = ((low + high) / 2).tolist(), (high - low).tolist()
    return compile_geometry((CollisionShape(size=(a, b, c), pose=Pose((x, y, z))),))


def _grid_poses(surface: PlacementSurface, low: Array, high: Array, quarter: int) -> Array:
    """Poses on a grid over a surface, rotated about z by quarter turns, for a body with the bounds low and high [m]."""
    turn = np.array([np.cos(quarter * np.pi / 4), 0.0, 0.0, np.sin(quarter * np.pi / 4)])
    corners = quat_rotate(turn, np.array([low, high]))
    least, most = corners.min(axis=0), corners.max(axis=0)
    room = np.array(surface.size) - (most - least)[:2] - 2 * _MARGIN_M
    if (room < 0.0).any():
        return np.zeros((0, 7))
    finest = max(_MIN_GRID_STEP_M, float(np.sqrt(room.prod() / _MAX_CANDIDATES)))
    steps = [np.linspace(-extent / 2, extent / 2, 2 * int(extent / finest / 2) + 1) for extent in room]
    x, y = np.meshgrid(*steps, indexing="ij")
    offset = -(least + most)[:2] / 2
    local = np.zeros((x.size, 7))
    local[:, 0], local[:, 1] = x.reshape(-1) + offset[0], y.reshape(-1) + offset[1]
    local[:, 2] = _DROP_HEIGHT_M - least[2]
    local[:, 3:] = turn
    placed = pose_multiply(np.tile(surface.pose, (len(local), 1)), local)
    placed[:, 3:] = normalize(quat_multiply(surface.pose[3:], local[:, 3:]))
    return placed


_MAX_ATTEMPTS = 12
"""Limit of the candidates that are simulated."""
_SETTLE_STEP_S, _MAX_SETTLE_S = 0.1, 3.0
"""Interval of the rest test, and its limit [s of simulated time]."""
_REST_TOLERANCE_M = 0.0005
"""A body that moves by less in an interval is at rest."""
_MAX_SLIDE_M = 0.03
"""A body that slid farther is not stable."""
_MIN_UPRIGHT_COSINE = 0.966
"""Cosine of the maximal tilt of a stable body, fifteen degrees."""


class PlacementResult(msgspec.Struct, frozen=True, kw_only=True, rename={"support_id": "holder", "attempts": "tried"}):
    """The pose of a placed body."""

    id: BodyId
    support_id: BodyId
    """The body that it is on or in."""
    pose: Pose
    """The pose at which it came to rest."""
    attempts: int
    """Number of candidates that were simulated."""


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
    name = BodyId(id or _free_id(local_name(iri), simulation.state.ids))
    physics = BodyPhysics(mobility=Mobility.DYNAMIC, gravity=True)
    return Body(
        id=name, iri=Iri(_iri_prefix(simulation.worlds) + name), cls=iri, pose=Pose(), size=extents, physics=physics
    )


def place_body(
    simulation: EngineSession, body: Body, geometry: BodyGeometry | None, *, support_id: str, inside: bool
) -> PlacementResult:
    """Spawns a body on another one, or in it, at a pose at which it stays.

    Free candidate poses are simulated until one is stable: the body is dropped from 1 mm and observed until it rests.
    If the engine can save its state, the trials do not affect other bodies; otherwise simulated time advances for all.

    Args:
        simulation: the simulation.
        body: the body to spawn; its pose is ignored.
        geometry: its geometry.
        support_id: the id of the holder. With `inside`, surfaces of its parts and drawers are used too.
        inside: whether the body is placed in the holder, or on it.

    Raises:
        BodyNotFoundError: the holder does not exist.
        NoFreePlacementError: no level surface is large enough and free, or the body is stable on none.
    """
    snapshot, existing = simulation.state, simulation.geometry
    bodies = {each.id: each for world in simulation.worlds for each in world.bodies}
    rows = {id: row for row, id in enumerate(snapshot.ids)}
    if support_id not in rows:
        raise BodyNotFoundError(support_id, known=snapshot.ids)
    location = f"{'into' if inside else 'on'} {support_id}"
    surfaces = list(
        _placement_surfaces(simulation, BodyId(support_id), bodies, existing, rows, snapshot.poses, inside=inside)
    )
    if not surfaces:
        reason = "it has no known support surface inside" if inside else "none of its sides is level and faces up"
        raise NoFreePlacementError(body.id, location, reason=reason)
    sampler = PlacementSampler(bodies, existing, snapshot.ids, snapshot.poses, enclosing_body_ids(simulation))
    reasons, attempts = list[str](), 0
    for surface in surfaces:
        candidates, reason = sampler.candidate_poses(body, geometry, surface)
        if reason:
            reasons.append(reason)
        for candidate in _sample_poses(candidates, _MAX_ATTEMPTS - attempts):
            attempts += 1
            rest_pose = _try_placement(simulation, msgspec.structs.replace(body, pose=candidate), geometry)
            if rest_pose is not None:
                return PlacementResult(id=body.id, support_id=surface.body_id, pose=rest_pose, attempts=attempts)
            reasons.append("it does not stay there")
    raise NoFreePlacementError(body.id, location, reason="; ".join(dict.fromkeys(reasons)))


# -- support surfaces --------------------------------------------------------------------------------------------------


def _placement_surfaces(
    simulation: EngineSession,
    id: BodyId,
    bodies: dict[BodyId, Body],
    geometry: GeometryMap,
    rows: dict[BodyId, int],
    poses: Array,
    *,
    inside: bool,
) -> Iterator[PlacementSurface]:
    """The level support surfaces of a body, its own before those of its parts and drawers, larger ones first."""
    found = []
    for each in (id, *(_attached_bodies(simulation.worlds, id) if inside else ())):
        if each in rows and each in bodies:
            found += list(support_surfaces(bodies[each], geometry.get(each), poses[rows[each]], inside=inside))
    yield from sorted(found, key=lambda surface: (surface.body_id != id, -surface.size[0] * surface.size[1]))


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


def _try_placement(simulation: EngineSession, body: Body, geometry: BodyGeometry | None) -> Pose | None:
    """Simulates a body at its pose; if it is stable, spawns it at the rest pose and returns that, else returns None."""
    world = World(iri=simulation.worlds[0].iri, name=simulation.worlds[0].name, bodies=(body,))
    geometries = {body.id: geometry} if geometry is not None else {}

    def simulate(engine: Engine) -> Pose | None:
        before = engine.save_state() if Capability.SAVE in engine.capabilities else None
        engine.spawn(world, geometry=geometries)
        rest_pose = _settle(engine, body)
        if before is not None:
            engine.restore_state(before)
        else:
            engine.delete([body.id])
        return rest_pose

    timeout_s = simulation.timeout_s + 10 * _MAX_SETTLE_S
    rest_pose = simulation.run_on_engine(simulate, label="place", timeout_s=timeout_s, edits=True)
    if rest_pose is not None:
        simulation.spawn(
            msgspec.structs.replace(world, bodies=(msgspec.structs.replace(body, pose=rest_pose),)),
            geometry=geometries,
            persistent=False,
        )
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


def _free_id(name: str, taken: Iterable[str]) -> str:
    used = set(taken)
    plain = re.sub(r"[^\w.-]", "_", name)
    return next(id for number in range(1, len(used) + 2) if (id := f"{plain}_{number}") not in used)


def _iri_prefix(worlds: Iterable[World]) -> str:
    """The common prefix of the IRIs of a map's individuals."""
    for world in worlds:
        for body in world.bodies:
            if body.iri.endswith(body.id):
                return body.iri.removesuffix(body.id)
        return f"{world.iri}#"
    return "http://mindstage.org/put#"
