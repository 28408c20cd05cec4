"""Build: a blueprint becomes a compiled MuJoCo model.

Every body becomes one MuJoCo body, except scenery: what never moves and has nothing to do with anything that
does becomes geometry of MuJoCo's world, because adding a body costs MuJoCo a walk over all bodies so far.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import repeat
from typing import Any

import mujoco
import numpy as np

from mindstage.engines.forest import Assembly, Branch
from mindstage.engines.joints import Axis, axes_of, is_ball
from mindstage.engines.mujoco.blueprint import Blueprint
from mindstage.engines.mujoco.live import Joint, Live
from mindstage.engines.mujoco.reach import beyond_reach
from mindstage.engines.mujoco.shapes import add_geom, inertia_frame, set_defaults, touch_of, unit_inertias
from mindstage.engines.mujoco.tuning import add_friction, soften
from mindstage.errors import EngineUnavailable
from mindstage.world import BodyId, Mobility, Motion, Solid, SolidKind, Vector
from mindstage.world.boxes import Boxes
from mindstage.world.geometry import Array, compose, invert, rotate

__all__ = ["build"]

_STIFF_LIMIT = (0.005, 1.0)
"""Time constant [s] and damping ratio of a hard limit: a strong arm presses a drawer less than 1 mm past it."""
_HERE = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
_DIRECTIONS = np.eye(3)
_UNTURNED = [1.0, 0.0, 0.0, 0.0]


class _Builder:
    """Holds what the steps of one build share."""

    def __init__(self, blueprint: Blueprint) -> None:
        self.blueprint = blueprint
        self.spec = mujoco.MjSpec()
        set_defaults(self.spec)
        self.inertias = unit_inertias(blueprint.bodies.values(), blueprint.sizes)
        self.meshes: dict[tuple[Vector, ...], str] = {}
        """By the points of hulls."""
        self.standing = Boxes.of(np.zeros((0, 7)), np.zeros((0, 3)))
        """Round each part of the scenery."""
        self.frames = _frames(blueprint)
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
            elif not plan.stands(assembly):
                top.mocap = True
        else:
            self._branch(assembly, branch)
        for id in assembly.bodies[1:]:
            self._body(self.made[plan.forest.holders[id]], id, plan.planner.holds[id])

    def _branch(self, assembly: Assembly, branch: Branch) -> None:
        parent_from_top, top_from_frame = self.frames[assembly.top]
        top = self._body(self.made[branch.parent], assembly.top, parent_from_top)
        axes = axes_of(branch.constraint, upside_down=branch.upside_down)
        ball = is_ball(axes)
        self._joints(top, branch, axes, ball, top_from_frame)

    def _joints(self, body: Any, branch: Branch, axes: tuple[Axis, ...], ball: bool, frame: Array) -> list[Any]:
        """The joints of one constraint, on a body in which its frame is known."""
        made = []
        for axis in axes:
            if ball and not axis.slides:
                continue
            turned = rotate(frame[3:], _DIRECTIONS[axis.direction])
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
        busy = {id for pair in plan.planner.collisions.apart for id in pair}
        constraints = plan.planner.inventory.constraints.values()
        busy |= {end for constraint in constraints for end in (constraint.parent, constraint.child)}
        scenery: list[BodyId] = []
        for assembly in plan.forest.assemblies.values():
            if plan.stands(assembly) and busy.isdisjoint(assembly.bodies):
                scenery += assembly.bodies
        made = [plan.planner.solids(id) for id in scenery]
        counts = [len(solids) for solids, _ in made]
        standing = np.repeat(plan.where[[plan.rows[id] for id in scenery]], counts, axis=0)
        local = [_HERE[None] if places is None else places for _, places in made]
        places = compose(standing, np.concatenate([np.zeros((0, 7)), *local]))
        extents = np.array([solid.size for solids, _ in made for solid in solids]).reshape(-1, 3)
        self.standing = Boxes.of(places, extents)
        each = iter(places.tolist())
        for id, (solids, _) in zip(scenery, made, strict=True):
            self._geometry(self.spec.worldbody, id, zip(solids, each, strict=False))
        return scenery

    def _body(self, parent: Any, id: BodyId, place: Array) -> Any:
        plan = self.blueprint
        pose = place.tolist()  # MuJoCo takes lists faster than arrays
        if pose[3:] == _UNTURNED:
            body = parent.add_body(name=_name(id), pos=pose[:3])
        else:
            body = parent.add_body(name=_name(id), pos=pose[:3], quat=pose[3:])
        self.made[id] = body
        description = plan.bodies[id]
        solids, places = plan.planner.solids(id)
        if places is None:
            self._geometry(body, id, zip(solids, repeat(None), strict=False))
        else:
            self._geometry(body, id, zip(solids, places.tolist(), strict=True))
        mass = plan.masses.get(id, 0.0)
        if mass > 0.0:
            body.explicitinertial = True
            body.ipos, body.iquat, moments = self._inertia(id)
            body.mass, body.inertia = mass, mass * moments
        if description.physics.gravity is False:
            body.gravcomp = 1.0
        return body

    def _inertia(self, id: BodyId) -> tuple[Array, Array, Array]:
        """Where the mass lies, along which axes, and its moments for 1 kg."""
        if id in self.blueprint.planner.forms:
            return inertia_frame(self.blueprint.planner.matter.prepared(id))
        return _HERE[:3], _HERE[3:], self.inertias[self.blueprint.rows[id]]

    def _geometry(self, body: Any, id: BodyId, solids: Iterable[tuple[Solid, Sequence[float] | None]]) -> None:
        """What of one of our bodies can be touched, and where that is on one of MuJoCo's."""
        planner = self.blueprint.planner
        ghost = id in planner.collisions.ghosts
        touch = touch_of(planner.forms.get(id), self.blueprint.timestep_s, ghost=ghost)
        for solid, place in solids:
            add_geom(body, solid, place, touch=touch, mesh=self._mesh(solid))

    def _mesh(self, solid: Solid) -> str:
        """The name of a hull's mesh, each made once; an empty one for what is no hull."""
        if solid.kind is not SolidKind.HULL:
            return ""
        if solid.points not in self.meshes:
            name = self.meshes[solid.points] = f"hull{len(self.meshes)}"
            self.spec.add_mesh(name=name, uservert=[number for point in solid.points for number in point])
        return self.meshes[solid.points]

    def apart(self) -> None:
        """Pairs that never collide."""
        for a, b in sorted(self.blueprint.apart):
            if a in self.made and b in self.made:
                self.spec.add_exclude(bodyname1=_name(a), bodyname2=_name(b))
        axes = {id: axes for id, (_, axes, _, _, _) in self.jointed.items()}
        for id in beyond_reach(self.blueprint, axes, self.standing):
            self.spec.add_exclude(bodyname1="world", bodyname2=_name(id))

    def loop(self, branch: Branch) -> None:
        """A constraint that closes a loop.

        MuJoCo has equalities for "welded" and "one point in common". Any other kind goes through a light go-between
        that has the joints and is welded to the far side.
        """
        of_parent, of_child = branch.seen_from_root(self.blueprint.planner.ends[branch.constraint.id])
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
            if plan.driven and assembly.mobility is Mobility.KINEMATIC
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


def _frames(plan: Blueprint) -> dict[BodyId, tuple[Array, Array]]:
    """Of each hanging assembly: its top seen from the parent body, and the joint's frame seen from the top."""
    branches = plan.forest.branches
    if not branches:
        return {}
    ends = [branch.seen_from_root(plan.planner.ends[branch.constraint.id]) for branch in branches.values()]
    top_from_frame = np.array([of_child for _, of_child in ends])
    inner = [row for row, (top, branch) in enumerate(branches.items()) if branch.child != top]
    if inner:
        tops, joined = list(branches), list(branches.values())
        top_from_world = invert(plan.where[[plan.rows[tops[row]] for row in inner]])
        world_from_child = plan.where[[plan.rows[joined[row].child] for row in inner]]
        top_from_frame[inner] = compose(compose(top_from_world, world_from_child), top_from_frame[inner])
    parent_from_top = compose(np.array([of_parent for of_parent, _ in ends]), invert(top_from_frame))
    return dict(zip(branches, zip(parent_from_top, top_from_frame, strict=True), strict=True))


def _name(id: BodyId) -> str:
    return f"body:{id}"  # "world" is a name of MuJoCo's own
