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

from mindstage.engines.forest import RigidGroup, TreeJoint
from mindstage.engines.joints import JointAxis, is_ball, movable_axes
from mindstage.engines.mujoco.blueprint import ModelInput
from mindstage.engines.mujoco.live import CompiledModel, ModelJoint
from mindstage.engines.mujoco.reach import cull_static_contacts
from mindstage.engines.mujoco.shapes import add_geom, contact_options, inertia_frame, set_defaults, unit_inertias
from mindstage.engines.mujoco.tuning import set_joint_friction, set_soft_limits
from mindstage.errors import EngineUnavailableError
from mindstage.world import AxisMotion, BodyId, CollisionShape, CollisionShapeType, Mobility, Vector
from mindstage.world.boxes import OrientedBoxes
from mindstage.world.geometry import Array, pose_inverse, pose_multiply, quat_rotate

__all__ = ["compile_model"]

_HARD_LIMIT_SOLREF = (0.005, 1.0)
"""Time constant [s] and damping ratio of a hard limit: a strong arm presses a drawer less than 1 mm past it."""
_IDENTITY_POSE = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
_DIRECTIONS = np.eye(3)
_UNTURNED = [1.0, 0.0, 0.0, 0.0]


class _SpecBuilder:
    """Holds what the steps of one build share."""

    def __init__(self, model_input: ModelInput) -> None:
        self.model_input = model_input
        self.spec = mujoco.MjSpec()
        set_defaults(self.spec)
        self.inertias = unit_inertias(model_input.bodies.values(), model_input.sizes)
        self.meshes: dict[tuple[Vector, ...], str] = {}
        """By the points of hulls."""
        self.scenery_boxes = OrientedBoxes.from_poses(np.zeros((0, 7)), np.zeros((0, 3)))
        """Round each part of the scenery."""
        self.frames = _frames(model_input)
        self.spec_bodies: dict[BodyId, Any] = {}
        self.free_joints: dict[BodyId, Any] = {}
        self.spec_joints: dict[BodyId, tuple[TreeJoint, tuple[JointAxis, ...], bool, list[Any], Any]] = {}

    def set_options(self) -> None:
        option = self.spec.option
        option.timestep = self.model_input.timestep_s
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        option.impratio = 10.0  # friction nearly as stiff as contact, so that nothing creeps down a slope
        option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)  # a broken world must not look like a new one
        self.spec.compiler.degree = False

    def add_group(self, group: RigidGroup) -> None:
        plan = self.model_input
        branch = plan.forest.tree_joints.get(group.root)
        if branch is None:
            top = self._add_body(self.spec.worldbody, group.root, plan.poses[plan.rows[group.root]])
            if group.is_dynamic:
                self.free_joints[group.root] = top.add_freejoint()
            elif not plan.is_fixed(group):
                top.mocap = True
        else:
            self._add_tree_joint(group, branch)
        for id in group.bodies[1:]:
            self._add_body(self.spec_bodies[plan.forest.rigid_parents[id]], id, plan.builder.attachment_poses[id])

    def _add_tree_joint(self, group: RigidGroup, tree_joint: TreeJoint) -> None:
        parent_from_top, top_from_frame = self.frames[group.root]
        top = self._add_body(self.spec_bodies[tree_joint.parent], group.root, parent_from_top)
        axes = movable_axes(tree_joint.joint, is_reversed=tree_joint.is_reversed)
        ball = is_ball(axes)
        self._add_joints(top, tree_joint, axes, ball, top_from_frame)

    def _add_joints(
        self, body: Any, tree_joint: TreeJoint, axes: tuple[JointAxis, ...], has_ball: bool, frame: Array
    ) -> list[Any]:
        """The joints of one constraint, on a body in which its frame is known."""
        made = []
        for axis in axes:
            if has_ball and not axis.is_prismatic:
                continue
            turned = quat_rotate(frame[3:], _DIRECTIONS[axis.direction])
            joint = body.add_joint(
                type=mujoco.mjtJoint.mjJNT_SLIDE if axis.is_prismatic else mujoco.mjtJoint.mjJNT_HINGE,
                pos=frame[:3],
                axis=turned,
            )
            if axis.limit is not None:
                joint.limited = True
                joint.range = (axis.middle - axis.limit, axis.middle + axis.limit)
                joint.solref_limit = _HARD_LIMIT_SOLREF
                joint.solimp_limit = (0.95, 0.999, 0.0005, 0.5, 2)
            made.append(joint)
        if has_ball:
            made.append(body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL, pos=frame[:3]))
        if made:
            self.spec_joints[tree_joint.joint.id] = (tree_joint, axes, has_ball, made, body)
        return made

    def add_scenery(self) -> list[BodyId]:
        """Adds what is only there to be bumped into, and says which bodies that were."""
        plan = self.model_input
        busy = {id for pair in plan.builder.collision_filter.excluded_pairs for id in pair}
        constraints = plan.builder.registry.joints.values()
        busy |= {end for constraint in constraints for end in (constraint.parent, constraint.child)}
        scenery: list[BodyId] = []
        for assembly in plan.forest.groups.values():
            if plan.is_fixed(assembly) and busy.isdisjoint(assembly.bodies):
                scenery += assembly.bodies
        made = [plan.builder.collision_shapes(id) for id in scenery]
        counts = [len(solids) for solids, _ in made]
        standing = np.repeat(plan.poses[[plan.rows[id] for id in scenery]], counts, axis=0)
        local = [_IDENTITY_POSE[None] if places is None else places for _, places in made]
        places = pose_multiply(standing, np.concatenate([np.zeros((0, 7)), *local]))
        extents = np.array([solid.size for solids, _ in made for solid in solids]).reshape(-1, 3)
        self.scenery_boxes = OrientedBoxes.from_poses(places, extents)
        each = iter(places.tolist())
        for id, (solids, _) in zip(scenery, made, strict=True):
            self._add_geoms(self.spec.worldbody, id, zip(solids, each, strict=False))
        return scenery

    def _add_body(self, parent: Any, id: BodyId, body_pose: Array) -> Any:
        plan = self.model_input
        pose = body_pose.tolist()  # MuJoCo takes lists faster than arrays
        if pose[3:] == _UNTURNED:
            body = parent.add_body(name=_name(id), pos=pose[:3])
        else:
            body = parent.add_body(name=_name(id), pos=pose[:3], quat=pose[3:])
        self.spec_bodies[id] = body
        description = plan.bodies[id]
        solids, places = plan.builder.collision_shapes(id)
        if places is None:
            self._add_geoms(body, id, zip(solids, repeat(None), strict=False))
        else:
            self._add_geoms(body, id, zip(solids, places.tolist(), strict=True))
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
        if id in self.model_input.builder.geometry:
            return inertia_frame(self.model_input.builder.mass_properties.compiled(id))
        return _IDENTITY_POSE[:3], _IDENTITY_POSE[3:], self.inertias[self.model_input.rows[id]]

    def _add_geoms(
        self, body: Any, id: BodyId, shapes: Iterable[tuple[CollisionShape, Sequence[float] | None]]
    ) -> None:
        """What of one of our bodies can be touched, and where that is on one of MuJoCo's."""
        planner = self.model_input.builder
        ghost = id in planner.collision_filter.non_colliding
        touch = contact_options(planner.geometry.get(id), self.model_input.timestep_s, non_colliding=ghost)
        for solid, place in shapes:
            add_geom(body, solid, place, geom_options=touch, mesh=self._hull_mesh_name(solid))

    def _hull_mesh_name(self, shape: CollisionShape) -> str:
        """The name of a hull's mesh, each made once; an empty one for what is no hull."""
        if shape.type is not CollisionShapeType.HULL:
            return ""
        if shape.points not in self.meshes:
            name = self.meshes[shape.points] = f"hull{len(self.meshes)}"
            self.spec.add_mesh(name=name, uservert=[number for point in shape.points for number in point])
        return self.meshes[shape.points]

    def add_excludes(self) -> None:
        """Pairs that never collide."""
        for a, b in sorted(self.model_input.excluded_pairs):
            if a in self.spec_bodies and b in self.spec_bodies:
                self.spec.add_exclude(bodyname1=_name(a), bodyname2=_name(b))
        axes = {id: axes for id, (_, axes, _, _, _) in self.spec_joints.items()}
        for id in cull_static_contacts(self.model_input, axes, self.scenery_boxes):
            self.spec.add_exclude(bodyname1="world", bodyname2=_name(id))

    def add_loop_joint(self, tree_joint: TreeJoint) -> None:
        """A constraint that closes a loop.

        MuJoCo has equalities for "welded" and "one point in common". Any other kind goes through a light go-between
        that has the joints and is welded to the far side.
        """
        of_parent, of_child = tree_joint.order_ends(self.model_input.builder.joint_frames[tree_joint.joint.id])
        axes = movable_axes(tree_joint.joint, is_reversed=tree_joint.is_reversed)
        linear, angular = tree_joint.joint.linear, tree_joint.joint.angular
        pinned = all(motion is AxisMotion.LOCKED for motion in (linear.x, linear.y, linear.z))
        turns = all(motion is AxisMotion.FREE for motion in (angular.twist, angular.swing1, angular.swing2))
        if not axes:
            self._add_weld(
                _name(tree_joint.parent), _name(tree_joint.child), pose_multiply(of_parent, pose_inverse(of_child))
            )
        elif pinned and turns:
            equality = self.spec.add_equality(
                type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY,
                name1=_name(tree_joint.child), name2=_name(tree_joint.parent),
            )  # fmt: skip
            equality.data[:3] = of_child[:3]
        else:
            self._add_intermediate_body(tree_joint, axes, of_parent, of_child)

    def _add_intermediate_body(
        self, tree_joint: TreeJoint, axes: tuple[JointAxis, ...], parent_from_joint: Array, child_from_joint: Array
    ) -> None:
        plan = self.model_input
        name = f"loop:{tree_joint.joint.id}"
        body = self.spec_bodies[tree_joint.parent].add_body(
            name=name, pos=parent_from_joint[:3], quat=parent_from_joint[3:]
        )
        mass = 0.01 * max(plan.forest.groups[plan.forest.root_of[tree_joint.child]].mass_kg, 0.1)
        body.explicitinertial, body.mass, body.inertia = True, mass, np.full(3, mass * 0.01)
        body.ipos, body.iquat = _IDENTITY_POSE[:3], _IDENTITY_POSE[3:]
        body.gravcomp = 1.0
        self._add_joints(body, tree_joint, axes, is_ball(axes), _IDENTITY_POSE)
        self._add_weld(name, _name(tree_joint.child), pose_inverse(child_from_joint))

    def _add_weld(self, first: str, second: str, second_from_first: Array) -> None:
        equality = self.spec.add_equality(
            type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1=first, name2=second
        )
        equality.data[:3] = 0.0
        equality.data[3:10] = second_from_first
        equality.data[10] = 1.0

    def compile(self, scenery: list[BodyId]) -> CompiledModel:
        plan = self.model_input
        try:
            model = self.spec.compile()
        except ValueError as error:  # what MuJoCo's compiler refuses; the inventory should have refused it before
            raise EngineUnavailableError("mujoco", cause=f"it cannot compile this world: {error}") from error
        data = mujoco.MjData(model)
        numbers = {id: body.id for id, body in self.spec_bodies.items()}
        joints = {}
        for id, (branch, axes, ball, made, body) in self.spec_joints.items():
            first = made[0].id
            position, velocity = int(model.jnt_qposadr[first]), int(model.jnt_dofadr[first])
            joints[id] = ModelJoint(branch, axes, ball, position, velocity, body.id)
        free = {
            top: (int(model.jnt_qposadr[joint.id]), int(model.jnt_dofadr[joint.id]))
            for top, joint in self.free_joints.items()
        }
        mocap = {
            top: int(model.body_mocapid[numbers[top]])
            for top, assembly in plan.forest.groups.items()
            if plan.kinematics_driven and assembly.mobility is Mobility.KINEMATIC
        }
        order = np.fromiter((numbers.get(id, 0) for id in plan.rows), dtype=np.intp, count=len(plan.rows))
        rows = np.array([plan.rows[id] for id in scenery], dtype=np.intp)
        return CompiledModel(model, data, plan.rows, numbers, order, rows, plan.poses[rows], joints, free, mocap)


