"""What the detection of events knows about bodies: their kinds, their smoothed poses, and their velocities.

Everything is an array over the rows of `EpisodeFrame.ids`, so that a frame costs a few array operations whatever the
number of bodies. Positions are smoothed by the median of three consecutive frames, which removes single outliers of a
noisy localization without shifting a motion in time; the price is one frame of delay.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import PoseArray
from mindstage.episodes.recording import EpisodeFrame
from mindstage.ranges import Fraction, NotNegative, check_fields
from mindstage.scene import Body, BodyId, Joint, Mobility, World
from mindstage.scene.bounding_boxes import Indices
from mindstage.scene.joint_kinematics import RigidGroups, axis_ranges, first_movable_axis, is_robot_part, moving_body
from mindstage.scene.spatial import SpatialRelations
from mindstage.scene.transforms import Array, normalize, pose_array, pose_inverse, pose_multiply
from mindstage.scene.world_model import AxisMotion

__all__ = ["AgentTracker", "BodyTable", "DetectionThresholds", "JointTable", "MotionSample", "MotionTracker", "lengths"]

Mask = NDArray[np.bool_]
Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionThresholds:
    """The numbers by which events are detected.

    They fit household objects and a recording at 20 Hz or more. A pair of numbers is a hysteresis: the first one begins
    a state, the second one ends it, so that noise around either does not.
    """

    min_duration_s: NotNegative = 0.1
    """A relation or a motion that lasts shorter is no event, and a shorter gap does not divide one [s]. The time
    resolution of human action segmentation, and longer than the rebound of a contact in a physics engine."""
    window_s: NotNegative = 0.1
    """Velocities are means over this time [s]: 1 mm of noise becomes 10 mm/s at most."""
    move_m_s: tuple[NotNegative, NotNegative] = (0.03, 0.015)
    """A body or a sliding joint moves, and stops [m/s]. Three times what 1 mm of noise makes of a resting body; hands
    move objects at 0.1 m/s and more."""
    turn_rad_s: tuple[NotNegative, NotNegative] = (0.08, 0.04)
    """A hinge turns, and stops [rad/s]: the rim of a door of 0.5 m at `move_m_s`."""
    still_m: NotNegative = 0.002
    """A body that is displaced by less has not moved yet [m]: begins and ends of motions are dated by it."""
    rest_m: NotNegative = 0.0005
    """A body that is displaced by less rests [m]: begins and ends of slides are dated by it."""
    changed_m: NotNegative = 1e-6
    """A body whose pose has changed by less has not moved since the frame before [m]; also of its quaternion."""
    touching_gap_m: NotNegative = 0.001
    """Gap within which bodies that an engine simulates are in contact though it reports none [m]: they sleep, or
    jitter."""
    flight_tolerance_m: NotNegative = 0.006
    """Deviation from a parabola within which a body is in free flight [m]: what a fall from rest covers within a
    frame."""
    contact_gap_m: tuple[NotNegative, NotNegative] = (0.003, 0.006)
    """Where contacts were not recorded, two bodies touch from one gap and part at the other one [m]: above the noise of
    1 mm on either side."""
    max_contact_depth_m: NotNegative = 0.02
    """Bodies that overlap by more are not in contact, but one is within the box of the other one [m]; the depth from
    which `scene.spatial` no longer calls a body "on" another one."""
    support_min_normal_z: Fraction = 0.7
    """Vertical part of the contact normal from which the lower body supports the upper one: 45 degrees."""
    impulse_window_s: NotNegative = 0.1
    """Time over which the force of a new contact is integrated [s]: the duration of an impact in an engine with soft
    contacts, and no more, since the weight of a resting body adds up."""
    collision_min_speed_m_s: NotNegative = 0.3
    """Least speed along the normal with which the bodies of a collision approach [m/s]: a fall from 5 mm; careful
    placing is slower."""
    collision_min_impulse_n_s: NotNegative = 0.02
    """Least impulse of a collision [N s]: a pen of 20 g at 1 m/s. Not required where forces and masses are unknown."""
    collision_repeat_s: NotNegative = 0.5
    """The rebounds of a collision within this time belong to it [s]."""
    teleport_m: NotNegative = 0.05
    """Least distance of a jump between two frames [m] …"""
    teleport_m_s: NotNegative = 2.0
    """… and least gain of speed that it would mean [m/s]: no hand, joint or fall gains as much within one frame."""
    fall_min_height_m: NotNegative = 0.05
    """Least height of a fall [m], which takes 0.1 s."""
    fall_min_acceleration_m_s2: NotNegative = 5.0
    """Least downward acceleration of a body that falls freely [m/s²]: half of gravity. A pulled body is slower."""
    held_min_s: NotNegative = 0.15
    """A body that nothing has touched for so long, and that does not fall, is held by a force [s]: then the last tenth
    of a second is free of the moment in which it left its support."""
    tip_min_rad: NotNegative = 0.785
    """Least change of the direction of a body's vertical axis by which it tips over [rad]: 45 degrees."""
    tip_begin_rad: NotNegative = 0.05
    """Change of that direction from which it has begun to tip [rad]."""
    slide_min_m: NotNegative = 0.03
    """Least distance of sliding [m], above the noise and the settling of a body that was put down."""
    lift_m: NotNegative = 0.05
    """Distance between a body and where it left or got its support, by which picking up ends and putting down begins
    [m]. USemLog has 30 mm to 120 mm and 20 mm to 80 mm for the two."""
    transport_min_m: NotNegative = 0.1
    """Least distance of transporting [m]."""
    release_s: NotNegative = 0.1
    """A body that gets a support within this time after its release was put down, not dropped [s]: the time of the
    least fall."""
    joint_min_m: NotNegative = 0.02
    """Least travel of opening and closing a slide [m]: the play of a closed drawer is less."""
    joint_min_rad: NotNegative = 0.035
    """Least travel of opening and closing a hinge [rad]: 2 degrees."""

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, slots=True, eq=False)
class JointTable:
    """The joints with an axis that moves, in one order."""

    ids: tuple[BodyId, ...]
    moving: tuple[BodyId, ...]
    """The body that each joint moves."""
    holding: tuple[BodyId, ...]
    axis: Indices
    """The first movable axis of each, in the order of `kinematics.axis_ranges`."""
    is_prismatic: Mask
    closed: Array
    """The position in the map, or the limit nearest to it [m or rad]."""
    low: Array
    """The limits [m or rad]; infinite without one."""
    high: Array
    _ends: Indices
    """2 x m: rows of parent and child."""
    _frames: Array
    """2 x m x 7: the joint frame in the frames of parent and child."""

    @classmethod
    def from_world(cls, world: World, row: Mapping[BodyId, int], before: JointTable | None = None) -> JointTable:
        """The table of a world; the joints of robots are not in it, since they neither open nor close.

        Args:
            row: the rows of the bodies.
            before: an earlier table; joints that are not in it have position 0 at the poses of the world.
        """
        bodies = {body.id: body for body in world.bodies}
        kept: list[tuple[Joint, int, Body, Body]] = []
        for joint in world.joints:
            axis = first_movable_axis(joint)
            if (
                axis is not None
                and joint.parent in row
                and joint.child in row
                and not is_robot_part(bodies[joint.child])
            ):
                kept.append((joint, axis, *moving_body(joint, bodies[joint.parent], bodies[joint.child])))
        ranges = [axis_ranges(joint)[axis] for joint, axis, _, _ in kept]
        is_free = np.array([each.motion is AxisMotion.FREE for each in ranges], dtype=bool)
        limit = np.where(is_free, np.inf, np.array([each.limit for each in ranges]))
        middle = np.where(is_free, 0.0, np.array([each.middle for each in ranges]))
        low, high = middle - limit, middle + limit
        frames = _unit_poses(pose_array(joint.pose for joint, *_ in kept))
        ends = [
            _unit_poses(pose_array(bodies[id].pose for id in ids))
            for ids in ([joint.parent for joint, *_ in kept], [joint.child for joint, *_ in kept])
        ]
        local_frames = np.stack([pose_multiply(pose_inverse(each), frames) for each in ends])
        if before is not None:
            known = {id: number for number, id in enumerate(before.ids)}
            for number, (joint, *_) in enumerate(kept):
                if joint.id in known:
                    local_frames[:, number] = before._frames[:, known[joint.id]]
        return cls(
            ids=tuple(joint.id for joint, *_ in kept),
            moving=tuple(moving.id for _, _, moving, _ in kept),
            holding=tuple(holder.id for _, _, _, holder in kept),
            axis=np.array([axis for _, axis, _, _ in kept], dtype=np.intp),
            is_prismatic=np.array([axis < 3 for _, axis, _, _ in kept], dtype=bool),
            closed=np.clip(0.0, low, high),
            low=low,
            high=high,
            _ends=np.array([[row[joint.parent], row[joint.child]] for joint, *_ in kept], dtype=np.intp)
            .reshape(-1, 2)
            .T,
            _frames=local_frames,
        )

    def positions(self, known: Mapping[BodyId, tuple[float, ...]] | None, poses: PoseArray) -> Array:
        """The position of each joint on its axis [m or rad].

        Args:
            known: the displacements of a frame; without them, or for a joint that is missing in them, the position is
                computed from the poses of its bodies.
            poses: the poses of all bodies, n x 7.
        """
        found = np.full(len(self.ids), np.nan)
        if known is not None:
            for index, (id, axis) in enumerate(zip(self.ids, self.axis.tolist(), strict=True)):
                if id in known:
                    found[index] = known[id][axis]
        missing = np.flatnonzero(np.isnan(found))
        if len(missing):
            parent, child = (
                pose_multiply(poses[ends[missing]], frames[missing])
                for ends, frames in zip(self._ends, self._frames, strict=True)
            )
            relative = pose_multiply(pose_inverse(parent), child)
            axis = self.axis[missing]
            component = relative[np.arange(len(missing)), np.where(axis < 3, axis, axis + 1)]
            angle = 2.0 * np.arctan2(component, relative[:, 3])
            found[missing] = np.where(axis < 3, component, (angle + np.pi) % (2 * np.pi) - np.pi)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class BodyTable:
    """What is known about each body apart from its motion, by its row in `EpisodeFrame.ids`."""

    structure: World
    ids: tuple[BodyId, ...]
    row: Mapping[BodyId, int]
    sizes: Array
    """n x 3 [m]; 0 if unknown."""
    masses: Array
    """n [kg]; NaN if unknown."""
    group: Indices
    """The row of the root of each body's rigid group."""
    is_jointed: Mask
    """Whether a joint holds the rigid group of the body."""
    is_dynamic: Mask
    """Whether the engine simulates the rigid group of the body."""
    is_free: Mask
    """Whether the body is dynamic and held by no joint, so that it can fall, slide and be picked up."""
    can_move: Mask
    """Whether anything but a deletion can change its pose: all bodies except static ones."""
    has_gravity: Mask
    is_mover: Mask
    """Whether it is a body that others can be held by: moved by commands, or a link of a robot."""
    mover: Indices
    """The row of the mover that a body is attached to; -1 for none."""
    is_agent: Mask
    """Whether a mover is described as an agent, a part of a robot, a hand or a gripper: by tags, joints or names."""
    base: Indices
    """The row of the kinematic body that holds a mover by a joint; -1 for none."""
    is_robot_part: Mask
    """Whether it is tagged as a part of a robot, which handles things and is not handled."""
    is_handled: Mask
    """Whether a body is free, or would be if it were not attached to a mover."""
    is_subject: Mask
    """Whether motions of a body are events: as `is_handled`, but of bodies that are attached to each other, one."""
    is_enclosing: Mask
    """Whether the body contains everything else; see `scene.spatial`."""
    jointed_groups: frozenset[tuple[int, int]]
    """Pairs of groups that a joint connects, in both orders."""
    joints: JointTable

    @classmethod
    def from_frame(cls, frame: EpisodeFrame, before: BodyTable | None = None) -> BodyTable:
        """The table of the bodies of a frame.

        Args:
            before: the table of the frame before, which tells new attachments from those of the map.
        """
        by_id = {body.id: number for number, body in enumerate(frame.structure.bodies)}
        row = {id: number for number, id in enumerate(frame.ids)}
        order = np.array([by_id[id] for id in frame.ids], dtype=np.intp)
        bodies = [frame.structure.bodies[number] for number in order.tolist()]
        groups = RigidGroups.from_world(frame.structure)
        row_of = np.full(len(by_id), -1, dtype=np.intp)
        row_of[order] = np.arange(len(order))
        group = row_of[groups.root_row[order]]
        group = np.where(group < 0, np.arange(len(group)), group)
        joined = [(int(row_of[one]), int(row_of[other])) for one, other in groups.jointed_pairs]
        is_jointed, is_dynamic = groups.is_jointed[order], groups.is_dynamic[order]
        mobility = [body.physics.mobility for body in bodies]
        is_kinematic = np.array([each is Mobility.KINEMATIC for each in mobility], dtype=bool)
        loose = np.array([each is Mobility.DYNAMIC for each in mobility], dtype=bool)
        robot = {moving for moving, held in joined if is_jointed[held] or is_kinematic[held]}
        chains = {moving for moving, held in joined if is_jointed[held]}
        base = np.full(len(bodies), -1, dtype=np.intp)
        for moving, held in joined:
            if is_kinematic[held] and not is_jointed[held]:
                base[group == group[moving]] = held
        is_named = np.array([not _AGENT_WORDS.isdisjoint(_words(body)) for body in bodies], dtype=bool)
        is_link = np.array([is_robot_part(body) for body in bodies], dtype=bool)
        is_robot = np.isin(group, list(robot)) | is_link
        is_mover = (is_kinematic[group] & ~is_jointed) | is_robot
        can_hold = is_mover & (is_kinematic | is_robot)
        holder = np.full(len(bodies), -1, dtype=np.intp)
        for each in frame.structure.attachments:
            child, parent = row.get(each.child, -1), row.get(each.parent, -1)
            if child >= 0 and parent >= 0 and loose[child] and can_hold[parent] and not is_link[child]:
                holder[child] = parent
        is_free = is_dynamic & ~is_jointed & ~is_link
        same = before is not None and before.ids == frame.ids
        enclosing = (
            before.is_enclosing if before is not None and same else _enclosing_bodies(frame.structure, frame.ids)
        )
        return cls(
            structure=frame.structure,
            ids=frame.ids,
            row=row,
            sizes=np.array([body.size or (0.0, 0.0, 0.0) for body in bodies], dtype=np.float64).reshape(-1, 3),
            masses=np.array([body.physics.mass_kg or np.nan for body in bodies], dtype=np.float64),
            group=group,
            is_jointed=is_jointed,
            is_dynamic=is_dynamic,
            is_free=is_free,
            can_move=is_dynamic | is_kinematic[group] | is_jointed | (holder >= 0),
            has_gravity=np.array([body.physics.gravity is not False for body in bodies], dtype=bool),
            is_mover=is_mover,
            mover=holder,
            is_agent=is_mover & (is_link | is_named | np.isin(group, list(chains))),
            base=base,
            is_robot_part=is_link,
            is_handled=is_free | (holder >= 0),
            is_subject=(is_free & (group == np.arange(len(group)))) | (holder >= 0),
            is_enclosing=enclosing,
            jointed_groups=frozenset(pair for one, other in joined for pair in ((one, other), (other, one))),
            joints=JointTable.from_world(frame.structure, row, None if before is None else before.joints),
        )

    def group_sums(self, counts: Indices | Mask) -> Indices:
        """For each body, the sum of the counts of the bodies of its rigid group."""
        return np.bincount(self.group, weights=counts, minlength=len(counts)).astype(np.intp)[self.group]

    def rows_before(self, before: BodyTable) -> Indices:
        """The row that each body had in another table; -1 for a body that was not in it."""
        if self.ids == before.ids:
            return np.arange(len(self.ids))
        return np.array([before.row.get(id, -1) for id in self.ids], dtype=np.intp)


