"""Comparison of two worlds: all differences, with measured errors where the values are numbers.

`diff` compares everything that a World contains. Order has no meaning: tags, facts and parts are compared as multisets.
Only materials keep their order, since meshes refer to them by index. Objects with equal ids are compared in order.
Blank node labels may differ between the worlds; what they stand for may not.

Parts are paired by id. A part whose IRI is a blank node label has no persistent id; such parts are paired by the bodies
that they connect or by their class, and in the order of their poses among equals. A suboptimal pair can only report
differences that are none, since every field of a pair is compared.

Fields are compared in columns with NumPy, so that ten thousand bodies take as many array operations as ten. NaN equals
NaN and nothing else: a world is equal to itself.
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

from mindstage.ranges import NotNegative, checked
from mindstage.scene.blank_node_matching import (
    Statement,
    StatementCanonicalizer,
    is_blank_node,
    match_blank_nodes,
    multiset_difference,
    part_name_pairs,
)
from mindstage.scene.display import counted, html_table
from mindstage.scene.transforms import quat_angle
from mindstage.scene.world_model import Body, BodyId, Joint, Light, NamedResource, PropertyAssertion, Tag, World

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
    """The kind of a change. Those in `MEASURED_KINDS` have an error in the unit stated here."""

    TRANSLATION = "translation_m"
    """The distance between two positions [m]."""
    ROTATION = "rotation_rad"
    """The smallest angle between two rotations [rad]; q and -q are equal, and norms are ignored."""
    SIZE = "size_m"
    """The largest difference of the three extents [m]."""
    MASS = "mass_kg"
    LIMIT = "limit"
    """The limit of a joint, or the middle of its range: linear [m] or angular [rad]."""
    STIFFNESS = "stiffness"
    """[N/m] or [Nm/rad]."""
    DAMPING = "damping"
    """[Ns/m] or [Nms/rad]."""
    COLOR = "color"
    """The color of a material or a light: the largest difference of the three channels, each 0 to 1."""
    INTENSITY = "intensity"
    """The intensity of a light [cd or lx]."""
    NAME = "name"
    """IRI, label, or name of the world."""
    CLASS = "class"
    """The class of a body or the type of a light."""
    APPEARANCE = "appearance"
    """Mesh, shape, materials."""
    PHYSICS = "physics"
    """Mobility, gravity, overlap events."""
    MOTION = "motion"
    """The axes of a joint, its soft limits, and whether its bodies collide."""
    STRUCTURE = "structure"
    """The bodies of a joint, and attachments."""
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
"""The kinds of changes with an error."""

MECHANICAL_KINDS = frozenset({ChangeKind.TRANSLATION, ChangeKind.ROTATION, ChangeKind.MASS, ChangeKind.LIMIT})
"""The kinds that matter for mechanics: poses, masses and joint limits."""

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
    "mimic": ChangeKind.MOTION,
}

LIGHT_FIELDS: Mapping[str, ChangeKind] = {
    "iri": ChangeKind.NAME,
    "type": ChangeKind.CLASS,
    **_POSE,
    "color": ChangeKind.COLOR,
    "intensity": ChangeKind.INTENSITY,
}


class FieldChange(msgspec.Struct, frozen=True, kw_only=True):
    """A field with different values in the two worlds."""

    id: str
    """The id of a body, joint or light, or the IRI of a resource or of the world."""
    field: str
    """The path of the attribute: `pose.position`, `linear.limit`."""
    kind: ChangeKind
    a: Any
    """The value in the first world, None if missing. For tags and facts: those that the second world lacks."""
    b: Any
    """The value in the second world, None if missing. For tags and facts: those that the first world lacks."""
    error: float | None = None
    """The difference of the values, in the unit of the kind.

    None if it is not a finite number: for kinds that are not measured, a missing value, NaN or infinity.
    """


def compare_columns(
    fields: Mapping[str, ChangeKind], ids: Sequence[str], a: Sequence[World | Body | Joint | Light], b: Sequence[Any]
) -> Iterator[FieldChange]:
    """Yields the changes of all fields of objects of one type, comparing a[i] with b[i].

    A mobility that is assumed counts as none.
    """
    for path, kind in fields.items():
        get = attrgetter(path.replace("physics.mobility", "physics.stated_mobility"))
        yield from compare_column(path, kind, ids, [get(item) for item in a], [get(item) for item in b])


def compare_materials(ids: Sequence[str], a: Sequence[Body], b: Sequence[Body]) -> Iterator[FieldChange]:
    """Yields the changes of materials: first names, paths and order, then the color of each."""
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
    """Yields the changes of one field."""
    if kind not in MEASURED_KINDS:
        for owner, x, y in zip(ids, a, b, strict=True):
            if x != y:
                yield FieldChange(id=owner, field=field, kind=kind, a=x, b=y)
        return
    errors = _measured_errors(kind, a, b)
    for row in np.flatnonzero(errors != 0.0).tolist():
        error = float(errors[row])
        yield FieldChange(
            id=ids[row], field=field, kind=kind, a=a[row], b=b[row], error=error if isfinite(error) else None
        )


def _measured_errors(kind: ChangeKind, a: Sequence[Any], b: Sequence[Any]) -> Array:
    """Returns the error of each pair; NaN or infinite where it is not defined."""
    width = (
        4
        if kind is ChangeKind.ROTATION
        else 3
        if kind in (ChangeKind.TRANSLATION, ChangeKind.SIZE, ChangeKind.COLOR)
        else 1
    )
    x, y = _array(a, width), _array(b, width)
    present_a, present_b = (np.array([value is not None for value in values], dtype=bool) for values in (a, b))
    same = np.all((x == y) | (np.isnan(x) & np.isnan(y)), axis=1) & (present_a == present_b)
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
    """Returns Euclidean norms without underflow or overflow of the squares."""
    longest = np.max(np.abs(vectors), axis=1, initial=0.0)
    scale = np.where(longest > 0.0, longest, 1.0)
    return np.asarray(longest * np.linalg.norm(vectors / scale[:, None], axis=1))


def _rotation_angles(a: Array, b: Array) -> Array:
    """Returns the angles between rotations [rad]; NaN if either quaternion is zero."""
    rescaled = []
    for q in (a, b):
        longest = np.max(np.abs(q), axis=1, initial=0.0)
        _, exponent = np.frexp(longest)  # scaling by a power of two is exact
        rescaled.append(np.where((longest > 0.0)[:, None], np.ldexp(q, -exponent[:, None]), np.nan))
    return quat_angle(*rescaled)


Item = TypeVar("Item", Body, Joint, Light)


@dataclass(slots=True)
class MatchedPairs(Generic[Item]):
    """Objects of two worlds, of which a[i] corresponds to b[i]."""

    a: list[Item] = field(default_factory=list)
    b: list[Item] = field(default_factory=list)
    only_in_a: list[Item] = field(default_factory=list)
    only_in_b: list[Item] = field(default_factory=list)

    def matched(self) -> Iterator[tuple[Item, Item]]:
        """Yields the pairs (a[i], b[i])."""
        return zip(self.a, self.b, strict=True)

    @property
    def ids(self) -> list[str]:
        """The ids of the pairs, which are those in a."""
        return [item.id for item in self.a]


def pair_bodies(a: Iterable[Body], b: Iterable[Body]) -> MatchedPairs[Body]:
    """Pairs bodies by id, and blank nodes by class, label and mesh."""

    def key(body: Body) -> Hashable:
        return (None if is_blank_node(body.cls) else body.cls, body.label, body.mesh)

    return _pair(a, b, key, key)


def pair_lights(a: Iterable[Light], b: Iterable[Light]) -> MatchedPairs[Light]:
    """Pairs lights by id, and blank nodes by type."""
    return _pair(a, b, lambda light: light.type, lambda light: light.type)


def pair_joints(a: Iterable[Joint], b: Iterable[Joint], ids: Mapping[BodyId, BodyId]) -> MatchedPairs[Joint]:
    """Pairs joints by id, and blank nodes by their bodies; `ids` maps ids of bodies in b to those in a."""

    def key_a(joint: Joint) -> Hashable:
        return (joint.parent, joint.child)

    def key_b(joint: Joint) -> Hashable:
        return (ids.get(joint.parent, joint.parent), ids.get(joint.child, joint.child))

    return _pair(a, b, key_a, key_b)


def _pair(
    a: Iterable[Item], b: Iterable[Item], key_a: Callable[[Item], Hashable], key_b: Callable[[Item], Hashable]
) -> MatchedPairs[Item]:
    named = _match(a, b, lambda item: item.id, lambda item: item.id)
    blank_a, rest_a = _split_blank_nodes(named.only_in_a)
    blank_b, rest_b = _split_blank_nodes(named.only_in_b)
    blank = _match(sorted(blank_a, key=_pose_key), sorted(blank_b, key=_pose_key), key_a, key_b)
    return MatchedPairs(named.a + blank.a, named.b + blank.b, rest_a + blank.only_in_a, rest_b + blank.only_in_b)


def _match(
    a: Iterable[Item], b: Iterable[Item], key_a: Callable[[Item], Hashable], key_b: Callable[[Item], Hashable]
) -> MatchedPairs[Item]:
    """Pairs items with equal keys in order: the first with the first, the second with the second."""
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


def _split_blank_nodes(items: Iterable[Item]) -> tuple[list[Item], list[Item]]:
    blank: list[Item] = []
    named: list[Item] = []
    for item in items:
        (blank if is_blank_node(item.iri) else named).append(item)
    return blank, named


def _pose_key(item: Item) -> tuple[float, ...]:
    return (*item.pose.position, *item.pose.quaternion)


class StatementDiff:
    """Collects the statements that are in only one of two worlds."""

    def __init__(self, names: Mapping[str, str], canonicalizer: StatementCanonicalizer) -> None:
        """Stores the names of b with another name in a, and the canonicalizer of both worlds."""
        self._names, self._canonicalizer = names, canonicalizer
        self.changes: list[FieldChange] = []
        self._lost: list[Statement] = []
        self._gained: list[Statement] = []

    @property
    def lost(self) -> tuple[Statement, ...]:
        """The statements that are only in a."""
        return tuple(sorted(self._lost, key=_statement_order))

    @property
    def gained(self) -> tuple[Statement, ...]:
        """The statements that are only in b."""
        return tuple(sorted(self._gained, key=_statement_order))

    def tags(self, id: str, a: Sequence[Tag], b: Sequence[Tag]) -> None:
        """Compares the tags of an object that is in both worlds."""
        if a != b:
            self._record_change(id, ChangeKind.TAGS, _missing_tags(a, b), _missing_tags(b, a))

    def facts(self, id: str, a: Sequence[PropertyAssertion], b: Sequence[PropertyAssertion]) -> None:
        """Compares the facts of an object that is in both worlds."""
        if self._names or not _literally_equal(a, b):
            mine = [self._canonicalizer.canonical_id(fact, {}) for fact in a]
            theirs = [self._canonicalizer.canonical_id(fact, self._names) for fact in b]
            self._record_change(
                id, ChangeKind.FACTS, multiset_difference(a, mine, theirs), multiset_difference(b, theirs, mine)
            )

    def only_in_a(self, id: str, assertions: Iterable[PropertyAssertion | Tag]) -> None:
        """Records the statements about an object that is only in a."""
        self._lost.extend(Statement(id, statement) for statement in assertions)

    def only_in_b(self, id: str, assertions: Iterable[PropertyAssertion | Tag]) -> None:
        """Records the statements about an object that is only in b."""
        self._gained.extend(Statement(id, statement) for statement in assertions)

    def resources(self, a: Iterable[NamedResource], b: Iterable[NamedResource]) -> None:
        """Compares the statements about other resources."""
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
    """A fast check for equality."""
    try:
        return a == b
    except RecursionError:  # deeply nested blank nodes: the canonicalizer handles any depth
        return False


def _sorted(assertions: Iterable[PropertyAssertion | Tag]) -> tuple[PropertyAssertion | Tag, ...]:
    return tuple(sorted(assertions, key=_assertion_order))


def _assertion_order(assertion: PropertyAssertion | Tag) -> tuple[str, ...]:
    """An order that does not depend on that of the world."""
    if isinstance(assertion, Tag):
        return (assertion.type, assertion.key, assertion.value)
    return (assertion.property, str(Statement("", assertion)))


def _statement_order(statement: Statement) -> tuple[str, ...]:
    return (statement.id, *_assertion_order(statement.assertion))


_MAX_LISTED = 10
"""Number of items of each kind that a summary lists."""
_MAX_TEXT_LENGTH = 60
"""Length at which values are truncated in a summary [characters]."""

Entity = TypeVar("Entity", World, Body, Joint, Light)


class WorldDiff(msgspec.Struct, frozen=True, kw_only=True):
    """The differences between two worlds, a and b, independent of the order of their parts."""

    only_in_a: tuple[str, ...] = ()
    """Ids of bodies, joints and lights that b lacks."""
    only_in_b: tuple[str, ...] = ()
    """Ids of bodies, joints and lights that a lacks."""
    changed: tuple[FieldChange, ...] = ()
    """The fields that differ, of objects in both worlds, sorted by id and field.

    The parent of an attachment is the field `attachment.parent` of the child; a resource that is in only one world is a
    change of its field `resource`.
    """
    lost: tuple[Statement, ...] = ()
    """Facts and tags of a that are not in b, including those of objects that are only in a."""
    gained: tuple[Statement, ...] = ()
    """Facts and tags of b that are not in a, including those of objects that are only in b."""

    @property
    def lost_facts(self) -> int:
        """The number of facts and tags of a that are not in b."""
        return len(self.lost)

    @property
    def gained_facts(self) -> int:
        """The number of facts and tags of b that are not in a."""
        return len(self.gained)

    @property
    def max_error(self) -> Mapping[str, float]:
        """The largest error of each measured kind, 0 without a difference; see `ChangeKind` for the units."""
        largest = dict.fromkeys((str(kind) for kind in MEASURED_KINDS), 0.0)
        for change in self.changed:
            if change.error is not None:
                largest[change.kind] = max(largest[change.kind], change.error)
        return largest

    @checked
    def identical(self, tolerance: NotNegative = 0.0, *, kinds: Container[ChangeKind] | None = None) -> bool:
        """Returns whether the worlds are equal within a tolerance.

        Differences without an error always count: a lost fact, another parent, a missing mass.

        Args:
            tolerance: the largest accepted error, in the unit of each kind.
            kinds: compare only these kinds, such as `MECHANICAL_KINDS`; objects in only one world always count.

        Raises:
            NumberRefusedError: the tolerance is negative or not finite.
        """
        return not (self.only_in_a or self.only_in_b or self.exceeding(tolerance, kinds=kinds))

    @checked
    def exceeding(
        self, tolerance: NotNegative = 0.0, *, kinds: Container[ChangeKind] | None = None
    ) -> tuple[FieldChange, ...]:
        """Returns the changes that exceed a tolerance; see `identical` for the arguments.

        Raises:
            NumberRefusedError: the tolerance is negative or not finite.
        """
        return tuple(
            change
            for change in self.changed
            if (kinds is None or change.kind in kinds) and (change.error is None or change.error > tolerance)
        )

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._summary()}>"

    def __str__(self) -> str:
        """A summary: the number of differences, the largest errors, and the largest changes."""
        lines = [self._summary()]
        for name, ids in (("a", self.only_in_a), ("b", self.only_in_b)):
            if ids:
                lines.append(f"only in {name}: {_listed(ids)}")
        if errors := [f"{kind} {error:.4g}" for kind, error in self.max_error.items() if error > 0.0]:
            lines.append(f"largest errors: {', '.join(errors)}")
        lines.extend(f"  {change.id} {change.field}: {_changed(change)}" for change in self._largest()[:_MAX_LISTED])
        if len(self.changed) > _MAX_LISTED:
            lines.append(f"  … and {counted(len(self.changed) - _MAX_LISTED, 'more change')}")
        for title, statements in (("lost", self.lost), ("gained", self.gained)):
            lines.extend(f"  {title}: {each.id} {each}" for each in statements[:_MAX_LISTED])
            if len(statements) > _MAX_LISTED:
                lines.append(f"  … and {len(statements) - _MAX_LISTED:,} more {title}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Returns the changes as an HTML table for notebooks, the largest first."""
        rows: list[tuple[object, ...]] = []
        for name, ids in (("a", self.only_in_a), ("b", self.only_in_b)):
            rows += [(id, f"only in {name}", "", "", None) for id in ids]
        rows += [
            (change.id, change.field, _short(change.a), _short(change.b), change.error) for change in self._largest()
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
        """Returns the changes by decreasing error, those without an error first."""
        return sorted(self.changed, key=lambda change: (change.error is not None, -(change.error or 0.0), change.id))

    @checked
    def to_builtins(self, delta: NotNegative = 0.0) -> dict[str, Any]:
        """Returns the output of `mindstage compare --json` as dicts, lists, strings and numbers.

        Facts are lines of text; non-finite numbers are the strings "nan", "inf" and "-inf".
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

    @checked
    def to_json(self, delta: NotNegative = 0.0) -> str:
        """Returns `to_builtins` as JSON text."""
        return msgspec.json.encode(self.to_builtins(delta)).decode()


def diff(a: World, b: World) -> WorldDiff:
    """Compares two worlds completely.

    Rotations are compared by their angle, numbers in facts by value. NaN is equal to NaN and to nothing else. The time
    is about linear in the number of objects.
    """
    return _Comparison(a, b).result()


class _Comparison:
    """One comparison of two worlds."""

    def __init__(self, a: World, b: World) -> None:
        self.a, self.b = a, b
        self.bodies = pair_bodies(a.bodies, b.bodies)
        self.ids = {y.id: x.id for x, y in self.bodies.matched() if x.id != y.id}
        """Ids in a of the bodies of b that have another id there."""
        self.joints = pair_joints(a.joints, b.joints, self.ids)
        self.lights = pair_lights(a.lights, b.lights)
        canonicalizer = StatementCanonicalizer()
        self.names = match_blank_nodes(a, b, self._known_names(), canonicalizer)
        """Names in a of the resources of b that have another name there."""
        self.statements = StatementDiff(self.names, canonicalizer)

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
        bodies, joints, lights = self.bodies, self.joints, self.lights
        yield from compare_columns(WORLD_FIELDS, [self.a.iri], [self.a], [self._with_names_of_a(self.a, self.b)])
        yield from compare_columns(
            BODY_FIELDS, bodies.ids, bodies.a, [self._renamed_body(x, y) for x, y in bodies.matched()]
        )
        yield from compare_materials(bodies.ids, bodies.a, bodies.b)
        yield from compare_columns(
            JOINT_FIELDS, joints.ids, joints.a, [self._renamed_joint(x, y) for x, y in joints.matched()]
        )
        yield from compare_columns(
            LIGHT_FIELDS, lights.ids, lights.a, [self._with_names_of_a(x, y) for x, y in lights.matched()]
        )

    def _with_names_of_a(self, x: Entity, y: Entity) -> Entity:
        """Returns an object of b with its IRI in a, if both IRIs are blank nodes."""
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


def _listed(ids: Sequence[str]) -> str:
    left = len(ids) - _MAX_LISTED
    return ", ".join(ids[:_MAX_LISTED]) + (f" and {left:,} more" if left > 0 else "")


def _changed(change: FieldChange) -> str:
    error = "" if change.error is None else f" ({change.kind} {change.error:.4g})"
    return f"{_short(change.a)} -> {_short(change.b)}{error}"


def _short(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = f"({', '.join(map(_short, value))})" if isinstance(value, tuple) else str(value)
    return text if len(text) <= _MAX_TEXT_LENGTH else f"{text[:_MAX_TEXT_LENGTH]}…"


def _change_rows(changes: Iterable[FieldChange]) -> list[dict[str, Any]]:
    return [
        {
            "id": change.id,
            "field": change.field,
            "kind": change.kind.value,
            "a": _jsonable(change.a),
            "b": _jsonable(change.b),
            "error": change.error,
        }
        for change in changes
    ]


def _statement_rows(statements: Iterable[Statement]) -> list[dict[str, str]]:
    return [{"id": statement.id, "note": str(statement)} for statement in statements]


def _jsonable(value: Any) -> Any:
    """Returns the value of a change as JSON types."""
    if isinstance(value, tuple):
        return [_jsonable(part) for part in value]
    if isinstance(value, PropertyAssertion):
        return str(Statement("", value))
    if isinstance(value, float) and not isfinite(value):
        return str(value)
    return msgspec.to_builtins(value)
