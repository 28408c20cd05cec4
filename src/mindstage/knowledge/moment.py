"""Moment: a place as it was told, and as it is now.

A question that looks at the present asks for it by its last argument, which no surface sees:

    @question
    def where_is(kb: KnowledgeBase, thing: IndividualName | None = None, *, present: Present) -> Iterator[Where]: ...

Asked of a knowledge base alone, everything is where its map tells. Asked of a stage, it is where the engine has it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import msgspec

from mindstage.world import BodyId, Iri, World

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["MAP_SOURCE", "StateAccess", "WorldState"]

MAP_SOURCE = "map"
"""Who tells of a place that no engine runs."""


class WorldState(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A place at one moment."""

    world: World
    """Everything as it is."""
    spawned: tuple[World, ...]
    """The same as it was spawned, map by map."""
    joint_positions: Mapping[BodyId, tuple[float, ...]] | None = None
    """How far each constraint has moved since: x, y, z [m], twist, swing2, swing1 [rad]; None where nobody knows."""
    source: str = MAP_SOURCE
    """Who says so: the engine's name, or "map"."""

    def map_of_body(self) -> dict[BodyId, Iri]:
        """The map that each body came from."""
        told = {body.id: world.iri for world in reversed(self.spawned) for body in world.bodies}
        return {body.id: told.get(body.id, self.world.iri) for body in self.world.bodies}


class StateAccess:
    """What a question sees of the present: made for one asking, and looked up only if it is wanted."""

    def __init__(self, kb: KnowledgeBase, fetch_state: Callable[[], WorldState] | None = None) -> None:
        """Nothing is looked at yet.

        Args:
            kb: tells of the maps that no engine runs.
            take: asks the engine how things are, at most once; None without an engine.
        """
        self._kb = kb
        self._fetch_state = fetch_state

    def fetch(self) -> None:
        """Looks now, and not when somebody first wants to know."""
        self._engine_state  # noqa: B018 - kept from now on

    def states(self, map: Iri | None = None) -> tuple[WorldState, ...]:
        """The place that the engine runs, and each map that is not spawned in it; or only where one map is."""
        running = self._engine_state
        spawned = {world.iri for world in running.spawned} if running else set()
        here = [running] if running and (map is None or map in spawned) else []
        elsewhere = (each for each in self._kb.maps() if each not in spawned and map in {None, each})
        return (*here, *(self._map_state(each) for each in elsewhere))

    def find_individual(self, name: str) -> Iri | None:
        """Something that stands in the engine, by its IRI or its body's id: a program may have spawned it."""
        bodies = self._engine_state.world.bodies if self._engine_state else ()
        return next((body.iri for body in bodies if name in (body.iri, body.id)), None)

    @cached_property
    def _engine_state(self) -> WorldState | None:
        return self._fetch_state() if self._fetch_state else None

    def _map_state(self, map: Iri) -> WorldState:
        world = self._kb.world(map)
        return WorldState(world=world, spawned=(world,))
