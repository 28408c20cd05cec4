"""Spots: where on a body, or in it, something can stand without standing in anything else.

A form tells its places: level rectangles. They are strewn with candidates, best ones first, and each candidate is held
against the solids of all that is near, many at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mindstage.engines.parts import Parts
from mindstage.engines.solids import Prepared, plain_solid, prepare
from mindstage.world import Body, BodyId, Form, Forms, Place, Pose, Solid, Vector
from mindstage.world.boxes import Boxes
from mindstage.world.geometry import Array, compose, multiply, pose_from, rotate, unit

__all__ = ["Crowd", "Holder", "places_of"]

_LEVEL = 0.985
"""Cosine of the steepest slope on which things are put: ten degrees."""
_GAP_M = 0.001
"""Between what is put down and what it is put on; it falls the rest."""
_MARGIN_M = 0.004
"""Between what is put down and the edge of its place."""
_FINEST_M = 0.02
_MOST = 625
"""So many candidates for each way round on one place."""
_ASSUMED_M: Vector = (0.1, 0.1, 0.1)


@dataclass(frozen=True, slots=True)
class Holder:
    """A place as it is now."""

    body: BodyId
    place: Place
    frame: Array
    """The pose of its middle in the world, z looking up; x and y along the place's own sides."""
    size: tuple[float, float]


def places_of(body: Body, form: Form | None, pose: Array, *, inside: bool) -> Iterator[Holder]:
    """The places of a body that look up now.

    Args:
        body: on which, or in which.
        form: what it is made of; without one it is a box, with its top as the only place.
        pose: where it is, seven numbers.
        inside: whether places in it are wanted, or places on it.
    """
    here = np.concatenate([pose[:3], unit(pose[3:])])
    known = form.places if form is not None else ()
    places = [place for place in known if place.inside is inside]
    if not inside and not known:
        places = list(_faces(body))
    for place in places:
        if rotate(here[3:], place.up)[2] >= _LEVEL:
            yield _holder(body.id, place, here)


def _faces(body: Body) -> Iterator[Place]:
    """The six sides of a box."""
    size = body.size or _ASSUMED_M
    for axis in range(3):
        across = [other for other in range(3) if other != axis]
        for sign in (1.0, -1.0):
            up, centre = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
            up[axis], centre[axis] = sign, sign * size[axis] / 2
            extent = (size[across[0]], size[across[1]])
            yield Place(centre=(centre[0], centre[1], centre[2]), size=extent, up=(up[0], up[1], up[2]))


