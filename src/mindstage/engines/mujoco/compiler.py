"""Build: a blueprint becomes a compiled MuJoCo model.

Every body becomes one MuJoCo body, except scenery: what never moves and has nothing to do with anything that
does becomes geometry of MuJoCo's world, because adding a body costs MuJoCo a walk over all bodies so far.

Blueprint: all that was decided before a model is built, so that nothing is decided while it is.

Meshes: files that MuJoCo can read, and how large what is in them is.

Reach: what hangs in a joint on something that stands still, and never gets to the scenery.

A drawer in the middle of a room meets no wall, however far it is pulled. Told so, MuJoCo does not look for contacts
between the two in every step; in a kitchen it would look at a hundred parts of the scenery for each drawer.

Shapes: solids as MuJoCo's geoms, how they feel to the touch, and the inertia that goes with them.

MuJoCo gives two geoms that meet the friction and bounce of the one with the higher priority. So that wood on ice
slips and a ball bounces on wood, whatever is bouncy comes first, then what is more slippery; what nobody said
anything about comes last.

Tuning: how joints resist, set in a compiled model, where the inertia behind each joint is known.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import repeat
from math import exp, log, pi
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mindstage.engines.collision_filter import JOINT_TOUCH_TOLERANCE_M
from mindstage.engines.collision_shapes import MEAN_SQUARES, CompiledGeometry, primitive_collision_type
from mindstage.engines.kinematic_tree import JointAxis, KinematicForest, RigidGroup, TreeJoint, is_ball, movable_axes
from mindstage.engines.mujoco.state import CompiledModel, ModelJoint
from mindstage.engines.physics_model import PhysicsModelBuilder
from mindstage.errors import EngineUnavailableError
from mindstage.scene import AxisMotion, Body, BodyGeometry, BodyId, CollisionShape, CollisionShapeType, Mobility, Vector
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.transforms import Array, mesh_scale, pose_inverse, pose_multiply, quat_rotate

__all__ = [
    "GeomOptions",
    "ModelInput",
    "TriangleMesh",
    "add_geom",
    "compile_model",
    "contact_options",
    "cull_static_contacts",
    "inertia_frame",
    "load_mesh",
    "set_defaults",
    "set_joint_friction",
    "set_soft_limits",
    "unit_inertias",
]


_FIXED_MOBILITIES = (Mobility.STATIC, Mobility.STATIONARY)


@dataclass(slots=True)
class ModelInput:
    """All that a model is made from; rows of arrays go with `rows`."""

    builder: PhysicsModelBuilder
    poses: Array
    """Where the bodies stand, n x 7, unit quaternions."""
    timestep_s: float
    bodies: Mapping[BodyId, Body]
    rows: dict[BodyId, int]
    sizes: Array
    masses: dict[BodyId, float]
    forest: KinematicForest
    excluded_pairs: set[tuple[BodyId, BodyId]]
    kinematics_driven: bool = False
    """Whether somebody moves kinematic bodies; until then they are fixed like static ones, which costs nothing."""

    def is_fixed(self, group: RigidGroup) -> bool:
        """Whether it is fixed to the world."""
        return group.mobility in _FIXED_MOBILITIES or (
            group.mobility is Mobility.KINEMATIC and not self.kinematics_driven
        )

    @classmethod
    def from_builder(
        cls, builder: PhysicsModelBuilder, poses: Array, timestep_s: float, *, kinematics_driven: bool = False
    ) -> ModelInput:
        """What a planner decided about bodies that stand somewhere."""
        ids = builder.registry.ids
        rows = {id: row for row, id in enumerate(ids)}
        sizes, masses, bodies = builder.mass_properties.sizes(ids), builder.masses(), builder.registry.bodies
        return cls(
            builder,
            poses,
            timestep_s,
            bodies,
            rows,
            sizes,
            masses,
            builder.forest,
            builder.excluded_pairs(),
            kinematics_driven,
        )


_MESH_SUFFIXES = frozenset({".obj", ".stl", ".msh"})


@dataclass(frozen=True, slots=True)
class TriangleMesh:
    """One file."""

    path: Path
    extents: Array
    """Along x, y and z, in the file's own units."""

    def scale_to(self, size: Vector | None) -> tuple[float, float, float]:
        """What makes it as large as a body; 1 where it is so already, or where nobody knows."""
        x, y, z = mesh_scale(self.extents, size).tolist()
        return x, y, z


