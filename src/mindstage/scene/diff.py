"""The judge: everything that two worlds do not agree on, and by how much.

`diff` compares all that a World holds. Order carries no meaning, so tags, facts and things are compared as sets
that count repetitions; only materials keep their order, since a mesh names its surfaces by number. What a world holds
twice under one id is compared in its order. Names that mean something only inside their own world may differ, what
they stand for may not.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from math import isfinite
from typing import Any, TypeVar

import msgspec
from msgspec.structs import replace

from mindstage.world.comparison_facts import Statement, StatementCanonicalizer
from mindstage.world.comparison_fields import (
    BODY_FIELDS,
    JOINT_FIELDS,
    LIGHT_FIELDS,
    MEASURED_KINDS,
    WORLD_FIELDS,
    ChangeKind,
    FieldChange,
    compare_columns,
    compare_materials,
)
from mindstage.world.comparison_names import is_blank_node, match_blank_nodes, part_name_pairs
from mindstage.world.comparison_pairs import MatchedPairs, pair_bodies, pair_joints, pair_lights
from mindstage.world.comparison_statements import StatementDiff
from mindstage.world.display import counted, html_table
from mindstage.world.facts import PropertyAssertion
from mindstage.world.values import Body, BodyId, Joint, Light, World

__all__ = ["WorldDiff", "diff"]

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
