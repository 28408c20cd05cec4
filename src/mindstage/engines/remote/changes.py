"""Changes: what of a plan a far engine does not know yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mindstage.bridge.description import BodyModelDelta, JointModelDelta, PhysicsModelDelta
from mindstage.engines.plan import BodyModel, JointModel
from mindstage.engines.planning import PhysicsModelBuilder
from mindstage.world import BodyId, Pose

__all__ = ["ModelState"]


@dataclass(frozen=True, slots=True)
class ModelState:
    """All that was told of a plan."""

    bodies: Mapping[BodyId, BodyModelDelta] = field(default_factory=dict)
    excluded_pairs: frozenset[tuple[BodyId, BodyId]] = frozenset()
    joints: Mapping[BodyId, JointModelDelta] = field(default_factory=dict)

    @classmethod
    def from_builder(cls, builder: PhysicsModelBuilder) -> ModelState:
        """What there is to be told."""
        plan = builder.build_model()
        return cls(
            bodies={id: _body_change(each) for id, each in plan.bodies.items()},
            excluded_pairs=plan.excluded_pairs,
            joints={id: _joint_change(each) for id, each in plan.joints.items()},
        )

    def diff_to(self, target: ModelState, *, poses: Mapping[BodyId, Pose] | None = None) -> PhysicsModelDelta:
        """What is to be told of another plan by someone who has told this one; what is gone needs no word.

        Args:
            then: the other one.
            poses: of bodies that are put somewhere else.
        """
        here = target.bodies.keys()
        joints: dict[BodyId, JointModelDelta | None] = dict.fromkeys(self.joints.keys() - target.joints.keys())
        joints |= {id: joint for id, joint in target.joints.items() if self.joints.get(id) != joint}
        return PhysicsModelDelta(
            bodies={id: body for id, body in target.bodies.items() if self.bodies.get(id) != body},
            apart=tuple(sorted(target.excluded_pairs - self.excluded_pairs)),
            together=tuple(
                sorted(
                    pair for pair in self.excluded_pairs - target.excluded_pairs if pair[0] in here and pair[1] in here
                )
            ),
            joints=joints,
            poses=dict(poses or {}),
        )


def _body_change(model: BodyModel) -> BodyModelDelta:
    return BodyModelDelta(
        size=model.size,
        top=model.root,
        hold=model.pose_in_root,
        mobility=model.mobility,
        gravity=model.gravity,
        mass_kg=model.mass_kg,
        ghost=model.non_colliding,
        solids=model.collision_shapes,
        friction=model.friction,
        restitution=model.restitution,
    )


def _joint_change(model: JointModel) -> JointModelDelta:
    """As the map has the roles, since that is how it tells the ranges."""
    parent, child = model.joint.parent, model.joint.child
    ends = model.parent_from_joint, model.child_from_joint
    of_parent, of_child = ends if model.parent == parent else ends[::-1]
    return JointModelDelta(parent=parent, child=child, of_parent=of_parent, of_child=of_child)
