"""The bodies, joints, lights and attachments of an engine, as they were described.

Every engine has one `EntityRegistry`. It refuses inconsistent entities (an id used twice, a joint to a missing body, a
cycle of attachments) with the same messages in all engines, and builds the snapshot.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot, isfinite
from operator import is_
from types import MappingProxyType

import msgspec
import numpy as np

from mindstage.engines.base import SpawnFailure, SpawnNote, SpawnReport
from mindstage.errors import AttachmentError, BodyExistsError, BodyNotFoundError, PoseUnreachableError
from mindstage.scene import (
    Attachment,
    Body,
    BodyId,
    Color,
    Iri,
    Joint,
    Light,
    Mobility,
    NamedResource,
    Pose,
    PropertyAssertion,
    World,
)
from mindstage.scene.edits import BodyEdit, SetPhysics
from mindstage.scene.joint_kinematics import moving_body, without_lost_masters
from mindstage.scene.transforms import Array, normalize, pose_array, pose_from_array, pose_multiply, quat_angle

__all__ = ["MAX_COORDINATE_M", "MAX_SIZE_M", "AddResult", "EntityRegistry", "pose_error"]

MAX_COORDINATE_M = 1e8
"""Positions farther from the origin are refused; the circumference of the earth is 4e7 m."""
MAX_SIZE_M = 1e5
"""Larger bodies are refused."""
_MIN_QUATERNION_NORM = 1e-6
"""Dimensionless, as is its reciprocal, the largest norm."""
_FRAME_TOLERANCE = 1e-9
"""A joint frame that differs by less from the described one is equal to it [m, rad], relative to larger coordinates."""
_MAX_STRENGTH = 1e9
"""Largest stiffness and damping of a soft limit, in SI units."""


@dataclass(slots=True)
class AddResult:
    """The entities of a world that were added to a registry, and those that were refused."""

    bodies: list[BodyId] = field(default_factory=list)
    joints: list[BodyId] = field(default_factory=list)
    attachments: list[BodyId] = field(default_factory=list)
    """Ids of the attached children."""
    failed_bodies: list[SpawnFailure] = field(default_factory=list)
    failed_joints: list[SpawnFailure] = field(default_factory=list)
    failed_attachments: list[SpawnFailure] = field(default_factory=list)

    def report(self, notes: Iterable[SpawnNote] = ()) -> SpawnReport:
        """The result as a `SpawnReport`."""
        return SpawnReport(
            bodies=len(self.bodies),
            joints=len(self.joints),
            attachments=len(self.attachments),
            failed_bodies=tuple(self.failed_bodies),
            failed_joints=tuple(self.failed_joints),
            failed_attachments=tuple(self.failed_attachments),
            notes=tuple(notes),
        )


class EntityRegistry:
    """Bodies, joints, lights and attachments by id."""

    def __init__(self) -> None:
        self.bodies: dict[BodyId, Body] = {}
        self.joints: dict[BodyId, Joint] = {}
        self.lights: dict[BodyId, Light] = {}
        self.parents: dict[BodyId, BodyId] = {}
        """The parent of each attached child."""
        self.highlighted: dict[BodyId, Color] = {}
        self.immovable: set[BodyId] = set()
        """Dynamic bodies that are simulated as static ones, until their physics is replaced."""
        self._children: dict[BodyId, dict[BodyId, None]] = {}  # dict as ordered set
        self._worlds: list[World] = []
        self._ids: tuple[BodyId, ...] | None = None
        self._rows: dict[BodyId, int] | None = None
        self._last = _LastSnapshot()

    def copy(self) -> EntityRegistry:
        """An independent copy; the values are frozen and shared."""
        twin = EntityRegistry()
        twin.bodies, twin.joints, twin.lights = dict(self.bodies), dict(self.joints), dict(self.lights)
        twin.parents, twin.highlighted = dict(self.parents), dict(self.highlighted)
        twin._children = {parent: dict(children) for parent, children in self._children.items()}
        twin.immovable = set(self.immovable)
        twin._worlds, twin._ids = list(self._worlds), self._ids
        twin._rows, twin._last = self._rows, replace(self._last)
        return twin

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """The ids of all bodies; the same object until one is added or removed."""
        if self._ids is None:
            self._ids = tuple(self.bodies)
        return self._ids

    @property
    def rows(self) -> dict[BodyId, int]:
        """The place of each body in `ids`, not to be changed; the same object until one is added or removed."""
        if self._rows is None:
            self._rows = dict(zip(self.ids, range(len(self.bodies)), strict=True))
        return self._rows

    def body(self, id: BodyId) -> Body:
        """Returns the body with an id.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        try:
            return self.bodies[id]
        except KeyError:
            raise BodyNotFoundError(id, known=self.bodies, world=self._worlds[0].name if self._worlds else "") from None

    def mobility(self, id: BodyId) -> Mobility:
        """The mobility with which a body is simulated: static by default, and for immovable bodies."""
        return Mobility.STATIC if id in self.immovable else self.bodies[id].physics.mobility or Mobility.STATIC

    def children(self, id: BodyId) -> tuple[BodyId, ...]:
        """The bodies that are attached directly to a body."""
        return tuple(self._children.get(id, ()))

    def attached_descendants(self, id: BodyId) -> Iterator[BodyId]:
        """The bodies attached to a body, directly and indirectly; parents before children."""
        stack = list(self.children(id))
        while stack:
            child = stack.pop()
            yield child
            stack.extend(self.children(child))

    # -- additions -------------------------------------------------------------------------------------------

    def add(self, world: World) -> AddResult:
        """Adds every valid entity: bodies and lights, then joints, then attachments."""
        added = AddResult()
        for body in world.bodies:
            reason = self._id_error(body.id) or pose_error(body.pose) or _size_error(body)
            if reason:
                added.failed_bodies.append(SpawnFailure(body.id, reason))
            else:
                self.bodies[body.id] = body
                added.bodies.append(body.id)
        for light in world.lights:
            if reason := self._id_error(light.id):
                added.failed_bodies.append(SpawnFailure(light.id, reason))
            else:
                self.lights[light.id] = light
        for joint in world.joints:
            if reason := self._joint_error(joint):
                added.failed_joints.append(SpawnFailure(joint.id, reason))
            else:
                self.joints[joint.id] = joint
                added.joints.append(joint.id)
        for attachment in world.attachments:
            if reason := self._attachment_error(attachment):
                added.failed_attachments.append(SpawnFailure(attachment.child, reason))
            else:
                self._link(attachment.parent, attachment.child)
                added.attachments.append(attachment.child)
        self._worlds.append(msgspec.structs.replace(world, bodies=(), joints=(), attachments=(), lights=()))
        new = range(len(self.bodies) - len(added.bodies), len(self.bodies))
        known = self._rows
        self._ids, self._rows = None, None if known is None else known | dict(zip(added.bodies, new, strict=True))
        return added

    def _id_error(self, id: BodyId) -> str:
        if id in self.bodies or id in self.joints or id in self.lights:
            return str(BodyExistsError(id))
        return ""

    def _joint_error(self, joint: Joint) -> str:
        ends = (joint.parent, joint.child)
        unknown = [end for end in ends if end not in self.bodies]
        if unknown:
            return f"it connects {' and '.join(map(repr, unknown))}, which does not exist"
        if ends[0] == ends[1]:
            return f"it connects {ends[0]!r} to itself"
        return self._id_error(joint.id) or pose_error(joint.pose) or _limits_error(joint)

    def _attachment_error(self, attachment: Attachment) -> str:
        for end in (attachment.parent, attachment.child):
            if end not in self.bodies:
                return f"there is no body {end!r}"
        current = self.parents.get(attachment.child)
        if current is not None:
            return f"it is already attached to {current!r}, so it cannot be attached to {attachment.parent!r} too"
        return self._attachment_cycle_error(attachment.parent, attachment.child)

    def _attachment_cycle_error(self, parent: BodyId, child: BodyId) -> str:
        ancestor: BodyId | None = parent
        while ancestor is not None:
            if ancestor == child:
                return (
                    "a body cannot be attached to itself"
                    if parent == child
                    else f"a cycle: {parent!r} is already attached to it"
                )
            ancestor = self.parents.get(ancestor)
        return ""

    # -- changes ---------------------------------------------------------------------------------------------

    def change(self, edit: BodyEdit) -> None:
        """Changes what is described of a body.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self.bodies[edit.id] = edit.changed(self.body(edit.id))
        if isinstance(edit, SetPhysics):
            (self.immovable.add if edit.immovable else self.immovable.discard)(edit.id)

    def move(self, id: BodyId, pose: Pose) -> None:
        """Sets the described pose of a body.

        Raises:
            BodyNotFoundError: there is no such body.
            PoseUnreachableError: the pose is not finite, or its quaternion is zero.
        """
        body = self.body(id)
        if reason := pose_error(pose):
            raise PoseUnreachableError(id, reason=reason)
        self.bodies[id] = msgspec.structs.replace(body, pose=pose)

    def attach(self, parent: BodyId, child: BodyId) -> None:
        """Attaches a child to a parent; see `Attach` for what it raises."""
        self.body(parent), self.body(child)
        if reason := self._attachment_cycle_error(parent, child):
            raise AttachmentError(parent, child, reason=reason)
        self.detach(child)
        self._link(parent, child)

    def detach(self, child: BodyId) -> None:
        """Detaches a child, if it is attached."""
        self.body(child)
        parent = self.parents.pop(child, None)
        if parent is not None:
            del self._children[parent][child]

    def _link(self, parent: BodyId, child: BodyId) -> None:
        self.parents[child] = parent
        self._children.setdefault(parent, {})[child] = None

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        """See `Engine.highlight`."""
        found = [self.body(id).id for id in ids]
        changed = dict(self.highlighted)  # a new dict each time, since callers keep the old one
        for id in found:
            if color is None:
                changed.pop(id, None)
            else:
                changed[id] = color
        self.highlighted = changed

    def remove(self, ids: Iterable[BodyId]) -> None:
        """Removes bodies with their joints and attachments; see `Delete`."""
        removed = {self.body(id).id for id in ids}
        for id in removed:
            for child in self.children(id):
                self.detach(child)
            self.detach(id)
            del self.bodies[id]
            self.immovable.discard(id)
            self._children.pop(id, None)
        self.highlighted = {id: color for id, color in self.highlighted.items() if id not in removed}
        self.joints = {
            id: joint for id, joint in self.joints.items() if joint.parent not in removed and joint.child not in removed
        }
        self._ids = self._rows = None

    def require_free(self, ids: Iterable[BodyId]) -> None:
        """Checks that ids are not in use.

        Raises:
            BodyExistsError: for the first that is.
        """
        for id in ids:
            if self._id_error(id):
                raise BodyExistsError(id)

    def fragment(self, ids: Iterable[BodyId]) -> World:
        """Some bodies with their joints and attachments, also to others, as they were described.

        Raises:
            BodyNotFoundError: for the first unknown id.
        """
        found = {self.body(id).id: self.bodies[id] for id in ids}
        return World(
            iri=self._worlds[0].iri if self._worlds else Iri(""),
            name=self._worlds[0].name if self._worlds else "",
            bodies=tuple(found.values()),
            joints=tuple(each for each in self.joints.values() if each.parent in found or each.child in found),
            attachments=tuple(
                Attachment(parent=parent, child=child)
                for child, parent in self.parents.items()
                if parent in found or child in found
            ),
        )

    def restore(self, fragment: World, immovable: Collection[BodyId] = ()) -> tuple[set[BodyId], set[BodyId]]:
        """Adds deleted bodies again, with their joints and attachments to bodies that exist.

        Args:
            fragment: what `fragment` returned before they were deleted.
            immovable: those of the bodies that were immovable.

        Returns:
            The ids of the joints, and those of the attached children.

        Raises:
            BodyExistsError: the id of a body is in use; nothing is added then.
        """
        self.require_free(body.id for body in fragment.bodies)
        self.bodies |= {body.id: body for body in fragment.bodies}
        self.immovable.update(immovable)
        joints, children = set[BodyId](), set[BodyId]()
        for joint in fragment.joints:
            if not self._joint_error(joint):
                self.joints[joint.id] = joint
                joints.add(joint.id)
        for attachment in fragment.attachments:
            if not self._attachment_error(attachment):
                self._link(attachment.parent, attachment.child)
                children.add(attachment.child)
        self._ids = self._rows = None
        return joints, children

    # -- snapshot --------------------------------------------------------------------------------------------

    def to_world(
        self,
        poses: Array | None = None,
        *,
        joint_frames: Mapping[BodyId, tuple[Array, Array]] = MappingProxyType({}),
        tolerance_m: float = 0.0,
        tolerance_rad: float = 0.0,
    ) -> World:
        """Everything as one world, with the IRI and name of the world that was added first.

        Args:
            poses: current poses, n x 7 in the order of `ids`; None for the described ones.
            joint_frames: each joint's frame in its parent and in its child. A joint is where the body that holds it has
                moved it; without its frames, it is where it was described.
            tolerance_m: a body that is no farther from its described pose keeps it [m]; beyond a meter from the origin,
                the tolerance is relative to the coordinates.
            tolerance_rad: the same for the rotation [rad].
        """
        bodies = self._moved_bodies(poses, tolerance_m, tolerance_rad)
        facts, resources = self._facts_and_resources()
        return World(
            iri=self._worlds[0].iri if self._worlds else Iri("http://mindstage.org/maps/empty.owl#map"),
            name=self._worlds[0].name if self._worlds else "",
            bodies=bodies,
            joints=self._moved_joints(bodies, joint_frames),
            attachments=self._attachments(),
            lights=tuple(self.lights.values()),
            facts=facts,
            resources=resources,
        )

    def _facts_and_resources(self) -> tuple[tuple[PropertyAssertion, ...], tuple[NamedResource, ...]]:
        last = self._last
        if last.worlds != self._worlds:
            last.worlds = list(self._worlds)
            last.facts = tuple(fact for world in self._worlds for fact in world.facts)
            last.resources = tuple(dict.fromkeys(resource for world in self._worlds for resource in world.resources))
        return last.facts, last.resources

    def _attachments(self) -> tuple[Attachment, ...]:
        links = list(self.parents.items())
        if links != self._last.links:
            attachments = tuple(Attachment(parent=parent, child=child) for child, parent in links)
            self._last.links, self._last.attachments = links, attachments
        return self._last.attachments

    def _moved_bodies(self, poses: Array | None, tolerance_m: float, tolerance_rad: float) -> tuple[Body, ...]:
        """The bodies, at these poses; those of the last snapshot as far as they are the same."""
        last, described = self._last, list(self.bodies.values())
        if len(described) != len(last.described):
            last.described, last.described_poses = described, pose_array(body.pose for body in described)
            last.bodies, last.poses = tuple(described), last.described_poses
        others = [] if described == last.described else _different_rows(described, last.described)
        if others:
            last.described, last.described_poses = described, last.described_poses.copy()
            last.described_poses[others] = pose_array(described[row].pose for row in others)
        now = last.described_poses if poses is None else poses
        is_changed = (now != last.poses).any(axis=1)
        is_changed[others] = True
        changed = np.flatnonzero(is_changed)
        if not len(changed):
            return last.bodies
        wanted, origin = now[changed], last.described_poses[changed]
        distance = np.abs(wanted[:, :3] - origin[:, :3]).max(axis=1, initial=0.0)
        scale = np.maximum(1.0, np.abs(origin[:, :3]).max(axis=1, initial=1.0))
        is_moved = (distance > tolerance_m * scale) | (quat_angle(origin[:, 3:], wanted[:, 3:]) > tolerance_rad)
        bodies = list(last.bodies)
        for row, is_other, pose in zip(changed.tolist(), is_moved.tolist(), wanted, strict=True):
            body = described[row]
            bodies[row] = msgspec.structs.replace(body, pose=pose_from_array(pose)) if is_other else body
        last.bodies, last.poses = tuple(bodies), now.copy()
        return last.bodies

    def _moved_joints(
        self, bodies: tuple[Body, ...], joint_frames: Mapping[BodyId, tuple[Array, Array]]
    ) -> tuple[Joint, ...]:
        """The joints, at the poses to which the bodies that hold them have moved them."""
        last, described = self._last, list(self.joints.values())
        frames = [joint_frames.get(joint.id) for joint in described]
        is_same = described == last.described_joints and all(map(is_, frames, last.frames))
        if is_same and bodies is last.joined_bodies:
            return last.joints
        rows = self.rows
        known = [joint for joint, frame in zip(described, frames, strict=True) if frame is not None]
        joints = {joint.id: joint for joint in described}
        if is_same and len(bodies) == len(last.joined_bodies):
            other = set(_different_rows(bodies, last.joined_bodies))
            known = [joint for joint in known if rows[joint.parent] in other or rows[joint.child] in other]
            joints = dict(zip(joints, last.joints, strict=True)) | {joint.id: joint for joint in known}
        if known:
            ends = [(bodies[rows[joint.parent]], bodies[rows[joint.child]]) for joint in known]
            joints |= _moved_joints(known, ends, [joint_frames[joint.id] for joint in known])
        last.described_joints, last.frames, last.joined_bodies = described, frames, bodies
        last.joints = without_lost_masters(tuple(joints.values()))
        return last.joints


def _different_rows(now: Sequence[object], then: Sequence[object]) -> list[int]:
    return [row for row, is_same in enumerate(map(is_, now, then)) if not is_same]


def _moved_joints(
    known: Sequence[Joint], ends: Sequence[tuple[Body, Body]], frames: Sequence[tuple[Array, Array]]
) -> dict[BodyId, Joint]:
    """Those of some joints that have moved with their holders, by their ids.

    Args:
        known: the joints.
        ends: their parents and children, at their poses.
        frames: the frames of each joint in its parent and in its child.
    """
    at_ends = pose_array(body.pose for pair in ends for body in pair)
    at_ends[:, 3:] = normalize(at_ends[:, 3:])
    now = pose_multiply(at_ends, np.array(frames).reshape(-1, 7)).reshape(-1, 2, 7)
    described = pose_array(joint.pose for joint in known)[:, None]
    scale = np.maximum(1.0, np.abs(described[..., :3]).max(axis=2))
    is_moved = np.abs(now[..., :3] - described[..., :3]).max(axis=2) > _FRAME_TOLERANCE * scale
    is_moved |= quat_angle(np.broadcast_to(described[..., 3:], now[..., 3:].shape), now[..., 3:]) > _FRAME_TOLERANCE
    moved: dict[BodyId, Joint] = {}
    for row in np.flatnonzero(is_moved.any(axis=1)).tolist():
        joint, (parent, child) = known[row], ends[row]
        _, holder = moving_body(joint, parent, child)
        end = 0 if holder is parent else 1
        if is_moved[row, end]:
            moved[joint.id] = msgspec.structs.replace(joint, pose=pose_from_array(now[row, end]))
    return moved


@dataclass(slots=True)
class _LastSnapshot:
    """The last world of a registry: the next one shares what has not changed.

    All is compared with what it was made of, so that nothing needs to be reported here when it changes.
    """

    described: list[Body] = field(default_factory=list)
    described_poses: Array = field(default_factory=lambda: np.zeros((0, 7)))
    poses: Array = field(default_factory=lambda: np.zeros((0, 7)))
    """Those of `bodies`, n x 7, before the tolerance."""
    bodies: tuple[Body, ...] = ()
    described_joints: list[Joint] = field(default_factory=list)
    frames: list[tuple[Array, Array] | None] = field(default_factory=list)
    joined_bodies: tuple[Body, ...] = ()
    """The bodies that `joints` are at."""
    joints: tuple[Joint, ...] = ()
    links: list[tuple[BodyId, BodyId]] = field(default_factory=list)
    attachments: tuple[Attachment, ...] = ()
    worlds: list[World] = field(default_factory=list)
    facts: tuple[PropertyAssertion, ...] = ()
    resources: tuple[NamedResource, ...] = ()


def pose_error(pose: Pose) -> str:
    """The reason why a pose is invalid, or an empty string."""
    if not all(map(isfinite, (*pose.position, *pose.quaternion))):
        return "its pose has numbers that are not finite"
    if max(map(abs, pose.position)) > MAX_COORDINATE_M:
        return f"its position {pose.position} is farther than {MAX_COORDINATE_M:g} m from the origin"
    if not any(pose.quaternion):
        return "its quaternion is all zeros, which is no rotation"
    if not _MIN_QUATERNION_NORM <= hypot(*pose.quaternion) <= 1.0 / _MIN_QUATERNION_NORM:
        return f"its quaternion {pose.quaternion} has a norm of {hypot(*pose.quaternion):.3g}, which is no rotation"
    return ""


def _size_error(body: Body) -> str:
    size = body.size
    if size is not None and not (all(map(isfinite, size)) and min(size) >= 0.0):
        return f"its size {size} is not three finite lengths"
    if size is not None and max(size) > MAX_SIZE_M:
        return f"its size {size} is larger than {MAX_SIZE_M:g} m"
    mass = body.physics.mass_kg
    if mass is not None and not (isfinite(mass) and mass >= 0.0):
        return f"its mass {mass} is not a finite mass"
    return ""


def _limits_error(joint: Joint) -> str:
    angular = joint.angular
    limits = (joint.linear.limit, angular.swing1_limit, angular.swing2_limit, angular.twist_limit)
    if not (all(map(isfinite, limits)) and min(limits) >= 0.0):
        return f"its limits {limits} are not all finite and positive"
    linear = joint.linear
    slides = (linear.x_middle, linear.y_middle, linear.z_middle)
    middles = (*slides, angular.swing1_middle, angular.swing2_middle, angular.twist_middle)
    if joint.mimic is not None and not (isfinite(joint.mimic.multiplier) and isfinite(joint.mimic.offset)):
        return f"the multiplier and offset by which it mimics {joint.mimic.joint!r} are not finite"
    if not all(map(isfinite, middles)):
        return f"the middle positions {middles} of its ranges are not all finite"
    if max(map(abs, (*limits, *middles))) > MAX_COORDINATE_M:
        return f"its limits {limits} or their middle positions {middles} are beyond {MAX_COORDINATE_M:g}"
    soft_limits = (linear.soft_limit, angular.swing_soft_limit, angular.twist_soft_limit)
    strengths = [number for each in soft_limits if each.enabled for number in (each.stiffness, each.damping)]
    if not all(isfinite(number) and 0.0 <= number <= _MAX_STRENGTH for number in strengths):
        return f"the stiffness and damping {strengths} of its soft limits are not all between 0 and {_MAX_STRENGTH:g}"
    return ""
