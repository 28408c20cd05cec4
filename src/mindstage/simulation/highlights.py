"""Highlighted bodies and visualization markers of a simulation.

The engine holds the highlight color of each body; `Highlights` adds the label and the question of each group. A body
that the engine no longer highlights leaves its group; a highlight set in the engine directly has no label. Markers are
not part of the world: they do not collide, are not saved, and remain when the world is cleared.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Iterable, Mapping
from enum import StrEnum
from typing import Any

import msgspec

from mindstage.access.limits import Lifetime
from mindstage.engines.base import Engine
from mindstage.errors import BodyNotFoundError
from mindstage.knowledge.names import EntityType
from mindstage.knowledge.queries import AnswerRow, Answers
from mindstage.ranges import Fraction, Point, Size, check_fields, checked
from mindstage.rdf.graphs import local_name
from mindstage.scene import IDENTITY, BodyId, Color, Pose, as_pose

__all__ = [
    "HighlightGroup",
    "HighlightRequest",
    "HighlightResult",
    "Highlights",
    "Marker",
    "MarkerStore",
    "MarkerType",
    "UnhighlightedItem",
    "highlight_request",
]


class MarkerType(StrEnum):
    """The shape of a marker."""

    CUBE = "cube"
    SPHERE = "sphere"
    CYLINDER = "cylinder"
    """Its axis is z."""
    CONE = "cone"
    """Its axis is z, the tip at the top."""
    ARROW = "arrow"
    """From the origin of its pose along x; `size[0]` is its length."""
    LINE_STRIP = "line_strip"
    """Segments from each point to the next."""
    LINE_LIST = "line_list"
    """A segment for each pair of points."""
    POINTS = "points"
    """A dot at each point."""
    TEXT = "text"
    BODY_COPY = "body_copy"
    """A copy of a body's visual geometry in the color of the marker; invisible if the body does not exist."""


class Marker(msgspec.Struct, frozen=True, kw_only=True):
    """A visualization marker, as in ROS."""

    id: str
    """A marker replaces an earlier one of the same id."""
    type: MarkerType
    pose: Pose = IDENTITY
    """In the world frame; `points` are relative to it."""
    size: Size = (0.1, 0.1, 0.1)
    """Extents along its own axes [m]; of lines and points, the first is the width."""
    color: Color = (1.0, 1.0, 1.0)
    opacity: Fraction = 1.0
    """From 0 (transparent) to 1."""
    points: tuple[Point, ...] = ()
    """Of lines and points, in the frame of `pose` [m]."""
    colors: tuple[Color, ...] = ()
    """One per point, or empty; interpolated along lines."""
    text: str = ""
    body: str = ""
    """The id of the body that a `BODY_COPY` copies."""

    def __post_init__(self) -> None:
        check_fields(self)
        msgspec.structs.force_setattr(self, "pose", as_pose(self.pose))


