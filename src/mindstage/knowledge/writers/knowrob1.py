"""Dialect 4, KnowRob 1: what has moved was perceived once more, a second after it was perceived last.

The exact pose stands beside it in dialect 1's words, since a matrix rounds; the perception only restates it.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from math import floor, isfinite

import numpy as np

from mindstage.knowledge.graph import Graph
from mindstage.knowledge.names import part_name
from mindstage.knowledge.readers.perceptions import PerceivedPoses
from mindstage.knowledge.reading.other_words import EVENT_OCCURS_AT, OBJECT_ACTED_ON, START_TIME
from mindstage.knowledge.vocabulary import HAS_POSE, KNOWROB, RESTATES, TYPE, knowrob, xsd
from mindstage.knowledge.wording.blocks import SubjectBlock
from mindstage.world import Body, Iri, IriRef, Literal, Pose, PropertyAssertion
from mindstage.world.geometry import normalized_pose_array, rotation_matrix

__all__ = ["KNOWROB1_DIALECT", "perception_blocks"]

KNOWROB1_DIALECT = "KnowRob 1"
_RESTATES_POSE = PropertyAssertion(RESTATES, IriRef(HAS_POSE))


def perception_blocks(body: Body, graph: Graph, used_names: Container[str]) -> Iterator[SubjectBlock]:
    """A perception of a body where it is now, and the matrix that says where.

    Args:
        body: what has moved.
        graph: what the map says, earlier perceptions among it.
        taken: names that others have.
    """
    sights = PerceivedPoses(graph).perceptions_of(body.iri)
    last = max((sight.time_s for sight in sights if isfinite(sight.time_s)), default=-1.0)
    event, matrix = (part_name(body.iri, suffix, used_names) for suffix in ("perception", "matrix"))
    yield SubjectBlock(
        event,
        [
            PropertyAssertion(TYPE, IriRef(knowrob("SemanticMapPerception"))),
            _RESTATES_POSE,
            PropertyAssertion(OBJECT_ACTED_ON, IriRef(body.iri)),
            PropertyAssertion(EVENT_OCCURS_AT, IriRef(matrix)),
            PropertyAssertion(START_TIME, IriRef(Iri(f"{KNOWROB}timepoint_{floor(last) + 1}"))),
        ],
        f"Perception of {body.id}",
    )
    yield SubjectBlock(
        matrix,
        [PropertyAssertion(TYPE, IriRef(knowrob("RotationMatrix3D"))), _RESTATES_POSE, *_matrix_facts(body.pose)],
    )


def _matrix_facts(pose: Pose) -> Iterator[PropertyAssertion]:
    row, matrix = normalized_pose_array(pose), np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation_matrix(row[3:]), row[:3]
    for (i, j), number in np.ndenumerate(matrix):
        yield PropertyAssertion(knowrob(f"m{i}{j}"), Literal(repr(float(number) + 0.0), xsd("float")))
