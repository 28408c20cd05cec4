"""Which parts of a robot are its arms, grippers, head, base and sensors.

SRDF says so, if there is one; what it leaves open is concluded from names and from the tree, and reported.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import msgspec
import numpy as np

from mindstage.robots.models.forward_kinematics import link_poses, rest_positions
from mindstage.robots.models.grippers import analyze_gripper
from mindstage.robots.models.link_tree import LinkTree
from mindstage.robots.models.robot_model import (
    Arm,
    BaseType,
    Gripper,
    GripperType,
    Head,
    ModelNote,
    RobotBase,
    RobotJoint,
    RobotJointType,
    RobotLink,
    RobotSensor,
    SensorType,
)
from mindstage.robots.models.srdf import Srdf, SrdfGroup
from mindstage.scene.transforms import Array, quat_rotate

__all__ = [
    "RobotStructure",
    "base_type",
    "find_structure",
    "is_named_as_finger",
    "wheel_joints",
    "without_base_joints",
]

_REST_STATES = ("rest", "tuck", "fold", "travel", "transport", "stow", "home", "park", "ready")
"""Words in the names of positions in which an arm is out of the way, the best first."""
_MIN_ARM_JOINTS = 4
"""Number of drives from which on a stated chain is an arm."""
_MIN_GUESSED_ARM_JOINTS = 5
"""The same of a chain that nothing states to be one."""
_WHEEL = re.compile(r"wheel|caster|roller|suspension", re.IGNORECASE)
_CASTER = re.compile(r"caster", re.IGNORECASE)
_ARM = re.compile(r"arm|manipulator", re.IGNORECASE)
_LEG = re.compile(r"leg|hip|knee|ankle|foot|feet|thigh|calf|shank|toe|rotor|propeller", re.IGNORECASE)
_FINGER = re.compile(
    r"finger|fngr|gripper|jaw|thumb|knuckle|claw|pincer|phalan|proximal|distal|metacarp"
    r"|(^|_)(index|middle|ring|little|pinky)(_|$)",
    re.IGNORECASE,
)
_NO_FINGER = re.compile(r"roll|yaw|wrist|camera", re.IGNORECASE)
_TOOL = re.compile(r"suction|vacuum|magnet|(^|_)hook(_|$)", re.IGNORECASE)
_MAX_FINGER_M = 0.25
"""Length of the fingers of a hand that nothing names."""
_HEAD = re.compile(r"head|neck", re.IGNORECASE)
_SIDES = (("left", re.compile(r"left|(^|_)l(_|$)|^L[A-Z]")), ("right", re.compile(r"right|(^|_)r(_|$)|^R[A-Z]")))
_SENSORS = (
    (re.compile(r"depth.*(link|frame)$", re.IGNORECASE), SensorType.DEPTH_CAMERA),
    (re.compile(r"(camera|rgb|kinect|xtion|realsense|d435|stereo).*(link|frame)$", re.IGNORECASE), SensorType.CAMERA),
    (re.compile(r"laser|lidar|scan|hokuyo|sick", re.IGNORECASE), SensorType.LASER_SCANNER),
    (re.compile(r"(^|_)(ft|force_torque)(_|$)", re.IGNORECASE), SensorType.FORCE_TORQUE),
    (re.compile(r"(^|_)imu(_|$)", re.IGNORECASE), SensorType.IMU),
)
_FLOOR_TOLERANCE_M = 0.03
"""A root whose geometry reaches less far below its origin stands on the floor with its origin."""
_LEVEL = 0.1
"""Largest vertical component of the axis of a slide that moves a base, and what that of a turn may lack to 1."""
_LOW_M = 0.5
"""Height below which links count for the radius of a base that drives."""


class RobotStructure(msgspec.Struct, frozen=True, kw_only=True):
    """The parts of a robot."""

    base: RobotBase
    arms: tuple[Arm, ...]
    grippers: tuple[Gripper, ...]
    head: Head | None
    sensors: tuple[RobotSensor, ...]
    home_positions: tuple[tuple[str, float], ...]
    notes: tuple[ModelNote, ...]


def find_structure(tree: LinkTree, srdf: Srdf, *, base: BaseType) -> RobotStructure:
    """Finds the parts of a robot.

    Args:
        srdf: its SRDF; empty if there is none.
        base: the result of `base_type`.
    """
    return _StructureFinder(tree, srdf, base).find()


def is_named_as_finger(name: str) -> bool:
    """Whether a link or a joint is a part of a gripper by its name."""
    return _FINGER.search(name) is not None


def wheel_joints(joints: Iterable[RobotJoint]) -> list[RobotJoint]:
    """The movable joints of wheels, casters and their suspensions, by their names."""
    return [joint for joint in joints if joint.is_movable and _WHEEL.search(joint.name)]


def base_type(joints: Iterable[RobotJoint], srdf: Srdf, notes: list[ModelNote]) -> BaseType:
    """Returns how a robot moves over the floor: by its SRDF, otherwise by its wheels, which is noted."""
    virtual = next(iter(srdf.virtual_joints), None)
    if virtual is not None and virtual.type == "planar":
        return BaseType.DIFFERENTIAL if "diff" in virtual.motion_model else BaseType.PLANAR
    turning = [joint for joint in wheel_joints(joints) if joint.type is RobotJointType.CONTINUOUS]
    driven = [joint for joint in turning if not _CASTER.search(joint.name)]
    if len(turning) >= 4 and len(driven) != 2:
        text = f"it moves in every direction, since it has {len(turning)} wheels that turn"
        notes.append(ModelNote(subject="base", text=text))
        return BaseType.PLANAR
    if len(driven) >= 2:
        text = f"it is driven by {driven[0].name} and {driven[1].name}, so it cannot move sideways"
        notes.append(ModelNote(subject="base", text=text))
        return BaseType.DIFFERENTIAL
    return BaseType.FIXED


def without_base_joints(
    links: Sequence[RobotLink], joints: Sequence[RobotJoint], notes: list[ModelNote]
) -> tuple[tuple[RobotLink, ...], tuple[RobotJoint, ...], bool]:
    """Leaves out joints that move a whole robot over the floor, since its base is moved by a planar joint.

    Such joints, two slides and often a turn, are between the first links of a description, which have no geometry.

    Args:
        links: the root first.
        joints: parents before children.
        notes: what is left out is appended.

    Returns:
        The links and joints that are left, and whether there were any such joints.
    """
    geometries = {link.name: link.geometry for link in links}
    poses = link_poses(joints, rest_positions(joints), links[0].name)
    link, chain, slides = links[0].name, list[RobotJoint](), 0
    while geometries[link] is None:
        below = [joint for joint in joints if joint.parent == link]
        if len(below) != 1:
            break
        (joint,) = below
        vertical = abs(float(quat_rotate(poses[joint.child][3:], np.array(joint.axis))[2]))
        slides += joint.is_prismatic and vertical < _LEVEL
        if joint.is_movable and not joint.is_prismatic and vertical < 1.0 - _LEVEL:
            break
        chain.append(joint)
        link = joint.child
    while chain and not chain[-1].is_movable:
        chain.pop()
    if slides < 2:
        return tuple(links), tuple(joints), False
    names = ", ".join(joint.name for joint in chain if joint.is_movable)
    notes.append(ModelNote(subject="base", text=f"it is moved as a whole over the floor, instead of by {names}"))
    gone = {joint.parent for joint in chain}
    return (
        tuple(each for each in links if each.name not in gone),
        tuple(each for each in joints if each.parent not in gone),
        True,
    )


class _ArmPart(NamedTuple):
    """The joints of an arm from the base to the tip, without a lift below them."""

    name: str
    joints: Sequence[RobotJoint]
    tip: str


class _StructureFinder:
    """The parts of one robot."""

    def __init__(self, tree: LinkTree, srdf: Srdf, base: BaseType) -> None:
        self.tree, self.srdf, self.base_type = tree, srdf, base
        self.notes: list[ModelNote] = []

    def find(self) -> RobotStructure:
        grippers = self._stated_grippers() or self._guessed_grippers()
        self._note_tools(grippers)
        arms = self._arms(self._stated_arms() or self._guessed_arms(grippers), grippers)
        return RobotStructure(
            base=self._base(),
            arms=arms,
            grippers=tuple(grippers),
            head=self._head(),
            sensors=self._sensors(),
            home_positions=self._home_positions(arms),
            notes=tuple(self.notes),
        )

    def _guess(self, subject: str, text: str) -> None:
        self.notes.append(ModelNote(subject=subject, text=text))

    # -- groups of SRDF ------------------------------------------------------------------------------------------------

    def _group_joints(self, group: SrdfGroup, visited: frozenset[str] = frozenset()) -> list[RobotJoint]:
        """All joints of a group, those that are fixed included, from the root outwards."""
        found: dict[str, RobotJoint] = {}
        for base, tip in group.chains:
            found |= {joint.name: joint for joint in self.tree.chain(base, tip) or ()}
        found |= {name: self.tree.joints[name] for name in group.joints if name in self.tree.joints}
        for link in group.links:
            if (joint := self.tree.parent_joint.get(link)) is not None:
                found[joint.name] = joint
        for name in group.groups:
            inner = self.srdf.group(name)
            if inner is not None and name not in visited:
                found |= {joint.name: joint for joint in self._group_joints(inner, visited | {group.name})}
        return sorted(found.values(), key=lambda joint: self.tree.depth(joint.child))

    def _stated_grippers(self) -> list[Gripper]:
        """The end effectors of SRDF that have fingers; in some files their group is that of the arm."""
        found: dict[str, Gripper] = {}
        for effector in self.srdf.end_effectors:
            group = self.srdf.group(effector.group)
            if group is None or effector.parent_link not in self.tree.links or group.name in found:
                continue
            inside = set(self.tree.subtree(effector.parent_link))
            fingers = [joint for joint in self._group_joints(group) if joint.is_movable and joint.child in inside]
            fingers += self._followers_of(fingers)
            gripper = self._gripper(group.name, self._palm(effector.parent_link, fingers), fingers)
            if gripper is not None:
                found[group.name] = gripper
        return list(found.values())

    def _followers_of(self, joints: Sequence[RobotJoint]) -> list[RobotJoint]:
        """Joints that mimic some of these and are not among them."""
        names = {joint.name for joint in joints}
        return [each for name in names for each in self.tree.followers.get(name, ()) if each.name not in names]

    def _palm(self, default: str, fingers: Sequence[RobotJoint]) -> str:
        """The link that carries all fingers."""
        lines = [self._line(joint.parent) for joint in fingers]
        moved = {joint.child for joint in fingers}
        common = (link for link in lines[0] if all(link in line for line in lines)) if lines else iter(())
        return next((link for link in common if link not in moved), default)

    def _line(self, link: str) -> list[str]:
        """A link and its ancestors."""
        return [link, *(joint.parent for joint in self.tree.ancestors(link))]

    def _stated_arms(self) -> list[_ArmPart]:
        """The arms of SRDF: groups that carry end effectors, and groups that are chains named as arms."""
        found: dict[str, _ArmPart] = {}
        for effector in self.srdf.end_effectors:
            if effector.parent_link in self.tree.links:
                part = self._arm_of_effector(effector.parent_group, effector.parent_link)
                if part is not None:
                    found.setdefault(part.name, part)
        taken = {joint.name for part in found.values() for joint in part.joints}
        for group in sorted(self.srdf.groups, key=lambda each: len(self._group_joints(each))):
            joints = [joint for joint in self._group_joints(group) if joint.is_actuated]
            is_chain = all(self.tree.chain(a.child, b.parent) is not None for a, b in pairwise(joints))
            is_free = taken.isdisjoint(joint.name for joint in joints)
            if _ARM.search(group.name) and len(joints) >= _MIN_ARM_JOINTS and is_chain and is_free:
                taken |= {joint.name for joint in joints}
                tip = next((tip for _, tip in group.chains if tip in self.tree.links), joints[-1].child)
                found[group.name] = _ArmPart(group.name, joints, tip)
        return list(found.values())

    def _arm_of_effector(self, group_name: str, parent_link: str) -> _ArmPart | None:
        """The group that carries an end effector: the stated one, or the smallest with enough joints."""
        above = {joint.name for joint in self.tree.ancestors(parent_link)}
        candidates = []
        for group in self.srdf.groups:
            actuated = [joint for joint in self._group_joints(group) if joint.is_actuated]
            joints = [joint for joint in actuated if joint.name in above]
            is_pure = all(_FINGER.search(joint.name) for joint in actuated if joint.name not in above)
            if joints and is_pure and not any(_LEG.search(joint.name) for joint in joints):
                candidates.append(_ArmPart(group.name, joints, parent_link))
        stated = next((part for part in candidates if part.name == group_name), None)
        if stated is not None:
            return stated
        long = [part for part in candidates if len(part.joints) >= _MIN_ARM_JOINTS]
        return min(long, key=lambda part: (len(part.joints), part.name)) if long else None

    # -- guesses -------------------------------------------------------------------------------------------------------

    def _guessed_grippers(self) -> list[Gripper]:
        """By their names, or by what they do if none of those has fingers that close on each other."""
        count = len(self.notes)
        named = self._named_grippers()
        if any(each.type is GripperType.PARALLEL and each.link not in each.finger_links for each in named):
            return named
        self.notes, notes = self.notes[:count], self.notes
        if unnamed := self._unnamed_grippers():
            return unnamed
        self.notes = notes
        return named

    def _named_grippers(self) -> list[Gripper]:
        """Groups of joints that are named as fingers, and have no other joint below them."""
        clusters: dict[str, list[RobotJoint]] = {}
        for joint in self.tree.joints.values():
            if joint.is_movable and self._is_finger(joint):
                above = [
                    each for each in self.tree.ancestors(joint.parent) if each.is_movable and self._is_finger(each)
                ]
                top = above[-1] if above else joint
                clusters.setdefault(self.tree.rigid_root(top.parent), []).append(joint)
        found: list[Gripper] = []
        for root, joints in clusters.items():
            names = {joint.name for joint in joints}
            masters = {joint.mimic.joint for joint in joints if joint.mimic is not None} - names
            joints = [*joints, *(self.tree.joints[each] for each in sorted(masters) if each in self.tree.joints)]
            moving = [joint for joint in joints if self._moves_something(joint, joints)]
            side = _side([root]) or _side(joint.name for joint in moving)
            name = f"{side}_gripper" if side and len(clusters) > 1 else "gripper"
            name = name if all(each.name != name for each in found) else f"{root}_gripper"
            gripper = self._gripper(name, self._palm(root, moving), moving)
            if gripper is not None:
                self._guess(name, f"{', '.join(gripper.joints)} move its fingers, by their names")
                found.append(gripper)
        return found

    def _unnamed_grippers(self) -> list[Gripper]:
        """Links with short branches of moving links that close on each other, whatever they are called."""
        found: list[Gripper] = []
        poses = self.tree.poses(rest_positions(self.tree.joints.values()))
        taken: set[str] = set()
        for link in self.tree.links:  # parents come first
            joint = self.tree.parent_joint.get(link)
            if link in taken or (joint is not None and not joint.is_movable):
                continue
            below = [
                each
                for rigid in self.tree.rigid_links(link)
                for each in self.tree.child_joints.get(rigid, ())
                if each.is_movable
            ]
            if len(below) < 2 or not all(self._is_short(each, poses) for each in below):
                continue
            inside = self.tree.subtree(link)[1:]
            moving = [each for name in inside if (each := self.tree.parent_joint[name]).is_movable]
            notes: list[ModelNote] = []
            palm = self._palm(link, moving)
            name = "gripper" if not found else f"{palm}_gripper"
            gripper = analyze_gripper(self.tree, name, palm, moving, notes)
            if gripper is not None and gripper.type is GripperType.PARALLEL:
                taken.update(inside)
                self.notes += notes
                self._guess(name, f"{', '.join(gripper.joints)} move its fingers, since these close on each other")
                found.append(gripper)
        return found

    def _is_short(self, joint: RobotJoint, poses: Mapping[str, Array]) -> bool:
        """Whether a joint may carry a finger by its length, and by what is below it."""
        links = self.tree.subtree(joint.child)
        points = self.tree.points(links, poses)
        names = [joint.name, *links]
        if not len(points) or any(_LEG.search(each) or _WHEEL.search(each) or _HEAD.search(each) for each in names):
            return False
        return float(np.linalg.norm(points - poses[joint.child][:3], axis=1).max()) <= _MAX_FINGER_M

    def _note_tools(self, grippers: Sequence[Gripper]) -> None:
        """Says of suction cups, magnets and hooks, and of grippers that nothing moves, that they grasp nothing."""
        named = [name for name in self.tree.links if is_named_as_finger(name)]
        if named and not grippers and all(each.subject != "gripper" for each in self.notes):
            text = "it is named as a part of a gripper, but no joint moves it, so the robot has none"
            self.notes.append(ModelNote(subject=named[0], text=text, is_guess=False))
        fingers = {link for each in grippers for link in self.tree.subtree(each.link)}
        for name in self.tree.links:
            if _TOOL.search(name) and name not in fingers:
                text = "what it holds is not simulated: the robot grasps with fingers that close, and has none there"
                self.notes.append(ModelNote(subject=name, text=text, is_guess=False))

    def _is_finger(self, joint: RobotJoint) -> bool:
        if not (_FINGER.search(joint.name) or _FINGER.search(joint.child)):
            return False
        names = f"{joint.name} {joint.child}"
        if _NO_FINGER.search(names) and joint.mimic is None and "finger" not in names.lower():
            return False
        below = (self.tree.parent_joint[link] for link in self.tree.subtree(joint.child)[1:])
        return all(_FINGER.search(each.name) or _FINGER.search(each.child) for each in below if each.is_movable)

    def _moves_something(self, joint: RobotJoint, cluster: Sequence[RobotJoint]) -> bool:
        """Whether a joint, or one that follows it, moves a link with a collision shape."""
        names = {joint.name, *(each.name for each in self.tree.followers.get(joint.name, ()))}
        moved = [each.child for each in cluster if each.name in names]
        geometries = (self.tree.links[link].geometry for top in moved for link in self.tree.subtree(top))
        return any(geometry is not None and geometry.collision_shapes for geometry in geometries)

    def _guessed_arms(self, grippers: Sequence[Gripper]) -> list[_ArmPart]:
        """The chains to the grippers; without these, long chains at the end of the tree that are no legs."""
        tips, least = [gripper.link for gripper in grippers], _MIN_ARM_JOINTS
        if not tips:
            moved = [joint for joint in self.tree.joints.values() if joint.is_actuated]
            tips = [joint.child for joint in moved if not self._has_joint_below(joint.child)]
            least = _MIN_GUESSED_ARM_JOINTS
        found: list[_ArmPart] = []
        for tip in tips:
            others = [each for each in tips if each != tip]
            chain = [joint for joint in self.tree.ancestors(tip) if joint.is_actuated]
            own = [joint for joint in chain if not set(self.tree.subtree(joint.child)).intersection(others)]
            own.reverse()
            names = [f"{joint.name} {joint.child}" for joint in own]
            if len(own) < least or any(_LEG.search(each) or _WHEEL.search(each) for each in names):
                continue
            side = _side(joint.name for joint in own)
            name = f"{side}_arm" if side else "arm"
            name = name if all(each.name != name for each in found) else f"{tip}_arm"
            self._guess(name, f"it has the joints {', '.join(joint.name for joint in own)}, by the tree")
            found.append(_ArmPart(name, own, own[-1].child))
        return found

    def _has_joint_below(self, link: str) -> bool:
        return any(self.tree.parent_joint[each].is_movable for each in self.tree.subtree(link)[1:])

    # -- arms and grippers ---------------------------------------------------------------------------------------------

    def _gripper(self, name: str, link: str, fingers: Sequence[RobotJoint]) -> Gripper | None:
        gripper = analyze_gripper(self.tree, name, link, fingers, self.notes) if fingers else None
        if gripper is None:
            self._guess(name, "it has no finger that moves and can touch things, so it is no gripper")
            return None
        states = {state: dict(positions) for group, state, positions in self.srdf.states if group == name}
        opened = _state_named(states, ("open", "opened"), gripper.joints)
        closed = _state_named(states, ("closed", "close"), gripper.joints)
        if opened is not None and closed is not None:
            gripper = msgspec.structs.replace(gripper, open_positions=opened, closed_positions=closed)
        return gripper

    def _arms(self, parts: Sequence[_ArmPart], grippers: Sequence[Gripper]) -> tuple[Arm, ...]:
        """The arms with their grippers, and with the lift or torso below if there is only one."""
        found = []
        for part in parts:
            joints = [*self._lift_below(part), *part.joints] if len(parts) == 1 else list(part.joints)
            inside = set(self.tree.subtree(joints[-1].child))
            rest, state = self._rest(joints)
            if state:
                self._guess(part.name, f"its rest position is the group state {state!r}")
            found.append(
                Arm(
                    name="arm" if len(parts) == 1 and not _ARM.search(part.name) else part.name,
                    joints=tuple(joint.name for joint in joints),
                    base_link=joints[0].parent,
                    tip_link=part.tip,
                    gripper=next((each.name for each in grippers if each.link in inside), None),
                    rest_positions=rest,
                )
            )
        return tuple(found)

    def _lift_below(self, part: _ArmPart) -> list[RobotJoint]:
        """The joints between the root and the only arm; none for a robot on legs or wheels of its own."""
        below = [joint for joint in self.tree.ancestors(part.joints[0].parent) if joint.is_actuated]
        if not below or any(_WHEEL.search(joint.name) or _LEG.search(joint.name) for joint in below):
            return []
        below.reverse()
        names = ", ".join(joint.name for joint in below)
        self._guess(part.name, f"it includes {names}, since there is no other arm")
        return below

    def _rest(self, joints: Sequence[RobotJoint]) -> tuple[tuple[float, ...], str]:
        """The positions of a named state in which the arm is out of the way, and its name; empty without one."""
        at_zero = rest_positions(joints)
        for word in _REST_STATES:
            for _, state, positions in self.srdf.states:
                given = {name: position for name, position in positions if name in at_zero}
                if word in state.lower() and 2 * len(given) > len(joints):
                    merged = rest_positions(joints, given)
                    return tuple(merged[joint.name] for joint in joints), "" if word == "rest" else state
        return (), ""

    def _home_positions(self, arms: Iterable[Arm]) -> tuple[tuple[str, float], ...]:
        home: dict[str, float] = {}
        for arm in arms:
            if arm.rest_positions:
                home |= dict(zip(arm.joints, arm.rest_positions, strict=True))
        return tuple(home.items())

    # -- head, sensors, base -------------------------------------------------------------------------------------------

    def _head(self) -> Head | None:
        group = self.srdf.group("head")
        joints = [] if group is None else [joint for joint in self._group_joints(group) if joint.is_actuated]
        if not joints:
            joints = [joint for joint in self.tree.joints.values() if joint.is_actuated and _HEAD.search(joint.name)]
            if joints:
                self._guess("head", f"{', '.join(joint.name for joint in joints)} turn it, by their names")
        if not joints:
            return None
        return Head(joints=tuple(joint.name for joint in joints), link=joints[-1].child)

    def _sensors(self) -> tuple[RobotSensor, ...]:
        found = []
        for name in self.tree.links:
            type = next((type for pattern, type in _SENSORS if pattern.search(name)), None)
            if type is not None:
                found.append(RobotSensor(name=name, type=type, link=name, is_optical="optical" in name.lower()))
        if found:
            self._guess("", f"{len(found)} links are the frames of sensors, by their names")
        return tuple(found)

    def _base(self) -> RobotBase:
        poses = self.tree.poses(rest_positions(self.tree.joints.values()))
        points = self.tree.points(self.tree.rigid_links(self.tree.root), poses)
        is_fixed = self.base_type is BaseType.FIXED
        is_legged = is_fixed and any(_LEG.search(name) for name in self.tree.links)
        standing = self.tree.points(self.tree.links, poses) if is_legged else points
        height = -float(standing[:, 2].min()) if len(standing) else 0.0
        if height < _FLOOR_TOLERANCE_M:
            height = 0.0
        low = points if is_fixed else points[points[:, 2] + height < _LOW_M]
        radius = float(np.linalg.norm(low[:, :2], axis=1).max()) if len(low) else 0.0
        return RobotBase(type=self.base_type, link=self.tree.root, height_m=round(height, 4), radius_m=round(radius, 4))


def _side(names: Iterable[str]) -> str:
    """The side that all of some names contain; empty if they do not."""
    names = list(names)
    return next((side for side, pattern in _SIDES if names and all(map(pattern.search, names))), "")


def _state_named(
    states: Mapping[str, Mapping[str, float]], names: Iterable[str], joints: Sequence[str]
) -> tuple[float, ...] | None:
    """The positions of joints in the first of some named states that has all of them."""
    for name in names:
        positions = states.get(name)
        if positions is not None and all(joint in positions for joint in joints):
            return tuple(positions[joint] for joint in joints)
    return None
