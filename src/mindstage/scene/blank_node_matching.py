"""Matching of blank nodes between two worlds, and canonical comparison of RDF statements.

Most resources have the same name in both worlds. A map that was written again has another IRI, and so have the nodes
that describe parts of its bodies, such as poses. The label of a blank node (`_:…`) is valid only within its own world.
Blank nodes are matched one to one: first by the position at which they are mentioned, then by all statements about and
with them (color refinement). A wrong match can only report differences that are none; it cannot hide any, since all
statements are still compared under the names that were matched.

Two statements have the same canonical id if they are equal: numbers of one datatype by value ("0.0" is "0.00" and
"0E0"), language tags without case, blank nodes by the statements about them in any order.
"""

from __future__ import annotations

import re
from collections import ChainMap, Counter, defaultdict
from collections.abc import Hashable, Iterable, Iterator, Mapping
from typing import TypeVar

import msgspec

from mindstage.scene.world_model import (
    BlankNode,
    Body,
    FactValue,
    Iri,
    IriRef,
    Joint,
    Light,
    Literal,
    NamedResource,
    PropertyAssertion,
    Tag,
    World,
)

__all__ = [
    "Statement",
    "StatementCanonicalizer",
    "is_blank_node",
    "match_blank_nodes",
    "multiset_difference",
    "part_name_pairs",
]


XSD = "http://www.w3.org/2001/XMLSchema#"
NUMERIC_DATATYPES = frozenset(
    XSD + name
    for name in (
        *("float", "double", "decimal", "integer", "nonPositiveInteger", "negativeInteger", "nonNegativeInteger"),
        *("positiveInteger", "long", "int", "short", "byte"),
        *("unsignedLong", "unsignedInt", "unsignedShort", "unsignedByte"),
    )
)
NUMBER_PATTERN = re.compile(r"[ \t\n\r]*([+-]?)(?=\.?[0-9])([0-9]*)\.?([0-9]*)(?:[eE]([+-]?[0-9]{1,9}))?[ \t\n\r]*")


class Statement(msgspec.Struct, frozen=True):
    """A fact or a tag with its subject; `str` formats the fact or tag as one line."""

    id: str
    """The id of a body, joint or light, or the IRI of a resource or of the world."""
    assertion: PropertyAssertion | Tag

    def __str__(self) -> str:
        if isinstance(self.assertion, Tag):
            return f"{self.assertion.type};{self.assertion.key},{self.assertion.value}"
        return format_assertion(self.assertion)


class StatementCanonicalizer:
    """Assigns equal ids to equal statements; one instance is used for both worlds.

    Nested blank nodes are processed from the inside out and without recursion, since an RDF list of a thousand items is
    a thousand levels deep.
    """

    def __init__(self) -> None:
        self._ids: dict[Hashable, int] = {}

    def canonical_id(self, fact: PropertyAssertion, names: Mapping[str, str]) -> int:
        """Returns the id of a fact after its names are replaced by those that `names` maps them to."""
        value = fact.value
        key = self._blank_node_id(value, names) if isinstance(value, BlankNode) else _leaf_key(value, names)
        return self._intern((fact.property, key))

    def _intern(self, key: Hashable) -> int:
        return self._ids.setdefault(key, len(self._ids))

    def _blank_node_id(self, root: BlankNode, names: Mapping[str, str]) -> int:
        done: dict[int, int] = {}
        waiting = [root]
        while waiting:
            inner = [fact.value for fact in waiting[-1].facts if isinstance(fact.value, BlankNode)]
            if undone := [value for value in inner if id(value) not in done]:
                waiting.extend(undone)
                continue
            node = waiting.pop()
            keys = (
                (
                    fact.property,
                    done[id(fact.value)] if isinstance(fact.value, BlankNode) else _leaf_key(fact.value, names),
                )
                for fact in node.facts
            )
            done[id(node)] = self._intern((None, *sorted(map(self._intern, keys))))
        return done[id(root)]


