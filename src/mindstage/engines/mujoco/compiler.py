"""Compiles a world to a MuJoCo model.

Every body becomes a MuJoCo body, except scenery: fixed bodies without joints or excluded pairs become geoms of the
world body, since adding a body costs MuJoCo time proportional to the number of bodies so far.

Contacts between scenery and a body that its joint keeps away from it are excluded. Otherwise MuJoCo would check each
drawer of a kitchen against a hundred geoms of the scenery in every step.

MuJoCo takes all parameters of a contact from the geom with the higher priority. Priorities are highest for bouncy
geoms, then for slippery ones, and lowest for geoms of unspecified friction: wood slips on ice, and a ball bounces on
wood. What else a contact needs is therefore a property of all geoms that can have priority: their impedance, and
rolling friction where something can roll.
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

from mindstage.engines.base import Actuator, ActuatorMode
from mindstage.engines.collision_filter import JOINT_TOUCH_TOLERANCE_M
from mindstage.engines.kinematic_tree import (
    JointAxis,
    KinematicForest,
    RigidGroup,
    TreeJoint,
    is_ball,
    mimic_coefficients,
    movable_axes,
)
from mindstage.engines.mass_properties import inertia_matrix
from mindstage.engines.mujoco.arena import ARENA_CAP_BYTES, first_arena_size, new_data
from mindstage.engines.mujoco.state import CompiledModel, ModelActuators, ModelJoint, set_tolerance
from mindstage.engines.physics_model import PhysicsModelBuilder
from mindstage.errors import EngineUnavailableError
from mindstage.scene import AxisMotion, Body, BodyGeometry, BodyId, CollisionShape, CollisionShapeType, Mobility, Vector
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.collision_shapes import MEAN_SQUARES, CompiledGeometry, primitive_collision_type
from mindstage.scene.geometry import Inertia
from mindstage.scene.transforms import Array, mesh_scale, pose_inverse, pose_multiply, quat_rotate

__all__ = [
    "FIXED_MOBILITIES",
    "GeomOptions",
    "MeshAsset",
    "ModelInput",
    "add_geom",
    "arena_size",
    "compile_model",
    "contact_options",
    "cull_static_contacts",
    "inertia_frame",
    "is_fixed_group",
    "load_mesh",
    "set_defaults",
    "set_joint_friction",
    "set_soft_limits",
    "unit_inertias",
]


FIXED_MOBILITIES = (Mobility.STATIC, Mobility.STATIONARY)
"""The mobilities of bodies that are fixed to the world."""


@dataclass(slots=True)
class ModelInput:
    """All data from which a model is compiled; `rows` has the row of each body in the arrays."""

    builder: PhysicsModelBuilder
    poses: Array
    """Poses of the bodies, n x 7, with unit quaternions."""
    timestep_s: float
    bodies: Mapping[BodyId, Body]
    rows: dict[BodyId, int]
    sizes: Array
    masses: dict[BodyId, float]
    forest: KinematicForest
    excluded_pairs: set[tuple[BodyId, BodyId]]
    linked: frozenset[BodyId]
    """Bodies on joints, and those of excluded pairs: they are no scenery."""
    kinematics_driven: bool = False
    """Whether kinematic bodies are moved; until then they are fixed like static ones, which costs nothing."""
    has_mocap_bodies: bool = False
    """Whether kinematic bodies that are moved are mocap bodies, as in files, and not those of `set_kinematic_pose`."""
    is_divisible: bool = False
    """Whether the world is so large that it has regions, which have to move as the whole world would, bit for bit."""
    arena_used_bytes: int = 0
    """How much of its arena the model before it has used."""
    arena_cap_bytes: int = ARENA_CAP_BYTES
    """The largest size of the arena."""

    def is_fixed(self, group: RigidGroup) -> bool:
        """Whether a group is fixed to the world."""
        return is_fixed_group(group, kinematics_driven=self.kinematics_driven)


def arena_size(model_input: ModelInput, bodies: int) -> int:
    """The size of the arena of a new model [bytes].

    Args:
        model_input: its input.
        bodies: the number of MuJoCo's bodies.
    """
    return first_arena_size(bodies, used_bytes=model_input.arena_used_bytes, cap_bytes=model_input.arena_cap_bytes)


def is_fixed_group(group: RigidGroup, *, kinematics_driven: bool) -> bool:
    """Whether a group is fixed to the world in a model, in which kinematic bodies may be moved, or not."""
    return group.mobility in FIXED_MOBILITIES or (group.mobility is Mobility.KINEMATIC and not kinematics_driven)


_MESH_SUFFIXES = frozenset({".obj", ".stl", ".msh"})


@dataclass(frozen=True, slots=True)
class MeshAsset:
    """A mesh file that MuJoCo can read."""

    path: Path
    extents: Array
    """Size along x, y and z, in units of the file."""

    def scale_to(self, size: Vector | None) -> tuple[float, float, float]:
        """Scale factors that give the mesh the size of a body; 1 if the size is unknown."""
        x, y, z = mesh_scale(self.extents, size).tolist()
        return x, y, z


def load_mesh(path: Path) -> MeshAsset | None:
    """Loads a mesh file; None if MuJoCo cannot read it."""
    if path.suffix.lower() not in _MESH_SUFFIXES:
        return None
    spec = mujoco.MjSpec()
    spec.add_mesh(name="mesh", file=str(path), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    try:
        model = spec.compile()
    except ValueError:  # the caller reports that the file is left out
        return None
    points = quat_rotate(model.mesh_quat[0], np.asarray(model.mesh_vert, dtype=np.float64)) + model.mesh_pos[0]
    return MeshAsset(path, np.ptp(points, axis=0))


_LIMIT_OVERRUN_M = 0.05
"""How far a joint may slide past its limit under load; hinges are assumed to turn fully."""
_CORNERS = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(8, 3)


def cull_static_contacts(
    model_input: ModelInput, axes: Mapping[BodyId, tuple[JointAxis, ...]], scenery: OrientedBoxes
) -> list[BodyId]:
    """Bodies on a joint of one axis that never reach the scenery, wherever the joint is.

    Args:
        model_input: the bodies and their poses.
        axes: movable axes of each tree joint.
        scenery: boxes of the scenery.
    """
    roots = _limited_root_joints(model_input, axes)
    if not roots or not len(scenery.center):
        return []
    low, high = _swept_bounds(model_input, roots)
    first, last = scenery.bounds()
    meets = np.all((low[:, None] < last[None]) & (high[:, None] > first[None]), axis=2).any(axis=1)
    free_roots = (root for root, meets_scenery in zip(roots, meets.tolist(), strict=True) if not meets_scenery)
    return [id for root in free_roots for id in model_input.forest.groups[root].bodies]


def _limited_root_joints(
    model_input: ModelInput, axes: Mapping[BodyId, tuple[JointAxis, ...]]
) -> dict[BodyId, JointAxis]:
    """Roots of groups that a joint of one axis with hard limits connects to a fixed body."""
    forest = model_input.forest
    joints = {}
    for root, tree_joint in forest.tree_joints.items():
        movable = axes.get(tree_joint.joint.id, ())
        limited = len(movable) == 1 and movable[0].limit is not None and not movable[0].soft_limit.enabled
        if limited and model_input.is_fixed(forest.groups[forest.root_of[tree_joint.parent]]):
            joints[root] = movable[0]
    return joints


def _swept_bounds(model_input: ModelInput, root_joints: Mapping[BodyId, JointAxis]) -> tuple[Array, Array]:
    """Corners of axis-aligned boxes around the groups in all positions of their joints."""
    joints = list(root_joints.values())
    tree_joints = [model_input.forest.tree_joints[root] for root in root_joints]
    ends = [tree_joint.order_ends(model_input.builder.joint_frames[tree_joint.joint.id]) for tree_joint in tree_joints]
    fixed = pose_multiply(
        model_input.poses[[model_input.rows[tree_joint.parent] for tree_joint in tree_joints]],
        np.array([end[0] for end in ends]),
    )
    moving = pose_multiply(
        model_input.poses[[model_input.rows[tree_joint.child] for tree_joint in tree_joints]],
        np.array([end[1] for end in ends]),
    )
    low, high = _group_bounds(model_input, list(root_joints))
    direction_index = [joint.direction for joint in joints]
    directions = quat_rotate(fixed[:, 3:], np.eye(3)[direction_index])
    position = pose_multiply(pose_inverse(fixed), moving)[np.arange(len(joints)), direction_index]
    limits = np.array([(joint.limit or 0.0) + _LIMIT_OVERRUN_M for joint in joints])
    middles = np.array([joint.middle for joint in joints])
    travel = np.stack([middles - limits - position, middles + limits - position], axis=1)
    shifts = travel[:, :, None] * directions[:, None]
    rotated_low, rotated_high = _rotation_bounds(low, high, moving[:, :3], directions)
    is_slide = np.array([joint.is_prismatic for joint in joints])[:, None]
    low = np.where(is_slide, low + np.minimum(shifts.min(axis=1), 0.0), rotated_low)
    return low, np.where(is_slide, high + np.maximum(shifts.max(axis=1), 0.0), rotated_high)


def _group_bounds(model_input: ModelInput, roots: list[BodyId]) -> tuple[Array, Array]:
    """Corners of axis-aligned boxes around groups at their current poses."""
    bodies = [model_input.forest.groups[root].bodies for root in roots]
    rows = [model_input.rows[id] for each in bodies for id in each]
    low, high = OrientedBoxes.from_poses(model_input.poses[rows], model_input.sizes[rows]).bounds()
    first = np.cumsum([0, *(len(each) for each in bodies[:-1])])
    return np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)


def _rotation_bounds(low: Array, high: Array, anchors: Array, axes: Array) -> tuple[Array, Array]:
    """Boxes that contain other boxes in all rotations about an axis."""
    offsets = low[:, None] + _CORNERS * (high - low)[:, None] - anchors[:, None]
    along = np.einsum("nci,ni->nc", offsets, axes)
    radius = np.linalg.norm(offsets - along[..., None] * axes[:, None], axis=2).max(axis=1)
    start, end = along.min(axis=1), along.max(axis=1)
    middle = anchors + axes * ((start + end) / 2)[:, None]
    half = np.abs(axes) * ((end - start) / 2)[:, None] + np.sqrt(np.maximum(1.0 - axes**2, 0.0)) * radius[:, None]
    return middle - half, middle + half


GeomOptions = dict[str, Any]
"""Keyword arguments of `MjsBody.add_geom`."""

_FRICTION = (0.8, 0.005, 0.0001)
"""Default sliding friction, which is dimensionless, and torsional and rolling friction [m].

