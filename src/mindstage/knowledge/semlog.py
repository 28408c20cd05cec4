"""Dialect 1, SemLog's maps with physics: from a graph to a world (`semantic_map` writes it back).

Every individual that says `describedInMap` becomes a body, a constraint or a light, if it has a pose; every statement
that has no field stays a fact of it; all else that the source says stays a resource. So each statement of the source
is in the world, once. What cannot be taken as told is reported, and told again by the writer as it was.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

from mindstage.knowledge import words
from mindstage.knowledge.census import Census, census_of, is_constraint, types_of
from mindstage.knowledge.findings import Report, Severity
from mindstage.knowledge.graph import Graph
from mindstage.knowledge.hierarchy import ClassHierarchy
from mindstage.knowledge.materials import materials_of
from mindstage.knowledge.names import ids_for, is_part_name, local_name
from mindstage.knowledge.parts import ANGULAR_PART, LINEAR_PART, PARTS, POSE_PART, Part
from mindstage.knowledge.relations import Relations
from mindstage.knowledge.sizes import ClassSizes, superclasses
from mindstage.knowledge.statements import Heard
from mindstage.knowledge.vocabulary import (
    CHILD,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    LIGHT_CLASSES,
    NAMED_INDIVIDUAL,
    PARENT,
    SEMANTIC_MAP,
    THING,
    TYPE,
)
from mindstage.world import (
    AngularMotion,
    Anonymous,
    Attachment,
    Body,
    BodyId,
    Constraint,
    Fact,
    Iri,
    Light,
    LinearMotion,
    Physics,
    Pose,
    Reference,
    Resource,
    Shape,
    Tag,
    Vector,
    World,
)
