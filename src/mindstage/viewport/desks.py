"""Desks: everything that pages ask for, and are told, in one place."""

from __future__ import annotations

from collections.abc import Container

import viser

from mindstage.stage import Simulation, StateSnapshot
from mindstage.viewport.asking import AskHandler
from mindstage.viewport.channel import RpcChannel
from mindstage.viewport.editdesk import EditHandler
from mindstage.viewport.filedesk import FileHandler
from mindstage.viewport.sights import ClientViews
from mindstage.viewport.status import StatusHandler
from mindstage.viewport.viewdesk import ViewHandler
from mindstage.viewport.visitor import ClientSession
from mindstage.viewport.worlddesk import WorldHandler
from mindstage.world import BodyId, World

__all__ = ["Handlers"]


class Handlers:
    """One desk for each kind of request."""

    def __init__(
        self, simulation: Simulation, channel: RpcChannel, views: ClientViews, server: viser.ViserServer
    ) -> None:
        """Offers all that a page can ask for.

        Args:
            stage: whose world it is about.
            channel: to the pages.
            sights: the views in them.
            server: that serves both.
        """
        self._channel = channel
        self._world = WorldHandler(simulation, channel)
        self._views = ViewHandler(views, channel, server)
        self._edits = EditHandler(simulation, channel, self._world, view_center=self._views.view_center)
        self._files = FileHandler(simulation, channel)
        self._asking = AskHandler(simulation, channel)
        self._status = StatusHandler(simulation, channel)

    def session_of_view(self, view: int) -> ClientSession | None:
        """Who sees a view; None where somebody opened a view by itself."""
        return self._views.session_of_view(view)

    def toast(self, view: int, text: str, *, kind: str = "error") -> None:
        """Shows a sentence to the visitor of a view."""
        if (visitor := self.session_of_view(view)) is not None:
            visitor.send_event("toast", {"text": text, "kind": kind})

    # -- for the thread that follows the world -------------------------------------------------------------------------

    def on_rebuild(self, world: World, *, enclosing: Container[BodyId]) -> None:
        """Something came, went or changed."""
        self._world.on_rebuild(world, enclosing=enclosing)
        self._views.publish()

    def publish(self, frame: StateSnapshot) -> None:
        """Tells what changes all the time; called some times in a second."""
        self._world.publish(frame)
        self._edits.publish(frame)
        self._asking.publish(frame)
        self._status.publish(frame)

    def show_error(self, text: str) -> None:
        """Says what is wrong with the page itself; nothing, where all is well again."""
        self._channel.publish("viewer_error", text)
