"""Where things are, for the outline: what each body is in or on, and in which room.

The answers are those of the questions `where_is` and `in_room`. They are found in a thread of its own, which rests ten
times as long as it works.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterable, Mapping

import msgspec
import numpy as np

from mindstage.errors import MindstageError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import get_question
from mindstage.knowledge.questions import StateAccess
from mindstage.rdf.graphs import local_name
from mindstage.scene import BodyId, Iri
from mindstage.scene.spatial import SpatialRelation
from mindstage.simulation import Simulation, StateSnapshot
from mindstage.viewer.server import RpcChannel

__all__ = ["OutlinePlaces", "Places", "find_places"]

_REST = 10.0
"""How many times as long as it works the thread rests."""
_SHORTEST_S = 1.0
"""The shortest wall time between two searches [s]."""
_MOVED_M = 0.05
"""Shorter motions do not count [m]."""
_FLOORS = ("Floor", "Ground")
"""Parts of the names of classes on whose bodies nothing is listed: all furniture is."""
_log = logging.getLogger(__name__)


class Places(msgspec.Struct, frozen=True):
    """Where the bodies are; the topic `places`."""

    holders: Mapping[BodyId, tuple[BodyId, str]]
    """The body that each body is "in" or "on", the closest one."""
    rooms: Mapping[BodyId, str]
    """The room of each body, by its name; empty if there are fewer than two."""


class OutlinePlaces:
    """Publishes where things are after edits and motions, as the topic `places`."""

    def __init__(self, simulation: Simulation, channel: RpcChannel) -> None:
        self._simulation, self._channel = simulation, channel
        self._closing = threading.Event()
        self._found: StateSnapshot | None = None
        self._thread = threading.Thread(target=self._run, name="mindstage-outline", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the thread."""
        self._closing.set()
        self._thread.join(timeout=_SHORTEST_S)

    def _run(self) -> None:
        rest_s = 0.0
        while not self._closing.wait(rest_s):
            start_s = time.monotonic()
            state = self._simulation.state
            if self._found is None or _is_elsewhere(self._found, state):
                self._found = state
                try:
                    self._channel.publish("places", find_places(self._simulation))
                except MindstageError as error:  # closed, or the world was replaced meanwhile
                    _log.debug("where things are was not found: %s", error)
            rest_s = max(_SHORTEST_S, _REST * (time.monotonic() - start_s))


def find_places(simulation: Simulation) -> Places:
    """Where all bodies of a simulation are."""
    kb = simulation.knowledge
    state = simulation.current_state()
    present = StateAccess(kb, lambda: state, simulation=simulation)
    bodies = {body.iri: body for body in state.world.bodies}
    ids = {iri: body.id for iri, body in bodies.items()}
    placed = [row for row in get_question("in_room").ask(kb, {}, present=present) if row.thing in ids]
    rooms = {ids[row.thing]: row.region for row in placed}
    nothing = {row.room for row in placed} | {iri for iri, body in bodies.items() if _is_floor(kb, body.cls)}
    holders: dict[BodyId, tuple[BodyId, str]] = {}
    for relation, word in ((SpatialRelation.INSIDE, "in"), (SpatialRelation.ON, "on")):
        rows = get_question("where_is").ask(kb, {"relation": relation}, present=present)
        for row in sorted(rows, key=lambda row: abs(row.gap)):
            if row.thing in ids and row.other in ids and row.other not in nothing:
                holders.setdefault(ids[row.thing], (ids[row.other], word))
    return Places(_without_circles(holders), rooms if len(set(rooms.values())) > 1 else {})


def _is_floor(kb: KnowledgeBase, cls: Iri) -> bool:
    names: Iterable[str] = map(local_name, (cls, *kb.ancestors(cls)))
    return any(part in name for name in names for part in _FLOORS)


def _without_circles(holders: Mapping[BodyId, tuple[BodyId, str]]) -> dict[BodyId, tuple[BodyId, str]]:
    """Without the holders of bodies that would hold themselves, such as two that are in one another."""
    kept = dict(holders)
    for id in holders:
        seen, at = {id}, id
        while at in kept:
            holder = kept[at][0]
            if holder in seen:
                del kept[at]
                break
            seen.add(holder)
            at = holder
    return kept


def _is_elsewhere(before: StateSnapshot, now: StateSnapshot) -> bool:
    if before.revision != now.revision or before.ids is not now.ids:
        return True
    return bool(np.any(np.abs(before.poses[:, :3] - now.poses[:, :3]) > _MOVED_M))
