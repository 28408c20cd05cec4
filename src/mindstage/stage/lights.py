"""Lights: which bodies are lit, in which colour, and what for.

The engine knows which bodies are lit; here is why. Whatever it puts out, be it that a body was deleted, goes out here
too, and what somebody lit past the stage has a place here without a reason.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from typing import Any

import msgspec

from mindstage.engines.contract import Engine
from mindstage.errors import BodyUnknown
from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions import Answers, Row
from mindstage.knowledge.reasoning import NameKind
from mindstage.world import BodyId, Colour

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
    required: frozenset[str] = frozenset()
    """Those that were given as plain ids, and must be there."""
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

    def show(self, engine: Engine, *, wish: Wish, colour: Colour | None, replace: bool, strict: bool = False) -> Shown:
        """Lights up what has a body, in place of what was lit for the same reason, or of everything.

        Raises:
            BodyUnknown: strict, for the first id that is not there; nothing changes then.
        """
        found = _bodies_of(engine, wish.things, required=wish.required if strict else frozenset())
        before = engine.highlights() if replace else self._lit_for(wish.label)
        if before:
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


def wish_of(shown: str | Row | Answers[Any] | Iterable[str | Row], label: str = "") -> Wish:
    """What is to be shown of answers, or of ids and IRIs.

    Of several columns of answers that hold individuals it is the first that was asked for: the handle of a door that
    was given.
    """
    if isinstance(shown, str | Row):
        shown = (shown,)
    if not isinstance(shown, Answers):
        names, bodies_lacking, required = list[str](), list[NotLit](), set[str]()
        for each in shown:
            if isinstance(each, str):
                names.append(str(each))
                required.update(() if "://" in each else (each,))
            elif each.subject_kind is NameKind.INDIVIDUAL:
                names.append(each.subject)
            else:
                bodies_lacking.append(_no_body(each.subject, each.subject_kind))
        return Wish(things=tuple(names), required=frozenset(required), bodiless=tuple(bodies_lacking), label=label)
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
    return tuple(_no_body(each, kind) for each in found)


def _no_body(name: str, kind: object) -> NotLit:
    what = f"a {kind.value}" if isinstance(kind, NameKind) else "no individual"
    return NotLit(local_name(name), f"it is {what}, which has no body")


def _bodies_of(engine: Engine, things: tuple[str, ...], *, required: Container[str]) -> Shown:
    """The bodies of individuals, named by IRI or id; and why others have none.

    Raises:
        BodyUnknown: for the first required id that is not there.
    """
    there = dict.fromkeys(engine.poses()[0])
    if all(thing in there for thing in things):  # as most are, and then the world need not be described
        return Shown(lit=tuple(dict.fromkeys(map(BodyId, things))), not_lit=())
    world = engine.log()
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
        elif "://" in thing:
            not_lit.append(NotLit(local_name(thing), "it has no body here"))
        else:
            unknown = BodyUnknown(thing, known=ids, world=world.name)
            if thing in required:
                raise unknown
            not_lit.append(NotLit(local_name(thing), str(unknown)))
    return Shown(lit=tuple(lit), not_lit=tuple(not_lit))
