"""The model of a robot: links, joints, and which of them are its arms, grippers, head, base and sensors.

Frames are those of the robot's own description: a link's frame is where its joint puts it, x forward and z up for the
base. Lengths are in meters, angles in radians, masses in kilograms, forces in newtons, moments in newton meters.
"""

from __future__ import annotations

from enum import StrEnum
from math import inf

import msgspec

from mindstage.scene import IDENTITY, Iri, Pose, Vector
from mindstage.scene.geometry import BodyGeometry, Inertia
from mindstage.sensors.camera_model import CameraModel

__all__ = [
    "Arm",
    "BaseType",
    "Gripper",
    "GripperType",
    "Head",
    "ModelNote",
    "RobotBase",
    "RobotComponent",
    "RobotJoint",
    "RobotJointType",
    "RobotLink",
    "RobotMimic",
    "RobotModel",
    "RobotSensor",
    "SensorType",
]


class RobotJointType(StrEnum):
    """The types of a robot's joints."""

    FIXED = "fixed"
    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    """Revolute without limits."""
    PRISMATIC = "prismatic"


class RobotMimic(msgspec.Struct, frozen=True, kw_only=True):
    """The position of a joint is `multiplier` times that of another one, plus `offset`."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0
    """[m] or [rad]."""


class RobotJoint(msgspec.Struct, frozen=True, kw_only=True):
    """A joint with at most one degree of freedom."""

    name: str
    type: RobotJointType
    parent: str
    child: str
    origin: Pose = IDENTITY
    """The joint frame in the frame of the parent; at position 0 the frame of the child coincides with it."""
    axis: Vector = (1.0, 0.0, 0.0)
    """Unit vector in the joint frame."""
    lower: float | None = None
    """Lower limit [m or rad]; None for no limit."""
    upper: float | None = None
    velocity: float | None = None
    """Largest speed [m/s or rad/s]; None if the description has none."""
    effort: float | None = None
    """Largest force [N] or moment [Nm]; None if the description has none."""
    damping: float = 0.0
    """[Ns/m] or [Nms/rad]."""
    friction: float = 0.0
    """[N] or [Nm]."""
    armature: float = 0.0
    """Inertia of the drive, as seen at the joint [kg] or [kg m²]."""
    mimic: RobotMimic | None = None

    @property
    def is_movable(self) -> bool:
        """Whether it moves; it may follow another joint."""
        return self.type is not RobotJointType.FIXED

    @property
    def is_prismatic(self) -> bool:
        """Whether positions are in meters; otherwise in radians."""
        return self.type is RobotJointType.PRISMATIC

    @property
    def limits(self) -> tuple[float, float]:
        """Both limits [m or rad]; infinite without one, and of a joint that turns freely."""
        if self.type is RobotJointType.CONTINUOUS:
            return -inf, inf
        return -inf if self.lower is None else self.lower, inf if self.upper is None else self.upper

    @property
    def unit(self) -> str:
        """That of its positions: "m" or "rad"."""
        return "m" if self.is_prismatic else "rad"

    @property
    def is_actuated(self) -> bool:
        """Whether it has a drive of its own: movable, and not following another joint."""
        return self.is_movable and self.mimic is None


class RobotLink(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A rigid body of a robot."""

    name: str
    geometry: BodyGeometry | None = None
    """Visual meshes and convex collision shapes in the link's frame; None if it has neither."""
    inertia: Inertia | None = None


class BaseType(StrEnum):
    """How a robot moves over the floor."""

    FIXED = "fixed"
    PLANAR = "planar"
    """In every direction, and it turns on the spot."""
    DIFFERENTIAL = "differential"
    """Forward and backward, and it turns on the spot."""


class RobotBase(msgspec.Struct, frozen=True, kw_only=True):
    """The base of a robot."""

    type: BaseType
    link: str
    """The link on the floor, in ROS usually `base_link` or `base_footprint`; its origin is at the height of the floor
    plus `height_m`."""
    height_m: float = 0.0
    """Height of the origin of `link` above the floor when the robot stands on it [m]."""
    radius_m: float = 0.0
    """Radius about the vertical axis of `link` that contains the base at every height of it [m]."""
    velocity: float = 0.7
    """Largest speed [m/s]."""
    turn_velocity: float = 1.5
    """[rad/s]."""
    acceleration: float = 1.0
    """[m/s²]."""
    turn_acceleration: float = 2.0
    """[rad/s²]."""


class GripperType(StrEnum):
    """The types of end effectors."""

    PARALLEL = "parallel"
    OTHER = "other"


_LEAST_TRAVEL = 1e-9
"""Of a finger, so that its lever is finite [m or rad]."""


