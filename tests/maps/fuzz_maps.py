"""Small valid maps, one of each dialect, and Hypothesis strategies that mutate maps and robot descriptions."""

from __future__ import annotations

from copy import deepcopy
from typing import Any, NamedTuple
from xml.etree import ElementTree

import pyoxigraph as ox
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from tests.maps.corruption import INVALID_TEXTS
from tests.maps.dialect_maps import knowrob1_map, matrix_turtle, perception, soma_map
from tests.maps.small_maps import XSD, body_turtle, room_map, slide_joint
from tests.maps.small_urdf import KITCHEN_URDF

__all__ = ["LINKED_MAP", "MAPS_BY_DIALECT", "MutatedMap", "mutated_maps", "mutated_urdfs"]

_SIZES = "k:Cup rdfs:subClassOf {} .".format(
    ", ".join(
        f'[ a owl:Restriction ; owl:onProperty k:{axis}OfObject ; owl:hasValue "{extent}"^^xsd:float ]'
        for axis, extent in (("depth", 10), ("width", 20), ("height", 30))
    )
)
_SEMLOG = room_map(
    body_turtle("table", 'k:mobility "static" ; k:mass "20.0"^^xsd:float ; k:tagsData "SemLog;Id,t;" ; k:child :cup'),
    body_turtle("cup", 'ms:material [ ms:index 0 ; ms:name "glaze" ] ; rdfs:label "cup"'),
    body_turtle("box", 'k:depthOfObject "1.0"^^xsd:float ; k:gravity true ; k:pathToCadModel "package://a/b.dae"'),
    body_turtle("lamp", cls="ms:SpotLight"),
    slide_joint("slide", "table", "box"),
    _SIZES,
)
_EARLY = room_map(
    body_turtle("wall", 'k:tagsData "SemLog;Class,Wall;Mobility,Static;"', position="0 0 0"),
    body_turtle("door", 'k:tagsData "SemLog;Class,Door;Mobility,Dynamic;"', "k:parent :hinge"),
    slide_joint("hinge", "wall", "door").replace(" ; k:describedInMap :room", ""),
)
_AMEVA = room_map(
    _SIZES,
    "k:Cup k:mass 3.0 .",
    body_turtle(
        "fridge", 'k:maskColor "FD1ACDFF" ; k:child :door', position="100.0 200.0 75.0", quaternion="0.0 0.0 0.0 1.0"
    ),
    body_turtle("door", "k:parent :fridge", cls="k:Door", position="126.0 200.0 96.0", quaternion="0.0 0.0 0.7 0.7"),
    body_turtle(
        "hinge", "k:parent :door", cls="k:RevoluteJoint", position="126.0 172.0 97.0", quaternion="0.0 0.0 0.0 1.0"
    ),
    body_turtle(
        "slide", "k:parent :cup", cls="k:LinearJoint", position="130.0 200.0 36.0", quaternion="0.0 0.0 0.0 1.0"
    ),
    body_turtle(
        "cup", "k:parent :fridge", 'k:levelName "Task"', position="100.0 210.0 36.0", quaternion="0.0 0.0 0.0 1.0"
    ),
)
_BOX = 'k:depthOfObject "0.6"^^xsd:float ; k:widthOfObject "-0.8"^^xsd:float ; k:heightOfObject "1.0"^^xsd:float'
_KNOWROB1 = knowrob1_map(
    ":cupboard a k:Cupboard ; k:describedInMap :old ; k:orientation :m ; k:properPhysicalParts :door, :hinge ;",
    f"    {_BOX} .",
    matrix_turtle("m", 0, 0, 1),
    f":door a k:Door ; k:orientation :n ; k:properPhysicalParts :grip ; k:hingedTo :cupboard ; {_BOX} .",
    matrix_turtle("n", 0.3, 0, 1, m11=-1),
    f":grip a k:Handle ; {_BOX} .",
    perception("grip", "200", 0.35, 0.3, 1),
    perception("grip", "1000", 0.36, 0.3, 1),
    ':hinge a k:HingedJoint ; k:connectedTo-Rigidly :door ; k:turnRadius "0.7" ; k:minJointValue "-0.1"^^xsd:float ;',
    '    k:maxJointValue "1.57"^^xsd:float ; k:direction [ k:vectorX 0.0 ; k:vectorY 0.0 ; k:vectorZ 1.0 ] .',
)


def _soma_individual(name: str, position: str, *facts: str) -> str:
    return f""":{name} a owl:NamedIndividual, soma:{name.title()} ;
        soma:hasShape [ a soma:Shape ; dul:hasRegion [ a soma:BoxShape ; soma:hasDepth 0.5 ; soma:hasWidth 0.6 ;
            soma:hasHeight 0.7 ] ] ;
        soma:hasColor [ dul:hasRegion [ soma:hasRGBValue "0.1 0.2 0.3"^^soma:array_double ] ] ;
        soma:hasLocalization [ a soma:Localization ; soma:hasSpaceRegion [ a soma:6DPose ; soma:isRelativeTo :case ;
            k:quaternion "0.0 0.0 0.0 1.0"^^soma:array_double ; k:translation "{position}"^^soma:array_double ] ] ;
        {" ; ".join(facts)} ."""


