"""Viewport: the page on which one sees a stage's world and reaches into it."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection, Iterable
from functools import wraps
from html import escape
from typing import Any

import msgspec
import viser

from mindstage.errors import MindstageError
from mindstage.stage import Frame, NoteKind, Stage
from mindstage.viewport.bodies import Clickable, Pick
from mindstage.viewport.channel import Channel
from mindstage.viewport.desks import Desks
from mindstage.viewport.framing import first_outlook, ground_height
from mindstage.viewport.hands import Hands
from mindstage.viewport.looks import decide_looks, find_outlines
from mindstage.viewport.markers import MarkerScene
from mindstage.viewport.palette import local_name
from mindstage.viewport.photograph import Photographer, Shot
from mindstage.viewport.scene import Scene
from mindstage.viewport.server import address, serve, shut_down
from mindstage.viewport.sights import Sights
from mindstage.world import BodyId, Iri, Physics, Pose, World

__all__ = ["Viewport"]

_PERIOD_S = 1 / 30
_WORDS_PERIOD_S = 0.1
"""Words change more slowly than things: nobody can read faster."""
_RETRY_S = 1.0
"""After a fault the page waits so long before it tries again."""
_PAUSED = "The simulation is paused: press Play to pull bodies."

_log = logging.getLogger(__name__)


class Viewport:
    """Serves a page for any number of visitors, in a thread of its own.

    It only reads the frames that the stage publishes, so that visitors neither stop nor slow the world. The bodies
    that they pull, and the buttons they press, go to the stage like anybody's calls.
    """

    def __init__(
        self,
        stage: Stage,
        *,
        host: str = "127.0.0.1",
        port: int = 8080,
        token: str | None = None,
        origins: Collection[str] = (),
    ) -> None:
        """Opens the page at once, whether or not the stage has a world yet.

        Args:
            stage: what is shown; not closed together with the viewport.
            host: 127.0.0.1 is this machine only. Whoever reaches the page may do all that it offers.
            port: where that one is taken, the next free one is used; 0 lets the system choose.
            token: what visitors must know; others than this machine's own need one.
            origins: addresses under which the page may be opened beside its own, such as `https://robot.example`.

        Raises:
            AccessRefused: others could reach it, and there is no token.
            ViewportUnavailable: nothing can be served there.
        """
        self._stage = stage
        self.channel = Channel()
        """What the page and we tell one another."""
        self._token = token
        self._server = serve(host, port, title="Mindstage", channel=self.channel, token=token, origins=origins)
        self._hands = Hands(stage)
        self._scene = Scene(self._server, prepare=self._prepare)
        self.sights = Sights(self._server, place=self._put)
        """What each visitor sees, and wants to see."""
        self._markers = MarkerScene(self._server)
        self._desks = Desks(stage, self.channel, self.sights, self._server)
        self._frame: Frame | None = None
        self._described: World | None = None
        self._framed: Iri | None = None
        """The world that visitors' first view was chosen for."""
        self._words_due = 0.0
        self._reported: set[str] = set()
        self._closing = threading.Event()
        self._stirred = threading.Event()
        """Set where it is worth looking at once, not only at the next picture."""
        self._farewell = stage.company.watch(self._stirred.set)
        self._thread = threading.Thread(target=self._watch, name="mindstage-viewport", daemon=True)
        self._thread.start()

    # -- for whoever opened it -------------------------------------------------------------------------------

    @property
    def url(self) -> str:
        """What to type into a browser."""
        return address(self._server)

    def select(self, id: BodyId | None) -> None:
        """Draws a frame round a body for all visitors, also for those who come later; None round none.

        Raises:
            BodyUnknown: there is no such body.
        """
        self.sights.select(id)

    def shot(self, shot: Shot | None = None) -> bytes:
        """A picture of the page or of the world alone, as PNG: `viewport.shot(Shot(size=(800, 600), section=1.8))`.

        Raises:
            BrowserUnavailable: no browser is found here, or it does not start.
            BrowserBroken: it ended, or the picture was not finished in time.
            BodyUnknown: a body that shall be seen is not there.
        """
        return Photographer(self._server, self.sights, token=self._token).take(shot or Shot())

    def close(self) -> None:
        """Ends the page; any number of times. The stage lives on."""
        if self._closing.is_set():
            return
        self._closing.set()
        self._farewell()
        self._stirred.set()
        self._thread.join()
        self._hands.let_go_of_all()
        shut_down(self._server)
        self.channel.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {'closed' if self._closing.is_set() else self.url}>"

    def _repr_html_(self) -> str:
        """A link for notebooks."""
        address = escape("" if self._closing.is_set() else self.url, quote=True)
        return f'<a href="{address}" target="_blank">{address}</a>' if address else escape(repr(self))

    def __enter__(self) -> Viewport:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- following the world ---------------------------------------------------------------------------------

    def _watch(self) -> None:
        while not self._closing.is_set():
            self._stirred.clear()
            start = time.monotonic()
            try:
                self._follow()
            except Exception as error:  # whatever it is, the page goes on and says so
                self._desks.say_fault(self._report(error))
                self._closing.wait(_RETRY_S)
            else:
                self._desks.say_fault("")
                took = time.monotonic() - start
                # At least half of the time is left to the world's own thread, however much moves or is edited.
                self._closing.wait(took)
                self._stirred.wait(max(0.0, _PERIOD_S - 2 * took))

    def _follow(self) -> None:
        before, frame = self._frame, self._stage.frame
        if before is None or frame.edition != before.edition or frame.ids is not before.ids:
            self._rebuild(frame)
        elif frame is not before:
            self._move(frame)
        if before is None or frame.highlights != before.highlights:
            self._scene.light_up(frame.highlights)
        if before is None or frame.markers is not before.markers or frame.edition != before.edition:
            self._markers.show(frame.markers, self._scene.looks)
        self._frame = frame
        self._scene.hide(self.sights.hidden)
        self._scene.show_shells(self.sights.shells_shown)
        self.sights.turn()
        if time.monotonic() >= self._words_due:
            self._words_due = time.monotonic() + _WORDS_PERIOD_S
            self._desks.tell(frame)

    def _rebuild(self, frame: Frame) -> None:
        """Something came, went or changed."""
        described = _as_described(self._stage.log(), self._stage.worlds)
        if described == self._described and self._frame is not None and frame.ids is self._frame.ids:
            self._move(frame)
            return
        shells = {id for report in self._stage.reports for id in report.noted(NoteKind.SHELL)}
        # Words first: they are there long before the picture is drawn.
        self._desks.rebuilt(described, shells=find_outlines(described, forms=self._stage.forms, shells=shells))
        before = self._described
        if before is None or frame.ids is not self._scene.ids or _as_seen(described) != _as_seen(before):
            self._draw(frame, described, shells)
        else:
            self._move(frame)
        self._described = described

    def _draw(self, frame: Frame, described: World, shells: Collection[BodyId]) -> None:
        """Shows a world that looks other than before."""
        knowledge = self._stage.knowledge
        looks = decide_looks(
            described, knowledge.shape_rule, knowledge.ancestors, forms=self._stage.forms, shells=shells
        )
        # What came after this frame has no pose in it yet; the next frame will bring it.
        looks = {id: looks[id] for id in frame.ids if id in looks}
        self._hands.learn(described)
        self._scene.show(looks, frame.ids, frame.poses, holdable=self._hands.holdable)
        self._scene.lay_ground(ground_height(described, looks))
        names = {body.id: body.label or local_name(body.cls) for body in described.bodies}
        self.sights.know(looks, names, frame.ids, frame.poses)
        if not looks:
            self._framed = None
        elif self._framed != described.iri:
            outlook = first_outlook(described, looks)
            self._scene.start_from(outlook.view())
            self.sights.open_on(outlook)
            self._framed = described.iri

    def _move(self, frame: Frame) -> None:
        if len(self._scene.move(frame.poses)):
            self.sights.follow(frame.poses)

    # -- following the visitors ------------------------------------------------------------------------------

    def _prepare(self, node: Clickable, pick: Pick, *, holdable: bool) -> None:
        """Makes a node that was just drawn answer to the mouse."""
        node.on_click(self._guarded(lambda event: self._click(pick(event.instance_index), event.client_id)))
        if holdable:
            drag = self._guarded(lambda event: self._drag(pick(event.instance_index), event))

            # viser keeps the order of what happened for coroutines only.
            async def on_drag(event: viser.SceneNodeDragEvent[Any]) -> None:
                drag(event)

            node.on_drag("left")(on_drag)

    def _click(self, id: BodyId | None, visitor: int) -> None:
        """Who clicks on what is selected selects nothing."""
        self.sights.select(None if self.sights.selected(visitor) == id else id, visitor=visitor)

    def _put(self, visitor: int, id: BodyId, pose: Pose) -> None:
        """A visitor has put a body somewhere."""
        try:
            self._stage.editing.move(id, pose)
        except MindstageError as error:
            self._desks.toast(visitor, str(error))

    def _drag(self, id: BodyId | None, event: viser.SceneNodeDragEvent[Any]) -> None:
        match event.phase:
            case "start" if id is not None:
                self._hands.take(event.client_id, id, event.start_position)
                if not self._stage.frame.playing:
                    self._desks.toast(event.client_id, _PAUSED, kind="info")
            case "update":
                x, y, z = event.client.camera.position.tolist()
                self._hands.pull(event.client_id, event.end_position, (x, y, z))
            case "end":
                self._hands.let_go(event.client_id)

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
                self._desks.toast(event.client.client_id, text)

        return run

    def _report(self, error: Exception) -> str:
        """Says once on stderr what is wrong, and gives it in words."""
        text = str(error) if isinstance(error, MindstageError) else f"{type(error).__name__}: {error}"
        if text not in self._reported:
            self._reported.add(text)
            _log.error("the viewport has a fault: %s", text, exc_info=error)
        return text


def _as_seen(world: World) -> World:
    """The same without what nobody sees: weights, gravity, and why anything is so."""
    bodies = (
        msgspec.structs.replace(body, physics=Physics(mobility=body.physics.mobility), tags=(), facts=())
        for body in world.bodies
    )
    return msgspec.structs.replace(world, bodies=tuple(bodies), facts=())


def _as_described(now: World, worlds: Iterable[World]) -> World:
    """The world that is there, with the poses that it was described with: an open drawer is still in its cupboard."""
    given = {body.id: body.pose for world in worlds for body in world.bodies}
    bodies = (msgspec.structs.replace(body, pose=given.get(body.id, body.pose)) for body in now.bodies)
    return msgspec.structs.replace(now, bodies=tuple(bodies))
