"""Dialect 2, SemLog's early maps: dialect 1 without properties for the physics, of which the tags tell.

Their constraints do not say what map they are described in; the census finds that out, since it is true of any map.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from mindstage.knowledge.findings import Severity
from mindstage.knowledge.readers.semlog import read_semlog_map
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.vocabulary import TAGS_DATA
from mindstage.knowledge.wording.tags import tags_in
from mindstage.knowledge.wording.words import GRAVITY, MASS, MOBILITY, OVERLAP_EVENTS, Word, text_in
from mindstage.world import Fact, Iri, Literal, World

__all__ = ["is_early_semlog", "read_early_semlog", "with_told_by_tags"]

_IN_TAGS: dict[str, Word[Any]] = {
    "mobility": MOBILITY,
    "mass": MASS,
    "gravity": GRAVITY,
    "overlapevents": OVERLAP_EVENTS,
}
"""What tags tell, by their keys in small letters."""
_TAG = ";mobility,"


def is_early_semlog(excerpt: Excerpt) -> bool:
    """Whether tags alone tell of the mobility of something."""
    return any(
        fact.property == TAGS_DATA and _TAG in (text_in(fact.value) or "").lower() and _is_silent(facts)
        for facts in (excerpt.graph[member] for member in excerpt.members)
        for fact in facts
    )


def read_early_semlog(excerpt: Excerpt) -> World:
    """Reads a map of dialect 2."""
    return read_semlog_map(with_told_by_tags(excerpt))


def with_told_by_tags(excerpt: Excerpt) -> Excerpt:
    """What is said nowhere but in tags, said as properties too."""
    graph = dict(excerpt.graph)
    for member in excerpt.members:
        if told := list(_told_by_tags(excerpt, member, graph[member])):
            graph[member] = [*graph[member], *told]
    return replace(excerpt, graph=graph)


def _is_silent(facts: Sequence[Fact]) -> bool:
    """Whether no property tells of the mobility."""
    return all(fact.property != MOBILITY.property for fact in facts)


def _told_by_tags(excerpt: Excerpt, member: Iri, facts: Sequence[Fact]) -> Iterator[Fact]:
    """What is said nowhere but in tags, as properties."""
    if not _is_silent(facts):
        return
    told = {fact.property for fact in facts}
    for tag in (tag for fact in facts if fact.property == TAGS_DATA for tag in tags_in(fact.value)):
        word = _IN_TAGS.get(tag.key.lower())
        if word is None or word.property in told:
            continue
        told.add(word.property)
        value = word.understand(Literal(tag.value))
        if value is None:
            what, did = f"the tag {tag.key} is {tag.value!r}, not {word.what}", "it stays a tag without meaning"
            excerpt.report(Severity.WARNING, member, word.property, what, did)
        else:
            yield Fact(word.property, word.say(value))
