"""Constraints: a constraint of a world as the wire describes one, and back.

The motions are the same numbers, 0 free, 1 limited, 2 locked; the first model is the parent, the second the child. On
the wire a range is the same either way from where it was spawned. A range that is not is widened until it is, since a
drawer that could also go backwards still opens, and one that is cut short does not.
"""

from __future__ import annotations

from collections.abc import Iterator

from mindstage.bridge.description.geometry import pose_from, pose_message
from mindstage.bridge.description.models import individual
from mindstage.bridge.description.remarks import Remark
from mindstage.msgs import geometry_msgs, world_control_msgs
from mindstage.world import AngularMotion, BodyId, Constraint, LinearMotion, Motion, Soft

__all__ = ["constraint_description", "constraint_from", "unsaid_of_constraint"]

LINEAR = ("x", "y", "z")
ANGULAR = ("swing1", "swing2", "twist")


def constraint_description(constraint: Constraint) -> world_control_msgs.ConstraintDescription:
    """A constraint for the wire."""
    return world_control_msgs.ConstraintDescription(
        id=constraint.id,
        constraint_details=world_control_msgs.PhysicsConstraintDetails(
            id_first_model=constraint.parent,
            id_second_model=constraint.child,
            disable_collision=constraint.disable_collision is not False,
            linear_limits=_linear(constraint.linear),
            angular_limits=_angular(constraint.angular),
        ),
        pose=pose_message(constraint.pose),
    )


def unsaid_of_constraint(constraint: Constraint) -> Iterator[Remark]:
    """What the wire cannot say of a constraint."""
    if constraint.facts:
        yield Remark("facts", (constraint.id,), "a constraint has no place for facts there")
    if constraint.tags:
        yield Remark("tags", (constraint.id,), "a constraint has no place for tags there")
    if constraint.disable_collision is None:
        yield Remark("disable_collision", (constraint.id,), "what is not told is written as true there")
    if _shifted(constraint.linear, LINEAR) or _shifted(constraint.angular, ANGULAR):
        yield Remark("middle", (constraint.id,), "a range is the same either way there, so it is widened until it is")


def constraint_from(
    description: world_control_msgs.ConstraintDescription, *, id: str = "", namespace: str
) -> tuple[Constraint, tuple[Remark, ...]]:
    """The constraint that is described, and what was left aside.

    Args:
        description: from the wire.
        id: its id, where the description has none.
        namespace: what comes before the id in its IRI, which the wire does not tell.
    """
    name = BodyId(description.id or id)
    details = description.constraint_details
    linear, angular = details.linear_limits, details.angular_limits
    constraint = Constraint(
        id=name,
        iri=individual(name, namespace),
        parent=BodyId(details.id_first_model),
        child=BodyId(details.id_second_model),
        pose=pose_from(description.pose),
        linear=LinearMotion(
            x=Motion(linear.x_motion),
            y=Motion(linear.y_motion),
            z=Motion(linear.z_motion),
            limit=linear.limit,
            soft=_soft(linear.use_advanced, linear.soft_constraint, linear.stiffness, linear.damping),
        ),
        angular=AngularMotion(
            swing1=Motion(angular.swing_1_motion),
            swing2=Motion(angular.swing_2_motion),
            twist=Motion(angular.twist_motion),
            swing1_limit=angular.swing_1_limit_angle,
            swing2_limit=angular.swing_2_limit_angle,
            twist_limit=angular.twist_limit_angle,
            swing_soft=_soft(
                angular.use_advanced, angular.swing_soft_constraint, angular.swing_stiffness, angular.swing_damping
            ),
            twist_soft=_soft(
                angular.use_advanced, angular.twist_soft_constraint, angular.twist_stiffness, angular.twist_damping
            ),
        ),
        disable_collision=details.disable_collision,
    )
    return constraint, tuple(_left_aside(name, details))


def _linear(motion: LinearMotion) -> world_control_msgs.LinearLimits:
    reach = [abs(getattr(motion, f"{axis}_middle")) for axis in LINEAR if getattr(motion, axis) is Motion.LIMITED]
    return world_control_msgs.LinearLimits(
        x_motion=world_control_msgs.MotionCode(motion.x),
        y_motion=world_control_msgs.MotionCode(motion.y),
        z_motion=world_control_msgs.MotionCode(motion.z),
        limit=motion.limit + max(reach, default=0.0),
        use_advanced=True,
        soft_constraint=motion.soft.enabled,
        stiffness=motion.soft.stiffness,
        damping=motion.soft.damping,
    )


def _angular(motion: AngularMotion) -> world_control_msgs.AngularLimits:
    return world_control_msgs.AngularLimits(
        swing_1_motion=world_control_msgs.MotionCode(motion.swing1),
        swing_2_motion=world_control_msgs.MotionCode(motion.swing2),
        twist_motion=world_control_msgs.MotionCode(motion.twist),
        swing_1_limit_angle=_reach(motion, "swing1"),
        swing_2_limit_angle=_reach(motion, "swing2"),
        twist_limit_angle=_reach(motion, "twist"),
        use_advanced=True,
        swing_soft_constraint=motion.swing_soft.enabled,
        swing_stiffness=motion.swing_soft.stiffness,
        swing_damping=motion.swing_soft.damping,
        twist_soft_constraint=motion.twist_soft.enabled,
        twist_stiffness=motion.twist_soft.stiffness,
        twist_damping=motion.twist_soft.damping,
    )


def _reach(motion: AngularMotion, axis: str) -> float:
    limit: float = getattr(motion, f"{axis}_limit")
    middle: float = getattr(motion, f"{axis}_middle")
    return limit + abs(middle) if getattr(motion, axis) is Motion.LIMITED else limit


def _shifted(motion: LinearMotion | AngularMotion, axes: tuple[str, ...]) -> bool:
    return any(getattr(motion, axis) is Motion.LIMITED and getattr(motion, f"{axis}_middle") for axis in axes)


def _soft(use_advanced: bool, enabled: bool, stiffness: float, damping: float) -> Soft:
    return Soft(enabled=use_advanced and enabled, stiffness=stiffness, damping=damping)


def _left_aside(id: str, details: world_control_msgs.PhysicsConstraintDetails) -> Iterator[Remark]:
    linear, angular = details.linear_limits, details.angular_limits
    if linear.soft_constraint and not linear.use_advanced:
        yield Remark("soft", (id,), "softness along the axes does not count without use_advanced")
    if (angular.swing_soft_constraint or angular.twist_soft_constraint) and not angular.use_advanced:
        yield Remark("soft", (id,), "softness about the axes does not count without use_advanced")
    if angular.angular_roation_offset != geometry_msgs.Vector3():
        yield Remark("angular_roation_offset", (id,), "it is left aside; turn the pose in its place")
    if details.enable_projection:
        yield Remark("enable_projection", (id,), "how an engine corrects errors is left to the engine")
    if details.parent_dominates:
        yield Remark("parent_dominates", (id,), "it is left aside; make the parent static in its place")
