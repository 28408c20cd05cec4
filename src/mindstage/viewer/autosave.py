"""Autosave: what was edited is kept on the disk, and offered again if the program ended before it was saved.

An edit that needs more than its JSON, such as one that adds bodies, makes a snapshot of the world, as physics does that
moves something; others go to the journal.
"""

from __future__ import annotations

import logging
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from typing import Any
from weakref import WeakSet

import numpy as np

from mindstage.access.policies import FILE
from mindstage.engines.base import Engine
from mindstage.episodes.saved_sessions import JOURNALED, SavedSession, SessionFolder, TakenWorld, ended_sessions
from mindstage.errors import InvalidArgumentError, MindstageError
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId, Iri
from mindstage.scene.edits import Edit
from mindstage.simulation import Simulation, StateSnapshot
from mindstage.simulation.observation import as_client
from mindstage.viewer.server import CLIENT, ClientSession, EmptyRequest, RpcChannel

__all__ = ["Autosave"]

_POLL_S = 0.2
"""Wall time between two writings of the journal [s]."""
_SNAPSHOT_S = 4.0
"""Wall time between two snapshots while bodies move [s]."""
_RETRY_S = 30.0
"""Wall time after which writing is tried again that has failed [s]."""
_JOIN_S = 30.0
"""How long closing waits for the last writing [s]."""
_TOPIC = "autosave"
_UNCHANGING = {"question", "highlight", "skill"}
"""Kinds of reports after which the world is as before."""
_log = logging.getLogger(__name__)


