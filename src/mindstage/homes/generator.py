"""Generated homes: a floor plan, furniture by the use of each room, and things where the ontology keeps them.

Equal arguments give equal worlds, on every machine: the only source of chance is one seeded generator. Nothing here
depends on what a robot can do.
"""

from __future__ import annotations

from collections.abc import Collection
from enum import StrEnum
from random import Random
from typing import Annotated, TypeVar

from msgspec import Meta

from mindstage.errors import InvalidArgumentError
from mindstage.homes.furnishing import fill_spaces, furnish
from mindstage.homes.household import MS, household
from mindstage.homes.rooms import Room, RoomKind, build_rooms
from mindstage.homes.scenery import Frame, Scenery
from mindstage.homes.styles import HomePart, HomeStyle
from mindstage.ranges import Seed, checked
from mindstage.scene import Iri, IriRef, Literal, NamedResource, PropertyAssertion, World

__all__ = ["GENERATOR_VERSION", "generate_home"]

GENERATOR_VERSION = 1
"""Raised when equal arguments no longer give equal homes."""
_ONTOLOGY = Iri("http://mindstage.org/ontology/household.ttl")
_OWL = "http://www.w3.org/2002/07/owl#"
_RDF_TYPE = Iri("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
_INTEGER = Iri("http://www.w3.org/2001/XMLSchema#integer")

_ROOMS = {
    HomeStyle.KITCHEN: (RoomKind.KITCHEN,),
    HomeStyle.FLAT: (RoomKind.KITCHEN, RoomKind.LIVING, RoomKind.BATH, RoomKind.BED, RoomKind.BED, RoomKind.OFFICE),
    HomeStyle.OFFICE: (RoomKind.OFFICE, RoomKind.OFFICE, RoomKind.KITCHEN, RoomKind.OFFICE, RoomKind.BATH),
    HomeStyle.LAB: (RoomKind.LAB, RoomKind.OFFICE, RoomKind.LAB, RoomKind.KITCHEN),
    HomeStyle.SHOP: (RoomKind.SHOP, RoomKind.OFFICE),
}
_Word = TypeVar("_Word", bound=StrEnum)
_DEFAULT_ROOM_COUNT = {"kitchen": 1, "flat": 4, "office": 3, "lab": 2, "shop": 2}
"""These are numbers of rooms."""
_AREAS_M2 = {
    RoomKind.KITCHEN: (12.0, 20.0),
    RoomKind.LIVING: (18.0, 30.0),
    RoomKind.BED: (11.0, 18.0),
    RoomKind.BATH: (6.0, 10.0),
    RoomKind.OFFICE: (12.0, 24.0),
    RoomKind.LAB: (24.0, 40.0),
    RoomKind.SHOP: (40.0, 70.0),
}


@checked
def generate_home(
    *,
    seed: Seed = 0,
    style: HomeStyle | str = HomeStyle.KITCHEN,
    size: Annotated[float, Meta(ge=0.8, le=3.0)] = 1.0,
    rooms: Annotated[int, Meta(ge=1, le=24)] | None = None,
    clutter: Annotated[float, Meta(ge=0.0, le=3.0)] = 1.0,
    without: Collection[HomePart | str] = (),
) -> World:
    """Generates a furnished place whose doors and drawers can be opened; the same arguments give the same world.

    Args:
        seed: what distinguishes homes of the same arguments.
        style: the kind of place.
        size: factor of the floor area of each room.
        rooms: number of rooms besides the corridor; None for that of the style.
        clutter: how many things there are: 0 for none, 1 for a usual number.
        without: what is left out.

    Raises:
        InvalidArgumentError: the style or what is left out is unknown.
        NumberRefusedError: a number is beyond its range.
    """
    style = _word(HomeStyle, style, "style")
    left_out = frozenset(str(_word(HomePart, each, "without")) for each in without)
    count = rooms or _DEFAULT_ROOM_COUNT[style]
    namespace = f"http://mindstage.org/homes/{style}_{seed}.owl#"
    arguments = f"{style}/{seed}/{size}/{count}/{clutter}/{'+'.join(sorted(left_out))}"
    scenery = Scenery(namespace, Random(f"{GENERATOR_VERSION}/{style}/{seed}/{size}/{count}"), household(), left_out)
    kinds = [_ROOMS[style][number % len(_ROOMS[style])] for number in range(count)]
    areas = [size * scenery.between(*_AREAS_M2[kind], step=0.5) for kind in kinds]
    for room in build_rooms(scenery, kinds, areas):
        furnish(scenery, room)
        if "lamps" not in left_out:
            _light(scenery, room)
    if "things" not in left_out and clutter > 0:
        fill_spaces(scenery, clutter)
    return _world(scenery, style, seed, arguments)


def _light(scenery: Scenery, room: Room) -> None:
    x0, y0, x1, y1 = room.rect
    across = max(1, round((x1 - x0) / 4))
    for number in range(across):
        frame = Frame(x0 + (x1 - x0) * (number + 0.5) / across, (y0 + y1) / 2)
        scenery.add("knowrob:CeilingLight", (0.4, 0.4, 0.06), frame, room.height - 0.06)


def _world(scenery: Scenery, style: HomeStyle, seed: int, arguments: str) -> World:
    map_iri = Iri(f"{scenery.namespace}home")
    facts = [
        PropertyAssertion(Iri(f"{MS}seed"), Literal(str(seed), _INTEGER)),
        PropertyAssertion(Iri(f"{MS}generatorArguments"), Literal(arguments)),
        PropertyAssertion(Iri(f"{MS}generatorVersion"), Literal(str(GENERATOR_VERSION), _INTEGER)),
    ]
    ontology = NamedResource(
        Iri(scenery.namespace.removesuffix("#")),
        (
            PropertyAssertion(_RDF_TYPE, IriRef(Iri(f"{_OWL}Ontology"))),
            PropertyAssertion(Iri(f"{_OWL}imports"), IriRef(_ONTOLOGY)),
        ),
    )
    return World(
        iri=map_iri,
        name=f"{style}_{seed}",
        bodies=tuple(scenery.bodies),
        joints=tuple(scenery.joints),
        attachments=tuple(scenery.attachments),
        facts=tuple(sorted(facts, key=lambda fact: fact.property)),
        resources=(ontology,),
    )


def _word(kind: type[_Word], value: str, name: str) -> _Word:
    try:
        return kind(value)
    except ValueError as error:
        known = ", ".join(kind)
        raise InvalidArgumentError(name, cause=f"{value!r} is unknown", remedy=f"use one of {known}") from error
