"""The messages of world_control_msgs: models, constraints and relations as Unreal's plugin reads them."""

from __future__ import annotations

from typing import ClassVar

from mindstage.msgs.geometry_msgs import Pose, Vector3
from mindstage.msgs.message import Message
from mindstage.msgs.primitives import Bool, Float32, String, Uint8Code

__all__ = [
    "AngularLimits",
    "ConstraintDescription",
    "LinearLimits",
    "MobilityCode",
    "ModelDescription",
    "MotionCode",
    "PhysicsConstraintDetails",
    "PhysicsProperties",
    "RelationDescription",
    "Tag",
]


class MobilityCode(Uint8Code):
    """Who may move a model."""

    STATIC = 0
    STATIONARY = 1
    DYNAMIC = 2
    KINEMATIC = 3


class MotionCode(Uint8Code):
    """What an axis allows."""

    FREE = 0
    LIMITED = 1
    LOCKED = 2


class Tag(Message, frozen=True):
    """One key and value that stays with a model."""

    type: String = ""
    key: String = ""
    value: String = ""


class PhysicsProperties(Message, frozen=True):
    """How a model takes part in the physics."""

    mobility: MobilityCode = MobilityCode.STATIC
    gravity: Bool = False
    generate_overlap_events: Bool = False
    mass: Float32 = 0.0
    """[kg]."""


class ModelDescription(Message, frozen=True):
    """A model to be spawned."""

    name: String = ""
    """Of its mesh: the asset SM_<name>."""
    pose: Pose = Pose()
    id: String = ""
    tags: tuple[Tag, ...] = ()
    path: String = ""
    """Where the mesh is looked for first."""
    actor_label: String = ""
    physics_properties: PhysicsProperties = PhysicsProperties()
    material_names: tuple[String, ...] = ()
    material_paths: tuple[String, ...] = ()


class LinearLimits(Message, frozen=True):
    """How far one model may slide against the other."""

    x_motion: MotionCode = MotionCode.FREE
    y_motion: MotionCode = MotionCode.FREE
    z_motion: MotionCode = MotionCode.FREE
    limit: Float32 = 0.0
    """[m], either way."""
    use_advanced: Bool = False
    """Whether the softness below counts."""
    soft_constraint: Bool = False
    stiffness: Float32 = 0.0
    damping: Float32 = 0.0


class AngularLimits(Message, frozen=True):
    """How far one model may turn against the other: swing 1 about z, swing 2 about y, twist about x."""

    spellings: ClassVar = {"angular_rotation_offset": "angular_roation_offset"}

    swing_1_motion: MotionCode = MotionCode.FREE
    swing_2_motion: MotionCode = MotionCode.FREE
    twist_motion: MotionCode = MotionCode.FREE
    swing_1_limit_angle: Float32 = 0.0
    """[rad], either way."""
    swing_2_limit_angle: Float32 = 0.0
    twist_limit_angle: Float32 = 0.0
    angular_roation_offset: Vector3 = Vector3()
    """Spelt so by the plugin."""
    use_advanced: Bool = False
    """Whether the softness below counts."""
    swing_soft_constraint: Bool = False
    swing_stiffness: Float32 = 0.0
    swing_damping: Float32 = 0.0
    twist_soft_constraint: Bool = False
    twist_stiffness: Float32 = 0.0
    twist_damping: Float32 = 0.0


class PhysicsConstraintDetails(Message, frozen=True):
    """Which two models are joined, and how."""

    id_first_model: String = ""
    id_second_model: String = ""
    disable_collision: Bool = False
    enable_projection: Bool = False
    projection_linear_tolerance: Float32 = 0.0
    projection_angular_tolerance: Float32 = 0.0
    parent_dominates: Bool = False
    linear_limits: LinearLimits = LinearLimits()
    angular_limits: AngularLimits = AngularLimits()


class ConstraintDescription(Message, frozen=True):
    """A constraint to be spawned."""

    id: String = ""
    constraint_details: PhysicsConstraintDetails = PhysicsConstraintDetails()
    pose: Pose = Pose()
    """The frame of the joint, in the world."""


class RelationDescription(Message, frozen=True):
    """The child goes where the parent goes."""

    parent_id: String = ""
    child_id: String = ""
