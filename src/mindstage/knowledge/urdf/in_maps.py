"""Robot sources: descriptions as maps, and maps that leave places and joints to a description.

Both become text in the words of dialect 1, which is all that anything later reads.

Class names: what a link is, from the words that its name is made of.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import pyoxigraph as ox

from mindstage.knowledge.dialects.conventions import Assumption
from mindstage.knowledge.io.files import SourceFile
from mindstage.knowledge.io.ros_packages import RosPackagePath
from mindstage.knowledge.io.write import MapFormat, write_map
from mindstage.knowledge.rdf import Finding, Graph, QuadSource, Severity, local_name
from mindstage.knowledge.rdf_mapping.properties import literal_text
from mindstage.knowledge.urdf.model import UrdfRobot
from mindstage.knowledge.urdf.parse import read_urdf
from mindstage.knowledge.urdf.to_world import UrdfWorld, urdf_to_world
from mindstage.knowledge.vocabulary import (
    BASE_LINK_NAME,
    DESCRIBED_IN_MAP,
    END_LINK_NAME,
    HAS_LOCALIZATION,
    HAS_POSE,
    KNOWROB,
    OWL,
    OWL_CLASS,
    RDFS,
    THING,
    TYPE,
)
from mindstage.scene import Iri, IriRef

__all__ = ["ClassNameIndex", "UrdfSources", "linked_individuals"]


_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_IGNORED_WORDS = frozenset(
    (
        *("link", "main", "base", "frame", "body", "joint", "footprint", "root", "area", "block"),
        *("left", "right", "upper", "lower", "top", "bottom", "middle", "front", "back", "inner", "outer"),
        *("center", "centre", "vertical", "horizontal", "small", "big", "large"),
    )
)
"""Words at the end of a link's name that say where it is, or nothing, but not what it is."""


class ClassNameIndex:
    """The classes that a store knows, by the words of their names."""

    def __init__(self, store: QuadSource) -> None:
        """Reads nothing yet."""
        self._store = store

    def class_of_link(self, link: str) -> Iri | None:
        """The class that the end of a link's name spells: a Handle for `oven_door_handle_link`, and so on.

        The longest end counts, so `fridge_door` is a FridgeDoor where there is such a class, and else a Door.
        """
        words = [word.lower() for word in _WORD.findall(link)]
        while words and words[-1] in _IGNORED_WORDS:
            words.pop()
        ends = ("".join(words[start:]) for start in range(len(words)))
        return next((self._classes_by_name[end] for end in ends if end in self._classes_by_name), None)

    @cached_property
    def _classes_by_name(self) -> dict[str, Iri]:
        """By name in small letters; of several classes of one name, the community's own."""
        quads = self._store.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(OWL_CLASS))
        classes = {Iri(quad.subject.value) for quad in quads if isinstance(quad.subject, ox.NamedNode)}
        told = sorted(cls for cls in classes if not cls.startswith((OWL, RDFS)))
        told.sort(key=lambda cls: cls.startswith(KNOWROB))  # whoever comes last stays
        return {local_name(cls).lower(): cls for cls in told}


@dataclass(slots=True)
class UrdfSources:
    """The descriptions that maps may name links of."""

    packages: RosPackagePath
    class_names: ClassNameIndex
    urdf_robots: dict[Path, UrdfRobot] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    assumptions: list[Assumption] = field(default_factory=list)

    def add(self, path: Path) -> None:
        """Reads a description that maps may lean on.

        Raises:
            SourceParseError: it is none, or cannot be read.
        """
        self.urdf_robots[path] = read_urdf(path, self.packages)

    def urdf_as_map(self, path: Path) -> SourceFile:
        """A description as a map of its own.

        Raises:
            SourceParseError: it is none, or cannot be read.
        """
        standing = urdf_to_world(read_urdf(path, self.packages), class_of=self.class_names.class_of_link)
        self._report_issues(path, standing)
        if standing.class_of_link:
            told = [f"{link} is a {local_name(cls)}" for link, cls in standing.class_of_link.items()]
            value = "links are what the ends of their names say"
            self._record_assumption(standing, "classes", value, f"{len(told)} links: {', '.join(told[:3])}")
        return SourceFile(path, write_map(standing.world, format=MapFormat.TURTLE).encode(), ox.RdfFormat.TURTLE)

    def add_linked_robots(self, file: SourceFile, graph: Graph) -> SourceFile:
        """A map with the places and joints of the links that it names.

        Args:
            file: the map, as text that Turtle can go on from, if it names links of any description here.
            graph: what it says.
        """
        links = dict(linked_individuals(graph))
        if not links:
            return file
        found: set[Iri] = set()
        data = file.data
        for path, robot in self.urdf_robots.items():
            names = {link.name for link in robot.links}
            known = {link: (individual, THING) for individual, link in links.items() if link in names}
            if not known:
                what, did = "no map names one of its links", "it is not used"
                self.findings.append(Finding(Severity.WARNING, str(path), BASE_LINK_NAME, what, did))
                continue
            found.update(individual for individual, _ in known.values())
            standing = urdf_to_world(
                robot, map=_map_of(graph, found), known_links=known, class_of=self.class_names.class_of_link
            )
            self._report_issues(path, standing)
            data += b"\n" + write_map(standing.world, format=MapFormat.TURTLE).encode()
        for individual, link in links.items():
            if individual not in found:
                what = f"its place stands in a robot's description, as the link {link!r}"
                did = "none of those given has that link; give the one that has with --urdf FILE"
                self.findings.append(Finding(Severity.WARNING, individual, BASE_LINK_NAME, what, did))
        return file if data is file.data else replace(file, data=data, format=ox.RdfFormat.TURTLE)

    def _report_issues(self, path: Path, urdf_world: UrdfWorld) -> None:
        for oddity in urdf_world.issues:
            severity = Severity.ERROR if oddity.is_missing else Severity.WARNING
            name = urdf_world.iris_by_name.get(oddity.subject)
            what = oddity.problem if name or not oddity.subject else f"{oddity.subject}: {oddity.problem}"
            self.findings.append(Finding(severity, name or str(path), "", what, oddity.action))
        world = urdf_world.world
        evidence = f"{len(world.joints)} joints let something move; a description does not say what holds its root"
        value = "what a joint lets move is dynamic, the root and all fixed to it static"
        self._record_assumption(urdf_world, "mobility", value, evidence)

    def _record_assumption(self, urdf_world: UrdfWorld, topic: str, value: str, evidence: str) -> None:
        self.assumptions.append(Assumption(urdf_world.world.iri, topic, value, evidence))


def linked_individuals(graph: Graph) -> Iterable[tuple[Iri, str]]:
    """Each individual that names a link and has no place of its own, and the link.

    It is that which its description begins with, or else ends with.
    """
    for individual, facts in graph.items():
        told: Mapping[Iri, Sequence[str]] = {
            property: [text for fact in facts if fact.property == property and (text := literal_text(fact.value))]
            for property in (BASE_LINK_NAME, END_LINK_NAME)
        }
        names = [*told[BASE_LINK_NAME], *told[END_LINK_NAME]]
        is_placed = any(fact.property in (HAS_POSE, HAS_LOCALIZATION) for fact in facts)
        if names and not is_placed and not individual.startswith("_:"):
            yield individual, names[0]


def _map_of(graph: Graph, individuals: Iterable[Iri]) -> Iri | None:
    """The map that individuals are described in."""
    for individual in sorted(individuals):
        for fact in graph.get(individual, ()):
            if fact.property == DESCRIBED_IN_MAP and isinstance(fact.value, IriRef):
                return fact.value.iri
    return None
