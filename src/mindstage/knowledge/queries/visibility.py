"""Questions that need the shapes of bodies: what is visible, what fits where, where there is room, what holds liquid.

The shapes are the collision shapes and support surfaces of the simulation; without one, bodies are bounding boxes,
which the source of each row says.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from itertools import permutations

import numpy as np

from mindstage.knowledge.claims import Claim, ClaimKind
from mindstage.knowledge.explain import individual_text, restriction_line, source_text, subclass_line
from mindstage.knowledge.owl import named_classes
from mindstage.knowledge.queries.proximity import (
    PlacedBodies,
    Viewpoint,
    missing_about,
    placed_states,
    unless_bodies_are_missing,
)
from mindstage.knowledge.queries.spatial import body_claims
from mindstage.knowledge.questions import (
    AnswerRow,
    AskedArguments,
    ClassName,
    IndividualName,
    MapName,
    MissingKnowledge,
    QuestionContext,
    StateAccess,
    question,
)
from mindstage.knowledge.reasoner_classes import ClassRestriction
from mindstage.ranges import Count
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import HAS_POSE, THING, knowrob, ms
from mindstage.scene import Body, BodyGeometry, BodyId, Iri, Pose, Vector
from mindstage.scene.placement import (
    MIN_UP_COSINE,
    FreePlace,
    PlacementSampler,
    PlacementSurface,
    spread_places,
    support_surfaces,
)
from mindstage.scene.ray_casting import ShapeScene, retained_volume
from mindstage.scene.transforms import Array, normalized_pose_array, pose_array

__all__ = [
    "FitRow",
    "FreePlaceRow",
    "LiquidBasis",
    "LiquidContainerRow",
    "PlaceRelation",
    "VisibilityRow",
    "can_hold_liquid",
    "fits",
    "free_place",
    "visible_from",
]

_CONTAINER = knowrob("Container")
_SIZE_PROPERTY = knowrob("depthOfObject")
_CONTAINER_FOR = knowrob("typePrimaryFunction-containerFor")
_LIQUIDS = (knowrob("LiquidTangibleThing"), knowrob("Drink"), knowrob("Water"), knowrob("FluidTangibleThing"))
_MIN_VOLUME_L = 0.005
"""Volume of the smallest vessel [l]."""


# -- visible from ------------------------------------------------------------------------------------------------------


class VisibilityRow(AnswerRow, frozen=True, kw_only=True):
    """A body that is visible."""

    thing: IndividualName
    share: float
    """The fraction of sample points on its surface that no other body hides, above 0 to 1."""
    hidden_by: tuple[IndividualName, ...]
    """What hides the rest, those that hide most first."""
    distance: float
    """From the viewer to the center of its box [m]."""
    map: MapName
    source: str
    """Where the poses and shapes come from: the name of the engine, or "map, bounding boxes"."""


@question(
    needs="viewer or viewer_pose: a view begins somewhere",
    sentences=(
        "what is visible from {viewer}",
        "what can be seen from {viewer}",
        "what (can|do) (i|you|robot) see from {viewer}",
        "can (i|you|robot|one) see {thing} from {viewer}",
        "is {thing} visible from {viewer}",
        "what does {viewer} see",
        "can {viewer} see {thing}",
        "from where is {thing} visible",
        "what hides {thing} from {viewer}",
        "what is visible from the position {viewer_pose}",
    ),
)
def visible_from(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    viewer: IndividualName | None = None,
    viewer_pose: str | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[VisibilityRow]:
    """Which bodies are visible from a body or a position, how much of them, and what hides the rest; the nearest first.

    Give `viewer`, a body whose center is the eye (it hides nothing itself, nor does what is attached to it), or
    `viewer_pose`, "x y z" [m]. Rays are cast from the eye to about 96 points on the surface of each body, spread over
    its collision shapes by their areas. A point is seen if the ray meets no other body before it meets this one, so
    that a body's own front never hides its back. The view is not limited to a direction. Bodies are opaque, glass
    too.

    Examples:
        visible_from plate_3 viewer_pose='0 0 1.6'
        visible_from viewer=chair_1
    """
    for bodies in placed_states(present, map):
        view = Viewpoint.find(bodies, viewer, viewer_pose)
        if view is not None and (thing is None or bodies.row_of(thing) is not None):
            for row, share, hidden_by in _views(bodies, view, viewer, thing):
                if share > 0.0:
                    apart = float(np.linalg.norm(bodies.placed.boxes.center[row] - view.position))
                    yield VisibilityRow(
                        thing=bodies.iri(row),
                        share=round(share, 6),
                        hidden_by=hidden_by,
                        distance=round(apart, 6),
                        map=bodies.map(row),
                        source=bodies.state.shape_source,
                    )


def _views(
    bodies: PlacedBodies, view: Viewpoint, viewer: Iri | None, thing: Iri | None
) -> Iterator[tuple[int, float, tuple[Iri, ...]]]:
    """The rows of bodies, how much of each is seen, and what hides the rest; the nearest first."""
    placed = bodies.placed
    scene = ShapeScene(placed.bodies, bodies.state.geometry)
    usable = bodies.comparable
    own = bodies.row_of(viewer) if viewer is not None else None
    group = bodies.group_of(own) if own is not None else frozenset()
    skipped = ~usable | np.array([body.iri in group for body in placed.bodies], dtype=bool)
    wanted = bodies.row_of(thing) if thing is not None else None
    targets = (
        np.flatnonzero(~skipped) if thing is None else np.array([wanted] if usable[wanted or 0] else [], dtype=int)
    )
    apart = np.linalg.norm(placed.boxes.center[targets] - view.position, axis=1)
    targets = targets[np.lexsort((targets, apart.round(9)))]
    for each in scene.visibility(view.position, targets.tolist(), skipped):
        yield each.row, each.share, tuple(bodies.iri(row) for row in each.hidden_by)


@visible_from.explain
def _explain_visibility(kb: QuestionContext, row: VisibilityRow) -> Iterator[str]:
    hidden = f"; the rest is hidden by {', '.join(map(local_name, row.hidden_by))}" if row.hidden_by else ""
    yield f"{row.share:.0%} of {local_name(row.thing)} is seen from {row.distance:g} m{hidden}"
    yield source_text(row.source)


@visible_from.missing
@unless_bodies_are_missing("thing", "viewer")
def _missing_visibility(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.thing is None:
        return
    for bodies in placed_states(asked.present, asked.map):
        view = Viewpoint.find(bodies, asked.viewer, asked.viewer_pose)
        if view is not None and bodies.row_of(asked.thing) is not None:
            for _, _, hidden_by in _views(bodies, view, asked.viewer, asked.thing):
                by = ", ".join(local_name(each) for each in hidden_by)
                reason = f"{individual_text(kb.reasoner, asked.thing)} is hidden by {by}"
                claims = [
                    Claim(kind=ClaimKind.HIDDEN, subject=asked.thing, object=each, other=asked.viewer, map=asked.map)
                    for each in hidden_by
                    if asked.viewer is not None
                ]
                yield missing_about(
                    kb,
                    asked.thing,
                    reason,
                    asked.viewer,
                    *hidden_by,
                    present=asked.present,
                    map=asked.map,
                    claims=claims,
                )


# -- what fits ---------------------------------------------------------------------------------------------------------


class PlaceRelation(StrEnum):
    """Where a thing is put."""

    ONTO = "onto"
    """On a support surface on top of a body."""
    INTO = "into"
    """On a support surface within a body."""


class FitRow(AnswerRow, frozen=True, kw_only=True):
    """A thing that fits on or into a body."""

    thing: IndividualName
    relation: PlaceRelation
    place: IndividualName
    margin: float
    """The smallest spare length along an axis [m]."""
    upright: bool
    """Whether it fits without being tipped over."""
    map: MapName
    """The map that `thing` is described in."""
    source: str
    """Where the shapes come from: the name of the engine, or "map, bounding boxes"."""


@question(
    needs="thing or place: all pairs of bodies are not listed",
    sentences=(
        "(does|can|would) {thing} fit {relation} {place}",
        "(what|which {thing}) fits {relation} {place}",
        "where does {thing} fit",
        "is {place} large enough for {thing} {relation=into}",
    ),
)
def fits(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    relation: PlaceRelation | None = None,
    place: IndividualName | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[FitRow]:
    """What fits on or into a body by its size, whether or not there is room now; the tightest fit last.

    `thing` or `place` must be given. The box of the thing is turned by quarter turns only. Onto: its base is within a
    level support surface on top of the place. Into: its base is within a level support surface inside, such as a shelf,
    and it is no higher than the free height above; it may be tipped over. Without shapes, the top of the bounding box
    is the only surface, and the inside of a container is its whole box, which is an upper bound.

    Examples:
        fits milk_carton_1 into fridge
        fits place=drawer_left_1
    """
    for bodies in placed_states(present, map):
        things = _given_rows(bodies, thing)
        surfaces = {row: list(_spaces(kb, bodies, row)) for row in _given_rows(bodies, place)}
        found = []
        for row in things:
            size = bodies.placed.bodies[row].size
            for other, spaces in surfaces.items():
                if other != row and size is not None:
                    found += [(row, other, *best) for best in _best_fits(size, spaces)]
        for row, other, each, margin, upright in sorted(found, key=lambda fit: (-fit[3], fit[0], fit[1], fit[2])):
            yield FitRow(
                thing=bodies.iri(row),
                relation=each,
                place=bodies.iri(other),
                margin=round(margin, 6) + 0.0,
                upright=upright,
                map=bodies.map(row),
                source=bodies.state.shape_source,
            )


def _given_rows(bodies: PlacedBodies, iri: Iri | None) -> list[int]:
    usable = bodies.comparable
    if iri is None:
        return [int(row) for row in np.flatnonzero(usable)]
    row = bodies.row_of(iri)
    return [row] if row is not None and usable[row] else []


def _spaces(kb: QuestionContext, bodies: PlacedBodies, row: int) -> Iterator[tuple[PlaceRelation, Vector]]:
    """The extents of the free spaces above and in a body; the height may be infinite."""
    body = bodies.placed.bodies[row]
    geometry = bodies.state.geometry.get(body.id)
    if geometry is None and body.size is not None:
        if kb.reasoner.is_a(body.cls, _CONTAINER):
            yield PlaceRelation.INTO, body.size
        up = np.abs(bodies.placed.boxes.rotation[row, 2])
        axis = int(np.argmax(up))
        if up[axis] >= MIN_UP_COSINE:
            one, two = (body.size[other] for other in range(3) if other != axis)
            yield PlaceRelation.ONTO, (one, two, np.inf)
        return
    pose = normalized_pose_array(body.pose)
    for relation, inside in ((PlaceRelation.ONTO, False), (PlaceRelation.INTO, True)):
        for surface in support_surfaces(body, geometry, pose, inside=inside):
            height = surface.surface.clearance
            yield relation, (*surface.size, np.inf if height is None else height)


def _best_fits(size: Vector, spaces: list[tuple[PlaceRelation, Vector]]) -> Iterator[tuple[PlaceRelation, float, bool]]:
    """For each relation the orientation with the largest margin; upright before tipped over."""
    best: dict[PlaceRelation, tuple[bool, float]] = {}
    for relation, space in spaces:
        for order in permutations(range(3)):
            upright = order[2] == 2
            margin = min(room - size[axis] for room, axis in zip(space, order, strict=True))
            if margin >= 0.0 and (upright or relation is PlaceRelation.INTO):
                best[relation] = max(best.get(relation, (False, -1.0)), (upright, float(margin)))
    for relation, (upright, margin) in best.items():
        yield relation, margin, upright


@fits.explain
def _explain_fit(kb: QuestionContext, row: FitRow) -> Iterator[str]:
    how = "upright" if row.upright else "tipped over"
    yield f"{local_name(row.thing)} fits {row.relation} {local_name(row.place)} {how}, with {row.margin:g} m to spare"
    yield source_text(row.source)


@fits.missing
@unless_bodies_are_missing("thing", "place")
def _missing_fit(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    what = local_name(asked.thing) if asked.thing is not None else "nothing"
    where = f"{asked.relation or 'onto or into'} {local_name(asked.place) if asked.place is not None else 'anything'}"
    verb = "fits" if asked.thing is None else "does not fit"
    reason = f"{what} {verb} {where}, by the known surfaces and sizes"
    if asked.thing is not None and asked.thing == asked.place:
        reason = f"{what} cannot be put onto or into itself"
    claims = body_claims((asked.thing, asked.place), asked.present.states(asked.map), asked.map)
    if asked.thing is not None and asked.place not in {None, asked.thing} and asked.relation is None:
        claims += (Claim(kind=ClaimKind.NOT_FITTING, subject=asked.thing, object=asked.place, map=asked.map),)
    yield MissingKnowledge(THING, _SIZE_PROPERTY, reason, claims=claims)


# -- free places -------------------------------------------------------------------------------------------------------


class FreePlaceRow(AnswerRow, frozen=True, kw_only=True):
    """A free pose of a thing on or in a body."""

    thing: IndividualName | None
    """None if a class was given."""
    relation: PlaceRelation
    support: IndividualName
    pose: Pose
    """The pose of the thing, 1 mm above the surface, in the map's frame."""
    margin: float
    """The horizontal distance to the nearest obstacle or edge of the surface [m]."""
    reason: str
    """Why this pose was chosen."""
    map: MapName
    """The map that `support` is described in."""
    source: str
    """Where the poses and shapes come from: the name of the engine, or "map, bounding boxes"."""


