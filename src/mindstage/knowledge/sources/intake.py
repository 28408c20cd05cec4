"""Intake: what a file says beyond its letters is written at its end, before anything else reads it.

The dialects of KnowRob 1 and 2 leave it to be understood who lives in which map (see `residence`), and some maps leave
places and joints to a robot's description. It is added to the text once, here, so that the store, the exact text and
whatever is made of them say the same. A description that is given as a map is turned into one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

import pyoxigraph as ox

from mindstage.knowledge.graph import Graph, graph_from_quads
from mindstage.knowledge.names import local_name, namespace_of
from mindstage.knowledge.reading.other_words import POSE_PROPERTIES
from mindstage.knowledge.reading.residence import inferred_membership, with_inferred_membership
from mindstage.knowledge.robots import is_urdf
from mindstage.knowledge.sources.files import SourceFile, read_file
from mindstage.knowledge.sources.robot_sources import UrdfSources, linked_individuals
from mindstage.knowledge.vocabulary import RDF
from mindstage.world import Iri, IriRef

__all__ = ["preprocess", "read_map_file"]

_END_TAG = re.compile(rb"</([\w.-]+:)?RDF\s*>")
_POSE_MARKERS = tuple(local_name(place).encode() for place in POSE_PROPERTIES)


def read_map_file(path: Path, urdf_sources: UrdfSources) -> SourceFile:
    """Reads a map's file, or a robot's description as a map.

    Raises:
        SourceParseError: it is missing, of no known format, cut off, or dangerous.
    """
    return urdf_sources.urdf_as_map(path) if is_urdf(path) else preprocess(read_file(path), urdf_sources)


def preprocess(file: SourceFile, urdf_sources: UrdfSources) -> SourceFile:
    """The same file, and with it what follows about who lives where, and what robots' descriptions lend it.

    A file that does not parse comes back as it is: whoever loads it says why.
    """
    if not any(sign in file.data for sign in _POSE_MARKERS):
        return file
    try:
        quads = list(ox.parse(file.data, file.format, base_iri=file.iri))
        graph = graph_from_quads(quads, set())
    except (SyntaxError, ValueError, MemoryError):
        return file
    more: Graph = inferred_membership(graph)
    leans = any(True for _ in linked_individuals(graph))
    if not more and not leans:
        return file
    if leans or any(subject.startswith("_:") for subject in more):
        file, more = _as_n_triples(file, quads, more)
    file = _append_statements(file, more)
    return urdf_sources.add_linked_robots(file, with_inferred_membership(graph)) if leans else file


def _append_statements(file: SourceFile, added: Graph) -> SourceFile:
    """The file with further statements at its end."""
    if file.format != ox.RdfFormat.RDF_XML:
        return replace(file, data=file.data + b"\n" + "".join(_to_n_triples(added)).encode())
    end = max((tag.start() for tag in _END_TAG.finditer(file.data)), default=len(file.data))
    return replace(file, data=file.data[:end] + "".join(_to_rdf_xml(added)).encode() + file.data[end:])


def _as_n_triples(file: SourceFile, quads: Sequence[ox.Quad], added: Graph) -> tuple[SourceFile, Graph]:
    """The file as triples, in which things without a name have labels that do not change from time to time.

    RDF/XML and Turtle may give such a thing not even a label, so there nothing more can be said of it.
    """
    free = (label for number in count(1) if (label := f"_:unnamed{number}").encode() not in file.data)
    labels: Mapping[Iri, Iri] = {subject: Iri(next(free)) for subject in added if subject.startswith("_:")}
    data = ox.serialize((quad.triple for quad in quads), format=ox.RdfFormat.N_TRIPLES) or b""
    for subject, label in labels.items():
        data = data.replace(f"{subject} ".encode(), f"{label} ".encode())
    told = {labels.get(subject, subject): facts for subject, facts in added.items()}
    return replace(file, data=data, format=ox.RdfFormat.N_TRIPLES), told


def _to_n_triples(added: Graph) -> list[str]:
    return [
        f"{subject if subject.startswith('_:') else f'<{subject}>'} <{fact.property}> <{fact.value.iri}> .\n"
        for subject, facts in added.items()
        for fact in facts
        if isinstance(fact.value, IriRef)
    ]


def _to_rdf_xml(added: Graph) -> list[str]:
    from xml.sax.saxutils import quoteattr  # it loads urllib and with it ssl and email

    return [
        f"<rdf:Description xmlns:rdf={quoteattr(RDF)} rdf:about={quoteattr(subject)}>"
        f"<p:{local_name(fact.property)} xmlns:p={quoteattr(namespace_of(fact.property))}"
        f" rdf:resource={quoteattr(fact.value.iri)}/></rdf:Description>\n"
        for subject, facts in added.items()
        for fact in facts
        if isinstance(fact.value, IriRef)
    ]
