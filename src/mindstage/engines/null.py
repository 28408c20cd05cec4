"""NullEngine: a world that only stands there.

It keeps the contract without any physics: nothing falls, nothing collides, attached bodies still follow. Programs are
tested with it, and whoever writes an engine can read here what the contract means.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from mindstage.engines.contract import Ability, Poses, SpawnReport, State, Statistics
from mindstage.engines.inventory import Inventory
from mindstage.errors import EngineClosed
from mindstage.world import NO_FORMS, BodyId, Colour, Forms, Material, Physics, Pose, Vector, World
from mindstage.world.geometry import compose, invert, pose_array, pose_from, unit_pose

__all__ = ["NullEngine"]


class NullEngine:
    """An engine in which time passes and nothing else happens."""

    name = "null"
    abilities = frozenset({Ability.SAVE, Ability.STATISTICS})

    def __init__(self) -> None:
        self._inventory = Inventory()
        self._time_s = 0.0
        self._closed = False

    @property
    def time_s(self) -> float:
        """See the contract, here and below."""
        return self._open()._time_s

    def spawn(self, world: World, *, forms: Forms = NO_FORMS) -> SpawnReport:
        return self._open()._inventory.add(world).report()

    def delete(self, ids: Iterable[BodyId]) -> None:
        self._open()._inventory.remove(ids)

    def clear(self) -> None:
        self._open()._inventory = Inventory()

    def attach(self, parent: BodyId, child: BodyId) -> None:
        self._open()._inventory.attach(parent, child)

    def detach(self, child: BodyId) -> None:
        self._open()._inventory.detach(child)

    def set_pose(self, id: BodyId, pose: Pose) -> None:
        inventory = self._open()._inventory
        old = inventory.body(id).pose
        inventory.replace(id, pose=pose)
        new_from_old = compose(unit_pose(pose), invert(unit_pose(old)))
        for child in inventory.hanging_on(id):
            inventory.replace(child, pose=pose_from(compose(new_from_old, unit_pose(inventory.body(child).pose))))

    def set_physics(self, id: BodyId, physics: Physics) -> None:
        self._open()._inventory.replace(id, physics=physics)

    def set_materials(self, id: BodyId, materials: tuple[Material, ...]) -> None:
        self._open()._inventory.replace(id, materials=materials)

    def highlight(self, ids: Iterable[BodyId], colour: Colour | None) -> None:
        self._open()._inventory.highlight(ids, colour)

    def highlights(self) -> Mapping[BodyId, Colour]:
        return MappingProxyType(self._open()._inventory.lit)

    def push(self, id: BodyId, force: Vector, at: Vector | None = None) -> None:
        self._open()._inventory.body(id)

    def step(self, duration_s: float) -> None:
        self._open()._time_s += duration_s

    def poses(self) -> tuple[tuple[BodyId, ...], Poses]:
        bodies = self._open()._inventory.bodies
        return self._inventory.ids, pose_array(body.pose for body in bodies.values())

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        return {}

    def statistics(self) -> Statistics:
        self._open()
        return Statistics(movable=0, awake=0, contacts=0)

    def log(self) -> World:
        return self._open()._inventory.world()

    def save(self) -> State:
        return State(_Saved(self._open()._inventory.copy(), self._time_s))

    def restore(self, state: State) -> None:
        if not isinstance(state, _Saved):
            raise TypeError(f"a state that NullEngine.save made is needed, not {type(state).__name__}")
        self._open()._inventory, self._time_s = state.inventory.copy(), state.time_s

    def close(self) -> None:
        self._closed = True

    def _open(self) -> NullEngine:
        if self._closed:
            raise EngineClosed(self.name)
        return self


@dataclass(frozen=True, slots=True)
class _Saved:
    inventory: Inventory
    time_s: float
