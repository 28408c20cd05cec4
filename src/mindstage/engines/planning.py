"""Planning: what an engine has to know beyond a world, worked out once for all engines and kept true through edits.

Which bodies hang together, what each is made of, what it weighs where nobody said so, and who may collide with whom.
The engine tells where things stand; nothing here moves anything.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from mindstage.engines.collision import Collisions, Scene, decide
from mindstage.engines.contract import Note, SpawnReport
from mindstage.engines.forest import Forest, grow
from mindstage.engines.inventory import Added, Inventory
from mindstage.engines.matter import Matter
from mindstage.engines.plan import Plan, plan_of
from mindstage.engines.solids import plain_solid, plate_solids
from mindstage.world import NO_FORMS, BodyId, Constraint, Forms, Physics, Solid, World
from mindstage.world.geometry import Array, compose, invert, pose_array, unit

__all__ = ["Planner"]


class Planner:
    """The description of everything in one engine, and the decisions about it.

    Wherever poses are asked for as `where`, they are n x 7 with unit quaternions, in the order of `inventory.ids`.
    """

    def __init__(self) -> None:
        self.inventory = Inventory()
        self.matter = Matter(self.inventory)
        self.collisions = Collisions()
        self.holds: dict[BodyId, Array] = {}
        """Each attached child's pose as seen from what it hangs on."""
        self.ends: dict[BodyId, tuple[Array, Array]] = {}
        """Each constraint's frame as seen from the map's parent and from its child."""
        self.late_notes: list[Note] = []
        """What had to be decided because of edits; what a spawn decided is in its report."""
        self._forest: Forest | None = None
        self._undecided: set[BodyId] = set()
        self._decided = _Decided()

    def copy(self) -> Planner:
        """A planner of its own with the same decisions."""
        twin = Planner()
        twin.inventory, twin.collisions = self.inventory.copy(), self.collisions.copy()
        twin.matter = self.matter.copy(twin.inventory)
        twin.holds, twin.ends, twin.late_notes = dict(self.holds), dict(self.ends), list(self.late_notes)
        twin._forest, twin._undecided, twin._decided = self._forest, set(self._undecided), self._decided
        return twin

    @property
    def forest(self) -> Forest:
        """Who hangs on whom now."""
        if self._forest is None:
            self._forest = grow(self.inventory, self.matter.masses_to_sort_by())
        return self._forest

    @property
    def forms(self) -> Forms:
        """What the bodies are made of that have a form."""
        return self.matter.forms

    def masses(self) -> dict[BodyId, float]:
        """Given masses, estimates for what moves without one, and 0 for the rest [kg]."""
        moving = {id for each in self.forest.assemblies.values() if each.simulates for id in each.bodies}
        return {id: self.matter.mass(id, moves=id in moving) for id in self.inventory.bodies}

    def solids(self, id: BodyId) -> tuple[tuple[Solid, ...], Array | None]:
        """What of a body can be touched: hollow plates, a form's solids, or its shape.

        Also gives where they are in the body's frame, k x 7; None for one that is just where the body is.
        """
        plates = self.collisions.hollows.get(id)
        if plates is not None:
            made = plate_solids(plates)
            return made, pose_array(solid.pose for solid in made)
        if id in self.matter.forms:
            prepared = self.matter.prepared(id)
            return prepared.solids, prepared.poses
        return (plain_solid(self.inventory.bodies[id], self.matter.size(id)),), None

    def plan(self) -> Plan:
        """All of it as a value. Call `settle` first if anything was edited since."""
        return plan_of(self)

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

    # -- edits -------------------------------------------------------------------------------------------------

    def add(self, world: World, where: Array, *, forms: Forms = NO_FORMS) -> SpawnReport:
        """See `Engine.spawn`.

        Args:
            world: what comes; its bodies stand as described.
            where: the poses of all bodies so far.
            forms: what the world's bodies are made of.
        """
        self.settle(where)
        added = self.inventory.add(world)
        strange = self.matter.add(added.bodies, forms)
        came = pose_array(self.inventory.bodies[id].pose for id in added.bodies)
        came[:, 3:] = unit(came[:, 3:])
        where = np.concatenate([where, came])
        self._join(added, where)
        self._forest = None
        notes = [*self.matter.assumptions(added.bodies, self._moves), *strange]
        new = {*added.bodies, *added.constraints}
        notes += [note for note in self.forest.notes if new.intersection(note.ids)]
        notes += self._decide(set(added.bodies), where)
        return added.report(notes)

    def remove(self, ids: Iterable[BodyId]) -> None:
        """See `Engine.delete`."""
        gone = {self.inventory.body(id).id for id in ids}
        if not gone:
            return
        orphans = [child for id in gone for child in self.inventory.children(id) if child not in gone]
        hung = [top for top, branch in self.forest.branches.items() if branch.parent in gone and top not in gone]
        self.inventory.remove(gone)
        self.matter.remove(gone)
        for id in [*gone, *orphans]:
            self.holds.pop(id, None)
        self.ends = {id: ends for id, ends in self.ends.items() if id in self.inventory.constraints}
        self._undecided -= gone
        self.collisions.forget(gone)
        self._forest = None
        self._undecided.update(*(self.reach(id) for id in (*orphans, *hung)))

    def attach(self, parent: BodyId, child: BodyId, where: Array) -> None:
        """See `Engine.attach`."""
        self.inventory.attach(parent, child)
        rows = [self.inventory.ids.index(id) for id in (parent, child)]
        self.holds[child] = compose(invert(where[rows[0]]), where[rows[1]])
        self._forest = None

    def detach(self, child: BodyId) -> bool:
        """See `Engine.detach`; False if it hung nowhere."""
        if self.inventory.body(child).id not in self.inventory.parents:
            return False
        self.inventory.detach(child)
        self.holds.pop(child, None)
        self._forest = None
        self._undecided.update(self.reach(child))
        return True

    def set_physics(self, id: BodyId, physics: Physics) -> None:
        """See `Engine.set_physics`."""
        self.inventory.replace(id, physics=physics)
        self._forest = None
        self._undecided.update(self.reach(id))
        self.late_notes += self.matter.assumptions([id], self._moves)

    def rehang(self, id: BodyId, target: Array, where: Array) -> None:
        """Tells that a body stands somewhere else now; what it hangs on holds it there."""
        holder = self.forest.holders.get(id)
        if holder is not None:
            self.holds[id] = compose(invert(where[self.inventory.ids.index(holder)]), target)

    def settle(self, where: Array) -> None:
        """Decides about what edits changed; the notes are late ones."""
        if self._undecided:
            self.late_notes += self._decide(self._undecided, where)

    # -- who collides with whom ----------------------------------------------------------------------------------

    def apart(self) -> set[tuple[BodyId, BodyId]]:
        """All pairs that never collide, in the order of their ids: decided ones, and parts of one piece of furniture.

        Bodies of one assembly never do either; they are not listed.
        """
        forest = self.forest
        pairs = {pair for pair in self.collisions.apart if forest.of_body[pair[0]] != forest.of_body[pair[1]]}
        for one, other in self._joined_assemblies():
            for a in forest.assemblies[one].bodies:
                pairs |= {(a, b) if a < b else (b, a) for b in forest.assemblies[other].bodies}
        return pairs

    def _joined_assemblies(self) -> set[tuple[BodyId, BodyId]]:
        """Pairs of tops: two ends of a constraint, and a door with what else is fixed to its case (racks, bars)."""
        forest = self.forest
        neighbours: dict[BodyId, set[BodyId]] = {}
        for constraint in self.inventory.constraints.values():
            if constraint.disable_collision is not False:
                one, other = forest.of_body[constraint.parent], forest.of_body[constraint.child]
                neighbours.setdefault(one, set()).add(other)
                neighbours.setdefault(other, set()).add(one)
        pairs = {(one, other) for one, others in neighbours.items() for other in others if one < other}
        for top, branch in forest.branches.items():
            beside = neighbours.get(forest.of_body[branch.parent], ())
            fixed = (other for other in beside if not forest.assemblies[other].simulates)
            pairs |= {(top, other) if top < other else (other, top) for other in fixed if other != top}
        return pairs

    def _moves(self, id: BodyId) -> bool:
        """Whether the physics moves it."""
        return self.forest.assemblies[self.forest.of_body[id]].simulates

    def _join(self, added: Added, where: Array) -> None:
        """Where attached children and constraint frames are, as seen from what they hang on."""
        if not (added.attachments or added.constraints):
            return
        rows = {id: row for row, id in enumerate(self.inventory.ids)}
        holders = [rows[self.inventory.parents[child]] for child in added.attachments]
        children = [rows[child] for child in added.attachments]
        self.holds.update(zip(added.attachments, compose(invert(where[holders]), where[children]), strict=True))
        constraints = [self.inventory.constraints[id] for id in added.constraints]
        frames = pose_array(constraint.pose for constraint in constraints)
        frames[:, 3:] = unit(frames[:, 3:])
        of_parent = compose(invert(where[[rows[constraint.parent] for constraint in constraints]]), frames)
        of_child = compose(invert(where[[rows[constraint.child] for constraint in constraints]]), frames)
        self.ends.update(zip(added.constraints, zip(of_parent, of_child, strict=True), strict=True))

    def _decide(self, fresh: set[BodyId], where: Array) -> list[Note]:
        """Decides what collides among fresh bodies and between them and the others."""
        ids, forest, constraints = self.inventory.ids, self.forest, self.inventory.constraints.values()
        numbers = {top: number for number, top in enumerate(forest.assemblies)}
        tops = [forest.of_body[id] for id in ids]
        held = {forest.of_body[end] for constraint in constraints for end in (constraint.parent, constraint.child)}
        before, self._decided = self._decided, _Decided.of(forest, constraints)
        scene = Scene(
            ids=ids,
            poses=where,
            sizes=self.matter.sizes(ids),
            assembly=np.array([numbers[top] for top in tops], dtype=np.intp),
            simulates=np.array([forest.assemblies[top].simulates for top in tops], dtype=bool),
            loose=np.array([forest.assemblies[top].simulates and top not in held for top in tops], dtype=bool),
            fresh=np.array([id in fresh for id in ids], dtype=bool),
            joined=frozenset((min(pair), max(pair)) for pair in self._decided.numbered(numbers)),
            cores=self.matter.cores(ids, where),
            parts=self.matter.parts(ids, where),
            formed=self.matter.formed(ids),
            settled=lambda a, b: before.could_collide(ids[a], ids[b]),
        )
        self.collisions, notes = decide(scene, self.collisions)
        self._undecided = set()
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

    def numbered(self, numbers: Mapping[BodyId, int]) -> Iterable[tuple[int, int]]:
        """The joined pairs by the numbers of their tops."""
        return ((numbers[a], numbers[b]) for a, b in self.joined)

    def could_collide(self, one: BodyId, other: BodyId) -> bool:
        a, b = self.of_body.get(one), self.of_body.get(other)
        if a is None or b is None or a == b or _sorted_pair(a, b) in self.joined:
            return False
        return a in self.simulating or b in self.simulating


def _sorted_pair(a: BodyId, b: BodyId) -> tuple[BodyId, BodyId]:
    return (a, b) if a < b else (b, a)
