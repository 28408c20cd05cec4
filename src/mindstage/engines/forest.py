"""Forest: which body moves with which, worked out before any physics.

Bodies that hang rigidly together form an assembly. Constraints join assemblies. MuJoCo wants kinematic trees: each
tree grows from an assembly that the physics does not move (else from the heaviest), whatever the map calls parent
and child. A constraint that would close a loop cannot be part of a tree; it is kept as an equality.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from mindstage.engines.contract import Note, NoteKind
from mindstage.engines.inventory import Inventory
from mindstage.world import AngularMotion, Body, BodyId, Constraint, LinearMotion, Mobility, Motion

__all__ = ["Assembly", "Branch", "Forest", "grow"]

T = TypeVar("T")


@dataclass(slots=True)
class Assembly:
    """Bodies that keep their places among one another."""

    top: BodyId
    """The body all others hang on."""
    mobility: Mobility
    """Of the top; it decides for all."""
    mass_kg: float
    bodies: list[BodyId] = field(default_factory=list)
    """The top first, parents before children."""

    @property
    def simulates(self) -> bool:
        """Whether the physics moves it."""
        return self.mobility is Mobility.DYNAMIC


@dataclass(slots=True)
class Branch:
    """An assembly hanging on a body of another one, by a constraint."""

    constraint: Constraint
    parent: BodyId
    """The end nearer to the root, which need not be what the map calls the parent."""
    child: BodyId

    @property
    def upside_down(self) -> bool:
        """Whether the map has the roles the other way round."""
        return self.parent != self.constraint.parent

    def seen_from_root(self, ends: tuple[T, T]) -> tuple[T, T]:
        """What belongs to the map's parent and to its child, as what belongs to this branch's parent and child."""
        return ends[::-1] if self.upside_down else ends


@dataclass(slots=True)
class Forest:
    """All assemblies and how they hang together."""

    assemblies: dict[BodyId, Assembly] = field(default_factory=dict)
    """By their tops, each one after the one it hangs on."""
    of_body: dict[BodyId, BodyId] = field(default_factory=dict)
    """The top of each body's assembly."""
    holders: dict[BodyId, BodyId] = field(default_factory=dict)
    """Whom each body hangs on rigidly; tops are not in it."""
    branches: dict[BodyId, Branch] = field(default_factory=dict)
    """By the top of the hanging assembly."""
    loops: list[Branch] = field(default_factory=list)
    """Constraints that close a loop."""
    notes: list[Note] = field(default_factory=list)


def grow(inventory: Inventory, masses: Mapping[BodyId, float]) -> Forest:
    """Works out the forest of everything in an inventory.

    Args:
        inventory: bodies, constraints, attachments.
        masses: of every body that the physics may move, estimated ones included [kg].
    """
    forest = Forest()
    _assemble(forest, inventory, masses)
    edges = _edges(forest, inventory.constraints.values())
    ordered: dict[BodyId, Assembly] = {}
    fixed = [assembly for assembly in forest.assemblies.values() if not assembly.simulates]
    free = sorted((a for a in forest.assemblies.values() if a.simulates), key=lambda a: -a.mass_kg)
    used: set[BodyId] = set()
    # A kinematic root may be moved one day, so what also reaches a static one should rather hang there.
    roots = sorted(fixed, key=lambda assembly: assembly.mobility is Mobility.KINEMATIC)
    _spread(forest, roots, edges, ordered, used)
    for assembly in free:
        _spread(forest, [assembly], edges, ordered, used)
    forest.assemblies = ordered
    return forest


def effective_mobility(body: Body) -> Mobility:
    """The body's mobility, where what is not said is static."""
    return body.physics.mobility or Mobility.STATIC


