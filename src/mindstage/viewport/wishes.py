"""Wishes: what a page may ask the Ask desk for, as it stands on the wire; what is not in here is refused."""

from __future__ import annotations

import msgspec

__all__ = [
    "AskRequest",
    "ClearHighlightRequest",
    "CompleteNameRequest",
    "EmptyRequest",
    "ExplainRequest",
    "HighlightAnswersRequest",
    "PrologRequest",
    "SparqlRequest",
    "TellRequest",
]


class AskRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A declared question; what is left out of `args` is asked for."""

    question: str
    args: dict[str, str] = {}


class SparqlRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A query in SPARQL."""

    query: str


class PrologRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Questions joined in Prolog."""

    line: str


class CompleteNameRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The beginning of a name."""

    prefix: str
    kind: str = ""
    """Such as CLASS; any if empty."""
    limit: int = 20


class HighlightAnswersRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Answers that shall be lit up: all of them, or some rows."""

    key: int
    color: str
    rows: tuple[int, ...] | None = None
    replace: bool = True


class ExplainRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An answer that shall be explained."""

    key: int
    row: int


class TellRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A statement to be added, or taken back."""

    subject: str
    property: str
    value: str
    retract: bool = False


class ClearHighlightRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is lit for a reason; everything without one."""

    label: str | None = None


class EmptyRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that there is."""
