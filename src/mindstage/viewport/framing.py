"""Framing: where one stands to see a place for the first time.

The furniture fills the picture, not the shells round it; of all directions the one is taken from which most of it
can be seen, so that fronts and handles face the visitor and tall cabinets do not stand in the way.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.viewport.looks import Form, Look
from mindstage.world import BodyId, Vector, World
from mindstage.world.geometry import Array, pose_array, rotation_matrix, unit

__all__ = ["View", "first_view", "frame_view", "ground_height"]

_FIELD_OF_VIEW_RAD = np.radians(42.0)
_ELEVATION_RAD = np.radians(33.0)
_DIRECTIONS = 24
_ASPECT = 1.15
"""Of the part of the picture that no panel covers."""
_MURK_M = 0.15
"""So much of other bodies in between dims what is behind by a factor of e."""
_SLANT_COUNTS = 0.2
"""A view across the corner shows a room better than one straight at a wall, if not much less is seen."""
_SEEN = 160
"""So many bodies, evenly picked, are looked at from each direction."""
_MARGIN = 1.08
_BLOCKERS = 200
"""So many of the largest bodies are taken to hide others."""
_CLOSE_M = 0.4


class View(msgspec.Struct, frozen=True):
    """A camera."""

    position: Vector
    look_at: Vector
    field_of_view_rad: float
    """From the lower to the upper edge of the picture."""


def first_view(world: World, looks: Mapping[BodyId, Look]) -> View:
    """Finds the view on a world as it is described.

    What moves, and what that is joined to, is what people come for; a place where nothing moves is shown whole.
    """
    bodies = [body for body in world.bodies if body.id in looks]
    seen = [looks[body.id] for body in bodies]
    ends = {end for joint in world.constraints for end in (joint.parent, joint.child)}
    ends |= {end for hold in world.attachments for end in (hold.parent, hold.child)}
    furniture = np.array([not (look.building or look.form is Form.INSIDE) for look in seen], dtype=bool)
    lively = np.array([body.id in ends or body.physics.simulates for body in bodies], dtype=bool) & furniture
    solid = np.array([_hides(look) for look in seen], dtype=bool)
    sizes = np.array([look.size for look in seen], dtype=float).reshape(-1, 3)
    poses = pose_array(body.pose for body in bodies)
    return frame_view(poses, sizes, lively if lively.any() else furniture, solid)


def ground_height(world: World, looks: Mapping[BodyId, Look]) -> float | None:
    """Where a ground has to be drawn, under everything; None where the place has a floor [m]."""
    if any(look.floor for look in looks.values()):
        return None
    bodies = [body for body in world.bodies if body.id in looks and looks[body.id].form is not Form.OUTLINE]
    return min((body.pose.position[2] - looks[body.id].size[2] / 2 for body in bodies), default=0.0)


def _hides(look: Look) -> bool:
    return look.form not in (Form.OUTLINE, Form.INSIDE) and look.paint.opacity > 0.6


def frame_view(poses: Array, sizes: Array, things: NDArray[np.bool_], blockers: NDArray[np.bool_]) -> View:
    """Finds the view.

    Args:
        poses: of all bodies, n x 7.
        sizes: of all bodies, n x 3 [m].
        things: which of them shall be seen; where it is none, all.
        blockers: which of them hide what is behind them.
    """
    if len(poses) == 0:
        return View((2.5, -2.5, 2.0), (0.0, 0.0, 0.5), _FIELD_OF_VIEW_RAD)
    if not things.any():
        things = np.ones(len(poses), dtype=bool)
    turn = rotation_matrix(unit(poses[:, 3:]))
    reach = np.einsum("nij,nj->ni", np.abs(turn), sizes / 2)
    rows = _crowd(poses[things, :3], np.flatnonzero(things))
    low = (poses[rows, :3] - reach[rows]).min(axis=0)
    high = (poses[rows, :3] + reach[rows]).max(axis=0)
    middle = (low + high) / 2
    corners = np.where(np.indices((2, 2, 2)).reshape(3, -1).T > 0, high, low) - middle
    seen = rows[np.linspace(0, len(rows) - 1, min(len(rows), _SEEN)).astype(int)]
    hiding = np.flatnonzero(blockers)
    hiding = hiding[np.argsort(-np.prod(sizes[hiding], axis=1))[:_BLOCKERS]]
    azimuths = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
    eyes = [middle + away * _distance(corners, away) for away in map(_away, azimuths)]
    visible = np.array([_visible(eye, poses, sizes, turn, seen, hiding) for eye in eyes])
    slant = np.abs(np.sin(2 * (azimuths - _grain(turn[rows]))))
    # Rounded, so that of two views that are equally good it is always the first.
    best = int(np.argmax(np.round(visible * (1.0 + _SLANT_COUNTS * slant), 6)))
    return View(_vector(eyes[best]), _vector(middle), _FIELD_OF_VIEW_RAD)


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


def _away(azimuth: float) -> Array:
    """The direction from the middle to the eye."""
    flat = np.cos(_ELEVATION_RAD)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(_ELEVATION_RAD)])


def _distance(corners: Array, away: Array) -> float:
    """How far the eye has to be for all corners to be in the picture."""
    right = np.cross([0.0, 0.0, 1.0], away)
    right /= np.linalg.norm(right)
    up = np.cross(away, right)
    tangent = np.tan(_FIELD_OF_VIEW_RAD / 2)
    across = np.maximum(np.abs(corners @ right) / (tangent * _ASPECT), np.abs(corners @ up) / tangent)
    return max(float(np.max(across + corners @ away)) * _MARGIN, _CLOSE_M)


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
