"""SceneKeeper: everything that a MuJoCo model is made from, kept true while a world is edited.

Edits are cheap: they change what is planned and mark the model as stale. `live` builds it when physics is
needed next, once for all edits since, and carries the running state over.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.contract import Note, SpawnReport
from mindstage.engines.forest import Forest
from mindstage.engines.inventory import Inventory
from mindstage.engines.mujoco.blueprint import Blueprint
from mindstage.engines.mujoco.build import build
from mindstage.engines.mujoco.carry import carry
from mindstage.engines.mujoco.live import Live
from mindstage.engines.planning import Planner
from mindstage.world import NO_FORMS, BodyId, Forms, Mobility, Physics, World
from mindstage.world.boxes import Boxes
from mindstage.world.geometry import Array, compose, invert, pose_array, unit

__all__ = ["SceneKeeper"]


class SceneKeeper:
    """The plan, where everything stands, and the model made from both."""

    def __init__(self, timestep_s: float, *, time_s: float = 0.0) -> None:
        self.planner = Planner()
        self.stale = True
        self._timestep_s = timestep_s
        self._time_s = time_s
        self._live: Live | None = None
        self._placed: dict[BodyId, Array] = {}
        """Poses that the model does not have yet."""
        self._at_rest: set[BodyId] = set()
        self._driven = False
        self._disturbed: list[Array] = []

    def copy(self) -> SceneKeeper:
        """A keeper of its own in the same state, stale if this one is; compiled models never change, so are shared."""
        twin = SceneKeeper(self._timestep_s, time_s=self._time_s)
        twin.planner, twin.stale = self.planner.copy(), self.stale
        if self._live is not None:
            twin._live = copy.copy(self._live)
            twin._live.data = copy.copy(self._live.data)
        twin._placed, twin._at_rest = dict(self._placed), set(self._at_rest)
        twin._disturbed, twin._driven = list(self._disturbed), self._driven
        return twin

    # -- what there is -----------------------------------------------------------------------------------------

    @property
    def inventory(self) -> Inventory:
        """What stands here, as it was described."""
        return self.planner.inventory

    @property
    def forest(self) -> Forest:
        """Who hangs on whom now."""
        return self.planner.forest

    @property
    def late_notes(self) -> list[Note]:
        """What had to be decided because of edits, and what the physics warned of."""
        return self.planner.late_notes

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self._time_s if self._live is None else float(self._live.data.time)

    @property
    def last_live(self) -> Live | None:
        """The model that was built last, stale or not; None before the first."""
        return self._live

    def live(self) -> Live:
        """The model, made anew if anything changed since."""
        if self.stale or self._live is None:
            self._rebuild()
        assert self._live is not None
        return self._live

    def where(self) -> Array:
        """All poses now, n x 7, in the order of the inventory's ids."""
        if not self.stale and self._live is not None:
            return self._live.poses()
        ids = self.inventory.ids
        poses = np.zeros((len(ids), 7))
        known: Mapping[BodyId, int] = {}
        if self._live is not None:
            known, before = self._live.rows, self._live.poses()
            old = np.fromiter((known.get(id, -1) for id in ids), dtype=np.intp, count=len(ids))
            poses[old >= 0] = before[old[old >= 0]]
        for row, id in enumerate(ids):
            if id in self._placed:
                poses[row] = self._placed[id]
        return poses

    def where_by_id(self) -> dict[BodyId, Array]:
        """All poses now, by body."""
        return dict(zip(self.inventory.ids, self.where(), strict=True))

    def bounds(self, ids: Iterable[BodyId]) -> Array:
        """The box around some bodies, 2 x 3: lower and upper corner [m]."""
        where = self.where_by_id()
        wanted = list(ids)
        poses = np.array([where[id] for id in wanted]).reshape(-1, 7)
        low, high = Boxes.of(poses, self.planner.matter.sizes(wanted)).bounds()
        return np.array([low.min(axis=0), high.max(axis=0)])

    def blueprint(self, where: Array | None = None) -> Blueprint:
        """All that a model of it is made from.

        Args:
            where: all poses, if they are at hand.
        """
        where = self.where() if where is None else where
        return Blueprint.of(self.planner, where, self._timestep_s, driven=self._driven)

    # -- edits -------------------------------------------------------------------------------------------------

    def add(self, world: World, *, forms: Forms = NO_FORMS) -> SpawnReport:
        """See `Engine.spawn`."""
        before = self.where()
        report = self.planner.add(world, before, forms=forms)
        came = self.inventory.ids[len(before) :]
        poses = pose_array(self.inventory.bodies[id].pose for id in came)
        poses[:, 3:] = unit(poses[:, 3:])
        self._placed.update(zip(came, poses, strict=True))
        self.stale = True
        return report

    def remove(self, ids: tuple[BodyId, ...]) -> None:
        """See `Engine.delete`."""
        gone = {self.inventory.body(id).id for id in ids}
        if not gone:
            return
        self._disturbed.append(self.bounds(gone))
        self.planner.remove(gone)
        for id in gone:
            self._placed.pop(id, None)
        self._at_rest -= gone
        self.stale = True
        if self._live is not None:  # what comes under the same name later is something else
            self._live = self._live.without(gone, joints=self.inventory.constraints)

    def attach(self, parent: BodyId, child: BodyId) -> None:
        """See `Engine.attach`."""
        self.planner.attach(parent, child, self.where())
        self.stale = True

    def detach(self, child: BodyId) -> None:
        """See `Engine.detach`."""
        self.stale |= self.planner.detach(child)

    def set_physics(self, id: BodyId, physics: Physics) -> None:
        """See `Engine.set_physics`."""
        self.planner.set_physics(id, physics)
        self._disturbed.append(self.bounds([id]))
        self.stale = True

    def move(self, id: BodyId, target: Array) -> None:
        """Puts a body, and all that goes with it, somewhere else; for bodies that no joint holds."""
        where = self.where_by_id()
        moving = self.planner.reach(id)
        self._disturbed.append(self.bounds(moving))
        self.planner.rehang(id, target, self.where())
        new_from_old = compose(target, invert(where[id]))
        moved = compose(new_from_old, np.array([where[body] for body in moving]))
        moved[:, 3:] = unit(moved[:, 3:])
        self._placed.update(zip(moving, moved, strict=True))
        self._placed[id] = target
        self._at_rest.update(moving)
        self._disturbed.append(self.bounds(moving))
        self.stale = True

    def drive(self, id: BodyId) -> None:
        """Makes kinematic bodies such that they can be moved in place, if this is one and the first that is."""
        assembly = self.forest.assemblies.get(id)
        if not self._driven and assembly is not None and assembly.mobility is Mobility.KINEMATIC:
            self._driven = self.stale = True

    def _rebuild(self) -> None:
        where = self.where()
        self.planner.settle(where)
        ids = self.inventory.ids
        new = build(self.blueprint(where))
        new.data.time = self.time_s
        disturbed: NDArray[np.float64] = np.array(self._disturbed).reshape(-1, 2, 3)
        carry(self._live, new, dict(zip(ids, where, strict=True)), self.planner.ends, self._at_rest, disturbed)
        self._live, self.stale = new, False
        self._placed, self._at_rest, self._disturbed = {}, set(), []
