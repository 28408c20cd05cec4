"""Dialect 4, KnowRob 1: what has moved was perceived once more, a second after it was perceived last.

The exact pose stands beside it in dialect 1's words, since a matrix rounds; the perception only restates it.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from math import floor, isfinite

import numpy as np

from mindstage.knowledge.graph import Graph
from mindstage.knowledge.names import part_name
from mindstage.knowledge.readers.perceptions import Perceptions
from mindstage.knowledge.reading.other_words import EVENT_OCCURS_AT, OBJECT_ACTED_ON, START_TIME
from mindstage.knowledge.vocabulary import HAS_POSE, KNOWROB, RESTATES, TYPE, knowrob, xsd
from mindstage.knowledge.wording.blocks import Block
from mindstage.world import Body, Fact, Iri, Literal, Pose, Reference
from mindstage.world.geometry import rotation_matrix, unit_pose

__all__ = ["KNOWROB1_DIALECT", "perception_blocks"]

KNOWROB1_DIALECT = "KnowRob 1"
_MARK = Fact(RESTATES, Reference(HAS_POSE))


def perception_blocks(body: Body, graph: Graph, taken: Container[str]) -> Iterator[Block]:
    """A perception of a body where it is now, and the matrix that says where.

    Args:
        body: what has moved.
        graph: what the map says, earlier perceptions among it.
        taken: names that others have.
    """
    sights = Perceptions(graph).sights(body.iri)
    last = max((sight.at for sight in sights if isfinite(sight.at)), default=-1.0)
    event, matrix = (part_name(body.iri, suffix, taken) for suffix in ("perception", "matrix"))
    yield Block(
        event,
        [
            Fact(TYPE, Reference(knowrob("SemanticMapPerception"))),
            _MARK,
            Fact(OBJECT_ACTED_ON, Reference(body.iri)),
            Fact(EVENT_OCCURS_AT, Reference(matrix)),
            Fact(START_TIME, Reference(Iri(f"{KNOWROB}timepoint_{floor(last) + 1}"))),
        ],
        f"Perception of {body.id}",
    )
    yield Block(matrix, [Fact(TYPE, Reference(knowrob("RotationMatrix3D"))), _MARK, *_elements(body.pose)])


def _elements(pose: Pose) -> Iterator[Fact]:
    row, matrix = unit_pose(pose), np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation_matrix(row[3:]), row[:3]
    for (i, j), number in np.ndenumerate(matrix):
        yield Fact(knowrob(f"m{i}{j}"), Literal(repr(float(number) + 0.0), xsd("float")))
