"""Lights: which bodies are lit, in which colour, and what for.

The engine knows which bodies are lit; here is why. Whatever it puts out, be it that a body was deleted, goes out here
too, and what somebody lit past the stage has a place here without a reason.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from mindstage.engines.contract import Engine
from mindstage.errors import BodyUnknown
from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions import Answers
from mindstage.knowledge.reasoning import NameKind
from mindstage.world import BodyId, Colour, World

__all__ = ["Lights", "Lit", "NotLit", "Shown", "Wish", "wish_of"]


class Lit(msgspec.Struct, frozen=True, kw_only=True):
    """Bodies that are lit together."""

    ids: tuple[BodyId, ...]
    colour: Colour
    label: str = ""
    """Why, in one line; empty where nobody said."""
    question: str = ""
    """The name of the question that they answer."""
    args: Mapping[str, str] = {}
    """What it was asked about, in short names."""


class NotLit(msgspec.Struct, frozen=True):
    """Something that cannot be lit."""

    id: str
    reason: str


class Shown(msgspec.Struct, frozen=True, kw_only=True):
    """What became of a wish to show something."""

    lit: tuple[BodyId, ...]
    not_lit: tuple[NotLit, ...]


class Wish(msgspec.Struct, frozen=True, kw_only=True):
    """What shall be shown, and why."""

    things: tuple[str, ...]
    """IRIs or ids."""
    bodiless: tuple[NotLit, ...] = ()
    """What cannot be shown, whatever the world holds."""
    label: str = ""
    question: str = ""
    args: Mapping[str, str] = {}


class Lights:
    """All groups that are lit, the latest last; only the thread that owns the engine may call it."""

    def __init__(self) -> None:
        self.groups: tuple[Lit, ...] = ()
        self._seen: dict[BodyId, Colour] = {}

    def show(self, engine: Engine, *, wish: Wish, colour: Colour | None, replace: bool) -> Shown:
        """Lights up what has a body, in place of what was lit for the same reason, or of everything."""
        found = _bodies_of(engine.log(), wish.things)
        before = engine.highlights() if replace else self._lit_for(wish.label)
        engine.highlight(tuple(before), None)
        engine.highlight(found.lit, colour)
        if colour is not None and found.lit:
            group = Lit(ids=found.lit, colour=colour, label=wish.label, question=wish.question, args=wish.args)
            others = (each for each in self.groups if not each.label or each.label != wish.label)
            self.groups, self._seen = (*others, group), {}
        return Shown(lit=found.lit, not_lit=(*wish.bodiless, *found.not_lit))

    def renew(self, engine: Engine) -> None:
        """Lights everything up again in an engine that may have forgotten it, or remember what went out since."""
        there = set(engine.poses()[0])
        engine.highlight(tuple(engine.highlights()), None)
        for group in self.groups:
            engine.highlight([id for id in group.ids if id in there], group.colour)

    def follow(self, highlights: Mapping[BodyId, Colour]) -> tuple[Lit, ...]:
        """The groups as they are for what the engine has lit."""
        if highlights != self._seen:
            self._seen = dict(highlights)
            kept = (_still(group, highlights) for group in self.groups if group.label)
            groups = [group for group in kept if group.ids]
            explained = {id for group in groups for id in group.ids}
            others: dict[Colour, list[BodyId]] = {}
            for id, colour in highlights.items():
                if id not in explained:
                    others.setdefault(colour, []).append(id)
            self.groups = (*(Lit(ids=tuple(ids), colour=colour) for colour, ids in others.items()), *groups)
        return self.groups

    def _lit_for(self, label: str) -> tuple[BodyId, ...]:
        return tuple(id for group in self.groups if label and group.label == label for id in group.ids)


def _still(group: Lit, highlights: Mapping[BodyId, Colour]) -> Lit:
    ids = tuple(id for id in group.ids if highlights.get(id) == group.colour)
    return group if ids == group.ids else msgspec.structs.replace(group, ids=ids)


def wish_of(shown: Answers[Any] | Iterable[str], label: str = "") -> Wish:
    """What is to be shown of answers, or of ids and IRIs.

    Of several columns of answers that hold individuals it is the first that was asked for: the handle of a door that
    was given.
    """
    if not isinstance(shown, Answers):
        return Wish(things=tuple(shown), label=label)
    asked = shown.question
    individuals = shown.asked_for(NameKind.INDIVIDUAL)
    column = individuals or shown.asked_for(*asked.columns.values())
    things, bodiless = tuple[str, ...](), tuple[NotLit, ...]()
    if column:
        found = dict.fromkeys(str(getattr(row, column)) for row in shown)
        things, bodiless = (tuple(found), ()) if individuals else ((), _bodiless(found, asked.columns[column]))
    args = {name: local_name(str(getattr(value, "value", value))) for name, value in shown.args.items()}
    typed = " ".join([asked.name, *(f"{name}={value}" for name, value in args.items())])
    return Wish(things=things, bodiless=bodiless, label=label or typed, question=asked.name, args=args)


def _bodiless(found: Iterable[str], kind: object) -> tuple[NotLit, ...]:
    what = f"a {kind.value}" if isinstance(kind, NameKind) else "no individual"
    return tuple(NotLit(local_name(each), f"it is {what}, which has no body") for each in found)


def _bodies_of(world: World, things: Iterable[str]) -> Shown:
    """The bodies of individuals, named by IRI or id; and why others have none."""
    by_iri = {str(body.iri): body.id for body in world.bodies}
    ids = {str(body.id): body.id for body in world.bodies}
    bodiless = {str(name): "constraint" for each in world.constraints for name in (each.iri, each.id)}
    bodiless |= {str(name): "light" for each in world.lights for name in (each.iri, each.id)}
    lit: dict[BodyId, None] = {}
    not_lit: list[NotLit] = []
    for thing in things:
        if (id := by_iri.get(thing) or ids.get(thing)) is not None:
            lit[id] = None
        elif kind := bodiless.get(thing):
            not_lit.append(NotLit(local_name(thing), f"it is a {kind}, which has no body"))
        else:
            reason = "it has no body here" if "://" in thing else str(BodyUnknown(thing, known=ids, world=world.name))
            not_lit.append(NotLit(local_name(thing), reason))
    return Shown(lit=tuple(lit), not_lit=tuple(not_lit))
