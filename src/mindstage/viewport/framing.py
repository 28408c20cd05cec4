"""Framing: where one stands to see a place for the first time.

The furniture fills the picture, not the shells round it, however wide or narrow the picture is. Of all directions the
one is taken from which most of it can be seen, so that fronts and handles face the visitor and tall cabinets do not
stand in the way.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.viewport.looks import Look, Part
from mindstage.world import BodyId, Vector, World
from mindstage.world.geometry import Array, pose_array, rotation_matrix, unit

__all__ = ["Outlook", "View", "corners", "first_outlook", "first_view", "focus_view", "ground_height"]

_FIELD_OF_VIEW_RAD = np.radians(36.0)
_ELEVATION_RAD = np.radians(33.0)
_UPRIGHT_ELEVATION_RAD = np.radians(50.0)
"""In a picture that is higher than wide: from farther up a floor is higher too."""
_STEEPEST_RAD = np.radians(89.5)
"""Straight down no side would be up."""
_DIRECTIONS = 24
_ASPECT = 1.25
"""Of a picture, until the visitor's is known: its width by its height."""
_MURK_M = 0.15
"""So much of other bodies in between dims what is behind by a factor of e."""
_SLANT_COUNTS = 0.2
"""A view across the corner shows a room better than one straight at a wall, if not much less is seen."""
_SEEN = 160
"""So many bodies, evenly picked, are looked at from each direction."""
_MARGIN = 1.2
_BLOCKERS = 200
"""So many of the largest bodies are taken to hide others."""
_CLOSE_M = 0.4


class View(msgspec.Struct, frozen=True):
    """A camera."""

    position: Vector
    look_at: Vector
    field_of_view_rad: float
    """From the lower to the upper edge of the picture."""


class Outlook(msgspec.Struct, frozen=True, eq=False):
    """What shall be seen, and from which direction: the view of a visitor follows from the shape of the window."""

    points: Array
    """Corners of all that shall be seen, n x 3 [m]."""
    azimuth_rad: float
    """Of the eye, seen from the middle."""
    grain_rad: float = 0.0
    """How walls and furniture are turned, up to quarter turns."""

    def view(self, aspect: float = _ASPECT) -> View:
        """The camera.

        Args:
            aspect: the picture's width by its height.
        """
        elevation = _ELEVATION_RAD if aspect >= 1.0 else _UPRIGHT_ELEVATION_RAD
        return _view(self.points, _away(self.azimuth_rad, elevation), aspect)

    def top(self, aspect: float = _ASPECT) -> View:
        """The same from straight above, as on a plan: walls are level or upright, whichever fills the picture."""
        quarter = np.pi / 2
        nearest = np.floor((self.azimuth_rad - self.grain_rad) / quarter)
        ways = (self.grain_rad + quarter * (nearest + step) for step in (0, 1))
        views = [_view(self.points, _away(way, _STEEPEST_RAD), aspect) for way in ways]
        return min(views, key=lambda view: round(view.position[2], 6))


def corners(poses: Array, sizes: Array) -> Array:
    """The corners of bodies, 8 n x 3 [m].

    Args:
        poses: n x 7.
        sizes: n x 3 [m].
    """
    signs = np.indices((2, 2, 2)).reshape(3, -1).T - 0.5
    own = signs[None] * sizes[:, None]
    turned: Array = np.einsum("nij,nkj->nki", rotation_matrix(unit(poses[:, 3:])), own) + poses[:, None, :3]
    return turned.reshape(-1, 3)


def focus_view(points: Array, eye: Vector, look_at: Vector, aspect: float = _ASPECT) -> View:
    """All of some points, seen from the side from which one looks already.

    Args:
        points: n x 3 [m].
        eye: where the camera is [m].
        look_at: where it looks [m].
        aspect: the picture's width by its height.
    """
    away = np.subtract(eye, look_at)
    length = float(np.linalg.norm(away))
    away = away / length if length > 1e-6 else _away(0.0, _ELEVATION_RAD)
    if float(np.hypot(away[0], away[1])) < float(np.cos(_STEEPEST_RAD)):
        away = _away(float(np.arctan2(away[1], away[0])), _STEEPEST_RAD)
    return _view(points, away, aspect)


def first_view(world: World, looks: Mapping[BodyId, Look], *, aspect: float = _ASPECT) -> View:
    """Where visitors stand first, in a world as it is described."""
    return first_outlook(world, looks).view(aspect)


def first_outlook(world: World, looks: Mapping[BodyId, Look]) -> Outlook:
    """Finds what to look at first, and from where.

    What moves, and what that is joined to, is what people come for; a place where nothing moves is shown whole.
    """
    bodies = [body for body in world.bodies if body.id in looks]
    seen = [looks[body.id] for body in bodies]
    ends = {end for joint in world.constraints for end in (joint.parent, joint.child)}
    ends |= {end for hold in world.attachments for end in (hold.parent, hold.child)}
    furniture = np.array([not look.building and look.part is Part.WHOLE for look in seen], dtype=bool)
    lively = np.array([body.id in ends or body.physics.simulates for body in bodies], dtype=bool) & furniture
    solid = np.array([look.part is Part.WHOLE and look.opaque for look in seen], dtype=bool)
    sizes = np.array([look.size for look in seen], dtype=float).reshape(-1, 3)
    poses = pose_array(body.pose for body in bodies)
    return _outlook(poses, sizes, lively if lively.any() else furniture, solid)


