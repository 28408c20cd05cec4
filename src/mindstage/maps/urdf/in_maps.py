"""Robot descriptions as maps, and maps that take the poses and joints of links from a robot description.

Both become Turtle in the vocabulary of dialect 1, which later steps read as they read any other map. The class of a
link is inferred from the words of its name.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import pyoxigraph as ox

from mindstage.maps.dialects.conventions import Assumption
from mindstage.maps.io.files import SourceFile
from mindstage.maps.io.ros_packages import RosPackagePath
from mindstage.maps.rdf_mapping.properties import literal_text
from mindstage.rdf.graphs import Finding, Graph, QuadSource, Severity, local_name
from mindstage.rdf.vocabulary import (
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

if TYPE_CHECKING:  # few maps refer to robot descriptions, and parsing them needs NumPy
    from mindstage.maps.urdf.to_world import UrdfWorld
    from mindstage.maps.urdf.urdf_model import UrdfRobot

__all__ = ["ClassNameIndex", "UrdfSources", "is_urdf", "linked_individuals"]

_HEAD_BYTES = 64 * 1024
_PROLOG = rb"(?>\s+|<\?.*?\?>|<!--.*?-->|<!DOCTYPE[^>\[]*(?:\[[^\]]*\]\s*)?>)*+"
"""What may precede the root element; possessive quantifiers keep matching linear in the number of comments."""
_ROBOT = re.compile(rb"\A(?:\xef\xbb\xbf)?" + _PROLOG + rb"<robot[\s/>]", re.DOTALL)

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_IGNORED_WORDS = frozenset(
    (
        *("link", "main", "base", "frame", "body", "joint", "footprint", "root", "area", "block"),
        *("left", "right", "upper", "lower", "top", "bottom", "middle", "front", "back", "inner", "outer"),
        *("center", "centre", "vertical", "horizontal", "small", "big", "large"),
    )
)
"""Words at the end of a link's name that do not describe its class."""


def is_urdf(path: Path) -> bool:
    """Whether the root element of a file is `<robot>`; the file may still be invalid."""
    try:
        with path.open("rb") as file:
            return _ROBOT.match(file.read(_HEAD_BYTES)) is not None
    except OSError:
        return False  # reading the file reports the cause


class ClassNameIndex:
    """The classes of a store, by name."""

    def __init__(self, store: QuadSource) -> None:
        """Creates the index; the store is read on first use."""
        self._store = store

    def class_of_link(self, link: str) -> Iri | None:
        """Returns the class named by the end of a link's name, such as Handle for `oven_door_handle_link`.

        The longest match counts: `fridge_door` is a FridgeDoor if that class exists, and otherwise a Door.
        """
        words = [word.lower() for word in _WORD.findall(link)]
        while words and words[-1] in _IGNORED_WORDS:
            words.pop()
        endings = ("".join(words[start:]) for start in range(len(words)))
        return next((self._classes_by_name[each] for each in endings if each in self._classes_by_name), None)

    @cached_property
    def _classes_by_name(self) -> dict[str, Iri]:
        """Classes by lower-case local name; of several, the KnowRob class."""
        quads = self._store.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(OWL_CLASS))
        classes = {Iri(quad.subject.value) for quad in quads if isinstance(quad.subject, ox.NamedNode)}
        named = sorted(cls for cls in classes if not cls.startswith((OWL, RDFS)))
        named.sort(key=lambda cls: cls.startswith(KNOWROB))  # the last one of a name is kept
        return {local_name(cls).lower(): cls for cls in named}


_MAX_LINKS = 5
"""Limit of the links that the finding about a missing robot description names."""


