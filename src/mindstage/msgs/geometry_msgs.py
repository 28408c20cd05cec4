"""geometry_msgs: places, directions and motions in space; metres, radians, newtons."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from mindstage.msgs.message import Message
from mindstage.msgs.primitives import Float32, Float64, String
from mindstage.msgs.std_msgs import Header

__all__ = [
    "Accel",
    "AccelStamped",
    "Point",
    "Point32",
    "PointStamped",
    "Polygon",
    "Pose",
    "PoseArray",
    "PoseStamped",
    "PoseWithCovariance",
    "PoseWithCovarianceStamped",
    "Quaternion",
    "QuaternionStamped",
    "Transform",
    "TransformStamped",
    "Twist",
    "TwistStamped",
    "Vector3",
    "Vector3Stamped",
    "Wrench",
    "WrenchStamped",
]

Covariance = Annotated[tuple[Float64, ...], Meta(min_length=36, max_length=36)]
"""6 x 6, row by row: x, y, z, and the turns about them."""


class Vector3(Message, frozen=True):
    """A direction with a length."""

    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0


class Vector3Stamped(Message, frozen=True):
    """A vector at a moment, in a frame."""

    header: Header = Header()
    vector: Vector3 = Vector3()


class Point(Message, frozen=True):
    """A place [m]."""

    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0


class PointStamped(Message, frozen=True):
    """A place at a moment, in a frame."""

    header: Header = Header()
    point: Point = Point()


class Point32(Message, frozen=True):
    """A place [m] with fewer digits."""

    x: Float32 = 0.0
    y: Float32 = 0.0
    z: Float32 = 0.0


class Polygon(Message, frozen=True):
    """A closed line."""

    points: tuple[Point32, ...] = ()


class Quaternion(Message, frozen=True):
    """A rotation, by four names and never by four places. What is left out is no rotation, as ROS 2 defines it."""

    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0
    w: Float64 = 1.0


class QuaternionStamped(Message, frozen=True):
    """A rotation at a moment, in a frame."""

    header: Header = Header()
    quaternion: Quaternion = Quaternion()


class Pose(Message, frozen=True):
    """A place and a rotation."""

    position: Point = Point()
    orientation: Quaternion = Quaternion()


class PoseStamped(Message, frozen=True):
    """A pose at a moment, in a frame."""

    header: Header = Header()
    pose: Pose = Pose()


class PoseArray(Message, frozen=True):
    """Poses in one frame."""

    header: Header = Header()
    poses: tuple[Pose, ...] = ()


class PoseWithCovariance(Message, frozen=True):
    """A pose and how sure it is."""

    pose: Pose = Pose()
    covariance: Covariance = (0.0,) * 36


class PoseWithCovarianceStamped(Message, frozen=True):
    """A pose and how sure it is, at a moment, in a frame."""

    header: Header = Header()
    pose: PoseWithCovariance = PoseWithCovariance()


class Transform(Message, frozen=True):
    """How one frame lies in another."""

    translation: Vector3 = Vector3()
    rotation: Quaternion = Quaternion()


class TransformStamped(Message, frozen=True):
    """How the child's frame lies in the header's, at a moment."""

    header: Header = Header()
    child_frame_id: String = ""
    transform: Transform = Transform()


class Twist(Message, frozen=True):
    """A velocity [m/s, rad/s]."""

    linear: Vector3 = Vector3()
    angular: Vector3 = Vector3()


class TwistStamped(Message, frozen=True):
    """A velocity at a moment, in a frame."""

    header: Header = Header()
    twist: Twist = Twist()


class Accel(Message, frozen=True):
    """An acceleration [m/s^2, rad/s^2]."""

    linear: Vector3 = Vector3()
    angular: Vector3 = Vector3()


class AccelStamped(Message, frozen=True):
    """An acceleration at a moment, in a frame."""

    header: Header = Header()
    accel: Accel = Accel()


class Wrench(Message, frozen=True):
    """A force and a torque [N, Nm]."""

    force: Vector3 = Vector3()
    torque: Vector3 = Vector3()


class WrenchStamped(Message, frozen=True):
    """A force and a torque at a moment, in a frame."""

    header: Header = Header()
    wrench: Wrench = Wrench()
