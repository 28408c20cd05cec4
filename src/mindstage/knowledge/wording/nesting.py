"""Nesting: a thing without a name goes into the one statement that mentions it.

What several statements mention, or none, stands as a subject under its label. So a world says the same of a map
however its file was written: nested, with labels, or statement by statement.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import count, pairwise

import msgspec

from mindstage.knowledge.graph import Graph, is_generated_label
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, SEMANTIC_MAP, TYPE
from mindstage.world import BlankNode, Iri, IriRef, PropertyAssertion

__all__ = ["MAX_NESTING", "nest_blank_nodes", "sorted_facts"]

MAX_NESTING = 64
"""Levels of things inside things; those below keep a label, since a list of a thousand items has a thousand levels."""

Mentions = Mapping[Iri, Sequence[tuple[Iri, int]]]
"""By label, the subjects that mention it, and where among their facts."""


def sorted_facts(facts: Iterable[PropertyAssertion]) -> tuple[PropertyAssertion, ...]:
    """Facts in the one order that an `BlankNode` has them in: by property, then value."""
    told = sorted(facts, key=_property_key)
    if any(one.property == other.property for one, other in pairwise(told)):
        told.sort(key=lambda fact: (fact.property, msgspec.json.encode(fact.value)))
    return tuple(told)


def _property_key(fact: PropertyAssertion) -> Iri:
    return fact.property


def nest_blank_nodes(graph: Graph) -> Graph:
    """The same graph, with all that can go inside inside. Labels that are left and were drawn by lot become numbers."""
    mentions = _count_mentions(graph)
    if not mentions and not any(subject.startswith("_:") for subject in graph):
        return graph
    told = dict(graph)
    inside = _nestable(graph, mentions)
    changed: dict[Iri, list[PropertyAssertion]] = {}
    for label in inside:
        owner, index = mentions[label][0]
        inner = BlankNode(sorted_facts(told.pop(label, ())))
        facts = changed.get(owner)
        if facts is None:
            told[owner] = facts = changed[owner] = list(told[owner])
        facts[index] = PropertyAssertion(facts[index].property, inner)
    return _renumbered(told, [label for label in mentions if label not in inside])


def _count_mentions(graph: Graph) -> Mentions:
    mentions: dict[Iri, list[tuple[Iri, int]]] = {}
    for subject, facts in graph.items():
        for index, fact in enumerate(facts):
            value = fact.value
            if isinstance(value, IriRef) and value.iri[:2] == "_:":
                mentions.setdefault(value.iri, []).append((subject, index))
    return mentions


def _nestable(graph: Graph, mentions: Mentions) -> dict[Iri, None]:
    """The labels of what goes inside, the innermost first."""
    depths: dict[Iri, int] = {}
    for start in mentions:
        chain: dict[Iri, None] = {}
        label = start
        while label not in depths and label not in chain and _can_nest(label, graph, mentions):
            chain[label] = None
            label = mentions[label][0][0]
        depth = depths.get(label, 0)
        in_circle = label in chain
        for inner in reversed(chain):
            # In a circle nothing is innermost: all keep their labels.
            depth = depths[inner] = 0 if in_circle else depth + 1
            in_circle = in_circle and inner != label
    inside = [label for label, depth in depths.items() if depth % MAX_NESTING]
    return dict.fromkeys(sorted(inside, key=depths.__getitem__, reverse=True))


def _can_nest(label: Iri, graph: Graph, mentions: Mentions) -> bool:
    """Whether one statement alone mentions it. Maps and their individuals stay subjects whoever mentions them."""
    if len(mentions.get(label, ())) != 1:
        return False
    owner, index = mentions[label][0]
    return graph[owner][index].property != DESCRIBED_IN_MAP and not any(
        fact.property == DESCRIBED_IN_MAP or (fact.property == TYPE and fact.value == IriRef(SEMANTIC_MAP))
        for fact in graph.get(label, ())
    )


def _renumbered(graph: Graph, mentioned: Iterable[Iri]) -> Graph:
    labels = dict.fromkeys(label for label in (*graph, *mentioned) if label.startswith("_:"))
    free = (label for n in count(1) if (label := Iri(f"_:b{n}")) not in labels)
    renamed = {label: next(free) for label in labels if is_generated_label(label)}
    if not renamed:
        return graph
    return {
        renamed.get(subject, subject): [_renamed(fact, renamed) for fact in facts] for subject, facts in graph.items()
    }


def _renamed(fact: PropertyAssertion, names: Mapping[Iri, Iri]) -> PropertyAssertion:
    value = fact.value
    if isinstance(value, IriRef) and value.iri in names:
        return PropertyAssertion(fact.property, IriRef(names[value.iri]))
    if isinstance(value, BlankNode):
        return PropertyAssertion(
            fact.property, BlankNode(sorted_facts(_renamed(inner, names) for inner in value.facts))
        )
    return fact