def load_mesh(path: Path) -> TriangleMesh | None:
    """A mesh, if MuJoCo can read it."""
    if path.suffix.lower() not in _MESH_SUFFIXES:
        return None
    spec = mujoco.MjSpec()
    spec.add_mesh(name="mesh", file=str(path), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    try:
        model = spec.compile()
    except ValueError:  # it says what is wrong with the file; whoever asked says that it is left out
        return None
    points = quat_rotate(model.mesh_quat[0], np.asarray(model.mesh_vert, dtype=np.float64)) + model.mesh_pos[0]
    return TriangleMesh(path, np.ptp(points, axis=0))


_LIMIT_OVERRUN_M = 0.05
"""So far something may slide past its limit, pushed hard; what turns is taken to turn all the way round."""
_CORNERS = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(8, 3)


def cull_static_contacts(
    model_input: ModelInput, axes: Mapping[BodyId, tuple[JointAxis, ...]], scenery: OrientedBoxes
) -> list[BodyId]:
    """The bodies that get to no scenery on the whole way that the one joint on which they hang lets them go.

    Args:
        plan: who hangs on whom, and where.
        axes: of each constraint that is a joint.
        scenery: what stands still.
    """
    hung = _limited_root_joints(model_input, axes)
    if not hung or not len(scenery.center):
        return []
    low, high = _swept_bounds(model_input, hung)
    first, last = scenery.bounds()
    meets = np.all((low[:, None] < last[None]) & (high[:, None] > first[None]), axis=2).any(axis=1)
    far = (top for top, met in zip(hung, meets.tolist(), strict=True) if not met)
    return [id for top in far for id in model_input.forest.groups[top].bodies]


def _limited_root_joints(
    model_input: ModelInput, axes: Mapping[BodyId, tuple[JointAxis, ...]]
) -> dict[BodyId, JointAxis]:
    """The tops that a joint of one axis, with hard limits, holds to what stands still."""
    forest = model_input.forest
    found = {}
    for top, branch in forest.tree_joints.items():
        joint = axes.get(branch.joint.id, ())
        limited = len(joint) == 1 and joint[0].limit is not None and not joint[0].soft_limit.enabled
        if limited and model_input.is_fixed(forest.groups[forest.root_of[branch.parent]]):
            found[top] = joint[0]
    return found


def _swept_bounds(model_input: ModelInput, root_joints: Mapping[BodyId, JointAxis]) -> tuple[Array, Array]:
    """The corners of upright boxes that hold the assemblies, wherever their joints let them be."""
    joints = list(root_joints.values())
    branches = [model_input.forest.tree_joints[top] for top in root_joints]
    ends = [branch.order_ends(model_input.builder.joint_frames[branch.joint.id]) for branch in branches]
    fixed = pose_multiply(
        model_input.poses[[model_input.rows[branch.parent] for branch in branches]], np.array([end[0] for end in ends])
    )
    moving = pose_multiply(
        model_input.poses[[model_input.rows[branch.child] for branch in branches]], np.array([end[1] for end in ends])
    )
    low, high = _group_bounds(model_input, list(root_joints))
    number = [joint.direction for joint in joints]
    directions = quat_rotate(fixed[:, 3:], np.eye(3)[number])
    now = pose_multiply(pose_inverse(fixed), moving)[np.arange(len(joints)), number]
    limits = np.array([(joint.limit or 0.0) + _LIMIT_OVERRUN_M for joint in joints])
    middles = np.array([joint.middle for joint in joints])
    ways = np.stack([middles - limits - now, middles + limits - now], axis=1)
    shifts = ways[:, :, None] * directions[:, None]
    turned_low, turned_high = _rotation_bounds(low, high, moving[:, :3], directions)
    slides = np.array([joint.is_prismatic for joint in joints])[:, None]
    low = np.where(slides, low + np.minimum(shifts.min(axis=1), 0.0), turned_low)
    return low, np.where(slides, high + np.maximum(shifts.max(axis=1), 0.0), turned_high)


def _group_bounds(model_input: ModelInput, roots: list[BodyId]) -> tuple[Array, Array]:
    """The corners of upright boxes round assemblies as they stand."""
    bodies = [model_input.forest.groups[top].bodies for top in roots]
    rows = [model_input.rows[id] for each in bodies for id in each]
    low, high = OrientedBoxes.from_poses(model_input.poses[rows], model_input.sizes[rows]).bounds()
    first = np.cumsum([0, *(len(each) for each in bodies[:-1])])
    return np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)


