"""Letters: what XML has no room for, and where a name begins.

Nearly all texts and names are plain ASCII. The patterns for the rest take milliseconds to make, more than all else
that is done when this room is first imported, so they are made when something needs them.
"""

from __future__ import annotations

import re
from functools import cache

__all__ = ["find_forbidden_character", "remove_forbidden_characters", "xml_local_name"]

_START = (
    "A-Z_a-z\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u200c-\u200d\u2070-\u218f"
    "\u2c00-\u2fef\u3001-\ud7ff\uf900-\ufdcf\ufdf0-\ufffd\U00010000-\U000effff"
)
_PLAIN_LAST_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9.-]*\Z")


def find_forbidden_character(text: str) -> re.Match[str] | None:
    """The first letter that no XML file can hold, not even escaped."""
    return None if text.isascii() and text.isprintable() else _forbidden_pattern().search(text)


def remove_forbidden_characters(text: str) -> str:
    """The text without letters that no XML file can hold."""
    return text if text.isascii() and text.isprintable() else _forbidden_pattern().sub("", text)


def xml_local_name(iri: str) -> re.Match[str] | None:
    """The longest end of an IRI that is a name in XML."""
    return (_PLAIN_LAST_NAME if iri.isascii() else _local_name_pattern()).search(iri)


@cache
def _forbidden_pattern() -> re.Pattern[str]:
    return re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@cache
def _local_name_pattern() -> re.Pattern[str]:
    return re.compile(rf"[{_START}][{_START}0-9.\u00b7\u0300-\u036f\u203f-\u2040-]*\Z")
