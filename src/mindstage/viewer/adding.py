"""Adding bodies from the page: the catalog of classes, and bodies that are dragged into the view."""

from __future__ import annotations

import base64
import time
from typing import Annotated

import msgspec
import numpy as np

from mindstage.access.limits import SURFACES
from mindstage.access.policies import EDIT, READ
from mindstage.errors import InvalidArgumentError, NoFreePlacementError, SpawnRefusedError
from mindstage.knowledge.names import EntityType
from mindstage.rendering.appearance import compute_appearance
from mindstage.scene import Body, BodyGeometry, BodyId, Iri, Pose, Vector, VisualMesh, World
from mindstage.simulation import Simulation
from mindstage.simulation.placement import FreePlaces, make_body, place_body
from mindstage.viewer.class_catalog import AddableClass, ClassCatalog
from mindstage.viewer.client_views import Ghost
from mindstage.viewer.server import ClientSession, EmptyRequest, RpcChannel
from mindstage.viewer.view_tools import PickResult, Pointer, PointerPicker, SessionViews

__all__ = ["AddHandler"]

_Meters = Annotated[float, msgspec.Meta(ge=-10_000.0, le=10_000.0)]
_Extent = Annotated[float, msgspec.Meta(ge=0.001, le=1000.0)]
_Size = tuple[_Extent, _Extent, _Extent]
_ClassName = Annotated[str, msgspec.Meta(min_length=1, max_length=2000)]
_CLEARANCE_M = 0.002
_MAX_HOVER_DISTANCE_M = 0.6
"""A free place that is farther from the pointer is not what was meant."""
_OFFERED_S = 5.0
"""How long the place of the last preview is used for the drop."""


class FindClassesRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `find_classes`: words of names, labels or synonyms, and a category."""

    text: Annotated[str, msgspec.Meta(max_length=200)] = ""
    category: Annotated[str, msgspec.Meta(max_length=100)] = ""


class ThumbnailRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `thumbnail`."""

    cls: _ClassName


class AddRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `add`: adds a body of a class."""

    cls: _ClassName
    on: BodyId | None = None
    """The body that it is placed on."""
    into: BodyId | None = None
    """The body that it is placed in."""
    position: tuple[_Meters, _Meters, _Meters] | None = None
    """Center of its lower side [m], without `on` and `into`; by default near the point that the camera looks at."""
    size: _Size | None = None


class HoverRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `hover` and `drop`: a class that is dragged to a point of the view."""

    cls: _ClassName
    pointer: Pointer
    size: _Size | None = None


class Offer(msgspec.Struct, frozen=True, kw_only=True):
    """Where a dragged body would be placed; the result of `hover`."""

    on: BodyId | None = None
    """The body that it would be on or in; None if it cannot be placed."""
    reason: str = ""
    """Why not."""


class _Place(msgspec.Struct, frozen=True, kw_only=True):
    pose: Pose
    offer: Offer
    point: Vector


class _Dragged(msgspec.Struct, frozen=True, eq=False):
    """A class that a page drags."""

    key: str
    body: Body
    geometry: BodyGeometry | None
    visuals: tuple[VisualMesh, ...]


