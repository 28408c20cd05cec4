"""A robot as part of a world: one body for each link, joints between them, and the geometry of the links.

The base of a robot that drives is moved by one planar joint, which has no wheels: its position is exact, and so is its
odometry. Links are at the frames of the description, so that poses of bodies are those of `tf`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Container, Mapping
from dataclasses import dataclass
from urllib.parse import quote

import msgspec
import numpy as np

from mindstage.rdf.vocabulary import URDF_LINK
from mindstage.robots.models.forward_kinematics import link_poses, rest_positions
from mindstage.robots.models.link_geometry import hull_shape
from mindstage.robots.models.link_tree import shape_points
from mindstage.robots.models.robot_model import BaseType, RobotJoint, RobotLink, RobotModel
from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    Body,
    BodyGeometry,
    BodyId,
    BodyPhysics,
    CollisionShape,
    GeometryMap,
    Iri,
    Joint,
    JointMimic,
    LinearLimits,
    Mobility,
    PoseLike,
    SoftLimit,
    Tag,
    Vector,
    VisualMesh,
    World,
)
from mindstage.scene.geometry import Inertia
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array, pose_multiply, quat_rotate

__all__ = ["ROBOT_PART_CLASS", "RobotWorld", "robot_world"]

ROBOT_PART_CLASS = URDF_LINK
"""The class of the bodies of a robot."""
_GROUND_CLEARANCE_M = 0.015
"""The collision shapes of a base that drives begin at this height: it moves without wheels, and must not rub."""
_MASSLESS_KG = 1e-5
_SMALL_INERTIA = Inertia(mass_kg=0.01, tensor=(1e-5, 1e-5, 1e-5, 0.0, 0.0, 0.0))
"""The inertia of what a joint moves if the description states none; solvers need some."""
_NO_GEOMETRY = BodyGeometry(key="", visuals=(), collision_shapes=(), shape_name="none")


class RobotWorld(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The bodies and joints of a robot, ready to be spawned."""

    world: World
    geometry: GeometryMap
    link_ids: Mapping[str, BodyId]
    """The body of each link."""
    joint_ids: Mapping[str, BodyId]
    """The joint of each movable joint of the model; fixed ones are attachments, or joints without motion."""
    base_joint_id: BodyId | None
    """The planar joint of a base that drives: x, y and swing1 are free; None for a fixed base."""
    zero: Mapping[str, float]
    """The position of each movable joint when spawned, where the positions of the engine's joints are 0 [m or rad]."""


def robot_world(
    model: RobotModel,
    pose: PoseLike,
    *,
    name: str,
    taken: Container[str] = (),
    positions: Mapping[str, float] | None = None,
) -> RobotWorld:
    """Returns the world of a robot.

    Args:
        pose: the pose of its root link in the world frame, on the floor: the root of a robot that drives is put at
            `base.height_m` above it.
        name: the name of the robot, unique in the world.
        taken: ids in use. If one of the robot's names is among them, all of its ids get the prefix `NAME.`.
        positions: positions of joints [m or rad]; by default `model.home_positions`.
    """
    return _RobotWorldBuilder(model, pose, name, taken, positions).build()


