"""Lights: which bodies are lit, in which color, and what for.

The engine knows which bodies are lit; here is why. Whatever it puts out, be it that a body was deleted, goes out here
too, and what somebody lit past the stage has a place here without a reason.

Markers: forms that a program wants to be seen beside the bodies: where it looks, where it goes, what it means.

They are no part of the world: nothing collides with them, no log holds them, and clearing the world leaves them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Iterable, Mapping
from enum import StrEnum
from typing import Any

import msgspec

from mindstage.engines.base import Engine
from mindstage.errors import BodyNotFoundError
from mindstage.knowledge.names import EntityType
from mindstage.knowledge.queries import AnswerRow, Answers
from mindstage.knowledge.rdf import local_name
from mindstage.scene import IDENTITY, BodyId, Color, Pose, Vector

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
    """What a marker looks like."""

    CUBE = "cube"
    SPHERE = "sphere"
    CYLINDER = "cylinder"
    """Upright: its axis is z."""
    CONE = "cone"
    """Upright, the tip at the top."""
    ARROW = "arrow"
    """From its place along x, as long as its size says."""
    LINE_STRIP = "line"
    """From each of its points to the next."""
    LINE_LIST = "lines"
    """From its first point to the second, from the third to the fourth."""
    POINTS = "points"
    """A dot at each of its points."""
    TEXT = "text"
    BODY_COPY = "ghost"
    """A body a second time, as it looks, in the marker's color; where that body is not there, nothing."""


class Marker(msgspec.Struct, frozen=True, kw_only=True):
    """One of them."""

    id: str
    """Another one of that id replaces it."""
    type: MarkerType
    pose: Pose = IDENTITY
    """In the world; the points are seen from it."""
    size: Vector = (0.1, 0.1, 0.1)
    """Extents along its own axes [m]; of lines, the first is how wide they are."""
    color: Color = (1.0, 1.0, 1.0)
    opacity: float = 1.0
    points: tuple[Vector, ...] = ()
    colors: tuple[Color, ...] = ()
    """One for each point, or none; along a line they run into one another."""
    text: str = ""
    body: str = ""
    """Of a ghost: the id of the body."""


