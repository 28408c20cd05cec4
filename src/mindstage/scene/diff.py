"""The judge: everything that two worlds do not agree on, and by how much.

`diff` compares all that a World holds. Order carries no meaning, so tags, facts and things are compared as sets
that count repetitions; only materials keep their order, since a mesh names its surfaces by number. What a world holds
twice under one id is compared in its order. Names that mean something only inside their own world may differ, what
they stand for may not.

Fields compared in columns: one field of many things at once, and how far its two values are apart.

Numbers go through numpy, so that ten thousand bodies cost as many array operations as ten. NaN is equal to NaN and to
nothing else: a world is equal to itself whatever it holds.

Things of two worlds side by side: by id, and by what they are where an id was made on the fly.

A thing whose IRI is a label (`_:…`) has no name of its own, so its id means nothing outside its world. Such things are
paired by what they join, or by what they are, and among equals in the order of their poses. A pair that is not the
best can only show differences that are none: every field of a pair is still compared.

What two worlds say about the same things, and what only one of them says.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Container, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from math import isfinite
from operator import attrgetter
from typing import Any, Generic, TypeVar

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.scene.blank_node_matching import (
    Statement,
    StatementCanonicalizer,
    is_blank_node,
    match_blank_nodes,
    multiset_difference,
    part_name_pairs,
)
from mindstage.scene.display import counted, html_table
from mindstage.scene.model import Body, BodyId, Joint, Light, NamedResource, PropertyAssertion, Tag, World
from mindstage.scene.transforms import quat_angle

__all__ = [
    "BODY_FIELDS",
    "JOINT_FIELDS",
    "LIGHT_FIELDS",
    "MEASURED_KINDS",
    "MECHANICAL_KINDS",
    "WORLD_FIELDS",
    "ChangeKind",
    "FieldChange",
    "MatchedPairs",
    "StatementDiff",
    "WorldDiff",
    "compare_column",
    "compare_columns",
    "compare_materials",
    "diff",
    "pair_bodies",
    "pair_joints",
    "pair_lights",
]


Array = NDArray[np.float64]


class ChangeKind(StrEnum):
    """What a change is about. Those in `MEASURED_KINDS` have an error, in the unit that is said here."""

    TRANSLATION = "translation_m"
    """The distance between two positions [m]."""
    ROTATION = "rotation_rad"
    """The smallest angle between two rotations [rad]: q and -q are one, and lengths do not count."""
    SIZE = "size_m"
    """The largest of the three extents' differences [m]."""
    MASS = "mass_kg"
    LIMIT = "limit"
    """Of a constraint, or the middle between its limits: linear [m] or angular [rad]."""
    STIFFNESS = "stiffness"
    """[N/m] or [Nm/rad]."""
    DAMPING = "damping"
    """[Ns/m] or [Nms/rad]."""
    COLOR = "colour"
    """Of a material or a light: the largest of the three channels' differences, each 0 to 1."""
    INTENSITY = "light"
    """A light's intensity [cd or lx]."""
    NAME = "name"
    """IRI, label, name of the world."""
    CLASS = "class"
    """What a thing is: the class of a body, the kind of a light."""
    APPEARANCE = "look"
    """Mesh, shape, materials."""
    PHYSICS = "physics"
    """Mobility, gravity, overlap events."""
    MOTION = "motion"
    """What a constraint lets happen: its axes, soft or not, whether its two bodies collide."""
    STRUCTURE = "structure"
    """What a constraint joins, and what hangs on what."""
    TAGS = "tags"
    FACTS = "facts"


MEASURED_KINDS = (
    ChangeKind.TRANSLATION,
    ChangeKind.ROTATION,
    ChangeKind.SIZE,
    ChangeKind.MASS,
    ChangeKind.LIMIT,
    ChangeKind.STIFFNESS,
    ChangeKind.DAMPING,
    ChangeKind.COLOR,
    ChangeKind.INTENSITY,
)
"""The kinds whose changes have a number."""

MECHANICAL_KINDS = frozenset({ChangeKind.TRANSLATION, ChangeKind.ROTATION, ChangeKind.MASS, ChangeKind.LIMIT})
"""Where things are, what they weigh and how far they move, whatever else is said of them."""

