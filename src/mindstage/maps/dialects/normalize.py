"""Normalization of other dialects to the vocabulary of dialect 1.

The reader of another dialect adds the poses, sizes, attachments and joints that it finds to a `DialectNormalizer`,
which states them in the vocabulary of dialect 1. The statements of the source are kept beside these, so `read_semlog`
builds the world from both without loss, and reading the written map gives the same world.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import isfinite
from typing import Any, TypeVar

from mindstage.maps.dialects.joints import JointLimits
from mindstage.maps.dialects.membership import types_of
from mindstage.maps.dialects.semlog import read_semlog
from mindstage.maps.dialects.source_map import SourceMap
from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.maps.rdf_mapping.fields import write_materials
from mindstage.maps.rdf_mapping.nested import (
    NESTED_ANGULAR_LIMITS,
    NESTED_LINEAR_LIMITS,
    NESTED_POSE,
    NestedResource,
    sorted_facts,
)
from mindstage.maps.rdf_mapping.properties import PropertyCodec, SubjectWriter
from mindstage.rdf.graphs import Severity, local_name, part_name
from mindstage.rdf.vocabulary import (
    ASSUMED_PARENT,
    CHILD,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    HAS_LINEAR,
    HAS_POSE,
    PARENT,
    TYPE,
)
from mindstage.scene import (
    BlankNode,
    FactValue,
    Iri,
    IriRef,
    Literal,
    Material,
    Mobility,
    Pose,
    PrimitiveType,
    PropertyAssertion,
    World,
)
from mindstage.scene.joint_kinematics import ObservedBox

__all__ = ["DialectNormalizer", "abbreviated_names", "abbreviated_texts"]

T = TypeVar("T")


class DialectNormalizer:
    """A copy of a map's statements, extended by statements in the vocabulary of dialect 1."""

    def __init__(self, source_map: SourceMap) -> None:
        self.source_map = source_map
        self.graph: dict[Iri, list[PropertyAssertion]] = {
            subject: list(facts) for subject, facts in source_map.graph.items()
        }
        self.members: dict[Iri, None] = dict.fromkeys(source_map.members)
        self.poses: dict[Iri, Pose] = {}
        self.sizes: dict[Iri, tuple[float, float, float]] = {}
        self.joined_pairs: set[frozenset[Iri]] = set(self._existing_joint_pairs())
        """Pairs of bodies that have a joint already, in either vocabulary."""
        self.carried_pairs: set[frozenset[Iri]] = set()
        """Pairs of bodies that move together, although the map has a joint between them."""
        self.movable: dict[Iri, None] = {}
        self.assumed: dict[Iri, list[str]] = {}
        """By the child of a joint, what is assumed about the joint; see `Joint.assumed`."""
        """Children of joints with a free or limited axis."""
        self._suppressed: set[tuple[str, str]] = set()
        self._facts_added: dict[Iri, set[PropertyAssertion]] = {}

    # -- writing -------------------------------------------------------------------------------------------------------

    def add(self, subject: Iri, property: Iri, value: FactValue) -> None:
        """Adds a statement, unless it exists."""
        facts = self.graph.setdefault(subject, [])
        existing = self._facts_added.setdefault(subject, set(facts))
        fact = PropertyAssertion(property, value)
        if fact not in existing:
            existing.add(fact)
            facts.append(fact)

    def prepend_value(self, subject: Iri, codec: PropertyCodec[T], value: T) -> None:
        """Inserts a value before the others of its property, so that it takes precedence."""
        self.graph.setdefault(subject, []).insert(0, PropertyAssertion(codec.property, codec.encode(value)))

    def set_pose(self, individual: Iri, pose: Pose) -> None:
        """Sets the pose of an individual in the map frame; one that is not finite is reported and ignored."""
        if not _is_finite(pose):
            self.warn(individual, HAS_POSE, "the numbers of its pose are too large", "it has no pose")
            return
        self.poses[individual] = pose
        self._set_nested(individual, NESTED_POSE, pose)

    def set_size(self, individual: Iri, size: Sequence[float | None]) -> None:
        """Sets the extents that are known [m], None for others; differing values of the source are kept."""
        for codec, extent in zip(codecs.SIZE, size, strict=True):
            if extent is not None and self.first_value(individual, codec) != extent:
                self.prepend_value(individual, codec, extent)
                self._suppressed.add((individual, codec.property))
        x, y, z = size
        if x is not None and y is not None and z is not None:
            self.sizes[individual] = (x, y, z)

    def set_shape(self, individual: Iri, shape_type: PrimitiveType) -> None:
        """Sets the primitive shape of an individual."""
        self.prepend_value(individual, codecs.SHAPE, shape_type)

    def set_mesh(self, individual: Iri, path: str) -> None:
        """Sets the path of an individual's mesh."""
        self.prepend_value(individual, codecs.MESH, path)

    def set_materials(self, individual: Iri, materials: Sequence[Material]) -> None:
        """Sets the materials of an individual."""
        writer = SubjectWriter(individual)
        write_materials(writer, materials)
        for fact in writer.all_facts():
            self.add(individual, fact.property, fact.value)

    def attach_loose(self, pairs: Iterable[tuple[Iri, Iri]]) -> None:
        """Attaches parts rigidly to their wholes, unless they are attached already or a joint lets them move."""
        attached = {child for member in self.members for child in self.references(member, CHILD)}
        attached |= {member for member in self.members if self.references(member, PARENT)}
        for whole, part in pairs:
            if part not in attached and self._can_attach(whole, part):
                self.add(whole, CHILD, IriRef(part))

    def add_joint(self, owner: Iri, parent: Iri, child: Iri, joint: JointLimits, *, name: Iri | None = None) -> None:
        """Adds a joint between two bodies.

        Args:
            owner: the individual that an unnamed joint is named after.
            parent: the body that the joint belongs to.
            child: the body that the joint moves.
            joint: pose and limits; those that are not finite are reported, and the joint is not added.
            name: IRI of the joint, if it has one.
        """
        if not _is_finite(joint.pose):
            self.warn(owner, HAS_POSE, "the numbers of its joint are too large", "the joint is kept as a fact")
            return
        iri = name or part_name(owner, "joint", self.graph)
        self.members[iri] = None
        self.add(iri, TYPE, IriRef(CONSTRAINT))
        self.add(iri, DESCRIBED_IN_MAP, IriRef(self.source_map.map))
        self.add(iri, PARENT, IriRef(parent))
        self.add(iri, CHILD, IriRef(child))
        self._set_nested(iri, NESTED_POSE, joint.pose)
        self._set_nested(iri, NESTED_LINEAR_LIMITS, joint.linear)
        self._set_nested(iri, NESTED_ANGULAR_LIMITS, joint.angular)
        self.joined_pairs.add(frozenset((parent, child)))
        if child in self.assumed:
            self.add(iri, codecs.ASSUMED.property, Literal(" ".join(self.assumed[child])))
        if joint.is_movable:
            self.movable[child] = None

    def _existing_joint_pairs(self) -> Iterator[frozenset[Iri]]:
        for member in self.members:
            if self.values(member, HAS_LINEAR):
                for parent in self.references(member, PARENT, ASSUMED_PARENT):
                    yield from (frozenset((parent, child)) for child in self.references(member, CHILD))

    def _set_nested(self, owner: Iri, nested_resource: NestedResource[Any], value: object) -> None:
        writer = SubjectWriter(owner)
        nested_resource.write(writer, value)
        self.graph.setdefault(owner, []).append(
            PropertyAssertion(nested_resource.property, BlankNode(sorted_facts(writer.all_facts())))
        )

    # -- reading -------------------------------------------------------------------------------------------------------

    def first_value(self, subject: Iri, codec: PropertyCodec[T]) -> T | None:
        """Returns the first valid value of a property, or None."""
        values = (codec.decode(value) for value in self.values(subject, codec.property))
        return next((value for value in values if value is not None), None)

    def values(self, subject: Iri, *properties: Iri) -> list[FactValue]:
        """Returns the values of some properties of a resource, in the order of the statements."""
        return [fact.value for fact in self.graph.get(subject, ()) if fact.property in properties]

    def references(self, subject: Iri, *properties: Iri) -> list[Iri]:
        """Returns the IRIs among the values of some properties of a resource."""
        return [value.iri for value in self.values(subject, *properties) if isinstance(value, IriRef)]

    def _can_attach(self, parent: Iri, child: Iri) -> bool:
        """Whether both have a pose, and no joint lets the child move."""
        have_poses = parent in self.poses and child in self.poses
        return have_poses and frozenset((parent, child)) not in self.joined_pairs and child not in self.movable

    def class_names(self, *subjects: Iri) -> list[str]:
        """Returns the local names of the classes of some individuals, then of the superclasses of these."""
        types = [cls for subject in subjects for cls in types_of(self.graph.get(subject, ()))]
        above = [upper for cls in types for upper in self.source_map.hierarchy.ancestors(cls)]
        return [local_name(cls) for cls in (*types, *above)]

    def box(self, body: Iri) -> ObservedBox:
        """Returns the pose of a body, and its size if that is known."""
        return ObservedBox(self.poses[body], self.sizes.get(body))

    def ordered_limits(self, joint: Iri, property: Iri, lower: float, upper: float) -> tuple[float, float]:
        """Returns the limits of a joint in their order; that they are swapped is reported."""
        if lower > upper:
            problem = f"its lower limit {lower:g} is above its upper limit {upper:g}"
            self.warn(joint, property, problem, "the two are swapped")
        return min(lower, upper), max(lower, upper)

    def class_name_contains(self, subject: Iri, text: str) -> bool:
        """Whether the local name of one of its classes contains a text."""
        return any(text in local_name(cls) for cls in types_of(self.graph.get(subject, ())))

    def warn(self, individual: Iri, property: str, problem: str, action: str) -> None:
        """Reports a warning."""
        self.source_map.report(Severity.WARNING, individual, property, problem, action)

    # -- result --------------------------------------------------------------------------------------------------------

    def make_jointed_dynamic(self) -> None:
        """Makes children of movable joints dynamic where the map gives no mobility, and records the assumption."""
        unset = [child for child in self.movable if self.first_value(child, codecs.MOBILITY) is None]
        for child in unset:
            self.prepend_value(child, codecs.ASSUMED_MOBILITY, Mobility.DYNAMIC)
        if unset:
            evidence = (
                f"joints let {len(unset)} bodies move, and their mobility is not given: {abbreviated_names(unset)}"
            )
            self.source_map.record_assumption("mobility", "bodies with a joint are dynamic", evidence)

    def record_inferred(self, inferred: Mapping[str, Sequence[Iri]], evidence: Sequence[str], *, of: str = "") -> None:
        """Records as assumptions what joints do not give.

        Args:
            inferred: the joints, or what they move, by what they do not give.
            evidence: from what it was inferred, for each joint.
            of: what precedes the names, if they are not those of joints.
        """
        for attribute, names in inferred.items():
            listed = f"{len(names)} joints do not give it, such as {of}{abbreviated_names(names)}"
            text = "; ".join([listed, *([abbreviated_texts(evidence)] if evidence else [])])
            self.source_map.record_assumption(f"joints: {attribute}", "inferred from poses and sizes", text)

    def world(self) -> World:
        """Returns the world that `read_semlog` builds from the normalized map."""
        return read_semlog(self.normalized())

    def normalized(self) -> SourceMap:
        """Returns the map with all added statements."""
        for member in self.members:
            if member.startswith("_:"):
                self.warn(member, "", "it has no IRI", f"its name is {local_name(member)!r} in this world")
        return replace(self.source_map, graph=self.graph, members=list(self.members), report=self._report_unsuppressed)

    def _report_unsuppressed(
        self, severity: Severity, individual: str, property: str, problem: str, action: str
    ) -> None:
        """Forwards the findings of `read_semlog`, except for those about values that were replaced here."""
        if (individual, property) not in self._suppressed:
            self.source_map.report(severity, individual, property, problem, action)


def _is_finite(pose: Pose) -> bool:
    return all(map(isfinite, (*pose.position, *pose.quaternion)))


def abbreviated_names(individuals: Iterable[Iri]) -> str:
    """Returns up to three local names and the number of the others."""
    names = [local_name(individual) for individual in individuals]
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more


def abbreviated_texts(texts: Sequence[str]) -> str:
    """Joins up to twenty texts, with the number of the others."""
    more = [f"and {len(texts) - 20} more"] if len(texts) > 20 else []
    return "; ".join([*texts[:20], *more])
