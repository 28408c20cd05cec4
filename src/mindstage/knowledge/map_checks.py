"""Findings about a world that can be simulated as it is, but that its map cannot mean.

A joint far from what it moves, a hinge that opens inwards, a door that slides by its thickness or opens to both sides,
moving parts at one pose or inside of fixed bodies, a class that no ontology has. Nothing is changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches

import numpy as np

from mindstage.knowledge.shape_rules import name_tokens
from mindstage.maps.dialects.source_map import SourceMap
from mindstage.rdf.graphs import FindingSink, Severity, local_name
from mindstage.rdf.vocabulary import HAS_ANGULAR, HAS_LINEAR, HAS_POSE, OWL, RDFS, TYPE
from mindstage.scene import AxisMotion, Body, BodyId, Iri, Joint, World
from mindstage.scene.bounding_boxes import OrientedBoxes, contains, overlapping_pairs, penetration_depths
from mindstage.scene.display import counted
from mindstage.scene.joint_kinematics import (
    ObservedBox,
    RigidGroups,
    axis_ranges,
    first_movable_axis,
    handles_by_body,
    is_moving_part_class,
    is_robot_part,
    moving_body,
    outward_joints,
)
from mindstage.scene.transforms import normalized_pose_array, pose_array, quat_rotate

__all__ = ["report_implausible"]

_MAX_HINGE_DISTANCE_M = 1.0
_MIN_SLIDE_M = 0.1
"""Doors that slide at all slide farther than this."""
_TWO_WAY = 0.9
"""Largest offset of a range from the closed position, relative to its half, with which it opens to both sides."""
_INWARD_M = 0.05
"""How far the middle of a door moves into what holds it, until it is half open, to be reported [m]."""
_OVERLAP_M = 0.05
_OVERLAP_SHARE = 0.25
"""How far a moving part is in a fixed body to be reported, also relative to its smallest extent."""
_INSIDE = 0.9
"""A part that is in a fixed body by this share along each axis is in its place, as a drawer in a cupboard."""
_MAX_NAMED = 3
"""Number of bodies that a finding names."""
_MIN_SIMILARITY = 0.8
"""Similarity of names from which one may be misspelled (`difflib`); an unlike class may be in an ontology elsewhere."""
_MAX_COMPARED = 50
"""Number of unknown classes for which near names are looked for."""


def report_implausible(world: World, source_map: SourceMap, classes: Callable[[], Iterable[Iri]]) -> None:
    """Reports what a map cannot mean.

    Args:
        world: the world as it was read.
        source_map: what it was read from; takes the findings.
        classes: returns the classes that any source declares.
    """
    report = source_map.report
    bodies = {body.id: body for body in world.bodies}
    moving = dict[BodyId, Body]()
    for joint in world.joints:
        if joint.parent in bodies and joint.child in bodies:
            moved, holder = moving_body(joint, bodies[joint.parent], bodies[joint.child])
            if not is_robot_part(moved):
                moving[moved.id] = moved
                _report_joint(joint, moved, holder, report)
    _report_two_way(world, bodies, report)
    _report_same_poses(world, moving, report)
    _report_overlaps(world, moving, report)
    _report_unknown_classes(world, source_map, classes)


def _report_joint(joint: Joint, moved: Body, holder: Body, report: FindingSink) -> None:
    number = first_movable_axis(joint)
    if number is None or moved.size is None:
        return
    motion, limit, middle = axis_ranges(joint)[number]
    action = "it is kept as it is"
    if number < 3:
        if motion is AxisMotion.LIMITED and 2 * limit < _MIN_SLIDE_M and "door" in name_tokens(moved.cls):
            problem = f"it lets the door {moved.id} slide by {2 * limit:.3g} m only"
            report(Severity.WARNING, joint.iri, HAS_LINEAR, problem, action)
        return
    box, origin = ObservedBox.of(moved), np.array(joint.pose.position)
    axis = quat_rotate(normalized_pose_array(joint.pose)[3:], np.eye(3)[number % 3])
    nearest = origin + float((box.center - origin) @ axis) * axis
    apart = np.maximum(np.abs(box.axes @ (nearest - box.center)) - box.half_extents, 0.0)
    distance = float(np.linalg.norm(apart))
    if distance > _MAX_HINGE_DISTANCE_M:
        problem = f"its axis is {distance:.2f} m from {moved.id}, which it moves"
        report(Severity.WARNING, joint.iri, HAS_POSE, problem, action)
        return
    half_open = middle if moved.id == joint.child else -middle
    if motion is not AxisMotion.LIMITED or abs(middle) < 0.9 * limit or holder.size is None or not limit:
        return
    casing, arm = ObservedBox.of(holder), box.center - nearest
    opened = nearest + np.cos(half_open) * arm + np.sin(half_open) * np.cross(axis, arm)
    before, after = (
        float((casing.half_extents - np.abs(casing.axes @ (at - casing.center))).min()) for at in (box.center, opened)
    )
    if after > max(before, 0.0) + _INWARD_M:
        problem = f"it opens {moved.id} inwards: half open, its middle is {after:.2f} m inside of {holder.id}"
        report(Severity.WARNING, joint.iri, HAS_ANGULAR, problem, action)


def _report_two_way(world: World, bodies: Mapping[BodyId, Body], report: FindingSink) -> None:
    """Reports doors and drawers that open to both sides, and whose front nothing shows."""
    parents = {each.child: each.parent for each in world.attachments}
    limited = outward_joints(world.joints, bodies, handles_by_body(bodies, parents))
    for joint in world.joints:
        number = first_movable_axis(joint)
        if number is None or joint.id in limited or not {joint.parent, joint.child} <= bodies.keys():
            continue
        moved, holder = moving_body(joint, bodies[joint.parent], bodies[joint.child])
        motion, limit, middle = axis_ranges(joint)[number]
        if motion is AxisMotion.LIMITED and abs(middle) < _TWO_WAY * limit and is_moving_part_class(moved.cls):
            problem = f"it lets {moved.id} open to both sides, and nothing shows where its front is"
            action = f"it moves {limit:.3g} {'m' if number < 3 else 'rad'} either way in {holder.id}"
            report(Severity.WARNING, joint.iri, HAS_LINEAR if number < 3 else HAS_ANGULAR, problem, action)


def _report_same_poses(world: World, moving: Mapping[BodyId, Body], report: FindingSink) -> None:
    by_pose: dict[tuple[object, ...], list[Body]] = {}
    for body in world.bodies:
        if body.id in moving or "door" in name_tokens(body.cls):
            by_pose.setdefault((body.cls, body.pose.position, body.pose.quaternion), []).append(body)
    for same in by_pose.values():
        if len(same) > 1:
            problem = f"{_listed(same)} have the identical pose"
            report(Severity.WARNING, same[0].iri, HAS_POSE, problem, "they are in each other")


def _report_overlaps(world: World, moving: Mapping[BodyId, Body], report: FindingSink) -> None:
    """Reports parts that joints move and that are in fixed bodies with which they have nothing to do."""
    sized = [body for body in world.bodies if body.size is not None]
    if not moving or len(sized) < 2:
        return
    poses = pose_array(body.pose for body in sized)
    boxes = OrientedBoxes.from_poses(poses, np.array([body.size for body in sized]))
    is_moving = np.array([body.id in moving for body in sized])
    groups = RigidGroups.from_world(world)
    rows = {body.id: row for row, body in enumerate(world.bodies)}
    root = np.asarray(groups.root_row)[[rows[body.id] for body in sized]]
    jointed = {pair for a, b in groups.jointed_pairs for pair in ((a, b), (b, a))}
    is_fixed = ~is_moving & np.array([not body.physics.is_dynamic for body in sized]) & ~np.isin(root, root[is_moving])
    found: dict[int, list[Body]] = {}
    for first, second in overlapping_pairs(boxes, is_moving, is_fixed):
        a, b = np.where(is_moving[first], first, second), np.where(is_moving[first], second, first)
        depth = penetration_depths(boxes, a, b)
        deep = (depth > _OVERLAP_M) & (depth > _OVERLAP_SHARE * 2 * boxes.half_extents[a].min(axis=1))
        deep &= ~contains(boxes, b, a, min_fraction=_INSIDE) & ~contains(boxes, a, b, min_fraction=_INSIDE)
        for part, fixed in zip(a[deep].tolist(), b[deep].tolist(), strict=True):
            if (int(root[part]), int(root[fixed])) not in jointed:
                found.setdefault(part, []).append(sized[fixed])
    for part, others in found.items():
        problem = f"{sized[part].id} moves, and is partly in what does not move: {_listed(others)}"
        report(Severity.WARNING, sized[part].iri, HAS_POSE, problem, "the boxes count as they are")


def _report_unknown_classes(world: World, source_map: SourceMap, declared: Callable[[], Iterable[Iri]]) -> None:
    hierarchy, used = source_map.hierarchy, dict.fromkeys(body.cls for body in world.bodies)
    unknown = [
        cls
        for cls in used
        if not (cls.startswith((OWL, RDFS)) or cls in source_map.graph)
        and not (hierarchy.ancestors(cls) or hierarchy.descendants(cls))
    ]
    known = set(declared()) if unknown else set()
    unknown = [cls for cls in unknown if cls not in known]
    by_key = {local_name(cls).lower(): cls for cls in sorted(known)}
    for cls in unknown[:_MAX_COMPARED]:
        name = local_name(cls)
        keys = get_close_matches(name.lower(), list(by_key), n=3, cutoff=_MIN_SIMILARITY)
        if found := [by_key[key] for key in keys]:  # one of the same name in another namespace is named in full
            near = ", ".join(each if local_name(each) == name else repr(local_name(each)) for each in found)
            problem = f"no loaded ontology has the class {name!r}; near: {near}"
            source_map.report(Severity.WARNING, cls, TYPE, problem, "its shape follows from its name, else it is a box")


def _listed(bodies: list[Body]) -> str:
    names = ", ".join(body.id for body in bodies[:_MAX_NAMED])
    return names if len(bodies) <= _MAX_NAMED else f"{names} and {counted(len(bodies) - _MAX_NAMED, 'other body')}"
