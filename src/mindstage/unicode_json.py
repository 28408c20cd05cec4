"""JSON of values whose texts may have what UTF-8 cannot encode, such as names of files in another encoding."""

from __future__ import annotations

import msgspec

from mindstage.errors import without_surrogates

__all__ = ["encode_json", "values_without_surrogates"]


def encode_json(value: object) -> bytes:
    """Encodes a value as JSON; bytes of names of files that are not UTF-8 are U+FFFD. Infinity and NaN are null."""
    try:
        return msgspec.json.encode(value)
    except UnicodeEncodeError:
        return msgspec.json.encode(values_without_surrogates(msgspec.to_builtins(value)))


def values_without_surrogates(value: object) -> object:
    """A value of texts, numbers, and lists and mappings of them, in which all texts can be encoded."""
    match value:
        case str():
            return without_surrogates(value)
        case dict():
            return {values_without_surrogates(key): values_without_surrogates(each) for key, each in value.items()}
        case list() | tuple():
            return [values_without_surrogates(each) for each in value]
    return value