_POSE = {"pose.position": ChangeKind.TRANSLATION, "pose.quaternion": ChangeKind.ROTATION}

WORLD_FIELDS: Mapping[str, ChangeKind] = {
    "iri": ChangeKind.NAME,
    "name": ChangeKind.NAME,
    "format_version": ChangeKind.NAME,
}

BODY_FIELDS: Mapping[str, ChangeKind] = {
    "iri": ChangeKind.NAME,
    "cls": ChangeKind.CLASS,
    "label": ChangeKind.NAME,
    **_POSE,
    "size": ChangeKind.SIZE,
    "mesh": ChangeKind.APPEARANCE,
    "shape": ChangeKind.APPEARANCE,
    "physics.mobility": ChangeKind.PHYSICS,
    "physics.gravity": ChangeKind.PHYSICS,
    "physics.overlap_events": ChangeKind.PHYSICS,
    "physics.mass_kg": ChangeKind.MASS,
}

JOINT_FIELDS: Mapping[str, ChangeKind] = {
    "iri": ChangeKind.NAME,
    "parent": ChangeKind.STRUCTURE,
    "child": ChangeKind.STRUCTURE,
    **_POSE,
    **{f"linear.{axis}": ChangeKind.MOTION for axis in ("x", "y", "z")},
    **{f"angular.{axis}": ChangeKind.MOTION for axis in ("swing1", "swing2", "twist")},
    "linear.limit": ChangeKind.LIMIT,
    **{f"linear.{axis}_middle": ChangeKind.LIMIT for axis in ("x", "y", "z")},
    **{
        f"angular.{axis}_{what}": ChangeKind.LIMIT
        for axis in ("swing1", "swing2", "twist")
        for what in ("limit", "middle")
    },
    **{
        f"{soft}.{part}": kind
        for soft in ("linear.soft_limit", "angular.swing_soft_limit", "angular.twist_soft_limit")
        for part, kind in (
            ("enabled", ChangeKind.MOTION),
            ("stiffness", ChangeKind.STIFFNESS),
            ("damping", ChangeKind.DAMPING),
        )
    },
    "disable_collision": ChangeKind.MOTION,
}

LIGHT_FIELDS: Mapping[str, ChangeKind] = {
    "iri": ChangeKind.NAME,
    "type": ChangeKind.CLASS,
    **_POSE,
    "color": ChangeKind.COLOR,
    "intensity": ChangeKind.INTENSITY,
}


class FieldChange(msgspec.Struct, frozen=True, kw_only=True):
    """One field that the two worlds do not agree on."""

    id: str
    """Of a body, a constraint, a light; the IRI of a resource or of the world itself."""
    field: str
    """The path of the attribute: `pose.position`, `linear.limit`."""
    kind: ChangeKind
    a: Any
    """What the first world has; None for nothing. For tags and facts: those that the second lacks."""
    b: Any
    """What the second world has; None for nothing. For tags and facts: those that the first lacks."""
    error: float | None = None
    """How far apart the two are, in the unit of the kind.

    None where no number says it: for what is not measured, a value against none, NaN or infinity against a number.
    """


def compare_columns(
    fields: Mapping[str, ChangeKind], ids: Sequence[str], a: Sequence[World | Body | Joint | Light], b: Sequence[Any]
) -> Iterator[FieldChange]:
    """The changes of all fields of things of one sort, a[i] against b[i]."""
    for field, kind in fields.items():
        get = attrgetter(field)
        yield from compare_column(field, kind, ids, [get(item) for item in a], [get(item) for item in b])


def compare_materials(ids: Sequence[str], a: Sequence[Body], b: Sequence[Body]) -> Iterator[FieldChange]:
    """The changes of materials: their names, paths and order at once, then the color of each."""
    names = [[tuple((m.name, m.path) for m in body.materials) for body in side] for side in (a, b)]
    yield from compare_column("materials", ChangeKind.APPEARANCE, ids, *names)
    rows = list(range(len(ids)))
    slot = 0
    while rows := [row for row in rows if min(len(a[row].materials), len(b[row].materials)) > slot]:
        colors = [[side[row].materials[slot].color for row in rows] for side in (a, b)]
        yield from compare_column(f"materials[{slot}].color", ChangeKind.COLOR, [ids[row] for row in rows], *colors)
        slot += 1