class AddHandler:
    """Handles the requests of the Add panel."""

    def __init__(
        self, simulation: Simulation, channel: RpcChannel, session_views: SessionViews, picker: PointerPicker
    ) -> None:
        """Registers the requests.

        Args:
            channel: the channel of the pages.
            session_views: the views of pages.
            picker: finds what is at the pointer.
        """
        self._simulation, self._session_views, self._picker = simulation, session_views, picker
        self._catalog = ClassCatalog(simulation)
        channel.register("find_classes", FindClassesRequest, self._find, READ, queue="catalog")
        channel.register(
            "class_categories", EmptyRequest, lambda _, __: self._catalog.categories, READ, queue="catalog"
        )
        channel.register("thumbnail", ThumbnailRequest, self._thumbnail, READ, queue="thumbnails")
        channel.register("add", AddRequest, self._add, EDIT)
        channel.register("hover", HoverRequest, self._hover, READ, queue="pick")
        channel.register("end_hover", EmptyRequest, self._end_hover, READ, queue="pick")
        channel.register("drop", HoverRequest, self._drop, EDIT, queue="pick")

    # -- the catalog ---------------------------------------------------------------------------------------------------

    def _find(self, _: ClientSession, request: FindClassesRequest) -> list[AddableClass]:
        return self._catalog.find(request.text, request.category)

    def _thumbnail(self, _: ClientSession, request: ThumbnailRequest) -> str:
        """A PNG file in base64; empty if there is none."""
        return base64.b64encode(self._catalog.thumbnail(self._class(request.cls))).decode()

    def _class(self, name: str) -> Iri:
        knowledge = self._simulation.knowledge
        with knowledge.lock:
            return knowledge.names.find(name, EntityType.CLASS)

    # -- adding --------------------------------------------------------------------------------------------------------

    def _add(self, session: ClientSession, request: AddRequest) -> BodyId:
        body = make_body(self._simulation, self._class(request.cls), size=request.size)
        if request.on is not None or request.into is not None:
            return self._simulation.place(body, on=request.on, into=request.into, title=f"{body.id} added").id
        if request.position is None and (placed_id := self._add_in_view(session, body)) is not None:
            return placed_id
        x, y, z = request.position or self._view_center(session)
        height = body.size[2] if body.size else 0.0
        self._spawn(msgspec.structs.replace(body, pose=Pose((x, y, z + height / 2 + _CLEARANCE_M))))
        return body.id

    def _view_center(self, session: ClientSession) -> Vector:
        """The point that the camera looks at; the origin if no view is connected."""
        try:
            x, y, z = self._session_views.camera(session).look_at.tolist()
        except InvalidArgumentError:
            return 0.0, 0.0, 0.0
        return x, y, z

    def _add_in_view(self, session: ClientSession, body: Body) -> BodyId | None:
        """Adds a body near the center of the view; None if no view is connected or nothing is in its center."""
        try:
            place = self._place_at(session, self._dragged(session, body.cls, body.size), (0.0, 0.0))
        except (InvalidArgumentError, NoFreePlacementError):
            return None
        if place is None or place.offer.on is None:
            return None
        return self._put(body, place)

    def _spawn(self, body: Body) -> None:
        first = next(iter(self._simulation.worlds), None)
        iri, name = (first.iri, first.name) if first else (Iri("http://mindstage.org/maps/new.owl#map"), "new")
        world = World(iri=iri, name=name, bodies=(body,))
        try:
            self._simulation.spawn(world, persistent=False, title=f"{body.id} added")
        except SpawnRefusedError as error:
            raise InvalidArgumentError(error.id, cause=error.reason) from error

    # -- dragging into the view ----------------------------------------------------------------------------------------

    def _hover(self, session: ClientSession, request: HoverRequest) -> Offer:
        """Shows where a body would be placed, as a ghost."""
        dragged = self._dragged(session, self._class(request.cls), request.size)
        place = self._place_at(session, dragged, request.pointer)
        session.state[_OFFER] = (time.monotonic(), request, place)
        ghost = None
        if place is not None:
            is_free = place.offer.on is not None
            ghost = Ghost(key=dragged.key, visuals=dragged.visuals, pose=place.pose, is_free=is_free)
        self._show(session, ghost)
        return place.offer if place is not None else Offer(reason="there is nothing at the pointer")

    def _end_hover(self, session: ClientSession, _: EmptyRequest) -> None:
        session.state.pop(_OFFER, None)
        self._show(session, None)

    def _drop(self, session: ClientSession, request: HoverRequest) -> BodyId:
        """Adds a body where its ghost is.

        Raises:
            NoFreePlacementError: it cannot be placed there.
        """
        offered_at, offered, place = session.state.pop(_OFFER, (0.0, None, None))
        self._show(session, None)
        cls = self._class(request.cls)
        if offered != request or time.monotonic() - offered_at > _OFFERED_S:
            place = self._place_at(session, self._dragged(session, cls, request.size), request.pointer)
        body = make_body(self._simulation, cls, size=request.size)
        if place is None or place.offer.on is None:
            reason = place.offer.reason if place is not None else "there is nothing"
            raise NoFreePlacementError(body.id, "at the pointer", reason=reason)
        return self._put(body, place)

    def _put(self, body: Body, place: _Place) -> BodyId:
        geometry, on = self._simulation.fit_geometry(body), place.offer.on
        assert on is not None
        title = f"{body.id} added"
        return place_body(
            self._simulation, body, geometry, support_id=on, inside=None, near=place.point, title=title
        ).id

    def _show(self, session: ClientSession, ghost: Ghost | None) -> None:
        for view in self._session_views.of(session):
            self._session_views.views.show_ghost(ghost, client=view)

    def _dragged(self, session: ClientSession, cls: Iri, size: Vector | None) -> _Dragged:
        """The meshes of a class; those of the last one are kept."""
        key = f"{cls} {size}"
        kept: _Dragged | None = session.state.get(_DRAGGED)
        if kept is None or kept.key != key:
            knowledge = self._simulation.knowledge
            body = make_body(self._simulation, cls, id="_dragged", size=size)
            geometry = self._simulation.fit_geometry(body)
            known = {} if geometry is None else {body.id: geometry}
            world = World(iri=body.iri, bodies=(body,))
            drawn = compute_appearance(world, knowledge.shape_rule, knowledge.ancestors, geometry=known)[body.id]
            kept = _Dragged(key, body, geometry, drawn.whole_visuals or drawn.visuals)
            session.state[_DRAGGED] = kept
        return kept

    def _place_at(self, session: ClientSession, dragged: _Dragged, pointer: Pointer) -> _Place | None:
        """The free place nearest to the pointer, without a support if there is none; None if nothing is there."""
        origin, direction = self._session_views.ray(session, pointer)
        height, culled = self._session_views.clip_height(session), self._session_views.culled(session)
        picked = self._picker.pick(origin, direction, clip_height=height, culled=culled)
        if picked is None:
            return None
        places = FreePlaces(self._simulation)
        reasons: list[str] = []
        for target in self._targets(picked, direction):
            for surface in places.surfaces(target.id, inside=None, near=target.point)[: SURFACES.count]:
                if surface.distance(target.point) > _MAX_HOVER_DISTANCE_M:
                    continue
                poses, reason = places.sampler.candidate_poses(
                    dragged.body, dragged.geometry, surface, near=target.point
                )
                if reason:
                    reasons.append(reason)
                for pose in poses[:1]:
                    if np.linalg.norm(np.subtract(pose.position, target.point)[:2]) <= _MAX_HOVER_DISTANCE_M:
                        return _Place(pose=pose, offer=Offer(on=target.id), point=target.point)
                    reasons.append("the next free place is too far away")
        x, y, z = picked.point
        height = dragged.body.size[2] if dragged.body.size else 0.1
        reason = reasons[0] if reasons else f"{picked.id} has no level surface there"
        return _Place(pose=Pose((x, y, z + height / 2)), offer=Offer(reason=reason), point=picked.point)

    def _targets(self, picked: PickResult, direction: np.ndarray) -> list[PickResult]:
        """What was picked, and what is below that point, slightly before the surface that was met."""
        x, y, z = (np.asarray(picked.point) - 0.05 * direction).tolist()
        below = self._picker.below((x, y, z))
        return [picked] if below is None or below.id == picked.id else [picked, below]


_OFFER, _DRAGGED = "offered place", "dragged class"
"""Keys of the `state` of a session."""
