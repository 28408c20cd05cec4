"""Observers and clients of a simulation: observers receive each state, and each edit with the client that made it.

While there is an observer, functions that run on the engine get an `ObservedEngine`, which reports edits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from itertools import islice
from typing import Any, Protocol, cast

import msgspec

from mindstage.access.limits import OBSERVER_INTERVAL
from mindstage.access.resources import from_outside
from mindstage.engines.base import Applied, Engine, SavedState, SpawnReport
from mindstage.errors import SimulationFaultError
from mindstage.knowledge.questions import Answers
from mindstage.scene import BodyId, Color
from mindstage.scene.edits import Edit
from mindstage.simulation.controllers import fault_error
from mindstage.simulation.state import StateSnapshot

__all__ = [
    "DEFAULT_CLIENT",
    "SKILL_EDIT",
    "ClientDirectory",
    "ConnectedClient",
    "ObservedEngine",
    "Observers",
    "SimulationObserver",
    "as_client",
    "current_client",
]

DEFAULT_CLIENT = "Python"
"""The client of threads outside of `as_client`."""
_client: ContextVar[str] = ContextVar("client", default=DEFAULT_CLIENT)
SKILL_EDIT = "skill"
"""The kind of the edits that report the begin and the end of a skill; see `Robot.performing`."""
_COMPOUND = {"reset", "clear", "undo", "redo", "place"}
"""Labels of calls that consist of several edits, and are reported as one."""
_REPEATABLE = {"undo", "redo"}
"""Those that are made again by their edits; the others are calls, or leave the world as it was."""
_UNDONE = {"check rest", "mark start"}
"""Labels of calls that leave the world as it was."""
_MAX_IDS = 1000
_MAX_ANSWER_COUNT = 200


@contextmanager
def as_client(name: str, *, trusted: bool = False) -> Iterator[None]:
    """In the context, edits and questions of this thread are those of a client, such as "viewer"; else of "Python".

    Args:
        name: the name of the client.
        trusted: whether its texts may name every file, as those of the command line; see `access.resources`.
    """
    token = _client.set(name)
    try:
        with from_outside(not trusted):
            yield
    finally:
        _client.reset(token)


def current_client() -> str:
    """The client whose call this thread executes."""
    return _client.get()


class ConnectedClient(msgspec.Struct, frozen=True, kw_only=True):
    """A connected client, such as a ROS node."""

    name: str
    transport: str
    """The transport, such as "ROS"."""
    activity: str = ""
    """A short description of what it uses."""


class ClientDirectory:
    """Lists connected clients, and notifies listeners of edits; may be used from any thread."""

    def __init__(self) -> None:
        self._sources: tuple[Callable[[], Iterable[ConnectedClient]], ...] = ()
        self._edit_callbacks: tuple[Callable[[], None], ...] = ()

    def add_client_source(self, source: Callable[[], Iterable[ConnectedClient]]) -> Callable[[], None]:
        """Registers a callback, for any thread, that lists connected clients; returns a function that removes it."""
        self._sources = (*self._sources, source)

        def remove() -> None:
            self._sources = tuple(each for each in self._sources if each is not source)

        return remove

    def clients(self) -> tuple[ConnectedClient, ...]:
        """The clients that are connected now."""
        return tuple(client for source in self._sources for client in source())

    def on_edit(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Registers a callback for edits, called after they are published; returns a function that removes it.

        It is called in the engine thread, and must not block.
        """
        self._edit_callbacks = (*self._edit_callbacks, callback)

        def remove() -> None:
            self._edit_callbacks = tuple(each for each in self._edit_callbacks if each is not callback)

        return remove

    def notify_edit(self, *, caught: type[BaseException] = Exception) -> BaseException | None:
        """Calls the edit callbacks: bodies, materials or highlights were added, removed or changed.

        A callback that raises is removed.

        Args:
            caught: what is caught of what callbacks raise.

        Returns:
            The exception of the last one that raised; None if none did.
        """
        raised: BaseException | None = None
        for callback in self._edit_callbacks:
            try:
                callback()
            except caught as error:
                raised = error
                self._edit_callbacks = tuple(each for each in self._edit_callbacks if each is not callback)
        return raised


class SimulationObserver(Protocol):
    """Receives states and edits. Its methods must be quick, and must not call the simulation.

    If one raises, the observer is removed and the simulation paused, with a `SimulationFaultError`.
    """

    interval_s: float
    """Longest simulated time between two published states while the simulation is stepped [s]."""

    def on_state(self, state: StateSnapshot, engine: Engine, *, edited: bool, rebuild_pending: bool) -> None:
        """Called in the engine thread after a state was published.

        Args:
            state: the state.
            engine: the engine, to which no reference may be kept.
            edited: whether anything but poses may have changed since the state before.
            rebuild_pending: whether reading joints or contacts would make the engine rebuild its model now.
        """

    def on_edit(self, kind: str, *, client: str, ids: Iterable[BodyId], details: Mapping[str, Any]) -> None:
        """Called before the state with the edit is published, or after a question; in any thread.

        Args:
            kind: what was done, such as "spawn".
            client: who did it.
            ids: the bodies that it is about.
            details: arguments and results, as JSON values; `edit` is an `Edit`, and `edits` are several.
        """


