"""SceneKeeper: everything that a MuJoCo model is made from, kept true while a world is edited.

Edits are cheap: they change what is described here and mark the model as stale. `live` builds it when physics is
needed next, once for all edits since, and carries the running state over.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.collision import Collisions, Scene, decide
from mindstage.engines.contract import Note, NoteKind, SpawnReport
from mindstage.engines.inventory import Added, Inventory
from mindstage.engines.mujoco.build import Blueprint, build
from mindstage.engines.mujoco.carry import carry
from mindstage.engines.mujoco.forest import Forest, grow
from mindstage.engines.mujoco.live import Live
from mindstage.world import Body, BodyId, Constraint, Physics, ShapeKind, World
from mindstage.world.boxes import Boxes
from mindstage.world.geometry import Array, compose, invert, pose_array, unit

__all__ = ["SceneKeeper"]

_SIZE_ASSUMED_M = 0.1
_DENSITY_ASSUMED = 200.0
"""[kg/m³]: furniture and full cupboards alike weigh about this much for the box that they fill."""
_ROUND = 0.8
"""A box of this part of its size lies about as often inside something round as outside."""
_MASS_ASSUMED_KG = (0.01, 100.0)
"""No estimate is below or above these."""


class SceneKeeper:
    """The description, the decisions, and the model made from both."""

    def __init__(self, timestep_s: float, *, time_s: float = 0.0) -> None:
        self.inventory = Inventory()
        self.collisions = Collisions()
        self.holds: dict[BodyId, Array] = {}
        self.ends: dict[BodyId, tuple[Array, Array]] = {}
        self.late_notes: list[Note] = []
        self._decided = _Decided()
        self.stale = True
        self._timestep_s = timestep_s
        self._time_s = time_s
        self._live: Live | None = None
        self._forest: Forest | None = None
        self._placed: dict[BodyId, Array] = {}
        """Poses that the model does not have yet."""
        self._at_rest: set[BodyId] = set()
        self._undecided: set[BodyId] = set()
        self._disturbed: list[Array] = []

    def copy(self) -> SceneKeeper:
        """A keeper of its own in the same state, stale if this one is; compiled models never change, so are shared."""
        twin = SceneKeeper(self._timestep_s, time_s=self._time_s)
        twin.inventory, twin.collisions = self.inventory.copy(), self.collisions.copy()
        twin.holds, twin.ends, twin.late_notes = dict(self.holds), dict(self.ends), list(self.late_notes)
        if self._live is not None:
            twin._live = copy.copy(self._live)
            twin._live.data = copy.copy(self._live.data)
        twin._forest, twin._decided, twin.stale = self._forest, self._decided, self.stale
        twin._placed, twin._at_rest = dict(self._placed), set(self._at_rest)
        twin._undecided, twin._disturbed = set(self._undecided), list(self._disturbed)
        return twin

    # -- what there is -----------------------------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self._time_s if self._live is None else float(self._live.data.time)

    @property
    def forest(self) -> Forest:
        """Who hangs on whom now."""
        if self._forest is None:
            self._forest = grow(self.inventory, self._masses_to_sort_by())
        return self._forest

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

    def reach(self, id: BodyId) -> list[BodyId]:
        """A body and all that goes where it goes, rigidly or on joints."""
        forest = self.forest
        on_joint: dict[BodyId, list[BodyId]] = {}
        for top, branch in forest.branches.items():
            on_joint.setdefault(branch.parent, []).append(top)
        found, waiting = [], [id]
        while waiting:
            body = waiting.pop()
            found.append(body)
            waiting += [child for child in self.inventory.children(body) if forest.holders.get(child) == body]
            waiting += on_joint.get(body, ())
        return found

    def bounds(self, ids: Iterable[BodyId]) -> Array:
        """The box around some bodies, 2 x 3: lower and upper corner [m]."""
        where = self.where_by_id()
        wanted = list(ids)
        poses = np.array([where[id] for id in wanted]).reshape(-1, 7)
        low, high = Boxes.of(poses, self._sizes(wanted)).bounds()
        return np.array([low.min(axis=0), high.max(axis=0)])

    def blueprint(self, where: Array | None = None) -> Blueprint:
        """All that a model of it is made from.

        Args:
            where: all poses, if they are at hand.
        """
        ids = self.inventory.ids
        return Blueprint(
            bodies=self.inventory.bodies,
            rows={id: row for row, id in enumerate(ids)},
            where=self.where() if where is None else where,
            sizes=self._sizes(ids),
            masses=self._masses(),
            forest=self.forest,
            holds=self.holds,
            ends=self.ends,
            collisions=self.collisions,
            constraints=self.inventory.constraints,
            timestep_s=self._timestep_s,
        )

    # -- edits -------------------------------------------------------------------------------------------------

    def add(self, world: World) -> SpawnReport:
        """See `Engine.spawn`."""
        self._settle_decisions()
        added = self.inventory.add(world)
        self._place(added)
        self._join(added)
        self._change()
        notes = self._assumptions(added.bodies)
        came = {*added.bodies, *added.constraints}
        notes += [note for note in self.forest.notes if came.intersection(note.ids)]
        notes += self._decide(set(added.bodies))
        return added.report(notes)

    def remove(self, ids: tuple[BodyId, ...]) -> None:
        """See `Engine.delete`."""
        gone = {self.inventory.body(id).id for id in ids}
        if not gone:
            return
        self._disturbed.append(self.bounds(gone))
        orphans = [child for id in gone for child in self.inventory.children(id) if child not in gone]
        hung = [top for top, branch in self.forest.branches.items() if branch.parent in gone and top not in gone]
        self.inventory.remove(gone)
        for id in [*gone, *orphans]:
            self.holds.pop(id, None)
        self.ends = {id: ends for id, ends in self.ends.items() if id in self.inventory.constraints}
        for id in gone:
            self._placed.pop(id, None)
        self._at_rest -= gone
        self._undecided -= gone
        self.collisions.forget(gone)
        self._change()
        self._undecided.update(*(self.reach(id) for id in (*orphans, *hung)))

    def attach(self, parent: BodyId, child: BodyId) -> None:
        """See `Engine.attach`."""
        self.inventory.attach(parent, child)
        where = self.where_by_id()
        self.holds[child] = compose(invert(where[parent]), where[child])
        self._change()

    def detach(self, child: BodyId) -> None:
        """See `Engine.detach`."""
        if self.inventory.body(child).id not in self.inventory.parents:
            return
        self.inventory.detach(child)
        self.holds.pop(child, None)
        self._change()
        self._undecided.update(self.reach(child))

    def set_physics(self, id: BodyId, physics: Physics) -> None:
        """See `Engine.set_physics`."""
        self.inventory.replace(id, physics=physics)
        self._disturbed.append(self.bounds([id]))
        self._change()
        self._undecided.update(self.reach(id))
        self.late_notes += self._assumptions([id])

    def move(self, id: BodyId, target: Array) -> None:
        """Puts a body, and all that goes with it, somewhere else; for bodies that no joint holds."""
        where = self.where_by_id()
        moving = self.reach(id)
        self._disturbed.append(self.bounds(moving))
        holder = self.forest.holders.get(id)
        if holder is not None:
            self.holds[id] = compose(invert(where[holder]), target)
        new_from_old = compose(target, invert(where[id]))
        moved = compose(new_from_old, np.array([where[body] for body in moving]))
        moved[:, 3:] = unit(moved[:, 3:])
        self._placed.update(zip(moving, moved, strict=True))
        self._placed[id] = target
        self._at_rest.update(moving)
        self._disturbed.append(self.bounds(moving))
        self.stale = True

    # -- inside ------------------------------------------------------------------------------------------------

    def _change(self) -> None:
        self.stale, self._forest = True, None

    def _place(self, added: Added) -> None:
        poses = pose_array(self.inventory.bodies[id].pose for id in added.bodies)
        poses[:, 3:] = unit(poses[:, 3:])
        self._placed.update(zip(added.bodies, poses, strict=True))

    def _join(self, added: Added) -> None:
        """Where attached children and constraint frames are, as seen from what they hang on."""
        if not (added.attachments or added.constraints):
            return
        rows = {id: row for row, id in enumerate(self.inventory.ids)}
        self.stale = True
        where = self.where()
        holders = [rows[self.inventory.parents[child]] for child in added.attachments]
        children = [rows[child] for child in added.attachments]
        self.holds.update(zip(added.attachments, compose(invert(where[holders]), where[children]), strict=True))
        constraints = [self.inventory.constraints[id] for id in added.constraints]
        frames = pose_array(constraint.pose for constraint in constraints)
        frames[:, 3:] = unit(frames[:, 3:])
        of_parent = compose(invert(where[[rows[constraint.parent] for constraint in constraints]]), frames)
        of_child = compose(invert(where[[rows[constraint.child] for constraint in constraints]]), frames)
        self.ends.update(zip(added.constraints, zip(of_parent, of_child, strict=True), strict=True))

    def _settle_decisions(self) -> None:
        """Decides about earlier edits before new bodies come, so that each report tells only its own."""
        if self._undecided:
            self.late_notes += self._decide(self._undecided)

    def _decide(self, fresh: set[BodyId]) -> list[Note]:
        """Decides what collides among fresh bodies and between them and the others."""
        ids, forest, constraints = self.inventory.ids, self.forest, self.inventory.constraints.values()
        poses, sizes = self.where(), self._sizes(ids)
        numbers = {top: number for number, top in enumerate(forest.assemblies)}
        tops = [forest.of_body[id] for id in ids]
        held = {forest.of_body[end] for constraint in constraints for end in (constraint.parent, constraint.child)}
        before, self._decided = self._decided, _Decided.of(forest, constraints)
        scene = Scene(
            ids=ids,
            poses=poses,
            sizes=sizes,
            assembly=np.array([numbers[top] for top in tops], dtype=np.intp),
            simulates=np.array([forest.assemblies[top].simulates for top in tops], dtype=bool),
            loose=np.array([forest.assemblies[top].simulates and top not in held for top in tops], dtype=bool),
            fresh=np.array([id in fresh for id in ids], dtype=bool),
            joined=frozenset(_sorted_pair(numbers[a], numbers[b]) for a, b in self._decided.joined),
            cores=_cores([self.inventory.bodies[id] for id in ids], poses, sizes),
            settled=lambda a, b: before.could_collide(ids[a], ids[b]),
        )
        self.collisions, notes = decide(scene, self.collisions)
        self._undecided = set()
        return notes

    def _rebuild(self) -> None:
        self._settle_decisions()
        where = self.where()
        ids = self.inventory.ids
        new = build(self.blueprint(where))
        new.data.time = self.time_s
        disturbed: NDArray[np.float64] = np.array(self._disturbed).reshape(-1, 2, 3)
        carry(self._live, new, dict(zip(ids, where, strict=True)), self.ends, self._at_rest, disturbed)
        self._live, self.stale = new, False
        self._placed, self._at_rest, self._disturbed = {}, set(), []

    # -- what is assumed -----------------------------------------------------------------------------------------

    def _sizes(self, ids: Iterable[BodyId]) -> Array:
        bodies = self.inventory.bodies
        default = (_SIZE_ASSUMED_M,) * 3
        return np.array([bodies[id].size or default for id in ids], dtype=float).reshape(-1, 3)

    def _masses(self) -> dict[BodyId, float]:
        """Given masses, and estimates for what moves without one."""
        masses = {}
        for assembly in self.forest.assemblies.values():
            for id in assembly.bodies:
                body = self.inventory.bodies[id]
                masses[id] = body.physics.mass_kg or (_estimated_mass(body) if assembly.simulates else 0.0)
        return masses

    def _masses_to_sort_by(self) -> dict[BodyId, float]:
        return {id: body.physics.mass_kg or _estimated_mass(body) for id, body in self.inventory.bodies.items()}

    def _assumptions(self, ids: Iterable[BodyId]) -> list[Note]:
        """One note for each kind of thing that the map did not say."""
        bodies = [self.inventory.bodies[id] for id in ids]
        forest = self.forest
        moving = [body for body in bodies if forest.assemblies[forest.of_body[body.id]].simulates]
        notes = []
        if unsized := tuple(body.id for body in bodies if body.size is None):
            text = f"{len(unsized)} bodies have no size and are taken as cubes of {_SIZE_ASSUMED_M} m"
            notes.append(Note(NoteKind.SIZE_ASSUMED, unsized, text))
        if unmoved := tuple(body.id for body in bodies if body.physics.mobility is None):
            text = f"{len(unmoved)} bodies have no mobility and are taken as static"
            notes.append(Note(NoteKind.MOBILITY_ASSUMED, unmoved, text))
        for body in moving:
            if not body.physics.mass_kg:
                text = f"{body.id} can move but has no mass: {_estimated_mass(body):.3g} kg estimated from its size"
                notes.append(Note(NoteKind.MASS_ESTIMATED, (body.id,), text))
        return notes


@dataclass(frozen=True, slots=True)
class _Decided:
    """Who could collide with whom when that was last decided."""

    of_body: Mapping[BodyId, BodyId] = field(default_factory=dict)
    simulating: frozenset[BodyId] = frozenset()
    """Tops of assemblies."""
    joined: frozenset[tuple[BodyId, BodyId]] = frozenset()
    """Pairs of tops that a constraint keeps from colliding."""

    @classmethod
    def of(cls, forest: Forest, constraints: Iterable[Constraint]) -> _Decided:
        simulating = frozenset(top for top, assembly in forest.assemblies.items() if assembly.simulates)
        joined = frozenset(
            _sorted_pair(forest.of_body[constraint.parent], forest.of_body[constraint.child])
            for constraint in constraints
            if constraint.disable_collision is not False
        )
        return cls(forest.of_body, simulating, joined)

    def could_collide(self, one: BodyId, other: BodyId) -> bool:
        a, b = self.of_body.get(one), self.of_body.get(other)
        if a is None or b is None or a == b or _sorted_pair(a, b) in self.joined:
            return False
        return a in self.simulating or b in self.simulating


_Comparable = TypeVar("_Comparable", int, BodyId)


def _sorted_pair(a: _Comparable, b: _Comparable) -> tuple[_Comparable, _Comparable]:
    return (a, b) if a < b else (b, a)


def _cores(bodies: Sequence[Body], poses: Array, sizes: Array) -> Boxes:
    """Boxes that stand for the bodies' real shapes when it comes to overlaps."""
    poses, sizes = poses.copy(), sizes.copy()
    for row, body in enumerate(bodies):
        if body.shape is None or body.shape.kind is ShapeKind.BOX:
            continue
        if body.shape.kind is ShapeKind.SPHERE:
            poses[row, 3:] = (1.0, 0.0, 0.0, 0.0)
            sizes[row] *= _ROUND
        else:
            sizes[row, :2] *= _ROUND
    return Boxes.of(poses, sizes)


def _estimated_mass(body: Body) -> float:
    volume = float(np.prod(body.size or (_SIZE_ASSUMED_M,) * 3))
    return float(np.clip(volume * _DENSITY_ASSUMED, *_MASS_ASSUMED_KG))
