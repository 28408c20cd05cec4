"""A body, a pose and helpers for the tests of conversions."""

from __future__ import annotations

import json
from math import cos, radians, sin

from msgspec.structs import replace

from mindstage.msgs import decode, encode, world_control_msgs
from mindstage.scene import Body, BodyId, Iri, Pose
from tests.kitchenette import KNOWROB, MAP

__all__ = ["ASYMMETRIC", "MUG", "json_round_trip", "transmittable_part"]

ASYMMETRIC = Pose((1.0, 2.0, 3.0), (cos(radians(15.0)), 0.0, 0.0, sin(radians(15.0))))
MUG = Body(id=BodyId("mug"), iri=Iri(MAP + "mug"), cls=Iri(KNOWROB + "Cup"), pose=ASYMMETRIC)


def json_round_trip(
    request: world_control_msgs.SpawnSemanticMap.Request,
) -> world_control_msgs.SpawnSemanticMap.Request:
    return decode(type(request), json.loads(json.dumps(encode(request))), strict=True)


def transmittable_part(body: Body) -> Body:
    """Returns a body without the fields that a model cannot represent, as `untranslatable_fields` lists them."""
    materials = tuple(replace(material, color=None) for material in body.materials)
    return replace(body, facts=(), materials=materials)