_SOMA = soma_map(
    _soma_individual(
        "case",
        "0.0 0.0 1.0",
        "urdf:hasJoint [ a :door_joint ; urdf:hasParentLink :case ; urdf:hasChildLink :door ;"
        ' urdf:hasAxisVector "0 0 1" ; urdf:hasOrigin [ urdf:hasXYZ "0.1 0.2 0.3" ] ]',
    ),
    _soma_individual("door", "-0.3 0.0 0.0", "soma:hasPhysicalComponent :grip"),
    _soma_individual("grip", "-0.4 -0.2 0.0", "dul:isComponentOf :door"),
    ":door_joint a owl:Class ; rdfs:subClassOf urdf:RevoluteJoint , [ a owl:Restriction ;",
    "    owl:onProperty urdf:hasJointLimits ; owl:hasValue [ urdf:hasLowerLimit 0.0 ; urdf:hasUpperLimit 1.57 ] ] .",
)
LINKED_MAP = soma_map(
    ':drawer a owl:NamedIndividual, soma:Drawer ; urdf:hasBaseLinkName "counter_drawer_main" ;',
    "    soma:hasPhysicalComponent :grip .",
    ':grip a owl:NamedIndividual, soma:DesignedHandle ; urdf:hasEndLinkName "counter_drawer_handle" .',
    ':cooler a soma:Refrigerator ; urdf:hasBaseLinkName "fridge" ; urdf:hasEndLinkName "fridge_door_link" .',
)
"""A map that takes its poses from `small_urdf.KITCHEN_URDF`."""

MAPS_BY_DIALECT = {
    "SemLog": _SEMLOG,
    "SemLog, early": _EARLY,
    "AMEVA": _AMEVA,
    "KnowRob 1": _KNOWROB1,
    "SOMA": _SOMA,
    "SOMA and a robot": LINKED_MAP,
}

_QUADS = {name: list(ox.parse(text, ox.RdfFormat.TURTLE)) for name, text in MAPS_BY_DIALECT.items()}
_ALL_QUADS = [quad for quads in _QUADS.values() for quad in quads]
_PROPERTIES = sorted({quad.predicate for quad in _ALL_QUADS}, key=str)
_DATATYPES = [ox.NamedNode(XSD + name) for name in ("string", "float", "integer", "boolean", "dateTime")]
_LITERALS = st.sampled_from(INVALID_TEXTS).flatmap(
    lambda text: st.sampled_from(
        [*(ox.Literal(text, datatype=kind) for kind in _DATATYPES), ox.Literal(text, language="de")]
    )
)


class MutatedMap(NamedTuple):
    """A mutated map; its repr lists the changes only."""

    quads: list[ox.Quad]
    changes: list[str]

    def __repr__(self) -> str:
        return "\n".join(["a map with", *self.changes])


@st.composite
def mutated_maps(draw: st.DrawFn, dialect: str) -> MutatedMap:
    """A valid map with statements removed, added or repeated, or with other subjects, properties or values."""
    quads, changes = list(_QUADS[dialect]), []
    nodes = sorted({quad.subject for quad in quads} | {quad.object for quad in quads if _is_node(quad)}, key=str)
    ghosts = [ox.NamedNode("http://example.org/old.owl#ghost"), ox.BlankNode("ghost")]
    subjects = st.sampled_from([*nodes, *ghosts])
    properties = st.sampled_from(_PROPERTIES)
    values = (
        subjects
        | _LITERALS
        | st.sampled_from([quad.object for quad in _ALL_QUADS if not isinstance(quad.object, ox.BlankNode)])
    )
    for _ in range(draw(st.integers(1, 6))):
        at = draw(st.integers(0, len(quads) - 1))
        old = quads[at]
        how = draw(st.sampled_from(["drop", "value", "value", "subject", "property", "more", "again"]))
        subject = draw(subjects) if how in ("subject", "more") else old.subject
        property = draw(properties) if how in ("property", "more") else old.predicate
        value = draw(values) if how in ("value", "more", "again") else old.object
        new = None if how == "drop" else ox.Quad(subject, property, value)
        quads[at : at + 1] = [quad for quad in (old if how in ("more", "again") else None, new) if quad is not None]
        changes.append(f"{how}: {old} -> {new}")
    return MutatedMap(quads, changes)


def _is_node(quad: ox.Quad) -> bool:
    return isinstance(quad.object, ox.NamedNode | ox.BlankNode)


def mutated_urdfs() -> SearchStrategy[str]:
    """A valid robot description with elements moved, repeated or removed, and invalid attributes."""
    return _robot_trees().map(lambda root: ElementTree.tostring(root, encoding="unicode"))


@st.composite
def _robot_trees(draw: st.DrawFn) -> Any:
    root = ElementTree.fromstring(KITCHEN_URDF)
    for _ in range(draw(st.integers(1, 6))):
        parents = [element for element in root.iter() if len(element)]
        if not parents:
            break
        parent = draw(st.sampled_from(parents))
        at = draw(st.integers(0, len(parent) - 1))
        element = parent[at]
        match draw(st.sampled_from(["drop", "again", "move", "attribute", "attribute", "attribute", "tag"])):
            case "drop":
                parent.remove(element)
            case "again":
                parent.insert(at, deepcopy(element))
            case "move":
                draw(st.sampled_from(parents)).append(deepcopy(element))
            case "tag":
                element.tag = draw(st.sampled_from(["link", "joint", "mesh", "box", "origin", "limit", "robot", "x"]))
            case _:
                key = draw(st.sampled_from([*element.keys(), "name", "link", "filename", "scale"]))
                names = [other.get(key) or "" for other in root.iter() if other.get(key)]
                element.set(key, draw(st.sampled_from([*names, *filter(_is_valid_xml_text, INVALID_TEXTS)])))
    return root


def _is_valid_xml_text(text: str) -> bool:
    return "\0" not in text