class MarkerStore:
    """The markers of a simulation, some with a lifetime."""

    def __init__(
        self,
        run: Callable[[Callable[[], Any], str], Any] = lambda function, _: function(),
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """Creates an empty store.

        Args:
            run: runs a function in the engine thread, with a label; so `add` and `remove` may be called from any.
            now: the clock that lifetimes are measured with [s].
        """
        self.markers: tuple[Marker, ...] = ()
        """In the order in which they were added."""
        self._by_id: dict[str, Marker] = {}
        self._expiry_times: dict[str, float] = {}
        self._run, self._now = run, now

    @checked
    def add(self, markers: Iterable[Marker], *, lifetime_s: Lifetime | None = None) -> None:
        """Adds markers, replacing those of the same ids, for a lifetime [s] or until they are removed.

        Raises:
            InvalidArgumentError: the lifetime is out of range; nothing was added.
        """
        added = tuple(markers)

        def add() -> None:
            for marker in added:
                self._by_id[marker.id] = marker
                self._expiry_times.pop(marker.id, None)
                if lifetime_s is not None:
                    self._expiry_times[marker.id] = self._now() + lifetime_s
            self.markers = tuple(self._by_id.values())

        self._run(add, "add markers")

    def remove(self, ids: Iterable[str]) -> tuple[str, ...]:
        """Removes markers; returns the ids of those that existed."""
        removed = tuple(ids)
        found: tuple[str, ...] = self._run(lambda: self._remove(removed), "remove markers")
        return found

    def _remove(self, ids: Iterable[str]) -> tuple[str, ...]:
        removed = tuple(id for id in ids if self._by_id.pop(id, None) is not None)
        for id in removed:
            self._expiry_times.pop(id, None)
        if removed:
            self.markers = tuple(self._by_id.values())
        return removed

    def expire(self) -> bool:
        """Removes, in the engine thread, the markers whose lifetime is over; returns whether there were any."""
        now = self._now()
        return bool(self._remove([id for id, until in self._expiry_times.items() if until <= now]))

    def next_expiry_s(self) -> float | None:
        """The time until the next marker expires [s]; None if no marker has a lifetime."""
        return max(0.0, min(self._expiry_times.values()) - self._now()) if self._expiry_times else None


class HighlightGroup(msgspec.Struct, frozen=True, kw_only=True):
    """Bodies that were highlighted together."""

    ids: tuple[BodyId, ...]
    color: Color
    label: str = ""
    """The reason, in one line; empty if none was given."""
    question: str = ""
    """The name of the question whose answers they are."""
    args: Mapping[str, str] = {}
    """The arguments of that question, as short names."""


class UnhighlightedItem(msgspec.Struct, frozen=True):
    """An item that cannot be highlighted, and the reason."""

    id: str
    reason: str


class HighlightResult(msgspec.Struct, frozen=True, kw_only=True):
    """The bodies that were highlighted, and the items that have no body."""

    highlighted: tuple[BodyId, ...]
    unhighlighted: tuple[UnhighlightedItem, ...]


class HighlightRequest(msgspec.Struct, frozen=True, kw_only=True):
    """The items to highlight, and their label."""

    items: tuple[str, ...]
    """IRIs or ids."""
    required: frozenset[str] = frozenset()
    """Items that were given as plain ids, and must exist."""
    without_body: tuple[UnhighlightedItem, ...] = ()
    """Items that never have a body, such as classes."""
    label: str = ""
    question: str = ""
    args: Mapping[str, str] = {}


class Highlights:
    """The highlighted groups of a simulation, the latest last; used in the engine thread only."""

    def __init__(self) -> None:
        self.groups: tuple[HighlightGroup, ...] = ()
        self._last_seen: dict[BodyId, Color] = {}

    def apply(
        self, engine: Engine, *, request: HighlightRequest, color: Color | None, replace: bool, strict: bool
    ) -> HighlightResult:
        """Highlights the bodies of the items, replacing the group of the same label or, with `replace`, all groups.

        Raises:
            BodyNotFoundError: with `strict`, for the first id that does not exist; nothing changes then.
        """
        found = _find_bodies(engine, request.items, required=request.required if strict else frozenset())
        before = engine.highlights() if replace else self._ids_for_label(request.label)
        if before:
            engine.highlight(tuple(before), None)
        engine.highlight(found.highlighted, color)
        if color is not None and found.highlighted:
            group = HighlightGroup(
                ids=found.highlighted, color=color, label=request.label, question=request.question, args=request.args
            )
            others = (each for each in self.groups if not each.label or each.label != request.label)
            self.groups, self._last_seen = (*others, group), {}
        return HighlightResult(
            highlighted=found.highlighted, unhighlighted=(*request.without_body, *found.unhighlighted)
        )

    def reapply(self, engine: Engine) -> None:
        """Sets the highlights in the engine to the groups, after a reset or a restored state."""
        existing = set(engine.poses()[0])
        engine.highlight(tuple(engine.highlights()), None)
        for group in self.groups:
            engine.highlight([id for id in group.ids if id in existing], group.color)

    def sync(self, highlights: Mapping[BodyId, Color]) -> tuple[HighlightGroup, ...]:
        """Updates the groups to the highlights of the engine, and returns them."""
        if highlights != self._last_seen:
            self._last_seen = dict(highlights)
            kept = (_still_highlighted(group, highlights) for group in self.groups if group.label)
            groups = [group for group in kept if group.ids]
            labeled = {id for group in groups for id in group.ids}
            others: dict[Color, list[BodyId]] = {}
            for id, color in highlights.items():
                if id not in labeled:
                    others.setdefault(color, []).append(id)
            self.groups = (*(HighlightGroup(ids=tuple(ids), color=color) for color, ids in others.items()), *groups)
        return self.groups

    def _ids_for_label(self, label: str) -> tuple[BodyId, ...]:
        return tuple(id for group in self.groups if label and group.label == label for id in group.ids)


def _still_highlighted(group: HighlightGroup, highlights: Mapping[BodyId, Color]) -> HighlightGroup:
    ids = tuple(id for id in group.ids if highlights.get(id) == group.color)
    return group if ids == group.ids else msgspec.structs.replace(group, ids=ids)


def highlight_request(
    answers: str | AnswerRow | Answers[Any] | Iterable[str | AnswerRow], label: str = ""
) -> HighlightRequest:
    """Collects the items to highlight from answers, or from ids and IRIs.

    Of answers it is the first column of individuals that was not an argument, such as the handle of a given door.
    """
    if isinstance(answers, str | AnswerRow):
        answers = (answers,)
    if not isinstance(answers, Answers):
        names, without_body, required = list[str](), list[UnhighlightedItem](), set[str]()
        for each in answers:
            if isinstance(each, str):
                names.append(str(each))
                required.update(() if "://" in each else (each,))
            elif each.subject_kind is EntityType.INDIVIDUAL:
                names.append(each.subject)
            else:
                without_body.append(_no_body(each.subject, each.subject_kind))
        return HighlightRequest(
            items=tuple(names), required=frozenset(required), without_body=tuple(without_body), label=label
        )
    question = answers.question
    individuals = answers.answer_column(EntityType.INDIVIDUAL)
    column = individuals or answers.answer_column(*question.columns.values())
    found = tuple(dict.fromkeys(str(getattr(row, column)) for row in answers)) if column else ()
    items = found if individuals else ()
    other = () if individuals or not column else tuple(_no_body(name, question.columns[column]) for name in found)
    args = {name: local_name(str(getattr(value, "value", value))) for name, value in answers.args.items()}
    typed = " ".join([question.name, *(f"{name}={value}" for name, value in args.items())])
    return HighlightRequest(items=items, without_body=other, label=label or typed, question=question.name, args=args)


def _no_body(name: str, kind: object) -> UnhighlightedItem:
    what = f"a {kind.value}" if isinstance(kind, EntityType) else "not an individual"
    return UnhighlightedItem(local_name(name), f"it is {what}, which has no body")


def _find_bodies(engine: Engine, items: tuple[str, ...], *, required: Container[str]) -> HighlightResult:
    """Finds the bodies of items given by IRI or id, and the reason why others have none.

    Raises:
        BodyNotFoundError: for the first required id that does not exist.
    """
    existing = set(engine.poses()[0])
    if all(item in existing for item in items):  # the usual case, which needs no snapshot
        return HighlightResult(highlighted=tuple(dict.fromkeys(map(BodyId, items))), unhighlighted=())
    world = engine.snapshot()
    by_iri = {str(body.iri): body.id for body in world.bodies}
    ids = {str(body.id): body.id for body in world.bodies}
    other_kinds = {str(name): "joint" for each in world.joints for name in (each.iri, each.id)}
    other_kinds |= {str(name): "light" for each in world.lights for name in (each.iri, each.id)}
    highlighted: dict[BodyId, None] = {}
    unhighlighted: list[UnhighlightedItem] = []
    for item in items:
        if (id := by_iri.get(item) or ids.get(item)) is not None:
            highlighted[id] = None
        elif kind := other_kinds.get(item):
            unhighlighted.append(UnhighlightedItem(local_name(item), f"it is a {kind}, which has no body"))
        elif "://" in item:
            unhighlighted.append(UnhighlightedItem(local_name(item), "it has no body here"))
        else:
            error = BodyNotFoundError(item, known=ids, world=world.name)
            if item in required:
                raise error
            unhighlighted.append(UnhighlightedItem(local_name(item), str(error)))
    return HighlightResult(highlighted=tuple(highlighted), unhighlighted=tuple(unhighlighted))
