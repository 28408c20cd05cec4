"""Claims: what the reasons for missing answers state about the graph and the state of the world, as data."""

from __future__ import annotations

from enum import StrEnum

import msgspec

from mindstage.scene import Iri

__all__ = ["Claim", "ClaimKind"]


class ClaimKind(StrEnum):
    """What a `Claim` states about the graph; None stands for anything."""

    NO_STATEMENT = "no statement"
    """No statement has this subject, property (or a subproperty) and object; poses and limits do not count."""
    NO_SOURCE = "no source"
    """No loaded file describes the map `subject`."""
    FEWER_MAPS = "fewer maps"
    """Loaded files describe fewer maps than `object`."""
    NO_CLASS = "no class"
    """`subject` is an individual without a class."""
    NOT_INSTANCE = "not an instance"
    """The individual `subject` is not a member of the class `object`."""
    NO_INSTANCE = "no instance"
    """No individual in `map` is a member of the class `object`."""
    NOT_SUBCLASS = "not a subclass"
    """The class `subject` is not a subclass of the other class `object`."""
    NOT_SIBLING = "not a sibling"
    """The classes `subject` and `object` have no common direct superclass."""
    NO_RESTRICTION = "no restriction"
    """No superclass of `subject`, or itself, needs a value of `property` of a class that has `object` as a subclass."""
    NO_NARROWER_RESTRICTION = "no narrower restriction"
    """As before, of a class that is `object` or a subclass of it."""
    NO_STATED_RESTRICTION = "no stated restriction"
    """Neither `subject` nor a superclass of it has a restriction of any type on `property` with the filler `object`;
    `detail` "inverse" means those on the inverse of the property only, "forward" the others."""
    RESTRICTION = "restriction"
    """`subject` or a superclass of it has a restriction on `property` whose filler names `object`."""
    NOT_PART = "not a part"
    """`object` is not a part of `subject`, except through a joint."""
    PART = "part"
    """`object` is a part of `subject`, if not otherwise then through a joint."""
    BODY = "body"
    """`subject` has a body in the state that was asked, of `map` or of all maps."""
    NO_BODY = "no body"
    """`subject` has no body in that state."""
    NO_SIZE = "no size"
    """`subject` has a body in that state, and its size is unknown."""
    NO_JOINT = "no joint"
    """No joint in that state connects the body `subject` to another."""
    NOT_LARGER = "not larger"
    """In that state, `subject` is not larger than `object` by the measure `detail`; nothing is if one is None."""
    NOT_BETWEEN = "not between"
    """In that state, less than half of the footprint or height of `subject` is between the bodies `object` and `other`,
    or more than a tenth of the footprint is in one of them; no body is between them if `subject` is None."""
    NOT_NEAREST = "not nearest"
    """In that state, at least `detail` bodies are as near to `other` as `subject`, or nearer, by their boxes."""
    ATTACHED = "attached"
    """In that state, attachments connect `subject` rigidly to `object`."""
    HIDDEN = "hidden"
    """In that state, a ray from the center of `other` to a point of `subject` meets `object` before."""
    IN_DIRECTION = "in direction"
    """In that state, `subject` is to the side `detail` ("left", "front" …) of `object`, seen along the map's x axis."""
    NOT_FITTING = "not fitting"
    """In that state, the box of `subject` fits neither onto nor into `object`."""
    ON_OR_IN = "on or in"
    """In that state, `subject` is on or in `object`, or on or in something that is."""


class Claim(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A fact about the graph, or the state, that the reason of a `MissingKnowledge` states or relies on."""

    kind: ClaimKind
    subject: Iri | None = None
    property: Iri | None = None
    object: str | None = None
    """A class, an individual or a map; the text of a literal or an expression; a number."""
    map: Iri | None = None
    other: Iri | None = None
    """A third individual."""
    detail: str | None = None
    """A measure, a direction or a number."""
