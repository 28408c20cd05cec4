"""What two worlds say about the same things, and what only one of them says."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable, Mapping, Sequence

from mindstage.world.comparison_facts import Forms, Statement, missing
from mindstage.world.comparison_fields import Change, Kind
from mindstage.world.facts import Fact, Resource
from mindstage.world.values import Tag

__all__ = ["Statements"]


class Statements:
    """Collects, thing by thing, the statements that one world makes and the other does not."""

    def __init__(self, names: Mapping[str, str], forms: Forms) -> None:
        """Takes what a calls the things that b calls otherwise, and the table to compare with."""
        self._names, self._forms = names, forms
        self.changes: list[Change] = []
        self._lost: list[Statement] = []
        self._gained: list[Statement] = []

    @property
    def lost(self) -> tuple[Statement, ...]:
        """What only a says."""
        return tuple(sorted(self._lost, key=_order))

    @property
    def gained(self) -> tuple[Statement, ...]:
        """What only b says."""
        return tuple(sorted(self._gained, key=_order))

    def tags(self, id: str, a: Sequence[Tag], b: Sequence[Tag]) -> None:
        """Compares the tags of a thing that both have."""
        if a != b:
            self._note(id, Kind.TAGS, _missing_tags(a, b), _missing_tags(b, a))

    def facts(self, id: str, a: Sequence[Fact], b: Sequence[Fact]) -> None:
        """Compares the facts of a thing that both have."""
        if self._names or not _same_words(a, b):
            mine = [self._forms.number(fact, {}) for fact in a]
            theirs = [self._forms.number(fact, self._names) for fact in b]
            self._note(id, Kind.FACTS, missing(a, mine, theirs), missing(b, theirs, mine))

    def only_in_a(self, id: str, said: Iterable[Fact | Tag]) -> None:
        """Counts what is lost together with the thing that it is about."""
        self._lost.extend(Statement(id, statement) for statement in said)

    def only_in_b(self, id: str, said: Iterable[Fact | Tag]) -> None:
        """Counts what is gained together with the thing that it is about."""
        self._gained.extend(Statement(id, statement) for statement in said)

    def resources(self, a: Iterable[Resource], b: Iterable[Resource]) -> None:
        """Compares what is said about anything else."""
        mine, theirs = _gathered(a, {}), _gathered(b, self._names)
        for iri in mine.keys() & theirs.keys():
            self.facts(iri, mine[iri], theirs[iri])
        for iri in mine.keys() - theirs.keys():
            self.only_in_a(iri, mine[iri])
            self.changes.append(Change(id=iri, field="resource", kind=Kind.FACTS, a=_sorted(mine[iri]), b=None))
        for iri in theirs.keys() - mine.keys():
            self.only_in_b(iri, theirs[iri])
            self.changes.append(Change(id=iri, field="resource", kind=Kind.FACTS, a=None, b=_sorted(theirs[iri])))

    def _note(self, id: str, kind: Kind, lost: Sequence[Fact | Tag], gained: Sequence[Fact | Tag]) -> None:
        if lost or gained:
            self.only_in_a(id, lost)
            self.only_in_b(id, gained)
            self.changes.append(Change(id=id, field=kind.value, kind=kind, a=_sorted(lost), b=_sorted(gained)))


def _gathered(resources: Iterable[Resource], names: Mapping[str, str]) -> Mapping[str, list[Fact]]:
    facts: dict[str, list[Fact]] = defaultdict(list)
    for resource in resources:
        facts[names.get(resource.iri, resource.iri)].extend(resource.facts)
    return facts


def _missing_tags(tags: Sequence[Tag], others: Sequence[Tag]) -> tuple[Tag, ...]:
    return missing(tags, map(_tag_form, tags), map(_tag_form, others))


def _tag_form(tag: Tag) -> Hashable:
    return (tag.type, tag.key, tag.value)


def _same_words(a: Sequence[Fact], b: Sequence[Fact]) -> bool:
    """The fast way to know that nothing differs."""
    try:
        return a == b
    except RecursionError:  # == follows lists in lists only so deep, Forms to any depth
        return False


def _sorted(said: Iterable[Fact | Tag]) -> tuple[Fact | Tag, ...]:
    return tuple(sorted(said, key=_said_order))


def _said_order(said: Fact | Tag) -> tuple[str, ...]:
    """As good an order as any, as long as it does not hang on that of the world."""
    if isinstance(said, Tag):
        return (said.type, said.key, said.value)
    return (said.property, str(Statement("", said)))


def _order(statement: Statement) -> tuple[str, ...]:
    return (statement.id, *_said_order(statement.said))
