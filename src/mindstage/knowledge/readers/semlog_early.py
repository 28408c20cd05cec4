"""Dialect 2, SemLog's early maps: dialect 1 without properties for the physics, of which the tags tell.

Their constraints do not say what map they are described in; the census finds that out, since it is true of any map.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from mindstage.knowledge.findings import Severity
from mindstage.knowledge.readers.semlog import read_semlog_map
from mindstage.knowledge.reading.excerpt import SourceMap
from mindstage.knowledge.vocabulary import TAGS_DATA
from mindstage.knowledge.wording.tags import parse_tags
from mindstage.knowledge.wording.words import GRAVITY, MASS, MOBILITY, OVERLAP_EVENTS, PropertyCodec, literal_text
from mindstage.world import Iri, Literal, PropertyAssertion, World

__all__ = ["is_early_semlog", "read_early_semlog", "with_tag_properties"]

_TAG_CODECS: dict[str, PropertyCodec[Any]] = {
    "mobility": MOBILITY,
    "mass": MASS,
    "gravity": GRAVITY,
    "overlapevents": OVERLAP_EVENTS,
}
"""What tags tell, by their keys in small letters."""
_MOBILITY_MARKER = ";mobility,"


def is_early_semlog(source_map: SourceMap) -> bool:
    """Whether tags alone tell of the mobility of something."""
    return any(
        fact.property == TAGS_DATA
        and _MOBILITY_MARKER in (literal_text(fact.value) or "").lower()
        and _lacks_mobility(facts)
        for facts in (source_map.graph[member] for member in source_map.members)
        for fact in facts
    )


def read_early_semlog(source_map: SourceMap) -> World:
    """Reads a map of dialect 2."""
    return read_semlog_map(with_tag_properties(source_map))


def with_tag_properties(source_map: SourceMap) -> SourceMap:
    """What is said nowhere but in tags, said as properties too."""
    graph = dict(source_map.graph)
    for member in source_map.members:
        if told := list(_facts_from_tags(source_map, member, graph[member])):
            graph[member] = [*graph[member], *told]
    return replace(source_map, graph=graph)


def _lacks_mobility(facts: Sequence[PropertyAssertion]) -> bool:
    """Whether no property tells of the mobility."""
    return all(fact.property != MOBILITY.property for fact in facts)


def _facts_from_tags(
    source_map: SourceMap, member: Iri, facts: Sequence[PropertyAssertion]
) -> Iterator[PropertyAssertion]:
    """What is said nowhere but in tags, as properties."""
    if not _lacks_mobility(facts):
        return
    told = {fact.property for fact in facts}
    for tag in (tag for fact in facts if fact.property == TAGS_DATA for tag in parse_tags(fact.value)):
        word = _TAG_CODECS.get(tag.key.lower())
        if word is None or word.property in told:
            continue
        told.add(word.property)
        value = word.decode(Literal(tag.value))
        if value is None:
            what, did = f"the tag {tag.key} is {tag.value!r}, not {word.expected}", "it stays a tag without meaning"
            source_map.report(Severity.WARNING, member, word.property, what, did)
        else:
            yield PropertyAssertion(word.property, word.encode(value))
