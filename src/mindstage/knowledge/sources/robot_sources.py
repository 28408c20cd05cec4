"""Robot sources: descriptions as maps, and maps that leave places and joints to a description.

Both become text in the words of dialect 1, which is all that anything later reads.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import pyoxigraph as ox

from mindstage.knowledge.findings import Finding, Severity
from mindstage.knowledge.graph import Graph
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reading.assumptions import Assumption
from mindstage.knowledge.reading.other_words import BASE_LINK_NAME, END_LINK_NAME, HAS_LOCALIZATION
from mindstage.knowledge.robots import ClassNames, Robot, RobotWorld, read_robot, robot_world
from mindstage.knowledge.sources.files import SourceFile
from mindstage.knowledge.sources.packages import Packages
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, HAS_POSE, THING
from mindstage.knowledge.wording.words import text_in
from mindstage.knowledge.writers.mapwriter import MapFormat, write_map
from mindstage.world import Iri, Reference

__all__ = ["RobotSources", "linked"]


@dataclass(slots=True)
class RobotSources:
    """The descriptions that maps may name links of."""

    packages: Packages
    classes: ClassNames
    robots: dict[Path, Robot] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    assumptions: list[Assumption] = field(default_factory=list)

    def add(self, path: Path) -> None:
        """Reads a description that maps may lean on.

        Raises:
            SourceUnreadable: it is none, or cannot be read.
        """
        self.robots[path] = read_robot(path, self.packages)

    def as_map(self, path: Path) -> SourceFile:
        """A description as a map of its own.

        Raises:
            SourceUnreadable: it is none, or cannot be read.
        """
        standing = robot_world(read_robot(path, self.packages), class_of=self.classes.of)
        self._tell(path, standing)
        if standing.classes:
            told = [f"{link} is a {local_name(cls)}" for link, cls in standing.classes.items()]
            value = "links are what the ends of their names say"
            self._assume(standing, "classes", value, f"{len(told)} links: {', '.join(told[:3])}")
        return SourceFile(path, write_map(standing.world, format=MapFormat.TURTLE).encode(), ox.RdfFormat.TURTLE)

    def lent_to(self, file: SourceFile, graph: Graph) -> SourceFile:
        """A map with the places and joints of the links that it names.

        Args:
            file: the map, as text that Turtle can go on from, if it names links of any description here.
            graph: what it says.
        """
        links = dict(linked(graph))
        if not links:
            return file
        found: set[Iri] = set()
        data = file.data
        for path, robot in self.robots.items():
            names = {link.name for link in robot.links}
            known = {link: (individual, THING) for individual, link in links.items() if link in names}
            if not known:
                what, did = "no map names one of its links", "it is not used"
                self.findings.append(Finding(Severity.WARNING, str(path), BASE_LINK_NAME, what, did))
                continue
            found.update(individual for individual, _ in known.values())
            standing = robot_world(robot, map=_home(graph, found), known=known, class_of=self.classes.of)
            self._tell(path, standing)
            data += b"\n" + write_map(standing.world, format=MapFormat.TURTLE).encode()
        for individual, link in links.items():
            if individual not in found:
                what = f"its place stands in a robot's description, as the link {link!r}"
                did = "none of those given has that link; give the one that has with --urdf FILE"
                self.findings.append(Finding(Severity.WARNING, individual, BASE_LINK_NAME, what, did))
        return file if data is file.data else replace(file, data=data, format=ox.RdfFormat.TURTLE)

    def _tell(self, path: Path, standing: RobotWorld) -> None:
        for oddity in standing.oddities:
            severity = Severity.ERROR if oddity.missing else Severity.WARNING
            name = standing.names.get(oddity.about)
            what = oddity.what if name or not oddity.about else f"{oddity.about}: {oddity.what}"
            self.findings.append(Finding(severity, name or str(path), "", what, oddity.did))
        world = standing.world
        evidence = f"{len(world.constraints)} joints let something move; a description does not say what holds its root"
        value = "what a joint lets move is dynamic, the root and all fixed to it static"
        self._assume(standing, "mobility", value, evidence)

    def _assume(self, standing: RobotWorld, about: str, value: str, evidence: str) -> None:
        self.assumptions.append(Assumption(standing.world.iri, about, value, evidence))


def linked(graph: Graph) -> Iterable[tuple[Iri, str]]:
    """Each individual that names a link and has no place of its own, and the link.

    It is that which its description begins with, or else ends with.
    """
    for individual, facts in graph.items():
        told: Mapping[Iri, Sequence[str]] = {
            property: [text for fact in facts if fact.property == property and (text := text_in(fact.value))]
            for property in (BASE_LINK_NAME, END_LINK_NAME)
        }
        names = [*told[BASE_LINK_NAME], *told[END_LINK_NAME]]
        is_placed = any(fact.property in (HAS_POSE, HAS_LOCALIZATION) for fact in facts)
        if names and not is_placed and not individual.startswith("_:"):
            yield individual, names[0]


def _home(graph: Graph, individuals: Iterable[Iri]) -> Iri | None:
    """The map that individuals are described in."""
    for individual in sorted(individuals):
        for fact in graph.get(individual, ()):
            if fact.property == DESCRIBED_IN_MAP and isinstance(fact.value, Reference):
                return fact.value.iri
    return None