def _leaf_key(value: IriRef | Literal, names: Mapping[str, str]) -> Hashable:
    if isinstance(value, IriRef):
        return ("iri", names.get(value.iri, value.iri))
    number = _parse_decimal(value.text) if value.datatype in NUMERIC_DATATYPES else None
    datatype = None if value.datatype == XSD + "string" else value.datatype
    return ("literal", number or value.text, datatype, value.language and value.language.lower())


def _parse_decimal(text: str) -> tuple[str, str, int] | None:
    """Returns sign, digits and exponent of a number, exactly for any length; None if it is no finite number."""
    match = NUMBER_PATTERN.fullmatch(text)
    if match is None:
        return None
    sign, whole, fraction, exponent = match.groups()
    digits = (whole + fraction).lstrip("0")
    shortest = digits.rstrip("0")
    if not shortest:
        return ("", "0", 0)
    return ("-" if sign == "-" else "", shortest, int(exponent or 0) - len(fraction) + len(digits) - len(shortest))


Item = TypeVar("Item")


def multiset_difference(
    items: Iterable[Item], keys: Iterable[Hashable], other_keys: Iterable[Hashable]
) -> tuple[Item, ...]:
    """Returns the items whose key is not among the other keys, counting repetitions."""
    left = Counter(other_keys)
    result = []
    for item, key in zip(items, keys, strict=True):
        if left[key] > 0:
            left[key] -= 1
        else:
            result.append(item)
    return tuple(result)


def format_assertion(fact: PropertyAssertion, *, max_depth: int = 3) -> str:
    """Formats a fact in the style of Turtle; blank nodes below `max_depth` are abbreviated."""
    return f"<{fact.property}> {_format_value(fact.value, max_depth)}"


def _format_value(value: FactValue, max_depth: int) -> str:
    if isinstance(value, IriRef):
        return value.iri if value.iri.startswith("_:") else f"<{value.iri}>"
    if isinstance(value, Literal):
        suffix = f"@{value.language}" if value.language else f"^^<{value.datatype}>" if value.datatype else ""
        return msgspec.json.encode(value.text).decode() + suffix
    if not value.facts:
        return "[]"
    inner = " ; ".join(format_assertion(fact, max_depth=max_depth - 1) for fact in value.facts) if max_depth else "…"
    return f"[ {inner} ]"


KNOWROB = "http://knowrob.org/kb/knowrob.owl#"
PART_PROPERTIES = frozenset(KNOWROB + name for name in ("pose", "linearConstraint", "angularConstraint"))
"""Properties whose values get new names when a map is written; their content is compared as fields of the world."""

MAX_REFINEMENT_ROUNDS = 8
"""Largest number of rounds of color refinement."""
MAX_GUESSES = 16
"""Largest number of arbitrary pairs that are tried to distinguish the remaining labels."""

MentionSite = tuple[str, str]
"""The subject and the property of a statement that mentions a label."""
Group = tuple[list[str], list[str]]
"""Labels of a and labels of b that all have the same color."""


def is_blank_node(name: str) -> bool:
    """Returns whether a name is the label of a blank node."""
    return name.startswith("_:")


def match_blank_nodes(
    a: World, b: World, known_pairs: Iterable[tuple[str, str]], canonicalizer: StatementCanonicalizer
) -> Mapping[str, str]:
    """Returns, for names of b that differ in a or clash with a name of a, the name in a or an unused one.

    Args:
        a: the first world.
        b: the second world.
        known_pairs: names in a and in b of the same resource; of several pairs with one name, the first counts.
        canonicalizer: compares the statements of both worlds.
    """
    names: dict[str, str] = {}
    taken: set[str] = set()
    for mine, theirs in known_pairs:
        if mine not in taken and theirs not in names:
            names[theirs] = mine
            taken.add(mine)
    labels_a, labels_b = _BlankNodeIndex(a), _BlankNodeIndex(b)
    if labels_a.labels or labels_b.labels:
        _BlankNodeMatcher(labels_a, labels_b, names, canonicalizer).run()
    for other in set(names.values()).difference(names):
        names[other] = f"{other} of b"  # names contain no space, so this one is unused in a
    return {theirs: mine for theirs, mine in names.items() if theirs != mine}


