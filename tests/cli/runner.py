"""Types of the fixtures, and small maps for commands."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from typer.testing import Result

__all__ = ["Run", "WriteMap", "json_output", "map_text"]

Run = Callable[..., Result]
WriteMap = Callable[..., Path]


def json_output(result: Result) -> Any:
    """Parses the JSON on stdout."""
    return json.loads(result.stdout)


_HEAD = """<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE rdf:RDF [
  <!ENTITY xsd "http://www.w3.org/2001/XMLSchema#">
  <!ENTITY knowrob "http://knowrob.org/kb/knowrob.owl#">
  <!ENTITY room "http://example.org/room.owl#">
]>
<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:owl="http://www.w3.org/2002/07/owl#"
         xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#" xmlns:knowrob="&knowrob;">
  <owl:Ontology rdf:about="http://example.org/room.owl"/>
  <owl:Class rdf:about="&knowrob;Mug"/>
"""


def _map(name: str) -> str:
    return (
        f'  <owl:NamedIndividual rdf:about="&room;{name}">'
        '<rdf:type rdf:resource="&knowrob;SemanticEnvironmentMap"/></owl:NamedIndividual>\n'
    )


def _mug(name: str, map: str, at: str | None) -> str:
    pose = f'<knowrob:pose rdf:resource="&room;{name}-pose"/>' if at is not None else ""
    pose_text = (
        f'  <owl:NamedIndividual rdf:about="&room;{name}-pose"><rdf:type rdf:resource="&knowrob;Pose"/>'
        f'<knowrob:translation rdf:datatype="&xsd;string">{at}</knowrob:translation>'
        '<knowrob:quaternion rdf:datatype="&xsd;string">1.0 0.0 0.0 0.0</knowrob:quaternion>'
        "</owl:NamedIndividual>\n"
    )
    return (
        f'  <owl:NamedIndividual rdf:about="&room;{name}"><rdf:type rdf:resource="&knowrob;Mug"/>'
        f'<knowrob:describedInMap rdf:resource="&room;{map}"/>{pose}'
        '<knowrob:mobility rdf:datatype="&xsd;string">static</knowrob:mobility>'
        "</owl:NamedIndividual>\n" + (pose_text if at is not None else "")
    )


def map_text(maps: list[str], mugs: dict[str, str | None]) -> str:
    """Maps, the first of which contains mugs: name to position, or to None for a mug without a pose."""
    individuals = "".join(_mug(mug, (maps or ["Room"])[0], position) for mug, position in mugs.items())
    return f"{_HEAD}{''.join(map(_map, maps))}{individuals}</rdf:RDF>\n"
