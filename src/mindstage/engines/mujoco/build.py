"""Build: a blueprint becomes a compiled MuJoCo model.

The blueprint is all that was decided before (who hangs on whom, what collides, which masses); nothing is decided
here. Every body becomes one MuJoCo body, except scenery: what never moves and has nothing to do with anything that
does becomes geometry of MuJoCo's world, because adding a body costs MuJoCo a walk over all bodies so far.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mindstage.engines.collision import Collisions
from mindstage.engines.mujoco.forest import Assembly, Branch, Forest
from mindstage.engines.mujoco.joints import Axis, axes_of, is_ball
from mindstage.engines.mujoco.live import Joint, Live
from mindstage.engines.mujoco.shapes import THINNEST_M, add_geom, primitive, unit_inertias
from mindstage.engines.mujoco.tuning import add_friction, soften
from mindstage.errors import EngineUnavailable
from mindstage.world import Body, BodyId, Constraint, Mobility, Motion
from mindstage.world.geometry import Array, compose, invert

__all__ = ["Blueprint", "build"]

_STIFF_LIMIT = (0.005, 1.0)
"""Time constant [s] and damping ratio of a hard limit: a strong arm presses a drawer less than 1 mm past it."""
_HERE = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
_FIXED = (Mobility.STATIC, Mobility.STATIONARY)


@dataclass(slots=True)
class Blueprint:
    """All that a model is made from; rows of arrays go with `rows`."""

    bodies: dict[BodyId, Body]
    rows: dict[BodyId, int]
    where: Array
    """Where the bodies stand, n x 7, unit quaternions."""
    sizes: Array
    masses: dict[BodyId, float]
    forest: Forest
    holds: dict[BodyId, Array]
    """Each attached child's pose as seen from what it hangs on."""
    ends: dict[BodyId, tuple[Array, Array]]
    """Each constraint's frame as seen from the map's parent and from its child."""
    collisions: Collisions
    constraints: dict[BodyId, Constraint]
    timestep_s: float


