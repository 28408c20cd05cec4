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

from mindstage.errors import BodyNotFoundError
from mindstage.viewport.framing import CameraPose, FramingTarget
from mindstage.viewport.looks import BodyAppearance
from mindstage.viewport.sight import ClientView, GizmoMode, LabelMode, PlaceCallback
from mindstage.world import BodyId, Pose
from mindstage.world.geometry import Array

__all__ = ["ClientViews", "GizmoMode", "LabelMode"]

_log = logging.getLogger(__name__)


class ClientViews:
    """All visitors' views. Where no visitor is named, all are meant, and those who come later too."""

    def __init__(self, server: viser.ViserServer, *, on_place: PlaceCallback) -> None:
        """Nobody is there yet.

        Args:
            server: where they come.
            place: called when a visitor has put a body somewhere with the gizmo.
        """
        self._on_place = on_place
        self._queue: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._views: dict[int, ClientView] = {}
        self._defaults: dict[str, Callable[[ClientView], None]] = {}
        """What newcomers get, by what it is about."""
        self._listeners: list[Callable[[int], None]] = []
        self._names: Mapping[BodyId, str] = {}
        self._appearances: Mapping[BodyId, BodyAppearance] = {}
        self._ids: tuple[BodyId, ...] = ()
        self._poses: Array | None = None
        self._target: FramingTarget | None = None
        self._hidden: frozenset[BodyId] = frozenset()
        self._hidden_changed = threading.Lock()
        self._enclosures_shown = True
        # A tab may be closed between two pictures; nobody needs to be warned of that on stderr.
        warnings.filterwarnings("ignore", message=".* on a closed connection", category=UserWarning)
        server.on_client_connect(lambda client: self._enqueue(lambda: self._on_connect(client)))
        server.on_client_disconnect(lambda client: self._enqueue(lambda: self._on_disconnect(client)))

    # -- what anybody may ask for --------------------------------------------------------------------------------------

    @property
    def clients(self) -> tuple[int, ...]:
        """Who is there."""
        return tuple(self._views)

    def on_change(self, listener: Callable[[int], None]) -> None:
        """Calls a function with each visitor whose selection has changed."""
        self._listeners.append(listener)

    def selected(self, client: int) -> BodyId | None:
        """What a visitor has selected."""
        sight = self._views.get(client)
        return sight.selected if sight is not None else None

    def select(self, id: BodyId | None, *, client: int | None = None) -> None:
        """Draws a frame round a body; None round none.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self._require_bodies([] if id is None else [id])

        def choose(sight: ClientView) -> None:
            if sight.select(id):
                self._notify(sight.client_id)

        self._request("select", choose, client)

    def focus(self, ids: Iterable[BodyId] = (), *, client: int | None = None) -> None:
        """Flies to bodies, so that they fill the picture; to the whole place, where none is named.

        Raises:
            BodyNotFoundError: one of them is not there.
        """
        wanted = tuple(ids)
        self._require_bodies(wanted)
        self._request(None, lambda sight: sight.focus(wanted), client)

    def go_home(self, *, client: int | None = None) -> None:
        """Flies to where visitors stand at first."""
        self._request(None, lambda sight: sight.go_home(), client)

    def go_top(self, *, client: int | None = None) -> None:
        """Looks down on the whole place, as on a plan."""
        self._request(None, lambda sight: sight.go_top(), client)

    def set_camera(self, camera_pose: CameraPose, *, client: int | None = None) -> None:
        """Takes a visitor somewhere at once."""
        self._request("view", lambda sight: sight.set_camera(camera_pose), client)

    def set_clip_height(self, height: float | None, *, client: int | None = None) -> None:
        """Hides all that is above a height [m], so that one sees into rooms; None shows it again."""
        self._request("section", lambda sight: sight.set_clip_height(height), client)

    def set_labels(self, labels: LabelMode, *, client: int | None = None) -> None:
        """Writes the names of bodies beside them."""
        self._request("labels", lambda sight: sight.set_labels(labels), client)

    def show_preview(self, id: BodyId, pose: Pose | None, *, client: int | None = None) -> None:
        """Draws a body a second time, see-through, at another pose; None takes that away.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self._require_bodies([id])
        self._request(f"ghost {id}", lambda sight: sight.show_preview(id, pose), client)

    def set_gizmo(self, mode: GizmoMode | None, *, client: int | None = None) -> None:
        """Gives the selected body handles to move or to turn it by."""
        self._request("gizmo", lambda sight: sight.set_gizmo(mode), client)

    @property
    def is_drawn(self) -> bool:
        """Whether what is there was drawn at least once, be it nothing."""
        return self._poses is not None

    @property
    def target(self) -> FramingTarget | None:
        """Where visitors stand at first; None as long as there is nothing to be seen."""
        return self._target

    @property
    def hidden(self) -> frozenset[BodyId]:
        """The bodies that nobody sees."""
        return self._hidden

    def show_bodies(self, ids: Iterable[BodyId], shown: bool) -> None:
        """Hides bodies from all visitors, or shows them again.

        Raises:
            BodyNotFoundError: one of them is not there.
        """
        wanted = frozenset(ids)
        self._require_bodies(wanted)
        with self._hidden_changed:
            self._hidden = self._hidden - wanted if shown else self._hidden | wanted

    @property
    def enclosures_shown(self) -> bool:
        """Whether the outlines of what encloses the place are drawn."""
        return self._enclosures_shown

    def show_enclosures(self, shown: bool) -> None:
        """Draws the outlines of what encloses the place, or not, for all visitors."""
        self._enclosures_shown = shown

    # -- for the thread that draws -------------------------------------------------------------------------------------

    def set_bodies(
        self,
        appearances: Mapping[BodyId, BodyAppearance],
        names: Mapping[BodyId, str],
        ids: tuple[BodyId, ...],
        poses: Array,
    ) -> None:
        """What is there now: how it is drawn, its name for people, and where it is."""
        self._appearances, self._names, self._ids, self._poses = appearances, names, ids, poses
        with self._hidden_changed:
            self._hidden &= appearances.keys()
        for sight in self._views.values():
            if sight.set_bodies(appearances, names, ids, poses):
                self._notify(sight.client_id)

    def set_target(self, outlook: FramingTarget) -> None:
        """Where visitors stand at first."""
        self._target = outlook
        for sight in self._views.values():
            sight.set_target(outlook)

    def update_poses(self, poses: Array) -> None:
        """Moves what is drawn at a body with it."""
        self._poses = poses
        for sight in self._views.values():
            sight.update_poses(poses)

    def process_queue(self) -> None:
        """Does all that was asked for since the last time, and lets cameras fly on."""
        while True:
            try:
                wish = self._queue.get_nowait()
            except Empty:
                break
            wish()
        for sight in self._views.values():
            sight.step_camera()

    def wait_idle(self, *, timeout_s: float) -> bool:
        """Waits until all that was asked for so far is on its way; False if it did not come to that in time."""
        done = threading.Event()
        self._enqueue(done.set)
        return done.wait(timeout_s)

    # -- how -----------------------------------------------------------------------------------------------------------

    def _enqueue(self, action: Callable[[], None]) -> None:
        self._queue.put(action)

    def _request(self, setting: str | None, action: Callable[[ClientView], None], client: int | None) -> None:
        def do() -> None:
            if client is not None:
                if (sight := self._views.get(client)) is not None:  # a tab may be closed at any time
                    action(sight)
                return
            if setting is not None:
                self._defaults[setting] = action
            for sight in self._views.values():
                action(sight)

        self._enqueue(do)

    def _require_bodies(self, ids: Iterable[BodyId]) -> None:
        for id in ids:
            if id not in self._appearances:
                raise BodyNotFoundError(id, world="the view", known=self._appearances)

    def _on_connect(self, client: viser.ClientHandle) -> None:
        sight = self._views[client.client_id] = ClientView(client, on_place=self._on_place, enqueue=self._enqueue)
        if self._poses is not None:
            sight.set_bodies(self._appearances, self._names, self._ids, self._poses)
        if self._target is not None:
            sight.set_target(self._target)
        for what in self._defaults.values():
            what(sight)

    def _on_disconnect(self, client: viser.ClientHandle) -> None:
        self._views.pop(client.client_id, None)

    def _notify(self, visitor: int) -> None:
        for listener in self._listeners:
            try:
                listener(visitor)
            except Exception:
                _log.exception("nobody could be told of a selection")