class Gripper(msgspec.Struct, frozen=True, kw_only=True):
    """An end effector with fingers."""

    name: str
    type: GripperType
    link: str
    """The link that carries the fingers, such as the palm."""
    joints: tuple[str, ...]
    """The joints of the fingers that have drives."""
    finger_links: tuple[str, ...]
    """The links that touch what is grasped."""
    grasp_pose: Pose
    """The grasp frame in the frame of `link`: its origin is between the finger tips, its x axis points out of the hand,
    and the fingers close along its y axis."""
    open_positions: tuple[float, ...]
    """Positions of `joints` when it is open [m or rad]."""
    closed_positions: tuple[float, ...]
    max_opening_m: float
    """Distance between the finger pads when it is open [m]."""
    max_force_n: float = 40.0
    """Largest force of each finger [N]."""

    @property
    def levers(self) -> tuple[float, ...]:
        """The effort of each of `joints` by the force of the fingers, by virtual work [N/N or N m/N]."""
        share_m = self.max_opening_m / len(self.joints)
        travels = zip(self.closed_positions, self.open_positions, strict=True)
        return tuple(share_m / max(abs(opened - closed), _LEAST_TRAVEL) for closed, opened in travels)


class Arm(msgspec.Struct, frozen=True, kw_only=True):
    """A chain of joints to a gripper."""

    name: str
    joints: tuple[str, ...]
    """The joints with drives from the base to the tip, a lift or a torso that only this arm uses included."""
    base_link: str
    tip_link: str
    """The last link; it carries the gripper if there is one."""
    gripper: str | None = None
    rest_positions: tuple[float, ...] = ()
    """Positions of `joints` in which the arm is out of the way while the robot drives [m or rad]; empty if unknown."""


class Head(msgspec.Struct, frozen=True, kw_only=True):
    """Joints that turn a camera; in the order pan, tilt if there are both."""

    joints: tuple[str, ...]
    link: str
    """The link that is turned."""


class SensorType(StrEnum):
    """The types of sensors."""

    CAMERA = "camera"
    DEPTH_CAMERA = "depth camera"
    LASER_SCANNER = "laser scanner"
    FORCE_TORQUE = "force torque"
    IMU = "imu"


class RobotSensor(msgspec.Struct, frozen=True, kw_only=True):
    """A sensor."""

    name: str
    type: SensorType
    link: str
    """The link whose frame it has; an optical frame (z forward, x right) if `is_optical`."""
    is_optical: bool = False
    field_of_view_rad: float = 1.0
    """Vertical, of cameras."""
    pose: Pose = IDENTITY
    """In the frame of the link; of a camera with a model, that of its optical frame."""
    camera: CameraModel | None = None
    """The camera that the description states; None if the sensor was found by the name of its link."""


class RobotComponent(msgspec.Struct, frozen=True, kw_only=True):
    """A part of a robot as ontologies describe it: an arm, a camera, a controller."""

    name: str
    classes: tuple[Iri, ...]
    """Its classes, in the terms of KnowRob's SRDL."""
    links: tuple[str, ...] = ()
    """The first link of a group of links, then the last ones; empty for software."""


class ModelNote(msgspec.Struct, frozen=True, kw_only=True):
    """A guess, or something of a description that could not be used."""

    subject: str
    """The link, joint or group; empty for the robot."""
    text: str
    is_guess: bool = True
    """Whether something was concluded, rather than left out."""


class RobotModel(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A robot as described by files, independent of where it is."""

    name: str
    links: tuple[RobotLink, ...]
    """The root first."""
    joints: tuple[RobotJoint, ...]
    """Parents before children; exactly one for each link but the root."""
    base: RobotBase
    arms: tuple[Arm, ...] = ()
    grippers: tuple[Gripper, ...] = ()
    head: Head | None = None
    sensors: tuple[RobotSensor, ...] = ()
    group_states: tuple[tuple[str, str, tuple[tuple[str, float], ...]], ...] = ()
    """Named positions, as SRDF's `group_state`: group, name, positions by joint."""
    disabled_collisions: frozenset[tuple[str, str]] = frozenset()
    """Pairs of links that do not collide, the lower name first."""
    home_positions: tuple[tuple[str, float], ...] = ()
    """Positions of joints with which the robot is added; 0 or the limit nearest to it for the others."""
    source: str = ""
    """The path of the description."""
    urdf: str = ""
    """The text of the parameter `robot_description`; empty if the description is no URDF."""
    notes: tuple[ModelNote, ...] = ()
    components: tuple[RobotComponent, ...] = ()
    """What a self-model states beyond the description, such as software."""
    capabilities: tuple[Iri, ...] = ()
    """The classes of the capabilities that a self-model states."""

    @property
    def root(self) -> str:
        """The name of the root link."""
        return self.links[0].name

    def joint(self, name: str) -> RobotJoint:
        """The joint of that name.

        Raises:
            KeyError: there is none.
        """
        for each in self.joints:
            if each.name == name:
                return each
        raise KeyError(name)

    @property
    def actuated_joints(self) -> tuple[RobotJoint, ...]:
        """The joints with drives of their own."""
        return tuple(each for each in self.joints if each.is_actuated)
