"""Tags: "SemLog;Class,Cup;Id,c1;Other;k,v;", which is types, each followed by its pairs of key and value.

That writing knows no escapes; tags that it cannot hold are written as JSON under a name of our own.
"""

from __future__ import annotations

import json

import msgspec

from mindstage.knowledge.vocabulary import TAGS_DATA, TAGS_JSON
from mindstage.knowledge.wording.letters import find_forbidden_character
from mindstage.knowledge.wording.statements import SubjectReader, SubjectWriter
from mindstage.knowledge.wording.words import PropertyCodec, literal_text
from mindstage.world import FactValue, Literal, Tag

__all__ = ["parse_tags", "read_tags", "write_tags"]

Tags = tuple[Tag, ...]


def read_tags(reader: SubjectReader) -> Tags:
    """The tags of an individual. Where they are told both ways, JSON counts."""
    told = reader.read(_JSON_TAGS_CODEC)
    return (reader.read(_TAGS_CODEC) or ()) if told is None else told


def parse_tags(value: FactValue) -> Tags:
    """The tags that one text in the community's writing holds; none, if it is none."""
    return _parse(value) or ()


def write_tags(writer: SubjectWriter, tags: Tags) -> None:
    """Says the tags in the community's writing, if it can hold them."""
    if writer.first_value(_JSON_TAGS_CODEC) is not None or not _has_short_form(tags):
        writer.write(_JSON_TAGS_CODEC, tags)
    elif tags or writer.first_value(_TAGS_CODEC) != ():
        writer.write(_TAGS_CODEC, tags or None)


def _parse(value: FactValue) -> Tags | None:
    text = literal_text(value)
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


def _format(tags: Tags) -> Literal:
    parts: list[str] = []
    kind = None
    for tag in tags:
        if tag.type != kind:
            kind = tag.type
            parts.append(kind)
        parts.append(f"{tag.key},{tag.value}")
    return Literal("".join(part + ";" for part in parts))


def _has_short_form(tags: Tags) -> bool:
    literal = _format(tags)
    return _parse(literal) == tags and not find_forbidden_character(literal.text)


def _parse_json(value: FactValue) -> Tags | None:
    try:
        told = msgspec.convert(json.loads(literal_text(value) or ""), list[tuple[str, str, str]])
    except (ValueError, RecursionError):
        return None
    return tuple(Tag(type=kind, key=key, value=value) for kind, key, value in told)


def _format_json(tags: Tags) -> Literal:
    # ASCII alone: JSON has an escape for every letter, also for those that XML has no way to write.
    return Literal(json.dumps([(tag.type, tag.key, tag.value) for tag in tags]))


_TAGS_CODEC = PropertyCodec(TAGS_DATA, 'tags ("type;key,value;…")', _parse, _format)
_JSON_TAGS_CODEC = PropertyCodec(TAGS_JSON, "a JSON array of [type, key, value]", _parse_json, _format_json)