class _Builder:
    """Holds what the steps of one build share."""

    def __init__(self, blueprint: Blueprint) -> None:
        self.blueprint = blueprint
        self.spec = mujoco.MjSpec()
        self.halves = (np.maximum(blueprint.sizes, THINNEST_M) / 2).tolist()
        self.inertias = unit_inertias(blueprint.bodies.values(), blueprint.sizes)
        self.made: dict[BodyId, Any] = {}
        self.free: dict[BodyId, Any] = {}
        self.jointed: dict[BodyId, tuple[Branch, tuple[Axis, ...], bool, list[Any], Any]] = {}

    def options(self) -> None:
        option = self.spec.option
        option.timestep = self.blueprint.timestep_s
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        option.impratio = 10.0  # friction nearly as stiff as contact, so that nothing creeps down a slope
        option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)  # a broken world must not look like a new one
        self.spec.compiler.degree = False

    def assembly(self, assembly: Assembly) -> None:
        plan = self.blueprint
        branch = plan.forest.branches.get(assembly.top)
        if branch is None:
            top = self._body(self.spec.worldbody, assembly.top, plan.where[plan.rows[assembly.top]])
            if assembly.simulates:
                self.free[assembly.top] = top.add_freejoint()
            elif assembly.mobility is Mobility.KINEMATIC:
                top.mocap = True
        else:
            self._branch(assembly, branch)
        for id in assembly.bodies[1:]:
            self._body(self.made[plan.forest.holders[id]], id, plan.holds[id])

    def _branch(self, assembly: Assembly, branch: Branch) -> None:
        parent_from_frame, frame_from_top, top_from_frame = self._frames(assembly.top, branch)
        top = self._body(self.made[branch.parent], assembly.top, compose(parent_from_frame, frame_from_top))
        axes = axes_of(branch.constraint, upside_down=branch.upside_down)
        ball = is_ball(axes)
        self._joints(top, branch, axes, ball, top_from_frame)

    def _frames(self, top: BodyId, branch: Branch) -> tuple[Array, Array, Array]:
        """The joint frame seen from the parent body; the top seen from that frame, and the other way round."""
        plan = self.blueprint
        of_parent, of_child = branch.seen_from_root(plan.ends[branch.constraint.id])
        top_from_frame = of_child
        if branch.child != top:
            top_from_child = compose(invert(plan.where[plan.rows[top]]), plan.where[plan.rows[branch.child]])
            top_from_frame = compose(top_from_child, of_child)
        return of_parent, invert(top_from_frame), top_from_frame

    def _joints(self, body: Any, branch: Branch, axes: tuple[Axis, ...], ball: bool, frame: Array) -> list[Any]:
        """The joints of one constraint, on a body in which its frame is known."""
        directions = np.eye(3)
        made = []
        for axis in axes:
            if ball and not axis.slides:
                continue
            turned = _rotate(frame[3:], directions[axis.direction])
            joint = body.add_joint(
                type=mujoco.mjtJoint.mjJNT_SLIDE if axis.slides else mujoco.mjtJoint.mjJNT_HINGE,
                pos=frame[:3],
                axis=turned,
            )
            if axis.limit is not None:
                joint.limited = True
                joint.range = (axis.middle - axis.limit, axis.middle + axis.limit)
                joint.solref_limit = _STIFF_LIMIT
                joint.solimp_limit = (0.95, 0.999, 0.0005, 0.5, 2)
            made.append(joint)
        if ball:
            made.append(body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL, pos=frame[:3]))
        if made:
            self.jointed[branch.constraint.id] = (branch, axes, ball, made, body)
        return made

    def scenery(self) -> list[BodyId]:
        """Adds what is only there to be bumped into, and says which bodies that were."""
        plan = self.blueprint
        busy = {id for pair in plan.collisions.apart for id in pair}
        busy |= {end for constraint in plan.constraints.values() for end in (constraint.parent, constraint.child)}
        scenery = []
        for assembly in plan.forest.assemblies.values():
            if assembly.mobility in _FIXED and busy.isdisjoint(assembly.bodies):
                for id in assembly.bodies:
                    self._geometry(self.spec.worldbody, id, plan.where[plan.rows[id]])
                scenery += assembly.bodies
        return scenery

    def _body(self, parent: Any, id: BodyId, place: Array) -> Any:
        plan = self.blueprint
        body = parent.add_body(name=_name(id), pos=place[:3], quat=place[3:])
        self.made[id] = body
        description = plan.bodies[id]
        self._geometry(body, id, _HERE)
        mass = plan.masses.get(id, 0.0)
        if mass > 0.0:
            body.explicitinertial = True
            body.mass, body.inertia = mass, mass * self.inertias[plan.rows[id]]
            body.ipos, body.iquat = _HERE[:3], _HERE[3:]
        if description.physics.gravity is False:
            body.gravcomp = 1.0
        return body

    def _geometry(self, body: Any, id: BodyId, place: Array) -> None:
        """The shape of one of our bodies, somewhere on one of MuJoCo's."""
        plan = self.blueprint
        ghost = id in plan.collisions.ghosts
        plates = plan.collisions.hollows.get(id)
        if plates is None:
            kind, extent = primitive(plan.bodies[id], self.halves[plan.rows[id]])
            add_geom(body, kind, extent, place[:3], place[3:], ghost)
            return
        centres = np.array([plate.centre for plate in plates])
        if place is not _HERE:
            centres = compose(place, np.concatenate([centres, np.tile(_HERE[3:], (len(plates), 1))], axis=1))[:, :3]
        extents = np.maximum([plate.size for plate in plates], THINNEST_M) / 2
        for centre, extent in zip(centres, extents.tolist(), strict=True):
            add_geom(body, mujoco.mjtGeom.mjGEOM_BOX, extent, centre, place[3:], ghost)

    def apart(self) -> None:
        """Pairs that never collide: decided ones, and the parts of one piece of furniture."""
        plan = self.blueprint
        pairs = set(plan.collisions.apart)
        for one, other in self._joined_assemblies():
            for a in plan.forest.assemblies[one].bodies:
                pairs |= {(a, b) if a < b else (b, a) for b in plan.forest.assemblies[other].bodies}
        for a, b in sorted(pairs):
            if a in self.made and b in self.made and plan.forest.of_body[a] != plan.forest.of_body[b]:
                self.spec.add_exclude(bodyname1=_name(a), bodyname2=_name(b))

    def _joined_assemblies(self) -> set[tuple[BodyId, BodyId]]:
        """Pairs of tops: two ends of a constraint, and a door with what else is fixed to its case (racks, bars)."""
        plan = self.blueprint
        neighbours: dict[BodyId, set[BodyId]] = {}
        for constraint in plan.constraints.values():
            if constraint.disable_collision is not False:
                one, other = plan.forest.of_body[constraint.parent], plan.forest.of_body[constraint.child]
                neighbours.setdefault(one, set()).add(other)
                neighbours.setdefault(other, set()).add(one)
        pairs = {(one, other) for one, others in neighbours.items() for other in others if one < other}
        for top, branch in plan.forest.branches.items():
            beside = neighbours.get(plan.forest.of_body[branch.parent], ())
            pairs |= {(top, other) for other in beside if not plan.forest.assemblies[other].simulates}
        return pairs

    def loop(self, branch: Branch) -> None:
        """A constraint that closes a loop.

        MuJoCo has equalities for "welded" and "one point in common". Any other kind goes through a light go-between
        that has the joints and is welded to the far side.
        """
        of_parent, of_child = branch.seen_from_root(self.blueprint.ends[branch.constraint.id])
        axes = axes_of(branch.constraint, upside_down=branch.upside_down)
        linear, angular = branch.constraint.linear, branch.constraint.angular
        pinned = all(motion is Motion.LOCKED for motion in (linear.x, linear.y, linear.z))
        turns = all(motion is Motion.FREE for motion in (angular.twist, angular.swing1, angular.swing2))
        if not axes:
            self._weld(_name(branch.parent), _name(branch.child), compose(of_parent, invert(of_child)))
        elif pinned and turns:
            equality = self.spec.add_equality(
                type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY,
                name1=_name(branch.child), name2=_name(branch.parent),
            )  # fmt: skip
            equality.data[:3] = of_child[:3]
        else:
            self._go_between(branch, axes, of_parent, of_child)

    def _go_between(self, branch: Branch, axes: tuple[Axis, ...], of_parent: Array, of_child: Array) -> None:
        plan = self.blueprint
        name = f"loop:{branch.constraint.id}"
        body = self.made[branch.parent].add_body(name=name, pos=of_parent[:3], quat=of_parent[3:])
        mass = 0.01 * max(plan.forest.assemblies[plan.forest.of_body[branch.child]].mass_kg, 0.1)
        body.explicitinertial, body.mass, body.inertia = True, mass, np.full(3, mass * 0.01)
        body.ipos, body.iquat = _HERE[:3], _HERE[3:]
        body.gravcomp = 1.0
        self._joints(body, branch, axes, is_ball(axes), _HERE)
        self._weld(name, _name(branch.child), invert(of_child))

    def _weld(self, first: str, second: str, second_from_first: Array) -> None:
        equality = self.spec.add_equality(
            type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1=first, name2=second
        )
        equality.data[:3] = 0.0
        equality.data[3:10] = second_from_first
        equality.data[10] = 1.0

    def finish(self, scenery: list[BodyId]) -> Live:
        plan = self.blueprint
        try:
            model = self.spec.compile()
        except ValueError as error:  # what MuJoCo's compiler refuses; the inventory should have refused it before
            raise EngineUnavailable("mujoco", cause=f"it cannot compile this world: {error}") from error
        data = mujoco.MjData(model)
        numbers = {id: body.id for id, body in self.made.items()}
        joints = {}
        for id, (branch, axes, ball, made, body) in self.jointed.items():
            first = made[0].id
            position, velocity = int(model.jnt_qposadr[first]), int(model.jnt_dofadr[first])
            joints[id] = Joint(branch, axes, ball, position, velocity, body.id)
        free = {
            top: (int(model.jnt_qposadr[joint.id]), int(model.jnt_dofadr[joint.id])) for top, joint in self.free.items()
        }
        mocap = {
            top: int(model.body_mocapid[numbers[top]])
            for top, assembly in plan.forest.assemblies.items()
            if assembly.mobility is Mobility.KINEMATIC
        }
        order = np.fromiter((numbers.get(id, 0) for id in plan.rows), dtype=np.intp, count=len(plan.rows))
        rows = np.array([plan.rows[id] for id in scenery], dtype=np.intp)
        return Live(model, data, plan.rows, numbers, order, rows, plan.where[rows], joints, free, mocap)


def build(blueprint: Blueprint, *, scenery: bool = True) -> Live:
    """Compiles a blueprint.

    Args:
        blueprint: what is built.
        scenery: whether what never moves may be geometry of MuJoCo's world, and no body of its own.

    Raises:
        EngineUnavailable: MuJoCo refuses the model; its words are in the cause.
    """
    builder = _Builder(blueprint)
    builder.options()
    standing = set(fixed := builder.scenery() if scenery else [])
    for assembly in blueprint.forest.assemblies.values():
        if assembly.top not in standing:
            builder.assembly(assembly)
    for branch in blueprint.forest.loops:
        builder.loop(branch)
    builder.apart()
    live = builder.finish(fixed)
    soften(live.model, live.joints.values())
    add_friction(live.model, live.data, live.joints.values())
    return live


def _name(id: BodyId) -> str:
    return f"body:{id}"  # "world" is a name of MuJoCo's own


def _rotate(quaternion: Array, vector: Array) -> Array:
    out = np.zeros(3)
    mujoco.mju_rotVecQuat(out, vector, quaternion)
    return out