Rolling friction is the arm of the force that stops what rolls: a ball with the radius r is slowed by
0.0001 g / (1.4 r), which is 0.02 m/s² for a ball of 7 cm.
"""
_ROLLING_CONDIM = 6
"""Dimensions of a contact with rolling friction; without it, errors of contact points drive a lying can."""
_DEFAULT_CONTACT: GeomOptions = {}
_NO_CONTACT: GeomOptions = {"contype": 0, "conaffinity": 0, "friction": (1.0, 0.005, 0.0001)}
_MAX_FRICTION = 100.0
"""Coefficient from which on friction is as good as glue."""
_GROUND_CONTACT = 2
"""Bit of `contype` for the ground."""
_KINEMATIC_CONTACT = 4
"""Bit of `contype` for kinematic bodies that are moved: they touch neither fixed bodies nor one another."""
_KINEMATIC_MASS_KG = 1e6
"""Mass of a kinematic body that is moved, and its moments of inertia for a radius of gyration of 1 m.

So large that no contact changes its velocity; the solver's tolerance is set without it.
"""
_GROUND_THICKNESS_M = 0.2
_MIN_INERTIA_SIZE_M = 0.005
"""Minimum size for inertia, so that a sheet of paper is not too easy to spin."""
_MIN_RESTITUTION = 0.5
"""Below this coefficient, as for all furniture, MuJoCo's default contacts are used, which come to rest."""
_CONTACT_TIME_CONSTANT_S = 0.02
"""MuJoCo's default time constant of a contact."""
_IMPEDANCES = (0.9, 0.9999, 0.00015, 0.5, 2.0)
"""Impedance of a contact where it begins and from a depth of 0.15 mm on, as `solimp` of MuJoCo.

MuJoCo's stiffness of a contact is proportional to the mass of the lighter body: at a constant impedance d, a load of m
times that mass sinks in proportionally to m (1 - d), which is 10 mm for 2 kg on 20 g with its defaults. An impedance
that grows to almost 1 limits the depth whatever the masses are, while touching bodies keep the soft contact with which
they come to rest.
"""
_DRIVEN_IMPEDANCE = 0.98
"""Impedance where a contact begins in a model with actuators: what a gripper holds, or an arm pushes, yields less."""
_MIN_CONTACT_STEPS = 20.0
"""Minimum duration of a bounce in time steps, for stability."""
_GEOMS = {
    CollisionShapeType.BOX: mujoco.mjtGeom.mjGEOM_BOX,
    CollisionShapeType.SPHERE: mujoco.mjtGeom.mjGEOM_SPHERE,
    CollisionShapeType.CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    CollisionShapeType.HULL: mujoco.mjtGeom.mjGEOM_MESH,
}