def compare_column(
    field: str, kind: ChangeKind, ids: Sequence[str], a: Sequence[Any], b: Sequence[Any]
) -> Iterator[FieldChange]:
    """The changes of one field."""
    if kind not in MEASURED_KINDS:
        for owner, x, y in zip(ids, a, b, strict=True):
            if x != y:
                yield FieldChange(id=owner, field=field, kind=kind, a=x, b=y)
        return
    errors = _measured_errors(kind, a, b)
    for row in np.flatnonzero(errors != 0.0).tolist():
        error = float(errors[row])
        told = error if isfinite(error) else None
        yield FieldChange(id=ids[row], field=field, kind=kind, a=a[row], b=b[row], error=told)


def _measured_errors(kind: ChangeKind, a: Sequence[Any], b: Sequence[Any]) -> Array:
    """How far each pair is apart; NaN or infinite where no number says it."""
    width = (
        4
        if kind is ChangeKind.ROTATION
        else 3
        if kind in (ChangeKind.TRANSLATION, ChangeKind.SIZE, ChangeKind.COLOR)
        else 1
    )
    x, y = _array(a, width), _array(b, width)
    given_a, given_b = (np.array([value is not None for value in values], dtype=bool) for values in (a, b))
    same = np.all((x == y) | (np.isnan(x) & np.isnan(y)), axis=1) & (given_a == given_b)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        if kind is ChangeKind.ROTATION:
            error = _rotation_angles(x, y)
        elif kind is ChangeKind.TRANSLATION:
            error = _row_norms(x - y)
        else:
            error = np.max(np.abs(x - y), axis=1, initial=0.0)
    return np.where(same, 0.0, error)


def _array(values: Sequence[Any], width: int) -> Array:
    empty = (np.nan,) * width if width > 1 else np.nan
    return np.array([empty if value is None else value for value in values], dtype=np.float64).reshape(-1, width)


def _row_norms(vectors: Array) -> Array:
    """Euclid's, without squaring numbers so small or large that their squares are none."""
    longest = np.max(np.abs(vectors), axis=1, initial=0.0)
    scale = np.where(longest > 0.0, longest, 1.0)
    return np.asarray(longest * np.linalg.norm(vectors / scale[:, None], axis=1))


def _rotation_angles(a: Array, b: Array) -> Array:
    """NaN where one of the two is no rotation."""
    near_one = []
    for q in (a, b):
        longest = np.max(np.abs(q), axis=1, initial=0.0)
        _, exponent = np.frexp(longest)  # a power of two: to scale by it rounds nothing
        near_one.append(np.where((longest > 0.0)[:, None], np.ldexp(q, -exponent[:, None]), np.nan))
    return quat_angle(*near_one)


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