_AGENT_WORDS = frozenset({"agent", "arm", "finger", "gripper", "hand", "human", "person", "robot", "thumb"})


def _words(body: Body) -> set[str]:
    """The words of the name and of the class of a body, in lower case."""
    names = (body.id, body.cls.rpartition("#")[2].rpartition("/")[2])
    return {word.lower() for name in names for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)}


class AgentTracker:
    """Which movers are agents, so that they can hold things: furniture is none, even if it is moved by commands.

    Agents are those that are described as such, those that the caller names, and bodies that have moved by themselves:
    no contact, joint or gravity explains the motion. That holds for each motion of a kinematic body that is not a jump,
    and for what it holds by joints.
    """

    def __init__(self, named: Collection[BodyId]) -> None:
        self._named = frozenset(named)
        self._moved: dict[BodyId, float] = {}
        """When a body had moved by itself [s]."""
        self._origins: dict[BodyId, Array] = {}

    def update(self, sample: MotionSample) -> Mask:
        """Takes a sample; returns which bodies are agents."""
        table = sample.table
        own = table.is_mover & ~table.is_agent & ~table.is_jointed & (table.group == np.arange(len(table.ids)))
        for row in np.flatnonzero(own).tolist():
            id, pose = table.ids[row], sample.poses[row]
            if id in self._moved:
                continue
            if id not in self._origins or sample.jumped[row]:
                self._origins[id] = pose.copy()
            origin = self._origins[id]
            turned = 2.0 * np.arccos(min(abs(float(pose[3:] @ origin[3:])), 1.0))
            if np.linalg.norm(pose[:3] - origin[:3]) > _SELF_MOVED_M or turned > _SELF_MOVED_RAD:
                self._moved[id] = sample.time_s
        found = table.is_agent.copy()
        rows = [table.row[id] for id in (*self._moved, *self._named) if id in table.row]
        if rows:
            found |= np.isin(table.group, table.group[rows]) | np.isin(table.base, rows)
        return found & table.is_mover

    def reason(self, table: BodyTable, id: BodyId) -> str:
        """Why a body is an agent, as a sentence."""
        row = table.row.get(id)
        if row is not None and table.is_agent[row]:
            return f"{id} is described as a part of a robot, a hand or a gripper."
        moved = next((each for each in (id, *self._around(table, row)) if each in self._moved), None)
        if moved is not None:
            return f"{moved} moved by itself: no contact, joint or gravity explains its motion."
        return f"{id} was named as an agent."

    @staticmethod
    def _around(table: BodyTable, row: int | None) -> tuple[BodyId, ...]:
        """The root of the group of a body, and the body that holds it by a joint."""
        return (
            () if row is None else tuple(table.ids[each] for each in (table.group[row], table.base[row]) if each >= 0)
        )


