"""Cameras: how a pose is chosen from which a world is seen well.

The initial camera frames the furniture rather than the building, from the direction in which most of it is visible, for
windows of any aspect ratio.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.ranges import Angle, Factor, FieldOfView, Finite, Point, check_fields, checked
from mindstage.rendering.appearance import BodyAppearance, VisiblePart
from mindstage.scene import BodyId, Vector, World
from mindstage.scene.transforms import (
    Array,
    normalize,
    pose_array,
    rotation_matrix,
)

__all__ = [
    "CameraPose",
    "FramingTarget",
    "ViewFrame",
    "corners",
    "find_occluders",
    "focus_camera",
    "ground_height",
    "initial_camera",
    "initial_target",
]


_FIELD_OF_VIEW_RAD = np.radians(36.0)
_ELEVATION_RAD = np.radians(26.0)
_UPRIGHT_LENS_ELEVATION_RAD = np.radians(21.0)
"""Elevation of a camera with a shifted lens: a steeper view would stretch what is near the lower edge."""
_UPRIGHT_ELEVATION_RAD = np.radians(50.0)
"""Elevation in a portrait window, where a steeper view makes the floor fill the height."""
_MAX_ELEVATION_RAD = np.radians(89.5)
"""At 90 degrees the up direction would be undefined."""
_DIRECTIONS = 24
_ASPECT = 1.25
"""Aspect ratio (width / height) until that of the client is known."""
_OCCLUSION_LENGTH_M = 0.15
"""Length of occluding bodies on a line of sight that reduces the visibility by a factor of e."""
_DIAGONAL_BONUS = 0.2
"""Bonus of a direction diagonal to the walls over one perpendicular to a wall."""
_MAX_SAMPLED_BODIES = 160
"""Number of bodies, sampled evenly, whose visibility is computed."""
_MARGIN_FACTOR = 1.12
_SHIFTED_MARGIN_FACTOR = 1.15
_MAX_OCCLUDERS = 200
"""Number of the largest bodies that count as occluders."""
_MIN_DISTANCE_M = 0.4
_MIN_SPREAD_M = 2.0
"""Bodies of a room may be three times as far from its middle, however near to each other most of them are [m]."""
_SURROUNDINGS_M = (0.5, 0.6)
"""How much of the walls beside and above the bodies is shown [m]."""
_SURROUNDINGS_PART = 0.15
"""The same as a part of the extent of the bodies, if that is less."""
_MAX_WIDER = 1.25
"""How much farther the camera may be for the sake of the surroundings."""
_WALLS_M = 0.3
"""Space for walls around the furniture on a floor plan [m]."""


class CameraPose(msgspec.Struct, frozen=True):
    """The pose and field of view of a camera."""

    position: Point
    look_at: Point
    field_of_view_rad: FieldOfView
    """Vertical field of view."""
    vertical_shift: Finite = 0.0
    """Shift of the lens: how far the point that the axis of the camera meets is above the center of the picture, as a
    part of its height. A camera whose axis is horizontal keeps vertical edges vertical, and the shift selects the part
    of the scene that is seen."""

    def __post_init__(self) -> None:
        check_fields(self)


class ViewFrame:
    """The frame and the image plane of a camera."""

    def __init__(self, camera: CameraPose, size: tuple[int, int]) -> None:
        """Computes the axes of the camera.

        Args:
            size: width and height of the picture [px].
        """
        self.width, self.height = size
        self.eye = np.array(camera.position, dtype=float)
        forward = np.array(camera.look_at, dtype=float) - self.eye
        self.forward = forward / max(float(np.linalg.norm(forward)), 1e-9)
        right = np.cross(self.forward, [0.0, 0.0, 1.0])
        if float(np.linalg.norm(right)) < 1e-6:  # straight down: the upper edge is north
            right = np.array([1.0, 0.0, 0.0])
        self.right = right / np.linalg.norm(right)
        self.up = np.cross(self.right, self.forward)
        half = float(np.tan(camera.field_of_view_rad / 2))
        self.half_width = half * self.width / self.height
        middle = -2.0 * half * camera.vertical_shift
        self.bottom, self.top = middle - half, middle + half

    @property
    def rise(self) -> tuple[float, float]:
        """Heights of the lower and the upper edge of the picture at a distance of 1."""
        return self.bottom, self.top

    def ray_axes(self) -> Array:
        """Half the width of the picture at a distance of 1, to the right; the unit vectors up and forward: columns."""
        return np.stack([self.right * self.half_width, self.up, self.forward], axis=1)

    def clip_from_world(self, near: float, far: float) -> Array:
        """The projection of OpenGL, 4 x 4.

        Args:
            near: distance of the near plane [m].
            far: distance of the far plane [m].
        """
        camera_from_world = np.eye(4)
        camera_from_world[:3, :3] = np.stack([self.right, self.up, -self.forward])
        camera_from_world[:3, 3] = -camera_from_world[:3, :3] @ self.eye
        height = self.top - self.bottom
        projection = np.zeros((4, 4))
        projection[0, 0] = 1 / self.half_width
        projection[1, 1], projection[1, 2] = 2 / height, (self.top + self.bottom) / height
        projection[2, 2], projection[2, 3] = -(far + near) / (far - near), -2 * far * near / (far - near)
        projection[3, 2] = -1.0
        product: Array = projection @ camera_from_world
        return product

    def project(self, points: Array) -> Array:
        """Pixel coordinates (from the upper left corner) and depth [m] of points, n x 3.

        Args:
            points: n x 3 [m].
        """
        local = (points - self.eye) @ np.stack([self.right, self.up, self.forward], axis=1)
        depth = np.where(np.abs(local[:, 2]) < 1e-9, 1e-9, local[:, 2])
        x = (local[:, 0] / depth / self.half_width + 1) / 2 * self.width
        y = (1 - (local[:, 1] / depth - self.bottom) / (self.top - self.bottom)) * self.height
        return np.stack([x, y, local[:, 2]], axis=1)


class FramingTarget(msgspec.Struct, frozen=True, eq=False):
    """What the initial camera shows and from which direction; its pose depends on the aspect ratio of the window."""

    points: Array
    """Corners of the bodies to show, n x 3 [m]."""
    azimuth_rad: Angle
    """Direction of the camera from the center, about z."""
    alignment_rad: Angle = 0.0
    """Yaw of walls and furniture, modulo 90 degrees."""
    surroundings: Array | None = None
    """Points of the walls behind the bodies, and of what hangs there, n x 3 [m]; None for none."""

    def __post_init__(self) -> None:
        check_fields(self)

    @checked
    def camera(self, aspect: Factor = _ASPECT) -> CameraPose:
        """Returns the camera pose that shows all points.

        Args:
            aspect: the aspect ratio of the window (width / height).
        """
        elevation = _ELEVATION_RAD if aspect >= 1.0 else _UPRIGHT_ELEVATION_RAD
        return _fit_camera(self.points, _view_direction(self.azimuth_rad, elevation), aspect)

    @checked
    def upright_camera(self, aspect: Factor = _ASPECT) -> CameraPose:
        """Returns a camera pose with a horizontal axis and a shifted lens that shows all points.

        Vertical edges are vertical in the picture (two-point perspective), as in photographs of architecture.

        Args:
            aspect: the aspect ratio of the picture (width / height).
        """
        camera = _fit_shifted_camera(self.points, self.azimuth_rad, aspect)
        if self.surroundings is None:
            return camera
        wider = _fit_shifted_camera(np.concatenate([self.points, self.surroundings]), self.azimuth_rad, aspect)
        center = self.points.mean(axis=0)
        near, far = (float(np.linalg.norm(np.subtract(each.position, center))) for each in (camera, wider))
        return wider if far < _MAX_WIDER * near else camera

    @checked
    def top_camera(self, aspect: Factor = _ASPECT) -> CameraPose:
        """Returns the camera pose from above, with walls parallel to the edges of the window.

        Args:
            aspect: the aspect ratio of the window (width / height).
        """
        quarter = np.pi / 2
        nearest = np.floor((self.azimuth_rad - self.alignment_rad) / quarter)
        azimuths = (self.alignment_rad + quarter * (nearest + step) for step in (0, 1))
        around = np.array([_WALLS_M, _WALLS_M, 0.0])
        points = np.concatenate([self.points - around, self.points + around])
        poses = [_fit_camera(points, _view_direction(each, _MAX_ELEVATION_RAD), aspect) for each in azimuths]
        return min(poses, key=lambda pose: round(pose.position[2], 6))


def corners(poses: Array, sizes: Array) -> Array:
    """The corners of the boxes of bodies in the world frame, 8 n x 3 [m].

    Args:
        poses: poses, n x 7.
        sizes: extents, n x 3 [m].
    """
    signs = np.indices((2, 2, 2)).reshape(3, -1).T - 0.5
    local = signs[None] * sizes[:, None]
    rotation = rotation_matrix(normalize(poses[:, 3:]))
    in_world: Array = np.einsum("nij,nkj->nki", rotation, local) + poses[:, None, :3]
    return in_world.reshape(-1, 3)


def focus_camera(points: Array, eye: Vector, look_at: Vector, aspect: float = _ASPECT) -> CameraPose:
    """Returns the camera pose that shows all points from the current direction.

    Args:
        points: points to show, n x 3 [m].
        eye: current position of the camera [m].
        look_at: current target of the camera [m].
        aspect: the aspect ratio of the window (width / height).
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
    """Returns the initial camera pose for a world.

    Args:
        world: the world, with the poses of its description.
        appearances: how its bodies are drawn.
        aspect: the aspect ratio of the window (width / height).
    """
    return initial_target(world, appearances).camera(aspect)


