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

from mindstage.viewport.looks import BodyAppearance, VisiblePart
from mindstage.world import BodyId, Vector, World
from mindstage.world.geometry import Array, normalize, pose_array, rotation_matrix

__all__ = [
    "CameraPose",
    "FramingTarget",
    "corners",
    "focus_camera",
    "ground_height",
    "initial_camera",
    "initial_target",
]

_FIELD_OF_VIEW_RAD = np.radians(36.0)
_ELEVATION_RAD = np.radians(33.0)
_UPRIGHT_ELEVATION_RAD = np.radians(50.0)
"""In a picture that is higher than wide: from farther up a floor is higher too."""
_MAX_ELEVATION_RAD = np.radians(89.5)
"""Straight down no side would be up."""
_DIRECTIONS = 24
_ASPECT = 1.25
"""Of a picture, until the visitor's is known: its width by its height."""
_OCCLUSION_LENGTH_M = 0.15
"""So much of other bodies in between dims what is behind by a factor of e."""
_DIAGONAL_BONUS = 0.2
"""A view across the corner shows a room better than one straight at a wall, if not much less is seen."""
_MAX_SAMPLED_BODIES = 160
"""So many bodies, evenly picked, are looked at from each direction."""
_MARGIN = 1.2
_MAX_OCCLUDERS = 200
"""So many of the largest bodies are taken to hide others."""
_MIN_DISTANCE_M = 0.4


class CameraPose(msgspec.Struct, frozen=True):
    """A camera."""

    position: Vector
    look_at: Vector
    field_of_view_rad: float
    """From the lower to the upper edge of the picture."""


class FramingTarget(msgspec.Struct, frozen=True, eq=False):
    """What shall be seen, and from which direction: the view of a visitor follows from the shape of the window."""

    points: Array
    """Corners of all that shall be seen, n x 3 [m]."""
    azimuth_rad: float
    """Of the eye, seen from the middle."""
    alignment_rad: float = 0.0
    """How walls and furniture are turned, up to quarter turns."""

    def camera(self, aspect: float = _ASPECT) -> CameraPose:
        """The camera.

        Args:
            aspect: the picture's width by its height.
        """
        elevation = _ELEVATION_RAD if aspect >= 1.0 else _UPRIGHT_ELEVATION_RAD
        return _fit_camera(self.points, _view_direction(self.azimuth_rad, elevation), aspect)

    def top_camera(self, aspect: float = _ASPECT) -> CameraPose:
        """The same from straight above, as on a plan: walls are level or upright, whichever fills the picture."""
        quarter = np.pi / 2
        nearest = np.floor((self.azimuth_rad - self.alignment_rad) / quarter)
        ways = (self.alignment_rad + quarter * (nearest + step) for step in (0, 1))
        views = [_fit_camera(self.points, _view_direction(way, _MAX_ELEVATION_RAD), aspect) for way in ways]
        return min(views, key=lambda view: round(view.position[2], 6))


def corners(poses: Array, sizes: Array) -> Array:
    """The corners of bodies, 8 n x 3 [m].

    Args:
        poses: n x 7.
        sizes: n x 3 [m].
    """
    signs = np.indices((2, 2, 2)).reshape(3, -1).T - 0.5
    own = signs[None] * sizes[:, None]
    turned: Array = np.einsum("nij,nkj->nki", rotation_matrix(normalize(poses[:, 3:])), own) + poses[:, None, :3]
    return turned.reshape(-1, 3)


def focus_camera(points: Array, eye: Vector, look_at: Vector, aspect: float = _ASPECT) -> CameraPose:
    """All of some points, seen from the side from which one looks already.

    Args:
        points: n x 3 [m].
        eye: where the camera is [m].
        look_at: where it looks [m].
        aspect: the picture's width by its height.
    """
    away = np.subtract(eye, look_at)
    length = float(np.linalg.norm(away))
    away = away / length if length > 1e-6 else _view_direction(0.0, _ELEVATION_RAD)
    if float(np.hypot(away[0], away[1])) < float(np.cos(_MAX_ELEVATION_RAD)):
        away = _view_direction(float(np.arctan2(away[1], away[0])), _MAX_ELEVATION_RAD)
    return _fit_camera(points, away, aspect)


def initial_camera(
    world: World, appearances: Mapping[BodyId, BodyAppearance], *, aspect: float = _ASPECT
) -> CameraPose:
    """Where visitors stand first, in a world as it is described."""
    return initial_target(world, appearances).camera(aspect)


def initial_target(world: World, appearances: Mapping[BodyId, BodyAppearance]) -> FramingTarget:
    """Finds what to look at first, and from where.

    What moves, and what that is joined to, is what people come for; a place where nothing moves is shown whole.
    """
    bodies = [body for body in world.bodies if body.id in appearances]
    seen = [appearances[body.id] for body in bodies]
    ends = {end for joint in world.joints for end in (joint.parent, joint.child)}
    ends |= {end for hold in world.attachments for end in (hold.parent, hold.child)}
    furniture = np.array([not look.is_building and look.part is VisiblePart.WHOLE for look in seen], dtype=bool)
    lively = np.array([body.id in ends or body.physics.is_dynamic for body in bodies], dtype=bool) & furniture
    solid = np.array([look.part is VisiblePart.WHOLE and look.is_opaque for look in seen], dtype=bool)
    sizes = np.array([look.size for look in seen], dtype=float).reshape(-1, 3)
    poses = pose_array(body.pose for body in bodies)
    return _find_target(poses, sizes, lively if lively.any() else furniture, solid)


