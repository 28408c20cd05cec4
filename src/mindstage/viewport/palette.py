"""Palette: which colour a thing has, decided from what it is.

The knowledge base has the first word: the class itself, then its ancestors, nearest first. Where none of them says
what the thing is made of, a word inside the class's name may; and a class that says nothing at all gets a quiet
colour of its own, the same every time.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from colorsys import hls_to_rgb
from enum import Enum
from hashlib import blake2s

import msgspec

from mindstage.world import Colour, Iri, Material

__all__ = [
    "DIMMED_OPACITY",
    "HIGHLIGHT_OPACITY",
    "Paint",
    "Surface",
    "dimmed",
    "lit",
    "local_name",
    "nouns",
    "paint",
    "surface",
    "words",
]

HIGHLIGHT_OPACITY = 0.85
"""Of a lit body that is see-through otherwise: a highlight must be seen."""
DIMMED_OPACITY = 0.3
"""Of everything else while something is lit: what is lit in a cupboard must be seen too."""
_MIST, _MISTINESS = 0.8, 0.6
"""The grey that dimmed colours go towards, and how far."""


class Surface(Enum):
    """What a thing looks like it is made of."""

    WALL = "wall"
    FLOOR = "floor"
    CEILING = "ceiling"
    WOOD = "wood"
    FRONT = "front"
    STONE = "stone"
    STEEL = "steel"
    BLACK_GLASS = "black glass"
    DARK_METAL = "dark metal"
    FOOD = "food"
    CERAMIC = "ceramic"
    LAMP = "lamp"
    GLASS = "glass"
    TEXTILE = "textile"
    PAPER = "paper"
    PLANT = "plant"
    PLASTIC = "plastic"
    UNKNOWN = "unknown"


class Paint(msgspec.Struct, frozen=True):
    """A colour, and how much of what is behind stays hidden."""

    colour: Colour
    opacity: float = 1.0


def _rgb(text: str) -> Colour:
    red, green, blue = (int(text[start : start + 2], 16) / 255 for start in (0, 2, 4))
    return red, green, blue


_PAINTS: dict[Surface, tuple[Paint, ...]] = {
    Surface.WALL: (Paint(_rgb("ece8e0")),),
    Surface.FLOOR: (Paint(_rgb("c9bfb0")),),
    Surface.CEILING: (Paint(_rgb("f2efe9")),),
    Surface.WOOD: (Paint(_rgb("b8946c")),),
    Surface.FRONT: (Paint(_rgb("ece2d0")),),
    Surface.STONE: (Paint(_rgb("6d6a68")),),
    Surface.STEEL: (Paint(_rgb("c0c6ca")),),
    Surface.BLACK_GLASS: (Paint(_rgb("2b3036")),),
    Surface.DARK_METAL: (Paint(_rgb("3a3f45")),),
    Surface.FOOD: tuple(Paint(_rgb(text)) for text in ("c9654a", "d9a441", "8ca556", "b98a5a")),
    Surface.CERAMIC: tuple(Paint(_rgb(text)) for text in ("f5f1e8", "6f94a8", "c98b6b", "8fae9b")),
    Surface.LAMP: (Paint(_rgb("ffe9b0")),),
    Surface.GLASS: (Paint(_rgb("a9cbd8"), 0.32),),
    Surface.TEXTILE: tuple(Paint(_rgb(text)) for text in ("8a9a86", "a8798a", "6f7f99")),
    Surface.PAPER: tuple(Paint(_rgb(text)) for text in ("efe6d2", "a8554a", "4f6d8c")),
    Surface.PLANT: (Paint(_rgb("6f9557")),),
    Surface.PLASTIC: tuple(Paint(_rgb(text)) for text in ("5f87a8", "7a7f86", "c2a24e")),
}
"""Where there are several, a class keeps the one that its name falls on."""

_SURFACE_WORDS: dict[Surface, str] = {
    Surface.WALL: "wall pillar column building wallofaconstruction",
    Surface.FLOOR: "floor ground floormat",
    Surface.CEILING: "ceiling roof",
    Surface.WOOD: """area base bench board bookcase bookshelf cabinet chair chest crate cupboard desk dresser frame
        furniture furniturepiece island leg nightstand shelf sideboard stool table wardrobe basket breadbasket""",
    Surface.FRONT: "door doorway drawer front gate panel",
    Surface.STONE: "countertop counter worktop plinth sill stone marble",
    Surface.STEEL: """appliance bakeware bakingtray bar bin can colander cookingutensil cookingvessel cutlery
        dishwasher extractor faucet filter fork freezer fridge grater hood kettle knife ladle lid pan rack radiator
        refrigerator silverware silverwarepiece sink spatula spoon strainer tap teaspoon toaster whisk""",
    Surface.BLACK_GLASS: "cooktop display hob microwave monitor oven screen stove stovetop television",
    Surface.DARK_METAL: "button controldevice dial handle hinge knob latch lever switch",
    Surface.FOOD: """apple banana beer beverage biscuit bread butter cake carrot cereal cheese chocolate cocoa coffee
        cookie cracker cucumber drink egg flour food foodstuff foodordrink fruit ham honey jam juice ketchup lemon
        lettuce meat milk mustard noodle oil onion orange pancake pasta pepper pizza popcorn potato rice roll salad
        salt sandwich sauce sausage snack soup spice sugar tea tomato vegetable vinegar water wine yogurt yoghurt""",
    Surface.CERAMIC: """bowl crockery cup dish drinkingvessel eatingvessel foodvessel jug mug pitcher plate saucer
        teapot vase""",
    Surface.LAMP: "bulb lamp light lightbulb lightfixture",
    Surface.GLASS: "bottle carafe drinkingglass glass jar pane tumbler window",
    Surface.TEXTILE: "carpet cloth clothing curtain cushion mat mattress napkin pillow rug sofa textile towel",
    Surface.PAPER: """book bookcopy cardboardbox cookbook letter magazine newspaper notebook paper papertowel picture
        poster sheet""",
    Surface.PLANT: "flower herb plant tree",
    Surface.PLASTIC: """bucket cleaningsubstance clock dispenser foodstoragebox machine maker radio robot soap
        sponge""",
}
_SURFACES = {word: surface for surface, text in _SURFACE_WORDS.items() for word in text.split()}

_VAGUE_WORDS = {
    "block": Surface.WOOD,
    "box": Surface.WOOD,
    "container": Surface.PLASTIC,
    "device": Surface.PLASTIC,
    "pot": Surface.STEEL,
    "tin": Surface.STEEL,
    "tray": Surface.WOOD,
}
"""They say something, but anything else in the name or above the class says more."""

_ADJECTIVES = {
    "beech": Surface.WOOD,
    "oak": Surface.WOOD,
    "wooden": Surface.WOOD,
    "steel": Surface.STEEL,
    "plastic": Surface.PLASTIC,
}
_MACHINES = frozenset({Surface.STEEL, Surface.BLACK_GLASS})

_OWN_COLOURS = {
    word: _rgb(colour)
    for colour, text in {
        "f5f1e8": "plate saucer",
        "7fa0b0": "bowl dish",
        "c98b6b": "mug",
        "f3f1ea": "milk egg flour sugar salt rice yogurt yoghurt",
        "c48a4a": "bread biscuit cake cookie pancake cereal pasta noodle cracker roll",
        "b7463a": "apple tomato ketchup ham meat jam pizza",
        "6d2238": "wine",
        "e3bd4b": "banana butter cheese lemon honey mustard oil",
        "e08a35": "orange juice carrot paprika",
        "6b4a35": "chocolate cocoa coffee tea",
        "7f9f4d": "cucumber lettuce salad vegetable pepper oregano",
        "cfd4d6": "dishwasher refrigerator fridge freezer",
    }.items()
    for word in text.split()
}
"""What everybody knows the colour of."""

_FILLED = 0.6
"""The opacity of a glass that is full of something with a colour."""


def surface(cls: Iri, ancestors: Iterable[Iri] = ()) -> Surface:
    """What things of a class are made of, by the look of it.

    Args:
        cls: the class.
        ancestors: its ancestors, nearest first.
    """
    parts = words(cls)
    if adjective := next((_ADJECTIVES[word] for word in parts[:-1] if word in _ADJECTIVES), None):
        return adjective
    own = [_SURFACES[word] for word in map(_known, reversed(parts)) if word is not None]
    for name in (cls, *ancestors):
        if (noun := _telling_noun(name)) is None:
            continue
        # The door of a fridge is made like the fridge; the handle of its door is not.
        machine = next((made for made in own[1:] if made in _MACHINES), None) if noun == "door" else None
        return machine or _SURFACES[noun]
    vague = [_VAGUE_WORDS[word] for word in reversed(parts) if word in _VAGUE_WORDS]
    return next(iter(own + vague), Surface.UNKNOWN)


def paint(cls: Iri, ancestors: Iterable[Iri] = (), materials: Sequence[Material] = ()) -> Paint:
    """How a thing is painted: as its materials say, else as its class suggests."""
    for material in materials:
        if material.colour is not None:
            return Paint(material.colour)
    above = tuple(ancestors)
    made_of = surface(cls, above)
    for word in (form for name in (cls, *above) for part in reversed(words(name)) for form in _forms(part)):
        if word in _OWN_COLOURS and _SURFACES.get(word, Surface.FOOD) is made_of:
            return Paint(_OWN_COLOURS[word])
    if made_of is Surface.GLASS and any(_SURFACES.get(noun) is Surface.FOOD for noun in nouns(cls, above)):
        # A bottle of wine is wine to a map, a glass for wine is not.
        contents = (word for name in above for word in reversed(words(name)) if word in _OWN_COLOURS)
        return next((Paint(_OWN_COLOURS[word], _FILLED) for word in contents), _PAINTS[made_of][0])
    if made_of is Surface.UNKNOWN:
        return Paint(_quiet_colour(local_name(cls)))
    choices = _PAINTS[made_of]
    return choices[_number(local_name(cls)) % len(choices)]


def lit(paint: Paint, colour: Colour | None) -> Paint:
    """The same surface with a highlight, or as it is."""
    return paint if colour is None else Paint(colour, max(paint.opacity, HIGHLIGHT_OPACITY))


def dimmed(paint: Paint) -> Paint:
    """The same surface stepping back behind what is lit, even if that is inside of it."""
    red, green, blue = (part + (_MIST - part) * _MISTINESS for part in paint.colour)
    return Paint((red, green, blue), min(paint.opacity, DIMMED_OPACITY))


def local_name(iri: str) -> str:
    """What stands after the last # or / of an IRI."""
    return re.split(r"[#/]", iri.rstrip("#/"))[-1]


