"""Which parts of a robot are its arms, grippers, head, base and sensors.

SRDF says so, if there is one; what it leaves open is concluded from names and from the tree, and reported.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

import msgspec
import numpy as np

from mindstage.robots.forward_kinematics import rest_positions
from mindstage.robots.model import (
    Arm,
    BaseType,
    Gripper,
    Head,
    ModelNote,
    RobotBase,
    RobotJoint,
    RobotJointType,
    RobotSensor,
    SensorType,
)
from mindstage.robots.models.grippers import analyze_gripper
from mindstage.robots.models.link_tree import LinkTree
from mindstage.robots.models.srdf import Srdf, SrdfGroup

__all__ = ["RobotStructure", "find_structure"]

_REST_STATES = ("rest", "tuck", "tucked", "fold", "folded", "travel", "transport", "stow", "home", "park", "ready")
"""Names of positions in which an arm is out of the way, the best first."""
_MIN_ARM_JOINTS = 4
_WHEEL = re.compile(r"wheel|caster|roller", re.IGNORECASE)
_CASTER = re.compile(r"caster", re.IGNORECASE)
_SENSORS = (
    (re.compile(r"depth.*(link|frame)$", re.IGNORECASE), SensorType.DEPTH_CAMERA),
    (re.compile(r"(camera|rgb|kinect|xtion|realsense|d435|stereo).*(link|frame)$", re.IGNORECASE), SensorType.CAMERA),
    (re.compile(r"(laser|lidar|scan|hokuyo|sick)", re.IGNORECASE), SensorType.LASER_SCANNER),
    (re.compile(r"(^|_)(ft|force_torque)(_|$)", re.IGNORECASE), SensorType.FORCE_TORQUE),
    (re.compile(r"(^|_)imu(_|$)", re.IGNORECASE), SensorType.IMU),
)
_MIN_CLEARANCE_M = 0.02


class RobotStructure(msgspec.Struct, frozen=True, kw_only=True):
    """The parts of a robot."""

    base: RobotBase
    arms: tuple[Arm, ...]
    grippers: tuple[Gripper, ...]
    head: Head | None
    sensors: tuple[RobotSensor, ...]
    home_positions: tuple[tuple[str, float], ...]
    notes: tuple[ModelNote, ...]


def find_structure(tree: LinkTree, srdf: Srdf, *, name: str) -> RobotStructure:
    """Finds the parts of a robot.

    Args:
        tree: the robot.
        srdf: its SRDF; empty if there is none.
        name: its name.
    """
    return _StructureFinder(tree, srdf, name).find()


class _StructureFinder:
    """The parts of one robot."""

    def __init__(self, tree: LinkTree, srdf: Srdf, name: str) -> None:
        self.tree, self.srdf, self.name = tree, srdf, name
        self.notes: list[ModelNote] = []

    def find(self) -> RobotStructure:
        grippers, arms = [], []
        for effector, arm_joints, tip in self._effectors():
            gripper = self._gripper(*effector)
            if gripper is not None:
                grippers.append(gripper)
            if arm_joints:
                arms.append((arm_joints, tip, None if gripper is None else gripper.name))
        arms = [*arms, *self._arms_without_effector([joints for joints, _, _ in arms])]
        base = self._base()
        named = [self._arm(joints, tip, gripper, count=len(arms), base=base) for joints, tip, gripper in arms]
        home = self._home_positions(named)
        return RobotStructure(
            base=base,
            arms=tuple(named),
            grippers=tuple(grippers),
            head=self._head(),
            sensors=self._sensors(),
            home_positions=home,
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

    def _effectors(self) -> list[tuple[tuple[str, str, list[RobotJoint]], list[RobotJoint], str]]:
        """For each end effector: its name, link and finger joints; the joints of the arm; the last link of the arm."""
        found = []
        for effector in self.srdf.end_effectors:
            group = self.srdf.group(effector.group)
            if group is None or effector.parent_link not in self.tree.links:
                continue
            joints = self._group_joints(group)
            arm = self._arm_of_effector(effector.parent_group, effector.parent_link)
            inside = set(self.tree.subtree(effector.parent_link))
            fingers = [joint for joint in joints if joint.is_movable and joint.child in inside]
            fingers += self._followers_of(fingers)
            link = self._palm(effector.parent_link, fingers)
            found.append(((effector.group, link, fingers), arm, effector.parent_link))
        return found

    def _followers_of(self, joints: Sequence[RobotJoint]) -> list[RobotJoint]:
        """Joints that mimic some of these and are not among them."""
        names = {joint.name for joint in joints}
        return [each for name in list(names) for each in self.tree.followers.get(name, ()) if each.name not in names]

    def _palm(self, parent_link: str, fingers: Sequence[RobotJoint]) -> str:
        """The link that carries all fingers."""
        if not fingers:
            return parent_link
        common = self._line(fingers[0].parent)
        for joint in fingers[1:]:
            line = set(self._line(joint.parent))
            common = [link for link in common if link in line]
        moved = {joint.child for joint in fingers}
        return next((link for link in common if link not in moved), parent_link)

    def _line(self, link: str) -> list[str]:
        """A link and its ancestors."""
        return [link, *(joint.parent for joint in self.tree.ancestors(link))]

    def _arm_of_effector(self, group_name: str, parent_link: str) -> list[RobotJoint]:
        """The actuated joints of the arm that carries an end effector."""
        above = {joint.name for joint in self.tree.ancestors(parent_link)}
        candidates = []
        for group in self.srdf.groups:
            joints = [joint for joint in self._group_joints(group) if joint.is_actuated]
            if joints and all(joint.name in above for joint in joints):
                candidates.append((group, joints))
        stated = next((joints for group, joints in candidates if group.name == group_name), None)
        if stated is not None:
            return stated
        long = [(group, joints) for group, joints in candidates if len(joints) >= _MIN_ARM_JOINTS]
        return min(long, key=lambda each: (len(each[1]), each[0].name))[1] if long else []

    def _arms_without_effector(
        self, known: Sequence[Sequence[RobotJoint]]
    ) -> list[tuple[list[RobotJoint], str, str | None]]:
        """Groups of SRDF that are chains named as arms, and have no end effector."""
        taken = {joint.name for joints in known for joint in joints}
        found: list[tuple[list[RobotJoint], str, str | None]] = []
        for group in sorted(self.srdf.groups, key=lambda each: len(self._group_joints(each))):
            if not re.search(r"arm|manipulator", group.name, re.IGNORECASE):
                continue
            joints = [joint for joint in self._group_joints(group) if joint.is_actuated]
            is_chain = all(self.tree.chain(a.child, b.parent) is not None for a, b in pairwise(joints))
            if len(joints) >= _MIN_ARM_JOINTS and is_chain and taken.isdisjoint(joint.name for joint in joints):
                taken |= {joint.name for joint in joints}
                found.append((joints, joints[-1].child, None))
        return found

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

    def _arm(self, joints: Sequence[RobotJoint], tip: str, gripper: str | None, *, count: int, base: RobotBase) -> Arm:
        """An arm, with the lift or torso below it if no other arm uses that."""
        first = joints[0]
        if count == 1:
            below = [joint for joint in self.tree.ancestors(first.parent) if joint.is_actuated]
            wheels = {joint.name for joint in below if _WHEEL.search(joint.name)}
            if below and not wheels:
                joints = [*reversed(below), *joints]
                names = ", ".join(joint.name for joint in reversed(below))
                self._guess(first.name, f"the arm includes {names}, since there is no other arm")
        names = tuple(joint.name for joint in joints)
        group = self._group_of(set(names))
        rest, state = self._rest(joints)
        if state:
            self._guess(group, f"its rest position is the group state {state!r}")
        return Arm(
            name=group,
            joints=names,
            base_link=joints[0].parent,
            tip_link=tip,
            gripper=gripper,
            rest_positions=rest,
        )

    def _group_of(self, names: set[str]) -> str:
        """The name of the group of SRDF with these joints, or with the most of them."""
        best, best_count = "arm", 0
        for group in self.srdf.groups:
            own = {joint.name for joint in self._group_joints(group) if joint.is_actuated}
            if own and own <= names and len(own) > best_count:
                best, best_count = group.name, len(own)
        return best

    def _rest(self, joints: Sequence[RobotJoint]) -> tuple[tuple[float, ...], str]:
        """The positions of a named state in which the arm is out of the way, and its name; empty without one."""
        positions_at_zero = rest_positions(joints)
        for word in _REST_STATES:
            for _, state, positions in self.srdf.states:
                given = {name: position for name, position in positions if name in positions_at_zero}
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

    # -- head and sensors ----------------------------------------------------------------------------------------------

    def _head(self) -> Head | None:
        group = self.srdf.group("head")
        joints = [] if group is None else [joint for joint in self._group_joints(group) if joint.is_actuated]
        if not joints:
            joints = [
                joint
                for joint in self.tree.joints.values()
                if joint.is_actuated and re.search(r"head|neck", joint.name, re.IGNORECASE)
            ]
            if joints:
                self._guess("head", f"{', '.join(joint.name for joint in joints)} turn the head, by their names")
        if not joints:
            return None
        return Head(joints=tuple(joint.name for joint in joints), link=joints[-1].child)

    def _sensors(self) -> tuple[RobotSensor, ...]:
        found = []
        for name in self.tree.links:
            for pattern, type in _SENSORS:
                if pattern.search(name):
                    found.append(RobotSensor(name=name, type=type, link=name, is_optical="optical" in name.lower()))
                    break
        if found:
            self._guess("", f"{len(found)} links are the frames of sensors, by their names")
        return tuple(found)

    # -- the base ------------------------------------------------------------------------------------------------------

    def _base(self) -> RobotBase:
        positions = rest_positions(self.tree.joints.values())
        poses = self.tree.poses(positions)
        rigid = self.tree.rigid_links(self.tree.root)
        wheels = [joint for joint in self.tree.joints.values() if joint.is_movable and _WHEEL.search(joint.name)]
        type = self._base_type(wheels)
        moved = [link for joint in wheels for link in self.tree.subtree(joint.child)]
        points = self.tree.points([*rigid, *moved], poses)
        height = max(0.0, -float(points[:, 2].min())) if len(points) else 0.0
        if height < _MIN_CLEARANCE_M:
            height = 0.0
        low = points[points[:, 2] + height < 0.5] if type is not BaseType.FIXED else points
        radius = float(np.linalg.norm(low[:, :2], axis=1).max()) if len(low) else 0.0
        return RobotBase(type=type, link=self.tree.root, height_m=round(height, 4), radius_m=round(radius, 4))

    def _base_type(self, wheels: Sequence[RobotJoint]) -> BaseType:
        virtual = next(iter(self.srdf.virtual_joints), None)
        if virtual is not None and virtual.type == "planar":
            return BaseType.DIFFERENTIAL if "diff" in virtual.motion_model else BaseType.PLANAR
        turning = [joint for joint in wheels if joint.type is RobotJointType.CONTINUOUS]
        driven = [joint for joint in turning if not _CASTER.search(joint.name)]
        if len(turning) >= 4 and len(driven) != 2:
            self._guess("base", f"it moves in every direction, since it has {len(turning)} wheels that turn")
            return BaseType.PLANAR
        if len(driven) >= 2:
            self._guess("base", f"it is driven by {driven[0].name} and {driven[1].name}, so it cannot move sideways")
            return BaseType.DIFFERENTIAL
        return BaseType.FIXED


def _state_named(
    states: Mapping[str, Mapping[str, float]], names: Iterable[str], joints: Sequence[str]
) -> tuple[float, ...] | None:
    """The positions of joints in the first of some named states that has all of them."""
    for name in names:
        positions = states.get(name)
        if positions is not None and all(joint in positions for joint in joints):
            return tuple(positions[joint] for joint in joints)
    return None