class MarkerStore:
    """All of them; only the thread that owns the engine may call it."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        """None yet.

        Args:
            now: the clock by which they go [s].
        """
        self.markers: tuple[Marker, ...] = ()
        """In the order in which they came."""
        self._by_id: dict[str, Marker] = {}
        self._expiry_times: dict[str, float] = {}
        self._now = now

    def add(self, markers: Iterable[Marker], *, lifetime_s: float | None = None) -> None:
        """Shows them, in the place of those that have the same ids."""
        for marker in markers:
            self._by_id[marker.id] = marker
            self._expiry_times.pop(marker.id, None)
            if lifetime_s is not None:
                self._expiry_times[marker.id] = self._now() + lifetime_s
        self.markers = tuple(self._by_id.values())

    def remove(self, ids: Iterable[str]) -> tuple[str, ...]:
        """Takes them away; gives those that were there."""
        gone = tuple(id for id in ids if self._by_id.pop(id, None) is not None)
        for id in gone:
            self._expiry_times.pop(id, None)
        if gone:
            self.markers = tuple(self._by_id.values())
        return gone

    def expire(self) -> bool:
        """Takes away those whose time is up; tells whether there were any."""
        now = self._now()
        return bool(self.remove([id for id, until in self._expiry_times.items() if until <= now]))

    def next_expiry_s(self) -> float | None:
        """When the next one goes [s from now]; None where none goes by itself."""
        return max(0.0, min(self._expiry_times.values()) - self._now()) if self._expiry_times else None


class HighlightGroup(msgspec.Struct, frozen=True, kw_only=True):
    """Bodies that are lit together."""

    ids: tuple[BodyId, ...]
    color: Color
    label: str = ""
    """Why, in one line; empty where nobody said."""
    question: str = ""
    """The name of the question that they answer."""
    args: Mapping[str, str] = {}
    """What it was asked about, in short names."""


class UnhighlightedItem(msgspec.Struct, frozen=True):
    """Something that cannot be lit."""

    id: str
    reason: str


class HighlightResult(msgspec.Struct, frozen=True, kw_only=True):
    """What became of a wish to show something."""

    highlighted: tuple[BodyId, ...]
    unhighlighted: tuple[UnhighlightedItem, ...]


class HighlightRequest(msgspec.Struct, frozen=True, kw_only=True):
    """What shall be shown, and why."""

    items: tuple[str, ...]
    """IRIs or ids."""
    required: frozenset[str] = frozenset()
    """Those that were given as plain ids, and must be there."""
    without_body: tuple[UnhighlightedItem, ...] = ()
    """What cannot be shown, whatever the world holds."""
    label: str = ""
    question: str = ""
    args: Mapping[str, str] = {}


class Highlights:
    """All groups that are lit, the latest last; only the thread that owns the engine may call it."""

    def __init__(self) -> None:
        self.groups: tuple[HighlightGroup, ...] = ()
        self._last_seen: dict[BodyId, Color] = {}

    def apply(
        self, engine: Engine, *, request: HighlightRequest, color: Color | None, replace: bool, strict: bool = False
    ) -> HighlightResult:
        """Lights up what has a body, in place of what was lit for the same reason, or of everything.

        Raises:
            BodyNotFoundError: strict, for the first id that is not there; nothing changes then.
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
        """Lights everything up again in an engine that may have forgotten it, or remember what went out since."""
        there = set(engine.poses()[0])
        engine.highlight(tuple(engine.highlights()), None)
        for group in self.groups:
            engine.highlight([id for id in group.ids if id in there], group.color)

    def sync(self, highlights: Mapping[BodyId, Color]) -> tuple[HighlightGroup, ...]:
        """The groups as they are for what the engine has lit."""
        if highlights != self._last_seen:
            self._last_seen = dict(highlights)
            kept = (_still_highlighted(group, highlights) for group in self.groups if group.label)
            groups = [group for group in kept if group.ids]
            explained = {id for group in groups for id in group.ids}
            others: dict[Color, list[BodyId]] = {}
            for id, color in highlights.items():
                if id not in explained:
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
    """What is to be shown of answers, or of ids and IRIs.

    Of several columns of answers that hold individuals it is the first that was asked for: the handle of a door that
    was given.
    """
    if isinstance(answers, str | AnswerRow):
        answers = (answers,)
    if not isinstance(answers, Answers):
        names, bodies_lacking, required = list[str](), list[UnhighlightedItem](), set[str]()
        for each in answers:
            if isinstance(each, str):
                names.append(str(each))
                required.update(() if "://" in each else (each,))
            elif each.subject_kind is EntityType.INDIVIDUAL:
                names.append(each.subject)
            else:
                bodies_lacking.append(_no_body(each.subject, each.subject_kind))
        return HighlightRequest(
            items=tuple(names), required=frozenset(required), without_body=tuple(bodies_lacking), label=label
        )
    asked = answers.question
    individuals = answers.answer_column(EntityType.INDIVIDUAL)
    column = individuals or answers.answer_column(*asked.columns.values())
    things, bodiless = tuple[str, ...](), tuple[UnhighlightedItem, ...]()
    if column:
        found = dict.fromkeys(str(getattr(row, column)) for row in answers)
        things, bodiless = (
            (tuple(found), ()) if individuals else ((), _items_without_body(found, asked.columns[column]))
        )
    args = {name: local_name(str(getattr(value, "value", value))) for name, value in answers.args.items()}
    typed = " ".join([asked.name, *(f"{name}={value}" for name, value in args.items())])
    return HighlightRequest(items=things, without_body=bodiless, label=label or typed, question=asked.name, args=args)


def _items_without_body(found: Iterable[str], kind: object) -> tuple[UnhighlightedItem, ...]:
    return tuple(_no_body(each, kind) for each in found)


def _no_body(name: str, kind: object) -> UnhighlightedItem:
    what = f"a {kind.value}" if isinstance(kind, EntityType) else "no individual"
    return UnhighlightedItem(local_name(name), f"it is {what}, which has no body")


def _find_bodies(engine: Engine, items: tuple[str, ...], *, required: Container[str]) -> HighlightResult:
    """The bodies of individuals, named by IRI or id; and why others have none.

    Raises:
        BodyNotFoundError: for the first required id that is not there.
    """
    there = dict.fromkeys(engine.poses()[0])
    if all(thing in there for thing in items):  # as most are, and then the world need not be described
        return HighlightResult(highlighted=tuple(dict.fromkeys(map(BodyId, items))), unhighlighted=())
    world = engine.snapshot()
    by_iri = {str(body.iri): body.id for body in world.bodies}
    ids = {str(body.id): body.id for body in world.bodies}
    bodiless = {str(name): "constraint" for each in world.joints for name in (each.iri, each.id)}
    bodiless |= {str(name): "light" for each in world.lights for name in (each.iri, each.id)}
    lit: dict[BodyId, None] = {}
    not_lit: list[UnhighlightedItem] = []
    for thing in items:
        if (id := by_iri.get(thing) or ids.get(thing)) is not None:
            lit[id] = None
        elif kind := bodiless.get(thing):
            not_lit.append(UnhighlightedItem(local_name(thing), f"it is a {kind}, which has no body"))
        elif "://" in thing:
            not_lit.append(UnhighlightedItem(local_name(thing), "it has no body here"))
        else:
            unknown = BodyNotFoundError(thing, known=ids, world=world.name)
            if thing in required:
                raise unknown
            not_lit.append(UnhighlightedItem(local_name(thing), str(unknown)))
    return HighlightResult(highlighted=tuple(lit), unhighlighted=tuple(not_lit))
