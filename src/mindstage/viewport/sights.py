"""Sights: what each visitor wants to see, and whatever is drawn for one visitor alone.

A visitor is known by the number of the view's connection. Any thread may ask for anything; what is asked for is done
by the one thread that draws, at its next turn.
"""

from __future__ import annotations

import logging
import threading
import warnings
from collections.abc import Callable, Iterable, Mapping
from queue import Empty, SimpleQueue

import viser

from mindstage.errors import BodyUnknown
from mindstage.viewport.framing import Outlook, View
from mindstage.viewport.looks import Look
from mindstage.viewport.sight import GizmoMode, Labels, Place, Sight
from mindstage.world import BodyId, Pose
from mindstage.world.geometry import Array

__all__ = ["GizmoMode", "Labels", "Sights"]

_log = logging.getLogger(__name__)


class Sights:
    """All visitors' views. Where no visitor is named, all are meant, and those who come later too."""

    def __init__(self, server: viser.ViserServer, *, place: Place) -> None:
        """Nobody is there yet.

        Args:
            server: where they come.
            place: called when a visitor has put a body somewhere with the gizmo.
        """
        self._place = place
        self._wishes: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._sights: dict[int, Sight] = {}
        self._for_all: dict[str, Callable[[Sight], None]] = {}
        """What newcomers get, by what it is about."""
        self._listeners: list[Callable[[int], None]] = []
        self._names: Mapping[BodyId, str] = {}
        self._looks: Mapping[BodyId, Look] = {}
        self._ids: tuple[BodyId, ...] = ()
        self._poses: Array | None = None
        self._outlook: Outlook | None = None
        self._hidden: frozenset[BodyId] = frozenset()
        self._hiding = threading.Lock()
        self._shells_shown = True
        # A tab may be closed between two pictures; nobody needs to be warned of that on stderr.
        warnings.filterwarnings("ignore", message=".* on a closed connection", category=UserWarning)
        server.on_client_connect(lambda client: self._wish(lambda: self._welcome(client)))
        server.on_client_disconnect(lambda client: self._wish(lambda: self._see_off(client)))

    # -- what anybody may ask for --------------------------------------------------------------------------------------

    @property
    def visitors(self) -> tuple[int, ...]:
        """Who is there."""
        return tuple(self._sights)

    def on_change(self, listener: Callable[[int], None]) -> None:
        """Calls a function with each visitor whose selection has changed."""
        self._listeners.append(listener)

    def selected(self, visitor: int) -> BodyId | None:
        """What a visitor has selected."""
        sight = self._sights.get(visitor)
        return sight.selected if sight is not None else None

    def select(self, id: BodyId | None, *, visitor: int | None = None) -> None:
        """Draws a frame round a body; None round none.

        Raises:
            BodyUnknown: there is no such body.
        """
        self._check([] if id is None else [id])

        def choose(sight: Sight) -> None:
            if sight.select(id):
                self._tell(sight.visitor)

        self._ask("select", choose, visitor)

    def focus(self, ids: Iterable[BodyId] = (), *, visitor: int | None = None) -> None:
        """Flies to bodies, so that they fill the picture; to the whole place, where none is named.

        Raises:
            BodyUnknown: one of them is not there.
        """
        wanted = tuple(ids)
        self._check(wanted)
        self._ask(None, lambda sight: sight.focus(wanted), visitor)

    def home(self, *, visitor: int | None = None) -> None:
        """Flies to where visitors stand at first."""
        self._ask(None, lambda sight: sight.home(), visitor)

    def top(self, *, visitor: int | None = None) -> None:
        """Looks down on the whole place, as on a plan."""
        self._ask(None, lambda sight: sight.top(), visitor)

    def look_from(self, view: View, *, visitor: int | None = None) -> None:
        """Takes a visitor somewhere at once."""
        self._ask("view", lambda sight: sight.look_from(view), visitor)

    def section(self, height: float | None, *, visitor: int | None = None) -> None:
        """Hides all that is above a height [m], so that one sees into rooms; None shows it again."""
        self._ask("section", lambda sight: sight.section(height), visitor)

    def label(self, labels: Labels, *, visitor: int | None = None) -> None:
        """Writes the names of bodies beside them."""
        self._ask("labels", lambda sight: sight.label(labels), visitor)

    def ghost(self, id: BodyId, pose: Pose | None, *, visitor: int | None = None) -> None:
        """Draws a body a second time, see-through, at another pose; None takes that away.

        Raises:
            BodyUnknown: there is no such body.
        """
        self._check([id])
        self._ask(f"ghost {id}", lambda sight: sight.ghost(id, pose), visitor)

    def gizmo(self, mode: GizmoMode | None, *, visitor: int | None = None) -> None:
        """Gives the selected body handles to move or to turn it by."""
        self._ask("gizmo", lambda sight: sight.gizmo(mode), visitor)

    @property
    def drawn(self) -> bool:
        """Whether what is there was drawn at least once, be it nothing."""
        return self._poses is not None

    @property
    def outlook(self) -> Outlook | None:
        """Where visitors stand at first; None as long as there is nothing to be seen."""
        return self._outlook

    @property
    def hidden(self) -> frozenset[BodyId]:
        """The bodies that nobody sees."""
        return self._hidden

    def show_bodies(self, ids: Iterable[BodyId], shown: bool) -> None:
        """Hides bodies from all visitors, or shows them again.

        Raises:
            BodyUnknown: one of them is not there.
        """
        wanted = frozenset(ids)
        self._check(wanted)
        with self._hiding:
            self._hidden = self._hidden - wanted if shown else self._hidden | wanted

    @property
    def shells_shown(self) -> bool:
        """Whether the outlines of what encloses the place are drawn."""
        return self._shells_shown

    def show_shells(self, shown: bool) -> None:
        """Draws the outlines of what encloses the place, or not, for all visitors."""
        self._shells_shown = shown

    # -- for the thread that draws -------------------------------------------------------------------------------------

    def know(
        self, looks: Mapping[BodyId, Look], names: Mapping[BodyId, str], ids: tuple[BodyId, ...], poses: Array
    ) -> None:
        """What is there now: how it is drawn, its name for people, and where it is."""
        self._looks, self._names, self._ids, self._poses = looks, names, ids, poses
        with self._hiding:
            self._hidden &= looks.keys()
        for sight in self._sights.values():
            if sight.know(looks, names, ids, poses):
                self._tell(sight.visitor)

    def open_on(self, outlook: Outlook) -> None:
        """Where visitors stand at first."""
        self._outlook = outlook
        for sight in self._sights.values():
            sight.open_on(outlook)

    def follow(self, poses: Array) -> None:
        """Moves what is drawn at a body with it."""
        self._poses = poses
        for sight in self._sights.values():
            sight.follow(poses)

    def turn(self) -> None:
        """Does all that was asked for since the last time, and lets cameras fly on."""
        while True:
            try:
                wish = self._wishes.get_nowait()
            except Empty:
                break
            wish()
        for sight in self._sights.values():
            sight.fly()

    def settled(self, *, timeout_s: float) -> bool:
        """Waits until all that was asked for so far is on its way; False if it did not come to that in time."""
        done = threading.Event()
        self._wish(done.set)
        return done.wait(timeout_s)

    # -- how -----------------------------------------------------------------------------------------------------------

    def _wish(self, wish: Callable[[], None]) -> None:
        self._wishes.put(wish)

    def _ask(self, about: str | None, what: Callable[[Sight], None], visitor: int | None) -> None:
        def do() -> None:
            if visitor is not None:
                if (sight := self._sights.get(visitor)) is not None:  # a tab may be closed at any time
                    what(sight)
                return
            if about is not None:
                self._for_all[about] = what
            for sight in self._sights.values():
                what(sight)

        self._wish(do)

    def _check(self, ids: Iterable[BodyId]) -> None:
        for id in ids:
            if id not in self._looks:
                raise BodyUnknown(id, world="the view", known=self._looks)

    def _welcome(self, client: viser.ClientHandle) -> None:
        sight = self._sights[client.client_id] = Sight(client, place=self._place, wish=self._wish)
        if self._poses is not None:
            sight.know(self._looks, self._names, self._ids, self._poses)
        if self._outlook is not None:
            sight.open_on(self._outlook)
        for what in self._for_all.values():
            what(sight)

    def _see_off(self, client: viser.ClientHandle) -> None:
        self._sights.pop(client.client_id, None)

    def _tell(self, visitor: int) -> None:
        for listener in self._listeners:
            try:
                listener(visitor)
            except Exception:
                _log.exception("nobody could be told of a selection")
