"""Desks: everything that pages ask for, and are told, in one place."""

from __future__ import annotations

from collections.abc import Container

import viser

from mindstage.stage import Frame, Stage
from mindstage.viewport.asking import AskDesk
from mindstage.viewport.channel import Channel
from mindstage.viewport.editdesk import EditDesk
from mindstage.viewport.filedesk import FileDesk
from mindstage.viewport.sights import Sights
from mindstage.viewport.status import StatusDesk
from mindstage.viewport.viewdesk import ViewDesk
from mindstage.viewport.visitor import Visitor
from mindstage.viewport.worlddesk import WorldDesk
from mindstage.world import BodyId, World

__all__ = ["Desks"]


class Desks:
    """One desk for each kind of request."""

    def __init__(self, stage: Stage, channel: Channel, sights: Sights, server: viser.ViserServer) -> None:
        """Offers all that a page can ask for.

        Args:
            stage: whose world it is about.
            channel: to the pages.
            sights: the views in them.
            server: that serves both.
        """
        self._channel = channel
        self._world = WorldDesk(stage, channel)
        self._views = ViewDesk(sights, channel, server)
        self._edits = EditDesk(stage, channel, self._world, aim=self._views.aim)
        self._files = FileDesk(stage, channel)
        self._asking = AskDesk(stage, channel)
        self._status = StatusDesk(stage, channel)

    def visitor(self, view: int) -> Visitor | None:
        """Who sees a view; None where somebody opened a view by itself."""
        return self._views.visitor(view)

    def toast(self, view: int, text: str, *, kind: str = "error") -> None:
        """Shows a sentence to the visitor of a view."""
        if (visitor := self.visitor(view)) is not None:
            visitor.tell("toast", {"text": text, "kind": kind})

    # -- for the thread that follows the world -------------------------------------------------------------------------

    def rebuilt(self, world: World, *, shells: Container[BodyId]) -> None:
        """Something came, went or changed."""
        self._world.rebuilt(world, shells=shells)
        self._views.tell()

    def tell(self, frame: Frame) -> None:
        """Tells what changes all the time; called some times in a second."""
        self._world.tell(frame)
        self._edits.tell(frame)
        self._asking.tell(frame)
        self._status.tell(frame)

    def say_fault(self, text: str) -> None:
        """Says what is wrong with the page itself; nothing, where all is well again."""
        self._channel.publish("viewer_error", text)
