"""Small maps of dialect 1 in Turtle, and helpers of tests that read them."""

from __future__ import annotations

from collections.abc import Callable

from mindstage.knowledge import KnowledgeBase
from mindstage.maps import UnitConventions
from mindstage.rdf import Finding
from mindstage.scene import Iri, World, diff

__all__ = [
    "KNOWROB",
    "OWL",
    "RDFS",
    "ROOM_NAMESPACE",
    "XSD",
    "MakeKnowledgeBase",
    "ReadMap",
    "assert_worlds_equal",
    "body_turtle",
    "individual",
    "knowledge_base_from",
    "knowrob_iri",
    "room_map",
    "slide_joint",
]

ROOM_NAMESPACE = "http://example.org/room.owl#"
KNOWROB = "http://knowrob.org/kb/knowrob.owl#"
OWL = "http://www.w3.org/2002/07/owl#"
RDFS = "http://www.w3.org/2000/01/rdf-schema#"
XSD = "http://www.w3.org/2001/XMLSchema#"

ReadMap = Callable[..., tuple[World, tuple[Finding, ...]]]
"""Reads the text of a map and returns its world and the findings."""

MakeKnowledgeBase = Callable[..., KnowledgeBase]
"""Creates a knowledge base with some statements, and nothing else."""

_PREFIXES = f"""
@prefix : <{ROOM_NAMESPACE}> .
@prefix k: <{KNOWROB}> .
@prefix owl: <{OWL}> .
@prefix rdfs: <{RDFS}> .
@prefix xsd: <{XSD}> .
@prefix ms: <http://mindstage.org/ontology#> .
@prefix e: <http://example.org/terms#> .
"""


def individual(name: str) -> Iri:
    """Returns the IRI of an individual of the room."""
    return Iri(ROOM_NAMESPACE + name)


def knowrob_iri(name: str) -> Iri:
    """Returns an IRI in KnowRob's namespace."""
    return Iri(KNOWROB + name)


def room_map(*statements: str, map: str = "room") -> str:
    """Returns a map with these statements, which may use the prefixes k, owl, rdfs, xsd, ms, e and `:`."""
    return "\n".join((_PREFIXES, f":{map} a owl:NamedIndividual, k:SemanticEnvironmentMap .", *statements))


def body_turtle(
    name: str, *facts: str, cls: str = "k:Cup", position: str = "1.0 2.0 3.0", quaternion: str = "1.0 0.0 0.0 0.0"
) -> str:
    """Returns an individual with a pose."""
    more = "".join(f" ; {fact}" for fact in facts)
    return f""":{name} a owl:NamedIndividual, {cls} ; k:describedInMap :room ; k:pose :{name}-pose{more} .
:{name}-pose a owl:NamedIndividual, k:Pose ; k:translation "{position}" ; k:quaternion "{quaternion}" ."""


def slide_joint(name: str, parent: str, child: str, *facts: str) -> str:
    """Returns a prismatic joint, as of a drawer."""
    return f"""{body_turtle(name, f"k:parent :{parent}", f"k:child :{child}", *facts, cls="k:Constraint")}
:{name} k:linearConstraint :{name}-linear ; k:angularConstraint :{name}-angular .
:{name}-linear a owl:NamedIndividual, k:LinearConstraint ; k:xMotion 1 ; k:yMotion 2 ; k:zMotion 2 ;
    k:limit "0.45"^^xsd:float ; k:softConstraint false ; k:stiffness "0.0"^^xsd:float ; k:damping "0.0"^^xsd:float .
:{name}-angular a owl:NamedIndividual, k:AngularConstraint ;
    k:swing1Motion 2 ; k:swing2Motion 2 ; k:twistMotion 0 ;
    k:swing1Limit "0.1"^^xsd:float ; k:swing2Limit "0.2"^^xsd:float ; k:twistLimit "0.3"^^xsd:float ;
    k:softSwingConstraint true ; k:swingStiffness "4.0"^^xsd:float ; k:swingDamping "5.0"^^xsd:float ;
    k:softTwistConstraint false ; k:twistStiffness "0.0"^^xsd:float ; k:twistDamping "0.0"^^xsd:float ."""


def assert_worlds_equal(a: World, b: World) -> None:
    """Asserts that two worlds are equal."""
    found = diff(a, b)
    assert (found.only_in_a, found.only_in_b, found.changed, found.lost, found.gained) == ((), (), (), (), ())
    assert (a.iri, a.name, len(a.resources)) == (b.iri, b.name, len(b.resources))


def knowledge_base_from(
    *paths: object,
    ontologies: tuple[object, ...] = (),
    bundled_ontology: bool = False,
    conventions: UnitConventions = UnitConventions(),  # noqa: B008 - it is frozen
) -> KnowledgeBase:
    """Returns a knowledge base that has loaded these files."""
    knowledge = KnowledgeBase(bundled_ontology=bundled_ontology)
    ontology_paths = [str(path) for path in ontologies]
    knowledge.load([str(path) for path in paths], ontologies=ontology_paths, conventions=conventions)
    return knowledge
