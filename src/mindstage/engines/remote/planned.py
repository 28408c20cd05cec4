"""PlannedEngine: a far engine that leaves decisions to us.

A game engine moves what it is told to move. Which bodies hang together, what keeps apart, what an unknown mass is and
where a joint lets something go is worked out here, by the same code as for engines in this process, and told with each
edit. Pushes wait here for the step that they are for, and its answer says where everything is then: a loop of pushes,
steps and poses is one question at a time.
"""
# ruff: noqa: D102 - the contract documents an engine's methods, once for all

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import msgspec
import numpy as np

from mindstage.bridge.description import (
    PlanChange,
    forms_to_json,
    plan_to_json,
    point_message,
    pose_message,
    to_json,
    vector_message,
)
from mindstage.engines.contract import Ability, Poses, SpawnReport
from mindstage.engines.inventory import Inventory, placeable
from mindstage.engines.planning import Planner
from mindstage.engines.remote.changes import Told
from mindstage.engines.remote.link import Link
from mindstage.engines.remote.mindstage import MindstageEngine, ShowForm
from mindstage.engines.remote.parcel import packed, packed_forms
from mindstage.engines.travelling import joint_places, require_reachable
from mindstage.errors import PoseUnreachable
from mindstage.msgs import Message, Service
from mindstage.msgs import mindstage_msgs as wire
from mindstage.world import (
    NO_FORMS,
    Body,
    BodyId,
    Colour,
    Constraint,
    Forms,
    Light,
    Material,
    Physics,
    Pose,
    Vector,
    World,
)
from mindstage.world.geometry import Array, compose, invert, pose_from, unit, unit_pose

__all__ = ["PlannedEngine"]

_ROW = np.dtype(("<f8", 7))
_SLACK = 1e-5
"""Single precision's poses are off by so much in a place of ten metres or so [m, rad]."""

Edit = Callable[[Planner, Array], object]


