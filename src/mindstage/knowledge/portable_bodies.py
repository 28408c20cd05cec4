"""Bodies whose map does not give their mobility, and that people carry by their class: a cup on a table is loose.

A body without a mobility is static. A static cup cannot be picked up, though, so that a body of a portable class is
dynamic if something is below it, which is an assumption. If nothing is, it would fall, and its pose or size is wrong:
it stays static, and is reported.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec.structs import replace

from mindstage.knowledge.shape_rules import Mounting, ShapeRule
from mindstage.maps.dialects.conventions import UnstatedMobility
from mindstage.maps.dialects.source_map import SourceMap
from mindstage.maps.rdf_mapping.properties import MOBILITY
from mindstage.rdf.graphs import Severity
from mindstage.scene import Body, BodyId, Iri, Mobility, World
from mindstage.scene.bounding_boxes import (
    OrientedBoxes,
    contains,
    footprints,
    overlapping_pairs,
    polygon_overlap_areas,
)
from mindstage.scene.display import counted
from mindstage.scene.transforms import normalize, pose_array

__all__ = ["with_portable_bodies"]

_MAX_GAP_M = 0.02
"""A body rests on another one if the distance from its lower side is at most this [m]."""
_MAX_BOARD_M = 0.02
"""Thickness of the bottom of a drawer or a basket, on which a body in it rests, besides the distance [m]."""
_SHELF_SHAPES = ("case", "shelf")
"""The shapes of furniture with shelves."""
_MIN_INSIDE = 0.95
"""Part of a body that is inside of a cupboard."""
_MIN_COMMON_AREA_M2 = 1e-6
"""Bodies whose footprints have a smaller intersection are beside each other."""
_MAX_NAMED = 5
"""Bodies that the assumption names."""


def with_portable_bodies(world: World, source_map: SourceMap, rule_of: Callable[[Iri], ShapeRule]) -> World:
    """Makes bodies of portable classes dynamic whose mobility is not given, and that have a support.

    Args:
        world: the world of the map; bodies that are attached, or at a joint, stay as they are.
        source_map: takes the assumption, and a finding for each body without a support.
        rule_of: returns the rule of a class, of which the mounting and the typical size are used.
    """
    held = {end for joint in world.joints for end in (joint.parent, joint.child)}
    held |= {end for attachment in world.attachments for end in (attachment.parent, attachment.child)}
    unset = [each for each in world.bodies if each.physics.mobility is None and each.id not in held]
    portable = [each for each in unset if _is_portable(rule_of(each.cls))]
    if not portable or source_map.conventions.mobility is UnstatedMobility.STATIC:
        return world
    supported = _supported(world, portable, rule_of)
    for each in portable:
        if each.id not in supported:
            problem = f"its mobility is not given, and nothing is within {1000 * _MAX_GAP_M:g} mm below it"
            source_map.report(Severity.WARNING, each.iri, MOBILITY.property, problem, "it is static")
    if not supported:
        return world
    names = [each.id for each in portable if each.id in supported]
    listed = ", ".join(names[:_MAX_NAMED]) + (" and others" if len(names) > _MAX_NAMED else "")
    evidence = f"people carry what is of the {counted(len(names), 'body')} {listed}, and each has something below it"
    source_map.record_assumption("mobility of portable bodies", "dynamic", evidence)
    assumed = {"mobility": Mobility.DYNAMIC, "assumed": ("mobility",)}
    bodies = (
        replace(each, physics=replace(each.physics, **assumed)) if each.id in supported else each
        for each in world.bodies
    )
    return replace(world, bodies=tuple(bodies))


def _is_portable(rule: ShapeRule) -> bool:
    """Whether people carry what has this rule; a word inside the name of its class is not enough."""
    return rule.mounting is Mounting.PORTABLE and not rule.mounting_is_weak


def _supported(world: World, portable: list[Body], rule_of: Callable[[Iri], ShapeRule]) -> set[BodyId]:
    """The ids of the bodies that stand on another one, on the bottom of one that contains them, or in a cupboard.

    A map has no shelves: the geometry of a cupboard gets them where what is in it stands.

    Args:
        world: the world, whose bodies count as their boxes.
        portable: the bodies in question.
        rule_of: see `with_portable_bodies`; a body without a size has the typical size of its class.
    """
    bodies = [each for each in world.bodies if any(each.pose.quaternion)]
    poses = pose_array(each.pose for each in bodies)
    poses[:, 3:] = normalize(poses[:, 3:])
    sizes = np.array([each.size or rule_of(each.cls).size or (0.0, 0.0, 0.0) for each in bodies], dtype=float)
    boxes = OrientedBoxes.from_poses(poses, sizes)
    (low, high), polygons, asked = boxes.bounds(), footprints(boxes), {each.id for each in portable}
    is_case = np.array([rule_of(each.cls).shape_type in _SHELF_SHAPES for each in bodies], dtype=bool)
    is_asked = np.array([each.id in asked for each in bodies], dtype=bool) & sizes.all(axis=1)
    any_body, found = np.ones(len(bodies), dtype=bool), set[BodyId]()
    for first, second in overlapping_pairs(boxes, is_asked, any_body, margin=(0.0, 0.0, _MAX_GAP_M)):
        upper, lower = np.concatenate([first, second]), np.concatenate([second, first])
        # The underside is at the top of another body, or at the underside of one that is as high, such as a basket.
        on_top = np.abs(low[upper, 2] - high[lower, 2]) <= _MAX_GAP_M
        height = low[upper, 2] - low[lower, 2]
        on_bottom = (height >= 0.0) & (height <= _MAX_GAP_M + _MAX_BOARD_M)
        contained = on_bottom & (high[lower, 2] >= high[upper, 2])
        contained |= is_case[lower] & contains(boxes, lower, upper, min_fraction=_MIN_INSIDE)
        near = is_asked[upper] & (on_top | contained)
        upper, lower = upper[near], lower[near]
        stands = polygon_overlap_areas(polygons, upper, lower) > _MIN_COMMON_AREA_M2
        found.update(bodies[row].id for row in upper[stands].tolist())
    return found