class Autosave:
    """Saves what is edited, in a thread of its own, and offers what an earlier process has saved; see the module."""

    interval_s = 1.0

    def __init__(self, simulation: Simulation, channel: RpcChannel, *, is_unsaved: Callable[[], bool]) -> None:
        """Starts; nothing is written before the first edit.

        Args:
            simulation: the simulation.
            channel: the channel of the pages; they are asked whether to restore what is offered.
            is_unsaved: whether there is anything that was not saved as a map.
        """
        self._simulation, self._channel, self._is_unsaved = simulation, channel, is_unsaved
        self._version = simulation.edits.version
        """The history whose world need not be saved."""
        self._edits: deque[Edit] = deque()
        self._is_due = False
        """Whether a snapshot is needed, since the journal does not describe what has happened."""
        self._is_stated = False
        """Whether a statement was added or removed."""
        self._known: WeakSet[KnowledgeBase] = WeakSet()
        self._knowledge = b""
        self._last: TakenWorld | None = None
        self._last_s = self._failed_s = float("-inf")
        self._error = ""
        self._offer: SavedSession | None = None
        self._offered = ExitStack()
        """Holds the lock of the folder that is offered."""
        self._lock = threading.RLock()
        self._closing = threading.Event()
        worlds = simulation.worlds
        self._store = SessionFolder(worlds[0].iri if worlds else Iri(""))
        channel.register("autosave.restore", EmptyRequest, self._restore, FILE, queue="files")
        channel.register("autosave.discard", EmptyRequest, self._discard, FILE, queue="files")
        self._watch(simulation.knowledge)
        self._publish()
        self._remove = simulation.observers.add(self)
        self._thread = threading.Thread(target=self._run, name="mindstage-autosave", daemon=True)
        self._thread.start()

    def forget(self) -> None:
        """Deletes what was saved since all of it is in a file of the user now."""
        with self._lock:
            self._edits.clear()
            self._version, self._last = self._simulation.edits.version, None
            self._is_due = self._is_stated = False
            self._store.delete()

    def close(self) -> None:
        """Writes what is left; deletes it if nothing is unsaved."""
        self._closing.set()
        self._thread.join(timeout=_JOIN_S)
        self._remove()
        with self._lock:
            if self._is_unsaved():
                self._store.close()
            else:
                self._store.delete()
            self._offered.close()

    # -- observing, in any thread --------------------------------------------------------------------------------------

    def on_state(self, state: StateSnapshot, engine: Engine, *, edited: bool, rebuild_pending: bool) -> None:
        """See `SimulationObserver`."""

    def on_edit(self, kind: str, *, client: str, ids: Iterable[BodyId], details: Mapping[str, Any]) -> None:
        """See `SimulationObserver`."""
        edits = details.get("edits") or ([details["edit"]] if "edit" in details else ())
        if edits and all(isinstance(each, JOURNALED) for each in edits):
            self._edits.extend(edits)
        elif kind not in _UNCHANGING:
            self._is_due = True

    # -- in the thread -------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        self._find_offer()
        while not self._closing.wait(_POLL_S):
            self._try_to_save()
        self._failed_s = float("-inf")
        self._try_to_save()

    def _try_to_save(self) -> None:
        if time.monotonic() < self._failed_s + _RETRY_S:
            return
        try:
            with self._lock:
                self._save()
        except (MindstageError, OSError) as error:
            self._failed_s = time.monotonic()
            if str(error) != self._error:
                _log.warning("edits could not be saved automatically: %s", error)
            self._set_error(str(error))
        else:
            self._set_error("")

    def _set_error(self, text: str) -> None:
        if text != self._error:
            self._error = text
            self._publish()

    def _save(self) -> None:
        simulation, last = self._simulation, self._last
        if last is None and simulation.edits.version == self._version and not self._is_stated:
            self._edits.clear()  # nothing of it is a step of the history
            self._is_due = False
            return
        is_late = time.monotonic() > self._last_s + _SNAPSHOT_S
        if last is None or self._is_due or (is_late and not np.array_equal(last.poses, simulation.state.poses)):
            self._save_snapshot()
            return
        edits = [self._edits.popleft() for _ in range(len(self._edits))]
        try:
            self._store.append(edits)
        except OSError:
            self._is_due = True  # these edits are not in the journal
            raise

    def _save_snapshot(self) -> None:
        simulation = self._simulation

        def take(engine: Engine) -> TakenWorld:
            self._is_due = False
            return TakenWorld(
                engine.snapshot(),
                simulation.worlds,
                dict(simulation.geometry),
                simulation.knowledge,
                np.array(engine.poses()[1]),
                len(self._edits),
            )

        taken = simulation.engine.run(take, label="autosave")
        try:
            # Steps first: they may be newer than the world, which is written again then.
            self._store.write_snapshot(taken, simulation.edits.history.undo[::-1], self._knowledge_of(taken.knowledge))
        except BaseException:
            self._is_due = True
            raise
        for _ in range(taken.waiting):
            self._edits.popleft()
        self._last, self._last_s = taken, time.monotonic()

    def _knowledge_of(self, knowledge: KnowledgeBase) -> bytes:
        """The statements as bytes, made again only if they have changed."""
        if self._watch(knowledge) or (self._last is not None and self._last.knowledge is not knowledge):
            self._knowledge = b""
        if not self._knowledge:
            self._knowledge = knowledge.to_bytes()
        return self._knowledge

    def _watch(self, knowledge: KnowledgeBase) -> bool:
        """Whether a knowledge base is new; its changes are noticed from now on."""
        if knowledge in self._known:
            return False
        self._known.add(knowledge)
        knowledge.on_change(lambda _: self._on_statements())
        return True

    def _on_statements(self) -> None:
        self._knowledge, self._is_due, self._is_stated = b"", True, True

    # -- the offer -----------------------------------------------------------------------------------------------------

    def _find_offer(self) -> None:
        """Takes the newest session of the same map; the others may be offered the next time."""
        for session, lock in ended_sessions(self._store.origin):
            if self._offer is None:
                self._offer, self._offered = session, lock.pop_all()
        self._publish()

    def _publish(self) -> None:
        offer = None if self._offer is None else self._offer.describe()
        self._channel.publish(_TOPIC, {"offer": offer, "error": self._error})

    def _taken_offer(self) -> SavedSession:
        with self._lock:
            if self._offer is None:
                raise InvalidArgumentError("the saved edits", cause="another window has restored or discarded them")
            offer, self._offer = self._offer, None
        self._publish()
        return offer

    def _restore(self, session: ClientSession, _: EmptyRequest) -> dict[str, object]:
        offer = self._taken_offer()
        try:
            with as_client(CLIENT, trusted=True):  # the meshes that the world names were granted before
                notes = offer.restore(self._simulation)
            with self._lock:
                self._save_snapshot()
        except BaseException:
            with self._lock:
                self._offer = offer
            self._publish()
            raise
        self._delete(offer)
        text = f"restored the unsaved edits of {offer.describe()['name']}; Undo brings back the world before"
        self._channel.tell_others(session, text)
        return {**offer.describe(), "notes": notes}

    def _discard(self, session: ClientSession, _: EmptyRequest) -> None:
        offer = self._taken_offer()
        self._delete(offer)
        self._channel.tell_others(session, f"discarded the unsaved edits of {offer.describe()['name']}")

    def _delete(self, offer: SavedSession) -> None:
        shutil.rmtree(offer.folder, ignore_errors=True)
        self._offered.close()
