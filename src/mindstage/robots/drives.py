"""The drives of a robot in an engine: which actuators it has, how stiff they are, and what they move.

A description states the largest effort of a joint, but not how its drive is controlled. The stiffness is chosen so that
a small error takes the largest effort, as with industrial drives, and the damping so that a joint does not overshoot
with the inertia of everything that it moves when the robot is added. Fingers press all the time with what bends this
spring, so that the largest effort alone must not take them beyond their velocity limit when what they hold slips out:
theirs is damped as a motor is, whose effort vanishes at its no-load speed. That effort is the one with which the
fingers grip: damping for more would only make them slow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from mindstage.engines.base import Actuator, ActuatorMode, Engine
from mindstage.engines.edits import SetActuators
from mindstage.engines.kinematic_tree import movable_axes
from mindstage.robots.floor_poses import BasePose, base_pose_of, planar_inverse, planar_multiply, planar_pose
from mindstage.robots.models.robot_model import BaseType, Gripper, RobotJoint, RobotModel
from mindstage.robots.world import RobotWorld
from mindstage.scene import Body, BodyId, Joint, Pose
from mindstage.scene.transforms import (
    Array,
    normalized_pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_rotate,
)

__all__ = ["BaseDrive", "JointDrive", "RobotDrives", "drives_of"]

_FULL_EFFORT_ERRORS = {True: 0.004, False: 0.015}
"""The error at which the drive of a prismatic [m] or revolute joint [rad] has its largest effort."""
_FINGER_FULL_EFFORT_ERRORS = {True: 0.01, False: 0.1}
"""The same of the drive of a finger [m or rad]."""
_MAX_FREQUENCY = 120.0
"""Largest natural frequency of a drive [rad/s], as a part of the frequency of the physics steps (500 Hz)."""
_MAX_FINGER_FREQUENCY_RAD_S = 200.0
_PHYSICS_STEP_S = 0.002
_GRAVITY_M_S2 = 9.81
_EFFORT_MARGIN = 3.0
"""A joint without a stated effort can lift so many times what it carries."""
_MIN_EFFORTS = {True: 50.0, False: 10.0}
"""Least effort of a drive whose description has none, of a prismatic [N] or revolute joint [N m]."""
_FREE_SPEED = 0.9
"""Part of its velocity limit at which the damping of a finger takes the effort with which it grips."""
_GRIP_MARGIN = 30.0
"""The effort of a finger is at most so many times that with which it grips: descriptions state 1000 N m for some."""
_LINK_MASS_KG = 0.5
"""Mass of a link without one, only for the choice of stiffness and damping."""
_BASE_ERRORS = (0.01, 0.01, 0.015)
"""The error of the base at which its drive has its largest force: x, y [m], yaw [rad]."""
_MIN_BASE_EFFORTS = (400.0, 400.0, 150.0)
"""Along x and y [N], and about the vertical [N m]."""
_BASE_TORQUE_MARGIN = 2.0
"""The base resists so many times the largest moment of a joint, so that an arm that is blocked does not turn it."""
_MAX_HELD_MOMENT = 400.0
"""Larger moments of joints are not considered for that [Nm]."""
_BASE_AXES = ("x", "y", "swing1")


class JointDrive(msgspec.Struct, frozen=True, kw_only=True):
    """The drive of a joint."""

    joint: RobotJoint
    actuator: str
    """The name of its actuator."""
    joint_id: BodyId
    zero: float
    """Position of the joint when spawned [m or rad]."""
    stiffness: float
    """[N/m] or [Nm/rad]."""
    damping: float
    effort_limit: float
    """[N] or [Nm]."""
    inertia: float
    """What the servo is made for: everything that it moves, and its armature [kg] or [kg m²]."""
    armature: float
    moved: frozenset[BodyId]
    """The bodies that it moves."""

    @property
    def name(self) -> str:
        """The name of the joint."""
        return self.joint.name

    @property
    def is_prismatic(self) -> bool:
        """Whether positions are in meters; otherwise in radians."""
        return self.joint.is_prismatic

    @property
    def lag_s(self) -> float:
        """The time by which its servo is behind a moving command [s]."""
        return self.damping / self.stiffness

    def clamped(self, position: float) -> float:
        """The command for a position, within the limits: relative to the spawned position [m or rad]."""
        if self.joint.lower is not None:
            position = max(position, self.joint.lower)
        if self.joint.upper is not None:
            position = min(position, self.joint.upper)
        return position - self.zero


class BaseDrive(msgspec.Struct, frozen=True, kw_only=True):
    """The drives of a base that moves over the floor, with the coordinates x, y, yaw of its joint."""

    type: BaseType
    joint_id: BodyId
    actuators: tuple[str, str, str]
    error_limits: tuple[float, float, float]
    """The errors at which the drives have their largest force [m, m, rad]."""
    lags_s: tuple[float, float, float]
    """The times by which the servos are behind moving commands [s]."""
    root: BodyId
    """The body that the joint moves."""
    frame: Pose
    """The frame of the joint when spawned, in the world frame."""
    root_offset: Pose
    """The frame of `root` in the frame of the joint's child."""
    odom: BasePose
    """`frame` on the floor: x, y [m], yaw [rad]."""
    offset: BasePose
    """The frame of the base link in the frame of the joint's child."""
    velocity: float
    """[m/s]."""
    turn_velocity: float
    """[rad/s]."""
    acceleration: float
    turn_acceleration: float
    moved: frozenset[BodyId]
    """All bodies of the robot."""

    @property
    def accelerations(self) -> tuple[float, float, float]:
        """The largest acceleration of each coordinate [m/s², m/s², rad/s²]."""
        return self.acceleration, self.acceleration, self.turn_acceleration

    def world_from_joint(self, coordinates: Array) -> BasePose:
        """The pose of the base link in the world frame at coordinates of the joint: x, y [m], yaw [rad]."""
        return planar_multiply(planar_multiply(self.odom, tuple(coordinates.tolist())), self.offset)

    def joint_from_world(self, pose: BasePose) -> Array:
        """The coordinates of the joint at a pose of the base link in the world frame; yaw within [-pi, pi)."""
        root = planar_multiply(pose, planar_inverse(self.offset))
        return np.array(planar_multiply(planar_inverse(self.odom), root))

    def root_pose(self, pose: BasePose) -> Pose:
        """The pose of the root in the world frame at a pose of the base link: x, y [m], yaw [rad]."""
        moved = planar_pose(tuple(self.joint_from_world(pose).tolist()))
        joint = pose_multiply(normalized_pose_array(self.frame), moved)
        return pose_from_array(pose_multiply(joint, normalized_pose_array(self.root_offset)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotDrives:
    """The drives of a robot, and which bodies of the world are its parts."""

    robot: str
    joints: Mapping[str, JointDrive]
    """By the name of the joint."""
    base: BaseDrive | None
    grippers: Mapping[str, Gripper]
    link_of_body: Mapping[BodyId, str]
    finger_bodies: Mapping[str, tuple[frozenset[BodyId], ...]]
    """The bodies of each finger, by gripper."""
    hand_bodies: Mapping[str, frozenset[BodyId]]
    """The bodies of the fingers and of the link that carries them, by gripper."""
    records: tuple[Actuator, ...]
    """The actuators."""

    @property
    def actuators(self) -> frozenset[str]:
        """The names of the actuators."""
        return frozenset(each.name for each in self.records)

    @property
    def gripper_bodies(self) -> frozenset[BodyId]:
        """The bodies of all fingers and hands."""
        return frozenset[BodyId]().union(*self.hand_bodies.values())

    def exist_in(self, engine: Engine) -> bool:
        """Whether all bodies of the robot are in an engine."""
        return self.link_of_body.keys() <= set(engine.poses()[0])

    def add_to(self, engine: Engine) -> None:
        """Adds the actuators to an engine that has the bodies of the robot."""
        engine.apply(SetActuators(self.records, tuple(self.link_of_body)))


def drives_of(model: RobotModel, placed: RobotWorld, *, name: str) -> RobotDrives:
    """Chooses the actuators of a robot.

    Args:
        placed: its bodies and joints.
        name: its name in the simulation.
    """
    bodies = {body.id: body for body in placed.world.bodies}
    joints = {joint.id: joint for joint in placed.world.joints}
    masses = {placed.link_ids[each.name]: _LINK_MASS_KG for each in model.links if each.name in placed.link_ids}
    masses |= {
        placed.link_ids[each.name]: each.inertia.mass_kg
        for each in model.links
        if each.inertia is not None and each.inertia.mass_kg > 0.0 and each.name in placed.link_ids
    }
    fingers = {joint for gripper in model.grippers for joint in gripper.joints}
    drives = {}
    for joint in model.actuated_joints:
        if joint.name not in placed.joint_ids or not movable_axes(joints[placed.joint_ids[joint.name]]):
            continue  # a joint without range
        moved = frozenset(placed.link_ids[link] for link in links_moved_by(model, joint))
        record = joints[placed.joint_ids[joint.name]]
        inertia, load = _inertia_and_load(record, [bodies[id] for id in moved], masses)
        using = [each for each in model.grippers if joint.name in each.joints]
        grip = max((each.max_force_n * each.levers[each.joints.index(joint.name)] for each in using), default=0.0)
        drives[joint.name] = _joint_drive(
            joint, record, placed.zero.get(joint.name, 0.0), moved, inertia, load, joint.name in fingers, grip
        )
    moments = [each.effort_limit for each in drives.values() if not each.is_prismatic]
    held = _BASE_TORQUE_MARGIN * min(max(moments, default=0.0), _MAX_HELD_MOMENT)
    base, base_actuators = _base_drive(model, placed, sum(masses.values()), held)
    records = [
        Actuator(
            name=each.actuator,
            joint=each.joint_id,
            mode=ActuatorMode.POSITION,
            effort_limit=each.effort_limit,
            stiffness=each.stiffness,
            damping=each.damping,
            armature=each.armature,
        )
        for each in drives.values()
    ]
    hands = {each.name: finger_links_by_finger(model, each) for each in model.grippers}
    return RobotDrives(
        robot=name,
        joints=drives,
        base=base,
        grippers={each.name: each for each in model.grippers if all(joint in drives for joint in each.joints)},
        link_of_body={id: link for link, id in placed.link_ids.items()},
        finger_bodies={
            name: tuple(frozenset(placed.link_ids[link] for link in finger) for finger in hand)
            for name, hand in hands.items()
        },
        hand_bodies={
            each.name: frozenset(
                placed.link_ids[link] for link in (each.link, *(link for hand in hands[each.name] for link in hand))
            )
            for each in model.grippers
        },
        records=(*base_actuators, *records),
    )


def links_moved_by(model: RobotModel, joint: RobotJoint) -> frozenset[str]:
    """The links that a joint moves."""
    found = {joint.child}
    for each in model.joints:  # parents come before children
        if each.parent in found:
            found.add(each.child)
    return frozenset(found)


def rigid_links(model: RobotModel, link: str) -> frozenset[str]:
    """A link and those that do not move relative to it."""
    found = {link}
    for each in (*reversed(model.joints), *model.joints):  # upwards, then downwards: parents come before children
        if not each.is_movable and not found.isdisjoint((each.parent, each.child)):
            found |= {each.parent, each.child}
    return frozenset(found)


def finger_links_by_finger(model: RobotModel, gripper: Gripper) -> tuple[frozenset[str], ...]:
    """The links of each finger of a gripper: its finger links, and those that carry them.

    What is fixed to its palm, against which an only finger closes, is one finger without others that carry it.
    """
    parents = {each.child: each.parent for each in model.joints}
    fixed = rigid_links(model, gripper.link)
    groups: dict[str, set[str]] = {}
    for link in gripper.finger_links:
        if link in fixed:
            groups.setdefault(gripper.link, set()).add(link)
            continue
        first, carriers = link, {link}
        while parents.get(first, gripper.link) not in fixed:
            first = parents[first]
            carriers.add(first)
        groups.setdefault(first, set()).update(carriers)
    return tuple(frozenset(each) for each in groups.values())


def _joint_drive(
    joint: RobotJoint,
    record: Joint,
    zero: float,
    moved: frozenset[BodyId],
    inertia: float,
    load: float,
    is_finger: bool,
    grip_effort: float,
) -> JointDrive:
    is_prismatic = joint.is_prismatic
    effort = joint.effort or max(_MIN_EFFORTS[is_prismatic], _EFFORT_MARGIN * load)
    errors, frequency, least_damping = _FULL_EFFORT_ERRORS, _MAX_FREQUENCY, 0.0
    if is_finger:
        errors, frequency = _FINGER_FULL_EFFORT_ERRORS, _MAX_FINGER_FREQUENCY_RAD_S
        effort = min(joint.effort or math.inf, _GRIP_MARGIN * grip_effort)
    stiffness = effort / errors[is_prismatic]
    if is_finger and joint.velocity:
        least_damping = min(effort, grip_effort) / (_FREE_SPEED * joint.velocity)
    # MuJoCo integrates an effort at its limit explicitly: within a step it must not take a finger beyond that speed.
    total = max(inertia + joint.armature, stiffness / frequency**2, least_damping * _PHYSICS_STEP_S)
    return JointDrive(
        joint=joint,
        actuator=record.id,
        joint_id=record.id,
        zero=zero,
        stiffness=stiffness,
        damping=max(2.0 * math.sqrt(stiffness * total), least_damping),
        effort_limit=effort,
        inertia=total,
        armature=total - inertia,
        moved=moved,
    )


def _inertia_and_load(joint: Joint, moved: list[Body], masses: Mapping[BodyId, float]) -> tuple[float, float]:
    """What a joint moves: mass [kg] and weight [N], or moment of inertia [kg m²] and largest moment of weight [Nm]."""
    frame = normalized_pose_array(joint.pose)
    axis = movable_axes(joint)[0]
    direction = quat_rotate(frame[3:], np.eye(3)[axis.direction])
    mass = sum(masses[body.id] for body in moved)
    if axis.is_prismatic:
        return mass, mass * _GRAVITY_M_S2
    inertia = load = 0.0
    for body in moved:
        offset = np.asarray(body.pose.position) - frame[:3]
        distance = float(np.linalg.norm(offset - direction * (offset @ direction)))
        inertia += masses[body.id] * (distance**2 + 0.05**2)
        load += masses[body.id] * _GRAVITY_M_S2 * (distance + 0.05)
    return inertia, load


def _base_drive(
    model: RobotModel, placed: RobotWorld, mass_kg: float, least_moment: float
) -> tuple[BaseDrive | None, tuple[Actuator, ...]]:
    """The drives of the base, and their actuators; none of a fixed one."""
    if placed.base_joint_id is None:
        return None, ()
    base = model.base
    joint = next(each for each in placed.world.joints if each.id == placed.base_joint_id)
    frame = normalized_pose_array(joint.pose)
    link = normalized_pose_array(placed.world.body(placed.link_ids[base.link]).pose)
    root = placed.link_ids[model.root]
    root_pose = normalized_pose_array(placed.world.body(root).pose)
    odom = base_pose_of(frame)
    offset = planar_multiply(planar_inverse(odom), base_pose_of(link))
    inertia = mass_kg * max(base.radius_m, 0.2) ** 2
    sizes = (mass_kg, mass_kg, inertia)
    accelerations = (base.acceleration, base.acceleration, base.turn_acceleration)
    rows = []
    for axis, size, acceleration, error, least in zip(
        _BASE_AXES, sizes, accelerations, _BASE_ERRORS, _MIN_BASE_EFFORTS, strict=True
    ):
        effort = max(least, 2.5 * size * acceleration, least_moment if axis == "swing1" else 0.0)
        stiffness = effort / error
        rows.append(
            Actuator(
                name=f"{joint.id}/{axis}",
                joint=joint.id,
                axis=axis,
                mode=ActuatorMode.POSITION,
                effort_limit=effort,
                stiffness=stiffness,
                damping=2.0 * math.sqrt(stiffness * size),
            )
        )
    lags_s = [each.damping / each.stiffness for each in rows]
    drive = BaseDrive(
        type=base.type,
        joint_id=joint.id,
        actuators=(rows[0].name, rows[1].name, rows[2].name),
        error_limits=_BASE_ERRORS,
        lags_s=(lags_s[0], lags_s[1], lags_s[2]),
        root=root,
        frame=joint.pose,
        root_offset=pose_from_array(pose_multiply(pose_inverse(frame), root_pose)),
        odom=odom,
        offset=offset,
        velocity=base.velocity,
        turn_velocity=base.turn_velocity,
        acceleration=base.acceleration,
        turn_acceleration=base.turn_acceleration,
        moved=frozenset(placed.link_ids.values()),
    )
    return drive, tuple(rows)