def part_name_pairs(a: Iterable[PropertyAssertion], b: Iterable[PropertyAssertion]) -> Iterator[tuple[str, str]]:
    """Yields the names in a and b of the parts of one resource, where they differ."""
    mine, theirs = _parts_by_property(a), _parts_by_property(b)
    for property in sorted(mine.keys() & theirs.keys()):
        if len(mine[property]) == len(theirs[property]) == 1 and mine[property] != theirs[property]:
            yield mine[property][0], theirs[property][0]


def _parts_by_property(facts: Iterable[PropertyAssertion]) -> Mapping[str, list[str]]:
    parts: dict[str, list[str]] = defaultdict(list)
    for fact in facts:
        if fact.property in PART_PROPERTIES and isinstance(fact.value, IriRef):
            parts[fact.property].append(fact.value.iri)
    return parts


def _statements(world: World) -> Iterator[tuple[Iri, Iterable[PropertyAssertion]]]:
    owners: list[World | Body | Joint | Light | NamedResource]
    owners = [world, *world.bodies, *world.joints, *world.lights, *world.resources]
    yield from ((owner.iri, owner.facts) for owner in owners)
    for body in world.bodies:
        if is_blank_node(body.cls):
            yield body.iri, (PropertyAssertion(Iri("cls"), IriRef(body.cls)),)


def _blank_nodes_in(fact: PropertyAssertion) -> Iterator[str]:
    waiting = [fact]
    while waiting:
        value = waiting.pop().value
        if isinstance(value, BlankNode):
            waiting.extend(value.facts)
        elif isinstance(value, IriRef) and is_blank_node(value.iri):
            yield value.iri


class _BlankNodeIndex:
    """The blank node labels of one world, and the statements that contain them."""

    def __init__(self, world: World) -> None:
        self.statements_about: dict[str, list[PropertyAssertion]] = defaultdict(list)
        """The statements about a label."""
        self.statements_mentioning: dict[str, list[tuple[str, PropertyAssertion]]] = defaultdict(list)
        """The subjects and statements that mention a label."""
        self.with_several_labels: set[int] = set()
        """The identities of the statements that mention more than one label."""
        self.labels_at: dict[MentionSite, set[str]] = defaultdict(set)
        self.mentions_by_owner: dict[str, list[MentionSite]] = defaultdict(list)
        """The sites at which a subject mentions labels."""
        mentioned: set[str] = set()
        for owner, facts in _statements(world):
            if facts and is_blank_node(owner):
                mentioned.add(owner)
                self.statements_about[owner].extend(facts)
            for fact in facts:
                value = fact.value
                if not isinstance(value, BlankNode) and not (isinstance(value, IriRef) and is_blank_node(value.iri)):
                    continue
                inside = list(_blank_nodes_in(fact))
                if len({*inside}) > 1:
                    self.with_several_labels.add(id(fact))
                for label in inside:
                    mentioned.add(label)
                    self.statements_mentioning[label].append((owner, fact))
                    self.labels_at[owner, fact.property].add(label)
        for site in sorted(self.labels_at):
            self.mentions_by_owner[site[0]].append(site)
        self.labels = sorted(mentioned)
        """Sorted, so that the choice between equal labels does not depend on the order of the world."""


