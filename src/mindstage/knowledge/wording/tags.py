"""Tags: "SemLog;Class,Cup;Id,c1;Other;k,v;", which is types, each followed by its pairs of key and value.

That writing knows no escapes; tags that it cannot hold are written as JSON under a name of our own.
"""

from __future__ import annotations

import json

import msgspec

from mindstage.knowledge.vocabulary import TAGS_DATA, TAGS_JSON
from mindstage.knowledge.wording.letters import forbidden_in_xml
from mindstage.knowledge.wording.statements import Heard, Said
from mindstage.knowledge.wording.words import Word, text_in
from mindstage.world import FactValue, Literal, Tag

__all__ = ["say_tags", "tags_in", "tags_of"]

Tags = tuple[Tag, ...]


def tags_of(heard: Heard) -> Tags:
    """The tags of an individual. Where they are told both ways, JSON counts."""
    told = heard.value(_AS_JSON)
    return (heard.value(_SHORT) or ()) if told is None else told


def tags_in(value: FactValue) -> Tags:
    """The tags that one text in the community's writing holds; none, if it is none."""
    return _understand(value) or ()


def say_tags(said: Said, tags: Tags) -> None:
    """Says the tags in the community's writing, if it can hold them."""
    if said.told(_AS_JSON) is not None or not _has_short_form(tags):
        said.value(_AS_JSON, tags)
    elif tags or said.told(_SHORT) != ():
        said.value(_SHORT, tags or None)


def _understand(value: FactValue) -> Tags | None:
    text = text_in(value)
    if text is None:
        return None
    tags, kind = [], None
    for part in text.removesuffix(";").split(";") if text else ():
        key, comma, told = part.partition(",")
        if not comma:
            kind = part
        elif kind is None:
            return None
        else:
            tags.append(Tag(type=kind, key=key, value=told))
    return tuple(tags)


def _say(tags: Tags) -> Literal:
    parts: list[str] = []
    kind = None
    for tag in tags:
        if tag.type != kind:
            kind = tag.type
            parts.append(kind)
        parts.append(f"{tag.key},{tag.value}")
    return Literal("".join(part + ";" for part in parts))


def _has_short_form(tags: Tags) -> bool:
    literal = _say(tags)
    return _understand(literal) == tags and not forbidden_in_xml(literal.text)


def _understand_json(value: FactValue) -> Tags | None:
    try:
        told = msgspec.convert(json.loads(text_in(value) or ""), list[tuple[str, str, str]])
    except (ValueError, RecursionError):
        return None
    return tuple(Tag(type=kind, key=key, value=value) for kind, key, value in told)


def _say_json(tags: Tags) -> Literal:
    # ASCII alone: JSON has an escape for every letter, also for those that XML has no way to write.
    return Literal(json.dumps([(tag.type, tag.key, tag.value) for tag in tags]))


_SHORT = Word(TAGS_DATA, 'tags ("type;key,value;…")', _understand, _say)
_AS_JSON = Word(TAGS_JSON, "a JSON array of [type, key, value]", _understand_json, _say_json)
