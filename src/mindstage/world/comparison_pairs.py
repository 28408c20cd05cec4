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

from mindstage.world.comparison_names import is_blank_node
from mindstage.world.values import Body, BodyId, Joint, Light

__all__ = ["MatchedPairs", "pair_bodies", "pair_joints", "pair_lights"]

Item = TypeVar("Item", Body, Joint, Light)


@dataclass(slots=True)
class MatchedPairs(Generic[Item]):
    """a[i] and b[i] are the same thing in two worlds."""

    a: list[Item] = field(default_factory=list)
    b: list[Item] = field(default_factory=list)
    only_in_a: list[Item] = field(default_factory=list)
    only_in_b: list[Item] = field(default_factory=list)

    def matched(self) -> Iterator[tuple[Item, Item]]:
        """Pair by pair."""
        return zip(self.a, self.b, strict=True)

    @property
    def ids(self) -> list[str]:
        """What the pairs are called: as in a."""
        return [item.id for item in self.a]


def pair_bodies(a: Iterable[Body], b: Iterable[Body]) -> MatchedPairs[Body]:
    """Nameless bodies are paired by class, label and mesh."""

    def what(body: Body) -> Hashable:
        return (None if is_blank_node(body.cls) else body.cls, body.label, body.mesh)

    return _pair(a, b, what, what)


def pair_lights(a: Iterable[Light], b: Iterable[Light]) -> MatchedPairs[Light]:
    """Nameless lights are paired by kind."""
    return _pair(a, b, lambda light: light.type, lambda light: light.type)


def pair_joints(a: Iterable[Joint], b: Iterable[Joint], ids: Mapping[BodyId, BodyId]) -> MatchedPairs[Joint]:
    """Nameless constraints are paired by the bodies that they join; `ids` says what a calls the bodies of b."""

    def joined(constraint: Joint) -> Hashable:
        return (constraint.parent, constraint.child)

    def joined_in_b(constraint: Joint) -> Hashable:
        return (ids.get(constraint.parent, constraint.parent), ids.get(constraint.child, constraint.child))

    return _pair(a, b, joined, joined_in_b)


def _pair(
    a: Iterable[Item], b: Iterable[Item], key_a: Callable[[Item], Hashable], key_b: Callable[[Item], Hashable]
) -> MatchedPairs[Item]:
    named = _match(a, b, lambda item: item.id, lambda item: item.id)
    nameless_a, rest_a = _split_nameless(named.only_in_a)
    nameless_b, rest_b = _split_nameless(named.only_in_b)
    nameless = _match(sorted(nameless_a, key=_pose_key), sorted(nameless_b, key=_pose_key), key_a, key_b)
    return MatchedPairs(
        named.a + nameless.a, named.b + nameless.b, rest_a + nameless.only_in_a, rest_b + nameless.only_in_b
    )


def _match(
    a: Iterable[Item], b: Iterable[Item], key_a: Callable[[Item], Hashable], key_b: Callable[[Item], Hashable]
) -> MatchedPairs[Item]:
    """The first of a key with the first of that key, the second with the second."""
    waiting: dict[Hashable, list[Item]] = defaultdict(list)
    for item in b:
        waiting[key_b(item)].append(item)
    for items in waiting.values():
        items.reverse()
    pairs: MatchedPairs[Item] = MatchedPairs()
    for item in a:
        if others := waiting.get(key_a(item)):
            pairs.a.append(item)
            pairs.b.append(others.pop())
        else:
            pairs.only_in_a.append(item)
    pairs.only_in_b.extend(item for items in waiting.values() for item in reversed(items))
    return pairs


def _split_nameless(items: Iterable[Item]) -> tuple[list[Item], list[Item]]:
    nameless: list[Item] = []
    named: list[Item] = []
    for item in items:
        (nameless if is_blank_node(item.iri) else named).append(item)
    return nameless, named


def _pose_key(item: Item) -> tuple[float, ...]:
    return (*item.pose.position, *item.pose.quaternion)
