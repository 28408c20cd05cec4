"""Putting: a new thing comes to stand on something, or in it, where there is room for it and it stays.

Spots: where on a body, or in it, something can stand without standing in anything else.

A form tells its places: level rectangles. They are strewn with candidates, best ones first, and each candidate is held
against the solids of all that is near, many at once.
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

__all__ = ["PlacementResult", "PlacementSampler", "PlacementSurface", "make_body", "place_body", "support_surfaces"]


_MIN_UP_COSINE = 0.985
"""Cosine of the steepest slope on which things are put: ten degrees."""
_DROP_HEIGHT_M = 0.001
"""Between what is put down and what it is put on; it falls the rest."""
_MARGIN_M = 0.004
"""Between what is put down and the edge of its place."""
_MIN_GRID_STEP_M = 0.02
_MAX_CANDIDATES = 625
"""So many candidates for each way round on one place."""
_ASSUMED_SIZE_M: Vector = (0.1, 0.1, 0.1)


@dataclass(frozen=True, slots=True)
class PlacementSurface:
    """A place as it is now."""

    body_id: BodyId
    surface: SupportSurface
    pose: Array
    """The pose of its middle in the world, z looking up; x and y along the place's own sides."""
    size: tuple[float, float]


def support_surfaces(
    body: Body, geometry: BodyGeometry | None, pose: Array, *, inside: bool
) -> Iterator[PlacementSurface]:
    """The places of a body that look up now.

    Args:
        body: on which, or in which.
        form: what it is made of; without one it is a box, with its top as the only place.
        pose: where it is, seven numbers.
        inside: whether places in it are wanted, or places on it.
    """
    here = np.concatenate([pose[:3], normalize(pose[3:])])
    known = geometry.support_surfaces if geometry is not None else ()
    places = [place for place in known if place.is_inside is inside]
    if not inside and not known:
        places = list(_box_surfaces(body))
    for place in places:
        if quat_rotate(here[3:], place.normal)[2] >= _MIN_UP_COSINE:
            yield _placement_surface(body.id, place, here)


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
    """All that stands somewhere now, to be held against what shall join it."""

    def __init__(
        self,
        bodies: Mapping[BodyId, Body],
        geometry: GeometryMap,
        ids: Sequence[BodyId],
        poses: Array,
        ignored_ids: frozenset[str],
    ) -> None:
        """Makes ready what can be in the way.

        Args:
            bodies: as they are described.
            forms: what they are made of.
            ids: of all that stand there.
            poses: theirs, n x 7.
            ghosts: those that collide with nothing.
        """
        rows = [row for row, id in enumerate(ids) if id in bodies and id not in ignored_ids]
        self._poses = (
            np.concatenate([poses[rows, :3], normalize(poses[rows, 3:])], axis=1) if rows else np.zeros((0, 7))
        )
        made: dict[object, CompiledGeometry] = {}
        self._compiled = [_compiled_geometry(bodies[ids[row]], geometry.get(ids[row]), made) for row in rows]
        corners = [each.bounds for each in self._compiled]
        low, high = (np.array([pair[end] for pair in corners]).reshape(-1, 3) for end in (0, 1))
        middles = self._poses.copy()
        if rows:
            middles[:, :3] += quat_rotate(self._poses[:, 3:], (low + high) / 2)
        self._low, self._high = OrientedBoxes.from_poses(middles, high - low).bounds()

    def candidate_poses(
        self, body: Body, geometry: BodyGeometry | None, surface: PlacementSurface
    ) -> tuple[list[Pose], str]:
        """Where on a place a body can stand, best first; none, and why, where it cannot."""
        low, high = _compiled_geometry(body, geometry, {}).bounds
        if surface.surface.clearance is not None and high[2] - low[2] > surface.surface.clearance:
            return [], f"it is {high[2] - low[2]:.2f} m high, and there is room for {surface.surface.clearance:.2f} m"
        candidates = np.concatenate([_grid_poses(surface, low, high, quarter) for quarter in (0, 1)])
        if not len(candidates):
            return [], "it is larger than the place"
        order = np.argsort(np.linalg.norm(candidates[:, :3] - surface.pose[:3], axis=1), kind="stable")
        candidates = candidates[order]
        free = self._is_free(_bounding_geometry(low, high), candidates)
        why = "" if free.any() else "something stands there already"
        return [pose_from_array(row) for row in candidates[free]], why

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
        meet = np.all((center - reach <= self._high[near]) & (self._low[near] <= center + reach), axis=2)
        a, b = np.nonzero(meet)
        deep = parts.penetration_depths(a, b + count, np.full(len(a), np.inf)) > 0.0
        return np.asarray(np.bincount(a[deep], minlength=count) == 0)


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
    """What a thing takes up: it may as well have the room between its handle and its foot for itself."""
    (x, y, z), (a, b, c) = ((low + high) / 2).tolist(), (high - low).tolist()
    return compile_geometry((CollisionShape(size=(a, b, c), pose=Pose((x, y, z))),))


def _grid_poses(surface: PlacementSurface, low: Array, high: Array, quarter: int) -> Array:
    """Poses all over a place, so many quarters of a turn round, for a body that reaches from low to high."""
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


def make_body(simulation: EngineSession, cls: str, *, id: str | None = None, size: Vector | None = None) -> Body:
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
    simulation: EngineSession, body: Body, geometry: BodyGeometry | None, *, support_id: str, inside: bool
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
    simulation: EngineSession,
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


def _enclosing_body_ids(simulation: EngineSession) -> frozenset[str]:
    """What encloses the place, and so is in nobody's way."""
    return frozenset(id for report in simulation.reports for id in report.ids_with_note(SpawnNoteKind.ENCLOSURE))


def _sample_poses(poses: list[Pose], count: int) -> Iterator[Pose]:
    """The best spot, and then some from all over the rest: where one does not hold, its neighbor hardly does."""
    if not poses or count <= 0:
        return
    rows = np.unique(np.linspace(0, len(poses) - 1, count).astype(int))
    yield from (poses[row] for row in rows.tolist())


# -- whether it stays --------------------------------------------------------------------------------------------------


def _try_placement(simulation: EngineSession, body: Body, geometry: BodyGeometry | None) -> Pose | None:
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