class _RobotWorldBuilder:
    """The world of one robot."""

    def __init__(
        self, model: RobotModel, pose: PoseLike, name: str, taken: Container[str], positions: Mapping[str, float] | None
    ) -> None:
        self.model, self.name = model, name
        self.is_driving = model.base.type is not BaseType.FIXED
        own = [link.name for link in model.links] + [joint.name for joint in model.joints if joint.is_movable]
        clashes = len(set(own)) < len(own) or any(each in taken for each in own)
        self.prefix = f"{name}." if clashes else ""
        self.links = {link.name: link for link in model.links}
        self.zero = rest_positions(model.joints, dict(model.home_positions) if positions is None else positions)
        self.floor = normalized_pose_array(pose)
        root = pose_multiply(self.floor, [0.0, 0.0, model.base.height_m, 1.0, 0.0, 0.0, 0.0])
        local = link_poses(model.joints, self.zero, model.root)
        self.poses = {link: pose_multiply(root, row) for link, row in local.items()}
        self.link_ids = {link.name: BodyId(self.prefix + link.name) for link in model.links}
        movable = [joint.name for joint in model.joints if joint.is_movable]
        taken_by_links = set(self.link_ids.values())
        self.joint_ids: dict[str, BodyId] = {}
        for joint in movable:
            id = BodyId(self.prefix + joint)
            self.joint_ids[joint] = BodyId(f"{id}.joint") if id in taken_by_links else id

        self.carriers = _carriers(model)
        self.parent_joint = {joint.child: joint for joint in model.joints}

    def build(self) -> RobotWorld:
        bodies = [self._body(link) for link in self.model.links]
        joints = [self._joint(joint) for joint in self.model.joints if joint.is_movable]
        attachments = []
        for joint in self.model.joints:
            if not joint.is_movable and joint.child in self.carriers:
                joints.append(self._locked_joint(joint))
            elif not joint.is_movable:
                attachments.append(Attachment(parent=self.link_ids[joint.parent], child=self.link_ids[joint.child]))
        geometry = {self.link_ids[link.name]: self._geometry(link) for link in self.model.links}
        base_joint = None
        if self.is_driving:
            odom, base_joint = self._base()
            bodies.append(odom)
            joints.append(base_joint)
            geometry[odom.id] = _NO_GEOMETRY
        iri = self._iri(self.name)
        return RobotWorld(
            world=World(
                iri=iri, name=self.name, bodies=tuple(bodies), joints=tuple(joints), attachments=tuple(attachments)
            ),
            geometry=geometry,
            link_ids=self.link_ids,
            joint_ids=self.joint_ids,
            base_joint_id=None if base_joint is None else base_joint.id,
            zero=self.zero,
        )

    def _iri(self, name: str) -> Iri:
        return Iri(f"http://mindstage.org/robots/{quote(self.name, safe='')}.owl#{quote(name, safe='')}")

    def _body(self, link: RobotLink) -> Body:
        is_static = link.name == self.model.root and not self.is_driving
        return Body(
            id=self.link_ids[link.name],
            iri=self._iri(link.name),
            cls=ROBOT_PART_CLASS,
            pose=pose_from_array(self.poses[link.name]),
            size=_size(link),
            physics=BodyPhysics(
                mobility=Mobility.STATIC if is_static else Mobility.DYNAMIC,
                mass_kg=None if is_static else self._mass(link),
            ),
            tags=(
                Tag(type="robot", key="name", value=self.name),
                Tag(type="robot", key="link", value=link.name),
            ),
        )

    def _mass(self, link: RobotLink) -> float:
        if link.inertia is not None:
            return link.inertia.mass_kg
        return _SMALL_INERTIA.mass_kg if self._moves_by_joint(link.name) else _MASSLESS_KG

    def _geometry(self, link: RobotLink) -> BodyGeometry:
        geometry, inertia = link.geometry or _NO_GEOMETRY, link.inertia
        if inertia is None and self._moves_by_joint(link.name):
            inertia = _SMALL_INERTIA
        shapes = geometry.collision_shapes
        if self.is_driving:
            row, lowest = self.poses[link.name], float(self.floor[2]) + _GROUND_CLEARANCE_M
            shapes = tuple(above for shape in shapes if (above := _above(shape, row, lowest)) is not None)
            shapes = geometry.collision_shapes if shapes == geometry.collision_shapes else shapes
        if shapes is geometry.collision_shapes and inertia is None:
            return geometry
        return BodyGeometry.deferred(
            _VisualsOf(geometry, shapes),
            collision_shapes=shapes,
            source=geometry.source,
            reason=geometry.reason,
            shape_name=geometry.shape_name,
            inertia=inertia,
        )

    def _moves_by_joint(self, link: str) -> bool:
        joint = self.parent_joint.get(link)
        return joint is not None and joint.is_movable

    def _base(self) -> tuple[Body, Joint]:
        """The static body at which the robot was added, and the joint that moves the base relative to it."""
        id = BodyId(f"{self.name}.odom")
        odom = Body(
            id=id,
            iri=self._iri("odom"),
            cls=ROBOT_PART_CLASS,
            pose=pose_from_array(self.floor),
            size=(0.0, 0.0, 0.0),
            physics=BodyPhysics(mobility=Mobility.STATIC),
            tags=(Tag(type="robot", key="name", value=self.name), Tag(type="robot", key="link", value="odom")),
        )
        free = AxisMotion.FREE
        joint = Joint(
            id=BodyId(f"{self.name}.base"),
            iri=self._iri("base"),
            parent=id,
            child=self.link_ids[self.model.root],
            pose=pose_from_array(self.floor),
            linear=LinearLimits(x=free, y=free),
            angular=AngularLimits(swing1=free),
        )
        return odom, joint

    def _locked_joint(self, joint: RobotJoint) -> Joint:
        """A joint without motion: engines take an attached body with joints of its own for one that moves on these."""
        frame = pose_multiply(self.poses[joint.parent], normalized_pose_array(joint.origin))
        return Joint(
            id=BodyId(f"{self.link_ids[joint.child]}.fixed"),
            iri=self._iri(f"{joint.child}.fixed"),
            parent=self.link_ids[joint.parent],
            child=self.link_ids[joint.child],
            pose=pose_from_array(frame),
        )

    def _joint(self, joint: RobotJoint) -> Joint:
        """A joint whose frame has x along the axis; its range is relative to the spawned position."""
        frame = pose_multiply(self.poses[joint.parent], normalized_pose_array(joint.origin))
        position = self.zero[joint.name]
        axis = quat_rotate(frame[3:], np.array(joint.axis))
        pose = pose_from_array([*frame[:3], *_rotation_from_x(axis)])
        motion, middle, half = AxisMotion.FREE, 0.0, 0.0
        # The limits of a follower are those of its master; in the PR2's grippers its own contradict its multiplier.
        if joint.lower is not None and joint.upper is not None and joint.mimic is None:
            lower, upper = min(joint.lower, position) - position, max(joint.upper, position) - position
            motion, middle, half = AxisMotion.LIMITED, (lower + upper) / 2, (upper - lower) / 2
        soft = SoftLimit(damping=joint.damping)
        linear, angular = LinearLimits(), AngularLimits()
        if joint.is_prismatic:
            linear = LinearLimits(x=motion, limit=half, x_middle=middle, soft_limit=soft)
        else:
            angular = AngularLimits(twist=motion, twist_limit=half, twist_middle=middle, twist_soft_limit=soft)
        mimic = None
        if joint.mimic is not None and joint.mimic.joint in self.joint_ids:
            mimic = JointMimic(joint=self.joint_ids[joint.mimic.joint], multiplier=joint.mimic.multiplier)
        return Joint(
            id=self.joint_ids[joint.name],
            iri=self._iri(joint.name),
            parent=self.link_ids[joint.parent],
            child=self.link_ids[joint.child],
            pose=pose,
            linear=linear,
            angular=angular,
            mimic=mimic,
        )