def contact_options(geometry: BodyGeometry | None, timestep_s: float, *, non_colliding: bool) -> GeomOptions:
    """Friction, restitution and priority of a body's geoms; MuJoCo's defaults where the geometry has none."""
    if non_colliding:
        return _NO_CONTACT
    if geometry is None or (geometry.friction is None and geometry.restitution is None):
        return _DEFAULT_CONTACT
    sliding = _FRICTION[0] if geometry.friction is None else min(max(geometry.friction, 1e-5), _MAX_FRICTION)
    priority = 0 if geometry.friction is None else 1 + round(1000 * exp(-sliding))
    restitution = min(geometry.restitution or 0.0, 0.98)
    if restitution < _MIN_RESTITUTION:
        return {"friction": (sliding, *_FRICTION[1:]), "priority": priority}
    # A damped spring with ratio z has the coefficient of restitution exp(-pi z / sqrt(1 - z^2)).
    damping = -log(restitution) / (pi**2 + log(restitution) ** 2) ** 0.5
    min_time_constant = _MIN_CONTACT_STEPS * timestep_s / (pi * damping)
    solref = (max(_CONTACT_TIME_CONSTANT_S, min_time_constant), damping)
    return {"friction": (sliding, *_FRICTION[1:]), "priority": 10_000 + round(1000 * restitution), "solref": solref}


def set_defaults(spec: Any) -> None:
    """Sets the options that all geoms of a spec share, since each option passed to `add_geom` costs time."""
    geom = spec.default.geom
    geom.type, geom.mass, geom.margin, geom.friction, geom.solimp = (
        mujoco.mjtGeom.mjGEOM_BOX,
        0.0,
        -JOINT_TOUCH_TOLERANCE_M,
        _FRICTION,
        _IMPEDANCES,
    )


def add_geom(
    body: Any,
    collision_shape: CollisionShape,
    pose: Sequence[float] | None,
    *,
    geom_options: GeomOptions,
    mesh: str = "",
) -> None:
    """Adds a massless geom to a body of a spec with `set_defaults`.

    Args:
        body: the MuJoCo body.
        collision_shape: the shape to add.
        pose: pose of its center in the body frame, seven numbers; None for the body's own pose.
        geom_options: options from `contact_options`.
        mesh: name of the mesh of a hull.
    """
    options: dict[str, Any] = {"meshname": mesh} if mesh else {"size": _half_extents(collision_shape)}
    if pose is not None:
        options["pos"], options["quat"] = pose[:3], pose[3:]
    if collision_shape.type is not CollisionShapeType.BOX:
        options["type"] = _GEOMS[collision_shape.type]
    if collision_shape.type is CollisionShapeType.SPHERE and len(set(collision_shape.size)) > 1:
        options["type"] = mujoco.mjtGeom.mjGEOM_ELLIPSOID  # its contacts are less exact than those of a sphere
    body.add_geom(**options, **geom_options)