class StatementDiff:
    """Collects, thing by thing, the statements that one world makes and the other does not."""

    def __init__(self, names: Mapping[str, str], canonicalizer: StatementCanonicalizer) -> None:
        """Takes what a calls the things that b calls otherwise, and the table to compare with."""
        self._names, self._canonicalizer = names, canonicalizer
        self.changes: list[FieldChange] = []
        self._lost: list[Statement] = []
        self._gained: list[Statement] = []

    @property
    def lost(self) -> tuple[Statement, ...]:
        """What only a says."""
        return tuple(sorted(self._lost, key=_statement_order))

    @property
    def gained(self) -> tuple[Statement, ...]:
        """What only b says."""
        return tuple(sorted(self._gained, key=_statement_order))

    def tags(self, id: str, a: Sequence[Tag], b: Sequence[Tag]) -> None:
        """Compares the tags of a thing that both have."""
        if a != b:
            self._record_change(id, ChangeKind.TAGS, _missing_tags(a, b), _missing_tags(b, a))

    def facts(self, id: str, a: Sequence[PropertyAssertion], b: Sequence[PropertyAssertion]) -> None:
        """Compares the facts of a thing that both have."""
        if self._names or not _literally_equal(a, b):
            mine = [self._canonicalizer.canonical_id(fact, {}) for fact in a]
            theirs = [self._canonicalizer.canonical_id(fact, self._names) for fact in b]
            self._record_change(
                id, ChangeKind.FACTS, multiset_difference(a, mine, theirs), multiset_difference(b, theirs, mine)
            )

    def only_in_a(self, id: str, assertions: Iterable[PropertyAssertion | Tag]) -> None:
        """Counts what is lost together with the thing that it is about."""
        self._lost.extend(Statement(id, statement) for statement in assertions)

    def only_in_b(self, id: str, assertions: Iterable[PropertyAssertion | Tag]) -> None:
        """Counts what is gained together with the thing that it is about."""
        self._gained.extend(Statement(id, statement) for statement in assertions)

    def resources(self, a: Iterable[NamedResource], b: Iterable[NamedResource]) -> None:
        """Compares what is said about anything else."""
        mine, theirs = _facts_by_iri(a, {}), _facts_by_iri(b, self._names)
        for iri in mine.keys() & theirs.keys():
            self.facts(iri, mine[iri], theirs[iri])
        for iri in mine.keys() - theirs.keys():
            self.only_in_a(iri, mine[iri])
            self.changes.append(
                FieldChange(id=iri, field="resource", kind=ChangeKind.FACTS, a=_sorted(mine[iri]), b=None)
            )
        for iri in theirs.keys() - mine.keys():
            self.only_in_b(iri, theirs[iri])
            self.changes.append(
                FieldChange(id=iri, field="resource", kind=ChangeKind.FACTS, a=None, b=_sorted(theirs[iri]))
            )

    def _record_change(
        self,
        id: str,
        kind: ChangeKind,
        lost: Sequence[PropertyAssertion | Tag],
        gained: Sequence[PropertyAssertion | Tag],
    ) -> None:
        if lost or gained:
            self.only_in_a(id, lost)
            self.only_in_b(id, gained)
            self.changes.append(FieldChange(id=id, field=kind.value, kind=kind, a=_sorted(lost), b=_sorted(gained)))


def _facts_by_iri(
    resources: Iterable[NamedResource], names: Mapping[str, str]
) -> Mapping[str, list[PropertyAssertion]]:
    facts: dict[str, list[PropertyAssertion]] = defaultdict(list)
    for resource in resources:
        facts[names.get(resource.iri, resource.iri)].extend(resource.facts)
    return facts


def _missing_tags(tags: Sequence[Tag], others: Sequence[Tag]) -> tuple[Tag, ...]:
    return multiset_difference(tags, map(_tag_key, tags), map(_tag_key, others))


def _tag_key(tag: Tag) -> Hashable:
    return (tag.type, tag.key, tag.value)


def _literally_equal(a: Sequence[PropertyAssertion], b: Sequence[PropertyAssertion]) -> bool:
    """The fast way to know that nothing differs."""
    try:
        return a == b
    except RecursionError:  # == follows lists in lists only so deep, Forms to any depth
        return False


def _sorted(assertions: Iterable[PropertyAssertion | Tag]) -> tuple[PropertyAssertion | Tag, ...]:
    return tuple(sorted(assertions, key=_assertion_order))


def _assertion_order(assertion: PropertyAssertion | Tag) -> tuple[str, ...]:
    """As good an order as any, as long as it does not hang on that of the world."""
    if isinstance(assertion, Tag):
        return (assertion.type, assertion.key, assertion.value)
    return (assertion.property, str(Statement("", assertion)))


def _statement_order(statement: Statement) -> tuple[str, ...]:
    return (statement.id, *_assertion_order(statement.assertion))


_MOST_SHOWN = 10
"""A summary lists so many of each; all are in the fields."""
_LONGEST = 60
"""Longer values are cut in a summary [characters]."""

Entity = TypeVar("Entity", World, Body, Joint, Light)


