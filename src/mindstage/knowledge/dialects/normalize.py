"""Rewording: a map of another dialect says in the words of dialect 1 what its own words mean, and keeps both.

A reader of another dialect finds out where things are and how they hang together, and says so here. All that the map
said itself stays beside it, so dialect 1's reader makes the world out of both and loses nothing; and since a written
map says both, whoever reads that one gets the same world.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from math import isfinite
from typing import Any, TypeVar

from mindstage.knowledge.dialects.joints import JointLimits
from mindstage.knowledge.dialects.membership import types_of
from mindstage.knowledge.dialects.semlog import read_semlog
from mindstage.knowledge.dialects.source_map import SourceMap
from mindstage.knowledge.rdf import Severity, local_name, part_name
from mindstage.knowledge.rdf_mapping import properties as words
from mindstage.knowledge.rdf_mapping.fields import write_materials
from mindstage.knowledge.rdf_mapping.nested import (
    NESTED_ANGULAR_LIMITS,
    NESTED_LINEAR_LIMITS,
    NESTED_POSE,
    NestedResource,
    sorted_facts,
)
from mindstage.knowledge.rdf_mapping.properties import PropertyCodec, SubjectWriter
from mindstage.knowledge.vocabulary import CHILD, CONSTRAINT, DESCRIBED_IN_MAP, HAS_LINEAR, HAS_POSE, PARENT, TYPE
from mindstage.scene import (
    BlankNode,
    FactValue,
    Iri,
    IriRef,
    Material,
    Mobility,
    Pose,
    PrimitiveType,
    PropertyAssertion,
    World,
)

__all__ = ["DialectNormalizer", "abbreviated_names"]

T = TypeVar("T")


class DialectNormalizer:
    """One map on its way into the words of dialect 1."""

    def __init__(self, source_map: SourceMap) -> None:
        self.source_map = source_map
        self.graph: dict[Iri, list[PropertyAssertion]] = {
            subject: list(facts) for subject, facts in source_map.graph.items()
        }
        self.members: dict[Iri, None] = dict.fromkeys(source_map.members)
        self.poses: dict[Iri, Pose] = {}
        self.sizes: dict[Iri, tuple[float, float, float]] = {}
        self.joined_pairs: set[frozenset[Iri]] = set(self._existing_joint_pairs())
        """Pairs that a joint joins, be it in the words of dialect 1."""
        self.movable: dict[Iri, None] = {}
        """What hangs on a joint that lets it move."""
        self._suppressed: set[tuple[str, str]] = set()
        self._facts_added: dict[Iri, set[PropertyAssertion]] = {}

    # -- saying --------------------------------------------------------------------------------------------------------

    def add(self, subject: Iri, property: Iri, value: FactValue) -> None:
        """Says one thing, unless it is said already."""
        facts = self.graph.setdefault(subject, [])
        said = self._facts_added.setdefault(subject, set(facts))
        fact = PropertyAssertion(property, value)
        if fact not in said:
            said.add(fact)
            facts.append(fact)

    def prepend_value(self, subject: Iri, codec: PropertyCodec[T], value: T) -> None:
        """Says a value in front of all that was told under the same word, so that it is the one that counts."""
        self.graph.setdefault(subject, []).insert(0, PropertyAssertion(codec.property, codec.encode(value)))

    def set_pose(self, individual: Iri, pose: Pose) -> None:
        """Says where something is, if anywhere."""
        if not _is_finite(pose):
            self.warn(individual, HAS_POSE, "its pose has numbers too large to reckon with", "it tells no place")
            return
        self.poses[individual] = pose
        self._set_nested(individual, NESTED_POSE, pose)

    def set_size(self, individual: Iri, size: Sequence[float | None]) -> None:
        """Says how large something is, as far as that is known; what was told of it, and not so, is kept."""
        for word, extent in zip(words.SIZE, size, strict=True):
            if extent is not None and self.first_value(individual, word) != extent:
                self.prepend_value(individual, word, extent)
                self._suppressed.add((individual, word.property))
        x, y, z = size
        if x is not None and y is not None and z is not None:
            self.sizes[individual] = (x, y, z)

    def set_shape(self, individual: Iri, shape_type: PrimitiveType) -> None:
        """Says of what form something is."""
        self.prepend_value(individual, words.SHAPE, shape_type)

    def set_mesh(self, individual: Iri, path: str) -> None:
        """Says where the mesh is."""
        self.prepend_value(individual, words.MESH, path)

    def set_materials(self, individual: Iri, materials: Sequence[Material]) -> None:
        """Says how something looks."""
        said = SubjectWriter(individual)
        write_materials(said, materials)
        for fact in said.all_facts():
            self.add(individual, fact.property, fact.value)

    def attach(self, parent: Iri, child: Iri) -> None:
        """Says that one thing goes where another one goes."""
        self.add(parent, CHILD, IriRef(child))

    def add_joint(self, owner: Iri, parent: Iri, child: Iri, joint: JointLimits, *, name: Iri | None = None) -> None:
        """Says that a joint joins two things.

        Args:
            owner: what the joint is named after where it has no name.
            parent: what holds.
            child: what is held.
            joint: how.
            name: the joint's own name.
        """
        if not _is_finite(joint.pose):
            self.warn(owner, HAS_POSE, "its joint has numbers too large to reckon with", "the joint stays a fact")
            return
        constraint = name or part_name(owner, "joint", self.graph)
        self.members[constraint] = None
        self.add(constraint, TYPE, IriRef(CONSTRAINT))
        self.add(constraint, DESCRIBED_IN_MAP, IriRef(self.source_map.map))
        self.add(constraint, PARENT, IriRef(parent))
        self.add(constraint, CHILD, IriRef(child))
        self._set_nested(constraint, NESTED_POSE, joint.pose)
        self._set_nested(constraint, NESTED_LINEAR_LIMITS, joint.linear)
        self._set_nested(constraint, NESTED_ANGULAR_LIMITS, joint.angular)
        self.joined_pairs.add(frozenset((parent, child)))
        if joint.is_movable:
            self.movable[child] = None

    def _existing_joint_pairs(self) -> Iterator[frozenset[Iri]]:
        for member in self.members:
            if self.values(member, HAS_LINEAR):
                for parent in self.references(member, PARENT):
                    yield from (frozenset((parent, child)) for child in self.references(member, CHILD))

    def _set_nested(self, owner: Iri, nested_resource: NestedResource[Any], value: object) -> None:
        said = SubjectWriter(owner)
        nested_resource.write(said, value)
        self.graph.setdefault(owner, []).append(
            PropertyAssertion(nested_resource.property, BlankNode(sorted_facts(said.all_facts())))
        )

    # -- hearing -------------------------------------------------------------------------------------------------------

    def first_value(self, subject: Iri, codec: PropertyCodec[T]) -> T | None:
        """The first value of a word that can be understood."""
        values = (codec.decode(value) for value in self.values(subject, codec.property))
        return next((value for value in values if value is not None), None)

    def values(self, subject: Iri, *properties: Iri) -> list[FactValue]:
        """All that is said about a thing by some properties."""
        return [fact.value for fact in self.graph.get(subject, ()) if fact.property in properties]

    def references(self, subject: Iri, *properties: Iri) -> list[Iri]:
        """The things that a thing is said to have to do with."""
        return [value.iri for value in self.values(subject, *properties) if isinstance(value, IriRef)]

    def can_attach(self, parent: Iri, child: Iri) -> bool:
        """Whether both stand somewhere, and no joint lets the child move."""
        both_stand = parent in self.poses and child in self.poses
        return both_stand and frozenset((parent, child)) not in self.joined_pairs and child not in self.movable

    def class_name_contains(self, subject: Iri, text: str) -> bool:
        """Whether the name of one of its classes holds a word."""
        return any(text in local_name(cls) for cls in types_of(self.graph.get(subject, ())))

    def warn(self, individual: Iri, property: str, problem: str, action: str) -> None:
        """Reports something odd."""
        self.source_map.report(Severity.WARNING, individual, property, problem, action)

    # -- ending --------------------------------------------------------------------------------------------------------

    def make_jointed_dynamic(self) -> None:
        """Says of what hangs on joints that the physics moves it, where nobody says otherwise, and says so aloud."""
        silent = [child for child in self.movable if self.first_value(child, words.MOBILITY) is None]
        for child in silent:
            self.prepend_value(child, words.MOBILITY, Mobility.DYNAMIC)
        if silent:
            evidence = f"of {len(silent)} bodies a joint lets them move, and nothing says whether they do: {abbreviated_names(silent)}"
            self.source_map.record_assumption("mobility", "what hangs on a joint is dynamic", evidence)

    def world(self) -> World:
        """The world that dialect 1's reader makes of it."""
        return read_semlog(self.normalized())

    def normalized(self) -> SourceMap:
        """The map with all that was said here, for whoever reads it next."""
        for member in self.members:
            if member.startswith("_:"):
                self.warn(member, "", "it has no name", f"it is called {local_name(member)!r} in this world")
        return replace(self.source_map, graph=self.graph, members=list(self.members), report=self._report_unsuppressed)

    def _report_unsuppressed(
        self, severity: Severity, individual: str, property: str, problem: str, action: str
    ) -> None:
        """Passes on what dialect 1's reader finds, but for what was met here before."""
        if (individual, property) not in self._suppressed:
            self.source_map.report(severity, individual, property, problem, action)


def _is_finite(pose: Pose) -> bool:
    return all(map(isfinite, (*pose.position, *pose.quaternion)))


def abbreviated_names(individuals: Iterable[Iri]) -> str:
    """The names of some things, and how many more there are."""
    names = [local_name(individual) for individual in individuals]
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more
