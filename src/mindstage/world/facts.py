"""Facts: what is known of a thing beyond the fields that a world has for it, kept word for word.

This is the shape of an RDF statement without RDF's machinery: a property and a value, where a value is a name, a
literal, or a thing that has no name and is known only by its own facts.
"""

from __future__ import annotations

from typing import NewType

import msgspec

__all__ = ["BlankNode", "FactValue", "Iri", "IriRef", "Literal", "NamedResource", "PropertyAssertion"]

Iri = NewType("Iri", str)
"""An absolute IRI; a name that starts with `_:` is a label which means something only inside one world."""


class IriRef(msgspec.Struct, frozen=True, tag="iri", forbid_unknown_fields=True):
    """A named thing."""

    iri: Iri


class Literal(msgspec.Struct, frozen=True, tag="literal", forbid_unknown_fields=True):
    """A value with its text exactly as the source has it."""

    text: str
    datatype: Iri | None = None
    """None for a plain string."""
    language: str | None = None


class BlankNode(msgspec.Struct, frozen=True, tag="anonymous", forbid_unknown_fields=True):
    """A thing without a name; two of them are the same when their facts are."""

    facts: tuple[PropertyAssertion, ...] = ()
    """Sorted by property, then value, so that equal things are equal values."""


FactValue = IriRef | Literal | BlankNode


class PropertyAssertion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One statement about the thing that holds it."""

    property: Iri
    value: FactValue


class NamedResource(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A named thing that is neither a body nor a constraint, and what is said about it."""

    iri: Iri
    facts: tuple[PropertyAssertion, ...] = ()