def initial_target(world: World, appearances: Mapping[BodyId, BodyAppearance]) -> FramingTarget:
    """Chooses what the initial camera shows, and the direction.

    Shows all furniture and all things, from where most of the dynamic, jointed and attached bodies are visible.

    Args:
        world: the world, with the poses of its description.
        appearances: how its bodies are drawn.
    """
    bodies = [body for body in world.bodies if body.id in appearances]
    drawn = [appearances[body.id] for body in bodies]
    ends = {end for joint in world.joints for end in (joint.parent, joint.child)}
    ends |= {end for link in world.attachments for end in (link.parent, link.child)}
    furniture = np.array([not each.is_building and each.part is VisiblePart.WHOLE for each in drawn], dtype=bool)
    movable = np.array([body.id in ends or body.physics.is_dynamic for body in bodies], dtype=bool) & furniture
    opaque = np.array([each.part is VisiblePart.WHOLE and each.is_opaque for each in drawn], dtype=bool)
    sizes = np.array([each.size for each in drawn], dtype=float).reshape(-1, 3)
    poses = pose_array(body.pose for body in bodies)
    target = _find_target(poses, sizes, furniture, movable, opaque)
    return msgspec.structs.replace(target, surroundings=_surroundings(target, poses, sizes, drawn))


def _surroundings(target: FramingTarget, poses: Array, sizes: Array, drawn: Sequence[BodyAppearance]) -> Array | None:
    """Corners of the walls that face the camera, and of what hangs there, near the bodies that it shows."""
    extent = float(np.ptp(target.points, axis=0).max())
    beside, above = (min(each, _SURROUNDINGS_PART * extent) for each in _SURROUNDINGS_M)
    lowest = target.points.min(axis=0) - np.array([beside, beside, 0.0])
    highest = target.points.max(axis=0) + np.array([beside, beside, above])
    away, found = _view_direction(target.azimuth_rad, 0.0), []
    for row, each in enumerate(drawn):
        if each.side is None:
            continue
        axis, direction = each.side
        if float(rotation_matrix(normalize(poses[row : row + 1, 3:]))[0][:, axis] @ away) * direction < 0.1:
            continue  # it turns its back to the camera, or is a ceiling
        box = corners(poses[row : row + 1], sizes[row : row + 1])
        low, high = np.maximum(box.min(axis=0), lowest), np.minimum(box.max(axis=0), highest)
        if np.all(low < high):
            found.append(np.where(np.indices((2, 2, 2)).reshape(3, -1).T, high, low))
    return np.concatenate(found) if found else None


