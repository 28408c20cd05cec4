"""Nesting: a thing without a name goes into the one statement that mentions it.

What several statements mention, or none, stands as a subject under its label. So a world says the same of a map
however its file was written: nested, with labels, or statement by statement.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import count, pairwise

import msgspec

from mindstage.knowledge.graph import Graph, drawn
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, SEMANTIC_MAP, TYPE
from mindstage.world import Anonymous, Fact, Iri, Reference

__all__ = ["NESTING", "nested", "sorted_facts"]

NESTING = 64
"""Levels of things inside things; those below keep a label, since a list of a thousand items has a thousand levels."""

Mentions = Mapping[Iri, Sequence[tuple[Iri, int]]]
"""By label, the subjects that mention it, and where among their facts."""


def sorted_facts(facts: Iterable[Fact]) -> tuple[Fact, ...]:
    """Facts in the one order that an `Anonymous` has them in: by property, then value."""
    told = sorted(facts, key=_property_of)
    if any(one.property == other.property for one, other in pairwise(told)):
        told.sort(key=lambda fact: (fact.property, msgspec.json.encode(fact.value)))
    return tuple(told)


def _property_of(fact: Fact) -> Iri:
    return fact.property


def nested(graph: Graph) -> Graph:
    """The same graph, with all that can go inside inside. Labels that are left and were drawn by lot become numbers."""
    mentions = _mentions(graph)
    if not mentions and not any(subject.startswith("_:") for subject in graph):
        return graph
    told = dict(graph)
    inside = _inside(graph, mentions)
    changed: dict[Iri, list[Fact]] = {}
    for label in inside:
        owner, index = mentions[label][0]
        inner = Anonymous(sorted_facts(told.pop(label, ())))
        facts = changed.get(owner)
        if facts is None:
            told[owner] = facts = changed[owner] = list(told[owner])
        facts[index] = Fact(facts[index].property, inner)
    return _numbered(told, [label for label in mentions if label not in inside])


def _mentions(graph: Graph) -> Mentions:
    mentions: dict[Iri, list[tuple[Iri, int]]] = {}
    for subject, facts in graph.items():
        for index, fact in enumerate(facts):
            value = fact.value
            if isinstance(value, Reference) and value.iri[:2] == "_:":
                mentions.setdefault(value.iri, []).append((subject, index))
    return mentions


def _inside(graph: Graph, mentions: Mentions) -> dict[Iri, None]:
    """The labels of what goes inside, the innermost first."""
    depths: dict[Iri, int] = {}
    for start in mentions:
        chain: dict[Iri, None] = {}
        label = start
        while label not in depths and label not in chain and _may_go_inside(label, graph, mentions):
            chain[label] = None
            label = mentions[label][0][0]
        depth = depths.get(label, 0)
        in_circle = label in chain
        for inner in reversed(chain):
            # In a circle nothing is innermost: all keep their labels.
            depth = depths[inner] = 0 if in_circle else depth + 1
            in_circle = in_circle and inner != label
    inside = [label for label, depth in depths.items() if depth % NESTING]
    return dict.fromkeys(sorted(inside, key=depths.__getitem__, reverse=True))


def _may_go_inside(label: Iri, graph: Graph, mentions: Mentions) -> bool:
    """Whether one statement alone mentions it. Maps and their individuals stay subjects whoever mentions them."""
    if len(mentions.get(label, ())) != 1:
        return False
    owner, index = mentions[label][0]
    return graph[owner][index].property != DESCRIBED_IN_MAP and not any(
        fact.property == DESCRIBED_IN_MAP or (fact.property == TYPE and fact.value == Reference(SEMANTIC_MAP))
        for fact in graph.get(label, ())
    )


def _numbered(graph: Graph, mentioned: Iterable[Iri]) -> Graph:
    labels = dict.fromkeys(label for label in (*graph, *mentioned) if label.startswith("_:"))
    free = (label for n in count(1) if (label := Iri(f"_:b{n}")) not in labels)
    renamed = {label: next(free) for label in labels if drawn(label)}
    if not renamed:
        return graph
    return {
        renamed.get(subject, subject): [_renamed(fact, renamed) for fact in facts] for subject, facts in graph.items()
    }


def _renamed(fact: Fact, names: Mapping[Iri, Iri]) -> Fact:
    value = fact.value
    if isinstance(value, Reference) and value.iri in names:
        return Fact(fact.property, Reference(names[value.iri]))
    if isinstance(value, Anonymous):
        return Fact(fact.property, Anonymous(sorted_facts(_renamed(inner, names) for inner in value.facts)))
    return fact