@dataclass(slots=True)
class UrdfSources:
    """The robot descriptions whose links maps may refer to."""

    packages: RosPackagePath
    class_names: ClassNameIndex
    xacro_paths: Mapping[Path, Mapping[str, str]] = field(default_factory=dict)
    """The files that are expanded if they contain xacro, with the values of their arguments: those that the user has
    named and asked for."""
    packages_only: bool = False
    """Whether meshes are read from packages only, not from other files: for a text that comes from a port."""
    urdf_robots: dict[Path, UrdfRobot] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    assumptions: list[Assumption] = field(default_factory=list)

    def add(self, path: Path) -> None:
        """Reads a robot description whose links maps may refer to.

        Raises:
            SourceParseError: it cannot be read or is not a robot description.
        """
        self.urdf_robots[path] = self._read(path)

    def urdf_as_map(self, path: Path) -> SourceFile:
        """Converts a robot description to a map.

        Raises:
            SourceParseError: it cannot be read or is not a robot description.
        """
        from mindstage.maps.io.formats import MapFormat
        from mindstage.maps.io.write import write_map
        from mindstage.maps.urdf.to_world import urdf_to_world

        urdf_world = urdf_to_world(self._read(path), class_of=self.class_names.class_of_link)
        self._report_issues(path, urdf_world)
        if urdf_world.class_of_link:
            classes = [f"{link} is a {local_name(cls)}" for link, cls in urdf_world.class_of_link.items()]
            value = "links have the classes that their names end with"
            self._record_assumption(urdf_world, "classes", value, f"{len(classes)} links: {', '.join(classes[:3])}")
        return SourceFile(path, write_map(urdf_world.world, format=MapFormat.TURTLE).encode(), ox.RdfFormat.TURTLE)

    def add_linked_robots(self, file: SourceFile, graph: Graph) -> SourceFile:
        """Adds the poses and joints of the links that a map refers to.

        Args:
            file: the map; if it refers to a link, its text must be a prefix of valid Turtle.
            graph: the statements of the map.
        """
        links = dict(linked_individuals(graph))
        if not links:
            return file
        if not self.urdf_robots:
            self.findings.append(_missing_robot(file, links))
            return file
        from mindstage.maps.io.formats import MapFormat
        from mindstage.maps.io.write import write_map
        from mindstage.maps.urdf.to_world import urdf_to_world

        found: set[Iri] = set()
        data = file.data
        for path, robot in self.urdf_robots.items():
            names = {link.name for link in robot.links}
            known = {link: (individual, THING) for individual, link in links.items() if link in names}
            if not known:
                problem, action = "no map refers to one of its links", "it is not used"
                self.findings.append(Finding(Severity.WARNING, str(path), BASE_LINK_NAME, problem, action))
                continue
            found.update(individual for individual, _ in known.values())
            urdf_world = urdf_to_world(
                robot, map=_map_of(graph, found), known_links=known, class_of=self.class_names.class_of_link
            )
            self._report_issues(path, urdf_world)
            data += b"\n" + write_map(urdf_world.world, format=MapFormat.TURTLE).encode()
        for individual, link in links.items():
            if individual not in found:
                problem = f"its pose is that of the link {link!r} of a robot description"
                action = "none of those given has that link; give the one that has with --urdf FILE"
                self.findings.append(Finding(Severity.WARNING, individual, BASE_LINK_NAME, problem, action))
        return file if data is file.data else replace(file, data=data, format=ox.RdfFormat.TURTLE)

    def _read(self, path: Path) -> UrdfRobot:
        from mindstage.maps.urdf.parse import read_urdf

        return read_urdf(path, self.packages, xacro=self.xacro_paths.get(path), packages_only=self.packages_only)

    def _report_issues(self, path: Path, urdf_world: UrdfWorld) -> None:
        for issue in urdf_world.issues:
            severity = Severity.ERROR if issue.is_missing else Severity.WARNING
            iri = urdf_world.iris_by_name.get(issue.subject)
            problem = issue.problem if iri or not issue.subject else f"{issue.subject}: {issue.problem}"
            self.findings.append(Finding(severity, iri or str(path), "", problem, issue.action))
        world = urdf_world.world
        evidence = f"{len(world.joints)} joints are movable; the description does not define the mounting of its root"
        value = "links with a movable joint are dynamic, the root and all links fixed to it static"
        self._record_assumption(urdf_world, "mobility", value, evidence)

    def _record_assumption(self, urdf_world: UrdfWorld, topic: str, value: str, evidence: str) -> None:
        self.assumptions.append(Assumption(urdf_world.world.iri, topic, value, evidence))


def linked_individuals(graph: Graph) -> Iterable[tuple[Iri, str]]:
    """Yields each individual without a pose that refers to a link, and the link's name.

    The base link takes precedence over the end link.
    """
    for individual, facts in graph.items():
        names = [
            text
            for property in (BASE_LINK_NAME, END_LINK_NAME)
            for fact in facts
            if fact.property == property and (text := literal_text(fact.value))
        ]
        has_pose = any(fact.property in (HAS_POSE, HAS_LOCALIZATION) for fact in facts)
        if names and not has_pose and not individual.startswith("_:"):
            yield individual, names[0]


def _missing_robot(file: SourceFile, links: Mapping[Iri, str]) -> Finding:
    """The finding about a map whose individuals are links of a robot description, where none is given."""
    names = [*dict.fromkeys(map(repr, links.values()))]
    shown = ", ".join(names[:_MAX_LINKS]) + (" …" if len(names) > _MAX_LINKS else "")
    count = f"{len(links):,} individuals take their poses" if len(links) > 1 else "an individual takes its pose"
    problem = f"{count} from links of a robot description ({shown})"
    action = (
        "none is given, so they are not in the world: give the URDF or xacro file with --urdf FILE (in Python robots)"
    )
    return Finding(Severity.ERROR, str(file.path), BASE_LINK_NAME, problem, action)


def _map_of(graph: Graph, individuals: Iterable[Iri]) -> Iri | None:
    """Returns the map that one of the individuals belongs to."""
    for individual in sorted(individuals):
        for fact in graph.get(individual, ()):
            if fact.property == DESCRIBED_IN_MAP and isinstance(fact.value, IriRef):
                return fact.value.iri
    return None
