"""What two worlds say about the same things, and what only one of them says."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable, Mapping, Sequence

from mindstage.world.comparison_facts import Statement, StatementCanonicalizer, multiset_difference
from mindstage.world.comparison_fields import ChangeKind, FieldChange
from mindstage.world.facts import NamedResource, PropertyAssertion
from mindstage.world.values import Tag

__all__ = ["StatementDiff"]


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