_SELF_MOVED_M = 0.02
"""Distance from which a kinematic body has moved [m]: more than the noise of a localization."""
_SELF_MOVED_RAD = 0.1


def _enclosing_bodies(world: World, ids: tuple[BodyId, ...]) -> Mask:
    enclosing = set(SpatialRelations(world).enclosing_bodies)
    return np.array([id in enclosing for id in ids], dtype=bool)


def _unit_poses(poses: Array) -> Array:
    return np.concatenate([poses[:, :3], normalize(poses[:, 3:])], axis=1)


@dataclass(slots=True, eq=False)
class MotionSample:
    """All bodies at one time."""

    time_s: float
    step_s: float
    """Time since the sample before [s]; 0 for the first one."""
    table: BodyTable
    poses: PoseArray
    """n x 7, smoothed positions and unit quaternions."""
    velocities: Array
    """n x 3: mean over `window_s` [m/s]."""
    last_velocities: Array
    """n x 3: mean over the two steps before this sample, and so before an impact [m/s]."""
    steps: Array
    """n: how far each body has moved since the sample before [m]; 0 if it was put elsewhere."""
    turning: Array
    """n: angular speed, as mean over `window_s` [rad/s]."""
    window: tuple[float, PoseArray]
    """The time and the poses at the begin of that window."""
    is_moving: Mask
    jumped: Mask
    """Whether it was put elsewhere since the sample before."""
    is_new: Mask
    """Whether the body did not exist in the sample before."""
    rows_before: Indices | None = None
    """The rows in the sample before, if bodies were added or removed since."""
    history: deque[tuple[float, PoseArray]] = field(default_factory=deque)
    """Earlier samples of the last `HISTORY_S`, the oldest first, with the rows of this one."""

    @property
    def is_first(self) -> bool:
        """Whether there is no sample before."""
        return self.step_s == 0.0

    def rest_s(self, row: int, still_m: float) -> float:
        """The first time from which a body has stayed within a distance of where it is now [s]."""
        found = self.time_s
        for time_s, poses in reversed(self.history):
            if np.linalg.norm(poses[row, :3] - self.poses[row, :3]) > still_m:
                break
            found = time_s
        return found


