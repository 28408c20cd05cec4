"""Things of two worlds side by side: by id, and by what they are where an id was made on the fly.

A thing whose IRI is a label (`_:…`) has no name of its own, so its id means nothing outside its world. Such things are
paired by what they join, or by what they are, and among equals in the order of their poses. A pair that is not the
best can only show differences that are none: every field of a pair is still compared.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from mindstage.world.comparison_names import is_label
from mindstage.world.values import Body, BodyId, Constraint, Light

__all__ = ["Pairs", "pair_bodies", "pair_constraints", "pair_lights"]

Item = TypeVar("Item", Body, Constraint, Light)


@dataclass(slots=True)
class Pairs(Generic[Item]):
    """a[i] and b[i] are the same thing in two worlds."""

    a: list[Item] = field(default_factory=list)
    b: list[Item] = field(default_factory=list)
    only_in_a: list[Item] = field(default_factory=list)
    only_in_b: list[Item] = field(default_factory=list)

    def same(self) -> Iterator[tuple[Item, Item]]:
        """Pair by pair."""
        return zip(self.a, self.b, strict=True)

    @property
    def ids(self) -> list[str]:
        """What the pairs are called: as in a."""
        return [item.id for item in self.a]


def pair_bodies(a: Iterable[Body], b: Iterable[Body]) -> Pairs[Body]:
    """Nameless bodies are paired by class, label and mesh."""

    def what(body: Body) -> Hashable:
        return (None if is_label(body.cls) else body.cls, body.label, body.mesh)

    return _pair(a, b, what, what)


def pair_lights(a: Iterable[Light], b: Iterable[Light]) -> Pairs[Light]:
    """Nameless lights are paired by kind."""
    return _pair(a, b, lambda light: light.kind, lambda light: light.kind)


def pair_constraints(
    a: Iterable[Constraint], b: Iterable[Constraint], ids: Mapping[BodyId, BodyId]
) -> Pairs[Constraint]:
    """Nameless constraints are paired by the bodies that they join; `ids` says what a calls the bodies of b."""

    def joined(constraint: Constraint) -> Hashable:
        return (constraint.parent, constraint.child)

    def joined_in_b(constraint: Constraint) -> Hashable:
        return (ids.get(constraint.parent, constraint.parent), ids.get(constraint.child, constraint.child))

    return _pair(a, b, joined, joined_in_b)


def _pair(
    a: Iterable[Item], b: Iterable[Item], key_a: Callable[[Item], Hashable], key_b: Callable[[Item], Hashable]
) -> Pairs[Item]:
    named = _match(a, b, lambda item: item.id, lambda item: item.id)
    nameless_a, rest_a = _split(named.only_in_a)
    nameless_b, rest_b = _split(named.only_in_b)
    nameless = _match(sorted(nameless_a, key=_place), sorted(nameless_b, key=_place), key_a, key_b)
    return Pairs(named.a + nameless.a, named.b + nameless.b, rest_a + nameless.only_in_a, rest_b + nameless.only_in_b)


def _match(
    a: Iterable[Item], b: Iterable[Item], key_a: Callable[[Item], Hashable], key_b: Callable[[Item], Hashable]
) -> Pairs[Item]:
    """The first of a key with the first of that key, the second with the second."""
    waiting: dict[Hashable, list[Item]] = defaultdict(list)
    for item in b:
        waiting[key_b(item)].append(item)
    for items in waiting.values():
        items.reverse()
    pairs: Pairs[Item] = Pairs()
    for item in a:
        if others := waiting.get(key_a(item)):
            pairs.a.append(item)
            pairs.b.append(others.pop())
        else:
            pairs.only_in_a.append(item)
    pairs.only_in_b.extend(item for items in waiting.values() for item in reversed(items))
    return pairs


def _split(items: Iterable[Item]) -> tuple[list[Item], list[Item]]:
    nameless: list[Item] = []
    named: list[Item] = []
    for item in items:
        (nameless if is_label(item.iri) else named).append(item)
    return nameless, named


def _place(item: Item) -> tuple[float, ...]:
    return (*item.pose.position, *item.pose.quaternion)
