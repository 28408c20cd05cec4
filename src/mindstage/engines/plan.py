"""Plan: all that an engine needs to run a world in the way that was decided, as values.

Two plans of one planner, compared, say what an edit changed; a far engine is sent just that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mindstage.engines.forest import KinematicForest, TreeJoint
from mindstage.world import IDENTITY, BodyId, CollisionShape, Joint, Mobility, Pose, Vector
from mindstage.world.geometry import normalized_pose_array, pose_from_array, pose_multiply

if TYPE_CHECKING:
    from mindstage.engines.planning import PhysicsModelBuilder

__all__ = ["BodyModel", "JointModel", "PhysicsModel", "build_physics_model"]


@dataclass(frozen=True, slots=True)
class BodyModel:
    """One body."""

    size: Vector
    """In force: an assumed one where the map has none."""
    root: BodyId
    """The body that its rigid assembly hangs on; itself where nothing holds it."""
    pose_in_root: Pose
    """Where it is in the frame of that body."""
    mobility: Mobility
    """Of the assembly."""
    gravity: bool
    mass_kg: float
    """Given or estimated; 0 where nobody knows and nobody needs to."""
    non_colliding: bool
    """Whether it collides with nothing."""
    collision_shapes: tuple[CollisionShape, ...]
    """What of it can be touched, in its own frame."""
    friction: float | None = None
    restitution: float | None = None


@dataclass(frozen=True, slots=True)
class JointModel:
    """One constraint between two assemblies of which at least one is simulated."""

    joint: Joint
    parent: BodyId
    """The end nearer to what does not move; it need not be what the map calls the parent."""
    child: BodyId
    parent_from_joint: Pose
    """The joint's frame as that parent sees it; what moves moves from there."""
    child_from_joint: Pose
    closes_loop: bool
    """Whether it closes a loop of constraints."""


@dataclass(frozen=True, slots=True)
class PhysicsModel:
    """Everything in one engine."""

    bodies: Mapping[BodyId, BodyModel]
    excluded_pairs: frozenset[tuple[BodyId, BodyId]]
    """Pairs that never collide, the lower id first; two of one assembly never do either and are not in it."""
    joints: Mapping[BodyId, JointModel]
    """By constraint; without those that are not taken, because they join what cannot move against each other."""


def build_physics_model(builder: PhysicsModelBuilder) -> PhysicsModel:
    """What a planner decided."""
    forest, masses = builder.forest, builder.masses()
    holds: dict[BodyId, Pose] = {}
    for assembly in forest.groups.values():
        for id in assembly.bodies:  # parents come before children
            holder = forest.rigid_parents.get(id)
            above = IDENTITY if holder is None else holds[holder]
            holds[id] = (
                IDENTITY
                if holder is None
                else pose_from_array(pose_multiply(normalized_pose_array(above), builder.attachment_poses[id]))
            )
    bodies = {id: _body_model(builder, forest, id, holds[id], masses[id]) for id in builder.registry.bodies}
    branches = [(branch, False) for branch in forest.tree_joints.values()]
    branches += [(branch, True) for branch in forest.loop_joints]
    joints = {branch.joint.id: _joint_model(builder, branch, loop) for branch, loop in branches}
    return PhysicsModel(bodies, frozenset(builder.excluded_pairs()), joints)


def _body_model(
    builder: PhysicsModelBuilder, forest: KinematicForest, id: BodyId, pose_in_root: Pose, mass_kg: float
) -> BodyModel:
    assembly = forest.groups[forest.root_of[id]]
    form = builder.geometry.get(id)
    return BodyModel(
        size=builder.mass_properties.size(id),
        root=assembly.root,
        pose_in_root=pose_in_root,
        mobility=assembly.mobility,
        gravity=builder.registry.bodies[id].physics.gravity is not False,
        mass_kg=mass_kg,
        non_colliding=id in builder.collision_filter.non_colliding,
        collision_shapes=builder.collision_shapes(id)[0],
        friction=form.friction if form else None,
        restitution=form.restitution if form else None,
    )


def _joint_model(builder: PhysicsModelBuilder, tree_joint: TreeJoint, closes_loop: bool) -> JointModel:
    of_parent, of_child = tree_joint.order_ends(builder.joint_frames[tree_joint.joint.id])
    frames = pose_from_array(of_parent), pose_from_array(of_child)
    return JointModel(tree_joint.joint, tree_joint.parent, tree_joint.child, *frames, closes_loop=closes_loop)
