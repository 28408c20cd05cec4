"""Small maps of dialects 4 and 5 in Turtle, and what tests do with them."""

from __future__ import annotations

from pathlib import Path

from mindstage.knowledge import Finding, save_map
from mindstage.world import Constraint, World
from tests.knowledge.maps import Read, assert_same, knowing

__all__ = ["about", "comes_back", "knowrob1", "matrix", "perceived", "range_of", "soma"]

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
_UNIT = (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)


def knowrob1(*statements: str) -> str:
    """A map of dialect 4."""
    return "\n".join((_PREFIXES, ":old a k:SemanticEnvironmentMap .", *statements))


def soma(*statements: str) -> str:
    """A map of dialect 5."""
    return "\n".join((_PREFIXES, "<http://example.org/old.owl> a owl:Ontology .", *statements))


def matrix(name: str, *at: float, **elements: float | str | None) -> str:
    """A matrix without rotation, but for the elements that are told; None leaves one out."""
    told: dict[str, float | str | None] = {f"m{n // 4}{n % 4}": value for n, value in enumerate(_UNIT)}
    told |= dict(zip(("m03", "m13", "m23"), at, strict=True)) | elements
    parts = (f' ; k:{key} "{value}"^^xsd:float' for key, value in told.items() if value is not None)
    return f":{name} a k:RotationMatrix3D{''.join(parts)} ."


def perceived(thing: str, when: str, *at: float, **elements: float | str | None) -> str:
    """A thing seen somewhere at some time."""
    name = f"{thing}-{when}"
    return f""":see-{name} a k:SemanticMapPerception ; k:objectActedOn :{thing} ;
        k:startTime :timepoint_{when} ; k:eventOccursAt :at-{name} .
    {matrix(f"at-{name}", *at, **elements)}"""


def range_of(constraint: Constraint) -> tuple[float, float]:
    """From where to where the child may go, along or about x, seen from where it was spawned."""
    linear, angular = constraint.linear, constraint.angular
    middle, limit = linear.x_middle + angular.twist_middle, linear.limit + angular.twist_limit
    return middle - limit, middle + limit


def about(findings: tuple[Finding, ...], name: str) -> str:
    """All that was found about one thing, in one text."""
    return "\n".join(str(finding) for finding in findings if finding.individual.endswith(f"#{name}"))


def comes_back(read: Read, text: str, folder: Path) -> World:
    """A world whose written map gives the same world, and has all that was told in it."""
    world, _ = read(text)
    path = folder / "back.owl"
    save_map(world, path)
    assert_same(world, knowing(path).world(world.iri))
    return world
