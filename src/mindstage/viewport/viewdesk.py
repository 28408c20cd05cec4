"""View desk: what a visitor wants to see, told by the page, done in the view that the page holds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import msgspec
import viser

from mindstage.errors import BodyUnknown
from mindstage.viewport.channel import Channel
from mindstage.viewport.server import key_of
from mindstage.viewport.sights import GizmoMode, Labels, Sights
from mindstage.viewport.visitor import Visitor
from mindstage.viewport.worlddesk import SELECTED, Nothing
from mindstage.world import BodyId, Vector

__all__ = ["ViewDesk"]


class Select(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Selects a body, or nothing, and flies to it if asked."""

    id: BodyId | None = None
    focus: bool = False


class Focus(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Flies to bodies; to the whole place without any."""

    ids: tuple[BodyId, ...] = ()


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Hides what is above a height."""

    height: Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)] | None = None


class Label(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Writes names beside bodies."""

    mode: Labels


class Gizmo(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Gives the selected body handles."""

    mode: GizmoMode | None = None


class ShowBodies(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Hides bodies, or shows them again, for all visitors."""

    ids: tuple[BodyId, ...]
    shown: bool


class ShowShells(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Draws the outlines of what encloses the place, or not, for all visitors."""

    shown: bool


class ViewDesk:
    """Brings each page and the view in it together; they find one another by the visitor's key."""

    def __init__(self, sights: Sights, channel: Channel, server: viser.ViserServer) -> None:
        """Offers what it does.

        Args:
            sights: all views.
            channel: to the pages.
            server: that serves both.
        """
        self._sights, self._channel, self._server = sights, channel, server
        channel.offer("select", Select, self._select, lane="look")
        channel.offer(
            "focus", Focus, self._in_view(lambda view, wish: sights.focus(wish.ids, visitor=view)), lane="look"
        )
        channel.offer("reset_camera", Nothing, self._in_view(lambda view, wish: sights.home(visitor=view)), lane="look")
        channel.offer("view_from_top", Nothing, self._in_view(lambda view, wish: sights.top(visitor=view)), lane="look")
        section = self._in_view(lambda view, wish: sights.section(wish.height, visitor=view))
        channel.offer("set_clipping_height", Section, section, lane="look")
        channel.offer(
            "set_labels", Label, self._in_view(lambda view, wish: sights.label(wish.mode, visitor=view)), lane="look"
        )
        channel.offer(
            "set_gizmo", Gizmo, self._in_view(lambda view, wish: sights.gizmo(wish.mode, visitor=view)), lane="look"
        )
        channel.offer("set_visible", ShowBodies, self._show_bodies, lane="look")
        channel.offer("show_enclosures", ShowShells, self._show_shells, lane="look")
        sights.on_change(self._chosen_in_view)
        self.tell()

    def visitor(self, view: int) -> Visitor | None:
        """Who sees a view."""
        return self._channel.visitor(self._key_of(view))

    def aim(self, visitor: Visitor) -> Vector | None:
        """What a visitor looks at; None where the view is not there yet."""
        for view in self._views(visitor):
            client = self._server.get_clients().get(view)
            if client is not None:
                x, y, z = client.camera.look_at.tolist()
                return x, y, z
        return None

    def _key_of(self, view: int) -> str | None:
        client = self._server.get_clients().get(view)
        return key_of(client, self._server) if client is not None else None

    def tell(self) -> None:
        """Tells all what nobody sees."""
        hidden = tuple(sorted(self._sights.hidden))
        self._channel.publish("visibility", {"hidden": hidden, "enclosures": self._sights.shells_shown})

    # -- what the page asks --------------------------------------------------------------------------------------------

    def _views(self, visitor: Visitor) -> list[int]:
        return [view for view in self._sights.visitors if self._key_of(view) == visitor.key]

    def _in_view(self, do: Callable[[int, Any], None]) -> Callable[[Visitor, Any], None]:
        def handle(visitor: Visitor, wish: Any) -> None:
            for view in self._views(visitor):
                do(view, wish)

        return handle

    def _select(self, visitor: Visitor, wish: Select) -> None:
        before, visitor.state[SELECTED] = visitor.state.get(SELECTED), wish.id
        try:
            for view in self._views(visitor):
                self._sights.select(wish.id, visitor=view)
                if wish.focus and wish.id is not None:
                    self._sights.focus([wish.id], visitor=view)
        except BodyUnknown:
            visitor.state[SELECTED] = before
            raise

    def _show_bodies(self, _: Visitor, wish: ShowBodies) -> None:
        self._sights.show_bodies(wish.ids, wish.shown)
        self.tell()

    def _show_shells(self, _: Visitor, wish: ShowShells) -> None:
        self._sights.show_shells(wish.shown)
        self.tell()

    # -- what happens in the view --------------------------------------------------------------------------------------

    def _chosen_in_view(self, view: int) -> None:
        visitor, chosen = self.visitor(view), self._sights.selected(view)
        # What the page itself selected it knows already.
        if visitor is not None and visitor.state.get(SELECTED) != chosen:
            visitor.state[SELECTED] = chosen
            visitor.tell("selected", chosen)