def _rotation_bounds(low: Array, high: Array, anchors: Array, axes: Array) -> tuple[Array, Array]:
    """The boxes in which other ones stay, however far they are turned about an axis."""
    away = low[:, None] + _CORNERS * (high - low)[:, None] - anchors[:, None]
    along = np.einsum("nci,ni->nc", away, axes)
    radius = np.linalg.norm(away - along[..., None] * axes[:, None], axis=2).max(axis=1)
    start, end = along.min(axis=1), along.max(axis=1)
    middle = anchors + axes * ((start + end) / 2)[:, None]
    half = np.abs(axes) * ((end - start) / 2)[:, None] + np.sqrt(np.maximum(1.0 - axes**2, 0.0)) * radius[:, None]
    return middle - half, middle + half


GeomOptions = dict[str, Any]
"""Options of geoms."""

_FRICTION = (0.8, 0.005, 0.0001)
_DEFAULT_CONTACT: GeomOptions = {}
_NO_CONTACT: GeomOptions = {"contype": 0, "conaffinity": 0, "friction": (1.0, 0.005, 0.0001)}
_MIN_INERTIA_SIZE_M = 0.005
"""For inertia a body is taken at least this thick, or a sheet of paper would spin without end."""
_MIN_RESTITUTION = 0.5
"""What bounces less, as all furniture does, has MuJoCo's own contacts: they hardly bounce, but come to rest."""
_CONTACT_TIME_CONSTANT_S = 0.02
"""MuJoCo's own time constant of a contact."""
_MIN_CONTACT_STEPS = 20.0
"""A bounce lasts at least so many time steps, or the solver would not see it."""
_GEOMS = {
    CollisionShapeType.BOX: mujoco.mjtGeom.mjGEOM_BOX,
    CollisionShapeType.SPHERE: mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    CollisionShapeType.CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    CollisionShapeType.HULL: mujoco.mjtGeom.mjGEOM_MESH,
}


def contact_options(geometry: BodyGeometry | None, timestep_s: float, *, non_colliding: bool) -> GeomOptions:
    """How a form's surface feels to others; what it does not say is as everywhere, and a ghost feels like nothing."""
    if non_colliding:
        return _NO_CONTACT
    if geometry is None or (geometry.friction is None and geometry.restitution is None):
        return _DEFAULT_CONTACT
    sliding = _FRICTION[0] if geometry.friction is None else max(geometry.friction, 1e-5)
    priority = 0 if geometry.friction is None else 1 + round(1000 * exp(-sliding))
    bounce = min(geometry.restitution or 0.0, 0.98)
    if bounce < _MIN_RESTITUTION:
        return {"friction": (sliding, *_FRICTION[1:]), "priority": priority}
    # A damped spring of ratio z sends back the part exp(-pi z / sqrt(1 - z^2)) of the speed with which it was hit.
    damping = -log(bounce) / (pi**2 + log(bounce) ** 2) ** 0.5
    slow_enough = _MIN_CONTACT_STEPS * timestep_s / (pi * damping)
    solref = (max(_CONTACT_TIME_CONSTANT_S, slow_enough), damping)
    return {"friction": (sliding, *_FRICTION[1:]), "priority": 10_000 + round(1000 * bounce), "solref": solref}


def set_defaults(spec: Any) -> None:
    """Sets what all geoms of a spec have in common: each attribute given to `add_geom` costs as much as its rest."""
    geom = spec.default.geom
    geom.type, geom.mass, geom.margin, geom.friction = (
        mujoco.mjtGeom.mjGEOM_BOX,
        0.0,
        -JOINT_TOUCH_TOLERANCE_M,
        _FRICTION,
    )


def add_geom(
    body: Any,
    collision_shape: CollisionShape,
    pose: Sequence[float] | None,
    *,
    geom_options: GeomOptions,
    mesh: str = "",
) -> None:
    """Adds a massless solid to one of MuJoCo's bodies, of a spec with `set_defaults`.

    Args:
        body: the spec's.
        solid: what is added.
        place: of its middle on that body, seven numbers; None for the body's own pose.
        touch: how it feels, and whom.
        mesh: the name of the mesh that a hull was made into.
    """
    options: dict[str, Any] = {"meshname": mesh} if mesh else {"size": _half_extents(collision_shape)}
    if pose is not None:
        options["pos"], options["quat"] = pose[:3], pose[3:]
    if collision_shape.type is not CollisionShapeType.BOX:
        options["type"] = _GEOMS[collision_shape.type]
    body.add_geom(**options, **geom_options)