class Observers:
    """The observers of a simulation; may be used from any thread."""

    def __init__(
        self, *, on_fault: Callable[[SimulationFaultError], None], caught: type[BaseException] = Exception
    ) -> None:
        """Creates an empty list.

        Args:
            on_fault: called with the error of an observer that raised and was removed.
            caught: what is caught of what observers raise.
        """
        self._observers: tuple[SimulationObserver, ...] = ()
        self._on_fault, self._caught = on_fault, caught
        self._called: SimulationObserver | None = None
        self.recorder: object | None = None
        """The last `mindstage.episodes.Recorder`: questions about the past are about what it has recorded so far."""

    def __bool__(self) -> bool:
        return bool(self._observers)

    @property
    def called(self) -> str:
        """The observer that is being called with a state now, which has not returned; empty if there is none."""
        called = self._called
        return "" if called is None else type(called).__name__

    def add(self, observer: SimulationObserver) -> Callable[[], None]:
        """Adds an observer; returns a function that removes it.

        Raises:
            InvalidArgumentError: its interval is out of range.
        """
        OBSERVER_INTERVAL.check(observer.interval_s)
        self._observers = (*self._observers, observer)
        return partial(self._remove, observer)

    def _remove(self, observer: SimulationObserver) -> None:
        self._observers = tuple(each for each in self._observers if each is not observer)

    def _call(self, observer: SimulationObserver, function: Callable[[], None]) -> None:
        try:
            function()
        except self._caught as error:
            self._remove(observer)
            fault = fault_error(f"the observer {type(observer).__name__}", error, remedy="it was removed")
            fault.__cause__ = error
            self._on_fault(fault)

    def step_s(self, longest_s: float) -> float:
        """The length of the steps into which a longer one is divided [s]."""
        return min((longest_s, *(max(each.interval_s, OBSERVER_INTERVAL.minimum) for each in self._observers)))

    def publish(self, state: StateSnapshot, engine: Engine, *, edited: bool, rebuild_pending: bool) -> None:
        """Passes a published state on."""
        for observer in self._observers:
            self._called = observer
            try:
                on_state = partial(observer.on_state, edited=edited, rebuild_pending=rebuild_pending)
                self._call(observer, partial(on_state, state, engine))
            finally:
                self._called = None

    def report(
        self,
        kind: str,
        *,
        ids: Iterable[BodyId] = (),
        details: Mapping[str, Any] | None = None,
        client: str | None = None,
    ) -> None:
        """Reports an edit or a request, by default of the client of this thread."""
        reported = tuple(ids)
        name = client or current_client()
        for observer in self._observers:
            self._call(observer, partial(observer.on_edit, kind, client=name, ids=reported, details=details or {}))

    def report_answers(self, answers: Answers[Any]) -> None:
        """Reports a question with its answers."""
        rows = [msgspec.to_builtins(row) for row in islice(answers, _MAX_ANSWER_COUNT)]
        details = {"question": answers.question.name, "args": msgspec.to_builtins(dict(answers.args))}
        self.report("question", details=details | {"count": len(answers), "answers": rows})

    @contextmanager
    def editing(self, engine: Engine, *, label: str, client: str) -> Iterator[Engine]:
        """The engine for a function that may edit the world; its edits are reported at the end.

        Args:
            engine: the engine.
            label: the name of the call.
            client: who made it.
        """
        observed = ObservedEngine(engine)
        try:
            yield cast("Engine", observed)
        finally:
            if label in _COMPOUND and observed.edits:
                all_ids = dict.fromkeys(id for _, ids, _ in observed.edits for id in ids)
                edits = [details["edit"] for _, _, details in observed.edits if "edit" in details]
                made = {"edits": edits} if edits and label in _REPEATABLE else {}
                self.report(label, ids=tuple(all_ids)[:_MAX_IDS], details=made, client=client)
            elif label not in _UNDONE:
                for kind, ids, details in observed.edits:
                    self.report(kind, ids=ids[:_MAX_IDS], details=details, client=client)


class ObservedEngine:
    """Passes all calls on to an engine, and lists the edits."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self.edits: list[tuple[str, tuple[BodyId, ...], Mapping[str, Any]]] = []
        """The kind of each edit, the bodies that it is about, and its arguments."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._engine, name)

    def apply(self, edit: Edit) -> Applied:
        """See `Engine`."""
        applied = self._engine.apply(edit)
        self.edits.append(_report(edit, applied.report))
        return applied

    def clear(self) -> None:
        """See `Engine`."""
        ids = self._engine.poses()[0]
        self._engine.clear()
        self.edits.append(("clear", ids, {}))

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        """See `Engine`."""
        highlighted = tuple(ids)
        self._engine.highlight(highlighted, color)
        self.edits.append(("highlight", highlighted, {"color": color}))

    def restore_state(self, state: SavedState) -> None:
        """See `Engine`."""
        self._engine.restore_state(state)
        self.edits.append(("restore", (), {}))

    def restore_before(self, edit: Edit, state: SavedState) -> None:
        """Restores the state to which an edit would lead, and reports the edit."""
        self._engine.restore_state(state)
        self.edits.append(_report(edit, SpawnReport()))


def _report(edit: Edit, report: SpawnReport) -> tuple[str, tuple[BodyId, ...], Mapping[str, Any]]:
    """What is reported of an edit that was made."""
    failed = {each.id for each in report.failed_bodies}
    details = {"edit": edit} | ({"failed": sorted(failed)} if failed else {})
    return edit.kind, tuple(id for id in edit.ids if id not in failed), details
