"""What a map of a generated home states, by rdflib and the words of the dialects; in meters, z up, right-handed."""

import re
from typing import Any, NamedTuple

import numpy as np
from rdflib import OWL, RDF, RDFS, Graph, Namespace
from scipy.spatial.transform import Rotation

__all__ = ["Stated", "read_stated"]

K, URDF = Namespace("http://knowrob.org/kb/knowrob.owl#"), Namespace("http://knowrob.org/kb/urdf.owl#")
SOMA = Namespace("http://www.ease-crc.org/ont/SOMA.owl#")
DUL = Namespace("http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#")
OVER = RDFS.subClassOf
SIZE = (K.depthOfObject, K.widthOfObject, K.heightOfObject)
MIRROR = np.diag([1.0, -1.0, 1.0])
FREE = {"xMotion": 0, "yMotion": 1, "zMotion": 2, "twistMotion": 0, "swing2Motion": 1, "swing1Motion": 2}


class Stated(NamedTuple):
    bodies: dict[str, tuple[Any, Any, Any, str]]  # position, rotation, the three numbers of the size, class
    joints: dict[str, tuple[set[str], Any, Any, float | None]]  # ends, origin, axis, travel; None where not stated


def read_stated(text: str, dialect: str) -> Stated:
    """Reads a map; the document type of early SemLog is repaired first, as SWI-Prolog reads it."""
    text = re.sub(r'(rdf:about="[^"]*") \1', r"\1", re.sub(r"<!ENTITY ([\w-]+)\"", r'<!ENTITY \1 "', text))
    stated = Stated({}, {})
    read = {"knowrob1": _knowrob1, "soma": _soma}.get(dialect, _logged)
    read(Graph().parse(data=text, format="xml"), stated, dialect)
    return stated


def _logged(graph: Graph, stated: Stated, dialect: str) -> None:
    for thing in graph.subjects(K.pose):
        pose, cls, name = graph.value(thing, K.pose), _class(graph, thing), _local(thing)
        position, quaternion = _row(graph, pose, K.translation), _row(graph, pose, K.quaternion)
        axes, unit = Rotation.from_quat(quaternion, scalar_first=dialect != "ameva").as_matrix(), 1.0
        if dialect == "ameva":
            axes, position, unit = MIRROR @ axes @ MIRROR, 0.01 * MIRROR @ position, 0.01
        parent, child = graph.value(thing, K.parent), graph.value(thing, K.child)
        if cls == K.Constraint:
            parts = [graph.value(thing, part) for part in (K.linearConstraint, K.angularConstraint)]
            facts = {_local(p): str(o) for part in parts for p, o in graph.predicate_objects(part)}
            (free,) = (each for each in FREE if int(facts[each]) < 2)
            travel = float(facts["limit" if free[1] == "M" else free.replace("Motion", "Limit")])
            stated.joints[name] = {_local(parent), _local(child)}, position, axes[:, FREE[free]], travel
        elif cls in (K.LinearJoint, K.RevoluteJoint):
            stated.joints[name] = {_local(parent), _local(graph.value(parent, K.parent))}, position, None, None
        else:
            values = {graph.value(e, OWL.onProperty): graph.value(e, OWL.hasValue) for e in graph[cls:OVER]}
            size = unit * np.array([float(values[each]) for each in SIZE])
            stated.bodies[name] = position, axes, size, _local(cls)


def _knowrob1(graph: Graph, stated: Stated, _: str) -> None:
    latest: dict[Any, tuple[str, Any]] = {}
    for event in graph.subjects(RDF.type, K.SemanticMapPerception):
        thing, seen = graph.value(event, K.objectActedOn), (_local(graph.value(event, K.startTime)), event)
        latest[thing] = max(latest.get(thing, seen), seen, key=lambda each: each[0])
    for thing, (_, event) in latest.items():
        cells = [K[f"m{cell // 4}{cell % 4}"] for cell in range(16)]
        rows = _floats(graph, graph.value(event, K.eventOccursAt), cells).reshape(4, 4)
        if ends := {_local(each) for each in graph[thing : K["connectedTo-Rigidly"]]}:
            vector = graph.value(thing, K.direction)
            axis = rows[:3, 2] if vector is None else _floats(graph, vector, [K[f"vector{each}"] for each in "XYZ"])
            low, high = _floats(graph, thing, (K.minJointValue, K.maxJointValue))
            stated.joints[_local(thing)] = ends, rows[:3, 3], axis, high - low
        else:
            stated.bodies[_local(thing)] = rows[:3, 3], rows[:3, :3], _floats(graph, thing, SIZE), ""


def _soma(graph: Graph, stated: Stated, _: str) -> None:
    for thing, place in graph.subject_objects(SOMA.hasLocalization):
        pose, shape = graph.value(place, SOMA.hasSpaceRegion), graph.value(thing, SOMA.hasShape)
        axes = Rotation.from_quat(_row(graph, pose, K.quaternion)).as_matrix()
        size = _floats(graph, graph.value(shape, DUL.hasRegion), (SOMA.hasDepth, SOMA.hasWidth, SOMA.hasHeight))
        stated.bodies[_local(thing)] = _row(graph, pose, K.translation), axes, size, ""
    for joint in graph.objects(None, URDF.hasJoint):
        ends = {_local(graph.value(joint, URDF[f"has{end}Link"])) for end in ("Parent", "Child")}
        values = [graph.value(each, OWL.hasValue) for each in graph[_class(graph, joint) : OVER]]
        low, high = _floats(graph, next(filter(None, values)), (URDF.hasLowerLimit, URDF.hasUpperLimit))
        stated.joints[_local(joint)] = ends, None, None, high - low


def _floats(graph: Graph, subject: Any, properties: Any) -> np.ndarray:
    return np.array([float(graph.value(subject, each)) for each in properties])


def _row(graph: Graph, subject: Any, property: Any) -> np.ndarray:
    return np.array([float(each) for each in str(graph.value(subject, property)).split()])


def _class(graph: Graph, thing: Any) -> Any:
    return next(cls for cls in graph[thing : RDF.type] if cls != OWL.NamedIndividual)


def _local(term: Any) -> str:
    return str(term).rpartition("#")[2]