def _half_extents(collision_shape: CollisionShape) -> list[float]:
    """Half extents in MuJoCo's order; an elliptic cylinder becomes a circular one of mean radius."""
    x, y, z = (extent / 2 for extent in collision_shape.size)
    return [(x + y) / 2, z, 0.0] if collision_shape.type is CollisionShapeType.CYLINDER else [x, y, z]


def unit_inertias(bodies: Iterable[Body], sizes: Array) -> Array:
    """Moments of inertia for 1 kg of primitive shapes that fill the bodies' sizes, n x 3 [m²]."""
    factors = np.array([MEAN_SQUARES[primitive_collision_type(body)] for body in bodies]).reshape(-1, 3)
    squares = np.maximum(sizes, _MIN_INERTIA_SIZE_M) ** 2 * factors
    return np.asarray(squares.sum(axis=1, keepdims=True) - squares)


@lru_cache(maxsize=4096)
def inertia_frame(distribution: CompiledGeometry | Inertia) -> tuple[Array, Array, Array]:
    """Mass distribution for 1 kg: center of mass [m], principal axes as a quaternion, principal moments [m²].

    A body without collision shapes has the inertia of a small one. Moments that no rigid body can have, since the
    largest is more than the sum of the others, are raised. Results are cached, since models are compiled often.
    """
    if isinstance(distribution, Inertia):
        tensor, center = inertia_matrix(distribution) / distribution.mass_kg, np.array(distribution.center)
    else:
        tensor, center = distribution.inertia, distribution.center_of_mass
    moments, axes = np.linalg.eigh(tensor)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    rotation = np.zeros(4)
    mujoco.mju_mat2Quat(rotation, axes.reshape(9))
    moments = np.maximum(moments, _MIN_INERTIA_SIZE_M**2 / 6)
    moments[:2] += max(moments[2] - moments[0] - moments[1], 0.0) / 2
    return center, rotation, moments


_SLIDE_FRICTION = 1.0
"""Friction of a slide, as an acceleration [m/s²]: 5 N for a drawer of 5 kg."""
_HINGE_FRICTION = 2.0
"""Friction of a hinge, as an acceleration [rad/s²]."""
_DAMPING = 1.0
"""Part of a joint's velocity that is lost in a second [1/s]."""


def set_soft_limits(model: Any, joints: Iterable[ModelJoint]) -> None:
    """Sets soft limits as springs and dampers of the given stiffness and damping.

    A MuJoCo constraint of impedance d lets through 1 - d of every other force and adds d times its own. Its stiffness
    and damping are given for a unit of inertia, and divided by d inside MuJoCo, so a small d gives the requested
    spring. A spring too stiff for the time step gets a larger d, which is softer but stable.
    """
    for joint in joints:
        limited_dofs = [axis for axis in joint.axes if axis.is_prismatic or not joint.is_ball]
        for offset, axis in enumerate(limited_dofs):
            if axis.soft_limit.enabled and axis.limit is not None and axis.soft_limit.stiffness > 0.0:
                dof = joint.dof_address + offset
                joint_id = int(model.dof_jntid[dof])
                weight = model.dof_invweight0[dof]
                impedance = float(np.clip(10 * axis.soft_limit.stiffness * weight * model.opt.timestep**2, 0.01, 0.95))
                damping = max(axis.soft_limit.damping, 1e-6)
                model.jnt_solref[joint_id] = (-axis.soft_limit.stiffness * weight, -damping * weight)
                model.jnt_solimp[joint_id] = (impedance, impedance, 0.001, 0.5, 2)


def set_joint_friction(model: Any, data: Any, joints: Iterable[ModelJoint]) -> None:
    """Sets the friction of joints such that they hold their position against gravity."""
    for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel, mujoco.mj_passive):
        compute(model, data)  # the parts of `mj_forward` that gravity needs
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


def _set_driven_friction(compiled: CompiledModel, model_input: ModelInput) -> None:
    """Gives joints with actuators the friction of these, and joints that follow them none."""
    builder, model = model_input.builder, compiled.model
    driven = builder.actuators.driven_joints
    if not driven:
        return
    for id, joint in compiled.joints.items():
        mimic = joint.tree_joint.joint.mimic
        if id in driven or (mimic is not None and mimic.joint in driven):
            dofs = slice(joint.dof_address, joint.dof_address + len(joint.axes))
            model.dof_frictionloss[dofs] = model.dof_damping[dofs] = 0.0
    frictions = [builder.actuators.actuators[name].friction for name in compiled.actuators.names]
    model.dof_frictionloss[compiled.actuators.dofs] = frictions


_ROUND_GEOMS = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID, mujoco.mjtGeom.mjGEOM_CYLINDER)


def _set_rolling_friction(compiled: CompiledModel) -> None:
    """Gives rolling friction to contacts of loose balls and cylinders, also with fixed bodies of a higher priority."""
    model = compiled.model
    loose_roots = [compiled.body_ids[root] for root in compiled.free_joint_addresses]
    is_loose = np.isin(model.body_rootid[model.geom_bodyid], loose_roots) & (model.geom_contype != 0)
    rolls = is_loose & np.isin(model.geom_type, [int(each) for each in _ROUND_GEOMS])
    if rolls.any():
        carries = ~is_loose & (model.geom_priority > model.geom_priority[rolls].min())
        model.geom_condim[rolls | carries] = _ROLLING_CONDIM


