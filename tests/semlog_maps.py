"""Maps in the dialect of SemLog's loggers of 2018, whose only statement about mobility is a tag."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from mindstage.scene import Vector

__all__ = ["Actor", "semlog_map"]

_HEADER = """<?xml version="1.0"?>
<!DOCTYPE rdf:RDF [
  <!ENTITY owl "http://www.w3.org/2002/07/owl#">
  <!ENTITY xsd "http://www.w3.org/2001/XMLSchema#">
  <!ENTITY knowrob "http://knowrob.org/kb/knowrob.owl#">
  <!ENTITY lab "http://knowrob.org/kb/Lab.owl#">
]>
<rdf:RDF xmlns:owl="http://www.w3.org/2002/07/owl#" xmlns:knowrob="http://knowrob.org/kb/knowrob.owl#"
  xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#" xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<owl:Ontology rdf:about="http://knowrob.org/kb/Lab.owl"/>
<owl:NamedIndividual rdf:about="&lab;map">
<rdf:type rdf:resource="&knowrob;SemanticEnvironmentMap"/></owl:NamedIndividual>
"""
_RESTRICTION = """<rdfs:subClassOf><owl:Restriction><owl:onProperty rdf:resource="&knowrob;{property}"/>
<owl:hasValue rdf:datatype="&xsd;float">{value}</owl:hasValue></owl:Restriction></rdfs:subClassOf>
"""
_CLASS = """<owl:Class rdf:about="&knowrob;{name}">
{sizes}</owl:Class>
"""
_ACTOR = """<owl:NamedIndividual rdf:about="&lab;{id}"><rdf:type rdf:resource="&knowrob;{cls}"/>
<knowrob:describedInMap rdf:resource="&lab;map"/><knowrob:pose rdf:resource="&lab;pose_{id}"/>
<knowrob:tagsData rdf:datatype="&xsd;string">SemLog;Mobility,{mobility};Class,{cls};Id,{id};</knowrob:tagsData>
</owl:NamedIndividual>
<owl:NamedIndividual rdf:about="&lab;pose_{id}"><rdf:type rdf:resource="&knowrob;Pose"/>
<knowrob:quaternion rdf:datatype="&xsd;string">1.000000 0.000000 0.000000 0.000000</knowrob:quaternion>
<knowrob:translation rdf:datatype="&xsd;string">{x} {y} {z}</knowrob:translation></owl:NamedIndividual>
"""
_SIZES = ("depthOfObject", "widthOfObject", "heightOfObject")


class Actor(NamedTuple):
    """An actor of the game engine; all actors of a class have one size."""

    id: str
    cls: str
    position: Vector
    size: Vector
    mobility: str = "Dynamic"


def semlog_map(path: Path, actors: Iterable[Actor]) -> Path:
    """Writes a map and returns its path."""
    listed = list(actors)
    text = [_HEADER]
    for cls, size in {actor.cls: actor.size for actor in listed}.items():
        sizes = "".join(_RESTRICTION.format(property=p, value=v) for p, v in zip(_SIZES, size, strict=True))
        text.append(_CLASS.format(name=cls, sizes=sizes))
    for actor in listed:
        x, y, z = actor.position
        text.append(_ACTOR.format(id=actor.id, cls=actor.cls, mobility=actor.mobility, x=x, y=y, z=z))
    path.write_text("".join(text) + "</rdf:RDF>\n", encoding="utf-8")
    return path