def _assemble(forest: Forest, inventory: Inventory, masses: Mapping[BodyId, float]) -> None:
    joined = _joined(inventory)
    for id, body in inventory.bodies.items():
        holder = inventory.parents.get(id)
        if holder is None:
            continue
        if not (body.physics.simulates and id in joined):
            forest.holders[id] = holder
            continue
        constraints = ", ".join(joined[id])
        text = f"{id} is attached to {holder}, but moves by its constraint {constraints}"
        forest.notes.append(Note(NoteKind.ATTACHMENT, (id, holder), text))
    tops = [id for id in inventory.bodies if id not in forest.holders]
    for top in tops:
        assembly = Assembly(top, effective_mobility(inventory.bodies[top]), 0.0)
        waiting = [top]
        while waiting:
            id = waiting.pop()
            assembly.bodies.append(id)
            assembly.mass_kg += masses.get(id, 0.0)
            forest.of_body[id] = top
            waiting.extend(child for child in inventory.children(id) if forest.holders.get(child) == id)
        forest.assemblies[top] = assembly
    for id, holder in forest.holders.items():
        if inventory.bodies[id].physics.simulates:
            text = f"{id} is dynamic and attached to {holder}: it moves rigidly with it and adds its mass"
            forest.notes.append(Note(NoteKind.ATTACHMENT, (id, holder), text))


def _joined(inventory: Inventory) -> dict[BodyId, list[BodyId]]:
    """The constraints of each body that has some."""
    joined: dict[BodyId, list[BodyId]] = {}
    for constraint in inventory.constraints.values():
        joined.setdefault(constraint.parent, []).append(constraint.id)
        joined.setdefault(constraint.child, []).append(constraint.id)
    return joined


_Edges = dict[BodyId, list[tuple[BodyId, Branch]]]


def _edges(forest: Forest, constraints: Iterable[Constraint]) -> _Edges:
    """For each assembly, what it could hold: the other assembly's top, and the branch seen from here."""
    edges: _Edges = {}
    for constraint in constraints:
        parent, child = forest.of_body[constraint.parent], forest.of_body[constraint.child]
        ids = (constraint.id, constraint.parent, constraint.child)
        if parent == child:
            text = f"{constraint.id} joins {constraint.parent} and {constraint.child}, which hang rigidly together"
            forest.notes.append(Note(NoteKind.CONSTRAINT, ids, text))
        elif not (forest.assemblies[parent].simulates or forest.assemblies[child].simulates):
            text = f"{constraint.id} joins {constraint.parent} and {constraint.child}, neither of which is dynamic"
            forest.notes.append(Note(NoteKind.CONSTRAINT, ids, text))
        elif not _all_free(constraint.linear, constraint.angular):
            edges.setdefault(parent, []).append((child, Branch(constraint, constraint.parent, constraint.child)))
            edges.setdefault(child, []).append((parent, Branch(constraint, constraint.child, constraint.parent)))
    return edges


def _all_free(linear: LinearMotion, angular: AngularMotion) -> bool:
    axes = (linear.x, linear.y, linear.z, angular.twist, angular.swing1, angular.swing2)
    return all(axis is Motion.FREE for axis in axes)


def _spread(
    forest: Forest, roots: list[Assembly], edges: _Edges, ordered: dict[BodyId, Assembly], used: set[BodyId]
) -> None:
    """Grows trees from some roots over all that they reach, breadth first; `used` holds the constraints so far."""
    waiting: deque[Assembly] = deque()
    for root in roots:
        if root.top not in ordered:
            ordered[root.top] = root
            waiting.append(root)
    while waiting:
        here = waiting.popleft()
        for top, branch in edges.get(here.top, ()):
            if branch.constraint.id in used:
                continue
            used.add(branch.constraint.id)
            if top in ordered:
                forest.loops.append(branch)
                text = f"{branch.constraint.id} closes a loop of constraints and is held by an equality"
                forest.notes.append(Note(NoteKind.CONSTRAINT, (branch.constraint.id,), text))
            else:
                forest.branches[top] = branch
                ordered[top] = forest.assemblies[top]
                waiting.append(forest.assemblies[top])