def _driven_roots(model_input: ModelInput) -> set[BodyId]:
    """The roots of the groups that actuators move."""
    forest, driven, roots = model_input.forest, model_input.builder.actuators.driven_joints, set[BodyId]()
    if driven:
        for root, tree_joint in forest.tree_joints.items():  # parents come before children
            if tree_joint.joint.id in driven or forest.root_of[tree_joint.parent] in roots:
                roots.add(root)
    return roots


def _servo(actuator: Actuator) -> dict[str, Any]:
    """The gain and bias of an actuator for MuJoCo: force = gain * command + bias · (1, position, velocity)."""
    stiffness, damping = actuator.stiffness, actuator.damping
    gain, bias = {
        ActuatorMode.POSITION: (stiffness, (0.0, -stiffness, -damping)),
        ActuatorMode.VELOCITY: (damping, (0.0, 0.0, -damping)),
        ActuatorMode.EFFORT: (1.0, (0.0, 0.0, 0.0)),
    }[actuator.mode]
    unused = [0.0] * 7
    return {
        "gaintype": mujoco.mjtGain.mjGAIN_FIXED, "gainprm": [gain, 0.0, 0.0, *unused],
        "biastype": mujoco.mjtBias.mjBIAS_AFFINE, "biasprm": [*bias, *unused],
    }  # fmt: skip


_HARD_LIMIT_SOLREF = (0.005, 1.0)
"""Time constant [s] and damping ratio of a hard limit: a strong arm pushes a drawer less than 1 mm past it."""
_MIMIC_SOLREF = (0.005, 1.0)
"""Time constant [s] and damping ratio of the coupling of a joint to the one that it follows."""
_IDENTITY_POSE = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
_DIRECTIONS = np.eye(3)
_IDENTITY_QUATERNION = [1.0, 0.0, 0.0, 0.0]
"""As w x y z."""


