"""Constraints: a constraint of a world as the wire describes one, and back.

The motions are the same numbers, 0 free, 1 limited, 2 locked; the first model is the parent, the second the child. On
the wire a range is the same either way from where it was spawned. A range that is not is widened until it is, since a
drawer that could also go backwards still opens, and one that is cut short does not.
"""

from __future__ import annotations

from collections.abc import Iterator

from mindstage.bridge.description.geometry import pose_from_message, pose_message
from mindstage.bridge.description.models import iri_from_id
from mindstage.bridge.description.remarks import ConversionNote
from mindstage.msgs import geometry_msgs, world_control_msgs
from mindstage.world import AngularLimits, AxisMotion, BodyId, Joint, LinearLimits, SoftLimit

__all__ = ["joint_from_message", "joint_message", "untranslatable_joint_fields"]

LINEAR_AXES = ("x", "y", "z")
ANGULAR_AXES = ("swing1", "swing2", "twist")


def joint_message(joint: Joint) -> world_control_msgs.ConstraintDescription:
    """A constraint for the wire."""
    return world_control_msgs.ConstraintDescription(
        id=joint.id,
        constraint_details=world_control_msgs.PhysicsConstraintDetails(
            id_first_model=joint.parent,
            id_second_model=joint.child,
            disable_collision=joint.disable_collision is not False,
            linear_limits=_linear_message(joint.linear),
            angular_limits=_angular_message(joint.angular),
        ),
        pose=pose_message(joint.pose),
    )


def untranslatable_joint_fields(joint: Joint) -> Iterator[ConversionNote]:
    """What the wire cannot say of a constraint."""
    if joint.facts:
        yield ConversionNote("facts", (joint.id,), "a constraint has no place for facts there")
    if joint.tags:
        yield ConversionNote("tags", (joint.id,), "a constraint has no place for tags there")
    if joint.disable_collision is None:
        yield ConversionNote("disable_collision", (joint.id,), "what is not told is written as true there")
    if _shifted_axes(joint.linear, LINEAR_AXES) or _shifted_axes(joint.angular, ANGULAR_AXES):
        yield ConversionNote(
            "middle", (joint.id,), "a range is the same either way there, so it is widened until it is"
        )


def joint_from_message(
    message: world_control_msgs.ConstraintDescription, *, id: str = "", namespace: str
) -> tuple[Joint, tuple[ConversionNote, ...]]:
    """The constraint that is described, and what was left aside.

    Args:
        description: from the wire.
        id: its id, where the description has none.
        namespace: what comes before the id in its IRI, which the wire does not tell.
    """
    name = BodyId(message.id or id)
    details = message.constraint_details
    linear, angular = details.linear_limits, details.angular_limits
    constraint = Joint(
        id=name,
        iri=iri_from_id(name, namespace),
        parent=BodyId(details.id_first_model),
        child=BodyId(details.id_second_model),
        pose=pose_from_message(message.pose),
        linear=LinearLimits(
            x=AxisMotion(linear.x_motion),
            y=AxisMotion(linear.y_motion),
            z=AxisMotion(linear.z_motion),
            limit=linear.limit,
            soft_limit=_soft_limit(linear.use_advanced, linear.soft_constraint, linear.stiffness, linear.damping),
        ),
        angular=AngularLimits(
            swing1=AxisMotion(angular.swing_1_motion),
            swing2=AxisMotion(angular.swing_2_motion),
            twist=AxisMotion(angular.twist_motion),
            swing1_limit=angular.swing_1_limit_angle,
            swing2_limit=angular.swing_2_limit_angle,
            twist_limit=angular.twist_limit_angle,
            swing_soft_limit=_soft_limit(
                angular.use_advanced, angular.swing_soft_constraint, angular.swing_stiffness, angular.swing_damping
            ),
            twist_soft_limit=_soft_limit(
                angular.use_advanced, angular.twist_soft_constraint, angular.twist_stiffness, angular.twist_damping
            ),
        ),
        disable_collision=details.disable_collision,
    )
    return constraint, tuple(_ignored_note(name, details))


def _linear_message(motion: LinearLimits) -> world_control_msgs.LinearLimits:
    reach = [
        abs(getattr(motion, f"{axis}_middle")) for axis in LINEAR_AXES if getattr(motion, axis) is AxisMotion.LIMITED
    ]
    return world_control_msgs.LinearLimits(
        x_motion=world_control_msgs.MotionCode(motion.x),
        y_motion=world_control_msgs.MotionCode(motion.y),
        z_motion=world_control_msgs.MotionCode(motion.z),
        limit=motion.limit + max(reach, default=0.0),
        use_advanced=True,
        soft_constraint=motion.soft_limit.enabled,
        stiffness=motion.soft_limit.stiffness,
        damping=motion.soft_limit.damping,
    )


def _angular_message(motion: AngularLimits) -> world_control_msgs.AngularLimits:
    return world_control_msgs.AngularLimits(
        swing_1_motion=world_control_msgs.MotionCode(motion.swing1),
        swing_2_motion=world_control_msgs.MotionCode(motion.swing2),
        twist_motion=world_control_msgs.MotionCode(motion.twist),
        swing_1_limit_angle=_joint_reach(motion, "swing1"),
        swing_2_limit_angle=_joint_reach(motion, "swing2"),
        twist_limit_angle=_joint_reach(motion, "twist"),
        use_advanced=True,
        swing_soft_constraint=motion.swing_soft_limit.enabled,
        swing_stiffness=motion.swing_soft_limit.stiffness,
        swing_damping=motion.swing_soft_limit.damping,
        twist_soft_constraint=motion.twist_soft_limit.enabled,
        twist_stiffness=motion.twist_soft_limit.stiffness,
        twist_damping=motion.twist_soft_limit.damping,
    )


def _joint_reach(motion: AngularLimits, axis: str) -> float:
    limit: float = getattr(motion, f"{axis}_limit")
    middle: float = getattr(motion, f"{axis}_middle")
    return limit + abs(middle) if getattr(motion, axis) is AxisMotion.LIMITED else limit


def _shifted_axes(motion: LinearLimits | AngularLimits, axes: tuple[str, ...]) -> bool:
    return any(getattr(motion, axis) is AxisMotion.LIMITED and getattr(motion, f"{axis}_middle") for axis in axes)


def _soft_limit(use_advanced: bool, enabled: bool, stiffness: float, damping: float) -> SoftLimit:
    return SoftLimit(enabled=use_advanced and enabled, stiffness=stiffness, damping=damping)


def _ignored_note(id: str, details: world_control_msgs.PhysicsConstraintDetails) -> Iterator[ConversionNote]:
    linear, angular = details.linear_limits, details.angular_limits
    if linear.soft_constraint and not linear.use_advanced:
        yield ConversionNote("soft", (id,), "softness along the axes does not count without use_advanced")
    if (angular.swing_soft_constraint or angular.twist_soft_constraint) and not angular.use_advanced:
        yield ConversionNote("soft", (id,), "softness about the axes does not count without use_advanced")
    if angular.angular_roation_offset != geometry_msgs.Vector3():
        yield ConversionNote("angular_roation_offset", (id,), "it is left aside; turn the pose in its place")
    if details.enable_projection:
        yield ConversionNote("enable_projection", (id,), "how an engine corrects errors is left to the engine")
    if details.parent_dominates:
        yield ConversionNote("parent_dominates", (id,), "it is left aside; make the parent static in its place")
