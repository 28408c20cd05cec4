"""Plan: all that an engine needs to run a world in the way that was decided, as values.

Two plans of one planner, compared, say what an edit changed; a far engine is sent just that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mindstage.engines.forest import Branch, Forest
from mindstage.world import IDENTITY, BodyId, Constraint, Mobility, Pose, Solid, Vector
from mindstage.world.geometry import compose, pose_from, unit_pose

if TYPE_CHECKING:
    from mindstage.engines.planning import Planner

__all__ = ["BodyPlan", "JointPlan", "Plan", "plan_of"]


@dataclass(frozen=True, slots=True)
class BodyPlan:
    """One body."""

    size: Vector
    """In force: an assumed one where the map has none."""
    top: BodyId
    """The body that its rigid assembly hangs on; itself where nothing holds it."""
    hold: Pose
    """Where it is in the frame of that body."""
    mobility: Mobility
    """Of the assembly."""
    gravity: bool
    mass_kg: float
    """Given or estimated; 0 where nobody knows and nobody needs to."""
    ghost: bool
    """Whether it collides with nothing."""
    solids: tuple[Solid, ...]
    """What of it can be touched, in its own frame."""
    friction: float | None = None
    restitution: float | None = None


@dataclass(frozen=True, slots=True)
class JointPlan:
    """One constraint between two assemblies of which at least one is simulated."""

    constraint: Constraint
    parent: BodyId
    """The end nearer to what does not move; it need not be what the map calls the parent."""
    child: BodyId
    of_parent: Pose
    """The joint's frame as that parent sees it; what moves moves from there."""
    of_child: Pose
    loop: bool
    """Whether it closes a loop of constraints."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Everything in one engine."""

    bodies: Mapping[BodyId, BodyPlan]
    apart: frozenset[tuple[BodyId, BodyId]]
    """Pairs that never collide, the lower id first; two of one assembly never do either and are not in it."""
    joints: Mapping[BodyId, JointPlan]
    """By constraint; without those that are not taken, because they join what cannot move against each other."""


def plan_of(planner: Planner) -> Plan:
    """What a planner decided."""
    forest, masses = planner.forest, planner.masses()
    holds: dict[BodyId, Pose] = {}
    for assembly in forest.assemblies.values():
        for id in assembly.bodies:  # parents come before children
            holder = forest.holders.get(id)
            above = IDENTITY if holder is None else holds[holder]
            holds[id] = IDENTITY if holder is None else pose_from(compose(unit_pose(above), planner.holds[id]))
    bodies = {id: _body_plan(planner, forest, id, holds[id], masses[id]) for id in planner.inventory.bodies}
    branches = [(branch, False) for branch in forest.branches.values()]
    branches += [(branch, True) for branch in forest.loops]
    joints = {branch.constraint.id: _joint_plan(planner, branch, loop) for branch, loop in branches}
    return Plan(bodies, frozenset(planner.apart()), joints)


def _body_plan(planner: Planner, forest: Forest, id: BodyId, hold: Pose, mass_kg: float) -> BodyPlan:
    assembly = forest.assemblies[forest.of_body[id]]
    form = planner.forms.get(id)
    return BodyPlan(
        size=planner.matter.size(id),
        top=assembly.top,
        hold=hold,
        mobility=assembly.mobility,
        gravity=planner.inventory.bodies[id].physics.gravity is not False,
        mass_kg=mass_kg,
        ghost=id in planner.collisions.ghosts,
        solids=planner.solids(id)[0],
        friction=form.friction if form else None,
        restitution=form.restitution if form else None,
    )


def _joint_plan(planner: Planner, branch: Branch, loop: bool) -> JointPlan:
    of_parent, of_child = branch.seen_from_root(planner.ends[branch.constraint.id])
    frames = pose_from(of_parent), pose_from(of_child)
    return JointPlan(branch.constraint, branch.parent, branch.child, *frames, loop=loop)
