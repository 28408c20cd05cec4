"""Dialect 4, KnowRob 1 (2009 to 2016): what robots perceived, and what hangs together.

An object's pose is where it was perceived last, or in the oldest maps where it says that it stands; earlier perceptions
stay facts. Matrices tell it (see `matrices`). Parts go with their whole, unless a joint lets them move.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mindstage.knowledge.names import local_name
from mindstage.knowledge.readers.knowrob1_joints import add_joints, find_joints
from mindstage.knowledge.readers.nesting_frames import resolve_pose_frames
from mindstage.knowledge.readers.numbers import NumberReader
from mindstage.knowledge.readers.perceptions import PerceivedPoses
from mindstage.knowledge.readers.rewording import DialectNormalizer, abbreviated_names
from mindstage.knowledge.readers.semlog import read_semlog
from mindstage.knowledge.readers.soma import is_soma, read_soma
from mindstage.knowledge.reading.excerpt import SourceMap
from mindstage.knowledge.reading.other_words import (
    CONNECTIONS,
    HINGED_TO,
    PRISMATICALLY_CONNECTED_TO,
    TO_PARTS,
    TO_WHOLES,
)
from mindstage.knowledge.vocabulary import CHILD, HAS_POSE, PARENT
from mindstage.knowledge.wording import words
from mindstage.world import Iri, World

__all__ = ["is_knowrob1", "read_knowrob1"]


def is_knowrob1(source_map: SourceMap) -> bool:
    """Whether something in the map has a place that only this dialect understands."""
    unplaced = [member for member in source_map.members if not _has_pose(source_map, member)]
    return bool(unplaced) and any(map(PerceivedPoses(source_map.graph).perceptions_of, unplaced))


def read_knowrob1(source_map: SourceMap) -> World:
    """Reads a map of dialect 4."""
    with np.errstate(over="ignore", invalid="ignore"):  # what becomes of too large numbers is looked at afterwards
        reworded = _normalize(DialectNormalizer(source_map))
    # Maps were carried from one generation to the next by hand, and some things were left as they were.
    return read_soma(reworded) if is_soma(reworded) else read_semlog(reworded)


def _normalize(normalizer: DialectNormalizer) -> SourceMap:
    excerpt = normalizer.source_map
    joints = find_joints(normalizer)
    numbers = NumberReader(excerpt.conventions)
    _set_poses(
        normalizer, [each for each in excerpt.members if each not in joints and not _has_pose(excerpt, each)], numbers
    )
    _set_sizes(normalizer, numbers)
    numbers.report_assumptions(normalizer)
    add_joints(normalizer, joints)
    _attach_parts(normalizer)
    normalizer.make_jointed_dynamic()
    return normalizer.normalized()


def _has_pose(source_map: SourceMap, individual: Iri) -> bool:
    return any(fact.property == HAS_POSE for fact in source_map.graph.get(individual, ()))


def _set_poses(normalizer: DialectNormalizer, individuals: list[Iri], number_reader: NumberReader) -> None:
    """Says where things are."""
    excerpt = normalizer.source_map
    perceptions = PerceivedPoses(excerpt.graph)
    placements = {}
    for individual in individuals:
        placement = perceptions.latest_pose(normalizer, individual)
        if placement is not None:
            placements[individual] = placement
    mirrored = [individual for individual, placement in placements.items() if placement.mirrored]
    if mirrored:
        evidence = f"{len(mirrored)} of {len(placements)} matrices are left-handed: {abbreviated_names(mirrored)}"
        value = "matrices are taken without their mirror: x and z stay, y is turned round"
        excerpt.record_assumption("handedness", value, evidence)
    poses = {individual: number_reader.pose(placement.pose) for individual, placement in placements.items()}
    for individual, pose in resolve_pose_frames(normalizer, poses, dict(_part_pairs(normalizer))).items():
        normalizer.set_pose(individual, pose)


def _set_sizes(normalizer: DialectNormalizer, number_reader: NumberReader) -> None:
    """Says how large things are: a length below 0 only says which way an axis was drawn."""
    backwards = []
    for individual in normalizer.poses:
        told = [_read_length(normalizer, individual, number) for number in range(3)]
        if any(length is not None and length < 0.0 for length in told):
            backwards.append(individual)
        normalizer.set_size(individual, [None if each is None else abs(number_reader.length(each)) for each in told])
    if backwards:
        evidence = (
            f"{len(backwards)} of {len(normalizer.poses)} things have a length below 0: {abbreviated_names(backwards)}"
        )
        normalizer.source_map.record_assumption("lengths below 0", "the same above 0", evidence)


def _read_length(normalizer: DialectNormalizer, individual: Iri, axis: int) -> float | None:
    for value in normalizer.values(individual, words.SIZE[axis].property):
        length = words.parse_number(words.literal_text(value) or "")
        if length is not None:
            return length
    return None


def _part_pairs(normalizer: DialectNormalizer) -> Iterator[tuple[Iri, Iri]]:
    """Each part, and what it is a part of."""
    for member in normalizer.members:
        for part in normalizer.references(member, *TO_PARTS):
            yield part, member
        for whole in normalizer.references(member, *TO_WHOLES):
            yield member, whole


def _attach_parts(normalizer: DialectNormalizer) -> None:
    """Says what goes where other things go."""
    hanging = {child for member in normalizer.members for child in normalizer.references(member, CHILD)}
    hanging |= {member for member in normalizer.members if normalizer.references(member, PARENT)}
    pairs = dict.fromkeys((whole, part) for part, whole in _part_pairs(normalizer))
    for member in normalizer.members:
        for property in CONNECTIONS:
            for other in normalizer.references(member, property):
                if (other, member) not in pairs:
                    pairs[member, other] = None
                if (
                    property in (HINGED_TO, PRISMATICALLY_CONNECTED_TO)
                    and frozenset((member, other)) not in normalizer.joined_pairs
                ):
                    what = f"it is joined with {local_name(other)}, but no joint tells how far that moves"
                    normalizer.warn(member, property, what, "they go together")
    for whole, part in pairs:
        if normalizer.can_attach(whole, part) and part not in hanging:
            normalizer.attach(whole, part)
