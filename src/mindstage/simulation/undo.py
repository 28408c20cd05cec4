"""Removal: deleting bodies so that they can come back, with their constraints and all that hung on them.

A constraint counts from where its bodies were when they were spawned. A door that was open when it was deleted is
therefore spawned shut, and then opened as far as it was; and what it belongs to may stand elsewhere by then.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress

import msgspec

from mindstage.engines.contract import Engine
from mindstage.errors import BodyExistsError, PoseUnreachableError, RestoreError, WorldError
from mindstage.stage.edits import EditCommand, current_poses
from mindstage.world import Attachment, BodyId, GeometryMap, Joint, Pose, World
from mindstage.world.geometry import Array, normalized_pose_array, pose_from_array, pose_inverse, pose_multiply

__all__ = ["DeleteBodies", "SpawnRecord", "UndeleteBodies"]

_Link = Joint | Attachment


class SpawnRecord(msgspec.Struct, frozen=True):
    """What was spawned, as it was given: from there constraints count."""

    poses: Mapping[BodyId, Pose]
    joints: Mapping[BodyId, Joint]

    @classmethod
    def from_worlds(cls, worlds: Iterable[World]) -> SpawnRecord:
        """That of several worlds."""
        poses: dict[BodyId, Pose] = {}
        constraints: dict[BodyId, Joint] = {}
        for world in worlds:
            poses |= {body.id: body.pose for body in world.bodies}
            constraints |= {joint.id: joint for joint in world.joints}
        return cls(poses, constraints)


class DeleteBodies(msgspec.Struct, frozen=True):
    """Deletes bodies with their constraints and attachments."""

    ids: tuple[BodyId, ...]
    spawn_record: SpawnRecord
    geometry: GeometryMap
    label: str

    def apply(self, engine: Engine) -> EditCommand:
        """See `EditCommand`."""
        before, gone = engine.snapshot(), set(self.ids)
        engine.delete(self.ids)
        return UndeleteBodies(before, tuple(sorted(gone)), self.spawn_record, self.geometry, self.label)


class UndeleteBodies(msgspec.Struct, frozen=True):
    """Spawns deleted bodies again, as they were."""

    previous_world: World
    """All that was there."""
    ids: tuple[BodyId, ...]
    """What of it was deleted."""
    spawn_record: SpawnRecord
    geometry: GeometryMap
    label: str

    def apply(self, engine: Engine) -> EditCommand:
        """See `EditCommand`."""
        there = current_poses(engine)
        gone = set(self.ids)
        if taken := gone & there.keys():
            raise BodyExistsError(min(taken))
        links = list(self._removed_links(there))
        shut, open_again = self._spawn_poses(links, there)
        stirred = [id for id in dict.fromkeys(link.child for link in links) if id not in gone]
        try:
            for id in stirred:
                engine.set_pose(id, pose_from_array(shut[id]))
            self._spawn(engine, self._world_fragment(links, shut))
        except WorldError:
            for id in stirred:
                engine.set_pose(id, there[id])
            raise
        for link in links:
            if isinstance(link, Joint) and not _same_pose(shut[link.child], open_again[link.child]):
                with suppress(PoseUnreachableError):  # then it is back at least, if not as far open
                    engine.set_pose(link.child, pose_from_array(open_again[link.child]))
        return DeleteBodies(self.ids, self.spawn_record, self.geometry, self.label)

    def _spawn(self, engine: Engine, world: World) -> None:
        """Spawns all of it or nothing.

        Raises:
            RestoreError: some of it cannot be spawned.
        """
        report = engine.spawn(world, geometry=self.geometry)
        for failure in (*report.failed_bodies, *report.failed_joints, *report.failed_attachments):
            there = set(engine.poses()[0])
            engine.delete([id for id in self.ids if id in there])
            raise RestoreError(failure.id, reason=failure.reason)

    def _removed_links(self, present: Mapping[BodyId, Pose]) -> Iterator[_Link]:
        """What joined the deleted bodies to one another and to those that are still there."""
        gone = set(self.ids)
        links: tuple[_Link, ...] = (*self.previous_world.joints, *self.previous_world.attachments)
        for link in links:
            ends = {link.parent, link.child}
            if ends & gone and ends <= gone | present.keys():
                yield link

    def _spawn_poses(
        self, links: Iterable[_Link], present: Mapping[BodyId, Pose]
    ) -> tuple[Mapping[BodyId, Array], Mapping[BodyId, Array]]:
        """Where all is to be spawned, and where it was in the end, seen from what is still there."""
        was = {body.id: normalized_pose_array(body.pose) for body in self.previous_world.bodies}
        holders = {link.child: link for link in links}
        shut: dict[BodyId, Array] = {}
        open_again: dict[BodyId, Array] = {}

        def place(id: BodyId, above: frozenset[BodyId]) -> None:
            link = holders.get(id)
            if id in shut:
                return
            if link is None or link.parent in above:  # nothing holds it; or a circle of constraints, cut here
                shut[id] = open_again[id] = was[id] if id in self.ids else normalized_pose_array(present[id])
                return
            place(link.parent, above | {id})
            open_again[id] = _moved_with(was[id], was[link.parent], open_again[link.parent])
            given = was
            if isinstance(link, Joint):
                given = {
                    end: normalized_pose_array(self.spawn_record.poses.get(end) or pose_from_array(was[end]))
                    for end in (id, link.parent)
                }
            shut[id] = _moved_with(given[id], given[link.parent], shut[link.parent])

        for id in (*self.ids, *(end for link in links for end in (link.parent, link.child))):
            place(id, frozenset())
        return shut, open_again

    def _world_fragment(self, links: Iterable[_Link], spawn_poses: Mapping[BodyId, Array]) -> World:
        def placed(id: BodyId, pose: Pose) -> Pose:
            return (
                pose if _same_pose(normalized_pose_array(pose), spawn_poses[id]) else pose_from_array(spawn_poses[id])
            )

        def moved(joint: Joint) -> Joint:
            given = self.spawn_record.joints.get(joint.id, joint)
            parent = normalized_pose_array(
                self.spawn_record.poses.get(joint.parent) or pose_from_array(spawn_poses[joint.parent])
            )
            frame = _moved_with(normalized_pose_array(given.pose), parent, spawn_poses[joint.parent])
            return (
                joint
                if _same_pose(frame, normalized_pose_array(joint.pose))
                else msgspec.structs.replace(joint, pose=pose_from_array(frame))
            )

        gone = set(self.ids)
        return World(
            iri=self.previous_world.iri,
            name=self.previous_world.name,
            bodies=tuple(
                msgspec.structs.replace(body, pose=placed(body.id, body.pose))
                for body in self.previous_world.bodies
                if body.id in gone
            ),
            joints=tuple(moved(link) for link in links if isinstance(link, Joint)),
            attachments=tuple(link for link in links if isinstance(link, Attachment)),
        )


def _moved_with(pose: Array, base_then: Array, base_now: Array) -> Array:
    """Where something is that went along with something else."""
    if _same_pose(base_then, base_now):
        return pose  # to the last digit
    return pose_multiply(base_now, pose_multiply(pose_inverse(base_then), pose))


def _same_pose(one: Array, other: Array) -> bool:
    return bool((one == other).all())