class _BlankNodeMatcher:
    """Finds pairs of labels; `names` maps those of b to those of a and is extended in place."""

    def __init__(
        self, a: _BlankNodeIndex, b: _BlankNodeIndex, names: dict[str, str], canonicalizer: StatementCanonicalizer
    ) -> None:
        self.a, self.b, self.names, self.canonicalizer = a, b, names, canonicalizer
        self.reverse_names = {mine: theirs for theirs, mine in names.items()}
        """The inverse of `names`: from a to b."""

    def run(self) -> None:
        """Pairs by mention site first, which also works if statements were lost."""
        self._propagate(
            [
                self.names.get(name, name)
                for name in self.b.mentions_by_owner
                if name in self.names or not is_blank_node(name)
            ]
        )
        groups = self._ambiguous_groups()
        for _ in range(MAX_GUESSES):
            if groups:
                groups = self._refine_groups(groups)
        for group in groups:
            self._pair_group(group)
        for label in sorted(set(self.b.labels).intersection(self.a.labels)):
            self._pair(label, label)

    def _refine_groups(self, groups: list[Group]) -> list[Group]:
        """Pairs groups of one label each and two labels of another group arbitrarily; returns the remaining groups."""
        for group in groups:
            if len(group[0]) == len(group[1]) == 1:
                self._pair_group(group)
        alike = [group for group in groups if len(group[0]) + len(group[1]) > 2]
        if not alike:
            return []
        known = len(self.names)
        self._pair(alike[0][0][0], alike[0][1][0])
        narrower = self._ambiguous_groups()
        if len(self.names) == known + 1 and len(narrower) == len(alike):
            # No other labels were distinguished by it, so the labels of this group are interchangeable.
            self._pair_group(alike[0])
        return [group for group in narrower if group[0][0] not in self.reverse_names]

    def _pair_group(self, group: Group) -> None:
        for mine, theirs in zip(*group, strict=False):
            self._pair(mine, theirs)

    def _pair(self, mine: str, theirs: str) -> None:
        if mine not in self.reverse_names and theirs not in self.names:
            self.names[theirs], self.reverse_names[mine] = mine, theirs
            self._propagate([mine])

    def _propagate(self, owners: list[str]) -> None:
        """Pairs labels that are the only ones at the same site, then those at the sites of these, and so on."""
        while owners:
            owner = owners.pop()
            for site in self.a.mentions_by_owner.get(owner, ()):
                there = self.b.labels_at.get((self.reverse_names.get(owner, owner), site[1]), ())
                mine = [label for label in self.a.labels_at[site] if label not in self.reverse_names]
                theirs = [label for label in there if label not in self.names]
                if len(mine) == len(theirs) == 1:
                    self.names[theirs[0]], self.reverse_names[mine[0]] = mine[0], theirs[0]
                    owners.append(mine[0])

    def _ambiguous_groups(self) -> list[Group]:
        """Returns the unpaired labels of both worlds, grouped by color: no statement distinguishes those of a group."""
        a = {label: label if label in self.reverse_names else "" for label in self.a.labels}
        b = {label: self.names.get(label, "") for label in self.b.labels}
        colors = 0
        for _ in range(MAX_REFINEMENT_ROUNDS):
            table: dict[object, str] = {}
            a = self._refine_colors(self.a, a, a, table)
            b = self._refine_colors(self.b, b, {**self.names, **b}, table)
            if len(table) == colors:
                break
            colors = len(table)
        mine, theirs = _group_by_color(a, self.reverse_names), _group_by_color(b, self.names)
        return [(mine[color], theirs[color]) for color in mine if color in theirs]

    def _refine_colors(
        self, labels: _BlankNodeIndex, colors: Mapping[str, str], names: Mapping[str, str], table: dict[object, str]
    ) -> dict[str, str]:
        numbers: dict[tuple[int, str], int] = {}

        def number(fact: PropertyAssertion, label: str) -> int:
            # Of several labels in one statement, each has its own place, so this one gets a name of its own.
            place = label if id(fact) in labels.with_several_labels else ""
            if (id(fact), place) not in numbers:
                own = ChainMap({place: "this"}, names) if place else names  # type: ignore[arg-type]
                numbers[id(fact), place] = self.canonicalizer.canonical_id(fact, own)
            return numbers[id(fact), place]

        def color(label: str) -> str:
            about = sorted(number(fact, label) for fact in labels.statements_about[label])
            mentions = labels.statements_mentioning[label]
            around = sorted((owner == label, names.get(owner, owner), number(fact, label)) for owner, fact in mentions)
            return table.setdefault((colors[label], *about, *around), f"color {len(table)}")

        paired = self.reverse_names if labels is self.a else self.names
        return {label: old if label in paired else color(label) for label, old in colors.items()}


def _group_by_color(colors: Mapping[str, str], paired: Mapping[str, str]) -> Mapping[str, list[str]]:
    groups: dict[str, list[str]] = defaultdict(list)
    for label, color in colors.items():
        if label not in paired:
            groups[color].append(label)
    return groups
