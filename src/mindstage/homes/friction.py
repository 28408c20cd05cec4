"""The true frictions of a generated home, which its map does not state: of things on what they stand on, and of joints.

They are drawn from published ranges, evenly by the logarithm, and depend on nothing that is assumed of a map without
frictions. The same home has the same ones.

| what | range | from |
|---|---|---|
| wood on wood | 0.30 to 0.75 | [1]: sliding and static, dry |
| metal on wood or metal | 0.20 to 0.60 | [2]: wood on clean metal; [1]: steel on steel 0.08 to 0.60 |
| plastic on wood or metal | 0.18 to 0.50 | [1]: on steel 0.18 to 0.45; [2]: acrylic glass on steel 0.4 to 0.5 |
| glass, ceramics on wood or metal | 0.20 to 0.70 | [3]: glass on metal 0.5 to 0.7 dry, 0.2 to 0.3 greasy |
| paper, textiles, food | 0.20 to 0.60 | as wood and leather, which is 0.3 to 0.4 in [2]: no better source was found |
| a drawer on rollers | 0.06 to 0.25 of its weight | [1]: arms of 0.5 to 2 mm; rollers of 8 mm |
| a drawer on wooden runners, one of five | 0.30 to 0.50 of its weight | [1]: wood on wood, sliding |
| a hinge | from the friction of pins of 4 mm, 0.18 to 0.50 of the forces on them, to 22.2 N at the edge | [1] and [4] |

1. LUST, Engineering Guide CDA3000, tables 7.21 and 7.22: friction pairings, lever arms of rolling friction.
2. The Engineering ToolBox, Friction and Friction Coefficients for various Materials (quoted from memory).
3. Schneider & Company, Coefficient of Friction Reference Chart.
4. 2010 ADA Standards for Accessible Design, 404.2.9: opening force of interior doors, at most 5 lbf.
"""

from __future__ import annotations

import math
from random import Random

import msgspec

from mindstage.scene import AxisMotion, Body, BodyId, Joint, Mobility, World

__all__ = ["ThingFriction", "true_frictions"]

_GRAVITY_M_S2 = 9.81
_RANGES = {
    "wood": (0.30, 0.75),
    "metal": (0.20, 0.60),
    "plastic": (0.18, 0.50),
    "glass": (0.20, 0.70),
    "ceramics": (0.20, 0.70),
    "paper": (0.20, 0.60),
    "textile": (0.20, 0.60),
    "food": (0.20, 0.60),
}
_WORDS = {
    "wood": "CuttingBoard Wooden KnifeBlock Mill Chair Dresser Table-Piece Shelf Stick",
    "metal": "Cutlery Fork Knife Spoon Pan Tray Kettle Toaster Can Tin Tongs Whisk Colander Grater Ladle Peeler Oven "
    "Refrigerator Bin Drawer Tool",
    "glass": "Glass Wine Beer Vinegar Jar Oil",
    "ceramics": "Plate Bowl Mug Cup Saucer Teapot Dish Vase Plant",
    "paper": "Book Milk Juice Cereal Flour Sugar Rice Pasta Tea Box Paper Pizza Salt",
    "textile": "Towel Cloth Sponge Mat",
    "food": "Banana Bread Carrot Cucumber Sausage Ham Sandwich Toast Food Cheese Pretzel Salad",
}
_ROLLING = (0.5 / 8.0, 2.0 / 8.0)
"""Friction of a drawer on rollers, relative to its weight."""
_WOODEN = (0.30, 0.50)
"""The same on wooden runners."""
_WOODEN_SHARE = 0.2
"""Part of the drawers that have these."""
_PIN_RADIUS_M = 0.004
_PIN_FRICTION = (0.18, 0.50)
"""Coefficients of friction of the pins of hinges."""
_MAX_DOOR_FORCE_N = 22.2


class ThingFriction(msgspec.Struct, frozen=True):
    """What is true of a thing."""

    material: str
    coefficient: float
    """Of sliding on what it stands on."""


def true_frictions(home: World) -> tuple[dict[BodyId, ThingFriction], dict[BodyId, float]]:
    """The frictions of a generated home.

    Args:
        home: what `generate_home` returned.

    Returns:
        The friction of each dynamic body, and of each joint: the force of a slide [N], the torque of a hinge [N m].
    """
    bodies = {body.id: body for body in home.bodies}
    things = {
        id: _thing(body, Random(f"friction/{body.iri}"))
        for id, body in bodies.items()
        if body.physics.mobility is Mobility.DYNAMIC
    }
    carried: dict[BodyId, list[Body]] = {}
    for each in home.attachments:
        carried.setdefault(each.parent, []).append(bodies[each.child])
    joints = {}
    for joint in home.joints:
        parts = [bodies[joint.child], *carried.get(joint.child, ())]
        weight_n = _GRAVITY_M_S2 * sum(part.physics.mass_kg or 0.0 for part in parts)
        joints[joint.id] = _joint(joint, bodies[joint.child], weight_n, Random(f"friction/{joint.iri}"))
    return things, joints


def _drawn(random: Random, low: float, high: float) -> float:
    return round(math.exp(random.uniform(math.log(low), math.log(high))), 4)


def _thing(body: Body, random: Random) -> ThingFriction:
    name = str(body.cls).rpartition("#")[2]
    known = [material for material, words in _WORDS.items() if any(word in name for word in words.split())]
    material = random.choice(known or sorted(_RANGES))
    return ThingFriction(material, _drawn(random, *_RANGES[material]))


def _joint(joint: Joint, child: Body, weight_n: float, random: Random) -> float:
    assert child.size is not None
    if any(each is not AxisMotion.LOCKED for each in (joint.linear.x, joint.linear.y, joint.linear.z)):
        share = _WOODEN if random.random() < _WOODEN_SHARE else _ROLLING
        return _drawn(random, *(each * weight_n for each in share))
    width_m, height_m = max(child.size[0], child.size[1]), child.size[2]
    # Two pins carry the weight, and the couple that holds the door upright.
    on_pins_n = weight_n + 2 * weight_n * width_m / 2 / height_m
    low = _PIN_FRICTION[0] * _PIN_RADIUS_M * on_pins_n
    return _drawn(random, low, max(_MAX_DOOR_FORCE_N * width_m, _PIN_FRICTION[1] * _PIN_RADIUS_M * on_pins_n))