def ground_height(world: World, appearances: Mapping[BodyId, BodyAppearance]) -> float | None:
    """The height of the ground plane, below all bodies [m]; None if the world has a floor."""
    if any(each.is_floor for each in appearances.values()):
        return None
    bodies = [
        body for body in world.bodies if body.id in appearances and appearances[body.id].part is not VisiblePart.OUTLINE
    ]
    return min((body.pose.position[2] - appearances[body.id].size[2] / 2 for body in bodies), default=0.0)


def _find_target(
    poses: Array,
    sizes: Array,
    body_mask: NDArray[np.bool_],
    preferred: NDArray[np.bool_],
    occluders: NDArray[np.bool_],
) -> FramingTarget:
    """Finds the direction in which most bodies are visible.

    Args:
        poses: poses of all bodies, n x 7.
        sizes: extents of all bodies, n x 3 [m].
        body_mask: the bodies to show; all if it is empty.
        preferred: those of them that are to be visible; all if it is empty.
        occluders: a mask of the bodies that hide others.
    """
    if len(poses) == 0:
        return FramingTarget(np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]]), -np.pi / 4)
    if not body_mask.any():
        body_mask = np.ones(len(poses), dtype=bool)
    rotations = rotation_matrix(normalize(poses[:, 3:]))
    rows = _without_outliers(poses[body_mask, :3], np.flatnonzero(body_mask))
    points = corners(poses[rows], sizes[rows])
    seen = rows[preferred[rows]] if preferred[rows].any() else rows
    sampled = seen[np.linspace(0, len(seen) - 1, min(len(seen), _MAX_SAMPLED_BODIES)).astype(int)]
    largest = np.flatnonzero(occluders)
    largest = largest[np.argsort(-np.prod(sizes[largest], axis=1))[:_MAX_OCCLUDERS]]
    azimuths = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
    eyes = [np.array(FramingTarget(points, float(azimuth)).camera().position) for azimuth in azimuths]
    visible = np.array([_visibility(eye, poses, sizes, rotations, sampled, largest) for eye in eyes])
    alignment = _alignment(rotations[rows])
    diagonal = np.abs(np.sin(2 * (azimuths - alignment)))
    # Rounded, so that of equally good directions the first is chosen on every machine.
    best = int(np.argmax(np.round(visible * (1.0 + _DIAGONAL_BONUS * diagonal), 6)))
    return FramingTarget(points, float(azimuths[best]), alignment)