@question(
    needs="support, and thing or cls: the places for all things are not listed",
    sentences=(
        "where is [there] [free] (room|space) for {thing} [{relation} {support}]",
        "is there [free] (room|space) for {thing} {relation} {support}",
        "where can i place {thing} {relation} {support}",
        "where is [there] [free] (room|space) {relation} {support}",
        "find a free place {relation} {support}",
        "find a free place for {thing} {relation} {support}",
        "where can i place another {cls} {relation} {support}",
        "is there [free] (room|space) for another {cls} {relation} {support}",
        "where is there [free] (room|space) for another {cls} {relation} {support}",
    ),
)
def free_place(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    relation: PlaceRelation | None = None,
    support: IndividualName | None = None,
    cls: ClassName | None = None,
    count: Count | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[FreePlaceRow]:
    """Where on or in a body a thing has room now: free poses, the one with the largest margin first.

    Give `support`, and `thing`, or `cls` for a new thing of the typical size of a class. Poses are sampled on a grid
    over the level support surfaces, as for `mindstage put`, upright and turned by quarter turns; a pose is free if
    the box of the thing meets no collision shape there. The place that the thing has now counts as free. `count`
    places (1 if it is left out) do not overlap one another. Whether the thing stays there is for the physics to say.

    Examples:
        free_place milk_carton_1 onto table
        free_place support=counter_left cls=Cup count=2
    """
    if support is None:
        return
    limit = 1 if count is None else count
    for bodies in placed_states(present, map):
        item = _item(kb, bodies, thing, cls)
        row = bodies.row_of(support)
        if item is None or row is None:
            continue
        for each, place, reason in _free_places(bodies, item, row, thing, relation, limit)[0]:
            yield FreePlaceRow(
                thing=thing,
                relation=each,
                support=support,
                pose=place.pose,
                margin=round(place.margin, 6),
                reason=reason,
                map=bodies.map(row),
                source=bodies.state.shape_source,
            )


def _item(
    kb: QuestionContext, bodies: PlacedBodies, thing: Iri | None, cls: Iri | None
) -> tuple[Body, BodyGeometry | None] | None:
    """The body to place, and its geometry."""
    if thing is not None:
        row = bodies.row_of(thing)
        body = bodies.placed.bodies[row] if row is not None else None
        return None if body is None or body.size is None else (body, bodies.state.geometry.get(body.id))
    size = kb.shape_rule(cls).size if cls is not None else None
    if cls is None or size is None:
        return None
    return Body(id=BodyId("new"), iri=Iri(f"{cls}-new"), cls=cls, pose=Pose(), size=size), None


def _free_places(
    bodies: PlacedBodies,
    item: tuple[Body, BodyGeometry | None],
    support: int,
    thing: Iri | None,
    relation: PlaceRelation | None,
    limit: int,
) -> tuple[list[tuple[PlaceRelation, FreePlace, str]], list[str]]:
    """The free places, and the reasons why surfaces have none."""
    state, placed = bodies.state, bodies.placed
    own = bodies.row_of(thing) if thing is not None else None
    group = bodies.group_of(own) if own is not None else frozenset()
    usable = bodies.comparable
    ignored = {body.id for row, body in enumerate(placed.bodies) if body.iri in group or not usable[row]}
    body = placed.bodies[support]
    reach = float(np.linalg.norm(item[0].size or (0.0, 0.0, 0.0)))
    near = np.all(placed.low <= placed.high[support] + (0.0, 0.0, reach), axis=1)
    near &= np.all(placed.high >= placed.low[support], axis=1)
    by_id = {placed.bodies[row].id: placed.bodies[row] for row in np.flatnonzero(near).tolist()}
    poses = pose_array(each.pose for each in by_id.values())
    sampler = PlacementSampler(by_id, state.geometry, list(by_id), poses, frozenset(ignored))
    found, reasons = list[tuple[PlaceRelation, FreePlace, str]](), list[str]()
    for each, surface in _surfaces(body, state.geometry.get(body.id), relation):
        places, reason = sampler.free_places(item[0], item[1], surface)
        kind = "on top" if each is PlaceRelation.ONTO else "inside"
        what = f"surface of {surface.size[0]:.3g} x {surface.size[1]:.3g} m {kind}"
        if reason:
            reasons.append(f"{what}: {reason}")
        found += [(each, place, f"the largest margin of {len(places)} free poses on a {what}") for place in places]
    found.sort(key=lambda each: -round(each[1].margin, 6))
    kept = spread_places([place for _, place, _ in found], item[0].size or (0.0, 0.0, 0.0), limit)
    return [found[at] for at in kept], reasons


def _surfaces(
    body: Body, geometry: BodyGeometry | None, relation: PlaceRelation | None
) -> Iterator[tuple[PlaceRelation, PlacementSurface]]:
    pose: Array = normalized_pose_array(body.pose)
    for each, inside in ((PlaceRelation.ONTO, False), (PlaceRelation.INTO, True)):
        if relation in {None, each}:
            yield from ((each, surface) for surface in support_surfaces(body, geometry, pose, inside=inside))


@free_place.explain
def _explain_place(kb: QuestionContext, row: FreePlaceRow) -> Iterator[str]:
    x, y, z = row.pose.position
    where = f"at {x:.4g} {y:.4g} {z:.4g} {row.relation} {local_name(row.support)}"
    yield f"{row.reason}, {where}: {row.margin:g} m are free beside it"
    yield source_text(row.source)


@free_place.missing
@unless_bodies_are_missing("thing", "support")
def _missing_place(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.thing is None and asked.cls is not None and kb.shape_rule(asked.cls).size is None:
        reason = f"the size of a {local_name(asked.cls)} is unknown: assert typicalSize of it, or give a thing"
        claim = Claim(kind=ClaimKind.NO_STATEMENT, subject=asked.cls, property=ms("typicalSize"))
        claims = (claim, *body_claims((asked.support,), asked.present.states(asked.map), asked.map))
        yield MissingKnowledge(asked.cls, ms("typicalSize"), reason, claims=claims)
        return
    support = asked.needed("support")
    for bodies in placed_states(asked.present, asked.map):
        item, row = _item(kb, bodies, asked.thing, asked.cls), bodies.row_of(support)
        if item is not None and row is not None:
            reasons = _free_places(bodies, item, row, asked.thing, asked.plain("relation", PlaceRelation), 1)[1]
            why = "; ".join(dict.fromkeys(reasons)) or "it has no level support surface there"
            wanted = local_name(asked.thing or asked.cls or "")
            text = f"{individual_text(kb.reasoner, support)} has no free place for {wanted}: {why}"
            yield missing_about(kb, support, text, asked.thing, present=asked.present, map=asked.map)


# -- liquids -----------------------------------------------------------------------------------------------------------


class LiquidBasis(StrEnum):
    """Why a thing can hold liquid."""

    CLASS = "class"
    """Its class is a container for a liquid, by a restriction."""
    SHAPE = "shape"
    """Its collision shapes retain liquid at its current pose."""


class LiquidContainerRow(AnswerRow, frozen=True, kw_only=True):
    """A thing that can hold liquid."""

    thing: IndividualName
    basis: LiquidBasis
    liquid: ClassName | None
    """The class of liquids that its class is for."""
    volume: float | None
    """What its shape retains [l]."""
    map: MapName
    source: str
    """Where the poses and shapes come from: the name of the engine, or "map, bounding boxes"."""


@question(
    sentences=(
        "(what|which things|which {thing}) can (hold|contain) (liquid|liquids|water)",
        "can {thing} (hold|contain) (liquid|liquids|water)",
        "how much (liquid|water) can {thing} (hold|contain)",
        "what can i pour (liquid|water) into",
    )
)
def can_hold_liquid(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    basis: LiquidBasis | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[LiquidContainerRow]:
    """What can hold liquid, by its class or by its shape, and how much.

    By class: a restriction on typePrimaryFunction-containerFor names a liquid (LiquidTangibleThing, Drink, Water, or a
    subclass), as the purpose or as the only admissible contents. By shape: the volume of the depressions of its
    collision shapes, seen from above at its current pose, on a grid of 48 x 48 heights (filled as in hydrology: Barnes,
    Lehman, Mulla 2014), if it is at least 5 ml. Holes that are smaller than a cell are not seen, and neither is what
    is under a lid. A bounding box has no depression, so the volume needs a simulation.

    Examples:
        can_hold_liquid basis=class
        can_hold_liquid coffee_mug_1
    """
    for bodies in placed_states(present, map):
        scene = ShapeScene(bodies.placed.bodies, bodies.state.geometry) if bodies.state.geometry else None
        volumes = dict[tuple[object, ...], float]()
        for row, body in enumerate(bodies.placed.bodies):
            if thing not in {None, body.iri}:
                continue
            home, source = bodies.map(row), bodies.state.shape_source
            owned = _liquid_restriction(kb, body.cls) if basis is not LiquidBasis.SHAPE else None
            if owned is not None:
                liquid = owned[1]
                yield LiquidContainerRow(
                    thing=body.iri, basis=LiquidBasis.CLASS, liquid=liquid, volume=None, map=home, source=source
                )
            if scene is not None and basis is not LiquidBasis.CLASS and body.id in bodies.state.geometry:
                # Many bodies have the same shapes, and most of these the same rotation.
                key = (bodies.state.geometry[body.id].collision_shapes, body.size, body.pose.quaternion)
                if key not in volumes:
                    volumes[key] = retained_volume(scene, row, bodies.placed.low[row], bodies.placed.high[row]) * 1000
                volume = volumes[key]
                if volume >= _MIN_VOLUME_L:
                    yield LiquidContainerRow(
                        thing=body.iri,
                        basis=LiquidBasis.SHAPE,
                        liquid=None,
                        volume=round(volume, 4),
                        map=home,
                        source=source,
                    )


def _liquid_restriction(kb: QuestionContext, cls: Iri) -> tuple[ClassRestriction, Iri] | None:
    """The restriction of a class that names a liquid as its contents, and the liquid."""
    uses = set(kb.reasoner.properties.sub_properties(_CONTAINER_FOR))
    for owned in kb.reasoner.restrictions(cls):
        if owned.restriction.property in uses and not owned.restriction.inverse:
            for filler in named_classes(owned.restriction.filler):
                if any(kb.reasoner.is_a(filler, liquid) for liquid in _LIQUIDS):
                    return owned, filler
    return None


@can_hold_liquid.explain
def _explain_liquid(kb: QuestionContext, row: LiquidContainerRow) -> Iterator[str]:
    if row.basis is LiquidBasis.SHAPE:
        yield f"the collision shapes of {local_name(row.thing)} retain {row.volume:g} l at its current pose"
        yield source_text(row.source)
        return
    for cls in kb.reasoner.types_of(row.thing):
        found = _liquid_restriction(kb, cls)
        if found is not None and found[1] == row.liquid:
            yield from subclass_line(kb.reasoner.classes.path(cls, found[0].cls))
            yield restriction_line(found[0].cls, found[0].restriction)
            return
    yield f"its class is for {local_name(row.liquid or '')}"


@can_hold_liquid.missing
@unless_bodies_are_missing("thing")
def _missing_liquid(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    basis = asked.plain("basis", LiquidBasis)
    what = individual_text(kb.reasoner, asked.thing) if asked.thing is not None else "nothing here"
    cls = kb.reasoner.class_of(asked.thing) if asked.thing is not None else None
    verb = "is no" if asked.thing is not None else "is a"
    what = f"{what} {verb} container for liquids"
    if basis is not LiquidBasis.SHAPE:
        reason = f"{what} by its class: no {local_name(_CONTAINER_FOR)} names a liquid"
        claims = tuple(
            Claim(kind=ClaimKind.NO_NARROWER_RESTRICTION, subject=own, property=_CONTAINER_FOR, object=liquid)
            for own in _classes_of(kb, asked.thing, asked.present, asked.map)
            for liquid in _LIQUIDS
        )
        claims += body_claims((asked.thing,), asked.present.states(asked.map), asked.map)
        yield MissingKnowledge(cls or _CONTAINER, _CONTAINER_FOR, reason, claims=claims)
    if basis is not LiquidBasis.CLASS:
        known = any(state.geometry for state in asked.present.states(asked.map))
        why = "its shape retains less than 5 ml" if known else "its shape is known to a running simulation only"
        claims = body_claims((asked.thing,), asked.present.states(asked.map), asked.map)
        yield MissingKnowledge(cls or _CONTAINER, HAS_POSE, f"{what} by its shape: {why}", claims=claims)


def _classes_of(kb: QuestionContext, thing: Iri | None, present: StateAccess, map: Iri | None) -> Iterator[Iri]:
    """The declared classes of an individual, or of all bodies."""
    found = (
        {body.cls for state in present.states(map) for body in state.world.bodies}
        if thing is None
        else set(kb.reasoner.types_of(thing))
    )
    yield from (cls for cls in sorted(found) if kb.reasoner.is_class(cls))
