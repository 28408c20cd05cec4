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

from mindstage.knowledge.findings import Severity
from mindstage.knowledge.names import local_name, part_name
from mindstage.knowledge.readers.joint_frames import Joint
from mindstage.knowledge.readers.semlog import read_semlog
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.vocabulary import CHILD, CONSTRAINT, DESCRIBED_IN_MAP, HAS_LINEAR, HAS_POSE, PARENT, TYPE
from mindstage.knowledge.wording import words
from mindstage.knowledge.wording.materials import say_materials
from mindstage.knowledge.wording.nesting import sorted_facts
from mindstage.knowledge.wording.parts import ANGULAR_PART, LINEAR_PART, POSE_PART, Part
from mindstage.knowledge.wording.statements import Said
from mindstage.knowledge.wording.words import Word
from mindstage.world import Anonymous, Fact, FactValue, Iri, Material, Mobility, Pose, Reference, ShapeKind, World

__all__ = ["Rewording", "few"]

T = TypeVar("T")


class Rewording:
    """One map on its way into the words of dialect 1."""

    def __init__(self, excerpt: Excerpt) -> None:
        self.excerpt = excerpt
        self.graph: dict[Iri, list[Fact]] = {subject: list(facts) for subject, facts in excerpt.graph.items()}
        self.members: dict[Iri, None] = dict.fromkeys(excerpt.members)
        self.poses: dict[Iri, Pose] = {}
        self.sizes: dict[Iri, tuple[float, float, float]] = {}
        self.joined: set[frozenset[Iri]] = set(self._joined_already())
        """Pairs that a joint joins, be it in the words of dialect 1."""
        self.moving: dict[Iri, None] = {}
        """What hangs on a joint that lets it move."""
        self._quiet: set[tuple[str, str]] = set()
        self._said: dict[Iri, set[Fact]] = {}

    # -- saying --------------------------------------------------------------------------------------------------------

    def add(self, subject: Iri, property: Iri, value: FactValue) -> None:
        """Says one thing, unless it is said already."""
        facts = self.graph.setdefault(subject, [])
        said = self._said.setdefault(subject, set(facts))
        fact = Fact(property, value)
        if fact not in said:
            said.add(fact)
            facts.append(fact)

    def say(self, subject: Iri, word: Word[T], value: T) -> None:
        """Says a value in front of all that was told under the same word, so that it is the one that counts."""
        self.graph.setdefault(subject, []).insert(0, Fact(word.property, word.say(value)))

    def place(self, individual: Iri, pose: Pose) -> None:
        """Says where something is, if anywhere."""
        if not _is_finite(pose):
            self.warn(individual, HAS_POSE, "its pose has numbers too large to reckon with", "it tells no place")
            return
        self.poses[individual] = pose
        self._part(individual, POSE_PART, pose)

    def measure(self, individual: Iri, size: Sequence[float | None]) -> None:
        """Says how large something is, as far as that is known; what was told of it, and not so, is kept."""
        for word, extent in zip(words.SIZE, size, strict=True):
            if extent is not None and self.told(individual, word) != extent:
                self.say(individual, word, extent)
                self._quiet.add((individual, word.property))
        x, y, z = size
        if x is not None and y is not None and z is not None:
            self.sizes[individual] = (x, y, z)

    def shape(self, individual: Iri, kind: ShapeKind) -> None:
        """Says of what form something is."""
        self.say(individual, words.SHAPE, kind)

    def mesh(self, individual: Iri, path: str) -> None:
        """Says where the mesh is."""
        self.say(individual, words.MESH, path)

    def paint(self, individual: Iri, materials: Sequence[Material]) -> None:
        """Says how something looks."""
        said = Said(individual)
        say_materials(said, materials)
        for fact in said.everything():
            self.add(individual, fact.property, fact.value)

    def attach(self, parent: Iri, child: Iri) -> None:
        """Says that one thing goes where another one goes."""
        self.add(parent, CHILD, Reference(child))

    def join(self, owner: Iri, parent: Iri, child: Iri, joint: Joint, *, name: Iri | None = None) -> None:
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
        self.add(constraint, TYPE, Reference(CONSTRAINT))
        self.add(constraint, DESCRIBED_IN_MAP, Reference(self.excerpt.map))
        self.add(constraint, PARENT, Reference(parent))
        self.add(constraint, CHILD, Reference(child))
        self._part(constraint, POSE_PART, joint.pose)
        self._part(constraint, LINEAR_PART, joint.linear)
        self._part(constraint, ANGULAR_PART, joint.angular)
        self.joined.add(frozenset((parent, child)))
        if joint.moves:
            self.moving[child] = None

    def _joined_already(self) -> Iterator[frozenset[Iri]]:
        for member in self.members:
            if self.values(member, HAS_LINEAR):
                for parent in self.references(member, PARENT):
                    yield from (frozenset((parent, child)) for child in self.references(member, CHILD))

    def _part(self, whole: Iri, part: Part[Any], value: object) -> None:
        said = Said(whole)
        part.write(said, value)
        self.graph.setdefault(whole, []).append(Fact(part.property, Anonymous(sorted_facts(said.everything()))))

    # -- hearing -------------------------------------------------------------------------------------------------------

    def told(self, subject: Iri, word: Word[T]) -> T | None:
        """The first value of a word that can be understood."""
        values = (word.understand(value) for value in self.values(subject, word.property))
        return next((value for value in values if value is not None), None)

    def values(self, subject: Iri, *properties: Iri) -> list[FactValue]:
        """All that is said about a thing by some properties."""
        return [fact.value for fact in self.graph.get(subject, ()) if fact.property in properties]

    def references(self, subject: Iri, *properties: Iri) -> list[Iri]:
        """The things that a thing is said to have to do with."""
        return [value.iri for value in self.values(subject, *properties) if isinstance(value, Reference)]

    def may_go_together(self, parent: Iri, child: Iri) -> bool:
        """Whether both stand somewhere, and no joint lets the child move."""
        both_stand = parent in self.poses and child in self.poses
        return both_stand and frozenset((parent, child)) not in self.joined and child not in self.moving

    def is_called(self, subject: Iri, word: str) -> bool:
        """Whether the name of one of its classes holds a word."""
        return any(word in local_name(cls) for cls in types_of(self.graph.get(subject, ())))

    def warn(self, individual: Iri, property: str, what: str, did: str) -> None:
        """Reports something odd."""
        self.excerpt.report(Severity.WARNING, individual, property, what, did)

    # -- ending --------------------------------------------------------------------------------------------------------

    def let_move(self) -> None:
        """Says of what hangs on joints that the physics moves it, where nobody says otherwise, and says so aloud."""
        silent = [child for child in self.moving if self.told(child, words.MOBILITY) is None]
        for child in silent:
            self.say(child, words.MOBILITY, Mobility.DYNAMIC)
        if silent:
            evidence = (
                f"of {len(silent)} bodies a joint lets them move, and nothing says whether they do: {few(silent)}"
            )
            self.excerpt.assume("mobility", "what hangs on a joint is dynamic", evidence)

    def world(self) -> World:
        """The world that dialect 1's reader makes of it."""
        return read_semlog(self.reworded())

    def reworded(self) -> Excerpt:
        """The map with all that was said here, for whoever reads it next."""
        for member in self.members:
            if member.startswith("_:"):
                self.warn(member, "", "it has no name", f"it is called {local_name(member)!r} in this world")
        return replace(self.excerpt, graph=self.graph, members=list(self.members), report=self._report)

    def _report(self, severity: Severity, individual: str, property: str, what: str, did: str) -> None:
        """Passes on what dialect 1's reader finds, but for what was met here before."""
        if (individual, property) not in self._quiet:
            self.excerpt.report(severity, individual, property, what, did)


def _is_finite(pose: Pose) -> bool:
    return all(map(isfinite, (*pose.position, *pose.quaternion)))


def few(individuals: Iterable[Iri]) -> str:
    """The names of some things, and how many more there are."""
    names = [local_name(individual) for individual in individuals]
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more