def _half_extents(collision_shape: CollisionShape) -> list[float]:
    """Half extents, as MuJoCo wants them; a cylinder is as wide as it is on average."""
    x, y, z = (extent / 2 for extent in collision_shape.size)
    return [(x + y) / 2, z, 0.0] if collision_shape.type is CollisionShapeType.CYLINDER else [x, y, z]


def unit_inertias(bodies: Iterable[Body], sizes: Array) -> Array:
    """The moments of solids that fill the bodies' sizes, for 1 kg, n x 3 [m²]."""
    factors = np.array([MEAN_SQUARES[primitive_collision_type(body)] for body in bodies]).reshape(-1, 3)
    squares = np.maximum(sizes, _MIN_INERTIA_SIZE_M) ** 2 * factors
    return np.asarray(squares.sum(axis=1, keepdims=True) - squares)


@lru_cache(maxsize=4096)
def inertia_frame(compiled: CompiledGeometry) -> tuple[Array, Array, Array]:
    """Where the mass of a form lies: its middle, the directions of its principal axes, and their moments for 1 kg.

    A body that nothing can touch has the inertia of something small. A form is worked out once, however often a model
    is built.
    """
    moments, axes = np.linalg.eigh(compiled.inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    turn = np.zeros(4)
    mujoco.mju_mat2Quat(turn, axes.reshape(9))
    return compiled.center_of_mass, turn, np.maximum(moments, _MIN_INERTIA_SIZE_M**2 / 6)


_SLIDE_FRICTION = 1.0
"""A slide holds against what would accelerate it by this [m/s²]: 5 N for a drawer of 5 kg."""
_HINGE_FRICTION = 2.0
"""The same for hinges [rad/s²]."""
_DAMPING = 1.0
"""Of the speed along a joint, this part is lost in a second [1/s]."""


def set_soft_limits(model: Any, joints: Iterable[ModelJoint]) -> None:
    """Soft limits as springs and dampers of their true strength.

    A MuJoCo constraint of impedance d lets through 1 - d of every other force and adds d of its own, whose stiffness
    and damping are told for a unit of inertia and divided by d inside MuJoCo. With a small d that is the
    spring asked for; a spring too stiff for the time step gets a larger one, which is softer than asked but stable.
    """
    for joint in joints:
        limitable = [axis for axis in joint.axes if axis.is_prismatic or not joint.is_ball]
        for offset, axis in enumerate(limitable):
            if axis.soft_limit.enabled and axis.limit is not None and axis.soft_limit.stiffness > 0.0:
                dof = joint.dof_address + offset
                number = int(model.dof_jntid[dof])
                weight = model.dof_invweight0[dof]
                impedance = float(np.clip(10 * axis.soft_limit.stiffness * weight * model.opt.timestep**2, 0.01, 0.95))
                damping = max(axis.soft_limit.damping, 1e-6)
                model.jnt_solref[number] = (-axis.soft_limit.stiffness * weight, -damping * weight)
                model.jnt_solimp[number] = (impedance, impedance, 0.001, 0.5, 2)


def set_joint_friction(model: Any, data: Any, joints: Iterable[ModelJoint]) -> None:
    """Gives every joint so much friction that it stays where it was put, gravity or not."""
    for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel, mujoco.mj_passive):
        stage(model, data)  # of all that `mj_forward` does, only what gravity needs
    weight = np.zeros(model.nv)
    mujoco.mj_rne(model, data, 0, weight)
    gravity = np.abs(weight - data.qfrc_passive)
    inertia = 1.0 / np.maximum(model.dof_invweight0, 1e-9)
    for joint in joints:
        for offset in range(len(joint.axes)):
            dof = joint.dof_address + offset
            slides = offset < sum(axis.is_prismatic for axis in joint.axes)
            holding = _SLIDE_FRICTION if slides else _HINGE_FRICTION
            model.dof_frictionloss[dof] = holding * inertia[dof] + 1.25 * gravity[dof]
            model.dof_damping[dof] = _DAMPING * inertia[dof]
            model.dof_solref[dof] = (0.005, 1.0)
            model.dof_solimp[dof] = (0.99, 0.999, 0.001, 0.5, 2)


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
