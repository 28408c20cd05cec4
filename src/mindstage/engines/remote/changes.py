"""Changes: what of a plan a far engine does not know yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mindstage.bridge.description import BodyChange, JointChange, PlanChange
from mindstage.engines.plan import BodyPlan, JointPlan
from mindstage.engines.planning import Planner
from mindstage.world import BodyId, Pose

__all__ = ["Told"]


@dataclass(frozen=True, slots=True)
class Told:
    """All that was told of a plan."""

    bodies: Mapping[BodyId, BodyChange] = field(default_factory=dict)
    apart: frozenset[tuple[BodyId, BodyId]] = frozenset()
    joints: Mapping[BodyId, JointChange] = field(default_factory=dict)

    @classmethod
    def of(cls, planner: Planner) -> Told:
        """What there is to be told."""
        plan = planner.plan()
        return cls(
            bodies={id: _body(each) for id, each in plan.bodies.items()},
            apart=plan.apart,
            joints={id: _joint(each) for id, each in plan.joints.items()},
        )

    def change_to(self, then: Told, *, poses: Mapping[BodyId, Pose] | None = None) -> PlanChange:
        """What is to be told of another plan by someone who has told this one; what is gone needs no word.

        Args:
            then: the other one.
            poses: of bodies that are put somewhere else.
        """
        here = then.bodies.keys()
        joints: dict[BodyId, JointChange | None] = dict.fromkeys(self.joints.keys() - then.joints.keys())
        joints |= {id: joint for id, joint in then.joints.items() if self.joints.get(id) != joint}
        return PlanChange(
            bodies={id: body for id, body in then.bodies.items() if self.bodies.get(id) != body},
            apart=tuple(sorted(then.apart - self.apart)),
            together=tuple(sorted(pair for pair in self.apart - then.apart if pair[0] in here and pair[1] in here)),
            joints=joints,
            poses=dict(poses or {}),
        )


def _body(plan: BodyPlan) -> BodyChange:
    return BodyChange(
        size=plan.size,
        top=plan.top,
        hold=plan.hold,
        mobility=plan.mobility,
        gravity=plan.gravity,
        mass_kg=plan.mass_kg,
        ghost=plan.ghost,
        solids=plan.solids,
        friction=plan.friction,
        restitution=plan.restitution,
    )


def _joint(plan: JointPlan) -> JointChange:
    """As the map has the roles, since that is how it tells the ranges."""
    parent, child = plan.constraint.parent, plan.constraint.child
    ends = plan.of_parent, plan.of_child
    of_parent, of_child = ends if plan.parent == parent else ends[::-1]
    return JointChange(parent=parent, child=child, of_parent=of_parent, of_child=of_child)
