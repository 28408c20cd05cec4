"""View desk: what a visitor wants to see, told by the page, done in the view that the page holds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import msgspec
import viser

from mindstage.errors import BodyNotFoundError
from mindstage.viewport.channel import RpcChannel
from mindstage.viewport.server import session_key_of
from mindstage.viewport.sights import ClientViews, GizmoMode, LabelMode
from mindstage.viewport.visitor import ClientSession
from mindstage.viewport.worlddesk import SELECTED, EmptyRequest
from mindstage.world import BodyId, Vector

__all__ = ["ViewHandler"]


class SelectRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Selects a body, or nothing, and flies to it if asked."""

    id: BodyId | None = None
    focus: bool = False


class FocusRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Flies to bodies; to the whole place without any."""

    ids: tuple[BodyId, ...] = ()


class ClipPlaneRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Hides what is above a height."""

    height: Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)] | None = None


class LabelRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Writes names beside bodies."""

    mode: LabelMode


class GizmoRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Gives the selected body handles."""

    mode: GizmoMode | None = None


class SetVisibilityRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Hides bodies, or shows them again, for all visitors."""

    ids: tuple[BodyId, ...]
    shown: bool


class ShowEnclosuresRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Draws the outlines of what encloses the place, or not, for all visitors."""

    shown: bool


class ViewHandler:
    """Brings each page and the view in it together; they find one another by the visitor's key."""

    def __init__(self, views: ClientViews, channel: RpcChannel, server: viser.ViserServer) -> None:
        """Offers what it does.

        Args:
            sights: all views.
            channel: to the pages.
            server: that serves both.
        """
        self._views, self._channel, self._server = views, channel, server
        channel.register("select", SelectRequest, self._select, queue="look")
        channel.register(
            "focus",
            FocusRequest,
            self._view_handler(lambda view, wish: views.focus(wish.ids, client=view)),
            queue="look",
        )
        channel.register(
            "reset_camera",
            EmptyRequest,
            self._view_handler(lambda view, wish: views.go_home(client=view)),
            queue="look",
        )
        channel.register(
            "view_from_top",
            EmptyRequest,
            self._view_handler(lambda view, wish: views.go_top(client=view)),
            queue="look",
        )
        section = self._view_handler(lambda view, wish: views.set_clip_height(wish.height, client=view))
        channel.register("set_clipping_height", ClipPlaneRequest, section, queue="look")
        channel.register(
            "set_labels",
            LabelRequest,
            self._view_handler(lambda view, wish: views.set_labels(wish.mode, client=view)),
            queue="look",
        )
        channel.register(
            "set_gizmo",
            GizmoRequest,
            self._view_handler(lambda view, wish: views.set_gizmo(wish.mode, client=view)),
            queue="look",
        )
        channel.register("set_visible", SetVisibilityRequest, self._show_bodies, queue="look")
        channel.register("show_enclosures", ShowEnclosuresRequest, self._show_enclosures, queue="look")
        views.on_change(self._on_view_selection)
        self.publish()

    def session_of_view(self, view: int) -> ClientSession | None:
        """Who sees a view."""
        return self._channel.session(self._key_of(view))

    def view_center(self, session: ClientSession) -> Vector | None:
        """What a visitor looks at; None where the view is not there yet."""
        for view in self._view_of(session):
            client = self._server.get_clients().get(view)
            if client is not None:
                x, y, z = client.camera.look_at.tolist()
                return x, y, z
        return None

    def _key_of(self, view: int) -> str | None:
        client = self._server.get_clients().get(view)
        return session_key_of(client, self._server) if client is not None else None

    def publish(self) -> None:
        """Tells all what nobody sees."""
        hidden = tuple(sorted(self._views.hidden))
        self._channel.publish("visibility", {"hidden": hidden, "enclosures": self._views.enclosures_shown})

    # -- what the page asks --------------------------------------------------------------------------------------------

    def _view_of(self, visitor: ClientSession) -> list[int]:
        return [view for view in self._views.clients if self._key_of(view) == visitor.key]

    def _view_handler(self, action: Callable[[int, Any], None]) -> Callable[[ClientSession, Any], None]:
        def handle(visitor: ClientSession, wish: Any) -> None:
            for view in self._view_of(visitor):
                action(view, wish)

        return handle

    def _select(self, session: ClientSession, request: SelectRequest) -> None:
        before, session.state[SELECTED] = session.state.get(SELECTED), request.id
        try:
            for view in self._view_of(session):
                self._views.select(request.id, client=view)
                if request.focus and request.id is not None:
                    self._views.focus([request.id], client=view)
        except BodyNotFoundError:
            session.state[SELECTED] = before
            raise

    def _show_bodies(self, _: ClientSession, request: SetVisibilityRequest) -> None:
        self._views.show_bodies(request.ids, request.shown)
        self.publish()

    def _show_enclosures(self, _: ClientSession, request: ShowEnclosuresRequest) -> None:
        self._views.show_enclosures(request.shown)
        self.publish()

    # -- what happens in the view --------------------------------------------------------------------------------------

    def _on_view_selection(self, view: int) -> None:
        visitor, chosen = self.session_of_view(view), self._views.selected(view)
        # What the page itself selected it knows already.
        if visitor is not None and visitor.state.get(SELECTED) != chosen:
            visitor.state[SELECTED] = chosen
            visitor.send_event("selected", chosen)