def ground_height(world: World, appearances: Mapping[BodyId, BodyAppearance]) -> float | None:
    """Where a ground has to be drawn, under everything; None where the place has a floor [m]."""
    if any(look.is_floor for look in appearances.values()):
        return None
    bodies = [
        body for body in world.bodies if body.id in appearances and appearances[body.id].part is not VisiblePart.OUTLINE
    ]
    return min((body.pose.position[2] - appearances[body.id].size[2] / 2 for body in bodies), default=0.0)


def _find_target(
    poses: Array, sizes: Array, body_mask: NDArray[np.bool_], occluders: NDArray[np.bool_]
) -> FramingTarget:
    """Finds the direction.

    Args:
        poses: of all bodies, n x 7.
        sizes: of all bodies, n x 3 [m].
        things: which of them shall be seen; where it is none, all.
        blockers: which of them hide what is behind them.
    """
    if len(poses) == 0:
        return FramingTarget(np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]]), -np.pi / 4)
    if not body_mask.any():
        body_mask = np.ones(len(poses), dtype=bool)
    turn = rotation_matrix(normalize(poses[:, 3:]))
    rows = _without_outliers(poses[body_mask, :3], np.flatnonzero(body_mask))
    points = corners(poses[rows], sizes[rows])
    seen = rows[np.linspace(0, len(rows) - 1, min(len(rows), _MAX_SAMPLED_BODIES)).astype(int)]
    hiding = np.flatnonzero(occluders)
    hiding = hiding[np.argsort(-np.prod(sizes[hiding], axis=1))[:_MAX_OCCLUDERS]]
    azimuths = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
    eyes = [np.array(FramingTarget(points, float(azimuth)).camera().position) for azimuth in azimuths]
    visible = np.array([_visibility(eye, poses, sizes, turn, seen, hiding) for eye in eyes])
    grain = _alignment(turn[rows])
    slant = np.abs(np.sin(2 * (azimuths - grain)))
    # Rounded, so that of two views that are equally good it is always the first.
    best = int(np.argmax(np.round(visible * (1.0 + _DIAGONAL_BONUS * slant), 6)))
    return FramingTarget(points, float(azimuths[best]), grain)


def _without_outliers(centers: Array, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """The rows without those that stand far from all the others: one lost poster shall not shrink the kitchen."""
    middle = np.median(centers, axis=0)
    distance = np.linalg.norm(centers - middle, axis=1)
    near: NDArray[np.bool_] = distance <= 3.0 * max(float(np.median(distance)), _MIN_DISTANCE_M)
    return rows[near]


def _alignment(rotations: Array) -> float:
    """How the furniture is turned about the vertical, up to a quarter turn [rad]."""
    yaw = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])
    return float(np.angle(np.exp(4j * yaw).sum())) / 4


def _view_direction(azimuth: float, elevation: float) -> Array:
    """The direction from the middle to the eye."""
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def _fit_camera(points: Array, direction: Array, aspect: float) -> CameraPose:
    """From a direction, as near as all points allow, and with as much beside them on each side."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    up = np.cross(direction, right)
    # Across, upwards and towards the eye.
    seen = (points - points[0]) @ np.stack([right, up, direction], axis=1)
    tangents = np.tan(_FIELD_OF_VIEW_RAD / 2) * np.array([aspect, 1.0]) / _MARGIN
    # A line of sight along each edge of the picture touches the points; two such lines meet where the eye has to be.
    most = np.max(seen[:, :2] + seen[:, 2:] * tangents, axis=0)
    least = np.min(seen[:, :2] - seen[:, 2:] * tangents, axis=0)
    depth = float(np.max((most - least) / (2 * tangents)))
    nearest = float(seen[:, 2].max()) + _MIN_DISTANCE_M
    depth = max(depth, nearest)
    across, upwards = ((most + least) / 2).tolist()
    eye = points[0] + across * right + upwards * up + depth * direction
    middle = float(np.median(seen[:, 2]))
    return CameraPose(
        _to_vector(eye), _to_vector(eye - max(depth - middle, _MIN_DISTANCE_M) * direction), float(_FIELD_OF_VIEW_RAD)
    )


def _visibility(
    eye: Array, poses: Array, sizes: Array, rotations: Array, sampled: NDArray[np.intp], occluders: NDArray[np.intp]
) -> float:
    """How much of the bodies can be seen: each counts one, less what stands between it and the eye."""
    through = np.zeros(len(sampled))
    for blocker in occluders:
        start = (eye - poses[blocker, :3]) @ rotations[blocker]
        path = (poses[sampled, :3] - poses[blocker, :3]) @ rotations[blocker] - start
        with np.errstate(divide="ignore", invalid="ignore"):
            enter, leave = (-sizes[blocker] / 2 - start) / path, (sizes[blocker] / 2 - start) / path
        first = np.nanmax(np.minimum(enter, leave), axis=1)
        last = np.nanmin(np.maximum(enter, leave), axis=1)
        inside = np.clip(np.minimum(last, 1.0) - np.maximum(first, 0.0), 0.0, 1.0) * np.linalg.norm(path, axis=1)
        through += np.where(sampled == blocker, 0.0, inside)
    return float(np.exp(-through / _OCCLUSION_LENGTH_M).sum())


def _to_vector(array: Array) -> Vector:
    x, y, z = array.tolist()
    return x, y, z
