"""Generates large maps in three dialects: rows of cupboards, each with a drawer, its slide joint, a handle and a cup.

`python -m benchmarks.large_maps DIALECT INDIVIDUALS FILE` writes one; poses and similar resources are not counted.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

__all__ = ["DIALECTS", "large_map"]

_HEAD = """<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE rdf:RDF [
\t<!ENTITY owl "http://www.w3.org/2002/07/owl#">
\t<!ENTITY xsd "http://www.w3.org/2001/XMLSchema#">
\t<!ENTITY knowrob "http://knowrob.org/kb/knowrob.owl#">
\t<!ENTITY soma "http://www.ease-crc.org/ont/SOMA.owl#">
\t<!ENTITY urdf "http://knowrob.org/kb/urdf.owl#">
\t<!ENTITY m "http://example.org/large.owl#">
]>
<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#"
\txmlns:owl="&owl;" xmlns:xsd="&xsd;" xmlns:knowrob="&knowrob;" xmlns:soma="&soma;"
\txmlns:dul="http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#" xmlns:urdf="&urdf;">
\t<owl:Ontology rdf:about="http://example.org/large.owl"/>
"""
_KINDS = (
    ("Cupboard", (0.6, 0.6, 0.9)),
    ("Drawer", (0.5, 0.5, 0.2)),
    ("Handle", (0.02, 0.3, 0.02)),
    ("Cup", (0.1, 0.1, 0.1)),
)
_PER_GROUP = 5
"""Four bodies and a joint."""


def large_map(dialect: str, individuals: int) -> str:
    """The text of a map with that number of individuals."""
    parts = (_GROUPS[dialect](number) for number in range(individuals // _PER_GROUP))
    return "".join((_HEAD, _MAPS[dialect], *("".join(part) for part in parts), "</rdf:RDF>\n"))


def _bodies(number: int) -> Iterator[tuple[str, str, tuple[float, float, float], tuple[float, float, float]]]:
    """The bodies of a group: name, class, position and extents [m]."""
    x, y = number % 100 * 2.0, number // 100 * 3.0
    offsets = ((0.0, 0.0, 0.45), (0.05, 0.0, 0.7), (0.32, 0.0, 0.7), (0.0, 0.1, 0.95))
    for (kind, size), (dx, dy, z) in zip(_KINDS, offsets, strict=True):
        yield f"{kind}{number}", kind, (x + dx, y + dy, z), size


def _element(about: str, cls: str, *statements: str) -> str:
    lines = "".join(f"\t\t{statement}\n" for statement in statements)
    begin = f'\t<owl:NamedIndividual rdf:about="&m;{about}">\n\t\t<rdf:type rdf:resource="{cls}"/>\n'
    return f"{begin}{lines}\t</owl:NamedIndividual>\n"


def _link(property: str, name: str) -> str:
    return f'<{property} rdf:resource="&m;{name}"/>'


def _literal(property: str, value: object, kind: str = "float") -> str:
    return f'<{property} rdf:datatype="&xsd;{kind}">{value}</{property}>'


def _row(*numbers: float) -> str:
    return " ".join(f"{number:.6f}" for number in numbers)


# -- SemLog ------------------------------------------------------------------------------------------------------------


def _semlog(number: int) -> Iterator[str]:
    for name, kind, at, _ in _bodies(number):
        child = [_link("knowrob:child", f"Handle{number}")] if kind == "Drawer" else []
        yield _element(
            name,
            f"&knowrob;{kind}",
            _link("knowrob:describedInMap", "map"),
            *child,
            _literal("knowrob:mobility", "static" if kind == "Cupboard" else "dynamic", "string"),
            _literal("knowrob:mass", 1.5),
            _literal("knowrob:gravity", "true", "boolean"),
            _literal("knowrob:pathToCadModel", f"package://large/{kind}.dae", "string"),
            _literal("knowrob:tagsData", f"SemLog;Class,{kind};Id,{name};", "string"),
            _link("knowrob:pose", f"{name}Pose"),
        )
        yield _pose(f"{name}Pose", at)
    ends = (_link("knowrob:parent", f"Cupboard{number}"), _link("knowrob:child", f"Drawer{number}"))
    parts = [_link(f"knowrob:{part}", f"Slide{number}{part}") for part in ("linearConstraint", "angularConstraint")]
    slide = f"Slide{number}"
    statements = (_link("knowrob:describedInMap", "map"), *ends, _link("knowrob:pose", f"{slide}Pose"), *parts)
    yield _element(slide, "&knowrob;Constraint", *statements)
    yield _pose(f"{slide}Pose", (number % 100 * 2.0, number // 100 * 3.0, 0.7))
    motions = [_literal(f"knowrob:{axis}Motion", 1 if axis == "x" else 2, "integer") for axis in "xyz"]
    yield _element(f"{slide}linearConstraint", "&knowrob;LinearConstraint", *motions, _literal("knowrob:limit", 0.2))
    turns = [_literal(f"knowrob:{turn}Motion", 2, "integer") for turn in ("swing1", "swing2", "twist")]
    yield _element(f"{slide}angularConstraint", "&knowrob;AngularConstraint", *turns)


def _pose(name: str, at: tuple[float, float, float]) -> str:
    place = _literal("knowrob:translation", _row(*at), "string")
    return _element(
        name, "&knowrob;Pose", place, _literal("knowrob:quaternion", "1.000000 0.000000 0.000000 0.000000", "string")
    )


def _sized_classes() -> Iterator[str]:
    for kind, size in _KINDS:
        restrictions = "".join(
            f'<rdfs:subClassOf><owl:Restriction><owl:onProperty rdf:resource="&knowrob;{axis}OfObject"/>'
            f"{_literal('owl:hasValue', extent)}</owl:Restriction></rdfs:subClassOf>"
            for axis, extent in zip(("depth", "width", "height"), size, strict=True)
        )
        yield f'\t<owl:Class rdf:about="&knowrob;{kind}">{restrictions}</owl:Class>\n'


# -- KnowRob 1 ---------------------------------------------------------------------------------------------------------


def _knowrob1(number: int) -> Iterator[str]:
    for name, kind, at, size in _bodies(number):
        extents = [
            _literal(f"knowrob:{axis}OfObject", one)
            for axis, one in zip(("depth", "width", "height"), size, strict=True)
        ]
        parts = {
            "Cupboard": [_link("knowrob:describedInMap", "map")],
            "Drawer": [_link("knowrob:properPhysicalParts", f"Handle{number}")],
            "Cup": [_link("knowrob:describedInMap", "map")],
        }.get(kind, [])
        if kind == "Cupboard":
            parts += [_link("knowrob:properPhysicalParts", f"{part}{number}") for part in ("Drawer", "Slide")]
        yield _element(name, f"&knowrob;{kind}", *extents, *parts)
        for time in (1000 + number, 2000 + number):
            seen = f"{name}seen{time}"
            when = _link("knowrob:startTime", f"timepoint_{time}")
            statements = (_link("knowrob:objectActedOn", name), _link("knowrob:eventOccursAt", f"{seen}at"), when)
            yield _element(seen, "&knowrob;SemanticMapPerception", *statements)
            yield _element(f"{seen}at", "&knowrob;RotationMatrix3D", *_matrix(at))
    limits = (_literal("knowrob:minJointValue", 0.0), _literal("knowrob:maxJointValue", 0.4))
    rigid = _link("knowrob:connectedTo-Rigidly", f"Drawer{number}")
    yield _element(f"Slide{number}", "&knowrob;PrismaticJoint", rigid, *limits)


def _matrix(at: tuple[float, float, float]) -> Iterator[str]:
    for row in range(4):
        for column in range(4):
            value = at[row] if column == 3 and row < 3 else float(row == column)
            yield _literal(f"knowrob:m{row}{column}", f"{value:.6f}")


# -- SOMA --------------------------------------------------------------------------------------------------------------


def _soma(number: int) -> Iterator[str]:
    for name, kind, at, size in _bodies(number):
        extents = "".join(
            _literal(f"soma:has{axis}", one) for axis, one in zip(("Depth", "Width", "Height"), size, strict=True)
        )
        pose = _array("knowrob:translation", _row(*at)) + _array("knowrob:quaternion", "0.0 0.0 0.0 1.0")
        ends = _link("urdf:hasParentLink", name) + _link("urdf:hasChildLink", f"Drawer{number}")
        joint = _nested("urdf:hasJoint", f"&m;Slide{number}", ends)
        part = {"Cupboard": [joint], "Drawer": [_link("soma:hasPhysicalComponent", f"Handle{number}")]}.get(kind, [])
        yield _element(
            name,
            f"&soma;{kind}",
            _nested("soma:hasShape", "&soma;Shape", _nested("dul:hasRegion", "&soma;BoxShape", extents)),
            _nested("soma:hasLocalization", "&soma;Localization", _nested("soma:hasSpaceRegion", "&soma;6DPose", pose)),
            *part,
        )
    limits = "<urdf:hasLowerLimit>0.0</urdf:hasLowerLimit><urdf:hasUpperLimit>0.4</urdf:hasUpperLimit>"
    value = _nested("owl:hasValue", "&urdf;JointLimits", limits)
    on = f'<owl:onProperty rdf:resource="&urdf;hasJointLimits"/>{value}'
    above = (
        f'<rdfs:subClassOf rdf:resource="&urdf;PrismaticJoint"/>{_nested("rdfs:subClassOf", "&owl;Restriction", on)}'
    )
    yield f'\t<owl:Class rdf:about="&m;Slide{number}">{above}</owl:Class>\n'


def _nested(property: str, cls: str, inner: str) -> str:
    return f'<{property}><rdf:Description><rdf:type rdf:resource="{cls}"/>{inner}</rdf:Description></{property}>'


def _array(property: str, row: str) -> str:
    return f'<{property} rdf:datatype="&soma;array_double">{row}</{property}>'


_MAP = _element("map", "&knowrob;SemanticEnvironmentMap")
_MAPS = {"SemLog": _MAP + "".join(_sized_classes()), "KnowRob 1": _MAP, "SOMA": ""}
_GROUPS: dict[str, Callable[[int], Iterator[str]]] = {"SemLog": _semlog, "KnowRob 1": _knowrob1, "SOMA": _soma}
DIALECTS = tuple(_GROUPS)


if __name__ == "__main__":
    Path(sys.argv[3]).write_text(large_map(sys.argv[1], int(sys.argv[2])), encoding="utf-8")