class _SpecBuilder:
    """Builds the spec of one model."""

    def __init__(self, model_input: ModelInput) -> None:
        self.model_input = model_input
        self.spec = mujoco.MjSpec()
        set_defaults(self.spec)
        self.inertias = unit_inertias(model_input.bodies.values(), model_input.sizes)
        self.meshes: dict[tuple[Vector, ...], str] = {}
        """Names of hull meshes by their points."""
        self.scenery_boxes = OrientedBoxes.from_poses(np.zeros((0, 7)), np.zeros((0, 3)))
        """A box around each geom of the scenery."""
        self.scenery_geom_counts: list[int] = []
        self.frames = _frames(model_input)
        self.spec_bodies: dict[BodyId, Any] = {}
        self.free_joints: dict[BodyId, Any] = {}
        self.kinematic_joints: dict[BodyId, Any] = {}
        """The free joints of kinematic bodies."""
        self.spec_joints: dict[BodyId, tuple[TreeJoint, tuple[JointAxis, ...], bool, list[Any], Any]] = {}
        self.actuators: list[tuple[str, Actuator, Any]] = []
        """The simulated actuators by name, and the axes that they drive."""
        self.driven_roots = _driven_roots(model_input)

    def set_options(self) -> None:
        option = self.spec.option
        option.timestep = self.model_input.timestep_s
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        # Friction nearly as stiff as contact prevents creep on slopes; what a gripper holds must creep less.
        option.impratio = 100.0 if self.driven_roots else 10.0
        if self.driven_roots:
            self.spec.default.geom.solimp[0] = _DRIVEN_IMPEDANCE
        option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        if self.model_input.is_divisible:  # as MuJoCo chooses for 60 degrees of freedom; the last bits depend on it
            option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
        option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)  # a diverged state must not be reset silently
        self.spec.compiler.degree = False

    def add_group(self, group: RigidGroup) -> None:
        model_input = self.model_input
        tree_joint = model_input.forest.tree_joints.get(group.root)
        if tree_joint is None:
            root = self._add_body(self.spec.worldbody, group.root, model_input.poses[model_input.rows[group.root]])
            if group.is_dynamic:
                self.free_joints[group.root] = root.add_freejoint()
            elif not model_input.is_fixed(group) and model_input.has_mocap_bodies:
                root.mocap = True
            elif not model_input.is_fixed(group):
                self.kinematic_joints[group.root] = root.add_freejoint()
                root.explicitinertial, root.mass = True, _KINEMATIC_MASS_KG
                root.ipos, root.iquat, root.inertia = np.zeros(3), _IDENTITY_QUATERNION, np.full(3, _KINEMATIC_MASS_KG)
                root.gravcomp = 1.0
        else:
            self._add_tree_joint(group, tree_joint)
        for id in group.bodies[1:]:
            self._add_body(
                self.spec_bodies[model_input.forest.rigid_parents[id]], id, model_input.builder.attachment_poses[id]
            )

    def _add_tree_joint(self, group: RigidGroup, tree_joint: TreeJoint) -> None:
        parent_from_root, root_from_frame = self.frames[group.root]
        root = self._add_body(self.spec_bodies[tree_joint.parent], group.root, parent_from_root)
        axes = movable_axes(tree_joint.joint, is_reversed=tree_joint.is_reversed)
        ball = is_ball(axes)
        self._add_joints(root, tree_joint, axes, ball, root_from_frame)

    def _add_joints(
        self, body: Any, tree_joint: TreeJoint, axes: tuple[JointAxis, ...], has_ball: bool, frame: Array
    ) -> list[Any]:
        """Adds the axes of one joint to a body.

        Args:
            body: the MuJoCo body that they move.
            tree_joint: the joint.
            axes: its movable axes.
            has_ball: whether the rotations are one ball joint.
            frame: the joint frame in the body, seven numbers.
        """
        joints = []
        for axis in axes:
            if has_ball and not axis.is_prismatic:
                continue
            axis_in_body = quat_rotate(frame[3:], _DIRECTIONS[axis.direction])
            joint = body.add_joint(
                type=mujoco.mjtJoint.mjJNT_SLIDE if axis.is_prismatic else mujoco.mjtJoint.mjJNT_HINGE,
                pos=frame[:3],
                axis=axis_in_body,
            )
            if axis.limit is not None:
                joint.limited = True
                joint.range = (axis.middle - axis.limit, axis.middle + axis.limit)
                joint.solref_limit = _HARD_LIMIT_SOLREF
                joint.solimp_limit = (0.95, 0.999, 0.0005, 0.5, 2)
            joints.append(joint)
        if has_ball:
            joints.append(body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL, pos=frame[:3]))
        if joints:
            self.spec_joints[tree_joint.joint.id] = (tree_joint, axes, has_ball, joints, body)
        return joints

    def add_scenery(self) -> list[BodyId]:
        """Adds bodies that are only collided with as geoms of the world body, and returns their ids."""
        model_input = self.model_input
        scenery: list[BodyId] = []
        for group in model_input.forest.groups.values():
            if model_input.is_fixed(group) and model_input.linked.isdisjoint(group.bodies):
                scenery += group.bodies
        shapes_of_body = [model_input.builder.collision_shapes(id) for id in scenery]
        counts = self.scenery_geom_counts = [len(shapes) for shapes, _ in shapes_of_body]
        standing = np.repeat(model_input.poses[[model_input.rows[id] for id in scenery]], counts, axis=0)
        local = [_IDENTITY_POSE[None] if poses is None else poses for _, poses in shapes_of_body]
        poses = pose_multiply(standing, np.concatenate([np.zeros((0, 7)), *local]))
        extents = np.array([shape.size for shapes, _ in shapes_of_body for shape in shapes]).reshape(-1, 3)
        self.scenery_boxes = OrientedBoxes.from_poses(poses, extents)
        each = iter(poses.tolist())
        for id, (shapes, _) in zip(scenery, shapes_of_body, strict=True):
            self._add_geoms(self.spec.worldbody, id, zip(shapes, each, strict=False))
        return scenery

    def _add_body(self, parent: Any, id: BodyId, body_pose: Array) -> Any:
        model_input = self.model_input
        pose = body_pose.tolist()  # MuJoCo takes lists faster than arrays
        if pose[3:] == _IDENTITY_QUATERNION:
            body = parent.add_body(name=_name(id), pos=pose[:3])
        else:
            body = parent.add_body(name=_name(id), pos=pose[:3], quat=pose[3:])
        self.spec_bodies[id] = body
        description = model_input.bodies[id]
        shapes, poses = model_input.builder.collision_shapes(id)
        if poses is None:
            self._add_geoms(body, id, zip(shapes, repeat(None), strict=False))
        else:
            self._add_geoms(body, id, zip(shapes, poses.tolist(), strict=True))
        mass = model_input.masses.get(id, 0.0)
        if mass > 0.0:
            body.explicitinertial = True
            body.ipos, body.iquat, moments = self._inertia(id)
            body.mass, body.inertia = mass, mass * moments
        if description.physics.gravity is False or id in model_input.builder.actuators.weightless:
            body.gravcomp = 1.0
        return body

    def _inertia(self, id: BodyId) -> tuple[Array, Array, Array]:
        """Center of mass, principal axes as a quaternion, and moments for 1 kg."""
        if id in self.model_input.builder.geometry:
            return inertia_frame(self.model_input.builder.mass_properties.mass_distribution(id))
        return _IDENTITY_POSE[:3], _IDENTITY_POSE[3:], self.inertias[self.model_input.rows[id]]

    def _add_geoms(
        self, body: Any, id: BodyId, shapes: Iterable[tuple[CollisionShape, Sequence[float] | None]]
    ) -> None:
        """Adds the collision shapes of a body, with their poses, to a MuJoCo body."""
        builder = self.model_input.builder
        non_colliding = id in builder.collision_filter.non_colliding
        geom_options = contact_options(
            builder.geometry.get(id), self.model_input.timestep_s, non_colliding=non_colliding
        )
        if not non_colliding:
            geom_options = geom_options | self._contact_bits(id)
        is_driven = self.model_input.forest.root_of[id] in self.driven_roots
        for shape, pose in shapes:
            # A ball that is held in one point by each finger would spin there without torsional friction.
            has_torsion = is_driven or (self.driven_roots and shape.type is CollisionShapeType.SPHERE)
            options = {**geom_options, "condim": 4} if has_torsion else geom_options
            add_geom(body, shape, pose, geom_options=options, mesh=self._hull_mesh_name(shape))

    def _contact_bits(self, id: BodyId) -> GeomOptions:
        """What a body collides with, if that is not the default: all bodies, and not the ground."""
        model_input = self.model_input
        group = model_input.forest.groups[model_input.forest.root_of[id]]
        affinity = _GROUND_CONTACT if model_input.builder.collides_with_ground(id) else 0
        if model_input.kinematics_driven and not model_input.has_mocap_bodies and not model_input.is_fixed(group):
            if not group.is_dynamic:
                return {"contype": _KINEMATIC_CONTACT, "conaffinity": 0}
            affinity |= _KINEMATIC_CONTACT
        return {"conaffinity": 1 | affinity} if affinity else {}

    def _hull_mesh_name(self, shape: CollisionShape) -> str:
        """The name of a hull's mesh, which is added on first use; empty for other shapes."""
        if shape.type is not CollisionShapeType.HULL:
            return ""
        if shape.points not in self.meshes:
            name = self.meshes[shape.points] = f"hull{len(self.meshes)}"
            self.spec.add_mesh(name=name, uservert=[number for point in shape.points for number in point])
        return self.meshes[shape.points]

    def add_ground(self) -> None:
        """Adds the ground, which only loose bodies collide with: a door must not rub on it."""
        ground = self.model_input.builder.ground
        if ground is None:
            return
        options: dict[str, Any] = {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [0.0, 0.0, 1.0]}
        options["pos"] = [0.0, 0.0, ground.height_m]
        if ground.area is not None:  # a plane is infinite, whatever its size
            x, y, far_x, far_y = ground.area
            half = [(far_x - x) / 2, (far_y - y) / 2, _GROUND_THICKNESS_M / 2]
            options = {"size": half, "pos": [(x + far_x) / 2, (y + far_y) / 2, ground.height_m - half[2]]}
        self.spec.worldbody.add_geom(name="ground", contype=_GROUND_CONTACT, conaffinity=0, **options)

    def add_excludes(self) -> None:
        """Excludes contacts of pairs."""
        for a, b in sorted(self.model_input.excluded_pairs):
            if a in self.spec_bodies and b in self.spec_bodies:
                self.spec.add_exclude(bodyname1=_name(a), bodyname2=_name(b))
        axes = {id: axes for id, (_, axes, _, _, _) in self.spec_joints.items()}
        for id in cull_static_contacts(self.model_input, axes, self.scenery_boxes):
            self.spec.add_exclude(bodyname1="world", bodyname2=_name(id))

    def add_loop_joint(self, tree_joint: TreeJoint) -> None:
        """Adds a joint that closes a loop.

        MuJoCo has equality constraints for a weld and for a common point. Other joints connect the parent to a light
        intermediate body, which is welded to the child.
        """
        parent_from_frame, child_from_frame = tree_joint.order_ends(
            self.model_input.builder.joint_frames[tree_joint.joint.id]
        )
        axes = movable_axes(tree_joint.joint, is_reversed=tree_joint.is_reversed)
        linear, angular = tree_joint.joint.linear, tree_joint.joint.angular
        is_position_locked = all(motion is AxisMotion.LOCKED for motion in (linear.x, linear.y, linear.z))
        is_rotation_free = all(motion is AxisMotion.FREE for motion in (angular.twist, angular.swing1, angular.swing2))
        if not axes:
            self._add_weld(
                _name(tree_joint.parent),
                _name(tree_joint.child),
                pose_multiply(parent_from_frame, pose_inverse(child_from_frame)),
            )
        elif is_position_locked and is_rotation_free:
            equality = self.spec.add_equality(
                type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY,
                name1=_name(tree_joint.child), name2=_name(tree_joint.parent),
            )  # fmt: skip
            equality.data[:3] = child_from_frame[:3]
        else:
            self._add_intermediate_body(tree_joint, axes, parent_from_frame, child_from_frame)

    def _add_intermediate_body(
        self, tree_joint: TreeJoint, axes: tuple[JointAxis, ...], parent_from_joint: Array, child_from_joint: Array
    ) -> None:
        model_input = self.model_input
        name = f"loop:{tree_joint.joint.id}"
        body = self.spec_bodies[tree_joint.parent].add_body(
            name=name, pos=parent_from_joint[:3], quat=parent_from_joint[3:]
        )
        mass = 0.01 * max(model_input.forest.groups[model_input.forest.root_of[tree_joint.child]].mass_kg, 0.1)
        body.explicitinertial, body.mass, body.inertia = True, mass, np.full(3, mass * 0.01)
        body.ipos, body.iquat = _IDENTITY_POSE[:3], _IDENTITY_POSE[3:]
        body.gravcomp = 1.0
        self._add_joints(body, tree_joint, axes, is_ball(axes), _IDENTITY_POSE)
        self._add_weld(name, _name(tree_joint.child), pose_inverse(child_from_joint))

    def add_mimics(self) -> None:
        """Couples each joint that follows another one to it, on the first axis of both."""
        for id, (tree_joint, axes, _, joints, _) in self.spec_joints.items():
            mimic = tree_joint.joint.mimic
            if mimic is None or mimic.joint not in self.spec_joints or mimic.joint == id:
                continue
            master, _, _, master_joints, _ = self.spec_joints[mimic.joint]
            if not axes or not master_joints:
                continue
            joints[0].name, master_joints[0].name = joint_name(id), joint_name(mimic.joint)
            equality = self.spec.add_equality(
                type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT,
                name1=joint_name(id), name2=joint_name(mimic.joint), solref=_MIMIC_SOLREF,
            )  # fmt: skip
            multiplier, offset = mimic_coefficients(tree_joint, master)
            equality.data[:5] = (offset, multiplier, 0.0, 0.0, 0.0)

    def add_actuators(self) -> None:
        """Adds the actuators of the joints that are simulated."""
        actuators = self.model_input.builder.actuators
        for name, actuator in actuators.actuators.items():
            found = self.spec_joints.get(actuator.joint)
            if found is None:
                continue
            tree_joint, axes, _, joints, _ = found
            number = [axis.index for axis in axes].index(actuators.axes[name])
            joint = joints[number]
            joint.name = joint.name or f"{joint_name(actuator.joint)}:{number}"
            joint.armature = actuator.armature
            self.spec.add_actuator(
                name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint.name,
                gear=[-1.0 if tree_joint.is_reversed else 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                forcelimited=True, forcerange=[-actuator.effort_limit, actuator.effort_limit],
                **_servo(actuator),
            )  # fmt: skip
            self.actuators.append((name, actuator, joint))

    def _add_weld(self, first: str, second: str, second_from_first: Array) -> None:
        equality = self.spec.add_equality(
            type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1=first, name2=second
        )
        equality.data[:3] = 0.0
        equality.data[3:10] = second_from_first
        equality.data[10] = 1.0

    def compile(self, scenery: list[BodyId]) -> CompiledModel:
        model_input = self.model_input
        self.spec.memory = arena_size(model_input, len(self.spec.bodies))
        try:
            model = self.spec.compile()
        except ValueError as error:  # the registry should have refused the input
            raise EngineUnavailableError("mujoco", cause=f"it cannot compile this world: {error}") from error
        data = new_data(model)
        numbers = {id: body.id for id, body in self.spec_bodies.items()}
        joints = {}
        for id, (tree_joint, axes, ball, spec_joints, body) in self.spec_joints.items():
            first = spec_joints[0].id
            position, velocity = int(model.jnt_qposadr[first]), int(model.jnt_dofadr[first])
            joints[id] = ModelJoint(tree_joint, axes, ball, position, velocity, body.id)
        free, kinematic = (
            {root: (int(model.jnt_qposadr[joint.id]), int(model.jnt_dofadr[joint.id])) for root, joint in found.items()}
            for found in (self.free_joints, self.kinematic_joints)
        )
        axis_ids = [joint.id for _, _, joint in self.actuators]
        actuators = ModelActuators(
            tuple(name for name, _, _ in self.actuators),
            model.jnt_qposadr[axis_ids].tolist(),
            model.jnt_dofadr[axis_ids].tolist(),
            model.actuator_gear[:, 0].tolist(),
        )
        order = np.fromiter((numbers.get(id, 0) for id in model_input.rows), dtype=np.intp, count=len(model_input.rows))
        rows = np.array([model_input.rows[id] for id in scenery], dtype=np.intp)
        row_of_body = np.full(model.nbody, -1, dtype=np.intp)
        row_of_body[order[order > 0]] = np.flatnonzero(order > 0)
        geom_rows = row_of_body[model.geom_bodyid]
        scenery_rows = np.repeat(rows, self.scenery_geom_counts)
        geom_rows[: len(scenery_rows)] = scenery_rows  # the geoms of the world body are the first, in this order
        return CompiledModel(
            model, data, model_input.rows, numbers, order, rows, model_input.poses[rows], joints, free, kinematic,
            geom_rows, actuators, model_input.arena_cap_bytes,
        )  # fmt: skip


def compile_model(model_input: ModelInput, *, scenery: bool = True) -> CompiledModel:
    """Compiles a model.

    Args:
        model_input: the world to compile.
        scenery: whether fixed bodies may become geoms of the world body.

    Raises:
        EngineUnavailableError: MuJoCo refuses the model, with its message as the cause.
    """
    builder = _SpecBuilder(model_input)
    builder.set_options()
    scenery_ids = set(scenery_bodies := builder.add_scenery() if scenery else [])
    for group in model_input.forest.groups.values():
        if group.root not in scenery_ids:
            builder.add_group(group)
    for tree_joint in model_input.forest.loop_joints:
        builder.add_loop_joint(tree_joint)
    builder.add_mimics()
    builder.add_actuators()
    builder.add_ground()
    builder.add_excludes()
    compiled = builder.compile(scenery_bodies)
    set_tolerance(compiled.model, compiled.kinematic_dofs)
    set_soft_limits(compiled.model, compiled.joints.values())
    set_joint_friction(compiled.model, compiled.data, compiled.joints.values())
    _set_driven_friction(compiled, model_input)
    _set_rolling_friction(compiled)
    return compiled


def _frames(model_input: ModelInput) -> dict[BodyId, tuple[Array, Array]]:
    """For each group on a joint: the root's pose in the parent body, and the joint's frame in the root."""
    tree_joints = model_input.forest.tree_joints
    if not tree_joints:
        return {}
    ends = [
        tree_joint.order_ends(model_input.builder.joint_frames[tree_joint.joint.id])
        for tree_joint in tree_joints.values()
    ]
    root_from_frame = np.array([child_from_frame for _, child_from_frame in ends])
    inner = [row for row, (root, tree_joint) in enumerate(tree_joints.items()) if tree_joint.child != root]
    if inner:
        roots, joints_in_order = list(tree_joints), list(tree_joints.values())
        root_from_world = pose_inverse(model_input.poses[[model_input.rows[roots[row]] for row in inner]])
        world_from_child = model_input.poses[[model_input.rows[joints_in_order[row].child] for row in inner]]
        root_from_frame[inner] = pose_multiply(pose_multiply(root_from_world, world_from_child), root_from_frame[inner])
    parent_from_root = pose_multiply(
        np.array([parent_from_frame for parent_from_frame, _ in ends]), pose_inverse(root_from_frame)
    )
    return dict(zip(tree_joints, zip(parent_from_root, root_from_frame, strict=True), strict=True))


def joint_name(id: BodyId) -> str:
    """The name of the first axis of a joint that is coupled to another one."""
    return f"joint:{id}"


def _name(id: BodyId) -> str:
    return f"body:{id}"  # "world" is reserved by MuJoCo
