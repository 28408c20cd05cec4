"""The structure of a recorded world: everything but the poses, and its changes as JSON.

A `WorldStructure` is written once and then as changes: bodies that were added or edited, and the parts of the world
other than bodies if one of them was. Each has a digest of all that it was made from, so that a reader notices if it
puts together what does not belong together. `EpisodeState` is the state that follows from messages.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from hashlib import blake2b
from math import isnan

import msgspec
import numpy as np
from msgspec.structs import replace

from mindstage.engines.base import Contact, PoseArray
from mindstage.episodes.messages import AXIS_NAMES, EpisodeDecoder, EpisodeTopic, WorldRecord
from mindstage.episodes.recording import DriveState, EpisodeFrame
from mindstage.scene import AxisMotion, Body, BodyId, Iri, Joint, World
from mindstage.scene.joint_kinematics import axis_ranges

__all__ = ["EpisodeState", "WorldStructure"]


class _WorldChange(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, forbid_unknown_fields=True):
    """What is different from the structure before."""

    world: World | None = None
    """The world without bodies; None if none of its other parts has changed."""
    ids: tuple[BodyId, ...] | None = None
    """All bodies, in the order of the poses; None if they are the same."""
    bodies: tuple[Body, ...] = ()
    """The bodies that are new or have changed."""
    unmoved_poses: tuple[tuple[float, float, float, float, float, float, float], ...] = ()
    """Their `EpisodeFrame.unmoved_poses`."""
    spawned_before: int = 0
    """How many of the spawned worlds are those of before."""
    spawned: tuple[World, ...] = ()
    """The spawned worlds after those."""
    immovable: tuple[BodyId, ...] | None = None


_ENCODER = msgspec.json.Encoder()
_DECODER = msgspec.json.Decoder(_WorldChange)


class WorldStructure:
    """A world apart from its poses, as it was from one time on."""

    def __init__(
        self,
        number: int,
        world: World,
        unmoved_poses: PoseArray,
        *,
        spawned: tuple[World, ...],
        immovable: frozenset[BodyId],
        digest: str = "",
    ) -> None:
        """Takes the parts.

        Args:
            number: counts the structures of an episode.
            world: its bodies are in the order of the poses; their poses are those of unmoved bodies.
            unmoved_poses: see `EpisodeFrame`.
            spawned: the worlds that were spawned until then.
            immovable: see `Spawn`.
            digest: see `EpisodeWorld.msg`; by default that of the first structure.
        """
        self.number = number
        self._digest = digest
        self.world = world
        self.ids = tuple(body.id for body in world.bodies)
        self.unmoved_poses = unmoved_poses
        self.spawned = spawned
        self.immovable = immovable

    @classmethod
    def of_snapshot(
        cls,
        snapshot: World,
        ids: Sequence[BodyId],
        poses: PoseArray,
        *,
        spawned: tuple[World, ...],
        immovable: frozenset[BodyId],
    ) -> WorldStructure:
        """The structure of a snapshot, with the poses that the engine has at the same time, in the order of `ids`."""
        bodies = {body.id: body for body in snapshot.bodies}
        world = replace(snapshot, bodies=tuple(bodies[id] for id in ids))
        return cls(0, world, poses, spawned=spawned, immovable=immovable)

    @cached_property
    def rows(self) -> Mapping[BodyId, int]:
        """The row of each body in arrays of poses."""
        return {id: row for row, id in enumerate(self.ids)}

    @cached_property
    def joint_names(self) -> Mapping[BodyId, tuple[str, ...]]:
        """The names of the six numbers of each joint in `sensor_msgs/JointState`."""
        return {joint.id: _joint_names(joint) for joint in self.world.joints}

    @cached_property
    def joint_axes(self) -> Mapping[str, tuple[BodyId, int]]:
        """The joint and the axis of each of those names."""
        return {name: (id, axis) for id, names in self.joint_names.items() for axis, name in enumerate(names)}

    def frame(self, poses: PoseArray) -> EpisodeFrame:
        """A frame with this structure."""
        return EpisodeFrame(
            time_s=0.0, structure=self.world, ids=self.ids, poses=poses, unmoved_poses=self.unmoved_poses
        )

    @cached_property
    def digest(self) -> str:
        """See `EpisodeWorld.msg`."""
        return self._digest or _digest("", self._complete_json)

    # -- changes -------------------------------------------------------------------------------------------------------

    def complete_record(self) -> WorldRecord:
        """The whole structure."""
        return WorldRecord(self.number, True, self._complete_json, self.digest)

    @cached_property
    def _complete_json(self) -> bytes:
        change = _WorldChange(
            world=replace(self.world, bodies=()),
            ids=self.ids,
            bodies=self.world.bodies,
            unmoved_poses=tuple(map(tuple, self.unmoved_poses.tolist())),
            spawned=self.spawned,
            immovable=tuple(sorted(self.immovable)),
        )
        return _ENCODER.encode(change)

    def followed_by(self, later: WorldStructure) -> tuple[WorldStructure, WorldRecord] | None:
        """The structure that follows, as it is read from a file, and the record for it; None if nothing has changed.

        Bodies that have only moved stay as they are here.

        Args:
            later: a structure from a snapshot.
        """
        kept = [id for id in later.ids if id in self.rows]
        rows = [self.rows[id] for id in kept]
        now = [later.rows[id] for id in kept]
        before = replace(self.world, bodies=tuple(self.world.bodies[row] for row in rows))
        frame = EpisodeFrame(
            time_s=0.0,
            structure=before,
            ids=tuple(kept),
            poses=later.unmoved_poses[now],
            unmoved_poses=self.unmoved_poses[rows],
        )
        expected = {body.id: body for body in frame.world().bodies}
        changed = [row for row, body in enumerate(later.world.bodies) if not _is_same(expected.get(body.id), body)]
        shell = replace(later.world, bodies=())
        spawned_before = _common_prefix(self.spawned, later.spawned)
        change = _WorldChange(
            world=None if shell == replace(self.world, bodies=()) else shell,
            ids=None if later.ids == self.ids else later.ids,
            bodies=tuple(later.world.bodies[row] for row in changed),
            unmoved_poses=tuple(map(tuple, later.unmoved_poses[changed].tolist())),
            spawned_before=spawned_before,
            spawned=later.spawned[spawned_before:],
            immovable=None if later.immovable == self.immovable else tuple(sorted(later.immovable)),
        )
        if change == _WorldChange(spawned_before=len(self.spawned)):
            return None
        json = _ENCODER.encode(change)
        record = WorldRecord(self.number + 1, False, json, _digest(self.digest, json))
        return self._changed(change, record.digest), record

    def after(self, record: WorldRecord) -> WorldStructure:
        """The structure after a change.

        Raises:
            ValueError: it is not a change of this structure.
        """
        if record.number != self.number + 1:
            raise ValueError(f"world {record.number} cannot follow world {self.number}")
        if record.digest != _digest(self.digest, record.json):
            raise ValueError(f"world {record.number} follows another world {self.number}")
        return self._changed(_DECODER.decode(record.json), record.digest)

    @classmethod
    def from_record(cls, record: WorldRecord) -> WorldStructure:
        """The structure in a complete record.

        Raises:
            ValueError: it is not valid.
        """
        change = _DECODER.decode(record.json)
        empty = World(iri=change.world.iri) if change.world is not None else None
        if empty is None:
            raise ValueError("a complete world has no statements")
        none = cls(record.number - 1, empty, np.zeros((0, 7)), spawned=(), immovable=frozenset())
        return none._changed(change, record.digest)

    def _changed(self, change: _WorldChange, digest: str) -> WorldStructure:
        if len(change.unmoved_poses) != len(change.bodies) or change.spawned_before > len(self.spawned):
            raise ValueError("a change of the world is not consistent")
        bodies = {body.id: body for body in (*self.world.bodies, *change.bodies)}
        poses = dict(zip(self.ids, self.unmoved_poses, strict=True))
        poses |= {body.id: np.array(row) for body, row in zip(change.bodies, change.unmoved_poses, strict=True)}
        ids = self.ids if change.ids is None else change.ids
        if not bodies.keys() >= set(ids):
            raise ValueError("a change of the world has bodies that are not described")
        world = replace(change.world or self.world, bodies=tuple(bodies[id] for id in ids))
        return WorldStructure(
            self.number + 1,
            world,
            np.array([poses[id] for id in ids], dtype=float).reshape(-1, 7),
            spawned=(*self.spawned[: change.spawned_before], *change.spawned),
            immovable=self.immovable if change.immovable is None else frozenset(change.immovable),
            digest=digest,
        )


class EpisodeState:
    """The state of all bodies while the messages of an episode are read, in their order."""

    def __init__(self, structure: WorldStructure | None = None) -> None:
        """Begins with a structure, by default an empty one, and with no poses."""
        self.structure = structure or WorldStructure(
            -1, World(iri=Iri("")), np.zeros((0, 7)), spawned=(), immovable=frozenset()
        )
        self.poses: PoseArray = np.full((len(self.structure.ids), 7), np.nan)
        self.joints: Mapping[BodyId, tuple[float, ...]] = {}
        """Replaced, and never changed."""
        self.contacts: tuple[Contact, ...] = ()
        self.drives: Mapping[str, DriveState] = {}
        """Replaced, and never changed."""

    def copy(self) -> EpisodeState:
        """A copy, which continues independently."""
        copy = EpisodeState(self.structure)
        copy.poses, copy.joints, copy.contacts = self.poses.copy(), self.joints, self.contacts
        copy.drives = self.drives
        return copy

    def use(self, structure: WorldStructure) -> None:
        """Continues with another structure; bodies that it does not have are dropped."""
        before, self.structure = self.structure, structure
        if structure.ids != before.ids:
            poses = np.full((len(structure.ids), 7), np.nan)
            for row, id in enumerate(structure.ids):
                if id in before.rows:
                    poses[row] = self.poses[before.rows[id]]
            self.poses = poses
        self.joints = {id: values for id, values in self.joints.items() if id in structure.joint_names}
        if not self.drives.keys() <= structure.joint_names.keys():
            self.drives = {id: each for id, each in self.drives.items() if id in structure.joint_names}

    def apply(self, topic: EpisodeTopic | None, data: bytes) -> None:
        """Applies the message of a topic; one that has no part of the state has no effect.

        Raises:
            ValueError: it is not valid, or about a body that does not exist.
        """
        match topic:
            case EpisodeTopic.WORLD:
                record = EpisodeDecoder.world(data)
                if record.complete:
                    self.use(WorldStructure.from_record(record))
                else:
                    self.use(self.structure.after(record))
            case EpisodeTopic.TF | EpisodeTopic.TF_STATIC:
                ids, poses = EpisodeDecoder.transforms(data)
                rows = self.structure.rows
                try:
                    self.poses[[rows[id] for id in ids]] = poses
                except KeyError as error:
                    raise ValueError(f"a pose of {error.args[0]!r}, which does not exist") from error
            case EpisodeTopic.JOINTS:
                self._apply_joints(EpisodeDecoder.joints(data))
            case EpisodeTopic.DRIVES:
                self.drives = {**self.drives, **EpisodeDecoder.drives(data)}
            case EpisodeTopic.CONTACTS:
                self.contacts = EpisodeDecoder.contacts(data)
            case _:
                pass

    def _apply_joints(self, named: Mapping[str, float]) -> None:
        axes = self.structure.joint_axes
        changed: dict[BodyId, list[float]] = {}
        for name, value in named.items():
            if name not in axes:
                raise ValueError(f"a position of {name!r}, which does not exist")
            id, axis = axes[name]
            changed.setdefault(id, list(self.joints.get(id, (0.0,) * 6)))[axis] = value
        gone = {id for id, values in changed.items() if any(map(isnan, values))}
        joints = {**self.joints, **{id: tuple(values) for id, values in changed.items()}}
        self.joints = {id: values for id, values in joints.items() if id not in gone} if gone else joints

    def frame(self, time_ns: int, *, has_joints: bool, has_contacts: bool) -> EpisodeFrame:
        """The state as a frame.

        Args:
            time_ns: time since the begin of the episode [ns].
            has_joints: whether positions of joints were recorded.
            has_contacts: whether contacts were recorded.
        """
        return EpisodeFrame(
            time_s=time_ns / 1e9,
            structure=self.structure.world,
            ids=self.structure.ids,
            poses=self.poses.copy(),
            joint_positions=self.joints if has_joints else None,
            contacts=self.contacts if has_contacts else None,
            drives=self.drives,
            unmoved_poses=self.structure.unmoved_poses,
        )


def _digest(before: str, json: bytes) -> str:
    return blake2b(before.encode() + json, digest_size=16).hexdigest()


def _is_same(expected: Body | None, body: Body) -> bool:
    """Whether a body is what follows from the structure before, apart from the rounding of its pose."""
    if expected is None or expected == body:
        return expected is not None
    if replace(expected, pose=body.pose) != body:
        return False
    before, now = (np.array((*each.pose.position, *each.pose.quaternion)) for each in (expected, body))
    return bool(np.abs(before - now).max() <= 1e-12)


def _common_prefix(before: Sequence[World], now: Sequence[World]) -> int:
    count = 0
    while count < min(len(before), len(now)) and (before[count] is now[count] or before[count] == now[count]):
        count += 1
    return count


def _joint_names(joint: Joint) -> tuple[str, ...]:
    """The name of a joint for its only movable axis, and "joint/axis" for all others."""
    movable = [axis for axis, each in enumerate(axis_ranges(joint)) if each.motion is not AxisMotion.LOCKED]
    main = movable[0] if len(movable) == 1 else None
    return tuple(joint.id if axis == main else f"{joint.id}/{name}" for axis, name in enumerate(AXIS_NAMES))