def _without_outliers(centers: Array, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """The rows without bodies that are far from all others, which would make everything else small."""
    median = np.median(centers, axis=0)
    distance = np.linalg.norm(centers - median, axis=1)
    near: NDArray[np.bool_] = distance <= 3.0 * max(float(np.median(distance)), _MIN_SPREAD_M)
    return rows[near]


def _alignment(rotations: Array) -> float:
    """The mean yaw of the furniture, modulo 90 degrees [rad]."""
    yaw = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])
    return float(np.angle(np.exp(4j * yaw).sum())) / 4


def _view_direction(azimuth: float, elevation: float) -> Array:
    """The unit vector from the center to the camera."""
    horizontal = np.cos(elevation)
    return np.array([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), np.sin(elevation)])


def _fit_camera(points: Array, direction: Array, aspect: float) -> CameraPose:
    """The nearest camera pose in a direction that shows all points, centered, with a margin."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    up = np.cross(direction, right)
    # Coordinates of the points to the right, up and towards the camera.
    local = (points - points[0]) @ np.stack([right, up, direction], axis=1)
    tangents = np.tan(_FIELD_OF_VIEW_RAD / 2) * np.array([aspect, 1.0]) / _MARGIN_FACTOR
    # The planes of the frustum touch the outermost points; opposite planes intersect at the camera.
    most = np.max(local[:, :2] + local[:, 2:] * tangents, axis=0)
    least = np.min(local[:, :2] - local[:, 2:] * tangents, axis=0)
    depth = float(np.max((most - least) / (2 * tangents)))
    nearest = float(local[:, 2].max()) + _MIN_DISTANCE_M
    depth = max(depth, nearest)
    x, y = ((most + least) / 2).tolist()
    eye = points[0] + x * right + y * up + depth * direction
    middle = float(np.median(local[:, 2]))
    return CameraPose(
        _to_vector(eye), _to_vector(eye - max(depth - middle, _MIN_DISTANCE_M) * direction), float(_FIELD_OF_VIEW_RAD)
    )


def _fit_shifted_camera(points: Array, azimuth: float, aspect: float) -> CameraPose:
    """The nearest camera pose in a direction, with a horizontal axis, whose shifted lens shows all points."""
    low, high = points.min(axis=0), points.max(axis=0)
    center = (low + high) / 2
    toward = _view_direction(azimuth, 0.0)
    right = np.array([-toward[1], toward[0], 0.0])
    away = _view_direction(azimuth, float(_UPRIGHT_LENS_ELEVATION_RAD))
    half = float(np.tan(_FIELD_OF_VIEW_RAD / 2))
    limits = half * np.array([aspect, 1.0]) / _SHIFTED_MARGIN_FACTOR

    def extents(distance: float, aside: float) -> tuple[Array, Array, float]:
        local = points - (center + distance * away + aside * right)
        depth = -local @ toward
        flat = np.stack([local @ right, local[:, 2]], axis=1) / np.maximum(depth, 1e-9)[:, None]
        return flat.min(axis=0), flat.max(axis=0), float(depth.min())

    def fits(distance: float, aside: float) -> bool:
        least, most, nearest = extents(distance, aside)
        return nearest > _MIN_DISTANCE_M and bool(np.all((most - least) / 2 <= limits))

    aside, near, far = 0.0, 0.0, 4.0 * float(np.linalg.norm(high - low)) / half + 1.0
    for _ in range(4):  # the lateral shift that centers the points depends on the distance
        near, upper = 0.0, far
        for _ in range(40):
            middle = (near + upper) / 2
            near, upper = (near, middle) if fits(middle, aside) else (middle, upper)
        distance = upper
        least, most, _ = extents(distance, aside)
        aside += float(least[0] + most[0]) / 2 * distance * float(np.cos(_UPRIGHT_LENS_ELEVATION_RAD))
    while not fits(distance, aside):
        distance *= 1.01
    least, most, _ = extents(distance, aside)
    eye = center + distance * away + aside * right
    return CameraPose(
        _to_vector(eye),
        _to_vector(eye - distance * toward),
        float(_FIELD_OF_VIEW_RAD),
        vertical_shift=-float(least[1] + most[1]) / 2 / (2 * half),
    )


def _visibility(
    eye: Array, poses: Array, sizes: Array, rotations: Array, sampled: NDArray[np.intp], occluders: NDArray[np.intp]
) -> float:
    """The number of visible bodies; a body counts less the more of the occluders is between it and the eye."""
    axes, half, centers = rotations[occluders], sizes[occluders, None] / 2, poses[occluders, :3]
    start = np.einsum("ki,kij->kj", eye - centers, axes)[:, None]
    path = np.matmul(poses[None, sampled, :3] - centers[:, None], axes) - start
    with np.errstate(divide="ignore", invalid="ignore"):
        enter, leave = (-half - start) / path, (half - start) / path
    first = np.fmax.reduce(np.fmin(enter, leave), axis=2)
    last = np.fmin.reduce(np.fmax(enter, leave), axis=2)
    inside = np.clip(np.minimum(last, 1.0) - np.maximum(first, 0.0), 0.0, 1.0) * np.linalg.norm(path, axis=2)
    inside[occluders[:, None] == sampled] = 0.0
    through = inside.sum(axis=0)
    return float(np.exp(-through / _OCCLUSION_LENGTH_M).sum())


def _to_vector(array: Array) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


_SAMPLE_INSET = 0.8
"""Part of the extents of a highlighted body that has to be visible; its edges may be occluded."""


def find_occluders(eye: Array, poses: Array, sizes: Array, highlighted: NDArray[np.intp]) -> NDArray[np.intp]:
    """Finds the bodies that occlude or contain a part of the highlighted bodies.

    Args:
        eye: position of the camera [m].
        poses: poses of all bodies, n x 7.
        sizes: extents of all bodies, n x 3 [m].
        highlighted: rows of the highlighted bodies.

    Returns:
        Rows of bodies that are not highlighted.
    """
    points = np.concatenate([poses[highlighted, :3], corners(poses[highlighted], sizes[highlighted] * _SAMPLE_INSET)])
    rotations = rotation_matrix(normalize(poses[:, 3:]))
    # In the frame of each body, the segment from the eye to a point is `start + s * path` for s from 0 to 1.
    start = np.einsum("nji,nj->ni", rotations, eye - poses[:, :3])[:, None]
    path = np.einsum("nji,npj->npi", rotations, points[None] - poses[:, None, :3]) - start
    with np.errstate(divide="ignore", invalid="ignore"):
        enter, leave = ((sign * sizes[:, None] / 2 - start) / path for sign in (-1.0, 1.0))
    first = np.nanmax(np.minimum(enter, leave), axis=2)
    last = np.nanmin(np.maximum(enter, leave), axis=2)
    crossed = np.any(np.maximum(first, 0.0) < np.minimum(last, 1.0), axis=1)
    crossed[highlighted] = False
    return np.flatnonzero(crossed)