class PlannedEngine(MindstageEngine):
    """The contract, where the thinking is done here and the moving there.

    Others may edit that world as well, by hand in an editor. What came or went by that is taken over when it is seen,
    and decided about with the next edit.
    """

    def __init__(self, link: Link, *, holds_time: bool = True, show: ShowForm = lambda form: "") -> None:
        super().__init__(link, holds_time=holds_time, show=show)
        self._planner = Planner()
        self._told = Told()
        self._forces: list[wire.Force] = []
        self._revision = 0
        self._there: tuple[BodyId, ...] = ()
        """The bodies of that revision, in the order of its rows."""
        self._rows: Array | None = None
        """Where everything is, in the order of the planner's bodies, if a step has just told that."""
        self._rows_are_wanted = False
        """Whether somebody looks at the poses after each step."""
        self._where()

    @property
    def abilities(self) -> frozenset[Ability]:
        return super().abilities | {Ability.JOINTS}

    # -- the world -----------------------------------------------------------------------------------------------------

    def spawn(self, world: World, *, forms: Forms = NO_FORMS) -> SpawnReport:
        self.ping()  # whether it is still the world that we know
        where = np.zeros((0, 7)) if self._world_is_gone else self._where()
        trial = self._planner.copy()
        report = trial.add(world, where, forms=forms)
        text, left_out = packed(_fitting(world, self._planner.inventory, trial.inventory))
        told = Told.of(trial)
        new = trial.inventory.bodies.keys() - self._planner.inventory.bodies.keys()
        usable, _ = packed_forms({id: form for id, form in forms.items() if id in new})  # what is not is noted already
        request = wire.SpawnWorld.Request(
            world=text, forms=forms_to_json(usable, mesh=self._show), plan=plan_to_json(self._told.change_to(told))
        )
        there = self._spawn(request, parts=len(world.bodies) + len(world.constraints))
        failed = [failure.id for each in (left_out, there) for failure in each.failed_bodies]
        trial.remove(id for id in trial.inventory.ids if id in set(failed))
        self._take(trial, told if not failed else Told.of(trial))
        return _together(report, left_out, there)

    def clear(self) -> None:
        super().clear()
        self._forget()

    def delete(self, ids: Iterable[BodyId]) -> None:
        wanted = tuple(ids)
        self._edit(wire.Delete, wire.Delete.Request(ids=wanted), lambda planner, where: planner.remove(wanted))

    def attach(self, parent: BodyId, child: BodyId) -> None:
        request = wire.Attach.Request(parent=parent, child=child)
        self._edit(wire.Attach, request, lambda planner, where: planner.attach(parent, child, where))

    def detach(self, child: BodyId) -> None:
        self._edit(wire.Detach, wire.Detach.Request(child=child), lambda planner, where: planner.detach(child))

    # -- bodies --------------------------------------------------------------------------------------------------------

    def set_pose(self, id: BodyId, pose: Pose) -> None:
        self._known(id)
        if reason := placeable(pose):
            raise PoseUnreachable(id, reason=reason)
        where, target, planner = self._by_id(), unit_pose(pose), self._planner
        if id in planner.forest.branches:
            require_reachable(planner, id, target, where, slack=_SLACK)
        moving = planner.reach(id)
        moved = compose(compose(target, invert(where[id])), np.array([where[each] for each in moving]))
        moved[:, 3:] = unit(moved[:, 3:])
        poses = dict(zip(moving, map(pose_from, moved), strict=True)) | {id: pose}

        def put(planner: Planner, where: Array) -> None:
            planner.rehang(id, target, where)
            planner.inventory.replace(id, pose=pose)

        request = wire.SetPose.Request(id=id, pose=pose_message(pose))
        if id in planner.forest.holders:
            self._edit(wire.SetPose, request, put, poses=poses)
        else:  # nothing else changes, and what is dragged is put somewhere many times a second
            self._ask_for_edit(wire.SetPose, request, PlanChange(poses=poses))
            planner.inventory.replace(id, pose=pose)

    def set_physics(self, id: BodyId, physics: Physics) -> None:
        request = wire.SetPhysics.Request(id=id, physics=to_json(physics))
        self._edit(wire.SetPhysics, request, lambda planner, where: planner.set_physics(id, physics))

    def set_materials(self, id: BodyId, materials: tuple[Material, ...]) -> None:
        self._known(id)
        super().set_materials(id, materials)
        self._planner.inventory.replace(id, materials=materials)

    def highlight(self, ids: Iterable[BodyId], colour: Colour | None) -> None:
        super().highlight(tuple(self._known(id) for id in ids), colour)

    def push(self, id: BodyId, force: Vector, at: Vector | None = None) -> None:
        self._known(id)
        push = wire.Force(id=id, force=vector_message(force))
        if at is not None:
            push = msgspec.structs.replace(push, at_point=True, point=point_message(at))
        self._forces.append(push)

    # -- time ----------------------------------------------------------------------------------------------------------

    def step(self, duration_s: float) -> None:
        self._rows_are_wanted &= self._rows is None
        wanted, self._rows = self._rows_are_wanted, None
        forces = tuple(force for force in self._forces if force.id in self._planner.inventory.bodies)
        self._forces.clear()
        reply = self._step(wire.Step.Request(duration_s=duration_s, forces=forces, packed=wanted))
        if wanted and reply.revision == self._revision:
            self._rows = self._sorted(self._unpacked("step", reply.rows))

    def poses(self) -> tuple[tuple[BodyId, ...], Poses]:
        self._open().be_ready()
        rows = self._where()
        self._rows, self._rows_are_wanted = None, True  # who asks again may ask because others move things
        return self._planner.inventory.ids, rows

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        self._open()
        return joint_places(self._planner, self._by_id())

    # -- edits ---------------------------------------------------------------------------------------------------------

    def _edit(
        self, service: type[Service], request: Message, edit: Edit, *, poses: Mapping[BodyId, Pose] | None = None
    ) -> None:
        """Makes an edit here, tells it with all that it changes, and keeps it if it was done there."""
        self._open()
        where = self._where()
        trial = self._planner.copy()
        edit(trial, where)
        now = dict(zip(self._planner.inventory.ids, where, strict=True))
        now |= {id: unit_pose(pose) for id, pose in (poses or {}).items()}
        trial.settle(np.array([now[id] for id in trial.inventory.ids]).reshape(-1, 7))
        told = Told.of(trial)
        self._ask_for_edit(service, request, self._told.change_to(told, poses=poses))
        self._take(trial, told)

    def _ask_for_edit(self, service: type[Service], request: Message, change: PlanChange) -> None:
        self._ask(service, msgspec.structs.replace(request, plan=plan_to_json(change)))
        self._rows = None

    def _take(self, planner: Planner, told: Told) -> None:
        self._planner, self._told, self._rows = planner, told, None
        self._ids = planner.inventory.ids

    def _known(self, id: BodyId) -> BodyId:
        """The id.

        Raises:
            BodyUnknown: there is no such body.
        """
        self._open()
        return self._planner.inventory.body(id).id

    # -- what is there -------------------------------------------------------------------------------------------------

    def _where(self) -> Array:
        """All poses now, n x 7, in the order of the planner's bodies."""
        if self._rows is not None:
            return self._rows
        reply: Any = self._ask(wire.GetPoses, wire.GetPoses.Request(packed=True, known=self._revision))
        if reply.revision != self._revision:
            self._revision, self._there = reply.revision, tuple(map(BodyId, reply.ids))
            if set(self._there) != set(self._planner.inventory.ids):
                self._adopt()
        return self._sorted(self._unpacked("get_poses", reply.rows))

    def _by_id(self) -> dict[BodyId, Array]:
        return dict(zip(self._planner.inventory.ids, self._where(), strict=True))

    def _unpacked(self, name: str, rows: bytes) -> Array:
        with self._link.making_sense(name):
            read = np.frombuffer(rows, dtype=_ROW).astype(np.float64)
            if len(read) != len(self._there) or not np.isfinite(read).all():
                raise ValueError(f"{len(self._there)} ids and {len(read)} rows, all of which should be numbers")
            read[:, 3:] = unit(read[:, 3:])
            return read

    def _sorted(self, rows: Array) -> Array:
        """Rows in the order of the planner's bodies, which is that of the far engine unless others edit there."""
        ids = self._planner.inventory.ids
        if ids == self._there:
            return rows
        places = {id: row for row, id in enumerate(self._there)}
        return rows[[places[id] for id in ids]]

    def _adopt(self) -> None:
        """Takes over what stands there, which others have changed; with the next edit, all of it is told anew."""
        forms, planner = self._planner.forms, Planner()
        planner.add(self.log(), np.zeros((0, 7)), forms=forms)
        self._take(planner, Told())

    def _forget(self) -> None:
        self._take(Planner(), Told())
        self._forces.clear()
        self._revision, self._there = 0, ()

    def _meet_again(self) -> None:
        super()._meet_again()
        if self._world_is_gone:
            self._forget()


