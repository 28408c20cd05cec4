"""Names of one world found again in another: what a thing is called there does not matter, what it is does.

Most things keep their name. A map that was written anew has a new name, and so have the parts that it describes its
things by, such as their poses. A label (`_:…`) means something only inside its own world. Labels are matched one to
one: first by the place that they are mentioned at, then by everything that is said about them and with them. A match
that is wrong can only show differences that are none; it cannot hide any, since all that is said is still compared
under the names that were found.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping

from mindstage.world.comparison_facts import Forms
from mindstage.world.facts import Anonymous, Fact, Iri, Reference, Resource
from mindstage.world.values import Body, Constraint, Light, World

__all__ = ["is_label", "part_names", "same_names"]

KNOWROB = "http://knowrob.org/kb/knowrob.owl#"
PARTS = frozenset(KNOWROB + name for name in ("pose", "linearConstraint", "angularConstraint"))
"""Who writes a map makes up a name for each of these; what they say stands in fields, and those are compared."""

ROUNDS = 8
"""How far around a label one looks at most to tell it from others."""
GUESSES = 16
"""How often one guesses between labels that look alike, to see whether that tells others apart."""

Place = tuple[str, str]
"""Who says it, and by which property."""
Group = tuple[list[str], list[str]]
"""Labels of a and labels of b, all of one colour."""


def is_label(name: str) -> bool:
    """Whether a name means something only inside its own world."""
    return name.startswith("_:")


def same_names(a: World, b: World, known: Iterable[tuple[str, str]], forms: Forms) -> Mapping[str, str]:
    """For names in b that mean something else in a, or nothing: the name in a, or one that nothing has.

    Args:
        a: one world.
        b: the other.
        known: names in a and b of the same thing; one that was given before is not given again.
        forms: the table that the statements of both are compared with.
    """
    names: dict[str, str] = {}
    taken: set[str] = set()
    for mine, theirs in known:
        if mine not in taken and theirs not in names:
            names[theirs] = mine
            taken.add(mine)
    labels_a, labels_b = _Labels(a), _Labels(b)
    if labels_a.all or labels_b.all:
        _Matching(labels_a, labels_b, names, forms).run()
    for other in set(names.values()).difference(names):
        names[other] = f"{other} of b"  # no name holds a blank, so this one stands for nothing in a
    return {theirs: mine for theirs, mine in names.items() if theirs != mine}


def part_names(a: Iterable[Fact], b: Iterable[Fact]) -> Iterator[tuple[str, str]]:
    """The names in a and b of the parts of one thing, where those are not the same."""
    mine, theirs = _parts(a), _parts(b)
    for property in sorted(mine.keys() & theirs.keys()):
        if len(mine[property]) == len(theirs[property]) == 1 and mine[property] != theirs[property]:
            yield mine[property][0], theirs[property][0]


def _parts(facts: Iterable[Fact]) -> Mapping[str, list[str]]:
    parts: dict[str, list[str]] = defaultdict(list)
    for fact in facts:
        if fact.property in PARTS and isinstance(fact.value, Reference):
            parts[fact.property].append(fact.value.iri)
    return parts


def _statements(world: World) -> Iterator[tuple[Iri, Iterable[Fact]]]:
    owners: list[World | Body | Constraint | Light | Resource]
    owners = [world, *world.bodies, *world.constraints, *world.lights, *world.resources]
    yield from ((owner.iri, owner.facts) for owner in owners)
    for body in world.bodies:
        if is_label(body.cls):
            yield body.iri, (Fact(Iri("cls"), Reference(body.cls)),)


def _labels_in(fact: Fact) -> Iterator[str]:
    waiting = [fact]
    while waiting:
        value = waiting.pop().value
        if isinstance(value, Anonymous):
            waiting.extend(value.facts)
        elif isinstance(value, Reference) and is_label(value.iri):
            yield value.iri


class _Labels:
    """The labels of one world, and where they stand."""

    def __init__(self, world: World) -> None:
        self.said_by: dict[str, list[Fact]] = defaultdict(list)
        """What is said about a label."""
        self.said_with: dict[str, list[tuple[str, Fact]]] = defaultdict(list)
        """Who mentions a label, and how."""
        self.at: dict[Place, set[str]] = defaultdict(set)
        self.places: dict[str, list[Place]] = defaultdict(list)
        """Where a name, label or not, mentions labels."""
        mentioned: set[str] = set()
        for owner, facts in _statements(world):
            if facts and is_label(owner):
                mentioned.add(owner)
                self.said_by[owner].extend(facts)
            for fact in facts:
                value = fact.value
                if not isinstance(value, Anonymous) and not (isinstance(value, Reference) and is_label(value.iri)):
                    continue
                for label in _labels_in(fact):
                    mentioned.add(label)
                    self.said_with[label].append((owner, fact))
                    self.at[owner, fact.property].add(label)
        for place in sorted(self.at):
            self.places[place[0]].append(place)
        self.all = sorted(mentioned)
        """By their text: which of two equal ones comes first must not hang on the order of the world."""


class _Matching:
    """The search for pairs; `names` (from b's to a's) grows while it runs."""

    def __init__(self, a: _Labels, b: _Labels, names: dict[str, str], forms: Forms) -> None:
        self.a, self.b, self.names, self.forms = a, b, names, forms
        self.taken = {mine: theirs for theirs, mine in names.items()}
        """The same from a's to b's."""

    def run(self) -> None:
        """Looks at places first, since those still tell labels apart when something was lost on the way."""
        self._follow([self.names.get(name, name) for name in self.b.places if name in self.names or not is_label(name)])
        groups = self._groups()
        for _ in range(GUESSES):
            if groups:
                groups = self._narrowed(groups)
        for group in groups:
            self._pair_all(group)
        for label in sorted(set(self.b.all).intersection(self.a.all)):
            self._pair(label, label)

    def _narrowed(self, groups: list[Group]) -> list[Group]:
        """The groups that are left once what is alone in its group is paired, and one guess is made."""
        for group in groups:
            if len(group[0]) == len(group[1]) == 1:
                self._pair_all(group)
        alike = [group for group in groups if len(group[0]) + len(group[1]) > 2]
        if not alike:
            return []
        known = len(self.names)
        self._pair(alike[0][0][0], alike[0][1][0])
        narrower = self._groups()
        if len(self.names) == known + 1 and len(narrower) == len(alike):
            # It told no others apart, so the rest of its group is as interchangeable.
            self._pair_all(alike[0])
        return [group for group in narrower if group[0][0] not in self.taken]

    def _pair_all(self, group: Group) -> None:
        for mine, theirs in zip(*group, strict=False):
            self._pair(mine, theirs)

    def _pair(self, mine: str, theirs: str) -> None:
        if mine not in self.taken and theirs not in self.names:
            self.names[theirs], self.taken[mine] = mine, theirs
            self._follow([mine])

    def _follow(self, owners: list[str]) -> None:
        """Pairs labels that stand alone at the same place, then those at their places, and so on."""
        while owners:
            owner = owners.pop()
            for place in self.a.places.get(owner, ()):
                there = self.b.at.get((self.taken.get(owner, owner), place[1]), ())
                mine = [label for label in self.a.at[place] if label not in self.taken]
                theirs = [label for label in there if label not in self.names]
                if len(mine) == len(theirs) == 1:
                    self.names[theirs[0]], self.taken[mine[0]] = mine[0], theirs[0]
                    owners.append(mine[0])

    def _groups(self) -> list[Group]:
        """The labels of both that are still alone, in groups that nothing said about or with them tells apart."""
        a = {label: label if label in self.taken else "" for label in self.a.all}
        b = {label: self.names.get(label, "") for label in self.b.all}
        colours = 0
        for _ in range(ROUNDS):
            table: dict[object, str] = {}
            a = self._recoloured(self.a, a, a, table)
            b = self._recoloured(self.b, b, {**self.names, **b}, table)
            if len(table) == colours:
                break
            colours = len(table)
        mine, theirs = _grouped(a, self.taken), _grouped(b, self.names)
        return [(mine[colour], theirs[colour]) for colour in mine if colour in theirs]

    def _recoloured(
        self, labels: _Labels, colours: Mapping[str, str], names: Mapping[str, str], table: dict[object, str]
    ) -> dict[str, str]:
        numbers: dict[int, int] = {}

        def number(fact: Fact) -> int:
            if id(fact) not in numbers:
                numbers[id(fact)] = self.forms.number(fact, names)
            return numbers[id(fact)]

        def colour(label: str) -> str:
            about = sorted(number(fact) for fact in labels.said_by[label])
            with_it = labels.said_with[label]
            around = sorted((owner == label, names.get(owner, owner), number(fact)) for owner, fact in with_it)
            return table.setdefault((colours[label], *about, *around), f"colour {len(table)}")

        paired = self.taken if labels is self.a else self.names
        return {label: old if label in paired else colour(label) for label, old in colours.items()}


def _grouped(colours: Mapping[str, str], paired: Mapping[str, str]) -> Mapping[str, list[str]]:
    groups: dict[str, list[str]] = defaultdict(list)
    for label, colour in colours.items():
        if label not in paired:
            groups[colour].append(label)
    return groups