def _holder(id: BodyId, place: Place, here: Array) -> Holder:
    along = np.eye(3)[next(axis for axis in range(3) if axis != np.argmax(np.abs(place.up)))]
    x = rotate(here[3:], along)
    yaw = float(np.arctan2(x[1], x[0]))
    middle = here[:3] + rotate(here[3:], place.centre)
    frame = np.array([*middle, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
    return Holder(id, place, frame, place.size)


class Crowd:
    """All that stands somewhere now, to be held against what shall join it."""

    def __init__(
        self, bodies: Mapping[BodyId, Body], forms: Forms, ids: Sequence[BodyId], poses: Array, ghosts: frozenset[str]
    ) -> None:
        """Makes ready what can be in the way.

        Args:
            bodies: as they are described.
            forms: what they are made of.
            ids: of all that stand there.
            poses: theirs, n x 7.
            ghosts: those that collide with nothing.
        """
        rows = [row for row, id in enumerate(ids) if id in bodies and id not in ghosts]
        self._poses = np.concatenate([poses[rows, :3], unit(poses[rows, 3:])], axis=1) if rows else np.zeros((0, 7))
        made: dict[object, Prepared] = {}
        self._prepared = [_prepared(bodies[ids[row]], forms.get(ids[row]), made) for row in rows]
        corners = [each.bounds for each in self._prepared]
        low, high = (np.array([pair[end] for pair in corners]).reshape(-1, 3) for end in (0, 1))
        middles = self._poses.copy()
        if rows:
            middles[:, :3] += rotate(self._poses[:, 3:], (low + high) / 2)
        self._low, self._high = Boxes.of(middles, high - low).bounds()

    def spots(self, body: Body, form: Form | None, holder: Holder) -> tuple[list[Pose], str]:
        """Where on a place a body can stand, best first; none, and why, where it cannot."""
        low, high = _prepared(body, form, {}).bounds
        if holder.place.height is not None and high[2] - low[2] > holder.place.height:
            return [], f"it is {high[2] - low[2]:.2f} m high, and there is room for {holder.place.height:.2f} m"
        candidates = np.concatenate([_strewn(holder, low, high, quarter) for quarter in (0, 1)])
        if not len(candidates):
            return [], "it is larger than the place"
        order = np.argsort(np.linalg.norm(candidates[:, :3] - holder.frame[:3], axis=1), kind="stable")
        candidates = candidates[order]
        free = self._free(_box_round(low, high), candidates)
        why = "" if free.any() else "something stands there already"
        return [pose_from(row) for row in candidates[free]], why

    def _free(self, prepared: Prepared, candidates: Array) -> Array:
        reach = float(np.linalg.norm(np.maximum(np.abs(prepared.bounds[0]), np.abs(prepared.bounds[1]))))
        low, high = candidates[:, :3].min(axis=0) - reach, candidates[:, :3].max(axis=0) + reach
        near = np.flatnonzero(np.all((self._low <= high) & (self._high >= low), axis=1))
        count = len(candidates)
        if not len(near):
            return np.ones(count, dtype=bool)
        parts = Parts.of(
            np.concatenate([candidates, self._poses[near]]), [prepared] * count + [self._prepared[row] for row in near]
        )
        centre = candidates[:, None, :3]
        meet = np.all((centre - reach <= self._high[near]) & (self._low[near] <= centre + reach), axis=2)
        a, b = np.nonzero(meet)
        deep = parts.depths(a, b + count, np.full(len(a), np.inf)) > 0.0
        return np.asarray(np.bincount(a[deep], minlength=count) == 0)


def _prepared(body: Body, form: Form | None, made: dict[object, Prepared]) -> Prepared:
    key: object = form.key if form is not None else (body.shape, body.size)
    if key not in made:
        made[key] = prepare(form.solids if form is not None else (plain_solid(body, body.size or _ASSUMED_M),))
    return made[key]


def _box_round(low: Array, high: Array) -> Prepared:
    """What a thing takes up: it may as well have the room between its handle and its foot for itself."""
    (x, y, z), (a, b, c) = ((low + high) / 2).tolist(), (high - low).tolist()
    return prepare((Solid(size=(a, b, c), pose=Pose((x, y, z))),))


def _strewn(holder: Holder, low: Array, high: Array, quarter: int) -> Array:
    """Poses all over a place, so many quarters of a turn round, for a body that reaches from low to high."""
    turn = np.array([np.cos(quarter * np.pi / 4), 0.0, 0.0, np.sin(quarter * np.pi / 4)])
    corners = rotate(turn, np.array([low, high]))
    least, most = corners.min(axis=0), corners.max(axis=0)
    room = np.array(holder.size) - (most - least)[:2] - 2 * _MARGIN_M
    if (room < 0.0).any():
        return np.zeros((0, 7))
    finest = max(_FINEST_M, float(np.sqrt(room.prod() / _MOST)))
    steps = [np.linspace(-extent / 2, extent / 2, 2 * int(extent / finest / 2) + 1) for extent in room]
    x, y = np.meshgrid(*steps, indexing="ij")
    offset = -(least + most)[:2] / 2
    local = np.zeros((x.size, 7))
    local[:, 0], local[:, 1] = x.reshape(-1) + offset[0], y.reshape(-1) + offset[1]
    local[:, 2] = _GAP_M - least[2]
    local[:, 3:] = turn
    placed = compose(np.tile(holder.frame, (len(local), 1)), local)
    placed[:, 3:] = unit(multiply(holder.frame[3:], local[:, 3:]))
    return placed