HISTORY_S = 0.4
"""Time over which samples are kept [s]: a slow motion is detected that late."""
_MIN_SAMPLE_STEP_S = 1 / 130
"""Samples that follow one another faster are not kept in the history, which bounds its length [s]."""


class MotionTracker:
    """Computes a `MotionSample` from each frame's poses."""

    def __init__(self, thresholds: DetectionThresholds) -> None:
        self._thresholds = thresholds
        self._history: deque[tuple[float, PoseArray]] = deque()
        self._last: MotionSample | None = None
        self._last_speeds = np.zeros((0, 3))
        self._earlier_speeds = np.zeros((0, 3))

    def sample(self, time_s: float, table: BodyTable, poses: PoseArray) -> MotionSample:
        """The sample of a time that is later than that of the sample before."""
        limits, last, n = self._thresholds, self._last, len(poses)
        rows_before, is_new = None, np.zeros(n, dtype=bool)
        is_moving, velocities_before = np.zeros(n, dtype=bool), np.zeros((n, 3))
        step_s, before = 0.0, poses
        jumped = np.zeros(n, dtype=bool)
        speeds = np.zeros((n, 3))
        if last is not None:
            step_s = time_s - last.time_s
            is_moving, velocities_before, before = last.is_moving, self._last_speeds, last.poses
            if last.table.ids != table.ids:
                rows_before = table.rows_before(last.table)
                is_new = rows_before < 0
                self._history = deque((at, _carried(each, rows_before, poses)) for at, each in self._history)
                before = _carried(before, rows_before, poses)
                is_moving = _carried(is_moving[:, None], rows_before, np.zeros((n, 1), dtype=bool))[:, 0]
                velocities_before = _carried(velocities_before, rows_before, np.zeros((n, 3)))
                self._earlier_speeds = _carried(self._earlier_speeds, rows_before, np.zeros((n, 3)))
            jumped = self._jumps(poses[:, :3] - before[:, :3], velocities_before, step_s)
            if jumped.any():
                for _, each in self._history:
                    each[jumped] = poses[jumped]
                before = np.where(jumped[:, None], poses, before)
            speeds = (poses[:, :3] - before[:, :3]) / step_s
        start_s, start = self._window(time_s, poses)
        span_s = max(time_s - start_s, 1e-9)
        velocities = (poses[:, :3] - start[:, :3]) / span_s
        dots = np.abs(np.einsum("ij,ij->i", poses[:, 3:], start[:, 3:]))
        speed = lengths(velocities)
        enter, leave = limits.move_m_s
        sample = MotionSample(
            time_s=time_s,
            step_s=step_s,
            table=table,
            poses=poses,
            velocities=velocities,
            last_velocities=velocities_before if last is None else (velocities_before + self._earlier_speeds) / 2,
            steps=lengths(speeds) * step_s,
            turning=2.0 * np.arccos(np.minimum(dots, 1.0)) / span_s,
            window=(start_s, start),
            is_moving=(speed > enter) | (is_moving & (speed >= leave)),
            jumped=jumped,
            is_new=is_new,
            rows_before=rows_before,
            history=self._history,
        )
        self._last, self._last_speeds, self._earlier_speeds = sample, speeds, velocities_before
        return sample

    def _jumps(self, steps: Array, velocities: Array, step_s: float) -> Mask:
        """Which bodies were put elsewhere: they moved by more than what a motion can gain within a frame."""
        limits = self._thresholds
        distance = lengths(steps)
        jumped = np.zeros(len(steps), dtype=bool)
        far = np.flatnonzero(distance > limits.teleport_m)
        gained = distance[far] / step_s - lengths(velocities[far])
        jumped[far[gained > limits.teleport_m_s + _MAX_ACCELERATION * step_s]] = True
        return jumped

    def _window(self, time_s: float, poses: PoseArray) -> tuple[float, PoseArray]:
        """The time and the poses at the begin of the window over which velocities are means."""
        while len(self._history) > 1 and self._history[1][0] <= time_s - HISTORY_S:
            self._history.popleft()
        found = time_s, poses
        for found in reversed(self._history):
            if found[0] <= time_s - self._thresholds.window_s + 1e-9:
                break
        return found

    def keep(self) -> None:
        """Adds the last sample to the history; called when everything that reads it is done."""
        last = self._last
        if last is not None and (not self._history or last.time_s - self._history[-1][0] >= _MIN_SAMPLE_STEP_S):
            self._history.append((last.time_s, last.poses))


def lengths(vectors: Array) -> Array:
    """The lengths of many vectors, n x k; several times as fast as `numpy.linalg.norm` for small k."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


_MAX_ACCELERATION = 20.0
"""Acceleration that a motion may have between two frames [m/s²]: twice gravity."""


def _carried(values: NDArray[Scalar], rows: Indices, default: NDArray[Scalar]) -> NDArray[Scalar]:
    """Values by the rows of another table, with a default for new rows."""
    result = default.copy()
    result[rows >= 0] = values[rows[rows >= 0]]
    return result
