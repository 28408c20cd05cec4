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

__all__ = ["TOLD", "Moment", "Present"]

TOLD = "map"
"""Who tells of a place that no engine runs."""


class Moment(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A place at one moment."""

    world: World
    """Everything as it is."""
    told: tuple[World, ...]
    """The same as it was spawned, map by map."""
    joints: Mapping[BodyId, tuple[float, ...]] | None = None
    """How far each constraint has moved since: x, y, z [m], twist, swing2, swing1 [rad]; None where nobody knows."""
    source: str = TOLD
    """Who says so: the engine's name, or "map"."""

    def homes(self) -> dict[BodyId, Iri]:
        """The map that each body came from."""
        told = {body.id: world.iri for world in reversed(self.told) for body in world.bodies}
        return {body.id: told.get(body.id, self.world.iri) for body in self.world.bodies}


class Present:
    """What a question sees of the present: made for one asking, and looked up only if it is wanted."""

    def __init__(self, kb: KnowledgeBase, take: Callable[[], Moment] | None = None) -> None:
        """Nothing is looked at yet.

        Args:
            kb: tells of the maps that no engine runs.
            take: asks the engine how things are, at most once; None without an engine.
        """
        self._kb = kb
        self._take = take

    def look(self) -> None:
        """Looks now, and not when somebody first wants to know."""
        self._running  # noqa: B018 - kept from now on

    def moments(self, map: Iri | None = None) -> tuple[Moment, ...]:
        """The place that the engine runs, and each map that is not spawned in it; or only where one map is."""
        running = self._running
        spawned = {world.iri for world in running.told} if running else set()
        here = [running] if running and (map is None or map in spawned) else []
        elsewhere = (each for each in self._kb.maps() if each not in spawned and map in {None, each})
        return (*here, *(self._as_told(each) for each in elsewhere))

    def individual(self, name: str) -> Iri | None:
        """Something that stands in the engine, by its IRI or its body's id: a program may have spawned it."""
        bodies = self._running.world.bodies if self._running else ()
        return next((body.iri for body in bodies if name in (body.iri, body.id)), None)

    @cached_property
    def _running(self) -> Moment | None:
        return self._take() if self._take else None

    def _as_told(self, map: Iri) -> Moment:
        world = self._kb.world(map)
        return Moment(world=world, told=(world,))
