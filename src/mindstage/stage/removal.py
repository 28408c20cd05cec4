"""Removal: deleting bodies so that they can come back, with their constraints and all that hung on them.

A constraint counts from where its bodies were when they were spawned. A door that was open when it was deleted is
therefore spawned shut, and then opened as far as it was; and what it belongs to may stand elsewhere by then.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress

import msgspec

from mindstage.engines.contract import Engine
from mindstage.errors import BodyExists, PoseUnreachable, ReturnRefused, WorldError
from mindstage.stage.edits import Edit, poses_of
from mindstage.world import Attachment, BodyId, Constraint, Forms, Pose, World
from mindstage.world.geometry import Array, compose, invert, pose_from, unit_pose

__all__ = ["ComeBack", "Remove", "Spawned"]

_Link = Constraint | Attachment


class Spawned(msgspec.Struct, frozen=True):
    """What was spawned, as it was given: from there constraints count."""

    poses: Mapping[BodyId, Pose]
    constraints: Mapping[BodyId, Constraint]

    @classmethod
    def of(cls, worlds: Iterable[World]) -> Spawned:
        """That of several worlds."""
        poses: dict[BodyId, Pose] = {}
        constraints: dict[BodyId, Constraint] = {}
        for world in worlds:
            poses |= {body.id: body.pose for body in world.bodies}
            constraints |= {joint.id: joint for joint in world.constraints}
        return cls(poses, constraints)


class Remove(msgspec.Struct, frozen=True):
    """Deletes bodies with their constraints and attachments."""

    ids: tuple[BodyId, ...]
    spawned: Spawned
    forms: Forms
    what: str

    def apply(self, engine: Engine) -> Edit:
        """See `Edit`."""
        before, gone = engine.log(), set(self.ids)
        engine.delete(self.ids)
        return ComeBack(before, tuple(sorted(gone)), self.spawned, self.forms, self.what)


class ComeBack(msgspec.Struct, frozen=True):
    """Spawns deleted bodies again, as they were."""

    before: World
    """All that was there."""
    ids: tuple[BodyId, ...]
    """What of it was deleted."""
    spawned: Spawned
    forms: Forms
    what: str

    def apply(self, engine: Engine) -> Edit:
        """See `Edit`."""
        there = poses_of(engine)
        gone = set(self.ids)
        if taken := gone & there.keys():
            raise BodyExists(min(taken))
        links = list(self._links(there))
        shut, open_again = self._places(links, there)
        stirred = [id for id in dict.fromkeys(link.child for link in links) if id not in gone]
        try:
            for id in stirred:
                engine.set_pose(id, pose_from(shut[id]))
            self._spawn(engine, self._fragment(links, shut))
        except WorldError:
            for id in stirred:
                engine.set_pose(id, there[id])
            raise
        for link in links:
            if isinstance(link, Constraint) and not _same(shut[link.child], open_again[link.child]):
                with suppress(PoseUnreachable):  # then it is back at least, if not as far open
                    engine.set_pose(link.child, pose_from(open_again[link.child]))
        return Remove(self.ids, self.spawned, self.forms, self.what)

    def _spawn(self, engine: Engine, world: World) -> None:
        """Spawns all of it or nothing.

        Raises:
            ReturnRefused: some of it cannot be spawned.
        """
        report = engine.spawn(world, forms=self.forms)
        for failure in (*report.failed_bodies, *report.failed_constraints, *report.failed_attachments):
            there = set(engine.poses()[0])
            engine.delete([id for id in self.ids if id in there])
            raise ReturnRefused(failure.id, reason=failure.reason)

    def _links(self, there: Mapping[BodyId, Pose]) -> Iterator[_Link]:
        """What joined the deleted bodies to one another and to those that are still there."""
        gone = set(self.ids)
        links: tuple[_Link, ...] = (*self.before.constraints, *self.before.attachments)
        for link in links:
            ends = {link.parent, link.child}
            if ends & gone and ends <= gone | there.keys():
                yield link

    def _places(
        self, links: Iterable[_Link], there: Mapping[BodyId, Pose]
    ) -> tuple[Mapping[BodyId, Array], Mapping[BodyId, Array]]:
        """Where all is to be spawned, and where it was in the end, seen from what is still there."""
        was = {body.id: unit_pose(body.pose) for body in self.before.bodies}
        holders = {link.child: link for link in links}
        shut: dict[BodyId, Array] = {}
        open_again: dict[BodyId, Array] = {}

        def place(id: BodyId, above: frozenset[BodyId]) -> None:
            link = holders.get(id)
            if id in shut:
                return
            if link is None or link.parent in above:  # nothing holds it; or a circle of constraints, cut here
                shut[id] = open_again[id] = was[id] if id in self.ids else unit_pose(there[id])
                return
            place(link.parent, above | {id})
            open_again[id] = _carried(was[id], was[link.parent], open_again[link.parent])
            given = was
            if isinstance(link, Constraint):
                given = {
                    end: unit_pose(self.spawned.poses.get(end) or pose_from(was[end])) for end in (id, link.parent)
                }
            shut[id] = _carried(given[id], given[link.parent], shut[link.parent])

        for id in (*self.ids, *(end for link in links for end in (link.parent, link.child))):
            place(id, frozenset())
        return shut, open_again

    def _fragment(self, links: Iterable[_Link], shut: Mapping[BodyId, Array]) -> World:
        def placed(id: BodyId, pose: Pose) -> Pose:
            return pose if _same(unit_pose(pose), shut[id]) else pose_from(shut[id])

        def moved(joint: Constraint) -> Constraint:
            given = self.spawned.constraints.get(joint.id, joint)
            parent = unit_pose(self.spawned.poses.get(joint.parent) or pose_from(shut[joint.parent]))
            frame = _carried(unit_pose(given.pose), parent, shut[joint.parent])
            return (
                joint if _same(frame, unit_pose(joint.pose)) else msgspec.structs.replace(joint, pose=pose_from(frame))
            )

        gone = set(self.ids)
        return World(
            iri=self.before.iri,
            name=self.before.name,
            bodies=tuple(
                msgspec.structs.replace(body, pose=placed(body.id, body.pose))
                for body in self.before.bodies
                if body.id in gone
            ),
            constraints=tuple(moved(link) for link in links if isinstance(link, Constraint)),
            attachments=tuple(link for link in links if isinstance(link, Attachment)),
        )


def _carried(what: Array, by_then: Array, by_now: Array) -> Array:
    """Where something is that went along with something else."""
    if _same(by_then, by_now):
        return what  # to the last digit
    return compose(by_now, compose(invert(by_then), what))


def _same(one: Array, other: Array) -> bool:
    return bool((one == other).all())