@dataclass(frozen=True, slots=True)
class _VisualsOf:
    """The visual meshes of another geometry, for one with other collision shapes; it can be pickled."""

    geometry: BodyGeometry
    shapes: tuple[CollisionShape, ...]

    def __call__(self) -> tuple[str, tuple[VisualMesh, ...]]:
        digest = hashlib.sha256(repr((self.geometry.key, self.shapes)).encode()).hexdigest()
        return digest[:32], self.geometry.visuals


def _carriers(model: RobotModel) -> set[str]:
    """The links that have a movable joint, or a link with one below them."""
    found: set[str] = set()
    for joint in reversed(model.joints):
        if joint.is_movable or joint.child in found:
            found.add(joint.parent)
    return found


def _size(link: RobotLink) -> Vector:
    """Extents of the collision shapes along the axes of the link; 0 for a frame."""
    shapes = () if link.geometry is None else link.geometry.collision_shapes
    if not shapes:
        return (0.0, 0.0, 0.0)
    points = np.concatenate([shape_points(shape) for shape in shapes])
    x, y, z = np.ptp(points, axis=0).tolist()
    return x, y, z


def _above(shape: CollisionShape, link_pose: Array, lowest: float) -> CollisionShape | None:
    """The part of a shape above a height in the world [m]; None if there is nothing left of it."""
    points = shape_points(shape)
    heights = quat_rotate(link_pose[3:], points)[:, 2] + link_pose[2]
    if heights.min() >= lowest:
        return shape
    if heights.max() <= lowest + 0.005:
        return None
    up = quat_rotate(link_pose[3:] * (1.0, -1.0, -1.0, -1.0), np.array([0.0, 0.0, 1.0]))
    return hull_shape(points + np.maximum(lowest - heights, 0.0)[:, None] * up)


def _rotation_from_x(axis: Array) -> Array:
    """The shortest rotation (w x y z) that maps x to a unit axis; half a turn about z for -x."""
    x, y, z = axis.tolist()
    if x < -1.0 + 1e-12:
        return np.array([0.0, 0.0, 0.0, 1.0])
    quaternion = np.array([1.0 + x, 0.0, -z, y])
    return np.asarray(quaternion / np.linalg.norm(quaternion))
