"""Small maps of dialects 4 and 5 in Turtle, and helpers of tests that read them."""

from __future__ import annotations

from pathlib import Path

from mindstage.maps import save_map
from mindstage.rdf import Finding
from mindstage.scene import Joint, World
from tests.maps.small_maps import ReadMap, assert_worlds_equal, knowledge_base_from

__all__ = [
    "check_round_trip",
    "finding_texts",
    "joint_range",
    "knowrob1_map",
    "matrix_turtle",
    "perception",
    "soma_map",
]

_PREFIXES = """
@prefix : <http://example.org/old.owl#> .
@prefix k: <http://knowrob.org/kb/knowrob.owl#> .
@prefix soma: <http://www.ease-crc.org/ont/SOMA.owl#> .
@prefix dul: <http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#> .
@prefix urdf: <http://knowrob.org/kb/urdf.owl#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
"""
_IDENTITY = (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)


def knowrob1_map(*statements: str) -> str:
    """Returns a map of dialect 4."""
    return "\n".join((_PREFIXES, ":old a k:SemanticEnvironmentMap .", *statements))


def soma_map(*statements: str) -> str:
    """Returns a map of dialect 5."""
    return "\n".join((_PREFIXES, "<http://example.org/old.owl> a owl:Ontology .", *statements))


def matrix_turtle(name: str, *position: float, **elements: float | str | None) -> str:
    """Returns an identity matrix with a position; other elements are overridden, and None omits one."""
    values: dict[str, float | str | None] = {f"m{n // 4}{n % 4}": value for n, value in enumerate(_IDENTITY)}
    values |= dict(zip(("m03", "m13", "m23"), position, strict=True)) | elements
    parts = (f' ; k:{key} "{value}"^^xsd:float' for key, value in values.items() if value is not None)
    return f":{name} a k:RotationMatrix3D{''.join(parts)} ."


def perception(individual: str, time: str, *position: float, **elements: float | str | None) -> str:
    """Returns a perception of an individual at a time."""
    name = f"{individual}-{time}"
    return f""":see-{name} a k:SemanticMapPerception ; k:objectActedOn :{individual} ;
        k:startTime :timepoint_{time} ; k:eventOccursAt :at-{name} .
    {matrix_turtle(f"at-{name}", *position, **elements)}"""


def joint_range(joint: Joint) -> tuple[float, float]:
    """Returns the lower and upper limit of a joint along or about x, relative to its initial pose."""
    linear, angular = joint.linear, joint.angular
    middle, limit = linear.x_middle + angular.twist_middle, linear.limit + angular.twist_limit
    return middle - limit, middle + limit


def finding_texts(findings: tuple[Finding, ...], name: str) -> str:
    """Returns all findings about an individual as one text."""
    return "\n".join(str(finding) for finding in findings if finding.individual.endswith(f"#{name}"))


def check_round_trip(read: ReadMap, text: str, folder: Path) -> World:
    """Returns the world of a map after checking that writing and reading it gives the same world."""
    world, _ = read(text)
    path = folder / "back.owl"
    save_map(world, path)
    assert_worlds_equal(world, knowledge_base_from(path).world(world.iri))
    return world
