"""Camera models: intrinsics, distortion, range, rate and noise of a camera, and the body that it is on.

Pixels have the coordinates of OpenCV and ROS: (0, 0) is the center of the upper left pixel.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Self

import msgspec
import numpy as np
from msgspec import Meta

from mindstage.errors import InvalidArgumentError
from mindstage.ranges import (
    FieldOfView,
    Finite,
    Fraction,
    Frequency,
    NotNegative,
    Positive,
    Seed,
    check_fields,
    checked,
)
from mindstage.scene import IDENTITY, BodyId, Pose
from mindstage.scene.transforms import Array

__all__ = ["CameraModel", "CameraMount", "CameraNoise", "undistorted"]

ImageSide = Annotated[int, Meta(ge=1, le=8192)]
"""Width or height of an image [px]; OpenGL renders no more."""
_ITERATIONS = 50
"""Number of steps in which a distortion is inverted."""
_CONVERGED = 1e-7
"""Largest error of the inverse of a distortion, at a distance of 1."""


class CameraNoise(msgspec.Struct, frozen=True, kw_only=True):
    """The noise of a camera; all of it is 0 by default. It depends on the seed and the simulated time only."""

    color_std: Fraction = 0.0
    """Standard deviation of each channel, as a part of the full range; Gaussian, as in SDF."""
    depth_std_m: NotNegative = 0.0
    """Standard deviation of depths at `depth_offset_m` [m]."""
    depth_std_per_m: NotNegative = 0.0
    """By how much it grows with the square of the distance from there [1/m]."""
    depth_offset_m: NotNegative = 0.0
    dropout: Fraction = 0.0
    """The part of the depths that are missing (NaN)."""
    seed: Seed = 0

    def __post_init__(self) -> None:
        check_fields(self)

    @classmethod
    @checked
    def kinect(cls, *, seed: Seed = 0) -> Self:
        """Axial noise of the first Kinect: 1.2 mm + 1.9 mm/m² (z - 0.4 m)².

        After Nguyen, Izadi, Lovell, "Modeling Kinect Sensor Noise for Improved 3D Reconstruction and Tracking" (2012).
        """
        return cls(depth_std_m=0.0012, depth_std_per_m=0.0019, depth_offset_m=0.4, seed=seed)


class CameraModel(msgspec.Struct, frozen=True, kw_only=True):
    """How a camera projects: u = fx x + cx, v = fy y + cy, of distorted coordinates x and y at a distance of 1."""

    width: ImageSide = 640
    height: ImageSide = 480
    fx: Positive = 525.0
    """Focal length along rows [px]."""
    fy: Positive = 525.0
    """Focal length along columns [px]."""
    cx: Finite = 319.5
    """Column of the optical axis [px]."""
    cy: Finite = 239.5
    """Row of the optical axis [px]."""
    distortion: tuple[Finite, ...] = ()
    """k1, k2, p1, p2, k3 of the model plumb_bob (Brown and Conrady); empty for none."""
    near_m: Positive = 0.02
    """What is nearer along the axis is not seen [m]."""
    far_m: Positive = 100.0
    """What is farther along the axis is not seen [m]."""
    rate_hz: Frequency = 30.0
    """Images per simulated second, for what publishes or records them."""
    noise: CameraNoise = CameraNoise()

    def __post_init__(self) -> None:
        """Checks ranges and distortion.

        Raises:
            InvalidArgumentError: the range is empty, or there are not five coefficients.
        """
        check_fields(self)
        if self.near_m >= self.far_m:
            raise InvalidArgumentError("near_m", cause=f"{self.near_m} is not below far_m", remedy="give 0.02 and 100")
        if len(self.distortion) not in {0, 5}:
            cause = f"it has {len(self.distortion)} coefficients"
            raise InvalidArgumentError("distortion", cause=cause, remedy="give k1, k2, p1, p2, k3, or nothing")

    @classmethod
    @checked
    def with_field_of_view(
        cls, horizontal_rad: FieldOfView, size: tuple[ImageSide, ImageSide] = (640, 480), **others: object
    ) -> Self:
        """A camera with square pixels and the optical axis in the middle of the image.

        Args:
            horizontal_rad: the angle between the outer edges of the first and the last column.
            size: width and height [px].
            others: further fields.
        """
        width, height = size
        focal = width / 2 / float(np.tan(horizontal_rad / 2))
        center = {"cx": (width - 1) / 2, "cy": (height - 1) / 2}
        return cls(**{"width": width, "height": height, "fx": focal, "fy": focal, **center, **others})  # type: ignore[arg-type]

    @property
    def k(self) -> Array:
        """The intrinsic matrix, 3 x 3 [px]; K of sensor_msgs/CameraInfo."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def distortion_model(self) -> str:
        """The field `distortion_model` of sensor_msgs/CameraInfo; empty for no distortion."""
        return "plumb_bob" if any(self.distortion) else ""

    def project(self, points: Array) -> Array:
        """The pixel coordinates of points in the optical frame, n x 2.

        Args:
            points: n x 3, in front of the camera [m].
        """
        distorted = _distorted(points[:, :2] / points[:, 2:], self.distortion)
        return distorted * [self.fx, self.fy] + [self.cx, self.cy]

    def rays(self) -> Array:
        """The directions that the centers of all pixels see in the optical frame, h x w x 3, of depth 1."""
        return np.concatenate([undistorted(self), np.ones((self.height, self.width, 1))], axis=2)


class CameraMount(msgspec.Struct, frozen=True, kw_only=True):
    """A camera on a body, or at a fixed pose in the world."""

    name: str
    model: CameraModel
    body: BodyId | None = None
    """None for the world."""
    pose: Pose = IDENTITY
    """Of the optical frame (x right, y down, z forward) in the frame of the body."""
    owner: frozenset[BodyId] = frozenset()
    """The bodies of the robot that it is on; those around its optical center are its housing, which it does not see."""
    frame: str = ""
    """The name of the optical frame in ROS."""


def _distorted(x: Array, coefficients: tuple[float, ...]) -> Array:
    if not any(coefficients):
        return x
    k1, k2, p1, p2, k3 = coefficients
    square = (x**2).sum(axis=-1)
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    across, down = x[..., 0], x[..., 1]
    both = 2 * across * down
    found = np.stack(
        [
            across * radial + p1 * both + p2 * (square + 2 * across**2),
            down * radial + p1 * (square + 2 * down**2) + p2 * both,
        ],
        axis=-1,
    )
    return np.asarray(found)


@lru_cache(maxsize=16)
def undistorted(model: CameraModel) -> Array:
    """Where the rays of all pixels meet the plane at a distance of 1 in the optical frame, h x w x 2, read-only.

    Raises:
        InvalidArgumentError: the distortion has no inverse at the edge of the image.
    """
    columns, rows = np.meshgrid(np.arange(model.width), np.arange(model.height))
    seen = np.stack([(columns - model.cx) / model.fx, (rows - model.cy) / model.fy], axis=-1)
    found = seen.copy()
    if any(model.distortion):
        with np.errstate(all="ignore"):
            for _ in range(_ITERATIONS):
                error = _distorted(found, model.distortion) - seen
                found = found - error
        if not np.abs(error).max() < _CONVERGED:
            raise InvalidArgumentError(
                "distortion",
                cause="it maps two directions to one pixel in the image",
                remedy="give smaller coefficients",
            )
    found.flags.writeable = False
    return found
