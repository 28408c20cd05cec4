"""Viewport: the page on which one sees a stage's world and reaches into it."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any

import msgspec
import viser

from mindstage.errors import MindstageError
from mindstage.stage import Frame, NoteKind, Stage
from mindstage.viewport.details import body_html
from mindstage.viewport.framing import first_view, ground_height
from mindstage.viewport.hands import Hands
from mindstage.viewport.looks import Form, decide_looks
from mindstage.viewport.markers import MarkerScene
from mindstage.viewport.panel import Panel
from mindstage.viewport.scene import Scene
from mindstage.viewport.server import address, serve, shut_down
from mindstage.world import Body, BodyId, World

__all__ = ["Viewport"]

_PERIOD_S = 1 / 30
_WORDS_PERIOD_S = 0.2
"""Words change more slowly than things: nobody can read faster."""
_RETRY_S = 1.0
"""After a fault the page waits so long before it tries again."""
_PAUSED = "The world is paused: press Play, and it will follow your hand."

_log = logging.getLogger(__name__)


class Viewport:
    """Serves a page for any number of visitors, in a thread of its own.

    It only reads the frames that the stage publishes, so that visitors neither stop nor slow the world. The bodies
    that they pull, and the buttons they press, go to the stage like anybody's calls.
    """

    def __init__(self, stage: Stage, *, host: str = "127.0.0.1", port: int = 8080) -> None:
        """Opens the page at once, whether or not the stage has a world yet.

        Args:
            stage: what is shown; not closed together with the viewport.
            host: 127.0.0.1 is this machine only. Whoever reaches the page may do all that it offers.
            port: where that one is taken, the next free one is used; 0 lets the system choose.

        Raises:
            ViewportUnavailable: nothing can be served there.
        """
        self._stage = stage
        self._server = serve(host, port, title="Mindstage")
        self._hands = Hands(stage)
        self._scene = Scene(self._server, prepare=self._prepare)
        self._markers = MarkerScene(self._server)
        self._panel = Panel(self._server, stage, choose=self.select, show_shells=self._show_shells, guard=self._guarded)
        self._frame: Frame | None = None
        self._described: World | None = None
        self._bodies: dict[BodyId, Body] = {}
        self._holders: dict[BodyId, BodyId] = {}
        self._wanted: BodyId | None = None
        self._selected: BodyId | None = None
        self._shells_wanted = True
        self._framed = False
        self._words_due = 0.0
        self._reported: set[str] = set()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="mindstage-viewport", daemon=True)
        self._thread.start()

    # -- for whoever opened it -------------------------------------------------------------------------------

    @property
    def url(self) -> str:
        """What to type into a browser."""
        return address(self._server)

    @property
    def selected(self) -> BodyId | None:
        """The body that is named in the panel."""
        return self._selected

    def select(self, id: BodyId | None) -> None:
        """Names a body in the panel and draws a frame round it; None selects nothing."""
        self._wanted = id

    def close(self) -> None:
        """Ends the page; any number of times. The stage lives on."""
        if self._closing.is_set():
            return
        self._closing.set()
        self._thread.join()
        self._hands.let_go_of_all()
        shut_down(self._server)

    def __enter__(self) -> Viewport:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- following the world ---------------------------------------------------------------------------------

    def _watch(self) -> None:
        pause = 0.0
        while not self._closing.wait(pause):
            start = time.monotonic()
            try:
                self._follow()
            except Exception as error:  # whatever it is, the page goes on and says so
                self._panel.show_fault(self._report(error))
                pause = _RETRY_S
            else:
                self._panel.show_fault("")
                took = time.monotonic() - start
                # At least half of the time is left to the world's own thread, however much moves.
                pause = max(_PERIOD_S - took, took)

    def _follow(self) -> None:
        before, frame = self._frame, self._stage.frame
        if before is None or frame.edition != before.edition or frame.ids is not before.ids:
            self._rebuild(frame)
        elif frame is not before:
            self._scene.move(frame.poses)
        if before is None or frame.highlights != before.highlights:
            self._scene.light_up(frame.highlights)
        if before is None or frame.markers is not before.markers:
            self._markers.show(frame.markers)
        if before is None or frame.lit is not before.lit:
            self._panel.show_lit(frame.lit)
        self._frame = frame
        self._mark()
        if time.monotonic() >= self._words_due:
            self._words_due = time.monotonic() + _WORDS_PERIOD_S
            self._tell(frame)

    def _rebuild(self, frame: Frame) -> None:
        """Something came, went or changed."""
        described = _as_described(self._stage.log(), self._stage.worlds)
        if described == self._described and self._frame is not None and frame.ids is self._frame.ids:
            self._scene.move(frame.poses)
            return
        notes = [note for report in self._stage.reports for note in report.notes]
        shells = {BodyId(id) for note in notes if note.kind is NoteKind.SHELL for id in note.ids}
        looks = decide_looks(described, self._stage.knowledge.ancestors, shells=shells)
        # What came after this frame has no pose in it yet; the next frame will bring it.
        looks = {id: looks[id] for id in frame.ids if id in looks}
        self._hands.learn(described)
        self._bodies = {body.id: body for body in described.bodies}
        self._holders = {hold.child: hold.parent for hold in described.attachments}
        self._panel.know(self._bodies, has_shells=any(look.form is Form.OUTLINE for look in looks.values()))
        self._scene.show(looks, frame.ids, frame.poses, holdable=self._hands.holdable)
        self._scene.lay_ground(ground_height(described, looks))
        if looks and not self._framed:
            self._scene.look_from(first_view(described, looks))
            self._framed = True
        self._described = described

    def _mark(self) -> None:
        """What visitors want marked, done here because only this thread may touch the scene."""
        wanted = self._wanted if self._wanted in self._bodies else None
        if wanted != self._selected:
            self._selected = wanted
            self._words_due = 0.0
        self._scene.select(self._selected)
        self._scene.show_shells(self._shells_wanted)

    def _tell(self, frame: Frame) -> None:
        self._panel.show_frame(frame)
        body = self._bodies.get(self._selected) if self._selected else None
        if body is None or body.id not in frame.ids:
            self._panel.show_body("")
            return
        ancestors = tuple(self._stage.knowledge.ancestors(body.cls))
        pose = frame.poses[frame.ids.index(body.id)]
        self._panel.show_body(body_html(body, ancestors=ancestors, pose=pose, hangs_on=self._holders.get(body.id)))

    # -- following the visitors ------------------------------------------------------------------------------

    def _prepare(self, id: BodyId, node: viser.MeshHandle, *, holdable: bool) -> None:
        """Makes a body that was just drawn answer to the mouse."""
        node.on_click(self._guarded(lambda _: self.select(None if self._wanted == id else id)))
        if holdable:
            drag = self._guarded(lambda event: self._drag(id, event))

            # viser keeps the order of what happened for coroutines only.
            async def on_drag(event: viser.SceneNodeDragEvent[viser.MeshHandle]) -> None:
                drag(event)

            node.on_drag("left")(on_drag)

    def _drag(self, id: BodyId, event: viser.SceneNodeDragEvent[viser.MeshHandle]) -> None:
        match event.phase:
            case "start":
                self._hands.take(event.client_id, id, event.start_position)
                if not self._stage.frame.playing:
                    _toast(event.client, "Paused", _PAUSED)
            case "update":
                x, y, z = event.client.camera.position.tolist()
                self._hands.pull(event.client_id, event.end_position, (x, y, z))
            case "end":
                self._hands.let_go(event.client_id)

    def _show_shells(self, shown: bool) -> None:
        self._shells_wanted = shown

    def _guarded(self, react: Callable[..., None]) -> Callable[..., None]:
        """Tells the visitor why what they did did not work."""

        @wraps(react)
        def run(event: Any) -> None:
            try:
                react(event)
            except MindstageError as error:
                text = str(error)
            except Exception as error:
                text = self._report(error)
            else:
                return
            if event.client is not None:
                _toast(event.client, "That did not work", text)

        return run

    def _report(self, error: Exception) -> str:
        """Says once on stderr what is wrong, and gives it in words."""
        text = str(error) if isinstance(error, MindstageError) else f"{type(error).__name__}: {error}"
        if text not in self._reported:
            self._reported.add(text)
            _log.error("the viewport has a fault: %s", text, exc_info=error)
        return text


def _as_described(now: World, worlds: Iterable[World]) -> World:
    """The world that is there, with the poses that it was described with: an open drawer is still in its cupboard."""
    given = {body.id: body.pose for world in worlds for body in world.bodies}
    bodies = (msgspec.structs.replace(body, pose=given.get(body.id, body.pose)) for body in now.bodies)
    return msgspec.structs.replace(now, bodies=tuple(bodies))


def _toast(client: viser.ClientHandle, title: str, text: str) -> None:
    client.add_notification(title, text, auto_close_seconds=6.0)