def compile_model(model_input: ModelInput, *, scenery: bool = True) -> CompiledModel:
    """Compiles a blueprint.

    Args:
        blueprint: what is built.
        scenery: whether what never moves may be geometry of MuJoCo's world, and no body of its own.

    Raises:
        EngineUnavailableError: MuJoCo refuses the model; its words are in the cause.
    """
    builder = _SpecBuilder(model_input)
    builder.set_options()
    standing = set(fixed := builder.add_scenery() if scenery else [])
    for assembly in model_input.forest.groups.values():
        if assembly.root not in standing:
            builder.add_group(assembly)
    for branch in model_input.forest.loop_joints:
        builder.add_loop_joint(branch)
    builder.add_excludes()
    live = builder.compile(fixed)
    set_soft_limits(live.model, live.joints.values())
    set_joint_friction(live.model, live.data, live.joints.values())
    return live


def _frames(plan: ModelInput) -> dict[BodyId, tuple[Array, Array]]:
    """Of each hanging assembly: its top seen from the parent body, and the joint's frame seen from the top."""
    branches = plan.forest.tree_joints
    if not branches:
        return {}
    ends = [branch.order_ends(plan.builder.joint_frames[branch.joint.id]) for branch in branches.values()]
    top_from_frame = np.array([of_child for _, of_child in ends])
    inner = [row for row, (top, branch) in enumerate(branches.items()) if branch.child != top]
    if inner:
        tops, joined = list(branches), list(branches.values())
        top_from_world = pose_inverse(plan.poses[[plan.rows[tops[row]] for row in inner]])
        world_from_child = plan.poses[[plan.rows[joined[row].child] for row in inner]]
        top_from_frame[inner] = pose_multiply(pose_multiply(top_from_world, world_from_child), top_from_frame[inner])
    parent_from_top = pose_multiply(np.array([of_parent for of_parent, _ in ends]), pose_inverse(top_from_frame))
    return dict(zip(branches, zip(parent_from_top, top_from_frame, strict=True), strict=True))


def _name(id: BodyId) -> str:
    return f"body:{id}"  # "world" is a name of MuJoCo's own