P = TypeVar("P", Body, Constraint, Light)


def _fitting(world: World, before: Inventory, after: Inventory) -> World:
    """What of a world came in."""
    hung = {(after.parents[child], child) for child in after.parents.keys() - before.parents.keys()}
    return msgspec.structs.replace(
        world,
        bodies=_new(world.bodies, before.bodies, after.bodies),
        constraints=_new(world.constraints, before.constraints, after.constraints),
        lights=_new(world.lights, before.lights, after.lights),
        attachments=tuple(dict.fromkeys(each for each in world.attachments if (each.parent, each.child) in hung)),
    )


def _new(parts: Iterable[P], before: Mapping[BodyId, P], after: Mapping[BodyId, P]) -> tuple[P, ...]:
    """Those that are there now and were not; of several with one id, the one that came in."""
    came = {part.id: part for part in parts if part.id not in before and after.get(part.id) is part}
    return tuple(came.values())


def _together(*reports: SpawnReport) -> SpawnReport:
    """What was decided here, what could not travel, and what became of it there."""
    here, left_out, there = reports
    return msgspec.structs.replace(
        there,
        failed_bodies=here.failed_bodies + left_out.failed_bodies + there.failed_bodies,
        failed_constraints=here.failed_constraints + left_out.failed_constraints + there.failed_constraints,
        failed_attachments=here.failed_attachments + there.failed_attachments,
        notes=here.notes + there.notes,
    )
