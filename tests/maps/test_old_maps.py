"""Maps in old namespaces, in other encodings, without a map individual, and of SRDL 2, read and written back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rdflib
from rdflib.compare import to_canonical_graph

from mindstage.errors import MapNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import save_map
from mindstage.scene import Mobility, World
from tests.maps.small_maps import room_map

_TABLE = """<?xml version='1.0' encoding='{encoding}'?>
<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#"
    xmlns:owl="http://www.w3.org/2002/07/owl#" xmlns:k="{namespace}"{attributes}>
  <owl:NamedIndividual rdf:about="http://example.org/a.owl#map">
    <rdf:type rdf:resource="{namespace}SemanticEnvironmentMap"/></owl:NamedIndividual>
  <owl:NamedIndividual rdf:about="http://example.org/a.owl#t"><rdf:type rdf:resource="{namespace}Table"/>
    <rdfs:label>{label}</rdfs:label><k:describedInMap rdf:resource="http://example.org/a.owl#map"/>
    <k:pose rdf:resource="http://example.org/a.owl#p"/></owl:NamedIndividual>
  <owl:NamedIndividual rdf:about="http://example.org/a.owl#p"><rdf:type rdf:resource="{namespace}Pose"/>
    <k:quaternion>1 0 0 0</k:quaternion><k:translation>0 0 0.40</k:translation></owl:NamedIndividual>