def ground_height(world: World, looks: Mapping[BodyId, Look]) -> float | None:
    """Where a ground has to be drawn, under everything; None where the place has a floor [m]."""
    if any(look.floor for look in looks.values()):
        return None
    bodies = [body for body in world.bodies if body.id in looks and looks[body.id].part is not Part.OUTLINE]
    return min((body.pose.position[2] - looks[body.id].size[2] / 2 for body in bodies), default=0.0)


def _outlook(poses: Array, sizes: Array, things: NDArray[np.bool_], blockers: NDArray[np.bool_]) -> Outlook:
    """Finds the direction.

    Args:
        poses: of all bodies, n x 7.
        sizes: of all bodies, n x 3 [m].
        things: which of them shall be seen; where it is none, all.
        blockers: which of them hide what is behind them.
    """
    if len(poses) == 0:
        return Outlook(np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]]), -np.pi / 4)
    if not things.any():
        things = np.ones(len(poses), dtype=bool)
    turn = rotation_matrix(unit(poses[:, 3:]))
    rows = _crowd(poses[things, :3], np.flatnonzero(things))
    points = corners(poses[rows], sizes[rows])
    seen = rows[np.linspace(0, len(rows) - 1, min(len(rows), _SEEN)).astype(int)]
    hiding = np.flatnonzero(blockers)
    hiding = hiding[np.argsort(-np.prod(sizes[hiding], axis=1))[:_BLOCKERS]]
    azimuths = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
    eyes = [np.array(Outlook(points, float(azimuth)).view().position) for azimuth in azimuths]
    visible = np.array([_visible(eye, poses, sizes, turn, seen, hiding) for eye in eyes])
    grain = _grain(turn[rows])
    slant = np.abs(np.sin(2 * (azimuths - grain)))
    # Rounded, so that of two views that are equally good it is always the first.
    best = int(np.argmax(np.round(visible * (1.0 + _SLANT_COUNTS * slant), 6)))
    return Outlook(points, float(azimuths[best]), grain)


def _crowd(centres: Array, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """The rows without those that stand far from all the others: one lost poster shall not shrink the kitchen."""
    middle = np.median(centres, axis=0)
    distance = np.linalg.norm(centres - middle, axis=1)
    near: NDArray[np.bool_] = distance <= 3.0 * max(float(np.median(distance)), _CLOSE_M)
    return rows[near]


def _grain(turn: Array) -> float:
    """How the furniture is turned about the vertical, up to a quarter turn [rad]."""
    yaw = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    return float(np.angle(np.exp(4j * yaw).sum())) / 4


def _away(azimuth: float, elevation: float) -> Array:
    """The direction from the middle to the eye."""
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def _view(points: Array, away: Array, aspect: float) -> View:
    """From a direction, as near as all points allow, and with as much beside them on each side."""
    right = np.cross([0.0, 0.0, 1.0], away)
    right /= np.linalg.norm(right)
    up = np.cross(away, right)
    # Across, upwards and towards the eye.
    seen = (points - points[0]) @ np.stack([right, up, away], axis=1)
    tangents = np.tan(_FIELD_OF_VIEW_RAD / 2) * np.array([aspect, 1.0]) / _MARGIN
    # A line of sight along each edge of the picture touches the points; two such lines meet where the eye has to be.
    most = np.max(seen[:, :2] + seen[:, 2:] * tangents, axis=0)
    least = np.min(seen[:, :2] - seen[:, 2:] * tangents, axis=0)
    depth = float(np.max((most - least) / (2 * tangents)))
    nearest = float(seen[:, 2].max()) + _CLOSE_M
    depth = max(depth, nearest)
    across, upwards = ((most + least) / 2).tolist()
    eye = points[0] + across * right + upwards * up + depth * away
    middle = float(np.median(seen[:, 2]))
    return View(_vector(eye), _vector(eye - max(depth - middle, _CLOSE_M) * away), float(_FIELD_OF_VIEW_RAD))


def _visible(
    eye: Array, poses: Array, sizes: Array, turn: Array, seen: NDArray[np.intp], blockers: NDArray[np.intp]
) -> float:
    """How much of the bodies can be seen: each counts one, less what stands between it and the eye."""
    through = np.zeros(len(seen))
    for blocker in blockers:
        start = (eye - poses[blocker, :3]) @ turn[blocker]
        path = (poses[seen, :3] - poses[blocker, :3]) @ turn[blocker] - start
        with np.errstate(divide="ignore", invalid="ignore"):
            enter, leave = (-sizes[blocker] / 2 - start) / path, (sizes[blocker] / 2 - start) / path
        first = np.nanmax(np.minimum(enter, leave), axis=1)
        last = np.nanmin(np.maximum(enter, leave), axis=1)
        inside = np.clip(np.minimum(last, 1.0) - np.maximum(first, 0.0), 0.0, 1.0) * np.linalg.norm(path, axis=1)
        through += np.where(seen == blocker, 0.0, inside)
    return float(np.exp(-through / _MURK_M).sum())


def _vector(array: Array) -> Vector:
    x, y, z = array.tolist()
    return x, y, z
