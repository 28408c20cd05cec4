"""Dialect 4, KnowRob 1 (2009 to 2016): what robots perceived, and what hangs together.

An object's pose is where it was perceived last, or in the oldest maps where it says that it stands; earlier perceptions
stay facts. Matrices tell it (see `matrices`). Parts go with their whole, unless a joint lets them move.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mindstage.knowledge.names import local_name
from mindstage.knowledge.readers.knowrob1_joints import join_all, joints_of
from mindstage.knowledge.readers.nesting_frames import told_within
from mindstage.knowledge.readers.numbers import Numbers
from mindstage.knowledge.readers.perceptions import Perceptions
from mindstage.knowledge.readers.rewording import Rewording, few
from mindstage.knowledge.readers.semlog import read_semlog
from mindstage.knowledge.readers.soma import is_soma, read_soma
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.reading.other_words import CONNECTIONS, HINGED, SLID, TO_PARTS, TO_WHOLES
from mindstage.knowledge.vocabulary import CHILD, HAS_POSE, PARENT
from mindstage.knowledge.wording import words
from mindstage.world import Iri, World

__all__ = ["is_knowrob1", "read_knowrob1"]


def is_knowrob1(excerpt: Excerpt) -> bool:
    """Whether something in the map has a place that only this dialect understands."""
    unplaced = [member for member in excerpt.members if not _stands(excerpt, member)]
    return bool(unplaced) and any(map(Perceptions(excerpt.graph).sights, unplaced))


def read_knowrob1(excerpt: Excerpt) -> World:
    """Reads a map of dialect 4."""
    with np.errstate(over="ignore", invalid="ignore"):  # what becomes of too large numbers is looked at afterwards
        reworded = _reworded(Rewording(excerpt))
    # Maps were carried from one generation to the next by hand, and some things were left as they were.
    return read_soma(reworded) if is_soma(reworded) else read_semlog(reworded)


def _reworded(rewording: Rewording) -> Excerpt:
    excerpt = rewording.excerpt
    joints = joints_of(rewording)
    numbers = Numbers(excerpt.conventions)
    _place(rewording, [each for each in excerpt.members if each not in joints and not _stands(excerpt, each)], numbers)
    _measure(rewording, numbers)
    numbers.tell(rewording)
    join_all(rewording, joints)
    _attach(rewording)
    rewording.let_move()
    return rewording.reworded()


def _stands(excerpt: Excerpt, individual: Iri) -> bool:
    return any(fact.property == HAS_POSE for fact in excerpt.graph.get(individual, ()))


def _place(rewording: Rewording, individuals: list[Iri], numbers: Numbers) -> None:
    """Says where things are."""
    excerpt = rewording.excerpt
    perceptions = Perceptions(excerpt.graph)
    placements = {}
    for individual in individuals:
        placement = perceptions.placement(rewording, individual)
        if placement is not None:
            placements[individual] = placement
    mirrored = [individual for individual, placement in placements.items() if placement.mirrored]
    if mirrored:
        evidence = f"{len(mirrored)} of {len(placements)} matrices are left-handed: {few(mirrored)}"
        value = "matrices are taken without their mirror: x and z stay, y is turned round"
        excerpt.assume("handedness", value, evidence)
    poses = {individual: numbers.pose(placement.pose) for individual, placement in placements.items()}
    for individual, pose in told_within(rewording, poses, dict(_wholes(rewording))).items():
        rewording.place(individual, pose)


def _measure(rewording: Rewording, numbers: Numbers) -> None:
    """Says how large things are: a length below 0 only says which way an axis was drawn."""
    backwards = []
    for individual in rewording.poses:
        told = [_length(rewording, individual, number) for number in range(3)]
        if any(length is not None and length < 0.0 for length in told):
            backwards.append(individual)
        rewording.measure(individual, [None if each is None else abs(numbers.length(each)) for each in told])
    if backwards:
        evidence = f"{len(backwards)} of {len(rewording.poses)} things have a length below 0: {few(backwards)}"
        rewording.excerpt.assume("lengths below 0", "the same above 0", evidence)


def _length(rewording: Rewording, individual: Iri, number: int) -> float | None:
    for value in rewording.values(individual, words.SIZE[number].property):
        length = words.number_in(words.text_in(value) or "")
        if length is not None:
            return length
    return None


def _wholes(rewording: Rewording) -> Iterator[tuple[Iri, Iri]]:
    """Each part, and what it is a part of."""
    for member in rewording.members:
        for part in rewording.references(member, *TO_PARTS):
            yield part, member
        for whole in rewording.references(member, *TO_WHOLES):
            yield member, whole


def _attach(rewording: Rewording) -> None:
    """Says what goes where other things go."""
    hanging = {child for member in rewording.members for child in rewording.references(member, CHILD)}
    hanging |= {member for member in rewording.members if rewording.references(member, PARENT)}
    pairs = dict.fromkeys((whole, part) for part, whole in _wholes(rewording))
    for member in rewording.members:
        for property in CONNECTIONS:
            for other in rewording.references(member, property):
                if (other, member) not in pairs:
                    pairs[member, other] = None
                if property in (HINGED, SLID) and frozenset((member, other)) not in rewording.joined:
                    what = f"it is joined with {local_name(other)}, but no joint tells how far that moves"
                    rewording.warn(member, property, what, "they go together")
    for whole, part in pairs:
        if rewording.may_go_together(whole, part) and part not in hanging:
            rewording.attach(whole, part)