</rdf:RDF>
"""
_NEW, _OLD = "http://knowrob.org/kb/knowrob.owl#", "http://ias.cs.tum.edu/kb/knowrob.owl#"


def table(*, encoding: str = "utf-8", namespace: str = _NEW, label: str = "Tisch", attributes: str = "") -> str:
    return _TABLE.format(encoding=encoding, namespace=namespace, label=label, attributes=attributes)


def read_and_write(path: Path) -> tuple[World, Path, str]:
    with KnowledgeBase() as kb:
        kb.load(path)
        world = kb.world()
        out = path.with_name("out.owl")
        save_map(world, out, source_view=kb.source_view())
        return world, out, "\n".join(map(str, (*kb.findings(), *kb.assumptions())))


def statements(path: Path) -> set[tuple[object, ...]]:
    """The statements of a file by rdflib; plain literals are texts, as in RDF 1.1."""
    graph = rdflib.Graph()
    graph.parse(path, format="turtle" if path.suffix == ".ttl" else "xml")
    plain = rdflib.XSD.string
    return {
        tuple(rdflib.Literal(str(node)) if getattr(node, "datatype", None) == plain else node for node in triple)
        for triple in to_canonical_graph(graph)
    }


@pytest.mark.parametrize(
    ("encoding", "codec", "label"),
    [
        ("US-ASCII", "ascii", "Tisch"),
        ("windows-1252", "cp1252", "K\u00fcche \u20ac"),
        ("ISO-8859-15", "iso-8859-15", "K\u00fcche \u20ac"),
        ("Shift_JIS", "shift_jis", "\u53f0\u6240"),
        ("UTF-16", "utf-16", "K\u00fcche"),
        ("UTF-16", "utf-16-be", "K\u00fcche"),
        ("UTF-32", "utf-32-le", "K\u00fcche"),
        ("IBM037", "cp037", "K\u00fcche"),
        ("cp1140", "cp1140", "K\u00fcche \u20ac"),
        ("UTF8", "utf-8", "K\u00fcche"),
    ],
)
def test_a_map_is_read_in_the_encoding_that_it_declares(tmp_path: Path, encoding: str, codec: str, label: str) -> None:
    path = tmp_path / "map.owl"
    path.write_bytes(table(encoding=encoding, label=label).encode(codec))
    world, out, notes = read_and_write(path)
    assert (world.bodies[0].label, world.bodies[0].pose.position) == (label, (0.0, 0.0, 0.4))
    assert "encoding" not in notes
    (tmp_path / "utf8.owl").write_text(table(label=label), encoding="utf-8")
    assert statements(out) == statements(tmp_path / "utf8.owl")


def test_bytes_beyond_a_declared_ascii_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "map.owl"
    path.write_bytes(table(encoding="US-ASCII", label="K\u00fcche").encode())
    world, _, notes = read_and_write(path)
    assert world.bodies[0].label == "K\u00fcche"
    assert "US-ASCII" in notes


def test_an_empty_base_is_that_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "map.owl"
    path.write_text(table(attributes=' xml:base=""'), encoding="utf-8")
    assert read_and_write(path)[0].bodies[0].id == "t"


def test_old_namespaces_are_read_and_written_back(tmp_path: Path) -> None:
    path = tmp_path / "map.owl"
    path.write_text(table(namespace=_OLD), encoding="utf-8")
    world, out, notes = read_and_write(path)
    assert world.bodies[0].cls == f"{_NEW}Table"
    assert "until 2013" in notes
    assert statements(out) == statements(path)


def test_each_name_keeps_its_namespace_where_both_are_used(tmp_path: Path) -> None:
    path = tmp_path / "map.ttl"
    path.write_text(
        f"@prefix o: <{_OLD}> . @prefix k: <{_NEW}> . @prefix e: <http://example.org/a.owl#> .\n"
        "e:map a o:SemanticEnvironmentMap . e:c a k:Wall ; k:describedInMap e:map ; o:pose e:p .\n"
        'o:wall2 a o:Wall2 ; k:describedInMap e:map ; o:pose e:p . e:p a o:Pose ; o:quaternion "1 0 0 0" ;'
        ' o:translation "0 0 1" .\n',
        encoding="utf-8",
    )
    world, out, _ = read_and_write(path)
    assert {body.id for body in world.bodies} == {"c", "wall2"}
    assert statements(out) == statements(path)


def test_a_scene_without_a_map_is_in_a_derived_one(tmp_path: Path) -> None:
    path = tmp_path / "scene.ttl"
    text = room_map(":part a k:Thing ; k:pose :p .", ':p a k:Pose ; k:quaternion "1 0 0 0" ; k:translation "1 2 3" .')
    path.write_text(text.replace(":room a owl:NamedIndividual, k:SemanticEnvironmentMap .", ""), encoding="utf-8")
    world, out, notes = read_and_write(path)
    assert [body.pose.position for body in world.bodies] == [(1.0, 2.0, 3.0)]
    assert "map: room, derived from scene.ttl" in notes
    assert statements(out) == statements(path)


def test_a_file_without_poses_is_to_be_loaded_as_an_ontology(tmp_path: Path) -> None:
    path = tmp_path / "classes.ttl"
    path.write_text("<urn:Cup> a <http://www.w3.org/2002/07/owl#Class> .", encoding="utf-8")
    with KnowledgeBase() as kb:
        kb.load(path)
        with pytest.raises(MapNotFoundError, match=r"load it as --ontology"):
            kb.world()


_ROBOT = """
@prefix r: <http://example.org/r.owl#> . @prefix k: <http://knowrob.org/kb/knowrob.owl#> .
@prefix s: <http://knowrob.org/kb/srdl2-comp.owl#> .
r:robot a r:Robot ; s:succeedingLink r:base .
r:base a s:UrdfLink ; s:box_size "0.4 0.3 0.2" ; s:mass_value 5 ; s:succeedingJoint r:lift, r:mount .
r:lift a s:PrismaticUrdfJoint ; s:succeedingLink r:arm ; s:axis_xyz "1 0 0" ; s:limit_lower 0 ; s:limit_upper 0.5 .
r:mount a s:FixedUrdfJoint ; s:succeedingLink r:camera .
r:arm a s:UrdfLink ; k:pathToCadModel "package://r/arm.stl" ; s:succeedingJoint r:wrist .
r:wrist a s:RevoluteUrdfJoint ; s:succeedingLink r:hand .
r:camera a s:UrdfLink . r:hand a s:UrdfLink ; s:sphere_radius 0.05 .
r:e1 a k:Proprioception ; k:objectActedOn r:lift ; k:eventOccursAt r:m1 .
r:e2 a k:Proprioception ; k:objectActedOn r:mount ; k:eventOccursAt r:m2 .
r:e3 a k:Proprioception ; k:objectActedOn r:wrist ; k:eventOccursAt r:m3 .
r:m1 k:translation "1 2 3" ; k:quaternion "0.8660254037844387 0 0 0.5" .
r:m2 k:translation "0 0 1" ; k:quaternion "1 0 0 0" .
r:m3 k:relativeTo r:m1 ; k:translation "2 0 0" ; k:quaternion "1 0 0 0" .
"""


def test_kinematics_of_srdl_give_bodies_and_joints(tmp_path: Path) -> None:
    path = tmp_path / "robot.ttl"
    path.write_text(_ROBOT, encoding="utf-8")
    world, out, notes = read_and_write(path)
    bodies = {body.id: body for body in world.bodies}
    assert {*bodies} == {"base", "arm", "camera", "hand"}
    # The arm is turned by 60 degrees about z, so that 2 m along its x axis are (1, sqrt(3)).
    assert bodies["hand"].pose.position == pytest.approx((2.0, 2.0 + np.sqrt(3.0), 3.0))
    assert (bodies["base"].size, bodies["base"].physics.mass_kg) == ((0.4, 0.3, 0.2), 5.0)
    assert bodies["arm"].mesh == "package://r/arm.stl"
    assert bodies["hand"].size == pytest.approx((0.1, 0.1, 0.1))
    assert bodies["camera"].size == (0.0, 0.0, 0.0)
    mobility = {id: body.physics.mobility for id, body in bodies.items()}
    assert mobility == dict.fromkeys(("arm", "hand"), Mobility.DYNAMIC) | dict.fromkeys(
        ("base", "camera"), Mobility.STATIC
    )
    assert [(each.parent, each.child) for each in world.attachments] == [("base", "camera")]
    joints = {joint.id: joint for joint in world.joints}
    assert {id: (joint.parent, joint.child) for id, joint in joints.items()} == {
        "lift": ("base", "arm"),
        "wrist": ("arm", "hand"),
    }
    lift = joints["lift"].linear
    assert (lift.x_middle - lift.limit, lift.x_middle + lift.limit) == pytest.approx((0.0, 0.5))
    # Along the arm's x axis: the joint's frame is turned by 60 degrees too.
    assert joints["lift"].pose.quaternion == pytest.approx((np.cos(np.pi / 6), 0.0, 0.0, 0.5))
    assert "joints: axis: the z axis of the joint's frame, assumed: 1 joints do not give it, such as wrist" in notes
    assert "error" not in notes
    assert statements(out) == statements(path)