class WorldDiff(msgspec.Struct, frozen=True, kw_only=True):
    """What two worlds, a and b, do not agree on; the same whatever the order that they hold things in."""

    only_in_a: tuple[str, ...] = ()
    """Ids of bodies, constraints and lights that b lacks."""
    only_in_b: tuple[str, ...] = ()
    """Ids of bodies, constraints and lights that a lacks."""
    changed: tuple[FieldChange, ...] = ()
    """The fields that differ of what stands in both, by id, then by field.

    What a body hangs on is its field `attachment.parents`; a resource that only one world has is a change of its field
    `resource`.
    """
    lost: tuple[Statement, ...] = ()
    """Facts and tags of a that are not in b, those of what is only in a included."""
    gained: tuple[Statement, ...] = ()
    """Facts and tags of b that are not in a."""

    @property
    def lost_facts(self) -> int:
        """How many facts and tags of a are not in b."""
        return len(self.lost)

    @property
    def gained_facts(self) -> int:
        """How many facts and tags of b are not in a."""
        return len(self.gained)

    @property
    def max_error(self) -> Mapping[str, float]:
        """The largest error of each kind that is measured, 0 where nothing differs; see `ChangeKind` for the units."""
        largest = dict.fromkeys((str(kind) for kind in MEASURED_KINDS), 0.0)
        for change in self.changed:
            if change.error is not None:
                largest[change.kind] = max(largest[change.kind], change.error)
        return largest

    def identical(self, tolerance: float = 0.0, *, kinds: Container[ChangeKind] | None = None) -> bool:
        """Whether the worlds are the same, but for errors up to a tolerance.

        No tolerance forgives what has no error: a lost fact, another parent, a mass against none.

        Args:
            tolerance: the largest error that is forgiven, in the unit of each kind.
            kinds: look only at changes of these kinds, such as `MECHANICAL_KINDS`; what stands in one world only still counts.

        Raises:
            ValueError: the tolerance is negative or NaN.
        """
        return not (self.only_in_a or self.only_in_b or self.exceeding(tolerance, kinds=kinds))

    def exceeding(
        self, tolerance: float = 0.0, *, kinds: Container[ChangeKind] | None = None
    ) -> tuple[FieldChange, ...]:
        """The changes that the tolerance does not forgive.

        Raises:
            ValueError: the tolerance is negative or NaN.
        """
        if not tolerance >= 0.0:
            raise ValueError(f"a tolerance of {tolerance} forgives nothing; give 0 or more")
        return tuple(
            change
            for change in self.changed
            if (kinds is None or change.kind in kinds) and (change.error is None or change.error > tolerance)
        )

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._summary()}>"

    def __str__(self) -> str:
        """A summary in lines: what differs, by how much at most, and the largest changes."""
        lines = [self._summary()]
        for name, ids in (("a", self.only_in_a), ("b", self.only_in_b)):
            if ids:
                lines.append(f"only in {name}: {_some(ids)}")
        if errors := [f"{kind} {error:.4g}" for kind, error in self.max_error.items() if error > 0.0]:
            lines.append(f"largest errors: {', '.join(errors)}")
        lines.extend(f"  {change.id} {change.field}: {_change(change)}" for change in self._largest()[:_MOST_SHOWN])
        if len(self.changed) > _MOST_SHOWN:
            lines.append(f"  … and {counted(len(self.changed) - _MOST_SHOWN, 'more change')}")
        for title, statements in (("lost", self.lost), ("gained", self.gained)):
            lines.extend(f"  {title}: {each.id} {each}" for each in statements[:_MOST_SHOWN])
            if len(statements) > _MOST_SHOWN:
                lines.append(f"  … and {len(statements) - _MOST_SHOWN:,} more {title}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """The changes, the largest first, as a table for notebooks."""
        rows: list[tuple[object, ...]] = []
        for name, ids in (("a", self.only_in_a), ("b", self.only_in_b)):
            rows += [(id, f"only in {name}", "", "", None) for id in ids]
        rows += [
            (change.id, change.field, _shown(change.a), _shown(change.b), change.error) for change in self._largest()
        ]
        rows += [(each.id, "statement lost", str(each), "", None) for each in self.lost]
        rows += [(each.id, "statement gained", "", str(each), None) for each in self.gained]
        return html_table(repr(self), ("id", "what", "a", "b", "error"), rows)

    def _summary(self) -> str:
        if self.identical():
            return "identical"
        kinds = Counter(str(change.kind) for change in self.changed)
        listed = f" ({', '.join(f'{kind} {number:,}' for kind, number in kinds.most_common())})" if kinds else ""
        alone = f"{len(self.only_in_a):,} only in a, {len(self.only_in_b):,} only in b"
        statements = f"{self.lost_facts:,} statements lost, {self.gained_facts:,} gained"
        return f"{alone}, {counted(len(self.changed), 'changed field')}{listed}, {statements}"

    def _largest(self) -> list[FieldChange]:
        """The changes by their error, those without one first."""
        return sorted(self.changed, key=lambda change: (change.error is not None, -(change.error or 0.0), change.id))

    def to_builtins(self, delta: float = 0.0) -> dict[str, Any]:
        """What `mindstage compare --json` promises, as dicts, lists, texts and numbers.

        Facts become lines of text, and numbers that JSON lacks the texts "nan", "inf", "-inf".
        """
        errors = self.max_error
        return {
            "identical": self.identical(delta),
            "delta": delta,
            "max_error": max(errors.values()),
            "errors": dict(errors),
            "only_in_a": list(self.only_in_a),
            "only_in_b": list(self.only_in_b),
            "changed": _change_rows(self.changed),
            "lost_facts": self.lost_facts,
            "gained_facts": self.gained_facts,
            "lost": _statement_rows(self.lost),
            "gained": _statement_rows(self.gained),
        }

    def to_json(self, delta: float = 0.0) -> str:
        """The same as a text."""
        return msgspec.json.encode(self.to_builtins(delta)).decode()


def diff(a: World, b: World) -> WorldDiff:
    """Compares everything that two worlds hold.

    Rotations are compared as rotations, numbers in facts by value. NaN is equal to NaN and to nothing else. Takes a
    time that grows with the number of things, and not with its square.
    """
    return _Comparison(a, b).result()


class _Comparison:
    """One run of the judge."""

    def __init__(self, a: World, b: World) -> None:
        self.a, self.b = a, b
        self.bodies = pair_bodies(a.bodies, b.bodies)
        self.ids = {y.id: x.id for x, y in self.bodies.matched() if x.id != y.id}
        """What a calls the bodies of b that have another id there."""
        self.joints = pair_joints(a.joints, b.joints, self.ids)
        self.lights = pair_lights(a.lights, b.lights)
        forms = StatementCanonicalizer()
        self.names = match_blank_nodes(a, b, self._known_names(), forms)
        """What a calls the things that b calls otherwise."""
        self.statements = StatementDiff(self.names, forms)

    @property
    def matched_pairs(self) -> Iterator[MatchedPairs[Body] | MatchedPairs[Joint] | MatchedPairs[Light]]:
        yield from (self.bodies, self.joints, self.lights)

    def result(self) -> WorldDiff:
        changes = [*self._field_changes(), *self._attachment_changes()]
        self._compare_statements()
        changes.extend(self.statements.changes)
        return WorldDiff(
            only_in_a=tuple(sorted(item.id for pairs in self.matched_pairs for item in pairs.only_in_a)),
            only_in_b=tuple(sorted(item.id for pairs in self.matched_pairs for item in pairs.only_in_b)),
            changed=tuple(sorted(changes, key=lambda change: (change.id, change.field))),
            lost=self.statements.lost,
            gained=self.statements.gained,
        )

    def _known_names(self) -> Iterator[tuple[str, str]]:
        yield self.a.iri, self.b.iri
        for pairs in self.matched_pairs:
            yield from ((x.iri, y.iri) for x, y in pairs.matched() if x.iri != y.iri or is_blank_node(x.iri))
        for pairs in self.matched_pairs:
            for x, y in pairs.matched():
                yield from part_name_pairs(x.facts, y.facts)

    def _field_changes(self) -> Iterator[FieldChange]:
        bodies, constraints, lights = self.bodies, self.joints, self.lights
        yield from compare_columns(WORLD_FIELDS, [self.a.iri], [self.a], [self._with_names_of_a(self.a, self.b)])
        yield from compare_columns(
            BODY_FIELDS, bodies.ids, bodies.a, [self._renamed_body(x, y) for x, y in bodies.matched()]
        )
        yield from compare_materials(bodies.ids, bodies.a, bodies.b)
        joined = [self._renamed_joint(x, y) for x, y in constraints.matched()]
        yield from compare_columns(JOINT_FIELDS, constraints.ids, constraints.a, joined)
        yield from compare_columns(
            LIGHT_FIELDS, lights.ids, lights.a, [self._with_names_of_a(x, y) for x, y in lights.matched()]
        )

    def _with_names_of_a(self, x: Entity, y: Entity) -> Entity:
        """A thing of b under the name that a has for it, where both names are none."""
        if is_blank_node(x.iri) and is_blank_node(y.iri):
            return replace(y, iri=self.names.get(y.iri, y.iri))
        return y

    def _renamed_body(self, x: Body, y: Body) -> Body:
        if is_blank_node(x.cls) and is_blank_node(y.cls):
            y = replace(y, cls=self.names.get(y.cls, y.cls))
        return self._with_names_of_a(x, y)

    def _renamed_joint(self, x: Joint, y: Joint) -> Joint:
        if self.ids:
            y = replace(y, parent=self.ids.get(y.parent, y.parent), child=self.ids.get(y.child, y.child))
        return self._with_names_of_a(x, y)

    def _attachment_changes(self) -> Iterator[FieldChange]:
        mine, theirs = _parents(self.a, {}), _parents(self.b, self.ids)
        for child in mine.keys() | theirs.keys():
            x, y = _one_or_more(mine.get(child, [])), _one_or_more(theirs.get(child, []))
            if x != y:
                yield FieldChange(id=child, field="attachment.parent", kind=ChangeKind.STRUCTURE, a=x, b=y)

    def _compare_statements(self) -> None:
        self.statements.facts(self.a.iri, self.a.facts, self.b.facts)
        self.statements.resources(self.a.resources, self.b.resources)
        for pairs in self.matched_pairs:
            for x, y in pairs.matched():
                self.statements.facts(x.id, x.facts, y.facts)
                self.statements.tags(x.id, x.tags, y.tags)
            for x in pairs.only_in_a:
                self.statements.only_in_a(x.id, (*x.facts, *x.tags))
            for y in pairs.only_in_b:
                self.statements.only_in_b(y.id, (*y.facts, *y.tags))


def _parents(world: World, ids: Mapping[BodyId, BodyId]) -> Mapping[BodyId, list[BodyId]]:
    parents: dict[BodyId, list[BodyId]] = defaultdict(list)
    for attachment in world.attachments:
        parents[ids.get(attachment.child, attachment.child)].append(ids.get(attachment.parent, attachment.parent))
    return parents


def _one_or_more(ids: list[BodyId]) -> str | tuple[str, ...] | None:
    return tuple(sorted(ids)) if len(ids) > 1 else ids[0] if ids else None


def _some(ids: Sequence[str]) -> str:
    left = len(ids) - _MOST_SHOWN
    return ", ".join(ids[:_MOST_SHOWN]) + (f" and {left:,} more" if left > 0 else "")


def _change(change: FieldChange) -> str:
    error = "" if change.error is None else f" ({change.kind} {change.error:.4g})"
    return f"{_shown(change.a)} -> {_shown(change.b)}{error}"


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = f"({', '.join(map(_shown, value))})" if isinstance(value, tuple) else str(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


_JSON_NAMES = {
    "soft_limit": "soft",
    "swing_soft_limit": "swing_soft",
    "twist_soft_limit": "twist_soft",
    "type": "kind",
    "color": "colour",
}
"""Attributes whose name in JSON differs."""


def _change_rows(changes: Iterable[FieldChange]) -> list[dict[str, Any]]:
    return [
        {
            "id": change.id,
            "field": ".".join(_JSON_NAMES.get(part, part) for part in change.field.split(".")),
            "kind": change.kind.value,
            "a": _jsonable(change.a),
            "b": _jsonable(change.b),
            "error": change.error,
        }
        for change in changes
    ]


def _statement_rows(statements: Iterable[Statement]) -> list[dict[str, str]]:
    return [{"id": statement.id, "said": str(statement)} for statement in statements]


def _jsonable(value: Any) -> Any:
    """What JSON can say of a change's value."""
    if isinstance(value, tuple):
        return [_jsonable(part) for part in value]
    if isinstance(value, PropertyAssertion):
        return str(Statement("", value))
    if isinstance(value, float) and not isfinite(value):
        return str(value)
    return msgspec.to_builtins(value)