def words(iri: str) -> tuple[str, ...]:
    """The words of a class's name in lower case: codes, numbers and what tells homonyms apart are left out.

    `IAIDrawerW60H29` is a drawer, `Table-PieceOfFurniture` a table.
    """
    name = local_name(iri).split("-")[0]
    parts = re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+\d*|\d+", name)
    return tuple(part.lower() for part in parts if len(part) > 1 and not (part.isupper() or part.isdigit()))


def nouns(cls: Iri, ancestors: Iterable[Iri] = ()) -> tuple[str, ...]:
    """What things of a class are, in a word each, most telling first: a DinnerPlate is a plate, then a dish."""
    return tuple(singular for name in (cls, *ancestors) for word in words(name)[-1:] for singular in _forms(word))


def _telling_noun(iri: str) -> str | None:
    """The noun that the name of a class ends with, or the whole name, if it is a known one."""
    parts = words(iri)
    return _known("".join(parts)) or (_known(parts[-1]) if parts else None)


def _known(word: str) -> str | None:
    return next((form for form in _forms(word) if form in _SURFACES), None)


def _forms(word: str) -> tuple[str, ...]:
    """A word, and what it may be the plural of."""
    return tuple(dict.fromkeys((word, word.removesuffix("s"), word.removesuffix("es"))))


def _number(text: str) -> int:
    return int.from_bytes(blake2s(text.encode(), digest_size=4).digest(), "big")


def _quiet_colour(name: str) -> Colour:
    """A hue that depends on the name alone, greyish and neither dark nor bright."""
    return hls_to_rgb(_number(name) % 360 / 360, 0.66, 0.18)
